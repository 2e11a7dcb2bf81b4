"""The Lagrangian of a spatial chain in Uicker's form, evaluated modulo a prime: the proof of what is emitted.

Bodies are 4x4 pseudo-inertias Sigma, postures 4x4 homogeneous transforms T in base axes, from the model file's origins
and axes. With the generator Q of a joint, S_j = T_j Q_j T_j^-1 and dT_l/dq_j = S_j T_l, Lagrange's equations
are traces:

    tau_j      = sum_l tr(dT_l/dq_j Sigma_l (T''_l - G)^T),   T'' from jets in time, G gravity as an acceleration
    D_ij       = sum_l tr(dT_l/dq_i Sigma_l dT_l/dq_j^T)
    [jk, i]    = sum_l tr(d2T_l/dq_j dq_k Sigma_l dT_l/dq_i^T),   C_ij = sum_k [jk, i] qd_k
    V          = -sum_l gravity . (T_l Sigma_l e_4)

No force, moment, angular velocity or moved frame occurs: the proof shares no equation with the recursion. All numbers
are residues modulo PRIME. Two different rational functions of degree d agree at a random point with a probability of at
most d/PRIME (Schwartz 1980; Zippel 1979).

A cosine that a file means by 0.7854 is irrational, and equations can be equal exactly only for numbers that both sides
share. The frames of geometry.py are therefore converted back to the file's chain in exact numbers and compared with
what the file states: an error in the frames would deviate by many orders of magnitude more than rounding.

Source: Uicker 1965 (On the dynamic analysis of spatial linkages using 4x4 matrices); Paul 1981, chapter 6.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from symbolic.functions import Turn
from symbolic.model_file.arm import Arm, Frame
from symbolic.rigid_body.spatial.geometry import (
    Geometry,
    LinkFrame,
    Matrix,
    Placement,
    Vector,
    applied,
    negative,
    placed,
    scaled,
)

ROUNDING = 1e-8
"""m and rad; allowed difference between the file's numbers and the exact ones, over a dozen frames."""


@dataclass(frozen=True)
class ExactFileChain:
    """A file's chain in exact numbers, with the file's joint frames.

    placements   (n,) poses of the joint frames in the previous one at q = 0; the first in the base
    axes         (n,) unit vectors in the joints' frames
    tip          in the last joint's frame
    gravity      in the base, m/s²
    """

    revolute: tuple[bool, ...]
    placements: tuple[Placement, ...]
    axes: tuple[Vector, ...]
    tip: Placement
    gravity: Vector


def exact_file_chain(geometry: Geometry) -> ExactFileChain:
    """The file's chain, from DH frames in exact numbers."""
    placements, before = [], geometry.base
    for link in geometry.links:
        placements.append(_joined(before, _joined(_start(link), link.body)))
        before = _reversed(link.body)
    return ExactFileChain(
        tuple(link.revolute for link in geometry.links),
        tuple(placements),
        tuple(_axis(link) for link in geometry.links),
        tip=_joined(before, geometry.tip),
        gravity=applied(geometry.base.turn, geometry.gravity),
    )


def deviation(arm: Arm, chain: ExactFileChain) -> float:
    """The largest difference of an element from the model file."""
    frames = zip(chain.placements, (j.origin for j in arm.joints), strict=True)
    apart = [_apart(placement, frame) for placement, frame in [*frames, (chain.tip, arm.tip)]]
    for axis, joint in zip(chain.axes, arm.joints, strict=True):
        length = math.hypot(*joint.axis)
        apart += [abs(float(u) - v / length) for u, v in zip(axis, joint.axis, strict=True)]
    apart += [abs(float(g) - h) for g, h in zip(chain.gravity, arm.gravity, strict=True)]
    return max(apart)


def _apart(placement: Placement, frame: Frame) -> float:
    pairs = [
        (u, v) for a, b in zip(placement.turn, _rotation(frame.rpy), strict=True) for u, v in zip(a, b, strict=True)
    ]
    return max(abs(float(u) - v) for u, v in [*pairs, *zip(placement.at, frame.xyz, strict=True)])


