"""Torque, place and direction of the end-effector at one instant of a plan, as expressions of the CasADi functions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import cos, sin

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from runtime.arrays import Array
from runtime.model import casadi_functions
from runtime.model.loader import Model
from runtime.model.terms import (
    OF_DRIVE,
    SURFACE,
    SignalContext,
    Structure,
    Term,
    check_complete,
    giver,
    joints_of,
    structure,
    unknown_to_plan,
)
from runtime.planning.blocks import Row
from runtime.planning.scenario import Point, Scenario, is_spring

AXIS = 2
"""The axis of the tip's frame whose direction `pointing` gives."""


@dataclass(frozen=True)
class Physics:
    """Terms with their values, without springs; left_out: terms that a plan cannot hold, and why."""

    model: Model
    terms: Structure
    left_out: Mapping[Term, str]

    @classmethod
    def of(cls, model: Model, scenario: Scenario) -> Physics:
        """The model file's effects, with the contact's parameters of the scenario; springs are the scenario's alone.

        Raises ModelError if a parameter has no value.
        """
        terms, left_out = {}, {}
        for term, values in structure(model).items():
            info = model.library[term.effect]
            if is_spring(info) or (info.rubs and not scenario.friction):
                continue
            unknown = unknown_to_plan(model.library, term.effect)
            if info.states or unknown:
                left_out[term] = "it has a memory" if info.states else f"a plan does not know its {unknown[0]}"
                continue
            own = scenario.contact.get(term.effect, {}) if info.scope == "contact" else {}
            terms[term] = {**values, **own}
        check_complete(model, terms)
        return cls(model, terms, left_out)

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Sizes of the parts of p that the equations read."""
        own = {str(term): len(self.model.library[term.effect].parameters) for term in self.terms}
        return {"struct": len(self.model.struct_values), "width": len(casadi_functions.WIDTHS), **own}

    def values(self, width: float) -> dict[str, list[float]]:
        """Values of the same parts; width of the smooth switches in rad/s (m/s), other widths in proportion."""
        own = {str(term): casadi_functions.ordered(self.model, term.effect, v) for term, v in self.terms.items()}
        # In the order of casadi_functions.WIDTHS: rate, position, force, time.
        return {"struct": self.model.struct_values, "width": [width, width / 50.0, width, width / 50.0], **own}

    def given(self, signal: str, p: Callable[[str], ca.SX]) -> ca.SX | None:
        """The signal that is a parameter of one of the terms; None where there is none."""
        found = giver(self.model.library, self.terms, signal)
        if found is None:
            return None
        term, name = found
        names = [parameter.name for parameter in self.model.library[term.effect].parameters]
        return p(str(term))[names.index(name)]

    def plate_position(self, p: Callable[[str], ca.SX]) -> ca.SX:
        """Base y of what the end-effector touches."""
        position = self.given(SURFACE, p)
        assert position is not None, "the end-effector touches nothing"
        return position


@dataclass(frozen=True)
class PlanInstant:
    """Expressions of one instant: q, qd, qdd (n,), parameters of the springs, p by name.

    apart   the end-effector is above the plate for certain, so that no effect of the contact acts
    """

    physics: Physics
    q: ca.SX
    qd: ca.SX
    qdd: ca.SX
    springs: Mapping[Term, ca.SX]
    p: Callable[[str], ca.SX]
    apart: bool

    @cached_property
    def _signals(self) -> _Signals:
        return _Signals(self)

    @property
    def tip(self) -> ca.SX:
        """Position of the end-effector: base x, y, in space x, y, z, m."""
        return self._signals.arm("tip")

    @property
    def tip_rotation(self) -> ca.SX:
        """(3, 3) rotation of the tip's frame of a spatial arm, in base axes."""
        return self._signals.arm("tip_rotation")

    @property
    def tip_rate(self) -> ca.SX:
        """Velocity of the end-effector, m/s."""
        return self._signals.arm("tip_rate")

    @cached_property
    def torque(self) -> ca.SX:
        """(n,) motor torques, N m or N: (10) and (15)."""
        own = self._signals.own
        model, library = self.physics.model, self.physics.model.library
        # Terms that read the predicted torque come last, when it is complete.
        terms = sorted(self.acting, key=lambda t: bool(library.needs[t.effect] & OF_DRIVE))
        for term in (*self.springs, *terms):
            for joint in joints_of(model, term):
                own[joint] += self.part(term, joint)
        return ca.vertcat(*own)

    @property
    def acting(self) -> list[Term]:
        """The model's effects that act here, without springs."""
        library = self.physics.model.library
        return [t for t in self.physics.terms if not (self.apart and library[t.effect].scope == "contact")]

    def part(self, term: Term, joint: int) -> ca.SX:
        """Torque of a spring or an effect at a joint (0-based)."""
        values = self.springs[term] if term in self.springs else self.p(str(term))
        read = self._signals.reader(term, joint)
        return casadi_functions.effect_torque(
            self.physics.model, term.effect, read, values=values, width=self.p("width")
        )


