"""What a user asks of a fitted model: what would be left with other values, would I see an effect in this motion, and
which motion tells two effects apart. The answers are files of the step."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from runtime.diagnosis.branches import complete
from runtime.diagnosis.diagnose import begin, judged
from runtime.diagnosis.steps import Step
from runtime.estimation.compare import JointSeries
from runtime.estimation.regressors import Signals
from runtime.experiments.design import SimulatedDiagnosis, parse_rivals, propose, write_motion
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term, Values, joints_of, structure
from runtime.motion.piece import Piece
from runtime.recordings.recording import Recording
from runtime.report.signals.joint_signals import of_series
from runtime.report.summary import relative_floor
from runtime.simulation.options import SimulationSettings
from runtime.simulation.settings import RATE
from runtime.simulation.simulate import parse_hidden, simulate
from runtime.studio.bench import Bench, Found, Tell, empty, write
from runtime.studio.session import SessionError
from runtime.studio.tasks import COMPILING, FITTING

Array = NDArray[np.float64]

HIDING, DIAGNOSING = "recording the model with the effect hidden", "diagnosing that recording"
DESIGNING = "looking for a motion"


def tried(bench: Bench, tell: Tell, step: int, effect: str, joint: int | None, values: Mapping[str, float]) -> Found:
    """What a step's model would leave with other values of one of its effects, everything else as fitted; or of one
    that its diagnosis has named, everything else as fitted with it."""
    opened = bench.opened()
    tell.parts((FITTING,))
    tell.part(FITTING)
    before = fitted = opened.fitted(step)
    term = _term(fitted, effect, joint)
    if term is None and (effect, joint) in opened.values_found(step):
        fitted = opened.fitted_with(step, effect, joint)
        term = _term(fitted, effect, joint)
    if term is None:
        raise SessionError(f"step {step} has no {effect}, nor was it named; choose an effect of its model")
    model, known = fitted.identification.model, fitted.identification.fit.prediction
    other = replace(known, values={**known.values, term: _within(model, term, known.values[term], values)})
    work, shown = empty(opened.session.scratch / "answer"), []
    for i in joints_of(model, term):
        series, fit = _with_values(fitted, other, i), fitted.joints[i]
        comparable = np.array_equal(before.joints[i].t, series.t)
        of_series(before.joints[i] if comparable else fit, series, str(term)).save(work / f"tried{i + 1}.npz")
        errors = {"rms": series.rms, "relative": series.relative, "fitted": fit.relative}
        shown.append({"joint": i + 1, **errors, "signals": f"step{step}-tried{i + 1}"})
    write(work / "tried.json", {"effect": effect, "joint": joint, "values": other.values[term], "joints": shown})
    return {"answered": step}


def _term(fitted: Step, effect: str, joint: int | None) -> Term | None:
    """An effect of a fitted model."""
    known = fitted.identification.fit.prediction.values
    return next((t for t in known if (t.name, t.joint) == (effect, joint)), None)


def _within(model: Model, term: Term, known: Values, values: Mapping[str, float]) -> Values:
    """The values of a term with others in their place. Raises SessionError for one that is none or out of bounds."""
    for name, value in values.items():
        low, high = model.library.effects[term.effect].parameter(name).bounds
        if not math.isfinite(value) or not low <= value <= high:
            raise SessionError(f"{term}: {name} is {value:g}; expected {low:g} to {high:g}")
    return {**known, **values}


def _with_values(fitted: Step, other: Prediction, joint: int) -> JointSeries:
    """A joint (0-based) with the torque that other values predict."""
    found, series = fitted.identification, fitted.joints[joint]
    pieces = found.motion.pieces_of(joint)
    change = np.concatenate([_change(found.model, p, found.fit.prediction, other, joint) for p in pieces])
    if not np.isfinite(change).all():
        raise SessionError("with these values the torque is not finite; choose others")
    return replace(series, predicted=series.predicted + change[found.motion.moving(joint)])


def _change(model: Model, piece: Piece, known: Prediction, other: Prediction, joint: int) -> Array:
    """In-band rows of the torque that one prediction has more than the other."""
    total = np.zeros(len(piece.t))
    for prediction, sign in ((other, 1.0), (known, -1.0)):
        signals = Signals(model, piece, prediction)
        for term in prediction.values:
            if joint in joints_of(model, term):
                total += sign * signals.torque(term, joint)
    return piece.equation(piece.in_band(total), joint)


def hidden(bench: Bench, tell: Tell, step: int, effect: str, joint: int | None, values: Mapping[str, float]) -> Found:
    """Would an effect be seen in the motion that was recorded? The fitted model is recorded along it with the effect
    hidden, and with the noise that is there, and that recording is diagnosed."""
    opened = bench.opened()
    tell.parts((FITTING, HIDING, DIAGNOSING))
    tell.part(FITTING)
    fitted = opened.fitted(step)
    model = opened.model(opened.fitted_text(step))
    place = parse_hidden(_written(effect, joint, values), model, "hide")
    tell.part(HIDING)
    noise = max(relative_floor(series) for series in fitted.joints)
    path = along(max(opened.recordings(False), key=_longest))
    made, there = simulate(model, [place], SimulationSettings(noise=noise), path)
    tell.part(DIAGNOSING)
    result = judged(complete(begin(model, [made])))
    term = next(iter(there.keys() - structure(model).keys()))
    rivals = result.findings[0].rivals if result.findings else ()
    named = tuple(f.term for f in result.findings)
    answer = SimulatedDiagnosis(term, tuple(rivals), SimulationSettings.seed, result.verdict, named, tuple(rivals))
    asked = {"effect": effect, "joint": joint, "values": there[term], "noise": noise}
    said = {"seen": term in named, "problem": answer.problem, "reason": result.reason}
    write(empty(opened.session.scratch / "answer") / "hidden.json", asked | said)
    return {"answered": step}


def _longest(recording: Recording) -> int:
    return max(s.stop - s.start for s in recording.segments)


def along(recording: Recording) -> Array:
    """(n, N) positions of the longest stretch of a recording at the rate of a simulation."""
    samples = max(recording.segments, key=lambda s: s.stop - s.start)
    t, q = recording.t[samples], recording.q[:, samples]
    even = np.arange(t[0], t[-1], 1 / RATE)
    return np.ascontiguousarray(make_interp_spline(t, q.T, k=3)(even).T)


def experiment(bench: Bench, tell: Tell, step: int, rivals: Sequence[Mapping[str, Any]]) -> Found:
    """The motion that tells effects apart that a step's model lacks; those that its diagnosis named at the values that
    were found."""
    opened = bench.opened()
    found = opened.values_found(step)
    texts = [_written(r["effect"], r["joint"], found.get((r["effect"], r["joint"]), {})) for r in rivals]
    tell.parts((COMPILING, DESIGNING))
    tell.part(COMPILING)
    model = opened.model(opened.fitted_text(step))
    tell.part(DESIGNING)
    proposal = propose(model, parse_rivals(",".join(texts), model), tell=tell.said)
    work = empty(opened.session.scratch / "answer")
    if proposal.separated:
        write_motion(work / "motion.csv", model, proposal.motion)
    write(work / "experiment.json", proposal.document().to_json())
    return {"answered": step}


def _written(effect: str, joint: int | None, values: Mapping[str, float]) -> str:
    """As one types it: EFFECT@JOINT:KEY=VALUE,..."""
    place = effect if joint is None else f"{effect}@{joint}"
    return place + (":" + ",".join(f"{name}={value!r}" for name, value in values.items()) if values else "")


TASKS: dict[str, Callable[..., Found]] = {"tried": tried, "hidden": hidden, "experiment": experiment}
