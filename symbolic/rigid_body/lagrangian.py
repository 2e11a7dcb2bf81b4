"""D, C and g of a planar chain from kinetic and potential energy: the reference for all planar dynamics.

Absolute angles theta_k (and slides) are the coordinates. Every vector is a sum of X e(theta_k) + Y e'(theta_k), e'
perpendicular to e, so that products of vectors are cosines and sines of theta_k − theta_l and nothing needs to be
simplified. T = ½ Σ A_ij θ̇_i θ̇_j, C from Christoffel symbols (Ḋ − 2C is skew-symmetric), g = ∂V/∂q.

Bodies may have the model file's physical parameters, for the proof, or lumped ones, for emission.
Source: Spong & Vidyasagar 1989; equation (1) of the paper.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import sympy as sp

from symbolic.functions import Exact, Notes
from symbolic.rigid_body.base_parameters import exact
from symbolic.rigid_body.newton_euler import Chain

NOTATION = {
    "c, s": "cosine and sine; c23 of q2 + q3",
    "w": "absolute rate",
    "m": "coefficient of A",
    "A": "inertia in absolute angles",
    "B": "Coriolis matrix in absolute angles",
    "V": "derivative of the potential energy by an absolute angle",
    "AS, BS": "the same, columns in joint angles",
    "D": "inertia matrix",
    "C": "Coriolis matrix",
    "g": "gravity torque",
}
"""The meaning of names in the generated code."""

Components = dict[int, tuple[Any, Any]]
"""A vector, the sum of X e(theta_k) + Y e'(theta_k): frame k -> (X, Y)."""


@dataclass(frozen=True)
class Body:
    """A link's body: a mass at `at`, a first moment `moment` without mass about `about`, and an inertia."""

    mass: Any
    at: Components
    moment: tuple[Any, Any]
    about: Components
    inertia: Any


@dataclass(frozen=True)
class Mechanics:
    """tau = D qdd + C qd + g: D (n, n) and C (n, n) by rows, g (n,), and the potential energy V."""

    D: list[list[sp.Expr]]
    C: list[list[sp.Expr]]
    g: list[sp.Expr]
    V: sp.Expr


def theta(k: int) -> sp.Expr:
    """Absolute angle of frame k; the base is frame 0."""
    return sp.Symbol(f"theta{k}", real=True) if k else sp.Integer(0)


def distal_points(chain: Chain, q: list[Any]) -> list[Components]:
    """The base and the distal points of the links, n + 1 vectors."""
    points: list[Components] = [{}]
    for i, frame in enumerate(chain.frames):
        reach = chain.lengths[i] if chain.revolute[i] else chain.lengths[i] + q[i]
        points.append(moved(points[-1], frame, reach, 0))
    return points


def moved(point: Components, frame: int, along: Any, across: Any) -> Components:
    """The point moved by (along, across) in a frame."""
    x, y = point.get(frame, (0, 0))
    return {**point, frame: (x + along, y + across)}


def rational(value: float) -> sp.Rational:
    """The decimal number as it is written, exactly."""
    return sp.Rational(exact(value))


def derivative(point: Components, chain: Chain, joint: int) -> tuple[int, Any, Any] | None:
    """∂point/∂(absolute coordinate of `joint`) as (frame, X, Y), for a point outwards of the joint."""
    if chain.revolute[joint]:
        x, y = point.get(joint + 1, (0, 0))
        return None if x == 0 and y == 0 else (joint + 1, -y, x)
    return (chain.frames[joint], 1, 0)


def mechanics(
    chain: Chain, bodies: list[Body], rotors: list[Any], q: list[Any], qd: list[Any], notes: Notes | None = None
) -> Mechanics:
    """D, C, g of a chain of bodies, in q and q̇.

    rotors   (n,) they have the relative rates: T += ½ I_i q̇_i²     notes   names intermediate values; None: no names
    """
    notes = notes or Exact()
    n, coordinates = chain.n, [theta(i + 1) if r else q[i] for i, r in enumerate(chain.revolute)]
    A = _inertia(chain, bodies, set(q), notes)
    slopes = {(i, j, k): sp.diff(A[i][j], x) for i in range(n) for j in range(i, n) for k, x in enumerate(coordinates)}

    def slope(i: int, j: int, k: int) -> sp.Expr:
        return slopes[min(i, j), max(i, j), k]

    rates: list[Any] = []
    w: Any = 0
    for i, revolute in enumerate(chain.revolute):
        w = notes.let(f"w{i + 1}", w + qd[i]) if revolute else w
        rates.append(w if revolute else qd[i])
    C = [
        [sum((slope(i, j, k) + slope(i, k, j) - slope(j, k, i)) / 2 * rates[k] for k in range(n)) for j in range(n)]
        for i in range(n)
    ]
    V = _potential(chain, bodies)
    g = [sp.diff(V, x) for x in coordinates]
    # Absolute angles are sums of joint angles.
    turning = [i for i, revolute in enumerate(chain.revolute) if revolute]
    sums = itertools.accumulate(q[i] for i in turning)
    absolute = {theta(i + 1): angle for i, angle in zip(turning, sums, strict=True)}

    def rows(matrix: list[list[Any]], name: str) -> list[list[Any]]:
        return [
            [notes.let(f"{name}{i}{j}", sp.sympify(e).xreplace(absolute)) for j, e in enumerate(row, 1)]
            for i, row in enumerate(matrix, 1)
        ]

    D = relative(chain, rows(A, "A"), notes, half="AS", name="D")
    for i in range(n):
        D[i][i] = D[i][i] + rotors[i]
    C = relative(chain, rows(C, "B"), notes, half="BS", name="C")
    g = relative_vector(chain, [notes.let(f"V{i}", e.xreplace(absolute)) for i, e in enumerate(g, 1)], notes, "g{}")
    return Mechanics(D, C, g, V.xreplace(absolute))


