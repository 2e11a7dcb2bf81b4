"""The tasks of a session's process: read, fit, diagnose.

A task writes its results into the session's `work` folder and says in a TaskResult which of them are complete. What was
read and fitted is kept in memory for the next task.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from runtime.diagnosis.stages import complete, conclude
from runtime.diagnosis.steps import Step
from runtime.identification.compare import Comparison, as_written
from runtime.identification.identify import fit_document
from runtime.loop.improve import HeldOut, left
from runtime.report.page import reports
from runtime.report.signals.joint_signals import of_held_out, of_joint, of_recording
from runtime.report.summary import ResultSummary, about
from runtime.studio import describe
from runtime.studio.documents import TaskResult, ValuesFound
from runtime.studio.history import Kind, PlacedEffect, SessionStep
from runtime.studio.loaded import LoadedSession, Reporter, write
from runtime.studio.questions import COMPILING, FITTING, experiment, hidden, open_plans, replayed, tried
from runtime.studio.terminal import invocation
from runtime.wording import AS_GIVEN, percent
from symbolic.model_file.checks import ModelError

READING, DRAWING = "reading the recordings", "drawing the results"
SEARCHING, LIMITS = "looking for missing effects", "computing the detection limits"


def read(loaded: LoadedSession, report: Reporter) -> TaskResult:
    """Read the recordings that have not been read in this way."""
    report.parts(READING)
    _read(loaded, report)
    return TaskResult()


def _read(loaded: LoadedSession, report: Reporter) -> None:
    report.part(READING)
    for number, given in enumerate(loaded.inputs.recordings, 1):
        target = loaded.session.recording(given)
        if (target / "recording.json").is_file():
            continue
        inspection, folder = loaded.inspection(given), loaded.new_folder(f"recording{number}")
        found, seen = inspection.recording, loaded.previews(given)
        for joint in range(0 if found is None else len(found.q)):
            assert found is not None
            of_recording(found, joint).save(folder / f"joint{joint + 1}.npz")
        guesses, arm = loaded.guesses(given), loaded.arm(given)
        write(folder / "recording.json", describe.recording(given, target.name, inspection, guesses, arm))
        write(folder / "columns.json", describe.columns(seen))
        (folder / "columns.json").replace(loaded.session.columns(given.given))
        folder.rename(target)


def begin(loaded: LoadedSession, report: Reporter) -> TaskResult:
    """Read the recordings, and where they can be used fit the model as given and the steps up to the current one.

    With another model file the same changes are made to that one, as far as they can be.
    """
    report.parts(READING, COMPILING, FITTING, DRAWING)
    _read(loaded, report)
    history, inputs = loaded.session.history, loaded.inputs
    problems = any(loaded.inspection(r).problem is not None for r in inputs.recordings)
    if problems or not inputs.complete or loaded.session.state.fitted:
        return TaskResult()
    here, text = history.here, loaded.source.text
    ways: list[tuple[str, Kind, tuple[PlacedEffect, ...]]] = [(text, "given", ())]
    for step in () if here is None else history.path(here.number)[1:]:
        try:
            text, done = _edited(loaded, text, step.kind, step.changed, values_of=step.parent)
        except ModelError:  # another model may have the effect, or lack the joint
            break
        ways.append((text, step.kind, done))
    number, parent, made = len(history.steps), None if here is None else here.number, []
    for text, kind, changed in ways:
        made.append(_fitted(loaded, report, text, number=number, parent=parent, kind=kind, changed=changed))
        number, parent = number + 1, number
    return TaskResult(steps=tuple(made))


def fit(loaded: LoadedSession, report: Reporter, step: int, kind: Kind, changed: Sequence[PlacedEffect]) -> TaskResult:
    """A step's model with further effects, or without one, fitted: the next step."""
    report.parts(COMPILING, FITTING, DRAWING)
    text, done = _edited(loaded, loaded.text(step), kind, changed, values_of=step)
    number = len(loaded.session.history.steps)
    made = _fitted(loaded, report, text, number=number, parent=step, kind=kind, changed=done)
    return TaskResult(steps=(made,))


def _edited(
    loaded: LoadedSession, text: str, kind: Kind, changed: Sequence[PlacedEffect], *, values_of: int | None
) -> tuple[str, tuple[PlacedEffect, ...]]:
    """A model file with further effects, or without some, and these effects as they are called there.

    values_of   the step whose diagnosis found values, from which the fit starts
    Raises ModelError.
    """
    values = {} if values_of is None else loaded.values_found(values_of)
    edits, done = loaded.source.with_text(text).edits, []
    for effect in changed:
        if kind == "added":
            done.append(PlacedEffect(edits.name_of_next(effect.effect, effect.joint), effect.joint))
            edits = edits.add(effect.effect, effect.joint, values.get(effect))
        else:
            done.append(effect)
            edits = edits.remove(effect.effect, effect.joint)
    return edits.text, tuple(done)


