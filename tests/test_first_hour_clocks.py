"""By how much another clock stamps the torques later: how often it is told right, for random motions.

Positions and torques of coupled arms with dry, viscous and load friction, gravity, a ripple and noise, sampled apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import binomtest

from runtime.arrays import Array
from runtime.recordings.clocks import ClockShift, torque_shift
from runtime.recordings.settings import CLOCK_SHIFT_LEAST

Random = np.random.Generator

FINE = 2000  # Hz, of the motion itself
RATES = (100, 125, 250, 500, 1000)  # Hz
LARGEST = 0.25  # s
CASES = 120


def legs(rng: Random, t: Array, joints: int) -> Array:
    """From rest to rest by polynomials of the fifth degree, each joint at its own times, with pauses."""
    q = np.zeros((joints, len(t)))
    for row in q:
        at, begins = 0.0, 0.0
        while begins < t[-1]:
            goal, lasts = rng.uniform(-1, 1), rng.uniform(0.6, 2.5)
            s = np.clip((t[t >= begins] - begins) / lasts, 0, 1)
            row[t >= begins] = at + (goal - at) * (10 * s**3 - 15 * s**4 + 6 * s**5)
            at, begins = goal, begins + lasts + rng.choice([0.0, rng.uniform(0, 0.7)])
    return q


def sines(rng: Random, t: Array, joints: int) -> Array:
    parts = [(f, rng.uniform(0.3, 1) / (1 + f) ** 1.5) for f in rng.uniform(0.1, 3, rng.integers(3, 7))]
    phases = rng.uniform(0, 2 * np.pi, (len(parts), joints, 1))
    return np.sum([a * np.sin(2 * np.pi * f * t + p) for (f, a), p in zip(parts, phases, strict=True)], axis=0)


def chirp(rng: Random, t: Array, joints: int) -> Array:
    end = rng.uniform(0.5, 4)
    return 0.4 * np.sin(2 * np.pi * (0.1 + end * t / t[-1] / 2) * t + rng.uniform(0, 2 * np.pi, (joints, 1)))


def to_and_fro(rng: Random, t: Array, joints: int) -> Array:
    """At one speed, but for the turns."""
    f, phase = rng.uniform(0.1, 0.6, (joints, 1)), rng.uniform(0, 2 * np.pi, (joints, 1))
    return 0.5 * np.arcsin(0.995 * np.sin(2 * np.pi * f * t + phase))


MOTIONS: Sequence[Callable[[Random, Array, int], Array]] = (legs, sines, chirp, to_and_fro)


@dataclass(frozen=True)
class Told:
    """A recording whose torques are stamped `true` s too late, and what was told of it. step: s of the slower clock."""

    true: float
    shift: ClockShift | None
    step: float

    @property
    def error(self) -> float:
        """In samples of the slower clock."""
        return np.inf if self.shift is None else abs(self.shift.value - self.true) / self.step

    @property
    def corrected(self) -> bool:
        shift = self.shift
        return shift is not None and shift.significant and abs(shift.value) > CLOCK_SHIFT_LEAST * self.step


def torques(rng: Random, t: Array, q: Array) -> Array:
    joints = len(q)
    qd = np.gradient(q, t, axis=1)
    qdd = np.gradient(qd, t, axis=1)
    own = rng.uniform(0.05, 2, joints)
    coupling = rng.uniform(-0.2, 0.2, (joints, joints)) * np.sqrt(np.outer(own, own))
    dry, viscous, weight = (
        rng.uniform(0, 3, (joints, 1)),
        rng.uniform(0, 3, (joints, 1)),
        rng.uniform(0, 8, (joints, 1)),
    )
    rigid = (np.diag(own) + coupling + coupling.T) @ qdd + rng.choice([0, 1]) * weight * np.sin(np.cumsum(q, axis=0))
    creep = rng.uniform(0, 1) * np.exp(-((qd / 0.05) ** 2))
    friction = (dry * (1 + creep) + rng.uniform(0, 0.15) * np.abs(rigid)) * np.tanh(qd / 0.005) + viscous * qd
    tau = rigid + friction + rng.choice([0, 0.2]) * np.sin(rng.uniform(30, 250) * q)
    return tau + rng.uniform(0.002, 0.05) * tau.std(axis=1, keepdims=True) * rng.standard_normal(tau.shape)


def recorded(seed: int) -> Told:
    rng = np.random.default_rng(seed)
    joints, seconds = int(rng.integers(1, 5)), rng.uniform(8, 40)
    t = np.arange(0, seconds + 2, 1 / FINE)
    q = rng.uniform(0.3, 1.5) * MOTIONS[rng.integers(len(MOTIONS))](rng, t, joints)
    tau = torques(rng, t, q)
    of_q, of_tau = rng.choice(RATES, 2)
    here = np.arange(0.5, seconds, 1 / of_q)
    there = np.arange(0.5 + rng.uniform(0, 0.3), seconds - 0.2, 1 / of_tau)
    true = float(rng.choice([0, 1, 1]) * rng.uniform(-LARGEST, LARGEST))
    counts = rng.choice([1e-6, 1e-5, 1e-4])
    positions = np.array([np.round(np.interp(here, t, x) / counts) * counts for x in q])
    jitter = rng.choice([0, 0.05]) / of_tau * rng.uniform(-1, 1, len(there))
    found = torque_shift(here, positions, there + true + jitter, np.array([np.interp(there, t, x) for x in tau]))
    return Told(true, found, 1 / min(of_q, of_tau))


@pytest.fixture(scope="module")
def told() -> list[Told]:
    return [recorded(seed) for seed in range(CASES)]


def test_a_shift_is_set_right(told):
    """Nineteen times in twenty to one and a half samples, as far as so few tell; hardly any larger one is left."""
    corrected = [case for case in told if case.corrected]
    assert len(corrected) > CASES / 3
    right = sum(case.error < CLOCK_SHIFT_LEAST for case in corrected)
    assert binomtest(right, len(corrected), 0.95, "less").pvalue > 0.05
    large = [case for case in told if abs(case.true) > 3 * case.step]
    assert np.mean([case.corrected for case in large]) > 0.95


def test_no_shift_is_made_up(told):
    """Where there is none, none is corrected, but for one time in thirty."""
    none = [case for case in told if case.true == 0]
    assert len(none) > CASES / 5
    assert np.mean([case.corrected for case in none]) < 1 / 30


def test_what_is_said_to_be_uncertain_is(told):
    """The truth lies within twice the uncertainty."""
    within = [abs(c.shift.value - c.true) < 2 * c.shift.error for c in told if c.shift is not None]
    assert len(within) > 0.9 * CASES
    assert np.mean(within) > 0.95
