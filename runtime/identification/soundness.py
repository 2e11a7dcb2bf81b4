"""Whether a fit may be believed at all: noise compensation has limits, beyond which it invents what it cannot see.

The encoders' noise in the regressors is taken off the Gram matrix. Where it is most of a column, what is left is the
difference of two large estimates: it may be negative, or so small that a coefficient becomes what it likes. Such a fit
leaves more than plain least squares would, and at last more than no model at all.

Source: errors in variables and their compensation, Söderström, Automatica 43, 2007; that the compensated estimate
exists only where the compensated matrix is positive, Fuller, Measurement Error Models, 1987, section 2.5.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from runtime.identification.problem import Fit, Problem, Skew
from runtime.identification.regressors import Regressors
from runtime.identification.settings import FAR_WORSE, MOST_COMPENSATED
from runtime.model.loader import Model
from runtime.motion.motion import Motion

Array = NDArray[np.float64]


def compensated(model: Model, motion: Motion) -> float:
    """The largest part of an inertial column's power that is the encoders' noise; 0 without such columns."""
    regressors = Regressors(model, motion)
    power, noise = np.zeros(len(model.lumps)), np.zeros(len(model.lumps))
    for i in range(model.n):
        use = motion.moving(i)
        x = regressors.rigid(i)[:, use]
        power += np.sum(x**2, axis=1)
        noise += np.sum((regressors.perturbed.rigid(i)[:, use] - x) ** 2, axis=1)
    return float(np.max(np.divide(noise, power, out=np.zeros_like(power), where=power > 0), initial=0.0))


def reason(problem: Problem, fit: Fit) -> str | None:
    """Why a fit cannot be believed; None where nothing speaks against it."""
    return _worse_than_none(problem, fit) or _mostly_noise(problem, fit) or _worse_than_plain(problem, fit)


def _worse_than_none(problem: Problem, fit: Fit) -> str | None:
    for i, left in enumerate(fit.residual):
        use = problem.motion.moving(i)
        torque = float(np.sum(problem.motion.torque(i, fit.skew)[use] ** 2))
        if (rest := float(left[use] @ left[use])) > torque:
            error = 100 * float(np.sqrt(rest / max(torque, 1e-300)))
            return (
                f"joint {i + 1}: the fit is worse than no model (error {error:.0f} %): these recordings do not tell "
                "its parameters; record faster motion, or with a finer encoder"
            )
    return None


def _mostly_noise(problem: Problem, fit: Fit) -> str | None:
    """What another reading of the encoders would change in a joint's predicted torque, against that torque."""
    for i in range(problem.model.n):
        use = problem.motion.moving(i)
        noise, fixed = problem.noise_rows(i, fit.shapes)
        read = (fit.coefficients @ noise + fixed)[use]
        torque = problem.motion.torque(i, fit.skew)[use]
        part = float(read @ read) / max(float(torque @ torque), 1e-300)
        if part > MOST_COMPENSATED:
            return (
                f"joint {i + 1}: {100 * min(part, 1.0):.0f} % of the power of its torque would be the encoder's noise, "
                "differentiated twice; record faster motion, or with a finer encoder"
            )
    return None


def _worse_than_plain(problem: Problem, fit: Fit) -> str | None:
    for i, (mine, theirs) in enumerate(zip(_squares(problem, fit.residual), _plain(problem, fit), strict=True)):
        if mine > FAR_WORSE * theirs:
            times = float(np.sqrt(mine / max(theirs, 1e-300)))
            return (
                f"joint {i + 1}: compensated for the encoder's noise, the fit leaves {times:.1f} "
                "times what plain least squares leave of the torque: the noise is too much of what the model reads; "
                "record faster motion, or with a finer encoder"
            )
    return None


def _squares(problem: Problem, residual: Sequence[Array]) -> list[float]:
    return [float(w**2 * (r @ r)) for w, r in zip(problem.weights, residual, strict=True)]


def _plain(problem: Problem, fit: Fit) -> list[float]:
    """Per joint the weighted squared error of least squares without compensation, on the rows and with the shapes of
    a fit."""
    system = problem.system(fit.shapes, Skew(fit.skew)).without_noise()
    return _squares(problem, system.residual(system.least(problem.inertia_cut)))
