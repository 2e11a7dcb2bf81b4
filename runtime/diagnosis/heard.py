"""What recordings that were not fitted say of one fit against another.

Their errors are plain, not whitened: they hold what the fit's own values cost elsewhere. Time is cut where the two
fits differ, so that each stretch holds as much of their difference: of an effect that acts everywhere these are even
stretches, of one that acts for a moment they lie within it, and stretches without it say nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis.gates import HELD_OUT
from runtime.diagnosis.settings import HEARD_SIGMAS, OUTWEIGHED, STRETCHES
from runtime.diagnosis.steps import Errors

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Heard:
    """falls_to: part of the squared error that is left, where the fits differ; sigmas: by how many standard deviations
    of its stretches' logarithms that is below 1; whole: part that is left over all time. Infinite and 0 where other
    joints lose by it, or the whole error rises."""

    falls_to: float
    sigmas: float
    whole: float = 1.0

    @property
    def repays(self) -> float:
        """What of a price that pays: a likelihood's logarithm at so many standard deviations, where they are sure."""
        return 0.5 * self.sigmas**2 if self.sigmas > HEARD_SIGMAS and self.falls_to < HELD_OUT.limit else 0.0

    @property
    def clear(self) -> bool:
        """Whether the one fit is surely better, over all time."""
        return self.repays > 0 and self.whole < HELD_OUT.limit


_DENIED = Heard(float("inf"), 0.0, float("inf"))


def heard(one: Errors, other: Errors, groups: Sequence[Collection[int]]) -> Heard:
    """Of one fit's errors against another's, at that of some groups of joints (0-based) at which it falls most; no
    joint may lose more than a part of what is gained there."""
    told = [_at(one, other, group) for group in groups]
    best = min(told, key=lambda h: h.falls_to, default=Heard(1.0, 0.0))
    gained = -np.log(best.falls_to)
    against = [_at(other, one, (i,)) for i in range(len(one.rms))]
    lost = sum(-np.log(h.falls_to) for h in against if h.clear)
    return best if best.whole < 1 and lost <= OUTWEIGHED * max(gained, 0.0) else _DENIED


def _at(one: Errors, other: Errors, joints: Collection[int]) -> Heard:
    """Of one fit against another at some joints (0-based), each in units of its error with the other."""
    pairs = [(one.left[i], other.left[i], other.rms[i], other.ties[i]) for i in joints if len(one.left[i])]
    logs = [d for left, before, rms, tie in pairs if rms > 0 for d in _stretched(left / rms, before / rms, tie)]
    if not logs or not np.isfinite(logs).all():
        return _DENIED
    falls = float(np.mean(logs))
    spread = float(np.std(logs, ddof=1)) / len(logs) ** 0.5 if len(logs) > 1 else float("inf")
    whole = sum(float(left @ left) / rms**2 for left, _, rms, _ in pairs) / sum(len(left) for left, _, _, _ in pairs)
    return Heard(float(np.exp(-min(falls, 700.0))), falls / spread if spread > 0 else 0.0, whole)


def _stretched(left: Array, before: Array, tie: int) -> Array:
    """(S,) logarithms of how many times smaller a squared residual (m,) is than another, over stretches of at least
    `tie` rows that hold equal parts of the squared difference."""
    apart = np.cumsum((left - before) ** 2)
    if not apart[-1] > 0:
        return np.zeros(0)
    ends = np.searchsorted(apart, apart[-1] * np.arange(1, STRETCHES + 1) / STRETCHES) + 1
    edges = [0]
    for end in ends:
        if end >= edges[-1] + tie:
            edges.append(int(end))
    edges[-1] = len(left) if len(edges) > 1 else 0
    if len(edges) < 2:
        edges = [0, len(left)]
    starts = np.array(edges[:-1])
    squares = [np.add.reduceat(x**2, starts) for x in (before, left)]
    tiny = 1e-300
    return np.log(np.maximum(squares[0], tiny) / np.maximum(squares[1], tiny))
