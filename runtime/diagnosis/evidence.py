"""Statistics of nested linear models on autocorrelated rows: cross-validation, whitening, BIC, Vuong.

A `Ground` holds the torques of all joints and the base model's regressors, with unknowns that joints share
(the base inertial parameters) standing once; a candidate adds a block of columns on the joints on which it
acts. Regressors are computed from measured positions and so carry noise. Every Gram matrix is compensated
for it (bias-compensated least squares, Stoica & Söderström 1982): the Gram matrix of a realisation of that
noise is subtracted. Without this, any candidate that can switch the inertia off where the motion is slow
"explains" the encoder's noise. The noise that the base model lets through is then added to every error
as a constant, so that errors stay those of real residuals and their ratios are not exaggerated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from runtime.regression.alike import Alike, Sides
from runtime.regression.folds import Grams, NormalEquations
from runtime.regression.least_squares import inverse, solve
from runtime.regression.robust import lag_by_lag
from runtime.regression.settings import FOLDS, LARGEST_COLUMN, LEAN, LEAST_OWN
from runtime.regression.whitening import Whitening, autoregression

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class CandidateRows:
    """A candidate's rows at one joint: its torque without free coefficients and its columns, (1 + k, M); of many
    choices of its shape (S, 1 + k, M).

    noise: what encoder noise adds to them; None as long as it is not asked for.
    """

    columns: Array
    noise: Array | None = None


@dataclass(frozen=True)
class CandidateBlock:
    """A candidate at one choice of its shape: its parts by joint (0-based) and bounds (k,) of its coefficients."""

    parts: Mapping[int, CandidateRows]
    lower: Array
    upper: Array

    @cached_property
    def finite(self) -> bool:
        """Whether its columns and their noise are numbers with a square: what is simulated can overflow, for one shape
        on one stretch of motion."""
        return bool(np.all(self.finite_each))

    @property
    def finite_each(self) -> Mask:
        """The same of each of many choices of its shape, (S,)."""
        rows = [x for part in self.parts.values() for x in (part.columns, part.noise) if x is not None]
        # The largest and the least of them tell as much as all magnitudes do, and NaN is among them.
        ends = [(np.max(x, axis=(-2, -1)), np.min(x, axis=(-2, -1))) for x in rows]
        there = [(high < LARGEST_COLUMN) & (low > -LARGEST_COLUMN) for high, low in ends]
        found: Mask = np.all(there, axis=0)
        return found

    def whitened(self, by: Sequence[Whitening]) -> CandidateBlock:
        """The same block, every joint's rows whitened."""
        parts = {
            j: CandidateRows(by[j](p.columns), None if p.noise is None else by[j](p.noise))
            for j, p in self.parts.items()
        }
        return replace(self, parts=parts)

    def at(self, choice: int) -> CandidateBlock:
        """At one of many choices of its shape, (1 + k, M)."""
        parts = {
            joint: CandidateRows(part.columns[choice], None if part.noise is None else part.noise[choice])
            for joint, part in self.parts.items()
        }
        return replace(self, parts=parts)

    def only(self, choices: Mask) -> CandidateBlock:
        """Some of many choices (S,)."""
        parts = {
            joint: CandidateRows(part.columns[choices], None if part.noise is None else part.noise[choices])
            for joint, part in self.parts.items()
        }
        return replace(self, parts=parts)


@dataclass(frozen=True)
class Solution:
    """Least squares of base and candidate.

    sse           over the used rows, weighted
    coefficients  (B + k,), the base's first
    residual      per joint (M,), unweighted, zero in rows that do not count
    """

    sse: float
    coefficients: Array
    residual: tuple[Array, ...]


