"""What residuals say of one fit against another, stretch by stretch: above all those that were not fitted.

Their errors are plain, not whitened: they hold what the fit's own values cost elsewhere. Time is cut where the two
fits differ, so that each stretch holds as much of their difference: of an effect that acts everywhere these are even
stretches, of one that acts for a moment they lie within it, and stretches without it say nothing. A law that is there
takes as much from the squared error of each. Source: the test of two laws that are not nested, Vuong 1989.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from runtime.arrays import Array
from runtime.diagnosis.gates import HELD_OUT
from runtime.diagnosis.score import stretches
from runtime.diagnosis.settings import HEARD_SIGMAS, STRETCHES, TIED
from runtime.motion.settings import LITTLE


@dataclass(frozen=True)
class Errors:
    """Error of every joint on one set of recordings: RMS and ‖τ − τ̂‖/‖τ‖; left: by joint (m,), the residual's rows that
    count."""

    rms: tuple[float, ...]
    relative: tuple[float, ...]
    left: tuple[Array, ...] = ()


@dataclass(frozen=True)
class Heard:
    """falls_to: part of the squared error that is left where the fits differ; sigmas: by how many standard deviations
    it falls from stretch to stretch. Infinite and 0 where nothing is told."""

    falls_to: float
    sigmas: float

    @property
    def repays(self) -> float:
        """What of a price that pays: a likelihood's logarithm at so many standard deviations, where they are sure."""
        return 0.5 * self.sigmas**2 if self.sigmas > HEARD_SIGMAS and self.falls_to < HELD_OUT.limit else 0.0

    @property
    def clear(self) -> bool:
        """Whether the one fit is surely better."""
        return self.repays > 0


def heard(one: Errors, other: Errors, groups: Sequence[Collection[int]]) -> Heard:
    """Of one fit's errors against another's, at that of some groups of joints (0-based) at which it falls most; what
    joints clearly lose is charged to it."""
    told = [_at(one, other, group) for group in groups]
    best = min(told, key=lambda h: h.falls_to, default=Heard(1.0, 0.0))
    against = [_at(other, one, (i,)) for i in range(len(one.rms))]
    return replace(best, falls_to=best.falls_to / float(np.prod([h.falls_to for h in against if h.clear])))


def steadily(one: Errors, other: Errors, groups: Sequence[Collection[int]]) -> float:
    """Standard deviations by which the squared error falls, at the best of some groups of joints."""
    return max((_at(one, other, group).sigmas for group in groups), default=0.0)


def spread_over(one: Errors, other: Errors, joint: int) -> float:
    """Over how many of STRETCHES even stretches of time the difference of two fits is spread at a joint (0-based)."""
    squares = (one.left[joint] - other.left[joint]) ** 2
    parts = np.array([float(x.sum()) for x in np.array_split(squares, STRETCHES)])
    return float(parts.sum() ** 2 / max(float(parts @ parts), 1e-300))


def _at(one: Errors, other: Errors, joints: Collection[int]) -> Heard:
    """Of one fit against another at some joints (0-based)."""
    own = [i for i in joints if len(one.left[i]) and other.rms[i] > 0]
    return compared([one.left[i] for i in own], [other.left[i] for i in own])


def compared(left: Sequence[Array], before: Sequence[Array]) -> Heard:
    """Of residuals (m,) of some joints against others."""
    units = [max(float(np.sqrt(np.mean(r**2))), 1e-300) for r in before]
    parts = [_stretched(a / u, b / u) for a, b, u in zip(left, before, units, strict=True)]
    now, was, sizes = (np.concatenate([part[k] for part in parts] or [np.zeros(0)]) for k in range(3))
    if not len(now) or not np.isfinite([*now, *was]).all():
        return Heard(inf, 0.0)
    falls = was - now
    spread = float(np.std(falls, ddof=1)) / len(falls) ** 0.5 if len(falls) > 1 else inf
    sigmas = float(np.mean(falls)) / spread if spread > 0 else 0.0
    # The longest stretches are those in which the fits hardly differ.
    busy = np.argsort(-sizes, kind="stable")[round(LITTLE * len(sizes)) :]
    return Heard(float(now[busy].sum() / was[busy].sum()), sigmas)


def _stretched(left: Array, before: Array) -> tuple[Array, Array, Array]:
    """(S,) squares of two residuals (m,) and numbers of rows, over stretches of equal squared difference."""
    edges = stretches((left - before) ** 2, TIED)
    now, was = (np.maximum(np.add.reduceat(x**2, edges), 1e-300) for x in (left, before))
    return now, was, np.diff([*edges, len(left)])
