"""One fit of all parameters of a structure, to a motion that is prepared.

Linear coefficients are solved exactly for every trial of the shape parameters and of the skew between
torque and encoder (variable projection, Golub & Pereyra 1973). The inertia matrix stays positive
definite over the recorded motion, and effects stay within their physical bounds.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from runtime.identification import grids
from runtime.identification.estimate import Estimate
from runtime.identification.grids import motor_angle
from runtime.identification.problem import Fit, Problem, Skew, first_least, weighted
from runtime.identification.regressors import Ahead, Regressors, open_rotors
from runtime.identification.settings import (
    AS_GOOD_A_FLANK,
    CLEARLY_LIKELIER,
    HOLD,
    HOPELESS_FLANK,
    NOMINAL_SKEW,
    ROTOR_ASSUMED,
    SKEW_RANGE,
    SKEW_SIGMAS,
    SKEWS_APART,
)
from runtime.model.loader import Model
from runtime.model.terms import IDENTIFIED, Prediction, Structure, Term, Values, joints_of
from runtime.motion.motion import Motion
from runtime.recordings.recording import RecordingError
from runtime.regression.bounded import bounded, inverse

Array = NDArray[np.float64]

_GAP_REACH: Final = 2.5
"""ratio; so far to either side of where a search over candidates, in steps of 2, left a gap its width is sought."""
_GAP_STEPS: Final = 6
"""number of steps to either side: among those that chance makes the least error is not missed."""


def _start(problem: Problem, known: Structure, skew: Skew) -> dict[Term, Values]:
    """Shape values from the file where it states them, else the best of the grid, one term after another."""
    shapes: dict[Term, Values] = {}
    open_terms: list[tuple[Term, list[Values]]] = []
    lines: list[Term] = []
    for term in problem.layout.terms:
        line = problem.model.library.effects[term.effect].line
        if line is not None and line.name not in known.get(term, {}):
            lines.append(term)
        names = [p.name for p in problem.model.library.effects[term.effect].shape]
        given = {k: v for k, v in known.get(term, {}).items() if k in names}
        choices = grids.points(problem.regressors, term)
        choices = list({tuple({**c, **given}.items()): {**c, **given} for c in choices}.values())
        if not choices and len(given) < len(names):
            raise RecordingError(
                f"{term} cannot be placed: these recordings give its {' and '.join(names)} no scale (a link without "
                "inertia, a joint without dry friction); state them in the model file, or leave the effect out"
            )
        choices = choices or [given]
        shapes[term] = choices[len(choices) // 2]
        if len(choices) > 1:
            open_terms.append((term, choices))
    for term, choices in open_terms:
        problem.foresee(term, choices, shapes)
        errors = problem.errors([{**shapes, term: c} for c in choices], skew)
        shapes[term] = choices[first_least(errors)]
    for k, term in enumerate(lines):
        shapes[term] = _on_strongest_line(problem, shapes, skew, lines[k:])
    return shapes


def _on_strongest_line(problem: Problem, shapes: dict[Term, Values], skew: Skew, open_lines: Sequence[Term]) -> Values:
    """Shape of the first of these terms with its order on the strongest line of what the others of the structure leave
    over its motor's angle; as it was if none stands out."""
    term = open_lines[0]
    line, joint = problem.model.library.effects[term.effect].line, joints_of(problem.model, term)[0]
    terms = [t for t in problem.layout.terms if t not in open_lines]
    others = Problem(problem.model, problem.motion, terms, problem.regressors.prediction)
    left, use = others.solve(shapes, skew).residual[joint], problem.motion.moving(joint)
    base = others.rows(joint, shapes)[0][:, use]
    base = base[np.any(base != 0, axis=1)]
    orders, _ = motor_angle(problem.model, problem.motion, joint).lines(left[use], base, inverse(base @ base.T))
    return {**shapes[term], line.name: float(orders[0])} if line and len(orders) else shapes[term]


