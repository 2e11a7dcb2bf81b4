"""The tasks of a session's process: fit, diagnose, answer a question about the model, open a plan.

A task writes its results into the session's `work` folder and says in a TaskResult which of them are complete. What was
read and fitted is kept in memory for the next task.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from runtime.diagnosis.settings import BUDGET_S
from runtime.diagnosis.stages import begin as begun
from runtime.diagnosis.stages import complete, conclude
from runtime.diagnosis.steps import Step, Trail
from runtime.diagnosis.verdict import decide
from runtime.documents.parts import Document
from runtime.experiments.design import SimulatedDiagnosis, parse_rivals, propose, write_motion
from runtime.identification.compare import Comparison, JointSeries, as_written
from runtime.identification.identify import fit_document
from runtime.identification.regressors import Signals
from runtime.inspection.inspection import Inspection, inspect
from runtime.loop.improve import HeldOut, left
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term, joints_of, structure
from runtime.plain_json import plain
from runtime.planning import results, trajectory
from runtime.progress import Progress
from runtime.recordings.recording import Recording
from runtime.report import motions
from runtime.report.page import motion_pages, reports
from runtime.report.signals.joint_signals import of_held_out, of_joint, of_recording, of_series
from runtime.report.summary import ResultSummary, about, relative_floor
from runtime.simulation.options import SimulationSettings
from runtime.simulation.settings import RATE
from runtime.simulation.simulate import parse_hidden, simulate
from runtime.studio import describe
from runtime.studio.documents import (
    HiddenEffectAnswer,
    JointAnswer,
    PlanOverview,
    TaskResult,
    ValuesAnswer,
    ValuesFound,
    document,
)
from runtime.studio.session import Inputs, Kind, PlacedEffect, SessionError, SessionStep, StudioSession, invocation
from runtime.studio.settings import PROGRESS_EVERY
from runtime.wording import percent
from runtime.workspace.names import ARMS, column_mapping
from runtime.workspace.source import Source
from symbolic.model_file.checks import quote

Array = NDArray[np.float64]

READING, COMPILING, FITTING = "reading the recordings", "deriving and compiling the model", "fitting the model"
SEARCHING, LIMITS = "looking for missing effects", "computing the detection limits"
DRAWING, EVALUATING = "drawing the results", "evaluating the plan"
HIDING, DIAGNOSING = "simulating the model with the hidden effect", "diagnosing that simulation"
DESIGNING = "designing a motion"


class Reporter:
    """Messages to the server about the progress of a task, a line of JSON each."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._time, self._doing = 0.0, ""
        self._parts: tuple[str, ...] = ()
        self._at, self._share = 0, 0.0

    def message(self, **fields: Any) -> None:
        self._out.write(json.dumps(plain(fields), allow_nan=False) + "\n")
        self._out.flush()

    def parts(self, *parts: str) -> None:
        """The parts of the task, in words."""
        self._parts, self._at, self._share = parts, 0, 0.0
        self.message(parts=parts)

    def part(self, what: str) -> None:
        """The part that begins; its duration is not known yet."""
        self._at = self._parts.index(what)
        self._share = max(self._share, self._at / len(self._parts))
        self.message(at=self._at, share=self._share, doing="", left=None)

    def progress(self, progress: Progress) -> None:
        """Of the current part, at most every PROGRESS_EVERY. A part may consist of several jobs, each of which starts
        at zero: the share of the whole never falls."""
        now, last = time.monotonic(), progress.done >= progress.parts
        if now - self._time >= PROGRESS_EVERY or progress.what != self._doing or last:
            self._time, self._doing = now, progress.what
            inside = min(progress.done / progress.parts, 1.0)
            self._share = max(self._share, (self._at + inside) / max(len(self._parts), 1))
            self.message(at=self._at, share=self._share, doing=progress.what, left=progress.left)

    def line(self, text: str) -> None:
        """An intermediate result, for people."""
        self.message(said=text)


