"""Composite bodies of a spatial chain, and D, C and g from them. A composite is everything that one joint moves.

A composite has mass, first and second moments, accumulated from the tip to the base. At joint j it is taken about the
origin of frame j, in axes whose z is that of the joint and which do not turn with any joint further out: those before
its group of parallel joints if it is the first of them, else the group's. (f, n) are force and moment there. The
acceleration of a point x of the composite is linear in [x, 1], so that force and moment are products of that field with
first and second moments. No linear velocity or acceleration of a frame is needed for

    D        column j   unit rate of joint j: the field z × x
    C        column j   the field (dS_j/dt + S_j V) x = w × (z × x) + z × v_rel, v_rel the velocity in link j's frame

where S_j is the joint's twist and V the velocity of the link in which x lies. Below the diagonal, C_ji = dD_ij/dt −
C_ij, which is what the Christoffel symbols require of their sum.

Source: Walker & Orin 1982 (composite bodies); Echeandia & Wensing 2021 (C by composites); Uicker 1965 (second moments).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from symbolic.functions import Author, Continuation, Notes, SymbolicFunction
from symbolic.rigid_body.dynamics import equation
from symbolic.rigid_body.spatial.geometry import NOWHERE, Geometry, LinkFrame, Matrix, Vector, added, cross, dot, scaled
from symbolic.rigid_body.spatial.recursion import KINDS, Direction, Moments, direction_along, groups

Wrench = tuple[Vector, Vector]
"""A force and a moment, or a momentum and its moment."""
STRAIGHT: Direction = (1, 0)


@dataclass(frozen=True)
class MomentFlow:
    """Moments of a velocity field v: the integrals of v, and of v_a x_b by rows."""

    h: Vector
    x: Vector
    y: Vector
    z: Vector


@dataclass(frozen=True)
class JointStep:
    """The step from joint j to the previous link.

    Links of parallel joints (a group) are written along the axes of the last of them, so that only the group's first
    step rotates.

    own         cosine and sine of frame j's x axis along the group's axes
    direction   of the group's x axis relative to that before the group; (1, 0) unless the joint is its group's first
    at          (3,) from the previous origin to that of frame j, in the axes before the rotation
    axis        (3,) joint j's axis without its sign, in the same axes
    link        its twist, of the axes before the rotation, is 0 unless the joint is its group's first
    """

    joint: int
    link: LinkFrame
    own: Direction
    direction: Direction
    at: Vector
    axis: Vector
    notes: Notes

    @classmethod
    def all(cls, geometry: Geometry, q: Sequence[Any], notes: Notes) -> list[JointStep]:
        """The steps of all joints."""
        steps = []
        for group in groups(geometry):
            for i in group:
                link, (c, s) = geometry.links[i], STRAIGHT
                x, y, lift = link.a, 0, notes.let(f"r{i + 1}", link.reach(q[i]))
                axis: Vector = (0, 0, 1)
                if i == group[0]:
                    c, s = direction_along(geometry, i - 1, group[-1], q=q, notes=notes)
                else:
                    along = direction_along(geometry, group[-1], i - 1, q=q, notes=notes)
                    way, axis = notes.let(f"x{i + 1}", link.across(q[i])), link.axis(along)
                    x, y = (notes.let(f"l{e}{i + 1}", way * part) for e, part in zip("cs", along, strict=True))
                own = direction_along(geometry, group[-1], i, q=q, notes=notes)
                steps.append(cls(i + 1, link, own, (c, s), at=(x, y, lift), axis=axis, notes=notes))
        return steps

    def named(self, names: Sequence[str], values: Sequence[Any]) -> tuple[Any, ...]:
        """Note values under names with the joint's number."""
        return tuple(self.notes.let(f"{name}{self.joint}", value) for name, value in zip(names, values, strict=True))

    def turned(self, v: Vector, name: str, direction: Direction | None = None) -> Vector:
        """A vector at the joint in the axes before it, or in axes in which x has another direction."""
        c, s = direction or self.direction
        x, y = self.named((f"{name}x", f"{name}y"), (c * v[0] - s * v[1], s * v[0] + c * v[1]))
        return x, y, v[2]

    def unturned(self, v: Vector, name: str) -> Vector:
        """A vector in the axes before the joint, in frame j."""
        c, s = self.direction
        x, y = self.named((f"{name}x", f"{name}y"), (c * v[0] + s * v[1], c * v[1] - s * v[0]))
        return x, y, v[2]

    def twisted(self, v: Vector) -> Vector:
        """From the axes before the joint to frame j − 1."""
        c, s = self.link.twist.pair
        return v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]

    def untwisted(self, v: Vector) -> Vector:
        """From frame j − 1 to the axes before the joint."""
        c, s = self.link.twist.pair
        return v[0], c * v[1] + s * v[2], c * v[2] - s * v[1]

    def placed(self, point: Vector, name: str) -> Vector:
        """A point of frame j in frame j − 1."""
        return self.twisted(added(self.turned(point, name), self.at))

    def carried(self, wrench: Wrench, name: str) -> Wrench:
        """Force and moment at the joint, in the axes before it, moved to the origin of frame j − 1."""
        f, n = wrench
        moved = added(n, cross(self.at, f))
        f = self.named([f"f{name}{e}" for e in "xyz"], self.twisted(f))
        n = self.named([f"n{name}{e}" for e in "xyz"], self.twisted(moved))
        return f, n

    def along(self, wrench: Wrench) -> Any:
        """The component of a wrench along the joint's axis, with its sign."""
        return self.link.sign * dot(wrench[1] if self.link.revolute else wrench[0], self.axis)

    def turned_wrench(self, wrench: Wrench, name: str) -> Wrench:
        """Force and moment, (3,) each, in the axes before the joint."""
        return self.turned(wrench[0], f"f{name}"), self.turned(wrench[1], f"n{name}")

    def turned_moments(self, b: Moments, direction: Direction, name: str) -> Moments:
        """A body's moments in axes about the same z in which x has this direction."""
        x, y, z = self.turned(b.first, f"{name}h", direction)
        xx, xy, _, yy = self._turned_block(b.xx, b.xy, b.xy, yy=b.yy, direction=direction, name=name)
        xz, yz, zz = self.turned((b.xz, b.yz, b.zz), f"{name}z", direction)
        return Moments(b.m, x, y, z=z, xx=xx, yy=yy, zz=zz, xy=xy, xz=xz, yz=yz)

    def carried_moments(self, b: Moments) -> Moments:
        """The body about the previous origin, in its axes."""
        rx, ry, rz = self.at
        h = added(b.first, scaled(b.m, self.at))
        xx, yy, zz = b.xx + rx * (b.x + h[0]), b.yy + ry * (b.y + h[1]), b.zz + rz * (b.z + h[2])
        xy, xz, yz = b.xy + rx * b.y + ry * h[0], b.xz + rx * b.z + rz * h[0], b.yz + ry * b.z + rz * h[1]
        c, s = self.link.twist.pair
        names = ("hx", "hy", "hz", "xx", "yy", "zz", "xy", "xz", "yz")
        yy, yz, _, zz = self._turned_block(yy, yz, yz, yy=zz, direction=self.link.twist.pair, name="t")
        moments = (*self.twisted(h), xx, yy, zz, c * xy - s * xz, s * xy + c * xz, yz)
        return Moments(b.m, *self.named([f"{name}_" for name in names], moments))

    def turned_flow(self, flow: MomentFlow) -> MomentFlow:
        """As turned_moments, for a flow."""
        h, (zx, zy, zz) = self.turned(flow.h, "kh"), self.turned(flow.z, "kz")
        xx, xy, yx, yy = self._turned_block(*flow.x[:2], *flow.y[:2], self.direction, "k")
        xz, yz, _ = self.turned((flow.x[2], flow.y[2], 0), "kk")
        return MomentFlow(h, (xx, xy, xz), (yx, yy, yz), (zx, zy, zz))

    def carried_flow(self, flow: MomentFlow) -> MomentFlow:
        """As carried_moments, for a flow."""
        h = flow.h
        x, y, z = (added(row, scaled(v, self.at)) for row, v in zip((flow.x, flow.y, flow.z), h, strict=True))
        across = [self.twisted(row) for row in (x, y, z)]
        columns = [self.twisted((u, v, w)) for u, v, w in zip(*across, strict=True)]
        x, y, z = (
            self.named([f"k{row}{column}_" for column in "xyz"], values)
            for row, values in zip("xyz", zip(*columns, strict=True), strict=True)
        )
        return MomentFlow(self.named([f"kh{e}_" for e in "xyz"], self.twisted(h)), x, y, z)

    def _turned_block(
        self, xx: Any, xy: Any, yx: Any, yy: Any, direction: Direction, name: str
    ) -> tuple[Any, Any, Any, Any]:
        """R M R^T of M = [[xx, xy], [yx, yy]], R by (cos, sin); trace and antisymmetric part are invariant."""
        c, s = direction
        if 0 in direction:
            return c * c * xx + s * s * yy, c * c * xy - s * s * yx, c * c * yx - s * s * xy, c * c * yy + s * s * xx
        (A,) = self.named((f"{name}A",), (s * (xx - yy) + c * (xy + yx),))
        (B,) = self.named((f"{name}B",), (s * A,))
        names = [f"{name}{e}" for e in ("xx", "xy", "yx", "yy")]
        xx, xy, yx, yy = self.named(names, (xx - B, c * A - yx, c * A - xy, yy + B))
        return xx, xy, yx, yy


