"""The equation of motion of an arm with all its effects, solved for the accelerations, as CasADi expressions.

What effects read are expressions of one instant (runtime/model/signals.py). Their torques and steps are the generated
ones, with switches of the widths named here.
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
from runtime.model.signals import OF_DRIVE, SignalContext
from runtime.model.terms import Structure, Term, check_complete, given, joints_of

RATE_WIDTH = 1e-3
"""rad/s (m/s) to either side of rest within which dry friction grows to its full height: at rest a joint creeps by
less than that."""
POSITION_WIDTH, FORCE_WIDTH, TIME_WIDTH = 1e-5, 1e-3, 1e-6
"""rad (m), N m (N), s: edges of a plate, a stop, a spring; zero load; the pick-up of a payload."""
_SHARP = (1e-12, 1e-12, 1e-12, 1e-12)
"""For effects with a memory, and what they act upon: their law has a finite slope without any smoothing."""
_INSTANT = 1e-8
"""s; a step so short that what follows the signals at once (a link's acceleration) is that of this instant."""
_NEWTON_STEPS, _DRIVE_STEPS = 3, 6


class PlantError(ValueError):
    """What cannot be simulated forwards in time; the message says why and what to do."""


@dataclass(frozen=True)
class PlantInstant:
    """Positions, rates, accelerations (n,) and the time since the run began, as expressions."""

    q: Any
    qd: Any
    qdd: Any
    t: Any


@dataclass(frozen=True)
class Memory:
    """The states of a term, from `start` on within the states of all.

    at_once   of each, whether it has no past of its own: it follows the signals of the instant
    """

    term: Term
    start: int
    at_once: tuple[bool, ...]

    @property
    def stop(self) -> int:
        return self.start + len(self.at_once)


class PlantEquations:
    """terms: with all values; rate_widths (n,): of the joints' dry friction."""

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
                raise PlantError(f"{term}: a drive with a memory cannot be simulated forwards; leave it out")
            lead = self.model.library[term.effect].of_kind("lead")
            if lead is not None and (value := self.terms[term].get(lead.name, 0.0)) < 0:
                raise PlantError(
                    f"{term}: {lead.name} = {value:g} {lead.unit.text()}: a torque recorded after it has acted cannot "
                    f"be simulated forwards; choose a {lead.name} > 0"
                )
        for term in (t for t in self.terms if "friction" in needed[t]):
            if not any(t.joint == term.joint and self._is_dry(t) for t in self.terms):
                raise PlantError(f"{term}: takes the place of the joint's Coulomb friction, and it has none")

    def _is_dry(self, term: Term) -> bool:
        return self.model.library[term.effect].dry

    # --- forces ---

    def torque(self, at: PlantInstant, memory: Any) -> Any:
        """Torques (n,) that the motors must give for these accelerations."""
        signals = _Signals(self, at)
        total = ca.SX(signals.arm("inverse_dynamics"))
        for term in self.forces:
            states = self._present(term, signals, memory)
            for joint in joints_of(self.model, term):
                total[joint] += self.force(term, joint, signals, states)
        return total

    def acceleration(self, q: Any, qd: Any, acting: Any, t: Any, memory: Any) -> Any:
        """(n,) under the motors' torques `acting`: exact, also where an effect reads the accelerations."""
        balance = self.balance
        qdd = ca.SX.zeros(self.n)
        for _ in range(self._newton_steps):
            torque, inertia = balance(q, qd, qdd, t, memory)
            qdd = qdd - ca.solve(inertia, torque - acting)
        return qdd

    @cached_property
    def balance(self) -> ca.Function:
        """Torque, and its derivative by the accelerations: the inertia that the motors feel."""
        q, qd, qdd, t, memory = self._symbols
        torque = self.torque(PlantInstant(q, qd, qdd, t), memory)
        return ca.Function("balance", [q, qd, qdd, t, memory], [torque, ca.jacobian(torque, qdd)])

    @cached_property
    def _newton_steps(self) -> int:
        q, qd, qdd, t, memory = self._symbols
        inertia = self.balance(q, qd, qdd, t, memory)[1]
        return _NEWTON_STEPS if ca.depends_on(inertia, qdd) else 1

    @cached_property
    def _symbols(self) -> tuple[Any, ...]:
        q, qd, qdd = (ca.SX.sym(name, self.n) for name in ("q", "qd", "qdd"))
        return q, qd, qdd, ca.SX.sym("t"), ca.SX.sym("memory", self.states)

    def force(self, term: Term, joint: int, signals: SignalContext, states: Any) -> Any:
        """Torque of a term at a joint (0-based)."""
        read = signals.reader(term, joint)
        return effect_torque(self.model, term.effect, read, self._values(term), self._width(term, joint), states)

    def _values(self, term: Term) -> list[float]:
        return ordered(self.model, term.effect, self.terms[term])

    def _width(self, term: Term, joint: int) -> tuple[float, ...]:
        sharp = self._is_dry(term) and term.joint in self._bristled
        if sharp or self.model.library[term.effect].states:
            return _SHARP
        return (self.rate_widths[joint], POSITION_WIDTH, FORCE_WIDTH, TIME_WIDTH)

    # --- memory ---

    def _find_memories(self) -> tuple[Memory, ...]:
        found: list[Memory] = []
        for term in self.forces:
            count = len(self.model.library[term.effect].states)
            if count:
                found.append(Memory(term, found[-1].stop if found else 0, self._at_once(term, count)))
        return tuple(found)

    def _at_once(self, term: Term, count: int) -> tuple[bool, ...]:
        """Of a law in time, the states without a past of their own; a law of the path alone keeps all of its states."""
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
                f"{term}: has a memory of the time and another of the path; it cannot be simulated forwards"
            )
        return at_once

    def _present(self, term: Term, signals: _Signals, memory: Any) -> Any:
        """States of a term as its torque sees them: those that follow at once are of this instant."""
        own = next((m for m in self.memories if m.term == term), None)
        if own is None:
            return None
        states = memory[own.start : own.stop]
        for _ in range(sum(own.at_once)):
            after = self._step(own, signals, _INSTANT, states)
            states = ca.vertcat(*(after[k] if new else states[k] for k, new in enumerate(own.at_once)))
        return states

    def _step(self, own: Memory, signals: _Signals, dt: Any, states: Any) -> Any:
        return self._called(own, "step", signals, [dt], states)

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
        """States of an arm that has stood still."""
        still = ca.SX.zeros(self.n)
        signals = _Signals(self, PlantInstant(q, still, still, ca.SX(0.0)))
        parts = [self._called(own, "start", signals, [], ca.SX.zeros(len(own.at_once))) for own in self.memories]
        return ca.vertcat(*parts) if parts else ca.SX(0, 1)

    # --- drives ---

    def acting(self, command: Any, before: Any, dt: float, at: PlantInstant) -> Any:
        """Torques (n,) that act when the recorded ones are `command` (n,); `before`: those that acted dt ago.

        An effect of the drive says by how much the recorded torque exceeds the acting one.
        """
        signals = _Signals(self, at)
        found = ca.SX(command)
        for joint in {(term.joint or 1) - 1 for term in self.drive}:
            torque = ca.SX.sym("acting")
            driven = _Driven(signals, torque, (torque - before[joint]) / dt)
            terms = [term for term in self.drive if joint in joints_of(self.model, term)]
            recorded = torque + sum(self.force(term, joint, driven, None) for term in terms)
            better = torque - (recorded - command[joint]) / ca.jacobian(recorded, torque)
            # A saturation's curve is convex: from beyond its root, each step comes nearer.
            for _ in range(_DRIVE_STEPS):
                found[joint] = ca.substitute(better, torque, found[joint])
        return found


