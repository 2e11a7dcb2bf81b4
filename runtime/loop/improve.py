"""The whole loop: fit, diagnose, add what is missing to the model file, regenerate, refit, until nothing passes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from msgspec import UNSET

from runtime.diagnosis.branches import complete
from runtime.diagnosis.diagnose import Diagnosis, begin, conclude, finding_entry
from runtime.diagnosis.grammar_search import Wider
from runtime.diagnosis.steps import Finding, Step
from runtime.documents.diagnosis import FitsEntry, HistoryEntry, ImprovementBase
from runtime.documents.fits import FitDocument
from runtime.model.loader import Model
from runtime.model.terms import Term, structure
from runtime.recordings.recording import Recording

OpenModel = Callable[[str], Model]
Add = Callable[[str, str, int | None, Mapping[str, float] | None], str]
Put = Callable[[str, FitDocument], str]
OnStep = Callable[[str], None]


@dataclass(frozen=True)
class Improvement:
    """What was added, what the error did, and what is left.

    model_text   the model file with the effects and the identified values; as it was where the data were refused
    found        the diagnosis of the model as given, with everything that was added
    left         the diagnosis of the improved model
    """

    model_text: str
    found: Diagnosis
    left: Diagnosis

    @property
    def steps(self) -> tuple[Step, ...]:
        return self.found.steps

    @property
    def findings(self) -> tuple[Finding, ...]:
        return self.found.findings

    def document(self) -> ImprovementBase:
        """As `tendon improve --json`, but for what follows from it: the diagnosis of what is left, and the history."""
        first, last = self.steps[0].identification, self.steps[-1].identification
        return self.left.document().as_part_of(
            ImprovementBase,
            sensors=[worth.document() for worth in self.found.sensors],
            history=[
                HistoryEntry(
                    added=None if step.added is None else str(step.added),
                    rms=list(step.fitted.rms),
                    relative=list(step.fitted.relative),
                    held_out=None if step.held_out is None else list(step.held_out.rms),
                    held_out_relative=None if step.held_out is None else list(step.held_out.relative),
                    finding=finding_entry(self.found, k - 1) if k else UNSET,
                )
                for k, step in enumerate(self.steps)
            ],
            identification=FitsEntry(before=first.document(), after=last.document()),
        )


def improve(
    model_text: str,
    open_model: OpenModel,
    add: Add,
    put: Put,
    recordings: Sequence[Recording],
    held_out: Sequence[Recording] = (),
    on_step: OnStep | None = None,
    wider: Wider | None = None,
) -> Improvement:
    """Improve a model until no candidate passes the gates.

    open_model   text of a model file -> compiled and loaded model
    add          (text, effect, joint, values) -> text with that effect in it
    put          (text, fit) -> text with the identified values
    held_out     never fitted; an effect that raises the error on them is not added
    wider        as for `diagnose`
    """
    tell = on_step or (lambda _: None)
    search = begin(open_model(model_text), recordings, held_out)
    tell(_progress(search.steps[-1]))
    search = complete(search, lambda step: tell(_progress(step)))
    found = conclude(search, wider)
    last, text = found.steps[-1], model_text
    for finding in found.findings:
        text = add(text, finding.term.name, finding.term.joint, last.values[finding.term])
    search.model = _reloaded(open_model, text, last)
    left = conclude(replace(search, steps=[last], findings=[])) if found.findings else found
    believed = found.verdict != "refused"
    return Improvement(put(text, last.identification.document()) if believed else text, found, left)


def _reloaded(open_model: OpenModel, text: str, step: Step) -> Model:
    """The model as regenerated from the edited file; it must hold exactly the terms that were fitted."""
    model = open_model(text)
    fitted = set(step.values)
    written: set[Term] = set(structure(model))
    if fitted != written:
        apart = ", ".join(sorted(map(str, fitted ^ written)))
        raise RuntimeError(f"the edited model file and the fitted model differ in {apart}")
    return model


def _progress(step: Step) -> str:
    what = "as in the file" if step.added is None else f"with {step.added}"
    error = ", ".join(f"{100 * r:.2f} %" for r in step.fitted.relative)
    held = (
        "" if step.held_out is None else f"; held out {', '.join(f'{100 * r:.2f} %' for r in step.held_out.relative)}"
    )
    return f"{what}: error {error}{held}"
