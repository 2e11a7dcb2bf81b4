"""A primal-dual interior-point method for programs of few unknowns and many constraints along a motion.

Slacks and multipliers of inequalities are eliminated, so that one dense symmetric system of the size of the unknowns
and the equalities is solved a step, whatever the number of rows. Barrier, filter and the correction of inertia are
those of Wächter & Biegler, "On the implementation of an interior-point filter line-search algorithm", Math. Program.
106 (2006); there is no restoration phase: a search that gets stuck says so, and another solver may go on.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from runtime.planning.kernels import BlockSlopes, Kernels

Array = NDArray[np.float64]

SOLVED, STUCK, LIMIT = "Solve_Succeeded", "Search_Direction_Stuck", "Maximum_Iterations_Exceeded"

_LEAST_STEP = 1e-7
_BARRIER_TOLERANCE, _BARRIER_FACTOR, _BARRIER_POWER = 10.0, 0.2, 1.5
_FRACTION = 0.99
"""Of the way to the nearest bound, at least, that a step may go."""
_FILTER_FEASIBLE, _FILTER_COST = 1e-5, 1e-8
_ARMIJO = 1e-4
_FALL, _MISS = 2.3, 1.1
"""Powers of the cost's descent and of the miss by which a step is held to the descent, not to the filter."""
_FEASIBLE = 1e-8
"""Of the largest miss that is ever accepted: below it only descent counts."""
_FIRST_SHIFT, _LARGEST_SHIFT = 1e-4, 1e20
_EQUALITY_SHIFT = 1e-10
"""Equalities that say the same thing twice do not make the system singular."""
_SIGMA = 1e10
"""How far multipliers of bounds may be from those that the barrier asks for, as a factor."""
_STEEPEST = 100.0
"""The cost is scaled so that its gradient begins no steeper."""
_MULTIPLIERS = 100.0
"""Mean multiplier above which the conditions of optimality are relative to it."""
_LARGEST_START = 1e3
"""Multipliers of equalities begin at zero where least squares make them larger."""


@dataclass(frozen=True)
class Manner:
    """accuracy of the conditions of optimality; barrier μ at first; push: least distance from bounds at first;
    multiplier: of bounds at first, None: what the barrier asks for there, as where x solved nearly the same program."""

    accuracy: float
    iterations: int
    barrier: float = 0.1
    push: float = 1e-2
    multiplier: float | None = 1.0


@dataclass(frozen=True)
class Minimum:
    """x (nx,) where it ended, its cost and rows (m,)."""

    x: Array
    cost: float
    rows: Array
    status: str
    iterations: int


@dataclass(frozen=True)
class Bounded:
    """A program in numbers: lower <= rows <= upper, low <= x <= high; equal bounds make equalities, or fix unknowns."""

    kernels: Kernels
    p: Array
    lower: Array
    upper: Array
    low: Array
    high: Array

    @cached_property
    def equal(self) -> NDArray[np.bool_]:
        """(m,)"""
        return np.asarray(self.lower == self.upper)

    @cached_property
    def boxed(self) -> NDArray[np.int64]:
        """Unknowns with a bound that are not fixed: they count as rows, too."""
        finite = np.isfinite(self.low) | np.isfinite(self.high)
        return np.flatnonzero(finite & (self.low < self.high))

    @cached_property
    def free(self) -> NDArray[np.int64]:
        return np.flatnonzero(self.low < self.high)

    @cached_property
    def span(self) -> tuple[Array, Array]:
        """Bounds of the inequalities, rows first, then unknowns."""
        parts = ((self.lower, self.low), (self.upper, self.high))
        low, high = (np.concatenate([rows[~self.equal], x[self.boxed]]) for rows, x in parts)
        return low, high

    def inequalities(self, rows: Array, x: Array) -> Array:
        return np.concatenate([rows[~self.equal], x[self.boxed]])


@dataclass(frozen=True)
class _Iterate:
    """x with its (scaled) cost and rows; slacks s (k,) of the inequalities; multipliers y of the equalities, and zl, zu
    of the slacks' bounds; miss: sums of what equalities and slacks are off."""

    x: Array
    cost: float
    rows: Array
    s: Array
    y: Array
    zl: Array
    zu: Array


@dataclass(frozen=True)
class _Slopes:
    """First derivatives at an iterate: of the scaled cost, of each block by z, and of the equalities, dense."""

    gradient: Array
    blocks: list[BlockSlopes]
    equalities: Array


@dataclass
class _Filter:
    """Pairs of infeasibility and barrier cost that later iterates must improve on."""

    largest: float
    pairs: list[tuple[float, float]] = field(default_factory=list)

    def accepts(self, miss: float, cost: float) -> bool:
        return miss < self.largest and all(miss < m or cost < c for m, c in self.pairs)

    def add(self, miss: float, cost: float) -> None:
        self.pairs.append(((1 - _FILTER_FEASIBLE) * miss, cost - _FILTER_COST * miss))


