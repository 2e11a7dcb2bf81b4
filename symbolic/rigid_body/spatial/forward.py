"""Forward dynamics of a chain in space: D = L diag(d) L^T, and C qd + g from the composites that D has anyway.

Joint j carries a composite. In links 1 .. j − 1 all of it is accelerated as link j − 1 is; this field, linear in the
place, is known from w, its derivative al at constant rates, and the acceleration a of the joint's origin. Beyond it
every joint k >= j adds the field by which link k is accelerated relative to link k − 1,

    [[-u w_z, 0, 0], [0, -u w_z, 0], [u w_x, u w_y, 0]] x,   u = 2 qd_k,   w = w_(k-1) + (0, 0, qd_k / 2)

of its own composite, which takes no acceleration of an origin and passes no moment about its own axis. Forces of these
are carried inwards; of the first field only the moment about z_j is needed. There, too, w may be taken half way
through the joint, so that both share S w.

Source: Walker & Orin 1982 (composite bodies); Uicker 1965 (second moments).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from symbolic.functions import SymbolicFunction
from symbolic.rigid_body.dynamics import solve_symmetric
from symbolic.rigid_body.kinematics import Author
from symbolic.rigid_body.spatial.composites import Step, Wrench, composites, gradient
from symbolic.rigid_body.spatial.geometry import Geometry, Vector
from symbolic.rigid_body.spatial.matrices import NOTATION, inertia, signed
from symbolic.rigid_body.spatial.moments import Moments
from symbolic.rigid_body.spatial.vectors import NOWHERE, added, applied, cross, dot, negative, scaled


def forward_dynamics(
    author: Author, geometry: Geometry, bodies: Sequence[Moments], rotors: Sequence[Any]
) -> SymbolicFunction:
    """`geometry`: in SymPy's numbers; `bodies`, `rotors`: (n,) base parameters as moments of the links and rotors."""
    recorder = author.recorder()
    q, qd, tau = (author.coordinates.symbols(name) for name in ("q", "qd", "tau"))
    steps = Step.all(geometry, q, recorder)
    wholes = composites(steps, bodies)
    right = [t - b for t, b in zip(tau, bias(geometry, steps, wholes, qd), strict=True)]
    qdd = solve_symmetric(inertia(geometry, steps, wholes, rotors), right, recorder)
    return author.function(
        "forward_dynamics",
        ("q", "qd", "tau"),
        ("qdd", qdd, (geometry.n,), author.coordinates.argument("qdd").unit, "joint accelerations"),
        recorder,
        "qdd = D(q)^-1 (tau - C(q, qd) qd - g(q)).",
        "Composite bodies, Walker & Orin 1982; D = L diag(d) L^T",
        NOTATION
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
    """Of the link before a joint, in the axes before the joint, at constant rates; a: of the joint's origin, less
    gravity. middle: w half way through the joint; lean: al there. twice: 2 qd_j."""

    w: Vector
    al: Vector
    a: Vector
    middle: Vector
    lean: Vector
    twice: Any


def bias(geometry: Geometry, steps: Sequence[Step], wholes: Sequence[Moments], qd: Sequence[Any]) -> list[Any]:
    """(n,) C qd + g. `wholes`: the composites at the joints."""
    result: list[Any] = [0] * geometry.n
    motions = _motions(geometry, steps, signed(geometry, qd))
    carried: Wrench = (NOWHERE, NOWHERE)
    for i in reversed(range(geometry.n)):
        link, step, b, m = geometry.links[i], steps[i], wholes[i], motions[i]
        wrench = step.turned_wrench(carried, "")
        first, own = _at_revolute(step, b, m) if link.revolute else _at_prismatic(step, b, m)
        result[i] = link.sign * (first + (wrench[1][2] if link.revolute else wrench[0][2]))
        f, n = (
            step.named([f"{name}{e}" for e in "xyz"], added(u, v)) for name, u, v in zip("fn", wrench, own, strict=True)
        )
        carried = step.carried((f, n), "")
    return result


def _motions(geometry: Geometry, steps: Sequence[Step], rates: Sequence[Any]) -> list[_Motion]:
    result = []
    w, al, a = NOWHERE, NOWHERE, negative(geometry.gravity)
    for link, step, rate in zip(geometry.links, steps, rates, strict=True):
        w, al = step.untwisted(w), step.untwisted(al)
        a = step.named(("ax", "ay", "az"), added(step.untwisted(a), applied(gradient(step, w, al), step.at)))
        half = step.notes.let(f"v{step.joint}_2", rate / 2)
        tilt = step.named(("tx", "ty", "tz"), cross(w, (0, 0, half)))
        lean = step.named(("mx", "my", "mz"), added(al, tilt))
        (middle,) = step.named(("m",), (w[2] + half,))
        twice = step.notes.let(f"u{step.joint}", 2 * rate)
        result.append(_Motion(w, al, a, (w[0], w[1], middle), lean, twice))
        if link.revolute:
            (wz,) = step.named(("wz",), (w[2] + rate,))
            w, al = (w[0], w[1], wz), step.named(("alx", "aly", "alz"), added(lean, tilt))
        else:
            a = added(a, scaled(4, tilt))
        w, al, a = step.unturned(w, "w"), step.unturned(al, "al"), step.unturned(a, "a")
    return result


def _at_revolute(step: Step, b: Moments, m: _Motion) -> tuple[Any, Wrench]:
    """Moment about z in the field of the link before; force and moment in the field that the joint adds."""
    (x, y, z), (hx, hy, _) = m.middle, b.first
    X, Y = step.named(("X", "Y"), (b.xx * x + b.xy * y + b.xz * z, b.xy * x + b.yy * y + b.yz * z))
    whole = step.named(("D",), (b.xx + b.yy,))[0]
    moment = y * X - x * Y + m.al[2] * whole - m.lean[0] * b.xz - m.lean[1] * b.yz + hx * m.a[1] - hy * m.a[0]
    (t,) = step.named(("t",), (m.twice * z,))
    return moment, ((-t * hx, -t * hy, m.twice * (x * hx + y * hy)), (m.twice * Y, -m.twice * X, 0))


def _at_prismatic(step: Step, b: Moments, m: _Motion) -> tuple[Any, Wrench]:
    """Likewise, the force along z."""
    field = cross(m.w, (0, 0, m.twice))
    force = dot(gradient(step, m.w, m.al)[2], b.first) + b.m * m.a[2]
    return force, (scaled(b.m, field), cross(b.first, field))