class LoadedSession:
    """The files of a session as read, and the models that were fitted to them in this process."""

    def __init__(self, session: StudioSession, effects: Path | None) -> None:
        self.session = session
        self.effects = effects
        self._trails: dict[int, Trail] = {}
        self._held_out: dict[int, HeldOut] = {}
        self._with: dict[tuple[int, PlacedEffect], Step] = {}

    @property
    def inputs(self) -> Inputs:
        return self.session.inputs

    @cached_property
    def source(self) -> Source:
        if self.inputs.model is None:
            raise SessionError("there is no model yet; give one")
        return Source.read(self.session.given(self.inputs.model), self.effects)

    @cached_property
    def inspections(self) -> list[Inspection]:
        arm = None if self.inputs.model is None else self.source.recorded_arm()
        columns = column_mapping(self.inputs.maps)
        paths = [self.session.given(r.given) for r in self.inputs.recordings]
        return [inspect(path, arm, columns, self.inputs.allow_gaps) for path in paths]

    def recordings(self, held_out: bool) -> list[Recording]:
        """The fitted or the held-out recordings. Raises SessionError."""
        found = []
        for given, inspection in zip(self.inputs.recordings, self.inspections, strict=True):
            if given.held_out == held_out:
                if inspection.problem is not None or inspection.recording is None:
                    raise SessionError(inspection.problem or f"{given.given.name}: cannot be read")
                found.append(inspection.recording)
        return found

    def model(self, text: str) -> Model:
        """The compiled model of a model file's text."""
        return self.source.with_text(text).compiled.model()

    def text(self, number: int) -> str:
        """The model file of a step, before the fit."""
        return (self.session.step(number) / "model.toml").read_text(encoding="utf-8")

    def fitted_text(self, number: int) -> str:
        """The model file of a step with the fitted values."""
        return (self.session.step(number) / "fitted.toml").read_text(encoding="utf-8")

    def values_found(self, number: int) -> dict[PlacedEffect, dict[str, float]]:
        """Of the effects that a step's diagnosis names."""
        entries = document(self.session.step(number) / "found.json", list[ValuesFound]) or []
        return {e.placed: {k: v for k, v in e.values.items() if v is not None} for e in entries}

    def trail(self, number: int, text: str | None = None) -> Trail:
        """The fitted model from which a step's diagnosis starts; text: of its model file, None: as it was written."""
        if number not in self._trails:
            model = self.model(self.text(number) if text is None else text)
            self._trails[number] = begun(model, self.recordings(False), self.recordings(True))
        return self._trails[number]

    def fitted(self, number: int) -> Step:
        """A step's model, fitted."""
        return self.trail(number).last

    def held_out(self, number: int) -> HeldOut | None:
        """The residuals of a step's model on the held-out recordings; None without any."""
        if number not in self._held_out and self.inputs.held_out:
            self._held_out[number] = left(self.fitted(number).fit, self.recordings(True))
        return self._held_out.get(number)

    def fitted_with(self, number: int, placed: PlacedEffect) -> Step:
        """A step's model with a further effect, fitted from the values that the step's diagnosis found."""
        if (number, placed) not in self._with:
            edits = self.source.with_text(self.text(number)).edits
            text = edits.add(placed.effect, placed.joint, self.values_found(number).get(placed)).text
            self._with[number, placed] = begun(self.model(text), self.recordings(False)).steps[0]
        return self._with[number, placed]

    def new_folder(self, name: str) -> Path:
        """A new folder for results."""
        folder = self.session.scratch / name
        folder.mkdir(parents=True)
        return folder


def _write(path: Path, found: Document | Sequence[Document]) -> None:
    path.write_text(json.dumps(plain(found), ensure_ascii=False, allow_nan=False), encoding="utf-8")


# The loop


def begin(loaded: LoadedSession, report: Reporter) -> TaskResult:
    """Read the recordings, and where they can be used fit the model as given: step 0."""
    report.parts(READING, COMPILING, FITTING, DRAWING)
    report.part(READING)
    for number, (given, inspection) in enumerate(zip(loaded.inputs.recordings, loaded.inspections, strict=True), 1):
        target, found = loaded.session.recording(number), inspection.recording
        if not (target / "recording.json").is_file():
            folder, joints = loaded.new_folder("recording"), 0 if found is None else len(found.q)
            for joint in range(joints):
                assert found is not None
                of_recording(found, joint).save(folder / f"joint{joint + 1}.npz")
            _write(folder / "recording.json", describe.recording(number, given.given.name, inspection, joints))
            target.parent.mkdir(exist_ok=True)
            folder.rename(target)
    problems = any(i.problem is not None for i in loaded.inspections)
    if problems or not loaded.inputs.complete or loaded.session.history.steps:
        return TaskResult()
    return TaskResult(step=_fitted(loaded, report, loaded.source.text, parent=None, kind="given", changed=()))


def fit(loaded: LoadedSession, report: Reporter, step: int, kind: Kind, changed: Sequence[PlacedEffect]) -> TaskResult:
    """A step's model with further effects, or without one, fitted: the next step.

    The fit starts from the values that the step's diagnosis found.
    """
    report.parts(COMPILING, FITTING, DRAWING)
    values, done = loaded.values_found(step), []
    edits = loaded.source.with_text(loaded.text(step)).edits
    for effect in changed:
        if kind == "added":
            done.append(PlacedEffect(edits.name_of_next(effect.effect, effect.joint), effect.joint))
            edits = edits.add(effect.effect, effect.joint, values.get(effect))
        else:
            done.append(effect)
            edits = edits.remove(effect.effect, effect.joint)
    return TaskResult(step=_fitted(loaded, report, edits.text, parent=step, kind=kind, changed=done))


