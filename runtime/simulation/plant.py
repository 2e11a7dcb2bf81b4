"""A simulated arm: its equation of motion with all effects, solved for the accelerations in CasADi, and integrated.

The signals that effects read are expressions of one instant. Torques and state steps are the generated functions, with
smoothed switches of the widths in settings.py.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.interruption import heard_in_casadi
from runtime.model.casadi_functions import effect_function, effect_torque, evaluate, ordered, slope
from runtime.model.loader import Model
from runtime.model.terms import OF_DRIVE, SignalContext, Structure, Term, check_complete, given, joints_of
from runtime.simulation.settings import (
    DRIVE_STEPS,
    FINER,
    FORCE_WIDTH,
    GROWTH,
    GROWTH_AT,
    INSTANT,
    NEWTON_STEPS,
    POSITION_WIDTH,
    RATE_WIDTH,
    SHARP_WIDTH,
    STEP,
    TIME_WIDTH,
    WEIGHTLESS,
)

_SHARP = (SHARP_WIDTH, SHARP_WIDTH, SHARP_WIDTH, SHARP_WIDTH)


class PlantError(ValueError):
    """Something that forward simulation cannot handle; the message says why and what to do."""


@dataclass(frozen=True)
class PlantInstant:
    """Positions, rates, accelerations (n,) and the time since the start of the run, as expressions."""

    q: Any
    qd: Any
    qdd: Any
    t: Any


@dataclass(frozen=True)
class Memory:
    """The states of a term, from index `start` on among the states of all terms.

    at_once   for each state, whether it follows the signals without delay
    """

    term: Term
    start: int
    at_once: tuple[bool, ...]

    @property
    def stop(self) -> int:
        return self.start + len(self.at_once)


class PlantEquations:
    """Equations of an arm. terms: with all values; rate_widths (n,): of the dry friction at rest, rad/s or m/s."""

    def __init__(self, model: Model, terms: Structure, rate_widths: ArrayLike) -> None:
        check_complete(model, terms)
        self.model, self.terms, self.n = model, terms, model.n
        self.rate_widths: list[float] = np.asarray(rate_widths, dtype=np.float64).tolist()
        needed = {term: model.library.needs[term.effect] for term in terms}
        self._bristled = {term.joint for term in terms if "friction" in needed[term]}
        self.drive = [term for term in terms if needed[term] & OF_DRIVE]
        self.forces = [term for term in terms if term not in self.drive]
        self.memories = self._find_memories()
        self.states = sum(len(m.at_once) for m in self.memories)
        self._check(needed)

    def _check(self, needed: dict[Term, frozenset[str]]) -> None:
        for term in self.drive:
            if self.model.library[term.effect].states:
                raise PlantError(f"{term}: forward simulation cannot handle a drive with states; leave it out")
            lead = self.model.library[term.effect].of_kind("lead")
            if lead is not None and (value := self.terms[term].get(lead.name, 0.0)) < 0:
                raise PlantError(
                    f"{term}: {lead.name} = {value:g} {lead.unit.text()}: forward simulation cannot record a torque "
                    f"after it acts; choose a {lead.name} > 0"
                )
        for term in (t for t in self.terms if "friction" in needed[t]):
            if not any(t.joint == term.joint and self._is_dry(t) for t in self.terms):
                raise PlantError(f"{term}: replaces the joint's Coulomb friction, which it does not have; add it")

    def _is_dry(self, term: Term) -> bool:
        return self.model.library[term.effect].dry

    # --- forces ---

    def torque(self, at: PlantInstant, memory: Any) -> Any:
        """Motor torques (n,) for these accelerations."""
        signals = _Signals(self, at)
        total = ca.SX(signals.arm("inverse_dynamics"))
        for term in self.forces:
            states = self._present(term, signals, memory)
            for joint in joints_of(self.model, term):
                total[joint] += self.force(term, joint, signals, states)
        return total

    def acceleration(self, q: Any, qd: Any, acting: Any, t: Any, memory: Any) -> Any:
        """Accelerations (n,) under the motors' torques `acting`, by Newton's method if an effect depends on them."""
        balance = self.balance
        qdd = ca.SX.zeros(self.n)
        for _ in range(self._newton_steps):
            torque, inertia = balance(q, qd, qdd, t, memory)
            qdd = qdd - ca.solve(inertia, torque - acting)
        return qdd

    @cached_property
    def balance(self) -> ca.Function:
        """Motor torques, and their derivative by the accelerations, the inertia at the motors."""
        q, qd, qdd, t, memory = self._symbols
        torque = self.torque(PlantInstant(q, qd, qdd, t), memory)
        return ca.Function("balance", [q, qd, qdd, t, memory], [torque, ca.jacobian(torque, qdd)])

    @cached_property
    def _newton_steps(self) -> int:
        inertia = self.balance(*self._symbols)[1]
        return NEWTON_STEPS if ca.depends_on(inertia, self._symbols[2]) else 1

    @cached_property
    def _symbols(self) -> tuple[Any, ...]:
        q, qd, qdd = (ca.SX.sym(name, self.n) for name in ("q", "qd", "qdd"))
        return q, qd, qdd, ca.SX.sym("t"), ca.SX.sym("memory", self.states)

    def force(self, term: Term, joint: int, signals: SignalContext, states: Any) -> Any:
        """Torque of a term at a joint (0-based)."""
        read = signals.reader(term, joint)
        return effect_torque(
            self.model, term.effect, read, self._values(term), width=self._width(term, joint), states=states
        )

    def _values(self, term: Term) -> list[float]:
        return ordered(self.model, term.effect, self.terms[term])

    def _width(self, term: Term, joint: int) -> tuple[float, ...]:
        sharp = self._is_dry(term) and term.joint in self._bristled
        if sharp or self.model.library[term.effect].states:
            return _SHARP
        return (self.rate_widths[joint], POSITION_WIDTH, FORCE_WIDTH, TIME_WIDTH)

    # --- states ---

    def _find_memories(self) -> tuple[Memory, ...]:
        found: list[Memory] = []
        for term in self.forces:
            if count := len(self.model.library[term.effect].states):
                found.append(Memory(term, found[-1].stop if found else 0, self._at_once(term, count)))
        return tuple(found)

    def _at_once(self, term: Term, count: int) -> tuple[bool, ...]:
        """States that follow the signals without delay, in laws that depend on time; none in rate-independent laws."""
        function = effect_function(self.model, term.effect, "step")
        inputs = [ca.SX.sym(function.name_in(k), function.size1_in(k)) for k in range(function.n_in())]
        after = function(*inputs)
        dt, before = inputs[-4], inputs[-2]
        if not ca.depends_on(after, dt):
            return (False,) * count
        past = ca.jacobian(after, before).sparsity()
        at_once = tuple(not past.has_nz(k, k) for k in range(count))
        if any(not at_once[k] and not ca.depends_on(after[k], dt) for k in range(count)):
            raise PlantError(
                f"{term}: has states that depend on time and others that do not; forward simulation cannot handle it"
            )
        return at_once

    def _present(self, term: Term, signals: _Signals, memory: Any) -> Any:
        """States of a term for its torque; those without delay take their value at this instant."""
        own = next((m for m in self.memories if m.term == term), None)
        if own is None:
            return None
        states = memory[own.start : own.stop]
        for _ in range(sum(own.at_once)):
            after = self._step(own, signals, INSTANT, states)
            states = ca.vertcat(*(after[k] if new else states[k] for k, new in enumerate(own.at_once)))
        return states

    def _step(self, own: Memory, signals: _Signals, dt: Any, states: Any) -> Any:
        return self._called(own, "step", signals, time=[dt], states=states)

    def _called(self, own: Memory, what: str, signals: _Signals, time: list[Any], states: Any) -> Any:
        read = signals.reader(own.term, (own.term.joint or 1) - 1)
        arguments = [read(name) for name in self.model.library[own.term.effect].signals]
        function = effect_function(self.model, own.term.effect, what)
        return function(*arguments, *time, self._values(own.term), states, _SHARP)

    def remember(self, at: PlantInstant, dt: Any, memory: Any) -> Any:
        """States after dt (s) of this motion."""
        signals = _Signals(self, at)
        parts = [self._step(own, signals, dt, self._present(own.term, signals, memory)) for own in self.memories]
        return ca.vertcat(*parts) if parts else memory

    def at_rest(self, q: Any) -> Any:
        """States of an arm that has been at rest."""
        still = ca.SX.zeros(self.n)
        signals = _Signals(self, PlantInstant(q, still, still, ca.SX(0.0)))
        parts = [
            self._called(own, "start", signals, time=[], states=ca.SX.zeros(len(own.at_once))) for own in self.memories
        ]
        return ca.vertcat(*parts) if parts else ca.SX(0, 1)

    # --- drives ---

    def acting(self, command: Any, before: Any, dt: float, at: PlantInstant) -> Any:
        """Torques (n,) that act when `command` (n,) is recorded. before: the acting torques dt s ago.

        An effect of the drive is the difference between recorded and acting torque.
        """
        signals = _Signals(self, at)
        found = ca.SX(command)
        for joint in {joint for term in self.drive for joint in joints_of(self.model, term)}:
            torque = ca.SX.sym("acting")
            driven = _Driven(signals, torque, (torque - before[joint]) / dt)
            terms = [term for term in self.drive if joint in joints_of(self.model, term)]
            recorded = torque + sum(self.force(term, joint, driven, None) for term in terms)
            better = torque - (recorded - command[joint]) / ca.jacobian(recorded, torque)
            # The curve of a saturation is convex, so that Newton's method converges.
            for _ in range(DRIVE_STEPS):
                found[joint] = ca.substitute(better, torque, found[joint])
        return found


class _Signals(SignalContext):
    """The signals that effects read, as expressions of one instant; without temperatures."""

    def __init__(self, equations: PlantEquations, at: PlantInstant) -> None:
        self.equations, self.model, self.instant = equations, equations.model, at

    def coordinate(self, name: str) -> Any:
        return getattr(self.instant, name)

    def evaluate(self, function: str) -> Any:
        return evaluate(self.model, function, self.model.struct_values, self.coordinate)

    def growth(self, function: str, by: str, own: int) -> Any:
        return slope(self.model, function, by, struct=self.model.struct_values, coordinate=self.coordinate)[:, own]

    def given(self, name: str) -> float | None:
        return given(self.model.library, self.equations.terms, name)

    def time(self) -> Any:
        return self.instant.t

    def terms(self) -> Collection[Term]:
        return self.equations.terms.keys()

    def torque(self, term: Term, joint: int) -> Any:
        return self.equations.force(term, joint, self, None)


class _Driven(_Signals):
    """The same for effects of a drive, which read the acting torque and its rate."""

    def __init__(self, signals: _Signals, acting: Any, slope: Any) -> None:
        super().__init__(signals.equations, signals.instant)
        self.acting, self.slope = acting, slope

    def predicted(self, _joint: int) -> Any:
        return self.acting

    def predicted_rate(self, _joint: int) -> Any:
        return self.slope


Array = NDArray[np.float64]


class Plant:
    """A simulated arm with `terms` (all values known), advanced by control periods.

    Integrated by the classical Runge-Kutta method; states of effects by their generated steps, which are exact for
    constant signals. q and qd are the motors' angles and rates divided by the gear ratio. Raises PlantError.
    """

    def __init__(self, model: Model, terms: Structure, period: float) -> None:
        self.model, self.terms, self.period = model, terms, period
        self._substeps = 0
        with heard_in_casadi():
            one = self._stable_step(max(1, ceil(period / STEP - 1e-9)))
            state, command = ca.MX.sym("state", one.size1_in(0)), ca.MX.sym("command", model.n)
            after = one.fold(self._substeps)(state, ca.repmat(command, 1, self._substeps))
            self._advance = ca.Function("period", [state, command], [after])
            self._rest = self._start_of(self._equations)
        self._state: Array = np.zeros(self._advance.size1_in(0))
        self._command: Array = np.zeros(model.n)
        # Calls without copies or conversions.
        self._buffer, self._run = self._advance.buffer()
        for k, array in enumerate((self._state, self._command)):
            self._buffer.set_arg(k, memoryview(array))  # type: ignore[arg-type, call-arg]
        self._buffer.set_res(0, memoryview(self._state))  # type: ignore[arg-type, call-arg]
        self.reset(np.zeros(model.n))

    @property
    def q(self) -> Array:
        """(n,) rad or m."""
        return self._state[: self.model.n]

    @property
    def qd(self) -> Array:
        """(n,) rad/s or m/s."""
        return self._state[self.model.n : 2 * self.model.n]

    @property
    def t(self) -> float:
        """Time in s since `reset`."""
        return float(self._state[-1])

    def reset(self, q: ArrayLike, qd: ArrayLike | None = None) -> None:
        """To q (n,) and t = 0, at rest unless rates qd (n,) are given."""
        n = self.model.n
        self._state[:] = np.asarray(self._rest(np.asarray(q, dtype=np.float64))).ravel()
        if qd is not None:
            self._state[n : 2 * n] = qd

    def advance(self, torque: ArrayLike) -> None:
        """Advances by one control period under constant torques (n,)."""
        self._command[:] = torque
        self._run()

    def _stable_step(self, coarsest: int) -> ca.Function:
        """One integration step; as many per control period as stability needs."""
        for substeps in FINER:
            one = self._stepping(substeps * coarsest)
            growth = self._growth(one)
            if np.isfinite(growth).all() and np.abs(np.linalg.eigvals(growth)).max() < GROWTH:
                return one
        raise PlantError(self._too_stiff(growth))

    def _start_of(self, equations: PlantEquations) -> ca.Function:
        """The state of an arm at rest at q."""
        n = self.model.n
        q, still = ca.SX.sym("q", n), ca.SX.zeros(n)
        # The motors start without torque.
        state = ca.vertcat(q, still, equations.at_rest(q), still, 0.0)
        return ca.Function("rest", [q], [state])

    def _stepping(self, substeps: int) -> ca.Function:
        """The function of one step of `substeps` in a control period."""
        self._substeps, self.step = substeps, self.period / substeps
        plain = PlantEquations(self.model, self.terms, [RATE_WIDTH] * self.model.n)
        self.widths = self._rate_widths(plain)
        wide = np.any(self.widths > RATE_WIDTH)
        self._equations = PlantEquations(self.model, self.terms, self.widths) if wide else plain
        return self._substep()

    def _growth(self, one: ca.Function) -> Array:
        """(S, S) derivative of the state after a step by the state before it, near rest."""
        state, command = ca.SX.sym("state", one.size1_in(0)), ca.SX.sym("command", self.model.n)
        derivative = ca.Function("derivative", [state, command], [ca.jacobian(one(state, command), state)])
        n = self.model.n
        begin = np.asarray(self._start_of(self._equations)(np.zeros(n))).ravel()
        # At rest, a bristle model is not differentiable.
        begin[n : 2 * n] = GROWTH_AT * self.widths
        return np.asarray(derivative(begin, np.zeros(n)))

    def _too_stiff(self, growth: Array) -> str:
        """The message if no step is short enough: the unstable joint and its stiff effects."""
        n = self.model.n
        joints = list(range(n))
        if np.isfinite(growth).all():
            values, modes = np.linalg.eig(growth)
            joints = [int(np.argmax(np.abs(modes[n : 2 * n, np.argmax(np.abs(values))])))]
        effects = {term: self.model.library[term.effect] for term in self.terms}
        # Effects whose stiffness or damping can cause a high frequency.
        stiffening = [t for t, info in effects.items() if info.scope == "joint" and (info.rubs or info.side == "link")]
        suspects = [str(t) for t in stiffening if (t.joint or 1) - 1 in joints]
        known = [self.model.joints[i].rotor_inertia for i in joints]
        rotors = [f"joint {i + 1}: {'unknown' if j is None else j}" for i, j in zip(joints, known, strict=True)]
        return (
            f"{self.model.name}: the arm with these effects is too stiff for steps of {self.step:.2g} s; choose "
            f"smaller values of {', '.join(suspects)}, or a larger rotor_inertia ({', '.join(rotors)})"
        )

    def _substep(self) -> ca.Function:
        """State (q, rates, memory, acting torques, t) after one step under a command (n,)."""
        n, h, equations = self.model.n, self.step, self._equations
        q, v, before, command = (ca.SX.sym(name, n) for name in ("q", "v", "before", "command"))
        memory, t = ca.SX.sym("memory", equations.states), ca.SX.sym("t")
        qdd, torque, dt = ca.SX.sym("qdd", n), ca.SX.sym("acting", n), ca.SX.sym("dt")
        accelerations = equations.acceleration(q, v, torque, t=t, memory=memory)
        slope = ca.Function("slope", [q, v, memory, torque, t], ca.cse([accelerations]))
        remembered = equations.remember(PlantInstant(q, v, qdd, t), dt, memory)
        later = ca.Function("later", [q, v, qdd, memory, t, dt], ca.cse([remembered]))
        acting = equations.acting(command, before, h, PlantInstant(q, v, ca.SX.zeros(n), t))
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

    def _rate_widths(self, equations: PlantEquations) -> Array:
        """(n,) widths of dry friction in rad/s or m/s, at least such that one step does not cross the whole slope."""
        n = self.model.n
        posture, still = np.zeros(n), np.zeros(n)
        memory = self._start_of(equations)(posture)[2 * n : 2 * n + equations.states]
        inertia = np.asarray(equations.balance(posture, still, still, 0.0, memory)[1])
        whole = np.diag(self.model.inertia(posture[:, None])[..., 0])
        weightless = [f"joint {i + 1}" for i in range(n) if not inertia[i, i] > WEIGHTLESS * whole[i]]
        if weightless:
            raise PlantError(
                f"{self.model.name}: no inertia moves with the motor, before an elastic transmission, at "
                f"{', '.join(weightless)}; state a rotor_inertia > 0 there"
            )
        dry = np.empty(n)
        for i, creep in enumerate(10 * RATE_WIDTH * np.eye(n)):
            ahead, back = (equations.balance(posture, s * creep, still, 0.0, memory)[0] for s in (1, -1))
            dry[i] = abs(float(ahead[i] - back[i])) / 2
        return np.maximum(RATE_WIDTH, self.step * dry * np.diag(np.linalg.inv(inertia)))
