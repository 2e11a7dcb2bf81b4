"""Every number that decides how a recording is prepared, with its unit, its reason and its source.

Where the source says "development recordings", the number was set by hand on simulated recordings with development
seeds (tests/judge), for verdicts; tests/benchmarks/test_thresholds.py prints the effect of halving and doubling it.
Numbers by construction, of numerics and of time stand beside the one formula that they belong to.
"""

from __future__ import annotations

from typing import Final

# conventions ---------------------------------------------------------------------------------------------------------

LITTLE: Final = 0.1
"""part; a tenth is little beside the whole, wherever no verdict hangs on how little; a choice: at each
place but that of folded torques, which is newer, no development recording is judged otherwise with half or twice."""

SOME: Final = 0.25
"""part; from a quarter on it is some of the whole, wherever no verdict hangs on how much; a choice, as LITTLE."""

MOST: Final = 0.5
"""part; more than half is most of the whole; by construction."""

CERTAIN: Final = 4.0
"""standard deviations; beyond, it is not chance, and not an interval that is a little too narrow; a normal variable is
beyond it once in 16,000 times."""

CLEARLY_LIKELIER: Final = 12.0
"""natural logarithm of a likelihood; a jump or another time of a torque must be so much likelier, and a line so much
above the largest of as many chances as there are orders (Scargle 1982), whose level is only estimated; 5 would have
named something on 23 of 30 clean recordings: trial of the method, and simulated white noise."""

# bands ---------------------------------------------------------------------------------------------------------------

ENCODER_SHARE: Final = 0.25
"""part of the torque noise's variance in the band; maximum of the encoder's noise as an inertial torque: whatever
smooths accelerations then cannot pass for physics; development recordings, on which an encoder 50 times coarser in an
unchanged band took 14 of 15 names away."""

HIGHEST_CUTOFF: Final = 100.0
"""Hz; geared joints do not move faster, and every further row costs time; development recordings."""

LOWEST_CUTOFF: Final = 8.0
"""Hz; below, the motion itself would be cut off, however coarse the encoder; development recordings."""

CLOSE_CUTOFFS: Final = 1.5
"""ratio; joints with cut-offs closer than that share the lower: each further view of a recording takes the time of one,
and a little wider band shows hardly more; a choice."""

WIDE_ENOUGH: Final = 30.0
"""Hz; the highest cut-off of joints whose encoders permit more than the arm's narrowest band: coupling of joints lies
below it, and above resonances of transmissions begin, which in one joint's rows alone pass for those of another;
development recordings of two joints, at 48 and 88 Hz."""

SMOOTHING_OVER_CUTOFF: Final = 3.0
"""ratio to the cut-off; the position's smoothing stops there, so that it is flat inside the band; development
recordings."""

ROWS_OVER_CUTOFF: Final = 2.5
"""ratio of the rate of rows to the cut-off; twice the band filter's stop-band, which begins a quarter above the
cut-off: a compromise between its length and the rate of rows; sampling theorem."""

CUTOFF_OF_SAMPLING: Final = 1 / (2 * ROWS_OVER_CUTOFF)
"""part of the sampling rate; two samples a row: the smoothing has no room above; by construction."""

MOST_DELAY: Final = 4.0
"""samples; the band's filter has room to shift a torque by less: no larger skew is searched; by construction."""

# instruments' noise --------------------------------------------------------------------------------------------------

WHITE_BAND: Final = (0.3, 0.45)
"""parts of the sampling rate; between them a joint does not move and filters of the instruments pass: what is there is
noise; development recordings."""

FILTERED: Final = 6.0
"""ratio of densities, lower to upper end of the band of white noise; a torque that falls by more was filtered
before it was recorded; real recordings: below 3.5, and 11 where one was filtered."""

FOLLOWS_RATE: Final = 0.7
"""number; the correlation of noise and squared rate over blocks, from which on instants are uncertain; simulated
recordings: below 0.45 with even stamps, coarse encoders too, above 0.85 with stamps of whole milliseconds."""

# rests ---------------------------------------------------------------------------------------------------------------

STANDSTILL_OF_TOP_SPEED: Final = 0.002
"""part of the joint's fastest rate; below, it creeps, which a clean encoder would call motion; development
recordings."""

UNAFFECTED: Final = 0.97
"""part of a row; where the elimination leaves more, no unknown torque reached it; development recordings."""

HELD_RANGE: Final = {"revolute": 5e-3, "prismatic": 5e-4}
"""rad, m; a joint that never leaves a range like this is held by its friction, which has no direction then; development
recordings with held joints."""

# motion that comes back ----------------------------------------------------------------------------------------------

REPEAT_WINDOW_S: Final = 2.0
"""s; a window of motion that is searched later in the recording: long enough not to be alike by chance; development
recordings."""

REPEAT_ALIKE: Final = 0.003
"""part of a joint's range; positions that differ by less, RMS, are the same motion; development recordings, closed loop
with noise."""

REPEAT_ALIKE_RATE: Final = 0.03
"""part of a joint's fastest rate, beside standstill's; rates that differ by less, RMS, are the same motion; development
recordings, closed loop with noise."""

REPEATABLE_SHARE: Final = 0.33
"""part of the residual's variance; so much must come back with the motion for it to count as repeatable; development
recordings with disturbances from outside."""

MORE_THAN_NOISE: Final = 1.5
"""noise floors; an error beyond is more than noise, for every verb and page; recordings in which nothing is missing, of
fine and coarse encoders, even and uneven stamps: 1.0 to 1.25."""

RESOLVED: Final = 0.001
"""part of a joint's torque, RMS; nothing is named of an error below it; magnets weaken by a thousandth a kelvin, and a
motor's torque with them; the quietest development recordings have twice as much noise."""

# spectra of a residual -----------------------------------------------------------------------------------------------

SLOW_PART: Final = 0.15
"""part of the cut-off; below lie slow disturbances; development recordings with disturbances from outside."""

WHITE_PART: Final = (0.35, 0.85)
"""parts of the cut-off; between them noise is taken to be white: above slow physics, below the filter's edge;
development recordings."""

# lines over the motor's angle ----------------------------------------------------------------------------------------

LEAST_PERIODS: Final = 4.0
"""number of periods over the motion; with fewer a wave is no line, but one of many shapes over the position, or a wave
over time; an order is then known to a quarter, the Rayleigh limit; a choice."""

LEAST_OWN_NOISE: Final = 0.03
"""part of the noise of a torque that a drive's law makes; at least so much is taken to be the drive's own and not that
of the recorded positions, whose part is known to about as much; a choice."""
