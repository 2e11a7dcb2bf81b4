"""A primal-dual interior-point method for programs of few unknowns and many constraints along a motion.

Slacks and multipliers of inequalities are eliminated, so that each step solves one dense symmetric system in the
unknowns and the equalities, whatever the number of rows. Barrier, filter and inertia correction are those of Wächter
& Biegler, "On the implementation of an interior-point filter line-search algorithm", Math. Program. 106 (2006). There
is no restoration phase: a search that gets stuck returns the status STUCK, and another solver may continue.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from runtime.planning.blocks import BlockSlopes, Kernels

Array = NDArray[np.float64]

SOLVED, STUCK, LIMIT = "Solve_Succeeded", "Search_Direction_Stuck", "Maximum_Iterations_Exceeded"

_LEAST_STEP = 1e-7
_BARRIER_TOLERANCE, _BARRIER_FACTOR, _BARRIER_POWER = 10.0, 0.2, 1.5
_FRACTION = 0.99
"""Least fraction of the distance to the nearest bound that a step may cover (fraction to the boundary)."""
_FILTER_FEASIBLE, _FILTER_COST = 1e-5, 1e-8
_ARMIJO = 1e-4
_FALL, _MISS = 2.3, 1.1
"""Exponents of the switching condition: of the cost's descent and of the infeasibility."""
_FEASIBLE = 1e-8
"""Fraction of the largest accepted infeasibility below which a step must decrease the cost."""
_FIRST_SHIFT, _LARGEST_SHIFT = 1e-4, 1e20
_EQUALITY_SHIFT = 1e-10
"""Regularization, so that redundant equalities do not make the system singular."""
_SIGMA = 1e10
"""Largest factor between the multiplier of a bound and the barrier's value for it, mu over the slack."""
_STEEPEST = 100.0
"""The cost is scaled so that no element of its first gradient is larger."""
_MULTIPLIERS = 100.0
"""Mean multiplier above which the optimality conditions are scaled by it."""
_LARGEST_START = 1e3
"""Largest initial multiplier of an equality; if least squares give a larger one, all begin at zero."""


@dataclass(frozen=True)
class Manner:
    """Options of a search.

    accuracy     of the optimality conditions
    barrier      initial μ
    push         initial distance from bounds, at least
    multiplier   initial multipliers of bounds; None: μ over the slack, for an x that solved nearly the same program
    """

    accuracy: float
    iterations: int
    barrier: float = 0.1
    push: float = 1e-2
    multiplier: float | None = 1.0


@dataclass(frozen=True)
class Minimum:
    """x (nx,) where the search ended, its cost and rows (m,)."""

    x: Array
    cost: float
    rows: Array
    status: str
    iterations: int


@dataclass(frozen=True)
class Bounded:
    """A program with lower <= rows <= upper, low <= x <= high; equal bounds make equalities, or fix unknowns."""

    kernels: Kernels
    p: Array
    lower: Array
    upper: Array
    low: Array
    high: Array

    @cached_property
    def equal(self) -> NDArray[np.bool_]:
        """(m,) whether a row is an equality."""
        return np.asarray(self.lower == self.upper)

    @cached_property
    def boxed(self) -> NDArray[np.int64]:
        """Unknowns with a bound that are not fixed: their bounds are inequalities, like rows."""
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
    of the slacks' bounds."""

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


class _Merit(NamedTuple):
    """Of an iterate: infeasibility, barrier cost, and the slope of that cost along the step."""

    miss: float
    cost: float
    slope: float


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
    """A local minimum near x (nx,), or the last iterate of a search without one."""
    return _Search(program, manner).run(np.clip(x, program.low, program.high))


