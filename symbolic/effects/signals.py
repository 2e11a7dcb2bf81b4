"""Every signal that an effect may read: its meaning, its source, and where it is available.

A signal with a source is computed from it everywhere: along recordings, in simulation, in plans and in the controller.
A signal without a source needs more than the sample itself and is computed in runtime/model/signals.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import sympy as sp

from symbolic import units as u


@dataclass(frozen=True)
class Coordinate:
    """q, qd or qdd of the joint `step` joints further out; 0 if there is none."""

    name: Literal["q", "qd", "qdd"]
    step: int = 0


@dataclass(frozen=True)
class ArmOutput:
    """A component of one of the arm's generated functions.

    index   in its output; "joint": the joint whose torque is computed, "own": the joint with the effect; indices beyond
            the dimensions of a planar arm's output are ignored
    """

    function: str
    index: tuple[int | Literal["joint", "own"], ...]


@dataclass(frozen=True)
class ArmSlope:
    """The derivative of one of the arm's generated functions, at the joint whose torque is computed, by the position or
    rate of the joint with the effect."""

    function: str
    by: Literal["q", "qd"]


@dataclass(frozen=True)
class JointConstant:
    """An attribute of the model file's joint."""

    name: str


@dataclass(frozen=True)
class Given:
    """The value of an active effect's parameter that `gives` this signal; `absent` if there is none."""

    absent: float


Source = Coordinate | ArmOutput | ArmSlope | JointConstant | Given

Needs = Literal["motion", "time", "temperature", "arm", "friction", "effect", "torque", "torque_rate"]
"""What a signal depends on, besides the model file:

motion        positions, rates and accelerations only
time          the start of the run
temperature   a measured temperature, or its absence
arm           the identified inertial parameters
friction      the joint's identified dry friction, which an effect that reads it replaces
effect        the identified parameters of another effect
torque        the predicted torque with all other effects
torque_rate   its derivative: an effect that reads it shifts the torque in time, as a skew of the recording does
"""


@dataclass(frozen=True)
class Signal:
    """A quantity that effects may read, one value a joint and sample.

    source      see the classes above; None: computed in runtime/model/signals.py
    known_to    where it is available first: "controller", at the measured motion; "plan", which also has
                accelerations; "recording"
    seen_over   the signal of `compare` over which an effect that reads it is visible; None: over none in particular
    sensor      an additional sensor that shows an effect which reads it, or None
    span        the range in which generated forms are tested
    switch      it is either 0 or 1
    space       only spatial arms have it
    """

    name: str
    unit: u.Unit
    meaning: str
    needs: Needs = "motion"
    source: Source | None = None
    known_to: Literal["controller", "plan", "recording"] = "recording"
    seen_over: Literal["position", "velocity", "acceleration", "load", "temperature", "time"] | None = None
    sensor: Literal["link", "temperature", "force"] | None = None
    span: tuple[float, float] = (-1.0, 1.0)
    switch: bool = False
    space: bool = False

    @property
    def between(self) -> bool:
        """Whether it connects the joint with the effect and the joint whose torque is computed."""
        source = self.source
        return isinstance(source, ArmSlope) or (isinstance(source, ArmOutput) and "own" in source.index)

    @cached_property
    def symbol(self) -> sp.Symbol:
        """What stands for it in a law."""
        return sp.Symbol(self.name, real=True)


def _tip_load(column: int, part: str) -> Signal:
    """A coefficient of the torque of a unit mass at (x, y, z) of the tip's frame, a sum over 1, x, y, z, x^2, y^2, z^2,
    x y, x z, y z."""
    return Signal(
        f"tip_load_{part}",
        u.FORCE / u.KILOGRAM / u.METRE ** len(part),
        f"torque that a unit mass off the end-effector asks of this joint, by {' '.join(part)} in the tip's frame",
        source=ArmOutput("tip_load", ("joint", column)),
        known_to="plan",
        seen_over="load",
        sensor="force",
        space=True,
    )


NEIGHBOURS = {"next": "the next joint outwards; 0 at the last", "previous": "the joint before; 0 at the first"}


def _rate(which: str, step: int) -> Signal:
    source = Coordinate("qd", step)
    return Signal(f"qd_{which}", u.RATE, f"rate of {NEIGHBOURS[which]}", source=source, known_to="controller")


def _acceleration(which: str, step: int) -> Signal:
    return Signal(
        f"qdd_{which}",
        u.ACCELERATION,
        f"acceleration of {NEIGHBOURS[which]}",
        source=Coordinate("qdd", step),
        known_to="plan",
        seen_over="acceleration",
        span=(-20.0, 20.0),
    )


def _moment(axis: str, row: int) -> Signal:
    return Signal(
        f"moment_{axis}",
        u.FORCE * u.SECOND**2 / u.METRE,
        f"derivative of the arm's first mass moment along base {axis} by q",
        source=ArmOutput("moment_jacobian", (row, "joint")),
        known_to="controller",
        seen_over="position",
        space=axis == "z",
    )


def _at_tip(name: str, unit: u.Unit, meaning: str, source: ArmOutput) -> Signal:
    return Signal(name, unit, meaning, source=source, known_to="controller", sensor="force")


OFF_TIP = ("x", "y", "z", "xx", "yy", "zz", "xy", "xz", "yz")
"""The products of a mass's coordinates in the tip's frame, in the order of the arm's function tip_load."""

