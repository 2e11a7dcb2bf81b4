"""One fit of all parameters of a structure, to a motion that is prepared.

Linear coefficients are solved exactly for every trial of the shape parameters and of the skew between
torque and encoder (variable projection, Golub & Pereyra 1973). The inertia matrix stays positive
definite over the recorded motion, and effects stay within their physical bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, Once
from runtime.identification import grids
from runtime.identification.fit import Fit
from runtime.identification.grids import motor_angle
from runtime.identification.jumps import least_places, with_gaps
from runtime.identification.problem import Nonlinear, Problem, Range, Skew, first_least, weighted
from runtime.identification.regressors import Ahead, Regressors, unseen_rotors
from runtime.identification.settings import (
    COMMAND_HOLD,
    HOLD,
    INTERVAL_SIGMAS,
    LONGEST_DELAY,
    NOMINAL_SKEW,
    ROTOR_ASSUMED,
    SKEW_RANGE,
)
from runtime.model.loader import Model
from runtime.model.terms import IDENTIFIED, Prediction, Structure, Term, Values, joints_of
from runtime.motion.motion import Motion
from runtime.motion.settings import CERTAIN, CLEARLY_LIKELIER, MOST, SOME
from runtime.recordings.recording import RecordingError
from runtime.regression.bounded import inverse


def _start(problem: Problem, known: Structure, skew: Skew) -> dict[Term, Values]:
    """Shape values from the file where it states them, else the best of the grid, one term after another."""
    shapes: dict[Term, Values] = {}
    open_terms: list[tuple[Term, list[Values]]] = []
    lines: list[Term] = []
    for term in problem.layout.terms:
        line = problem.model.library.effects[term.effect].line
        if line is not None and line.name not in known.get(term, {}):
            lines.append(term)
        info = problem.model.library.effects[term.effect]
        names = [p.name for p in info.shape if p.name not in known.get(term, {})]
        given = {p.name: known[term][p.name] for p in (*info.given, *info.shape) if p.name in known.get(term, {})}
        choices = grids.points(problem.regressors, term)
        choices = list({tuple({**c, **given}.items()): {**c, **given} for c in choices}.values())
        if not choices and names:
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


def fit_motion(
    model: Model, motion: Motion, known: Structure, skew: float | None = None, start: Fit | None = None
) -> Fit:
    """Fit all of a structure's parameters.

    known   active terms with the values from which the search starts (shapes; linear ones need none)
    skew    samples, or None to estimate it
    start   an earlier fit with at least some of the terms, for its shapes and prediction
    """
    terms = tuple(known)
    needs = [t for t in terms if model.library.needs[t.effect] & IDENTIFIED]
    prediction = start.prediction if start else None
    shapes: dict[Term, Values] = dict(start.shapes) if start else {}
    if prediction is None and needs:
        plain = fit_motion(model, motion, {t: v for t, v in known.items() if t not in needs}, skew)
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
    soft = any(model.library.effects[t.effect].gives_way for t in terms)
    ahead = start.ahead if start and not soft else None
    # One joint's weights are those of its instruments: they say how sure a shift is.
    weights = start.problem.weights if start is not None and model.n > 1 else None
    problem = Problem(model, motion, terms, prediction, ahead, start.problem if start else None, weights)
    if any(t not in shapes for t in terms):
        given = {**known, **{t: s for t, s in shapes.items() if t in known}}
        shapes = _start(problem, given, Skew(at, "shared" if free else "no"))
    fit = _refined(problem, {t: shapes[t] for t in terms}, at, free)
    for _ in range(7 if needs else 1 if model.n > 1 else 0):
        before, problem = fit, fit.problem
        weights = problem.weights if model.n > 1 else None
        if needs:
            if not drivable(model, motion, needs, fit.prediction):
                break
            problem = Problem(model, motion, terms, fit.prediction, _delayed(model, motion, fit), problem, weights)
        fit = _refined(problem, fit.shapes, fit.skew, free)
        if _settles(before, fit):
            break
    if free and not fit.skew_free and not soft:
        # No term of the structure reads them: effects that delay a torque fix the skew.
        fit = replace(fit, ahead=_ahead(fit.problem, fit.shapes, fit.skew))
    return fit


def _settles(before: Fit, after: Fit) -> bool:
    """Whether no coefficient moves by more than a thousandth, or what is left of no joint's torque by more than noise
    does. A parameter that few rows tell may go on changing."""
    if np.allclose(before.coefficients, after.coefficients, rtol=1e-3, atol=0.0):
        return True
    # Over 2500 rows all coefficients together move so much by a tenth of a standard deviation.
    noise = 2e-3
    both = zip(before.residual, after.residual, strict=True)
    return all(np.linalg.norm(b - a) <= noise * np.linalg.norm(b) for a, b in both)


def _delayed(model: Model, motion: Motion, fit: Fit) -> Ahead | None:
    """Where delays are exact, moved to the delays that were found: of a joint's own and of the arm's together; nowhere
    at a joint whose torque lags instead."""
    if fit.ahead is None:
        return None
    found: dict[int, float] = {}
    for term, values in fit.prediction.values.items():
        if "torque_rate" in model.library.needs[term.effect]:
            lead = model.library.effects[term.effect].of_kind("lead")
            for joint in joints_of(model, term):
                found[joint] = found.get(joint, 0.0) + (values[lead.name] if lead else 0.0)
    times = [found.get(i, time) for i, time in enumerate(fit.ahead.times)]
    return _large_delays(motion, fit.skew, times, fit.ahead.whole)


def drivable(model: Model, motion: Motion, terms: Sequence[Term], prediction: Prediction) -> bool:
    """Whether what hangs on every transmission has an inertia, without which its motion has no meaning."""
    regressors = Regressors(model, motion, prediction)
    own = [t.joint - 1 for t in terms if t.joint and model.library.effects[t.effect].gives_way]
    return all(float(np.min(s.link_inertia(i))) > 0 for i in own for s in regressors.signals(i))


def _refined(problem: Problem, shapes: dict[Term, Values], skew: float, free: bool) -> Fit:
    """Shapes and, where it is free, the skew sought from a start, and every joint weighted by what is left of it."""
    at, hold = Skew(skew, "shared" if free else "no"), free
    problem, shapes = _search(problem, shapes, at)
    if free:
        at, hold = _settled(problem, shapes, at)
    residual = problem.solve(shapes, at).residual
    count = np.array([max(1, problem.motion.moving(i).sum()) for i in range(problem.model.n)])
    problem = problem.weighed(1 / np.maximum(np.sqrt([r @ r for r in residual] / count), 1e-12))
    solved = problem.solve(shapes, Skew(at.at))
    return Fit(
        problem,
        problem.prediction(solved.coefficients, shapes),
        solved.coefficients,
        shapes,
        skew=at.at,
        skew_free=hold,
        residual=solved.residual,
        ahead=problem.regressors.ahead,
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
    commanded = problem.motion.commanded
    hold = COMMAND_HOLD if commanded else HOLD
    # Noise in the torque that is shifted shortens the steps, to a third at least; beside what gives way they are long.
    for _ in range(8 if soft or commanded else 2):
        shift = float(problem.solve(shapes, replace(common, unknown="shared")).shifts[0])
        common = Skew(float(np.clip(common.at + shift, *SKEW_RANGE)), "shared")
    solved = problem.solve(shapes, Skew(common.at, "each"))
    spread = np.sqrt(np.maximum(np.diagonal(inverse(solved.gram))[problem.layout.size :], 0.0))
    # What gives way delays, too: beside it a time cannot be measured by itself.
    seen = (spread > 0) & ~np.isin(np.arange(problem.model.n), list(soft))
    own, margin = (common.at + solved.shifts)[seen], CERTAIN * spread[seen]
    low, high = (own - margin).max(initial=-np.inf), (own + margin).min(initial=np.inf)
    if commanded and seen.any() and np.all(np.abs(own - NOMINAL_SKEW) <= INTERVAL_SIGMAS * spread[seen]):
        return replace(common, at=NOMINAL_SKEW), True
    if not seen.any() or (low - high < SOME and low <= hold[1] and high >= hold[0]):
        return replace(common, at=float(np.clip(common.at, *hold))), True
    nearest = float(own[np.argmin(np.abs(own - NOMINAL_SKEW))])
    held = problem.model.n > 1 and hold[0] <= nearest <= hold[1]
    return Skew(nearest if held else NOMINAL_SKEW), False


def _search(problem: Problem, shapes: dict[Term, Values], skew: Skew) -> tuple[Problem, dict[Term, Values]]:
    """Shape parameters that minimise the weighted residual, from a start that a grid gave, and with them the parts that
    rotors have in the inertia of their joints, where the model file leaves them out and a term tells them."""
    # On either side of a rotor's part something is left.
    rotors = {i: (share * both, (0.02 * both, 0.98 * both)) for i, (share, both) in _open_rotors(problem).items()}
    if rotors or problem.rotors:  # those of a start with a transmission that this structure lacks go
        problem = problem.with_rotors(
            {i: float(np.clip(problem.rotors.get(i, assumed), *ends)) for i, (assumed, ends) in rotors.items()}
        )
    ranges, shapes = dict[Nonlinear, Range](), {t: dict(s) for t, s in shapes.items()}
    for of in problem.searched(shapes):
        if of.term is None:
            ranges[of] = rotors[of.joint][1]
        elif ends := grids.slope_range(problem.regressors, of.term, of.name, shapes[of.term]):
            ranges[of] = ends
            shapes[of.term][of.name] = float(np.clip(shapes[of.term][of.name], *ends))
    if ranges:
        problem, shapes = _descended(problem, shapes, skew, ranges)
    return problem, with_gaps(problem, least_places(problem, shapes, skew), skew)


def _descended(
    problem: Problem, shapes: dict[Term, Values], skew: Skew, ranges: Mapping[Nonlinear, Range]
) -> tuple[Problem, dict[Term, Values]]:
    """From a start, step by step, to parameters that minimise the weighted residual within their ranges.

    A step is the solution of the linearised equations, shorter than one that led astray; the last moves next to
    nothing.
    Source: Gauss and Newton on separable least squares, Kaufman, BIT 15, 1975; the trust region, Conn, Gould & Toint,
    Trust-Region Methods, 2000.
    """
    solved, reach, nothing, steps = problem.solve(shapes, skew), 1.0, 1e-6, 12
    error = weighted(solved.residual, problem.weights)
    for _ in range(steps):
        step, square = problem.step(shapes, solved, skew, ranges=ranges, reach=reach)
        if square < nothing * error:
            break
        there, moved = problem.changed(shapes, step)
        found = there.solve(moved, skew)
        left = weighted(found.residual, problem.weights)
        if left >= error:
            reach = max(abs(step[of]) / (high - low) for of, (low, high) in ranges.items()) / 4
        else:
            problem, shapes, solved, error = there, moved, found, left
    return problem, shapes


def _open_rotors(problem: Problem) -> dict[int, tuple[float, float]]:
    """By joint (0-based) of a rotor that only a term tells: the part that is assumed, and of what inertia."""
    if problem.regressors.prediction is None or problem.motion.rigid_given:
        return {}
    found = {}
    for joint in unseen_rotors(problem.model, problem.layout.terms):
        assumed = problem.regressors.signals(joint)[0].assumed_rotor(joint)
        if assumed > 0 and problem.model.joints[joint].rotor_inertia is None:
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
    times, whole = [], []
    for i in range(problem.model.n):
        ways = (False, True) if problem.motion.feeds_back(i) else (False,)
        found = [_delay_of(problem, shapes, i, skew, way) for way in ways]
        # A time at the end of those that are sought is no delay: something else is missing.
        ends = LONGEST_DELAY - 1 / problem.motion.cutoff(i)
        whole.append(int(np.argmin([left if time < ends else np.inf for time, left in found])) == 1)
        times.append(found[whole[-1]][0])
    return _large_delays(problem.motion, skew, times, np.array(whole))


def _large_delays(motion: Motion, skew: float, times: Sequence[float], whole: NDArray[np.bool_]) -> Ahead:
    """These times (n,) s, and 0 where first order does for them."""
    given = np.array(times)
    # Up to that phase at the band's end first order is off by half its square.
    small = 2 * np.pi * motion.band.cutoffs * np.abs(given) < SOME
    return Ahead(skew, np.where(small, 0.0, given), whole)


def _delay_of(
    problem: Problem, shapes: Mapping[Term, Values], joint: int, skew: float, whole: bool
) -> tuple[float, float]:
    """The time, of a whole torque or of its command alone, and the part of the torque's square that it leaves."""
    motion = problem.motion
    if not motion.moving(joint).any():
        return 0.0, 1.0
    alone = problem.system(shapes, Skew(skew)).alone(joint)
    given = alone.joints[0].tau - alone.joints[0].spread(alone.at(np.zeros(len(alone.unknown)))[0].left)

    def left(torque: Array) -> Array:
        """Part of the square of torques (..., M) that the model leaves."""
        kept, whole = alone.own({0: torque - given})
        found: Array = kept / np.maximum(whole, 1e-300)
        return found

    def later(time: float) -> Array:
        return motion.torque_delayed(joint, skew, time, whole)

    step = 1 / (8 * motion.cutoff(joint))  # between two of them no least error is missed
    times = step * np.arange(-np.ceil(MOST * LONGEST_DELAY / step), np.ceil(LONGEST_DELAY / step) + 1)
    key = ("later torques", joint, whole)
    once = motion.once if skew == NOMINAL_SKEW else Once()  # another hardly comes again
    torques = once.one(key, lambda: np.array([later(float(time)) for time in times]))
    best = float(times[int(np.argmin(left(torques)))])
    from scipy.optimize import minimize_scalar  # where it is used: it takes longer to load than a fit

    bounds, ends = (best - step, best + step), {"xatol": step / 100}
    found = minimize_scalar(lambda time: float(left(later(time))), bounds=bounds, method="bounded", options=ends)
    fall = np.log(max(float(left(alone.joints[0].tau)), 1e-300) / max(float(found.fun), 1e-300))
    clear = alone.count * fall > 2 * CLEARLY_LIKELIER
    return (float(found.x) if clear else 0.0), float(found.fun)
