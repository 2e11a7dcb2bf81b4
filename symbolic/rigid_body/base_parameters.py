"""Base inertial parameters of a planar arm, the layout of its recursion, and the names under which users see them.

Every link has the elementary parameters of newton_euler.Lumps. Their columns in the regressor are linearly dependent:
mass at a joint may be counted to either link, the first joint's rotor turns with its link. Dependent columns are merged
into the others, in an order of preference that makes the recursion short; tau = Y lumps then holds exactly and Y has
full rank. Rank and combinations are exact: columns are evaluated at random points modulo PRIME.

Source: Gautier & Khalil 1990 (minimum inertial parameters), with exact instead of numerical rank.
"""

from __future__ import annotations

import math
import random
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import sympy as sp

from symbolic.functions import Notes, OperationCounter, Residues, Turn, random_turn, residue
from symbolic.model_file.arm import ROTOR, Arm
from symbolic.model_file.checks import ModelError, nearest
from symbolic.rigid_body.newton_euler import Chain, Gravity, Lumps, inverse_dynamics, motion, torques

PRIME = 2**1279 - 1
"""Recovers coefficients of up to 190 digits over 190 from residues; a few angles of 15 digits multiply."""

Column = tuple[str, int]
"""Kind and link index (0-based) of an elementary parameter."""

Combination = dict[Column, Fraction]
Parameters = Mapping[Column, Fraction | None]


@dataclass(frozen=True)
class BaseParameters:
    """values: the base parameters in order, None where unknown; merged: each one's (column, coefficient) pairs.

    stated   the sums of the known parts     lacking   the unknown parts
    """

    values: dict[Column, Fraction | None]
    merged: dict[Column, tuple[tuple[Column, Fraction], ...]]
    stated: dict[Column, Fraction]
    lacking: dict[Column, tuple[Column, ...]]

    @classmethod
    def of(cls, parts: Mapping[Column, Sequence[tuple[Column, Fraction]]], values: Parameters) -> BaseParameters:
        """The base parameters that consist of these parts. values: of the parts, None where unknown."""
        lacking = {base: tuple(c for c, _ in own if values[c] is None) for base, own in parts.items()}
        stated = {base: sum(((values[c] or 0) * f for c, f in own), Fraction(0)) for base, own in parts.items()}
        known = {base: None if lacking[base] else value for base, value in stated.items()}
        return cls(known, {base: tuple(own) for base, own in parts.items()}, stated, lacking)

    def described(self, lump: Lump, column: Column, arm: Arm, scale: Fraction = Fraction(1)) -> Lump:
        """The lump of a base parameter with its value, times `scale`, and what that lacks."""
        stated, lacking = float(self.stated[column] * scale), self.lacking[column]
        keys = {(i + 1, k) for kind, i in lacking for k in arm.joints[i].unknown if (k == ROTOR) == (kind == "I")}
        links = stated if all(kind == "I" for kind, _ in lacking) else None
        return replace(lump, value=None if lacking else stated, lacks=tuple(sorted(keys)), links=links)


def exact(value: float) -> Fraction:
    """The decimal number as it is written, as a fraction."""
    return Fraction(repr(float(value)))


def dependencies(
    revolute: Sequence[bool],
    points: int,
    torques_of: Callable[[list[Any], list[int], list[int], Notes], Mapping[Column, Sequence[Any]]],
) -> dict[Column, Combination]:
    """The columns of the regressor that depend on earlier independent ones, each with its combination of them.

    torques_of   columns (n,) by q, qd, qdd and notes; evaluated at random states modulo PRIME, from a fixed seed

    Raises ArithmeticError if a coefficient has more digits than PRIME can represent.
    """
    rng, rows = random.Random(1), defaultdict[Column, list[int]](list)
    for _ in range(points):
        q = [random_turn(rng, PRIME) if r else rng.randrange(PRIME) for r in revolute]
        qd, qdd = ([rng.randrange(PRIME) for _ in revolute] for _ in range(2))
        for column, tau in torques_of(q, qd, qdd, Residues(PRIME)).items():
            rows[column] += [t % PRIME for t in tau]
    independent: list[Column] = []
    # Pivot row, the column without the earlier pivot rows, and its combination of independent columns.
    reduced: list[tuple[int, list[int], list[int]]] = []
    dependent: dict[Column, Combination] = {}
    for column, residues in rows.items():
        vector, combination = list(residues), [0] * len(independent)
        for pivot, other, used in reduced:
            factor = vector.pop(pivot)
            if factor:
                vector = [(a - factor * b) % PRIME for a, b in zip(vector, other, strict=True)]
                for j, c in enumerate(used):
                    combination[j] = (combination[j] + factor * c) % PRIME
        pivot_row = next((r for r, v in enumerate(vector) if v), None)
        if pivot_row is None:
            fractions = zip(independent, map(fraction, combination), strict=True)
            dependent[column] = {c: f for c, f in fractions if f}
            continue
        inverse = pow(vector.pop(pivot_row), -1, PRIME)
        own = [-c * inverse % PRIME for c in combination] + [inverse]
        independent.append(column)
        reduced.append((pivot_row, [v * inverse % PRIME for v in vector], own))
    return dependent


