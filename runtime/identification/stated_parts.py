"""How much of what the model file states of links and rotors is in a recorded torque: all of it, a hundredth, nothing.

A joint's torque is fitted with the torque of all stated values as one column, beside a column for each value that the
file leaves open and for each effect. Its coefficient is near 1 where torque and file are right, and shows a factor by
which either is wrong even where inertias are partly unknown. Gravity's part of it is 0 where the driver takes gravity
out of the torque.

Source: partialled-out regression, Frisch & Waugh, Econometrica 1, 1933.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.identification.problem import Problem
from runtime.identification.recorded_torque import without_weight
from runtime.identification.settings import SUSPECTED_RATIO
from runtime.model.loader import Model
from runtime.model.terms import Term, Values
from runtime.motion.settings import CERTAIN, LITTLE, SOME


@dataclass(frozen=True)
class StatedPart:
    """The part of a stated torque that is in a recorded one.

    value   1: all of it      spread  by how much the residual, if all of it were of the stated torque's form, moves it
    told    whether no open value makes a torque of that form
    stated, recorded   N m (N), RMS
    """

    value: float
    spread: float
    told: bool
    stated: float
    recorded: float

    @property
    def counts(self) -> bool:
        """Whether the recorded torque has a part of the stated one's form, however small."""
        return self.told and abs(self.value) > CERTAIN * self.spread

    @property
    def far_below(self) -> bool:
        return self.counts and abs(self.value) + self.spread < 1 / SUSPECTED_RATIO

    @property
    def far_above(self) -> bool:
        return self.counts and abs(self.value) - self.spread > SUSPECTED_RATIO

    @property
    def weighs(self) -> bool:
        """Whether it is a part of the recorded torque that nothing else makes, if it is there."""
        return self.told and self.stated > SOME * self.recorded

    @property
    def present(self) -> bool:
        """Whether more of it is there than would be left if it had been taken out."""
        return self.value - self.spread > SOME

    @property
    def absent(self) -> bool:
        """Whether nothing of it is there, although the recorded torque is large enough to have it."""
        return abs(self.value) + self.spread < SOME and self.recorded * SUSPECTED_RATIO > self.stated


def stated_part(stated: Array, others: Array, torque: Array) -> StatedPart:
    """The part of a stated torque (M,) in a recorded one (M,), beside other columns (k, M); norms are RMS values."""
    size, recorded = float(np.linalg.norm(stated)), float(np.linalg.norm(torque))
    scale = np.linalg.norm(others, axis=1)
    used = others[scale > 0] / scale[scale > 0, None]
    both = np.stack([stated, torque], axis=1)
    if len(used):
        both = both - used.T @ np.linalg.lstsq(used.T, both, rcond=None)[0]
    own, left = both.T
    power = float(own @ own)
    # Less than that of what open values cannot imitate is told by what the model lacks.
    if size == 0 or power <= (LITTLE * size) ** 2:
        return StatedPart(0.0, np.inf, False, size, recorded)
    value = float(own @ left) / power
    spread = float(np.linalg.norm(left - value * own)) / np.sqrt(power)
    return StatedPart(value, spread, told=True, stated=size, recorded=recorded)


def stated_lumps(model: Model) -> tuple[NDArray[np.bool_], Array]:
    """(p,) whether the model file states a base inertial parameter, and (p,) its value, 0 where it does not."""
    known = np.array([lump.value is not None for lump in model.lumps])
    return known, np.array([lump.value or 0.0 for lump in model.lumps])


def of_all_stated(model: Model, columns: Array, torque: Array) -> StatedPart:
    """The part of all stated inertial parameters in a joint's torque (M,); columns (K, M): of all unknowns of a
    problem, the inertial parameters' first."""
    known, values = stated_lumps(model)
    own = columns[: len(known)]
    return stated_part(values @ own, np.vstack([own[~known], columns[len(known) :]]), torque)


def of_stated_gravity(
    problem: Problem, shapes: Mapping[Term, Values], torques: Sequence[Array]
) -> dict[int, StatedPart]:
    """Joint (0-based) -> the part of the stated masses' weight in its torque (M,); joints without such a weight are
    left out."""
    model, motion, found = problem.model, problem.motion, {}
    known, values = stated_lumps(model)
    for i, torque in enumerate(torques):
        use = motion.moving(i)
        weights = problem.regressors.weights(i)[:, use]
        weight = values @ weights
        if use.any() and np.any(weight):
            columns, fixed = problem.rows(i, shapes)
            columns, scale = columns[:, use], 1 / np.sqrt(np.count_nonzero(use))
            moving = columns[: len(known)] - (0.0 if without_weight(motion) else weights)
            others = [(values @ moving)[None], moving[~known], weights[~known], columns[len(known) :]]
            found[i] = stated_part(scale * weight, scale * np.vstack(others), scale * (torque - fixed)[use])
    return found
