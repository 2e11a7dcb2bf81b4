"""Statistics of nested linear models on autocorrelated rows: cross-validation, whitening, BIC, Vuong.

A `Rows` object holds one joint's torque and base regressors; a candidate adds a block of columns.
Regressors are computed from measured positions and so carry noise. Every Gram matrix is compensated for
it (bias-compensated least squares, Stoica & Söderström 1982): the Gram matrix of a realisation of that
noise is subtracted. Without this, any candidate that can switch the inertia off where the motion is slow
"explains" the encoder's noise. The noise that the base model lets through is then added to every error
as a constant, so that errors stay those of real residuals and their ratios are not exaggerated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from runtime.constrained import bounded, solve

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FOLDS = 10
_MOST_LAGS = 12


@dataclass(frozen=True)
class Block:
    """A candidate's columns at one choice of its shape.

    fixed (M,): torque without a free coefficient; columns (k, M); bounds of their coefficients.
    noise (1 + k, M): what encoder noise adds to fixed and columns; zeros as long as it is not asked for.
    """

    columns: Array
    fixed: Array
    lower: Array
    upper: Array
    noise: Array


@dataclass(frozen=True)
class Solution:
    """Least squares of base and candidate: sse over the used rows, coefficients (base first), residual (M,)."""

    sse: float
    coefficients: Array
    residual: Array


@dataclass(frozen=True)
class Rows:
    """y (M,), base (b, M) with bounds (b,) of its coefficients, noise (b + 1, M) of base and y, use (M,) rows
    that count, piece (M,) the stretch of time and fold (M,) the part of a cross-validation of a row; level
    (FOLDS,): squared error that the regressors' noise makes under the base model, a constant of all candidates."""

    y: Array
    base: Array
    noise: Array
    lower: Array
    upper: Array
    use: Mask
    piece: NDArray[np.intp]
    fold: NDArray[np.intp]
    level: Array

    @classmethod
    def levelled(
        cls,
        y: Array,
        base: Array,
        noise: Array,
        bounds: tuple[Array, Array],
        use: Mask,
        piece: NDArray[np.intp],
        fold: NDArray[np.intp],
    ) -> Rows:
        """Rows with the noise level that follows from their own base model."""
        rows = cls(y, base, noise, *bounds, use, piece, fold, np.zeros(FOLDS))
        direction = np.append(rows.solve().coefficients, -1.0)
        through = np.where(use, direction @ noise, 0.0) ** 2
        return replace(rows, level=np.bincount(fold, weights=through, minlength=FOLDS).astype(float))

    @cached_property
    def count(self) -> int:
        return int(self.use.sum())

    @cached_property
    def fold_sizes(self) -> Array:
        return np.bincount(self.fold[self.use], minlength=FOLDS).astype(float)

    def rank(self, block: Block | None = None) -> int:
        """Number of separate linear directions that base and block span on the used rows."""
        x = self.base if block is None else np.vstack([self.base, block.columns])
        unit = _unit(x[:, self.use])
        return int(np.linalg.matrix_rank(unit @ unit.T, tol=1e-9, hermitian=True)) if len(x) else 0

    def orthogonal(self, columns: Array) -> Array:
        """(k, M) what of each column the base cannot take over, zero in unused rows."""
        x, b = np.where(self.use, columns, 0.0), np.where(self.use, self.base, 0.0)
        return x - np.array([solve(b @ b.T, b @ row) for row in x]).reshape(len(x), len(b)) @ b

    def _stacked(self, block: Block | None) -> tuple[Array, Array]:
        """Base, block and torque (b + k + 1, M), and their noise."""
        if block is None:
            return np.vstack([self.base, self.y]), self.noise
        x = np.vstack([self.base, block.columns, self.y - block.fixed])
        return x, np.vstack([self.noise[:-1], block.noise[1:], self.noise[-1] - block.noise[0]])

    def solve(self, block: Block | None = None) -> Solution:
        """Least squares on the used rows, every coefficient within its bounds."""
        x, noise = self._stacked(block)
        used, noise_used = x[:, self.use], noise[:, self.use]
        gram = used @ used.T - noise_used @ noise_used.T
        direction = np.append(bounded(gram[:-1, :-1], gram[:-1, -1], *self._bounds(block)), -1.0)
        residual = np.zeros(len(self.use))
        residual[self.use] = -direction @ used
        return Solution(float(direction @ gram @ direction) + float(self.level.sum()), direction[:-1], residual)

    def sse(self, block: Block) -> float:
        """As `solve(block).sse`, quickly and with the block's noise left out: for grids."""
        own, fixed = block.columns[:, self.use], block.fixed[self.use]
        cross = own @ self._used.T
        cross[:, -1] -= own @ fixed
        corner = self._used @ fixed
        gram = self._gram.copy()
        gram[:-1, -1] -= corner[:-1]
        gram[-1, :-1] -= corner[:-1]
        gram[-1, -1] += fixed @ fixed - 2 * corner[-1]
        b = len(self.base)
        whole = np.zeros((b + len(own) + 1,) * 2)
        order = [*range(b), b + len(own)]
        whole[np.ix_(order, order)] = gram
        inner = slice(b, b + len(own))
        whole[inner, inner] = own @ own.T
        whole[inner, order] = cross
        whole[order, inner] = cross.T
        direction = np.append(bounded(whole[:-1, :-1], whole[:-1, -1], *self._bounds(block)), -1.0)
        return float(direction @ whole @ direction) + float(self.level.sum())

    @cached_property
    def _used(self) -> Array:
        return np.ascontiguousarray(np.vstack([self.base, self.y])[:, self.use])

    @cached_property
    def _gram(self) -> Array:
        noise = self.noise[:, self.use]
        return self._used @ self._used.T - noise @ noise.T

    def _bounds(self, block: Block | None) -> tuple[Array, Array]:
        if block is None:
            return self.lower, self.upper
        return np.append(self.lower, block.lower), np.append(self.upper, block.upper)

    def cross_validate(self, blocks: Sequence[Block | None]) -> tuple[Array, Array]:
        """Held-out and training SSE (FOLDS,) where every fold takes the block that trains best without it."""
        grams = [self._fold_grams(block) for block in blocks]
        held, trained = np.zeros(FOLDS), np.zeros(FOLDS)
        for fold in range(FOLDS):
            best = np.inf
            for block, gram in zip(blocks, grams, strict=True):
                rest = gram.sum(axis=0) - gram[fold]
                theta = bounded(rest[:-1, :-1], rest[:-1, -1], *self._bounds(block))
                direction = np.append(theta, -1.0)
                sse = float(direction @ rest @ direction)
                if sse < best:
                    best, held[fold] = sse, float(direction @ gram[fold] @ direction)
            trained[fold] = best
        return held + self.level, trained + self.level.sum() - self.level

    def _fold_grams(self, block: Block | None) -> Array:
        """(FOLDS, b + k + 1, b + k + 1), the torque last."""
        x, noise = (part[:, self._by_fold] for part in self._stacked(block))
        edges = np.concatenate([[0], np.cumsum(self.fold_sizes).astype(int)])
        return np.array(
            [x[:, lo:hi] @ x[:, lo:hi].T - noise[:, lo:hi] @ noise[:, lo:hi].T for lo, hi in pairwise(edges)]
        )

    @cached_property
    def _by_fold(self) -> NDArray[np.intp]:
        used = np.flatnonzero(self.use)
        return used[np.argsort(self.fold[used], kind="stable")]

    def whitened(self, ar: Array) -> Rows:
        """The same rows through the autoregressive filter `ar` (1, a1, ...), piece by piece."""
        y, base, noise = self.whiten(self.y[None], ar)[0], self.whiten(self.base, ar), self.whiten(self.noise, ar)
        return Rows.levelled(y, base, noise, (self.lower, self.upper), self.use, self.piece, self.fold)

    def whiten(self, x: Array, ar: Array) -> Array:
        """x (k, M) through the filter; rows that do not count enter as zero on both sides of the equation."""
        x = np.where(self.use, x, 0.0)
        edges = np.flatnonzero(np.diff(self.piece)) + 1
        parts = [_filtered(part, ar) for part in np.split(x, edges, axis=1)]
        return np.where(self.use, np.concatenate(parts, axis=1), 0.0)

    def whiten_block(self, block: Block, ar: Array) -> Block:
        fixed = self.whiten(block.fixed[None], ar)[0]
        noise = self.whiten(block.noise, ar)
        return Block(self.whiten(block.columns, ar), fixed, block.lower, block.upper, noise)

    def autoregression(self, residual: Array) -> Array:
        """(1, a1, ..., ap) of a residual (M,), order by BIC; Yule-Walker over pairs of rows that both count."""
        covariance = np.zeros(_MOST_LAGS + 1)
        r = np.where(self.use, residual, 0.0)
        for lag in range(_MOST_LAGS + 1):
            pair = self.use[lag:] & self.use[: len(self.use) - lag] & (self.piece[lag:] == self.piece[: len(r) - lag])
            covariance[lag] = (r[lag:] * r[: len(r) - lag])[pair].sum() / max(1, int(pair.sum()))
        return _levinson(covariance, self.count)


