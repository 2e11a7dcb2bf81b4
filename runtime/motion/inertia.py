"""The inertia that a recording shows where no model tells it: for the band, and to see what a fit makes of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from runtime.motion.filters import differentiator
from runtime.motion.settings import LOWEST_CUTOFF, SEGMENT_HALVES
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]


def moment(q: Array, qd: Array, qdd: Array, tau: Array) -> Array:
    """(7, 7) products of one joint's acceleration, friction, constant and gravity columns and its torque, (N,) each.

    Dry and viscous friction, an offset and the gravity of a link that turns are taken along, so that none of them
    passes for an inertia.
    """
    columns = np.array([qdd, qd, np.sign(qd), np.ones_like(q), np.sin(q), np.cos(q), tau])
    product: Array = columns @ columns.T
    return product


def asked_inertia(products: Array) -> float:
    """kg m² (kg), what the torque asks for an acceleration, by least squares over the sum of such `moment`s."""
    size = np.sqrt(np.maximum(np.diag(products), 1e-300))
    scaled = products / np.outer(size, size)
    share = np.linalg.lstsq(scaled[:-1, :-1], scaled[:-1, -1])[0]
    return float(max(abs(share[0]) * size[-1] / size[0], 1e-12))


def apparent_inertia(recordings: Sequence[Recording]) -> Array:
    """(n,) kg m² (kg) that each joint's torque asks for its acceleration, below the lowest cut-off."""
    products = np.zeros((len(recordings[0].q), 7, 7))
    for r in recordings:
        derive = differentiator(LOWEST_CUTOFF, 1 / r.dt)
        for s in (s for s in r.segments if s.stop - s.start > SEGMENT_HALVES * derive.half):
            inside = slice(s.start + derive.half, s.stop - derive.half)
            for i, (q, tau) in enumerate(zip(r.q, r.tau, strict=True)):
                products[i] += moment(*derive(q[s]), tau[inside])
    return np.array([asked_inertia(one) for one in products])
