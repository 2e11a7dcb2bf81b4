"""The work of a session, task by task: what is read, fitted and diagnosed is written into the session's `work` folder,
and what is fitted once is kept for the next task."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime import files
from runtime.diagnosis.branches import complete
from runtime.diagnosis.diagnose import Diagnosis, conclude
from runtime.diagnosis.steps import Finding, Step
from runtime.estimation.compare import Comparison, as_written
from runtime.inspection.inspection import Inspection
from runtime.loop import held_out
from runtime.plain_json import plain
from runtime.planning import results, trajectory
from runtime.report import plans
from runtime.report.follow_up import about
from runtime.report.page import planned_page
from runtime.report.page.html_page import render
from runtime.report.signals.joint_signals import of_held_out, of_joint, of_recording
from runtime.report.summary import ResultSummary
from runtime.studio import describe
from runtime.studio.bench import Bench, Found, Opened, Tell, empty, write
from runtime.studio.commands import invocation
from runtime.studio.history import PlacedEffect
from runtime.studio.session import SessionError
from runtime.wording import percent
from runtime.workspace.names import ARMS
from runtime.workspace.source import Source
from symbolic.model_file.checks import quote

READING, COMPILING, FITTING = "reading the recordings", "deriving and compiling the model", "fitting the model"
LOOKING, WEIGHING = "looking for missing effects", "weighing what would have been seen"
DRAWING, EVALUATING = "drawing what was found", "evaluating the plan"
_FITTING = (COMPILING, FITTING, DRAWING)

# --- tasks: (bench, tell, what the server says) -> what the server takes ---


def begin(bench: Bench, tell: Tell) -> Found:
    """Look at the recordings, and where they can be used fit the model as given: step 0."""
    opened = bench.opened()
    tell.parts((READING, *_FITTING))
    tell.part(READING)
    for number, inspection in enumerate(opened.inspections, 1):
        _keep_recording(opened, number, inspection)
    problems = [i.problem for i in opened.inspections if i.problem is not None]
    if problems or not opened.inputs.complete or opened.session.history.steps:
        return {"step": None, "problems": problems}
    return {"step": _fitted(opened, tell, 0, opened.source.text, None, "given", ())}


def fit(bench: Bench, tell: Tell, step: int, number: int, kind: str, changed: Sequence[Mapping[str, Any]]) -> Found:
    """A step's model with effects more, or without one, fitted: the next step.

    Where the diagnosis of the step has named an effect, its fit begins at what was found.
    """
    opened = bench.opened()
    tell.parts(_FITTING)
    values = opened.values_found(step)
    edits, done = opened.source.with_text(opened.text(step)).edits, []
    for entry in changed:
        effect, joint = str(entry["effect"]), entry["joint"]
        if kind == "added":
            name = edits.name_of_next(effect, joint)
            edits, effect = edits.add(effect, joint, values.get((effect, joint))), name
        else:
            edits = edits.remove(effect, joint)
        done.append(PlacedEffect(effect, joint))
    return {"step": _fitted(opened, tell, number, edits.text, step, kind, done)}


def diagnose(bench: Bench, tell: Tell, step: int) -> Found:
    """Which effects a step's model lacks."""
    opened = bench.opened()
    tell.parts((FITTING, LOOKING, WEIGHING, DRAWING))
    tell.part(FITTING)
    pristine = opened.search(step, opened.text(step))
    del opened.searches[step]  # a diagnosis goes on from it, and so changes it
    tell.part(LOOKING)
    search = complete(pristine, lambda reached: tell.said(_progress(reached)))
    tell.part(WEIGHING)
    result = conclude(search, opened.source.compiled.model_with_guesses)
    tell.part(DRAWING)
    given = invocation(opened.inputs, about(opened.source.text))
    held = [held_out.left(s.identification, opened.recordings(True)) for s in _ends(result) if opened.inputs.held_out]
    summary = ResultSummary(result, given, tuple(joint.floor for joint in held[-1].joints) if held else ())
    work = empty(opened.session.scratch / "verdict")
    write(work / "verdict.json", describe.verdict(summary))
    write(work / "found.json", {"values": _values(result.findings, result.steps[-1])})
    files.replace(work / "report.html", render(summary).encode())
    for joint in range(len(summary.first.joints)):
        added = " + ".join(dict.fromkeys(f.term.effect for f in summary.findings_at(joint)))
        of_joint(summary.first, summary.last, joint, added).save(work / f"joint{joint + 1}.npz")
        if held:
            before = held[0] if len(held) > 1 else None
            of_held_out(before, held[-1], joint, added).save(work / f"held{joint + 1}.npz")
    return {"judged": step, "verdict": result.verdict}


