"""The model file's origins and axes as the frames of geometry.py round them: what the proof takes for the arm.

A cosine that a file means by 0.7854 is irrational, and equations can be equal exactly only for numbers that both sides
share. The frames are therefore led back to the file's own chain, joint frame in joint frame, in exact numbers, and held
against what the file says: a mistake of the frames is a deviation many orders of magnitude above rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from symbolic.model_file.arm import Arm, Frame
from symbolic.rigid_body.spatial.geometry import Geometry, LinkFrame, Placement
from symbolic.rigid_body.spatial.vectors import Matrix, Vector, applied, negative, placed, scaled

ROUNDING = 1e-8
"""m and rad; how far a number of the file may stand from the exact one: rounded decimals of a dozen frames."""


@dataclass(frozen=True)
class ExactFileChain:
    """A file's chain in exact numbers, the joints' frames as it has them.

    placements   (n,) of a joint's frame in the one before, where q = 0; the first in the base
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
    """The file's chain, from frames with exact numbers."""
    placements, before = [], geometry.base
    for link in geometry.links:
        placements.append(_joined(before, _joined(_start(link), link.body)))
        before = _reversed(link.body)
    return ExactFileChain(
        tuple(link.revolute for link in geometry.links),
        tuple(placements),
        tuple(_axis(link) for link in geometry.links),
        _joined(before, geometry.tip),
        applied(geometry.base.turn, geometry.gravity),
    )


def deviation(arm: Arm, chain: ExactFileChain) -> float:
    """The largest difference of an element from what the model file says."""
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
    """In the file's joint frame."""
    c, s = link.offset.pair
    return scaled(link.sign, applied(_transposed(link.body.turn), link.axis((c, -s))))


def _start(link: LinkFrame) -> Placement:
    """The link's frame in the one before, where q = 0."""
    if isinstance(link.rest, int):
        return link.start
    return replace(link, offset=link.offset + link.rest).start


def _transposed(R: Matrix) -> Matrix:
    a, b, c = zip(*R, strict=True)
    return a, b, c


def _joined(outer: Placement, inner: Placement) -> Placement:
    """inner, given in outer, in what outer is given in."""
    columns = [applied(outer.turn, column) for column in _transposed(inner.turn)]
    a, b, c = columns
    return Placement(_transposed((a, b, c)), placed(outer.turn, outer.at, inner.at))


def _reversed(placement: Placement) -> Placement:
    turn = _transposed(placement.turn)
    return Placement(turn, negative(applied(turn, placement.at)))
