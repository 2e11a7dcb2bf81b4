"""Limits by which a recording is refused or its clocks are aligned, each with unit, reason and source."""

from __future__ import annotations

from typing import Final

SLOWEST_STEP: Final = 0.2
"""s; a longer median step means that time is in another unit: loggers of motion run from some Hz to some kHz, and a
time in milliseconds reads 0.2 at 5 kHz; a choice between the two."""

FASTEST_STEP: Final = 1e-5
"""s; a shorter median step means that time is in another unit: the fastest current loops of drives run at some 40 kHz;
a choice."""

MIN_SAMPLES: Final = 200
"""samples; fewer contain no motion that determines inertia and friction; a choice."""

MIN_SEGMENT: Final = 50
"""samples; of a shorter piece between gaps the edges of the filters leave nothing; a choice."""

GAP: Final = 3.0
"""ratio of a step to the median step; above it samples were lost, not only late; a choice."""

RATE_SCALE: Final = 1.05
"""ratio of a recorded rate to that of the positions; beyond it either way it has another unit, which would make every
friction wrong by as much; a choice: no unit of rate is so near another."""

ROUNDING: Final = 1e-6
"""part of a step; rounding errors of times and their differences; twelve printed digits."""

LARGEST: Final = 1e12
"""SI unit; no sensor of a joint reads more, and the square must not overflow; a choice."""

SMALLEST: Final = 1e-12
"""SI unit; a torque or position that changes by less is constant: the smallest drives have some 1e-6 N m, the finest
encoders some 1e-9 rad behind a gear, and no sensor resolves a thousandth of that; a choice."""

MAX_BYTES: Final = 2_000_000_000
"""length in bytes; of a file, its decompressed contents and what is kept of it, so that a wrong length cannot fill the
memory; a choice: an hour of seven joints at 1 kHz in CSV is 1 GB."""

BLOCK: Final = 1 << 23
"""length in bytes; a text is read in blocks of this size, each in some tenths of a second; a choice."""

HEAD: Final = 1 << 16
"""length in bytes; block size while the header and the first sample are searched; a choice."""

LONGEST_LINE: Final = 1_000_000
"""length in bytes; MOST_FIELDS names or numbers of a hundred letters each; a choice."""

MOST_SAMPLES: Final = 5_000_000
"""samples; eighty minutes at 1 kHz: filters, regressors and fits keep some hundred numbers per sample, so that seven
joints fit into the memory of a laptop; a choice."""

LARGEST_MATRIX: Final = 128
"""number of columns; a variable whose shorter side has more holds images or tables, not signals of joints."""

MOST_FIELDS: Final = 10_000
"""number of fields; a file with more is not a recording of an arm."""

MOST_LAYOUTS: Final = 64
"""number of kinds; lists of joints in the messages of one topic, which several nodes may share; more cannot be read
as columns."""

MOST_SENDERS: Final = 8
"""number of texts of frame_id on one topic; with more it is a count or a time, not the name of a sender; a choice."""

LEAST_SWITCHES: Final = 6
"""number of messages after which the sender is another; a node that was restarted, or a drive that was switched off,
changes once or twice; a choice."""

LEAST_OF_SENDER: Final = 0.02
"""part of a topic's messages; fewer with a torque of 0 or with other positions are failed reads; a choice."""

SENDERS_APART: Final = 5.0
"""ratio of the distance between two senders' positions to the usual step, or of the torque beside one of 0 to its
resolution; of Gaussian noise one sample in a million is so far from its neighbours; a choice."""

SENDERS_TRAVEL: Final = 0.5
"""part of the travel from message to message that every second message travels, where two senders take turns: of one
motion it is twice as far, of white noise as far."""

LATE_STEP: Final = 0.5
"""part of the median step; where messages in the order of their stamps are nearer, the clock was set back; a choice."""

LONGEST_RECORD: Final = 1_000_000_000
"""length in bytes; of a chunk of a log; writers make chunks of some MB; a choice."""

SPLINE_DEGREE: Final = 3
"""power of the polynomials that interpolate signals of another clock: exact to a part in a thousand below a tenth of
the sampling rate; de Boor, A Practical Guide to Splines, 1978."""

CLOCK_SHIFT_MOST: Final = 0.5
"""s; a larger offset is not drift or a queue but another time of day, which the file shows; a choice."""

CLOCK_SHIFT_SMOOTHING: Final = (0.005, 0.01, 0.02)
"""s; standard deviations of the Gaussian kernels, for bands of 8 to 32 Hz, in which arms move and encoders resolve
accelerations; development and real recordings."""

CLOCK_SHIFT_SAMPLES: Final = 60_000
"""samples; as many, a minute at 1 kHz, are used to find an offset; computing time."""

