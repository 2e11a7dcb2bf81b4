"""Recordings of a six-joint arm in space whose last motor turns with the last two joints, from equations by hand.

The proportions are a Stäubli RX-90's, as are the quarter turns; bodies, rotors and frictions are invented. Torques
come from the virtual work of the bodies' particles (judge/space.py) along a prescribed motion with its exact
derivatives, and every joint's torque has an offset. The model file knows neither rotors nor frictions, as one that came
out of a URDF.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.recordings.recording import Recording
from tests.judge import space
from tests.judge.bodies import torque
from tests.spatial_arms import TABLES
from tests.wrist import CoupledMotor

MASSES = (10.5, 4.0, 4.1, 3.6, 1.0, 0.2)  # kg
CENTRES = (
    *((0.0, -0.04, 0.02), (0.11, 0.0, 0.13), (0.01, -0.02, 0.04)),
    *((0.0, 0.0, -0.11), (0.0, 0.03, 0.0), (0.0, 0.0, 0.04)),
)  # m
ROTORS = (0.5, 0.5, 0.2, 0.06, 0.05, 0.02)  # kg m^2
DRY = (6.0, 7.0, 5.0, 3.0, 2.0, 0.5)  # N m
VISCOUS = (8.0, 5.5, 2.0, 1.1, 1.9, 0.6)  # N m s/rad
OFFSETS = (0.3, 0.5, -0.4, 0.2, -0.3, 0.1)  # N m
NOISE = (0.9, 0.9, 0.4, 0.1, 0.1, 0.05)  # N m
COUNTS = 2 * np.pi / 600_000  # rad, of the encoders
RATE = 1000.0  # Hz
FREQUENCIES = (0.1, 0.5)  # Hz, from to
SWING = 0.9  # rad, of the sum of the sines

ARM = space.chain(
    [
        space.SpatialBody(frame, mass, com, (0.004 * mass, 0.0, 0.0, 0.004 * mass, 0.0, 0.002 * mass), rotor, (), 0, 0)
        for frame, mass, com, rotor in zip(TABLES["rx90"], MASSES, CENTRES, ROTORS, strict=True)
    ]
)
MODEL = "\n".join(
    [
        'name = "spatial_wrist"',
        "gravity = [0.0, 0.0, -9.81]",
        *(
            line
            for line in space.file_joints(ARM, ("coulomb_asymmetric", "viscous"), 1.0)
            if not line.startswith("rotor_inertia")
        ),
        "",
    ]
)
"""What its user believes: everything but the coupled motor."""


@dataclass(frozen=True)
class Beside:
    """What else the file lacks: a spring at joint 4, N m/rad, and the part of the load at joint 3 that rubs there;
    gravity of a tilted base, m/s^2; and how wide the joints swing, rad."""

    spring: float = 0.0
    load: float = 0.0
    gravity: tuple[float, float, float] = space.DOWN
    swing: float = SWING


def record(motor: CoupledMotor, seed: int, seconds: float, beside: Beside = Beside()) -> Recording:
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    q, v, a = (np.array(rows) for rows in zip(*(_sines(rng, t, beside.swing) for _ in MASSES), strict=True))
    q += np.array(space.HOME[6])[:, None]
    tau = torque(ARM, np.array([q, v, a]), beside.gravity)
    tau[2] += beside.load * np.abs(tau[2]) * np.sign(v[2])
    tau[3] += beside.spring * q[3]
    tau += np.array(DRY)[:, None] * np.sign(v) + np.array(VISCOUS)[:, None] * v + np.array(OFFSETS)[:, None]
    turning, gaining = v[4] + motor.ratio * v[5], a[4] + motor.ratio * a[5]
    taken = motor.dry * np.sign(turning) + motor.viscous * turning + motor.inertia * gaining
    tau[4:] += np.array([taken, motor.ratio * taken])
    tau += np.array(NOISE)[:, None] * rng.standard_normal(tau.shape)
    read = np.round(q / COUNTS) * COUNTS
    run = np.zeros(len(t), dtype=np.int64)
    return Recording(
        *(Path("wrist.csv"), t, run, read, tau),
        types=("revolute",) * 6,
        segments=(slice(0, len(t)),),
        temperature=(None,) * 6,
    )


def _sines(rng: np.random.Generator, t: Array, swing: float) -> tuple[Array, Array, Array]:
    """Position, rate and acceleration of a sum of four sines."""
    w = 2 * np.pi * np.geomspace(*FREQUENCIES, 4)[:, None] * rng.uniform(0.85, 1.15, (4, 1))
    size = swing * rng.uniform(0.2, 0.4, (4, 1))
    angle = w * t + rng.uniform(0, 2 * np.pi, (4, 1))
    return (
        np.sum(size * np.sin(angle), axis=0),
        np.sum(size * w * np.cos(angle), axis=0),
        np.sum(-size * w**2 * np.sin(angle), axis=0),
    )