def minimize(program: Bounded, x: Array, manner: Manner) -> Minimum:
    """A local minimum near x (nx,), or where the search ended without one."""
    return _Search(program, manner).run(np.clip(x, program.low, program.high))


class _Search:
    """The state of one search: barrier, filter, shift of the Hessian; scale of the cost."""

    def __init__(self, program: Bounded, manner: Manner) -> None:
        self.program, self.manner, self.mu = program, manner, manner.barrier
        self.low, self.high = program.span
        self.has_low, self.has_high = np.isfinite(self.low), np.isfinite(self.high)
        self.scale, self.shift = 1.0, 0.0
        self.least_barrier = manner.accuracy / 10

    def run(self, x: Array) -> Minimum:
        with np.errstate(all="ignore"):
            return self._run(x)

    def _run(self, x: Array) -> Minimum:
        cost, rows = self._values(x)
        if not (np.isfinite(cost) and np.isfinite(rows).all() and np.isfinite(self._slopes(x).gradient).all()):
            # Outside of what the arm can reach: no step leads back from there.
            return Minimum(x, cost, rows, STUCK, 0)
        at, slopes = self._begin(x)
        self.filter = _Filter(1e4 * max(1.0, self._miss(at)))
        for iteration in range(self.manner.iterations):
            off = self._off(at, slopes)
            if self._error(at, off, 0.0) <= self.manner.accuracy:
                return self._ended(at, SOLVED, iteration)
            self._lower_barrier(at, off)
            following = self._following(at, slopes)
            if following is None:
                return self._ended(at, STUCK, iteration)
            at = self._centred(following)
            slopes = self._slopes(at.x)
        return self._ended(at, LIMIT, self.manner.iterations)

    def _ended(self, at: _Iterate, status: str, iterations: int) -> Minimum:
        return Minimum(at.x, float(at.cost / self.scale), at.rows, status, iterations)

    # --- where it is ---

    def _begin(self, x: Array) -> tuple[_Iterate, _Slopes]:
        """Slacks off their bounds, and the multipliers of the equalities by least squares."""
        free, push = self.program.free, self.manner.push
        steep = np.abs(self._slopes(x).gradient[free]).max(initial=0.0)
        self.scale = min(1.0, _STEEPEST / max(steep, 1e-12))
        slopes = self._slopes(x)
        cost, rows = self._values(x)
        width = np.where(self.has_low & self.has_high, self.high - self.low, np.inf)
        off = [push * np.minimum(np.maximum(1.0, np.abs(bound)), width) for bound in (self.low, self.high)]
        least = np.where(self.has_low, self.low + off[0], -np.inf)
        most = np.where(self.has_high, self.high - off[1], np.inf)
        s = np.clip(self.program.inequalities(rows, x), least, most)
        given = self.manner.multiplier
        zl = np.where(self.has_low, self.mu / (s - self.low) if given is None else given, 0.0)
        zu = np.where(self.has_high, self.mu / (self.high - s) if given is None else given, 0.0)
        y = np.zeros(len(slopes.equalities))
        if len(y):
            dual = (slopes.gradient + self._pulled(slopes, zu - zl))[free]
            squares = np.asarray(-np.linalg.lstsq(slopes.equalities[:, free].T, dual, rcond=None)[0])
            if np.abs(squares).max() <= _LARGEST_START:
                y = squares
        return _Iterate(x, cost, rows, s, y, zl, zu), slopes

    def _values(self, x: Array) -> tuple[float, Array]:
        cost, rows = self.program.kernels.value(x, self.program.p)
        return self.scale * cost, rows

    def _slopes(self, x: Array) -> _Slopes:
        kernels = self.program.kernels
        gradient, blocks = kernels.slope(x, self.program.p)
        return _Slopes(self.scale * gradient, blocks, kernels.chosen(blocks, self.program.equal))

    def _split(self, v: Array) -> tuple[Array, Array]:
        """Of a number an inequality: all rows (m,), and the boxed unknowns."""
        count = len(v) - len(self.program.boxed)
        rows = np.zeros(len(self.program.equal))
        rows[~self.program.equal] = v[:count]
        return rows, v[count:]

    def _pulled(self, slopes: _Slopes, v: Array) -> Array:
        """(nx,) Jᵀ v, v (k,) a number an inequality."""
        rows, x = self._split(v)
        found = self.program.kernels.transposed(slopes.blocks, rows)
        found[self.program.boxed] += x
        return found

    def _ahead(self, slopes: _Slopes, dx: Array) -> Array:
        """(k,) by how much the inequalities change with x."""
        return self.program.inequalities(self.program.kernels.ahead(slopes.blocks, dx), dx)

    def _missed(self, at: _Iterate) -> tuple[Array, Array]:
        """By how much equalities, and slacks, are not what they should be."""
        program = self.program
        return (at.rows - program.lower)[program.equal], program.inequalities(at.rows, at.x) - at.s

    def _miss(self, at: _Iterate) -> float:
        return float(sum(np.abs(part).sum() for part in self._missed(at)))

    def _barrier_cost(self, at: _Iterate) -> float:
        rooms = np.concatenate([(at.s - self.low)[self.has_low], (self.high - at.s)[self.has_high]])
        return float(at.cost - self.mu * np.log(rooms).sum())

    def _off(self, at: _Iterate, slopes: _Slopes) -> tuple[float, float]:
        """By how much the gradient of the Lagrangian, and the constraints, are not zero: of optimality what no barrier
        changes."""
        dual = slopes.gradient + slopes.equalities.T @ at.y + self._pulled(slopes, at.zu - at.zl)
        missed = max(np.abs(part).max(initial=0.0) for part in self._missed(at))
        return float(np.abs(dual[self.program.free]).max(initial=0.0)), float(missed)

    def _error(self, at: _Iterate, off: tuple[float, float], mu: float) -> float:
        """By how much the conditions of optimality of the barrier's problem are missed, scaled; off: as `_off`."""
        dual, missed = off
        gaps = [(at.zl * (at.s - self.low))[self.has_low] - mu, (at.zu * (self.high - at.s))[self.has_high] - mu]
        z = float(at.zl.sum() + at.zu.sum())
        pairs = max(1, len(gaps[0]) + len(gaps[1]))
        both = max(_MULTIPLIERS, (float(np.abs(at.y).sum()) + z) / (pairs + len(at.y))) / _MULTIPLIERS
        own = max(_MULTIPLIERS, z / pairs) / _MULTIPLIERS
        gap = max(np.abs(part).max(initial=0.0) for part in gaps)
        return float(max(dual / both, missed, gap / own))

    def _lower_barrier(self, at: _Iterate, off: tuple[float, float]) -> None:
        while self.mu > self.least_barrier and self._error(at, off, self.mu) <= _BARRIER_TOLERANCE * self.mu:
            self.mu = max(self.least_barrier, min(_BARRIER_FACTOR * self.mu, self.mu**_BARRIER_POWER))
            self.filter = _Filter(self.filter.largest)

    def _centred(self, at: _Iterate) -> _Iterate:
        """Multipliers of bounds not too far from what the barrier asks for."""
        low, high = self.mu / (at.s - self.low), self.mu / (self.high - at.s)
        zl = np.where(self.has_low, np.clip(at.zl, low / _SIGMA, low * _SIGMA), 0.0)
        zu = np.where(self.has_high, np.clip(at.zu, high / _SIGMA, high * _SIGMA), 0.0)
        return replace(at, zl=zl, zu=zu)

    # --- where it goes ---

    def _following(self, at: _Iterate, slopes: _Slopes) -> _Iterate | None:
        """The next iterate, or None where no step is good enough."""
        low, high = self.has_low / (at.s - self.low), self.has_high / (self.high - at.s)
        sigma = at.zl * low + at.zu * high
        pull = self.mu * (high - low)
        system = self._system(at, slopes, sigma)
        if system is None:
            return None
        equal, above = self._missed(at)
        dx, y = system(-slopes.gradient - self._pulled(slopes, sigma * above + pull), -equal, at.y)
        ds = self._ahead(slopes, dx) + above
        slope = float(slopes.gradient @ dx + pull @ ds)
        keep = max(_FRACTION, 1 - self.mu)
        far = self._room(at.s - self.low, -ds, keep), self._room(self.high - at.s, ds, keep)
        dl = np.where(self.has_low, self.mu * low - at.zl - at.zl * low * ds, 0.0)
        du = np.where(self.has_high, self.mu * high - at.zu + at.zu * high * ds, 0.0)
        dual = min(self._room(at.zl, -dl, keep), self._room(at.zu, -du, keep))
        step = min(far)
        miss, cost = self._miss(at), self._barrier_cost(at)
        first = True
        while step > _LEAST_STEP:
            trial = self._moved(at, step * dx, step * ds)
            if self._accepted(miss, cost, slope, step, trial):
                break
            if first and self._miss(trial) >= miss:
                corrected = self._corrected(at, slopes, system, sigma, pull, step, trial, keep)
                if corrected is not None and self._accepted(miss, cost, slope, step, corrected):
                    trial = corrected
                    break
            first, step = False, step / 2
        else:
            return None
        return replace(trial, y=at.y + step * (y - at.y), zl=at.zl + dual * dl, zu=at.zu + dual * du)

    def _corrected(
        self,
        at: _Iterate,
        slopes: _Slopes,
        system: _System,
        sigma: Array,
        pull: Array,
        step: float,
        trial: _Iterate,
        keep: float,
    ) -> _Iterate | None:
        """A second-order correction: the same step with what the constraints' curvature adds to the miss."""
        equal, above = (step * old + new for old, new in zip(self._missed(at), self._missed(trial), strict=True))
        dx, _ = system(-slopes.gradient - self._pulled(slopes, sigma * above + pull), -equal, at.y)
        ds = self._ahead(slopes, dx) + above
        far = min(self._room(at.s - self.low, -ds, keep), self._room(self.high - at.s, ds, keep))
        return self._moved(at, far * dx, far * ds)

    def _moved(self, at: _Iterate, dx: Array, ds: Array) -> _Iterate:
        cost, rows = self._values(at.x + dx)
        return replace(at, x=at.x + dx, s=at.s + ds, cost=cost, rows=rows)

    @staticmethod
    def _room(room: Array, towards: Array, keep: float) -> float:
        """The largest part of a step, up to 1, that leaves of every room at least 1 − keep."""
        closing = (towards > 0) & np.isfinite(room)
        return float(min(1.0, (keep * room[closing] / towards[closing]).min(initial=np.inf)))

    def _accepted(self, miss: float, cost: float, slope: float, step: float, trial: _Iterate) -> bool:
        """Whether the filter takes a trial; where it takes it for its feasibility, later ones must be better."""
        there, new = self._miss(trial), self._barrier_cost(trial)
        if not (np.isfinite(there) and np.isfinite(new) and self.filter.accepts(there, new)):
            return False
        rounding = 10 * np.finfo(float).eps * abs(cost)
        falls = slope < 0 and step * (-slope) ** _FALL > miss**_MISS
        if falls and miss <= _FEASIBLE * self.filter.largest:
            return bool(new <= cost + _ARMIJO * step * slope + rounding)
        if not (there <= (1 - _FILTER_FEASIBLE) * miss or new <= cost - _FILTER_COST * miss + rounding):
            return False
        if not (falls and new <= cost + _ARMIJO * step * slope + rounding):
            self.filter.add(miss, cost)
        return True

    def _system(self, at: _Iterate, slopes: _Slopes, sigma: Array) -> _System | None:
        """The Newton system, its Hessian shifted until the step goes down within the equalities."""
        program = self.program
        rows, x = self._split(sigma)
        y, _ = self._split(at.zu - at.zl)
        y[program.equal] = at.y
        H = program.kernels.condensed(at.x, program.p, slopes.blocks, self.scale, y, rows)
        H[program.boxed, program.boxed] += x
        shift, grown = 0.0, 8.0 if self.shift else 100.0
        while shift < _LARGEST_SHIFT:
            system = _System.of(H, slopes.equalities, program.free, shift)
            if system is not None:
                self.shift = shift or self.shift
                return system
            shift = grown * shift if shift else (self.shift / 3 or _FIRST_SHIFT)
        return None


