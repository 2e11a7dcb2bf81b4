"""Unknown gains of the drives: identified with the model, where something known gives the scale.

    c0 x0 + sum of c_k x_k = Y θ + effects        x: columns of the drive's law, c: its coefficients

Divided by c0, the equation is linear in 1/c0, c_k/c0 and what is unknown of the arm; the torque of stated masses and
inertias is the column of 1/c0. The command's column stands alone, because what the model lacks is in it: on the other
side, that error would draw all unknowns towards zero. Simple effects that the model lacks stand beside, unless they
imitate a gain: else a gain would make up for them. Where nothing is stated, ratios alone are told, and all torques stay
in the unit of the command.

Source: Gautier & Briot, ASME J. Dynamic Systems, Measurement, and Control 136(5), 2014; covariance over stretches of
time, Newey & West, Econometrica 55(3), 1987.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.identification.fit import Fit, quantile
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import prepared
from runtime.identification.problem import Problem
from runtime.identification.regressors import is_delay
from runtime.identification.settings import INTERVAL_SIGMAS, SCORE_BLOCK_S, SPARED, STATED_MASS
from runtime.identification.stated_parts import stated_lumps
from runtime.model.loader import Model
from runtime.model.terms import Term, joints_of, structure
from runtime.motion.motion import Motion
from runtime.motion.settings import LITTLE, MOST
from runtime.recordings.driven import DrivenJoint, ToldGain
from runtime.recordings.recording import Recording, RecordingError
from runtime.regression.bounded import bounded, inverse
from symbolic.model_file.drive_laws import SATURATION


def with_gains(model: Model, recordings: Sequence[Recording], fitted: int) -> list[Recording]:
    """Recordings whose torques have the identified coefficients of the drives; as they are where all are stated.

    fitted   how many of them, the first ones, are identified with
    Raises RecordingError.
    """
    found, own = list(recordings), recordings[:fitted]
    if not any(r.gains_open for r in own):
        return found
    limited = any(j is not None and j.unknown and SATURATION in j.gains for r in own for j in r.driven)
    for part in SPARED if limited else SPARED[:1]:
        found = [r.sparing(part) for r in recordings]
        # The band and the torques that effects read follow the scale; a command's own delay is told with a scale alone.
        first, passes = 2, 4 if model.n == 1 else 5
        for k in range(passes):
            motion = prepared(model, found[:fitted])
            whole, structured = motion.all_late, structure(model)
            fit = fit_motion(model, whole if k < first else motion, structured)
            if k >= first and fit.ahead is not None and np.any(fit.ahead.whole & (fit.ahead.times != 0)):
                fit = fit_motion(model, whole, structured)
            told = told_gains(fit)
            found = [r.with_gains(told) for r in found]
        if not limited or all(_cuts_less(r, part) for r in found[:fitted]):
            break
    else:
        found = [r.sparing(0.0) for r in found]
    _check_scales(model, found[0], told)
    return found


def _cuts_less(recording: Recording, part: float) -> bool:
    """Whether the drives' limits cut, by gains that are told, no more than a part of the samples."""
    return all(
        joint is None or (not joint.without_scale and float(np.mean(joint.cut)) <= part) for joint in recording.driven
    )


def _check_scales(model: Model, recording: Recording, told: Mapping[int, Mapping[str, ToldGain]]) -> None:
    """Refuse an arm of several joints of which some torques have a scale and others have none: they share masses."""
    for i, gains in told.items():
        if model.n > 1 and gains and next(iter(gains.values())).interval is None:
            name = next(iter(gains))
            raise RecordingError(
                f"{recording.path}: nothing known tells {name} of the drive of joint {i + 1}, without which its "
                f"torque has another unit than those of other joints; state {name}, or the weight that it moves"
            )


def with_gains_of(fit: Fit, joint: int) -> DrivenJoint | None:
    """The drive of a joint (0-based) with the gains that a fit tells; None where the torque was recorded."""
    driven = fit.motion.driven[joint] if fit.motion.driven else None
    return driven and (driven.with_told(told_gains(fit)[joint]) if driven.unknown else driven)


def told_gains(fit: Fit) -> dict[int, dict[str, ToldGain]]:
    """The coefficients of each joint (0-based) that has unknown ones."""
    own = fit.problem.regressors
    again = Problem(fit.model, fit.motion.perturbed, fit.problem.layout.terms, own.prediction, own.ahead)
    found = {
        i: _of_joint(fit, again, i, joint)
        for i, joint in enumerate(fit.motion.driven)
        if joint is not None and joint.unknown
    }
    return found | {i: _scaled(found[i], over) for i, over in _over_shared(fit, found).items()}


