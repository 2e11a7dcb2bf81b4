"""D, C, g, the bias C qd + g and forward dynamics of a chain in space, from its composites."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from symbolic.rigid_body.spatial.composites import NOWHERE, Flow, Moments, Step, Wrench
from symbolic.rigid_body.spatial.geometry import Geometry, Vector

Square = list[list[Any]]
"""(n, n), row by row."""


def signed(geometry: Geometry, rates: Sequence[Any]) -> list[Any]:
    """(n,) of the joints in the file's direction -> along z of their frames, or back."""
    return [link.sign * rate for link, rate in zip(geometry.links, rates, strict=True)]


def inertia(geometry: Geometry, steps: Sequence[Step], wholes: Sequence[Moments], rotors: Sequence[Any]) -> Square:
    """D (n, n). `wholes`: the composites at the joints; `rotors`: (n,) added on the diagonal."""
    columns = [_momentum(link.revolute, b) for link, b in zip(geometry.links, wholes, strict=True)]
    D = _along_axes(geometry, steps, columns, "")
    for i, link in enumerate(geometry.links):
        own = steps[i].named(("D",), (wholes[i].xx + wholes[i].yy if link.revolute else wholes[i].m,))[0]
        D[i][i] = own + rotors[i]
        for j in range(i):
            D[i][j] = D[j][i]
    return D


def _momentum(revolute: bool, b: Moments) -> Wrench:
    """Momentum and its moment at unit rate of the joint."""
    if revolute:
        return (-b.y, b.x, 0), (-b.xz, -b.yz, b.xx + b.yy)
    return (0, 0, b.m), (b.y, -b.x, 0)


def _along_axes(geometry: Geometry, steps: Sequence[Step], columns: Sequence[Wrench], name: str) -> Square:
    """Element (i, j), i <= j: what column j, a wrench at joint j, is along the axis of joint i. Below: 0."""
    n = geometry.n
    result: Square = [[0] * n for _ in range(n)]
    for j, column in enumerate(columns):
        wrench = column
        for i in range(j, -1, -1):
            if i < j:
                wrench = steps[i].turned_wrench(wrench, f"{name}{j + 1}_")
            links = geometry.links
            result[i][j] = links[i].sign * links[j].sign * _along(links[i].revolute, wrench)
            wrench = steps[i].carried(wrench, f"{name}{j + 1}_")
    return result


def _along(revolute: bool, wrench: Wrench) -> Any:
    """What a joint feels of a wrench."""
    return wrench[1][2] if revolute else wrench[0][2]


def gravity(geometry: Geometry, steps: Sequence[Step], wholes: Sequence[Moments]) -> list[Any]:
    """g (n,) = dV/dq, V = −gravity · (first moment): the composites hang on their joints."""
    result, pull = [], geometry.gravity
    for link, step, b in zip(geometry.links, steps, wholes, strict=True):
        x, y, z = step.untwisted(pull)
        result.append(link.sign * (b.y * x - b.x * y if link.revolute else -b.m * z))
        pull = step.unturned((x, y, z), "g")
    return result


def turning(geometry: Geometry, steps: Sequence[Step], rates: Sequence[Any]) -> list[Vector]:
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


def bias(geometry: Geometry, steps: Sequence[Step], wholes: Sequence[Moments], qd: Sequence[Any]) -> list[Any]:
    """(n,) C qd + g: forces of the composites in the acceleration of their first link relative to the link before."""
    rates = signed(geometry, qd)
    turns, hanging = turning(geometry, steps, rates), gravity(geometry, steps, wholes)
    result = list(hanging)
    wrench: Wrench = (NOWHERE, NOWHERE)
    for i in reversed(range(geometry.n)):
        link, step = geometry.links[i], steps[i]
        if i < geometry.n - 1:
            wrench = step.turned_wrench(wrench, "")
        own = _relative(link.revolute, step, wholes[i], turns[i], rates[i])
        f, n = (
            step.named([f"{name}{e}" for e in "xyz"], [u + v for u, v in zip(a, b, strict=True)])
            for name, a, b in zip("fn", wrench, own, strict=True)
        )
        result[i] = link.sign * _along(link.revolute, (f, n)) + hanging[i]
        wrench = step.carried((f, n), "")
    return result


def _relative(revolute: bool, step: Step, b: Moments, w: Vector, rate: Any) -> Wrench:
    """Force and moment of a composite in the field by which its first link is accelerated at constant rates.

    Revolute: [[-s, 0, 0], [0, -s, 0], [p, r, 0]] x, s = rate (2 w_z + rate), p = 2 rate w_x, r = 2 rate w_y.
    Prismatic: 2 rate w × z for all x.
    """
    (twice,) = step.named(("u",), (2 * rate,))
    p, r = step.named(("p", "r"), (twice * w[0], twice * w[1]))
    if not revolute:
        return _uniform(b, (r, -p, 0))
    (s,) = step.named(("s",), (rate * (2 * w[2] + rate),))
    f = (-s * b.x, -s * b.y, p * b.x + r * b.y)
    return f, (p * b.xy + r * b.yy + s * b.yz, -s * b.xz - p * b.xx - r * b.xy, 0)


