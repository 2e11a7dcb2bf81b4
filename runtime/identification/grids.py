"""Where the shape parameters of effects are looked for: grids over what a motion covers, orders of the lines over the
motor's angle, and places at which a torque sets in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf, nan

import numpy as np

from runtime.arrays import Array
from runtime.identification.regressors import Regressors
from runtime.model.loader import EffectInfo, Model
from runtime.model.terms import Term, Values, joints_of
from runtime.motion.motion import Motion
from runtime.motion.settings import LEAST_PERIODS, ROWS_OVER_CUTOFF
from runtime.motion.spectra import LombScargle, fitted_wave, lines, rayleigh_period
from symbolic.described import DescribedParameter, ParameterKind

# --- grids ---


def _span(regressors: Regressors, term: Term, of: str, known: Values) -> tuple[float, float]:
    """Offset and scale of a term's grid, whose low and high are in units of `of`; known: shape values chosen so far."""
    if of == "one":
        return 0.0, 1.0
    info, joints = regressors.model.library.effects[term.effect], joints_of(regressors.model, term)
    if info.gives_way or of == "line":
        joints = joints[:1]
    if of == "critical":
        inertia = max(_span(regressors, term, "link_inertia", known)[1], 0.0)
        return 0.0, 2 * float(np.sqrt(_of_kind(info, "stiffness", known) * inertia))
    if of == "end":
        start, span = _span(regressors, term, "position", known)
        return (start + span, -span) if _of_kind(info, "side", known) > 0 else (start, span)
    key = (of, joints)
    if key not in regressors.extents:
        regressors.extents[key] = _extent(regressors, of, joints)
    offset, scale = regressors.extents[key]
    return known[info.line.name] if of == "line" and info.line else offset, scale


def _extent(regressors: Regressors, of: str, joints: tuple[int, ...]) -> tuple[float, float]:
    """Offset and scale from what some joints (0-based) do over the motion."""
    pieces = regressors.motion.pieces_of(joints[0])
    if of == "line":
        return nan, motor_angle(regressors.model, regressors.motion, joints[0]).period
    if of == "duration":
        return 0.0, max(float(p.t[-1]) for p in pieces)
    if of == "elapsed":
        return 0.0, max(p.began + float(p.t[-1]) for p in pieces)
    if of == "rate":
        return 0.0, max(float(np.abs(p.qd[list(joints)]).max()) for p in pieces)
    if of in ("position", "tip"):
        values = _everywhere(regressors, "q" if of == "position" else "tip_y", joints)
        return float(values.min()), float(np.ptp(values))
    if of == "range":
        return 0.0, float(np.ptp(_everywhere(regressors, "q", joints)))
    if of == "link_inertia":
        return 0.0, float(np.median(_everywhere(regressors, of, joints)))
    if of == "level_per_range":
        level = float(np.max(_everywhere(regressors, "level", joints)))
        return 0.0, level / float(np.ptp(_everywhere(regressors, "q", joints)))
    return 0.0, float(np.max(np.abs(_everywhere(regressors, of, joints))))


def _of_kind(info: EffectInfo, kind: ParameterKind, values: Values, default: float = nan) -> float:
    parameter = info.of_kind(kind)
    return default if parameter is None else values.get(parameter.name, default)


def _everywhere(regressors: Regressors, signal: str, joints: tuple[int, ...]) -> Array:
    return np.concatenate([np.atleast_1d(s.at(signal, i)) for i in joints for s in regressors.signals(i)])


def axis(regressors: Regressors, term: Term, parameter: DescribedParameter, known: Values) -> Array:
    """Grid values of one shape parameter, ascending; `known` holds the shape parameters declared before it."""
    grid = parameter.grid
    if grid is None:
        raise ValueError(f'{term}: shape parameter "{parameter.name}" has no grid')
    offset, scale = _span(regressors, term, grid.of, known)
    spaced = np.geomspace if grid.spacing == "log" else np.linspace
    values = offset + scale * spaced(grid.low, grid.high, grid.count)
    return np.sort(np.append(values, _breaks(regressors)) if parameter.kind == "onset" else values)


def _breaks(regressors: Regressors) -> list[float]:
    """s since a recording began, halfway between two of its pieces: where a run or a gap ends."""
    pieces = regressors.motion.pieces
    return [
        (one.began + float(one.t[-1]) + other.began + float(other.t[0])) / 2
        for one, other in pairwise(pieces)
        if one.recording == other.recording
    ]


