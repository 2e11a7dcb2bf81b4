"""An arm's equation of motion with all effects, solved for the accelerations, as expressions of CasADi.

The signals that effects read are expressions of one instant. Torques and state steps are the generated functions, with
smoothed switches of the widths in settings.py.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from runtime.model.casadi_functions import effect_function, effect_torque, evaluate, ordered, slope
from runtime.model.loader import Model
from runtime.model.terms import OF_DRIVE, Prediction, SignalContext, Structure, Term, check_complete, given, joints_of
from runtime.simulation.settings import (
    DRIVE_STEPS,
    FORCE_WIDTH,
    INSTANT,
    NEWTON_STEPS,
    POSITION_WIDTH,
    SHARP_WIDTH,
    TIME_WIDTH,
)
from symbolic.model_file.arm import LINK_TORQUE, MOTOR_TORQUE, WEIGHTLESS, Torque

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


def check_forward(model: Model, terms: Structure) -> None:
    """Refuses what forward simulation cannot handle. Raises PlantError, and ModelError where a value is missing."""
    check_complete(model, terms)
    library = model.library
    needed = {term: library.needs[term.effect] for term in terms}
    for term in (t for t in terms if needed[t] & OF_DRIVE):
        if library[term.effect].states:
            raise PlantError(f"{term}: forward simulation cannot handle a drive with states; leave it out")
        lead = library[term.effect].of_kind("lead")
        if lead is not None and (value := terms[term].get(lead.name, 0.0)) < 0:
            raise PlantError(
                f"{term}: {lead.name} = {value:g} {lead.unit.text()}: forward simulation cannot record a torque "
                f"after it acts; choose a {lead.name} > 0"
            )
    for term in (t for t in terms if "friction" in needed[t]):
        if not any(t.joint == term.joint and library[t.effect].dry for t in terms):
            raise PlantError(f"{term}: replaces the joint's Coulomb friction, which it does not have; add it")


class PlantEquations:
    """Equations of an arm.

    known         its parameters, all of them; numbers, or expressions for a simulation's derivatives by them
    rate_widths   (n,) of the dry friction at rest, rad/s or m/s      torque   what the drives' torques are
    """

    def __init__(self, model: Model, known: Prediction, rate_widths: ArrayLike, torque: Torque = MOTOR_TORQUE) -> None:
        terms = known.values
        self.model, self.known, self.terms, self.n, self.kind = model, known, terms, model.n, torque
        self.struct = ca.vertcat(*model.struct_of(known.lumps))
        self.rate_widths: list[float] = np.asarray(rate_widths, dtype=np.float64).tolist()
        needed = {term: model.library.needs[term.effect] for term in terms}
        self._bristled = {term.joint for term in terms if "friction" in needed[term]}
        self.drive = [term for term in terms if needed[term] & OF_DRIVE]
        self.forces = [term for term in terms if term not in self.drive]
        self.memories = self._find_memories()
        self.states = sum(len(m.at_once) for m in self.memories)

    def _is_dry(self, term: Term) -> bool:
        return self.model.library[term.effect].dry

    # --- forces ---

    def torque(self, at: PlantInstant, memory: Any) -> Any:
        """Motor torques (n,) for these accelerations."""
        signals = _Signals(self, at)
        total = self._rigid(signals)
        for term in self.forces:
            states = self._present(term, signals, memory)
            for joint in joints_of(self.model, term):
                total[joint] += self.force(term, joint, signals, states)
        return total

    def _rigid(self, signals: _Signals) -> Any:
        """What a torque of this kind has of D qdd + C qd + g, (n,)."""
        if self.kind == LINK_TORQUE:
            return ca.SX(signals.arm("link_load"))
        total = ca.SX(signals.arm("inverse_dynamics"))
        if self.kind == WEIGHTLESS:
            still = ca.SX.zeros(self.n)
            at_rest = _Signals(self, PlantInstant(signals.instant.q, still, still, signals.instant.t))
            total -= at_rest.arm("inverse_dynamics")
        return total

    def acceleration(self, q: Any, qd: Any, acting: Any, t: Any, memory: Any) -> Any:
        """Accelerations (n,) under the motors' torques `acting`, by Newton's method if an effect depends on them."""
        balance = self.balance
        qdd = ca.SX.zeros(self.n)
        for _ in range(self._newton_steps):
            torque, inertia = balance(q, qd, qdd, t, memory, self.free)
            qdd = qdd - ca.solve(inertia, torque - acting)
        return qdd

    @cached_property
    def balance(self) -> ca.Function:
        """Motor torques, and their derivative by the accelerations, the inertia at the motors."""
        q, qd, qdd, t, memory, free = self._symbols
        torque = self.torque(PlantInstant(q, qd, qdd, t), memory)
        return ca.Function("balance", [q, qd, qdd, t, memory, free], [torque, ca.jacobian(torque, qdd)])

    @cached_property
    def _newton_steps(self) -> int:
        inertia = self.balance(*self._symbols)[1]
        return NEWTON_STEPS if ca.depends_on(inertia, self._symbols[2]) else 1

    @cached_property
    def _symbols(self) -> tuple[Any, ...]:
        q, qd, qdd = (ca.SX.sym(name, self.n) for name in ("q", "qd", "qdd"))
        return q, qd, qdd, ca.SX.sym("t"), ca.SX.sym("memory", self.states), self.free

    @cached_property
    def free(self) -> Any:
        """The symbols among the parameters, (k,); none where all are numbers."""
        parts = [self.struct, *(self._values(term) for term in self.terms)]
        return ca.vertcat(*ca.symvar(ca.SX(ca.vertcat(*parts))))

    def force(self, term: Term, joint: int, signals: SignalContext, states: Any) -> Any:
        """Torque of a term at a joint (0-based)."""
        read = signals.reader(term, joint)
        return effect_torque(
            self.model, term.effect, read, self._values(term), width=self._width(term, joint), states=states
        )

    def _values(self, term: Term) -> Any:
        return ca.vertcat(*ordered(self.model, term.effect, self.terms[term]))

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
            slope = ca.jacobian(recorded, torque)
            better = torque - (recorded - command[joint]) / slope
            # The curve of a saturation is convex, so that Newton's method converges; a straight one is solved at once.
            for _ in range(DRIVE_STEPS if ca.depends_on(slope, torque) else 1):
                found[joint] = ca.substitute(better, torque, found[joint])
        return found


class _Signals(SignalContext):
    """The signals that effects read, as expressions of one instant; without temperatures."""

    def __init__(self, equations: PlantEquations, at: PlantInstant) -> None:
        self.equations, self.model, self.instant = equations, equations.model, at

    def coordinate(self, name: str) -> Any:
        return getattr(self.instant, name)

    def evaluate(self, function: str) -> Any:
        return evaluate(self.model, function, self.equations.struct, self.coordinate)

    def growth(self, function: str, by: str, own: int) -> Any:
        return slope(self.model, function, by, struct=self.equations.struct, coordinate=self.coordinate)[:, own]

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
