"""The paper's two scenarios written down by hand, as its readers do: for SciPy's solvers, with finite differences.

The same unknowns, nodes, cost and constraints as Tendon's program, which a test compares. What is evaluated is quick:
compiled batch kernels for the arm, NumPy over all nodes at once for the rest, one evaluation for cost and constraints.
"""

from __future__ import annotations

import time
import warnings
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, minimize

from runtime.arrays import Array
from runtime.model.terms import Term, structure
from runtime.planning.program import Program, bernstein
from runtime.planning.scenario import PhasePlan
from runtime.planning.task import CLEAR_OF_SINGULAR

STIFFNESS_UNIT = 1000.0
"""N/m, in which a program counts stiffnesses."""


@dataclass(frozen=True)
class Laws:
    """Friction (4), springs (2) and the plate (3) with switches of a width (rad/s, m/s); xp: numpy or casadi."""

    xp: Any
    program: Program
    width: float

    def _sign(self, x: Any, width: float) -> Any:
        s = self.xp.fmax(-1.0, self.xp.fmin(1.0, x / width))
        return s * (15.0 - 10.0 * s**2 + 3.0 * s**4) / 8.0

    def _step(self, x: Any, width: float) -> Any:
        return (1.0 + self._sign(x, width)) / 2.0

    def _ramp(self, x: Any, width: float) -> Any:
        s = self.xp.fmax(-1.0, self.xp.fmin(1.0, x / width))
        rounded = width * (5.0 + 15.0 * s**2 - 5.0 * s**4 + s**6) / 16.0
        return (x + rounded + self.xp.fmax(0.0, x - width) + self.xp.fmax(0.0, -x - width)) / 2.0

    @cached_property
    def _terms(self) -> dict[Term, dict[str, float]]:
        own = self.program.task.scenario.contact
        return {t: {**v, **own.get(t.effect, {})} for t, v in structure(self.program.task.model).items()}

    @cached_property
    def _dry(self) -> tuple[Array, Array, Array, Array]:
        """(n, 1) each: c_1 to c_4 of Table I."""
        names = ("coulomb_asymmetric", "positive"), ("coulomb_asymmetric", "negative")
        names += ("viscous", "coefficient"), ("viscous_cubic", "coefficient")
        joints = range(1, self.program.task.model.n + 1)
        return tuple(np.array([[self._terms[Term(effect, j)][key]] for j in joints]) for effect, key in names)

    def friction(self, qd: Any) -> Any:
        """Of all joints, (n, N)."""
        forwards, backwards, viscous, cubic = self._dry
        dry = forwards * self._step(qd, self.width) - backwards * self._step(-qd, self.width)
        return dry + viscous * qd + cubic * qd**3

    def spring(self, k: int, q: Any, stiffness: Any, offset: Any) -> Any:
        """stiffness in kN/m."""
        plan, width = self.program.task.scenario.springs[k], self.width / 50.0
        radius, pretension = plan.stated["radius"], plan.stated["pretension"]
        pull = radius**2 * STIFFNESS_UNIT * stiffness * self._ramp(offset - q, width)
        return -pull - radius * pretension * self._step(offset - q, width)

    @cached_property
    def plate_at(self) -> float:
        return self._terms[Term("plate")]["position"]

    def plate(self, y: Any, yd: Any) -> Any:
        """Force on the end-effector along y."""
        p, width = self._terms[Term("plate")], self.width / 50.0
        rubbed = (p["pretension"] - p["friction"] * self._sign(yd, self.width)) * self._step(p["position"] - y, width)
        return p["stiffness"] * self._ramp(p["position"] - y, width) + rubbed


def rates(program: Program, plan: PhasePlan, i: int) -> tuple[float, float]:
    """Bounds of a joint's (0-based) rate in a free phase or in contact."""
    limit = program.task.model.joints[i].speed_limit or np.inf
    ends = [program.task.scenario.points[name].q.get(i + 1) for name in (plan.start, plan.end)]
    if plan.monotone and plan.kind == "free" and None not in ends:
        return (0.0, limit) if ends[1] > ends[0] else (-limit, 0.0)
    return -limit, limit


def places(program: Program, plan: PhasePlan) -> dict[int, tuple[float, float]]:
    """Where the scenario keeps joints (0-based) in a phase: those that move there."""
    moved = program.task.scenario.moving if plan.kind == "free" else range(1, program.task.model.n + 1)
    return {j - 1: program.task.scenario.ranges[j] for j in moved if j in program.task.scenario.ranges}


def downwards(program: Program, plan: PhasePlan) -> float:
    """1 or -1: which way along y a contact phase goes."""
    start, end = (program.task.scenario.points[name].tip for name in (plan.start, plan.end))
    return float(np.sign(end[1] - start[1]))


