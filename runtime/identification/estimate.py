"""A value as a fit or a further sensor gives it, with what is known of its error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec import UNSET, UnsetType

from runtime.documents.parts import EstimateEntry


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval; `with_others`: parameters with which it can only be told together.

    No interval and no others: no row says anything of it, and it is as the model file has it.
    """

    value: float
    interval: tuple[float, float] | None
    unit: str
    with_others: tuple[str, ...] = ()

    @property
    def known_value(self) -> float | None:
        """The value; None where there is none, as the rest position of a spring of no stiffness."""
        return self.value if np.isfinite(self.value) else None

    @property
    def known_interval(self) -> tuple[float, float] | None:
        """The interval; None where it is infinite."""
        return self.interval if self.interval and np.all(np.isfinite(self.interval)) else None

    @property
    def inseparable_from(self) -> list[str] | UnsetType:
        """`with_others` as a key of a document."""
        return list(self.with_others) or UNSET

    @property
    def fitted(self) -> dict[str, Any]:
        """As keys of an entry of a fit."""
        known = {"fit": self.known_value, "interval": self.known_interval}
        return {**known, "unit": self.unit, "inseparable_from": self.inseparable_from}

    def document(self) -> EstimateEntry:
        return EstimateEntry(
            value=self.known_value, unit=self.unit, interval=self.known_interval, inseparable_from=self.inseparable_from
        )
