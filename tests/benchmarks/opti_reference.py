"""The paper's two scenarios in CasADi's Opti, written by hand on other people's inverse dynamics.

The same unknowns, nodes, cost and constraints again; derivatives are CasADi's own, exact, and the solver is IPOPT.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from by_hand import STIFFNESS_UNIT, Laws, Solved, downwards, places, rates

from runtime.arrays import Array
from runtime.planning.program import Program, bernstein
from runtime.planning.scenario import PhasePlan, Point
from runtime.planning.task import CLEAR_OF_SINGULAR
from symbolic.model_file.arm import Arm

IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-6, "max_iter": 1000}


class OptiByHand:
    """A periodic scenario as an Opti problem; rnea: tau of q, qd, qdd of the arm of four revolute joints.

    Opti calls the functions of an instant node by node. Its option `expand`, one scalar expression of the whole, is
    no quicker for scenario 1 and takes twice as long for scenario 2.
    """

    def __init__(self, program: Program, arm: Arm, rnea: ca.Function, width: float) -> None:
        self.program, self.scenario, self.rnea = program, program.task.scenario, rnea
        self.lengths = list(arm.lengths)
        self.laws = Laws(ca, program, width)
        self._contact = any(plan.kind == "contact" for plan in self.scenario.phases)
        opti = self.opti = ca.Opti()
        free = program.task.unknowns.free
        self._points = [opti.variable(len(f), p.degree + 1) for f, p in zip(free, self.scenario.phases, strict=True)]
        self._springs = opti.variable(2 * len(self.scenario.springs)) if self.scenario.springs else ca.MX(0, 1)
        opti.minimize(sum(self._along(k) for k in range(len(self.scenario.phases))))
        for k in range(len(self.scenario.phases)):
            self._between(k - 1, k)
        for k, spring in enumerate(self.scenario.springs):
            low, high = np.array(spring.sought["stiffness"]) / STIFFNESS_UNIT
            opti.subject_to(opti.bounded(low, self._springs[2 * k], high))
            opti.subject_to(
                opti.bounded(spring.sought["offset"][0], self._springs[2 * k + 1], spring.sought["offset"][1])
            )

    # --- one instant ---

    def _joints(self, phase: int, c: ca.SX, cd: ca.SX, cdd: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """q, qd, qdd from the free coordinates and their derivatives by time."""
        own, n = self.program.task.unknowns.free[phase], self.program.task.model.n
        x = [c[own.index(i)] if i in own else self.scenario.posture[i] for i in range(n)]
        q = ca.vertcat(*x) if self.scenario.phases[phase].kind == "free" else self._inverse(x[1:])
        qd = ca.jtimes(q, c, cd)
        return q, qd, ca.jtimes(qd, c, cd) + ca.jtimes(qd, cd, cdd)

    def _inverse(self, w: Sequence[ca.SX]) -> ca.SX:
        """The joints of (13) from w_2 to w_4; w_1 is the plate's place."""
        a, b, third, fourth = self.lengths
        y, angle, last = w
        x = float(self.program.task.model.contact["x"]) - third * ca.cos(angle) - fourth * ca.cos(angle + last)
        q2 = self.scenario.elbow * ca.acos((x**2 + y**2 - a**2 - b**2) / (2 * a * b))
        q1 = ca.atan2(y, x) - ca.atan2(b * ca.sin(q2), a + b * ca.cos(q2))
        return ca.vertcat(q1, q2, angle - q1 - q2, last)

    @cached_property
    def _tip(self) -> ca.Function:
        """x and y of the end-effector, and their derivative by q."""
        q = ca.SX.sym("q", len(self.lengths))
        angles = ca.vertsplit(ca.cumsum(q))
        x = sum(length * ca.cos(a) for length, a in zip(self.lengths, angles, strict=True))
        y = sum(length * ca.sin(a) for length, a in zip(self.lengths, angles, strict=True))
        tip = ca.vertcat(x, y)
        return ca.Function("tip", [q], [tip, ca.jacobian(tip, q)])

    def _effort(self, phase: int, q: ca.SX, qd: ca.SX, qdd: ca.SX, springs: ca.SX) -> ca.SX:
        """Squared torque that counts."""
        tau = self.rnea(q, qd, qdd)
        if self.scenario.friction:
            tau += self.laws.friction(qd)
        for k, spring in enumerate(self.scenario.springs):
            i = spring.joint - 1
            tau[i] += self.laws.spring(k, q[i], springs[2 * k], springs[2 * k + 1])
        if self.scenario.phases[phase].kind == "contact":
            tip, J = self._tip(q)
            tau -= J[1, :].T * self.laws.plate(tip[1], J[1, :] @ qd)
        return ca.sumsqr(tau[[j - 1 for j in self.scenario.objective.joints or self.scenario.moving]])

    def _limits(self, phase: int, q: ca.SX, qd: ca.SX) -> list[tuple[ca.SX, float, float]]:
        plan = self.scenario.phases[phase]
        tip, J = self._tip(q)
        rows = [(qd[j - 1], *rates(self.program, plan, j - 1)) for j in self.scenario.moving]
        rows += [(q[i], *span) for i, span in places(self.program, plan).items()]
        if plan.kind == "contact":
            rows.append((self.scenario.elbow * ca.sin(q[1]), CLEAR_OF_SINGULAR, np.inf))
            if plan.monotone:
                rows.append((downwards(self.program, plan) * (J[1, :] @ qd), 0.0, np.inf))
        elif self._contact:
            rows.append((tip[1] - self.laws.plate_at, 0.0, np.inf))
        return rows

    # --- the whole ---

    def _sampled(self, phase: int, s: Array, order: int) -> list[ca.MX]:
        plan: PhasePlan = self.scenario.phases[phase]
        T = self.scenario.cycle_time * plan.part
        return [self._points[phase] @ (bernstein(plan.degree, s, d).T / T**d) for d in range(order + 1)]

    def _along(self, phase: int) -> ca.MX:
        """The cost of a phase; its limits are put into the problem."""
        plan = self.scenario.phases[phase]
        nodes, weights = np.polynomial.legendre.leggauss(self.program.nodes(plan.degree))
        inputs = [ca.SX.sym(name, self._points[phase].shape[0]) for name in ("c", "cd", "cdd")]
        springs = ca.SX.sym("springs", self._springs.shape[0])
        q, qd, qdd = self._joints(phase, *inputs)
        limits = self._limits(phase, q, qd)
        at = ca.Function(
            "at",
            [*inputs, springs],
            [self._effort(phase, q, qd, qdd, springs), ca.vertcat(*(row[0] for row in limits))],
        )
        many = ca.repmat(self._springs, 1, len(nodes))
        effort, rows = at.map(len(nodes))(*self._sampled(phase, (nodes + 1) / 2, 2), many)
        for i, (_, low, high) in enumerate(limits):
            self.opti.subject_to(self.opti.bounded(low, rows[i, :], high))
        return effort @ (weights / 2) * self.scenario.cycle_time * plan.part

    def _end(self, phase: int, s: float) -> tuple[ca.Function, list[ca.MX]]:
        """q, qd, the tip and its rate as a function of what is sampled at an end."""
        inputs = [ca.SX.sym(name, self._points[phase].shape[0]) for name in ("c", "cd")]
        q, qd, _ = self._joints(phase, *inputs, ca.SX.zeros(inputs[0].shape[0]))
        tip, J = self._tip(q)
        end = ca.Function("end", inputs, [q, qd, tip, J @ qd])
        return end, self._sampled(phase, np.array([s]), 1)

    def _between(self, before: int, after: int) -> None:
        sides = [self._end(before, 1.0), self._end(after, 0.0)]
        kinds = [self.scenario.phases[k].kind for k in (before, after)]
        if kinds == ["contact", "contact"]:
            jumps: list[Any] = [a - b for a, b in zip(sides[0][1], sides[1][1], strict=True)]
        else:
            joints = [j - 1 for j in self.scenario.moving]
            ends = [function(*sampled)[:2] for function, sampled in sides]
            jumps = [a[joints] - b[joints] for a, b in zip(*ends, strict=True)]
        for jump in jumps:
            self.opti.subject_to(jump == 0)
        chosen = 1 if kinds == ["free", "contact"] else 0
        point = self.scenario.points[self.scenario.phases[after].start]
        self._asked(point, *sides[chosen], "contact" in kinds)

    def _asked(self, point: Point, function: ca.Function, sampled: list[ca.MX], contact: bool) -> None:
        q, qd, tip, tip_rate = function(*sampled)
        axes = [1] if contact else [0, 1]
        for joint, value in point.q.items():
            self.opti.subject_to(q[joint - 1] == value)
        if point.tip is not None:
            self.opti.subject_to(tip[axes] == np.array(point.tip)[axes])
        if point.rest:
            self.opti.subject_to(qd[[j - 1 for j in self.scenario.moving]] == 0)
        elif point.tip_rest:
            self.opti.subject_to(tip_rate[axes] == 0)

    def _begin(self, x: Array) -> None:
        u = self.program.task.unknowns
        for k, points in enumerate(self._points):
            self.opti.set_initial(points, np.array([x[u.points(k, row)] for row in range(points.shape[0])]))
        for k in range(len(self.scenario.springs)):
            self.opti.set_initial(self._springs[2 * k : 2 * k + 2], x[u.spring(k)])

    def rows(self, x: Array) -> tuple[float, Array, Array, Array]:
        """Cost, constraints, and their lower and upper bounds at unknowns x (nx,), in the order of the program's."""
        self._begin(x)
        here = self.opti.initial()
        f, g, lower, upper = (
            self.opti.debug.value(e, here) for e in (self.opti.f, self.opti.g, self.opti.lbg, self.opti.ubg)
        )
        return float(f), *(np.asarray(part, dtype=float).ravel() for part in (g, lower, upper))

    def solve(self, x: Array, cap: float) -> Solved:
        """From unknowns x (nx,), in the order of the program's."""
        self._begin(x)
        way: list[tuple[float, Array]] = []
        self.opti.callback(lambda _: way.append((time.process_time() - cpu, self._found(x))))
        self.opti.solver("ipopt", {"print_time": False, "show_eval_warnings": False}, {**IPOPT, "max_cpu_time": cap})
        wall, cpu = time.perf_counter(), time.process_time()
        # Opti says in this way that IPOPT gave up; what it had then counts.
        with suppress(RuntimeError):
            self.opti.solve()
        found = self._found(x)
        wall, busy = time.perf_counter() - wall, time.process_time() - cpu
        stats = self.opti.stats()
        says = str(stats["return_status"])
        stopped = says == "Maximum_CpuTime_Exceeded"
        return Solved(found, wall, busy, int(stats["iter_count"]), stopped, says, (*way, (busy, found)))

    def _found(self, x: Array) -> Array:
        u, found = self.program.task.unknowns, np.zeros(len(x))
        for k, points in enumerate(self._points):
            for row, values in enumerate(np.atleast_2d(self.opti.debug.value(points))):
                found[u.points(k, row)] = values
        for k in range(len(self.scenario.springs)):
            found[u.spring(k)] = self.opti.debug.value(self._springs)[2 * k : 2 * k + 2]
        return found
