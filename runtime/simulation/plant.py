"""The simulated arm: motors that hold a torque for a control period, encoders that count, everything between."""

from __future__ import annotations

from math import ceil

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.interruption import heard_in_casadi
from runtime.model.loader import Model
from runtime.model.terms import Structure
from runtime.simulation.plant_equations import RATE_WIDTH, PlantEquations, PlantError, PlantInstant
from runtime.simulation.settings import FINER, GROWTH, GROWTH_AT, STEP, WEIGHTLESS

Array = NDArray[np.float64]


class Plant:
    """An arm with `terms` (all values known), moved on by one control period after the other.

    Integrated by the classical Runge-Kutta method; effects with a memory by their own steps in between, which
    are exact where their signals stand still. Raises PlantError for what cannot be simulated forwards.

    q, qd   (n,) of the motors, by the gear ratio     t   s since `reset`
    """

    def __init__(self, model: Model, terms: Structure, period: float) -> None:
        self.model, self.terms, self.period = model, terms, period
        self._substeps = 0
        with heard_in_casadi():
            self._advance = self._period(self._stable_step(max(1, ceil(period / STEP - 1e-9))))
            self._rest = self._start_of(self._equations)
        self._state: Array = np.zeros(self._advance.size1_in(0))
        self._command: Array = np.zeros(model.n)
        # A call without copies or conversions.
        self._buffer, self._run = self._advance.buffer()
        for k, array in enumerate((self._state, self._command)):
            self._buffer.set_arg(k, memoryview(array))  # type: ignore[arg-type, call-arg]
        self._buffer.set_res(0, memoryview(self._state))  # type: ignore[arg-type, call-arg]
        self.reset(np.zeros(model.n))

    @property
    def q(self) -> Array:
        """(n,) rad or m, of the motors."""
        return self._state[: self.model.n]

    @property
    def qd(self) -> Array:
        """(n,) rad/s or m/s, of the motors."""
        return self._state[self.model.n : 2 * self.model.n]

    @property
    def t(self) -> float:
        """s since `reset`."""
        return float(self._state[-1])

    def reset(self, q: ArrayLike, qd: ArrayLike | None = None) -> None:
        """At q (n,) and t = 0; at rest, unless rates qd (n,) are given."""
        n = self.model.n
        self._state[:] = np.asarray(self._rest(np.asarray(q, dtype=np.float64))).ravel()
        if qd is not None:
            self._state[n : 2 * n] = qd

    def advance(self, torque: ArrayLike) -> None:
        """One control period with these torques (n,) held."""
        self._command[:] = torque
        self._run()

    def _stable_step(self, coarsest: int) -> ca.Function:
        """One step, in the fewest a control period with which nothing grows."""
        for substeps in FINER:
            one = self._stepping(substeps * coarsest)
            growth = self._growth(one)
            if _is_stable(growth):
                return one
        raise PlantError(self._too_stiff(growth))

    def _start_of(self, equations: PlantEquations) -> ca.Function:
        """The state of an arm that has stood at q."""
        n = self.model.n
        q, still = ca.SX.sym("q", n), ca.SX.zeros(n)
        # The motors begin without a torque.
        state = ca.vertcat(q, still, equations.at_rest(q), still, 0.0)
        return ca.Function("rest", [q], [state])

    def _stepping(self, substeps: int) -> ca.Function:
        """One step of so many in a control period."""
        self._substeps, self.step = substeps, self.period / substeps
        plain = PlantEquations(self.model, self.terms, [RATE_WIDTH] * self.model.n)
        self.widths = self._rate_widths(plain)
        wide = np.any(self.widths > RATE_WIDTH)
        self._equations = PlantEquations(self.model, self.terms, self.widths) if wide else plain
        return self._substep()

    def _growth(self, one: ca.Function) -> Array:
        """Derivative of the state after a step by that before it, close to rest."""
        state, command = ca.SX.sym("state", one.size1_in(0)), ca.SX.sym("command", self.model.n)
        derivative = ca.Function("derivative", [state, command], [ca.jacobian(one(state, command), state)])
        n = self.model.n
        begin = np.asarray(self._start_of(self._equations)(np.zeros(n))).ravel()
        # At rest itself, a bristle's law has a kink.
        begin[n : 2 * n] = GROWTH_AT * self.widths
        return np.asarray(derivative(begin, np.zeros(n)))

    def _too_stiff(self, growth: Array) -> str:
        """What to say where no step is short enough: of the joint that runs away."""
        n = self.model.n
        joints = list(range(n))
        if np.isfinite(growth).all():
            values, modes = np.linalg.eig(growth)
            joints = [int(np.argmax(np.abs(modes[n : 2 * n, np.argmax(np.abs(values))])))]
        effects = {term: self.model.library[term.effect] for term in self.terms}
        # Those of whose rates and deflections a high frequency can come.
        stiffening = [t for t, info in effects.items() if info.scope == "joint" and (info.rubs or info.side == "link")]
        suspects = [str(t) for t in stiffening if (t.joint or 1) - 1 in joints]
        known = [self.model.joints[i].rotor_inertia for i in joints]
        rotors = [f"joint {i + 1}: {'unknown' if j is None else j}" for i, j in zip(joints, known, strict=True)]
        return (
            f"{self.model.name}: the arm with these effects is too stiff for steps of {self.step:.2g} s; choose "
            f"smaller values of {', '.join(suspects)}, or a larger rotor_inertia ({', '.join(rotors)})"
        )

    def _period(self, one: ca.Function) -> ca.Function:
        state = ca.MX.sym("state", one.size1_in(0))
        command = ca.MX.sym("command", self.model.n)
        many = one.fold(self._substeps)
        return ca.Function("period", [state, command], [many(state, ca.repmat(command, 1, self._substeps))])

    def _substep(self) -> ca.Function:
        """State (q, rates, memory, acting torques, t) after one step under a command (n,)."""
        n, h, equations = self.model.n, self.step, self._equations
        q, v, before, command = (ca.SX.sym(name, n) for name in ("q", "v", "before", "command"))
        memory, t = ca.SX.sym("memory", equations.states), ca.SX.sym("t")
        acting = equations.acting(command, before, h, PlantInstant(q, v, ca.SX.zeros(n), t))
        slope, later = self._slope(), self._later()
        # Each stage with its own memory, stepped from the beginning along the stage before.
        a1 = slope(q, v, memory, acting, t)
        q2, v2 = q + h / 2 * v, v + h / 2 * a1
        m2 = later(q, v, a1, memory, t, h / 2)
        a2 = slope(q2, v2, m2, acting, t + h / 2)
        q3, v3 = q + h / 2 * v2, v + h / 2 * a2
        m3 = later(q2, v2, a2, memory, t + h / 2, h / 2)
        a3 = slope(q3, v3, m3, acting, t + h / 2)
        q4, v4 = q + h * v3, v + h * a3
        m4 = later(q3, v3, a3, memory, t + h / 2, h)
        a4 = slope(q4, v4, m4, acting, t + h)
        q5 = q + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v5 = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        state, after = ca.vertcat(q, v, memory, before, t), ca.vertcat(q5, v5, m4, acting, t + h)
        return ca.Function("substep", [state, command], ca.cse([after]))

    def _slope(self) -> ca.Function:
        """Accelerations of q, rates, memory, acting torques and time."""
        n, equations = self.model.n, self._equations
        q, v, acting = (ca.SX.sym(name, n) for name in ("q", "v", "acting"))
        memory, t = ca.SX.sym("memory", equations.states), ca.SX.sym("t")
        qdd = equations.acceleration(q, v, acting, t, memory)
        return ca.Function("slope", [q, v, memory, acting, t], ca.cse([qdd]))

    def _later(self) -> ca.Function:
        """Memory after dt of this motion."""
        n, equations = self.model.n, self._equations
        q, v, qdd = (ca.SX.sym(name, n) for name in ("q", "v", "qdd"))
        memory, t, dt = ca.SX.sym("memory", equations.states), ca.SX.sym("t"), ca.SX.sym("dt")
        after = equations.remember(PlantInstant(q, v, qdd, t), dt, memory)
        return ca.Function("later", [q, v, qdd, memory, t, dt], ca.cse([after]))

    def _rate_widths(self, equations: PlantEquations) -> Array:
        """(n,) rad/s: so wide that one step does not carry a joint across all of dry friction's slope."""
        n = self.model.n
        posture, still = np.zeros(n), np.zeros(n)
        memory = self._start_of(equations)(posture)[2 * n : 2 * n + equations.states]
        inertia = np.asarray(equations.balance(posture, still, still, 0.0, memory)[1])
        whole = np.diag(self.model.inertia(posture[:, None])[..., 0])
        weightless = [f"joint {i + 1}" for i in range(n) if not inertia[i, i] > WEIGHTLESS * whole[i]]
        if weightless:
            raise PlantError(
                f"{self.model.name}: nothing moves with the motor, in front of a transmission that gives way, at "
                f"{', '.join(weightless)}; state a rotor_inertia > 0 there"
            )
        dry = np.empty(n)
        for i, creep in enumerate(10 * RATE_WIDTH * np.eye(n)):
            ahead, back = (equations.balance(posture, s * creep, still, 0.0, memory)[0] for s in (1, -1))
            dry[i] = abs(float(ahead[i] - back[i])) / 2
        return np.maximum(RATE_WIDTH, self.step * dry * np.diag(np.linalg.inv(inertia)))


def _is_stable(growth: Array) -> bool:
    """Whether a step lets no disturbance grow by more than an arm can. growth: (S, S) derivative of the state after a
    step by that before it."""
    return bool(np.isfinite(growth).all() and np.abs(np.linalg.eigvals(growth)).max() < GROWTH)
