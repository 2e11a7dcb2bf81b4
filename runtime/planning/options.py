"""What one may choose of an optimization. Nothing slow is imported here: --help reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from runtime.setting import Checked, Setting

Starts = Annotated[int | None, Setting("Random first guesses; few by default.", 1, 10_000)]


@dataclass(frozen=True)
class PlanningSettings(Checked):
    """Of the search. starts: None: one, or several where postures are free because points ask for the end-effector
    only."""

    starts: Starts = None
    seed: Annotated[int, Setting("Another seed is other guesses.", low=0)] = 0
