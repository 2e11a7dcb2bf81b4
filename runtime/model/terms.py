"""Terms of a model's equation of motion: effects at joints, their known values, and the signals that they read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.model.loader import Library, Model
from symbolic.described import number_name, numbered
from symbolic.model_file.checks import ModelError, at_joint

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
"""Active terms with their known parameter values."""


def structure(model: Model) -> Structure:
    """The terms of the model file."""
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
    """Raises ModelError if a parameter has no value, which planning and simulation need."""
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
            f"{model.name}: this needs values that the model file leaves out ({'; '.join(places)}); state them, or "
            "find them with tendon identify MODEL RECORDING --write"
        )


def joints_of(model: Model, term: Term) -> tuple[int, ...]:
    """Indices (0-based) of the joints whose torque the term changes, its own first."""
    if term.joint is None:
        return tuple(range(model.n))
    info = model.library.effects[term.effect]
    if info.scope == "joints":
        return (term.joint - 1, term.joint)
    if info.gives_way:
        return (term.joint - 1, *(i for i in range(model.n) if i != term.joint - 1))
    return (term.joint - 1,)


SURFACE = "plate_y"
"""The signal with the height of the surface at the tip, a parameter of a contact effect."""


def known_vector(model: Model, term: Term) -> tuple[Array, float] | None:
    """A vector of the model file that a term changes, and its size; None for other terms."""
    info = model.library.effects[term.effect]
    if info.known_size is None:
        return None
    stated = np.array(getattr(model, info.known_size.of))[: len(info.linear)]
    return stated, float(np.linalg.norm(stated)) or info.known_size.size


def giver(library: Library, terms: Iterable[Term], signal: str) -> tuple[Term, str] | None:
    """The term with a parameter that is this signal for other effects, and the parameter's name, if any."""
    for term in terms:
        parameter = library[term.effect].giving(signal)
        if parameter is not None:
            return term, parameter.name
    return None


def given(library: Library, values: Mapping[Term, Values], signal: str) -> float | None:
    """The value of a signal that is a parameter of one of these terms; None: there is none, or it is unknown."""
    found = giver(library, values, signal)
    return None if found is None else values[found[0]].get(found[1])


def unit_of(model: Model, term: Term, parameter: str) -> str:
    """Unit of a parameter at its joint, as text."""
    info = model.library.effects[term.effect].parameter(parameter)
    return info.unit.text(model.joints[(term.joint or 1) - 1].type)


@dataclass(frozen=True)
class Prediction:
    """The result of a fit: base inertial parameters (p,) and all parameter values of all terms.

    rotors   joint (0-based) -> rotor inertia, where the model file leaves it out and a term determines it
    """

    lumps: Array
    values: Mapping[Term, Values]
    rotors: Mapping[int, float] = field(default_factory=dict)


def at(term: Term) -> str:
    """Where a term acts, as text after its name."""
    return at_joint(term.joint)


class UnknownHere(LookupError):
    """A signal that its context does not know."""


