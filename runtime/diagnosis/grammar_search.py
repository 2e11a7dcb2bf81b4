"""Terms of a grammar as candidates: what would explain a residual if it were in the library.

The guesses compete on a residual as the library's effects did, through the same gates; of those that explain
nearly as much as the best, the simplest is taken. A disturbance from outside follows no signal of the model,
so no guess passes there.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from runtime.diagnosis.candidates import Candidate, FittedBase
from runtime.diagnosis.ranking import Ranking, rank
from runtime.diagnosis.steps import Step
from runtime.identification.fitting import fit_motion
from runtime.identification.problem import Problem
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term, steps
from runtime.motion.settings import LITTLE


@dataclass(frozen=True)
class Draft:
    """A guess that passed the gates, added and refitted; `others`: those that explain nearly as much."""

    step: Step
    others: tuple[Term, ...]

    @property
    def term(self) -> Term:
        return self.step.term


def best(step: Step, model: Model, guesses: Collection[str], joints: Sequence[int]) -> Draft | None:
    """The best guess on the residual of a step at these joints (0-based); None if none passes."""
    found = _base(step, model)
    passing = []
    for joint in joints:
        terms = [t for t in found.terms() if _at(t, joint) and t.effect in guesses and _has_neighbours(model, t)]
        ranking = _rank(found, terms, step.floors)
        if ranking.best is not None:
            passing.append((_nearly_best(ranking, model), ranking, joint))
    for near, ranking, joint in sorted(passing, key=lambda item: -item[1].candidates[0].evidence.net):
        after = _added(step, model, near[0])
        if after.fitted.rms[joint] < step.fitted.rms[joint]:
            return Draft(after.after(step, near[0], ranking), tuple(c.term for c in near[1:]))
    return None


def _base(step: Step, model: Model) -> FittedBase:
    found = step.fit
    terms, weights = found.problem.layout.terms, found.problem.weights
    problem = Problem(model, found.motion, terms, found.prediction, found.ahead, weights=weights)
    return FittedBase(replace(found, problem=problem))


def _at(term: Term, joint: int) -> bool:
    """Whether a joint (0-based) is the term's own; what acts on the whole arm counts at the first."""
    return (term.joint or 1) - 1 == joint


def _has_neighbours(model: Model, term: Term) -> bool:
    return all(0 <= (term.joint or 1) - 1 + step < model.n for step in steps(model.library, term.effect))


def _rank(base: FittedBase, terms: Sequence[Term], floors: Sequence[float]) -> Ranking:
    """First those of equal number of parameters among themselves, so that simple guesses reach the final, too."""
    info = base.model.library.effects
    finalists: list[Term] = []
    for size in sorted({len(info[t.effect].parameters) for t in terms}):
        equals = [t for t in terms if len(info[t.effect].parameters) == size]
        finalists += [c.term for c in rank(base, equals, floors).candidates[:3]]
    return rank(base, finalists, floors)


def _nearly_best(ranking: Ranking, model: Model) -> list[Candidate]:
    least, effects = (1 - LITTLE) * ranking.candidates[0].evidence.net, model.library.effects
    near = [c for c in ranking.candidates if c.passes and c.evidence.net >= least]
    return sorted(near, key=lambda c: (len(effects[c.term.effect].parameters), -c.evidence.net))


def _added(step: Step, model: Model, candidate: Candidate) -> Step:
    """The structure with the guess, everything refitted."""
    fit = step.fit
    known: Structure = {t: dict(shape) for t, shape in fit.shapes.items()}
    known[candidate.term] = dict(candidate.shape)
    found = fit_motion(model, step.fit.motion, known, start=fit)
    return Step.of(found)
