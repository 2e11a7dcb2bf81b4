"""Tasks that answer a question about a fitted model, and that open a plan."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline

from runtime.diagnosis.stages import begin as begun
from runtime.diagnosis.stages import complete
from runtime.diagnosis.steps import Step
from runtime.diagnosis.verdict import decide
from runtime.documents.replays import ReplayDocument, ReplayStep
from runtime.experiments.asking import parse_rivals
from runtime.experiments.design import SimulatedDiagnosis, propose, write_motion
from runtime.identification.compare import JointSeries
from runtime.identification.regressors import Signals
from runtime.model.terms import Prediction, Term, joints_of, structure
from runtime.planning import results, trajectory
from runtime.replay.replay import Replay
from runtime.report import motions
from runtime.report.page import motion_pages
from runtime.report.page.replay_page import moving_arm, replay_page, replayed_seconds
from runtime.report.signals.joint_signals import of_series
from runtime.report.summary import relative_floor
from runtime.simulation.options import SimulationSettings
from runtime.simulation.settings import RATE
from runtime.simulation.simulate import parse_hidden, simulate
from runtime.studio.describe import embeddable
from runtime.studio.documents import (
    HiddenEffectAnswer,
    JointAnswer,
    PlanOverview,
    ReplayAnswer,
    TaskResult,
    ValuesAnswer,
)
from runtime.studio.history import PlacedEffect
from runtime.studio.loaded import LoadedSession, Reporter, write
from runtime.studio.session import SessionError
from runtime.workspace.names import ARMS
from runtime.workspace.source import Source
from symbolic.model_file.checks import quote

COMPILING, FITTING, EVALUATING = "deriving and compiling the model", "fitting the model", "evaluating the plan"
HIDING, DIAGNOSING = "simulating the model with the hidden effect", "diagnosing that simulation"
DESIGNING, REPLAYING = "designing a motion", "driving the model by the recorded torques"


def tried(
    loaded: LoadedSession, report: Reporter, step: int, effect: PlacedEffect, values: Mapping[str, float]
) -> TaskResult:
    """The residual of a step's model with other values of an effect of the model, or of one that the diagnosis names.

    All other values stay as fitted.
    """
    report.parts(FITTING)
    report.part(FITTING)
    before = fitted = loaded.fitted(step)
    if _term(fitted, effect) is None and effect in loaded.values_found(step):
        fitted = loaded.fitted_with(step, effect)
    term = _term(fitted, effect)
    if term is None:
        raise SessionError(
            f"step {step} has no {effect}, nor does its diagnosis name it; choose an effect of its model"
        )
    model, known = fitted.fit.model, fitted.fit.prediction
    for name, value in values.items():
        low, high = model.library.effects[term.effect].parameter(name).bounds
        if not math.isfinite(value) or not low <= value <= high:
            raise SessionError(f"{term}: {name} is {value:g}; expected {low:g} to {high:g}")
    other = replace(known, values={**known.values, term: {**known.values[term], **values}})
    folder, joints = loaded.new_folder("answer"), []
    for i in joints_of(model, term):
        series, fit = _with_values(fitted, other, i), fitted.joints[i]
        comparable = np.array_equal(before.joints[i].t, series.t)
        of_series(before.joints[i] if comparable else fit, series, str(term)).save(folder / f"tried{i + 1}.npz")
        signals = f"step{step}-tried{i + 1}"
        joints.append(
            JointAnswer(joint=i + 1, rms=series.rms, relative=series.relative, fitted=fit.relative, signals=signals)
        )
    write(folder / "tried.json", ValuesAnswer(placed=effect, values=other.values[term], joints=joints))
    return TaskResult(answered=step)


def _term(fitted: Step, effect: PlacedEffect) -> Term | None:
    """The term of an effect in a fitted model; None where it has no such effect."""
    terms = fitted.fit.prediction.values
    return next((t for t in terms if (t.name, t.joint) == (effect.effect, effect.joint)), None)


def _with_values(fitted: Step, other: Prediction, joint: int) -> JointSeries:
    """A joint (0-based) with the torque that other values predict."""
    found, series, change = fitted.fit, fitted.joints[joint], []
    for piece in found.motion.pieces_of(joint):
        total = np.zeros(len(piece.t))
        for prediction, sign in ((other, 1.0), (found.prediction, -1.0)):
            signals = Signals(found.model, piece, prediction)
            for term in prediction.values:
                if joint in joints_of(found.model, term):
                    total += sign * signals.torque(term, joint)
        change.append(piece.equation(piece.in_band(total), joint))
    moving = np.concatenate(change)[found.motion.moving(joint)]
    if not all(np.isfinite(part).all() for part in change):
        raise SessionError("with these values the torque is not finite; choose others")
    return replace(series, predicted=series.predicted + moving)


def hidden(
    loaded: LoadedSession, report: Reporter, step: int, effect: PlacedEffect, values: Mapping[str, float]
) -> TaskResult:
    """Whether a diagnosis would name an effect in the recorded motion.

    The fitted model is simulated along the longest stretch of that motion with the effect and the noise of the
    recordings, and diagnosed.
    """
    report.parts(FITTING, HIDING, DIAGNOSING)
    report.part(FITTING)
    fitted = loaded.fitted(step)
    model = loaded.model(loaded.fitted_text(step))
    place = parse_hidden(_typed(effect, values), model, "hide")
    report.part(HIDING)
    noise = max(relative_floor(series) for series in fitted.joints)
    stretches = [(r.t[samples], r.q[:, samples]) for r in loaded.recordings(False) for samples in r.segments]
    t, q = max(stretches, key=lambda stretch: len(stretch[0]))
    path = np.ascontiguousarray(make_interp_spline(t, q.T, k=3)(np.arange(t[0], t[-1], 1 / RATE)).T)
    made, there = simulate(model, [place], SimulationSettings(noise=noise), path)
    report.part(DIAGNOSING)
    result = decide(complete(begun(model, [made])))
    term = next(iter(there.keys() - structure(model).keys()))
    rivals = tuple(result.findings[0].rivals) if result.findings else ()
    named = tuple(f.term for f in result.findings)
    trial = SimulatedDiagnosis(
        hidden=term,
        others=rivals,
        seed=SimulationSettings.seed,
        verdict=result.verdict,
        named=named,
        rivals=rivals,
    )
    shown = HiddenEffectAnswer(
        placed=effect, values=there[term], seen=term in named, problem=trial.problem, noise=noise
    )
    write(loaded.new_folder("answer") / "hidden.json", shown)
    return TaskResult(answered=step)


def experiment(loaded: LoadedSession, report: Reporter, step: int, rivals: Sequence[PlacedEffect]) -> TaskResult:
    """The motion that distinguishes effects that a step's model lacks, at the values that its diagnosis found."""
    found = loaded.values_found(step)
    texts = [_typed(rival, found.get(rival, {})) for rival in rivals]
    report.parts(COMPILING, DESIGNING)
    report.part(COMPILING)
    model = loaded.model(loaded.fitted_text(step))
    report.part(DESIGNING)
    proposal = propose(model, parse_rivals(",".join(texts), model), tell=report.line)
    folder = loaded.new_folder("answer")
    if proposal.separated:
        write_motion(folder / "motion.csv", model, proposal.motion)
    write(folder / "experiment.json", proposal.document())
    return TaskResult(answered=step)


