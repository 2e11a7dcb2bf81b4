"""Backward: a trail without findings that others make superfluous, that are the rest of another, or not significant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from runtime.diagnosis.acceptance import (
    above_noise,
    helps_held_out,
    is_accepted,
    is_significant,
    kept_alone,
    own_joints,
    same_signals,
    simplest,
    whitened_bic,
)
from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.gates import BIC
from runtime.diagnosis.ranking import Ranking, rank
from runtime.diagnosis.settings import BIC_APART, MOST_OF_BOTH
from runtime.diagnosis.steps import Step, Trail
from runtime.model.terms import Term, joints_of


def lacking(step: Step, terms: Sequence[Term]) -> list[Term]:
    """Those of some terms that do not act only where the residual is below the noise."""
    base = step.base
    return [t for t in terms if base.watched(t) or above_noise(step, own_joints(base.model, t))]


def reconsidered(trail: Trail) -> Trail:
    """The trail without the first finding that later ones have made superfluous, or with a likelier one in its place;
    the same trail where there is none."""
    last, findings = trail.last.term, trail.findings
    for k, finding in enumerate(findings[:-1]):
        if (finding.term.effect, finding.term.joint) == (last.effect, last.joint):
            continue  # several of one effect are there because each has what the others have not
        if finding.candidate.twist is not None or not _share_a_joint(trail, finding.term, last):
            continue
        without = trail.without(finding.term)
        ranking = _in_place(trail, without, finding.term)
        own = ranking.of(finding.term)
        likely = own.delta_bic if own is not None and own.passes else -np.inf
        best, others = ranking.best, [f for f in findings if f is not finding]
        needless = _is_superfluous(trail, finding, without) or (best is None and not _is_likelier(trail, without))
        if needless and not helps_held_out(without, trail.last, finding.term):
            return trail.rebuilt(others, {}, (finding.term,))
        apart = best is not None and best.delta_bic - likely >= BIC_APART
        if best is not None and apart and not _is_worse_with(trail, best, finding, without):
            others.insert(k, replace(finding, chosen=best, ranking=ranking, rivals=ranking.rivals))
            return trail.rebuilt(others, {best.term: best.shape}, (finding.term,))
    return trail


def _share_a_joint(trail: Trail, one: Term, other: Term) -> bool:
    """What acts on none of a finding's joints explains something else."""
    return bool(set(joints_of(trail.model, one)) & set(joints_of(trail.model, other)))


def _in_place(trail: Trail, step: Step, gone: Term) -> Ranking:
    """Candidates that could stand for a finding beside the step without it. What acts on none of its joints
    explains something else, and what contains another finding would take that one's place as well."""
    base, own = step.base, set(joints_of(trail.model, gone))
    others = {(f.term.effect, f.term.joint) for f in trail.findings if f.term != gone}
    effects = trail.model.library.effects
    terms = [
        t
        for t in base.terms()
        if own & set(joints_of(trail.model, t))
        and not any((g, t.joint) in others for g in effects[t.effect].generalises)
    ]
    return rank(base, lacking(step, terms), step.floors)


def _is_superfluous(trail: Trail, finding: Step, without: Step) -> bool:
    """Whether later findings do without an earlier one, or that one is only what a later one's law lacks."""
    whole, last = trail.last, trail.last.term
    if not is_accepted(without, whole, finding.term):
        return True
    if not may_be_the_rest(trail, finding.term, last):
        return False
    own, later = _kept_alone(trail, finding.term, (last,), whole)
    return later >= MOST_OF_BOTH and later > own


def _is_likelier(trail: Trail, without: Step) -> bool:
    """Whether all findings, refitted, are likelier than without one of them, by as much as a candidate must be.

    The gates weigh all joints under one variance, in which what one joint gains may drown in what others leave.
    """
    plain, whole = whitened_bic(without.base.system, [without, trail.last])
    return plain - whole > BIC.limit


