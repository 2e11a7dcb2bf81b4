"""Where the joints of an arm are, for pictures of it: in space and in the plane, by the generated tip alone.

What stands beyond a link moves with it as long as all joints further out stay at 0. So a point that is at x where all
positions are 0 is carried by link j to

    p_j + R_j R_0^T (x - p_0),

p_j and R_j the tip's place and frame at (q_1, ..., q_j, 0, ..., 0), p_0 and R_0 those where all are 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.model.loader import Model

Array = NDArray[np.float64]


def joint_places(model: Model, q: Array) -> list[tuple[Array, Array]]:
    """Of every joint, (3, N) m each: where it is, and where what it moves begins, elsewhere for a slide alone.

    q   (n, N)
    """
    found = []
    for j, (joint, home) in enumerate(zip(model.joints, model.places, strict=True)):
        base = carried(model, q, j, home)
        found.append((base, carried(model, q, j + 1, home) if joint.type == "prismatic" else base))
    return found


def carried(model: Model, q: Array, link: int, place: ArrayLike) -> Array:
    """(3, N) m, base axes: where a link (0: the base) carries a point; of a planar arm z is 0.

    place   (2,) or (3,) m, where the point is when all positions are 0
    """
    still = np.ascontiguousarray(q, dtype=np.float64).copy()
    still[link:] = 0.0
    p, R = _pose(model, still)
    p0, R0 = (part[..., 0] for part in _pose(model, np.zeros((model.n, 1))))
    x = np.zeros(3)
    x[: np.size(place)] = place
    return p + np.einsum("ijn,kj,k->in", R, R0, x - p0)


def tip_place(model: Model, q: Array) -> Array:
    """(3, N) m, base axes; of a planar arm z is 0."""
    return _pose(model, np.ascontiguousarray(q, dtype=np.float64))[0]


def _pose(model: Model, q: Array) -> tuple[Array, Array]:
    """The tip's place (3, N) and its frame's axes in base axes (3, 3, N)."""
    tip = model.tip(q)
    if model.spatial:
        return tip, model.call("tip_rotation", {"q": q})
    c, s, zero = np.cos(tip[2]), np.sin(tip[2]), np.zeros(q.shape[1])
    R = np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]])
    return np.array([tip[0], tip[1], zero]), R
