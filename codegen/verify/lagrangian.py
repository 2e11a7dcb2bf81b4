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
share. The frames of spatial/geometry.py are therefore converted back to the file's chain in exact numbers and compared
with what the file states: an error in the frames would deviate by many orders of magnitude more than rounding.

Source: Uicker 1965 (On the dynamic analysis of spatial linkages using 4x4 matrices); Paul 1981, chapter 6.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from symbolic import functions
from symbolic.functions import Turn
from symbolic.model_file.arm import Arm
from symbolic.model_file.frames import about, product
from symbolic.rigid_body.spatial.geometry import (
    Geometry,
    LinkFrame,
    Matrix,
    Placement,
    Vector,
    applied,
    scaled,
    transposed,
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
    links = geometry.links
    bodies = [_start(link).joined(link.body) for link in links]
    first = geometry.base.joined(bodies[0])
    return ExactFileChain(
        tuple(link.revolute for link in links),
        (first, *(body.inside(before.body) for body, before in zip(bodies[1:], links, strict=False))),
        tuple(_axis(link) for link in links),
        tip=geometry.tip.inside(links[-1].body),
        gravity=applied(geometry.base.turn, geometry.gravity),
    )


def deviation(arm: Arm, chain: ExactFileChain) -> float:
    """The largest difference of an element from the model file."""
    frames = zip((*chain.placements, chain.tip), (*(j.origin for j in arm.joints), arm.tip), strict=True)
    pairs = [(chain.gravity, arm.gravity)]
    for placement, frame in frames:
        pairs += [(placement.at, frame.xyz), *zip(placement.turn, _rotation(frame.rpy), strict=True)]
    for axis, joint in zip(chain.axes, arm.joints, strict=True):
        pairs.append((axis, scaled(1 / math.hypot(*joint.axis), joint.axis)))
    return max(abs(float(u) - v) for exact, stated in pairs for u, v in zip(exact, stated, strict=True))


def _rotation(rpy: Sequence[float]) -> Matrix:
    x, y, z = (about(axis, angle) for axis, angle in zip(((1, 0, 0), (0, 1, 0), (0, 0, 1)), rpy, strict=True))
    return product(z, product(y, x))


def _axis(link: LinkFrame) -> Vector:
    c, s = link.offset.pair
    return scaled(link.sign, applied(transposed(link.body.turn), link.axis((c, -s))))


def _start(link: LinkFrame) -> Placement:
    if isinstance(link.rest, int):
        return link.start
    return replace(link, offset=link.offset + link.rest).start


PRIME = 2**127 - 1
"""A Mersenne prime, far above any degree that occurs."""

residue = functools.partial(functions.residue, prime=PRIME)

Square = npt.NDArray[np.object_]
"""(4, 4) residues, Python's integers."""

ELEMENTS = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
"""A body's ten inertial parameters: inertia tensor about the origin of its joint's frame, first moments, mass."""


def pseudo_inertia(parameters: Sequence[int]) -> Square:
    """Sigma, the integral of [x y z 1]^T [x y z 1] dm, of ten parameters in the order of ELEMENTS."""
    xx, xy, xz, yy, yz, zz, x, y, z, m = parameters
    trace_2 = (xx + yy + zz) * pow(2, -1, PRIME)
    rows = [[trace_2 - xx, -xy, -xz, x], [-xy, trace_2 - yy, -yz, y], [-xz, -yz, trace_2 - zz, z], [x, y, z, m]]
    return np.array(rows, dtype=object)


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
        generators = []
        for axis, turns in zip(chain.axes, chain.revolute, strict=True):
            x, y, z = map(residue, axis)
            rows = [[0, -z, y, 0], [z, 0, -x, 0], [-y, x, 0, 0]] if turns else [[0, 0, 0, e] for e in (x, y, z)]
            generators.append(np.array([*rows, [0, 0, 0, 0]], dtype=object))
        return cls(
            chain.revolute,
            tuple(map(_residues, chain.placements)),
            _residues(chain.tip),
            tuple(generators),
            tuple(map(residue, chain.gravity)),
        )

    def posture(self, q: Sequence[Turn | int], bodies: Sequence[Square]) -> ExactPosture:
        """The chain at q, (n,) Turns or residues, with the pseudo-inertias `bodies` (n,)."""
        joints = zip(self.placements, self.generators, q, strict=True)
        steps = [times(placement, _moved(Q, position)) for placement, Q, position in joints]
        places = list(itertools.accumulate(steps, times))
        axes = [times(times(T, Q), _inverse(T)) for T, Q in zip(places, self.generators, strict=True)]
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

    def torques(self, qd: Sequence[int], qdd: Sequence[int]) -> list[int]:
        """(n,) tau without rotors: D qdd + C qd + g."""
        joints = zip(self.places, self.bodies, self._accelerations(qd, qdd), strict=True)
        parts = [times(times(T, body), T2.T) for T, body, T2 in joints]
        return [contracted(S, M.T) for S, M in zip(self.axes, _outer_sums(parts), strict=True)]

    def tip_torques(self, qd: Sequence[int], qdd: Sequence[int], bodies: Sequence[Square]) -> list[list[int]]:
        """The joint torques (n,) of each of the bodies, given in the tip's frame."""
        outwards, back = self.tip(), times(self._accelerations(qd, qdd)[-1], self.chain.tip).T
        forces = [times(times(outwards, body), back) for body in bodies]
        return [[contracted(S, M.T) for S in self.axes] for M in forces]

    def _accelerations(self, qd: Sequence[int], qdd: Sequence[int]) -> list[Square]:
        """T'' - G of every joint's frame, by jets in time."""
        T0, T1, T2 = identity(), 0 * identity(), 0 * identity()
        T2[:3, 3] = [-g for g in self.chain.gravity]
        result = []
        for A, Q, v, a in zip(self.steps, self.chain.generators, qd, qdd, strict=True):
            AQ = times(A, Q)
            A1, A2 = AQ * v % PRIME, (AQ * a + times(AQ, Q) * (v * v)) % PRIME
            T2 = (times(T2, A) + 2 * times(T1, A1) + times(T0, A2)) % PRIME
            T1 = (times(T1, A) + times(T0, A1)) % PRIME
            T0 = times(T0, A)
            result.append(T2)
        return result

    @functools.cached_property
    def second_moments(self) -> Sequence[Square]:
        """(n,) W_j, the sum over l >= j of T_l Sigma_l T_l^T: moments of everything joint j moves, in base axes."""
        return _outer_sums([times(times(T, body), T.T) for T, body in zip(self.places, self.bodies, strict=True)])

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
        return [list(SW[:3, 3]) for SW in self._turned_moments]

    def tip(self) -> Square:
        """The tip's frame in the base."""
        return times(self.places[-1], self.chain.tip)

    def tip_jacobian(self) -> list[list[int]]:
        """(6, n): rows x, y, z of the tip, then rotation about base x, y, z."""
        tip = self.tip()
        columns = [[*times(S, tip)[:3, 3], S[2, 1], S[0, 2], S[1, 0]] for S in self.axes]
        return [list(row) for row in zip(*columns, strict=True)]


def identity() -> Square:
    """The unit matrix, (4, 4) residues."""
    return np.eye(4, dtype=int).astype(object)


def times(a: Square, b: Square) -> Square:
    """Matrix product modulo PRIME."""
    return a @ b % PRIME


def contracted(a: Square, b: Square) -> int:
    """tr(a bᵀ): the sum of the products of entries in equal places."""
    return int((a * b).sum() % PRIME)


def _inverse(T: Square) -> Square:
    result = identity()
    result[:3, :3] = T[:3, :3].T
    result[:3, 3] = -(T[:3, :3].T @ T[:3, 3]) % PRIME
    return result


def _outer_sums(parts: Sequence[Square]) -> Sequence[Square]:
    return [*itertools.accumulate(reversed(parts))][::-1]


def _residues(placement: Placement) -> Square:
    rows = [[*row, p] for row, p in zip(placement.turn, placement.at, strict=True)]
    return np.array([[residue(x) for x in row] for row in [*rows, [0, 0, 0, 1]]], dtype=object)


def _moved(Q: Square, position: Turn | int) -> Square:
    if isinstance(position, Turn):
        return (identity() + Q * position.sin + times(Q, Q) * (1 - position.cos)) % PRIME
    return (identity() + Q * position) % PRIME
