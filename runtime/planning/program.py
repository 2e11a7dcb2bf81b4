"""The nonlinear program (11) of a scenario: its expressions, placed along the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import BPoly

from runtime.model.loader import Model
from runtime.planning.blocks import ProgramBlock
from runtime.planning.scenario import Scenario
from runtime.planning.task import Task

Array = NDArray[np.float64]


def bernstein(degree: int, s: Array, derivative: int = 0) -> Array:
    """(N, M + 1): what each control point of (9) contributes at s in [0, 1], or to a derivative by s."""
    basis = BPoly(np.eye(degree + 1)[:, None, :], [0.0, 1.0])
    return np.asarray(basis.derivative(derivative)(s) if derivative else basis(s))


@cache
def quadrature(count: int) -> tuple[Array, Array]:
    """Nodes s in [0, 1] (N,) of Gauss and Legendre, and their weights, which sum to 1; not to be written to."""
    s, weights = np.polynomial.legendre.leggauss(count)
    return (s + 1) / 2, weights / 2


@dataclass(frozen=True)
class Program:
    """A task as blocks of one nonlinear program.

    nodes(degree): of Gauss and Legendre in a phase, for the cost and the constraints along it.
    """

    task: Task
    nodes: Callable[[int], int]

    @classmethod
    def of(cls, model: Model, scenario: Scenario, nodes: Callable[[int], int]) -> Program:
        return cls(Task(model, scenario), nodes)

    @cached_property
    def blocks(self) -> tuple[ProgramBlock, ...]:
        along = [self._along(k) for k in range(len(self.task.scenario.phases))]
        between = [block for block in self._between() if block.expression.labels]
        return (*along, *([self._peak()] if self.task.scenario.objective.goal == "peak_torque" else []), *between)

    def _along(self, phase: int) -> ProgramBlock:
        """At the nodes of Gauss and Legendre within a phase."""
        plan = self.task.scenario.phases[phase]
        s, weights = quadrature(self.nodes(plan.degree))
        where = tuple(f"phase {phase + 1} ({plan.start} to {plan.end}) at {x:.0%} of it" for x in s)
        return ProgramBlock(self.task.along[phase], self._sample_places(phase, s), weights, where)

    def _sample_places(self, phase: int, s: Array) -> sparse.csr_matrix:
        """(N nz, nx): at each place the free coordinates, their first and second derivatives, springs, and the peak."""
        u, degree = self.task.unknowns, self.task.scenario.phases[phase].degree
        k = len(u.free[phase])
        other = np.arange(u.motion, u.size)
        width = 3 * k + len(other)
        rows = np.arange(len(s))[:, None] * width
        parts = [_entries(rows + 3 * k + np.arange(len(other)), other, np.ones((len(s), len(other))))]
        for d in range(3):
            basis = bernstein(degree, s, d)
            for c in range(k):
                points = u.points(phase, c)
                parts.append(_entries(rows + d * k + c, np.arange(points.start, points.stop), basis))
        i, j, value = (np.concatenate(p) for p in zip(*parts, strict=True))
        return sparse.csr_matrix((value, (i, j)), shape=(width * len(s), u.size))

    def _peak(self) -> ProgramBlock:
        u = self.task.unknowns
        return ProgramBlock(self.task.peak, sparse.csr_matrix(([1.0], ([0], [u.peak])), (1, u.size)), np.ones(1), ("",))

    def _between(self) -> list[ProgramBlock]:
        count = len(self.task.scenario.phases)
        found = []
        for k in range(count + 1):
            if self.task.scenario.periodic and k < count:
                found.append(self._junction((k - 1) % count, k))
            elif not self.task.scenario.periodic:
                found.append(self._junction(k - 1 if k else None, k if k < count else None))
        return found

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
    """Row, column and value of each entry, of arrays that broadcast to one shape."""
    return tuple(a.ravel() for a in np.broadcast_arrays(rows, columns, values))
