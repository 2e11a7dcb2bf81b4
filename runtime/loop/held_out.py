"""Residuals and noise floors of recordings that were not fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis.steps import residuals_elsewhere
from runtime.estimation.compare import JointSeries, laid_open
from runtime.estimation.identify import Identification, without_tip_rests
from runtime.estimation.problem import Problem
from runtime.motion import repeats
from runtime.motion.motion import Motion
from runtime.motion.noise_floor import Floor, floor
from runtime.motion.prepare import prepare
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]


def floors(identification: Identification, recordings: Sequence[Recording]) -> tuple[Floor, ...]:
    """Noise floor of each joint on recordings that were not fitted, in the band of the fit; empty without any."""
    return tuple(joint.floor for joint in left(identification, recordings).joints) if recordings else ()


@dataclass(frozen=True)
class HeldOut:
    """Residuals of a fit on recordings that were not fitted.

    residuals   (M,) for each joint, on all rows of the motion
    joints      torque and prediction of each joint, on the rows that are compared
    """

    motion: Motion
    residuals: tuple[Array, ...]
    joints: tuple[JointSeries, ...]


def left(identification: Identification, recordings: Sequence[Recording]) -> HeldOut:
    """Residuals of a fit on one or more recordings."""
    model, fit = identification.model, identification.fit
    motion = without_tip_rests(model, prepare(recordings, identification.motion.band, model))
    problem = Problem(model, motion, tuple(fit.shapes), fit.prediction, ahead=fit.ahead)
    found, residuals = repeats.find(motion), residuals_elsewhere(identification, motion)
    floors = []
    for i, residual in enumerate(residuals):
        noise, fixed_noise = problem.noise_rows(i, fit.shapes)
        floors.append(floor(motion, found[i], i, residual, read=fit.coefficients @ noise + fixed_noise))
    return HeldOut(motion, tuple(residuals), laid_open(identification, motion, residuals, floors))