def solve(
    model: Model, motion: Motion, known: Structure, skew: float | None, start: Fit | None = None
) -> tuple[Problem, Fit]:
    """Fit all of a structure's parameters.

    known   active terms with the values from which the search starts (shapes; linear ones need none)
    skew    samples, or None to estimate it
    start   an earlier fit with at least some of the terms, for its shapes and prediction
    """
    terms = tuple(known)
    needs = [t for t in terms if _needs_prediction(model, t)]
    prediction = start.prediction if start else None
    shapes: dict[Term, Values] = dict(start.shapes) if start else {}
    if prediction is None and needs:
        _, plain = solve(model, motion, {t: v for t, v in known.items() if t not in needs}, skew)
        prediction, shapes = plain.prediction, dict(plain.shapes)
        start = plain
    if prediction is not None and not drivable(model, motion, needs, prediction):
        # What an ill-posed fit leaves without inertia cannot be simulated; what the file says of it can.
        prediction = replace(prediction, lumps=model.lumps_or(prediction.lumps))
    at = skew if skew is not None else (start.skew if start else NOMINAL_SKEW)
    free = skew is None
    if free and any("torque_rate" in model.library.needs[t.effect] for t in terms):
        # A delay is counted from the shift that a hold explains; both at once cannot be told apart.
        free = False
        at = NOMINAL_SKEW if model.n == 1 or start is None else start.skew
    ahead = start.ahead if start else None
    problem, fit = _refine(
        model, motion, known, shapes=shapes, skew=at, free_skew=free, prediction=prediction, ahead=ahead
    )
    for _ in range(7 if needs else 0):
        before = fit
        if not drivable(model, motion, needs, fit.prediction):
            break
        problem, fit = _refine(
            model,
            motion,
            known,
            shapes=fit.shapes,
            skew=fit.skew,
            free_skew=free,
            prediction=fit.prediction,
            ahead=_delayed(model, motion, fit),
        )
        if _settles(before, fit):
            break
    if free and not fit.skew_free and not _gives_way(model, known):
        # No term of the structure reads them: effects that delay a torque fix the skew.
        fit = replace(fit, ahead=_ahead(problem, fit.shapes, fit.skew))
    return problem, fit


def _settles(before: Fit, after: Fit) -> bool:
    """Whether no coefficient moves by more than a thousandth, or what is left of no joint's torque by more than noise
    does: what the data hardly tell, a place that few rows pass, may go on wandering."""
    if np.allclose(before.coefficients, after.coefficients, rtol=1e-3, atol=0.0):
        return True
    # Over 2500 rows all coefficients together move so much by a tenth of a standard deviation.
    noise = 2e-3
    both = zip(before.residual, after.residual, strict=True)
    return all(np.linalg.norm(b - a) <= noise * np.linalg.norm(b) for a, b in both)


def _delayed(model: Model, motion: Motion, fit: Fit) -> Ahead | None:
    """Where delays are exact, moved to the delays that were found."""
    if fit.ahead is None:
        return None
    times = list(fit.ahead.times)
    for term, values in fit.prediction.values.items():
        lead = model.library.effects[term.effect].of_kind("lead")
        if lead is not None and term.joint is not None:
            times[term.joint - 1] = values[lead.name]
    return _large_delays(motion, fit.skew, times)


def drivable(model: Model, motion: Motion, terms: Sequence[Term], prediction: Prediction) -> bool:
    """Whether what hangs on every transmission has an inertia, without which its motion has no meaning."""
    regressors = Regressors(model, motion, prediction)
    own = [t.joint - 1 for t in terms if t.joint and model.library.effects[t.effect].gives_way]
    return all(float(np.min(s.link_inertia(i))) > 0 for i in own for s in regressors.signals(i))


def _gives_way(model: Model, terms: Iterable[Term]) -> bool:
    """Whether a transmission gives way, which delays, too: beside it a time cannot be measured by itself."""
    return any(model.library.effects[t.effect].gives_way for t in terms)


def _needs_prediction(model: Model, term: Term) -> bool:
    return bool(model.library.needs[term.effect] & IDENTIFIED)