def composites(steps: Sequence[JointStep], bodies: Sequence[Moments]) -> list[Moments]:
    """The composites of all joints, (n,). bodies: of the links, each in its frame."""
    result: list[Moments] = []
    carried = Moments()
    for step, body in zip(reversed(steps), reversed(bodies), strict=True):
        along = step.turned_moments(body, step.own, "o")
        sums = [own + others for own, others in zip(along[:-1], carried[:-1], strict=True)]
        whole = Moments(*step.named([f"{name}_c" for name in KINDS], sums))
        (spin,) = step.named(("D",), (whole.xx + whole.yy,))
        result.append(step.turned_moments(whole, step.direction, "")._replace(spin=spin))
        carried = step.carried_moments(result[-1])
    return result[::-1]


def gradient(step: JointStep, w: Vector, al: Vector) -> Matrix:
    """U = al x + w w^T - |w|^2 of a link: the gradient of its points' accelerations."""
    (x, y, z), (ax, ay, az) = w, al
    names = ("wxy", "wxz", "wyz", "wxx", "wyy", "wzz")
    xy, xz, yz, xx, yy, zz = step.named(names, (x * y, x * z, y * z, x * x, y * y, z * z))
    return (
        step.named(("Uxx", "Uxy", "Uxz"), (-yy - zz, xy - az, xz + ay)),
        step.named(("Uyx", "Uyy", "Uyz"), (xy + az, -xx - zz, yz - ax)),
        step.named(("Uzx", "Uzy", "Uzz"), (xz - ay, yz + ax, -xx - yy)),
    )


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
"""The meaning of names in the generated code."""