@dataclass(frozen=True)
class Rows:
    """One joint's equations.

    y (M,), base (b, M), noise (b + 1, M) of base and y; index (b,): which unknowns of the ground the base's
    columns belong to; use (M,): rows that count, at least some; piece (M,): the stretch of time of a row;
    weight: 1/σ of the joint; directions (M, K): combinations of rows that were eliminated; clear (M,): rows that none
    of them reaches; None: all that count; dependent: number of rows that follow from others.
    """

    y: Array
    base: Array
    noise: Array
    index: NDArray[np.intp]
    use: Mask
    piece: NDArray[np.intp]
    weight: float
    directions: sparse.csr_array | None = None
    clear: Mask | None = None
    dependent: int = 0

    @cached_property
    def count(self) -> int:
        """Number of rows that count."""
        return int(self.use.sum())

    @property
    def independent(self) -> int:
        return max(1, self.count - self.dependent)

    @cached_property
    def folds(self) -> list[slice]:
        """FOLDS contiguous stretches of time with equally many used rows, in places of the used rows."""
        edges = np.linspace(0, self.count, FOLDS + 1).astype(int)
        return [slice(int(lo), int(hi)) for lo, hi in pairwise(edges)]

    @cached_property
    def _places(self) -> tuple[NDArray[np.intp], Array]:
        """(FOLDS, L) rows of each fold, filled up to one length, and their weights, zero for what fills up."""
        used, length = np.flatnonzero(self.use), max(part.stop - part.start for part in self.folds)
        places, weights = np.zeros((FOLDS, length), dtype=np.intp), np.zeros((FOLDS, length))
        for f, part in enumerate(self.folds):
            places[f, : part.stop - part.start] = used[part]
            weights[f, : part.stop - part.start] = self.weight
        return places, weights

    def folded(self, x: Array) -> Array:
        """(FOLDS, R, L) weighted used rows of x (R, M), fold by fold, zeros at their ends."""
        places, weights = self._places
        return x[:, places].swapaxes(0, 1) * weights[:, None]

    @cached_property
    def _folded_stack(self) -> tuple[Array, Array]:
        """(FOLDS, L, b + 1) of base and torque, and of their noise."""
        stack = self.folded(np.vstack([self.base, self.y]))
        return stack.swapaxes(1, 2).copy(), self.folded(self.noise).swapaxes(1, 2).copy()

    def fold_moments(self, part: CandidateRows) -> tuple[Array, Array]:
        """Of a candidate's rows with base and torque (FOLDS, 1 + k, b + 1), and with themselves, compensated."""
        stack, stack_noise = self._folded_stack
        x = self.folded(part.columns)
        cross, square = x @ stack, x @ x.swapaxes(1, 2)
        if part.noise is not None:
            noise = self.folded(part.noise)
            cross -= noise @ stack_noise
            square -= noise @ noise.swapaxes(1, 2)
        return cross, square

    def used(self, x: Array) -> Array:
        """Weighted used rows of x (..., M)."""
        return np.ascontiguousarray(x[..., self.use]) * self.weight

    @cached_property
    def stack(self) -> Array:
        """Base and torque, (b + 1, count), weighted."""
        return self.used(np.vstack([self.base, self.y]))

    @cached_property
    def stack_noise(self) -> Array:
        """What of `stack` is noise, (b + 1, count)."""
        return self.used(self.noise)

    def whitening(self, residual: Array) -> Whitening:
        """By the autoregression of a residual (M,), as it is where nothing was eliminated."""
        ar = autoregression(residual, self.use if self.clear is None else self.clear, self.piece)
        return Whitening.of(ar, self.use, self.piece, self.directions)

    def whitened(self, by: Whitening, residual: Array) -> Rows:
        """The same equations with white noise of variance 1, where that is what a residual (M,) leaves; all rows count,
        and as many are independent as before."""
        use = np.ones_like(self.use)
        dependent = len(use) - self.independent
        left = float(np.linalg.norm(by(residual))) / np.sqrt(self.independent)
        return replace(
            self,
            y=by(self.y),
            base=by(self.base),
            noise=by(self.noise),
            use=use,
            weight=1 / left if left else self.weight,
            directions=None,
            dependent=dependent,
        )


