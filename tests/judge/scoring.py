"""Who was right: an answer of the diagnosis against what was hidden."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from .cases import Made

Findings = Sequence[Mapping[str, Any]]
Separates = Callable[[str, str], bool]
"""Whether the motion that is proposed between two effects, both "effect@joint", tells them apart in simulation."""

MIMIC = 1.05
"""Physics that the library lacks, explained to within this multiple of the floor, is a mimic and not an error."""
NEAR_LINE = 0.01
"""An order that is found within this part of a hidden one is that one."""
ALIKE = (frozenset(("linear_spring", "gravity", "cable", "parallel_spring")), frozenset(("torque_delay", "elasticity")))
"""Within these a rival counts as right where the proposed experiment separates it from the truth."""


@dataclass(frozen=True)
class Score:
    """outcome: see run.py; extra: names beyond the truth; among: every truth is among findings and their rivals."""

    outcome: str
    extra: int
    among: bool


def tag(effect: str, joint: int | None) -> str:
    return effect if joint is None else f"{effect}@{joint}"


def judged(made: Made, findings: Findings, verdict: str, separates: Separates | None = None) -> Score:
    """The score of an answer. separates: without it a rival is an outcome of its own, "rival"."""
    named = [tag(f["effect"], f["joint"]) for f in findings]
    if not made.hidden or not all(h.truth for h in made.hidden):
        outcome = "wrong" if named else "right" if verdict in made.case.expected else verdict
        return Score(outcome, len(named), False)
    right, like = _tags(made)
    rivals = [{tag(r["effect"], r["joint"]) for r in f["rivals"]} for f in findings]
    spoken_of = set(named).union(*rivals) if named else set()
    among = all(spoken_of & tags for tags in right)
    if not named:
        return Score("missed", 0, False)
    if len(right) > 1:
        hits = [
            any(name in close or rival & tags for name, rival in zip(named, rivals, strict=True))
            for tags, close in zip(right, like, strict=True)
        ]
        both = all(tags & set(named) for tags in right)
        outcome = "right" if both else "rival" if all(hits) else "half" if any(hits) else "wrong"
        return Score(outcome, max(0, len(named) - sum(hits)), among)
    if named[0] in right[0]:
        return Score("right", sum(name not in right[0] for name in named), among)
    known = rivals[0] & right[0]
    if known and separates and any(_alike(named[0], truth) and separates(named[0], truth) for truth in known):
        return Score("right", len(named) - 1, among)
    return Score("rival" if known else "wrong", len(named) - 1, among)


def _tags(made: Made) -> tuple[list[set[str]], list[set[str]]]:
    """Of each hidden effect the names that are right, and those with what counts as right for it in a pair."""
    right, like = [], []
    for what, joint in zip(made.hidden, made.joints, strict=True):
        place = joint or 1
        right.append({tag(x, joint) for x in (what.truth, *what.accept)})
        like.append(right[-1] | {tag(x, None if x in ("gravity", "payload") else place) for x in what.rivals})
    return right, like


def _alike(a: str, b: str) -> bool:
    pair = {a.split("@")[0], b.split("@")[0]}
    return any(pair <= group for group in ALIKE)


def column(made: Made, findings: Findings, verdict: str) -> str:
    """The column of the confusion matrix: the first name, "other joint" for a right one elsewhere, or the verdict."""
    if not findings:
        return "-" if verdict == "clean" else verdict
    first = findings[0]
    for what, joint in zip(made.hidden, made.joints, strict=True):
        if first["effect"] in (what.truth, *what.accept) and first["joint"] != joint:
            return "other joint"
    return str(first["effect"])


def exact(score: Score, verdict: str, made: Made) -> bool:
    """Whether just what is hidden was named, in a case whose structure is the library's; nothing, where nothing is."""
    if made.case.kind in ("forms", "unknown"):
        return False
    return score.outcome == "right" and not score.extra and (bool(made.hidden) or verdict == "clean")


def lines(made: Made, findings: Findings) -> str:
    """Of the lines of a hidden ripple, how many were found, within NEAR_LINE: "2/3"; "" where none is hidden."""
    hidden = [order for what in made.hidden for order in what.orders]
    found: list[float] = []
    for f in findings:
        for name, x in f["parameters"].items():
            if name.startswith("order"):
                found += [float(v) for v in np.atleast_1d(x["value"])]
    hit = sum(any(abs(x - order) <= NEAR_LINE * order for x in found) for order in hidden)
    return f"{hit}/{len(hidden)}" if hidden else ""


def agreement(intervals: Sequence[tuple[float, float]], true: Sequence[float]) -> tuple[int, int, bool]:
    """How many true values lie in their 95 % intervals, of how many, and whether all agree together.

    Together: each interval is widened (Bonferroni) until all of them hold at once in 95 % of recordings.
    """
    if not true:
        return 0, 0, False
    low, high, at = np.array(intervals).T[0], np.array(intervals).T[1], np.array(true)
    wider = float(stats.norm.ppf(1 - 0.025 / len(true)) / stats.norm.ppf(0.975))
    together = np.abs(at - 0.5 * (low + high)) <= wider * 0.5 * (high - low)
    return int(np.sum((low <= at) & (at <= high))), len(true), bool(together.all())
