"""The whole confusion matrix on the judging set, its rates, and pysindy and sysidentpy on the same recordings."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

from harness import sized

from tests.judge import plan
from tests.judge.line import append, blank, code, read, write
from tests.judge.others import METHODS
from tests.judge.run import How, report, run, show

BUDGET = float(os.environ.get("TENDON_BENCHMARK_BUDGET", sized("600", "10")))
"""Seconds after which no case is begun; the table goes on where it ended when the same code is judged again."""
TABLES = Path.home() / ".cache" / "tendon" / "benchmarks"


def test_confusion() -> None:
    """Cases in random order, so that a part is a fair sample; nothing is asserted but that every case was judged."""
    compared = all(importlib.util.find_spec(name) is not None for name in METHODS)
    if not compared:
        print(f"\n{' or '.join(METHODS)} is not here; without the comparison (pip install -e '.[benchmark]')")
    path = TABLES / f"confusion-{code()}{'-compared' if compared else ''}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists():
        write(path, [])
    lines = read(path)
    known = {x.key for x in lines}
    todo = [case for case in plan.judging() if blank(case).key not in known]
    print(f"\n{len(lines)} rows in {path}, {len(todo)} cases left, {BUDGET:g} s for them (TENDON_BENCHMARK_BUDGET)")
    for x in run(todo, How(os.cpu_count() or 1, compared=compared, experiments=True, budget=BUDGET)):
        append(path, x)
        lines.append(x)
        print(show(x), flush=True)
    print(*report(lines), sep="\n")
    failed = [x for x in lines if x.outcome == "failed"]
    assert not failed, failed[0].reason
