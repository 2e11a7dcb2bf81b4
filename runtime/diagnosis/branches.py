"""Where the data cannot tell an effect from its rivals, what comes after it may: each is followed to its end.

A rival takes something else along (a spring in gravity's place bends the load that friction reads), so that the sets
as wholes are apart where the first effects are not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from runtime.diagnosis.likelihood import ruled_out, whitened_bic
from runtime.diagnosis.presliding import bristles
from runtime.diagnosis.remainder import remainder
from runtime.diagnosis.search import Search
from runtime.diagnosis.settings import BIC_APART, HELD_OUT_FALLS_TO, MOST_BRANCHES
from runtime.diagnosis.steps import Finding, Step
from runtime.diagnosis.worth import squared
from runtime.model.terms import Term

OnSearchStep = Callable[[Step], None]


def complete(search: Search, on_step: OnSearchStep = lambda _: None) -> Search:
    """The search at its end: the best of those that follow the first finding that has rivals, or one of these; without
    what the data do not tell beside the rest."""
    _follow(search, on_step)
    number = next((k for k, f in enumerate(search.findings) if f.rivals), None)
    if number is not None and _undecided(search, number):
        branches = [search]
        for term in search.findings[number].rivals[:MOST_BRANCHES]:
            branch = search.instead(number, term)
            if branch is not None:
                branches.append(_follow(branch))
        search = _best(branches, number)
    search.take_back_untold()
    search.findings = [replace(f, rivals=_left(f)) for f in search.findings]
    return search


def _left(finding: Finding) -> tuple[Term, ...]:
    """The rivals of a finding that nothing refuted, and those that no likelihood tells from it."""
    return tuple(dict.fromkeys(t for t in (*finding.rivals, *bristles(finding)) if t not in finding.refuted))


def _follow(search: Search, on_step: OnSearchStep = lambda _: None) -> Search:
    while search.open and search.advance() is not None:
        on_step(search.steps[-1])
    return search


def _undecided(search: Search, number: int) -> bool:
    """Whether anything comes after a finding, or is left at its joint, that would tell its rivals from it."""
    later = len(search.findings) > number + 1
    return later or remainder(search.steps[-1], search.findings[number].joint_index) is not None


def _best(branches: list[Search], number: int) -> Search:
    """The branch whose whole set explains most, the first unless another is clearly better; its rivals are the terms
    of those that are not clearly worse."""
    ends = [b.steps[-1] for b in branches]
    scores = whitened_bic(branches[0].ground().ground, ends)
    best = 0
    for k in range(1, len(branches)):
        if _clearly_better(ends[k], ends[best], scores[k], scores[best]):
            best = k
    chosen = branches[best]
    if len(chosen.findings) <= number:
        return chosen
    worse = [_clearly_better(ends[best], end, scores[best], score) for end, score in zip(ends, scores, strict=True)]
    heads = [b.findings[number].term if len(b.findings) > number else None for b in branches]
    finding = chosen.findings[number]
    lost = {head for head, gone in zip(heads, worse, strict=True) if gone and head is not None}
    refuted = {head for head in lost if ruled_out(head, ends[best], finding.joint_index)}
    rivals = tuple(t for t in finding.rivals if t not in refuted and t != finding.term)
    chosen.findings[number] = replace(finding, rivals=rivals, refuted=())
    return chosen


def _clearly_better(one: Step, other: Step, score: float, other_score: float) -> bool:
    if one.held_out is not None and other.held_out is not None:
        here, there = squared(one.held_out), squared(other.held_out)
        if here < HELD_OUT_FALLS_TO * there:
            return True
        if there < HELD_OUT_FALLS_TO * here:
            return False
    return score <= other_score - BIC_APART