def _inertia(chain: Chain, bodies: list[Body], slides: set[Any], notes: Notes) -> list[list[sp.Expr]]:
    """A (n, n), symmetric, in absolute coordinates."""
    n = chain.n
    terms: dict[tuple[int, int], list[tuple[Any, tuple[int, Any, Any], tuple[int, Any, Any]]]] = {}

    def add(i: int, j: int, factor: Any, u: tuple[int, Any, Any] | None, v: tuple[int, Any, Any] | None) -> None:
        if u is not None and v is not None and factor != 0:
            terms.setdefault((i, j), []).append((factor, u, v))

    own = [[sp.Integer(0)] * n for _ in range(n)]
    for last, body in enumerate(bodies):
        frame = chain.frames[last]
        moving = [derivative(body.at, chain, i) for i in range(last + 1)]
        for i in range(last + 1):
            for j in range(i, last + 1):
                add(i, j, body.mass, u=moving[i], v=moving[j])
        if not frame:
            continue
        turning = frame - 1
        own[turning][turning] += body.inertia
        # Kinetic energy of a first moment: (rate of its base point) · (rate of the moment).
        hx, hy = body.moment
        for i in range(last + 1):
            base = derivative(body.about, chain, i)
            add(min(i, turning), max(i, turning), 2 if i == turning else 1, u=base, v=(frame, -hy, hx))
    A = [[sp.Integer(0)] * n for _ in range(n)]
    for i in range(n):
        for j in range(i, n):
            A[i][j] = A[j][i] = own[i][j] + _products(terms.get((i, j), []), f"m{i + 1}{j + 1}", slides, notes)
    return A


def _products(
    terms: list[tuple[Any, tuple[int, Any, Any], tuple[int, Any, Any]]], name: str, slides: set[Any], notes: Notes
) -> sp.Expr:
    """Σ factor u · v, collected by pair of frames."""
    cosines: dict[tuple[int, int], Any] = {}
    sines: dict[tuple[int, int], Any] = {}
    for factor, (k, x, y), (l, x2, y2) in terms:
        sign = 1 if k <= l else -1
        pair = (min(k, l), max(k, l))
        cosines[pair] = cosines.get(pair, 0) + factor * (x * x2 + y * y2)
        sines[pair] = sines.get(pair, 0) + sign * factor * (y * x2 - x * y2)
    total = sp.Integer(0)
    for collected, function in ((cosines, sp.cos), (sines, sp.sin)):
        for (k, l), value in collected.items():
            coefficient = sp.sympify(value)
            if not coefficient.free_symbols & slides:  # slides are differentiated
                coefficient = notes.let(name, coefficient)
            total += coefficient * function(theta(l) - theta(k))
    return total


def _potential(chain: Chain, bodies: list[Body]) -> sp.Expr:
    """V = −Σ gravity · (mass times position + first moment)."""
    gravity, total = chain.gravity, sp.Integer(0)
    if gravity is None:
        return total
    for last, body in enumerate(bodies):
        weights = {k: (body.mass * x, body.mass * y) for k, (x, y) in body.at.items()}
        for k, (x, y) in moved(weights, chain.frames[last], *body.moment).items():
            # Gravity's components along and across the frame's direction.
            angle = theta(k)
            turned, size = (angle, gravity.x) if gravity.y == 0 else (angle - gravity.angle, gravity.strength)
            along, across = size * sp.cos(turned), -size * sp.sin(turned)
            if angle == 0:
                along, across = gravity.x, gravity.y
            elif gravity.x == 0:
                along, across = gravity.y * sp.sin(angle), gravity.y * sp.cos(angle)
            total -= x * along + y * across
    return total


def relative(chain: Chain, matrix: list[list[Any]], notes: Notes, half: str, name: str) -> list[list[Any]]:
    """SᵀMS: from absolute coordinates to q, by sums from the tip inwards. half, name: names of MS and of the result."""
    rows = [relative_vector(chain, row, notes, f"{half}{i}{{}}") for i, row in enumerate(matrix, 1)]
    columns = [
        relative_vector(chain, list(column), notes, f"{name}{{}}{j}")
        for j, column in enumerate(zip(*rows, strict=True), 1)
    ]
    return [list(row) for row in zip(*columns, strict=True)]


def relative_vector(chain: Chain, vector: list[Any], notes: Notes, name: str) -> list[Any]:
    """Sᵀv: a revolute joint turns all frames further out. name: a format with a place for the joint."""
    result: list[Any] = list(vector)
    total: Any = 0
    for i in reversed(range(chain.n)):
        if chain.revolute[i]:
            total = notes.let(name.format(i + 1), total + vector[i])
            result[i] = total
    return result
