"""Limits of scenarios and trajectories, and the options of an optimization; --help imports this."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from runtime.setting import SearchSettings, Setting

SHORTEST_CYCLE: Final = 0.01
"""s; ten steps of a controller at 1 kHz, too short for any motion of an arm; a choice."""

SHORTEST_PHASE: Final = 1e-6
"""s; a thousandth of a control period at 1 kHz, so that nothing is executed in it; a choice."""

LONGEST_CYCLE: Final = 3600.0
"""s; an hour, in which a controller evaluates the polynomials 3.6 million times; a choice."""

MOST_PHASES: Final = 1000
"""number of phases; each is sent to a board by itself; a choice."""

MOST_BYTES: Final = 20_000_000
"""length in bytes; of a trajectory file: MOST_PHASES of seven joints with MAX_POINTS numbers of 24 characters are 5 MB;
a choice."""

LEAST_POSITION_EXCESS: Final = 5e-4
"""part of the larger end of a joint's range; a smaller excess of a plan is allowed. A program keeps limits at nodes;
between them a position goes 3e-5 of it further, and a milliradian is far from where an arm is stopped; a choice."""

LEAST_SPEED_EXCESS: Final = 5e-3
"""part of a joint's speed limit; likewise for speeds, which vary more between nodes; a choice."""

LEAST_TORQUE_EXCESS: Final = 5e-3
"""part of a joint's torque limit; likewise for torques, which have kinks from friction and springs; a choice."""

MOST_TIGHTENINGS: Final = 6
"""number of times that a plan is computed again with tighter limits where it exceeds them between nodes; where a limit
can be kept, two are enough; a choice."""

Starts = Annotated[int | None, Setting("Number of random first guesses; default: few.", 1, 10_000)]


@dataclass(frozen=True)
class PlanningSettings(SearchSettings):
    """Options of the search. starts: None for one, or four where points of the end-effector leave postures free."""

    starts: Starts = None
    seed: Annotated[int, Setting("Seed of the first guesses.", low=0)] = 0
