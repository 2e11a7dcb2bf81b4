"""Terms of a model's equation of motion: effects at joints, what is known of them and where they act."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime.model.loader import Library, Model
from symbolic.described import number_name, numbered
from symbolic.model_file.checks import ModelError, at_joint

Array = NDArray[np.float64]
Values = dict[str, float]


@dataclass(frozen=True, order=True)
class Term:
    """An effect at a joint (1-based), or of the whole arm or the contact (joint None).

    number   which of several of that effect at the joint
    """

    effect: str
    joint: int | None = None
    number: int = 1

    def __str__(self) -> str:
        return self.name if self.joint is None else f"{self.name}@{self.joint}"

    @property
    def name(self) -> str:
        """As the model file calls it: torque_ripple, torque_ripple_2."""
        return number_name(self.effect, self.number)


Structure = dict[Term, Values]
"""Active terms with the parameter values that are known."""


def structure(model: Model) -> Structure:
    """What the model file activates."""
    found: Structure = {}
    for number, joint in enumerate(model.joints, start=1):
        for name, values in joint.effects.items():
            effect, which = numbered(name, model.library.effects)
            found[Term(effect, number, which)] = dict(values)
    for name, values in model.effects.items():
        found[Term(name)] = dict(values)
    if model.contact is not None:
        for name, values in model.contact["effects"].items():
            found[Term(name)] = dict(values)
    return found


def check_complete(model: Model, terms: Mapping[Term, Values]) -> None:
    """Raise ModelError where a parameter of an effect has no value: with it, nothing can be planned or simulated."""
    lacking: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for term, values in terms.items():
        unknown = tuple(
            p.name for p in model.library[term.effect].parameters if p.name not in values and p.default is None
        )
        if unknown:
            lacking.setdefault((term.name, unknown), []).extend([] if term.joint is None else [str(term.joint)])
    if lacking:
        places = (
            f"{name}{'@' * bool(joints)}{','.join(joints)}: {', '.join(unknown)}"
            for (name, unknown), joints in lacking.items()
        )
        raise ModelError(
            f"{model.name}: this needs values that the model file leaves out ({'; '.join(places)}); state them, or let "
            "tendon identify MODEL RECORDING --write find them"
        )


def joints_of(model: Model, term: Term) -> tuple[int, ...]:
    """Indices (0-based) of the joints on whose torque the term acts, its own first."""
    if term.joint is None:
        return tuple(range(model.n))
    info = model.library.effects[term.effect]
    if info.scope == "joints":
        return (term.joint - 1, term.joint)
    if info.gives_way:
        return (term.joint - 1, *(i for i in range(model.n) if i != term.joint - 1))
    return (term.joint - 1,)


SURFACE = "plate_y"
"""The signal that says where the end-effector touches something: the value of a parameter of an effect."""


def giver(library: Library, terms: Iterable[Term], signal: str) -> tuple[Term, str] | None:
    """The term of which a parameter is a signal for the effects beside it, and that parameter's name."""
    for term in terms:
        parameter = library[term.effect].giving(signal)
        if parameter is not None:
            return term, parameter.name
    return None


def given(library: Library, values: Mapping[Term, Values], signal: str) -> float | None:
    """The signal that a parameter of one of these terms is; None where there is none or its value is not known."""
    found = giver(library, values, signal)
    return None if found is None else values[found[0]].get(found[1])


def unit_of(model: Model, term: Term, parameter: str) -> str:
    """Unit of a parameter at this joint, for people."""
    info = model.library.effects[term.effect].parameter(parameter)
    return info.unit.text(model.joints[(term.joint or 1) - 1].type)


@dataclass(frozen=True)
class Prediction:
    """Base inertial parameters (p,) and all parameter values of all terms: what a fit found.

    rotors   inertia of the rotors, by joint (0-based), where the model file leaves it out and a term told it
    """

    lumps: Array
    values: Mapping[Term, Values]
    rotors: Mapping[int, float] = field(default_factory=dict)


def at(term: Term) -> str:
    """Where a term acts, after its name."""
    return at_joint(term.joint)
