"""The noise floor of recordings that were held out: what a perfect model would leave of them."""

from __future__ import annotations

from collections.abc import Sequence

from runtime.diagnosis.steps import residuals_elsewhere
from runtime.estimation.identify import Identification, without_tip_rests
from runtime.estimation.problem import Problem
from runtime.motion import repeats
from runtime.motion.motion import prepare
from runtime.motion.noise_floor import Floor, floor
from runtime.recordings.recording import Recording


def floors(identification: Identification, recordings: Sequence[Recording]) -> tuple[Floor, ...]:
    """Floor of every joint on recordings that were not fitted, in the band of the fit; empty without recordings."""
    if not recordings:
        return ()
    model, fit = identification.model, identification.fit
    motion = without_tip_rests(model, prepare(recordings, identification.motion.band, model))
    problem = Problem(model, motion, tuple(fit.shapes), fit.prediction, fit.ahead)
    found = repeats.find(motion)
    floors = []
    for i, residual in enumerate(residuals_elsewhere(identification, motion)):
        noise, fixed_noise = problem.noise_rows(i, fit.shapes)
        floors.append(floor(motion, found, i, residual, fit.coefficients @ noise + fixed_noise))
    return tuple(floors)
