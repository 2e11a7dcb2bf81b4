"""Runs the diagnosis on cases and prints who was right.

    python -m tests.judge.run --cases single --size 0.5 --seeds 3 --joints 1 --csv table.csv

--cases takes classes (clean, single, forms, unknown, pairs) and names (stribeck, elasticity+torque_ripple, ...).
Per case: the truth with its size in units of the noise floor, the verdict, what was named and its rivals, and the
error at the joint of the truth: before / after / floor. Then totals by class and by name. The CSV has also what is
left of the size when a shift between torque and motion is free (beyond_delay), the amounts and what was fitted.

    right   the truth was named first, or nothing where nothing should be (for pairs: both were named)
    rival   the truth, or what counts as right for it, is among the rivals of what was named first
    missed  nothing was named     wrong   something else was named first     half   one of a pair
    mimic   physics that the library lacks was explained to within a twentieth of the floor by another effect
    +n      n effects were named beyond the truth
"""

from __future__ import annotations

import argparse
import csv
import json
import multiprocessing
import os
import sys
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

from . import cases as judging  # noqa: E402
from .cases import Case, Made, Setting  # noqa: E402


@dataclass
class Line:
    """One row of the table."""

    case: str
    kind: str
    joints: int
    seed: int
    setting: str
    truth: str
    size: str
    beyond_delay: float = float("nan")
    outcome: str = ""
    extra: int = 0
    verdict: str = ""
    named: str = ""
    rivals: str = ""
    before: float = float("nan")
    after: float = float("nan")
    floor: float = float("nan")
    held_out_after: float = float("nan")
    cutoff: float = float("nan")
    seconds: float = float("nan")
    amount: str = ""
    parameters: str = ""
    reason: str = ""


def _tag(effect: str, joint: int | None) -> str:
    return effect if joint is None else f"{effect}@{joint}"


def judged(made: Made, findings: Sequence[dict[str, Any]], verdict: str) -> tuple[str, int]:
    """Outcome, and how many effects were named beyond the truth."""
    named = [_tag(f["effect"], f["joint"]) for f in findings]
    if not made.hidden or not all(h.truth for h in made.hidden):
        return ("wrong" if named else "right" if verdict in made.case.expected else verdict), len(named)
    right, like = [], []
    for what, joint in zip(made.hidden, made.joints, strict=True):
        place = joint or 1
        right.append({_tag(x, joint) for x in (what.truth, *what.accept)})
        like.append(right[-1] | {_tag(x, None if x in ("gravity", "payload") else place) for x in what.rivals})
    extra = sum(not any(name in tags for tags in right) for name in named)
    if not named:
        return "missed", 0
    if len(right) > 1:
        rivals = {
            name: {_tag(r["effect"], r["joint"]) for r in f["rivals"]} for name, f in zip(named, findings, strict=True)
        }
        hits = [
            any(name in tags or (rivals[name] & tags) or name in close for name in named)
            for tags, close in zip(right, like, strict=True)
        ]
        return ("right" if all(hits) else "half" if any(hits) else "wrong"), max(0, len(named) - sum(hits))
    if named[0] in right[0]:
        return "right", extra
    rivals_of_first = {_tag(r["effect"], r["joint"]) for r in findings[0]["rivals"]}
    return ("rival" if rivals_of_first & right[0] else "wrong"), len(named) - 1


def line(case: Case) -> Line:
    """Makes a case, diagnoses it, judges the answer. An exception is an outcome, "failed"."""
    from runtime.cli import open_model
    from runtime.diagnose import diagnose

    s = case.setting
    parts = [
        s.excitation,
        s.noise,
        f"x{s.coarse:g}",
        *(["jitter"] if s.jitter else []),
        *([] if s.temperature else ["no T"]),
    ]
    out = Line(case.label, case.kind, s.joints, case.seed, " ".join(parts), "", "")
    try:
        made = judging.make(case)
        truth = [_tag(h.truth or name, j) for h, name, j in zip(made.hidden, case.names, made.joints, strict=True)]
        out.truth = " ".join(truth)
        out.size = " ".join(f"{x:.2f}" for x in made.sizes)
        out.beyond_delay = made.beyond_delay
        out.amount = " ".join(f"{x:.4g}" for x in made.amounts)
        with tempfile.TemporaryDirectory() as directory:
            path = Path(directory) / "model.toml"
            path.write_text(made.model, encoding="utf-8")
            model = open_model(path)
        start = time.process_time()
        answer = diagnose(model, [made.recording], [made.held_out] if HELD_OUT else []).to_json()
        out.seconds = time.process_time() - start
    except Exception as error:
        out.outcome, out.reason = "failed", f"{type(error).__name__}: {error}"
        traceback.print_exc(file=sys.stderr)
        return out
    findings = answer["findings"]
    out.outcome, out.extra = judged(made, findings, answer["verdict"])
    out.verdict, out.reason, out.cutoff = answer["verdict"], answer["reason"], answer["band"]["cutoff_hz"]
    out.named = " ".join(_tag(f["effect"], f["joint"]) for f in findings)
    out.rivals = " ".join(_tag(r["effect"], r["joint"]) for r in findings[0]["rivals"]) if findings else ""
    at = next((j - 1 for j in made.joints if j), 0)
    out.before, out.floor = answer["joints"][at]["rms"], answer["joints"][at]["floor"]
    here = [f for f in findings if (f["joint"] or at + 1) == at + 1]
    out.after = here[-1]["rms_after"] if here else out.before
    if here and here[-1]["held_out_after"] is not None:
        out.held_out_after = here[-1]["held_out_after"]
    if out.kind == "unknown" and out.outcome == "wrong" and out.after < _MIMIC * out.floor:
        out.outcome, out.extra = "mimic", 0
    out.parameters = json.dumps([{k: v["value"] for k, v in f["parameters"].items()} for f in findings])
    return out


