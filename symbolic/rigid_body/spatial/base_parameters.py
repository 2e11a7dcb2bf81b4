"""Base inertial parameters of a spatial chain, the layout of its recursion, and the names under which users see them.

Mass on the axis of a revolute joint may be counted to the link before: three moments of its link (m, z, zz) merge into
the neighbour's. A prismatic joint does not turn its link, so that the six second moments merge. Further dependencies,
near the base and between rotors and links, are found by exact rank. The remaining columns are the base parameters:
tau = Y lumps holds exactly, Y has full rank. The layout with the fewest operations is found by running the recursion on
values that only count.

Source: Gautier & Khalil 1990 (minimum inertial parameters).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from symbolic.functions import Notes, OperationCounter, Turn
from symbolic.model_file.arm import Arm
from symbolic.rigid_body.base_parameters import (
    PRIME,
    BaseParameters,
    Column,
    Combination,
    LayoutConstant,
    Lump,
    dependencies,
    exact,
    overridden,
)
from symbolic.rigid_body.spatial.geometry import NOWHERE, Geometry, Vector, dot, offset_symbol, scaled
from symbolic.rigid_body.spatial.recursion import (
    INERTIA,
    KINDS,
    Moments,
    SpatialMotion,
    body_values,
    groups,
    motion,
    named,
    torques,
    turned,
    twisted,
    wrench,
)

ROTOR = "I"
MIRRORED = ("xy", "xz", "yz")
"""Moments whose base parameters have the sign of the inertia tensor's elements, the opposite one."""
_STAYS = {True: ("xx", "yy", "xy", "xz", "yz", "x", "y"), False: ("x", "y", "z", "m")}
"""Moments that do not merge into the previous link, of a revolute (True) and of a prismatic joint's link."""


@dataclass(frozen=True)
class Merging:
    """Every moment (kind, link) and rotor ("I", joint) as a combination of the kept columns."""

    kept: tuple[Column, ...]
    terms: Mapping[Column, Combination]