class _Signals(SignalContext):
    """What effects read at one instant of a plan; own: the motor torques (n,) summed so far."""

    def __init__(self, instant: PlanInstant) -> None:
        self.model, self.instant = instant.physics.model, instant

    @cached_property
    def own(self) -> list[ca.SX]:
        rigid = self.arm("inverse_dynamics")
        return [rigid[i] for i in range(self.model.n)]

    def coordinate(self, name: str) -> ca.SX:
        return getattr(self.instant, name)

    def evaluate(self, function: str) -> ca.SX:
        return casadi_functions.evaluate(self.model, function, self.instant.p("struct"), self.coordinate)

    def given(self, name: str) -> ca.SX | None:
        return self.instant.physics.given(name, self.instant.p)

    def terms(self) -> Collection[Term]:
        return [*self.instant.springs, *self.instant.acting]

    def torque(self, term: Term, joint: int) -> ca.SX:
        return self.instant.part(term, joint)

    def predicted(self, joint: int) -> ca.SX:
        return self.own[joint]


# --- direction of the end-effector ---


def rotation(rpy: ArrayLike) -> Array:
    """(3, 3) of roll, pitch and yaw about fixed axes, rad, as in URDF."""
    (cr, cp, cy), (sr, sp, sy) = ([f(float(a)) for a in np.asarray(rpy)] for f in (cos, sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def target_frame(point: Point) -> Array | None:
    """(3, 3) target axes of the tip's frame, in columns; None where the direction is free.

    Where only the z axis is given, the other two are any perpendicular ones.
    """
    if point.orientation is not None:
        return rotation(point.orientation)
    if point.pointing is None:
        return None
    d = np.array(point.pointing) / np.linalg.norm(point.pointing)
    across = np.cross(d, np.eye(3)[np.argmin(np.abs(d))])
    u = across / np.linalg.norm(across)
    return np.column_stack([u, np.cross(d, u), d])


def direction_rows(point: Point, R: ca.SX, target: ca.SX) -> list[Row]:
    """Constraints on the tip's rotation R (3, 3); target (9,): the target frame, column after column.

    An axis a along d leaves the rotation about d free: with u and v perpendicular to d, u·a and v·a are zero and d·a is
    not negative. For a whole orientation the skew part of Rtᵀ R is zero, and the trace excludes a half turn.
    """
    own = ca.reshape(target, 3, 3).T @ R
    what = "end-effector's direction"
    if point.orientation is None:
        axis = own[:, AXIS]
        rows = [(axis[0], 0.0, 0.0, what, "rad"), (axis[1], 0.0, 0.0, what, "rad")]
        return [*rows, (axis[2], 0.0, float("inf"), what, "rad")]
    skew = [(own[2, 1] - own[1, 2]) / 2, (own[0, 2] - own[2, 0]) / 2, (own[1, 0] - own[0, 1]) / 2]
    turned = [
        (part, 0.0, 0.0, f"end-effector's rotation about its {axis}", "rad")
        for part, axis in zip(skew, "xyz", strict=True)
    ]
    return [*turned, (ca.trace(own), 0.0, float("inf"), "end-effector's rotation", "rad")]


def turn_needed(point: Point, R: Array) -> tuple[Array, Array]:
    """The rotation from the tip's R (3, 3) to the target: axes (k, 3), and the angle about each, rad (k,)."""
    frame = target_frame(point)
    if frame is None:
        return np.zeros((0, 3)), np.zeros(0)
    if point.orientation is None:
        about = np.cross(R[:, AXIS], frame[:, AXIS])
        angle = np.arctan2(np.linalg.norm(about), R[:, AXIS] @ frame[:, AXIS])
        axes = frame[:, :AXIS].T
        if angle > np.pi / 2 and np.linalg.norm(about) < 1e-9:
            return axes, np.array([angle, 0.0])
        return axes, axes @ about * (angle / max(np.linalg.norm(about), 1e-12))
    left = frame @ R.T
    about = np.array([left[2, 1] - left[1, 2], left[0, 2] - left[2, 0], left[1, 0] - left[0, 1]]) / 2
    angle = np.arctan2(np.linalg.norm(about), (np.trace(left) - 1) / 2)
    return np.eye(3), about * (angle / max(np.linalg.norm(about), 1e-12))
