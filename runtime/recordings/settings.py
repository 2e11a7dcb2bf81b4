"""Every number by which a recording is refused before anything is fitted, with its unit, its reason and its source."""

from __future__ import annotations

from typing import Final

SLOWEST_STEP: Final = 0.2
"""s; a median step above it is no log of a moving joint but a time in another unit: field buses and loggers of motion
run from some Hz to some kHz, and a clock in milliseconds reads 0.2 at 5 kHz; a choice between the two."""
