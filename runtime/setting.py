"""Settings that users may choose, declared once as fields of a dataclass, with range and help text.

    @dataclass(frozen=True)
    class NoiseSettings(Checked):
        seed: Annotated[int, Setting("Seed of the noise.", low=0)] = 0

The command line makes its options of these fields (runtime/cli/options.py), functions take the dataclass, and
and values out of range are refused in either case.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from math import inf, isfinite
from typing import Annotated, Any, get_args, get_origin, get_type_hints


class SettingError(ValueError):
    """A setting is out of range; the message names it and the range."""


@dataclass(frozen=True)
class Setting:
    """Description of a setting.

    help       text for --help
    low, high  range of a number, both included; None: no limit
    metavar    placeholder of the value in --help; None: that of the type
    """

    help: str
    low: float | None = None
    high: float | None = None
    metavar: str | None = None

    @property
    def range(self) -> str:
        """The range in words; empty without one."""
        if self.low is None:
            return "" if self.high is None else f"at most {self.high:g}"
        return f"at least {self.low:g}" if self.high is None else f"{self.low:g} to {self.high:g}"

    def allows(self, value: Any) -> bool:
        """Whether a value lies in the range; if there is one, it must be a finite number."""
        if not self.range:
            return True
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        if isinstance(value, float) and not isfinite(value):
            return False
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)


@dataclass(frozen=True)
class DeclaredSetting:
    """A field of a dataclass of settings."""

    name: str
    type: Any
    default: Any
    setting: Setting


def split(hint: Any) -> tuple[Any, Setting | None]:
    """Type and setting of `Annotated[type, Setting(...)]`; None without a setting."""
    if get_origin(hint) is not Annotated:
        return hint, None
    kind, *notes = get_args(hint)
    return kind, next((note for note in notes if isinstance(note, Setting)), None)


def declared(settings: type[Checked]) -> Iterator[DeclaredSetting]:
    """The settings of a class, in order."""
    hints = get_type_hints(settings, include_extras=True)
    for field in fields(settings):
        kind, setting = split(hints[field.name])
        if setting is None:
            raise TypeError(f"{settings.__name__}.{field.name}: expected Annotated[type, Setting(...)]")
        yield DeclaredSetting(field.name, kind, field.default, setting)


@dataclass(frozen=True)
class Checked:
    """Settings within their ranges. Raises SettingError; None is always allowed."""

    def __post_init__(self) -> None:
        for item in declared(type(self)):
            value = getattr(self, item.name)
            if value is not None and not item.setting.allows(value):
                raise SettingError(f"{item.name} is {value!r}; expected {item.setting.range}")


LEAST_TIME_LIMIT = 0.1
"""s; of a search."""


@dataclass(frozen=True, kw_only=True)
class SearchSettings(Checked):
    """How much a search may do. It counts its iterations; only with a time limit does a clock decide anything."""

    budget: Annotated[
        int | None, Setting("Iterations that the search may make; default: all that it is made for.", 1)
    ] = None
    time_limit: Annotated[
        float | None, Setting("Longest time for the search, s; default: none.", low=LEAST_TIME_LIMIT)
    ] = None

    @property
    def seconds(self) -> float:
        """s; that the search may take; inf without a limit."""
        return inf if self.time_limit is None else self.time_limit
