"""Steps of a search: a structure fitted, its errors on what was fitted and on what was not, and what a step added."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis.gates import Evidence, Verdict
from runtime.identification.compare import JointSeries, errors, series
from runtime.identification.identify import Identification
from runtime.identification.problem import Problem
from runtime.model.terms import Term, Values
from runtime.motion.motion import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Errors:
    """Error of every joint on one set of recordings: RMS and ‖τ − τ̂‖/‖τ‖."""

    rms: tuple[float, ...]
    relative: tuple[float, ...]


@dataclass(frozen=True)
class Step:
    """A fitted structure: after `added` (None: the model as given)."""

    added: Term | None
    identification: Identification
    joints: tuple[JointSeries, ...]
    fitted: Errors
    held_out: Errors | None

    @classmethod
    def of(
        cls,
        added: Term | None,
        identification: Identification,
        joints: tuple[JointSeries, ...] | None = None,
        held_out: Errors | None = None,
    ) -> Step:
        """With the errors of its joints; joints: the series of the identification where they are there already."""
        found = series(identification) if joints is None else joints
        errors = Errors(tuple(j.rms for j in found), tuple(j.relative for j in found))
        return cls(added, identification, found, errors, held_out)

    @property
    def floors(self) -> list[float]:
        """Noise floor of every joint, in the unit of its torque."""
        return [s.floor.value for s in self.joints]

    @property
    def shapes(self) -> dict[Term, Values]:
        """Shape parameters of every term, as found."""
        return self.identification.fit.shapes

    @property
    def values(self) -> dict[Term, Values]:
        """Shapes, and the parameters of what a further sensor shows: what stands in a model file with this step."""
        fit = self.identification.fit
        return {**fit.shapes, **{t: {name: e.value for name, e in v.items()} for t, v in fit.witnessed.items()}}


@dataclass(frozen=True)
class Finding:
    """A named effect: what speaks for it, what the data cannot tell from it, and against whom it was chosen.

    refuted   those of the rivals that explain held-out recordings clearly less, with nothing else beside them
    """

    evidence: Evidence
    rivals: tuple[Term, ...]
    verdict: Verdict
    before: Step
    after: Step
    refuted: tuple[Term, ...] = ()

    @property
    def term(self) -> Term:
        return self.evidence.term

    @property
    def joint_index(self) -> int:
        """Of the joint (0-based) at which it shows: its own, or for one of the whole arm that where it shows most."""
        if self.term.joint is not None:
            return self.term.joint - 1
        falls = [1 - b / a if a else 0.0 for a, b in zip(self.before.fitted.rms, self.after.fitted.rms, strict=True)]
        return int(np.argmin([-f for f in falls]))

    def share(self) -> float:
        """(rms_before² − rms_after²) / (rms_before² − floor²), at most 1; of the twist where that is what shows it."""
        if self.evidence.twist is not None:
            return min(self.evidence.share, 1.0)
        i = self.joint_index
        before, after = self.before.fitted.rms[i], self.after.fitted.rms[i]
        excess = before**2 - self.before.joints[i].floor.value ** 2
        return float(np.clip((before**2 - after**2) / excess, 0.0, 1.0)) if excess > 0 else 0.0


def errors_elsewhere(identification: Identification, motion: Motion) -> Errors:
    """Error of a fit, all its values as they are, on another motion."""
    found = []
    for i, left in enumerate(residuals_elsewhere(identification, motion)):
        use = motion.moving(i)
        found.append(errors(left[use], motion.recorded(i, identification.fit.skew)[use]))
    return Errors(tuple(rms for rms, _ in found), tuple(relative for _, relative in found))


def residuals_elsewhere(identification: Identification, motion: Motion) -> list[Array]:
    """Per joint (M,) what a fit, all its values as they are, leaves of the torque on another motion; zero in rows
    that do not count."""
    fit, model = identification.fit, identification.model
    problem = Problem(model, motion, tuple(fit.shapes), prediction=fit.prediction, ahead=fit.ahead)
    found = []
    for i in range(model.n):
        with np.errstate(over="ignore", invalid="ignore"):  # what is simulated along another motion may have no end
            x, fixed = problem.rows(i, fit.shapes)
            left = motion.torque(i, fit.skew) - (fixed + fit.coefficients @ x)
        found.append(np.where(motion.moving(i), left, 0.0))
    return found


def seconds_moving(motion: Motion, joint: int) -> float:
    """For how long a joint (0-based) moves faster than its encoder's noise."""
    return float(motion.moving(joint).sum()) / motion.row_rate(joint)