def _rotation(rpy: Sequence[float]) -> list[list[float]]:
    """R = Rz(yaw) Ry(pitch) Rx(roll): every unit vector turned about x, then y, then z."""
    columns = []
    for k in range(3):
        v = [float(i == k) for i in range(3)]
        for axis, angle in enumerate(rpy):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            c, s = math.cos(angle), math.sin(angle)
            v[i], v[j] = c * v[i] - s * v[j], s * v[i] + c * v[j]
        columns.append(v)
    return [list(row) for row in zip(*columns, strict=True)]


def _axis(link: LinkFrame) -> Vector:
    """The joint's axis in the file's joint frame."""
    c, s = link.offset.pair
    return scaled(link.sign, applied(_transposed(link.body.turn), link.axis((c, -s))))


def _start(link: LinkFrame) -> Placement:
    """The link's pose in the previous frame at q = 0."""
    if isinstance(link.rest, int):
        return link.start
    return replace(link, offset=link.offset + link.rest).start


def _transposed(R: Matrix) -> Matrix:
    a, b, c = zip(*R, strict=True)
    return a, b, c


def _joined(outer: Placement, inner: Placement) -> Placement:
    """The composition of two poses."""
    columns = [applied(outer.turn, column) for column in _transposed(inner.turn)]
    a, b, c = columns
    return Placement(_transposed((a, b, c)), placed(outer.turn, outer.at, inner.at))


def _reversed(placement: Placement) -> Placement:
    turn = _transposed(placement.turn)
    return Placement(turn, negative(applied(turn, placement.at)))


PRIME = 2**127 - 1
"""A Mersenne prime, far above any degree that occurs."""

Square = list[list[int]]
"""(4, 4) residues."""

ELEMENTS = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
"""A body's ten inertial parameters: inertia tensor about the origin of its joint's frame, first moments, mass."""


def residue(number: Fraction | int) -> int:
    """A fraction modulo PRIME."""
    fraction = Fraction(number)
    return fraction.numerator * pow(fraction.denominator, -1, PRIME) % PRIME


def pseudo_inertia(parameters: Sequence[int]) -> Square:
    """Sigma, the integral of [x y z 1]^T [x y z 1] dm, of ten parameters in the order of ELEMENTS."""
    xx, xy, xz, yy, yz, zz, x, y, z, m = parameters
    half = pow(2, -1, PRIME)
    trace_2 = (xx + yy + zz) * half
    return [[trace_2 - xx, -xy, -xz, x], [-xy, trace_2 - yy, -yz, y], [-xz, -yz, trace_2 - zz, z], [x, y, z, m]]


@dataclass(frozen=True)
class ExactChain:
    """An arm's geometry modulo PRIME.

    revolute     (n,)
    placements   (n,) poses of the joint frames in the previous one; tip: in the last joint's
    generators   (n,) Q, with dT/dq = T Q
    gravity      (3,)
    """

    revolute: tuple[bool, ...]
    placements: tuple[Square, ...]
    tip: Square
    generators: tuple[Square, ...]
    gravity: tuple[int, ...]

    @classmethod
    def of(cls, chain: ExactFileChain) -> ExactChain:
        """The chain of a model file."""
        return cls(
            chain.revolute,
            tuple(_placement(placement) for placement in chain.placements),
            _placement(chain.tip),
            tuple(_generator(axis, turns) for axis, turns in zip(chain.axes, chain.revolute, strict=True)),
            tuple(residue(g) for g in chain.gravity),
        )

    def posture(self, q: Sequence[Turn | int], bodies: Sequence[Square]) -> ExactPosture:
        """The chain at q, (n,) Turns or residues, with the pseudo-inertias `bodies` (n,)."""
        steps, places, T = [], [], identity()
        for placement, Q, position in zip(self.placements, self.generators, q, strict=True):
            steps.append(times(placement, _moved(Q, position)))
            T = times(T, steps[-1])
            places.append(T)
        axes = [times(times(T, Q), inverse(T)) for T, Q in zip(places, self.generators, strict=True)]
        return ExactPosture(self, tuple(bodies), steps, places=places, axes=axes)


