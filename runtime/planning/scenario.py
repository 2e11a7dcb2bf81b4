"""What is to be optimized: points, phases, springs, the objective. The file is read by scenario_file.py."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

Values = dict[str, float]
Kind = Literal["free", "contact"]
Goal = Literal["torque_squared", "peak_torque", "electrical_energy", "positive_work"]


@dataclass(frozen=True)
class Point:
    """An instant between two phases.

    q          by joint (1-based): position, rad or m
    tip        base x and y, in space x, y and z, of the end-effector, m; None: not asked for
    pointing   of a spatial arm: the direction, in base axes, of the z axis of the tip's frame; None: not asked for
    orientation  likewise roll, pitch and yaw of the tip's frame, rad
    rest       all joints stand still
    tip_rest   the end-effector stands still, joints may move
    """

    q: Mapping[int, float] = field(default_factory=dict)
    tip: tuple[float, ...] | None = None
    pointing: tuple[float, ...] | None = None
    orientation: tuple[float, ...] | None = None
    rest: bool = False
    tip_rest: bool = False

    @property
    def directed(self) -> bool:
        """Whether it is asked which way the end-effector points."""
        return self.pointing is not None or self.orientation is not None

    @property
    def reached(self) -> bool:
        """Whether anything is asked of the end-effector, so that postures are free."""
        return self.tip is not None or self.directed


@dataclass(frozen=True)
class PhasePlan:
    """From one point to the next.

    kind      "free": joint coordinates; "contact": those of (13), the end-effector stays on the plate's axis
    part      of the cycle time
    degree    of the polynomials, M of (9)
    monotone  no joint with a stated position at both points turns back; in contact: nor does the end-effector
    """

    start: str
    end: str
    kind: Kind
    part: float
    degree: int
    monotone: bool = False


@dataclass(frozen=True)
class SpringPlan:
    """A spring beside a joint, its parameters in SI; their names are those of its declaration.

    sought      bounds of what is sought; as a file has been read, of all that it states
    stated      the other parameters' values
    catalogue   sizes that can be bought; empty: any
    effect      its name; "": the one that is meant where nobody names one
    """

    joint: int
    sought: Mapping[str, tuple[float, float]]
    stated: Mapping[str, float] = field(default_factory=dict)
    catalogue: tuple[float, ...] = ()
    effect: str = ""

    def within(self, name: str, low: float, high: float) -> SpringPlan:
        """With other bounds of a sought parameter."""
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
    """cycle_time in s; moving: joints (1-based) that move, the others keep `posture` (n,);
    friction: whether it is part of the model; elbow: sign of sin q_2 in contact;
    ranges: by joint (1-based), of its position, within the joint's own limits;
    contact: parameters of the environment that differ from the model file's, by effect and name.
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

    def with_any_spring(self) -> Scenario:
        """Without the catalogues."""
        return replace(self, springs=tuple(replace(spring, catalogue=()) for spring in self.springs))

    def at(self, cycle_time: float) -> Scenario:
        """The same motion within another cycle time, s."""
        return replace(self, cycle_time=cycle_time)
