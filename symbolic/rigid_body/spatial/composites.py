"""Composite bodies: all that a joint moves, taken as one. D, C, g and the bias of forward dynamics follow from them.

A composite is mass, first and second moments, carried from the tip to the base. At joint j it stands about the origin
of frame j, in axes whose z is that of the joint and which turn with no joint outwards of it: those before its group of
parallel joints if it is the first of them, else the group's. (f, n) are force and moment there. A point x of the
composite is accelerated by a field that is linear in [x, 1]; its force and moment are the field's products with first
and second moments. No linear velocity or acceleration of a frame is needed for

    D        column j   unit rate of joint j: the field z × x
    C        column j   the field (dS_j/dt + S_j V) x = w × (z × x) + z × v_rel, v_rel the velocity in link j's frame

where S_j is the joint's twist and V the velocity of the link in which x lies. C qd + g at once is in forward.py.
Below the diagonal, C_ji = dD_ij/dt − C_ij: what the Christoffel symbols say of their sums.

Source: Walker & Orin 1982 (composite bodies); Echeandia & Wensing 2021 (C by composites); Uicker 1965 (second moments).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from symbolic.rigid_body.spatial.geometry import Geometry
from symbolic.rigid_body.spatial.moments import KINDS, Moments
from symbolic.rigid_body.spatial.recursion import Direction, direction_along, groups
from symbolic.rigid_body.spatial.vectors import NOWHERE, Matrix, Vector, added, cross, scaled
from symbolic.straightline import Notes

Wrench = tuple[Vector, Vector]
"""A force and a moment, or a momentum and its moment."""
STRAIGHT: Direction = (1, 0)


class Composite(NamedTuple):
    """Moments of all that a joint moves, as Moments has them, at the joint, in the axes before it.

    spin   second moment about z, xx + yy: it does not turn
    """

    m: Any
    x: Any
    y: Any
    z: Any
    xx: Any
    yy: Any
    zz: Any
    xy: Any
    xz: Any
    yz: Any
    spin: Any

    @property
    def first(self) -> Vector:
        """First mass moments, (3,) kg m."""
        return self.x, self.y, self.z


@dataclass(frozen=True)
class MomentFlow:
    """The same with a velocity field v in place of one x: the integrals of v, and of v_a x_b by rows."""

    h: Vector
    x: Vector
    y: Vector
    z: Vector

    @classmethod
    def still(cls) -> MomentFlow:
        """Of a body that does not move."""
        return cls(NOWHERE, NOWHERE, NOWHERE, NOWHERE)


@dataclass(frozen=True)
class JointStep:
    """The way from joint j to the link before.

    Links of parallel joints are written along the axes of the last of them (their group): all but the group's first
    step move the origin alone.

    own         cosine and sine of frame j's x axis along the group's axes
    direction   of the group's x axis, along that before the group turns; (1, 0) if the joint is not its group's first
    at          (3,) from the origin before to that of frame j, in the axes before the turn
    axis        (3,) that joint j turns about or slides along, but for the sign, likewise
    twist       of the axes before the turn, in frame j − 1; 0 if the joint is not its group's first
    """

    joint: int
    own: Direction
    direction: Direction
    at: Vector
    axis: Vector
    twist: Direction
    notes: Notes

    @classmethod
    def all(cls, geometry: Geometry, q: Sequence[Any], notes: Notes) -> list[JointStep]:
        """One a joint."""
        steps = []
        for group in groups(geometry):
            for i in group:
                link, (c, s) = geometry.links[i], STRAIGHT
                x, y, lift = link.a, 0, notes.let(f"r{i + 1}", link.reach(q[i]))
                axis: Vector = (0, 0, 1)
                if i == group[0]:
                    c, s = direction_along(geometry, i - 1, group[-1], q, notes)
                else:
                    along = direction_along(geometry, group[-1], i - 1, q, notes)
                    way, axis = notes.let(f"x{i + 1}", link.across(q[i])), link.axis(along)
                    x, y = (notes.let(f"l{e}{i + 1}", way * part) for e, part in zip("cs", along, strict=True))
                own = direction_along(geometry, group[-1], i, q, notes)
                steps.append(cls(i + 1, own, (c, s), (x, y, lift), axis, link.twist.pair, notes))
        return steps

    def named(self, names: Sequence[str], values: Sequence[Any]) -> tuple[Any, ...]:
        """Values under names with the joint's number, as the recursion notes them."""
        return tuple(self.notes.let(f"{name}{self.joint}", value) for name, value in zip(names, values, strict=True))

    def turned(self, v: Vector, name: str) -> Vector:
        """A vector at the joint in the axes before it."""
        return self._turned(v, self.direction, name)

    def _turned(self, v: Vector, direction: Direction, name: str) -> Vector:
        c, s = direction
        x, y = self.named((f"{name}x", f"{name}y"), (c * v[0] - s * v[1], s * v[0] + c * v[1]))
        return x, y, v[2]

    def unturned(self, v: Vector, name: str) -> Vector:
        """A vector in the axes before the joint, in frame j."""
        c, s = self.direction
        x, y = self.named((f"{name}x", f"{name}y"), (c * v[0] + s * v[1], c * v[1] - s * v[0]))
        return x, y, v[2]

    def twisted(self, v: Vector) -> Vector:
        """From the axes before the joint to frame j − 1."""
        c, s = self.twist
        return v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]

    def untwisted(self, v: Vector) -> Vector:
        """From frame j − 1 to the axes before the joint."""
        c, s = self.twist
        return v[0], c * v[1] + s * v[2], c * v[2] - s * v[1]

    def placed(self, point: Vector, name: str) -> Vector:
        """A point of frame j in frame j − 1."""
        return self.twisted(added(self.turned(point, name), self.at))

    def carried(self, wrench: Wrench, name: str) -> Wrench:
        """Force and moment at the joint, in the axes before it, as they act at the origin of frame j − 1."""
        f, n = wrench
        moved = added(n, cross(self.at, f))
        f = self.named([f"f{name}{e}" for e in "xyz"], self.twisted(f))
        n = self.named([f"n{name}{e}" for e in "xyz"], self.twisted(moved))
        return f, n

    def turned_wrench(self, wrench: Wrench, name: str) -> Wrench:
        """Force and moment, (3,) each, in the axes before the joint."""
        return self.turned(wrench[0], f"f{name}"), self.turned(wrench[1], f"n{name}")

    def turned_moments(self, b: Moments) -> Moments:
        """A composite of link j in the axes before the joint."""
        return self._turned_moments(b, self.direction, "")

    def along_group(self, b: Moments) -> Moments:
        """A body of frame j along the axes of its group."""
        return self._turned_moments(b, self.own, "o")

    def _turned_moments(self, b: Moments, direction: Direction, name: str) -> Moments:
        x, y, z = self._turned(b.first, direction, f"{name}h")
        xx, xy, _, yy = self._turned_block(b.xx, b.xy, b.xy, b.yy, direction, name)
        xz, yz, zz = self._turned((b.xz, b.yz, b.zz), direction, f"{name}z")
        return Moments(b.m, x, y, z, xx, yy, zz, xy, xz, yz)

    def carried_moments(self, b: Composite) -> Moments:
        """The body about the origin before, in its axes."""
        rx, ry, rz = self.at
        h = added(b.first, scaled(b.m, self.at))
        xx, yy, zz = b.xx + rx * (b.x + h[0]), b.yy + ry * (b.y + h[1]), b.zz + rz * (b.z + h[2])
        xy, xz, yz = b.xy + rx * b.y + ry * h[0], b.xz + rx * b.z + rz * h[0], b.yz + ry * b.z + rz * h[1]
        c, s = self.twist
        names = ("hx", "hy", "hz", "xx", "yy", "zz", "xy", "xz", "yz")
        yy, yz, _, zz = self._turned_block(yy, yz, yz, zz, self.twist, "t")
        moments = (*self.twisted(h), xx, yy, zz, c * xy - s * xz, s * xy + c * xz, yz)
        return Moments(b.m, *self.named([f"{name}_" for name in names], moments))

    def turned_flow(self, flow: MomentFlow) -> MomentFlow:
        """As turned_moments."""
        h, (zx, zy, zz) = self.turned(flow.h, "kh"), self.turned(flow.z, "kz")
        xx, xy, yx, yy = self._turned_block(*flow.x[:2], *flow.y[:2], self.direction, "k")
        xz, yz, _ = self.turned((flow.x[2], flow.y[2], 0), "kk")
        return MomentFlow(h, (xx, xy, xz), (yx, yy, yz), (zx, zy, zz))

    def carried_flow(self, flow: MomentFlow) -> MomentFlow:
        """As carried_moments: the origin that moves away takes v along."""
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
        """R M R^T of M = [[xx, xy], [yx, yy]] for R by (cos, sin): trace and antisymmetric part stay."""
        c, s = direction
        if 0 in direction:
            return c * c * xx + s * s * yy, c * c * xy - s * s * yx, c * c * yx - s * s * xy, c * c * yy + s * s * xx
        (A,) = self.named((f"{name}A",), (s * (xx - yy) + c * (xy + yx),))
        (B,) = self.named((f"{name}B",), (s * A,))
        names = [f"{name}{e}" for e in ("xx", "xy", "yx", "yy")]
        xx, xy, yx, yy = self.named(names, (xx - B, c * A - yx, c * A - xy, yy + B))
        return xx, xy, yx, yy


