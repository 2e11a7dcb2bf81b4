"""Every number of the monitor on the board, with its unit, its reason and its source."""

from __future__ import annotations

from typing import Final

WINDOW: Final = 0.5
"""s of judged motion; one energy is compared with its floor: several periods of the band, so that noise averages, and
short beside what users call at once; a choice."""

LEVELS: Final = (-6, 8)
"""half octaves of energy over its floor; between them a window's energy is scored: an eighth to sixteen times; a single
window beyond, as of a collision, counts no more than one at the end; a choice."""

STEPS_A_LEVEL: Final = 4
"""number; whole steps of the cumulative sum a half octave, so that its references need no fractions; a choice."""

DRIFT: Final = 1
"""half octaves above the mean score while the model holds; the reference of the sum that tells drift: half of the
change that is found soonest, an energy of twice the floor's; Page 1954, Basseville & Nikiforov 1993, section 2.2."""

BREAK: Final = 5
"""half octaves above that mean; the reference of the sum that tells a broken model: energies over some eight floors,
which is an RMS of three; a choice."""

MEMORY: Final = 16
"""number of windows; over them the residual is compared with signals, from where the sum that tells drift left zero:
some periods of a slow motion; a choice."""

LEAST_SHARE: Final = 0.2
"""part of the residual's energy beyond its floor; a signal that explains less is not named: dry friction is eight
tenths of a velocity, and what two signals share of a slow motion is some percent; a choice, and simulated changes."""

CHANCE: Final = 0.05
"""part of the residual's whole energy; a signal that explains less is not named: chance makes some percent of noise
with the freedom of MEMORY windows; a choice."""

ADVANTAGE: Final = 1.5
"""ratio of explained energies; below it the signal that was named before stays, so that two that are nearly alike do
not take turns; a choice."""

KEEPING: Final = 0.75
"""half octaves; by so much less does a residual's energy keep an alarm than raise it: a change as small as the
reference of the sum would take turns with a model that holds; below DRIFT, so that one that holds again is told."""

MIDDLE: Final = 10.0
"""s; over it the middle of position and load is taken, about which the residual may follow them; a choice."""

STAGE: Final = 4
"""frames; the moving means that smooth motion and torque for the statistics are so long: their corner is a small part
of the rate of frames, below which differences are derivatives; a choice."""

STAGES: Final = 4
"""number of moving means one after another; a cubic B-spline's smoothing, of which the second derivative is still a
difference of means; a choice."""

HALF_POWER: Final = 0.225
"""ratio; the smoothing's corner, at half power, times the length of a moving mean; by construction: sinc^4."""

ROWS_OVER_CUTOFF: Final = 2.5
"""ratio of the rate of rows to the cut-off; as identification has it."""