def _over_shared(fit: Fit, found: Mapping[int, Mapping[str, ToldGain]]) -> dict[int, float]:
    """By joint (0-based) how much larger its command's coefficient is than the inertias that joints share make it
    beside that of the first, as far as these tell more than what is stated of the joint alone: in the logarithm, the
    mean of both by their variances."""
    gains, driven, over = fit.motion.gains, fit.motion.driven, dict[int, float]()
    parts = dict(zip(gains, fit.coefficients[fit.problem.layout.gains], strict=True))
    commands = {i: (i, joint.command_gain) for i, joint in enumerate(driven) if i in found and joint is not None}

    changes = {
        i: found[i][joint.command_gain].value / joint.told[joint.command_gain].value
        for i, joint in enumerate(driven)
        if i in found and joint is not None and joint.command_gain in joint.identified
    }
    first = next((change for i, change in changes.items() if commands[i] not in parts), 1.0)
    for i, change in changes.items():
        if commands[i] in parts:
            low, high = found[i][commands[i][1]].interval or (0.0, np.inf)
            alone = ((high - low) / (2 * INTERVAL_SIGMAS * found[i][commands[i][1]].value)) ** 2 + STATED_MASS**2
            place = fit.problem.layout.gains.start + gains.index(commands[i])
            shared = float(fit.uncertainty.covariance[place, place])
            ratio = max(change * (1.0 + float(parts[commands[i]])) / first, STATED_MASS)
            over[i] = float(ratio ** (alone / (alone + shared)))
    return over


def _scaled(gains: Mapping[str, ToldGain], by: float) -> dict[str, ToldGain]:
    """Gains divided by a factor."""
    return {
        name: replace(g, value=g.value / by, interval=g.interval and (g.interval[0] / by, g.interval[1] / by))
        for name, g in gains.items()
    }


@dataclass(frozen=True)
class _Equation:
    """One joint's: y (M,) = θ · columns (K, M), the first `gains` of which are the drive's; noise (K, M): what the
    encoders add to them; heard (M,): to y; stretch (M,): of time, by number."""

    y: Array
    heard: Array
    columns: Array
    noise: Array
    lower: Array
    upper: Array
    stretch: NDArray[np.intp]
    gains: int

    def beside(self, columns: Array) -> _Equation:
        """The same with further columns (k, M), of any sign."""
        free = np.full(len(columns), np.inf)
        return replace(
            self,
            columns=np.vstack([self.columns, columns]),
            noise=np.vstack([self.noise, np.zeros_like(columns)]),
            lower=np.concatenate([self.lower, -free]),
            upper=np.concatenate([self.upper, free]),
        )

    def solved(self) -> tuple[Array, Array]:
        """θ (K,) and half of its intervals (K,), with residuals that hang together within a stretch of time."""
        gram = self.columns @ self.columns.T - self.noise @ self.noise.T
        theta = bounded(gram, self.columns @ self.y - self.noise @ self.heard, self.lower, self.upper)
        scores = self.columns * (self.y - theta @ self.columns)
        each = np.array([scores[:, self.stretch == s].sum(axis=1) for s in np.unique(self.stretch)])
        over = inverse(gram)
        spare = max(1, len(each) - len(theta))
        variance = np.diag(over @ (each.T @ each) @ over.T) * len(each) / spare
        return theta, quantile(len(each) - 1) * np.sqrt(np.maximum(variance, 0.0))

    def own(self, k: int) -> float:
        """Part of a column's size that no other column imitates."""
        others = np.delete(self.columns, k, axis=0)
        others = others[others.any(axis=1)]
        size = float(np.linalg.norm(self.columns[k]))
        if size == 0.0 or not len(others):
            return float(size > 0.0)
        scaled = others / np.linalg.norm(others, axis=1, keepdims=True)
        left = self.columns[k] - np.linalg.lstsq(scaled.T, self.columns[k], rcond=None)[0] @ scaled
        return float(np.linalg.norm(left)) / size


def _of_joint(fit: Fit, again: Problem, i: int, joint: DrivenJoint) -> dict[str, ToldGain]:
    """The unknown coefficients of a joint's (0-based) drive; one that effects imitate is left out, and they have it.

    A command that acts late has the slope of its part, as far as the fit tells by how much it is late; else what the
    model lacks would pass for that, and only the slope of the whole torque, which imitates no gain, stands for it.
    """
    late = fit.skew + fit.problem.regressors.late(i)
    whole = fit.problem.regressors.whole(i)

    def given(motion: Motion) -> dict[str, Array]:
        """Columns of the unknown gains, and "": the torque of those that are known."""
        columns = {name: motion.torque_per_gain((i, name), late, whole) for name in joint.unknown}
        made = sum(joint.acting[name] * column for name, column in columns.items())
        return columns | {"": motion.torque_delayed(i, late, 0.0, whole) - made}

    columns, noisy = given(fit.motion), given(again.motion)
    noise = {name: noisy[name] - x for name, x in columns.items()}
    command = joint.command_gain
    others = [name for name in joint.unknown if name != command]
    asked = command if command in joint.unknown else ""
    equation = _equation(fit, again, i, (columns, noise), asked, others)
    alike = [name for k, name in enumerate(others) if equation.own(k) < LITTLE]
    if alike:
        others = [name for name in others if name not in alike]
        equation = _equation(fit, again, i, (columns, noise), asked, others)
    slope = fit.problem.regressors.skew(i, late) if fit.skew_free else fit.motion.slope(i)
    use = fit.motion.moving(i)
    late_too = equation.beside(slope[None, use])
    wider = late_too.beside(_lacking(fit, i)[:, use])
    if all(wider.own(k) > LITTLE for k in range(wider.gains) if wider.columns[k].any()):
        equation = wider
    found = _gains(fit, i, joint, (equation, late_too), others, bool(asked))
    return found | {name: ToldGain(name, 0.0, "", None, imitated=True) for name in alike}


