"""Every number by which a recording is prepared, with its unit, its reason and its source.

Where the source says "development recordings", the number was set by hand on simulated recordings with development
seeds (tests/judge), for verdicts and not by a derivation; tests/benchmarks/test_thresholds.py shows what halving and
doubling it does. "By construction" says that another number would contradict how the thing is built.
"""

from __future__ import annotations

from typing import Final

# the band in which model and measurement are compared ---------------------------------------------------------------

ENCODER_SHARE: Final = 0.25
"""part of the torque noise's variance in the band; as much the encoder's noise, as an inertial torque, may have: then
whatever smooths accelerations cannot pass for physics; development recordings, on which an encoder 50 times coarser in
an unchanged band took 14 of 15 names away."""

HIGHEST_CUTOFF: Final = 100.0
"""Hz; geared joints are not moved faster than that, and every further row costs time; development recordings."""

LOWEST_CUTOFF: Final = 8.0
"""Hz; below, the motion itself would be cut off, however coarse the encoder; development recordings."""

CLOSE_CUTOFFS: Final = 1.5
"""ratio; joints whose cut-offs are that close share the lower: every further view of a recording takes the time of
one, and a band that is wider by less shows hardly more; a choice."""

WIDE_ENOUGH: Final = 30.0
"""Hz; a joint whose encoder would bear more than the arm's narrowest band gets no more than that: what a joint does to
another lies below it, and above resonances of transmissions begin, which in one joint's rows alone pass for those of
another; development recordings of two joints, at 48 and 88 Hz."""

CUTOFF_OF_SAMPLING: Final = 0.2
"""part of the sampling rate; the smoothing, which stops at three times the cut-off, has no room above; by
construction."""

ENOUGH_FOR_NOISE: Final = 200_000
"""samples; from so many the instruments' noise is known well enough, and a long recording costs no more; time."""

DENSITY_SEGMENT: Final = 1024
"""samples; a spectrum's bins are then narrow against the stretch in which noise is looked for; by construction."""

WHITE_FROM: Final = 0.3
"""part of the sampling rate; from there on a joint does not move, and what is left is noise; development recordings."""

WHITE_TO: Final = 0.45
"""part of the sampling rate; above, filters of the instruments end the spectrum; development recordings."""

TIMING_DIFFERENCES: Final = 6
"""number; so often positions are differenced until their motion is gone: 5 Hz at 500 samples a second leave 1e-7 of it;
by construction."""

TIMING_BLOCK: Final = 64
"""samples; a block's noise is known to a fifth, and the rate hardly changes; by construction."""

TIMING_BLOCKS: Final = 10
"""number of blocks; fewer tell nothing of how noise and rate go together; by construction."""

FOLLOWS_RATE: Final = 0.7
"""number; the correlation of noise and squared rate over blocks, from which on instants are uncertain; simulated
recordings: below 0.45 with even stamps, coarse encoders too, above 0.85 with stamps of whole milliseconds."""

EXCITATION_WINDOW_S: Final = 1.0
"""s; short against a change of the motion, long against a period of the lowest cut-off; development recordings."""

EXCITATION_CAUTION: Final = 2.0
"""ratio; the encoder's noise is taken for so much denser when it is asked which part of an acceleration is motion: its
estimate varies, and noise that passes for load is amplified at a resonance; development recordings."""

SEGMENT_HALVES: Final = 4
"""number of half kernels; a stretch must hold two kernels to tell an inertia from a rigid-body torque; by
construction."""

# the inertia that chooses the band ----------------------------------------------------------------------------------

INERTIA_GUESSED: Final = 2.0
"""ratio; an inertia of the file that is so much smaller than what the recordings show is a guess, and does not choose
the band, whose cut-off goes with its root; a choice."""

INERTIA_SEEN: Final = 0.3
"""part of a torque's variance, less what friction and gravity may explain; an acceleration that explains less of it
does not tell its inertia; development recordings."""

MOST_INERTIA_ROWS: Final = 20_000
"""rows; from so many an inertia is known far better than to a ratio of two; time."""

