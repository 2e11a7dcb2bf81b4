"""What a declaration of an effect says without equations: fields that are data, shared with whoever reads effects.json.

No SymPy here, and no list of the fields but the classes themselves: `to_json` and `from_json` walk them. What other
rooms need to know of an effect, of its parameters and of its states stands here; nothing asks for a name.
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
    """A unit that a revolute and a prismatic joint may read differently."""

    def text(self, joint_type: str = "revolute") -> str:
        """The unit in letters, of a revolute joint or of a prismatic one."""


@dataclass(frozen=True)
class UnitTexts:
    """A unit as it is read back: its text by type of joint."""

    revolute: str
    prismatic: str

    def text(self, joint_type: str = "revolute") -> str:
        """For people, e.g. `N m s/rad`."""
        return self.prismatic if joint_type == "prismatic" else self.revolute


@dataclass(frozen=True)
class Grid:
    """Where a shape parameter is looked for: `count` values from `low` to `high` times the data's `of`.

    of   "one"              as they are
         "rate"             largest |qd|
         "position"         from the smallest to the largest q (low = 0, high = 1)
         "end"              from the end of the motion inwards, as parts of its range: from the largest q for a
                            parameter of the kind "side" of +1, from the smallest for -1
         "range"            largest q less smallest: for a length within the motion
         "tip"              from the smallest to the largest tip_y (low = 0, high = 1)
         "load"             largest |load|
         "duration"         of the longest run, s
         "elapsed"          of the longest recording, its runs one after another, s
         "link_inertia"     median link_inertia: for a stiffness low and high are then angular frequencies squared
         "critical"         2 sqrt(k · median link_inertia), k the parameter of the kind "stiffness" that is tried
         "line"             from an order of a line of the residual's spectrum over the motor's angle, in periods of the
                            whole motion: low and high are then its surroundings, and no order is the highest
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
        """Whether values between those of the grid have a meaning: not so for a side."""
        return self.spacing == "log" or self.count > 2


ParameterKind = Literal["", "stiffness", "damping", "play", "side", "begin", "end", "onset", "lead"]


@dataclass(frozen=True)
class DescribedParameter:
    """A parameter of an effect; `bounds` are physical (dissipation, order), in SI.

    role      "linear": solved exactly by identification; "shape": searched on a grid; "given": from the model file or
              `default`, because no motion can tell it
    default   the value of a "given" parameter that the model file does not state
    kind      what searches and limits take a shape parameter for: "stiffness", more than 0, and the "damping" beside
              it; "play", from flank to flank; "side", +1 or -1; "begin" and "end" of a stretch; "onset", a time from
              which it acts, tried also where runs and gaps end; "lead", by which the recorded torque is ahead of the
              acting one (less than 0 cannot be simulated forwards)
    neutral   the value at which the effect vanishes
    gives     the signal that its value is for the effects beside it; "" for none
    planned   what an optimization seeks of an effect that a trajectory brings: its "size", which may be chosen from a
              catalogue, and the "place" where it begins to act; "" for what a scenario states
    scale     a typical size, SI: an optimization counts in it, so that its unknown is about one
    says      the words with which a plan gives its value; None: its name
    abroad    what files of simulators (URDF, MJCF) call it, where they have it: the "damping" or the dry "friction" of
              a joint, the "stiffness" of a spring and its "rest"; gravity along the base's axes
    space     only an effect of an arm in space has it; on a planar one it is as if it were zero
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
    abroad: Literal["", "damping", "friction", "stiffness", "rest", "gravity x", "gravity y", "gravity z"] = ""
    space: bool = False


P = TypeVar("P", bound=DescribedParameter)


@dataclass(frozen=True, kw_only=True)
class DescribedEffect(Generic[P]):
    """One physical effect, as far as words and numbers go.

    name         as users write it
    scope        "joint"; "joints" (acts on a joint and the next one outwards); "arm"; "contact"
    family       a heading for lists; nothing is decided by it
    parameters   linear, shape and given ones
    dissipates   its power torque * qd is never negative within the bounds (or, for contact, work on the plate)
    friction     is friction although it does not always dissipate: a curvature, a change by warmth, a bristle
    dry          dry friction that presliding bristles carry: what the signal `level` is the magnitude of; g(qd) of
                 Canudas de Wit et al. 1995
    has_gap      between two flanks nothing is transmitted; a link-side encoder shows the play
    carried      the transmission carries it on to the link, as it carries the weight of the arm: it belongs to the
                 signal `load`, so that it may read neither that nor what hangs on other effects
    one_form     its law is one of many forms of such an effect: what it leaves is where it differs from the true one
    sits_at      on which side of a torque sensor at the joint's output, where `side` does not follow from the rest
    brought      a trajectory brings it along, with parameters of its own: springs to plan with (scope "joint"), what
                 the end-effector touches (scope "contact"); a controller always compensates it
    several      a joint may have more than one, each with values of its own: the second of torque_ripple is called
                 torque_ripple_2
    generalises  effects whose torques are special cases: adding this one replaces them
    assumed      every joint of an arm from elsewhere is taken to have it until recordings say otherwise
    gives_way    the transmission gives way: what the own joint's link does is felt at all joints; set by the signals
                 that it reads
    summary      one sentence
    equation     the law as a person writes it
    trace        what it leaves in a residual, one sentence
    experiment   the motion that would bring it out, one sentence
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
        """Parameters that no motion tells."""
        return tuple(p for p in self.parameters if p.role == "given")

    @property
    def rubs(self) -> bool:
        """Whether it is friction: what (7) scales, and what a frictionless plan leaves out."""
        return self.scope != "contact" and (self.friction or self.dissipates)

    @property
    def side(self) -> Literal["motor", "link"] | None:
        """Of a torque sensor at the joint's output, on which the effect acts; None where nothing tells.

        What rubs at one joint is taken to sit at the motor; what weighs, touches or couples links, at the link. The
        transmission lies before the sensor, but the torque that it withholds is missing behind it.
        """
        if self.sits_at is not None:
            return self.sits_at
        if self.scope != "joint" or self.gives_way:
            return "link"
        return "motor" if self.rubs else None

    @property
    def line(self) -> P | None:
        """The shape parameter that is an order of a line over the motor's angle."""
        return next((p for p in self.shape if p.grid is not None and p.grid.of == "line"), None)

    def of_kind(self, kind: ParameterKind) -> P | None:
        """The first parameter of a kind."""
        return next((p for p in self.parameters if p.kind == kind), None)

    def giving(self, signal: str) -> P | None:
        """The parameter whose value is a signal for others."""
        return next((p for p in self.parameters if p.gives == signal), None)


