"""Recordings of a one-joint drive with a known hidden effect, from equations written apart from the library's.

The model file that a user would believe is the demo's: drive with direction-dependent Coulomb, viscous and
cubic friction. What is hidden is integrated in closed loop, each in its own way: two masses for an
elasticity, a bristle for presliding, a load on the link for springs and for the outside.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, exp, pi, sin, sqrt
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.recordings.recording import Recording
from runtime.simulation import demo as plant

ROTOR, LINK = 0.10, 0.1365  # kg m^2
WARMING = 15.0  # K, reached with a time constant of a third of the recording
SIZES = {
    "stribeck": 0.6,  # N m, at 0.15 rad/s
    "viscous_asymmetric": 0.4,  # N m s/rad more towards negative q
    "linear_spring": 1.5,  # N m/rad about q = 0.3
    "parallel_spring": 3.0,  # N m/rad below q = 0.5, 0.4 N m there
    "torque_ripple": 0.45,  # N m, twice a revolution of the motor
    "elasticity": 3000.0,  # N m/rad: link at 23.6 Hz behind a held motor
    "lugre": 150.0,  # N m/rad of the bristle: slides after 7 to 11 mrad
    "thermal_friction": -0.35,  # of Coulomb friction at the end of the warming
    "disturbance": 0.5,  # N m at 3.7 Hz from outside
    "friction_wave": 0.25,  # N m of dry friction, a wave of 20 rad^-1 over the angle: no effect of the library
}
"""What `record` can hide, and its size in the unit beside it."""


@dataclass(frozen=True)
class Recorded:
    """One recording at 1 kHz: t s, q rad (counts), tau N m (command with noise), temperature degC; each (N,)."""

    t: Array
    q: Array
    tau: Array
    temperature: Array


def record(hidden: str | None, seed: int, size: float | None = None, repeats: int = 2) -> Recorded:
    """A recording with one hidden effect out of SIZES (None: none), `size` in place of its usual one."""
    rng = np.random.default_rng(seed)
    t, desired = plant.motion(rng, repeats)
    warm = WARMING * (1 - np.exp(-t / (t[-1] / 3)))
    amount = 0.0 if hidden is None else SIZES[hidden] if size is None else size
    q, tau = plant.closed_loop(desired, _advance(hidden, amount, t[-1] / 3, rng), [0.0] * 4)
    return Recorded(
        t,
        q,
        tau + plant.TORQUE_NOISE * rng.standard_normal(len(t)),
        24.0 + (warm if hidden == "thermal_friction" else 0.0) + 0.2 * rng.standard_normal(len(t)),
    )


def recording(hidden: str | None, seed: int, size: float | None = None) -> Recording:
    """The same as it is read from a file."""
    made = record(hidden, seed, size)
    whole = np.zeros(len(made.t), dtype=np.int64)
    parts, temperature = (slice(0, len(made.t)),), (made.temperature,)
    q, tau = made.q[None], made.tau[None]
    return Recording(
        Path("plant.csv"), made.t, whole, q, tau, types=("revolute",), segments=parts, temperature=temperature
    )


def _advance(hidden: str | None, amount: float, time_constant: float, rng: np.random.Generator) -> plant.Advance:
    if hidden == "elasticity":
        return _two_masses(amount)
    if hidden == "lugre":
        return _bristle(amount)
    if hidden == "friction_wave":
        return _waving(amount)

    def opposing(speed: float, side: int, time: float) -> float:
        level = plant.friction(speed, side, hidden=False)
        if hidden == "stribeck":
            level += amount * exp(-((speed / 0.15) ** 2))
        if hidden == "viscous_asymmetric" and side < 0:
            level += amount * speed
        if hidden == "thermal_friction":
            level += amount * (1 - exp(-time / time_constant))
        return level

    phase = rng.uniform(0, 2 * pi)
    loads = {
        "linear_spring": lambda q, _t: amount * (q - 0.3),
        "parallel_spring": lambda q, _t: -(amount * (0.5 - q) + 0.4) if q < 0.5 else 0.0,
        "torque_ripple": lambda q, _t: amount * cos(2 * 100 * q + 0.7),
        "disturbance": lambda _q, t: amount * sin(2 * pi * 3.7 * t + phase),
    }
    return plant.stick_slip(opposing, loads.get(hidden or ""))


def _two_masses(stiffness: float, damping_ratio: float = 0.03) -> plant.Advance:
    """Motor (angle, rate) with the joint's friction, link (angle, rate) behind a spring and a small damper."""
    damping = 2 * damping_ratio * sqrt(stiffness * LINK)
    substeps = 10
    h = plant.PERIOD / substeps

    def advance(state: plant.State, torque: float, _time: float) -> None:
        motor, rate, link, link_rate = state
        for _ in range(substeps):
            twist = stiffness * (motor - link) + damping * (rate - link_rate)
            drive = torque - twist
            side = 1 if (rate or drive) > 0 else -1
            held = plant.friction(abs(rate), side, hidden=False)
            if rate != 0.0 or abs(drive) > held:
                new = rate + h * (drive - side * held) / ROTOR
                rate = 0.0 if rate * new < 0.0 else new
            link_rate += h * twist / LINK
            motor += h * rate
            link += h * link_rate
        state[:] = [motor, rate, link, link_rate]

    return advance


def _bristle(stiffness: float) -> plant.Advance:
    """A rigid joint whose dry friction is one elastic bristle: state (angle, rate, deflection)."""
    substeps = 10
    h = plant.PERIOD / substeps

    def advance(state: plant.State, torque: float, _time: float) -> None:
        angle, rate, bend = state[:3]
        for _ in range(substeps):
            limit = plant.COULOMB[1 if rate > 0 else -1] / stiffness
            bend += h * (rate - abs(rate) * bend / limit)
            viscous = plant.VISCOUS * rate + plant.CUBIC * rate**3
            rate += h * (torque - stiffness * bend - viscous) / plant.INERTIA
            angle += h * rate
        state[:3] = [angle, rate, bend]

    return advance


def _waving(size: float, order: float = 20.0) -> plant.Advance:
    """A rigid joint whose dry friction is larger at some angles: state (angle, rate)."""
    substeps = 4
    h = plant.PERIOD / substeps

    def advance(state: plant.State, torque: float, _time: float) -> None:
        angle, rate = state[:2]
        for _ in range(substeps):
            side = 1 if (rate or torque) > 0 else -1
            held = plant.friction(abs(rate), side, hidden=False) + size * (1 + sin(order * angle + 0.4))
            if rate != 0.0 or abs(torque) > held:
                new = rate + h * (torque - side * held) / plant.INERTIA
                rate = 0.0 if rate * new < 0.0 else new
            angle += h * rate
        state[:2] = [angle, rate]

    return advance