def _refine(
    model: Model,
    motion: Motion,
    known: Structure,
    shapes: dict[Term, Values],
    skew: float,
    free_skew: bool,
    prediction: Prediction | None,
    ahead: Ahead | None = None,
) -> tuple[Problem, Fit]:
    ahead = None if _gives_way(model, known) else ahead
    problem = Problem(model, motion, tuple(known), prediction=prediction, ahead=ahead)
    missing = {t: v for t, v in known.items() if t not in shapes}
    at = Skew(skew, "shared" if free_skew else "no")
    found = _start(problem, {**known, **{t: s for t, s in shapes.items() if t in known}}, at) if missing else shapes
    shapes = {t: found[t] for t in known}
    hold = free_skew
    for _ in range(2):
        problem, shapes = _search(problem, shapes, at)
        if free_skew:
            at, hold = _settled(problem, shapes, at)
        solved = problem.solve(shapes, at)
        count = np.array([max(1, motion.moving(i).sum()) for i in range(model.n)])
        rms = np.sqrt([r @ r for r in solved.residual] / count)
        problem.weights = 1 / np.maximum(rms, 1e-12)
        if model.n == 1:
            break
    solved = problem.solve(shapes, Skew(at.at))
    theta = solved.coefficients
    prediction = problem.prediction(theta, shapes)
    return problem, Fit(
        prediction,
        theta,
        shapes,
        skew=at.at,
        skew_free=hold,
        residual=solved.residual,
        weights=problem.weights,
        ahead=ahead,
    )


def _settled(problem: Problem, shapes: dict[Term, Values], skew: Skew) -> tuple[Skew, bool]:
    """The shift that all joints share, and whether a hold explains it.

    Torque and encoders of all joints are sampled together. Where their shifts differ, or no hold explains them,
    something delays a torque: then the shift stays as near to that of a hold as a joint's is, and the delays
    are left to be found.

    Source: a delay as one more unknown, linear after Gauss and Newton: Ljung, System Identification, 1999; a hold
    delays by half a sample: Åström & Wittenmark, Computer-Controlled Systems, 1997. That joints are sampled alike
    where the intervals of all their shifts meet is a union-intersection test, Roy 1953.
    """
    effects = problem.model.library.effects
    soft = {
        joint for t in problem.layout.terms if effects[t.effect].gives_way for joint in joints_of(problem.model, t)[:1]
    }
    common = skew
    # Noise in the torque that is shifted shortens the steps, to a third at least; beside what gives way they are long.
    for _ in range(8 if soft else 2):
        shift = float(problem.solve(shapes, replace(common, unknown="shared")).shifts[0])
        common = Skew(float(np.clip(common.at + shift, *SKEW_RANGE)), "shared")
    solved = problem.solve(shapes, Skew(common.at, "each"))
    spread = np.sqrt(np.maximum(np.diagonal(inverse(solved.gram))[problem.layout.size :], 0.0))
    # What gives way delays, too: beside it a time cannot be measured by itself.
    seen = (spread > 0) & ~np.isin(np.arange(problem.model.n), list(soft))
    own, margin = (common.at + solved.shifts)[seen], SKEW_SIGMAS * spread[seen]
    low, high = (own - margin).max(initial=-np.inf), (own + margin).min(initial=np.inf)
    if not seen.any() or (low - high < SKEWS_APART and low <= HOLD[1] and high >= HOLD[0]):
        return replace(common, at=float(np.clip(common.at, *HOLD))), True
    nearest = float(own[np.argmin(np.abs(own - NOMINAL_SKEW))])
    held = problem.model.n > 1 and HOLD[0] <= nearest <= HOLD[1]
    return Skew(nearest if held else NOMINAL_SKEW), False