Square = list[list[Any]]
"""(n, n), row by row."""


def signed(steps: Sequence[JointStep], rates: Sequence[Any]) -> list[Any]:
    """(n,) rates with the signs of the joints: from the file's directions to those of z, or back."""
    return [step.link.sign * rate for step, rate in zip(steps, rates, strict=True)]


def inertia(steps: Sequence[JointStep], wholes: Sequence[Moments], rotors: Sequence[Any]) -> Square:
    """D (n, n). wholes: the composites at the joints; rotors: (n,) added to the diagonal."""
    D = _along_axes(steps, [_momentum(step, b) for step, b in zip(steps, wholes, strict=True)], "")
    for i, (step, b) in enumerate(zip(steps, wholes, strict=True)):
        D[i][i] = (b.spin if step.link.revolute else b.m) + rotors[i]
        for j in range(i):
            D[i][j] = D[j][i]
    return D


def _momentum(step: JointStep, b: Moments) -> Wrench:
    if step.link.revolute:
        return (-b.y, b.x, 0), (-b.xz, -b.yz, b.spin)
    return _uniform(b, step.axis)


def _along_axes(steps: Sequence[JointStep], columns: Sequence[Wrench], name: str) -> Square:
    """Element (i, j), i <= j: column j, a wrench at joint j, along the axis of joint i; 0 below the diagonal."""
    result: Square = [[0] * len(steps) for _ in steps]
    for j, wrench in enumerate(columns):
        for i in range(j, -1, -1):
            if i < j:
                wrench = steps[i].turned_wrench(wrench, f"{name}{j + 1}_")
            result[i][j] = steps[j].link.sign * steps[i].along(wrench)
            wrench = steps[i].carried(wrench, f"{name}{j + 1}_")
    return result