HELD_OUT = False
_MIMIC = 1.05


def _start(held_out: bool) -> None:
    global HELD_OUT
    HELD_OUT = held_out


def show(x: Line) -> str:
    wrong = {"right": " ", "rival": "~"}.get(x.outcome, "!")
    extra = f"+{x.extra}" if x.extra and x.outcome != "wrong" else ""
    errors = f"{x.before:.3f}/{x.after:.3f}/{x.floor:.3f}"
    found = x.named or "-"
    rivals = f"  rivals {x.rivals}" if x.rivals else ""
    return (
        f"{wrong} {x.outcome + extra:8s} {x.joints}R {x.case:24s} #{x.seed:<4d} "
        f"{x.truth or '-':24s} {x.size or '-':>9s}  {x.verdict:11s} {found}{rivals}  {errors}  {x.seconds:.0f}s  "
        f"[{x.setting}]"
    )


def totals(lines: Sequence[Line]) -> list[str]:
    """Counts of outcomes by class and number of joints, then by name."""
    out = []
    for title, key in (("class", lambda x: f"{x.kind} {x.joints}R"), ("case", lambda x: f"{x.case} {x.joints}R")):
        groups: dict[str, Counter[str]] = defaultdict(Counter)
        for x in lines:
            groups[key(x)].update([x.outcome, *(["extra"] if x.extra and x.outcome in ("right", "rival") else [])])
        out.append(f"--- by {title}")
        for name, counts in groups.items():
            number = sum(v for k, v in counts.items() if k != "extra")
            rest = ", ".join(f"{k} {v}" for k, v in counts.most_common() if k != "right")
            out.append(f"{name:34s} right {counts['right']:3d} of {number:3d}  {rest}")
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description="Judge the diagnosis by an independent plant.")
    parser.add_argument("--cases", nargs="+", default=["single"], help="classes or names, '+' between two of a pair")
    parser.add_argument("--size", nargs="+", type=float, default=[0.5], help="in units of the noise floor")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--joints", nargs="+", type=int, default=[1])
    parser.add_argument("--excitation", choices=judging.motion.KINDS, default="full")
    parser.add_argument("--coarse", type=float, default=1.0, help="encoder counts as multiples of 2 pi / 200000")
    parser.add_argument("--noise", choices=list(judging.NOISE), default="white")
    parser.add_argument("--jitter", type=float, default=0.0, help="of the period, as a part of it")
    parser.add_argument("--held-out", action="store_true", help="diagnose with a second recording of the same plant")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--csv", type=Path)
    given = parser.parse_args()
    setting = Setting(excitation=given.excitation, coarse=given.coarse, noise=given.noise, jitter=given.jitter)
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    try:
        todo = list(judging.cases(given.cases, given.joints, given.size, seeds, setting))
    except ValueError as error:
        parser.error(str(error))
    lines = []
    with multiprocessing.get_context("spawn").Pool(given.jobs, _start, (given.held_out,)) as pool:
        for x in pool.imap_unordered(line, todo):
            lines.append(x)
            print(show(x), flush=True)
            if given.csv:
                write(given.csv, lines)
    print(*totals(sorted(lines, key=lambda x: (x.kind, x.joints, x.case))), sep="\n")


def write(path: Path, lines: Sequence[Line]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, [f.name for f in fields(Line)])
        table.writeheader()
        table.writerows(asdict(x) for x in lines)


if __name__ == "__main__":
    main()