def composites(steps: Sequence[JointStep], bodies: Sequence[Moments]) -> list[Composite]:
    """(n,), one a joint. `bodies`: of the links, each in its frame."""
    result: list[Composite] = []
    carried = Moments()
    for step, body in zip(reversed(steps), reversed(bodies), strict=True):
        sums = [own + others for own, others in zip(step.along_group(body), carried, strict=True)]
        whole = Moments(*step.named([f"{name}_c" for name in KINDS], sums))
        (spin,) = step.named(("D",), (whole.xx + whole.yy,))
        result.append(Composite(*step.turned_moments(whole), spin))
        carried = step.carried_moments(result[-1])
    return result[::-1]


def gradient(step: JointStep, w: Vector, al: Vector) -> Matrix:
    """U = al x + w w^T - |w|^2 of a link: its points' accelerations by their places."""
    (x, y, z), (ax, ay, az) = w, al
    names = ("wxy", "wxz", "wyz", "wxx", "wyy", "wzz")
    xy, xz, yz, xx, yy, zz = step.named(names, (x * y, x * z, y * z, x * x, y * y, z * z))
    return (
        step.named(("Uxx", "Uxy", "Uxz"), (-yy - zz, xy - az, xz + ay)),
        step.named(("Uyx", "Uyy", "Uyz"), (xy + az, -xx - zz, yz - ax)),
        step.named(("Uzx", "Uzy", "Uzz"), (xz - ay, yz + ax, -xx - yy)),
    )
