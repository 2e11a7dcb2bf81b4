"""Base inertial parameters in space: which combinations of the bodies' moments the torques can show.

Mass on the axis of a revolute joint may be counted to the link before, whatever the joint does: three of a link's
moments (m, z, zz) merge into its neighbour's. A prismatic joint does not turn its link: the six second moments merge.
What else depends on each other, near the base and between rotors and links, is found exactly (exact_rank.py). What is
left are base parameters: tau = Y lumps holds exactly, Y has full rank.

Source: Gautier & Khalil 1990 (minimum inertial parameters).
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from symbolic.model_file.arm import Arm
from symbolic.rigid_body.exact_rank import (
    PRIME,
    BaseParameters,
    Column,
    Combination,
    dependencies,
    exact,
    known_sum,
    random_turn,
)
from symbolic.rigid_body.spatial.geometry import Geometry
from symbolic.rigid_body.spatial.moments import INERTIA, KINDS, Moments, body_values
from symbolic.rigid_body.spatial.recursion import SpatialMotion, motion, named, turned, twisted, wrench
from symbolic.rigid_body.spatial.vectors import Vector, dot, scaled
from symbolic.straightline import Notes, Residues

ROTOR = "I"
MIRRORED = ("xy", "xz", "yz")
"""Moments whose base parameters have the sign of the inertia tensor's elements, which is the other one."""
_STAYS = {True: ("xx", "yy", "xy", "xz", "yz", "x", "y"), False: ("x", "y", "z", "m")}
"""Moments that do not merge into the link before, of a revolute joint's link and of a prismatic one's."""


@dataclass(frozen=True)
class Merging:
    """Every moment (kind, link) and rotor ("I", joint) in terms of the columns that are kept."""

    kept: tuple[Column, ...]
    terms: Mapping[Column, Combination]


def merging(g: Geometry) -> Merging:
    """By the geometry alone."""
    near = _merged_inwards(g)
    candidates = [(kind, i) for i, link in enumerate(g.links) for kind in _STAYS[link.revolute]]
    rotors = [(ROTOR, i) for i in range(g.n)]
    order = [*candidates[:1], *rotors, *candidates[1:]]
    dependent = dependencies(_residues(g, order))
    kept = tuple(c for c in order if c not in dependent)
    far = {c: {c: Fraction(1)} for c in kept} | dependent
    terms = {c: _combined([(f, far[own]) for own, f in parts.items()]) for c, parts in near.items()}
    return Merging(kept, terms | {c: far[c] for c in rotors})


def _merged_inwards(g: Geometry) -> dict[Column, Combination]:
    """Every moment in terms of those that stay; at the base the others vanish."""
    found: dict[Column, Combination] = {}
    for i, link in enumerate(g.links):
        for kind in KINDS:
            if kind in _STAYS[link.revolute]:
                found[kind, i] = {(kind, i): Fraction(1)}
            elif i == 0:
                found[kind, i] = {}
            else:
                before = Moments(**{kind: Fraction(1)}).placed(link.start)
                found[kind, i] = _combined([(f, found[k, i - 1]) for k, f in zip(KINDS, before, strict=True) if f])
    return found


def _combined(parts: Sequence[tuple[Fraction, Combination]]) -> Combination:
    total: Combination = {}
    for factor, combination in parts:
        for column, f in combination.items():
            total[column] = total.get(column, Fraction(0)) + factor * f
    return {column: f for column, f in total.items() if f}


def _residues(g: Geometry, kept: Sequence[Column]) -> dict[Column, list[int]]:
    """Columns of the regressor at random states, modulo PRIME. The seed is fixed: the output must be."""
    rng, notes, n, chain = random.Random(1), Residues(PRIME), g.n, g.residues(PRIME)
    found: dict[Column, list[int]] = {c: [] for c in kept}
    for _ in range(-(-len(kept) // n) + 2):
        q = [random_turn(rng) if link.revolute else rng.randrange(PRIME) for link in g.links]
        qd, qdd = ([rng.randrange(PRIME) for _ in range(n)] for _ in range(2))
        moving = motion(chain, range(n), q, qd, qdd, notes)
        for column, torques in columns(chain, kept, moving, qdd, notes).items():
            found[column] += [t % PRIME for t in torques]
    return found


def columns(
    g: Geometry, kept: Sequence[Column], moving: Sequence[SpatialMotion], qdd: Sequence[Any], notes: Notes
) -> dict[Column, list[Any]]:
    """The torques (n,) of a unit of each of these moments and rotors. `moving`: every link along its own axes."""
    found: dict[Column, list[Any]] = {c: [0] * g.n for c in kept}
    axes: list[tuple[Vector, Vector]] = []
    for i, m in enumerate(moving):
        axes = [_outwards(z, v, g, moving, i, f"{j + 1}_{i + 1}", notes) for j, (z, v) in enumerate(axes)]
        unit = scaled(g.links[i].sign, m.axis)
        nothing: Vector = (0, 0, 0)
        axes.append((unit, nothing) if g.links[i].revolute else (nothing, unit))
        for kind in (k for k, j in kept if j == i):
            if kind == ROTOR:
                found[kind, i][i] = qdd[i]
                continue
            force, moment = wrench(Moments(**{kind: 1}), m)
            for j, (z, v) in enumerate(axes):
                found[kind, i][j] = dot(force, v) + dot(moment, z)
    return found


def _outwards(
    z: Vector, v: Vector, g: Geometry, moving: Sequence[SpatialMotion], i: int, name: str, notes: Notes
) -> tuple[Vector, Vector]:
    """Axis of an inner joint and velocity of link i's origin by it, along the link's own axes, from the link before."""
    link, m = g.links[i], moving[i]
    if m.first:
        v = (v[0], v[1] + z[2] * link.a, v[2] - z[1] * link.a)
        z, v = twisted(z, link.twist), twisted(v, link.twist)
    else:
        x, y = m.reach
        v = (v[0] - z[2] * y, v[1] + z[2] * x, v[2] + z[0] * y - z[1] * x)
    z, v = (named(e, name, turned(vector, m.before), notes) for e, vector in (("z", z), ("y", v)))
    return z, named("y", name, (v[0] + z[1] * m.lift, v[1] - z[0] * m.lift, v[2]), notes)


def base_parameters(arm: Arm, g: Geometry, merged: Merging) -> BaseParameters:
    """What the kept columns come to. `merged`: the file's parameters that are in each, INERTIA's kinds and "I"."""
    values: dict[Column, Fraction | None] = {}
    parts: dict[Column, list[tuple[Column, Fraction]]] = {c: [] for c in merged.kept}
    for i, (joint, link) in enumerate(zip(arm.joints, g.links, strict=True)):
        values |= {(kind, i): value for kind, value in body_values(joint.link).items()}
        values[ROTOR, i] = None if joint.rotor_inertia is None else exact(joint.rotor_inertia)
        own = {kind: unit.placed(link.body) for kind, unit in INERTIA.items()}
        units = {
            kind: _combined([(f, merged.terms[k, i]) for k, f in zip(KINDS, moments, strict=True) if f])
            for kind, moments in own.items()
        }
        for kind, terms in (units | {ROTOR: merged.terms[ROTOR, i]}).items():
            for column, f in terms.items():
                parts[column].append(((kind, i), -f if column[0] in MIRRORED else f))
    order = sorted(merged.kept, key=lambda c: (c[1], (*KINDS, ROTOR).index(c[0])))
    return BaseParameters({c: known_sum(values, parts[c]) for c in order}, {c: tuple(parts[c]) for c in order})
