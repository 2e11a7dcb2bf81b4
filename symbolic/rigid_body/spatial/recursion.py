"""Inverse dynamics of a spatial chain: a Newton-Euler recursion on lumped parameters, which is what is emitted.

The same code runs on SymPy symbols, counted values and residues modulo a prime (see functions.py). It is short
because:

- A link carries U, with acceleration(p) = acceleration(origin) + U p, instead of the angular acceleration. The column
  of U along the joint's axis is the same before and after the joint, so that it only has to be turned.
- A link is described by its moments of mass of order 0, 1 and 2 about its frame's origin. Those that merge into other
  links are 0 and vanish (base_parameters.py). The moment of the inertial forces is the axial vector of U S.
- Links of parallel joints are written along shared axes: instead of turning vectors from link to link, the few moments
  of each link are turned. Likewise the last link need not be turned.
- Constants of the geometry are numbers and fold.

Second moments S replace the inertia tensor: they turn like a matrix, and I = tr(S) − S.

Source: Luh, Walker & Paul 1980 (recursive Newton-Euler); Khalil & Kleinfinger 1987 (customised, in modified DH
frames); Featherstone 2008, section 2; Rucker & Wensing 2022 (pseudo-inertia).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, NamedTuple

from symbolic.functions import Notes, Turn
from symbolic.model_file.arm import Link
from symbolic.rigid_body.base_parameters import exact
from symbolic.rigid_body.spatial.geometry import (
    Geometry,
    LinkFrame,
    Placement,
    Vector,
    added,
    cross,
    dot,
    quarter_turned,
    scaled,
    vector,
)


class Moments(NamedTuple):
    """A body's moments about a frame's origin and axes: the integrals of 1, x and x xᵀ over its mass.

    m          mass, kg
    x, y, z    first moments, kg m
    xx .. yz   second moments, kg m²
    spin       xx + yy of a composite, which rotation about z does not change
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
    spin: Any = 0

    @property
    def first(self) -> tuple[Any, Any, Any]:
        """First mass moments, (3,) kg m."""
        return self.x, self.y, self.z

    def placed(self, frame: Placement) -> Moments:
        """The body's moments in the frame in which its own frame has the pose `frame`."""
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


KINDS = Moments._fields[:-1]

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
"""Moments of a unit of each of a body's ten parameters: inertia tensor in the joint's frame in kg m², first moments in
kg m, mass in kg."""


def body_values(link: Link) -> dict[str, Fraction | None]:
    """The parameters of INERTIA from the model file; None where unknown."""
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


Direction = tuple[Any, Any]
"""Cosine and sine."""


class Gradient(NamedTuple):
    """U (3, 3) of a link, 1/s²: the gradient of its points' accelerations; and differences of its diagonal."""

    xx: Any
    yy: Any
    zz: Any
    xy: Any
    yx: Any
    xz: Any
    zx: Any
    yz: Any
    zy: Any
    zz_yy: Any
    xx_zz: Any
    yy_xx: Any

    def along(self, x: Any, y: Any, z: Any) -> Vector:
        """U (x, y, z)."""
        return (
            self.xx * x + self.xy * y + self.xz * z,
            self.yx * x + self.yy * y + self.yz * z,
            self.zx * x + self.zy * y + self.zz * z,
        )


@dataclass(frozen=True)
class SpatialMotion:
    """The motion of one link, along the axes in which it is written.

    first       whether it is the first of its group
    direction   cosine and sine of its frame's x axis
    before      cosine and sine of the previous link's x axis; in the first of a group, of the joint's x axis before it
                turns
    reach       x and y from the previous origin to its own, m, along the previous link's axes; 0 in a group's first
    lift        the same along z
    axis        (3,) the joint's axis without its sign
    U           gradient of the acceleration
    a           (3,) acceleration of its origin minus gravity, m/s²
    """

    first: bool
    direction: Direction
    before: Direction
    reach: tuple[Any, Any]
    lift: Any
    axis: Vector
    U: Gradient
    a: Vector


def groups(g: Geometry) -> list[range]:
    """Indices (0-based) of consecutive links with parallel joint axes."""
    starts = [i for i, link in enumerate(g.links) if i == 0 or link.twist.sin != 0]
    return [range(a, b) for a, b in zip(starts, [*starts[1:], g.n], strict=True)]