def _search(problem: Problem, shapes: dict[Term, Values], skew: Skew) -> tuple[Problem, dict[Term, Values]]:
    """Shape parameters that minimise the weighted residual, from a start that a grid gave, and with them the parts that
    rotors have in the inertia of their joints, where the model file leaves them out and a term tells them."""
    names, x0, lower, upper = [], [], [], []
    for term, shape in shapes.items():
        info = problem.model.library.effects[term.effect]
        for parameter in () if info.has_gap else info.shape:
            if parameter.grid is not None and parameter.grid.continuous:
                values = grids.axis(problem.regressors, term, parameter, shape)
                low, high = float(values[0]), float(values[-1])
                if not grids.searchable(parameter, values):
                    continue
                names.append((term, parameter.name))
                lower.append(low)
                upper.append(high)
                x0.append(float(np.clip(shape[parameter.name], low, high)))
    rotors = _open_rotors(problem)
    for joint, (share, both) in rotors.items():
        # On either side something is left.
        lower.append(0.02 * both)
        upper.append(0.98 * both)
        x0.append(float(np.clip(problem.rotors.get(joint, share * both), lower[-1], upper[-1])))
    if not x0:
        return problem, _with_gaps(problem, shapes, skew)
    from scipy.optimize import least_squares  # where it is used: it takes longer to load than a fit

    lo, scale = np.array(lower), np.array(upper) - np.array(lower)

    @lru_cache(maxsize=2)  # a step of a rotor, and its place
    def with_rotors(*found: float) -> Problem:
        return problem.with_rotors(dict(zip(rotors, found, strict=True))) if found else problem

    def unpack(z: Array) -> tuple[Problem, dict[Term, Values]]:
        changed, values = {t: dict(s) for t, s in shapes.items()}, lo + z * scale
        for (term, name), value in zip(names, values, strict=False):
            changed[term][name] = float(value)
        return with_rotors(*map(float, values[len(names) :])), changed

    def residual(z: Array) -> Array:
        there, changed = unpack(z)
        parts = there.solve(changed, skew).residual
        return np.concatenate([w * r for w, r in zip(problem.weights, parts, strict=True)])

    # The method begins inside its bounds. A derivative's step lies between rounding and curvature; a search that moves
    # by less has ended, and a grid has brought its start near.
    inside, step = 1e-6, 1e-4
    z0 = np.clip((np.array(x0) - lo) / scale, inside, 1 - inside)
    ends = {"xtol": step, "ftol": 1e-6, "max_nfev": 12}
    best, changed = unpack(least_squares(residual, z0, bounds=(0.0, 1.0), diff_step=step, **ends).x)
    return best, _with_gaps(best, grids.least_places(best, changed, skew), skew)


def _open_rotors(problem: Problem) -> dict[int, tuple[float, float]]:
    """By joint (0-based) of a rotor that only a term tells: the part that is assumed, and of what inertia."""
    if problem.regressors.prediction is None or problem.motion.rigid_given:
        return {}
    found = {}
    for joint in open_rotors(problem.model, problem.layout.terms):
        assumed = problem.regressors.signals(joint)[0].assumed_rotor(joint)
        if assumed > 0:
            found[joint] = (ROTOR_ASSUMED, assumed / ROTOR_ASSUMED)
    return found


# torques that lead the motion ----------------------------------------------------------------------------------------


def _ahead(problem: Problem, shapes: Mapping[Term, Values], skew: float) -> Ahead:
    """The time beyond `skew` samples that leaves least of each joint's torque; 0 for a joint that does not move, and
    where that is hardly less than without.

    A delay shifts the torque and no regressor: the equations stay, and only their right side is filtered again. A
    torque at a time that is none of its own would have the noise of both times in its column.
    Source: separable least squares in the delay, Ljung, System Identification, 1999.
    """
    return _large_delays(problem.motion, skew, [_delay_of(problem, shapes, i, skew) for i in range(problem.model.n)])


def _large_delays(motion: Motion, skew: float, times: Sequence[float]) -> Ahead:
    """These times (n,) s, where first order does not do for them: it has the encoders' noise in it, that is known."""
    given = np.array(times)
    small = 2 * np.pi * motion.band.cutoffs * np.abs(given) < 1.0  # rad
    return Ahead(skew, np.where(small, 0.0, given))


def _delay_of(problem: Problem, shapes: Mapping[Term, Values], joint: int, skew: float) -> float:
    use = problem.motion.moving(joint)
    if not use.any():
        return 0.0
    x, fixed = (rows[..., use] for rows in problem.rows(joint, shapes))
    gram, layout = x @ x.T, problem.layout

    def left(time: float) -> float:
        y = problem.motion.torque_delayed(joint, skew, time)[use] - fixed
        rest = y - bounded(gram, x @ y, layout.lower, upper=layout.upper, near=layout.stated) @ x
        return float(rest @ rest) / max(float(y @ y), 1e-300)

    step = 1 / (8 * problem.motion.cutoff(joint))  # between two of them no least error is missed
    # s: a field bus takes some cycles of 1 to 10 ms to hand a command on, a current filter of 10 to 100 Hz less.
    longest_lag, longest_delay = 0.02, 0.05
    times = step * np.arange(-np.ceil(longest_lag / step), np.ceil(longest_delay / step) + 1)
    best = float(times[int(np.argmin([left(float(t)) for t in times]))])
    from scipy.optimize import minimize_scalar  # where it is used: it takes longer to load than a fit

    found = minimize_scalar(left, bounds=(best - step, best + step), method="bounded", options={"xatol": step / 100})
    rows = int(use.sum()) - problem.motion.dependent(joint, use)
    clear = rows * np.log(left(0.0) / max(float(found.fun), 1e-300)) > CLEARLY_LIKELIER
    return float(found.x) if clear else 0.0


