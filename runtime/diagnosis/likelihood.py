"""Structures that were refitted whole, weighed against each other under one noise model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.diagnosis.evidence import Ground
from runtime.diagnosis.settings import BIC_APART
from runtime.diagnosis.steps import Step
from runtime.estimation.folds import bic
from runtime.estimation.problem import Problem
from runtime.model.terms import Term, Values


def whitened_bic(ground: Ground, steps: Sequence[Step]) -> list[float]:
    """BIC of each step, residuals whitened by the noise of the best of them; ground: of any of them."""
    fits = [s.identification for s in steps]
    rows = ground.rows
    weighted = [sum(float(r.weight**2 * (e @ e)) for r, e in zip(rows, f.fit.residual, strict=True)) for f in fits]
    best = fits[int(np.argmin(weighted))].fit.residual
    noise = [r.autoregression(e) for r, e in zip(rows, best, strict=True)]
    total = sum(r.count for r in rows)
    found = []
    for f in fits:
        white = [r.whiten(e, ar) for r, e, ar in zip(rows, f.fit.residual, noise, strict=True)]
        fit = sum(bic(float(e @ e), r.count, 0) for r, e in zip(rows, white, strict=True) if r.count)
        found.append(fit + _unknowns(f.problem, f.fit.shapes) * float(np.log(total)))
    return found


def outgrown(ground: Ground, terms: Sequence[Term], steps: Sequence[Step], best: int) -> list[Term]:
    """Terms that are special cases of the best one and clearly less likely than it: steps, one a term.

    Candidates are weighed under one variance for all joints, in which what a special case leaves at one or two hardly
    counts on an arm of many, and Vuong's test is for models of which none contains the other. Refitted, every joint has
    a variance of its own, and the likelihood alone sets them apart.
    """
    chosen = terms[best]
    generalises = steps[best].identification.model.library.effects[chosen.effect].generalises
    special = [k for k, t in enumerate(terms) if t.effect in generalises and t.joint == chosen.joint]
    if not special:
        return []
    scores = whitened_bic(ground, steps)
    return [terms[k] for k in special if scores[k] - scores[best] >= BIC_APART]


def _unknowns(problem: Problem, shapes: dict[Term, Values]) -> int:
    return problem.layout.size + sum(len(s) for s in shapes.values())
