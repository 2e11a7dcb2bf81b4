"""The declaration of an effect without its equations: data that effects.json contains, free of SymPy.

`to_json` and `from_json` convert the classes field by field. Other rooms decide by these fields, never by an effect's
name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from math import inf, isfinite
from types import NoneType, UnionType
from typing import Any, Generic, Literal, Protocol, TypeVar, Union, get_args, get_origin, get_type_hints

JOINT_TYPES = ("revolute", "prismatic")


class UnitOfJoint(Protocol):
    """A unit whose text depends on the joint's type."""

    def text(self, joint_type: str = "revolute") -> str:
        """The unit's text at a revolute or prismatic joint."""


@dataclass(frozen=True)
class UnitTexts:
    """A unit read from JSON: its text by joint type."""

    revolute: str
    prismatic: str

    def text(self, joint_type: str = "revolute") -> str:
        """The unit's text, e.g. `N m s/rad`."""
        return self.prismatic if joint_type == "prismatic" else self.revolute


@dataclass(frozen=True)
class Grid:
    """The grid on which a shape parameter is searched: `count` values from `low` to `high`, times a scale of the data.

    of   "one"              no scale
         "rate"             largest |qd|
         "position"         from the smallest to the largest q (low = 0, high = 1)
         "end"              from an end of the motion inwards, as parts of its range: from the largest q where the
                            parameter of the kind "side" is +1, from the smallest where it is -1
         "range"            largest minus smallest q: for a length within the motion
         "tip"              from the smallest to the largest tip_y (low = 0, high = 1)
         "load"             largest |load|
         "duration"         of the longest run, s
         "elapsed"          of the longest recording, its runs one after another, s
         "link_inertia"     median link_inertia: for a stiffness low and high are then angular frequencies squared
         "critical"         2 sqrt(k · median link_inertia), k the tried value of the parameter of the kind "stiffness"
         "line"             orders around a line of the residual's spectrum over the motor's angle: low and high are
                            offsets from it, in periods of the whole motion
         "level_per_range"  largest level over the range of q: a stiffness whose deflection is a part of the range
    """

    low: float
    high: float
    count: int
    of: Literal[
        "one",
        "rate",
        "position",
        "end",
        "range",
        "tip",
        "load",
        "duration",
        "elapsed",
        "link_inertia",
        "critical",
        "line",
        "level_per_range",
    ] = "one"
    spacing: Literal["log", "linear"] = "log"

    @property
    def continuous(self) -> bool:
        """Whether values between grid points are meaningful; not so for a side."""
        return self.spacing == "log" or self.count > 2


ParameterKind = Literal["", "stiffness", "contact", "damping", "play", "side", "begin", "end", "onset", "lead", "lag"]


@dataclass(frozen=True)
class DescribedParameter:
    """A parameter of an effect; `bounds` are physical (dissipation, order), in SI.

    role      "linear": solved exactly by identification; "shape": searched on a grid; "given": from the model file or
              `default`, because motion cannot identify it
    default   the value that the model file need not state, of a "given" parameter and of some shapes
    kind      the meaning of a parameter for searches, limits and evidence: "stiffness" (> 0) of a shape and its
              "damping"; "contact", a linear stiffness without which there is no contact; "play", from flank to flank;
              "side", +1 or -1; "begin" and "end" of an interval of positions; "onset", a start time, also tried where
              runs and gaps end; "lead", the time by which the recorded torque precedes the acting one (negative
              values cannot be simulated forwards); "lag", the time constant of a first-order lag, by which slow motion
              is delayed
    neutral   the value at which the effect vanishes
    gives     the signal that other effects read this value as; "" for none
    planned   the role in optimization: "size", which may come from a catalogue; "place", where the effect begins to
              act; "" for values that a scenario states
    scale     a typical size in SI, by which an optimization scales its unknown
    says      the words that introduce its value in a plan; None: its name
    abroad    its word in simulators' files (URDF, MJCF), if they have one: "damping" or dry "friction" of a joint,
              "stiffness" and "rest" of a spring, "lag" of an actuator, gravity along base axes
    space     exists on spatial arms only; on a planar arm the effect behaves as if it were zero
    """

    name: str
    unit: UnitOfJoint
    meaning: str
    role: Literal["linear", "shape", "given"] = "linear"
    bounds: tuple[float, float] = (-inf, inf)
    grid: Grid | None = None
    default: float | None = None
    kind: ParameterKind = ""
    neutral: float = 0.0
    gives: str = ""
    planned: Literal["", "size", "place"] = ""
    scale: float = 1.0
    says: str | None = None
    abroad: Literal["", "damping", "friction", "stiffness", "rest", "lag", "gravity x", "gravity y", "gravity z"] = ""
    space: bool = False


