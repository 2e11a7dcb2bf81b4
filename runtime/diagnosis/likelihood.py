"""Structures that were refitted whole, weighed against each other under one noise model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.diagnosis.settings import ABOVE_NOISE, BIC_APART, LEAST_ERROR_FALL
from runtime.diagnosis.steps import Step
from runtime.diagnosis.worth import refuted
from runtime.identification.problem import Problem
from runtime.model.terms import Term, Values
from runtime.regression.system import LinearSystem, bic


def whitened_bic(ground: LinearSystem, steps: Sequence[Step]) -> list[float]:
    """BIC of each step, residuals whitened by the noise of the best of them; ground: of any of them."""
    fits = [s.identification for s in steps]
    rows = ground.joints
    weighted = [sum(float(r.weight**2 * (e @ e)) for r, e in zip(rows, f.fit.residual, strict=True)) for f in fits]
    best = fits[int(np.argmin(weighted))].fit.residual
    by = [r.whitening(e) for r, e in zip(rows, best, strict=True)]
    total = sum(r.independent for r in rows)
    found = []
    for f in fits:
        white = [whitened(e) for whitened, e in zip(by, f.fit.residual, strict=True)]
        fit = sum(bic(float(e @ e), r.independent, 0) for r, e in zip(rows, white, strict=True) if r.count)
        found.append(fit + _unknowns(f.problem, f.fit.shapes) * float(np.log(total)))
    return found


def ruled_out(term: Term, best: Step, joint: int) -> bool:
    """Whether a step that is clearly more likely rules out a term at a joint (0-based).

    The blows in a gap follow from motion above the band, which a simulation does not know: an error of theirs says
    little where what stands in their place leaves far more than noise as well.
    """
    here = best.joints[joint]
    rugged = best.identification.model.library.effects[term.effect].has_gap
    return not rugged or here.rms < ABOVE_NOISE * here.floor.spectrum


def outgrown(ground: LinearSystem, terms: Sequence[Term], steps: Sequence[Step], best: int) -> list[Term]:
    """Terms that are special cases of the best one and clearly less likely than it: steps, one a term.

    Candidates are weighed under one variance for all joints, in which what a special case leaves at one or two hardly
    counts on an arm of many, and Vuong's test is for models of which none contains the other. Refitted, every joint has
    a variance of its own, and the likelihood alone sets them apart.
    """
    special = _special_cases(steps[best], terms, terms[best])
    if not special:
        return []
    scores = whitened_bic(ground, steps)
    return [terms[k] for k in special if scores[k] - scores[best] >= BIC_APART]


def plainest(terms: Sequence[Term], steps: Sequence[Step], best: int) -> int:
    """The best term, or the special case of it that leaves hardly more: what a term has beyond one must be worth a
    name, too. A gap of almost no width is a spring by another integration, whose rounding would choose."""
    joint = (terms[best].joint or 1) - 1
    most = steps[best].fitted.rms[joint] / (1 - LEAST_ERROR_FALL)
    for k in _special_cases(steps[best], terms, terms[best]):
        if steps[k].fitted.rms[joint] <= most and not refuted(steps[k], steps[best]):
            return k
    return best


def _special_cases(step: Step, terms: Sequence[Term], of: Term) -> list[int]:
    """Which of some terms are special cases of a term of a step."""
    generalises = step.identification.model.library.effects[of.effect].generalises
    return [k for k, t in enumerate(terms) if t.effect in generalises and t.joint == of.joint]


def _unknowns(problem: Problem, shapes: dict[Term, Values]) -> int:
    return problem.layout.size + sum(len(s) for s in shapes.values())
