"""Every number by which something about a recording is called suspicious, with its unit, its reason and its source."""

from __future__ import annotations

from typing import Final

FOLLOWS: Final = 0.95
"""part of a rate's integral that the position must explain before the scale between them is believed; a rate that is
filtered or late still follows to some per cent; a choice."""

UNRELATED: Final = 0.5
"""part of a rate's integral; a position that explains less of it is another signal: a rate that is noisy, or of which
samples are lost, is explained by 0.65 and more; real recordings."""

SCALE_OFF: Final = 0.15
"""part by which a rate may be larger or smaller than the derivative of its position; filters and coarse encoders cost
some per cent; the least of the mistaken units, rpm for rad/s, is a factor of 9.5."""

AGAINST_MOTION: Final = 0.02
"""part of the product of the effective torque and rate that the work may be negative: a joint that comes back to where
it was takes up what its friction dissipates; less may be a load that another joint lifts; a choice."""

RETURNED: Final = 0.5
"""part of its range within which a joint must end near its start; else its work may be a load's and not that of
friction; a choice."""

MANY_TURNS: Final = 1.5
"""number of turns; a position over more is a motor's or in degrees; joints of arms turn little more than once."""

WELL_TOLD: Final = 0.5
"""part of a parameter's value; a 95 % interval of a smaller half width tells its size and sign; a choice."""

SHIFT_PASSES: Final = 4
"""number of Gauss-Newton steps to a shift in time; each leaves the square of what the last left; Ljung, System
Identification, 1999."""

SMALLEST_SHIFT: Final = 0.1
"""part of a sample; a smaller shift between two signals cannot matter to what is made of them; a choice."""

MOVES_FROM: Final = 20.0
"""ratio of a range to its resolution or noise; what stays within is held; a choice."""

TOP_SPEED: Final = 0.999
"""part of the samples; what the fastest of them exceed may be noise of differences; a choice."""

LATEST_SHIFT: Final = 0.2
"""s; a later signal belongs to another motion; buses and filters take some ms, networks some 100 ms."""
