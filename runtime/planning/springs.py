"""The springs that a trajectory brings along: known by their declarations, whatever their names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from runtime.model.loader import Model
from runtime.model.terms import Term, Values
from runtime.planning.scenario import Scenario, SpringPlan
from symbolic.described import DescribedEffect, DescribedParameter

Declared = Mapping[str, DescribedEffect[Any]]
"""Effects by name, as a library has them."""


def is_spring(info: DescribedEffect[Any]) -> bool:
    """Whether a trajectory brings it along for a joint."""
    return info.brought and info.scope == "joint"


def springs(effects: Declared) -> dict[str, DescribedEffect[Any]]:
    """All of them by name; the first is meant where nobody names one."""
    return {name: info for name, info in effects.items() if is_spring(info)}


def usual(effects: Declared) -> str:
    """The one that is meant where nobody names one."""
    return next(iter(springs(effects)))


def size(info: DescribedEffect[Any]) -> DescribedParameter:
    """What is bought of a spring: the parameter planned as its size."""
    return next(p for p in info.parameters if p.planned == "size")


def place(info: DescribedEffect[Any]) -> DescribedParameter | None:
    """Where it begins to pull, if that is sought, too."""
    return next((p for p in info.parameters if p.planned == "place"), None)


@dataclass(frozen=True)
class SoughtSpring:
    """A spring of a scenario with its declaration. Unknowns count in the scales of their parameters."""

    plan: SpringPlan
    info: DescribedEffect[Any]

    @property
    def term(self) -> Term:
        return Term(self.info.name, self.plan.joint)

    @cached_property
    def size(self) -> DescribedParameter:
        return size(self.info)

    @cached_property
    def place(self) -> DescribedParameter | None:
        return place(self.info)

    @cached_property
    def sought(self) -> tuple[DescribedParameter, ...]:
        """In the order of the unknowns, which is that of the declaration."""
        return tuple(p for p in self.info.parameters if p.name in self.plan.sought)

    @property
    def bounds(self) -> tuple[tuple[float, float], ...]:
        """Of the sought parameters, SI."""
        return tuple(self.plan.sought[p.name] for p in self.sought)

    def values(self, unknowns: Iterable[Any]) -> dict[str, Any]:
        """All parameters in declared order, SI."""
        found = {p.name: p.scale * x for p, x in zip(self.sought, unknowns, strict=True)}
        known = {**self.plan.stated, **found}
        return {p.name: known[p.name] for p in self.info.parameters}

    def unknowns(self, values: Values) -> list[float]:
        """What stands for these values of the sought parameters."""
        return [values[p.name] / p.scale for p in self.sought]

    def relieving(self, at: float | None) -> Values:
        """Of size 1 at a place, with nothing that pulls whatever the size."""
        others = {p.name: p.neutral for p in self.info.linear}
        there = {} if self.place is None or at is None else {self.place.name: at}
        return {**self.plan.stated, **others, **there, self.size.name: 1.0}


def sought(model: Model, scenario: Scenario) -> tuple[SoughtSpring, ...]:
    """The scenario's springs, in its order."""
    effects = model.library.effects
    return tuple(SoughtSpring(s, effects[s.effect or usual(effects)]) for s in scenario.springs)
