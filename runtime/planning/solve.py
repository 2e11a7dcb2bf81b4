"""One program, many solutions, and what stands in the way where there is none."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime.interruption import heard_in_casadi
from runtime.planning.batch import Machine
from runtime.planning.blocks import Sum, assemble
from runtime.planning.interior_point import SOLVED, Bounded, Manner, Minimum, minimize
from runtime.planning.kernels import Kernels
from runtime.planning.program import Program

Array = NDArray[np.float64]
Bounds = tuple[Array, Array]
"""Lower and upper, of a program's rows (m,) or unknowns (nx,)."""

MET = 1e-4
"""By which a constraint may be missed, in its own unit, and still counts as met."""
_FAR, _THERE, _NEXT = (0.1, 1e-2, 1.0), (1e-4, 1e-5, 1.0), (1e-4, 1e-5, None)
"""Barrier at first, least distance from bounds and their multipliers, of a guess that is rough, in the right basin, or
the solution of a program that is nearly this one: there a larger barrier would push it over the ridge into the next, as
springs and friction make many."""
_ROUGH = 1e-3
"""Accuracy of solutions that only show where to begin."""
_INTERRUPTED = ("User_Requested_Stop", "NonIpopt_Exception_Thrown")
"""What IPOPT says where Ctrl-C came between two iterations, and within one."""
_QUIET = {"print_time": False, "show_eval_warnings": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}


@dataclass(frozen=True)
class Miss:
    """The constraint that is missed most: where in the motion, what, by how much."""

    where: str
    what: str
    amount: float
    unit: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what} is missed by {self.amount:.3g} {self.unit}"


@dataclass(frozen=True)
class Attempt:
    """x (nx,); cost: of the smooth program; status: what IPOPT said; missed: None if all constraints are met."""

    x: Array
    cost: float
    status: str
    iterations: int
    seconds: float
    missed: Miss | None

    @property
    def met(self) -> bool:
        return self.missed is None


class Solver:
    """Solves a program from given points: by the dense interior-point method, and where that ends without a solution by
    IPOPT from the same point; accuracy: of the optimality conditions, relative to their scale."""

    def __init__(self, program: Program, accuracy: float, iterations: int) -> None:
        self.program, self.accuracy, self.iterations = program, accuracy, iterations
        started = time.perf_counter()
        with heard_in_casadi():
            self._kernels = Kernels.of(program.blocks, Machine(program.task.model.library.machine))
            for block in program.blocks:
                block.expression.instructions  # noqa: B018 (derived once, before processes are forked that need it)
        self.setup_seconds = time.perf_counter() - started
        blocks = program.blocks
        self.rows: Bounds = (
            np.concatenate([block.lower.ravel() for block in blocks]),
            np.concatenate([block.upper.ravel() for block in blocks]),
        )

    @cached_property
    def pace(self) -> float:
        """How long a step of the search takes here, about: its derivatives, s."""
        p, y = self.program.task.p.vector(self.program.task.values(1.0)), np.zeros(len(self.rows[0]))
        x = np.zeros(self._kernels.size)
        for _ in range(2):
            # The first makes room for its numbers, the second counts.
            began = time.perf_counter()
            self._kernels.condensed(x, p, self._kernels.slope(x, p)[1], 1.0, y, y)
            seconds = time.perf_counter() - began
        return seconds

    def run(self, x: Array, width: float, sizes: Mapping[int, float] | None = None) -> Attempt:
        """A solution from the rough guess x (nx,); width of the switches in rad/s (m/s).

        sizes   by number of the spring (0-based): of its size, SI; fixed, not sought
        """
        return self._run(_FAR, x, width, sizes or {}, 1.0)

    def relieved(self, x: Array, width: float, share: float) -> Attempt:
        """The motion for springs that are yet to be chosen, from the rough guess x: without them, but only a share of
        their joints' squared torque counts, as if the springs gave the rest."""
        none = dict.fromkeys(range(len(self.program.task.scenario.springs)), 0.0)
        return self._run(_FAR, x, width, none, share)

    def refine(self, x: Array, width: float, sizes: Mapping[int, float] | None = None) -> Attempt:
        """The solution in whose basin x lies."""
        return self._run(_THERE, x, width, sizes or {}, 1.0)

    def onwards(
        self, x: Array, width: float, sizes: Mapping[int, float] | None = None, rows: Bounds | None = None
    ) -> Attempt:
        """The solution next to x, which solved a program that is nearly this one.

        rows   within which its rows are sought, where not within their own bounds
        """
        return self._run(_NEXT, x, width, sizes or {}, 1.0, rows=rows)

    def near(self, x: Array, width: float) -> Array:
        """(nx,) About where `onwards` would end, for a narrower width to begin with."""
        return self._run(_NEXT, x, width, {}, 1.0, accuracy=max(_ROUGH, self.accuracy)).x

    def _run(
        self,
        start: tuple[float, float, float | None],
        x: Array,
        width: float,
        sizes: Mapping[int, float],
        share: float,
        *,
        accuracy: float | None = None,
        rows: Bounds | None = None,
    ) -> Attempt:
        p, bounds = self.program.task.p.vector(self.program.task.values(width, share)), self.bounds(sizes)
        whole = Bounded(self._kernels, p, *(rows or self.rows), *bounds)
        began = time.perf_counter()
        manner = Manner(accuracy or self.accuracy, self.iterations, *start)
        found = minimize(whole, x, manner)
        if found.status != SOLVED:
            found = self._by_ipopt(manner, x, whole)
        seconds = time.perf_counter() - began
        return Attempt(found.x, found.cost, found.status, found.iterations, seconds, self._missed(found.rows))

    @cached_property
    def _sum(self) -> Sum:
        return assemble(self.program.blocks)

    def _by_ipopt(self, manner: Manner, x: Array, whole: Bounded) -> Minimum:
        """The same problem from the same point, with a restoration phase where constraints resist."""
        near = {f"ipopt.{slack}bound_{kind}": manner.push for slack in ("", "slack_") for kind in ("push", "frac")}
        options = {"ipopt.tol": manner.accuracy, "ipopt.max_iter": manner.iterations, "ipopt.mu_init": manner.barrier}
        within = {"lbx": whole.low, "ubx": whole.high, "lbg": whole.lower, "ubg": whole.upper}
        with heard_in_casadi():
            solver = self._sum.solver({**_QUIET, **options, **near})
            found = solver(x0=np.clip(x, whole.low, whole.high), p=whole.p, **within)
        rows, stats = np.array(found["g"]).ravel(), solver.stats()
        x = np.array(found["x"]).ravel()
        if stats["return_status"] in _INTERRUPTED:
            # IPOPT takes Ctrl-C for a wish to have what it has, which is no solution.
            raise KeyboardInterrupt
        return Minimum(x, float(found["f"]), rows, str(stats["return_status"]), int(stats["iter_count"]))

    def bounds(self, sizes: Mapping[int, float]) -> Bounds:
        """Of the unknowns, (nx,) each: springs alone are bounded, the motion by its constraints."""
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
