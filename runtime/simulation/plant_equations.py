"""The equation of motion of an arm with all its effects, solved for the accelerations, as CasADi expressions.

What the signals mean is said in estimation/regressors.py; here the same are expressions of one instant. The effects'
torques and steps are the generated ones, with switches of the widths named here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from runtime.estimation.regressors import LEVEL_EFFECTS
from runtime.model.casadi_functions import arm_function, effect_function, effect_torque, ordered, struct_values
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term, joints_of

RATE_WIDTH = 1e-3
"""rad/s (m/s) to either side of rest within which dry friction grows to its full height: at rest a joint creeps by
less than that."""
POSITION_WIDTH, FORCE_WIDTH, TIME_WIDTH = 1e-5, 1e-3, 1e-6
"""rad (m), N m (N), s: edges of a plate, a stop, a spring; zero load; the pick-up of a payload."""
_SHARP = (1e-12, 1e-12, 1e-12, 1e-12)
"""For effects with a memory, and what they act upon: their law has a finite slope without any smoothing."""
_INSTANT = 1e-8
"""s; a step so short that what follows the signals at once (a link's acceleration) is that of this instant."""
_NEVER = -1e9
"""m: base y of the plate's surface where there is none."""
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
        reads = {term: set(model.library[term.effect].signals) for term in terms}
        self._bristled = {term.joint for term in terms if "level" in reads[term]}
        self.drive = [term for term in terms if reads[term] & {"predicted", "predicted_rate"}]
        self.forces = [term for term in terms if term not in self.drive]
        self.memories = self._find_memories()
        self.states = sum(len(m.at_once) for m in self.memories)
        self._check(reads)

    def _check(self, reads: dict[Term, set[str]]) -> None:
        for term in self.drive:
            if self.model.library[term.effect].states:
                raise PlantError(f"{term}: a drive with a memory cannot be simulated forwards; leave it out")
            if "predicted_rate" in reads[term] and self.terms[term].get("time", 0.0) < 0:
                raise PlantError(
                    f"{term}: time = {self.terms[term]['time']:g} s: a torque recorded after it has acted cannot be "
                    "simulated forwards; choose a time > 0"
                )
        for term in (t for t in self.terms if t.joint in self._bristled and "level" in reads[t]):
            if not any(Term(effect, term.joint) in self.terms for effect in LEVEL_EFFECTS):
                raise PlantError(f"{term}: takes the place of the joint's Coulomb friction, and it has none")

    # --- forces ---

    def torque(self, at: PlantInstant, memory: Any) -> Any:
        """Torques (n,) that the motors must give for these accelerations."""
        signals = _Signals(self, at)
        total = ca.SX(signals.rigid)
        for term in self.forces:
            states = self._present(term, signals, memory)
            for joint in joints_of(self.model, term):
                total[joint] += self._force(term, joint, signals, states)
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

    def _force(self, term: Term, joint: int, signals: _Signals, states: Any) -> Any:
        read = signals.reader(term, joint)
        return effect_torque(self.model, term.effect, read, self._values(term), self._width(term, joint), states)

    def _values(self, term: Term) -> list[float]:
        return ordered(self.model, term.effect, self.terms[term])

    def _width(self, term: Term, joint: int) -> tuple[float, ...]:
        sharp = term.effect in LEVEL_EFFECTS and term.joint in self._bristled
        if sharp or self.model.library[term.effect].states:
            return _SHARP
        return (self.rate_widths[joint], POSITION_WIDTH, FORCE_WIDTH, TIME_WIDTH)

    def level(self, joint: int, signals: _Signals) -> Any:
        """Magnitude of the joint's Coulomb friction in the present direction."""
        terms = [Term(effect, joint + 1) for effect in LEVEL_EFFECTS]
        return ca.fabs(sum(self._force(term, joint, signals, None) for term in terms if term in self.terms))

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
            excess = sum(
                self._excess(term, joint, signals, torque, (torque - before[joint]) / dt)
                for term in self.drive
                if joint in joints_of(self.model, term)
            )
            recorded = torque + excess
            better = torque - (recorded - command[joint]) / ca.jacobian(recorded, torque)
            # A saturation's curve is convex: from beyond its root, each step comes nearer.
            for _ in range(_DRIVE_STEPS):
                found[joint] = ca.substitute(better, torque, found[joint])
        return found

    def _excess(self, term: Term, joint: int, signals: _Signals, torque: Any, slope: Any) -> Any:
        own = {"predicted": torque, "predicted_rate": slope}
        read = signals.reader(term, joint)
        width = self._width(term, joint)
        return effect_torque(
            self.model, term.effect, lambda s: own[s] if s in own else read(s), self._values(term), width
        )


def check_complete(model: Model, terms: Structure) -> None:
    """Raise PlantError where a parameter of an effect has no value."""
    for term, values in terms.items():
        for p in model.library[term.effect].parameters:
            if p.name not in values and p.default is None:
                raise PlantError(
                    f"{model.name}: {term} has no value of {p.name}; identify it (tendon identify --write) "
                    "or state it in the model file"
                )


class _Signals:
    """The signals that effects read, as expressions of one instant."""

    def __init__(self, equations: PlantEquations, at: PlantInstant) -> None:
        self.equations, self.model, self.at = equations, equations.model, at

    def reader(self, term: Term, joint: int) -> Callable[[str], Any]:
        """Signals of a term by name, as it reads them for its torque at a joint (0-based)."""
        own = (term.joint or 1) - 1
        coupled = "coupling" in self.model.library[term.effect].signals and term.joint is not None

        def read(name: str) -> Any:
            if name == "coupling" and coupled:
                return self.link_inertia(own) if joint == own else self.inertia[joint, own]
            if name == "has_next":
                return 1.0 if term.joint is not None and joint == own else 0.0
            return _READERS[name](self, own if coupled else joint)

        return read

    def _arm(self, name: str, *arguments: Any) -> Any:
        return arm_function(self.model, name)(struct_values(self.model), *arguments)

    @cached_property
    def rigid(self) -> Any:
        return self._arm("inverse_dynamics", self.at.q, self.at.qd, self.at.qdd)

    @cached_property
    def inertia(self) -> Any:
        return self._arm("inertia", self.at.q)

    def link_inertia(self, joint: int) -> Any:
        return self.inertia[joint, joint] - self.model.joints[joint].rotor_inertia

    def load(self, joint: int) -> Any:
        return self.rigid[joint] - self.model.joints[joint].rotor_inertia * self.at.qdd[joint]

    @cached_property
    def tip(self) -> Any:
        return self._arm("tip", self.at.q)

    @cached_property
    def tip_row(self) -> Any:
        return self._arm("tip_jacobian", self.at.q)[1, :]

    @cached_property
    def moments(self) -> Any:
        return self._arm("moment_jacobian", self.at.q)

    @cached_property
    def tip_load(self) -> Any:
        return self._arm("tip_load", self.at.q, self.at.qd, self.at.qdd)

    def plate(self) -> float:
        return self.equations.terms.get(Term("plate"), {}).get("position", _NEVER)


_READERS: dict[str, Callable[[_Signals, int], Any]] = {
    "q": lambda s, i: s.at.q[i],
    "qd": lambda s, i: s.at.qd[i],
    "qdd": lambda s, i: s.at.qdd[i],
    "t": lambda s, _: s.at.t,
    "load": lambda s, i: s.load(i),
    "link_inertia": lambda s, i: s.link_inertia(i),
    "coupling": lambda s, i: s.link_inertia(i),
    "level": lambda s, i: s.equations.level(i, s),
    # No temperature is measured here.
    "warmth": lambda _, __: 0.0,
    "unmeasured": lambda _, __: 1.0,
    "qd_next": lambda s, i: s.at.qd[i + 1] if i + 1 < s.model.n else 0.0,
    "qd_previous": lambda s, i: s.at.qd[i - 1] if i else 0.0,
    "moment_x": lambda s, i: s.moments[0, i],
    "moment_y": lambda s, i: s.moments[1, i],
    "tip_load": lambda s, i: s.tip_load[i],
    "tip_y": lambda s, _: s.tip[1],
    "tip_yd": lambda s, _: ca.mtimes(s.tip_row, s.at.qd),
    "tip_row": lambda s, i: s.tip_row[i],
    "plate_y": lambda s, _: s.plate(),
    "ratio": lambda s, i: s.model.joints[i].gear_ratio,
}
