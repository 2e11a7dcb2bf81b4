"""Inverse and forward dynamics of a spatial chain, the torque on its links, and the regressor.

Forward dynamics solves D = L diag(d) L^T; C qd + g comes from the composites that D has already. Joint j carries a
composite. All of it is accelerated as link j − 1 is; this field, linear in the place, is known from w, its derivative
al at constant rates, and the acceleration a of the joint's origin. Beyond it every joint k >= j adds the field by which
link k is accelerated relative to link k − 1,

    [[-u w_z, 0, 0], [0, -u w_z, 0], [u w_x, u w_y, 0]] x,   u = 2 qd_k,   w = w_(k-1) + (0, 0, qd_k / 2)

of its own composite, which needs no acceleration of an origin and has no moment about its own axis. Forces of these
fields are carried inwards; of the first field only the moment about z_j is needed. That moment is the same for every
link that turns about z_j relative to link j − 1: w may be taken half way through the joint, so that both fields share
S w, and parallel joints share the field of the link before them.

Source: Walker & Orin 1982 (composite bodies); Uicker 1965 (second moments); Khalil & Kleinfinger 1987 (recursion).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import sympy as sp

from symbolic.functions import Author, Continuation, SymbolicFunction
from symbolic.rigid_body.base_parameters import Column
from symbolic.rigid_body.dynamics import equation, solve_symmetric
from symbolic.rigid_body.spatial.base_parameters import MIRRORED, bodies, columns
from symbolic.rigid_body.spatial.composites import (
    COMPOSITE_NOTATION,
    JointStep,
    Wrench,
    composites,
    gradient,
    inertia,
    signed,
)
from symbolic.rigid_body.spatial.geometry import (
    NOWHERE,
    Geometry,
    Matrix,
    Vector,
    added,
    applied,
    cross,
    dot,
    negative,
    scaled,
)
from symbolic.rigid_body.spatial.recursion import Moments, groups, motion, torques

NOTATION = {
    "c, s": "cosine and sine; c23 of q2 + q3",
    "w": "angular velocity",
    "v": "the same at the joint before",
    "al": "angular acceleration",
    "ww": "product of angular velocities",
    "p": "the same, after the difference from w",
    "U": "acceleration by place; u: its column along the joint",
    "a": "acceleration of the origin less gravity; b at the joint before",
    "lc, ls": "length along x and y",
    "r": "way along the axis",
    "S, Sxx, Syy, Sxy, Sx, Sy, Sz": "moments of a link along shared axes",
    "F, f": "force",
    "N": "moment",
}
"""The meaning of names in the generated code; they end with the axis and the link's number."""


def functions(
    author: Author, g: Geometry, axes: Sequence[int], symbols: Mapping[Column, sp.Symbol], own: Sequence[Any]
) -> list[SymbolicFunction]:
    """inverse_dynamics, link_load, regressor.

    g   with SymPy numbers     axes   (n,) see recursion.motion
    symbols   the base parameters     own   (n,) the rotors' inertias, kg m² (kg)
    """
    recorder, n = author.recorder(), g.n
    q, qd, qdd = (author.coordinates.symbols(name) for name in ("q", "qd", "qdd"))
    moving = motion(g, axes, q, qd=qd, qdd=qdd, notes=recorder)
    tau = torques(g, *bodies(symbols, n), moving, qdd, recorder)
    whole = [recorder.symbol(f"whole{i + 1}", torque) for i, torque in enumerate(tau)]
    load = [torque - rotor * a for torque, rotor, a in zip(whole, own, qdd, strict=True)]
    made = partial(equation, author, recorder)
    return [
        made(
            "inverse_dynamics",
            tau,
            source="Newton-Euler recursion on base parameters, in modified DH frames: Khalil & Kleinfinger 1987",
            notation=NOTATION,
        ),
        made(
            "link_load",
            load,
            source="Inverse dynamics less the model file's rotor inertia times qdd",
            notation=NOTATION | {"whole": "torque of a joint, its rotor included"},
            continues=Continuation("inverse_dynamics", tuple((symbol, i) for i, symbol in enumerate(whole))),
        ),
        _regressor(author, g, tuple(symbols)),
    ]


