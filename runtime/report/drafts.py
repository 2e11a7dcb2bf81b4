"""What is said of a draft for an unexplained residual: why there is none, what it explains, what to do with it."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from runtime.diagnosis.grammar_search import Draft
from runtime.diagnosis.verdict import Diagnosis
from runtime.report.diagnosed import drafted


def needless(diagnosis: Diagnosis) -> str:
    """Why there is no draft for a verdict other than "unexplained"."""
    return {
        "effect": "No draft: an effect of the library explains the residual; add it with tendon improve.",
        "clean": "No draft: the residual is noise.",
        "refused": "No draft: the recordings were refused.",
    }[diagnosis.verdict]


def none_found(diagnosis: Diagnosis) -> str:
    """Why an unexplained residual gets no draft."""
    step = diagnosis.last
    outside = [i + 1 for i in diagnosis.unexplained if step.joints[i].floor.repeatable(step.joints[i].rms) is False]
    text = "No draft: no term of the model's signals explains the residual"
    if outside:
        text += (
            f"; at joint {', '.join(map(str, outside))} the residual does not repeat with the motion, as from outside"
        )
    return text + ". Record further signals, or compare with a recording from another day."


def notes(draft: Draft, model: str, recordings: Sequence[str]) -> list[str]:
    """Paragraphs for the top of a draft's file; recordings: names of files."""
    said = drafted(draft)
    values = ", ".join(f"{name} = {p.value:.4g} {p.unit}" for name, p in said.parameters.items())
    others = ", ".join(o.effect for o in said.others)
    return [
        f"At joint {said.joint} of {model}, on {', '.join(recordings)}, it explains {100 * said.share:.0f} % of "
        f"what the model leaves above the noise: rms {said.rms_before:.4g} -> {said.rms_after:.4g} "
        f"{said.unit}, noise floor {said.floor:.4g}.",
        f"Fitted there: {values}." + (f" Guesses that explain nearly as much: {others}." if others else ""),
        "Next: find a physical cause, rename the effect, correct the law and bound its parameters. Units and shape are "
        "consistent; test it on another recording.",
    ]


def next_steps(
    draft: Draft, model: Path, recordings: Sequence[Path], reading: Sequence[str], target: Path
) -> list[str]:
    """Commands that improve the model with the draft and that add it to the model file."""
    where = [] if draft.term.joint is None else ["--joint", str(draft.term.joint)]
    own = ["--effects", str(target)]
    return [
        shlex.join(["tendon", "improve", str(model), *map(str, recordings), *reading, *own]),
        shlex.join(["tendon", "add", str(model), draft.term.effect, *where, *own]),
    ]
