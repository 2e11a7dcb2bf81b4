"""Where a joint rests or turns: what its dry friction is there, nobody knows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.motion.settings import FRICTION_SIGMAS, RATE_BLUR

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def at_rest(rate: Array, dt: float, cutoff: float, standstill: float) -> Mask:
    """(N,) samples of a rate (N,) at steps of dt at which it rests or turns, or is about to as far as it is known.

    What rubs holds any torque below its friction at rest. A rate that its noise may have turned is below `standstill`;
    a turn lies between two samples, and the smoothing of the rate, `cutoff` Hz, blurs when a rest began.
    """
    still = np.abs(rate) < standstill
    turning = np.diff(np.sign(rate)) != 0
    still[:-1] |= turning
    still[1:] |= turning
    reach = max(1, int(np.ceil(RATE_BLUR / (cutoff * dt))))
    count = np.concatenate([[0], np.cumsum(still)])
    at = np.arange(len(still))
    close: Mask = count[np.minimum(at + reach + 1, len(still))] > count[np.maximum(at - reach, 0)]
    return close


def dry_friction(q: Array, qd: Array, qdd: Array, rigid: Array, tau: Array) -> float:
    """N m (N), as much as it may be: the jump of a torque where a joint turns, beside what is smooth in its own motion,
    (M,) each, and what the arm's rigid bodies may ask of it, rigid (k, M): the other joints' motion asks more of a
    heavy one.

    A joint that hardly runs in one direction does not tell its friction from an offset; none would be the one wrong
    answer, as its turns would then pass for known.
    """
    if not len(q):
        return 0.0
    columns = np.vstack([np.sign(qd), qd, qdd, np.ones_like(q), np.sin(q), np.cos(q), rigid])
    size = np.maximum(np.linalg.norm(columns, axis=1), 1e-300)
    columns /= size[:, None]
    inverse = np.linalg.pinv(columns @ columns.T, rcond=1e-9, hermitian=True)
    found = inverse @ (columns @ tau)
    left = float(np.linalg.norm(tau - found @ columns)) / np.sqrt(len(q))
    most = (float(found[0]) + FRICTION_SIGMAS * left * np.sqrt(max(float(inverse[0, 0]), 0.0))) / float(size[0])
    return max(most, 0.0)
