"""D, C, g, the bias C qd + g and forward dynamics of a chain in space, from its composites."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from symbolic.functions import Author, Continuation, SymbolicFunction, output
from symbolic.rigid_body.spatial.composites import Composite, JointStep, MomentFlow, Wrench, composites
from symbolic.rigid_body.spatial.geometry import Geometry, LinkFrame
from symbolic.rigid_body.spatial.moments import Moments
from symbolic.rigid_body.spatial.vectors import NOWHERE, Vector, added, cross, dot, scaled

COMPOSITE_NOTATION = {
    "c, s": "cosine and sine",
    "r": "way along the axis of a joint",
    "xx, yy, zz, xy, xz, yz, hx, hy, hz": "second and first moments of all that a joint moves; _c about its link's "
    "origin, _ about that of the link before",
    "A, B": "what turns them",
    "f, n": "force and moment, or momentum and its moment",
    "D": "inertia that a joint sees",
    "k, kh": "moments of the velocities relative to the link that a joint moves",
    "w": "angular velocity",
    "g": "gravity",
}
"""What these functions call their values, for whoever reads the generated code."""

Square = list[list[Any]]
"""(n, n), row by row."""


def signed(geometry: Geometry, rates: Sequence[Any]) -> list[Any]:
    """(n,) of the joints in the file's direction -> along z of their frames, or back."""
    return [link.sign * rate for link, rate in zip(geometry.links, rates, strict=True)]


def inertia(
    geometry: Geometry, steps: Sequence[JointStep], wholes: Sequence[Composite], rotors: Sequence[Any]
) -> Square:
    """D (n, n). `wholes`: the composites at the joints; `rotors`: (n,) added on the diagonal."""
    columns = [_momentum(*joint) for joint in zip(geometry.links, steps, wholes, strict=True)]
    D = _along_axes(geometry, steps, columns, "")
    for i, link in enumerate(geometry.links):
        D[i][i] = (wholes[i].spin if link.revolute else wholes[i].m) + rotors[i]
        for j in range(i):
            D[i][j] = D[j][i]
    return D


def _momentum(link: LinkFrame, step: JointStep, b: Composite) -> Wrench:
    """Momentum and its moment at unit rate of the joint."""
    if link.revolute:
        return (-b.y, b.x, 0), (-b.xz, -b.yz, b.spin)
    return _uniform(b, step.axis)


def _along_axes(geometry: Geometry, steps: Sequence[JointStep], columns: Sequence[Wrench], name: str) -> Square:
    """Element (i, j), i <= j: what column j, a wrench at joint j, is along the axis of joint i. Below: 0."""
    n = geometry.n
    result: Square = [[0] * n for _ in range(n)]
    for j, column in enumerate(columns):
        wrench = column
        for i in range(j, -1, -1):
            if i < j:
                wrench = steps[i].turned_wrench(wrench, f"{name}{j + 1}_")
            links = geometry.links
            result[i][j] = links[i].sign * links[j].sign * _along(links[i], steps[i], wrench)
            wrench = steps[i].carried(wrench, f"{name}{j + 1}_")
    return result


def _along(link: LinkFrame, step: JointStep, wrench: Wrench) -> Any:
    """What a joint feels of a wrench."""
    return dot(wrench[1] if link.revolute else wrench[0], step.axis)


def gravity(geometry: Geometry, steps: Sequence[JointStep], wholes: Sequence[Composite]) -> list[Any]:
    """g (n,) = dV/dq, V = −gravity · (first moment): the composites hang on their joints."""
    result, pull = [], geometry.gravity
    for link, step, b in zip(geometry.links, steps, wholes, strict=True):
        x, y, z = step.untwisted(pull)
        result.append(link.sign * (b.y * x - b.x * y if link.revolute else -b.m * dot(step.axis, (x, y, z))))
        pull = step.unturned((x, y, z), "g")
    return result


def turning(geometry: Geometry, steps: Sequence[JointStep], rates: Sequence[Any]) -> list[Vector]:
    """(n,) absolute angular velocity of link j − 1 in the axes before joint j."""
    result: list[Vector] = []
    w: Vector = NOWHERE
    for link, step, rate in zip(geometry.links, steps, rates, strict=True):
        w = step.untwisted(w)
        result.append(w)
        if link.revolute:
            (wz,) = step.named(("wz",), (w[2] + rate,))
            w = (w[0], w[1], wz)
        w = step.unturned(w, "w")
    return result


