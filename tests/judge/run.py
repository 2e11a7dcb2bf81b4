"""Runs the diagnosis on cases and prints who was right.

    python -m tests.judge.run --cases single --size 0.5 --seeds 3 --joints 1 --csv table.csv
    python -m tests.judge.run --judging --others --experiments --csv judged.csv --resume --budget 3600
    python -m tests.judge.run --short --csv short.csv --resume --budget 1500
    python -m tests.judge.run --cases cable_pack --situation low_noise --size 2 --save cases
    python -m tests.judge.run --simulator mujoco --csv developed.csv --resume
    python -m tests.judge.run --drive torque servo servo_open pwm --csv driven.csv --resume
    python -m tests.judge.run --simulator mujoco --first-seed 4103 --seeds 1
    python -m tests.judge.run --simulator mujoco --cases gap_tendon --size 2 --joints 6 --first-seed 12 --every 8

--cases takes classes (clean, limits, inside, single, forms, unknown, pairs) and names (stribeck, elasticity+gravity).
--situation: how they are recorded (situations.py): uneven stamps, low rates, steps of the torque, an upright arm.
--judging runs the judging set of plan.py, whose seeds and sizes nobody develops with; --seeds is then its rounds.
--short runs some 400 of its kind; both mix their classes evenly, so that a part that --budget cuts has some of each.
--simulator mujoco: MuJoCo moves the arms that ship with Tendon, drive, vishard4, ur10 and panda by --joints 1, 4, 6
and 7. Alone it runs the set of mujoco_plan.py for development, with --judging the one that is run once; with --seeds,
the cases of the set that have them.
Per case: the truth with its size in units of the noise floor, the verdict, what was named and its rivals, the error at
the joint of the truth (before / after / floor), and the error over the true floor on a recording that was not fitted.
Then totals by class and by name, the confusion matrix, rates with their 95 % intervals, how many of the reported
intervals hold the true value and, with --others, pysindy and sysidentpy on the same recordings. With --resume, rows
that the CSV has are not made again.

    right   the truth was named first, or nothing where nothing should be (for pairs: both were named)
            With --experiments also the rival of a kind (scoring.ALIKE) that the proposed motion separates from it.
    rival   the truth is among the rivals of what was named first (for pairs: each was named or is a rival)
    missed  nothing was named     wrong   something else was named first     half   one of a pair
    mimic   physics that the library lacks was explained to within a twentieth of the floor by another effect
    off     nothing was named, but the fitted parameters do not agree with the true ones
    +n      n effects were named beyond the truth
"""

from __future__ import annotations

import argparse
import importlib.util
import multiprocessing
import os
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing.pool import AsyncResult
from pathlib import Path

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

from . import cases as judging  # noqa: E402
from . import confusion, plan, rates  # noqa: E402
from .cases import Case  # noqa: E402
from .drives import FORMS  # noqa: E402
from .line import Line, append, blank, code, line, read, write  # noqa: E402
from .others import METHODS  # noqa: E402
from .save import save  # noqa: E402
from .situations import SITUATIONS  # noqa: E402


@dataclass(frozen=True)
class How:
    """As line.line; budget: seconds after which no case is begun."""

    jobs: int = 2
    held_out: bool = False
    compared: bool = False
    experiments: bool = False
    budget: float = float("inf")


_how = How()


def _start(how: How) -> None:
    global _how
    _how = how


def _line(case: Case) -> Line:
    return line(case, _how.held_out, _how.compared, _how.experiments)


def run(todo: Sequence[Case], how: How) -> Iterator[Line]:
    """Rows as they are done; what has begun when the budget, s, is spent is still finished."""
    end = time.monotonic() + how.budget
    with multiprocessing.get_context("spawn").Pool(how.jobs, _start, (how,)) as pool:
        waiting: list[AsyncResult[Line]] = []
        rest = iter(todo)
        while True:
            while len(waiting) < how.jobs and time.monotonic() < end and (case := next(rest, None)) is not None:
                waiting.append(pool.apply_async(_line, (case,)))
            if not waiting:
                return
            done = [job for job in waiting if job.ready()]
            for job in done:
                waiting.remove(job)
                yield job.get()
            if not done:
                waiting[0].wait(0.05)


