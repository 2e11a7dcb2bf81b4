"""Composite bodies: all that a joint moves, taken as one. D, C, g and the bias of forward dynamics follow from them.

A composite is mass, first and second moments, carried from the tip to the base. At joint j it stands about the origin
of frame j, in the axes that frame j − 1 has after its twist: a joint turns about z of these, or slides along it, and
(f, n) below are force and moment there. Point x of the composite is accelerated by a field that is linear in [x, 1];
its force and moment are the field's products with first and second moments. No linear velocity and no linear
acceleration of a frame is ever needed:

    D        column j   unit rate of joint j, the field z × x
    C        column j   the field (dS_j/dt + S_j V) x = w × (z × x) + z × v_rel, v_rel the velocity in link j's frame
    C qd     joint j    acceleration of link j relative to link j − 1, qd_j times the field 2 w' × (z × x) + ...

Below the diagonal, C_ji = dD_ij/dt − C_ij: what the Christoffel symbols say of their sums.

Source: Walker & Orin 1982 (composite bodies); Echeandia & Wensing 2021 (C by composites); Uicker 1965 (second moments).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from symbolic.rigid_body.spatial.geometry import Geometry, Vector
from symbolic.rigid_body.spatial.vectors import NOWHERE, added
from symbolic.straightline import Notes

Wrench = tuple[Vector, Vector]
"""A force and a moment, or a momentum and its moment."""


@dataclass(frozen=True)
class Moments:
    """Mass, first and second moments of a body about a frame's origin: the integrals of 1, x, x x^T over its mass."""

    m: Any = 0
    x: Any = 0
    y: Any = 0
    z: Any = 0
    xx: Any = 0
    yy: Any = 0
    zz: Any = 0
    xy: Any = 0
    xz: Any = 0
    yz: Any = 0

    @property
    def first(self) -> Vector:
        return self.x, self.y, self.z


@dataclass(frozen=True)
class Flow:
    """The same with a velocity field v in place of one x: the integrals of v, and of v_a x_b by rows."""

    h: Vector
    x: Vector
    y: Vector
    z: Vector

    @classmethod
    def still(cls) -> Flow:
        return cls(NOWHERE, NOWHERE, NOWHERE, NOWHERE)


@dataclass(frozen=True)
class Step:
    """The way from frame j to frame j − 1: cosine and sine of theta_j and of the twist, and the origin's place."""

    joint: int
    direction: tuple[Any, Any]
    twist: tuple[Any, Any]
    a: Any
    d: Any
    notes: Notes

    @classmethod
    def all(cls, geometry: Geometry, q: Sequence[Any], notes: Notes) -> list[Step]:
        """One a joint."""
        return [
            cls(j, link.direction(x, notes), link.twist.pair, link.a, notes.let(f"r{j}", link.reach(x)), notes)
            for j, (link, x) in enumerate(zip(geometry.links, q, strict=True), 1)
        ]

    def named(self, names: Sequence[str], values: Sequence[Any]) -> tuple[Any, ...]:
        return tuple(self.notes.let(f"{name}{self.joint}", value) for name, value in zip(names, values, strict=True))

    def turned(self, v: Vector, name: str) -> Vector:
        """A vector of frame j in the axes before the joint."""
        c, s = self.direction
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
        return self.twisted(added(self.turned(point, name), (self.a, 0, self.d)))

    def carried(self, wrench: Wrench, name: str) -> Wrench:
        """Force and moment at the joint, in the axes before it, as they act at the origin of frame j − 1."""
        f, n = wrench
        moved = (n[0] - self.d * f[1], n[1] + self.d * f[0] - self.a * f[2], n[2] + self.a * f[1])
        f = self.named([f"f{name}{e}" for e in "xyz"], self.twisted(f))
        n = self.named([f"n{name}{e}" for e in "xyz"], self.twisted(moved))
        return f, n

    def turned_wrench(self, wrench: Wrench, name: str) -> Wrench:
        return self.turned(wrench[0], f"f{name}"), self.turned(wrench[1], f"n{name}")

    def turned_moments(self, b: Moments) -> Moments:
        """A body of frame j in the axes before the joint."""
        x, y, z = self.turned(b.first, "h")
        xx, xy, _, yy = self._turned_block(b.xx, b.xy, b.xy, b.yy, self.direction, "")
        xz, yz, zz = self.turned((b.xz, b.yz, b.zz), "z")
        return Moments(b.m, x, y, z, xx, yy, zz, xy, xz, yz)

    def carried_moments(self, b: Moments) -> Moments:
        """The body about the origin of frame j − 1, in its axes."""
        h = [b.x + b.m * self.a, b.y, b.z + b.m * self.d]
        xx, zz = b.xx + self.a * (b.x + h[0]), b.zz + self.d * (b.z + h[2])
        xy, yz = b.xy + self.a * b.y, b.yz + self.d * b.y
        xz = b.xz + self.a * b.z + self.d * h[0]
        c, s = self.twist
        names = ("hx", "hy", "hz", "xx", "yy", "zz", "xy", "xz", "yz")
        x, y, z = self.twisted((h[0], h[1], h[2]))
        y2, yz, _, z2 = self._turned_block(b.yy, yz, yz, zz, self.twist, "t")
        moments = (x, y, z, xx, y2, z2, c * xy - s * xz, s * xy + c * xz, yz)
        return Moments(b.m, *self.named([f"{name}_" for name in names], moments))

    def turned_flow(self, flow: Flow) -> Flow:
        """As turned_moments."""
        h, (zx, zy, zz) = self.turned(flow.h, "kh"), self.turned(flow.z, "kz")
        xx, xy, yx, yy = self._turned_block(*flow.x[:2], *flow.y[:2], self.direction, "k")
        xz, yz, _ = self.turned((flow.x[2], flow.y[2], 0), "kk")
        return Flow(h, (xx, xy, xz), (yx, yy, yz), (zx, zy, zz))

    def carried_flow(self, flow: Flow) -> Flow:
        """As carried_moments: the origin that moves away takes v along."""
        h, rows = flow.h, (flow.x, flow.y, flow.z)
        x, y, z = ((row[0] + v * self.a, row[1], row[2] + v * self.d) for row, v in zip(rows, h, strict=True))
        across = [self.twisted(row) for row in (x, y, z)]
        columns = [self.twisted((u, v, w)) for u, v, w in zip(*across, strict=True)]
        x, y, z = (
            self.named([f"k{row}{column}_" for column in "xyz"], values)
            for row, values in zip("xyz", zip(*columns, strict=True), strict=True)
        )
        return Flow(self.named([f"kh{e}_" for e in "xyz"], self.twisted(h)), x, y, z)

    def _turned_block(
        self, xx: Any, xy: Any, yx: Any, yy: Any, direction: tuple[Any, Any], name: str
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


def composites(steps: Sequence[Step], bodies: Sequence[Moments]) -> list[Moments]:
    """(n,) all that a joint moves, at the joint, in the axes before it. `bodies`: of the links, each in its frame."""
    result: list[Moments] = []
    carried: Moments | None = None
    for step, body in zip(reversed(steps), reversed(bodies), strict=True):
        whole = body
        if carried is not None:
            names = [f.name for f in fields(Moments)]
            sums = [getattr(body, name) + getattr(carried, name) for name in names]
            whole = Moments(*step.named([f"{name}_c" for name in names], sums))
        result.append(step.turned_moments(whole))
        carried = step.carried_moments(result[-1])
    return result[::-1]