def _is_worse_with(trail: Trail, candidate: Candidate, instead: Step, without: Step) -> bool:
    """Whether another effect in a finding's place, all refitted, is not clearly likelier, explains hardly more than
    that finding does as a special case, or explains less of recordings that were not fitted."""
    added = [(t, v) for t, v in trail.added() if t in without.shapes]
    known = trail.structure([*added, (candidate.term, candidate.shape)])
    whole, other = trail.last, trail.refitted(known, without)
    likely, other_way = whitened_bic(without.base.system, [whole, other])
    if likely - other_way < BIC_APART or simplest((candidate.term, instead.term), (other, whole), 0):
        return True
    if whole.held_out is None or other.held_out is None:
        return False
    own = {*joints_of(trail.model, candidate.term), *joints_of(trail.model, instead.term)}
    return other.held_out.squared(own) > whole.held_out.squared(own)


def without_insignificant(trail: Trail) -> Trail:
    """The trail without findings, the least likely first, whose size is not significant beside all others."""
    while True:
        last = trail.last
        open_ones = [f for f in trail.findings if f.candidate.twist is None and not is_significant(last, f.term)]
        open_ones.sort(key=lambda f: f.candidate.delta_bic)
        without = ((f, trail.without(f.term)) for f in open_ones)
        kept = (is_accepted, helps_held_out)
        gone = next((f for f, before in without if not any(keeps(before, last, f.term) for keeps in kept)), None)
        if gone is None:
            return trail
        trail = trail.rebuilt([f for f in trail.findings if f is not gone], {}, (gone.term,))


def without_replaced(trail: Trail) -> Trail:
    """The trail without findings that the last one generalises: they were special cases of it, and its evidence is then
    counted from where the first of them began."""
    kept = [f for f in trail.findings if f.term in trail.last.values]
    if len(kept) == len(trail.findings):
        return trail
    gone = [f.term for f in trail.findings if f not in kept]
    trail = trail.rebuilt(kept, {}, gone)
    last = trail.last
    before = last.previous
    alone = rank(before.base, [last.term], before.floors).best
    return trail if alone is None else trail.to(replace(last, chosen=alone))


# one law at a place, and what it leaves ------------------------------------------------------------------------------


def rest_of_another(trail: Trail, terms: Sequence[Term], both: Step) -> bool:
    """Whether an effect found before, over the same quantities at the same joint, leaves hardly anything to these:
    then they are what that one's law lacks, and no effects of their own; both: the step with all of them.

    One law that nearly does it stands before two that do as well without it.
    """
    earlier = [f for f in trail.findings if all(may_be_the_rest(trail, f.term, t) for t in terms)]
    kept = (_kept_alone(trail, f.term, terms, both) for f in earlier)
    return any(own >= MOST_OF_BOTH and (len(terms) > 1 or own >= later) for own, later in kept)


def may_be_the_rest(trail: Trail, one: Term, other: Term) -> bool:
    """Whether a later term may be the rest of one before, at the same joint: over the same quantities, or after one
    whose law is one form of many."""
    one_info, other_info = (trail.model.library.effects[t.effect] for t in (one, other))
    if one.joint is None or one.joint != other.joint or one.effect == other.effect:
        return False
    contained = one.effect in other_info.generalises or other.effect in one_info.generalises
    return not contained and (one_info.one_form or same_signals(one_info, other_info))


def _kept_alone(trail: Trail, earlier: Term, terms: Sequence[Term], both: Step) -> list[float]:
    """As `kept_alone` of an earlier finding and of later terms; both: the step with all of them."""
    added = {f.term for f in trail.findings} | set(terms)
    shapes = [(t, v) for t, v in both.shapes.items() if t in added]
    none, first, second = (
        trail.refitted(trail.structure([(t, v) for t, v in shapes if t not in gone]), both)
        for gone in ((earlier, *terms), tuple(terms), (earlier,))
    )
    return kept_alone(none, (first, second), both, (earlier.joint or 1) - 1)