# the clock ----------------------------------------------------------------------------------------------------------

EVEN_GRID: Final = 0.02
"""part of a period; instants that depart less from an even grid count as on it, and the recording is not interpolated;
real recordings, whose controllers log steps of 10 and 12 ms."""

CLOCK_WANDER: Final = 1e-3
"""part of a period; segments whose mean steps differ by less have one clock: an inertia is then wrong by twice that at
most; quartz clocks differ by a tenth of it and less."""

COUNTED_AT_ONCE: Final = 16
"""samples; over so many the period of a clock is first read, and nearer to each other a clock does not wander; the
rounding of a stamp is then a small part of a period; development recordings with rounded stamps."""

CLOCK_AHEAD: Final = 8
"""samples; one of so many is stamped in time: a host is late for a few, and then catches up; real recordings with
stamps up to two periods late."""

CLOCK_PHASE: Final = 1000
"""samples; over so many the phase of a clock is averaged: long against losses, short against its wander; development
recordings with lost samples."""

CLOCK_SMOOTHER: Final = 1.5
"""ratio of squared departures from smooth; over the instants for which it is so much less the positions were taken;
chance reaches it with a thousand samples once in a million; development recordings with uneven stamps."""

ENOUGH_FOR_CLOCK: Final = 50_000
"""samples; from so many it is known which instants are true; time."""

STAMP_DIGITS: Final = 7
"""number of decimal places; stamps that are printed to more are not rounded by any of them that matters; by
construction."""

STAMP_ROUNDED: Final = 1.01
"""part of the last decimal place; a rounded stamp departs by half of it to either side; a hundredth for errors of
arithmetic, by construction."""

STEP_DIGITS: Final = 10
"""number of digits of a period; beyond are errors of arithmetic, by which nothing shall differ; double precision."""

SPLINE_DEGREE: Final = 5
"""number, the degree of the splines that interpolate uneven samples; at the ceiling of the band 0.1 % are then lost
where degree 3 loses 1 %, and higher ones raise noise where steps differ by three; sines at random steps."""

# the step of a position ---------------------------------------------------------------------------------------------

STEP_QUANTILE: Final = 0.001
"""part of all differences; the least of them may be an error of printing; development recordings."""

STEP_ONE: Final = 1.5
"""ratio to the least step; what is below it is one step, what is above are several; halfway, by construction."""

STEP_ROUNDED: Final = 0.1
"""part of a step; printed digits round a multiple of it by no more; development recordings."""

STEP_OF_ALL: Final = 0.95
"""part of all differences; so many must be multiples: the rest are errors of printing; development recordings."""

STEP_SINGLE: Final = 0.02
"""part of all differences; so many must be single steps, or the "step" is a chance divisor; development recordings."""

# measured rates -----------------------------------------------------------------------------------------------------

RATE_BETTER: Final = 0.5
"""part of the density of the noise of differentiated positions, near the cut-off; a measured rate with less is used;
noise that is half changes a cut-off by a sixth, and what changes it less is not worth a second instrument."""

RATE_OWN: Final = 0.5
"""part of the same density; a measured rate that differs by less from the differentiated positions has their noise, as
a difference of them has; by construction."""

RATE_DELAYED: Final = 0.25
"""part of a period; a rate that is later is filtered, or a difference to the reading before, which is half a period
late; between that and none."""

RATE_SCALE: Final = 0.05
"""part of one; a rate that is so much larger or smaller than the derivative of the positions has another unit, and
would make every friction wrong by as much; a choice."""

RATE_FOLLOWS: Final = 0.5
"""part of a power; a rate of which the positions explain less is none of this joint; a choice."""

# filters ------------------------------------------------------------------------------------------------------------

SMOOTHING_OVER_CUTOFF: Final = 3.0
"""ratio to the cut-off; the position's smoothing stops there, so that it is flat inside the band; development
recordings."""

SMOOTHING_STOPBAND_DB: Final = 70.0
"""dB; the second derivative raises noise at three cut-offs by (2 pi f)^2, and this takes it down again; development
recordings."""