@dataclass(frozen=True)
class ExactPosture:
    """A chain at one q, and its joint torques modulo PRIME, without rotors, which add I_i qdd_i.

    steps    (n,) of a joint's frame in the one before, moved by q
    places   (n,) T, of a joint's frame in the base
    axes     (n,) S, so that dT_l/dq_j = S_j T_l for l >= j
    """

    chain: ExactChain
    bodies: tuple[Square, ...]
    steps: list[Square]
    places: list[Square]
    axes: list[Square]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.axes)

    def carrying(self, bodies: Sequence[Square]) -> ExactPosture:
        """The same posture with other bodies."""
        return replace(self, bodies=tuple(bodies))

    def torques(self, qd: Sequence[int], qdd: Sequence[int]) -> list[int]:
        """(n,) tau without rotors: D qdd + C qd + g."""
        joints = zip(self.places, self.bodies, self._accelerations(qd, qdd), strict=True)
        parts = [times(times(T, body), transposed(T2)) for T, body, T2 in joints]
        return [trace(S, M) for S, M in zip(self.axes, _outer_sums(parts), strict=True)]

    def tip_torques(self, qd: Sequence[int], qdd: Sequence[int], bodies: Sequence[Square]) -> list[list[int]]:
        """The joint torques (n,) of each of the bodies, given in the tip's frame."""
        outwards, back = self.tip(), transposed(times(self._accelerations(qd, qdd)[-1], self.chain.tip))
        forces = [times(times(outwards, body), back) for body in bodies]
        return [[trace(S, M) for S in self.axes] for M in forces]

    def _accelerations(self, qd: Sequence[int], qdd: Sequence[int]) -> list[Square]:
        """T'' - G of every joint's frame, by jets in time."""
        T0, T1, T2 = identity(), [[0] * 4 for _ in range(4)], [[0] * 4 for _ in range(4)]
        for i, g in enumerate(self.chain.gravity):
            T2[i][3] = -g
        result = []
        for A, Q, v, a in zip(self.steps, self.chain.generators, qd, qdd, strict=True):
            AQ = times(A, Q)
            A1, A2 = _scaled(AQ, v), _sum(_scaled(AQ, a), _scaled(times(AQ, Q), v * v))
            T2 = _sum(times(T2, A), _scaled(times(T1, A1), 2), times(T0, A2))
            T1 = _sum(times(T1, A), times(T0, A1))
            T0 = times(T0, A)
            result.append(T2)
        return result

    @functools.cached_property
    def second_moments(self) -> list[Square]:
        """(n,) W_j, the sum over l >= j of T_l Sigma_l T_l^T: moments of everything joint j moves, in base axes."""
        parts = [times(times(T, body), transposed(T)) for T, body in zip(self.places, self.bodies, strict=True)]
        return _outer_sums(parts)

    @functools.cached_property
    def _turned_moments(self) -> list[Square]:
        """(n,) S_j W_j."""
        return [times(S, W) for S, W in zip(self.axes, self.second_moments, strict=True)]

    @functools.cached_property
    def inertia(self) -> list[list[int]]:
        """(n, n) D without rotors: tr(S_i W_max(i,j) S_j^T), and W is symmetric."""
        S, SW, n = self.axes, self._turned_moments, self.n
        return [[contracted(S[min(i, j)], SW[max(i, j)]) for j in range(n)] for i in range(n)]

    def coriolis(self, qd: Sequence[int]) -> list[list[int]]:
        """(n, n) C by Christoffel symbols: C_ij = sum_k [jk, i] qd_k."""
        W, S, SW, n = self.second_moments, self.axes, self._turned_moments, self.n
        C = [[0] * n for _ in range(n)]
        for j in range(n):
            for k in range(j, n):
                turned = times(S[j], S[k])  # d2T_l/dq_j dq_k = S_j S_k T_l for j <= k
                inner = times(turned, W[k])
                for i in range(n):
                    symbol = contracted(inner, S[i]) if i <= k else contracted(turned, SW[i])
                    C[i][j] += symbol * qd[k]
                    if j != k:
                        C[i][k] += symbol * qd[j]
        return [[x % PRIME for x in row] for row in C]

    def gravity(self) -> list[int]:
        """(n,) dV/dq."""
        return [-sum(g * x for g, x in zip(self.chain.gravity, row, strict=True)) % PRIME for row in self._slopes()]

    def moment_jacobian(self) -> list[list[int]]:
        """(3, n) derivative of the sum of mass times position."""
        return [list(row) for row in zip(*self._slopes(), strict=True)]

    def _slopes(self) -> list[list[int]]:
        """(n, 3) derivative of the first moment, in base axes, by each joint."""
        return [[row[3] for row in SW[:3]] for SW in self._turned_moments]

    def tip(self) -> Square:
        """The tip's frame in the base."""
        return times(self.places[-1], self.chain.tip)

    def tip_jacobian(self) -> list[list[int]]:
        """(6, n): rows x, y, z of the tip, then rotation about base x, y, z."""
        tip = self.tip()
        columns = []
        for S in self.axes:
            moved = times(S, tip)
            columns.append([moved[0][3], moved[1][3], moved[2][3], S[2][1], S[0][2], S[1][0]])
        return [list(row) for row in zip(*columns, strict=True)]


