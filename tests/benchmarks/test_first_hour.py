"""From nothing to a verdict on real recordings: what a new user types, how many commands it takes, and how long.

Each machine's recordings are read as they are; those of one of them also from MCAP and from a MATLAB file made of them,
with the same verdict. What is not known of a machine is left out of its model file. The real recordings lie outside the
project; without them the benchmark says so and goes on.
"""

from __future__ import annotations

import json
import os
import resource
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from scipy.io import savemat

from runtime.recordings.recording import Recording, read
from tests.benchmarks import harness
from tests.runtime.formats import write_mcap

REAL = Path(__file__).parents[3] / "shared" / "data" / "real"
MOST_COMMANDS = 4
"""init or import, inspect, improve with the held-out part and the report; and one to spare."""
TENDON = "from runtime.cli.main import main; main()"


@dataclass(frozen=True)
class Machine:
    """What is known of a machine, and its recordings.

    begun             the verb and its options that write the model file
    fitted, held_out  recordings; None: there is but one
    options           with which they are read
    """

    begun: str
    fitted: Path
    held_out: Path | None
    options: str = ""

    @property
    def commands(self) -> list[str]:
        """As they are typed."""
        held = f" --held-out {self.held_out}" if self.held_out else ""
        return [
            f"{self.begun} --out machine.toml",
            f"inspect {self.fitted} machine.toml{self.options}",
            f"improve machine.toml {self.fitted}{held}{self.options} --out better.toml --report report "
            "--json found.json",
        ]


def _drive(gravity: str, ratio: float, more: str = "") -> str:
    known = f"--gravity {gravity} --gear-ratio {ratio}{more}"
    return f"init --no-questions --name machine --plane --joints r --length 0.1 {known}"


KUKA = Machine(_drive("0,-9.81", 252.333), REAL / "kuka" / "a3_A.csv.gz", REAL / "kuka" / "a3_B.csv.gz")
MACHINES: Mapping[str, Machine] = {
    "kuka": KUKA,
    "laas": Machine(
        _drive("0,0", 1, " --torque-constant 0.025"),
        REAL / "laas" / "flag1_fit.csv.gz",
        REAL / "laas" / "flag1_held.csv.gz",
        " --allow-gaps",
    ),
    "xl330": Machine(_drive("9.81,0", 288), REAL / "xl330" / "fit.csv.gz", REAL / "xl330" / "held.csv.gz"),
    "aliengo": Machine(
        _drive("9.81,0", 6.33), REAL / "aliengo" / "hip_fit.csv.gz", REAL / "aliengo" / "hip_held.csv.gz"
    ),
    "tx40": Machine(f"import {REAL / 'tx40' / 'tx40.urdf'}", REAL / "tx40" / "tx40.csv.gz", None),
}
LONG = ("tx40",)
"""Machines that take minutes."""


def as_mcap(path: Path, recording: Recording) -> None:
    write_mcap(path, [("/joint_states", ("axis",), {"t": recording.t, "q": recording.q, "tau": recording.tau})])


def as_mat(path: Path, recording: Recording) -> None:
    savemat(path, {"log": {"t": recording.t, "q1": recording.q[0], "tau1": recording.tau[0]}})


WRITERS: Mapping[str, Callable[[Path, Recording], None]] = {"mcap": as_mcap, "mat": as_mat}


def typed(machine: Machine, folder: Path) -> tuple[dict[str, Any], list[tuple[str, float, float]]]:
    """What was found, and of each command its seconds and those of processor time."""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2]), "OPENBLAS_NUM_THREADS": "1"}
    spent = []
    for command in machine.commands:
        began, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        done = subprocess.run(
            [sys.executable, "-c", TENDON, *shlex.split(command)], cwd=folder, env=environment, capture_output=True
        )
        assert done.returncode in (0, 1), done.stderr.decode()
        processor = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        spent.append((command, time.monotonic() - began, processor))
    return json.loads((folder / "found.json").read_text()), spent


def test_from_nothing_to_the_verdict(tmp_path: Path) -> None:
    if not REAL.is_dir():
        pytest.skip("../shared/data/real is not there")
    cases = {name: machine for name, machine in MACHINES.items() if not (harness.SHORT and name in LONG)}
    for ending, write in WRITERS.items():
        paths = []
        for part, source in (("fitted", KUKA.fitted), ("held_out", KUKA.held_out)):
            assert source is not None
            paths.append(tmp_path / f"{part}.{ending}")
            write(paths[-1], read(source, 1))
        cases[f"kuka, {ending}"] = replace(KUKA, fitted=paths[0], held_out=paths[1])
    rows, named = [], {}
    for name, machine in cases.items():
        folder = tmp_path / name.replace(", ", "_")
        folder.mkdir()
        found, spent = typed(machine, folder)
        named[name] = [step["added"] for step in found["history"] if step["added"]]
        assert len(spent) <= MOST_COMMANDS
        wall, processor = (sum(column) for column in list(zip(*spent, strict=True))[1:])
        rows.append((name, str(len(spent)), f"{wall:.0f}", f"{processor:.1f}", found["verdict"]))
    head = ("machine", "commands", "seconds", "of processor time", "verdict on the rest")
    notes = [f"{name}: {', '.join(effects) or 'nothing named'}" for name, effects in named.items()]
    harness.show("From nothing to the verdict", head, rows, notes)
    assert named["kuka, mcap"] == named["kuka, mat"]