def _lacking(fit: Fit, i: int) -> Array:
    """(K, M) columns of effects that the model lacks at a joint (0-based) and that are linear in all parameters: what a
    gain would otherwise make up for."""
    library, found = fit.model.library, []
    for name, effect in library.effects.items():
        term = Term(name, i + 1)
        if (
            effect.scope == "joint"
            and not effect.shape
            and library.needs[name] <= {"motion"}
            and term not in fit.shapes
        ):
            found.append(fit.problem.regressors.columns(term, i, {})[1:])
    return np.vstack(found) if found else np.zeros((0, len(fit.motion.row_piece(i))))


def _equation(
    fit: Fit,
    again: Problem,
    i: int,
    given: tuple[Mapping[str, Array], Mapping[str, Array]],
    command: str,
    others: Sequence[str],
) -> _Equation:
    """A joint's (0-based) equation: over the command's coefficient, unless that is known ("").

    given: by gain and, of those that are known together, by "", (M,) the torque per unit; and the encoders' noise in it
    """
    use, layout = fit.motion.moving(i), fit.problem.layout
    (x, fixed), (x_again, fixed_again) = (_undelayed(p, fit, i) for p in (fit.problem, again))
    stated, values = stated_lumps(fit.model)
    pinned, pinned_again = (values @ rows[: len(stated)] + f for rows, f in ((x, fixed), (x_again, fixed_again)))
    free = np.append(~stated, np.ones(len(x) - len(stated), dtype=bool)) & x.any(axis=1)
    free[layout.gains] = False  # they are asked for here
    sides = zip(given, (pinned, pinned_again - pinned), strict=True)
    own, noise = (np.stack([*(-part[name] for name in others), rest - part[""]]) for part, rest in sides)
    y, heard = (part[command] if command else -rows[-1] for part, rows in zip(given, (own, noise), strict=True))
    lower, upper = _one_sided(layout.lower[free]), _one_sided(layout.upper[free])
    count = len(own) if command else len(own) - 1
    blocks = fit.motion.row_piece(i) * 10**6 + (fit.motion.row_time(i) / SCORE_BLOCK_S).astype(int)
    return _Equation(
        y[use],
        heard[use],
        np.vstack([own[:count], x[free]])[:, use],
        np.vstack([noise[:count], (x_again - x)[free]])[:, use],
        np.concatenate([np.zeros(count), lower]),
        np.concatenate([np.full(count, np.inf), upper]),
        blocks[use],
        count,
    )


def _undelayed(problem: Problem, fit: Fit, i: int) -> tuple[Array, Array]:
    """A joint's (0-based) columns and the part without free coefficient, for a torque that is taken as late as delays
    of the structure make it."""
    x, fixed = problem.rows(i, fit.shapes)
    regressors = problem.regressors
    if regressors.late(i):
        for term in problem.layout.terms:
            if is_delay(fit.model, term) and i in joints_of(fit.model, term):
                fixed = fixed - regressors.columns(term, i, fit.shapes[term])[0]
    return x, fixed


def _one_sided(bounds: Array) -> Array:
    """Bounds of unknowns that are divided by a positive gain: zero and infinity stay."""
    return np.where(bounds == 0.0, 0.0, np.where(bounds > 0, np.inf, -np.inf))


def _gains(
    fit: Fit, i: int, joint: DrivenJoint, by: tuple[_Equation, _Equation], others: Sequence[str], scaled: bool
) -> dict[str, ToldGain]:
    """Gains by the first of two equations; no surer beside the command's than by the second, in which that is late."""
    (theta, spread), (_, wide) = (equation.solved() for equation in by)
    at = len(others)
    type_of = fit.model.joints[i].type
    units = {term.name: term.unit[type_of == "prismatic"] for term in joint.law.terms}
    one, sure = 1.0, not scaled
    found: dict[str, ToldGain] = {}
    if scaled:
        name = joint.command_gain
        part, half = float(theta[at]), float(spread[at])
        sure = part > 0 and half < MOST * part
        one = 1 / part if sure else 1.0
        ends = (1 / (part + half), 1 / (part - half)) if sure else None
        found[name] = ToldGain(name, one, units[name], ends)
    for k, name in enumerate(others):
        half = one * float(max(spread[k], wide[k]))
        value = one * float(theta[k])
        ends = (max(value - half, 0.0), value + half) if sure else None
        found[name] = ToldGain(
            name, value, units[name] if sure else f"{units[name]} per {units[joint.command_gain]}", ends
        )
    return found
