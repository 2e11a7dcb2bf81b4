"""The motor torque of a plan, (10) and (15), as expressions of the generated CasADi functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from runtime.model import casadi_functions
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term, structure
from runtime.planning.scenario import Scenario
from runtime.planning.trajectory import SPRING

FRICTION = "friction"
"""The family of effects that a frictionless plan leaves out."""
ARM_SIGNALS = frozenset({"moment_x", "moment_y", "tip_load", "tip_y", "tip_yd", "tip_row", "plate_y"})
PLANNED = (
    frozenset({"q", "qd", "qdd", "load", "predicted", "qd_next", "qd_previous", "has_next", "ratio"}) | ARM_SIGNALS
)
"""Signals that a plan knows; time, temperature and what has a memory it does not."""


@dataclass(frozen=True)
class Physics:
    """What acts in a plan: terms with their values, springs apart, and what it leaves out and why."""

    model: Model
    terms: Structure
    left_out: Mapping[Term, str]

    @classmethod
    def of(cls, model: Model, scenario: Scenario) -> Physics:
        """The model file's effects; parallel springs are the scenario's, and so is what it says of the contact."""
        terms, left_out = {}, {}
        for term, values in structure(model).items():
            info = model.library[term.effect]
            if term.effect == SPRING or (info.family == FRICTION and not scenario.friction):
                continue
            unknown = sorted(set(info.signals) - PLANNED)
            if info.states or unknown:
                left_out[term] = "it has a memory" if info.states else f"a plan does not know its {unknown[0]}"
                continue
            own = scenario.contact.get(term.effect, {}) if info.scope == "contact" else {}
            terms[term] = {**values, **own}
        return cls(model, terms, left_out)

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Of the parts of p that the equations read."""
        own = {str(term): len(self.model.library[term.effect].parameters) for term in self.terms}
        return {"struct": len(casadi_functions.struct_values(self.model)), "width": len(casadi_functions.WIDTHS), **own}

    def values(self, width: float) -> dict[str, list[float]]:
        """The same parts' values; width of the switches in rad/s (m/s), and their other widths with it."""
        own = {str(term): casadi_functions.ordered(self.model, term.effect, v) for term, v in self.terms.items()}
        return {"struct": casadi_functions.struct_values(self.model), "width": widths(width), **own}

    @property
    def touches(self) -> bool:
        """Whether there is a plate."""
        return Term("plate") in self.terms

    def plate_position(self, p: Callable[[str], ca.SX]) -> ca.SX:
        names = [parameter.name for parameter in self.model.library["plate"].parameters]
        return p("plate")[names.index("position")]


def widths(rate: float) -> list[float]:
    """In the order of casadi_functions.WIDTHS: rate (rad/s, m/s), and position, force, time in proportion."""
    return [rate, rate / 50.0, rate, rate / 50.0]


@dataclass(frozen=True)
class PlanInstant:
    """Expressions of one instant: q, qd, qdd (n,), spring parameters by joint, p by name.

    apart   the end-effector is known to be off the plate, so that nothing of the contact acts
    """

    physics: Physics
    q: ca.SX
    qd: ca.SX
    qdd: ca.SX
    springs: Mapping[int, ca.SX]
    p: Callable[[str], ca.SX]
    apart: bool

    def _arm(self, name: str, *inputs: Any) -> Any:
        return casadi_functions.arm_function(self.physics.model, name)(self.p("struct"), *inputs)

    @cached_property
    def tip(self) -> ca.SX:
        return self._arm("tip", self.q)

    @cached_property
    def tip_rate(self) -> ca.SX:
        return self._jacobian @ self.qd

    @cached_property
    def _jacobian(self) -> ca.SX:
        return self._arm("tip_jacobian", self.q)

    @cached_property
    def _rigid(self) -> ca.SX:
        return self._arm("inverse_dynamics", self.q, self.qd, self.qdd)

    @cached_property
    def _moments(self) -> ca.SX:
        return self._arm("moment_jacobian", self.q)

    @cached_property
    def _tip_load(self) -> ca.SX:
        return self._arm("tip_load", self.q, self.qd, self.qdd)

    @cached_property
    def torque(self) -> ca.SX:
        """(n,) motor torques, N m or N."""
        own = [self._rigid[i] for i in range(self.physics.model.n)]
        for joint, values in self.springs.items():
            own[joint - 1] += self._torque(SPRING, values, joint - 1, own, 1.0)
        # What reads the predicted torque comes last, when all the rest is in it.
        library = self.physics.model.library
        terms = [t for t in self.physics.terms if not (self.apart and library[t.effect].scope == "contact")]
        for term in sorted(terms, key=lambda t: "predicted" in library[t.effect].signals):
            for joint, first in self._joints(term):
                own[joint] += self._torque(term.effect, self.p(str(term)), joint, own, first)
        return ca.vertcat(*own)

    def _joints(self, term: Term) -> list[tuple[int, float]]:
        """Joints (0-based) on which a term acts, and 1 for the first of two joints."""
        if term.joint is None:
            return [(i, 1.0) for i in range(self.physics.model.n)]
        i = term.joint - 1
        both = self.physics.model.library[term.effect].scope == "joints"
        return [(i, 1.0), (i + 1, 0.0)] if both else [(i, 1.0)]

    def _torque(self, effect: str, values: Any, joint: int, own: list[Any], first: float) -> Any:
        def read(name: str) -> Any:
            return first if name == "has_next" else self._signal(name, joint, own)

        return casadi_functions.effect_torque(self.physics.model, effect, read, values, self.p("width"))

    def _signal(self, name: str, i: int, own: list[Any]) -> Any:
        joint, n = self.physics.model.joints[i], self.physics.model.n
        readers: dict[str, Callable[[], Any]] = {
            "q": lambda: self.q[i],
            "qd": lambda: self.qd[i],
            "qdd": lambda: self.qdd[i],
            "load": lambda: self._rigid[i] - joint.rotor_inertia * self.qdd[i],
            "predicted": lambda: own[i],
            "qd_next": lambda: self.qd[i + 1] if i + 1 < n else 0.0,
            "qd_previous": lambda: self.qd[i - 1] if i else 0.0,
            "ratio": lambda: joint.gear_ratio,
            "moment_x": lambda: self._moments[0, i],
            "moment_y": lambda: self._moments[1, i],
            "tip_load": lambda: self._tip_load[i],
            "tip_y": lambda: self.tip[1],
            "tip_yd": lambda: self.tip_rate[1],
            "tip_row": lambda: self._jacobian[1, i],
            "plate_y": lambda: self.physics.plate_position(self.p) if self.physics.touches else -1e9,
        }
        return readers[name]()
