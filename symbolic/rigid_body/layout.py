"""How the recursion is laid out: its frame, its unit of length, and the constants it needs beside the lumps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from symbolic.functions import Coordinates
from symbolic.model_file.arm import Arm
from symbolic.rigid_body.base_parameters import lumps_of
from symbolic.rigid_body.exact_rank import BaseParameters, exact
from symbolic.rigid_body.newton_euler import Chain, Gravity, inverse_dynamics
from symbolic.straightline import Recorder, count


@dataclass(frozen=True)
class LayoutConstant:
    """A constant of the struct; `value` is exact, but for the angle and strength of an inclined gravity."""

    symbol: sp.Symbol
    unit: str
    meaning: str
    value: Fraction | float


@dataclass(frozen=True)
class RecursionLayout:
    """frame: the revolute joint in whose link's frame vectors are written (0: the base's).

    reference   link whose length is the unit of length, None: the metre
    scaled      the chain in that unit, for the dynamics
    metric      the chain in metres, for the kinematics
    fields      candidates for the struct, in order
    """

    frame: int
    reference: int | None
    scaled: Chain
    metric: Chain
    fields: tuple[LayoutConstant, ...]

    def metres(self, kind: str) -> int:
        """The power of the reference length that multiplies base parameters of this kind."""
        return {"J": 0, "I": 0, "mu": 2, "h": 1, "hy": 1}[kind] if self.reference else 0


def choose_layout(arm: Arm, base: BaseParameters) -> RecursionLayout:
    """The layout whose inverse dynamics count fewest operations; the metre is preferred where that is equal.

    With a length unit, masses appear as mass times length², and one link's lever arms cost no product.
    Sliding joints have a position in metres, so that arms with one keep the metre.
    """
    n = len(arm.joints)
    turning = [i for i, j in enumerate(arm.joints, 1) if j.type == "revolute"]
    candidates: list[tuple[int, int | None]] = [(f, None) for f in (*turning, 0)]
    if len(turning) == n:
        candidates += [(f, f) for f in turning[:-1] if arm.lengths[f - 1]]
    layouts = [_layout(arm, frame, reference) for frame, reference in candidates]
    return min(layouts, key=lambda layout: _cost(arm, layout, base))


def _cost(arm: Arm, layout: RecursionLayout, base: BaseParameters) -> int:
    coordinates, recorder = Coordinates(tuple(j.type for j in arm.joints)), Recorder()
    lumps = lumps_of({c: sp.Symbol(f"{c[0]}{c[1]}", real=True) for c in base.values}, len(arm.joints))
    q, qd, qdd = (coordinates.symbols(name) for name in ("q", "qd", "qdd"))
    tau = inverse_dynamics(layout.scaled, lumps, layout.frame, q, qd, qdd, recorder)
    return count(recorder.live(tau), tau).cost


def _layout(arm: Arm, frame: int, reference: int | None) -> RecursionLayout:
    lengths = [exact(length) for length in arm.lengths]
    unit = lengths[reference - 1] if reference else Fraction(1)
    by = f"_by_l{reference}" if reference else ""
    metres = tuple(
        LayoutConstant(_symbol(f"l{i}"), "m", f"length of link {i}", value)
        for i, value in enumerate(lengths, 1)
        if value
    )
    ratios = tuple(
        LayoutConstant(_symbol(f"l{i}{by}"), "1", f"length of link {i} over that of link {reference}", value / unit)
        for i, value in enumerate(lengths, 1)
        if value and reference and i != reference
    )
    gravity, constants = _gravity(arm, unit, by, reference)
    revolute = tuple(j.type == "revolute" for j in arm.joints)
    metric = tuple(_symbol(f"l{i}") if value else 0 for i, value in enumerate(lengths, 1))
    scaled = tuple(
        0 if not value else 1 if i == reference else _symbol(f"l{i}{by}") for i, value in enumerate(lengths, 1)
    )
    in_metres = gravity
    if gravity is not None and reference:
        l = _symbol(f"l{reference}")
        in_metres = Gravity(gravity.x * l, gravity.y * l, gravity.strength * l, gravity.angle)
    return RecursionLayout(
        frame,
        reference,
        Chain(revolute, scaled, gravity),
        Chain(revolute, metric, in_metres),
        ratios + constants + metres,
    )


def _gravity(
    arm: Arm, unit: Fraction, by: str, reference: int | None
) -> tuple[Gravity | None, tuple[LayoutConstant, ...]]:
    """Gravity in symbols, scaled by the unit of length, and its candidates for the struct."""
    x, y = (exact(g) for g in arm.gravity[:2])
    if not x and not y:
        return None, ()
    measure, over = ("1/s^2", f" over the length of link {reference}") if reference else ("m/s^2", "")
    strength, angle = math.hypot(*arm.gravity[:2]) / float(unit), math.atan2(arm.gravity[1], arm.gravity[0])
    fields = (
        LayoutConstant(_symbol(f"gravity_x{by}"), measure, f"gravity along base x{over}", x / unit),
        LayoutConstant(_symbol(f"gravity_y{by}"), measure, f"gravity along base y{over}", y / unit),
        LayoutConstant(_symbol(f"gravity{by}"), measure, f"strength of gravity{over}", strength),
        LayoutConstant(_symbol("gravity_angle"), "rad", "angle of gravity from base x", angle),
    )
    symbols = [f.symbol for f in fields]
    return Gravity(symbols[0] if x else 0, symbols[1] if y else 0, symbols[2], symbols[3]), fields


def _symbol(name: str) -> sp.Symbol:
    return sp.Symbol(name, real=True)