CLOCK_SHIFT_STANDS_OUT: Final = 0.5
"""part of the median residual over all shifts that the right shift leaves at most; simulated and real recordings: a
fifth where it is right, nine tenths where only one axis of six is used."""

CLOCK_SHIFT_TIED: Final = 1.2
"""ratio of the residuals of two shifts that count as equal: periodic motion leaves the same one period later; a
choice."""

CLOCK_SHIFT_FINEST: Final = 0.5
"""part of a sample of the slower clock; least standard error: with it, 98 % of 500 simulated offsets lie within twice
their standard error, without it 60 %."""

CLOCK_SHIFT_CLEAR: Final = 3.0
"""ratio of an offset to its standard error above which it is significant; simulated and real recordings."""

CLOCK_SHIFT_LEAST: Final = 1.5
"""samples of the slower clock; smaller offsets are left to the fit, which separates them from a controller's hold; a
choice, above the one sample that a hold explains."""

MOST_JSON: Final = 200_000_000
"""length in bytes; a log in JSON is read whole and takes some ten times its length in memory; a choice."""

MOST_EPISODES: Final = 10_000
"""number of files of a LeRobot data set; each is opened for its layout in some ms; a choice."""

LARGEST_RADIANS: Final = 7.0
"""rad; positions of a LeRobot data set that never exceed it are in rad: a turn is 6.28, and motions in degrees or in
percent of a range are larger."""

NORMALISED: Final = 101.0
"""percent; LeRobot's normalised positions reach from -100 to 100, with rounding; what exceeds it is in degrees."""

LEAST_SIGNAL: Final = 20
"""samples; a shorter variable is a setting of each joint, not a signal."""

PREVIEW_FIRST: Final = 4
"""number of first values of a field that are shown where columns are chosen; a choice."""

PREVIEW_PARTS: Final = 120
"""number of parts of a field whose least and largest values are drawn there: a picture of as many pixels; a choice."""

PREVIEW_TOGETHER: Final = 16
"""number of fields that are read together for that: of MOST_SAMPLES they fill 0.6 GB."""

SCALE_SAMPLES: Final = 20_000
"""samples; from as many, spread over a signal, the usual size of its steps is told to some per cent; computing time."""

ORDINARY: Final = 0.9
"""part of the steps of a signal that counts as usual; reversals, impacts and slips fill less than the rest; clean
recordings, simulated and real."""

SIDE: Final = 4
"""samples on either side of a failed read through which a parabola is laid: five more than it has coefficients; a
choice."""

LONGEST_EXCURSION: Final = 5
"""samples; what is away for longer may be a motion, or a drive that is off; reads fail one to a few at a time."""

AWAY: Final = 8.0
"""ratio of the distance of a failed read from its neighbours' parabola to what these, and second differences elsewhere,
deviate; 188 clean recordings, simulated and real, reach 5 with one sample and 7 with five."""

REPEATED_AWAY: Final = 3.0
"""ratio of the distance of a number that comes again from its neighbours to their steps; half as much as AWAY is
enough, as the number is one of few; clean recordings reach 2."""

MANY_READS: Final = 3
"""number of failed reads of one value from which all samples of that value are left out, if they are COMMON_VALUE of
them: between failed reads a signal that has this value cannot be told from one; a choice."""

SILENT: Final = 3.0
"""ratio of the torque that the motion asks for while 0 is read to what it leaves elsewhere; a choice."""

TURN_OFF: Final = 3.0
"""ratio of what a jump may be off from whole turns to second differences; a choice, as for a standard deviation."""

AT_AN_END: Final = 0.05
"""part of its range within which a register's wrap begins and ends; a choice, of the way between two samples."""

COMMON_VALUE: Final = 0.05
"""part of the samples; a signal with fewer that repeat the one before is not held; a choice."""

FEWEST_RENEWALS: Final = 30
"""number of renewals from which a rate is told: of as many at random, an even distance is met once in 1e8."""

LEAST_STEPS: Final = 0.01
"""part of a signal's changes that may be smaller than its resolution, by printed digits; a choice."""

COUNTED_STEPS: Final = 2.5
"""ratio of a change to the least ones from which a signal moves on with each sample: an encoder that changes by three
steps has no time to repeat itself; a choice."""

EVEN_RENEWALS: Final = 1.5
"""ratio of the longest to the shortest usual distance of renewals: two and three samples, or a clock that jitters by a
fifth; a choice."""

IN_PHASE: Final = 0.9
"""part of the renewals whose distance must be usual; lost messages make others; a choice."""

SAME_RATE: Final = 0.95
"""ratio of two rates of renewal that count as one; counted over thirty of them, a choice."""
