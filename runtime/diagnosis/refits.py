"""Candidates refitted beside each other: which of them is the best of its place, and which are its rivals."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from runtime.diagnosis.acceptance import acting, own_joints, preferred, refitted
from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.ranking import weigh
from runtime.diagnosis.score import NOT_WEIGHED
from runtime.diagnosis.settings import ABOVE_NOISE
from runtime.diagnosis.steps import Step, Trail
from runtime.model.terms import Term, joints_of


@dataclass(frozen=True, eq=False)
class Refitted:
    """A candidate with everything refitted beside it, and the gates asked again."""

    candidate: Candidate
    step: Step

    @property
    def term(self) -> Term:
        return self.candidate.term


def refit(trail: Trail, candidate: Candidate, stale: bool = False) -> Refitted:
    """stale: the candidate was weighed beside another step than the last."""
    last = trail.last
    if stale:
        candidate = weighed_anew(last, candidate)
    step = trail.with_candidates(last, candidate)
    return Refitted(refitted(last, step, candidate), step)


def weighed_anew(step: Step, candidate: Candidate) -> Candidate:
    """A candidate weighed beside another step."""
    found = weigh(step.base, [candidate], step.floors).of(candidate.term)
    return replace(candidate, evidence=NOT_WEIGHED) if found is None else found


def share_a_joint(trail: Trail, one: Term, other: Term) -> bool:
    """What acts on none of a finding's joints explains something else."""
    return bool(set(joints_of(trail.model, one)) & set(joints_of(trail.model, other)))


def place_of(trail: Trail, term: Term) -> int | None:
    """The joint (from 1) at which a term competes with others; None of one that acts on several."""
    return 1 if trail.model.n == 1 else term.joint


def best_of(trail: Trail, those: Sequence[Refitted]) -> tuple[Refitted, tuple[Term, ...]] | None:
    """Of some refits of one joint the simplest of those that are as likely as the best, and its rivals."""
    able = [one for one in those if one.candidate.passes]
    if not able:
        return None
    best = max(able, key=lambda one: one.candidate.evidence.net)
    for one in able:
        groups = of_either(trail, one.term, best.term)
        if one is not best and preferred(one.step, best.step, groups, dearer(one, best)):
            best = one
    alike = [one for one in able if one is best or not clearly_worse(trail, one, best)]
    cheapest = simplest(trail, [one.candidate for one in alike])
    first = next(one for one in alike if one.candidate is cheapest)
    return first, tuple(one.term for one in alike if one is not first)


def simplest(trail: Trail, those: Sequence[Candidate]) -> Candidate:
    """Of candidates that nothing tells apart that with the fewest unknowns, of such one that does not contradict the
    model file before one that does, then the likeliest."""
    return min(those, key=lambda c: (unknowns(trail, c), c.predicted is False, -c.evidence.net))


def unknowns(trail: Trail, candidate: Candidate) -> int:
    return trail.last.base.unknowns(candidate.term, candidate.searched, candidate.predicted)


def dearer(one: Refitted, other: Refitted) -> float:
    return one.candidate.evidence.price - other.candidate.evidence.price


def clearly_worse(trail: Trail, one: Refitted, best: Refitted) -> bool:
    joint = best.step.joints[own_joints(trail.model, best.term)[0]]
    if trail.model.library.effects[one.term.effect].has_gap and joint.rms > ABOVE_NOISE * joint.floor.spectrum:
        # The blows in a gap follow from motion above the band, which a simulation does not know: an error of theirs
        # says little where what stands in their place leaves far more than noise as well.
        return False
    return preferred(best.step, one.step, of_either(trail, one.term, best.term), dearer(best, one))


def of_either(trail: Trail, one: Term, other: Term) -> list[Collection[int]]:
    """Groups of joints (0-based) at which one of two terms must show."""
    return [*acting(trail.model, one), *acting(trail.model, other)]
