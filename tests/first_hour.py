"""Real machines as a new user meets them: what is known of each, its recordings, and the same in other formats.

What is not known of a machine is left out of its model file. The real recordings lie outside the project.
"""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import savemat

from runtime.arrays import Array
from tests.runtime.recordings.formats import write_mcap

DATA = Path(__file__).parents[2] / "shared" / "data"
REAL = DATA / "real"
BETWEEN_RUNS = 1.0
"""s; by how much a log of messages goes on after a run: its stamps never restart."""


@dataclass(frozen=True)
class Machine:
    """What is known of a machine, and its recordings.

    begun             the verb and its options that write the model file
    fitted, held_out  recordings; None: there is but one
    joints            names that a log of messages has
    options           with which the recordings are read
    """

    begun: str
    fitted: Path
    held_out: Path | None
    joints: tuple[str, ...] = ("axis",)
    options: str = ""

    def commands(self, fitted: Path, held_out: Path | None, options: str) -> list[str]:
        """As they are typed: init or import, inspect, improve with what is held out and the report."""
        held = f" --held-out {held_out}" if held_out else ""
        return [
            f"{self.begun} --out machine.toml",
            f"inspect {fitted} machine.toml{options}",
            f"improve machine.toml {fitted}{held}{options} --out better.toml --report report --json found.json",
        ]


def _drive(gravity: str, ratio: float, more: str = "", joints: str = "r") -> str:
    known = f"--gravity {gravity} --gear-ratio {ratio}{more}"
    return f"init --name machine --plane --joints {joints} --length 0.25 {known}"


def _real(name: str, fitted: str, held_out: str) -> tuple[Path, Path]:
    return REAL / name / f"{fitted}.csv.gz", REAL / name / f"{held_out}.csv.gz"


_ANTI_COGGING = _drive("0,0", 1, " --torque-constant 0.025")
MACHINES: Mapping[str, Machine] = {
    "laas, flag 0": Machine(_ANTI_COGGING, *_real("laas", "flag0_fit", "flag0_held"), options=" --allow-gaps"),
    "laas, flag 1": Machine(_ANTI_COGGING, *_real("laas", "flag1_fit", "flag1_held"), options=" --allow-gaps"),
    "kuka, axis 1": Machine(_drive("0,0", 256.857), *_real("kuka", "a1_A", "a1_B")),
    "kuka, axis 2": Machine(_drive("0,-9.81", 267.429), *_real("kuka", "a2_A", "a2_B")),
    "kuka, axis 3": Machine(_drive("0,-9.81", 252.333), *_real("kuka", "a3_A", "a3_B")),
    "xl330": Machine(_drive("9.81,0", 288), *_real("xl330", "fit", "held")),
    "aliengo, hip": Machine(_drive("9.81,0", 6.33), *_real("aliengo", "hip_fit", "hip_held")),
    "aliengo, thigh": Machine(_drive("9.81,0", 6.33), *_real("aliengo", "thigh_fit", "thigh_held")),
    "aliengo, calf": Machine(_drive("9.81,0", 6.33), *_real("aliengo", "calf_fit", "calf_held")),
    "aliengo, leg": Machine(
        _drive("9.81,0", 6.33, joints="r,r"), *_real("aliengo", "leg_fit", "leg_held"), joints=("thigh", "calf")
    ),
    "EMPS": Machine(
        _drive("0,0", 1, joints="p"), DATA / "emps" / "identification.csv.gz", DATA / "emps" / "validation.csv.gz"
    ),
    "tx40": Machine(
        f"import {REAL / 'tx40' / 'tx40.urdf'}",
        REAL / "tx40" / "tx40.csv.gz",
        None,
        tuple(f"joint_{k}" for k in range(1, 7)),
    ),
}


def as_it_is(path: Path, _folder: Path, machine: Machine) -> tuple[Path, str]:
    """A recording where it lies, and the options with which it is read."""
    return path, machine.options


def as_mat(path: Path, folder: Path, machine: Machine) -> tuple[Path, str]:
    """A MATLAB file of it: one struct, its fields called as the columns are."""
    columns = _columns(path)
    out = folder / f"{_stem(path)}.mat"
    savemat(out, {"log": {name: values for name, (values, _) in columns.items()}})
    return out, machine.options + "".join(
        f' --map {name}="{name} [{unit}]"' for name, (_, unit) in columns.items() if unit == "A"
    )


def as_mcap(path: Path, folder: Path, machine: Machine) -> tuple[Path, str]:
    """A log of it: positions, rates and torques in one topic, and a topic for whatever else is measured."""
    columns = {name: values for name, (values, _) in _columns(path).items()}
    options = machine.options
    if "run" in columns:
        columns["t"] = _one_after_the_other(columns["t"], columns.pop("run"))
        options = " --allow-gaps"
    own: dict[str, Array] = {"t": columns["t"]}
    streams = [("/joint_states", machine.joints, own)]
    for signal in dict.fromkeys(re.sub(r"\d+", "{}", name) for name in columns if name != "t"):
        rows = np.array([columns[signal.format(k)] for k in range(1, len(machine.joints) + 1)])
        if signal in ("q{}", "qd{}", "tau{}"):
            own[signal[:-2]] = rows
            continue
        topic = f"/{signal.format('')}"
        streams.append((topic, machine.joints, {"t": columns["t"], "q": rows}))
        for k, joint in enumerate(machine.joints, 1):
            options += f' --map {signal.format(k)}="{topic}.position.{joint}"'
    options += "".join(
        f' --map {name}="effort.{machine.joints[0]} [A]"' for name, (_, unit) in _columns(path).items() if unit == "A"
    )
    return write_mcap(folder / f"{_stem(path)}.mcap", streams), options


FORMATS: Mapping[str, Callable[[Path, Path, Machine], tuple[Path, str]]] = {
    "CSV": as_it_is,
    "MCAP": as_mcap,
    ".mat": as_mat,
}


def _stem(path: Path) -> str:
    return path.name.removesuffix(".csv.gz")


def _columns(path: Path) -> dict[str, tuple[Array, str]]:
    """Columns of a CSV and the units in its header, read without the product."""
    with gzip.open(path, "rt", encoding="utf-8") as lines:
        cells = lines.readline().strip().split(",")
        table = np.loadtxt(lines, delimiter=",")
    named = [re.fullmatch(r"(\w+)(?: \[(.*)\])?", cell) for cell in cells]
    return {m[1]: (table[:, k], m[2] or "") for k, m in enumerate(named) if m}


def _one_after_the_other(t: Array, run: Array) -> Array:
    """Stamps of runs that each begin again, in one line."""
    starts = np.flatnonzero(np.diff(run, prepend=np.nan) != 0)
    out, end = t.copy(), 0.0
    for first, last in zip(starts, [*starts[1:], len(t)], strict=True):
        out[first:last] += end - t[first]
        end = out[last - 1] + BETWEEN_RUNS
    return out
