"""Where the shape parameters of effects are looked for, given what a motion covers."""

from __future__ import annotations

from itertools import pairwise
from math import inf, nan

import numpy as np
from numpy.typing import NDArray

from runtime.identification.regressors import Regressors
from runtime.identification.settings import GRID_EDGE
from runtime.identification.torque_lines import motor_angle
from runtime.model.loader import EffectInfo
from runtime.model.terms import Term, Values, joints_of
from symbolic.described import DescribedParameter, ParameterKind

Array = NDArray[np.float64]


def _span(regressors: Regressors, term: Term, of: str, known: Values) -> tuple[float, float]:
    """Offset and scale by which a grid's low and high are read for this term; `known`: values chosen so far."""
    if of == "one":
        return 0.0, 1.0
    joints = joints_of(regressors.model, term)
    info = regressors.model.library.effects[term.effect]
    if info.gives_way:
        joints = joints[:1]
    if of == "line":
        return known[info.line.name] if info.line else nan, period(regressors, term)
    if of == "critical":
        inertia = max(_span(regressors, term, "link_inertia", known)[1], 0.0)
        return 0.0, 2 * float(np.sqrt(_of_kind(info, "stiffness", known) * inertia))
    if of == "end":
        start, span = _span(regressors, term, "position", known)
        return (start + span, -span) if _of_kind(info, "side", known) > 0 else (start, span)
    key = (of, joints)
    if key not in regressors.extents:
        regressors.extents[key] = _extent(regressors, of, joints)
    return regressors.extents[key]


def period(regressors: Regressors, term: Term) -> float:
    """Order of one period over the whole motion of the term's joint."""
    key = ("period", joints_of(regressors.model, term)[:1])
    if key not in regressors.extents:
        regressors.extents[key] = 0.0, motor_angle(regressors.model, regressors.motion, key[1][0]).period
    return regressors.extents[key][1]


def _extent(regressors: Regressors, of: str, joints: tuple[int, ...]) -> tuple[float, float]:
    pieces = regressors.motion.pieces_of(joints[0])
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
    """The value of the parameter of a kind; the default where the effect has none or it has no value."""
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


def searchable(parameter: DescribedParameter, values: Array) -> bool:
    """Whether there is something between the ends of an axis: not at a joint that is held, nor where a fitted inertia
    below zero turns the scale of a stiffness over."""
    low, high = float(values[0]), float(values[-1])
    logarithmic = parameter.grid is not None and parameter.grid.spacing == "log"
    return bool(np.isfinite([low, high]).all()) and low < high and not (logarithmic and low <= 0)


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
            own = spread(regressors, term) if orders is None else orders
            found = [{**v, parameter.name: float(x)} for v in found for x in own]
        else:
            found = [{**v, parameter.name: float(x)} for v in found for x in axis(regressors, term, parameter, v)]
    usable = [v for v in found if all(np.isfinite(x) for x in v.values())]
    return [
        v
        for v in usable
        if _of_kind(info, "begin", v, -inf) <= _of_kind(info, "end", v, inf) and _of_kind(info, "stiffness", v, 1.0) > 0
    ]


def spread(regressors: Regressors, term: Term) -> Array:
    """Orders all over what the motion of the term's joint shows."""
    joint = joints_of(regressors.model, term)[0]
    return motor_angle(regressors.model, regressors.motion, joint).spread()


def at_edge(regressors: Regressors, term: Term, shape: Values) -> bool:
    """Whether the shape sits at an end of what was searched, where a search proves nothing.

    Only the first that is no choice of sides counts: it places the effect; the others round it off, and an end of
    their grid (a damping too small to matter) is as good an answer as any.
    """
    places = (p for p in regressors.model.library.effects[term.effect].shape if p.grid and p.grid.continuous)
    parameter = next(places, None)
    if parameter is None or parameter.grid is None:
        return False
    values = axis(regressors, term, parameter, shape)
    ends = np.array([values[0], shape[parameter.name], values[-1]])
    x = np.log(np.maximum(ends, 1e-300)) if parameter.grid.spacing == "log" else ends
    return bool(x[1] - x[0] < GRID_EDGE * (x[2] - x[0]) or x[2] - x[1] < GRID_EDGE * (x[2] - x[0]))


def within(regressors: Regressors, term: Term, shape: Values) -> bool:
    """Whether every shape parameter lies on its grid's stretch."""
    for parameter in regressors.model.library.effects[term.effect].shape:
        values = axis(regressors, term, parameter, shape)
        slack = 1e-9 * abs(float(values[-1] - values[0]))
        if not values[0] - slack <= shape[parameter.name] <= values[-1] + slack:
            return False
    return True
