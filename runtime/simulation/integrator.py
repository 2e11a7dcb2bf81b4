"""An arm's equations integrated: the classical Runge-Kutta method, in steps that are short enough to be stable.

The states of effects take their generated steps, which are exact for constant signals.
"""

from __future__ import annotations

from math import ceil

import casadi as ca
import numpy as np

from runtime.arrays import Array
from runtime.model.loader import Model
from runtime.model.terms import Prediction
from runtime.simulation.equations import PlantEquations, PlantError, PlantInstant, check_forward
from runtime.simulation.settings import FINER, GROWTH, GROWTH_AT, RATE_WIDTH, STEP, WEIGHTLESS
from symbolic.model_file.arm import MOTOR_TORQUE, Torque


class Integrator:
    """Equations and steps for periods of `period` s. Raises PlantError.

    known     parameters, all of them numbers        torque  what the drives' torques are
    longest   s, of the steps, if stability allows it
    posture   (n,) at which stability is checked; an identified inertia may be wrong where no data are; None: zeros
    A state is q (n,), qd (n,), the memories of effects, the torques that act (n,), and the time.
    """

    def __init__(
        self,
        model: Model,
        known: Prediction,
        period: float,
        torque: Torque = MOTOR_TORQUE,
        longest: float = STEP,
        posture: Array | None = None,
    ) -> None:
        check_forward(model, {term: dict(values) for term, values in known.values.items()})
        self.model, self.known, self.torque, self.period = model, known, torque, period
        self.posture = np.zeros(model.n) if posture is None else posture
        coarsest = max(1, ceil(period / longest - 1e-9))
        for substeps in FINER:
            self.substeps, self.step = substeps * coarsest, period / (substeps * coarsest)
            self._choose_widths()
            self.one = runge_kutta(self.equations, self.step)
            growth = self._growth()
            if np.isfinite(growth).all() and np.abs(np.linalg.eigvals(growth)).max() < GROWTH:
                return
        raise PlantError(self._too_stiff(growth))

    def with_parameters(self, known: Prediction) -> PlantEquations:
        """The same equations with other parameters, numbers or expressions."""
        return PlantEquations(self.model, known, self.widths, self.torque)

    def rest(self, equations: PlantEquations | None = None) -> ca.Function:
        """The state of an arm at rest at q (n,)."""
        own, n = equations or self.equations, self.model.n
        q, still = ca.SX.sym("q", n), ca.SX.zeros(n)
        # The motors start without torque.
        return ca.Function("rest", [q], [ca.vertcat(q, still, own.at_rest(q), still, 0.0)])

    def _choose_widths(self) -> None:
        """Widths (n,) of dry friction in rad/s or m/s, at least such that one step does not cross the whole slope."""
        self.widths: Array = np.full(self.model.n, RATE_WIDTH)
        plain = self.with_parameters(self.known)
        self.widths = self._rate_widths(plain)
        self.equations = self.with_parameters(self.known) if np.any(self.widths > RATE_WIDTH) else plain

    def _growth(self) -> Array:
        """(S, S) derivative of the state after a step by the state before it, near rest."""
        state, command = ca.SX.sym("state", self.one.size1_in(0)), ca.SX.sym("command", self.model.n)
        after = self.one(state, command, ca.SX(0, 1))
        derivative = ca.Function("derivative", [state, command], [ca.jacobian(after, state)])
        n = self.model.n
        begin = np.asarray(self.rest()(self.posture)).ravel()
        # At rest, a bristle model is not differentiable.
        begin[n : 2 * n] = GROWTH_AT * self.widths
        return np.asarray(derivative(begin, np.zeros(n)))

    def _too_stiff(self, growth: Array) -> str:
        """The message if no step is short enough: the unstable joint and its stiff effects."""
        n, terms = self.model.n, self.known.values
        joints = list(range(n))
        if np.isfinite(growth).all():
            values, modes = np.linalg.eig(growth)
            joints = [int(np.argmax(np.abs(modes[n : 2 * n, np.argmax(np.abs(values))])))]
        effects = {term: self.model.library[term.effect] for term in terms}
        # Effects whose stiffness or damping can cause a high frequency.
        stiffening = [t for t, info in effects.items() if info.scope == "joint" and (info.rubs or info.side == "link")]
        suspects = [str(t) for t in stiffening if (t.joint or 1) - 1 in joints]
        rotor = [self.model.joints[i].rotor_inertia for i in joints]
        rotors = [f"joint {i + 1}: {'unknown' if j is None else j}" for i, j in zip(joints, rotor, strict=True)]
        return (
            f"{self.model.name}: the arm with these effects is too stiff for steps of {self.step:.2g} s; choose "
            f"smaller values of {', '.join(suspects)}, or a larger rotor_inertia ({', '.join(rotors)})"
        )

    def _rate_widths(self, equations: PlantEquations) -> Array:
        n = self.model.n
        posture, still = self.posture, np.zeros(n)
        memory = self.rest(equations)(posture)[2 * n : 2 * n + equations.states]
        inertia = np.asarray(equations.balance(posture, still, still, 0.0, memory, [])[1])
        whole = np.diag(self.model.inertia(posture[:, None], self.known.lumps)[..., 0])
        weightless = [f"joint {i + 1}" for i in range(n) if not inertia[i, i] > WEIGHTLESS * whole[i]]
        if weightless:
            raise PlantError(
                f"{self.model.name}: no inertia moves with the motor, before an elastic transmission, at "
                f"{', '.join(weightless)}; state a rotor_inertia > 0 there"
            )
        dry = np.empty(n)
        for i, creep in enumerate(10 * RATE_WIDTH * np.eye(n)):
            ahead, back = (equations.balance(posture, s * creep, still, 0.0, memory, [])[0] for s in (1, -1))
            dry[i] = abs(float(ahead[i] - back[i])) / 2
        return np.maximum(RATE_WIDTH, self.step * dry * np.diag(np.linalg.inv(inertia)))


