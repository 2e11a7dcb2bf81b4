"""Every number by which a recording is refused before anything is fitted, with its unit, its reason and its source."""

from __future__ import annotations

from typing import Final

SLOWEST_STEP: Final = 0.2
"""s; a median step above it is no log of a moving joint but a time in another unit: field buses and loggers of motion
run from some Hz to some kHz, and a clock in milliseconds reads 0.2 at 5 kHz; a choice between the two."""

FASTEST_STEP: Final = 1e-5
"""s; a shorter median step is a time in another unit: the fastest current loops of drives run at some 40 kHz, and are
logged no faster; a choice."""

MIN_SAMPLES: Final = 200
"""samples; fewer hold no motion from which inertia and friction could be told; a choice."""

MIN_SEGMENT: Final = 50
"""samples; a shorter piece between gaps is used up by the filters' edges; a choice."""

GAP: Final = 3.0
"""ratio of a step to the median one; above it the samples between were lost and are not only late; a choice."""

ROUNDING: Final = 1e-6
"""part of a step; what printing and arithmetic leave of times and of their differences; twelve printed digits."""

LARGEST: Final = 1e12
"""SI unit; no reading of a joint is larger, and its square must not overflow; a choice."""

SMALLEST: Final = 1e-12
"""SI unit; a torque or a position that changes by less does not change: the smallest drives have some 1e-6 N m, the
finest encoders some 1e-9 rad behind a gear, and no sensor tells a thousandth of that; a choice."""

MAX_BYTES: Final = 2_000_000_000
"""length in bytes; of a file, of what it unpacks to and of what is kept of it, so that a false length in it cannot fill
the memory; a choice: an hour of seven joints at 1 kHz in CSV is 1 GB."""

BLOCK: Final = 1 << 23
"""length in bytes; of a text so much is read and understood at once, some tenths of a second; a choice."""

HEAD: Final = 1 << 16
"""length in bytes; of a text so much is read at once until its header and first sample are found; a choice."""

LONGEST_LINE: Final = 1_000_000
"""length in bytes; MOST_FIELDS names or numbers of a hundred letters each; a choice."""

MOST_SAMPLES: Final = 5_000_000
"""samples; of a recording, eighty minutes at 1 kHz: filters, regressors and fits keep some hundred numbers of each, so
that seven joints fit into the memory of a laptop; a choice."""

LARGEST_MATRIX: Final = 128
"""number of columns; a variable with more in its shorter direction holds no joints' signals but pictures or tables."""

MOST_FIELDS: Final = 10_000
"""number of fields; a file that declares more is no recording of an arm, and its list would not be read by anyone."""

MOST_LAYOUTS: Final = 64
"""number of kinds; so many sets and orders of joints come in one topic's messages where several nodes share it; more
is no topic that can be read as columns."""

LONGEST_RECORD: Final = 1_000_000_000
"""length in bytes; of a chunk of a log, packed or not: writers make them of some MB; a choice."""

SPLINE_DEGREE: Final = 3
"""power of the polynomials by which signals of another clock are brought to the instants of the positions: below a
tenth of the sampling rate exact to a part in a thousand; de Boor, A Practical Guide to Splines, 1978."""

CLOCK_SHIFT_MOST: Final = 0.5
"""s; a larger shift between two clocks is no drift or queue but another time of day, which the file shows; a choice."""

CLOCK_SHIFT_SMOOTHING: Final = (0.005, 0.01, 0.02)
"""s; standard deviations of the Gaussian kernels, for bands of 8 to 32 Hz, in which arms move and encoders tell an
acceleration; development and real recordings."""

CLOCK_SHIFT_SAMPLES: Final = 60_000
"""samples; of so many, a minute at 1 kHz, a shift is told; time."""

CLOCK_SHIFT_STANDS_OUT: Final = 0.5
"""part of what other shifts leave of the torques; the right one leaves less; simulated and real recordings: a fifth at
most where it is right, nine tenths where one axis of six is looked at."""

CLOCK_SHIFT_TIED: Final = 1.2
"""ratio of what two shifts leave of the torques; a motion that comes back after a while leaves as much one period
later; a choice."""

CLOCK_SHIFT_FINEST: Final = 0.5
"""part of a sample of the slower clock; kernels that agree to less are not worth more: of 500 simulated motions 98 %
are told to twice the uncertainty that follows, without it 60 %."""

CLOCK_SHIFT_CLEAR: Final = 3.0
"""ratio of a shift to its uncertainty; from there on it is one; simulated and real recordings."""

CLOCK_SHIFT_LEAST: Final = 1.5
"""samples of the slower clock; a smaller shift is left to the fit, which tells it from the hold of a controller; a
choice, above the one sample that a hold explains."""

LEAST_SIGNAL: Final = 20
"""samples; a variable with fewer is no signal but a setting of each joint, of which an arm has at most some ten."""