def open_plans(bench: Bench, tell: Tell, files: Sequence[Mapping[str, str]]) -> Found:
    """Render the report's page of each trajectory, as `tendon optimize --report` does, from the file alone.

    files   name in given/, and what it was called
    """
    opened, made = bench.opened(), []
    tell.parts((COMPILING, EVALUATING))
    for k, entry in enumerate(files):
        path = opened.session.folder / "given" / entry["file"]
        source = _arm_of_plan(opened, trajectory.arm_of(path))
        tell.part(COMPILING)
        model = source.compiled.model()
        planned = trajectory.read(path, model)
        tell.part(EVALUATING)
        document = plain(results.stated(model, planned))
        work = empty(opened.session.scratch / f"plan{k}")
        (work / "page.html").write_text(planned_page.render(model, planned, document), encoding="utf-8")
        write(work / "plan.json", {"name": entry["name"], "headline": plans.headline(document)})
        made.append(work.name)
    return {"opened": made}


TASKS: dict[str, Callable[..., Found]] = {"begin": begin, "fit": fit, "diagnose": diagnose, "open_plans": open_plans}


# --- what they have in common ---


def _fitted(
    opened: Opened, tell: Tell, number: int, text: str, parent: int | None, kind: str, changed: Sequence[PlacedEffect]
) -> Found:
    """A step, written; what the server needs of it for the history."""
    tell.part(COMPILING)
    opened.model(text)
    tell.part(FITTING)
    search = opened.search(number, text)
    step, held = search.steps[0], opened.held(number)
    held_joints = () if held is None else held.joints
    tell.part(DRAWING)
    comparison = Comparison(step.identification, step.joints, as_written(step.identification))
    summary = ResultSummary(comparison, invocation(opened.inputs, about(opened.source.text)))
    work = empty(opened.session.scratch / "step")
    (work / "model.toml").write_text(text, encoding="utf-8")
    put = opened.source.with_text(text).edits.set(step.identification.document()).text
    (work / "fitted.toml").write_text(put, encoding="utf-8")
    write(work / "shown.json", describe.step(number, summary, held_joints, search.suspicions))
    write(work / "library.json", describe.offered(search))
    _keep_signals(work, opened, number, parent, ", ".join(map(str, changed)))
    return {
        "parent": parent,
        "kind": kind,
        "changed": [{"effect": e.effect, "joint": e.joint} for e in changed],
        "joints": describe.errors(step, held_joints),
    }


def _arm_of_plan(opened: Opened, arm: str) -> Source:
    """The model file of an arm: the session's, or one that ships with Tendon. Raises SessionError."""
    given = opened.inputs.model
    if given is not None and arm in (opened.source.arm().name, given.name.removesuffix(".toml")):
        return opened.source
    if arm in {path.stem for path in ARMS.glob("*.toml")}:
        return Source.shipped(arm, opened.effects)
    raise SessionError(f"the plan is for the arm {quote(arm)}, which is not the session's; give its model file first")


def _keep_signals(work: Path, opened: Opened, number: int, parent: int | None, changed: str) -> None:
    """The signal sets of a step beside the one that it changes, if it changes one."""
    step, before = opened.fitted(number), None if parent is None else opened.fitted(parent)
    held, held_before = opened.held(number), None if parent is None else opened.held(parent)
    for k, series in enumerate(step.joints):
        comparable = before is not None and np.array_equal(before.joints[k].t, series.t)
        of_joint(before if before and comparable else step, step, k, changed).save(work / f"joint{k + 1}.npz")
        if held is not None:
            of_held_out(held_before, held, k, changed).save(work / f"held{k + 1}.npz")


def _ends(result: Diagnosis) -> Sequence[Step]:
    """The model as it was diagnosed, and with all that was found, where something was."""
    return result.steps[:1] if len(result.steps) == 1 else (result.steps[0], result.steps[-1])


def _keep_recording(opened: Opened, number: int, inspection: Inspection) -> None:
    """What was read of a recording, in its folder."""
    target = opened.session.recording(number)
    if (target / "recording.json").is_file():
        return
    work = empty(opened.session.scratch / "recording")
    joints = 0 if inspection.recording is None else len(inspection.recording.q)
    for joint in range(joints):
        assert inspection.recording is not None
        of_recording(inspection.recording, joint).save(work / f"joint{joint + 1}.npz")
    given = opened.inputs.recordings[number - 1]
    write(work / "recording.json", describe.recording(number, given, inspection, joints))
    target.parent.mkdir(exist_ok=True)
    work.rename(target)


def _values(findings: Sequence[Finding], last: Step) -> list[Found]:
    """Where the fit of a model with the findings may begin."""
    terms = [f.term for f in findings]
    return [{"effect": t.name, "joint": t.joint, "values": dict(last.values[t])} for t in terms if t in last.values]


def _progress(step: Step) -> str:
    what = "as in the file" if step.added is None else f"with {step.added}"
    return f"{what}: error {', '.join(percent(r) for r in step.fitted.relative)}"