def runge_kutta(equations: PlantEquations, h: float) -> ca.Function:
    """The state after one step of h s under a command (n,): a function of both, and of the symbols of parameters."""
    n = equations.n
    q, v, before, command = (ca.SX.sym(name, n) for name in ("q", "v", "before", "command"))
    memory, t = ca.SX.sym("memory", equations.states), ca.SX.sym("t")
    qdd, torque, dt = ca.SX.sym("qdd", n), ca.SX.sym("acting", n), ca.SX.sym("dt")
    free = equations.free
    accelerations = equations.acceleration(q, v, torque, t=t, memory=memory)
    slope = ca.Function("slope", [q, v, memory, torque, t, free], ca.cse([accelerations]))
    remembered = equations.remember(PlantInstant(q, v, qdd, t), dt, memory)
    later = ca.Function("later", [q, v, qdd, memory, t, dt, free], ca.cse([remembered]))
    acting = equations.acting(command, before, h, PlantInstant(q, v, ca.SX.zeros(n), t))
    # Each stage with its own memory, stepped from the beginning along the stage before.
    a1 = slope(q, v, memory, acting, t, free)
    q2, v2 = q + h / 2 * v, v + h / 2 * a1
    m2 = later(q, v, a1, memory, t, h / 2, free)
    a2 = slope(q2, v2, m2, acting, t + h / 2, free)
    q3, v3 = q + h / 2 * v2, v + h / 2 * a2
    m3 = later(q2, v2, a2, memory, t + h / 2, h / 2, free)
    a3 = slope(q3, v3, m3, acting, t + h / 2, free)
    q4, v4 = q + h * v3, v + h * a3
    m4 = later(q3, v3, a3, memory, t + h / 2, h, free)
    a4 = slope(q4, v4, m4, acting, t + h, free)
    q5 = q + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
    v5 = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    state, after = ca.vertcat(q, v, memory, before, t), ca.vertcat(q5, v5, m4, acting, t + h)
    return ca.Function("substep", [state, command, free], ca.cse([after]))
