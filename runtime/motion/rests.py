"""Dry friction is unknown while a joint rests: it is eliminated from the rows that it reaches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
from scipy import sparse

from runtime.arrays import Array, Mask
from runtime.motion.filters import LowPass
from runtime.motion.settings import LITTLE

UNKNOWN_OVER_NOISE: Final = 0.3
"""ratio to the torque noise in the band; a combination of rows is eliminated if the dry friction at rest could exceed
it there; what is left in is then small beside the noise, also where it comes back; by construction."""
SAME_DIRECTION: Final = 1e-3
"""part of a row; combinations of rows that differ by less are one; rounding."""


def at_rest(rate: Array, dt: float, cutoff: float, standstill: float) -> Mask:
    """(N,) samples of a rate (N,), at steps of dt, at which a joint rests or turns: there friction holds any torque.

    Below `standstill` the sign of a rate is chance. A turn lies between two samples, and the smoothing of the rate,
    down by half at twice the cut-off, blurs where a rest began by 1 / (2 pi 2) of the cut-off's period.
    """
    still = np.abs(rate) < standstill
    turning = np.diff(np.sign(rate)) != 0
    still[:-1] |= turning
    still[1:] |= turning
    reach = max(1, int(np.ceil(0.08 / (cutoff * dt))))
    count = np.concatenate([[0], np.cumsum(still)])
    at = np.arange(len(still))
    close: Mask = count[np.minimum(at + reach + 1, len(still))] > count[np.maximum(at - reach, 0)]
    return close


def dry_friction(q: Array, qd: Array, qdd: Array, rigid: Array, tau: Array) -> float:
    """Upper bound of a joint's dry friction, N m (N): the jump of its torque where it turns, plus two standard
    deviations, beside smooth functions of its own motion (M,) and the rigid-body regressors, rigid (k, M).

    A bound, because a joint that hardly runs in one direction does not separate friction from an offset; too much
    costs a few rows, too little leaves an unknown torque in them.
    """
    if not len(q):
        return 0.0
    columns = np.vstack([np.sign(qd), qd, qdd, np.ones_like(q), np.sin(q), np.cos(q), rigid])
    size = np.maximum(np.linalg.norm(columns, axis=1), 1e-300)
    columns /= size[:, None]
    inverse = np.linalg.pinv(columns @ columns.T, rcond=1e-9, hermitian=True)
    found = inverse @ (columns @ tau)
    left = float(np.linalg.norm(tau - found @ columns)) / np.sqrt(len(q))
    most = (float(found[0]) + 2 * left * np.sqrt(max(float(inverse[0, 0]), 0.0))) / float(size[0])
    return max(most, 0.0)


@dataclass(frozen=True)
class UnknownTorque:
    """Projects rows (M,) onto the complement of what an unknown torque at some samples can put into them.

    The band's filter passes few combinations of these samples. They are eliminated from measured torque and regressors
    alike, so that white noise stays white and rows stay in the band.

    samples     (N,) at which the torque is unknown
    quiet       torque noise in the band over the largest unknown torque, 0 where that may be anything
    directions  (M, K) sparse, orthonormal within every run of samples
    left        (M,) part of each row that is left
    counts      (M,) rows of which enough is left
    Source: nuisance parameters in least squares, eliminated by projection: Frisch & Waugh 1933, Econometrica 1(4).
    """

    samples: Mask
    quiet: float
    directions: sparse.csr_array
    left: Array
    counts: Mask

    @classmethod
    def of(cls, low_pass: LowPass, unknown: Mask, quiet: float) -> UnknownTorque:
        """For a torque unknown at samples (N,); arguments as the fields."""
        left, directions = _eliminated(low_pass, unknown, max(UNKNOWN_OVER_NOISE * quiet, SAME_DIRECTION))
        # A row of which less is left holds mostly what friction at rest may be.
        return cls(unknown, quiet, directions, left, left > LITTLE)

    @classmethod
    def nowhere(cls, low_pass: LowPass, samples: int) -> UnknownTorque:
        """For a torque that is known at all of so many samples."""
        rows = len(low_pass.centres(samples))
        nothing = sparse.csr_array((rows, 0))
        return cls(np.zeros(samples, dtype=bool), 0.0, nothing, np.ones(rows), np.ones(rows, dtype=bool))

    @property
    def too_much(self) -> bool:
        """Whether less than half is left of the rows that do not lie inside a rest."""
        return bool(self.left.sum() < 0.5 * np.count_nonzero(self.left))

    def relaxed(self, low_pass: LowPass) -> UnknownTorque:
        """The same with at least half of the rows left: what the unknown torque puts in below the noise stays; where
        that does not suffice, it is `resolved`."""
        found = self.of(low_pass, self.samples, self.quiet / UNKNOWN_OVER_NOISE)
        return self.resolved(low_pass) if found.too_much else found

    def resolved(self, low_pass: LowPass) -> UnknownTorque:
        """The same with the torque known in rests shorter than a period of the cut-off, which the band does not
        resolve."""
        lasting = np.zeros(len(self.samples), dtype=bool)
        for run in _runs(self.samples):
            lasting[run] = run.stop - run.start > low_pass.rate / low_pass.cutoff
        return self.of(low_pass, lasting, self.quiet)

    def cut(self, window: slice, low_pass: LowPass) -> UnknownTorque:
        """Within a window of samples; rows that a run at its ends reaches do not count, as samples outside the window
        belong to the run."""
        found = self.of(low_pass, self.samples[window], self.quiet)
        counts, size = found.counts.copy(), window.stop - window.start
        for run in _runs(found.samples):
            if run.start < 2 * low_pass.half or run.stop > size - 2 * low_pass.half:
                counts[low_pass.rows(run, low_pass.half, len(counts))] = False
        return replace(found, counts=counts)

    @cached_property
    def _axes(self) -> tuple[sparse.csr_array, sparse.csr_array]:
        """(M, K) axes, whose product with their transpose is what is taken out, and (K, M) that transpose."""
        columns, found = sparse.csc_array(self.directions), list[tuple[slice, Array]]()
        first, last = (columns.indices[ends] for ends in (columns.indptr[:-1], columns.indptr[1:] - 1))
        apart = np.flatnonzero(first[1:] > np.maximum.accumulate(last)[:-1]) + 1
        # Combinations of runs that reach no common row are perpendicular.
        for low, high in pairwise([0, *apart, len(first)]):
            reached = slice(first[low], last[low:high].max() + 1)
            together = columns[:, low:high][reached].toarray()
            power, vectors = np.linalg.eigh(together.T @ together)
            found.append((reached, together @ vectors / np.sqrt(power + SAME_DIRECTION**2)))
        axes = _side_by_side(found, columns.shape[0])
        return axes, axes.T.tocsr()

    def __call__(self, x: Array) -> Array:
        """x (..., M) -> (..., M), each row the same to its last bit whatever stands beside it."""
        if not self.directions.shape[1]:
            return x
        (axes, across), rows = self._axes, x.reshape(-1, x.shape[-1])
        with np.errstate(invalid="ignore"):  # a column that overflows is left out by whoever asked for it
            return np.asarray(rows - (axes @ (across @ rows.T)).T).reshape(x.shape)


def _eliminated(low_pass: LowPass, unknown: Mask, least: float) -> tuple[Array, sparse.csr_array]:
    """(M,) part of each row that is left without what a torque of at most 1 at samples (N,) puts more than `least`
    into, exactly 0 deep inside a rest; and (M, K) those combinations of rows.

    Combinations of runs that reach the same rows count twice, hence what is left is bounded by 0.
    """
    rows, kernel = len(low_pass.centres(len(unknown))), 2 * low_pass.half
    left = np.ones(rows)
    alike: dict[tuple[int, int, int], Array] = {}
    found: list[tuple[slice, Array]] = []
    for run in _runs(unknown):
        if run.stop - run.start > 2 * kernel:
            # Deep inside no kernel reaches a known sample.
            ends = slice(run.start, run.start + kernel), slice(run.stop - kernel, run.stop)
            inside = low_pass.rows(slice(run.start + low_pass.half, run.stop - low_pass.half), 0, rows)
            left[inside] = 0.0
            parts = [(ends[0], slice(0, inside.start)), (ends[1], slice(inside.stop, rows))]
        else:
            parts = [(run, slice(0, rows))]
        for samples, among in parts:
            reached = low_pass.rows(samples, low_pass.half, rows)
            reached = slice(max(reached.start, among.start), min(reached.stop, among.stop))
            # A row's weight of a sample depends on their distance alone.
            apart = samples.start - low_pass.factor * reached.start
            key = (apart, samples.stop - samples.start, reached.stop - reached.start)
            if key not in alike:
                alike[key] = _basis(low_pass.response(samples, reached), least)
            left[reached] -= (alike[key] ** 2).sum(axis=1)
            found.append((reached, alike[key]))
    return np.maximum(left, 0.0), _side_by_side(found, rows)


def _runs(there: Mask) -> Iterator[slice]:
    """Runs of samples (N,) that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]])))
    return (slice(int(start), int(stop)) for start, stop in edges.reshape(-1, 2))


def _side_by_side(bases: list[tuple[slice, Array]], rows: int) -> sparse.csr_array:
    """(rows, K) columns of bases (m, k), each in its own rows."""
    columns = [(reached, column) for reached, basis in bases for column in basis.T]
    values = np.concatenate([np.zeros(0), *(column for _, column in columns)])
    places = np.concatenate([np.zeros(0, int), *(np.arange(reached.start, reached.stop) for reached, _ in columns)])
    ends = np.cumsum([0, *(len(column) for _, column in columns)])
    return sparse.csc_array((values, places, ends), shape=(rows, len(columns))).tocsr()


def _basis(response: Array, least: float) -> Array:
    """(m, k) orthonormal combinations of rows into which a torque of at most 1 at samples (n) puts more than `least`;
    response (m, n)."""
    power, vectors = np.linalg.eigh(response @ response.T)
    largest = np.sqrt(np.maximum(power, 0.0) * response.shape[1])
    return np.asarray(vectors[:, largest > least])
