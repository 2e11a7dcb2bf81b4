"""Rests of a joint: its dry friction is unknown there, and is eliminated from the rows that it reaches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from runtime.motion.filters import LowPass
from runtime.motion.settings import (
    DENSE_DIRECTIONS,
    FRICTION_SIGMAS,
    LEAST_LEFT,
    LEAST_OF_ROW,
    RATE_BLUR,
    RESOLVED_REST,
    SAME_DIRECTION,
    UNKNOWN_OVER_NOISE,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def at_rest(rate: Array, dt: float, cutoff: float, standstill: float) -> Mask:
    """(N,) samples of a rate (N,) at steps of dt at which it rests or turns, or is about to as far as it is known.

    What rubs holds any torque below its friction at rest. A rate that its noise may have turned is below `standstill`;
    a turn lies between two samples, and the smoothing of the rate, `cutoff` Hz, blurs when a rest began.
    """
    still = np.abs(rate) < standstill
    turning = np.diff(np.sign(rate)) != 0
    still[:-1] |= turning
    still[1:] |= turning
    reach = max(1, int(np.ceil(RATE_BLUR / (cutoff * dt))))
    count = np.concatenate([[0], np.cumsum(still)])
    at = np.arange(len(still))
    close: Mask = count[np.minimum(at + reach + 1, len(still))] > count[np.maximum(at - reach, 0)]
    return close


def dry_friction(q: Array, qd: Array, qdd: Array, rigid: Array, tau: Array) -> float:
    """N m (N), as much as it may be: the jump of a torque where a joint turns, beside what is smooth in its own motion,
    (M,) each, and what the arm's rigid bodies may ask of it, rigid (k, M): the other joints' motion asks more of a
    heavy one.

    A joint that hardly runs in one direction does not tell its friction from an offset; none would be the one wrong
    answer, as its turns would then pass for known.
    """
    if not len(q):
        return 0.0
    columns = np.vstack([np.sign(qd), qd, qdd, np.ones_like(q), np.sin(q), np.cos(q), rigid])
    size = np.maximum(np.linalg.norm(columns, axis=1), 1e-300)
    columns /= size[:, None]
    inverse = np.linalg.pinv(columns @ columns.T, rcond=1e-9, hermitian=True)
    found = inverse @ (columns @ tau)
    left = float(np.linalg.norm(tau - found @ columns)) / np.sqrt(len(q))
    most = (float(found[0]) + FRICTION_SIGMAS * left * np.sqrt(max(float(inverse[0, 0]), 0.0))) / float(size[0])
    return max(most, 0.0)


@dataclass(frozen=True)
class UnknownTorque:
    """Rows (M,) less all that a torque at some samples could have put into them, whatever it was.

    A torque that is unknown at some samples is so many unknowns more. The band's filter lets few of their combinations
    through: those are eliminated, from measured torque and regressors alike, by projecting the rows on what is
    orthogonal to them. An equation stays one, noise that was white stays white in what is left, and as the combinations
    are signals in the band, rows stay in it.

    samples (N,), quiet: as given to `of`; directions (M, K) sparse, orthonormal within every run of samples; left (M,):
    part of each row that is left; counts (M,): rows of which that is enough.
    Source: nuisance parameters in least squares, eliminated by projection: Frisch & Waugh 1933, Econometrica 1(4).
    """

    samples: Mask
    quiet: float
    directions: sparse.csr_array
    left: Array
    counts: Mask

    @classmethod
    def of(cls, low_pass: LowPass, unknown: Mask, quiet: float) -> UnknownTorque:
        """Of samples (N,) at which it is unknown; quiet: torque noise in the band over what it may come to, 0 where it
        may come to anything."""
        left, found = _eliminated(low_pass, unknown, max(UNKNOWN_OVER_NOISE * quiet, SAME_DIRECTION))
        left = np.maximum(left, 0.0)
        return cls(unknown, quiet, _side_by_side(found, len(left)), left, left > LEAST_OF_ROW)

    @property
    def too_much(self) -> bool:
        """Whether too little is left of the rows that no rest holds whole."""
        return bool(self.left.sum() < LEAST_LEFT * np.count_nonzero(self.left))

    def resolved(self, low_pass: LowPass) -> UnknownTorque:
        """The same with the torque known in rests that the band does not resolve, in which friction comes and goes
        within a period of the cut-off."""
        lasting = np.zeros(len(self.samples), dtype=bool)
        for run in _runs(self.samples):
            lasting[run] = run.stop - run.start > RESOLVED_REST * low_pass.rate / low_pass.cutoff
        return self.of(low_pass, lasting, self.quiet)

    def cut(self, window: slice, low_pass: LowPass) -> UnknownTorque:
        """Within a window of samples: no row counts there that a run of samples at its ends reaches, as it would have
        to be known from outside."""
        found = self.of(low_pass, self.samples[window], self.quiet)
        counts, size = found.counts.copy(), window.stop - window.start
        for run in _runs(found.samples):
            if run.start < 2 * low_pass.half or run.stop > size - 2 * low_pass.half:
                counts[low_pass.rows(run, low_pass.half, len(counts))] = False
        return replace(found, counts=counts)

    @cached_property
    def _across(self) -> sparse.csc_array:
        """(K, M) the directions' transpose, which takes as long to make as to multiply by."""
        return self.directions.T

    @cached_property
    def _gram(self) -> SuperLU:
        gram = self._across @ self.directions
        return splu(sparse.csc_matrix(gram + SAME_DIRECTION**2 * sparse.eye_array(gram.shape[0])))

    @cached_property
    def _axes(self) -> tuple[Array, Array] | None:
        """(M, K) orthonormal axes of the directions and (K,) what is taken of each; None where these are too many to
        stand without zeros between them."""
        rows, count = self.directions.shape
        if rows * count > DENSE_DIRECTIONS:
            return None
        # Of the rows that they reach: the others keep their zeros to the last bit.
        reached = np.flatnonzero(np.diff(self.directions.indptr))
        inside, size, _ = np.linalg.svd(self.directions[reached].toarray(), full_matrices=False)
        axes = np.zeros((rows, len(size)))
        axes[reached] = inside
        return axes, size**2 / (size**2 + SAME_DIRECTION**2)

    def __call__(self, x: Array) -> Array:
        """x (..., M) -> (..., M)."""
        if not self.directions.shape[1]:
            return x
        with np.errstate(invalid="ignore"):  # a column that overflows is left out by whoever asked for it
            if self._axes is not None:
                axes, part = self._axes
                rows = x.reshape(-1, x.shape[-1])
                return np.asarray(rows - ((rows @ axes) * part) @ axes.T).reshape(x.shape)
            flat = x.reshape(-1, x.shape[-1]).T
            left: Array = flat - self.directions @ self._gram.solve(np.ascontiguousarray(self._across @ flat))
        return np.ascontiguousarray(left.T).reshape(x.shape)


