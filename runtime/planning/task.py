"""A scenario for an arm as expressions of one instant: what the torque costs there, and the constraints on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import sqrt

import casadi as ca
import numpy as np

from runtime.model import casadi_functions
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.planning.blocks import Expression, Row
from runtime.planning.direction import direction_rows, target_frame
from runtime.planning.physics import Physics, PlanInstant
from runtime.planning.scenario import PhasePlan, Point, Scenario
from runtime.planning.springs import SoughtSpring, sought
from runtime.planning.unknowns import Parameters, Unknowns

CLEAR_OF_SINGULAR = 0.05
"""Least |sin q_2| in contact: at zero J_w is singular."""
INF = float("inf")
NONE = ca.SX(0, 1)


def limit_label(what: str, i: int) -> str:
    """Of the row that limits a position, speed or torque of joint i (0-based)."""
    return f"{what} of joint {i + 1}"


@dataclass(frozen=True)
class Task:
    """What a scenario asks of an arm. Solutions may differ in p: cycle time, targets, effects, lumps, lengths."""

    model: Model
    scenario: Scenario

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
        points = self.scenario.points.items()
        targets = {f"tip {name}": len(point.tip) for name, point in points if point.tip is not None}
        targets |= {f"frame {name}": 9 for name, point in points if target_frame(point) is not None}
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
        frames = {f"frame {name}": target_frame(point) for name, point in s.points.items()}
        targets |= {name: frame.ravel(order="F").tolist() for name, frame in frames.items() if frame is not None}
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

    # --- along a phase ---

    @cached_property
    def along(self) -> tuple[Expression, ...]:
        """Of each phase: cost and path constraints. z: free coordinates and their first and second derivatives by the
        phase's s, springs, and the peak where that is the goal."""
        return tuple(self._along(phase) for phase in range(len(self.scenario.phases)))

    def _along(self, phase: int) -> Expression:
        k, springs = len(self.unknowns.free[phase]), sum(self.unknowns.spring_sizes)
        peak = self.scenario.objective.goal == "peak_torque"
        z = ca.SX.sym("z", 3 * k + springs + peak)
        at = self._instant(phase, z[:k], z[k : 2 * k], z[2 * k : 3 * k], self._springs(z[3 * k :]))
        rows = self._path(phase, at)
        if peak:
            rows += self._below_peak(at, z[-1])
        duration = self.p("duration")[phase]
        return Expression.of(z, self.p.symbol, self._cost(at) * duration, self._squares(at) * ca.sqrt(duration), rows)

    @cached_property
    def peak(self) -> Expression:
        """The largest torque over its limit, an unknown, as the cost."""
        z = ca.SX.sym("z")
        return Expression.of(z, self.p.symbol, z, NONE, [])

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

    def _path(self, phase: int, at: PlanInstant) -> list[Row]:
        plan = self.scenario.phases[phase]
        joints = self.moving if plan.kind == "free" else range(self.model.n)
        rows: list[Row] = []
        for i in joints:
            info = self.model.joints[i]
            unit = info.position_unit
            low, high = self._rates(plan, i)
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

    # --- between phases ---

    def junction(self, before: int | None, after: int | None) -> Expression:
        """Continuity of position and rate between two phases, and what is asked for at the point between them.

        z: free coordinates and their derivatives by s at the end of the one, then at the beginning of the other.
        """
        sides = [phase for phase in (before, after) if phase is not None]
        sizes = [2 * len(self.unknowns.free[phase]) for phase in sides]
        z = ca.SX.sym("z", sum(sizes))
        parts = ca.vertsplit(z, np.cumsum([0, *sizes]).tolist())
        seen = [self._at_end(phase, part) for phase, part in zip(sides, parts, strict=True)]
        rows: list[Row] = []
        if len(seen) == 2:
            rows += self._continuity(sides[0], sides[1], seen, parts)
        phases, name = self.scenario.phases, self.point_between(before, after)
        # A point is asked for once, on the side where the plate already gives a part of it.
        chosen = max(range(len(seen)), key=lambda k: phases[sides[k]].kind == "contact")
        rows += self._asked(self.scenario.points[name], name, seen[chosen], phases[sides[chosen]].kind == "contact")
        return Expression.of(z, self.p.symbol, ca.SX(0), NONE, rows)

    def point_between(self, before: int | None, after: int | None) -> str:
        """Its name."""
        return self.scenario.phases[after].start if after is not None else self.scenario.phases[before or 0].end

    def _at_end(self, phase: int, z: ca.SX) -> PlanInstant:
        k = len(self.unknowns.free[phase])
        return self._instant(phase, z[:k], z[k:], ca.SX.zeros(k), {})

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
            (at.q[j - 1] - q, 0.0, 0.0, limit_label("position", j - 1), unit[j - 1]) for j, q in point.q.items()
        ]
        # In contact the plate's axis has the end-effector's x already.
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
