"""Accuracy and words of replays, each with unit, reason and source; "a choice" is arbitrary."""

from __future__ import annotations

from typing import Final

WINDOWS: Final = (0.1, 0.3, 1.0)
"""s; lengths of the windows in open loop: a torque's error grows with their square; a choice of the field's users."""

STRETCH: Final = 10.0
"""s; in closed loop the motion starts anew from the recording after so long: a loop has forgotten its start by then,
and stretches run side by side; a choice."""

STEP: Final = 1 / 8000
"""s; the longest step of the integration; half as fine as the simulated plant's, whose errors are then below those of
the start of a window."""

RATE_NOISE: Final = 2e-3
"""part of a joint's rate, rms; noise of the rate with which windows begin: what the smoothing then leaves out of a
motion is less than that; a choice."""

STATES_OF_SAMPLING: Final = 0.2
"""part of the sampling rate; the highest cut-off of positions and rates; what a filter of some twenty samples does."""

AGREES: Final = 1.0
"""ratio; where the torque's error makes more of the motion's error than all else does, both say the same; by
construction."""

RESTING: Final = 0.2
"""part of the samples; a joint that rests for longer is held by dry friction, which takes up any torque; a choice."""

START: Final = 0.5
"""part of the error that the torque does not make; more of it by the start's rate is called its cause; a choice."""

RUNAWAY: Final = 100.0
"""ratio; a motion that is off by so many times what the joint moves has left the arm's range; a choice."""

SAME_PERIOD: Final = 0.01
"""part of a sample's period; recordings that differ by less are played side by side: a window is then off by a sample
at most; a choice."""

SHORTEST: Final = 10
"""samples; a shorter window says nothing of a motion; a choice."""

# output error --------------------------------------------------------------------------------------------------------

SHOOTING: Final = 0.5
"""s; length of the windows: long enough for what friction and gains do to the motion, short enough that a bad start is
forgiven; Ljung, System Identification, 1999, on multiple shooting."""

MOST_WINDOWS: Final = 60
"""number; windows of a search, evenly spread: half a minute of motion; more take longer and tell hardly more."""

MOST_RUNS: Final = 1000
"""number; windows times directions in which they are differentiated, at most: with six joints and sixty parameters a
step takes seconds; a choice."""

LEAST_WINDOWS: Final = 12
"""number; the fewest windows, however many parameters there are; a choice."""

SHOOTING_STEP: Final = 1 / 2000
"""s; the longest step of the integration, if stability allows it; its error is below that of a fit's parameters."""

GAUSS_NEWTON_STEPS: Final = 10
"""number; steps of the search at most; it begins at a fit, and three or four are the rule."""

ENOUGH_FALL: Final = 1e-4
"""part of the cost; a step that lowers it by less is the last: half of what one in 5,000 errors, alone, adds to it."""

SKEW_TOLD: Final = 0.2
"""samples; width of an interval of the torque's lateness that a fit tells well enough: it moves a friction by a
tenth of what a whole hold would; a choice."""

SKEW_STEP: Final = 0.1
"""samples; by which steps in the torque's lateness are scaled and its derivative is taken; a choice."""

SURE: Final = 1e-3
"""part of a parameter; the least size by which steps in it are scaled; a choice."""

TANGLED: Final = 0.05
"""part of a parameter; the same for one that the data tell only together with others; a choice."""

DAMPINGS: Final = (1e-6, 1e-4, 1e-2, 1.0, 100.0)
"""part of the diagonal of the normal matrix; tried until a step lowers the cost, the boldest first; Marquardt 1963."""
