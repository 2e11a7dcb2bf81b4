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

LEAST_PRICE: Final = 10.0
"""natural logarithm; a term's score must exceed it however little was searched; clean recordings of four joints reach
9."""

SHOWN_ALIKE: Final = 2.0
"""ratio; a transmission's value that a fit to the torque moves further from what its encoders show stands for something
else there; a choice."""

OF_WHAT_IS_LEFT: Final = 0.3
"""part of what is left; where an error, after the noise that is compensated for, is less, noise is most of it, and
nothing is known of the rest; development recordings with coarse encoders."""

# rivals -------------------------------------------------------------------------------------------------------------

ALIKE: Final = 5.0
"""natural logarithm; two candidates are told apart beyond it; "very strong" (Kass & Raftery 1995)."""

# the search over candidates -----------------------------------------------------------------------------------------

WORTH_A_LOOK: Final = 0.004
"""part of the squared error on the excerpt, for one joint; a candidate whose fall is less is not looked at on the
whole: it passes no gate there; time, and development recordings."""

FINALISTS: Final = 8
"""number of candidates; the best on the excerpt are refined and weighed on the whole; development recordings."""

FINALISTS_OF_A_JOINT: Final = 3
"""number of candidates; of every joint so many are among them, lest one joint fill the list; development recordings."""

BUDGET: Final = 1000
"""number of structures fitted to all rows; a search that would fit more is cut; one of an arm of one to seven joints,
simulated or real, fits 2 to 25: a choice, forty times as many."""

# a finding, refitted ------------------------------------------------------------------------------------------------

MOST_TRIED: Final = 4
"""number of candidates; of every joint so many are refitted beside each other; time, and a tie of gravity, spring,
cable and offset is four."""

MOST_PAIRED: Final = 2
"""number of candidates; so many runners-up of a finding are asked with a second of their own; time."""

WORTH_A_REFIT: Final = 0.5
"""part of the gain of the likeliest candidate of a joint; what gains less is not refitted beside it; time."""

MOST_FINDINGS: Final = 6
"""number of findings a joint; an end to a search whose base model must be wrong; a choice."""

MOST_OF_ONE: Final = 8
"""number of findings; so many of an effect of which a joint may have several: the lines of a motor that a user would
compensate; a choice."""

LEAST_MOVING_S: Final = 2.0
"""s; a joint that moves for less says nothing of an effect; development recordings."""

LEAST_PASSES: Final = 1.25
"""number of passes, on average, of each position; in a single one speed is a function of position, and any law of the
one is a law of the other; a choice: a quarter of the range is passed again."""

AT_THE_FLOOR: Final = 0.97
"""ratio to the noise floor; where a residual is below, nothing is missing; floors are known to a few hundredths;
development recordings."""

WIDEST_ORDER: Final = 0.5
"""part of the distance between whole orders a turn; where the 95 % interval of a line's order is wider, a whole order
lies near enough by chance more often than not, and must explain as well; half, by construction; intervals of ripples of
half a noise floor and more are 0.07 to 0.4 wide on development recordings."""

HEARD_SIGMAS: Final = 2.33
"""standard deviations; recordings bear one fit out against another beyond it, and those that were not fitted repay half
its square of the price; one per cent of a normal distribution, on one side."""

IDLE: Final = 0.1
"""part of the stretches of a recording that was not fitted, the longest; what two fits make of a time in which they
hardly differ is not asked; a choice."""

AS_WELL: Final = 0.5
"""natural logarithm; a whole order explains as well as a line's own within it; one standard deviation of a
normal distribution; a choice, with simulated lines at 45.5 periods a turn in view."""

# what is left when nothing more passes ------------------------------------------------------------------------------

LEAST_EXPLAINED: Final = 0.5
"""part of what is above the noise floor; findings must explain so much where physics is left after them, or they only
came nearest; development recordings with forms that are not the library's."""

MOST_LEFT: Final = 0.5
"""part of the squared error that findings explain; where more than that surely comes back with the motion after them,
they only came nearest; development recordings: 0.18 at most beside right findings, 0.7 and more with laws that the
library lacks."""

ABOVE_NOISE: Final = 1.15
"""ratio to the instruments' noise; a residual must be above it before what comes back with the motion is called
physics: coarse steps come back, too; development recordings."""

FORM_PART: Final = 0.2
"""part of the variance; if as much surely comes back with the motion after an effect was added, its law should have
explained more; development recordings with forms that are not the library's."""

FORM_ABOVE_NOISE: Final = 1.03
"""ratio to the instruments' noise; the same for the residual's level; development recordings with forms that are not
the library's."""

SLOW_DENSITY: Final = 3.2
"""ratio of densities; low frequencies over the rest of the band from which a disturbance from outside is called slow;
development recordings with and without disturbances."""

BURST_POWER: Final = 5.0
"""ratio of variances; the second worst second over most seconds from which they are called bursts; development
recordings with and without disturbances."""

SLOW_AND_BURSTS: Final = (2.3, 3.0)
"""ratios as of the two before; both together are no chance, though neither would be enough; development recordings with
disturbances."""

# contradictions -----------------------------------------------------------------------------------------------------

CONTRADICTS: Final = 5.0
"""standard deviations of a difference; two values of a parameter, of two recordings or of the file and the data,
contradict each other beyond it: intervals are too narrow where a model is not exact (of eight none held the truth of a
simulated elasticity); development recordings of one arm."""

MATERIAL: Final = 0.1
"""part of the larger value; two values that differ by less do not contradict each other, however certain they are;
development recordings of one arm."""

GROSS: Final = 0.25
"""part of the larger value; a parameter of the model file that is wrong by more may have made the effects that are
named beside it, and is said first: URDFs' masses are right to 5 to 20 %; real recordings of whole arms."""

GROSS_TORQUE: Final = 0.1
"""part of a joint's torque, RMS; what a wrong parameter of the model file must move for that: small moments may be
wrong by any factor; real recordings of whole arms."""

# a fit that is no diagnosis -----------------------------------------------------------------------------------------

MOSTLY: Final = 0.5
"""part of a joint's torque; where a fit misses more, it says less of the joint than it leaves; a choice."""

FAR_ABOVE_NOISE: Final = 3.0
"""ratio to the noise floor; a fit that leaves more, at the bound of what is physical, is none, and one within it lacks
something that its parameters took up; a choice beside ABOVE_NOISE and what is more than noise."""

# further sensors ----------------------------------------------------------------------------------------------------

SENSOR_STRETCHES: Final = 10
"""number of stretches of time; their sums count as independent; the usual number (Kohavi 1995)."""

SENSOR_SIGMAS: Final = 3.0
"""standard deviations; what a sensor says against a candidate must be as sure; three in a thousand of a normal
distribution."""

# guesses ------------------------------------------------------------------------------------------------------------

GUESS_REACH: Final = 0.95
"""part of the best guess's gain less its price; a simpler one within it is preferred; development recordings with laws
that the library lacks."""

# detection limits ---------------------------------------------------------------------------------------------------

LIMIT_SIGMAS: Final = 1.645
"""standard deviations; with noise of another draw 95 % of recordings would still show the effect; normal distribution,
on one side."""

LIMIT_PART: Final = 0.5
"""part of a joint's torque, RMS; where the effect in the middle of all limits could be larger, unseen, nothing is said
of the joint; a choice."""

LIMIT_OF_ITS_OWN: Final = 1.5
"""ratio of torque to that with the parameter at its weakest; below, others of the shape make it, as the flanks of a gap
do; development recordings."""