def _filtered(x: Array, ar: Array) -> Array:
    out = ar[0] * x
    for lag in range(1, len(ar)):
        out[:, lag:] += ar[lag] * x[:, :-lag]
    return out


def _unit(x: Array) -> Array:
    norm = np.linalg.norm(x, axis=1, keepdims=True)
    return x / np.where(norm > 0, norm, 1.0)


def _levinson(covariance: Array, count: int) -> Array:
    ar, error = np.array([1.0]), covariance[0]
    best, best_score = ar, count * np.log(max(error, 1e-300))
    for order in range(1, len(covariance)):
        reflection = -(ar @ covariance[order:0:-1]) / error
        ar = np.append(ar, 0.0) + reflection * np.append(ar, 0.0)[::-1]
        error *= 1 - reflection**2
        if error <= 0:
            break
        score = count * np.log(error) + order * np.log(count)
        if score < best_score:
            best, best_score = ar, score
    return best


def time_folds(use: Mask) -> NDArray[np.intp]:
    """(M,) FOLDS contiguous stretches with equally many used rows."""
    order = np.cumsum(use) - 1
    return np.clip(order * FOLDS // max(1, int(use.sum())), 0, FOLDS - 1)


def bic(sse: float, count: int, parameters: int) -> float:
    return count * float(np.log(max(sse, 1e-300) / count)) + parameters * float(np.log(count))


def log_likelihood(held: Array, trained: Array, sizes: Array) -> float:
    """Held-out Gaussian log-likelihood, each fold with the variance of its training rows.

    Minus infinity where compensation leaves no variance: such a model explains noise.
    """
    if np.any(trained <= 0):
        return float("-inf")
    variance = trained / (sizes.sum() - sizes)
    return float(np.sum(-0.5 * sizes * np.log(2 * np.pi * variance) - held / (2 * variance)))


def vuong(better: Array, worse: Array, use: Mask) -> float:
    """Vuong's statistic of two residuals (M,) with a variance robust to autocorrelation.

    Source: Vuong 1989; Newey & West 1987 for the variance.
    """
    a, b = better[use], worse[use]
    variance = float(a @ a) / len(a)
    gain = (b**2 - a**2) / (2 * variance)
    centred = gain - gain.mean()
    lags = int(4 * (len(a) / 100) ** (2 / 9)) + 1
    spread = float(centred @ centred)
    for lag in range(1, lags + 1):
        spread += 2 * (1 - lag / (lags + 1)) * float(centred[lag:] @ centred[:-lag])
    return float(gain.sum() / np.sqrt(max(spread, 1e-300)))
