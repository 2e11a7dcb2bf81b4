"""A guess at physics that is not in the library: the term of a grammar that explains most of what is left.

The guesses compete on the residual of a finished diagnosis as the library's effects did, through the same
gates; of those that explain nearly as much as the best, the simplest is proposed. A disturbance from
outside follows no signal of the model, so no guess passes and nothing is proposed.
"""

from __future__ import annotations

import shlex
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.candidates import Field
from runtime.compare import series, structure_json
from runtime.diagnose import Diagnosis
from runtime.identify import Problem, identify_motion
from runtime.judge import Evidence, Verdict, rank
from runtime.leftover import remainder
from runtime.loader import Model
from runtime.search import Errors, Finding, Step
from runtime.terms import Structure, Term

_FINALISTS = 3
"""Of each number of parameters, how many guesses meet in the last comparison."""
_REACH = 0.95
"""Part of the best guess's fall of BIC from which a simpler one is preferred to it."""


@dataclass(frozen=True)
class Draft:
    """A guess that passed the gates, added and refitted; `others`: those that explain nearly as much."""

    finding: Finding
    others: tuple[Term, ...]

    @property
    def term(self) -> Term:
        return self.finding.term

    def to_json(self) -> dict[str, Any]:
        """The key "draft" of `tendon diagnose --json`, without the file."""
        i = self.finding.joint_index
        before, after = self.finding.before, self.finding.after
        values = after.identification.inference.values[self.term]
        return {
            "effect": self.term.effect,
            "joint": self.term.joint,
            "equation": after.identification.model.library.effects[self.term.effect].equation,
            "share": self.finding.share(),
            "rms_before": before.fitted.rms[i],
            "rms_after": after.fitted.rms[i],
            "floor": before.joints[i].floor.value,
            "unit": before.joints[i].force_unit,
            "evidence": self.finding.evidence.to_json(),
            "parameters": {name: estimate.to_json() for name, estimate in values.items()},
            "others": [{"effect": t.effect, "joint": t.joint} for t in self.others],
        }


def described(diagnosis: Diagnosis) -> dict[str, Any]:
    """As `tendon diagnose --json`: at unexplained joints also over which signals the residual is structured."""
    document = {**diagnosis.to_json(), "draft": None}
    if diagnosis.verdict == "unexplained":
        step = diagnosis.steps[-1]
        for joint in unexplained(step):
            document["joints"][joint]["structure"] = structure_json(step.joints[joint])
    return document


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
    said = draft.to_json()
    values = ", ".join(f"{name} = {p['value']:.4g} {p['unit']}" for name, p in said["parameters"].items())
    others = ", ".join(o["effect"] for o in said["others"])
    return [
        f"At joint {said['joint']} of {model}, on {', '.join(recordings)}, it explains {100 * said['share']:.0f} % of "
        f"what the model leaves above the noise: rms {said['rms_before']:.4g} -> {said['rms_after']:.4g} "
        f"{said['unit']}, noise floor {said['floor']:.4g}.",
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


def best(step: Step, model: Model, guesses: Collection[str], joints: Sequence[int]) -> Draft | None:
    """As `propose`, on the residual of any step and at these joints (0-based)."""
    found = _field(step, model)
    floors = [s.floor.value for s in step.joints]
    passing = []
    for joint in joints:
        terms = [t for t in found.terms() if _at(t, joint) and t.effect in guesses and _has_neighbours(model, t)]
        verdict = _rank(found, terms, floors)
        if verdict.best is not None:
            passing.append((_nearly_best(verdict), verdict, joint))
    for near, verdict, joint in sorted(passing, key=lambda item: -item[1].ranked[0].delta_bic):
        after = _added(step, model, near[0])
        if after.fitted.rms[joint] < step.fitted.rms[joint]:
            return Draft(Finding(near[0], (), verdict, step, after), tuple(e.term for e in near[1:]))
    return None


def _field(step: Step, model: Model) -> Field:
    """The step's fit as a field for the candidates of another library."""
    found = step.identification
    problem = Problem(model, found.motion, found.problem.layout.terms, found.fit.prediction)
    problem.weights = found.fit.weights
    return Field(problem, found.fit)


def _at(term: Term, joint: int) -> bool:
    """Whether a joint (0-based) is the term's own; what acts on the whole arm counts at the first."""
    return (term.joint or 1) - 1 == joint


def _has_neighbours(model: Model, term: Term) -> bool:
    """Whether the joints beside it are there whose motion the term reads."""
    signals, joint = model.library.effects[term.effect].signals, term.joint or 1
    return ("qd_next" not in signals or joint < model.n) and ("qd_previous" not in signals or joint > 1)


def _rank(field: Field, terms: Sequence[Term], floors: Sequence[float]) -> Verdict:
    """First those of equal number of parameters among themselves, so that simple guesses reach the final, too."""
    info = field.model.library.effects
    finalists: list[Term] = []
    for size in sorted({len(info[t.effect].parameters) for t in terms}):
        equals = [t for t in terms if len(info[t.effect].parameters) == size]
        finalists += [e.term for e in rank(field, equals, floors).ranked[:_FINALISTS]]
    return rank(field, finalists, floors)


def _nearly_best(verdict: Verdict) -> list[Evidence]:
    """Those within reach of the best, the one with the fewest parameters first."""
    least = _REACH * verdict.ranked[0].delta_bic
    near = [e for e in verdict.ranked if e.passes and e.delta_bic >= least]
    return sorted(near, key=lambda e: (e.parameters, -e.delta_bic))


def _added(step: Step, model: Model, evidence: Evidence) -> Step:
    """The structure with the guess, everything refitted."""
    fit = step.identification.fit
    known: Structure = {t: dict(shape) for t, shape in fit.shapes.items()}
    known[evidence.term] = dict(evidence.candidate.shape)
    found = identify_motion(model, step.identification.motion, known, start=fit)
    joints = series(found)
    return Step(
        evidence.term, found, joints, Errors(tuple(j.rms for j in joints), tuple(j.relative for j in joints)), None
    )
