"""Lines over the motor's angle in what a model leaves of a joint's torque: orders at which a ripple is looked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from runtime.identification.settings import (
    BAND_EDGE,
    MIDDLE_OF_SPEEDS,
    MOST_LINES_TRIED,
    OF_ITS_OWN,
    ORDERS_SPREAD,
    SLOWEST_ROWS,
)
from runtime.model.loader import Model
from runtime.motion.angle_spectrum import angle_spectrum, lines, wave_beside
from runtime.motion.motion import Motion
from runtime.motion.settings import LEAST_PERIODS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MotorAngle:
    """The motor's angle at the in-band rows at which a joint moves.

    angle (M,) rad; speed (M,) rad/s; time (M,) s, of recordings one after another; cutoff Hz of the band
    """

    angle: Array
    speed: Array
    time: Array
    cutoff: float

    @property
    def period(self) -> float:
        """Order of one period over the whole motion."""
        return 2 * np.pi / max(float(np.ptp(self.angle)), 1e-300)

    @property
    def span(self) -> tuple[float, float]:
        """Lowest order with enough periods in the motion, and the highest that is in the band while it is slow."""
        slow = float(np.quantile(self.speed, SLOWEST_ROWS)) if len(self.speed) else 0.0
        return LEAST_PERIODS * self.period, 2 * np.pi * self.cutoff / max(slow, 1e-300)

    def spread(self) -> Array:
        """Orders all over the span, where none is known; none if the span is empty."""
        low, high = self.span
        return np.geomspace(low, high, ORDERS_SPREAD) if low < high else np.empty(0)

    def lines(self, left: Array, base: Array, projection: Array) -> tuple[Array, int]:
        """Orders (L,) of waves over the angle that stand out of a residual, the strongest first, and the number of
        orders among which they do; left (M,), base (B, M) and projection (B, B) as for `angle_spectrum`.

        A line that comes out clearer over the time, and not beside that, is none of the motor's.
        """
        low, high = self.span
        if not low < high:
            return np.empty(0), 1
        among = max(2, round((high - low) / self.period))
        octaves = low * 2 ** np.arange(np.ceil(np.log2(high / low)) + 1)
        found: dict[float, float] = {}
        for start, stop in pairwise(np.minimum(octaves, high)):
            # Where the motor is too fast for an order to be in the band, the rows hold nothing of it.
            slow = self.speed * start < 2 * np.pi * BAND_EDGE * self.cutoff
            part = replace(self, angle=self.angle[slow], speed=self.speed[slow], time=self.time[slow])
            rows = left[slow], base[:, slow], projection
            found |= part.of_their_own(lines(part.angle, *rows, (start, stop), among), *rows)
        strongest = sorted(found, key=lambda order: -found[order])[:MOST_LINES_TRIED]
        return np.array(strongest), among

    def of_their_own(
        self, found: Mapping[float, float], left: Array, base: Array, projection: Array
    ) -> dict[float, float]:
        """Those of some lines, order and gain, that no wave over the time explains and more, of a frequency through
        which the order sweeps."""
        if not found:
            return {}
        margin = LEAST_PERIODS / max(float(np.ptp(self.time)), 1e-300)
        slow, fast = (self._speed(part) / (2 * np.pi) for part in MIDDLE_OF_SPEEDS)
        swept = min(found) * slow - margin, max(found) * fast + margin
        over_time = angle_spectrum(2 * np.pi * self.time, left, base, projection=projection, span=swept)
        return {
            order: gain
            for order, gain in found.items()
            if not self._taken_by(
                over_time.strongest(order * slow - margin, order * fast + margin),
                order,
                gain,
                left=left,
                base=base,
                projection=projection,
            )
        }

    def _taken_by(
        self, wave: tuple[float, float], order: float, gain: float, left: Array, base: Array, projection: Array
    ) -> bool:
        """Whether a wave over the time, frequency and gain, explains a line and more, and leaves little of it."""
        frequency, more = wave
        if more < gain:
            return False
        beside = left - wave_beside(2 * np.pi * frequency * self.time, left, base, projection)
        remaining = angle_spectrum(self.angle, beside, base, projection=projection, span=self._about(order))
        return bool(remaining.gain.max(initial=0.0) < OF_ITS_OWN * gain)

    def _about(self, order: float) -> tuple[float, float]:
        return order - self.period / 2, order + self.period / 2

    def _speed(self, part: float) -> float:
        """The speed below which the motor goes a part of its way."""
        order = np.argsort(self.speed)
        way = np.cumsum(self.speed[order])
        return max(float(self.speed[order[np.searchsorted(way, part * way[-1])]]), 1e-300) if len(way) else 1e-300


def per_turn(order: float, ratio: float) -> str:
    """How often a line repeats, for people: of a geared joint in both counts."""
    if ratio == 1.0:
        return f"{order:.4g} per turn"
    return f"{order:.4g} per turn of the motor, {order * ratio:.4g} of the joint"


def motor_angle(model: Model, motion: Motion, joint: int) -> MotorAngle:
    """Of a joint (0-based) along a motion."""
    use, ratio = motion.moving(joint), model.joints[joint].gear_ratio
    time = motion.row_time(joint).copy()
    starts = np.flatnonzero(np.diff(time, prepend=time[:1]) < 0)
    # What one recording says of the phase of a wave over the time, another does not know: any offset will do.
    for start in starts:
        time[start:] += time[start - 1] - time[start]
    return MotorAngle(
        ratio * motion.rows("q", joint)[joint][use],
        ratio * np.abs(motion.rows("qd", joint)[joint][use]),
        time[use],
        motion.cutoff(joint),
    )
