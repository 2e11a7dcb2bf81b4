"""A value as a fit or a further sensor gives it, with what is known of its error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval; `with_others`: parameters with which it can only be told together.

    No interval and no others: no row says anything of it, and it is as the model file has it.
    """

    value: float
    interval: tuple[float, float] | None
    unit: str
    with_others: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """null stands for what has no value: the rest position of a spring of no stiffness."""
        known = self.interval if self.interval and np.all(np.isfinite(self.interval)) else None
        value = self.value if np.isfinite(self.value) else None
        document: dict[str, Any] = {"value": value, "unit": self.unit, "interval": list(known) if known else None}
        if self.with_others:
            document["inseparable_from"] = list(self.with_others)
        return document
