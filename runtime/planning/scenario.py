"""What is to be optimized: points, phases, springs, the objective. The file is read by scenario_file.py."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

from runtime.model.loader import Model
from runtime.model.terms import Term, Values
from symbolic.described import DescribedEffect, DescribedParameter

Kind = Literal["free", "contact"]
Goal = Literal["torque_squared", "peak_torque", "electrical_energy", "positive_work"]
Declared = Mapping[str, DescribedEffect[Any]]
"""Effects by name, as a library has them."""


@dataclass(frozen=True)
class Point:
    """An instant between two phases, and what is required there.

    q            by joint (1-based): position, rad or m
    tip          base x and y, in space x, y and z, of the end-effector, m; None: free
    pointing     spatial arms: direction of the z axis of the tip's frame, in base axes; None: free
    orientation  spatial arms: roll, pitch and yaw of the tip's frame, rad; None: free
    rest         all joints stand still
    tip_rest     the end-effector stands still, joints may move
    """

    q: Mapping[int, float] = field(default_factory=dict)
    tip: tuple[float, ...] | None = None
    pointing: tuple[float, ...] | None = None
    orientation: tuple[float, ...] | None = None
    rest: bool = False
    tip_rest: bool = False

    @property
    def directed(self) -> bool:
        """Whether the direction of the end-effector is given."""
        return self.pointing is not None or self.orientation is not None

    @property
    def reached(self) -> bool:
        """Whether anything is required of the end-effector, so that postures are free."""
        return self.tip is not None or self.directed


@dataclass(frozen=True)
class PhasePlan:
    """From one point to the next.

    kind      "free": joint coordinates; "contact": those of (13), the end-effector stays on the plate's axis
    part      of the cycle time
    degree    of the polynomials, M of (9)
    monotone  no joint whose position is given at both points turns back; in contact: nor does the end-effector
    """

    start: str
    end: str
    kind: Kind
    part: float
    degree: int
    monotone: bool = False


@dataclass(frozen=True)
class SpringPlan:
    """A spring at a joint, its parameters in SI, named as in its declaration.

    sought      bounds of the parameters to be optimized; before `fitted`, of all parameters in the file
    stated      values of the other parameters
    catalogue   sizes that can be bought; empty: any
    effect      its name; "": the library's first spring
    """

    joint: int
    sought: Mapping[str, tuple[float, float]]
    stated: Mapping[str, float] = field(default_factory=dict)
    catalogue: tuple[float, ...] = ()
    effect: str = ""

    def within(self, name: str, low: float, high: float) -> SpringPlan:
        """With other bounds of a parameter."""
        return replace(self, sought={**self.sought, name: (low, high)})


@dataclass(frozen=True)
class Objective:
    """goal    "torque_squared": ∫ Σ τ² dt, (8); "peak_torque": the largest |τ| over its joint's torque limit;
               "electrical_energy": ∫ Σ R (τ/k)² dt, k the torque constant; "positive_work": ∫ Σ max(0, τ q̇) dt
    joints     whose torque counts (1-based); empty: those that move
    resistance by joint, Ω, for the electrical energy
    """

    goal: Goal = "torque_squared"
    joints: tuple[int, ...] = ()
    resistance: Mapping[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Scenario:
    """A motion to be planned.

    cycle_time   s
    friction     whether it is part of the model
    moving       joints (1-based) that move; the others keep `posture` (n,)
    contact      parameters of the environment that differ from the model file's, by effect and name
    elbow        sign of sin q_2 in contact
    ranges       of positions, by joint (1-based), within the joint's own limits
    """

    name: str
    model: str
    cycle_time: float
    periodic: bool
    friction: bool
    moving: tuple[int, ...]
    posture: tuple[float, ...]
    objective: Objective
    points: Mapping[str, Point]
    phases: tuple[PhasePlan, ...]
    springs: tuple[SpringPlan, ...] = ()
    contact: Mapping[str, Values] = field(default_factory=dict)
    elbow: float = 1.0
    ranges: Mapping[int, tuple[float, float]] = field(default_factory=dict)

    def without_springs(self) -> Scenario:
        """The same motion with no spring sought."""
        return replace(self, springs=())

    def at(self, cycle_time: float) -> Scenario:
        """The same motion with another cycle time, s."""
        return replace(self, cycle_time=cycle_time)

    @property
    def counted(self) -> tuple[int, ...]:
        """Joints (1-based) whose torque counts in the objective."""
        return self.objective.joints or self.moving


# --- springs, known by their declarations, whatever their names ---


def is_spring(info: DescribedEffect[Any]) -> bool:
    """Whether a trajectory brings the effect along for a joint."""
    return info.brought and info.scope == "joint"


def springs(effects: Declared) -> dict[str, DescribedEffect[Any]]:
    """All springs by name; the first is the default."""
    return {name: info for name, info in effects.items() if is_spring(info)}


def usual(effects: Declared) -> str:
    """The default spring."""
    return next(iter(springs(effects)))


@dataclass(frozen=True)
class SoughtSpring:
    """A spring of a scenario with its declaration. Unknowns are values over the scales of their parameters."""

    plan: SpringPlan
    info: DescribedEffect[Any]

    @property
    def term(self) -> Term:
        return Term(self.info.name, self.plan.joint)

    @cached_property
    def size(self) -> DescribedParameter:
        """The parameter by which a spring is bought, its stiffness."""
        return next(p for p in self.info.parameters if p.planned == "size")

    @cached_property
    def place(self) -> DescribedParameter | None:
        """The position where it begins to pull, if that is sought, too."""
        return next((p for p in self.info.parameters if p.planned == "place"), None)

    @cached_property
    def sought(self) -> tuple[DescribedParameter, ...]:
        """In the order of the unknowns, which is that of the declaration."""
        return tuple(p for p in self.info.parameters if p.name in self.plan.sought)

    def values(self, unknowns: Iterable[Any]) -> dict[str, Any]:
        """All parameters in declared order, SI."""
        found = {p.name: p.scale * x for p, x in zip(self.sought, unknowns, strict=True)}
        known = {**self.plan.stated, **found}
        return {p.name: known[p.name] for p in self.info.parameters}

    def unknowns(self, values: Mapping[str, float]) -> list[float]:
        """Unknowns that stand for these values of the sought parameters."""
        return [values[p.name] / p.scale for p in self.sought]

    def relieving(self, at: float) -> Values:
        """Parameters of a spring of size 1 at a place, without the torque that does not depend on the size."""
        others = {p.name: p.neutral for p in self.info.linear}
        place = {} if self.place is None else {self.place.name: at}
        return {**self.plan.stated, **others, **place, self.size.name: 1.0}


def sought(model: Model, scenario: Scenario) -> tuple[SoughtSpring, ...]:
    """The scenario's springs, in its order."""
    effects = model.library.effects
    return tuple(SoughtSpring(s, effects[s.effect or usual(effects)]) for s in scenario.springs)
