"""The nonlinear program (11) of a scenario: its expressions placed along the motion, and its solver."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import BPoly

from runtime.arrays import Array
from runtime.documents.parts import SearchEnd
from runtime.interruption import heard_in_casadi
from runtime.model.loader import Model
from runtime.planning.blocks import ProgramBlock, assemble
from runtime.planning.scenario import Scenario
from runtime.planning.task import Task

Bounds = tuple[Array, Array]
"""Lower and upper, of a program's rows (m,) or unknowns (nx,)."""

MET = 1e-4
"""Largest violation of a constraint that counts as met, in its own unit."""
_FAR, _NEXT = (0.1, 1e-2), (1e-4, 1e-5)
"""Initial barrier and distance from bounds for a guess that is rough, or the solution of nearly the same program:
springs and friction make many basins, and a large barrier leaves the right one."""
_ROUGH = 1e-3
"""Accuracy of solutions that serve as first guesses only."""
_INTERRUPTED = ("User_Requested_Stop", "NonIpopt_Exception_Thrown")
"""IPOPT's status after Ctrl-C between two iterations, and within one."""
_OUT_OF_STEPS, _OUT_OF_TIME = "Maximum_Iterations_Exceeded", "Maximum_WallTime_Exceeded"
_NO_TIME = 1e-3
"""s; IPOPT takes no less."""
_QUIET = {"print_time": False, "show_eval_warnings": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}


def bernstein(degree: int, s: Array, derivative: int = 0) -> Array:
    """(N, M + 1): weight of each control point of (9) at s in [0, 1], or in a derivative by s."""
    basis = BPoly(np.eye(degree + 1)[:, None, :], [0.0, 1.0])
    return np.asarray(basis.derivative(derivative)(s) if derivative else basis(s))