@dataclass(frozen=True)
class Ground:
    """The base model's equations at all joints; lower and upper (B,) bound its unknowns.

    level (FOLDS,): squared error that the regressors' noise makes under the base model, a constant of all candidates;
    changes: unknowns that are changes of what was fitted, so that zero says nothing is new.
    """

    rows: tuple[Rows, ...]
    lower: Array
    upper: Array
    level: Array = field(default_factory=lambda: np.zeros(FOLDS))
    changes: tuple[int, ...] = ()

    @classmethod
    def levelled(cls, rows: tuple[Rows, ...], lower: Array, upper: Array, changes: tuple[int, ...] = ()) -> Ground:
        """A ground with the noise level that follows from its own base model."""
        plain = cls(rows, lower, upper, changes=changes)
        theta = plain.solve().coefficients
        level = np.zeros(FOLDS)
        for row in rows:
            through = np.append(theta[row.index], -1.0) @ row.stack_noise
            level += [float(through[part] @ through[part]) for part in row.folds]
        return replace(plain, level=level)

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.lower)

    @cached_property
    def fold_sizes(self) -> Array:
        """(FOLDS,) rows, less what was eliminated, as if that were spread evenly."""
        parts = [r.independent / max(1, r.count) for r in self.rows]
        return np.array(
            [
                sum(p * (r.folds[f].stop - r.folds[f].start) for p, r in zip(parts, self.rows, strict=True))
                for f in range(FOLDS)
            ]
        )

    @cached_property
    def _base_grams(self) -> Array:
        """(FOLDS, B + 1, B + 1) of base and torque, compensated."""
        out = np.zeros((FOLDS, self.size + 1, self.size + 1))
        for row in self.rows:
            at = np.ix_(np.append(row.index, self.size), np.append(row.index, self.size))
            for f, part in enumerate(row.folds):
                s, n = row.stack[:, part], row.stack_noise[:, part]
                out[f][at] += s @ s.T - n @ n.T
        return out

    def moments(self, block: CandidateBlock) -> Array:
        """(FOLDS, B + k + 2, B + k + 2) of base, the block's fixed part, its columns and the torque."""
        b, k = self.size, len(block.lower)
        own, order = slice(b, b + k + 1), [*range(b), b + k + 1]
        out = np.zeros((FOLDS, b + k + 2, b + k + 2))
        out[:, np.array(order)[:, None], order] = self._base_grams
        for joint, part in block.parts.items():
            row = self.rows[joint]
            cross, square = row.fold_moments(part)
            rows = np.arange(b, b + k + 1)[:, None]
            out[:, rows, np.append(row.index, b + k + 1)] += cross
            out[:, own, own] += square
        out[:, :b, own] = np.swapaxes(out[:, own, :b], 1, 2)
        out[:, -1, own] = out[:, own, -1]
        return out

    def grams(self, moments: Array, block: CandidateBlock) -> Grams:
        """Of the base with a block, out of its moments."""
        b, k = self.size, len(block.lower)
        kept = [*range(b), *range(b + 1, b + k + 1)]
        lower, upper = np.append(self.lower, block.lower), np.append(self.upper, block.upper)
        lean = np.append(self._base.lean, self._lean(moments))
        folds, ends = moments[:, kept][:, :, kept], self._ends.setdefault(b + k, [])
        return Grams(folds, lower, upper, lean=lean, ends=ends, core=self._base)

    def _lean(self, moments: Array) -> Array:
        """(k,) what speaks for zero of a block's coefficients where a fold is left out: what all rows but a few tell of
        an effect may stand in that fold alone, and what those few say of it is noise. Of a torque that has a part
        without coefficient, zero is no neutral value."""
        whole, b = moments.sum(axis=0), self.size
        if whole[b, b] != 0:
            return np.zeros(len(whole) - b - 2)
        projection, _ = self._projection
        cross = whole[b + 1 : -1, :b]
        own = np.diagonal(whole)[b + 1 : -1] - np.einsum("kb,bc,kc->k", cross, projection, cross)
        return LEAN * np.maximum(own, 0.0)

    def posed(
        self, moments: Array, block: CandidateBlock | None, added: Array | None = None, grams: Grams | None = None
    ) -> NormalEquations:
        """Equations of the base with a block (None: without it) out of the moments of a block.

        added   (1 + k,) parts of the block's torque and columns that are put into the measured torque first
        grams   of base and block, where they are there already
        """
        b, k = self.size, moments.shape[1] - self.size - 2
        torque = np.zeros(b + k + 2)
        torque[-1] = 1.0
        if added is not None:
            torque[b:-1] += added
        kept = [*range(b)]
        if block is None:
            grams = self._base
        else:
            torque[b] -= 1.0
            kept, grams = [*kept, *range(b + 1, b + k + 1)], grams or self.grams(moments, block)
        against = moments @ torque
        return NormalEquations(grams, against[:, kept], against @ torque, level=self.level, sizes=self.fold_sizes)

    def equations(self, block: CandidateBlock | None = None) -> NormalEquations:
        """Of the base with a block, or without one."""
        if block is None:
            return self._base_equations
        return self.posed(self.moments(block), block)

    @cached_property
    def _base(self) -> Grams:
        # As of a block's coefficients: of the moment at which a load is taken up, one fold tells, and without it a
        # change of that moment would be whatever the others' noise makes it, by far the largest error of that fold.
        lean = np.zeros(self.size)
        free = np.flatnonzero(self.lower < self.upper)
        gram = self._base_grams.sum(axis=0)[np.ix_(free, free)]
        for k in set(self.changes) & set(free):
            spread = solve(gram, (free == k).astype(float))[free == k][0]
            lean[k] = LEAN / spread if spread > 0 else 0.0
        return Grams(
            self._base_grams[:, :-1, :-1], self.lower, self.upper, lean=lean, ends=self._ends.setdefault(self.size, [])
        )

    @cached_property
    def _base_equations(self) -> NormalEquations:
        moments, squares = self._base_grams[:, :-1, -1], self._base_grams[:, -1, -1]
        return NormalEquations(self._base, moments, squares, level=self.level, sizes=self.fold_sizes)

    @cached_property
    def _ends(self) -> dict[int, list[Sides]]:
        """By number of unknowns, on which bounds they ended."""
        return {}

    def solve(self, block: CandidateBlock | None = None) -> Solution:
        """Least squares on the used rows, every coefficient within its bounds."""
        found = self.equations(block)
        return Solution(found.sse, found.coefficients, self.residual(found.coefficients, block))

    def residual(self, theta: Array, block: CandidateBlock | None) -> tuple[Array, ...]:
        """Per joint (M,), unweighted, zero in rows that do not count."""
        found = []
        for joint, row in enumerate(self.rows):
            r = row.y - theta[row.index] @ row.base
            if block is not None and joint in block.parts:
                r = r - np.append(1.0, theta[self.size :]) @ block.parts[joint].columns
            found.append(np.where(row.use, r, 0.0))
        return tuple(found)

    def whitened(self, by: Sequence[Whitening], residual: Sequence[Array]) -> Ground:
        """The same ground, every joint's rows whitened and weighed by what they leave of its residual (M,): a joint
        whose error is slow would otherwise count for little among others."""
        rows = tuple(r.whitened(white, left) for r, white, left in zip(self.rows, by, residual, strict=True))
        return Ground.levelled(rows, self.lower, self.upper, self.changes)

    def without(self, unknowns: Sequence[int]) -> Ground:
        """The same ground with these unknowns of the base at zero; its noise level stays."""
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[list(unknowns)] = upper[list(unknowns)] = 0.0
        return replace(self, lower=lower, upper=upper)

    @cached_property
    def _projection(self) -> tuple[Array, tuple[tuple[Array, Array], ...]]:
        """Pseudo-inverse (B, B) of the base's Gram matrix over unknowns that are free, and per joint the base's
        residual and what noise adds to it."""
        gram = self._base_grams.sum(axis=0)[:-1, :-1]
        theta = self.solve().coefficients
        free = np.flatnonzero((theta > self.lower) & (theta < self.upper))
        projection = np.zeros_like(gram)
        projection[np.ix_(free, free)] = inverse(gram[np.ix_(free, free)])
        left = (np.append(-theta[r.index], 1.0) for r in self.rows)
        return projection, tuple((d @ r.stack, d @ r.stack_noise) for d, r in zip(left, self.rows, strict=True))

    def beside(self, joint: int) -> tuple[Array, Array, Array]:
        """A joint's (0-based) weighted used rows: what the base leaves (count,), its columns (b, count), and the
        inverse of the whole Gram matrix at their unknowns (b, b)."""
        projection, left = self._projection
        row = self.rows[joint]
        return left[joint][0], row.stack[:-1], projection[np.ix_(row.index, row.index)]

    def gain(self, block: CandidateBlock) -> float:
        """By how much the block lowers the squared error, quickly: for searches. Its noise counts where it is given."""
        parts = {
            joint: CandidateRows(part.columns[None], None if part.noise is None else part.noise[None])
            for joint, part in block.parts.items()
        }
        return float(self.gains(replace(block, parts=parts))[0])

    def gains(self, blocks: CandidateBlock) -> Array:
        """(S,) `gain` of a candidate at many choices of its shape, whose parts are (S, 1 + k, M)."""
        projection, left = self._projection
        k = len(blocks.lower)
        count = len(next(iter(blocks.parts.values())).columns)
        moment, square = np.zeros((count, k + 1)), np.zeros((count, k + 1, k + 1))
        cross = np.zeros((count, k + 1, self.size))
        for joint, part in blocks.parts.items():
            row = self.rows[joint]
            x = row.used(part.columns)
            moment += x @ left[joint][0]
            square += x @ x.swapaxes(1, 2)
            cross[:, :, row.index] += x @ row.stack[:-1].T
            if part.noise is not None:
                noise = row.used(part.noise)
                moment -= noise @ left[joint][1]
                square -= noise @ noise.swapaxes(1, 2)
                cross[:, :, row.index] -= noise @ row.stack_noise[:-1].T
        own = square - cross @ projection @ cross.swapaxes(1, 2)
        seen = np.diagonal(own, axis1=1, axis2=2) > LEAST_OWN * np.diagonal(square, axis1=1, axis2=2)
        moment = np.where(seen, moment, 0.0)
        # What is not seen gets a square of its own and no moment: then it stays at zero, and the others as they are.
        own = np.where(seen[:, :, None] & seen[:, None, :], own, np.eye(k + 1))
        fall = np.where(seen[:, 0], 2 * moment[:, 0] - own[:, 0, 0], 0.0)
        if k:
            target, inner = moment[:, 1:] - own[:, 1:, 0], own[:, 1:, 1:]
            theta = Alike(inner, blocks.lower, blocks.upper).solve(target)
            theta = np.where(seen[:, 1:], theta, 0.0)
            fall += np.einsum("sk,sk->s", theta, 2 * target - np.einsum("skl,sl->sk", inner, theta))
        return fall

    def beyond(self, torques: Mapping[int, Array]) -> Array:
        """(count,) weighted rows of all joints: what the base cannot take over of torques (M,) by joint."""
        projection, _ = self._projection
        used = {joint: self.rows[joint].used(torque) for joint, torque in torques.items()}
        cross = np.zeros(self.size)
        for joint, x in used.items():
            cross[self.rows[joint].index] += self.rows[joint].stack[:-1] @ x
        taken = projection @ cross
        return np.concatenate(
            [used.get(joint, 0.0) - taken[row.index] @ row.stack[:-1] for joint, row in enumerate(self.rows)]
        )

    def own(self, torques: Mapping[int, Array]) -> tuple[Array, Array]:
        """Weighted squares (...) of what the base cannot take over of torques (..., M) by joint, and of them whole."""
        projection, _ = self._projection
        ahead = next(iter(torques.values())).shape[:-1] if torques else ()
        square, cross = np.zeros(ahead), np.zeros((*ahead, self.size))
        for joint, torque in torques.items():
            row = self.rows[joint]
            x = row.used(torque)
            square += np.einsum("...m,...m->...", x, x)
            cross[..., row.index] += x @ row.stack[:-1].T
        return np.maximum(square - ((cross @ projection) * cross).sum(axis=-1), 0.0), square

    def held(self, moments: Array, theta: Array) -> tuple[float, float]:
        """How much of a torque the measurement holds beside the base, and its standard deviation if rows are white.

        moments of a block; theta (1 + k,) parts of its fixed part and columns in that torque
        """
        whole, b = moments.sum(axis=0), self.size
        projection, _ = self._projection
        left = whole[b:-1] - whole[b:-1, :b] @ projection @ whole[:b]
        kept, cross = float(theta @ left[:, b:-1] @ theta), float(theta @ left[:, -1])
        if kept <= 0:
            return 0.0, float("inf")
        equations = self.equations()
        return cross / kept, float(np.sqrt(max(equations.sse, 0.0) / equations.count / kept))


def vuong(better: Array, worse: Array) -> float:
    """Vuong's statistic of two residuals (N,) with a variance robust to autocorrelation.

    Source: Vuong 1989.
    """
    variance = float(better @ better) / len(better)
    gain = (worse**2 - better**2) / (2 * variance)
    return float(gain.sum() / np.sqrt(max(lag_by_lag(gain), 1e-300)))