def motion(
    g: Geometry, axes: Sequence[int], q: Sequence[Any], qd: Sequence[Any], qdd: Sequence[Any], notes: Notes
) -> list[SpatialMotion]:
    """The motion of all links, from the base outwards; gravity is an acceleration of the base.

    axes   (n,) the link (0-based) along whose x axis each link is written: one of the same group, or the one before the
           group, rotated by the twist only
    """
    found: list[SpatialMotion] = []
    state = _State((0, 0, 0), 0, (0, 0, 0), vector([-x for x in g.gravity]))
    for group in groups(g):
        at = group[0] - 1
        for i in group:
            link, k = g.links[i], i + 1
            reach: tuple[Any, Any] = (0, 0)
            if i > group[0]:
                c, s = direction_along(g, at, i - 1, q=q, notes=notes)
                across = notes.let(f"x{k}", link.across(q[i]))
                reach = notes.let(f"lc{k}", across * c), notes.let(f"ls{k}", across * s)
                state = state.moved(found[-1].U.along(*reach, 0), k, notes)
            before = direction_along(g, axes[i], at, q=q, notes=notes)
            state, at = _turned_state(state, before, k, notes), axes[i]
            lift = notes.let(f"r{k}", link.reach(q[i]))
            state = state.moved([e * lift for e in state.column], k, notes)
            axis = (0, 0, 1) if i == group[0] else link.axis(direction_along(g, at, i - 1, q=q, notes=notes))
            rate, rise = link.sign * qd[i], link.sign * qdd[i]
            if link.revolute:
                wx, wy, wz = state.w
                w = (wx, wy, notes.let(f"wz{k}", wz + rate))
                state = replace(state, w=w, turning=notes.let(f"alz{k}", state.turning + rise))
            else:
                twice = notes.let(f"qd{k}_2", 2 * rate)
                state = state.moved(added(scaled(rise, axis), cross(state.w, scaled(twice, axis))), k, notes)
            U = _gradient(state, at == group[-1] and i < g.n - 1, k, notes)
            own = direction_along(g, at, i, q=q, notes=notes)
            found.append(SpatialMotion(i == group[0], own, before, reach, lift=lift, axis=axis, U=U, a=state.a))
        if group[-1] < g.n - 1:
            state = _turned_state(state, direction_along(g, group[-1], at, q=q, notes=notes), group[-1] + 1, notes)
            state = _twisted_state(state, g.links[group[-1] + 1], group[-1] + 2, notes)
    return found


@dataclass(frozen=True)
class _State:
    """State of the recursion: w, rad/s; its derivative about z; the column of U along z; a of the last origin."""

    w: Vector
    turning: Any
    column: Vector
    a: Vector

    def moved(self, by: Sequence[Any], k: int, notes: Notes) -> _State:
        return replace(self, a=named("a", k, [a + e for a, e in zip(self.a, by, strict=True)], notes))


def _gradient(state: _State, outwards: bool, k: int, notes: Notes) -> Gradient:
    """U of a link. outwards: the next group needs the angular acceleration about y."""
    let, (wx, wy, wz), (xz, yz, Uzz) = notes.let, state.w, state.column
    xx, zz, xy = let(f"wxx{k}", wx * wx), let(f"wzz{k}", wz * wz), let(f"wxy{k}", wx * wy)
    less, more = let(f"xx_zz{k}", xx - zz), let(f"wxz{k}", xx + zz)
    Uxx = let(f"Uxx{k}", Uzz + less)
    if outwards:
        across, along = let(f"wx_z{k}", wx * wz), let(f"wy_z{k}", wy * wz)
        zx = let(f"Uzx{k}", across - let(f"aly{k}", xz - across))
        zy = let(f"Uzy{k}", along - let(f"alx{k}", yz - along))
    else:
        twice = let(f"wz{k}_2", 2 * wz)
        zx, zy = let(f"Uzx{k}", twice * wx - xz), let(f"Uzy{k}", twice * wy - yz)
    return Gradient(
        xx=Uxx,
        yy=-more,
        zz=Uzz,
        xy=let(f"Uxy{k}", xy - state.turning),
        yx=let(f"Uyx{k}", xy + state.turning),
        xz=xz,
        zx=zx,
        yz=yz,
        zy=zy,
        zz_yy=let(f"zz_yy{k}", Uzz + more),
        xx_zz=less,
        yy_xx=-Uzz if xx == 0 else let(f"yy_xx{k}", -more - Uxx),
    )


def _twisted_state(state: _State, link: LinkFrame, k: int, notes: Notes) -> _State:
    """The state at the next group's first axis, along that axis and the previous x axis."""
    (ca, sa), (wx, _, wz), U = link.twist.pair, state.w, _gradient(state, True, k - 1, notes)
    state = state.moved([link.a * e for e in (U.xx, U.yx, U.zx)], k, notes)
    column = [ca * z - sa * y for y, z in ((U.xy, U.xz), (U.yy, U.yz), (U.zy, U.zz))]
    about_y = notes.let(f"aly{k - 1}", U.xz - notes.let(f"wx_z{k - 1}", wx * wz))
    return _State(
        named("v", k, twisted(state.w, link.twist), notes),
        notes.let(f"al{k}", ca * state.turning - sa * about_y),
        named("u", k, twisted(column, link.twist), notes),
        named("b", k, twisted(state.a, link.twist), notes),
    )


def _turned_state(state: _State, direction: Direction, k: int, notes: Notes) -> _State:
    if direction == (1, 0):
        return state
    return _State(
        named("w", k, turned(state.w, direction), notes),
        state.turning,
        named("U", k, turned(state.column, direction), notes),
        named("a", k, turned(state.a, direction), notes),
    )