@dataclass(frozen=True)
class _Sampled:
    """A phase at its nodes and, last, at its two ends: free coordinates c and rates cd, and the joints' motion."""

    c: Array
    cd: Array
    q: Array
    qd: Array
    qdd: Array


class ByHand:
    """Cost and constraints of a periodic scenario from the unknowns x (nx,), all in NumPy and compiled kernels."""

    def __init__(self, program: Program, width: float) -> None:
        self.program, self.model, self.scenario = program, program.task.model, program.task.scenario
        self.laws = Laws(np, program, width)
        self._sampling = [self._sampled(plan.degree) for plan in self.scenario.phases]
        self._touches = any(plan.kind == "contact" for plan in self.scenario.phases)
        # Finite differences of the cost and of the constraints ask for the same points.
        self._known: OrderedDict[bytes, tuple[float, Array, Array]] = OrderedDict()

    def _sampled(self, degree: int) -> tuple[Array, Array]:
        """(3, M + 1, N + 2) of positions and their derivatives by s, and weights (N + 2,), zero at the ends."""
        nodes, weights = np.polynomial.legendre.leggauss(self.program.nodes(degree))
        s = np.concatenate([(nodes + 1) / 2, [0.0, 1.0]])
        return np.array([bernstein(degree, s, d).T for d in range(3)]), np.concatenate([weights / 2, [0.0, 0.0]])

    def cost(self, x: Array) -> float:
        return self._evaluated(x)[0]

    def equalities(self, x: Array) -> Array:
        """Zero where continuity and points are met."""
        return self._evaluated(x)[1]

    def inequalities(self, x: Array) -> Array:
        """Not negative where limits are kept."""
        return self._evaluated(x)[2]

    def violation(self, x: Array) -> float:
        """The largest miss of a constraint, in its own unit."""
        _, equal, above = self._evaluated(x)
        return float(max(np.abs(equal).max(), (-above).max(initial=0.0)))

    def _evaluated(self, x: Array) -> tuple[float, Array, Array]:
        key = x.tobytes()
        if key not in self._known:
            self._known[key] = self._evaluate(x)
            if len(self._known) > 2 * len(x):
                self._known.popitem(last=False)
        return self._known[key]

    def _evaluate(self, x: Array) -> tuple[float, Array, Array]:
        phases = [self._phase(k, x) for k in range(len(self.scenario.phases))]
        q, qd, qdd = (np.concatenate([getattr(p, name) for p in phases], axis=1) for name in ("q", "qd", "qdd"))
        tau = self.model.inverse_dynamics(q, qd, qdd)
        if self.scenario.friction:
            tau += self.laws.friction(qd)
        for k, spring in enumerate(self.scenario.springs):
            own = x[self.program.task.unknowns.spring(k)]
            tau[spring.joint - 1] += self.laws.spring(k, q[spring.joint - 1], *own)
        if self._touches:
            row = self.model.tip_jacobian(q)[1]
            tau -= self._pressed * row * self.laws.plate(self.model.tip(q)[1], np.sum(row * qd, axis=0))
        counted = [j - 1 for j in self.scenario.objective.joints or self.scenario.moving]
        cost = float(np.sum(tau[counted] ** 2 @ self._weights))
        return cost, self._between(phases), self._along(phases)

    @cached_property
    def _pressed(self) -> Array:
        """1 at the samples of contact phases, 0 where the end-effector is kept above the plate."""
        touched = [float(plan.kind == "contact") for plan in self.scenario.phases]
        return np.concatenate([np.full(len(w), t) for (_, w), t in zip(self._sampling, touched, strict=True)])

    @cached_property
    def _weights(self) -> Array:
        parts = [plan.part for plan in self.scenario.phases]
        sampled = zip(self._sampling, parts, strict=True)
        return np.concatenate([w * self.scenario.cycle_time * part for (_, w), part in sampled])

    def _phase(self, k: int, x: Array) -> _Sampled:
        plan, u = self.scenario.phases[k], self.program.task.unknowns
        T = self.scenario.cycle_time * plan.part
        points = np.array([x[u.points(k, row)] for row in range(len(u.free[k]))])
        c, cd, cdd = (points @ basis / T**d for d, basis in enumerate(self._sampling[k][0]))
        q, qd, qdd = (np.zeros((self.model.n, c.shape[1])) for _ in range(3))
        q[:] = np.array(self.scenario.posture)[:, None]
        for whole, own in ((q, c), (qd, cd), (qdd, cdd)):
            whole[list(u.free[k])] = own
        if plan.kind == "free":
            return _Sampled(c, cd, q, qd, qdd)
        q[0] = self.model.contact["x"]
        at = self.model.contact_inverse(q, self.scenario.elbow)
        rate = self.model.contact_acceleration(at, np.zeros_like(at), qd)
        return _Sampled(c, cd, at, rate, self.model.contact_acceleration(at, rate, qdd))

    def _between(self, phases: list[_Sampled]) -> Array:
        rows: list[Array] = []
        for after in range(len(phases)):
            before = after - 1
            kinds = [self.scenario.phases[k].kind for k in (before, after)]
            end, begin = phases[before], phases[after]
            if kinds == ["contact", "contact"]:
                rows += [end.c[:, -1] - begin.c[:, -2], end.cd[:, -1] - begin.cd[:, -2]]
            else:
                joints = [j - 1 for j in self.scenario.moving]
                rows += [end.q[joints, -1] - begin.q[joints, -2], end.qd[joints, -1] - begin.qd[joints, -2]]
            chosen = (begin, -2) if kinds[1] == "contact" and kinds[0] == "free" else (end, -1)
            rows += self._asked(self.scenario.phases[after].start, *chosen, "contact" in kinds)
        return np.concatenate(rows)

    def _asked(self, name: str, side: _Sampled, at: int, contact: bool) -> list[Array]:
        point = self.scenario.points[name]
        q, qd = side.q[:, at], side.qd[:, at]
        axes = [1] if contact else [0, 1]
        rows = [np.array([q[j - 1] - value for j, value in point.q.items()])]
        if point.tip is not None:
            rows.append((self.model.tip(q)[:2] - point.tip)[axes])
        if point.rest:
            rows.append(qd[[j - 1 for j in self.scenario.moving]])
        elif point.tip_rest:
            rows.append((self.model.tip_jacobian(q)[:2] @ qd)[axes])
        return rows

    def _along(self, phases: list[_Sampled]) -> Array:
        rows: list[Array] = []
        for plan, sampled in zip(self.scenario.phases, phases, strict=True):
            q, qd = sampled.q[:, :-2], sampled.qd[:, :-2]
            for i in [j - 1 for j in self.scenario.moving]:
                low, high = rates(self.program, plan, i)
                rows += [qd[i] - low, high - qd[i]]
            for i, (low, high) in places(self.program, plan).items():
                rows += [q[i] - low, high - q[i]]
            if plan.kind == "contact":
                rows.append(self.scenario.elbow * np.sin(q[1]) - CLEAR_OF_SINGULAR)
                yd = np.sum(self.model.tip_jacobian(q)[1] * qd, axis=0)
                rows += [downwards(self.program, plan) * yd] if plan.monotone else []
            elif self._touches:
                rows.append(self.model.tip(q)[1] - self.laws.plate_at)
        return np.concatenate(rows)


