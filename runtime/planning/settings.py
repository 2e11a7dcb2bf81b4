"""Every limit of scenarios and trajectories, with its unit, its reason and its source."""

from __future__ import annotations

from typing import Final

SHORTEST_CYCLE: Final = 0.01
"""s; ten steps of a controller at 1 kHz, of which no arm makes a motion; a choice."""

SHORTEST_PHASE: Final = 1e-6
"""s; a thousandth of a control period at 1 kHz: nothing is executed in it, and its accelerations are numbers; a
choice."""

LONGEST_CYCLE: Final = 3600.0
"""s; of a motion, an hour: its polynomials are evaluated a thousand times a second; a choice."""

MOST_PHASES: Final = 1000
"""number of phases; each is a polynomial that somebody chose, and sent to a board one by one; a choice."""

MOST_BYTES: Final = 20_000_000
"""length in bytes; of a trajectory's file: MOST_PHASES of seven joints with MAX_POINTS numbers of 24 letters are 5 MB;
a choice."""

LEAST_POSITION_EXCESS: Final = 5e-4
"""part of the larger end of a joint's range: what a plan goes beyond it by less is let pass. A program keeps limits at
its nodes, and between them a position that touches one goes 3e-5 of it further; a milliradian is far from where an arm
is stopped; a choice."""

LEAST_SPEED_EXCESS: Final = 5e-3
"""part of a joint's speed limit; the same of rates, which bend more between nodes; a choice."""

LEAST_TORQUE_EXCESS: Final = 5e-3
"""part of a joint's torque limit; the same of torques, which friction and springs give kinks; a choice."""

MOST_TIGHTENINGS: Final = 6
"""number of times that a plan is sought again, held further within the limits where it went beyond them between nodes;
two are enough where a limit can be kept; a choice."""