def _uniform(b: Composite, a: Vector) -> Wrench:
    """Force and moment of a body whose points are all accelerated alike."""
    return scaled(b.m, a), cross(b.first, a)


def coriolis(geometry: Geometry, steps: Sequence[JointStep], wholes: Sequence[Composite], qd: Sequence[Any]) -> Square:
    """C (n, n) from Christoffel symbols."""
    rates = signed(geometry, qd)
    flows, turns = _flows(geometry, steps, wholes, rates), turning(geometry, steps, rates)
    joints = list(zip(geometry.links, steps, wholes, flows, turns, rates, strict=True))
    C = _along_axes(geometry, steps, [_field(*joint) for joint in joints], "c")
    rate_of_D = _rates_along_axes(geometry, steps, joints, rates)
    for i in range(geometry.n):
        for j in range(i):
            C[i][j] = rate_of_D[j][i] - C[j][i]
    return C


def _flows(
    geometry: Geometry, steps: Sequence[JointStep], wholes: Sequence[Composite], rates: Sequence[Any]
) -> list[MomentFlow]:
    """(n,) the composites' motion relative to their first link, at the joints."""
    result: list[MomentFlow] = []
    carried = MomentFlow.still()
    for link, step, b, rate in zip(
        reversed(geometry.links), reversed(steps), reversed(wholes), reversed(rates), strict=True
    ):
        flow = step.turned_flow(carried)
        result.append(flow)
        carried = step.carried_flow(_with_joint(link, step, b, flow, rate))
    return result[::-1]


def _with_joint(link: LinkFrame, step: JointStep, b: Composite, flow: MomentFlow, rate: Any) -> MomentFlow:
    """Relative to the link before the joint."""
    (hx, hy, hz), x, y, z = flow.h, flow.x, flow.y, flow.z
    if not link.revolute:
        v = scaled(rate, step.axis)
        x, y, z = (added(row, scaled(e, b.first)) for row, e in zip((x, y, z), v, strict=True))
        return MomentFlow(added(flow.h, scaled(b.m, v)), x, y, z)
    x = (x[0] - rate * b.xy, x[1] - rate * b.yy, x[2] - rate * b.yz)
    y = (y[0] + rate * b.xx, y[1] + rate * b.xy, y[2] + rate * b.xz)
    x = step.named(("kxx", "kxy", "kxz"), x)
    y = step.named(("kyx", "kyy", "kyz"), y)
    h = step.named(("khx", "khy"), (hx - rate * b.y, hy + rate * b.x))
    return MomentFlow((h[0], h[1], hz), x, y, z)


def _field(link: LinkFrame, step: JointStep, b: Composite, k: MomentFlow, w: Vector, rate: Any) -> Wrench:
    """Force and moment in the field (dS/dt + S V) x of a joint: w × (z × x) + z × v, or w × axis; w of the link
    moved."""
    if not link.revolute:
        return _uniform(b, cross(w, step.axis))
    wx, wy, wz = w[0], w[1], w[2] + rate
    f = (-wz * b.x - k.h[1], -wz * b.y + k.h[0], wx * b.x + wy * b.y)
    n = (
        wx * b.xy + wy * b.yy + wz * b.yz - k.x[2],
        -wz * b.xz - k.y[2] - wx * b.xx - wy * b.xy,
        k.x[0] + k.y[1],
    )
    return f, n


def _rates_along_axes(
    geometry: Geometry, steps: Sequence[JointStep], joints: Sequence[Any], rates: Sequence[Any]
) -> Square:
    """dD/dt above the diagonal: momenta carried inwards with their rates, which a turning joint turns along."""
    n = geometry.n
    result: Square = [[0] * n for _ in range(n)]
    for j, (link, at, b, k, _, _) in enumerate(joints):
        now, rate = _momentum(link, at, b), _momentum_rate(link, at, k)
        for i in range(j, -1, -1):
            step, own = steps[i], geometry.links[i]
            if i < j:
                now, rate = step.turned_wrench(now, f"{j + 1}_"), step.turned_wrench(rate, f"d{j + 1}_")
                result[i][j] = own.sign * link.sign * _along(own, step, rate)
            rate = _seen_from_before(own, step, now, rate, rates[i])
            now, rate = step.carried(now, f"{j + 1}_"), step.carried(rate, f"d{j + 1}_")
    return result


