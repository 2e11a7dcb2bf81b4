"""The motor torque of a plan, (10) and (15), as expressions of the generated CasADi functions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from runtime.model import casadi_functions
from runtime.model.loader import Model
from runtime.model.terms import (
    OF_DRIVE,
    SURFACE,
    SignalContext,
    Structure,
    Term,
    check_complete,
    giver,
    joints_of,
    structure,
    unknown_to_plan,
)
from runtime.planning.scenario import Scenario
from runtime.planning.springs import is_spring


@dataclass(frozen=True)
class Physics:
    """What acts in a plan: terms with their values, springs apart, and what it leaves out and why."""

    model: Model
    terms: Structure
    left_out: Mapping[Term, str]

    @classmethod
    def of(cls, model: Model, scenario: Scenario) -> Physics:
        """The model file's effects; parallel springs are the scenario's, and so is what it says of the contact.

        Raises ModelError where one of them has no value.
        """
        terms, left_out = {}, {}
        for term, values in structure(model).items():
            info = model.library[term.effect]
            if is_spring(info) or (info.rubs and not scenario.friction):
                continue
            unknown = unknown_to_plan(model.library, term.effect)
            if info.states or unknown:
                left_out[term] = "it has a memory" if info.states else f"a plan does not know its {unknown[0]}"
                continue
            own = scenario.contact.get(term.effect, {}) if info.scope == "contact" else {}
            terms[term] = {**values, **own}
        check_complete(model, terms)
        return cls(model, terms, left_out)

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Of the parts of p that the equations read."""
        own = {str(term): len(self.model.library[term.effect].parameters) for term in self.terms}
        return {"struct": len(self.model.struct_values), "width": len(casadi_functions.WIDTHS), **own}

    def values(self, width: float) -> dict[str, list[float]]:
        """The same parts' values; width of the switches in rad/s (m/s), and their other widths with it."""
        own = {str(term): casadi_functions.ordered(self.model, term.effect, v) for term, v in self.terms.items()}
        return {"struct": self.model.struct_values, "width": widths(width), **own}

    def given(self, signal: str, p: Callable[[str], ca.SX]) -> ca.SX | None:
        """The signal that a parameter of a term is; None where there is none."""
        found = giver(self.model.library, self.terms, signal)
        if found is None:
            return None
        term, name = found
        names = [parameter.name for parameter in self.model.library[term.effect].parameters]
        return p(str(term))[names.index(name)]

    def plate_position(self, p: Callable[[str], ca.SX]) -> ca.SX:
        """Base y of what the end-effector touches."""
        position = self.given(SURFACE, p)
        assert position is not None, "the end-effector touches nothing"
        return position


def widths(rate: float) -> list[float]:
    """In the order of casadi_functions.WIDTHS: rate (rad/s, m/s), and position, force, time in proportion."""
    return [rate, rate / 50.0, rate, rate / 50.0]


@dataclass(frozen=True)
class PlanInstant:
    """Expressions of one instant: q, qd, qdd (n,), parameters of the springs, p by name.

    apart   the end-effector is known to be off the plate, so that nothing of the contact acts
    """

    physics: Physics
    q: ca.SX
    qd: ca.SX
    qdd: ca.SX
    springs: Mapping[Term, ca.SX]
    p: Callable[[str], ca.SX]
    apart: bool

    @cached_property
    def _signals(self) -> _Signals:
        return _Signals(self)

    @property
    def tip(self) -> ca.SX:
        """Place of the end-effector: base x, y, in space x, y, z, m."""
        return self._signals.arm("tip")

    @property
    def tip_rotation(self) -> ca.SX:
        """(3, 3) of the tip's frame of a spatial arm, in base axes."""
        return self._signals.arm("tip_rotation")

    @property
    def tip_rate(self) -> ca.SX:
        """Its rate, m/s."""
        return self._signals.arm("tip_rate")

    @cached_property
    def torque(self) -> ca.SX:
        """(n,) motor torques, N m or N."""
        own = self._signals.own
        # What reads the predicted torque comes last, when all the rest is in it.
        model, library = self.physics.model, self.physics.model.library
        terms = sorted(self.acting, key=lambda t: bool(library.needs[t.effect] & OF_DRIVE))
        for term in (*self.springs, *terms):
            for joint in joints_of(model, term):
                own[joint] += self.part(term, joint)
        return ca.vertcat(*own)

    @property
    def acting(self) -> list[Term]:
        """The model's effects, without the springs."""
        library = self.physics.model.library
        return [t for t in self.physics.terms if not (self.apart and library[t.effect].scope == "contact")]

    def part(self, term: Term, joint: int) -> ca.SX:
        """Torque of a spring or an effect at a joint (0-based)."""
        values = self.springs[term] if term in self.springs else self.p(str(term))
        read = self._signals.reader(term, joint)
        return casadi_functions.effect_torque(self.physics.model, term.effect, read, values, self.p("width"))


class _Signals(SignalContext):
    """What effects read at one instant of a plan; own: the motors' torques (n,), as far as they are summed."""

    def __init__(self, instant: PlanInstant) -> None:
        self.model, self.instant = instant.physics.model, instant

    @cached_property
    def own(self) -> list[ca.SX]:
        rigid = self.arm("inverse_dynamics")
        return [rigid[i] for i in range(self.model.n)]

    def coordinate(self, name: str) -> ca.SX:
        return getattr(self.instant, name)

    def evaluate(self, function: str) -> ca.SX:
        return casadi_functions.evaluate(self.model, function, self.instant.p("struct"), self.coordinate)

    def given(self, name: str) -> ca.SX | None:
        return self.instant.physics.given(name, self.instant.p)

    def terms(self) -> Collection[Term]:
        return [*self.instant.springs, *self.instant.acting]

    def torque(self, term: Term, joint: int) -> ca.SX:
        return self.instant.part(term, joint)

    def predicted(self, joint: int) -> ca.SX:
        return self.own[joint]
