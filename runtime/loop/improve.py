"""The loop: fit, diagnose, add the missing effect to the model file, regenerate, refit, until no candidate passes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

from runtime.arrays import Array
from runtime.diagnosis.grammar_search import Draft, best
from runtime.diagnosis.settings import BUDGET
from runtime.diagnosis.stages import begin, complete, conclude
from runtime.diagnosis.steps import Step, residuals_elsewhere
from runtime.diagnosis.verdict import Diagnosis, Verdict
from runtime.documents.fits import FitDocument
from runtime.identification.compare import JointSeries, series_on
from runtime.identification.drive_gains import with_gains_of
from runtime.identification.fit import Fit
from runtime.identification.identify import fit_document, without_tip_rests
from runtime.identification.problem import Problem
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.motion.motion import Motion, prepare
from runtime.motion.repeats import Floor
from runtime.recordings.recording import Recording
from runtime.wording import AS_GIVEN


class EditedModel(Protocol):
    """Edits of a model file, as in runtime/workspace/edits.py."""

    @property
    def text(self) -> str: ...

    def add(self, effect: str, joint: int | None = None, values: Mapping[str, float] | None = None) -> Self: ...

    def set(self, fit: FitDocument) -> Self: ...

    def set_drive_gains(self, gains: Mapping[int, Mapping[str, float]]) -> Self: ...


class CompiledModel(Protocol):
    """Generated code of a model file, as in runtime/workspace/source.py."""

    def model(self) -> Model: ...


class ModelSource(Protocol):
    """A model file that can be edited and compiled, as in runtime/workspace/source.py."""

    @property
    def edits(self) -> EditedModel: ...

    @property
    def compiled(self) -> CompiledModel: ...

    def with_text(self, text: str) -> ModelSource: ...


@dataclass(frozen=True)
class Improvement:
    """The effects that were added, the error after each, and the diagnosis of the improved model.

    model_text   model file with the effects and the fitted values; unchanged where the data were refused
    found        diagnosis of the model as given, with everything that was added
    left         diagnosis of the improved model
    """

    model_text: str
    found: Diagnosis
    left: Diagnosis

    @property
    def steps(self) -> tuple[Step, ...]:
        return self.found.steps

    @property
    def findings(self) -> tuple[Step, ...]:
        return self.found.findings

    @property
    def verdict(self) -> Verdict:
        """An effect where one was added and no error on recordings that were not fitted rose by it; else what is said
        of what is left."""
        before, after = self.steps[0].held_out, self.steps[-1].held_out
        joints = [f.joint_index for f in self.findings]
        rose = before is not None and after is not None and any(after.rms[i] > before.rms[i] for i in joints)
        return "effect" if joints and not rose else self.left.verdict


def improve(
    source: ModelSource,
    recordings: Sequence[Recording],
    held_out: Sequence[Recording] = (),
    on_step: Callable[[str], None] | None = None,
    budget: int = BUDGET,
) -> Improvement:
    """Fit, diagnose and add effects until no candidate passes the gates; nothing is written.

    held_out   recordings that are never fitted; an effect that raises the error on them is not added
    on_step    gets a line about each step      budget  number of structures that the search may fit to all rows
    """
    tell = on_step or (lambda _: None)
    trail = begin(source.compiled.model(), recordings, held_out)
    tell(_progress(trail.last))
    trail = complete(trail, lambda step: tell(_progress(step)), budget)
    found = conclude(trail)
    last, edits = found.last, source.edits
    for finding in found.findings:
        edits = edits.add(finding.term.name, finding.term.joint, last.values[finding.term])
    left = found
    if found.findings:
        model = source.with_text(edits.text).compiled.model()
        fitted, written = set(last.values), set(structure(model))
        if fitted != written:
            apart = ", ".join(sorted(map(str, fitted ^ written)))
            raise RuntimeError(f"the edited model file and the fitted model differ in {apart}")
        alone = replace(last, chosen=None, before=None)
        left = conclude(replace(trail, model=model, last=alone))
    # All joints share the inertial parameters: values of a fit that contradicts itself at one are not written.
    if found.verdict != "refused" and not any(v.why == "unsound fit" for v in found.joints):
        drives = (with_gains_of(last.fit, i) for i in range(last.fit.model.n))
        gains = {i: drive.to_write for i, drive in enumerate(drives, 1) if drive is not None}
        edits = edits.set(fit_document(last.fit)).set_drive_gains(gains)
    return Improvement(edits.text, found, left)


def _progress(step: Step) -> str:
    def percent(errors: Sequence[float]) -> str:
        return ", ".join(f"{100 * error:.2f} %" for error in errors)

    what = AS_GIVEN if step.added is None else f"with {step.added}"
    held = "" if step.held_out is None else f"; held out {percent(step.held_out.relative)}"
    return f"{what}: error {percent(step.fitted.relative)}{held}"


# --- recordings that were not fitted ---


@dataclass(frozen=True)
class HeldOut:
    """Residuals of a fit on recordings that were not fitted.

    residuals   (M,) for each joint, on all rows of the motion
    joints      torque and prediction of each joint, on the rows that are compared
    """

    motion: Motion
    residuals: tuple[Array, ...]
    joints: tuple[JointSeries, ...]


def left(fit: Fit, recordings: Sequence[Recording]) -> HeldOut:
    """Residuals of a fit on one or more recordings."""
    model = fit.model
    motion = fit.on(without_tip_rests(model, prepare(recordings, fit.motion.band, model)))
    problem = Problem(model, motion, tuple(fit.shapes), fit.prediction, ahead=fit.ahead)
    residuals = residuals_elsewhere(fit, motion)
    return HeldOut(motion, tuple(residuals), series_on(fit, problem, residuals))


def floors(fit: Fit, recordings: Sequence[Recording]) -> tuple[Floor, ...]:
    """Noise floor of each joint on recordings that were not fitted, in the band of the fit; empty without any."""
    return tuple(joint.floor for joint in left(fit, recordings).joints) if recordings else ()


def propose(diagnosis: Diagnosis, model: Model, guesses: Collection[str]) -> Draft | None:
    """The simplest draft that explains nearly as much as any; None if none passes the gates.

    model   arm of the diagnosis, its library extended by the effects named in `guesses`
    """
    return best(diagnosis.last, model, guesses, diagnosis.unexplained)