BAND_STOPBAND_DB: Final = 60.0
"""dB; what is folded back by the decimation is a thousandth; by construction."""

BLOCK_ROWS: Final = 500
"""number of rows; regressors are made of so many at a time: some ten thousand samples of a wide one fit into the
processor's caches, and a long recording's are never whole in the memory; time."""

TRANSITION: Final = 0.5
"""part of the cut-off; from pass-band to stop-band of the band's filter, a quarter to either side of the cut-off; a
compromise between the filter's length and the rows' rate."""

ROWS_OVER_CUTOFF: Final = 2.5
"""ratio of the rate of rows to the cut-off; just twice the stop-band, a quarter above the cut-off; sampling theorem."""

BAND_OF_SAMPLING: Final = 0.39
"""part of the sampling rate; with its transition the band's filter ends below half of it; by construction."""

SMOOTHING_OF_SAMPLING: Final = 0.45
"""part of the sampling rate; the middle between the smoothing's pass-band and stop-band lies no higher; by
construction."""

STOPBAND_OF_SAMPLING: Final = 0.499
"""part of the sampling rate; a filter's design needs a stop-band below half of it; by construction."""

MOST_DELAY: Final = 4.0
"""samples; the band's filter has so much room to shift a torque, more than a skew is looked for; by construction."""

# standstill ---------------------------------------------------------------------------------------------------------

RATE_BLUR: Final = 0.08
"""part of a period of the cut-off; the rate's smoothing, which is down by half at twice the cut-off, answers to a jump
of the acceleration so late: 1 / (2 pi 2); by construction."""

STANDSTILL_NOISE: Final = 4.0
"""standard deviations of the rate's noise; below, the sign of the rate is chance; a normal variable is beyond it once
in 16,000 rows."""

STANDSTILL_OF_TOP_SPEED: Final = 0.002
"""part of the joint's fastest rate; below, it creeps, and a clean encoder would else call it motion; development
recordings."""

FRICTION_SIGMAS: Final = 2.0
"""standard deviations of white rows; so much more dry friction than was found may be unknown at rest; a normal variable
is beyond it once in forty; too much of it costs a few rows, too little leaves a torque in them."""

UNKNOWN_OVER_NOISE: Final = 0.3
"""ratio to the torque noise in the band; a combination of rows is eliminated if all that dry friction may hold at rest
could come to more in it; what is left in is then small beside the noise, also where it comes back; by construction."""

DENSE_DIRECTIONS: Final = 40_000
"""number of rows times combinations; up to so many, products with a full matrix are faster than with a sparse one;
time, it decides no result."""

RESOLVED_REST: Final = 1.0
"""ratio to a period of the cut-off; the band does not resolve a rest that is shorter; by construction."""

CLEAR_RATE: Final = 0.1
"""part of the fastest rate; where what counts as rest is more of it, slow motion passes for rests; a choice."""

LEAST_LEFT: Final = 0.5
"""part of the rows that no rest holds whole; with less left the unknown torques have taken over; a choice."""

SAME_DIRECTION: Final = 1e-3
"""part of a row; combinations of rows that differ by less are one; rounding."""

LEAST_OF_ROW: Final = 0.1
"""part of a row; one of which less is left once an unknown torque was eliminated says nothing; by construction."""

HELD_RANGE: Final = {"revolute": 5e-3, "prismatic": 5e-4}
"""rad, m; a joint that never leaves a range like this is held by its friction, which has no direction then; development
recordings with held joints."""

UNTOUCHED: Final = 0.97
"""part of a row; where more of it is left once an unknown torque was eliminated, none reached it; development
recordings."""

# pieces and excerpts ------------------------------------------------------------------------------------------------

LEAST_ROWS: Final = 10
"""rows; a stretch must leave so many after the filters, or it is dropped; by construction."""

EXCERPT_WINDOWS: Final = 8
"""number of windows; an excerpt is spread over the motion, and each window is long against the filter; development
recordings."""

