"""Every number on which a verdict rests, with its unit, its reason and its source.

Where the source says "development recordings", the number was set by hand on simulated recordings with development
seeds (tests/judge), for verdicts and not by a derivation; tests/benchmarks/test_thresholds.py shows what halving and
doubling it does. "Trial of a method" is one on 15 effects in a joint, 45 recordings with and 44 without a hidden
effect, before this program. "By construction" says that another number would contradict how the thing is built.
"""

from __future__ import annotations

from typing import Final

# the comparison of candidates ---------------------------------------------------------------------------------------

STRETCHES: Final = 40
"""number of stretches of time over which a term's score is summed; so many give its variance to a quarter (2/40)^(1/2);
a choice."""

TIED: Final = 3
"""rows; the shortest stretch of a residual that is not whitened: a period of the band's end, within which rows hang
together; sampling theorem."""

LEAST_PRICE: Final = 10.0
"""natural logarithm; a term's score must exceed it however little was searched; clean recordings of four joints reach
9."""

SHOWN_ALIKE: Final = 2.0
"""ratio; a transmission's value that a fit to the torque moves further from what its encoders show stands for something
else there; a choice."""

# rivals -------------------------------------------------------------------------------------------------------------

ALIKE: Final = 5.0
"""natural logarithm; two candidates are told apart beyond it; "very strong" (Kass & Raftery 1995)."""

# the search over candidates -----------------------------------------------------------------------------------------

WORTH_A_LOOK: Final = 0.004
"""part of the squared error on the excerpt, for one joint; a candidate whose fall is less is not looked at on the
whole: it passes no gate there; time, and development recordings."""

FINALISTS: Final = 8
"""number of candidates; the best on the excerpt are refined and weighed on the whole; development recordings."""

FINALISTS_OF_A_JOINT: Final = 4
"""number of candidates; of every joint so many are among them, lest one joint fill the list, and as many are refitted
beside each other: a tie of gravity, spring, cable and offset; time, and development recordings."""

BUDGET: Final = 1000
"""number of structures fitted to all rows; a search that would fit more is cut; one of an arm of one to seven joints,
simulated or real, fits 2 to 25: a choice, forty times as many."""

# a finding, refitted ------------------------------------------------------------------------------------------------

MOST_PAIRED: Final = 2
"""number of candidates; so many runners-up of a finding are asked with a second of their own; time."""

MOST_FINDINGS: Final = 8
"""number of findings a joint, and of one effect of which it may have several; an end to a search whose base model must
be wrong, and to lines of a motor that a user would compensate; a choice."""

LEAST_MOVING_S: Final = 2.0
"""s; a joint that moves for less says nothing of an effect; development recordings."""

LEAST_PASSES: Final = 1.25
"""number of passes, on average, of each position; in a single one speed is a function of position, and any law of the
one is a law of the other; a choice: a quarter of the range is passed again."""

FLOOR_KNOWN: Final = 0.03
"""part of a noise floor; so well it is known: nothing is missing of a residual that is less below it, and one that is
more above the instruments' noise should have been explained; development recordings, also with forms that are not the
library's."""

HEARD_SIGMAS: Final = 2.33
"""standard deviations; recordings bear one fit out against another beyond it, and those that were not fitted repay half
its square of the price; one per cent of a normal distribution, on one side."""

# what is left when nothing more passes ------------------------------------------------------------------------------

ABOVE_NOISE: Final = 1.15
"""ratio to the instruments' noise; a residual must be above it before what comes back with the motion is called
physics: coarse steps come back, too; development recordings."""

SLOW_DENSITY: Final = 3.2
"""ratio of densities; low frequencies over the rest of the band from which a disturbance from outside is called slow;
development recordings with and without disturbances."""

BURST_POWER: Final = 5.0
"""ratio of variances; the second worst second over most seconds from which they are called bursts; development
recordings with and without disturbances."""

SLOW_AND_BURSTS: Final = (2.3, 3.0)
"""ratios as of the two before; both together are no chance, though neither would be enough; development recordings with
disturbances."""

# a fit that is no diagnosis -----------------------------------------------------------------------------------------

FAR_ABOVE_NOISE: Final = 3.0
"""ratio to the noise floor; a fit that leaves more, at the bound of what is physical, is none, and one within it lacks
something that its parameters took up; a choice beside ABOVE_NOISE and what is more than noise."""

SENSOR_STRETCHES: Final = 10
"""number of stretches of time; their sums count as independent, also of residuals that hang together for seconds; the
usual number (Kohavi 1995)."""

# detection limits ---------------------------------------------------------------------------------------------------

LIMIT_SIGMAS: Final = 1.645
"""standard deviations; with noise of another draw 95 % of recordings would still show the effect; normal distribution,
on one side."""

LIMIT_OF_ITS_OWN: Final = 1.5
"""ratio of torque to that with the parameter at its weakest; below, others of the shape make it, as the flanks of a gap
do; development recordings."""
