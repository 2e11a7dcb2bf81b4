"""What a case can hide in the plant: each entry draws its shape at random and says how its amount enters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from runtime.arrays import Array

from .bodies import BELIEVED, Bodies, in_space, link_inertia

Rows = list[dict[str, float]]
Put = Callable[[Rows, dict[str, float], float], None]
Push = Callable[[Array, float], Array]
"""(t (N,), amount) -> torque (N,) from outside at the hidden joint."""

POSITION = ("linear_spring", "gravity", "cable", "parallel_spring")
"""Torques over the position: a rival of these counts as right for another of them."""


@dataclass(frozen=True)
class Setup:
    """What an entry may know when it draws: the arm, the joint (0-based), the motion (3, n, N)."""

    bodies: Bodies
    joint: int
    motion: Array
    rng: np.random.Generator
    ratio: float = 100.0
    step: float = 1e-3  # s, of the recording

    @property
    def seconds(self) -> float:
        return self.motion.shape[-1] * 1e-3

    @property
    def reach(self) -> Array:
        """Lowest and highest angle of the joint."""
        q = self.motion[0, self.joint]
        return np.array([q.min(), q.max()])

    def within(self, low: float, high: float) -> float:
        """An angle at a random place between two fractions of the range."""
        a, b = self.reach
        return float(a + (b - a) * self.rng.uniform(low, high))

    @property
    def link_inertia(self) -> float:
        """What hangs on the joint's transmission, kg m^2."""
        return link_inertia(self.bodies, self.joint, np.median(self.motion[0], axis=1))


@dataclass(frozen=True)
class Hidden:
    """One hidden effect.

    truth     the library's name; "" for what no library has
    amount    where the search for a size begins; power: size goes about with amount**power
    limits    amounts that are still physics
    put       writes an amount into the plant's rows; push: or a torque from outside
    accept    further names that are as right, by algebra
    rivals    names that are right as rivals
    believed  effects of the user's model file, if the truth needs others than the usual
    left_out  what is hidden is the plant's own gravity, which the model file leaves out
    orders    of each line of a ripple, per turn of the motor, the largest first
    """

    truth: str
    amount: float
    limits: tuple[float, float]
    put: Put | None = None
    push: Push | None = None
    power: float = 1.0
    accept: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    believed: tuple[str, ...] = BELIEVED
    of_arm: bool = False
    warms: bool = False
    left_out: bool = False
    orders: tuple[float, ...] = ()


@dataclass(frozen=True)
class Entry:
    """An effect to hide: how it is drawn, its class, who can have it, and what it needs a setting to be."""

    draw: Callable[[Setup], Hidden]
    kind: str = "single"
    least_joints: int = 1
    not_last: bool = False
    needs: Mapping[str, Any] = field(default_factory=dict)
    most_joints: int = 7

    def fits(self, arm: Bodies) -> bool:
        """Whether an arm can have it: one in space has its gravity always."""
        able = self.least_joints <= len(arm) <= self.most_joints
        return able and not (in_space(arm) and "gravity" in self.needs)


ENTRIES: dict[str, Entry] = {}


def entry(
    name: str, kind: str = "single", least_joints: int = 1, not_last: bool = False, **needs: Any
) -> Callable[..., object]:
    def register(draw: Callable[[Setup], Hidden]) -> Callable[[Setup], Hidden]:
        ENTRIES[name] = Entry(draw, kind, least_joints, not_last, needs)
        return draw

    return register


def at(joint: int, **values: Callable[[float], float] | float) -> Put:
    """Sets parameters of one joint: numbers, or functions of the amount."""

    def put(rows: Rows, _arm: dict[str, float], amount: float) -> None:
        rows[joint].update({k: float(v(amount)) if callable(v) else float(v) for k, v in values.items()})

    return put


def more(joint: int, **values: float) -> Put:
    """Adds amount times the number to parameters of one joint."""

    def put(rows: Rows, _arm: dict[str, float], amount: float) -> None:
        for key, value in values.items():
            rows[joint][key] = rows[joint].get(key, 0.0) + amount * value

    return put


def same(amount: float) -> float:
    return amount


PAIRS = (
    ("elasticity", "torque_ripple"),
    ("backlash", "load_friction"),
    ("linear_spring", "end_stop"),
    ("thermal_friction", "parallel_spring"),
    ("stribeck", "linear_spring"),
    ("stribeck", "torque_ripple"),
    ("lugre", "gravity"),
    ("load_friction", "elasticity"),
    ("friction_patch", "stribeck"),
    ("viscous_asymmetric", "cable"),
    ("torque_saturation", "stribeck"),
    ("payload", "stribeck"),
    ("gravity_left_out", "load_friction"),
)
