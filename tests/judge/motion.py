"""Excitations: what the arm is asked to do while it is recorded."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array

PERIOD = 1e-3
KINDS = ("full", "no_repeat", "no_slow", "slow", "small", "one_cosine", "brief", "fourier")
"""full: slow triangles, cosines of rising speed, a multi-sine three times, a fast part; brief: each of them for a
quarter of the time; fourier: a multi-sine four times and nothing else. The others lack something."""
ORDINARY = {"": "full", "mujoco": "fourier"}
"""By simulator, the excitation in whose place, and with which, a first motion is compared."""


def desired(rng: np.random.Generator, n: int, kind: str = "full") -> Array:
    """Angle, rate and acceleration (3, n, N) at 1 kHz; 80 s for one joint and 60 to 80 s for an arm if full."""
    if kind == "one_cosine":
        pieces = [_cosines(rng, n, [rng.uniform(1.0, 2.0)], 30.0)]
    elif kind == "fourier":
        pieces = [_multisine(rng, n, 4, fade=2000)]
    elif kind == "slow":
        pieces = [_triangles(rng, n), _triangles(rng, n)]
    elif kind == "brief":
        pieces = [_triangles(rng, n, 6.0), _cosines(rng, n, [1.0, 3.5], 2.5), _multisine(rng, n, 3, 3.0)]
        pieces.append(_fast(rng, n, 3.0))
    else:
        pieces = [] if kind == "no_slow" else [_triangles(rng, n)]
        fastest = 5.0 if n < 3 else 3.5
        speeds = [0.6 * fastest, fastest] if kind == "no_slow" else [1.0, 0.6 * fastest, fastest]
        pieces += [_cosines(rng, n, speeds, 6.5), _multisine(rng, n, 1 if kind == "no_repeat" else 3), _fast(rng, n)]
    angle = np.concatenate([np.zeros((n, 300)), *pieces, np.zeros((n, 300))], axis=1)
    if kind == "small":
        angle *= 0.13
    return _derived(_smooth(_smooth(angle, 30), 30))


def along(angle: Array) -> Array:
    """Angles (n, N) with rate and acceleration, (3, n, N)."""
    return _derived(angle)


def gentle(angle: Array, home: Array) -> Array:
    """A motion's angles (n, N) about others (n,), as (3, n, N): up to some 3 Hz and some 20 rad/s^2."""
    for _ in range(3):
        angle = _smooth(angle, 80)
    return _derived(angle + home[:, None])


def _derived(angle: Array) -> Array:
    rate = np.gradient(angle, PERIOD, axis=1)
    return np.stack([angle, rate, np.gradient(rate, PERIOD, axis=1)])


def _smooth(x: Array, length: int) -> Array:
    padded = np.pad(x, ((0, 0), (length, length)), mode="edge")
    means = np.array([np.convolve(row, np.full(length, 1 / length), "same") for row in padded])
    smoothed: Array = means[:, length:-length]
    return smoothed


def _window(count: int, fade: int = 500) -> Array:
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(fade) / fade)
    return np.concatenate([ramp, np.ones(count - 2 * fade), ramp[::-1]])


def _triangles(rng: np.random.Generator, n: int, seconds: float = 18.0) -> Array:
    """Legs at constant speed to and fro, each pair faster than the last."""
    count = round(seconds / PERIOD)
    out = np.zeros((n, count))
    for i in range(n):
        start = rng.choice([-1, 1]) * rng.uniform(0.3, 0.45)
        at, corners, times = start, [0.0, start], [0.0, 0.8]
        for speed in np.array([0.05, 0.09, 0.18, 0.35, 0.7]) * rng.uniform(0.8, 1.25, 5):
            length = min(speed * rng.uniform(1.7, 2.1), 0.8)
            away = -np.sign(start) * length
            for target in (at + away, at):
                times.append(times[-1] + length / speed)
                corners.append(target)
        times.append(times[-1] + 0.8)
        corners.append(0.0)
        scale = seconds / times[-1]
        out[i] = np.interp(np.arange(count) * PERIOD, np.array(times) * scale, corners)
    return out


def _cosines(rng: np.random.Generator, n: int, speeds: list[float], seconds: float) -> Array:
    """Sines of one amplitude at peak speeds that rise from one to the next."""
    count = round(seconds / PERIOD)
    out = np.zeros((n, count * len(speeds)))
    for i in range(n):
        amplitude = rng.uniform(0.8, 0.95)
        frequency = np.concatenate([np.full(count, s * rng.uniform(0.85, 1.05) / amplitude) for s in speeds])
        frequency = _smooth(frequency[None, :], 600)[0]
        phase = np.cumsum(frequency) * PERIOD
        out[i] = amplitude * np.sin(phase) * _window(len(phase))
    return out


def _multisine(rng: np.random.Generator, n: int, repeats: int, seconds: float = 10.0, fade: int = 500) -> Array:
    """A random sum of harmonics of 1/seconds up to 2.5 Hz; the same `repeats` times, or as long without repeating.

    fade   periods in which it begins and ends
    """
    rows = []
    for _ in range(n):
        count = round(seconds / PERIOD) * (1 if repeats > 1 else 3)
        total = count * PERIOD
        harmonics = np.arange(1, round(2.5 * total) + 1)
        sizes = rng.standard_normal(len(harmonics)) / (1.0 + (harmonics / (0.45 * total)) ** 1.5)
        t = np.arange(count) * PERIOD
        wave = np.zeros(count)
        for h, size, phase in zip(harmonics, sizes, rng.uniform(0, 2 * np.pi, len(harmonics)), strict=True):
            wave += size * np.sin(2 * np.pi * h * t / total + phase)
        rate = np.abs(np.gradient(wave, PERIOD)).max()
        wave *= min(0.95 / np.abs(wave).max(), 3.8 / rate)
        rows.append(np.tile(wave, repeats) if repeats > 1 else wave)
    out = np.array(rows)
    ramps = _window(2 * fade, fade)
    lead, tail = out[:, -fade:] * ramps[:fade], out[:, :fade] * ramps[fade:]
    return np.concatenate([lead, out, tail], axis=1)


def _fast(rng: np.random.Generator, n: int, seconds: float = 10.0) -> Array:
    """A random sum of sines from 1 to 14 Hz at accelerations of some 10 rad/s^2."""
    t = np.arange(round(seconds / PERIOD)) * PERIOD
    out = np.zeros((n, len(t)))
    for i in range(n):
        for frequency in np.geomspace(rng.uniform(0.8, 1.2), rng.uniform(11.0, 15.0), 24):
            size = rng.uniform(1.0, 2.5) / (2 * np.pi * frequency) ** 2
            out[i] += size * np.sin(2 * np.pi * frequency * t + rng.uniform(0, 2 * np.pi))
        out[i] *= _window(len(t)) * min(1.0, 0.25 / np.abs(out[i]).max())
    return out