@dataclass(frozen=True)
class KnownSize:
    """Linear parameters, one an axis, change a vector of the model file. It then has the size that the file's has, or
    this one where the file's is nothing; or it is nothing.

    of   the key of the model file     size  SI     at_most  whether a part of the vector is in no parameter, as in a
    plane that may be inclined
    """

    of: Literal["gravity"]
    size: float
    at_most: bool = False


P = TypeVar("P", bound=DescribedParameter)


@dataclass(frozen=True, kw_only=True)
class DescribedEffect(Generic[P]):
    """One physical effect without its equations.

    name         as users write it
    scope        "joint"; "joints" (acts on a joint and the next one outwards); "arm"; "contact"
    family       a heading for lists
    parameters   linear, shape and given ones
    dissipates   its power torque * qd (of a contact: its work on the plate) is never negative within the bounds
    friction     is friction although it does not always dissipate: a curvature, a change by warmth, a bristle
    dry          dry friction that presliding bristles carry; the signal `level` is its magnitude, g(qd) of Canudas de
                 Wit et al. 1995
    has_gap      transmits nothing between two flanks; a link-side encoder shows the play
    carried      the transmission carries it to the link, like the arm's weight: it is part of the signal `load`, and
                 must read neither that nor signals that depend on other effects
    one_form     its law is one of several published forms, so that a residual may remain where the true form differs
    sits_at      the side of a torque sensor at the joint's output, if it does not follow from the other fields
    brought      belongs to a trajectory, with its own parameters: springs to plan with (scope "joint"), objects that
                 the end-effector touches (scope "contact"); a controller always compensates it
    several      a joint may have more than one; the second torque_ripple is called torque_ripple_2
    generalises  effects that are special cases of it: adding this one replaces them
    alike_at_joints  of an effect of the arm: that effect of a joint, with one value for all of them; where only one
                 joint moves, that one is named
    known_size   constraint on its linear parameters, one for each axis of a vector
    assumed      imported arms have it at every joint, with unknown values
    gives_way    the transmission is compliant, so that the joint's link affects all joints; follows from the signals
    summary      one sentence
    equation     the law as text
    trace        the pattern that it leaves in a residual, one sentence
    experiment   a motion that reveals it, one sentence
    source       literature
    """

    name: str
    scope: Literal["joint", "joints", "arm", "contact"]
    family: str
    summary: str
    equation: str
    trace: str
    experiment: str
    source: str
    dissipates: bool = False
    friction: bool = False
    dry: bool = False
    has_gap: bool = False
    carried: bool = False
    one_form: bool = False
    sits_at: Literal["motor", "link"] | None = None
    brought: bool = False
    several: bool = False
    generalises: tuple[str, ...] = ()
    alike_at_joints: str = ""
    known_size: KnownSize | None = None
    assumed: bool = False
    gives_way: bool = False
    parameters: tuple[P, ...]

    @property
    def linear(self) -> tuple[P, ...]:
        """Parameters that identification solves for exactly."""
        return tuple(p for p in self.parameters if p.role == "linear")

    @property
    def shape(self) -> tuple[P, ...]:
        """Parameters that identification searches for."""
        return tuple(p for p in self.parameters if p.role == "shape")

    @property
    def given(self) -> tuple[P, ...]:
        """Parameters that motion cannot identify."""
        return tuple(p for p in self.parameters if p.role == "given")

    @property
    def sized(self) -> bool:
        """Whether its linear parameters must keep a vector's known size."""
        return self.known_size is not None and not self.known_size.at_most

    @property
    def rubs(self) -> bool:
        """Whether it is friction: scaled by equation (7), and omitted in a frictionless plan."""
        return self.scope != "contact" and (self.friction or self.dissipates)

    @property
    def side(self) -> Literal["motor", "link"] | None:
        """The side of a torque sensor at the joint's output on which the effect acts; None if undetermined.

        Friction of one joint is assumed at the motor; weight, contact and coupling act at the link. A compliant
        transmission is in front of the sensor, but the torque that it withholds is missing behind it.
        """
        if self.sits_at is not None:
            return self.sits_at
        if self.scope != "joint" or self.gives_way:
            return "link"
        return "motor" if self.rubs else None

    @property
    def line(self) -> P | None:
        """The shape parameter that is the order of a spectral line over the motor's angle."""
        return next((p for p in self.shape if p.grid is not None and p.grid.of == "line"), None)

    def of_kind(self, kind: ParameterKind) -> P | None:
        """The first parameter of a kind."""
        return next((p for p in self.parameters if p.kind == kind), None)

    def giving(self, signal: str) -> P | None:
        """The parameter whose value is a signal for other effects."""
        return next((p for p in self.parameters if p.gives == signal), None)


