"""From nothing to a verdict on real recordings: what a new user types, how many commands it takes, and how long.

Each machine's recordings are read as they are, and from MCAP and MATLAB files made of them: with the same effects. What
is not known of a machine is left out of its model file. The real recordings lie outside the project; without them the
benchmark says so and goes on.
"""

from __future__ import annotations

import json
import os
import resource
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.benchmarks import harness
from tests.first_hour import FORMATS, MACHINES, REAL

MOST_COMMANDS = 4
"""init or import, inspect, improve with the held-out part and the report; and one to spare."""
TENDON = "from runtime.cli.main import main; main()"
CASES = os.environ.get("TENDON_BENCHMARK_CASES", harness.sized("", "aliengo, calf"))
"""Machines whose names begin so; in the short form the quickest."""


def typed(commands: Sequence[str], folder: Path) -> tuple[dict[str, Any], list[tuple[float, float]]]:
    """What was found, and of each command its seconds and those of processor time."""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2]), "OPENBLAS_NUM_THREADS": "1"}
    spent = []
    for command in commands:
        began, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        done = subprocess.run(
            [sys.executable, "-c", TENDON, *shlex.split(command)], cwd=folder, env=environment, capture_output=True
        )
        assert done.returncode in (0, 1), done.stderr.decode()
        processor = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        spent.append((time.monotonic() - began, processor))
    return json.loads((folder / "found.json").read_text()), spent


def falls(found: dict[str, Any], key: str) -> str:
    """The error at the first and at the last step, of the joint at which it is largest first."""
    first, last = (found["history"][k][key] for k in (0, -1))
    if first is None:
        return "–"
    i = max(range(len(first)), key=lambda joint: first[joint])
    return f"{100 * first[i]:.1f} → {100 * last[i]:.1f} %"


@pytest.mark.parametrize("name", [name for name in MACHINES if name.startswith(CASES)])
def test_from_nothing_to_the_verdict(tmp_path: Path, name: str) -> None:
    if not REAL.is_dir():
        pytest.skip("../shared/data/real is not there")
    machine, rows, named = MACHINES[name], [], {}
    for kind, write in FORMATS.items():
        folder = tmp_path / kind
        folder.mkdir()
        fitted, options = write(machine.fitted, folder, machine)
        held_out = write(machine.held_out, folder, machine)[0] if machine.held_out else None
        commands = machine.commands(fitted, held_out, options)
        assert len(commands) <= MOST_COMMANDS
        found, spent = typed(commands, folder)
        named[kind] = [step["added"] for step in found["history"] if step["added"]]
        wall, processor = (sum(column) for column in zip(*spent, strict=True))
        errors = falls(found, "relative"), falls(found, "held_out_relative")
        rows.append((kind, str(len(spent)), f"{wall:.0f}", f"{processor:.1f}", *errors, found["verdict"]))
    head = ("format", "commands", "s", "of processor time", "error", "held out", "the rest")
    notes = [f"named: {', '.join(named['CSV']) or 'nothing'}", machine.commands(machine.fitted, None, "")[0]]
    harness.show(f"From nothing to the verdict: {name}", head, rows, notes)
    assert named["MCAP"] == named["CSV"]
    assert named[".mat"] == named["CSV"]