@dataclass(frozen=True)
class Solved:
    """x (nx,) where a solver ended; stopped: it was not done when its time was over; way: processor time, s, at which
    it was at which x."""

    x: Array
    seconds: float
    cpu: float
    iterations: int
    stopped: bool
    says: str
    way: tuple[tuple[float, Array], ...]


class _Over(Exception):
    pass


def scipy_solution(
    program: Program, width: float, method: str, x: Array, bounds: tuple[Array, Array], cap: float
) -> Solved:
    """SLSQP or trust-constr with SciPy's own finite differences; cap: s of processor time after which it is stopped."""
    wall, cpu = time.perf_counter(), time.process_time()
    problem = ByHand(program, width)
    way: list[tuple[float, Array]] = []

    def timed(evaluate: Callable[[Array], Any]) -> Callable[[Array], Any]:
        def run(x: Array) -> Any:
            if time.process_time() - cpu > cap:
                raise _Over
            return evaluate(x)

        return run

    def note(x: Array, *_: Any) -> None:
        way.append((time.process_time() - cpu, x.copy()))

    cost, equal, above = (timed(f) for f in (problem.cost, problem.equalities, problem.inequalities))
    if method == "SLSQP":
        constraints: Any = [{"type": "eq", "fun": equal}, {"type": "ineq", "fun": above}]
        options: dict[str, Any] = {"maxiter": 1000, "ftol": 1e-6}
    else:
        constraints = [NonlinearConstraint(equal, 0.0, 0.0), NonlinearConstraint(above, 0.0, np.inf)]
        options = {"maxiter": 3000, "gtol": 1e-5, "xtol": 1e-8}
    start = np.clip(x, *bounds)
    try:
        with warnings.catch_warnings():  # trust-constr says so where two gradients are equal
            warnings.filterwarnings("ignore", "delta_grad == 0.0", UserWarning)
            limits = Bounds(*bounds)
            found = minimize(
                cost, start, method=method, bounds=limits, constraints=constraints, callback=note, options=options
            )
        last, says, stopped = found.x, str(found.message), False
    except _Over:
        last, says, stopped = way[-1][1] if way else start, f"stopped after {cap:g} s", True
    busy = time.process_time() - cpu
    return Solved(last, time.perf_counter() - wall, busy, len(way), stopped, says, (*way, (busy, last)))
