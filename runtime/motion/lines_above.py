"""Lines of the torque over the motor's angle that lie above the band, and bands raised to hold them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from runtime.motion.angle_spectrum import lines
from runtime.motion.band import Band, LineAbove
from runtime.motion.settings import (
    CUTOFF_OF_SAMPLING,
    ENOUGH_FOR_NOISE,
    LINE_INSIDE,
    LINE_TURNS,
    LINE_WORTH,
    NOISE_OF_LINES,
    SLOW_FOR_LINES,
)
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]


def lines_above(recordings: Sequence[Recording], band: Band, ratios: Sequence[float]) -> list[LineAbove]:
    """Lines of the measured torques that are above the band most of the way, the strongest first.

    ratios (n,): gear ratios. The torque is taken as it is: what model and motion say of it lies below.
    """
    found = [line for i, ratio in enumerate(ratios) for line in _of_joint(recordings, band, i, ratio)]
    found.sort(key=lambda line: -line.rms)
    return [line for line in found if line.rms**2 >= LINE_WORTH * found[0].rms ** 2]


def raised(recordings: Sequence[Recording], band: Band, inertia: Array, ratios: Sequence[float]) -> Band:
    """Every joint's band up to above the highest of the lines beyond it that the encoders' noise permits.

    inertia (n, n) as for `choose_band`. As an inertial torque in the raised band, that noise must be small against what
    the joint's lines are; a line that would need more of it stays above.
    """
    above = lines_above(recordings, band, ratios)
    highest = CUTOFF_OF_SAMPLING * min(1 / r.dt for r in recordings)
    cutoffs, reasons = band.cutoffs.copy(), []
    for joint in sorted({line.joint for line in above}):
        own = [line for line in above if line.joint == joint]
        together = float(np.sqrt(sum(line.rms**2 for line in own)))
        for line in sorted(own, key=lambda line: -line.frequency):
            cutoff = float(f"{LINE_INSIDE * line.frequency:.3g}")
            # One-sided white noise of the positions, twice differentiated, up to the cut-off.
            noise = float(np.sqrt(inertia[joint] ** 2 @ band.position_density * (2 * np.pi) ** 4 * cutoff**5 / 5))
            if cutoff <= highest and noise < NOISE_OF_LINES * together:
                reasons.append(
                    f"the band of joint {joint + 1} is raised from {cutoffs[joint]:g} to {cutoff:g} Hz to hold a line "
                    f"of its torque that repeats {line.order:.4g} times per turn of the motor, "
                    f"at {line.frequency:.3g} Hz"
                )
                cutoffs[joint] = cutoff
                break
    rest = tuple(line for line in above if LINE_INSIDE * line.frequency > cutoffs[line.joint])
    return replace(band, cutoffs=cutoffs, reason="; ".join([band.reason, *reasons]), above=rest)


def _of_joint(recordings: Sequence[Recording], band: Band, joint: int, ratio: float) -> list[LineAbove]:
    cutoff = float(band.cutoffs[joint])
    # A stretch of each is enough to see a line, as it is for noise.
    stretches = [(r, slice(s.start, min(s.stop, s.start + ENOUGH_FOR_NOISE))) for r in recordings for s in r.segments]
    parts = [_along(r.q[joint, s], r.tau[joint, s], r.dt, ratio=ratio, cutoff=cutoff) for r, s in stretches]
    angle, speed, torque = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    use = speed > SLOW_FOR_LINES * speed.max(initial=0.0)
    angle, speed, torque = angle[use], speed[use], torque[use]
    if not len(angle) or np.ptp(angle) < 2 * np.pi * LINE_TURNS:
        return []
    ordered = np.sort(speed)
    middle = float(ordered[np.searchsorted(np.cumsum(ordered), ordered.sum() / 2)])
    # Above the band at the middle speed, and below what a raised band could hold.
    span = 2 * np.pi * cutoff / middle, 2 * np.pi * CUTOFF_OF_SAMPLING / recordings[0].dt / middle
    among = max(2, round((span[1] - span[0]) * float(np.ptp(angle)) / (2 * np.pi)))
    rows = angle, torque - torque.mean(), np.ones((1, len(angle))), np.array([[1 / len(angle)]])
    return [
        LineAbove(joint, order, order * middle / (2 * np.pi), float(np.sqrt(gain / len(angle))))
        for order, gain in lines(*rows, span, among).items()
    ]


def _along(q: Array, tau: Array, dt: float, ratio: float, cutoff: float) -> tuple[Array, Array, Array]:
    """The motor's angle and speed, and the torque less its slow part, each (N,)."""
    width = max(1, round(1 / (cutoff * dt)))
    if len(q) <= 2 * width:
        return np.empty(0), np.empty(0), np.empty(0)
    speed = np.abs(q[2 * width :] - q[: -2 * width]) / (2 * width * dt)
    total = np.concatenate([[0.0], np.cumsum(tau)])
    size = 2 * width + 1
    slow = (total[size:] - total[:-size]) / size
    inner = slice(width, -width)
    return ratio * q[inner], ratio * speed, tau[inner] - slow