def merging(g: Geometry) -> Merging:
    """The merging for a geometry."""
    # Every moment in terms of those that stay; at the base, the others vanish.
    near: dict[Column, Combination] = {}
    for i, link in enumerate(g.links):
        for kind in KINDS:
            near[kind, i] = {(kind, i): Fraction(1)} if kind in _STAYS[link.revolute] else {}
            if i and not near[kind, i]:
                before = Moments(**{kind: Fraction(1)}).placed(link.start)
                near[kind, i] = _combined([(f, near[k, i - 1]) for k, f in zip(KINDS, before, strict=False) if f])
    candidates = [(kind, i) for i, link in enumerate(g.links) for kind in _STAYS[link.revolute]]
    rotors = [(ROTOR, i) for i in range(g.n)]
    order = [*candidates[:1], *rotors, *candidates[1:]]
    chain = g.residues(PRIME)

    def torques_of(q: list[Any], qd: list[int], qdd: list[int], notes: Notes) -> dict[Column, list[Any]]:
        moving = motion(chain, range(g.n), q, qd=qd, qdd=qdd, notes=notes)
        return columns(chain, order, moving, qdd=qdd, notes=notes)

    points = -(-len(order) // g.n) + 2
    dependent = dependencies([link.revolute for link in g.links], points, torques_of)
    kept = tuple(c for c in order if c not in dependent)
    far = {c: {c: Fraction(1)} for c in kept} | dependent
    terms = {c: _combined([(f, far[own]) for own, f in parts.items()]) for c, parts in near.items()}
    return Merging(kept, terms | {c: far[c] for c in rotors})


def _combined(parts: Sequence[tuple[Fraction, Combination]]) -> Combination:
    total: Combination = {}
    for factor, combination in parts:
        for column, f in combination.items():
            total[column] = total.get(column, Fraction(0)) + factor * f
    return {column: f for column, f in total.items() if f}


def columns(
    g: Geometry, kept: Sequence[Column], moving: Sequence[SpatialMotion], qdd: Sequence[Any], notes: Notes
) -> dict[Column, list[Any]]:
    """The torques (n,) of a unit of each of these moments and rotors. moving: every link along its own axes."""
    found: dict[Column, list[Any]] = {c: [0] * g.n for c in kept}
    # The inner joints' axes, and the velocities of link i's origin by them.
    axes: list[tuple[Vector, Vector]] = []
    for i, (link, m) in enumerate(zip(g.links, moving, strict=True)):
        for j, (z, v) in enumerate(axes):
            if m.first:
                v = (v[0], v[1] + z[2] * link.a, v[2] - z[1] * link.a)
                z, v = twisted(z, link.twist), twisted(v, link.twist)
            else:
                x, y = m.reach
                v = (v[0] - z[2] * y, v[1] + z[2] * x, v[2] + z[0] * y - z[1] * x)
            name = f"{j + 1}_{i + 1}"
            z, v = (named(e, name, turned(vector, m.before), notes) for e, vector in (("z", z), ("y", v)))
            axes[j] = z, named("y", name, (v[0] + z[1] * m.lift, v[1] - z[0] * m.lift, v[2]), notes)
        unit = scaled(link.sign, m.axis)
        axes.append((unit, NOWHERE) if link.revolute else (NOWHERE, unit))
        for kind in (k for k, j in kept if j == i):
            if kind == ROTOR:
                found[kind, i][i] = qdd[i]
                continue
            force, moment = wrench(Moments(**{kind: 1}), m)
            for j, (z, v) in enumerate(axes):
                found[kind, i][j] = dot(force, v) + dot(moment, z)
    return found


def base_parameters(arm: Arm, g: Geometry, merged: Merging) -> BaseParameters:
    """Values of the kept columns, and the file's parameters (INERTIA's kinds and "I") that each consists of."""
    values: dict[Column, Fraction | None] = {}
    parts: dict[Column, list[tuple[Column, Fraction]]] = {c: [] for c in merged.kept}
    for i, (joint, link) in enumerate(zip(arm.joints, g.links, strict=True)):
        values |= {(kind, i): value for kind, value in body_values(joint.link).items()}
        values[ROTOR, i] = None if joint.rotor_inertia is None else exact(joint.rotor_inertia)
        own = {kind: unit.placed(link.body) for kind, unit in INERTIA.items()}
        units = {
            kind: _combined([(f, merged.terms[k, i]) for k, f in zip(KINDS, moments, strict=False) if f])
            for kind, moments in own.items()
        }
        for kind, terms in (units | {ROTOR: merged.terms[ROTOR, i]}).items():
            for column, f in terms.items():
                parts[column].append(((kind, i), -f if column[0] in MIRRORED else f))
    order = sorted(merged.kept, key=lambda c: (c[1], (*KINDS, ROTOR).index(c[0])))
    return BaseParameters.of({c: parts[c] for c in order}, values)


def choose_axes(g: Geometry, kept: Sequence[Column]) -> tuple[int, ...]:
    """The axes of recursion.motion with the fewest operations in inverse dynamics that single changes lead to.

    Masses of revolute links are not kept as base parameters: that would save the recursion 1 % of its operations and
    cost D and forward dynamics several.
    """
    best = tuple(range(g.n))
    # Axes that were tried before cannot be better.
    least, tried, improved = _cost(g, best, kept), {best}, True
    while improved:
        improved = False
        for axes in (other for other in _other_axes(g, best) if other not in tried):
            tried.add(axes)
            cost = _cost(g, axes, kept)
            if cost < least:
                best, least, improved = axes, cost, True
                break
    return best


def _other_axes(g: Geometry, chosen: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """The choices in which consecutive links of a group are written along other axes of it."""
    for group in groups(g):
        for first in group:
            for last in range(first, group[-1] + 1):
                for axes in range(group[0] - 1, group[-1] + 1):
                    yield (*chosen[:first], *[axes] * (last + 1 - first), *chosen[last + 1 :])


def bodies(values: Mapping[Column, Any], n: int) -> tuple[list[Moments], list[Any]]:
    """The links' moments and the joints' rotors from base parameters, which have the inertia tensor's signs; 0 where
    there is none."""
    moments = [Moments()] * n
    for (kind, i), x in values.items():
        if kind != ROTOR:
            moments[i] = moments[i]._replace(**{kind: -x if kind in MIRRORED else x})
    return moments, [values.get((ROTOR, i), 0) for i in range(n)]


def _cost(g: Geometry, axes: Sequence[int], kept: Sequence[Column]) -> int:
    counter = OperationCounter()
    chain = g.over(lambda x: x, [rest if rest == 0 else counter.leaf(f"rest{i}") for i, rest in enumerate(g.rests)])

    def leaves(name: str) -> Sequence[Any]:
        return [counter.leaf(f"{name}{i}") for i in range(g.n)]

    qdd = leaves("qdd")
    moments, rotors = bodies({c: counter.leaf(str(c)) for c in kept}, g.n)
    moving = motion(chain, axes, leaves("q"), qd=leaves("qd"), qdd=qdd, notes=counter)
    return counter.cost(torques(chain, moments, rotors, moving=moving, qdd=qdd, notes=counter))


NAMES = {"xx": "YY", "yy": "XX", "xy": "XY", "xz": "XZ", "yz": "YZ", "x": "MX", "y": "MY", "z": "MZ", "m": "M"}
"""The field's names. Mass along a link's z axis merges into the previous link; without it, ∫ y² dm is the inertia about
x, XX, ∫ x² dm that about y, YY, and ZZ = XX + YY."""


def named_lumps(arm: Arm, base: BaseParameters, merged: Merging) -> tuple[Lump, ...]:
    """The base parameters with names, units, meanings and values; identified values in the file have precedence.

    Raises ModelError for an identified value whose name this arm does not have.
    """
    lumps = []
    for column in base.values:
        kind, i = column
        parts = base.merged[column]
        # A link that only turns about its joint's direction: XX and YY act as one.
        about_z = kind == "xx" and merged.terms["yy", i] == {column: 1}
        name = "I" if kind == ROTOR else "ZZ" if about_z else NAMES[kind]
        sliding = arm.joints[i].type == "prismatic"
        lump = Lump(
            f"{name}{i + 1}",
            {"I": "kg" if sliding else "kg m^2", "M": "kg"}.get(name, "kg m" if name[0] == "M" else "kg m^2"),
            _meaning(name, i + 1) + (", with what merges into it" if len(parts) > 1 else ""),
            joint=i + 1,
            parts=tuple((j + 1, own, factor) for (own, j), factor in parts),
        )
        lumps.append(base.described(lump, column, arm))
    return overridden(arm, lumps)


def _meaning(name: str, joint: int) -> str:
    if name == "I":
        return f"rotor inertia of joint {joint} at its output"
    if name == "ZZ":
        return f"inertia of link {joint} about its joint"
    if name == "M":
        return f"mass of link {joint}"
    if name[0] == "M":
        return f"first mass moment of link {joint} along {name[1].lower()} of its DH frame"
    return f"inertia {name} of link {joint} in its DH frame, of what lies across z"


def angles(g: Geometry) -> tuple[LayoutConstant, ...]:
    """Constants of the struct: angles beyond quarter turns between the model file's zero and the DH frames'."""
    return tuple(
        LayoutConstant(
            offset_symbol(j), "rad", f"of joint {j}'s DH frame where q{j} = 0", math.atan2(rest.sin, rest.cos)
        )
        for j, rest in enumerate(g.rests, 1)
        if isinstance(rest, Turn)
    )