@dataclass(frozen=True)
class _System:
    """[H + shift, Aᵀ; A, 0] over the free unknowns, factorised."""

    size: int
    free: NDArray[np.int64]
    factor: Array
    pivots: NDArray[np.int32]

    @classmethod
    def of(cls, H: Array, A: Array, free: NDArray[np.int64], shift: float) -> _System | None:
        """None where it has not one negative eigenvalue an equality."""
        k, m = len(free), len(A)
        whole = np.zeros((k + m, k + m), order="F")
        whole[:k, :k] = H[np.ix_(free, free)]
        whole[range(k), range(k)] += shift
        whole[k:, :k] = A[:, free]
        whole[range(k, k + m), range(k, k + m)] = -_EQUALITY_SHIFT
        if not np.isfinite(whole).all():
            return None
        factor, pivots, info = lapack.dsytrf(whole, lower=1)
        single = pivots > 0
        # A pivot of two rows has one eigenvalue of either sign.
        negative = int((factor.diagonal()[single] < 0).sum()) + int((~single).sum()) // 2
        return cls(len(H), free, factor, pivots) if info == 0 and negative == m else None

    def __call__(self, dual: Array, equal: Array, y: Array) -> tuple[Array, Array]:
        """Step of x, and the multipliers of the equalities, which are y here: the shift acts on their change alone, so
        that equalities are met where it ends."""
        right = np.concatenate([dual[self.free], equal - _EQUALITY_SHIFT * y])
        solved, _ = lapack.dsytrs(self.factor, self.pivots, right, lower=1)
        dx = np.zeros(self.size)
        dx[self.free] = solved[: len(self.free)]
        return dx, solved[len(self.free) :]