EXCERPT_WINDOW_KERNELS: Final = 10
"""number of the band filter's kernels; shorter windows would lose more at their ends than they hold; by
construction."""

TEMPERATURE_WINDOW_S: Final = 1.0
"""s; gears warm slowly and sensors are coarse: a mean over so long loses nothing; by construction."""

TEMPERATURE_START: Final = 200
"""samples; the temperature from which a rise is counted is their median; by construction."""

# motion that comes back ---------------------------------------------------------------------------------------------

REPEAT_WINDOW_S: Final = 2.0
"""s; a stretch of motion that is looked for later in the recording: long enough not to be alike by chance; development
recordings."""

REPEAT_SEARCH_HZ: Final = 50.0
"""Hz; the search sees the motion this often, before it aligns to the nearest row; time."""

REPEAT_ALIKE: Final = 0.003
"""part of a joint's range; positions that differ by less, RMS, are the same motion; development recordings, closed loop
with noise."""

REPEAT_ALIKE_RATE: Final = 0.03
"""part of a joint's fastest rate, beside standstill's; rates that differ by less, RMS, are the same motion; development
recordings, closed loop with noise."""

REPEAT_LEAST_TRAVEL: Final = 0.02
"""part of a joint's range; a window in which no joint moves by more comes back everywhere; development recordings."""

REPEAT_LEAST_S: Final = 4.0
"""s; less motion that comes back gives no floor; two windows."""

REPEAT_STRETCHES: Final = 10
"""number of stretches; their means say how much a mean over all pairs of rows varies by chance: enough to know that to
a quarter, each long against what hangs together; by construction."""

REPEAT_SIGMAS: Final = 2.0
"""standard deviations; what comes back must be beyond chance by as many, one in forty on one side; normal
distribution."""

REPEAT_LEAST_ROWS: Final = 100
"""rows; from so many a variance is known to a seventh; chi-squared distribution."""

REPEAT_TAPS: Final = 4
"""rows to either side; from so many a signal is read between rows: it fills four fifths of what they could hold; by
construction."""

REPEAT_WINDOWS: Final = 60
"""number of windows; so many of a long recording are looked for in the rest of it; time."""

LASTING: Final = 0.33
"""part of the residual's variance; so much must come back with the motion for it to count as repeatable; development
recordings with disturbances from outside."""

# spectra of a residual ----------------------------------------------------------------------------------------------

LINE_STANDS_OUT: Final = 0.1
"""part of a residual's power; a frequency that holds more of it is a line; development recordings."""

LINE_CHANCE: Final = 6.9
"""natural logarithm; of noise the strongest of its frequencies holds more than this and the logarithm of their number,
over their number, once in a thousand signals; Fisher's test."""

LINE_WIDTH: Final = 3
"""bins; a Hann window spreads a peak over so many to either side, and the trend over as many at the beginning; by
construction."""

LINE_BLURRED: Final = 2.0
"""bins; a Hann window makes as much of one frequency of noise: 1 + 2 (2/3)² + 2 (1/6)² times its power, its neighbours
by their correlation; by construction."""

LINE_COLOUR: Final = 3
"""number, the degree of the course of a spectrum's logarithm over the band; slow pushes at one end, an encoder's noise
at the other; a choice."""

SLOW_PART: Final = 0.15
"""part of the cut-off; below lie slow disturbances; development recordings with disturbances from outside."""

WHITE_PART: Final = (0.35, 0.85)
"""parts of the cut-off; between them noise is taken to be white: above slow physics, below the filter's edge;
development recordings."""

PEAK_SEGMENT: Final = 3.0
"""s; of the segments of a residual's spectrum, as it is drawn and searched for peaks: bins of a third of a Hz; a
choice."""

PEAK_OVERLAP: Final = 1.8
"""ratio; so many spectra that are independent are worth those of Hann windows which overlap by half, to as many as fit
side by side; Welch 1967."""

PEAK_CHANCE: Final = 4.5
"""standard deviations; of the density of noise, as its cube root has them (Wilson & Hilferty 1931); a bin of noise
passes it three times in a million; by construction."""

