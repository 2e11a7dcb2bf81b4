"""A guess at physics that is not in the library, proposed to the user: what it explains, and what to do with it."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Sequence
from pathlib import Path

from msgspec.structs import replace

from runtime.diagnosis.diagnose import Diagnosis
from runtime.diagnosis.grammar_search import Draft, best
from runtime.diagnosis.remainder import remainder
from runtime.diagnosis.steps import Step
from runtime.documents.diagnosis import DiagnosisBase
from runtime.estimation.compare import structure_entries
from runtime.model.loader import Model


def described(diagnosis: Diagnosis) -> DiagnosisBase:
    """A diagnosis with the signals that the residual follows at each unexplained joint."""
    document = diagnosis.document()
    if diagnosis.verdict != "unexplained":
        return document
    joints, step = list(document.joints), diagnosis.steps[-1]
    for k in unexplained(step):
        joints[k] = replace(joints[k], structure=structure_entries(step.joints[k]))
    return replace(document, joints=joints)


def needless(diagnosis: Diagnosis) -> str:
    """Why a diagnosis that is not "unexplained" gets no guess."""
    return {
        "effect": "No draft: an effect of the library explains what is left; add it (tendon improve) and look again.",
        "clean": "No draft: the residual is noise, and there is nothing to explain.",
        "refused": "No draft: these recordings cannot decide, so a guess from them would be none.",
    }[diagnosis.verdict]


def none_found(diagnosis: Diagnosis) -> str:
    """Why an unexplained residual gets no guess."""
    step = diagnosis.steps[-1]
    outside = [i + 1 for i in unexplained(step) if step.joints[i].floor.repeatable(step.joints[i].rms) is False]
    text = "No draft: no term of the model's own signals explains what is left"
    if outside:
        text += f"; at joint {', '.join(map(str, outside))} it does not come back with the motion, as from outside"
    return text + ". Record what could cause it, or compare with a recording from another day."


def notes(draft: Draft, model: str, recordings: Sequence[str]) -> list[str]:
    """Paragraphs for the top of a draft's file; names of files only."""
    said = draft.document()
    values = ", ".join(f"{name} = {p.value:.4g} {p.unit}" for name, p in said.parameters.items())
    others = ", ".join(o.effect for o in said.others)
    return [
        f"At joint {said.joint} of {model}, on {', '.join(recordings)}, it explains {100 * said.share:.0f} % of "
        f"what the model leaves above the noise: rms {said.rms_before:.4g} -> {said.rms_after:.4g} "
        f"{said.unit}, noise floor {said.floor:.4g}.",
        f"Fitted there: {values}." + (f" Guesses that explain nearly as much: {others}." if others else ""),
        "What to do with it: find what could act like this, rename it, correct the law, and bound each parameter as "
        "the physics does. Units and shape are consistent; whether it is true only another recording can tell.",
    ]


def next_steps(
    draft: Draft, model: Path, recordings: Sequence[Path], reading: Sequence[str], target: Path
) -> list[str]:
    """The commands that show the error fall with the guess, and that put it into the model file."""
    where = [] if draft.term.joint is None else ["--joint", str(draft.term.joint)]
    own = ["--effects", str(target)]
    return [
        shlex.join(["tendon", "improve", str(model), *map(str, recordings), *reading, *own]),
        shlex.join(["tendon", "add", str(model), draft.term.effect, *where, *own]),
    ]


def unexplained(step: Step) -> tuple[int, ...]:
    """Joints (0-based) whose residual holds more than noise."""
    return tuple(i for i in range(len(step.joints)) if remainder(step, i) is not None)


def propose(diagnosis: Diagnosis, model: Model, guesses: Collection[str]) -> Draft | None:
    """The simplest guess that explains nearly as much as any; None if none passes the gates.

    model     the arm of the diagnosis, its library extended by the effects named in `guesses`
    """
    step = diagnosis.steps[-1]
    return best(step, model, guesses, unexplained(step))