class SignalContext(ABC):
    """The signals that effects read: numbers (N,) along samples, or expressions of one instant.

    A context implements what it knows; other methods raise UnknownHere.
    """

    model: Model

    @abstractmethod
    def coordinate(self, name: str) -> Any:
        """q, qd or qdd of the joints, indexed by the joint (0-based)."""

    @abstractmethod
    def evaluate(self, function: str) -> Any:
        """The output of a generated function of the arm for this motion."""

    @abstractmethod
    def given(self, name: str) -> Any | None:
        """The signal that is a parameter of an active effect; None: there is none."""

    def growth(self, function: str, by: str, own: int) -> Any:
        """Derivative of a function of the arm, one entry per joint, by q or qd (`by`) of the joint `own`."""
        raise UnknownHere(f"the derivative of {function} by {by} of joint {own + 1}")

    def time(self) -> Any:
        """Time in s since the start of the run."""
        raise UnknownHere("the time")

    def elapsed(self) -> Any:
        """Time in s since the start of the recording, with its runs one after another."""
        return self.time()

    def terms(self) -> Collection[Term]:
        """The active terms."""
        raise UnknownHere("the active terms")

    def torque(self, term: Term, joint: int) -> Any:
        """Torque of a term at a joint (0-based)."""
        raise UnknownHere(f"the torque of {term} at joint {joint + 1}")

    def predicted(self, joint: int) -> Any:
        """Predicted motor torque at a joint (0-based)."""
        raise UnknownHere(f"the predicted torque of joint {joint + 1}")

    def predicted_rate(self, joint: int) -> Any:
        """Time derivative of the predicted torque."""
        raise UnknownHere(f"the rate of joint {joint + 1}'s predicted torque")

    def warmth(self, joint: int) -> Any | None:  # noqa: ARG002
        """Rise of the measured temperature in K; None: not measured."""
        return None

    @cached_property
    def _outputs(self) -> dict[str, Any]:
        return {}

    def arm(self, function: str) -> Any:
        """As `evaluate`, but computed only once."""
        if function not in self._outputs:
            self._outputs[function] = self.evaluate(function)
        return self._outputs[function]

    def signal(self, name: str, joint: int, own: int | None) -> Any:
        """A signal at a joint (0-based) for an effect at the joint `own`; None: an effect of the arm or the contact."""
        source = self.model.library.signal[name].source
        if source is None:
            return self._of_others(name, joint, own)
        at = joint if own is None else own
        match source["kind"]:
            case "Given":
                value = self.given(name)
                return source["absent"] if value is None else value
            case "Coordinate":
                there = joint + source["step"]
                return self.coordinate(source["name"])[there] if 0 <= there < self.model.n else 0.0
            case "ArmOutput":
                joints = {"joint": joint, "own": at}
                shape = self.model.metadata["functions"][source["function"]]["outputs"][0][1]
                index = tuple(joints.get(i, i) for i in source["index"][: len(shape)])
                return self.arm(source["function"])[index if len(index) > 1 else index[0]]
            case "ArmSlope":
                return self.growth(source["function"], source["by"], at)[joint]
            case "JointConstant":
                return getattr(self.model.joints[joint], source["name"])
        raise ValueError(source["kind"])

    def _of_others(self, name: str, joint: int, own: int | None) -> Any:
        """A signal without a source: of time, temperature or other effects."""
        library = self.model.library
        match name:
            case "t":
                return self.time()
            case "elapsed":
                return self.elapsed()
            case "level":
                dry = (Term(name, joint + 1) for name, info in library.effects.items() if info.dry)
                return abs(sum(self.torque(term, joint) for term in dry if term in self.terms()))
            case "load":
                borne = (t for t in self.terms() if library[t.effect].carried and joint in joints_of(self.model, t))
                return self.arm("link_load")[joint] + sum(self.torque(term, joint) for term in borne)
            case "predicted":
                return self.predicted(joint)
            case "predicted_rate":
                return self.predicted_rate(joint)
            case "warmth":
                warmth = self.warmth(joint)
                return 0.0 if warmth is None else warmth
            case "unmeasured":
                return 1.0 if self.warmth(joint) is None else 0.0
            case "has_next":
                return 1.0 if joint == own else 0.0
        raise KeyError(name)

    def reader(self, term: Term, joint: int) -> Callable[[str], Any]:
        """Signals by name as a term reads them for its torque at a joint (0-based)."""
        library = self.model.library
        own = None if term.joint is None else term.joint - 1
        elsewhere = own is not None and library[term.effect].gives_way

        def read(name: str) -> Any:
            # At another joint, the torque of an elastic effect is that of its own joint times a signal between both.
            at = own if elsewhere and own is not None and not library.signal[name].between else joint
            return self.signal(name, at, own)

        return read


IDENTIFIED = frozenset({"arm", "friction", "effect", "torque", "torque_rate"})
"""Needs that require an identified model; all others require only the motion."""
OF_OTHERS = frozenset({"friction", "effect", "torque", "torque_rate"})
"""Needs that depend on other effects."""
OF_DRIVE = frozenset({"torque", "torque_rate"})
"""Needs of effects of the drive, between commanded and acting torque."""


def unknown_to_plan(library: Library, effect: str) -> list[str]:
    """Signals of the effect that are unknown in planning, in alphabetical order."""
    return sorted(name for name in library[effect].signals if library.signal[name].known_to == "recording")


def steps(library: Library, effect: str) -> list[int]:
    """Distances, in joints outwards, to the joints whose motion the effect reads."""
    sources = (library.signal[name].source for name in library[effect].signals)
    return [source["step"] for source in sources if source is not None and "step" in source]


def sensors(library: Library, effect: str) -> frozenset[str]:
    """Sensors that measure a signal of the effect: "link", "temperature", "force"."""
    found = (library.signal[name].sensor for name in library[effect].signals)
    return frozenset(sensor for sensor in found if sensor is not None)


def reads_arm(library: Library, effect: str, known: str) -> bool:
    """Whether the effect reads a function of the arm other than `known`."""
    sources = (library.signal[name].source for name in library[effect].signals)
    return any(source is not None and source.get("function", known) != known for source in sources)