OF_PLACES = ("position", "end", "tip")
"""Grids over a range of places."""


def searchable(parameter: DescribedParameter, values: Array) -> bool:
    """Whether an axis has an extent: not at a joint that is held, nor where a negative fitted inertia gives a negative
    scale of a stiffness."""
    low, high = float(values[0]), float(values[-1])
    logarithmic = parameter.grid is not None and parameter.grid.spacing == "log"
    return bool(np.isfinite([low, high]).all()) and low < high and not (logarithmic and low <= 0)


def slope_range(regressors: Regressors, term: Term, name: str, known: Values) -> tuple[float, float] | None:
    """Where a shape parameter is sought along derivatives of the torque; None where these lead nowhere: over a gap,
    over places at which a torque sets in, and without an extent."""
    info = regressors.model.library.effects[term.effect]
    parameter = info.parameter(name)
    if info.has_gap or parameter.grid is None or parameter.grid.of in OF_PLACES:
        return None
    values = axis(regressors, term, parameter, known)
    return (float(values[0]), float(values[-1])) if searchable(parameter, values) else None


def points(regressors: Regressors, term: Term, orders: Array | None = None) -> list[Values]:
    """All combinations of the shape parameters' grid values; one empty choice for a term without shape.

    orders   of lines over the motor's angle, for an effect that is one; None: all over what the motion shows
    Empty if the data give the grid no scale (no link inertia for an elasticity, no friction for bristles).
    """
    found: list[Values] = [{}]
    # Sides first: where a place is looked for depends on them.
    info = regressors.model.library.effects[term.effect]
    for parameter in sorted(info.shape, key=lambda p: p.grid is not None and p.grid.continuous):
        if parameter is info.line:
            if orders is None:
                joint = joints_of(regressors.model, term)[0]
                orders = motor_angle(regressors.model, regressors.motion, joint).spread()
            found = [{**v, parameter.name: float(x)} for v in found for x in orders]
        else:
            found = [{**v, parameter.name: float(x)} for v in found for x in axis(regressors, term, parameter, v)]
    usable = [v for v in found if all(np.isfinite(x) for x in v.values())]
    return [
        v
        for v in usable
        if _of_kind(info, "begin", v, -inf) <= _of_kind(info, "end", v, inf) and _of_kind(info, "stiffness", v, 1.0) > 0
    ]


def edge_distance(regressors: Regressors, term: Term, shape: Values) -> float:
    """Distance of a shape from the nearer end of its grid, as a part of the range; infinite for a term whose shape has
    no place.

    Only the first continuous parameter counts, which places the effect; an end of the others' grids (a damping too
    small to matter) is a valid value.
    """
    places = (p for p in regressors.model.library.effects[term.effect].shape if p.grid and p.grid.continuous)
    parameter = next(places, None)
    if parameter is None or parameter.grid is None:
        return inf
    values = axis(regressors, term, parameter, shape)
    ends = np.array([values[0], shape[parameter.name], values[-1]])
    x = np.log(np.maximum(ends, 1e-300)) if parameter.grid.spacing == "log" else ends
    return float(min(x[1] - x[0], x[2] - x[1]) / (x[2] - x[0]))


def within(regressors: Regressors, term: Term, shape: Values) -> bool:
    """Whether every shape parameter lies within its grid."""
    for parameter in regressors.model.library.effects[term.effect].shape:
        values = axis(regressors, term, parameter, shape)
        slack = 1e-9 * abs(float(values[-1] - values[0]))
        if not values[0] - slack <= shape[parameter.name] <= values[-1] + slack:
            return False
    return True


