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

MOST_PLANS: Final = 4
"""number of motions; that are tried for the same rivals: the shortest, the plainest, the best and the surest; by
construction."""

# possible arms ------------------------------------------------------------------------------------------------------

BODY_SPREAD: Final = 0.1
"""ratio; standard deviation of stated masses and lengths of bodies: CAD without cables, screws and grease; a choice."""

ASSUMED_SPREAD: Final = 0.5
"""unit of the logarithm; standard deviation of an assumed rotor inertia: two of them are a factor of 2.7; a choice."""

FARTHEST: Final = 2.5
"""standard deviations; no factor is farther from 1: an arm whose friction is a tenth of the usual is another arm; a
choice."""

FRICTION_SPREAD: Final = 0.4
"""unit of the logarithm; standard deviation of an effect's torque: friction differs by so much between two arms of a
kind, and with temperature; a choice."""

SPREAD_DRAWS: Final = 400
"""number of arms; from which the spread of base parameters is computed: ten for each of 40 parameters; a choice."""

# a first motion -----------------------------------------------------------------------------------------------------

CORNER_RATE: Final = 0.02
"""rad/s, m/s; half width of the smoothed sign of dry friction while a motion is sought; a reversal lasts as long; a
choice."""

ROWS_A_SECOND: Final = 40.0
"""rows; independent ones of a joint in a second: twice the usual cutoff; a choice."""

SURE_SPREADS: Final = 3.5
"""standard deviations; of the torque of possible arms above the likeliest arm's, which a motion is kept below; one of
10,000 draws lies beyond; a choice."""

SPEEDING_UP: Final = 0.3
"""s; from rest to a joint's largest speed; robots' controllers take 0.2 to 0.5 s; a choice."""

FARTHEST_REACH: Final = 1.5
"""rad, m; from the start pose of a first motion where no range is given: cables and hoses are rarely made for
turns; a choice."""

POSSIBLE_ARMS: Final = 200
"""number of arms; drawn for a motion; a choice."""

SHAPES_EVERY: Final = 40
"""samples; at 1 kHz between two checks of collision shapes: a tip moves by 60 mm; time."""

LEAST_TORQUE: Final = 1e-9
"""N m, N; of a joint in the noise: one that rests has none; double precision; by construction."""

UNSTATED_TORQUE: Final = 1.5
"""ratio; the largest torque where the file states none, to that of a random Fourier motion; a choice."""

PERIOD: Final = 10.0
"""s; of the Fourier motion: five times as many oscillations a minute tell no more, and slower ones move too little; a
choice."""

FASTEST_HARMONIC: Final = 2.0
"""Hz; of the Fourier motion: below the lowest resonances of arms, and above what limits of acceleration leave; a
choice."""

SAMPLES_A_PERIOD: Final = 200
"""number of samples; of the Fourier motion in the search: ten of its fastest oscillation; a choice."""

STARTS: Final = 4
"""number of random motions; from which the search begins: the best of four is within half a nat of the best of twenty;
simulated UR10."""

FOURIER_PART: Final = 0.5
"""part of the whole length; left to the Fourier motion; a choice."""

LADDER: Final = (0.01, 1.0, 8)
"""parts of the largest speed: from, to, how many; over two decades, as friction maps are; a choice."""

LEAST_LADDER: Final = 3
"""number of speeds; of a ladder for which there is little time: slow, middling, fast; a choice."""

LEG: Final = 0.8
"""s; at each speed of the ladder from the middle to a turn and back; five time constants of the band's filters; a
choice."""

STATIONS: Final = 5
"""number of poses; at which all joints are held; a choice."""

HELD_FOR: Final = 1.0
"""s; at each of them; a choice."""

LONGEST_PASS: Final = 15.0
"""s; of slow passes over a part of the range and back; a choice."""

PASS_CORNER: Final = 0.5
"""s; over which the corners of slow passes are rounded; a choice."""

CHECK_RATE: Final = 200.0
"""Hz; at which a motion is checked: a hundred samples of its fastest oscillation; a choice."""

TRANSFER_LEAST: Final = 0.5
"""s; of the way between two poses; a choice."""

PENALTIES: Final = (1e3, 1e4, 1e5)
"""numbers; weights, in nats, of squared parts of limits that a motion exceeds, one search after another: the first
finds the way, the last ends within a percent of the limits; a choice."""

STEPS_A_PENALTY: Final = 150
"""number of steps; of the search with each weight; the information changes by less than a nat afterwards; a choice."""

SOFT: Final = 0.02
"""unit, m; above the margins; there a distance begins to cost; a choice."""

SMALLER_BY: Final = 0.98
"""ratio; one step of a motion that is made smaller to keep to all limits; a choice."""

SMALLEST: Final = 0.05
"""ratio; no motion is made smaller than by this; a choice."""

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

REACH_TO_RADIUS: Final = 0.05
"""ratio; of a link's radius to the length of the chain where no inertia is stated: a UR10 has 0.043, a Panda 0.06, an
SO-100 0.06; arms' drawings."""

TRUSTED_MEDIAN: Final = (0.75, 1.5)
"""ratios; to that radius: where the median of an arm's radii from inertias ends; a UR10 has 0.9, a Panda 1.5; a
choice."""

TRUSTED_RADIUS: Final = (0.75, 1.25)
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

# motions for other programs -----------------------------------------------------------------------------------------

AT_START: Final = 0.01
"""rad, m; within which every joint stands where a URScript's motion starts; below what a joint moves in a period of
servoj at full speed; a choice."""

STOPPING: Final = 2.0
"""rad/s, m/s; per second, of the stop at a URScript's end; the default of stopj."""

NORMALISED: Final = 100.0
"""parts of a hundred; LeRobot's positions of a motor go from minus this to this over its range; its documentation."""
