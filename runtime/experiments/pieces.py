"""The motions from which an experiment is composed: pieces that begin and end at rest in the middle of the range.

Each piece is written for one joint in units of what that joint may do, so it fits any arm: slow legs and
constant speeds for friction and springs, reversals of growing amplitude for presliding, sines over decades of
frequency for transmissions, changing load. For an arm, the joints in question move alone, with the others, or
while the others change the load.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import ArrayLike

from runtime.arrays import Array
from runtime.experiments.settings import CORNER_S, PAUSE, SPEEDING_UP
from runtime.model.loader import JointInfo
from runtime.simulation.settings import MARGIN, RANGE, RATE, SPEED


@dataclass(frozen=True)
class Envelope:
    """What a joint may do: middle and half of its range, rad (m), its speed, rad/s (m/s), and its acceleration, rad/s^2
    (m/s^2)."""

    middle: float
    reach: float
    speed: float
    scale: float
    acceleration: float

    @classmethod
    def of(cls, joint: JointInfo, wider: float = 1.0, faster: float = 1.0) -> Envelope:
        """Within the model file's limits, and what simulations assume where it states none."""
        middle, reach = 0.0, RANGE[joint.type]
        if joint.position_limits is not None:
            low, high = joint.position_limits
            middle, reach = (low + high) / 2, (high - low) / 2
        speed = joint.speed_limit or SPEED[joint.type]
        fastest = MARGIN * faster * speed
        return cls(middle, MARGIN * wider * reach, fastest, RANGE[joint.type], fastest / SPEEDING_UP)


Shape = Callable[[Envelope, np.random.Generator, float], Array]
"""Displacement from the middle (N,) at RATE; `ease` in (0, 1] makes it slower or smaller."""


@dataclass(frozen=True)
class MotionPiece:
    """A motion of the arm; make(ease) gives displacements from the middle, (n, N)."""

    name: str
    make: Callable[[float], Array]


def smooth(path: Array, seconds: float) -> Array:
    """The path (N,) with its corners rounded over twice `seconds`, ends held."""
    width = max(1, round(seconds * RATE)) | 1
    mean = np.full(width, 1 / width)
    padded = np.pad(path, 2 * width, mode="edge")
    return np.convolve(np.convolve(padded, mean, "same"), mean, "same")[width:-width]


def legs(corners: ArrayLike, speeds: ArrayLike, soft: float = CORNER_S) -> Array:
    """Straight from 0 to each corner in turn and back to 0, at these speeds."""
    places = np.concatenate([[0.0], np.asarray(corners, dtype=float), [0.0]])
    pace = np.broadcast_to(np.asarray(speeds, dtype=float), len(places) - 1)
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(places)) / pace)])
    t = np.arange(ceil(times[-1] * RATE) + 1) / RATE
    return smooth(np.interp(t, times, places), soft)


def _faded(wave: Array, envelope: Envelope, ease: float) -> Array:
    fade = np.clip(np.minimum(np.arange(len(wave)), np.arange(len(wave))[::-1]) / RATE, 0, 1)
    wave = (wave - wave.mean()) * fade**3 * (10 - 15 * fade + 6 * fade**2)
    fastest = np.abs(np.gradient(wave, 1 / RATE)).max()
    return ease * wave * min(envelope.speed / fastest, envelope.reach / np.abs(wave).max())


def sines(low: float, high: float, slope: float, seconds: float, lines: int = 13) -> Shape:
    """Sines spaced evenly on a logarithmic scale from `low` to `high` Hz, amplitudes as frequency^-slope."""

    def shape(envelope: Envelope, rng: np.random.Generator, ease: float) -> Array:
        t = np.arange(round(seconds * RATE)) / RATE
        frequency = np.geomspace(low, high, lines) * rng.uniform(0.95, 1.05, lines)
        phase = rng.uniform(0, 2 * np.pi, lines)
        waves = np.sin(2 * np.pi * frequency[:, None] * t + phase[:, None])
        return _faded(frequency**-slope @ waves, envelope, ease)

    return shape