class _Search:
    """The state of one search: barrier, filter, shift of the Hessian, scale of the cost."""

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
            # Beyond the arm's reach: no step leads back.
            return Minimum(x, cost, rows, status=STUCK, iterations=0)
        at, slopes = self._begin(x)
        self.filter = _Filter(1e4 * max(1.0, self._infeasibility(at)))
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
        return Minimum(at.x, float(at.cost / self.scale), at.rows, status=status, iterations=iterations)

    # --- the iterate ---

    def _begin(self, x: Array) -> tuple[_Iterate, _Slopes]:
        """Slacks pushed off their bounds; multipliers of the equalities by least squares."""
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
            dual = (slopes.gradient + self._transposed(slopes, zu - zl))[free]
            squares = np.asarray(-np.linalg.lstsq(slopes.equalities[:, free].T, dual, rcond=None)[0])
            if np.abs(squares).max() <= _LARGEST_START:
                y = squares
        return _Iterate(x, cost, rows, s=s, y=y, zl=zl, zu=zu), slopes

    def _values(self, x: Array) -> tuple[float, Array]:
        cost, rows = self.program.kernels.value(x, self.program.p)
        return self.scale * cost, rows

    def _slopes(self, x: Array) -> _Slopes:
        kernels = self.program.kernels
        gradient, blocks = kernels.slope(x, self.program.p)
        return _Slopes(self.scale * gradient, blocks, kernels.jacobian_rows(blocks, self.program.equal))

    def _split(self, v: Array) -> tuple[Array, Array]:
        """A vector over the inequalities as one over all rows (m,) and one over the boxed unknowns."""
        count = len(v) - len(self.program.boxed)
        rows = np.zeros(len(self.program.equal))
        rows[~self.program.equal] = v[:count]
        return rows, v[count:]

    def _transposed(self, slopes: _Slopes, v: Array) -> Array:
        """(nx,) Jᵀ v, with v (k,) over the inequalities."""
        rows, x = self._split(v)
        found = self.program.kernels.jacobian_transposed_times(slopes.blocks, rows)
        found[self.program.boxed] += x
        return found

    def _change(self, slopes: _Slopes, dx: Array) -> Array:
        """(k,) change of the inequalities with a step dx, to first order."""
        return self.program.inequalities(self.program.kernels.jacobian_times(slopes.blocks, dx), dx)

    def _residuals(self, at: _Iterate) -> tuple[Array, Array]:
        """Residuals of the equalities, and of the inequalities against their slacks."""
        program = self.program
        return (at.rows - program.lower)[program.equal], program.inequalities(at.rows, at.x) - at.s

    def _infeasibility(self, at: _Iterate) -> float:
        """Sum of the absolute residuals."""
        return float(sum(np.abs(part).sum() for part in self._residuals(at)))

    def _barrier_cost(self, at: _Iterate) -> float:
        rooms = np.concatenate([(at.s - self.low)[self.has_low], (self.high - at.s)[self.has_high]])
        return float(at.cost - self.mu * np.log(rooms).sum())

    def _off(self, at: _Iterate, slopes: _Slopes) -> tuple[float, float]:
        """Largest elements of the Lagrangian's gradient and of the residuals; they do not depend on the barrier."""
        dual = slopes.gradient + slopes.equalities.T @ at.y + self._transposed(slopes, at.zu - at.zl)
        missed = max(np.abs(part).max(initial=0.0) for part in self._residuals(at))
        return float(np.abs(dual[self.program.free]).max(initial=0.0)), float(missed)

    def _error(self, at: _Iterate, off: tuple[float, float], mu: float) -> float:
        """Scaled optimality error of the barrier problem; off: of `_off`."""
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
        """With multipliers of bounds within a factor _SIGMA of the barrier's values."""
        low, high = self.mu / (at.s - self.low), self.mu / (self.high - at.s)
        zl = np.where(self.has_low, np.clip(at.zl, low / _SIGMA, low * _SIGMA), 0.0)
        zu = np.where(self.has_high, np.clip(at.zu, high / _SIGMA, high * _SIGMA), 0.0)
        return replace(at, zl=zl, zu=zu)

    # --- the step ---

    def _following(self, at: _Iterate, slopes: _Slopes) -> _Iterate | None:
        """The next iterate, or None if no step is accepted."""
        low, high = self.has_low / (at.s - self.low), self.has_high / (self.high - at.s)
        sigma = at.zl * low + at.zu * high
        pull = self.mu * (high - low)
        system = self._system(at, slopes, sigma)
        if system is None:
            return None
        keep = max(_FRACTION, 1 - self.mu)

        def newton(equal: Array, above: Array) -> tuple[Array, Array, Array, float]:
            """Steps of x and s that remove these residuals, new multipliers y, and how far the bounds let it go."""
            dx, y = system(-slopes.gradient - self._transposed(slopes, sigma * above + pull), -equal, at.y)
            ds = self._change(slopes, dx) + above
            return dx, ds, y, min(self._room(at.s - self.low, -ds, keep), self._room(self.high - at.s, ds, keep))

        dx, ds, y, step = newton(*self._residuals(at))
        dl = np.where(self.has_low, self.mu * low - at.zl - at.zl * low * ds, 0.0)
        du = np.where(self.has_high, self.mu * high - at.zu + at.zu * high * ds, 0.0)
        dual = min(self._room(at.zl, -dl, keep), self._room(at.zu, -du, keep))
        before = _Merit(self._infeasibility(at), self._barrier_cost(at), float(slopes.gradient @ dx + pull @ ds))
        first = True
        while step > _LEAST_STEP:
            trial = self._moved(at, step * dx, step * ds)
            if self._accepted(before, step, trial):
                break
            if first and self._infeasibility(trial) >= before.miss:
                # Second-order correction: also removes the residuals left by the constraints' curvature.
                pairs = zip(self._residuals(at), self._residuals(trial), strict=True)
                cx, cs, _, far = newton(*(step * old + new for old, new in pairs))
                corrected = self._moved(at, far * cx, far * cs)
                if self._accepted(before, step, corrected):
                    trial = corrected
                    break
            first, step = False, step / 2
        else:
            return None
        return replace(trial, y=at.y + step * (y - at.y), zl=at.zl + dual * dl, zu=at.zu + dual * du)

    def _moved(self, at: _Iterate, dx: Array, ds: Array) -> _Iterate:
        cost, rows = self._values(at.x + dx)
        return replace(at, x=at.x + dx, s=at.s + ds, cost=cost, rows=rows)

    @staticmethod
    def _room(room: Array, towards: Array, keep: float) -> float:
        """The largest fraction of a step, up to 1, that leaves at least 1 − keep of every distance to a bound."""
        closing = (towards > 0) & np.isfinite(room)
        return float(min(1.0, (keep * room[closing] / towards[closing]).min(initial=np.inf)))

    def _accepted(self, before: _Merit, step: float, trial: _Iterate) -> bool:
        """Whether the filter accepts a trial; if it does for its feasibility, the filter grows."""
        miss, cost, slope = before
        there, new = self._infeasibility(trial), self._barrier_cost(trial)
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
        """The Newton system, its Hessian shifted until it is positive definite on the null space of the equalities."""
        program = self.program
        rows, x = self._split(sigma)
        y, _ = self._split(at.zu - at.zl)
        y[program.equal] = at.y
        H = program.kernels.condensed(at.x, program.p, slopes.blocks, scale=self.scale, y=y, sigma=rows)
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
        """None unless it has exactly one negative eigenvalue per equality."""
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
        # A 2 x 2 pivot has one eigenvalue of either sign.
        negative = int((factor.diagonal()[single] < 0).sum()) + int((~single).sum()) // 2
        return cls(len(H), free, factor, pivots) if info == 0 and negative == m else None

    def __call__(self, dual: Array, equal: Array, y: Array) -> tuple[Array, Array]:
        """Step of x, and the new multipliers of the equalities. The regularization acts on their change from y alone,
        so that the equalities are met at convergence."""
        right = np.concatenate([dual[self.free], equal - _EQUALITY_SHIFT * y])
        solved, _ = lapack.dsytrs(self.factor, self.pivots, right, lower=1)
        dx = np.zeros(self.size)
        dx[self.free] = solved[: len(self.free)]
        return dx, solved[len(self.free) :]