def _fitted(
    loaded: LoadedSession,
    report: Reporter,
    text: str,
    *,
    parent: int | None,
    kind: Kind,
    changed: Sequence[PlacedEffect],
) -> SessionStep:
    """The next step: its model fitted, and its files written."""
    number = len(loaded.session.history.steps)
    report.part(COMPILING)
    loaded.model(text)
    report.part(FITTING)
    trail = loaded.trail(number, text)
    step, held = trail.last, loaded.held_out(number)
    held_joints = () if held is None else held.joints
    report.part(DRAWING)
    comparison = Comparison(step.fit, step.joints, as_written(step.fit))
    summary = ResultSummary(comparison, invocation(loaded.inputs, about(loaded.source.text)))
    folder = loaded.new_folder("step")
    (folder / "model.toml").write_text(text, encoding="utf-8")
    fitted = loaded.source.with_text(text).edits.set(fit_document(step.fit)).text
    (folder / "fitted.toml").write_text(fitted, encoding="utf-8")
    _write(folder / "overview.json", describe.step(number, summary, held_joints, trail.suspicions))
    _write(folder / "library.json", describe.offered(trail))
    before, held_before = (None, None) if parent is None else (loaded.fitted(parent), loaded.held_out(parent))
    names = ", ".join(map(str, changed))
    for k, series in enumerate(step.joints):
        comparable = before is not None and np.array_equal(before.joints[k].t, series.t)
        of_joint(before if before and comparable else step, step, k, names).save(folder / f"joint{k + 1}.npz")
        if held is not None:
            of_held_out(held_before, held, k, names).save(folder / f"held{k + 1}.npz")
    errors = [describe.error(s, held_joints[k] if held_joints else None) for k, s in enumerate(step.joints)]
    return SessionStep(number=number, parent=parent, kind=kind, changed=tuple(changed), joints=tuple(errors))


def diagnose(loaded: LoadedSession, report: Reporter, step: int) -> TaskResult:
    """Which effects a step's model lacks."""
    report.parts(FITTING, SEARCHING, LIMITS, DRAWING)
    report.part(FITTING)
    trail = loaded.trail(step)
    report.part(SEARCHING)

    def reached(found: Step) -> None:
        model = "as in the file" if found.added is None else f"with {found.added}"
        report.line(f"{model}: error {', '.join(percent(r) for r in found.fitted.relative)}")

    trail = complete(trail, reached, BUDGET_S)
    report.part(LIMITS)
    result = conclude(trail, loaded.source.compiled.model_with_guesses, BUDGET_S)
    report.part(DRAWING)
    first, last = result.steps[0], result.last
    ends = [first] if first is last else [first, last]
    held = [left(end.fit, loaded.recordings(True)) for end in ends if loaded.inputs.held_out]
    given = invocation(loaded.inputs, about(loaded.source.text))
    summary = ResultSummary(result, given, tuple(joint.floor for joint in held[-1].joints) if held else ())
    folder = loaded.new_folder("answer")
    named = [f.term for f in result.findings if f.term in last.values]
    found = [ValuesFound(placed=PlacedEffect(t.name, t.joint), values=dict(last.values[t])) for t in named]
    _write(folder / "verdict.json", describe.verdict(summary))
    _write(folder / "found.json", found)
    (folder / "report.html").write_text(reports.report(summary).html(), encoding="utf-8")
    for joint in range(len(first.joints)):
        added = " + ".join(dict.fromkeys(f.term.effect for f in summary.findings_at(joint)))
        of_joint(first, last, joint, added).save(folder / f"joint{joint + 1}.npz")
        if held:
            before = held[0] if len(held) > 1 else None
            of_held_out(before, held[-1], joint, added).save(folder / f"held{joint + 1}.npz")
    return TaskResult(answered=step, verdict=result.verdict)


# Questions about a fitted model


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
    _write(folder / "tried.json", ValuesAnswer(placed=effect, values=other.values[term], joints=joints))
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
    _write(loaded.new_folder("answer") / "hidden.json", shown)
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
    _write(folder / "experiment.json", proposal.document())
    return TaskResult(answered=step)


def _typed(effect: PlacedEffect, values: Mapping[str, float]) -> str:
    """As on a command line: EFFECT@JOINT:KEY=VALUE,..."""
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
        _write(folder / "plan.json", PlanOverview(name=name, headline=motions.plan_headline(stated)))
    return TaskResult(plans=len(names))


TASKS: dict[str, Callable[..., TaskResult]] = {
    task.__name__: task for task in (begin, fit, diagnose, tried, hidden, experiment, open_plans)
}
