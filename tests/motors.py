"""Recordings of a single motor with torque lines over its angle, from equations written apart from the library's.

A rotor with Coulomb and viscous friction and waves of torque over the motor's angle is integrated in closed loop under
a servo at 1 kHz, whose command is recorded with noise beside the counts of its encoder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import copysign, cos
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.recordings.recording import Recording

PERIOD = 1e-3
SUBSTEPS = 4
BANDWIDTH = 50.0  # rad/s of the servo


@dataclass(frozen=True)
class Motor:
    """Everything at the joint: inertia kg m^2, Coulomb N m, viscous N m s/rad, noise of the torque N m; counts a turn
    of the motor."""

    ratio: float = 1.0
    inertia: float = 1e-3
    coulomb: float = 0.05
    viscous: float = 0.01
    noise: float = 0.01
    counts: float = 1e5

    def model(self, effects: Sequence[str] = ("coulomb", "viscous")) -> str:
        """The model file that its user would believe."""
        head = f"""name = "motor"
gravity = [0.0, 0.0]
[[joint]]
type = "revolute"
rotor_inertia = {self.inertia}
gear_ratio = {self.ratio}
[joint.link]
length = 0.0
mass = 0.0
com = [0.0, 0.0]
inertia = 0.0
"""
        return head + "".join(f"[joint.effects.{name}]\n" for name in effects)


GEARED = Motor(ratio=50.0, inertia=0.24, coulomb=1.0, viscous=1.0, noise=0.02, counts=16384)


def steps(speeds: Sequence[float], seconds: float) -> Array:
    """Positions at 1 kHz of a motion at one speed after another, 0.2 s from one to the next."""
    n = round(seconds / PERIOD)
    speed = np.array(speeds)[np.minimum(np.arange(n) * len(speeds) // n, len(speeds) - 1)]
    width = round(0.2 / PERIOD)
    ramped = np.convolve(np.pad(speed, (width, width), "edge"), np.ones(width) / width, "same")[width:-width]
    return np.asarray(np.cumsum(ramped) * PERIOD)


def sines(size: float, seconds: float, seed: int) -> Array:
    """Positions at 1 kHz of five sines together, up to 1 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds / PERIOD)) * PERIOD
    parts = zip(rng.uniform(0.4, 1.0, 5), rng.uniform(0.05, 1.0, 5), rng.uniform(0, 6, 5), strict=True)
    return np.asarray(sum(size * a * np.sin(2 * np.pi * f * t + p) for a, f, p in parts))


def record(
    motor: Motor, desired: Array, waves: Sequence[tuple[float, float, float]], seed: int = 0, outside: float = 0.0
) -> Recording:
    """A recording; waves: (order a turn of the motor, N m at the joint, phase rad); outside: N m at 23.7 Hz."""
    rng = np.random.default_rng(seed)
    rate, step = np.gradient(desired, PERIOD), 2 * np.pi / motor.counts / motor.ratio
    stiffness, damping = motor.inertia * BANDWIDTH**2, 1.4 * motor.inertia * BANDWIDTH
    read, command = np.zeros_like(desired), np.zeros_like(desired)
    angle, speed, filtered, before, h = float(desired[0]), 0.0, 0.0, float(desired[0]), PERIOD / SUBSTEPS
    for k, (goal, goal_rate) in enumerate(zip(desired.tolist(), rate.tolist(), strict=True)):
        seen = round(angle / step) * step
        filtered += 0.4 * ((seen - before) / PERIOD - filtered)
        before = seen
        u = stiffness * (goal - seen) + damping * (goal_rate - filtered)
        u += motor.coulomb * np.tanh(goal_rate / 0.05) + motor.viscous * goal_rate
        read[k], command[k] = seen, u
        load = outside * cos(2 * np.pi * 23.7 * k * PERIOD)
        for _ in range(SUBSTEPS):
            drive = u - load - motor.viscous * speed
            drive -= sum(size * cos(order * motor.ratio * angle + phase) for order, size, phase in waves)
            if speed == 0.0 and abs(drive) <= motor.coulomb:
                continue
            friction = copysign(motor.coulomb, speed or drive)
            after = speed + h * (drive - friction) / motor.inertia
            speed = 0.0 if speed * after < 0.0 else after
            angle += h * speed
    t = np.arange(len(desired)) * PERIOD
    command += motor.noise * rng.standard_normal(len(t))
    whole = np.zeros(len(t), dtype=np.int64)
    q, tau = read[None], command[None]
    return Recording(Path("motor.csv"), t, whole, q, tau, ("revolute",), (slice(0, len(t)),), (None,))