def _fitted(
    loaded: LoadedSession,
    report: Reporter,
    text: str,
    *,
    number: int,
    parent: int | None,
    kind: Kind,
    changed: Sequence[PlacedEffect],
) -> SessionStep:
    """A step: its model fitted, and its files written."""
    report.part(COMPILING)
    loaded.model(text)
    report.part(FITTING)
    trail = loaded.begin(number, text, None if kind == "given" else parent)
    step, held = trail.last, loaded.held_out(number)
    held_joints = () if held is None else held.joints
    report.part(DRAWING)
    comparison = Comparison(step.fit, step.joints, as_written(step.fit))
    summary = ResultSummary(comparison, invocation(loaded.inputs, about(loaded.source.text)))
    folder = loaded.new_folder(f"step{number}")
    (folder / "model.toml").write_text(text, encoding="utf-8")
    fitted = loaded.source.with_text(text).edits.set(fit_document(step.fit)).text
    (folder / "fitted.toml").write_text(fitted, encoding="utf-8")
    given = (*loaded.inputs.fitted, *loaded.inputs.held_out)
    cells = {r.given.file: found.cells for r in given if (found := loaded.inspection(r).recording) is not None}
    write(folder / "overview.json", describe.step(number, summary, held_joints, trail.suspicions, cells))
    write(folder / "library.json", describe.offered(trail))
    before: Step | None = None
    held_before: HeldOut | None = None
    if parent is not None and kind != "given":  # a model as given follows steps that were fitted to other data
        before, held_before = loaded.fitted(parent), loaded.held_out(parent)
    names = ", ".join(map(str, changed))
    for k, series in enumerate(step.joints):
        comparable = before is not None and np.array_equal(before.joints[k].t, series.t)
        of_joint(before if before and comparable else step, step, k, names).save(folder / f"joint{k + 1}.npz")
        if held is not None:
            of_held_out(held_before, held, k, names).save(folder / f"held{k + 1}.npz")
    errors = [describe.error(s, held_joints[k] if held_joints else None) for k, s in enumerate(step.joints)]
    return SessionStep(
        number=number, parent=parent, kind=kind, inputs=loaded.inputs, changed=tuple(changed), joints=tuple(errors)
    )


def diagnose(loaded: LoadedSession, report: Reporter, step: int) -> TaskResult:
    """Which effects a step's model lacks."""
    report.parts(FITTING, SEARCHING, LIMITS, DRAWING)
    report.part(FITTING)
    trail = loaded.trail(step)
    report.part(SEARCHING)

    def reached(found: Step) -> None:
        model = AS_GIVEN if found.added is None else f"with {found.added}"
        report.line(f"{model}: error {', '.join(percent(r) for r in found.fitted.relative)}")

    trail = complete(trail, reached)
    report.part(LIMITS)
    result = conclude(trail)
    report.part(DRAWING)
    first, last = result.steps[0], result.last
    ends = [first] if first is last else [first, last]
    held = [left(end.fit, loaded.recordings(True)) for end in ends if loaded.inputs.held_out]
    given = invocation(loaded.inputs, about(loaded.source.text))
    given = replace(given, provenance=loaded.provenance("diagnose", step, given))
    summary = ResultSummary(result, given, tuple(joint.floor for joint in held[-1].joints) if held else ())
    folder = loaded.new_folder("answer")
    named = [f.term for f in result.findings if f.term in last.values]
    found = [ValuesFound(placed=PlacedEffect(t.name, t.joint), values=dict(last.values[t])) for t in named]
    write(folder / "verdict.json", describe.verdict(summary))
    write(folder / "found.json", found)
    (folder / "report.html").write_text(reports.report(summary).html(), encoding="utf-8")
    for joint in range(len(first.joints)):
        added = " + ".join(dict.fromkeys(f.term.effect for f in summary.findings_at(joint)))
        of_joint(first, last, joint, added).save(folder / f"joint{joint + 1}.npz")
        if held:
            before = held[0] if len(held) > 1 else None
            of_held_out(before, held[-1], joint, added).save(folder / f"held{joint + 1}.npz")
    return TaskResult(answered=step, verdict=result.verdict)


TASKS: dict[str, Callable[..., TaskResult]] = {
    task.__name__: task for task in (read, begin, fit, diagnose, tried, hidden, experiment, replayed, open_plans)
}
