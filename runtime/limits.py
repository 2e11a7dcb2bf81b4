"""Detection limits: how large an effect would have had to be for these recordings to show it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from runtime import grids
from runtime.candidates import Field
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


def at_joint(field: Field, joint: int, floor: float) -> list[Limit]:
    """Limits of every candidate that is judged at a joint (0-based), where the recordings have any."""
    found = []
    for term in field.terms(joint):
        limit = _limit(field, term, floor)
        if limit is not None:
            found.append(limit)
    return found


def _limit(field: Field, term: Term, floor: float) -> Limit | None:
    info = field.model.library.effects[term.effect]
    shapes = grids.points(field.regressors, term)
    if not shapes:
        return None
    joints = joints_of(field.model, term)
    rows = field.rows(joints, field.replaced(term))
    least = float(max(LEAST_EFFECT * floor, floor * np.sqrt((LEAST_DELTA_BIC + np.log(rows.count)) / rows.count)))
    if not info.coefficients:
        return _stiffness_limit(field, term, shapes, least)
    column = field.block(term, joints, shapes[len(shapes) // 2]).columns[:1]
    own = rows.orthogonal(column)[0]
    rms = float(np.sqrt(own @ own / rows.count))
    if rms <= _SEPARATE * float(np.sqrt(np.mean(column[0, rows.use] ** 2))):
        return None
    coefficient = info.coefficients[0]
    unit = coefficient.unit(field.model.joints[(term.joint or 1) - 1].type)
    return Limit(term, coefficient.name, "above", least / rms, unit)


def _stiffness_limit(field: Field, term: Term, shapes: list[dict[str, float]], least: float) -> Limit | None:
    """For an effect that vanishes as its first shape parameter grows: the largest value that still shows."""
    joints = joints_of(field.model, term)
    rows = field.rows(joints)
    name = next(iter(shapes[0]))
    values = sorted({shape[name] for shape in shapes})
    seen = None
    for value in values:
        choices = [s for s in shapes if s[name] == value]
        fixed = field.block(term, joints, choices[len(choices) // 2]).fixed
        if not np.all(np.isfinite(fixed)):
            continue
        own = rows.orthogonal(fixed[None])[0]
        if np.sqrt(own @ own / rows.count) > least:
            seen = value
    return None if seen is None else Limit(term, name, "below", seen, unit_of(field.model, term, name))
