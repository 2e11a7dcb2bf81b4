"""How the recursion is laid out: along whose axes each link is written, and which base parameters are kept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from symbolic.rigid_body.exact_rank import Column
from symbolic.rigid_body.spatial.base_parameters import ROTOR, Merging, merging
from symbolic.rigid_body.spatial.counting import OperationCounter
from symbolic.rigid_body.spatial.geometry import Geometry
from symbolic.rigid_body.spatial.moments import Moments
from symbolic.rigid_body.spatial.recursion import groups, motion, torques


@dataclass(frozen=True)
class SpatialLayout:
    """axes: see recursion.motion; merged: the base parameters."""

    axes: tuple[int, ...]
    merged: Merging


def choose_layout(g: Geometry) -> SpatialLayout:
    """The layout whose inverse dynamics count fewest operations, as far as single changes of the axes lead.

    Masses are no base parameters of revolute links: one that is kept saves the recursion one operation in a hundred,
    and D and forward dynamics, where it is carried through all composites, lose several.
    """
    best = SpatialLayout(tuple(range(g.n)), merging(g))
    # Of those that one change led to, most are led to by the next one again: none of them costs less.
    least, tried, improved = _cost(g, best), {best.axes}, True
    while improved:
        improved = False
        for layout in (other for other in _other_axes(g, best) if other.axes not in tried):
            tried.add(layout.axes)
            cost = _cost(g, layout)
            if cost < least:
                best, least, improved = layout, cost, True
                break
    return best


def _other_axes(g: Geometry, layout: SpatialLayout) -> Iterator[SpatialLayout]:
    """Consecutive links of a group along other axes of it."""
    for group in groups(g):
        for first in group:
            for last in range(first, group[-1] + 1):
                for axes in range(group[0] - 1, group[-1] + 1):
                    chosen = (*layout.axes[:first], *[axes] * (last + 1 - first), *layout.axes[last + 1 :])
                    if chosen != layout.axes:
                        yield replace(layout, axes=chosen)


def moments_of(values: Mapping[Column, Any], n: int) -> tuple[list[Moments], list[Any]]:
    """The links' moments and the joints' rotors, all 0 but for `values`."""
    moments = [Moments(**{kind: x for (kind, j), x in values.items() if j == i and kind != ROTOR}) for i in range(n)]
    return moments, [values.get((ROTOR, i), 0) for i in range(n)]


def _cost(g: Geometry, layout: SpatialLayout) -> int:
    counter = OperationCounter()
    chain = g.over(lambda x: x, [rest if rest == 0 else counter.leaf(f"rest{i}") for i, rest in enumerate(g.rests)])

    def leaves(name: str) -> Sequence[Any]:
        return [counter.leaf(f"{name}{i}") for i in range(g.n)]

    qdd = leaves("qdd")
    moments, rotors = moments_of({c: counter.leaf(str(c)) for c in layout.merged.kept}, g.n)
    moving = motion(chain, layout.axes, leaves("q"), leaves("qd"), qdd, counter)
    return counter.count(torques(chain, moments, rotors, moving, qdd, counter)).cost
