"""Detection limits: how large an effect would have had to be for these recordings to show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from runtime import grids
from runtime.candidates import Field
from runtime.evidence import Ground
from runtime.judge import LEAST_DELTA_BIC, LEAST_EFFECT
from runtime.terms import Term, joints_of, unit_of

Array = NDArray[np.float64]

_SEPARATE = 1e-3
"""Part of a candidate's torque that must not be the base model's too, for a limit to mean anything."""


@dataclass(frozen=True)
class Limit:
    """A parameter above (or below) which the effect would have been seen."""

    term: Term
    parameter: str
    side: Literal["above", "below"]
    value: float
    unit: str

    def to_json(self) -> dict[str, Any]:
        return {
            "effect": self.term.effect,
            "joint": self.term.joint,
            "parameter": self.parameter,
            self.side: self.value,
            "unit": self.unit,
        }


def of(field: Field, floors: Sequence[float], joints: Sequence[int]) -> list[Limit]:
    """Limits of every candidate that acts first on one of these joints (0-based), where the recordings have any."""
    found = []
    for term in field.terms():
        own = joints_of(field.model, term)[0]
        limit = _limit(field, term, own, floors[own]) if own in joints else None
        if limit is not None:
            found.append(limit)
    return found


def _limit(field: Field, term: Term, own: int, floor: float) -> Limit | None:
    info = field.model.library.effects[term.effect]
    shapes = grids.points(field.excerpt[0], term)
    if not shapes:
        return None
    ground = field.without(field.excerpt[1], field.replaced(term))
    count = field.ground.rows[own].count
    least = float(max(LEAST_EFFECT * floor, floor * np.sqrt((LEAST_DELTA_BIC + np.log(count)) / count)))
    rms = field.rms(own) / float(np.sqrt(max(1, ground.rows[own].count)))
    if not info.coefficients:
        return _stiffness_limit(field, term, shapes, ground, least / rms)
    block = field.trial(term, shapes[len(shapes) // 2])
    kept, whole = ground.own({i: part.columns[1] for i, part in block.parts.items()})
    if kept <= _SEPARATE**2 * whole:
        return None
    coefficient = info.coefficients[0]
    unit = coefficient.unit(field.model.joints[(term.joint or 1) - 1].type)
    return Limit(term, coefficient.name, "above", least / (rms * float(np.sqrt(kept))), unit)


def _stiffness_limit(
    field: Field, term: Term, shapes: list[dict[str, float]], ground: Ground, least: float
) -> Limit | None:
    """For an effect that vanishes as its first shape parameter grows: the largest value that still shows."""
    name = next(iter(shapes[0]))
    seen = None
    for value in sorted({shape[name] for shape in shapes}):
        choices = [s for s in shapes if s[name] == value]
        block = field.trial(term, choices[len(choices) // 2])
        if (
            all(np.isfinite(p.columns).all() for p in block.parts.values())
            and ground.own({i: p.columns[0] for i, p in block.parts.items()})[0] > least**2
        ):
            seen = value
    return None if seen is None else Limit(term, name, "below", seen, unit_of(field.model, term, name))
