"""What one may choose of the paper's study. Nothing slow is imported here: --help reads it."""

from __future__ import annotations

from typing import Annotated

from runtime.setting import Setting

TRIALS = 3
Trials = Annotated[int, Setting("Of each case on the simulated arm; 0: only the optimizations.", 0, 20)]
