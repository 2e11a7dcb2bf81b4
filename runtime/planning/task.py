"""A scenario for an arm as expressions of one instant: the cost of its torque, and the constraints on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import sqrt

import casadi as ca
import numpy as np

from runtime.arrays import Array
from runtime.model import casadi_functions
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.planning.blocks import Expression, Row
from runtime.planning.physics import Physics, PlanInstant, direction_rows, target_frame
from runtime.planning.scenario import PhasePlan, Point, Scenario, SoughtSpring, sought

CLEAR_OF_SINGULAR = 0.05
"""Least |sin q_2| in contact: at zero J_w is singular."""
INF = float("inf")
NONE = ca.SX(0, 1)


def limit_label(what: str, i: int) -> str:
    """Label of the row that limits a position, speed or torque of joint i (0-based)."""
    return f"{what} of joint {i + 1}"


@dataclass(frozen=True)
class Parameters:
    """The vector p of a program by name: what changes from one solution to the next without a new program."""

    symbol: ca.SX
    place: Mapping[str, slice]

    @classmethod
    def of(cls, sizes: Mapping[str, int]) -> Parameters:
        """Symbols for parameters of these sizes, one after another."""
        ends = np.cumsum([0, *sizes.values()])
        place = {name: slice(int(a), int(b)) for name, (a, b) in zip(sizes, pairwise(ends), strict=True)}
        return cls(ca.SX.sym("p", int(ends[-1])), place)

    def __call__(self, name: str) -> ca.SX:
        return self.symbol[self.place[name]]

    def vector(self, values: Mapping[str, Sequence[float]]) -> Array:
        """(P,) the values of all parameters."""
        found = np.full(self.symbol.numel(), np.nan)
        for name, place in self.place.items():
            found[place] = values[name]
        return found


@dataclass(frozen=True)
class Unknowns:
    """Layout of x: control points phase by phase and coordinate by coordinate, springs, the peak.

    free   by phase: coordinates (0-based) that are sought; the others are constant
    """

    scenario: Scenario
    free: tuple[tuple[int, ...], ...]

    @cached_property
    def _starts(self) -> list[int]:
        sizes = [len(free) * (p.degree + 1) for free, p in zip(self.free, self.scenario.phases, strict=True)]
        return np.cumsum([0, *sizes]).tolist()

    def points(self, phase: int, row: int) -> slice:
        """Control points of the row-th free coordinate of a phase."""
        count = self.scenario.phases[phase].degree + 1
        first = self._starts[phase] + row * count
        return slice(first, first + count)

    @property
    def motion(self) -> int:
        """Number of unknowns of the motion; springs and the peak follow."""
        return self._starts[-1]

    def spring(self, k: int) -> slice:
        """Unknowns of the k-th spring, over their parameters' scales."""
        first = self._starts[-1] + sum(self.spring_sizes[:k])
        return slice(first, first + self.spring_sizes[k])

    @cached_property
    def spring_sizes(self) -> tuple[int, ...]:
        """Number of unknowns of each spring."""
        return tuple(len(spring.sought) for spring in self.scenario.springs)

    @property
    def peak(self) -> int:
        """Index of the largest torque over its limit, if the objective is that."""
        return self._starts[-1] + sum(self.spring_sizes)

    @cached_property
    def size(self) -> int:
        """Number of unknowns."""
        return self.peak + (self.scenario.objective.goal == "peak_torque")


