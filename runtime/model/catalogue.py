"""What generated metadata says of joints, lumps, effects and their parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import atan2, inf, nan, prod
from typing import Any, Literal


class LoaderError(ValueError):
    """Arrays or names that do not fit the model; the message says what was expected."""


@dataclass(frozen=True)
class SignalInfo:
    """A signal that effects may read; see symbolic/effects/signals.py.

    source   its kind and fields; None for one that needs what surrounds the sample
    """

    name: str
    unit: Mapping[str, str]
    meaning: str
    needs: str
    source: Mapping[str, Any] | None
    known_to: str
    seen_over: str | None
    sensor: str | None

    @property
    def between(self) -> bool:
        """Whether it stands between the joint where an effect sits and the one whose torque is asked for."""
        return self.source is not None and "own" in self.source.get("index", ())


@dataclass(frozen=True)
class GridInfo:
    """Where a shape parameter is looked for; see symbolic/effects/declaration.py."""

    low: float
    high: float
    count: int
    of: str
    spacing: str

    @property
    def continuous(self) -> bool:
        """Whether values between those of the grid have a meaning: not so for a side."""
        return self.spacing == "log" or self.count > 2


@dataclass(frozen=True)
class ParameterInfo:
    """A parameter of an effect: role "linear", "shape" or "given" (then with a default), physical bounds
    (±inf where there is none)."""

    name: str
    units: Mapping[str, str]
    meaning: str
    role: str
    bounds: tuple[float, float]
    grid: GridInfo | None
    default: float | None
    gives: str

    def unit(self, joint_type: str = "revolute") -> str:
        """For people, e.g. `N m s/rad`."""
        return self.units[joint_type]


_SIDES: dict[str, Literal["motor", "link"]] = {
    "friction": "motor",
    "drive": "motor",
    "spring": "link",
    "load": "link",
    "contact": "link",
    "transmission": "link",
}


@dataclass(frozen=True)
class EffectInfo:
    """An effect as declared, without its equations in symbols."""

    name: str
    scope: str
    family: str
    summary: str
    equation: str
    trace: str
    experiment: str
    source: str
    dissipates: bool
    generalises: tuple[str, ...]
    signals: tuple[str, ...]
    gives_way: bool
    parameters: tuple[ParameterInfo, ...]
    coefficients: tuple[ParameterInfo, ...]
    recover: tuple[Any, ...] | None
    states: tuple[str, ...]

    @property
    def side(self) -> Literal["motor", "link"] | None:
        """Of a torque sensor at the joint's output, on which the effect acts; None for a family that does not tell.

        What rubs and drives is taken to sit at the motor, what springs, weighs and touches at the link. The
        transmission lies before the sensor, but the torque that it withholds is missing behind it.
        """
        return _SIDES.get(self.family)

    @property
    def linear(self) -> tuple[ParameterInfo, ...]:
        return tuple(p for p in self.parameters if p.role == "linear")

    @property
    def shape(self) -> tuple[ParameterInfo, ...]:
        return tuple(p for p in self.parameters if p.role == "shape")

    def giving(self, signal: str) -> ParameterInfo | None:
        """The parameter whose value is a signal for others."""
        return next((p for p in self.parameters if p.gives == signal), None)

    def parameter(self, name: str) -> ParameterInfo:
        for p in self.parameters:
            if p.name == name:
                return p
        names = ", ".join(p.name for p in self.parameters)
        raise LoaderError(f'effect "{self.name}" has no parameter "{name}"; it has: {names or "none"}')


@dataclass(frozen=True)
class LumpInfo:
    """A base inertial parameter: value from the model file; joint counts from 1."""

    name: str
    unit: str
    meaning: str
    joint: int
    value: float


@dataclass(frozen=True)
class DriveInfo:
    """A joint's drive on a CAN bus: node id; direction 1 or −1; rated torque of the motor in N m, None: as it says."""

    node: int
    direction: int
    rated_torque: float | None


@dataclass(frozen=True)
class JointInfo:
    """A joint as the model file has it; effects: name -> parameter values (those that are known)."""

    type: str
    rotor_inertia: float
    gear_ratio: float
    torque_constant: float | None
    position_limits: tuple[float, float] | None
    speed_limit: float | None
    torque_limit: float | None
    gains: Mapping[str, float] | None
    encoder_counts: int | None
    encoder_zero: int
    drive: DriveInfo | None
    effects: Mapping[str, Mapping[str, float]]
    force_unit: str
    position_unit: str


def joint_info(data: Mapping[str, Any]) -> JointInfo:
    limits = data["limits"]
    return JointInfo(
        type=data["type"],
        rotor_inertia=data["rotor_inertia"],
        gear_ratio=data["gear_ratio"],
        torque_constant=data["torque_constant"],
        position_limits=None if limits["position"] is None else tuple(limits["position"]),
        speed_limit=limits["speed"],
        torque_limit=limits["torque"],
        gains=data["gains"],
        encoder_counts=data["encoder_counts"],
        encoder_zero=data["encoder_zero"],
        drive=None if data["drive"] is None else DriveInfo(**data["drive"]),
        effects=data["effects"],
        force_unit=data["units"]["force"],
        position_unit=data["units"]["position"],
    )


def evaluate(form: Any, known: Mapping[str, float]) -> float:
    """A form of symbolic.effects.declaration.prefix; nan where it has no value (a division by zero)."""
    if isinstance(form, str):
        return known[form]
    if isinstance(form, list):
        arguments = [evaluate(argument, known) for argument in form[1:]]
        try:
            return float(_OPERATIONS[form[0]](arguments))
        except (ZeroDivisionError, OverflowError):
            return nan
    return float(form)


_OPERATIONS: dict[str, Callable[[list[float]], float]] = {
    "add": sum,
    "mul": prod,
    "pow": lambda a: a[0] ** a[1],
    "atan2": lambda a: atan2(a[0], a[1]),
}


def _parameter(data: Mapping[str, Any]) -> ParameterInfo:
    low, high = data["bounds"]
    return ParameterInfo(
        name=data["name"],
        units=data["unit"],
        meaning=data["meaning"],
        role=data["role"],
        bounds=(-inf if low is None else float(low), inf if high is None else float(high)),
        grid=None if data["grid"] is None else GridInfo(**data["grid"]),
        default=data["default"],
        gives=data["gives"],
    )


def effect_info(data: Mapping[str, Any]) -> EffectInfo:
    plain = {key: data[key] for key in ("name", "scope", "family", "summary", "equation", "trace", "experiment")}
    return EffectInfo(
        **plain,
        source=data["source"],
        dissipates=data["dissipates"],
        generalises=tuple(data["generalises"]),
        signals=tuple(data["signals"]),
        gives_way=data["gives_way"],
        parameters=tuple(_parameter(p) for p in data["parameters"]),
        coefficients=tuple(_parameter(c) for c in data["coefficients"]),
        recover=None if data["recover"] is None else tuple(data["recover"]),
        states=tuple(data["states"]),
    )