def _uniform(b: Moments, a: Vector) -> Wrench:
    """Force and moment of a body whose points are all accelerated alike."""
    n = (b.y * a[2] - b.z * a[1], b.z * a[0] - b.x * a[2], b.x * a[1] - b.y * a[0])
    return (b.m * a[0], b.m * a[1], b.m * a[2]), n


def coriolis(geometry: Geometry, steps: Sequence[Step], wholes: Sequence[Moments], qd: Sequence[Any]) -> Square:
    """C (n, n) from Christoffel symbols."""
    rates = signed(geometry, qd)
    flows, turns = _flows(geometry, steps, wholes, rates), turning(geometry, steps, rates)
    joints = list(zip(geometry.links, wholes, flows, turns, rates, strict=True))
    C = _along_axes(geometry, steps, [_field(link.revolute, *rest) for link, *rest in joints], "c")
    rate_of_D = _rates_along_axes(geometry, steps, joints, rates)
    for i in range(geometry.n):
        for j in range(i):
            C[i][j] = rate_of_D[j][i] - C[j][i]
    return C


def _flows(geometry: Geometry, steps: Sequence[Step], wholes: Sequence[Moments], rates: Sequence[Any]) -> list[Flow]:
    """(n,) the composites' motion relative to their first link, at the joints."""
    result: list[Flow] = []
    carried = Flow.still()
    for link, step, b, rate in zip(
        reversed(geometry.links), reversed(steps), reversed(wholes), reversed(rates), strict=True
    ):
        flow = step.turned_flow(carried)
        result.append(flow)
        carried = step.carried_flow(_with_joint(link.revolute, step, b, flow, rate))
    return result[::-1]


def _with_joint(revolute: bool, step: Step, b: Moments, flow: Flow, rate: Any) -> Flow:
    """Relative to the link before the joint."""
    (hx, hy, hz), x, y, z = flow.h, flow.x, flow.y, flow.z
    if not revolute:
        z = (z[0] + rate * b.x, z[1] + rate * b.y, z[2] + rate * b.z)
        return Flow((hx, hy, hz + rate * b.m), x, y, z)
    x = (x[0] - rate * b.xy, x[1] - rate * b.yy, x[2] - rate * b.yz)
    y = (y[0] + rate * b.xx, y[1] + rate * b.xy, y[2] + rate * b.xz)
    x = step.named(("kxx", "kxy", "kxz"), x)
    y = step.named(("kyx", "kyy", "kyz"), y)
    h = step.named(("khx", "khy"), (hx - rate * b.y, hy + rate * b.x))
    return Flow((h[0], h[1], hz), x, y, z)


def _field(revolute: bool, b: Moments, k: Flow, w: Vector, rate: Any) -> Wrench:
    """Force and moment in the field (dS/dt + S V) x of a joint: w × (z × x) + z × v, or w × z; w of the link moved."""
    if not revolute:
        return _uniform(b, (w[1], -w[0], 0))
    wx, wy, wz = w[0], w[1], w[2] + rate
    f = (-wz * b.x - k.h[1], -wz * b.y + k.h[0], wx * b.x + wy * b.y)
    n = (
        wx * b.xy + wy * b.yy + wz * b.yz - k.x[2],
        -wz * b.xz - k.y[2] - wx * b.xx - wy * b.xy,
        k.x[0] + k.y[1],
    )
    return f, n


def _rates_along_axes(geometry: Geometry, steps: Sequence[Step], joints: Sequence[Any], rates: Sequence[Any]) -> Square:
    """dD/dt above the diagonal: momenta carried inwards with their rates, which a turning joint turns along."""
    n = geometry.n
    result: Square = [[0] * n for _ in range(n)]
    for j, (link, b, k, _, _) in enumerate(joints):
        now, rate = _momentum(link.revolute, b), _momentum_rate(link.revolute, k)
        for i in range(j, -1, -1):
            step, own = steps[i], geometry.links[i]
            if i < j:
                now, rate = step.turned_wrench(now, f"{j + 1}_"), step.turned_wrench(rate, f"d{j + 1}_")
                result[i][j] = own.sign * link.sign * _along(own.revolute, rate)
            rate = _seen_from_before(own.revolute, now, rate, rates[i])
            now, rate = step.carried(now, f"{j + 1}_"), step.carried(rate, f"d{j + 1}_")
    return result


def _momentum_rate(revolute: bool, k: Flow) -> Wrench:
    """Rate of _momentum in the axes of the link that the joint moves."""
    if revolute:
        return (-k.h[1], k.h[0], 0), (-k.x[2] - k.z[0], -k.y[2] - k.z[1], 2 * (k.x[0] + k.y[1]))
    return (0, 0, 0), (k.h[1], -k.h[0], 0)


def _seen_from_before(revolute: bool, now: Wrench, rate: Wrench, joint_rate: Any) -> Wrench:
    """The rate of a wrench in the axes before a joint: turned along, or carried along z × f."""
    (fx, fy, _), (nx, ny, _) = now
    (ax, ay, az), (bx, by, bz) = rate
    v = joint_rate
    if not revolute:
        return rate[0], (bx - v * fy, by + v * fx, bz)
    return (ax - v * fy, ay + v * fx, az), (bx - v * ny, by + v * nx, bz)