def _regressor(author: Author, g: Geometry, kept: Sequence[Column]) -> SymbolicFunction:
    recorder, n = author.recorder(), g.n
    q, qd, qdd = (author.coordinates.symbols(name) for name in ("q", "qd", "qdd"))
    moving = motion(g, range(n), q, qd=qd, qdd=qdd, notes=recorder)
    found = columns(g, kept, moving, qdd=qdd, notes=recorder)
    Y = [[-found[c][i] if c[0] in MIRRORED else found[c][i] for c in kept] for i in range(n)]
    return equation(
        author,
        recorder,
        "regressor",
        Y,
        source="The forces of one moment of mass at a time, along the joints; Gautier & Khalil 1990",
        notation=NOTATION | {"z": "axis of an inner joint", "y": "velocity of the origin by that joint"},
    )


def forward_dynamics(
    author: Author, geometry: Geometry, bodies: Sequence[Moments], rotors: Sequence[Any]
) -> SymbolicFunction:
    """geometry: with SymPy numbers; bodies, rotors: (n,) base parameters as moments of the links and as rotors."""
    recorder = author.recorder()
    q, qd, tau = (author.coordinates.symbols(name) for name in ("q", "qd", "tau"))
    steps = JointStep.all(geometry, q, recorder)
    wholes = composites(steps, bodies)
    right = [t - b for t, b in zip(tau, bias(geometry, steps, wholes, qd), strict=True)]
    qdd = solve_symmetric(inertia(steps, wholes, rotors), right, recorder)
    return equation(
        author,
        recorder,
        "forward_dynamics",
        qdd,
        source="Composite bodies, Walker & Orin 1982; D = L diag(d) L^T",
        notation=COMPOSITE_NOTATION
        | {
            "al": "angular acceleration at constant rates",
            "a": "acceleration of an origin at constant rates, less gravity",
            "U": "by what the acceleration grows with the place",
            "X, Y": "second moments times w",
            "b": "torque at constant rates",
            "L, d": "D = L diag(d) L^T",
            "Ld": "L diag(d)",
            "e": "1/d",
            "z, x": "substitution",
        },
    )


@dataclass(frozen=True)
class _Motion:
    """At constant rates, in the axes before a joint.

    w, al   angular velocity of the previous link, and its derivative; adding t (0, 0, 1) to w and subtracting t z × w
            from al does not change their field's moment about z
    extra   the z component half way through the joint, minus that of w
    twice   twice the joint's rate
    a       acceleration of the joint's origin, minus gravity
    U       of the previous link
    """

    w: Vector
    al: Vector
    extra: Any
    twice: Any
    a: Vector
    U: Matrix


def bias(geometry: Geometry, steps: Sequence[JointStep], wholes: Sequence[Moments], qd: Sequence[Any]) -> list[Any]:
    """C qd + g, (n,). wholes: the composites at the joints."""
    result: list[Any] = [0] * geometry.n
    motions = _motions(geometry, steps, signed(steps, qd))
    carried: Wrench = (NOWHERE, NOWHERE)
    for i in reversed(range(geometry.n)):
        step, b, m = steps[i], wholes[i], motions[i]
        wrench = step.turned_wrench(carried, "")
        first, own = _at_revolute(step, b, m) if step.link.revolute else _at_prismatic(step, b, m)
        result[i] = step.link.sign * first + step.along(wrench)
        f, n = (
            step.named([f"{name}{e}" for e in "xyz"], added(u, v)) for name, u, v in zip("fn", wrench, own, strict=True)
        )
        carried = step.carried((f, n), "")
    return result


