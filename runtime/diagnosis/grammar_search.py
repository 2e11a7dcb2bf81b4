"""Terms of a grammar as candidates: what would explain a residual if it were in the library.

The guesses compete on a residual as the library's effects did, through the same gates; of those that explain
nearly as much as the best, the simplest is taken. A disturbance from outside follows no signal of the model,
so no guess passes there.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from runtime.diagnosis.candidates import CandidateField
from runtime.diagnosis.gates import Evidence, Verdict, rank
from runtime.diagnosis.settings import GUESS_FINALISTS, GUESS_REACH
from runtime.diagnosis.steps import Finding, Step
from runtime.documents.diagnosis import DraftBase
from runtime.documents.parts import EffectAt
from runtime.identification.identify import identify_motion
from runtime.identification.problem import Problem
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term, steps

Wider = Callable[[], tuple[Model, Collection[str]]]
"""Opens the same arm with a library that holds guesses, too, and says which of its effects are guesses."""


@dataclass(frozen=True)
class Draft:
    """A guess that passed the gates, added and refitted; `others`: those that explain nearly as much."""

    finding: Finding
    others: tuple[Term, ...]

    @property
    def term(self) -> Term:
        return self.finding.term

    def document(self) -> DraftBase:
        """The key "draft" of `tendon diagnose --json`, without the file."""
        i = self.finding.joint_index
        before, after = self.finding.before, self.finding.after
        values = after.identification.inference.values[self.term]
        return DraftBase(
            effect=self.term.effect,
            joint=self.term.joint,
            equation=after.identification.model.library.effects[self.term.effect].equation,
            share=self.finding.share(),
            rms_before=before.fitted.rms[i],
            rms_after=after.fitted.rms[i],
            floor=before.joints[i].floor.value,
            unit=before.joints[i].force_unit,
            evidence=self.finding.evidence.document(),
            parameters={name: estimate.document() for name, estimate in values.items()},
            others=[EffectAt(effect=t.effect, joint=t.joint) for t in self.others],
        )


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
            return Draft(Finding(near[0], (), verdict, before=step, after=after), tuple(e.term for e in near[1:]))
    return None


def _field(step: Step, model: Model) -> CandidateField:
    """The step's fit as a field for the candidates of another library."""
    found = step.identification
    problem = Problem(
        model, found.motion, found.problem.layout.terms, prediction=found.fit.prediction, ahead=found.fit.ahead
    )
    problem.weights = found.fit.weights
    return CandidateField(problem, found.fit)


def _at(term: Term, joint: int) -> bool:
    """Whether a joint (0-based) is the term's own; what acts on the whole arm counts at the first."""
    return (term.joint or 1) - 1 == joint


def _has_neighbours(model: Model, term: Term) -> bool:
    """Whether the joints beside it are there whose motion the term reads."""
    return all(0 <= (term.joint or 1) - 1 + step < model.n for step in steps(model.library, term.effect))


def _rank(field: CandidateField, terms: Sequence[Term], floors: Sequence[float]) -> Verdict:
    """First those of equal number of parameters among themselves, so that simple guesses reach the final, too."""
    info = field.model.library.effects
    finalists: list[Term] = []
    for size in sorted({len(info[t.effect].parameters) for t in terms}):
        equals = [t for t in terms if len(info[t.effect].parameters) == size]
        finalists += [e.term for e in rank(field, equals, floors).ranked[:GUESS_FINALISTS]]
    return rank(field, finalists, floors)


def _nearly_best(verdict: Verdict) -> list[Evidence]:
    """Those within reach of the best, the one with the fewest parameters first."""
    least = GUESS_REACH * verdict.ranked[0].delta_bic
    near = [e for e in verdict.ranked if e.passes and e.delta_bic >= least]
    return sorted(near, key=lambda e: (e.parameters, -e.delta_bic))


def _added(step: Step, model: Model, evidence: Evidence) -> Step:
    """The structure with the guess, everything refitted."""
    fit = step.identification.fit
    known: Structure = {t: dict(shape) for t, shape in fit.shapes.items()}
    known[evidence.term] = dict(evidence.candidate.shape)
    found = identify_motion(model, step.identification.motion, known, start=fit)
    return Step.of(evidence.term, found)
