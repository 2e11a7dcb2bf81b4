"""Every number by which an experiment is chosen and confirmed, with its unit, its reason and its source.

Where the source says "a choice", the number was set by hand, so that the experiments of the tests are short and their
diagnoses right. The motions themselves are in pieces.py.
"""

from __future__ import annotations

from typing import Final

# the bench ----------------------------------------------------------------------------------------------------------

ORDINARY_SECONDS: Final = 40.0
"""s; the ordinary excitation on which rivals are tried first: what a user records; a choice."""

ORDINARY_REPEATS: Final = 2
"""number of times; the motion comes back once within those seconds, for a floor from repeats; by construction."""

EXACT: Final = 1e-4
"""part of a torque; no law is known better, and sums of squares are hardly; a choice."""

TRIAL_SEEDS: Final = (1, 2)
"""numbers beside the user's seed; of the noise of the recordings on which a motion must hold; time."""

SAME_ANSWER: Final = 2
"""number of motions; where a stronger one ends in the same wrong answer, it is not the motion that stands in the way:
no further one is tried; time."""

# possible arms ------------------------------------------------------------------------------------------------------

BODY_SPREAD: Final = 0.2
"""ratio; standard deviation of stated masses and lengths of bodies: CAD without cables, screws and grease; a choice."""

ASSUMED_SPREAD: Final = 0.7
"""unit of the logarithm; standard deviation of an assumed rotor inertia: a factor of two; a choice."""

FRICTION_SPREAD: Final = 0.5
"""unit of the logarithm; standard deviation of an effect's torque: friction differs by so much between two arms of a
kind, and with temperature; a choice."""

SPREAD_DRAWS: Final = 400
"""number of arms; from which the spread of base parameters is computed: ten for each of 40 parameters; a choice."""

# what is enough -----------------------------------------------------------------------------------------------------

SURE: Final = 8.0
"""standard deviations; by so many a rival must miss the truth: a likelihood ratio well beyond chance; a choice."""

VISIBLE: Final = 0.3
"""noise floors; so much a rival must leave of its own beside the base model; twice what a diagnosis asks for."""

NEAR_BEST: Final = 0.7
"""part of the best separation; of the motions that reach it the shortest is taken; a choice."""

# how a motion is composed -------------------------------------------------------------------------------------------

LEAST_SECONDS: Final = 24.0
"""s; a shorter motion is repeated: below, cross-validation has too little to hold out; a choice."""

LEAST_TIMES: Final = 2
"""number of times; a motion that comes back gives a floor, and friction that changes with time shows; by
construction."""

MOST_PIECES: Final = 4
"""number of pieces; a choice does not grow beyond; a user's patience."""

ORDINARY_PIECE_SECONDS: Final = 16.0
"""s; the ordinary excitation as one piece among others; a choice."""

PAUSE: Final = 0.4
"""s; at rest between pieces: long against the filters; by construction."""

CORNER_S: Final = 0.05
"""s; over which a corner is rounded, twice, so that no torque jumps; a choice."""

# how large and how fast ---------------------------------------------------------------------------------------------

SMALLER: Final = (1.0, 0.75, 0.5, 0.3)
"""parts of the range; tried from the largest to the smallest until the torques allow it; a choice."""

SLOWER: Final = 0.8
"""ratio of speeds; one step slower where a piece asks for too much torque; a choice."""

SLOWINGS: Final = 8
"""number of steps; down to a sixth of the speed; a choice."""

MEMORY_TORQUE: Final = 2.0
"""ratio to the torque on the ordinary excitation; so much a rival with a memory may ask for where no limit is stated,
lest it be driven into resonance; a choice."""

# what the arm must not touch ----------------------------------------------------------------------------------------

SURROUNDINGS_MARGIN: Final = 0.05
"""length; kept from floor and boxes: a tape measure, a tracking error, and the mount's tilt; a choice."""

LINK_MARGIN: Final = 0.02
"""length; kept between links: their places are known better than the room's; a choice."""

REACH_TO_RADIUS: Final = 0.06
"""ratio; of a link's radius to the length of the chain where no inertia is stated: a UR10 has 0.043, a Panda 0.06, an
SO-100 0.07; arms' drawings."""

TRUSTED_MEDIAN: Final = (0.5, 1.5)
"""ratios; to that radius: where the median of an arm's radii from inertias ends; a UR10 has 0.8, a Panda 1.2; a
choice."""

TRUSTED_RADIUS: Final = (0.75, 1.5)
"""ratios; to that median: identified inertias may be impossible and give a link any radius, so it ends here; a
choice."""

PARALLEL_AXES: Final = 1e-3
"""rad, m; sine of the angle below which two axes have no direction of their own between them; rounding of files."""

SAMPLED_POSES: Final = 300
"""number of poses; within the limits, at all of which two parts of one housing are close; time."""

FREE_RANGE: Final = 3.2
"""rad, m; to either side of 0, of a joint without limits in those poses: half a turn and more; by construction."""

OPEN_END: Final = 10.0
"""length; from the base, where a box ends of which one end is left out: beyond any arm's reach; a choice."""

BISECTIONS: Final = 30
"""number of halvings; of a segment, to the point nearest to a box: a billionth of its length; by construction."""
