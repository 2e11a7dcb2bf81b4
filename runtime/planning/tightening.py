"""Limits that a motion keeps between the nodes of its program, too: there its nodes are held further within them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from runtime.planning.limits import Along
from runtime.planning.program import Program, quadrature
from runtime.planning.solve import Bounds
from runtime.planning.task import limit_label

Array = NDArray[np.float64]

_MOST = 0.25
"""Of what is between a row's bounds: by how much they move at once, so that they never meet."""


def tightened(program: Program, bounds: Bounds, t: Array, beyond: Sequence[Along]) -> Bounds:
    """Bounds of the program's rows, moved inwards at the nodes on either side of every instant at which the motion goes
    beyond a limit, by as much as it does.

    t   (N,) s, at which the quantities that go beyond are given
    """
    lower, upper = (part.copy() for part in bounds)
    begin, first = 0.0, 0
    for k, plan in enumerate(program.task.scenario.phases):
        block = program.blocks[k]
        rows = slice(first, first + block.lower.size)
        low, high = (part[rows].reshape(block.lower.shape) for part in (lower, upper))
        labels = [what for what, _ in block.expression.labels]
        end = begin + program.task.scenario.cycle_time * plan.part
        nodes = begin + (end - begin) * quadrature(program.nodes(plan.degree))[0]
        for along in beyond:
            if (label := limit_label(along.what, along.joint)) in labels:
                row = labels.index(label)
                room = _MOST * (high[:, row] - low[:, row])
                low[:, row] += np.minimum(_about(nodes, begin, end, t, along.low - along.x), room)
                high[:, row] -= np.minimum(_about(nodes, begin, end, t, along.x - along.high), room)
        begin, first = end, rows.stop
    return lower, upper


def _about(nodes: Array, begin: float, end: float, t: Array, excess: Array) -> Array:
    """(nodes,) The largest excess (N,), no less than none, at times t between the nodes before and after each."""
    edges = np.concatenate([[begin], nodes, [end]])
    # Between one edge and the next: each time belongs to one such gap, and each node to two.
    here = (t >= begin) & (t <= end)
    gap = np.clip(np.searchsorted(edges, t[here], side="right") - 1, 0, len(nodes))
    largest = np.zeros(len(nodes) + 1)
    np.maximum.at(largest, gap, excess[here])
    found: Array = np.maximum(largest[:-1], largest[1:])
    return found