def identity() -> Square:
    """The unit matrix, (4, 4) residues."""
    return [[int(i == j) for j in range(4)] for i in range(4)]


def times(a: Square, b: Square) -> Square:
    """Matrix product modulo PRIME."""
    columns = list(zip(*b, strict=True))
    return [[(w * a0 + x * a1 + y * a2 + z * a3) % PRIME for w, x, y, z in columns] for a0, a1, a2, a3 in a]


def transposed(a: Square) -> Square:
    """aᵀ, (4, 4)."""
    return [list(column) for column in zip(*a, strict=True)]


def inverse(T: Square) -> Square:
    """The inverse of a homogeneous transform."""
    R = [[T[j][i] for j in range(3)] for i in range(3)]
    p = [T[i][3] for i in range(3)]
    return [[*row, -sum(x * y for x, y in zip(row, p, strict=True)) % PRIME] for row in R] + [[0, 0, 0, 1]]


def trace(a: Square, b: Square) -> int:
    """The trace of the product."""
    return contracted(a, transposed(b))


def contracted(a: Square, b: Square) -> int:
    """tr(a bᵀ): the sum of the products of entries in equal places."""
    rows = zip(a, b, strict=True)
    return sum(w * a0 + x * a1 + y * a2 + z * a3 for (a0, a1, a2, a3), (w, x, y, z) in rows) % PRIME


def _scaled(a: Square, factor: int) -> Square:
    return [[factor * x % PRIME for x in row] for row in a]


def _sum(*matrices: Square) -> Square:
    return [[sum(entries) % PRIME for entries in zip(*rows, strict=True)] for rows in zip(*matrices, strict=True)]


def _outer_sums(parts: Sequence[Square]) -> list[Square]:
    """Sums from every joint to the tip."""
    sums, total = [], [[0] * 4 for _ in range(4)]
    for part in reversed(parts):
        total = _sum(total, part)
        sums.append(total)
    return sums[::-1]


def _placement(placement: Placement) -> Square:
    rows = zip(placement.turn, placement.at, strict=True)
    return [[*(residue(x) for x in row), residue(p)] for row, p in rows] + [[0, 0, 0, 1]]


def _generator(axis: Vector, revolute: bool) -> Square:
    x, y, z = (residue(u) for u in axis)
    if revolute:
        return [[0, -z, y, 0], [z, 0, -x, 0], [-y, x, 0, 0], [0, 0, 0, 0]]
    return [[0, 0, 0, x], [0, 0, 0, y], [0, 0, 0, z], [0, 0, 0, 0]]


def _moved(Q: Square, position: Turn | int) -> Square:
    """exp(Q q): Rodrigues' formula for a turn about a unit axis; for a slide, Q Q is 0."""
    if isinstance(position, Turn):
        return _sum(identity(), _scaled(Q, position.sin), _scaled(times(Q, Q), 1 - position.cos))
    return _sum(identity(), _scaled(Q, position))
