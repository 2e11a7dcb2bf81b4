"""Where the numbers of a program stand: what is sought in x, what one solution may change from the next in p."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from runtime.planning.scenario import Scenario

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Parameters:
    """The vector p of a program by name: what changes from one solution to the next without a new program."""

    symbol: ca.SX
    place: Mapping[str, slice]

    @classmethod
    def of(cls, sizes: Mapping[str, int]) -> Parameters:
        """Symbols for parameters of these sizes, one behind the other."""
        ends = np.cumsum([0, *sizes.values()])
        place = {name: slice(int(a), int(b)) for name, (a, b) in zip(sizes, pairwise(ends), strict=True)}
        return cls(ca.SX.sym("p", int(ends[-1])), place)

    def __call__(self, name: str) -> ca.SX:
        return self.symbol[self.place[name]]

    def vector(self, values: Mapping[str, Sequence[float]]) -> Array:
        """(P,) numbers of all parameters; NaN where nothing stands for one."""
        found = np.full(self.symbol.numel(), np.nan)
        for name, place in self.place.items():
            found[place] = values[name]
        return found


@dataclass(frozen=True)
class Unknowns:
    """Where the unknowns stand in x: control points phase by phase and coordinate by coordinate, springs, the peak.

    free   by phase: coordinates (0-based) that are sought; the others are constant
    """

    scenario: Scenario
    free: tuple[tuple[int, ...], ...]

    @cached_property
    def _starts(self) -> list[int]:
        sizes = [len(free) * (p.degree + 1) for free, p in zip(self.free, self.scenario.phases, strict=True)]
        return np.cumsum([0, *sizes]).tolist()

    def points(self, phase: int, row: int) -> slice:
        """Control points of the row-th free coordinate of a phase."""
        count = self.scenario.phases[phase].degree + 1
        first = self._starts[phase] + row * count
        return slice(first, first + count)

    @property
    def motion(self) -> int:
        """How many are those of the motion: springs and the peak follow."""
        return self._starts[-1]

    def spring(self, k: int) -> slice:
        """What is sought of the k-th spring, in its parameters' scales."""
        first = self._starts[-1] + sum(self.spring_sizes[:k])
        return slice(first, first + self.spring_sizes[k])

    @cached_property
    def spring_sizes(self) -> tuple[int, ...]:
        """How many unknowns each spring has."""
        return tuple(len(spring.sought) for spring in self.scenario.springs)

    @property
    def peak(self) -> int:
        """The largest torque over its limit, where the objective is that."""
        return self._starts[-1] + sum(self.spring_sizes)

    @cached_property
    def size(self) -> int:
        """Number of unknowns."""
        return self.peak + (self.scenario.objective.goal == "peak_torque")