PEAK_NEAR: Final = 4
"""bins; beside a peak they belong to it, as the Hann window spreads it; by construction."""

PEAK_FAR: Final = 16
"""bins; up to there on either side is what a peak is held against; wider, a slope of the noise would count; simulated
coloured noise."""

NAMED_PEAKS: Final = 3
"""number; of peaks that are named in a spectrum, the strongest; a choice."""

RESIDUAL_SEGMENT: Final = 256
"""rows; a spectrum's bins are then narrow against the slow part of the band; by construction."""

BURST_STRETCHES: Final = 3
"""number of stretches of a second; with fewer, the second worst is no measure; by construction."""

BLOCK_OF_KERNEL: Final = 8
"""ratio of lengths; in blocks so much longer than its kernel a signal is convolved; time."""

KAISER_TAPS: Final = (7.95, 2.285)
"""numbers; stop-band in dB at no length, and dB a tap and radian of the transition; Kaiser 1974."""

KAISER_BETA: Final = (8.7, 0.1102)
"""numbers; stop-band in dB of no taper, and taper a dB above that, from 50 dB on; Kaiser 1974."""

# lines over the motor's angle ---------------------------------------------------------------------------------------

ANGLE_GRID: Final = 1.4
"""part of a radian of the highest order's phase; the grid of the angle is as fine: what of a wave another order of the
grid takes on is then a hundredth of its amplitude, (1.4 / (2 pi - 1.4)) to the power of SHARED_BY; by construction."""

SHARED_BY: Final = 4
"""number of neighbours of the grid; among so many a sample is shared, by a cubic B-spline, whose spectrum is that power
of a sinc; by construction."""

ORDERS_A_PERIOD: Final = 4
"""number of orders from one that is resolved to the next; a line between two of them loses a twentieth of its power; by
construction."""

MOST_ANGLES: Final = 250_000
"""number of steps of the angle's grid; of a longer way only lower orders are looked at; memory."""

LEAST_PERIODS: Final = 4.0
"""number of periods over the motion; with fewer a wave is no line, but one of many shapes over the position; a
choice."""

LINE_ABOVE_CHANCE: Final = 12.0
"""natural logarithm; so much a line is above the largest of as many chances as there are orders: far more than their
exponential distribution asks (Scargle 1982), as their level is only estimated; simulated white noise."""

NEAR_SURROUNDINGS: Final = 8
"""number of resolved orders to either side; a line is compared with as many at low orders, and others so near to a
stronger one may be its shadows; twice the least number of periods."""

WIDE_SURROUNDINGS: Final = 40
"""number of resolved orders to either side; with so many at most a line is compared: noise is even over them; a
choice."""

MOST_PEAKS: Final = 3
"""number of peaks; so many of a span may be lines: of others it is seen once the strongest are in the model; time."""

LEAST_OF_WAVE: Final = 0.005
"""part of a wave's own square; so much the model's columns must leave of it: less is decided by their errors; by
construction."""

SLOW_FOR_LINES: Final = 0.1
"""part of the highest speed; where the motor is slower, nothing is above the band; a choice."""

LINE_TURNS: Final = 4
"""number of turns of the motor from end to end of the motion; with fewer, a line above the band cannot be told to come
back with the turn, and a wave over time passes for it; an order is known to a quarter then, the Rayleigh limit."""

LINE_INSIDE: Final = 1.1
"""ratio to a line's frequency at the middle speed; a band up to there holds it on about half of the way; a choice."""

LINE_WORTH: Final = 0.01
"""part of the strongest line's power, a tenth of its size; a line with less asks for no higher band; a choice, with
a real motor in view."""

NOISE_OF_LINES: Final = 0.1
"""ratio of RMS; the encoder's noise as an inertial torque in the raised band to all lines above it: a hundredth of
their power; a choice, with a real motor in view."""

KEPT_SKEWS: Final = 4
"""numbers of samples; at so many shifts a joint's torque is kept in the band: that of the fit, those half a sample to
either side of none, and that of a delay; memory."""