SIGNALS: tuple[Signal, ...] = (
    Signal(
        "q",
        u.POSITION,
        "joint position",
        source=Coordinate("q"),
        known_to="controller",
        seen_over="position",
        span=(-3.0, 3.0),
    ),
    Signal(
        "qd",
        u.RATE,
        "joint rate",
        source=Coordinate("qd"),
        known_to="controller",
        seen_over="velocity",
        span=(-5.0, 5.0),
    ),
    Signal(
        "qdd",
        u.ACCELERATION,
        "joint acceleration",
        source=Coordinate("qdd"),
        known_to="plan",
        seen_over="acceleration",
        span=(-20.0, 20.0),
    ),
    Signal("t", u.SECOND, "time since the start of the run", "time", seen_over="time", span=(0.0, 100.0)),
    Signal(
        "elapsed",
        u.SECOND,
        "time since the recording began, its runs one after another",
        "time",
        seen_over="time",
        span=(0.0, 100.0),
    ),
    Signal(
        "load",
        u.FORCE,
        "predicted torque transmitted to the link: D qdd + C qd + g without the own rotor, and what else the "
        "transmission carries: gravity, payloads, springs, contact",
        "arm",
        known_to="plan",
        seen_over="load",
        span=(-50.0, 50.0),
    ),
    Signal(
        "link_inertia",
        u.INERTIA,
        "inertia of the link side as this joint sees it, without the own rotor",
        needs="arm",
        source=ArmOutput("link_inertia", ("joint", "joint")),
        seen_over="acceleration",
        span=(0.01, 3.0),
    ),
    Signal(
        "coupling",
        u.INERTIA,
        "inertia between this joint and the effect's own, link side; at the own joint link_inertia. An effect that "
        "reads it acts on all joints: what its own joint's link does is felt in the others",
        needs="arm",
        source=ArmOutput("link_inertia", ("joint", "own")),
        seen_over="acceleration",
        sensor="link",
    ),
    Signal(
        "level",
        u.FORCE,
        "predicted magnitude of the joint's Coulomb friction in the present direction",
        "friction",
        seen_over="velocity",
        span=(0.1, 10.0),
    ),
    Signal(
        "predicted",
        u.FORCE,
        "predicted motor torque, all active effects included",
        "torque",
        known_to="plan",
        seen_over="load",
        span=(-50.0, 50.0),
    ),
    Signal(
        "predicted_rate",
        u.FORCE / u.SECOND,
        "time derivative of the predicted motor torque",
        "torque_rate",
        seen_over="acceleration",
        span=(-500.0, 500.0),
    ),
    Signal(
        "warmth",
        u.KELVIN,
        "rise of the measured temperature since the start; 0 where none is measured",
        "temperature",
        seen_over="temperature",
        sensor="temperature",
        span=(0.0, 30.0),
    ),
    Signal("unmeasured", u.KELVIN, "1 K where no temperature is measured, else 0", "temperature", switch=True),
    _rate("next", 1),
    _rate("previous", -1),
    Signal(
        "has_next",
        u.ONE,
        "1 if the effect's second joint is the next one outwards, else 0",
        known_to="controller",
        switch=True,
    ),
    _moment("x", 0),
    _moment("y", 1),
    Signal(
        "tip_load",
        u.FORCE / u.KILOGRAM,
        "torque that a unit mass at the end-effector asks of this joint",
        source=ArmOutput("tip_load", ("joint", 0)),
        known_to="plan",
        seen_over="load",
        sensor="force",
    ),
    _at_tip("tip_y", u.METRE, "end-effector's y in the base frame", ArmOutput("tip", (1,))),
    _at_tip("tip_yd", u.METRE / u.SECOND, "rate of the end-effector's y", ArmOutput("tip_rate", (1,))),
    _at_tip(
        "tip_row",
        u.FORCE / u.NEWTON,
        "derivative of the end-effector's y by q",
        ArmOutput("tip_jacobian", (1, "joint")),
    ),
    Signal(
        "plate_y",
        u.METRE,
        "base y of the active plate's surface; out of reach, -1e9, where no plate is active",
        needs="effect",
        source=Given(absent=-1e9),
        known_to="controller",
    ),
    Signal(
        "ratio",
        u.ONE / u.POSITION,
        "gear ratio per unit of position: motor turns' angle by q",
        source=JointConstant("gear_ratio"),
        known_to="controller",
        span=(1.0, 160.0),
    ),
    _acceleration("next", 1),
    _acceleration("previous", -1),
    _moment("z", 2),
    *(_tip_load(column, part) for column, part in enumerate(OFF_TIP, 1)),
    Signal(
        "coupling_rate",
        u.VISCOUS,
        "how the torque that the link side asks of this joint grows with the rate of the effect's own: centrifugal, "
        "Coriolis and gyroscopic forces",
        needs="arm",
        source=ArmSlope("link_load", "qd"),
        sensor="link",
    ),
    Signal(
        "coupling_slope",
        u.STIFFNESS,
        "how the torque that the link side asks of this joint grows with the position of the effect's own: gravity, "
        "and inertia that changes with the posture",
        needs="arm",
        source=ArmSlope("link_load", "q"),
        sensor="link",
    ),
)
SIGNAL = {s.name: s for s in SIGNALS}
