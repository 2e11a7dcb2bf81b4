"""Recordings of two links whose outer motor turns with both joints, from equations written by hand.

A planar pair of links, as in any textbook, and a motor at the rate q̇₁ + r q̇₂ with dry and viscous friction and an
inertia: what the motor takes acts on joint 1 as it is, on joint 2 times r. The motion is prescribed, with its exact
derivatives, so that the torque is exact but for the noise. In the motor's place a fluid may resist the links.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.recordings.recording import Recording

RATE, SECONDS = 1000.0, 24.0
LENGTH, SECOND_LENGTH = 0.30, 0.2  # m, of the links
FIRST, SECOND = (2.0, 0.16, 0.03), (1.2, 0.12, 0.012)  # mass kg, centre of mass m, inertia about it kg m^2
ROTORS = (0.08, 0.05)  # kg m^2, each of its own joint
DRY, VISCOUS = (1.1, 0.8), (0.9, 0.6)  # N m, N m s/rad, each of its own joint
COUNTS = 2 * np.pi / 400_000  # rad, of the encoders
NOISE = 0.03  # N m


@dataclass(frozen=True)
class CoupledMotor:
    """Dry friction N m, viscous friction N m s/rad and inertia kg m² at the first joint; turns by the second's."""

    dry: float = 0.0
    viscous: float = 0.0
    inertia: float = 0.0
    ratio: float = 1.0


@dataclass(frozen=True)
class Resistance:
    """What no motor makes: drag of a fluid, N s²/m² a metre of either link."""

    fluid: float = 0.0


MODEL = f"""\
name = "wrist"
gravity = [0.0, 0.0]
[[joint]]
type = "revolute"
rotor_inertia = {ROTORS[0]}
gear_ratio = 100
[joint.link]
length = {LENGTH}
mass = {FIRST[0]}
com = [{FIRST[1]}, 0.0]
inertia = {FIRST[2]}
[joint.effects.coulomb]
[joint.effects.viscous]
[[joint]]
type = "revolute"
rotor_inertia = {ROTORS[1]}
gear_ratio = 100
[joint.link]
length = {SECOND_LENGTH}
mass = {SECOND[0]}
com = [{SECOND[1]}, 0.0]
inertia = {SECOND[2]}
[joint.effects.coulomb]
[joint.effects.viscous]
"""
"""What its user believes: everything but the coupled motor."""


def record(motor: CoupledMotor, seed: int, beside: Resistance = Resistance(), alike: float = 0.0) -> Recording:
    """A recording; alike: how much of the second joint's motion is the first's."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(SECONDS * RATE)) / RATE
    first, second = np.array(_sines(rng, t)), np.array(_sines(rng, t))
    q, v, a = np.stack([first, alike * first + (1 - alike**2) ** 0.5 * second], axis=1)
    tau = _links(q, v, a) + np.array(ROTORS)[:, None] * a
    tau += np.array(DRY)[:, None] * np.sign(v) + np.array(VISCOUS)[:, None] * v
    rate, acceleration = v[0] + motor.ratio * v[1], a[0] + motor.ratio * a[1]
    taken = motor.dry * np.sign(rate) + motor.viscous * rate + motor.inertia * acceleration
    tau += np.array([taken, motor.ratio * taken]) + _drag(q, v, beside.fluid)
    tau += NOISE * rng.standard_normal(tau.shape)
    run = np.zeros(len(t), dtype=np.int64)
    read = np.round(q / COUNTS) * COUNTS
    kinds = ("revolute", "revolute")
    return Recording(
        Path("wrist.csv"), t, run, read, tau, types=kinds, segments=(slice(0, len(t)),), temperature=(None, None)
    )


def _sines(rng: np.random.Generator, t: Array) -> tuple[Array, Array, Array]:
    """Position, rate and acceleration of a sum of sines from 0.05 to 4 Hz."""
    frequencies = np.geomspace(0.05, 4.0, 7) * rng.uniform(0.85, 1.15, 7)
    phases, sizes = rng.uniform(0, 2 * np.pi, 7), 0.5 * frequencies**-0.9 * 0.05**0.5
    w = 2 * np.pi * frequencies[:, None]
    angle = w * t + phases[:, None]
    size = sizes[:, None]
    return (
        np.sum(size * np.sin(angle), axis=0),
        np.sum(size * w * np.cos(angle), axis=0),
        np.sum(-size * w**2 * np.sin(angle), axis=0),
    )


def _links(q: Array, v: Array, a: Array) -> Array:
    """(2, N) torque of the two links: Spong & Vidyasagar 1989, section 6.4, without gravity."""
    (m1, c1, i1), (m2, c2, i2) = FIRST, SECOND
    cosine, h = np.cos(q[1]), -m2 * LENGTH * c2 * np.sin(q[1])
    d11 = m1 * c1**2 + i1 + m2 * (LENGTH**2 + c2**2 + 2 * LENGTH * c2 * cosine) + i2
    d12 = m2 * (c2**2 + LENGTH * c2 * cosine) + i2
    d22 = m2 * c2**2 + i2
    first = d11 * a[0] + d12 * a[1] + h * (2 * v[0] * v[1] + v[1] ** 2)
    second = d12 * a[0] + d22 * a[1] - h * v[0] ** 2
    return np.array([first, second])


def _drag(q: Array, v: Array, density: float) -> Array:
    """(2, N) torque of a fluid that resists each strip of both links by the square of its speed across the link."""
    torque, elbow, strips = np.zeros_like(v), LENGTH * np.cos(q[1]), 12
    for part in (np.arange(strips) + 0.5) / strips:
        at, across = part * LENGTH, part * LENGTH * v[0]
        torque[0] += density * LENGTH / strips * np.abs(across) * across * at
        at, across = part * SECOND_LENGTH, elbow * v[0] + part * SECOND_LENGTH * (v[0] + v[1])
        force = density * SECOND_LENGTH / strips * np.abs(across) * across
        torque += np.array([force * (at + elbow), force * at])
    return torque