def replayed(loaded: LoadedSession, report: Reporter, step: int) -> TaskResult:
    """How far the motion of a step's model is off under the recorded torques, beside that of the step before: on the
    held-out recordings, or without any on those that were fitted."""
    report.parts(FITTING, REPLAYING)
    report.part(FITTING)
    parent = loaded.session.history.step(step).parent
    numbers = [number for number in (parent, step) if number is not None]
    fits = [loaded.fitted(number).fit for number in numbers]
    data = loaded.recordings(True) or loaded.recordings(False)
    report.part(REPLAYING)
    found = [Replay.of_fit(fit, data) for fit in fits]
    steps = [ReplayStep(added=f"step {k}", joints=one.joints) for k, one in zip(numbers, found, strict=True)]
    document = ReplayDocument(arm=fits[-1].model.name, fitted=True, steps=steps)
    folder = loaded.new_folder("answer")
    (folder / "replay.html").write_text(replay_page(found, document).html(), encoding="utf-8")
    seconds = replayed_seconds(found)
    arm = None if seconds is None else embeddable(moving_arm(found, seconds))
    write(folder / "replay.json", ReplayAnswer(steps=steps, arm=arm))
    return TaskResult(answered=step)


def _typed(effect: PlacedEffect, values: Mapping[str, float]) -> str:
    return str(effect) + (":" + ",".join(f"{name}={value!r}" for name, value in values.items()) if values else "")


def open_plans(loaded: LoadedSession, report: Reporter, names: Mapping[str, str]) -> TaskResult:
    """The report's page of each trajectory, as `tendon optimize --report` writes it, from the file alone.

    names   of the files in given/ -> original names
    """
    report.parts(COMPILING, EVALUATING)
    for k, (file, name) in enumerate(names.items()):
        path = loaded.session.folder / "given" / file
        arm, given = trajectory.arm_of(path), loaded.inputs.model
        if given is not None and arm in (loaded.source.arm().name, given.name.removesuffix(".toml")):
            source = loaded.source
        elif arm in {shipped.stem for shipped in ARMS.glob("*.toml")}:
            source = Source.shipped(arm, loaded.effects)
        else:
            raise SessionError(
                f"the plan is for the arm {quote(arm)}, which is not the session's; give its model file first"
            )
        report.part(COMPILING)
        model = source.compiled.model()
        planned = trajectory.read(path, model)
        report.part(EVALUATING)
        stated = results.stated(model, planned)
        folder = loaded.new_folder(f"plan{k}")
        (folder / "page.html").write_text(motion_pages.plan_page(model, planned, stated).html(), encoding="utf-8")
        write(folder / "plan.json", PlanOverview(name=name, headline=motions.plan_headline(stated)))
    return TaskResult(plans=len(names))