def gravity(steps: Sequence[JointStep], wholes: Sequence[Moments], pull: Vector) -> list[Any]:
    """g (n,) = dV/dq, with V = −pull · (first moment of the composites). pull: gravity in frame 0."""
    result = []
    for step, b in zip(steps, wholes, strict=True):
        (x, y, z), link = step.untwisted(pull), step.link
        result.append(link.sign * (b.y * x - b.x * y if link.revolute else -b.m * dot(step.axis, (x, y, z))))
        pull = step.unturned((x, y, z), "g")
    return result


def turning(steps: Sequence[JointStep], rates: Sequence[Any]) -> list[Vector]:
    """(n,) absolute angular velocities of link j − 1 in the axes before joint j."""
    result: list[Vector] = []
    w: Vector = NOWHERE
    for step, rate in zip(steps, rates, strict=True):
        w = step.untwisted(w)
        result.append(w)
        if step.link.revolute:
            (wz,) = step.named(("wz",), (w[2] + rate,))
            w = (w[0], w[1], wz)
        w = step.unturned(w, "w")
    return result


def _uniform(b: Moments, a: Vector) -> Wrench:
    return scaled(b.m, a), cross(b.first, a)


def coriolis(steps: Sequence[JointStep], wholes: Sequence[Moments], qd: Sequence[Any]) -> Square:
    """C (n, n) from Christoffel symbols."""
    rates = signed(steps, qd)
    flows: list[MomentFlow] = []  # of the composites relative to their first link, at the joints
    carried = MomentFlow(NOWHERE, NOWHERE, NOWHERE, NOWHERE)
    for step, b, rate in zip(reversed(steps), reversed(wholes), reversed(rates), strict=True):
        flows.insert(0, step.turned_flow(carried))
        carried = step.carried_flow(_with_joint(step, b, flows[0], rate))
    joints = list(zip(steps, wholes, flows, turning(steps, rates), rates, strict=True))
    C = _along_axes(steps, [_field(*joint) for joint in joints], "c")
    rate_of_D = _rates_along_axes(steps, wholes, flows, rates)
    for i in range(len(steps)):
        for j in range(i):
            C[i][j] = rate_of_D[j][i] - C[j][i]
    return C


def _with_joint(step: JointStep, b: Moments, flow: MomentFlow, rate: Any) -> MomentFlow:
    """The flow relative to the link before the joint."""
    (hx, hy, hz), x, y, z = flow.h, flow.x, flow.y, flow.z
    if not step.link.revolute:
        v = scaled(rate, step.axis)
        x, y, z = (added(row, scaled(e, b.first)) for row, e in zip((x, y, z), v, strict=True))
        return MomentFlow(added(flow.h, scaled(b.m, v)), x, y, z)
    x = (x[0] - rate * b.xy, x[1] - rate * b.yy, x[2] - rate * b.yz)
    y = (y[0] + rate * b.xx, y[1] + rate * b.xy, y[2] + rate * b.xz)
    x = step.named(("kxx", "kxy", "kxz"), x)
    y = step.named(("kyx", "kyy", "kyz"), y)
    h = step.named(("khx", "khy"), (hx - rate * b.y, hy + rate * b.x))
    return MomentFlow((h[0], h[1], hz), x, y, z)


