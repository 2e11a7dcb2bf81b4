"""Base inertial parameters: which combinations of masses, moments and inertias the torques can show.

Every link has the elementary parameters of newton_euler.Lumps. Their columns in the regressor are not
independent: mass at a joint may be counted to either link, the first joint's rotor turns with its link,
and so on. Those that depend on earlier ones, in an order of preference that makes the recursion short,
are merged into them (exact_rank.py). What is left are base parameters: tau = Y lumps holds exactly, Y has
full rank.

Source: Gautier & Khalil 1990 (minimum inertial parameters).
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from symbolic.model_file.arm import Arm, Link
from symbolic.rigid_body.exact_rank import (
    PRIME,
    BaseParameters,
    Column,
    dependencies,
    exact,
    known_sum,
    random_turn,
    residue,
)
from symbolic.rigid_body.newton_euler import Chain, Gravity, Lumps, motion, torques
from symbolic.straightline import Residues, Turn

KINDS = ("J", "I", "mu", "h", "hy")


def exact_chain(arm: Arm) -> Chain:
    """The arm's chain in exact numbers; the gravity angle is a Turn that carries the strength."""
    gx, gy = (exact(g) for g in arm.gravity[:2])
    gravity = Gravity(gx or 0, gy or 0, 1, Turn(gx, gy)) if gx or gy else None
    return Chain(tuple(j.type == "revolute" for j in arm.joints), tuple(map(exact, arm.lengths)), gravity)


def link_values(link: Link, length: float, revolute: bool) -> Mapping[str, Fraction | None]:
    """The elementary parameters of one link: its whole mass stands at the distal point. None: not known."""
    m = None if link.mass is None else exact(link.mass)
    inertia = None if link.inertia is None else exact(link.inertia[5])
    if m is None or link.com is None:
        return {"J": None, "mu": m, "h": None, "hy": None}
    along, across = exact(link.com[0]), exact(link.com[1])
    end = exact(length)
    h, hy = m * (along - end), m * across
    # Of a revolute link, moments about the joint, less what the point mass contributes.
    offset = m * (across**2 + (along**2 - end**2 if revolute else (along - end) ** 2))
    return {"J": None if inertia is None else inertia + offset, "mu": m, "h": h, "hy": hy}


def elementary(arm: Arm) -> dict[Column, Fraction | None]:
    """All elementary parameters in order of preference; hy only where a centre of mass may be off its link's line."""
    n = len(arm.joints)
    values: dict[Column, Fraction | None] = {}
    for i, (joint, length) in enumerate(zip(arm.joints, arm.lengths, strict=True)):
        for kind, value in link_values(joint.link, length, joint.type == "revolute").items():
            values[kind, i] = value
        values["I", i] = None if joint.rotor_inertia is None else exact(joint.rotor_inertia)
    sliding = {i for i, j in enumerate(arm.joints) if j.type == "prismatic"}
    order: list[Column] = [("J", i) for i in range(n)] + [("mu", i) for i in sorted(sliding)]
    order += [("I", i) for i in range(n)] + [("mu", i) for i in range(n - 1)] + [("h", n - 1)]
    order += [("hy", i) for i in range(n) if values["hy", i] != 0] + [("mu", n - 1)]
    order += [("h", i) for i in reversed(range(n - 1))]
    return {c: values[c] for c in dict.fromkeys(order)}


def base_parameters(arm: Arm) -> BaseParameters:
    """Merge the dependent columns; the result is in the order J, I, mu, h, hy and then by joint."""
    values = elementary(arm)
    points = -(-len(values) // len(arm.joints)) + 4
    coefficients = dependencies(_regressor(arm, tuple(values), points))
    merged: dict[Column, list[tuple[Column, Fraction]]] = {
        c: [(c, Fraction(1))] for c in values if c not in coefficients
    }
    for column, combination in coefficients.items():
        for target, factor in combination.items():
            merged[target].append((column, factor))
    order = sorted(merged, key=lambda c: (KINDS.index(c[0]), c[1]))
    return BaseParameters({c: known_sum(values, merged[c]) for c in order}, {c: tuple(merged[c]) for c in order})


def _regressor(arm: Arm, columns: tuple[Column, ...], points: int) -> dict[Column, list[int]]:
    """Columns of the regressor over `points` random states, modulo PRIME. The seed is fixed: the output must be."""
    rng, notes, n = random.Random(1), Residues(PRIME), len(arm.joints)
    chain = _modular(exact_chain(arm))
    result: dict[Column, list[int]] = {c: [] for c in columns}
    for _ in range(points):
        q = [random_turn(rng) if r else rng.randrange(PRIME) for r in chain.revolute]
        qd, qdd = ([rng.randrange(PRIME) for _ in range(n)] for _ in range(2))
        moving = motion(chain, 0, q, qd, qdd, notes)
        for column in columns:
            tau = torques(chain, unit_lumps(n, column), moving, qdd, notes)
            result[column] += [t % PRIME for t in tau]
    return result


def unit_lumps(n: int, column: Column) -> Lumps:
    """All lumps 0 but one, which is 1."""
    values = {kind: [0] * n for kind in KINDS}
    values[column[0]][column[1]] = 1
    return Lumps(**{kind: tuple(v) for kind, v in values.items()})


def lumps_of(values: dict[Column, Any], n: int) -> Lumps:
    """The recursion's parameters from those that are base parameters; all others are 0."""
    return Lumps(**{kind: tuple(values.get((kind, i), 0) for i in range(n)) for kind in KINDS})


def _modular(chain: Chain) -> Chain:
    g = chain.gravity
    if g is not None:
        angle = Turn(residue(g.angle.cos), residue(g.angle.sin))
        g = Gravity(residue(g.x), residue(g.y), residue(g.strength), angle)
    return Chain(chain.revolute, tuple(residue(l) for l in chain.lengths), g)