def _motions(geometry: Geometry, steps: Sequence[JointStep], rates: Sequence[Any]) -> list[_Motion]:
    result: list[_Motion] = []
    w, al, a = NOWHERE, NOWHERE, negative(geometry.gravity)
    for group in groups(geometry):
        w, al, a = (steps[group[0]].untwisted(v) for v in (w, al, a))
        start = gradient(steps[group[0]], w, al)
        spin: Any = 0  # rate about z of the previous link relative to the link before the group
        for i in group:
            step, rate, turns = steps[i], rates[i], geometry.links[i].revolute
            now = (w[0], w[1], w[2] + spin)
            U = start if i == group[0] else _spun_gradient(step, start, now)
            a = step.named(("ax", "ay", "az"), added(a, applied(U, step.at)))
            half, twice = step.named(("v", "u"), (rate / 2, 2 * rate))
            if len(group) == 1 and turns:
                tilt = step.named(("tx", "ty", "tz"), _spun(NOWHERE, w, half))
                level = (w[0], w[1], step.notes.let(f"m{i + 1}", w[2] + half))
                result.append(_Motion(level, step.named(("mx", "my", "mz"), added(al, tilt)), 0, twice=twice, a=a, U=U))
            elif turns:
                result.append(_Motion(w, al, spin + half, twice=twice, a=a, U=U))
            else:
                result.append(_Motion(now, al, 0, twice=twice, a=a, U=U))
            a = a if turns else added(a, cross(now, scaled(twice, step.axis)))
            spin = step.notes.let(f"wz{i + 1}", spin + rate) if turns else spin
            if i == group[0]:
                w, al, a = (step.unturned(v, name) for v, name in zip((w, al, a), ("w", "al", "a"), strict=True))
                start = start if len(group) == 1 else gradient(step, w, al)
        al, w = _spun(al, w, spin), (w[0], w[1], w[2] + spin)
    return result


def _spun(al: Vector, w: Vector, spin: Any) -> Vector:
    """Angular acceleration of a link that turns at `spin` about z relative to a link with al and w."""
    return al[0] + spin * w[1], al[1] - spin * w[0], al[2]


def _spun_gradient(step: JointStep, U: Matrix, w: Vector) -> Matrix:
    """U, at w, of a link that turns about z relative to the link with U; its column along z is the same."""
    (_, xy, xz), (yx, _, yz), (_, _, zz) = U
    (twice,) = step.named(("wz",), (2 * w[2],))
    wxx, wyy, wzz = step.named(("wxx", "wyy", "wzz"), [e * e for e in w])
    return (
        (step.notes.let(f"Uxx{step.joint}", -wyy - wzz), xy, xz),
        (yx, step.notes.let(f"Uyy{step.joint}", -wxx - wzz), yz),
        (*step.named(("Uzx", "Uzy"), (twice * w[0] - xz, twice * w[1] - yz)), zz),
    )


def _at_revolute(step: JointStep, b: Moments, m: _Motion) -> tuple[Any, Wrench]:
    """Moment about z in the previous link's field; force and moment in the field that the joint adds."""
    (x, y, z), (hx, hy, _) = m.w, b.first
    X, Y = step.named(("X", "Y"), (b.xx * x + b.xy * y + b.xz * z, b.xy * x + b.yy * y + b.yz * z))
    moment = y * X - x * Y + m.al[2] * b.spin - m.al[0] * b.xz - m.al[1] * b.yz + hx * m.a[1] - hy * m.a[0]
    (t,) = step.named(("t",), (m.twice * (z + m.extra),))
    X, Y = X + b.xz * m.extra, Y + b.yz * m.extra
    return moment, ((-t * hx, -t * hy, m.twice * (x * hx + y * hy)), (m.twice * Y, -m.twice * X, 0))


def _at_prismatic(step: JointStep, b: Moments, m: _Motion) -> tuple[Any, Wrench]:
    field = cross(m.w, scaled(m.twice, step.axis))
    force = added(applied(m.U, b.first), scaled(b.m, m.a))
    return dot(step.axis, force), (scaled(b.m, field), cross(b.first, field))