@cache
def quadrature(count: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes s in [0, 1] (N,) and their weights, which sum to 1; do not modify."""
    s, weights = np.polynomial.legendre.leggauss(count)
    return (s + 1) / 2, weights / 2


@dataclass(frozen=True)
class Program:
    """A task as blocks of one nonlinear program.

    nodes(degree): number of Gauss-Legendre nodes in a phase, for the cost and the constraints along it.
    """

    task: Task
    nodes: Callable[[int], int]

    @classmethod
    def of(cls, model: Model, scenario: Scenario, nodes: Callable[[int], int]) -> Program:
        return cls(Task(model, scenario), nodes)

    @cached_property
    def blocks(self) -> tuple[ProgramBlock, ...]:
        """One per phase, the peak if that is the objective, and one per point that requires anything."""
        s, u = self.task.scenario, self.task.unknowns
        count = len(s.phases)
        found = [self._along(k) for k in range(count)]
        if s.objective.goal == "peak_torque":
            place = sparse.csr_matrix(([1.0], ([0], [u.peak])), (1, u.size))
            found.append(ProgramBlock(self.task.peak, place, np.ones(1), ("",)))
        if s.periodic:
            between = [self._junction((k - 1) % count, k) for k in range(count)]
        else:
            between = [self._junction(k - 1 if k else None, k if k < count else None) for k in range(count + 1)]
        return (*found, *(block for block in between if block.expression.labels))

    def _along(self, phase: int) -> ProgramBlock:
        """At the nodes within a phase: free coordinates, first and second derivatives, springs, and the peak."""
        plan, u = self.task.scenario.phases[phase], self.task.unknowns
        s, weights = quadrature(self.nodes(plan.degree))
        where = tuple(f"phase {phase + 1} ({plan.start} to {plan.end}) at {x:.0%} of it" for x in s)
        k, other = len(u.free[phase]), np.arange(u.motion, u.size)
        width = 3 * k + len(other)
        rows = np.arange(len(s))[:, None] * width
        parts = [_entries(rows + 3 * k + np.arange(len(other)), other, np.ones((len(s), len(other))))]
        for d in range(3):
            basis = bernstein(plan.degree, s, d)
            for c in range(k):
                points = u.points(phase, c)
                parts.append(_entries(rows + d * k + c, np.arange(points.start, points.stop), basis))
        i, j, value = (np.concatenate(p) for p in zip(*parts, strict=True))
        places = sparse.csr_matrix((value, (i, j)), shape=(width * len(s), u.size))
        return ProgramBlock(self.task.along[phase], places, weights, where)

    def _junction(self, before: int | None, after: int | None) -> ProgramBlock:
        sides = [(phase, end) for phase, end in ((before, 1.0), (after, 0.0)) if phase is not None]
        places = sparse.vstack([self._end_places(phase, end) for phase, end in sides]).tocsr()
        where = f"point {self.task.point_between(before, after)}"
        return ProgramBlock(self.task.junction(before, after), places, np.ones(1), (where,))

    def _end_places(self, phase: int, s: float) -> sparse.csr_matrix:
        u, degree = self.task.unknowns, self.task.scenario.phases[phase].degree
        k = len(u.free[phase])
        found = sparse.lil_matrix((2 * k, u.size))
        for d in range(2):
            basis = bernstein(degree, np.array([s]), d)[0]
            for c in range(k):
                found[d * k + c, u.points(phase, c)] = basis
        return found.tocsr()


def _entries(rows: NDArray[np.int64], columns: NDArray[np.int64], values: Array) -> tuple[Array, ...]:
    return tuple(a.ravel() for a in np.broadcast_arrays(rows, columns, values))


# --- solutions ---


@dataclass(frozen=True)
class Miss:
    """The constraint that is violated most: where in the motion, what, by how much."""

    where: str
    what: str
    amount: float
    unit: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what} is missed by {self.amount:.3g} {self.unit}"


@dataclass(frozen=True)
class Attempt:
    """x (nx,); cost: of the smooth program; status: of the solver; missed: None if all constraints are met; allowed:
    iterations that it might make; ended: whether fewer of them than usual, or a time limit, cut it."""

    x: Array
    cost: float
    status: str
    iterations: int
    seconds: float
    missed: Miss | None
    allowed: int
    ended: SearchEnd

    @property
    def met(self) -> bool:
        return self.missed is None


class Solver:
    """Solves a program from a first guess by IPOPT, with the exact derivatives of its blocks.

    accuracy: of the optimality conditions, relative to their scale. iterations: of a solution at most; fewer where
    `most` is less, or the clock passes `until`, s. In all methods x is (nx,), width that of the smooth switches in
    rad/s (m/s), and sizes fixes sizes of springs, SI, by number of the spring (0-based).
    """

    def __init__(self, program: Program, accuracy: float, iterations: int) -> None:
        self.program, self.accuracy, self.iterations = program, accuracy, iterations
        self.most, self.until = iterations, inf
        started = time.perf_counter()
        with heard_in_casadi():
            self._sum = assemble(program.blocks)
        self.setup_seconds = time.perf_counter() - started
        blocks = program.blocks
        self.rows: Bounds = (
            np.concatenate([block.lower.ravel() for block in blocks]),
            np.concatenate([block.upper.ravel() for block in blocks]),
        )

    def run(self, x: Array, width: float) -> Attempt:
        """A solution from a rough guess."""
        return self._run(_FAR, x, width)

    def relieved(self, x: Array, width: float, share: float) -> Attempt:
        """The motion for springs that are not yet known, from a rough guess: without springs, but only a share of
        their joints' squared torque counts, as if springs gave the rest."""
        none = dict.fromkeys(range(len(self.program.task.scenario.springs)), 0.0)
        return self._run(_FAR, x, width, sizes=none, share=share)

    def refine(self, x: Array, width: float) -> Attempt:
        """The solution in the basin of x."""
        return self._run(_NEXT, x, width)

    def onwards(
        self, x: Array, width: float, sizes: Mapping[int, float] | None = None, rows: Bounds | None = None
    ) -> Attempt:
        """The solution next to x, which solved nearly the same program; rows: bounds in place of the program's own."""
        return self._run(_NEXT, x, width, sizes=sizes, rows=rows)

    def near(self, x: Array, width: float) -> Attempt:
        """Roughly where `onwards` would end, as a first guess for a narrower width."""
        return self._run(_NEXT, x, width, accuracy=max(_ROUGH, self.accuracy))

    def _run(
        self,
        start: tuple[float, float],
        x: Array,
        width: float,
        *,
        sizes: Mapping[int, float] | None = None,
        share: float = 1.0,
        accuracy: float | None = None,
        rows: Bounds | None = None,
    ) -> Attempt:
        p, (low, high) = self.program.task.p.vector(self.program.task.values(width, share)), self.bounds(sizes or {})
        lower, upper = rows or self.rows
        barrier, push = start
        options = {f"ipopt.{slack}bound_{kind}": push for slack in ("", "slack_") for kind in ("push", "frac")}
        options |= {"ipopt.tol": accuracy or self.accuracy, "ipopt.max_iter": self.most, "ipopt.mu_init": barrier}
        if isfinite(self.until):
            options["ipopt.max_wall_time"] = max(self.until - time.monotonic(), _NO_TIME)
        began = time.perf_counter()
        with heard_in_casadi():
            solver = self._sum.solver({**_QUIET, **options})
            found = solver(x0=np.clip(x, low, high), p=p, lbx=low, ubx=high, lbg=lower, ubg=upper)
        stats = solver.stats()
        status = str(stats["return_status"])
        if status in _INTERRUPTED:
            # After Ctrl-C IPOPT returns its last iterate, which is not a solution.
            raise KeyboardInterrupt
        return Attempt(
            np.array(found["x"]).ravel(),
            float(found["f"]),
            status,
            iterations=int(stats["iter_count"]),
            seconds=time.perf_counter() - began,
            missed=self._missed(np.array(found["g"]).ravel()),
            allowed=self.most,
            ended=self._end(status),
        )

    def _end(self, status: str) -> SearchEnd:
        if status == _OUT_OF_TIME:
            return "time"
        return "budget" if status == _OUT_OF_STEPS and self.most < self.iterations else "complete"

    def bounds(self, sizes: Mapping[int, float]) -> Bounds:
        """Of the unknowns, (nx,) each: only springs have bounds, the motion has constraints."""
        u = self.program.task.unknowns
        lower, upper = np.full(u.size, -np.inf), np.full(u.size, np.inf)
        for k, spring in enumerate(self.program.task.springs):
            plan = spring.plan.within(spring.size.name, sizes[k], sizes[k]) if k in sizes else spring.plan
            lower[u.spring(k)] = spring.unknowns({name: low for name, (low, _) in plan.sought.items()})
            upper[u.spring(k)] = spring.unknowns({name: high for name, (_, high) in plan.sought.items()})
        return lower, upper

    @cached_property
    def _labels(self) -> Sequence[tuple[str, tuple[str, str]]]:
        return [(where, what) for b in self.program.blocks for where in b.where for what in b.expression.labels]

    def _missed(self, rows: Array) -> Miss | None:
        lower, upper = self.rows
        amount = np.maximum(lower - rows, rows - upper)
        amount[~np.isfinite(rows)] = np.inf
        if not len(amount) or amount.max() <= MET:
            return None
        worst = int(np.argmax(amount))
        where, (what, unit) = self._labels[worst]
        return Miss(where, what, float(amount[worst]), unit)
