"""The nonlinear program (11) of a scenario: unknowns, cost, constraints, as blocks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import sqrt
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import BPoly

from runtime.model import casadi_functions
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.planning.blocks import ProgramBlock
from runtime.planning.physics import Physics, PlanInstant
from runtime.planning.scenario import PhasePlan, Point, Scenario
from runtime.planning.springs import SoughtSpring, sought
from runtime.planning.unknowns import Parameters, Unknowns

Array = NDArray[np.float64]
Row = tuple[ca.SX, float, float, str, str]
"""A constraint: expression, lower and upper bound, what it is for a person, and its unit."""

CLEAR_OF_SINGULAR = 0.05
"""Least |sin q_2| in contact: at zero J_w is singular."""
INF = float("inf")
NONE = ca.SX(0, 1)


def bernstein(degree: int, s: Array, derivative: int = 0) -> Array:
    """(N, M + 1): what each control point of (9) contributes at s in [0, 1], or to a derivative by s."""
    basis = BPoly(np.eye(degree + 1)[:, None, :], [0.0, 1.0])
    return np.asarray(basis.derivative(derivative)(s) if derivative else basis(s))


@dataclass(frozen=True)
class Program:
    """A scenario as blocks of one nonlinear program.

    Solutions may differ in p: cycle time, targets, effects' values, the arm's lumps and lengths.
    nodes(degree): of Gauss and Legendre in a phase, for the cost and the constraints along it.
    """

    model: Model
    scenario: Scenario
    nodes: Callable[[int], int]

    # --- unknowns and parameters ---

    @cached_property
    def physics(self) -> Physics:
        return Physics.of(self.model, self.scenario)

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """0-based."""
        return tuple(j - 1 for j in self.scenario.moving)

    @cached_property
    def unknowns(self) -> Unknowns:
        free = tuple(self.moving if p.kind == "free" else (1, 2, 3) for p in self.scenario.phases)
        return Unknowns(self.scenario, free)

    @cached_property
    def p(self) -> Parameters:
        targets = {f"tip {name}": 2 for name, point in self.scenario.points.items() if point.tip is not None}
        own = {"duration": len(self.scenario.phases), "plate x": 1, "share": len(self._counted())}
        return Parameters.of({**self.physics.sizes, **own, **targets})

    def values(self, width: float, share: float = 1.0) -> dict[str, list[float]]:
        """What p is for the scenario as it stands; width of the switches, rad/s.

        share   of the squared torque of sprung joints that counts: while a search has no springs yet, less than all
        """
        sprung = {spring.joint - 1 for spring in self.scenario.springs}
        shares = [share if i in sprung else 1.0 for i in self._counted()]
        s = self.scenario
        x = 0.0 if self.model.contact is None else float(self.model.contact["x"])
        targets = {f"tip {name}": list(point.tip) for name, point in s.points.items() if point.tip is not None}
        durations = [s.cycle_time * phase.part for phase in s.phases]
        return {**self.physics.values(width), "duration": durations, "plate x": [x], "share": shares, **targets}

    # --- one instant as seen from one side ---

    def _coordinates(self, phase: int, free: Sequence[ca.SX]) -> ca.SX:
        """All n coordinates, from the free ones."""
        if self.scenario.phases[phase].kind == "contact":
            return ca.vertcat(self.p("plate x"), *free)
        given = dict(zip(self.unknowns.free[phase], free, strict=True))
        return ca.vertcat(*(given.get(i, ca.SX(q)) for i, q in enumerate(self.scenario.posture)))

    def _instant(self, phase: int, c: ca.SX, cs: ca.SX, css: ca.SX, springs: Mapping[Term, ca.SX]) -> PlanInstant:
        """c, cs, css: free coordinates and their derivatives by the phase's s in [0, 1]."""
        T = self.p("duration")[phase]
        k = len(self.unknowns.free[phase])
        zero = [ca.SX(0)] * k
        still = self._coordinates(phase, zero) * 0
        v = self._embedded(phase, ca.vertsplit(cs / T)) if k else still
        a = self._embedded(phase, ca.vertsplit(css / T**2)) if k else still
        at = self._coordinates(phase, ca.vertsplit(c))
        if self.scenario.phases[phase].kind == "free":
            return PlanInstant(self.physics, at, v, a, springs, self.p, apart=self._kept_off)
        struct = self.p("struct")
        q = casadi_functions.arm_function(self.model, "contact_inverse")(struct, at, self.scenario.elbow)
        solve = casadi_functions.arm_function(self.model, "contact_acceleration")
        # Without rates b_w is zero, and the map of accelerations is that of rates.
        qd = solve(struct, q, ca.SX.zeros(self.model.n), v)
        return PlanInstant(self.physics, q, qd, solve(struct, q, qd, a), springs, self.p, apart=False)

    def _embedded(self, phase: int, free: Sequence[ca.SX]) -> ca.SX:
        """Rates of all coordinates: those that are not free stand still."""
        given = dict(zip(self.unknowns.free[phase], free, strict=True))
        return ca.vertcat(*(given.get(i, ca.SX(0)) for i in range(self.model.n)))

    @cached_property
    def springs(self) -> tuple[SoughtSpring, ...]:
        return sought(self.model, self.scenario)

    def _springs(self, z: ca.SX) -> dict[Term, ca.SX]:
        """Parameters of each spring, from what is sought of them in z."""
        ends = np.cumsum([0, *self.unknowns.spring_sizes]).tolist()
        unknowns = [ca.vertsplit(z[a:b]) for a, b in pairwise(ends)]
        return {s.term: ca.vertcat(*s.values(x).values()) for s, x in zip(self.springs, unknowns, strict=True)}

    # --- blocks ---

    @cached_property
    def blocks(self) -> tuple[ProgramBlock, ...]:
        along = [self._along(k) for k in range(len(self.scenario.phases))]
        between = [block for block in self._between() if block.rows.numel()]
        return (*along, *([self._peak()] if self.scenario.objective.goal == "peak_torque" else []), *between)

    def _along(self, phase: int) -> ProgramBlock:
        """Cost and path constraints at the nodes of Gauss and Legendre within a phase."""
        plan = self.scenario.phases[phase]
        nodes, weights = np.polynomial.legendre.leggauss(self.nodes(plan.degree))
        s, weights = (nodes + 1) / 2, weights / 2
        k, springs = len(self.unknowns.free[phase]), sum(self.unknowns.spring_sizes)
        peak = self.scenario.objective.goal == "peak_torque"
        z = ca.SX.sym("z", 3 * k + springs + peak)
        at = self._instant(phase, z[:k], z[k : 2 * k], z[2 * k : 3 * k], self._springs(z[3 * k :]))
        rows = self._path(phase, at)
        if peak:
            rows += self._below_peak(at, z[-1])
        places = self._sample_places(phase, s)
        return ProgramBlock(
            z=z,
            p=self.p.symbol,
            places=places,
            offset=np.zeros(places.shape[0]),
            cost=self._cost(at) * self.p("duration")[phase],
            squares=self._squares(at) * ca.sqrt(self.p("duration")[phase]),
            weights=weights,
            where=tuple(f"phase {phase + 1} ({plan.start} to {plan.end}) at {x:.0%} of it" for x in s),
            **_rows(rows, len(s)),
        )

    def _sample_places(self, phase: int, s: Array) -> sparse.csr_matrix:
        """(N nz, nx): at each place the free coordinates, their first and second derivatives, springs, and the peak."""
        u, degree = self.unknowns, self.scenario.phases[phase].degree
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

    def _counted(self) -> list[int]:
        """Joints (0-based) whose torque counts."""
        return [j - 1 for j in self.scenario.objective.joints or self.scenario.moving]

    def _cost(self, at: PlanInstant) -> ca.SX:
        """What a phase costs per time, without the squares."""
        if self.scenario.objective.goal != "positive_work":
            return ca.SX(0)
        power = [at.torque[i] * at.qd[i] for i in self._counted()]
        return ca.sum(ca.vertcat(*(ca.fmax(w, 0) for w in power)))

    def _squares(self, at: PlanInstant) -> ca.SX:
        """What costs its square per time, (k,)."""
        goal = self.scenario.objective.goal
        if goal == "electrical_energy":
            return ca.vertcat(*(sqrt(self._loss(i)) * at.torque[i] for i in self._counted()))
        own = at.torque[self._counted()] * ca.sqrt(self.p("share"))
        return own if goal == "torque_squared" else NONE

    def _loss(self, i: int) -> float:
        """W per squared torque: R/k²."""
        constant = self.model.joints[i].torque_constant or 1.0
        return self.scenario.objective.resistance[i + 1] / constant**2

    def _below_peak(self, at: PlanInstant, peak: ca.SX) -> list[Row]:
        found: list[Row] = []
        for i in self._counted():
            part = at.torque[i] / (self.model.joints[i].torque_limit or 1.0)
            found += [(part - peak, -INF, 0.0, f"torque of joint {i + 1} below the peak", "1")]
            found += [(part + peak, 0.0, INF, f"torque of joint {i + 1} below the peak", "1")]
        return found

    def _peak(self) -> ProgramBlock:
        z = ca.SX.sym("z")
        places = sparse.csr_matrix(([1.0], ([0], [self.unknowns.peak])), shape=(1, self.unknowns.size))
        none: list[Row] = []
        return ProgramBlock(z, self.p.symbol, places, np.zeros(1), z, NONE, np.ones(1), where=("",), **_rows(none, 1))

    def _path(self, phase: int, at: PlanInstant) -> list[Row]:
        plan = self.scenario.phases[phase]
        joints = self.moving if plan.kind == "free" else range(self.model.n)
        rows: list[Row] = []
        for i in joints:
            info = self.model.joints[i]
            unit = info.position_unit
            low, high = self._rates(plan, i)
            if low > -INF or high < INF:
                rows.append((at.qd[i], low, high, f"speed of joint {i + 1}", f"{unit}/s"))
            span = self.span(i)
            if span is not None:
                rows.append((at.q[i], *span, f"position of joint {i + 1}", unit))
            if info.torque_limit is not None:
                limit = info.torque_limit
                rows.append((at.torque[i], -limit, limit, f"torque of joint {i + 1}", info.force_unit))
        if plan.kind == "contact":
            rows.append((self.scenario.elbow * ca.sin(at.q[1]), CLEAR_OF_SINGULAR, INF, "distance from q_2 = 0", "1"))
            way = self._tip_way(plan)
            if plan.monotone and way:
                rows.append((way * at.tip_rate[1], 0.0, INF, "end-effector must not turn back", "m/s"))
        elif self._kept_off:
            above = at.tip[1] - self.physics.plate_position(self.p)
            rows.append((above, 0.0, INF, "end-effector above the plate", "m"))
        return rows

    def span(self, i: int) -> tuple[float, float] | None:
        """Where joint i (0-based) may be: within its limits, and within what the scenario narrows them to."""
        ends = [e for e in (self.model.joints[i].position_limits, self.scenario.ranges.get(i + 1)) if e is not None]
        return (max(low for low, _ in ends), min(high for _, high in ends)) if ends else None

    @property
    def _kept_off(self) -> bool:
        """Whether free phases stay above the plate: where others press it."""
        return any(plan.kind == "contact" for plan in self.scenario.phases)

    def _rates(self, plan: PhasePlan, i: int) -> tuple[float, float]:
        limit = self.model.joints[i].speed_limit or INF
        start, end = (self.scenario.points[name].q.get(i + 1) for name in (plan.start, plan.end))
        if plan.monotone and plan.kind == "free" and start is not None and end is not None and start != end:
            return (0.0, limit) if end > start else (-limit, 0.0)
        return -limit, limit

    def _tip_way(self, plan: PhasePlan) -> float:
        start, end = (self.scenario.points[name].tip for name in (plan.start, plan.end))
        return 0.0 if start is None or end is None else float(np.sign(end[1] - start[1]))

    # --- instants between phases ---

    def _between(self) -> list[ProgramBlock]:
        count = len(self.scenario.phases)
        found = []
        for k in range(count + 1):
            if self.scenario.periodic and k < count:
                found.append(self._junction((k - 1) % count, k))
            elif not self.scenario.periodic:
                found.append(self._junction(k - 1 if k else None, k if k < count else None))
        return found

    def _junction(self, before: int | None, after: int | None) -> ProgramBlock:
        """Continuity of position and rate between two phases, and what is asked for at the point between them."""
        sides = [(phase, end) for phase, end in ((before, 1.0), (after, 0.0)) if phase is not None]
        sizes = [2 * len(self.unknowns.free[phase]) for phase, _ in sides]
        z = ca.SX.sym("z", sum(sizes))
        parts = ca.vertsplit(z, np.cumsum([0, *sizes]).tolist())
        seen = [self._at_end(phase, part) for (phase, _), part in zip(sides, parts, strict=True)]
        phases = self.scenario.phases
        name = phases[sides[-1][0]].start if after is not None else phases[sides[-1][0]].end
        rows: list[Row] = []
        if len(seen) == 2:
            rows += self._continuity(sides[0][0], sides[1][0], seen, parts)
        # A point is asked for once, on the side where the plate already gives a part of it.
        chosen = max(range(len(seen)), key=lambda k: phases[sides[k][0]].kind == "contact")
        rows += self._asked(self.scenario.points[name], name, seen[chosen], phases[sides[chosen][0]].kind == "contact")
        places = sparse.vstack([self._end_places(phase, end) for phase, end in sides]).tocsr()
        return ProgramBlock(
            z=z,
            p=self.p.symbol,
            places=places,
            offset=np.zeros(places.shape[0]),
            cost=ca.SX(0),
            squares=NONE,
            weights=np.ones(1),
            where=(f"point {name}",),
            **_rows(rows, 1),
        )

    def _at_end(self, phase: int, z: ca.SX) -> PlanInstant:
        k = len(self.unknowns.free[phase])
        return self._instant(phase, z[:k], z[k:], ca.SX.zeros(k), {})

    def _end_places(self, phase: int, s: float) -> sparse.csr_matrix:
        u, degree = self.unknowns, self.scenario.phases[phase].degree
        k = len(u.free[phase])
        found = sparse.lil_matrix((2 * k, u.size))
        for d in range(2):
            basis = bernstein(degree, np.array([s]), d)[0]
            for c in range(k):
                found[d * k + c, u.points(phase, c)] = basis
        return found.tocsr()

    def _continuity(self, before: int, after: int, seen: Sequence[PlanInstant], parts: Sequence[ca.SX]) -> list[Row]:
        kinds = {self.scenario.phases[k].kind for k in (before, after)}
        if kinds == {"contact"}:
            k = len(self.unknowns.free[before])
            T = self.p("duration")
            jumps = ca.vertcat(parts[0][:k] - parts[1][:k], parts[0][k:] / T[before] - parts[1][k:] / T[after])
            names = [(f"w{i + 1}", "m" if i < 2 else "rad") for i in self.unknowns.free[before]]
        else:
            joints = list(self.moving)
            jumps = ca.vertcat(seen[0].q[joints] - seen[1].q[joints], seen[0].qd[joints] - seen[1].qd[joints])
            names = [(f"joint {i + 1}", self.model.joints[i].position_unit) for i in joints]
        labels = [(f"continuous position of {name}", unit) for name, unit in names]
        labels += [(f"continuous rate of {name}", f"{unit}/s") for name, unit in names]
        return [(jump, 0.0, 0.0, *label) for jump, label in zip(ca.vertsplit(jumps), labels, strict=True)]

    def _asked(self, point: Point, name: str, at: PlanInstant, contact: bool) -> list[Row]:
        unit = {i: joint.position_unit for i, joint in enumerate(self.model.joints)}
        rows: list[Row] = [
            (at.q[j - 1] - q, 0.0, 0.0, f"position of joint {j}", unit[j - 1]) for j, q in point.q.items()
        ]
        # In contact the plate's axis has the end-effector's x already.
        axes = (1,) if contact else (0, 1)
        if point.tip is not None:
            target = self.p(f"tip {name}")
            rows += [(at.tip[i] - target[i], 0.0, 0.0, f"end-effector's {'xy'[i]}", "m") for i in axes]
        if point.rest:
            own = range(self.model.n) if contact else self.moving
            rows += [(at.qd[i], 0.0, 0.0, f"rest of joint {i + 1}", f"{unit[i]}/s") for i in own]
        elif point.tip_rest:
            rows += [(at.tip_rate[i], 0.0, 0.0, f"rest of the end-effector's {'xy'[i]}", "m/s") for i in axes]
        return rows


def _entries(rows: NDArray[np.int64], columns: NDArray[np.int64], values: Array) -> tuple[Array, ...]:
    """Row, column and value of each entry, of arrays that broadcast to one shape."""
    return tuple(a.ravel() for a in np.broadcast_arrays(rows, columns, values))


def _rows(rows: Sequence[Row], count: int) -> dict[str, Any]:
    """The fields of a block that describe its rows."""
    lower, upper = ([row[k] for row in rows] for k in (1, 2))
    return {
        "rows": ca.vertcat(*(row[0] for row in rows)) if rows else NONE,
        "lower": np.tile(np.array(lower, dtype=float), (count, 1)),
        "upper": np.tile(np.array(upper, dtype=float), (count, 1)),
        "what": tuple((row[3], row[4]) for row in rows),
    }