def show(x: Line, progress: str = "") -> str:
    wrong = {"right": " ", "rival": "~"}.get(x.outcome, "!")
    extra = f"+{x.extra}" if x.extra and x.outcome != "wrong" else ""
    errors = f"{x.before:.3f}/{x.after:.3f}/{x.floor:.3f} held out {x.ratio:.2f}"
    found = x.named or "-"
    rivals = f"  rivals {x.rivals}" if x.rivals else ""
    others = f"  pysindy {x.pysindy}, sysidentpy {x.sysidentpy}" if x.pysindy else ""
    return (
        f"{wrong} {x.outcome + extra:8s} {x.joints}R {x.case:24s} #{x.seed:<4d} "
        f"{x.truth or '-':24s} {x.size or '-':>9s}  {x.verdict:11s} {found}{rivals}  {errors}  {x.seconds:.0f}s  "
        f"[{x.setting}]{others}{progress}"
    )


def totals(lines: Sequence[Line]) -> list[str]:
    """Counts of outcomes by class and number of joints, by name, and by how they were recorded."""
    out = []
    keys: dict[str, Callable[[Line], str]] = {
        "class": lambda x: f"{x.kind} {x.joints}R",
        "case": lambda x: f"{x.case} {x.joints}R",
        "recording": lambda x: x.setting,
    }
    for title, key in keys.items():
        groups: dict[str, Counter[str]] = defaultdict(Counter)
        for x in lines:
            groups[key(x)].update([x.outcome, *(["extra"] if x.extra and x.outcome in ("right", "rival") else [])])
        out.append(f"--- by {title}")
        for name, counts in groups.items():
            number = sum(v for k, v in counts.items() if k != "extra")
            rest = ", ".join(f"{k} {v}" for k, v in counts.most_common() if k != "right")
            out.append(f"{name:34s} right {counts['right']:3d} of {number:3d}  {rest}")
    return out


def report(lines: Sequence[Line]) -> list[str]:
    """Everything that is printed at the end."""
    ordered = sorted(lines, key=lambda x: (judging.KINDS.index(x.kind), x.joints, x.case))
    if not ordered:
        return ["no case was run"]
    out = [*totals(ordered), "--- hidden against named first, the wrong answers by name", *confusion.text(ordered)]
    out += ["--- rates", *rates.rates_table(ordered), "--- errors and times", *rates.errors_table(ordered)]
    covered = rates.coverage_table(ordered)
    out += ["--- 95 % intervals that hold the true value", *covered] if covered else []
    driven = rates.drives_table(ordered)
    out += ["--- drives that are told what to make", *driven] if driven else []
    compared = rates.comparison(ordered)
    return [*out, "--- beside other tools, on the same recordings", *compared] if compared else out


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Judge the diagnosis by an independent plant.")
    parser.add_argument("--cases", nargs="+", help="classes or names, '+' between two of a pair; default single")
    parser.add_argument("--size", nargs="+", type=float, default=[0.5], help="in units of the noise floor")
    parser.add_argument("--seeds", type=int, help="how many, default 1; with --judging: rounds, default 5")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--joints", nargs="+", type=int, help="default 1; with --judging: 1 2 4")
    parser.add_argument(
        "--situation", nargs="+", choices=list(SITUATIONS), default=["plain"], help="how recordings are made"
    )
    parser.add_argument(
        "--excitation",
        choices=[*judging.motion.KINDS, judging.FIRST],
        help="first: what tendon experiment proposes, with as much of an effect as has the size on today's excitation",
    )
    parser.add_argument("--simulator", choices=["mujoco"], help="instead of the judge's own")
    parser.add_argument(
        "--drive",
        nargs="+",
        choices=["torque", *FORMS],
        help="what is recorded in place of a torque; each case in each form. Without --cases: the set of plan.driven",
    )
    parser.add_argument("--every", type=int, help="periods of the drives, 1 ms, a sample")
    parser.add_argument("--level", type=float, help="N m, of the torque's noise")
    parser.add_argument("--coarse", type=float, help="encoder counts as multiples of 2 pi / 200000")
    parser.add_argument("--noise", choices=list(judging.NOISE))
    parser.add_argument("--jitter", type=float, help="of the period, as a part of it")
    parser.add_argument("--held-out", action="store_true", help="diagnose with a second recording of the same plant")
    parser.add_argument("--judging", action="store_true", help="the judging set: its own seeds and sizes")
    parser.add_argument("--short", action="store_true", help="the short judging set")
    parser.add_argument("--others", action="store_true", help="pysindy and sysidentpy on the same recordings")
    parser.add_argument("--experiments", action="store_true", help="ask `tendon experiment` about rivals of one kind")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--budget", type=float, default=float("inf"), help="seconds after which no case is begun")
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--resume", action="store_true", help="keep the rows of --csv and make only what it lacks")
    parser.add_argument("--save", type=Path, metavar="DIR", help="write the cases there as files; diagnose none")
    parser.add_argument("--matrix", type=Path, help="the confusion matrix as CSV")
    parser.add_argument("--figure", type=Path, help="the confusion matrix as a picture (.png, .svg, .pdf)")
    return parser


