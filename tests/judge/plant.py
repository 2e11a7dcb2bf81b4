"""The plant of plant.c, space.h and laws.h, compiled once and called through ctypes."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import re
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from codegen.toolchain.build import compiler
from runtime.arrays import Array

SOURCE = Path(__file__).with_name("plant.c")
LAWS = Path(__file__).with_name("laws.h")
SPACE = Path(__file__).with_name("space.h")
PERIOD = 1e-3
COUNT = 2 * np.pi / 200_000  # rad at the joint

_ONES = ("GAIN", "STOP_EXPONENT", "GAP_EXPONENT", "CREEP_SPEED", "BRAKE_SPEED", "COUPLED_SPEED", "LIMIT")
DEFAULTS = dict.fromkeys(_ONES, 1.0)
ARM_DEFAULTS = {"COUNT": COUNT, "SUBSTEPS": 8.0}


class RanAwayError(RuntimeError):
    """The closed loop was unstable."""


@dataclass(frozen=True)
class Run:
    """What the plant did, (n, N) each; all but q and link are of the period that begins at the sample.

    q         rad, the motor's angle at the samples, exact
    tau       N m, the command
    rate, acceleration   means over the period, of the motor
    above, below         friction as a part of its level, in motion forwards and backwards
    link      rad, the link's angle at the samples
    """

    q: Array
    tau: Array
    rate: Array
    acceleration: Array
    above: Array
    below: Array
    link: Array


def names(enum: str) -> tuple[str, ...]:
    """The members of an enum of laws.h, without its last, which counts them."""
    found = re.search(rf"enum {enum} \{{(.*?)\}}", LAWS.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    bare = re.sub(r"/\*.*?\*/", "", found[1], flags=re.DOTALL)
    return tuple(name.strip() for name in bare.split(",") if name.strip())[:-1]


@functools.cache
def library() -> ctypes.CDLL:
    """plant.c as a shared library, in a directory of the system's for temporary files, by content."""
    command = [*compiler(), "-O2", "-std=c99", "-fPIC", "-shared"]
    content = b"".join(path.read_bytes() for path in (SOURCE, LAWS, SPACE)) + repr(command).encode()
    digest = hashlib.sha256(content).hexdigest()[:16]
    path = Path(tempfile.gettempdir()) / f"tendon-plant-{os.getuid()}-{digest}.so"
    if not path.exists():
        fresh = path.with_suffix(f".{os.getpid()}")
        subprocess.run([*command, str(SOURCE), "-o", str(fresh), "-lm"], check=True)
        fresh.rename(path)
    loaded = ctypes.CDLL(str(path))
    assert loaded.plant_parameters() == len(names("parameter"))
    assert loaded.plant_arm_parameters() == len(names("arm_parameter"))
    return loaded


def table(rows: Sequence[Mapping[str, float]]) -> Array:
    """Parameters by name as laws.h wants them, (n, PARAMETERS). KeyError for a name that it does not have."""
    order = {name: k for k, name in enumerate(names("parameter"))}
    out = np.zeros((len(rows), len(order)))
    for i, row in enumerate(rows):
        for name, value in {**DEFAULTS, **row}.items():
            out[i, order[name]] = value
    return out


def simulate(
    joints: Sequence[Mapping[str, float]],
    desired: Array,
    arm: Mapping[str, float] | None = None,
    forward: Array | None = None,
    outside: Array | None = None,
    warm: Array | None = None,
    period: Array | None = None,
) -> Run:
    """The plant in closed loop along desired (3, n, N): angle, rate, acceleration.

    joints   parameters of laws.h by name, a mapping a joint; arm: those of the arm
    forward  (n, N) N m feedforward; outside (n, N) N m torque on the links; warm (n, N) 0 to 1
    period   (N,) s between samples, default 1 ms
    Raises RanAwayError.
    """
    _, n, count = desired.shape
    order = names("arm_parameter")
    of_arm = np.array([{**ARM_DEFAULTS, **(arm or {})}.get(name, 0.0) for name in order])
    unknown = set(arm or {}) - set(order)
    if unknown:
        raise KeyError(*unknown)
    zeros = np.zeros((n, count))
    given = [zeros if x is None else x for x in (forward, outside, warm)]
    steps = np.full(count, PERIOD) if period is None else period
    out = [np.empty((n, count)) for _ in range(7)]
    held = [np.ascontiguousarray(x, dtype=np.float64) for x in (of_arm, table(joints), steps, *desired, *given)]
    pointers = [x.ctypes.data_as(ctypes.c_void_p) for x in (*held, *out)]
    failed = library().plant_simulate(ctypes.c_int(n), ctypes.c_int(count), *pointers)
    if failed or not all(np.isfinite(x).all() for x in out):
        raise RanAwayError(f"ran away in period {failed}")
    return Run(*out)