@dataclass(frozen=True)
class Task:
    """A scenario for an arm. Solutions may differ in p: cycle time, targets, parameters of effects and of the arm."""

    model: Model
    scenario: Scenario

    # --- unknowns and parameters ---

    @cached_property
    def physics(self) -> Physics:
        return Physics.of(self.model, self.scenario)

    @cached_property
    def springs(self) -> tuple[SoughtSpring, ...]:
        return sought(self.model, self.scenario)

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """0-based."""
        return tuple(j - 1 for j in self.scenario.moving)

    @cached_property
    def _counted(self) -> list[int]:
        """0-based."""
        return [j - 1 for j in self.scenario.counted]

    @cached_property
    def unknowns(self) -> Unknowns:
        free = tuple(self.moving if p.kind == "free" else (1, 2, 3) for p in self.scenario.phases)
        return Unknowns(self.scenario, free)

    @cached_property
    def _targets(self) -> dict[str, list[float]]:
        points = self.scenario.points.items()
        places = {f"tip {name}": list(point.tip) for name, point in points if point.tip is not None}
        frames = {f"frame {name}": target_frame(point) for name, point in points}
        return places | {name: R.ravel(order="F").tolist() for name, R in frames.items() if R is not None}

    @cached_property
    def p(self) -> Parameters:
        own = {"duration": len(self.scenario.phases), "plate x": 1, "share": len(self._counted)}
        return Parameters.of({**self.physics.sizes, **own, **{name: len(v) for name, v in self._targets.items()}})

    def values(self, width: float, share: float = 1.0) -> dict[str, list[float]]:
        """Values of p; width of the smooth switches, rad/s.

        share   of the squared torque of sprung joints that counts; less than 1 while their springs are unknown
        """
        s = self.scenario
        sprung = {spring.joint - 1 for spring in s.springs}
        x = 0.0 if self.model.contact is None else float(self.model.contact["x"])
        own = {
            "duration": [s.cycle_time * phase.part for phase in s.phases],
            "plate x": [x],
            "share": [share if i in sprung else 1.0 for i in self._counted],
        }
        return {**self.physics.values(width), **own, **self._targets}

    # --- one instant, seen from one phase ---

    def _coordinates(self, phase: int, free: Sequence[ca.SX]) -> ca.SX:
        if self.scenario.phases[phase].kind == "contact":
            return ca.vertcat(self.p("plate x"), *free)
        given = dict(zip(self.unknowns.free[phase], free, strict=True))
        return ca.vertcat(*(given.get(i, ca.SX(q)) for i, q in enumerate(self.scenario.posture)))

    def _rates(self, phase: int, free: ca.SX) -> ca.SX:
        given = dict(zip(self.unknowns.free[phase], ca.vertsplit(free), strict=True))
        return ca.vertcat(*(given.get(i, ca.SX(0)) for i in range(self.model.n)))

    def _instant(self, phase: int, c: Sequence[ca.SX], springs: Mapping[Term, ca.SX]) -> PlanInstant:
        """c: free coordinates and their first and second derivatives by the phase's s in [0, 1]."""
        T = self.p("duration")[phase]
        at = self._coordinates(phase, ca.vertsplit(c[0]))
        v, a = self._rates(phase, c[1] / T), self._rates(phase, c[2] / T**2)
        if self.scenario.phases[phase].kind == "free":
            return PlanInstant(self.physics, at, v, qdd=a, springs=springs, p=self.p, apart=self._kept_off)
        struct = self.p("struct")
        q = casadi_functions.arm_function(self.model, "contact_inverse")(struct, at, self.scenario.elbow)
        solve = casadi_functions.arm_function(self.model, "contact_acceleration")
        # b_w is zero without rates, so that accelerations and rates have the same map.
        qd = solve(struct, q, ca.SX.zeros(self.model.n), v)
        return PlanInstant(self.physics, q, qd, qdd=solve(struct, q, qd, a), springs=springs, p=self.p, apart=False)

    # --- along a phase ---

    @cached_property
    def along(self) -> tuple[Expression, ...]:
        """Cost and path constraints of each phase. z: free coordinates, their first and second derivatives by the
        phase's s, springs, and the peak if that is the objective."""
        return tuple(self._along(phase) for phase in range(len(self.scenario.phases)))

    def _along(self, phase: int) -> Expression:
        k, springs = len(self.unknowns.free[phase]), sum(self.unknowns.spring_sizes)
        peak = self.scenario.objective.goal == "peak_torque"
        z = ca.SX.sym("z", 3 * k + springs + peak)
        ends = np.cumsum([3 * k, *self.unknowns.spring_sizes]).tolist()
        unknowns = [ca.vertsplit(z[a:b]) for a, b in pairwise(ends)]
        own = {s.term: ca.vertcat(*s.values(x).values()) for s, x in zip(self.springs, unknowns, strict=True)}
        at = self._instant(phase, (z[:k], z[k : 2 * k], z[2 * k : 3 * k]), own)
        rows = self._path(phase, at) + (self._below_peak(at, z[-1]) if peak else [])
        duration = self.p("duration")[phase]
        return Expression.of(z, self.p.symbol, self._cost(at) * duration, self._squares(at) * ca.sqrt(duration), rows)

    @cached_property
    def peak(self) -> Expression:
        """The largest torque over its limit, an unknown, as the cost."""
        z = ca.SX.sym("z")
        return Expression.of(z, self.p.symbol, z, NONE, [])

    def _cost(self, at: PlanInstant) -> ca.SX:
        if self.scenario.objective.goal != "positive_work":
            return ca.SX(0)
        power = [at.torque[i] * at.qd[i] for i in self._counted]
        return ca.sum(ca.vertcat(*(ca.fmax(w, 0) for w in power)))

    def _squares(self, at: PlanInstant) -> ca.SX:
        """(k,) whose squares are cost per time."""
        goal, resistance = self.scenario.objective.goal, self.scenario.objective.resistance
        if goal == "electrical_energy":
            # W per squared torque: R/k².
            loss = [resistance[i + 1] / (self.model.joints[i].torque_constant or 1.0) ** 2 for i in self._counted]
            return ca.vertcat(*(sqrt(w) * at.torque[i] for w, i in zip(loss, self._counted, strict=True)))
        own = at.torque[self._counted] * ca.sqrt(self.p("share"))
        return own if goal == "torque_squared" else NONE

    def _below_peak(self, at: PlanInstant, peak: ca.SX) -> list[Row]:
        found: list[Row] = []
        for i in self._counted:
            part = at.torque[i] / (self.model.joints[i].torque_limit or 1.0)
            found += [(part - peak, -INF, 0.0, f"torque of joint {i + 1} below the peak", "1")]
            found += [(part + peak, 0.0, INF, f"torque of joint {i + 1} below the peak", "1")]
        return found

    def _path(self, phase: int, at: PlanInstant) -> list[Row]:
        """Constraints at every instant of a phase."""
        plan = self.scenario.phases[phase]
        rows: list[Row] = []
        for i in self.moving if plan.kind == "free" else range(self.model.n):
            info = self.model.joints[i]
            unit = info.position_unit
            low, high = self._speeds(plan, i)
            if low > -INF or high < INF:
                rows.append((at.qd[i], low, high, limit_label("speed", i), f"{unit}/s"))
            span = self.span(i)
            if span is not None:
                rows.append((at.q[i], *span, limit_label("position", i), unit))
            if info.torque_limit is not None:
                limit = info.torque_limit
                rows.append((at.torque[i], -limit, limit, limit_label("torque", i), info.force_unit))
        if plan.kind == "contact":
            rows.append((self.scenario.elbow * ca.sin(at.q[1]), CLEAR_OF_SINGULAR, INF, "distance from q_2 = 0", "1"))
            start, end = (self.scenario.points[name].tip for name in (plan.start, plan.end))
            way = 0.0 if start is None or end is None else float(np.sign(end[1] - start[1]))
            if plan.monotone and way:
                rows.append((way * at.tip_rate[1], 0.0, INF, "end-effector must not turn back", "m/s"))
        elif self._kept_off:
            above = at.tip[1] - self.physics.plate_position(self.p)
            rows.append((above, 0.0, INF, "end-effector above the plate", "m"))
        return rows

    def span(self, i: int) -> tuple[float, float] | None:
        """Allowed positions of joint i (0-based): its limits, and the scenario's narrower range."""
        ends = [e for e in (self.model.joints[i].position_limits, self.scenario.ranges.get(i + 1)) if e is not None]
        return (max(low for low, _ in ends), min(high for _, high in ends)) if ends else None

    @property
    def _kept_off(self) -> bool:
        return any(plan.kind == "contact" for plan in self.scenario.phases)

    def _speeds(self, plan: PhasePlan, i: int) -> tuple[float, float]:
        """Allowed speeds of joint i (0-based)."""
        limit = self.model.joints[i].speed_limit or INF
        start, end = (self.scenario.points[name].q.get(i + 1) for name in (plan.start, plan.end))
        if plan.monotone and plan.kind == "free" and start is not None and end is not None and start != end:
            return (0.0, limit) if end > start else (-limit, 0.0)
        return -limit, limit

    # --- between phases ---

    def junction(self, before: int | None, after: int | None) -> Expression:
        """Continuity of position and rate between two phases, and what the point between them requires.

        z: free coordinates and their derivatives by s at the end of one phase, then at the beginning of the other.
        """
        sides = [phase for phase in (before, after) if phase is not None]
        free = [len(self.unknowns.free[phase]) for phase in sides]
        z = ca.SX.sym("z", 2 * sum(free))
        parts = ca.vertsplit(z, np.cumsum([0, *(2 * k for k in free)]).tolist())
        seen = [
            self._instant(phase, (part[:k], part[k:], ca.SX.zeros(k)), {})
            for phase, part, k in zip(sides, parts, free, strict=True)
        ]
        rows = self._continuity(sides, seen, parts) if len(seen) == 2 else []
        phases, name = self.scenario.phases, self.point_between(before, after)
        # A point's constraints are set once, on the side of a contact phase, where the plate fixes a part of them.
        chosen = max(range(len(seen)), key=lambda k: phases[sides[k]].kind == "contact")
        rows += self._required(name, seen[chosen], phases[sides[chosen]].kind == "contact")
        return Expression.of(z, self.p.symbol, ca.SX(0), NONE, rows)

    def point_between(self, before: int | None, after: int | None) -> str:
        """Its name."""
        return self.scenario.phases[after].start if after is not None else self.scenario.phases[before or 0].end

    def _continuity(self, sides: Sequence[int], seen: Sequence[PlanInstant], parts: Sequence[ca.SX]) -> list[Row]:
        before, after = sides
        kinds = {self.scenario.phases[k].kind for k in sides}
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

    def _required(self, name: str, at: PlanInstant, contact: bool) -> list[Row]:
        """What a point requires."""
        point: Point = self.scenario.points[name]
        unit = {i: joint.position_unit for i, joint in enumerate(self.model.joints)}
        rows: list[Row] = [
            (at.q[j - 1] - q, 0.0, 0.0, limit_label("position", j - 1), unit[j - 1]) for j, q in point.q.items()
        ]
        # In contact the end-effector's x is that of the plate's axis.
        axes = (1,) if contact else range(3 if self.model.spatial else 2)
        if point.tip is not None:
            target = self.p(f"tip {name}")
            rows += [(at.tip[i] - target[i], 0.0, 0.0, f"end-effector's {'xyz'[i]}", "m") for i in axes]
        if point.directed:
            rows += direction_rows(point, at.tip_rotation, self.p(f"frame {name}"))
        if point.rest:
            own = range(self.model.n) if contact else self.moving
            rows += [(at.qd[i], 0.0, 0.0, f"rest of joint {i + 1}", f"{unit[i]}/s") for i in own]
        elif point.tip_rest:
            rows += [(at.tip_rate[i], 0.0, 0.0, f"rest of the end-effector's {'xyz'[i]}", "m/s") for i in axes]
        return rows
