"""Recordings of a joint that carries its link upright, from equations written apart from the library's.

A geared joint with dry friction, part of it in proportion to the torque that its gear transmits, under the weight of
its link and a dress pack that pulls on it; set-valued friction, integrated many times finer than it is recorded at
1 kHz.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import copysign, cos, exp, tanh
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.recordings.recording import Recording
from tests import one_joint
from tests.one_joint import LINK, ROTOR

MOMENT = 0.4  # kg m
COUNT = 2 * np.pi / 200_000
SERVO = 50.0  # rad/s, critically damped to 0.8


@dataclass(frozen=True)
class Upright:
    """gravity m/s^2; by_load: dry friction per transmitted torque; stribeck N m at 0.1 rad/s; pack N m; noise N m."""

    gravity: float = 0.0
    by_load: float = 0.0
    stribeck: float = 0.0
    pack: float = 0.0
    noise: float = 0.2
    dry: float = 2.0
    viscous: float = 1.2

    def carried(self, q: float) -> float:
        """N m that the gear transmits to the link at rest."""
        return MOMENT * self.gravity * cos(q) + self.pack * (tanh(4 * (q - 0.2)) + 0.3 * exp(1.5 * (q - 0.8)))

    def level(self, rate: float, transmitted: float) -> float:
        """N m of dry friction."""
        return self.dry + self.stribeck * exp(-((rate / 0.1) ** 2)) + self.by_load * abs(transmitted)

    def acceleration(self, q: float, rate: float, torque: float) -> float:
        carried = self.carried(q)
        free = torque - carried - self.viscous * rate
        if rate == 0.0 and abs(free) <= self.level(0.0, carried):
            return 0.0
        side, found = copysign(1.0, rate or free), free / (ROTOR + LINK)
        for _ in range(3):  # the friction hangs on the acceleration by a small part
            found = (free - side * self.level(rate, LINK * found + carried)) / (ROTOR + LINK)
        return 0.0 if rate == 0.0 and found * side < 0 else found


def model(effects: str = "", gravity: float = 0.0) -> str:
    """The model file of its user, with Coulomb and viscous friction and what `effects` adds."""
    friction = "[joint.effects.coulomb_asymmetric]\n[joint.effects.viscous]\n"
    return one_joint.model_text(f"{friction}{effects}\n", "upright", -gravity)


def record(plant: Upright, seed: int, seconds: float = 30.0, size: float = 1.0, substeps: int = 5) -> Recording:
    """A recording of sines about q = 0, up to 1.4 Hz; size scales them. Its second half repeats the first."""
    rng = np.random.default_rng(seed)
    half = round(seconds * 500)
    t = np.arange(2 * half) * 1e-3
    tones = np.arange(1, 6) * rng.integers(1, 9, 5) / (half * 1e-3)
    parts = zip(rng.uniform(0.15, 0.45, 5), tones, rng.uniform(0, 6, 5), strict=True)
    wanted = size * np.asarray(sum(a / (1 + 2 * f) * np.cos(2 * np.pi * f * t + p) for a, f, p in parts))
    q, tau = _run(plant, wanted, substeps)
    return Recording(
        path=Path(f"upright{seed}.csv"),
        t=t,
        run=np.zeros(len(t), dtype=np.int64),
        q=q[None],
        tau=(tau + plant.noise * rng.standard_normal(len(t)))[None],
        types=("revolute",),
        segments=(slice(0, len(t)),),
        temperature=(None,),
    )


def _run(plant: Upright, wanted: Array, substeps: int) -> tuple[Array, Array]:
    rates = np.gradient(wanted, 1e-3)
    stiffness, damping = (ROTOR + LINK) * SERVO**2, 1.6 * (ROTOR + LINK) * SERVO
    h, q, rate = 1e-3 / substeps, float(wanted[0]), 0.0
    angle, torque = np.empty_like(wanted), np.empty_like(wanted)
    advance: Callable[[float, float, float], float] = plant.acceleration
    for k, (to, speed) in enumerate(zip(wanted.tolist(), rates.tolist(), strict=True)):
        command = stiffness * (to - q) + damping * (speed - rate)
        angle[k], torque[k] = round(q / COUNT) * COUNT, command
        for _ in range(substeps):
            new = rate + h * advance(q, rate, command)
            new = 0.0 if rate * new < 0 else new
            q += h * (rate + new) / 2
            rate = new
    return angle, torque
