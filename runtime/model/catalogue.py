"""Generated metadata of joints, base inertial parameters, signals and effects, as dataclasses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import atan2, cos, nan, prod, sin
from typing import Any, cast

from symbolic.described import DescribedEffect, DescribedParameter, from_json
from symbolic.model_file.arm import DescribedJoint


class LoaderError(ValueError):
    """Arrays or names that do not fit the model; the message says what was expected."""


@dataclass(frozen=True)
class SignalInfo:
    """A signal that effects may read; see symbolic/effects/signals.py.

    source   its kind and fields; None for a signal that depends on other effects or samples
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
        """Whether it relates the joint of an effect to the joint whose torque is computed."""
        source = self.source
        return source is not None and (source["kind"] == "ArmSlope" or "own" in source.get("index", ()))


@dataclass(frozen=True, kw_only=True)
class EffectInfo(DescribedEffect[DescribedParameter]):
    """A declared effect with compiled equations.

    signals        names of the signals that it reads
    coefficients     unknowns of the linear fit
    from_parameters  them as functions of the parameters, in prefix form, where they are others than the linear ones
    recover          and the linear parameters as functions of them
    states           names of its states            deflection   the state that a link-side encoder measures
    """

    signals: tuple[str, ...]
    coefficients: tuple[DescribedParameter, ...]
    from_parameters: tuple[Any, ...] | None
    recover: tuple[Any, ...] | None
    states: tuple[str, ...]
    deflection: str | None

    def parameter(self, name: str) -> DescribedParameter:
        """The parameter of this name. Raises LoaderError."""
        for p in self.parameters:
            if p.name == name:
                return p
        names = ", ".join(p.name for p in self.parameters)
        raise LoaderError(f'effect "{self.name}" has no parameter "{name}"; it has: {names or "none"}')


@dataclass(frozen=True)
class LumpInfo:
    """A base inertial parameter.

    joint   counted from 1     value   from the model file; None: unknown
    parts   of a spatial arm: (joint, inertial parameter of its body or rotor, coefficient), whose sum it is
    """

    name: str
    unit: str
    meaning: str
    joint: int
    value: float | None
    parts: Sequence[Sequence[Any]] = ()


@dataclass(frozen=True)
class JointInfo(DescribedJoint):
    """A joint of the model file. units: of "force" and "position"; unknown: inertial keys missing in the file."""

    units: Mapping[str, str] = field(kw_only=True)
    unknown: tuple[str, ...] = field(kw_only=True)

    @property
    def position_limits(self) -> tuple[float, float] | None:
        """(low, high) in rad or m; None: not stated."""
        return self.limits.position

    @property
    def speed_limit(self) -> float | None:
        """rad/s or m/s; None: not stated."""
        return self.limits.speed

    @property
    def torque_limit(self) -> float | None:
        """N m or N; None: not stated."""
        return self.limits.torque

    @property
    def force_unit(self) -> str:
        """Unit of its torque."""
        return self.units["force"]

    @property
    def position_unit(self) -> str:
        """Unit of its position."""
        return self.units["position"]


def joint_info(data: Mapping[str, Any]) -> JointInfo:
    """A joint from metadata.json."""
    return cast(JointInfo, from_json(JointInfo, {"unknown": [], **data}))


def evaluate(form: Any, known: Mapping[str, float]) -> float:
    """The value of a prefix form (symbolic.effects.declaration.prefix); nan after a division by zero."""
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
    "cos": lambda a: cos(a[0]),
    "sin": lambda a: sin(a[0]),
}


def effects_of(listed: Iterable[Mapping[str, Any]]) -> dict[str, EffectInfo]:
    """The effects of effects.json by name."""
    return {e["name"]: cast(EffectInfo, from_json(EffectInfo, e)) for e in listed}