def _eliminated(low_pass: LowPass, unknown: Mask, least: float) -> tuple[Array, list[tuple[slice, Array]]]:
    """(M,) part of each row that is left without what a torque of at most 1 at samples (N,) puts more than `least`
    into, exactly 0 deep inside a rest; and by runs of samples the rows that they reach and their combinations (m, k).

    Combinations of runs that reach the same rows count twice in what is left, which may be less than nothing.
    """
    rows, kernel = len(low_pass.centres(len(unknown))), 2 * low_pass.half
    left = np.ones(rows)
    alike: dict[tuple[int, int, int], Array] = {}
    found: list[tuple[slice, Array]] = []
    for run in _runs(unknown):
        if run.stop - run.start > 2 * kernel:
            # Deep inside no kernel reaches what is known.
            ends = slice(run.start, run.start + kernel), slice(run.stop - kernel, run.stop)
            inside = low_pass.rows(slice(run.start + low_pass.half, run.stop - low_pass.half), 0, rows)
            left[inside] = 0.0
            parts = [(ends[0], slice(0, inside.start)), (ends[1], slice(inside.stop, rows))]
        else:
            parts = [(run, slice(0, rows))]
        for samples, among in parts:
            reached = low_pass.rows(samples, low_pass.half, rows)
            reached = slice(max(reached.start, among.start), min(reached.stop, among.stop))
            # What a row has of a sample hangs on how far they are apart alone.
            apart = samples.start - low_pass.factor * reached.start
            key = (apart, samples.stop - samples.start, reached.stop - reached.start)
            if key not in alike:
                alike[key] = _basis(low_pass.response(samples, reached), least)
            left[reached] -= (alike[key] ** 2).sum(axis=1)
            found.append((reached, alike[key]))
    return left, found


def _runs(there: Mask) -> Iterator[slice]:
    """Stretches of samples (N,) that are there."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]])))
    return (slice(int(start), int(stop)) for start, stop in edges.reshape(-1, 2))


def _side_by_side(bases: Sequence[tuple[slice, Array]], rows: int) -> sparse.csr_array:
    """(rows, K) columns of bases (m, k), each in its rows of all."""
    at = [np.repeat(np.arange(there.start, there.stop), basis.shape[1]) for there, basis in bases]
    ends = np.cumsum([0, *(basis.shape[1] for _, basis in bases)])
    number = [np.tile(np.arange(*edges), len(basis)) for edges, (_, basis) in zip(pairwise(ends), bases, strict=True)]
    values = np.concatenate([np.zeros(0), *(basis.ravel() for _, basis in bases)])
    place = (np.concatenate([np.zeros(0, int), *at]), np.concatenate([np.zeros(0, int), *number]))
    return sparse.csr_array((values, place), shape=(rows, int(ends[-1])))


def _basis(response: Array, least: float) -> Array:
    """(m, k) orthonormal combinations of rows through which a torque of at most 1 at samples (n) comes to more than
    `least`; response (m, n)."""
    power, vectors = np.linalg.eigh(response @ response.T)
    largest = np.sqrt(np.maximum(power, 0.0) * response.shape[1])
    return np.asarray(vectors[:, largest > least])