AnyEffect = DescribedEffect[Any]
"""With equations or without."""


# --- several of an effect at one place ---

_NUMBERED = re.compile(r"(.+)_([2-9]|[1-9][0-9]+)", re.ASCII)
E = TypeVar("E", bound="DescribedEffect[Any]")


def numbered(name: str, effects: Mapping[str, E]) -> tuple[str, int]:
    """The effect that a name in a model file means, and which of several at its place: torque_ripple_2, the second.

    A name that means no effect is its own.
    """
    match = None if name in effects else _NUMBERED.fullmatch(name)
    if match and match[1] in effects and effects[match[1]].several:
        return match[1], int(match[2])
    return name, 1


def number_name(effect: str, number: int) -> str:
    """The name of the first, second, ... of an effect at one place."""
    return effect if number == 1 else f"{effect}_{number}"


def declared(name: str, effects: Mapping[str, E]) -> E:
    """The declaration that a name in a model file means, under that name. Raises KeyError."""
    effect, number = numbered(name, effects)
    return effects[effect] if number == 1 else replace(effects[effect], name=name)


# --- JSON ---


def to_json(value: Any, kind: Any = None) -> Any:
    """`value` as JSON, its data classes by the fields that the class `kind` declares (None: its own).

    Infinite numbers are null, and a unit is its text by type of joint.
    """
    kind = _plain(type(value) if kind is None else kind)
    if kind in (UnitOfJoint, UnitTexts):
        return {joint_type: value.text(joint_type) for joint_type in JOINT_TYPES}
    if isinstance(value, tuple):
        item = (*get_args(kind), None)[0]
        return [to_json(each, item) for each in value]
    if is_dataclass(value):
        return {name: to_json(getattr(value, name), hint) for name, hint in _fields(kind).items()}
    if isinstance(value, float) and not isfinite(value):
        return None
    return value


def from_json(kind: Any, data: Any) -> Any:
    """What `to_json` made of a value of this type; null is an infinite number where there must be one."""
    plain: Any = _plain(kind)
    if data is None and plain is not kind:
        return None
    if plain is UnitOfJoint:
        return UnitTexts(**data)
    if is_dataclass(plain):
        shape: Any = plain
        return shape(**{name: from_json(hint, data[name]) for name, hint in _fields(shape).items()})
    if plain == tuple[float, float]:
        low, high = data
        return (-inf if low is None else float(low), inf if high is None else float(high))
    if get_origin(plain) is tuple:
        return tuple(from_json(get_args(plain)[0], each) for each in data)
    return data


def _plain(kind: Any) -> Any:
    """A type without its None; for a variable, its bound."""
    if isinstance(kind, TypeVar):
        return kind.__bound__
    if get_origin(kind) in (Union, UnionType):
        (kind,) = (each for each in get_args(kind) if each is not NoneType)
    return kind


@cache
def _fields(shape: Any) -> Mapping[str, Any]:
    """Names and types of a data class's fields, in order."""
    hints = get_type_hints(shape)
    return {f.name: hints[f.name] for f in fields(shape)}