class _Signals(SignalContext):
    """The signals that effects read, as expressions of one instant; no temperature is measured there."""

    def __init__(self, equations: PlantEquations, at: PlantInstant) -> None:
        self.equations, self.model, self.instant = equations, equations.model, at

    def coordinate(self, name: str) -> Any:
        return getattr(self.instant, name)

    def evaluate(self, function: str) -> Any:
        return evaluate(self.model, function, self.model.struct_values, self.coordinate)

    def growth(self, function: str, by: str, own: int) -> Any:
        return slope(self.model, function, by, self.model.struct_values, self.coordinate)[:, own]

    def given(self, name: str) -> float | None:
        return given(self.model.library, self.equations.terms, name)

    def time(self) -> Any:
        return self.instant.t

    def terms(self) -> Collection[Term]:
        return self.equations.terms.keys()

    def torque(self, term: Term, joint: int) -> Any:
        return self.equations.force(term, joint, self, None)


class _Driven(_Signals):
    """The same where a drive acts: the torque that it gives, and how that changes in time."""

    def __init__(self, signals: _Signals, acting: Any, slope: Any) -> None:
        super().__init__(signals.equations, signals.instant)
        self.acting, self.slope = acting, slope

    def predicted(self, _joint: int) -> Any:
        return self.acting

    def predicted_rate(self, _joint: int) -> Any:
        return self.slope