def named(name: str, k: Any, v: Sequence[Any], notes: Notes) -> Vector:
    """A vector (3,) whose elements are noted as namexk, nameyk, namezk."""
    return vector([notes.let(f"{name}{axis}{k}", e) for axis, e in zip("xyz", v, strict=True)])


def twisted(v: Sequence[Any], twist: Turn) -> Vector:
    """A vector in axes rotated about x by the twist."""
    x, y, z = v
    return x, twist.cos * y + twist.sin * z, twist.cos * z - twist.sin * y


def turned(v: Sequence[Any], direction: tuple[Any, Any]) -> Vector:
    """A vector in axes in which its present x axis has this direction."""
    (x, y, z), (c, s) = v, direction
    return c * x - s * y, s * x + c * y, z


def direction_along(g: Geometry, axes: int, frame: int, q: Sequence[Any], notes: Notes) -> Direction:
    """Cosine and sine of a frame's x axis relative to that of another frame of its group."""
    low, high = sorted((axes, frame))
    angle: Any = 0
    turn = Turn(1, 0)
    for i in range(low + 1, high + 1):
        link = g.links[i]
        angle = notes.let(f"a{i + 1}", angle + link.angle(q[i])) if link.revolute else angle
        turn = turn + link.offset
    c, s = quarter_turned(notes.sincos(angle), turn)
    return (c, s) if frame > axes else (c, -s)


def torques(
    g: Geometry,
    moments: Sequence[Moments],
    rotors: Sequence[Any],
    moving: Sequence[SpatialMotion],
    qdd: Sequence[Any],
    notes: Notes,
) -> list[Any]:
    """Joint torques and forces (n,), from the tip inwards. moments, rotors: (n,) of links and joints."""
    tau: list[Any] = [0] * g.n
    F: Vector = (0, 0, 0)
    N: Vector = (0, 0, 0)
    for group in reversed(groups(g)):
        F, N = (
            named(name, group[-1] + 1, turned(v, moving[group[-1]].direction), notes)
            for name, v in (("F", F), ("N", N))
        )
        for i in reversed(group):
            link, m, k = g.links[i], moving[i], i + 1
            own_F, own_N = wrench(turned_moments(moments[i], m.direction, k, notes), m)
            F, N = named("F", k, added(F, own_F), notes), named("N", k, added(N, own_N), notes)
            own = dot(N if link.revolute else F, m.axis)
            tau[i] = (own if link.sign > 0 else -own) + rotors[i] * qdd[i]
            N = named("N", k, added(N, (-m.lift * F[1], m.lift * F[0], 0)), notes)
            back = (m.before[0], -m.before[1])
            F, N = (named(name, k, turned(v, back), notes) for name, v in (("F", F), ("N", N)))
            x, y = m.reach
            N = named("N", k, added(N, (y * F[2], -x * F[2], x * F[1] - y * F[0])), notes)
        first, k = g.links[group[0]], group[0] + 1
        F, N = (named(name, k, twisted(v, -first.twist), notes) for name, v in (("F", F), ("N", N)))
        N = named("N", k, added(N, (0, -first.a * F[2], first.a * F[1])), notes)
    return tau


def wrench(S: Moments, m: SpatialMotion) -> tuple[Vector, Vector]:
    """Inertial force, and its moment about the origin, of a link's mass in this motion."""
    U, (ax, ay, az) = m.U, m.a
    along = U.along(*S.first)
    return vector([S.m * a + e for a, e in zip(m.a, along, strict=True)]), (
        S.yy * U.zy - S.zz * U.yz + S.xy * U.zx - S.xz * U.yx + S.yz * U.zz_yy + S.y * az - S.z * ay,
        S.zz * U.xz - S.xx * U.zx + S.yz * U.xy - S.xy * U.zy + S.xz * U.xx_zz + S.z * ax - S.x * az,
        S.xx * U.yx - S.yy * U.xy + S.xz * U.yz - S.yz * U.xz + S.xy * U.yy_xx + S.x * ay - S.y * ax,
    )


def turned_moments(S: Moments, direction: Direction, k: int, notes: Notes) -> Moments:
    """Moments in axes with the same z in which their present x axis has this direction."""
    let, (c, s) = notes.let, direction
    if s == 0 and c == 1:
        return S
    twice = let(f"S2{k}", s * (S.xx - S.yy) + c * (2 * S.xy))
    across = let(f"Ss{k}", s * twice)
    x, y, _ = named("M", k, turned((S.x, S.y, 0), direction), notes)
    xz, yz, _ = named("Sz", k, turned((S.xz, S.yz, 0), direction), notes)
    xx, yy = let(f"Sxx{k}", S.xx - across), let(f"Syy{k}", S.yy + across)
    return S._replace(x=x, y=y, xx=xx, yy=yy, xy=let(f"Sxy{k}", c * twice - S.xy), xz=xz, yz=yz)