def _field(step: JointStep, b: Moments, k: MomentFlow, w: Vector, rate: Any) -> Wrench:
    """Force and moment in the field (dS/dt + S V) x of a joint: w × (z × x) + z × v, or w × axis; w of its link."""
    if not step.link.revolute:
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
    steps: Sequence[JointStep], wholes: Sequence[Moments], flows: Sequence[MomentFlow], rates: Sequence[Any]
) -> Square:
    """dD/dt above the diagonal: momenta carried inwards with their rates."""
    result: Square = [[0] * len(steps) for _ in steps]
    for j, (moved, b, k) in enumerate(zip(steps, wholes, flows, strict=True)):
        now, rate = _momentum(moved, b), (NOWHERE, cross(k.h, moved.axis))
        if moved.link.revolute:
            rate = (-k.h[1], k.h[0], 0), (-k.x[2] - k.z[0], -k.y[2] - k.z[1], 2 * (k.x[0] + k.y[1]))
        for i in range(j, -1, -1):
            step = steps[i]
            if i < j:
                now, rate = step.turned_wrench(now, f"{j + 1}_"), step.turned_wrench(rate, f"d{j + 1}_")
                result[i][j] = moved.link.sign * step.along(rate)
            # The rate in the axes before the joint, from the rate in those after it.
            v, (f, n), (df, dn) = rates[i], now, rate
            if step.link.revolute:
                df, dn = (df[0] - v * f[1], df[1] + v * f[0], df[2]), (dn[0] - v * n[1], dn[1] + v * n[0], dn[2])
            else:
                dn = added(dn, cross(scaled(v, step.axis), f))
            rate = df, dn
            now, rate = step.carried(now, f"{j + 1}_"), step.carried(rate, f"d{j + 1}_")
    return result


def functions(
    author: Author, geometry: Geometry, bodies: Sequence[Moments], rotors: Sequence[Any], own: Sequence[Any]
) -> list[SymbolicFunction]:
    """inertia, link_inertia, coriolis, gravity.

    geometry   with SymPy numbers     bodies   (n,) base parameters as moments of the links
    rotors     (n,) base parameters that are rotors     own   (n,) the rotors' inertias
    """
    recorder, n = author.recorder(), geometry.n
    q, qd = author.coordinates.symbols("q"), author.coordinates.symbols("qd")
    steps = JointStep.all(geometry, q, recorder)
    wholes = composites(steps, bodies)
    D = inertia(steps, wholes, rotors)
    whole = [recorder.symbol(f"whole{i + 1}", D[i][i]) for i in range(n)]
    links = [[whole[i] - own[i] if i == j else e for j, e in enumerate(row)] for i, row in enumerate(D)]
    C = coriolis(steps, wholes, qd)
    made = partial(equation, author, recorder, notation=COMPOSITE_NOTATION)
    return [
        made("inertia", D, source="Composite bodies; Walker & Orin 1982"),
        made(
            "link_inertia",
            links,
            source="Composite bodies; the model file's rotor inertias",
            notation=COMPOSITE_NOTATION | {"whole": "inertia at a joint, its rotor included"},
            continues=Continuation("inertia", tuple((symbol, (n + 1) * i) for i, symbol in enumerate(whole))),
        ),
        made("coriolis", C, source="Composite bodies; Echeandia & Wensing 2021"),
        made("gravity", gravity(steps, wholes, geometry.gravity), source="Composite bodies hang on their joints"),
    ]