# the width of a gap --------------------------------------------------------------------------------------------------
#
# What lies behind a gap strikes its flanks at instants that depend on everything: the error over the width is rugged,
# and no derivative leads to its minimum. It is sought in steps over a range, and then between them. Stiffness and
# damping of the flanks act above the band, where nothing is compared: the interval of the width holds the best widths
# with all flanks that are as good, and nothing is claimed of the flanks.


def _with_gaps(problem: Problem, shapes: Mapping[Term, Values], skew: Skew) -> dict[Term, Values]:
    """Shapes with the width of every gap at the least error that lies around it."""
    best = dict(shapes)
    for term in problem.layout.terms:
        if problem.model.library.effects[term.effect].has_gap:
            best[term] = _narrowed(problem, best, skew, term)[1]
    return best


def gap_estimates(problem: Problem, fit: Fit, term: Term, values: dict[str, Estimate]) -> dict[str, Estimate]:
    """A term's estimates with the interval that its flanks leave to its gap, and none for themselves; as they are for
    a term without a gap."""
    info = problem.model.library.effects[term.effect]
    play = info.of_kind("play")
    if not info.has_gap or play is None:
        return values
    skew = Skew(fit.skew)
    own = _squared_error(problem, fit.shapes, skew)
    tried = [(own, fit.shapes[term])]
    for flanks in _flanks(problem, fit, term):
        shapes = {**fit.shapes, term: flanks}
        if _squared_error(problem, shapes, skew) < HOPELESS_FLANK**2 * own:
            tried.append(_narrowed(problem, shapes, skew, term))
    least = min(error for error, _ in tried)
    as_good = [shape[play.name] for error, shape in tried if error <= AS_GOOD_A_FLANK**2 * least]
    step = _GAP_REACH ** (1 / _GAP_STEPS)
    ends = min(as_good) / step, max(as_good) * step
    return {name: replace(e, interval=ends if name == play.name else None) for name, e in values.items()}


def _flanks(problem: Problem, fit: Fit, term: Term) -> list[Values]:
    """The term's shape with the flanks of the grid in the place of its own."""
    own = fit.shapes[term]
    play = problem.model.library.effects[term.effect].of_kind("play")
    kept = {play.name: own[play.name]} if play else {}
    choices = ({**own, **c, **kept} for c in grids.points(problem.regressors, term))
    return list({tuple(c.items()): c for c in choices}.values())


def _narrowed(problem: Problem, shapes: Mapping[Term, Values], skew: Skew, term: Term) -> tuple[float, Values]:
    """The least squared error over the width of a term's gap, and the term's shape there."""
    from scipy.optimize import minimize_scalar  # where it is used: it takes longer to load than a fit

    play = problem.model.library.effects[term.effect].of_kind("play")
    own = shapes[term]
    if play is None or not own[play.name] > 0:
        return _squared_error(problem, shapes, skew), own

    def shape(logarithm: float) -> Values:
        return {**own, play.name: float(np.exp(logarithm))}

    def error(logarithm: float) -> float:
        return _squared_error(problem, {**shapes, term: shape(logarithm)}, skew)

    reach = float(np.log(_GAP_REACH))
    widths = np.log(own[play.name]) + np.linspace(-reach, reach, 2 * _GAP_STEPS + 1)
    tried = [shape(w) for w in widths]
    problem.foresee(term, tried, shapes)
    errors = problem.errors([{**shapes, term: one} for one in tried], skew)
    best, step = first_least(errors), reach / _GAP_STEPS
    bounds = (widths[best] - step, widths[best] + step)
    # Finer, the width is chance.
    between = minimize_scalar(error, bounds=bounds, method="bounded", options={"xatol": step / 5})
    least, at = min((float(errors[best]), float(widths[best])), (float(between.fun), float(between.x)))
    return least, shape(at)


def _squared_error(problem: Problem, shapes: Mapping[Term, Values], skew: Skew) -> float:
    return weighted(problem.solve(shapes, skew).residual, problem.weights)