def fraction(residue: int) -> Fraction:
    """The fraction of small numerator and denominator with this residue (Wang 1981)."""
    bound = math.isqrt(PRIME // 2)
    (r0, r1), (s0, s1) = (PRIME, residue), (0, 1)
    while r1 > bound:
        quotient = r0 // r1
        r0, r1, s0, s1 = r1, r0 - quotient * r1, s1, s0 - quotient * s1
    if abs(s1) > bound:
        raise ArithmeticError("a coefficient of the base parameters has more digits than the prime can represent")
    return Fraction(r1, s1)


KINDS = ("J", "I", "mu", "h", "hy")


def exact_chain(arm: Arm) -> Chain:
    """The arm's chain in exact numbers; the gravity angle is a Turn that includes the strength."""
    gx, gy = (exact(g) for g in arm.gravity[:2])
    gravity = Gravity(gx or 0, gy or 0, 1, Turn(gx, gy)) if gx or gy else None
    return Chain(tuple(j.type == "revolute" for j in arm.joints), tuple(map(exact, arm.lengths)), gravity)


def elementary(arm: Arm) -> dict[Column, Fraction | None]:
    """All elementary parameters in order of preference, each link's mass at its distal point; None where unknown; hy
    only where the centre of mass may be off the link's line."""
    n = len(arm.joints)
    values: dict[Column, Fraction | None] = {}
    for i, (joint, length) in enumerate(zip(arm.joints, arm.lengths, strict=True)):
        link, end = joint.link, exact(length)
        m = None if link.mass is None else exact(link.mass)
        values |= {("J", i): None, ("mu", i): m, ("h", i): None, ("hy", i): None}
        values["I", i] = None if joint.rotor_inertia is None else exact(joint.rotor_inertia)
        if m is None or link.com is None:
            continue
        along, across = exact(link.com[0]), exact(link.com[1])
        values |= {("h", i): m * (along - end), ("hy", i): m * across}
        if link.inertia is not None:
            # Moments about the joint (revolute), minus the point mass's contribution.
            square = along**2 - end**2 if joint.type == "revolute" else (along - end) ** 2
            values["J", i] = exact(link.inertia[5]) + m * (across**2 + square)
    sliding = {i for i, j in enumerate(arm.joints) if j.type == "prismatic"}
    order: list[Column] = [("J", i) for i in range(n)] + [("mu", i) for i in sorted(sliding)]
    order += [("I", i) for i in range(n)] + [("mu", i) for i in range(n - 1)] + [("h", n - 1)]
    order += [("hy", i) for i in range(n) if values["hy", i] != 0] + [("mu", n - 1)]
    order += [("h", i) for i in reversed(range(n - 1))]
    return {c: values[c] for c in dict.fromkeys(order)}


def base_parameters(arm: Arm) -> BaseParameters:
    """The base parameters, ordered J, I, mu, h, hy and then by joint."""
    values = elementary(arm)
    points = -(-len(values) // len(arm.joints)) + 4
    chain = exact_chain(arm).over(lambda x: residue(x, PRIME))

    def torques_of(q: list[Any], qd: list[int], qdd: list[int], notes: Notes) -> dict[Column, list[Any]]:
        moving = motion(chain, 0, q, qd=qd, qdd=qdd, notes=notes)
        return {c: torques(chain, lumps_of({c: 1}, chain.n), moving, qdd=qdd, notes=notes) for c in values}

    coefficients = dependencies(chain.revolute, points, torques_of)
    merged: dict[Column, list[tuple[Column, Fraction]]] = {
        c: [(c, Fraction(1))] for c in values if c not in coefficients
    }
    for column, combination in coefficients.items():
        for target, factor in combination.items():
            merged[target].append((column, factor))
    order = sorted(merged, key=lambda c: (KINDS.index(c[0]), c[1]))
    return BaseParameters.of({c: merged[c] for c in order}, values)


def lumps_of(values: dict[Column, Any], n: int) -> Lumps:
    """The recursion's parameters: base parameters have values, all others are 0."""
    return Lumps(**{kind: tuple(values.get((kind, i), 0) for i in range(n)) for kind in KINDS})


@dataclass(frozen=True)
class LayoutConstant:
    """A constant of the struct; `value` is exact except for the angle and strength of an inclined gravity."""

    symbol: sp.Symbol
    unit: str
    meaning: str
    value: Fraction | float


@dataclass(frozen=True)
class RecursionLayout:
    """The frame and the unit of length of the planar recursion, and the constants that it needs.

    frame       the revolute joint in whose link's frame vectors are written (0: the base)
    reference   the link whose length is the unit of length; None: the metre
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
        """The power of the reference length in base parameters of this kind."""
        return {"J": 0, "I": 0, "mu": 2, "h": 1, "hy": 1}[kind] if self.reference else 0


def choose_layout(arm: Arm, base: BaseParameters) -> RecursionLayout:
    """The layout with the fewest operations in inverse dynamics; the metre is preferred among equals.

    With a link length as unit, masses become mass times length² and that link's lever arms need no product. Arms with
    sliding joints, whose positions are in metres, keep the metre.
    """
    n = len(arm.joints)
    turning = [i for i, j in enumerate(arm.joints, 1) if j.type == "revolute"]
    candidates: list[tuple[int, int | None]] = [(f, None) for f in (*turning, 0)]
    if len(turning) == n:
        candidates += [(f, f) for f in turning[:-1] if arm.lengths[f - 1]]
    layouts = [_layout(arm, frame, reference) for frame, reference in candidates]
    return min(layouts, key=lambda layout: _cost(arm, layout, base))


def _cost(arm: Arm, layout: RecursionLayout, base: BaseParameters) -> int:
    counter, n = OperationCounter(), len(arm.joints)
    chain = layout.scaled.over(lambda x: counter.leaf(x.name) if isinstance(x, sp.Symbol) else x)
    lumps = lumps_of({c: counter.leaf(f"{c[0]}{c[1]}") for c in base.values}, n)
    q, qd, qdd = ([counter.leaf(f"{name}{i}") for i in range(n)] for name in ("q", "qd", "qdd"))
    return counter.cost(inverse_dynamics(chain, lumps, layout.frame, q=q, qd=qd, qdd=qdd, notes=counter))


def _layout(arm: Arm, frame: int, reference: int | None) -> RecursionLayout:
    lengths, fields = list(enumerate(map(exact, arm.lengths), 1)), list[LayoutConstant]()

    def constant(name: str, unit: str, meaning: str, value: Fraction | float) -> sp.Symbol:
        fields.append(LayoutConstant(sp.Symbol(name, real=True), unit, meaning, value))
        return fields[-1].symbol

    unit, by, over, per_second = Fraction(1), "", "", "m/s^2"
    ratios: list[Any] = []
    if reference:
        unit, by, per_second = lengths[reference - 1][1], f"_by_l{reference}", "1/s^2"
        over = f" over the length of link {reference}"
        for i, value in lengths:
            meaning = f"length of link {i} over that of link {reference}"
            own = i == reference or not value
            ratios.append(int(i == reference) if own else constant(f"l{i}{by}", "1", meaning, value / unit))
    gravity, (x, y) = None, (exact(g) for g in arm.gravity[:2])
    if x or y:
        strength, angle = math.hypot(*arm.gravity[:2]) / float(unit), math.atan2(arm.gravity[1], arm.gravity[0])
        along = constant(f"gravity_x{by}", per_second, f"gravity along base x{over}", x / unit)
        across = constant(f"gravity_y{by}", per_second, f"gravity along base y{over}", y / unit)
        size = constant(f"gravity{by}", per_second, f"strength of gravity{over}", strength)
        turned = constant("gravity_angle", "rad", "angle of gravity from base x", angle)
        gravity = Gravity(along if x else 0, across if y else 0, size, turned)
    revolute = tuple(j.type == "revolute" for j in arm.joints)
    metres = [constant(f"l{i}", "m", f"length of link {i}", value) if value else 0 for i, value in lengths]
    scaled, in_metres = Chain(revolute, tuple(ratios or metres), gravity), gravity
    if gravity is not None and reference:
        l = metres[reference - 1]
        in_metres = Gravity(gravity.x * l, gravity.y * l, gravity.strength * l, gravity.angle)
    metric = Chain(revolute, tuple(metres), in_metres)
    return RecursionLayout(frame, reference, scaled, metric=metric, fields=tuple(fields))


@dataclass(frozen=True)
class Lump:
    """A base inertial parameter.

    joint   1-based
    value   from the model file; None where it depends on a number that the file omits
    lacks   these numbers: joint (1-based) and key; none where the value was identified
    links   value without the rotors that it lacks; None where it lacks a number of a link
    parts   of a spatial arm: (joint, parameter of recursion.INERTIA or "I" for the rotor, factor)
    """

    name: str
    unit: str
    meaning: str
    joint: int
    value: float | None = None
    parts: tuple[tuple[int, str, Fraction], ...] = ()
    lacks: tuple[tuple[int, str], ...] = ()
    links: float | None = None


def named_lumps(arm: Arm, base: BaseParameters, layout: RecursionLayout) -> tuple[Lump, ...]:
    """The base parameters with names, units, meanings and values; identified values in the file have precedence.

    Raises ModelError for an identified value whose name this arm does not have.
    """
    scale = exact(arm.lengths[layout.reference - 1]) if layout.reference else Fraction(1)
    lumps = []
    for kind, i in base.values:
        sliding = arm.joints[i].type == "prismatic"
        power = layout.metres(kind)
        name = f"{'M' if sliding and kind == 'mu' else kind}{i + 1}"
        own = {"J": "kg m^2", "I": "kg" if sliding else "kg m^2", "mu": "kg", "h": "kg m", "hy": "kg m"}[kind]
        unit = "kg m^2" if power else own
        note = f", times l{layout.reference}{'^2' if power == 2 else ''}" if power else ""
        also = ", rotor included" if kind != "I" and any(c == ("I", i) for c, _ in base.merged[kind, i]) else ""
        text = _meaning(kind, i + 1, sliding, len(arm.joints)) + also + note
        lumps.append(base.described(Lump(name, unit, text, joint=i + 1), (kind, i), arm, scale**power))
    return overridden(arm, lumps)


def overridden(arm: Arm, lumps: Sequence[Lump]) -> tuple[Lump, ...]:
    """The lumps with identified values from the model file. Raises ModelError for an unknown name."""
    names = [lump.name for lump in lumps]
    for name in arm.inertial:
        if name not in names:
            near = nearest(name, names)
            hint = f'; did you mean "{near}"?' if near else ""
            raise ModelError(
                f'{arm.name}: inertial: unknown base parameter "{name}"{hint} (this arm has {", ".join(names)})'
            )
    return tuple(
        replace(lump, value=arm.inertial[lump.name], lacks=()) if lump.name in arm.inertial else lump for lump in lumps
    )


def _meaning(kind: str, joint: int, sliding: bool, n: int) -> str:
    end = "the end-effector" if joint == n else f"joint {joint + 1}"
    if kind == "mu":
        return f"mass that joint {joint} slides" if sliding else f"point mass that link {joint} carries at {end}"
    return {
        "J": f"inertia that turns with link {joint} about joint {joint}, beyond the point masses",
        "I": f"rotor inertia of joint {joint} at its output",
        "h": f"first mass moment of link {joint} along it, beyond the point masses",
        "hy": f"first mass moment of link {joint} across it, from a centre of mass off its line",
    }[kind]