def _mujoco(purpose: str) -> list[Case]:
    from .mujoco_plan import mujoco  # needs an extra

    return mujoco(purpose)


def wanted(parser: argparse.ArgumentParser, given: argparse.Namespace) -> list[Case]:
    """The cases that the arguments ask for, in each form; the parser's error for impossible ones."""
    forms = ["" if form == "torque" else form for form in given.drive or ["torque"]]
    return [replace(c, setting=replace(c.setting, drive=form)) for c in _chosen(parser, given) for form in forms]


def _chosen(parser: argparse.ArgumentParser, given: argparse.Namespace) -> list[Case]:
    try:
        if given.drive and not given.cases:
            return plan.driven(given.simulator or "")
        if given.simulator and (given.judging or not given.cases):
            seeds = range(given.first_seed, given.first_seed + given.seeds) if given.seeds else range(2**31)
            return [c for c in _mujoco("judging" if given.judging else "development") if c.seed in seeds]
        if given.judging:
            rounds = 5 if given.seeds is None else given.seeds
            kinds, joints = given.cases or judging.KINDS, given.joints or plan.JOINTS
            return list(plan.judging(kinds, joints, rounds, given.excitation or "full"))
        if given.short:
            return list(plan.short())
        seeds = range(given.first_seed, given.first_seed + (given.seeds or 1))
        if seeds.stop > plan.FIRST_JUDGING_SEED:
            parser.error(f"seeds from {plan.FIRST_JUDGING_SEED} on belong to the judging set; use --judging")
        chosen = {k: getattr(given, k) for k in ("excitation", "coarse", "noise", "jitter", "level", "simulator")}
        own = {k: v for k, v in chosen.items() if v is not None}
        if given.simulator:
            own = {"excitation": "fourier", **own}
        todo: list[Case] = []
        for name in given.situation:
            setting = replace(SITUATIONS[name], **own)
            if given.every:
                setting = replace(setting, logger=replace(setting.logger, every=given.every))
            todo += judging.cases(given.cases or ["single"], given.joints or [1], given.size, seeds, setting)
        return todo
    except ValueError as error:
        parser.error(str(error))


def main() -> None:
    parser = _arguments()
    given = parser.parse_args()
    missing = [name for name in METHODS if importlib.util.find_spec(name) is None]
    if given.simulator and importlib.util.find_spec(given.simulator) is None:
        parser.error(f"{given.simulator} not installed; pip install -e '.[mjcf]'")
    if given.others and missing:
        parser.error(f"{' and '.join(missing)} not installed; pip install -e '.[benchmark]'")
    if given.resume and not given.csv:
        parser.error("--resume needs --csv FILE")
    todo, lines = wanted(parser, given), []
    if given.save:
        for case in todo:
            print(save(case, given.save), flush=True)
        return
    if given.resume and given.csv.exists():
        try:
            lines = read(given.csv)
        except ValueError as error:
            parser.error(str(error))
        keys = {x.key for x in lines}
        todo = [case for case in todo if blank(case).key not in keys]
        older = sum(x.code != code() for x in lines)
        print(f"{len(lines)} rows kept, {older} of them of other code than today's; {len(todo)} cases left", flush=True)
    elif given.csv:
        write(given.csv, [])
    start = time.monotonic()
    how = How(given.jobs, given.held_out, given.others, given.experiments, given.budget)
    for number, x in enumerate(run(todo, how), 1):
        lines.append(x)
        print(show(x, f"  ({number}/{len(todo)}, {time.monotonic() - start:.0f} s)"), flush=True)
        if given.csv:
            append(given.csv, x)
    print(*report(lines), sep="\n")
    if given.matrix:
        confusion.write(given.matrix, lines)
    if given.figure:
        confusion.figure(given.figure, lines)


if __name__ == "__main__":
    main()
