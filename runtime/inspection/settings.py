"""Thresholds of the inspection of recordings, each with unit, reason and source."""

from __future__ import annotations

from typing import Final

FOLLOWS: Final = 0.95
"""part of a rate's integral that the position must explain before the scale between them counts; a filtered or late
rate still fits to some per cent; a choice."""

SCALE_OFF: Final = 0.15
"""part by which a rate may differ from the derivative of its position; filters and coarse encoders cause some per cent;
the smallest factor of a wrong unit, rpm for rad/s, is 9.5."""

MANY_TURNS: Final = 1.5
"""number of turns; a position over more is the motor's or in degrees; joints of arms turn little more than once."""

MOVES_FROM: Final = 20.0
"""ratio of a range to its resolution or noise; below it the joint is held; a choice."""

LATEST_SHIFT: Final = 0.2
"""s; a longer delay belongs to another motion; buses and filters take some ms, networks some 100 ms."""