def over_the_range(speed: float, part: float = 1.0) -> Shape:
    """There and back over a part of the range, at a part of the top speed."""

    def shape(envelope: Envelope, rng: np.random.Generator, ease: float) -> Array:
        reach = part * envelope.reach * rng.choice([-1.0, 1.0])
        return legs([reach, -reach], ease * speed * envelope.speed, CORNER_S / ease)

    return shape


def _constant_speeds(envelope: Envelope, rng: np.random.Generator, ease: float) -> Array:
    """Speeds over two decades in both directions, in random order."""
    speeds = ease * envelope.speed * rng.permutation(np.geomspace(0.01, 1.0, 8))
    far = np.minimum(envelope.reach, 1.2 * speeds) * rng.choice([-1.0, 1.0], len(speeds))
    corners = np.stack([far, np.zeros_like(far)], axis=1).ravel()
    return legs(corners[:-1], np.repeat(speeds, 2), CORNER_S / ease)


def _reversals(envelope: Envelope, rng: np.random.Generator, ease: float) -> Array:
    """Reversals of growing amplitude, 1 to 300 mrad, two of each."""
    amplitudes = np.minimum(np.repeat(envelope.scale * np.geomspace(0.001, 0.3, 7), 2), envelope.reach)
    corners = amplitudes[:, None] * rng.choice([-1.0, 1.0]) * np.array([1.0, -1.0])
    speeds = np.minimum(0.2 * envelope.speed, amplitudes / 0.1)
    pace = [*np.repeat(speeds, 2), 0.2 * envelope.speed]
    return legs(corners.ravel(), ease * np.array(pace), 0.02 / ease)


def _reversals_on_the_way(envelope: Envelope, rng: np.random.Generator, ease: float) -> Array:
    """Slow legs with small reversals on the way, so that loops lie inside loops."""
    reach = 0.8 * envelope.reach
    way = np.concatenate([np.linspace(0, reach, 7), np.linspace(reach, -reach, 13), np.linspace(-reach, 0, 7)])
    back = np.geomspace(0.003, 0.1, len(way) - 1) * envelope.scale
    ahead = np.sign(np.diff(way))
    corners = np.stack([way[1:], way[1:] - ahead * rng.permutation(back)], axis=1).ravel()
    return legs(corners, ease * 0.2 * envelope.speed, 0.02 / ease)


def _under_load(envelope: Envelope, rng: np.random.Generator, ease: float) -> Array:
    """Legs in one direction whose speed swings quickly, so that the load changes and the direction does not."""
    slow = legs([0.9 * envelope.reach, -0.9 * envelope.reach], 0.4 * envelope.speed)
    t = np.arange(len(slow)) / RATE
    swing = np.zeros_like(t)
    for frequency in (3.0, 7.0):
        amplitude = 0.175 * envelope.speed / (2 * np.pi * frequency)
        swing += amplitude * np.sin(2 * np.pi * frequency * t + rng.uniform(0, 2 * np.pi))
    # Not far from the ends of the range, and not where the legs begin and end.
    swing *= min(1.0, 0.1 * envelope.reach / np.abs(swing).max())
    fade = np.clip(np.minimum(t, t[::-1]) / 0.5, 0, 1)
    return slow + ease * swing * fade**3 * (10 - 15 * fade + 6 * fade**2)


def _swelling(envelope: Envelope, rng: np.random.Generator, ease: float) -> Array:
    t = np.arange(round(9.0 * RATE)) / RATE
    growth = np.geomspace(0.01, 1.0, len(t))
    return _faded(growth * np.sin(2 * np.pi * rng.uniform(1.8, 2.2) * t), envelope, ease)