def _momentum_rate(link: LinkFrame, step: JointStep, k: MomentFlow) -> Wrench:
    """Rate of _momentum in the axes of the link that the joint moves."""
    if link.revolute:
        return (-k.h[1], k.h[0], 0), (-k.x[2] - k.z[0], -k.y[2] - k.z[1], 2 * (k.x[0] + k.y[1]))
    return NOWHERE, cross(k.h, step.axis)


def _seen_from_before(link: LinkFrame, step: JointStep, now: Wrench, rate: Wrench, joint_rate: Any) -> Wrench:
    """The rate of a wrench in the axes before a joint: turned along, or carried along axis × f."""
    (fx, fy, _), (nx, ny, _) = now
    (ax, ay, az), (bx, by, bz) = rate
    v = joint_rate
    if not link.revolute:
        return rate[0], added(rate[1], cross(scaled(v, step.axis), now[0]))
    return (ax - v * fy, ay + v * fx, az), (bx - v * ny, by + v * nx, bz)


def functions(
    author: Author, geometry: Geometry, bodies: Sequence[Moments], rotors: Sequence[Any], own: Sequence[Any]
) -> list[SymbolicFunction]:
    """inertia, link_inertia, coriolis, gravity. `geometry`: in SymPy's numbers; `bodies`: (n,) base parameters as
    moments of the links; `rotors`: (n,) that are base parameters of their own; `own`: (n,) the rotors' inertias."""
    recorder, n, force = author.recorder(), geometry.n, author.coordinates.force
    q, qd = author.coordinates.symbols("q"), author.coordinates.symbols("qd")
    steps = JointStep.all(geometry, q, recorder)
    wholes = composites(steps, bodies)
    D = inertia(geometry, steps, wholes, rotors)
    whole = [recorder.symbol(f"whole{i + 1}", D[i][i]) for i in range(n)]
    links = [[whole[i] - own[i] if i == j else e for j, e in enumerate(row)] for i, row in enumerate(D)]
    C = coriolis(geometry, steps, wholes, qd)
    mixed = " or " in force
    unit = "kg m^2, kg m or kg" if mixed else author.coordinates.unit("kg m^2", "kg")
    rate = "per entry: torque by rate" if mixed else author.coordinates.unit("kg m^2/s", "kg/s")
    return [
        author.function(
            "inertia",
            ("q",),
            output("D", _flat(D), (n, n), unit=unit, meaning="inertia matrix, symmetric and positive definite"),
            recorder,
            doc="Inertia matrix D(q), rotors included.",
            source="Composite bodies; Walker & Orin 1982",
            notation=COMPOSITE_NOTATION,
        ),
        author.function(
            "link_inertia",
            ("q",),
            output("D", _flat(links), (n, n), unit=unit, meaning="inertia matrix without the rotors"),
            recorder,
            doc="Inertia of the links as the joints see it: D(q) less the rotors.",
            source="Composite bodies; the model file's rotor inertias",
            notation=COMPOSITE_NOTATION | {"whole": "inertia at a joint, its rotor included"},
            continues=Continuation("inertia", tuple((symbol, (n + 1) * i) for i, symbol in enumerate(whole))),
        ),
        author.function(
            "coriolis",
            ("q", "qd"),
            output("C", _flat(C), (n, n), unit=rate, meaning="Coriolis matrix; dD/dt - 2 C is skew-symmetric"),
            recorder,
            doc="Coriolis and centrifugal matrix C(q, qd) from Christoffel symbols.",
            source="Composite bodies; Echeandia & Wensing 2021",
            notation=COMPOSITE_NOTATION,
        ),
        author.function(
            "gravity",
            ("q",),
            output("g", gravity(geometry, steps, wholes), (n,), unit=force, meaning="gravity torques"),
            recorder,
            doc="Gravity torques g(q) = dV/dq; zero where the model file has no gravity.",
            source="Composite bodies hang on their joints",
            notation=COMPOSITE_NOTATION,
        ),
    ]


def _flat(rows: Square) -> list[Any]:
    return [e for row in rows for e in row]
