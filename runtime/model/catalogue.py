"""What generated metadata says of joints, lumps, effects and their parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import atan2, nan, prod
from typing import Any, cast

from symbolic.described import DescribedEffect, DescribedParameter, from_json


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


@dataclass(frozen=True, kw_only=True)
class EffectInfo(DescribedEffect[DescribedParameter]):
    """An effect as declared, its equations compiled.

    signals        names of those that it reads
    coefficients   what identification solves for; recover: the linear parameters in them, as `prefix` writes it
    states         names; deflection: the one that a link-side encoder measures
    """

    signals: tuple[str, ...]
    coefficients: tuple[DescribedParameter, ...]
    recover: tuple[Any, ...] | None
    states: tuple[str, ...]
    deflection: str | None

    def parameter(self, name: str) -> DescribedParameter:
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


def effect_info(data: Mapping[str, Any]) -> EffectInfo:
    return cast(EffectInfo, from_json(EffectInfo, data))
