"""What a rigid body is to the equations: its moments of mass 0, 1 and 2 about an origin, along axes.

Ten numbers, in any ring, in which forces and energies are linear. Second moments stand in place of the inertia
tensor: they turn like a matrix, and the inertia tensor follows from them, I = tr(S) − S.

Source: Featherstone 2008; Rucker & Wensing 2022 (pseudo-inertia).
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any, NamedTuple

from symbolic.model_file.arm import Link
from symbolic.rigid_body.exact_rank import exact
from symbolic.rigid_body.spatial.geometry import Placement


class Moments(NamedTuple):
    """Of a body about a frame's origin and along its axes: the integrals of 1, x and x xᵀ over its mass.

    m          mass, kg
    x, y, z    first moments, kg m
    xx .. yz   second moments, kg m²
    """

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
    def first(self) -> tuple[Any, Any, Any]:
        """First mass moments, (3,) kg m."""
        return self.x, self.y, self.z

    def placed(self, frame: Placement) -> Moments:
        """The same body about the frame in which its own stands as `frame` says, and along that one's axes."""
        R, p = frame.turn, frame.at
        S = ((self.xx, self.xy, self.xz), (self.xy, self.yy, self.yz), (self.xz, self.yz, self.zz))
        h = [sum(r * e for r, e in zip(row, self.first, strict=True)) for row in R]

        def second(i: int, j: int) -> Any:
            turned = sum(R[i][k] * S[k][l] * R[j][l] for k in range(3) for l in range(3) if S[k][l] != 0)
            return turned + h[i] * p[j] + h[j] * p[i] + self.m * p[i] * p[j]

        return Moments(
            self.m,
            *(h[i] + self.m * p[i] for i in range(3)),
            *(second(i, j) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))),
        )


KINDS = Moments._fields

INERTIA: Mapping[str, Moments] = {
    "XX": Moments(xx=Fraction(-1, 2), yy=Fraction(1, 2), zz=Fraction(1, 2)),
    "XY": Moments(xy=-1),
    "XZ": Moments(xz=-1),
    "YY": Moments(xx=Fraction(1, 2), yy=Fraction(-1, 2), zz=Fraction(1, 2)),
    "YZ": Moments(yz=-1),
    "ZZ": Moments(xx=Fraction(1, 2), yy=Fraction(1, 2), zz=Fraction(-1, 2)),
    "MX": Moments(x=1),
    "MY": Moments(y=1),
    "MZ": Moments(z=1),
    "M": Moments(m=1),
}
"""A unit of each of the ten parameters of a body as users know them: the inertia tensor about the origin of the joint's
frame and along its axes in kg m², first moments in kg m, mass in kg."""


def body_values(link: Link) -> dict[str, Fraction | None]:
    """The parameters of INERTIA as the model file states them; None where a number behind one is not known."""
    m = None if link.mass is None else exact(link.mass)
    values: dict[str, Fraction | None] = dict.fromkeys(INERTIA) | {"M": m}
    if m is None or link.com is None:
        return values
    x, y, z = (exact(e) for e in link.com)
    values |= {"MX": m * x, "MY": m * y, "MZ": m * z}
    if link.inertia is not None:
        xx, xy, xz, yy, yz, zz = (exact(e) for e in link.inertia)
        values |= {"XX": xx + m * (y * y + z * z), "YY": yy + m * (x * x + z * z), "ZZ": zz + m * (x * x + y * y)}
        values |= {"XY": xy - m * x * y, "XZ": xz - m * x * z, "YZ": yz - m * y * z}
    return values
