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

SHORTEST: Final = 10
"""samples; a shorter window says nothing of a motion; a choice."""