AnyEffect = DescribedEffect[Any]
"""With equations or without."""


# --- several instances of an effect at one joint ---

_NUMBERED = re.compile(r"(.+)_([2-9]|[1-9][0-9]+)", re.ASCII)
E = TypeVar("E", bound="DescribedEffect[Any]")


def numbered(name: str, effects: Mapping[str, E]) -> tuple[str, int]:
    """Effect and number of a name in a model file: torque_ripple_2 is number 2; an unknown name is unchanged."""
    match = None if name in effects else _NUMBERED.fullmatch(name)
    if match and match[1] in effects and effects[match[1]].several:
        return match[1], int(match[2])
    return name, 1


def number_name(effect: str, number: int) -> str:
    """The model file's name of the first, second, ... instance of an effect."""
    return effect if number == 1 else f"{effect}_{number}"


def declared(name: str, effects: Mapping[str, E]) -> E:
    """The declaration for a name in a model file, under that name. Raises KeyError."""
    effect, number = numbered(name, effects)
    return effects[effect] if number == 1 else replace(effects[effect], name=name)


# --- JSON ---


def to_json(value: Any, kind: Any = None) -> Any:
    """`value` as JSON, data classes by the fields of `kind` (None: their own). Infinite numbers are null, and a unit is
    its text by joint type."""
    kind = _plain(type(value) if kind is None else kind)
    if kind in (UnitOfJoint, UnitTexts):
        return {joint_type: value.text(joint_type) for joint_type in JOINT_TYPES}
    if isinstance(value, tuple):
        item = (*get_args(kind), None)[0]
        return [to_json(each, item) for each in value]
    if is_dataclass(value):
        return {name: to_json(getattr(value, name), hint) for name, hint in field_types(kind).items()}
    if isinstance(value, float) and not isfinite(value):
        return None
    return value


def from_json(kind: Any, data: Any) -> Any:
    """The inverse of `to_json` for a type; null is an infinite number where a number is required."""
    plain: Any = _plain(kind)
    if data is None and plain is not kind:
        return None
    if plain is UnitOfJoint:
        return UnitTexts(**data)
    if is_dataclass(plain):
        shape: Any = plain
        return shape(**{name: from_json(hint, data[name]) for name, hint in field_types(shape).items()})
    if plain == tuple[float, float]:
        low, high = data
        return (-inf if low is None else float(low), inf if high is None else float(high))
    if get_origin(plain) is tuple:
        return tuple(from_json(get_args(plain)[0], each) for each in data)
    return data


def _plain(kind: Any) -> Any:
    """An optional type without None; a type variable's bound."""
    if isinstance(kind, TypeVar):
        return kind.__bound__
    if get_origin(kind) in (Union, UnionType):
        (kind,) = (each for each in get_args(kind) if each is not NoneType)
    return kind


@cache
def field_types(shape: Any) -> Mapping[str, Any]:
    """Names and types of a data class's fields, in order."""
    hints = get_type_hints(shape)
    return {f.name: hints[f.name] for f in fields(shape)}