_SHAPES: dict[str, Shape] = {
    "slow legs over the whole range": over_the_range(0.2),
    "creep over a part of the range": over_the_range(0.05, 0.35),
    "constant speeds over two decades": _constant_speeds,
    "fast legs over the whole range": over_the_range(1.0),
    "legs under changing load": _under_load,
    "reversals of growing amplitude": _reversals,
    "small reversals along slow legs": _reversals_on_the_way,
    "sines of the whole range": sines(0.12, 1.5, 1.5, seconds=14.0, lines=9),
    "sines over two decades of frequency": sines(0.12, 12.0, 1.2, 14.0),
    "sines with large accelerations": sines(2.0, 20.0, 2.0, 9.0),
    "a swelling oscillation": _swelling,
}
BROAD = (
    "the ordinary excitation",
    "sines of the whole range",
    "sines over two decades of frequency",
)
"""Pieces in which position, speed and acceleration go their own ways: a base model can be fitted on each."""
_ALONE = (
    "slow legs over the whole range",
    "constant speeds over two decades",
    "reversals of growing amplitude",
    "sines over two decades of frequency",
)


def pieces(
    joints: Sequence[Envelope], subject: Sequence[int], everyone: Sequence[int], ordinary: Callable[[], Array]
) -> list[MotionPiece]:
    """All pieces for an arm whose joints `subject` (0-based) are in question; everyone: joints that move at all;
    ordinary() is the usual excitation."""
    found = [MotionPiece(BROAD[0], lambda _: ordinary())]
    found += [MotionPiece(name, _moved(joints, dict.fromkeys(everyone, shape))) for name, shape in _SHAPES.items()]
    others = [i for i in everyone if i not in subject]
    if not others:
        return found
    who = " and ".join(str(i + 1) for i in subject)
    who = f"joint {who} alone" if len(subject) == 1 else f"joints {who} alone"
    for name in _ALONE:
        found.append(MotionPiece(f"{name}, {who}", _moved(joints, dict.fromkeys(subject, _SHAPES[name]))))
    slow, quick = _SHAPES["slow legs over the whole range"], _SHAPES["sines over two decades of frequency"]
    loaded = {i: slow if i in subject else quick for i in everyone}
    found.append(MotionPiece("slow legs while the other joints change the load", _moved(joints, loaded)))
    found.append(
        MotionPiece("slow legs with the other joints in other postures", _postures(joints, subject, others, slow))
    )
    return found


def _moved(joints: Sequence[Envelope], shapes: dict[int, Shape]) -> Callable[[float], Array]:
    """Every joint named moves by its shape, no two alike; the others rest."""

    def make(ease: float) -> Array:
        rows = {i: shape(joints[i], np.random.default_rng(i), ease) for i, shape in shapes.items()}
        return _together(len(joints), rows)

    return make


def _postures(
    joints: Sequence[Envelope], subject: Sequence[int], others: Sequence[int], shape: Shape
) -> Callable[[float], Array]:
    def make(ease: float) -> Array:
        rows: dict[int, Array] = {}
        once = {i: shape(joints[i], np.random.default_rng(i), ease) for i in subject}
        hold = max(len(row) for row in once.values())
        lead = 0
        for i in others:
            part = legs([0.6 * joints[i].reach], 0.3 * ease * joints[i].speed)
            half = len(part) // 2
            rows[i] = np.concatenate([part[:half], np.full(hold, part[half]), part[half:]])
            lead = max(lead, half)
        rows.update({i: np.pad(row, (lead, 0)) for i, row in once.items()})
        return _together(len(joints), rows)

    return make


def _together(n: int, rows: dict[int, Array]) -> Array:
    length = max(len(row) for row in rows.values())
    path = np.zeros((n, length))
    for i, row in rows.items():
        path[i, : len(row)] = row
        path[i, len(row) :] = row[-1]
    return path


def in_sequence(parts: Sequence[Array], joints: Sequence[Envelope]) -> tuple[Array, list[tuple[float, float]]]:
    """Positions (n, N) of the parts one after another, with pauses, and the seconds from and to which each goes."""
    pause = np.zeros((len(joints), round(PAUSE * RATE)))
    rows, spans, at = [pause], [], pause.shape[1]
    for part in parts:
        spans.append((at / RATE, (at + part.shape[1]) / RATE))
        rows += [part, pause]
        at += part.shape[1] + pause.shape[1]
    middle = np.array([[joint.middle] for joint in joints])
    return middle + np.concatenate(rows, axis=1), spans
