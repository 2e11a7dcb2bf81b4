"""Physics that no library has, and disturbances from outside: the right answer to these is "unexplained"."""

from __future__ import annotations

import numpy as np
from scipy import signal

from runtime.arrays import Array

from .hidden import Hidden, Setup, at, entry, same


@entry("outside_sine", "unknown")
def _(s: Setup) -> Hidden:
    frequency, phase = s.rng.choice([3.7, s.rng.uniform(1.5, 9.0)]), s.rng.uniform(0, 6)
    return Hidden("", 0.1, (1e-3, 5.0), push=lambda t, a: a * np.sin(2 * np.pi * frequency * t + phase))


@entry("outside_knocks", "unknown")
def _(s: Setup) -> Hidden:
    count = int(s.rng.integers(5, 12))
    times = s.rng.uniform(0.05, 0.95, count) * s.seconds
    lengths, sizes = s.rng.uniform(0.05, 0.25, count), s.rng.choice([-1, 1], count) * s.rng.uniform(0.6, 1.0, count)

    def push(t: Array, amount: float) -> Array:
        out = np.zeros_like(t)
        for at_, length, size in zip(times, lengths, sizes, strict=True):
            inside = (t >= at_) & (t < at_ + length)
            out[inside] += amount * size * np.sin(np.pi * (t[inside] - at_) / length)
        return out

    return Hidden("", 1.0, (1e-2, 20.0), push=push)


@entry("outside_wander", "unknown")
def _(s: Setup) -> Hidden:
    noise = s.rng.standard_normal(s.motion.shape[-1])
    wander = signal.lfilter([1.0], [1.0, -np.exp(-1e-3 / 0.6)], noise)
    wander /= wander.std()
    return Hidden("", 0.1, (1e-3, 5.0), push=lambda t, a: a * wander[: len(t)])


@entry("drag_at_angle", "unknown")
def _(s: Setup) -> Hidden:
    return Hidden("", 0.3, (1e-3, 10.0), at(s.joint, DRAG_AT_ANGLE=same, DRAG_ANGLE=s.within(0.2, 0.8)))


@entry("brake", "unknown")
def _(s: Setup) -> Hidden:
    return Hidden("", 0.5, (1e-3, 10.0), at(s.joint, BRAKE=same, BRAKE_SPEED=s.rng.uniform(0.6, 1.5)))


@entry("swinging_inertia", "unknown")
def _(s: Setup) -> Hidden:
    return Hidden("", 0.03, (1e-4, 0.12), at(s.joint, SWING=same))


@entry("friction_wave", "unknown")
def _(s: Setup) -> Hidden:
    put = at(s.joint, WAVE=same, WAVE_ORDER=s.rng.uniform(6.0, 14.0), WAVE_PHASE=s.rng.uniform(0, 6))
    return Hidden("", 0.15, (1e-3, 3.0), put)


@entry("drag_across", "unknown", least_joints=2)
def _(s: Setup) -> Hidden:
    return Hidden("", 0.1, (1e-3, 3.0), at(s.joint, ACROSS=same))