# --- lines over the motor's angle ---


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
        return rayleigh_period(self.angle)

    @property
    def span(self) -> tuple[float, float]:
        """Lowest order with enough periods in the motion, and the highest that is in the band while it is slow."""
        # It is in the band on a tenth of the rows: enough for its order and its amplitude.
        # Rows of exact rest, which only prescribed motions have, are in no band.
        turning = self.speed[self.speed > 0.0]
        slow = float(np.quantile(turning, 0.1)) if len(turning) else 0.0
        return LEAST_PERIODS * self.period, 2 * np.pi * self.cutoff / max(slow, 1e-300)

    def spread(self) -> Array:
        """Orders evenly over the logarithm of the span; none if it is empty."""
        low, high = self.span
        return np.geomspace(low, high, 12) if low < high else np.empty(0)

    def with_turns(self, orders: Array) -> Array:
        """Some orders, and once and twice a turn of the motor, where the span holds these and none of them is near.

        A motor that is fast beside a narrow band shows a line on few of its rows only, too few to stand out among all
        orders; these two nearly every drive has (unbalance and eccentricity, a strain wave's two lobes).
        Source: Tuttle & Seering, A nonlinear model of a harmonic drive gear transmission, IEEE Trans. Robotics and
        Automation 12, 1996.
        """
        low, high = self.span
        new = [x for x in (1.0, 2.0) if low < x < high and not np.any(np.abs(orders - x) < 2 * self.period)]
        return np.append(orders, new)

    def lines(self, left: Array, base: Array, projection: Array) -> tuple[Array, int]:
        """Orders (L,) of waves over the angle that stand out of a residual, the strongest first, and the number of
        orders among which they do; left (M,), base (B, M) and projection (B, B) as for `LombScargle.of`.

        A line that a wave over the time explains better is not the motor's.
        """
        low, high = self.span
        if not low < high:
            return np.empty(0), 1
        among = max(2, round((high - low) / self.period))
        octaves = low * 2 ** np.arange(np.ceil(np.log2(high / low)) + 1)
        found: dict[float, float] = {}
        for start, stop in pairwise(np.minimum(octaves, high)):
            # Where the motor is too fast, an order lies in the stop-band, and the rows hold nothing of it.
            slow = self.speed * start < 2 * np.pi * (ROWS_OVER_CUTOFF / 2) * self.cutoff
            part = replace(self, angle=self.angle[slow], speed=self.speed[slow], time=self.time[slow])
            rows = left[slow], base[:, slow], projection
            found |= part._without_waves_over_time(lines(part.angle, *rows, (start, stop), among), *rows)
        # The rest may be shadows of these, and comes up again once they are in the model.
        strongest = sorted(found, key=lambda order: -found[order])[:6]
        return np.array(strongest), among

    def _without_waves_over_time(
        self, found: Mapping[float, float], left: Array, base: Array, projection: Array
    ) -> dict[float, float]:
        """Those of some lines, order and gain, that no wave over the time explains better, of a frequency through which
        the order sweeps, unless half of the line remains beside it."""
        if not found:
            return {}
        margin = LEAST_PERIODS / max(float(np.ptp(self.time)), 1e-300)
        slow, fast = (self._speed(part) / (2 * np.pi) for part in (0.02, 0.98))
        swept = min(found) * slow - margin, max(found) * fast + margin
        over_time = LombScargle.of(2 * np.pi * self.time, base, projection, swept).spectrum(left)
        kept = {}
        for order, gain in found.items():
            frequency, more = over_time.strongest(order * slow - margin, order * fast + margin)
            if more >= gain:
                beside = left - fitted_wave(2 * np.pi * frequency * self.time, left, base, projection)
                about = order - self.period / 2, order + self.period / 2
                remaining = LombScargle.of(self.angle, base, projection, about).spectrum(beside)
            if more < gain or remaining.gain.max(initial=0.0) >= gain / 2:
                kept[order] = gain
        return kept

    def _speed(self, part: float) -> float:
        order = np.argsort(self.speed)
        way = np.cumsum(self.speed[order])
        return max(float(self.speed[order[np.searchsorted(way, part * way[-1])]]), 1e-300) if len(way) else 1e-300


def motor_angle(model: Model, motion: Motion, joint: int) -> MotorAngle:
    """The motor's angle of a joint (0-based) along a motion."""
    use, ratio = motion.moving(joint), model.joints[joint].gear_ratio
    time = motion.row_time(joint).copy()
    starts = np.flatnonzero(np.diff(time, prepend=time[:1]) < 0)
    # The phase of a wave over the time is unknown between recordings: any offset will do.
    for start in starts:
        time[start:] += time[start - 1] - time[start]
    return MotorAngle(
        ratio * motion.rows("q", joint)[joint][use],
        ratio * np.abs(motion.rows("qd", joint)[joint][use]),
        time[use],
        motion.cutoff(joint),
    )
