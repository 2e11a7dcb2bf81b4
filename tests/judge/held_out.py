"""The error on a recording that was not fitted, beside what a perfect model would leave of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from runtime.arrays import Array
from runtime.diagnosis.steps import errors_elsewhere
from runtime.diagnosis.verdict import Diagnosis
from runtime.motion.motion import Motion, prepare

from .bodies import torque
from .cases import Made
from .hidden import Rows


def error_and_floor(made: Made, found: Diagnosis) -> tuple[Array, Array]:
    """RMS (n,) N m at each joint, in the diagnosis's band: of the last step's residual, and of the noise alone.

    The noise is what the simulator knows: of the torque, of the push from outside, and of the encoder, which a perfect
    model turns into torque by the true inertia and friction.
    """
    fit = found.steps[-1].fit
    band, model = fit.motion.band, fit.model
    motion = fit.on(prepare([made.held_out], band, model))
    bare = replace(made.held_out, q=made.exact, tau=made.disturbed, qd=None, q_link=None)
    floor = _floor(made, motion, prepare([bare], band, model))
    return np.array(errors_elsewhere(fit, motion).rms), floor


def _floor(made: Made, motion: Motion, bare: Motion) -> Array:
    """bare: of the true angles, with a torque that is what disturbs it alone."""
    bodies, gravity, floor = made.bodies, made.case.setting.gravity, np.zeros(motion.n)
    for view, exactly in zip(motion.views, bare.views, strict=True):
        (piece,), (truth,) = view.pieces, exactly.pieces
        # What is known exactly may keep a row more at an end.
        at = np.searchsorted(truth.t, piece.t - piece.dt / 2).clip(max=len(truth.t) - 1)
        exact, measured = (np.array([p.q, p.qd, p.qdd]) for p in (truth, piece))
        exact, disturbed = exact[..., at], truth.tau[:, at]
        encoder = torque(bodies, measured, gravity) - torque(bodies, exact, gravity)
        encoder += _friction(made.rows, measured[1]) - _friction(made.rows, exact[1])
        for i, row in piece.equations(disturbed - encoder, view.joints).items():
            floor[i] = np.sqrt(np.mean(row[motion.moving(i)] ** 2))
    return floor


def _friction(rows: Rows, rate: Array) -> Array:
    """(n, N) N m of what is no hidden effect."""
    out = np.empty_like(rate)
    for i, (row, v) in enumerate(zip(rows, rate, strict=True)):
        out[i] = np.where(v > 0, row["DRY_POSITIVE"], -row["DRY_NEGATIVE"])
        out[i] += row["VISCOUS_POSITIVE"] * v + row["CUBIC"] * v**3
    return out
