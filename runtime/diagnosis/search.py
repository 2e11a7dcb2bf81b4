"""Rules that lengthen or shorten a trail: each takes one and returns one.

Forward by the best candidate, in pairs where one effect stood for two, and backward again where later effects make an
earlier one superfluous.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from runtime.diagnosis.acceptance import (
    above_noise,
    acting,
    clearly_better,
    error_falls,
    explains_better,
    is_accepted,
    is_significant,
    kept_alone,
    less_likely_cases,
    own_joints,
    preferred,
    ruled_out,
    same_signals,
    simplest,
    whitened_bic,
)
from runtime.diagnosis.candidates import Candidate, FittedBase
from runtime.diagnosis.gates import BIC, TORQUE
from runtime.diagnosis.ranking import Ranking, rank, weigh
from runtime.diagnosis.settings import (
    BIC_APART,
    LEAST_MOVING_S,
    MOST_FINDINGS,
    MOST_OF_BOTH,
    SHOWN_ALIKE,
)
from runtime.diagnosis.steps import Step, Trail, remainder, seconds_moving, with_witnessed
from runtime.diagnosis.twist import Witnessed, witnessed
from runtime.model.terms import Term, joints_of
from runtime.progress import of_each
from runtime.regression.system import Block, Columns, LinearSystem

# comparisons ---------------------------------------------------------------------------------------------------------


def compared(trail: Trail) -> Trail:
    """The trail with all candidates ranked beside its last step."""
    base = trail.last.base
    return replace(trail, ranking=rank(base, _lacking(trail.last, base.terms()), trail.last.floors))


def _lacking(step: Step, terms: Sequence[Term]) -> list[Term]:
    """Those of some terms that do not act only where the residual is below the noise."""
    base = step.base
    return [t for t in terms if base.watched(t) or above_noise(step, own_joints(base.model, t))]


def undecided(trail: Trail, joint: int) -> Candidate | None:
    """What a recording that is not fitted would decide of a joint (0-based), the strongest; None where there is such a
    recording, or nothing that depends on one."""
    if trail.held_out is not None:
        return None
    open_ones = [c for c in trail.ranking.candidates if c.answerable and joint in own_joints(trail.model, c.term)]
    return max(open_ones, key=lambda c: c.delta_bic, default=None)


def not_borne_out(trail: Trail, joint: int) -> Candidate | None:
    """The strongest candidate of a joint (0-based) that passes every gate beside the last step and was not accepted
    once all was refitted; None where there is none."""
    able = [c for c in trail.ranking.candidates if c.passes and c.term not in trail.taken_back]
    here = [c for c in able if joint in own_joints(trail.model, c.term) and _moves_enough(trail, c.term)]
    return max(here, key=lambda c: c.delta_bic, default=None)


# forward -------------------------------------------------------------------------------------------------------------


def add_witnessed(trail: Trail) -> Trail:
    """What link-side encoders show and the torque alone does not.

    Where the torque falls with it, too, once all is refitted from there, it is fitted to the torque; else the fit stays
    as it is.
    """
    in_torque = {c.term for c in trail.ranking.candidates if c.passes}
    last = trail.last
    for one in (w for w in witnessed(last.base) if w.term not in in_torque):
        before = trail.last
        step = _fitted_to_torque(trail, one)
        if step is None:
            same = with_witnessed(before.fit, {one.term: one.values})
            step = replace(before, fit=same).after(before, one.candidate)
        trail = trail.to(step)
    return trail


def _fitted_to_torque(trail: Trail, one: Witnessed) -> Step | None:
    """A transmission that encoders show, from its values there; None if the torque does not fall with it."""
    before = trail.last
    base, values = before.base, {name: e.value for name, e in one.values.items()}
    choices = [{**c, **values} for c in base.choices(one.term)]
    if not choices or not above_noise(before, own_joints(trail.model, one.term)):
        return None
    ranking = weigh(base, [base.best_of(one.term, choices)], before.floors)
    if not ranking.candidates:
        return None
    (candidate,) = ranking.candidates
    after = trail.with_candidates(before, candidate)
    if not is_accepted(before, after, one.term):
        return None
    # What else the torque lacks would bend a transmission to anything.
    fitted = after.fit.inference.values[one.term]
    alike = all(1 / SHOWN_ALIKE < fitted[name].value / e.value < SHOWN_ALIKE for name, e in one.values.items())
    return after.after(before, candidate, ranking) if alike else None


def best_single(trail: Trail) -> Step | None:
    """The best candidate that passes every gate and is accepted once everything is refitted with it."""
    step, ranking = trail.last, trail.ranking
    able = [c for c in ranking.candidates if c.passes or (trail.held_out is not None and c.answerable)]
    able = [c for c in able if _moves_enough(trail, c.term) and c.term not in trail.taken_back]
    able.sort(key=lambda c: -c.delta_bic)
    alike = [c.term for c in ranking.candidates[:1]] + [*ranking.rivals]
    for candidate in able:
        first = candidate is ranking.candidates[0]
        for found in _refitted(trail, candidate, ranking.rivals if first else ()):
            if is_accepted(step, found, found.term) and not _rest_of_another(trail, (found.term,), found):
                # Where the first has no significant values, the data do not separate the next from it either.
                others = tuple(t for t in alike if t != found.term) if found.term in alike else ()
                return found if first else replace(found, rivals=others)
            if not any(error_falls(step, found, i) for i in own_joints(trail.model, found.term)):
                alike = [t for t in alike if t != found.term]
    return None


def _moves_enough(trail: Trail, term: Term) -> bool:
    """Whether the term's joint moves for long enough to say anything of it."""
    return seconds_moving(trail.motion, joints_of(trail.model, term)[0]) >= LEAST_MOVING_S


def _refitted(trail: Trail, candidate: Candidate, rivals: Sequence[Term]) -> list[Step]:
    """Steps that add a candidate: first one of its rivals instead, if that clearly leaves less.

    Candidates are ranked beside a base that was fitted without them; what an effect takes from others
    (a bristle from dry friction) shows only when everything is refitted. Recordings that were not fitted decide
    where they can.
    """
    step, ranked = trail.last, trail.ranking.candidates
    others = [c for c in ranked if c.term in rivals and c is not candidate][:4]  # time
    special = trail.model.library.effects[candidate.term.effect].generalises
    others += [c for c in ranked if c.passes and c.term.effect in special and c not in others]
    tried = [candidate, *others]
    terms = [c.term for c in tried]
    steps = [trail.with_candidates(step, c) for c in tried]
    best = 0
    for k, after in enumerate(steps):
        if preferred(after, steps[best], joints_of(trail.model, terms[k])[0]):
            best = k
    best = simplest(terms, steps, best)
    made = []
    for k in dict.fromkeys((best, 0)):
        lost = tuple(t for t, after in zip(terms, steps, strict=True) if _refuted(trail, t, after, by=steps[k]))
        gone = {terms[k], *less_likely_cases(step.base.system, terms, steps, k)}
        alike = tuple(t for t in (candidate.term, *rivals) if t not in gone)
        made.append(replace(steps[k].after(step, tried[k], trail.ranking, alike), refuted=lost))
    return made


def _refuted(trail: Trail, term: Term, step: Step, by: Step) -> bool:
    """Whether another step explains recordings that were not fitted clearly better than that with a term, where the
    term acts."""
    return explains_better(by, step, acting(trail.model, term))


def add_further(trail: Trail, term: Term) -> Trail:
    """More of an effect of which a joint may have several, what explains most first, as long as they are accepted."""
    while trail.model.library.effects[term.effect].several:
        step = trail.last
        base = step.base
        alike = [t for t in base.terms() if (t.effect, t.joint) == (term.effect, term.joint)]
        ranking = weigh(base, [c for t in alike for c in base.each(t)], step.floors)
        able = sorted((c for c in ranking.candidates if c.passes), key=lambda c: -c.eff)
        tried = ((c, trail.with_candidates(step, c)) for c in able)
        found = next(((c, after) for c, after in tried if is_accepted(step, after, c.term)), None)
        if found is None:
            return trail
        trail = trail.to(found[1].after(step, found[0], ranking))
    return trail


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


# pairs ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CandidatePair:
    """Two candidates and the fall of the squared error on the excerpt that both make together."""

    first: Candidate
    second: Candidate
    gain: float

    @property
    def terms(self) -> tuple[Term, Term]:
        return self.first.term, self.second.term


def best_pair(trail: Trail, single: Step | None) -> Step | None:
    """Two effects that together explain clearly more than the best one with any second beside it; not in the place of
    one whose values are significant if theirs are not."""
    step = trail.last
    if single is None and not any(c.delta_bic > BIC.limit for c in trail.ranking.candidates):
        return None
    base, taken = step.base, None if single is None else single.term
    found = [p for p in _pairs(base, trail.ranking.candidates) if not trail.taken_back & set(p.terms)]
    own = [p for p in found if taken in p.terms]
    least = own[0].gain if own else 0.0
    others = [
        p for p in found if taken not in p.terms and p.gain > MOST_OF_BOTH * max(least, _least_gain(base, step, p))
    ][:2]  # time
    if not others:
        return None
    steps = [trail.with_candidates(step, p.first, p.second) for p in others]
    plain, *scores = whitened_bic(base.system, [step if single is None else single, *steps])
    best = int(np.argmin(scores))
    if plain - scores[best] < BIC.limit:
        return None
    if own:
        beside = trail.with_candidates(step, own[0].first, own[0].second)
        alternative, *scores = whitened_bic(base.system, [beside, *steps])
        best = int(np.argmin(scores))
        if alternative - scores[best] < BIC_APART:
            return None
    if single and _nearly_does(trail, single, others[best], steps[best]):
        return None
    both = all(is_significant(steps[best], t) for t in others[best].terms)
    if single and is_significant(single, single.term) and not both:
        return None
    near = [p for p, score in zip(others, scores, strict=True) if 0 < score - scores[best] < BIC_APART]
    return _both(trail, others[best], steps[best], near)


def _nearly_does(trail: Trail, single: Step, pair: CandidatePair, together: Step) -> bool:
    """Whether one effect, over the same quantities at the same joint, explains nearly as much as a pair."""
    if not all(_alike(trail, single.term, t) for t in pair.terms):
        return False
    (kept,) = kept_alone(trail.last, (single,), together, single.joint_index)
    return kept >= MOST_OF_BOTH


def _pairs(base: FittedBase, candidates: Sequence[Candidate]) -> list[CandidatePair]:
    """The best partner for each of the best candidates, the best pair first.

    Where one effect stands for two, a search one by one starts with the wrong one: each candidate of a beam is put into
    the base, and the library is searched for the best second one beside it.
    """
    found: dict[frozenset[Term], CandidatePair] = {}
    beam = sorted((c for c in candidates if c.gain > 0), key=lambda c: -c.gain)[:6]
    for pair in of_each("pairs", lambda first: _partner(base, first), beam):
        if pair is not None:
            key = frozenset(pair.terms)
            if key not in found or pair.gain > found[key].gain:
                found[key] = pair
    return sorted(found.values(), key=lambda p: -p.gain)


def _partner(base: FittedBase, first: Candidate) -> CandidatePair | None:
    system, effects = _beside(base, first), base.model.library.effects
    own, best = first.term, None
    for term in base.terms():
        special = own.effect in effects[term.effect].generalises or term.effect in effects[own.effect].generalises
        if term.joint not in (own.joint, None) or term == own or special:
            continue
        second = base.search(term, system)
        if second is not None and (best is None or second.gain > best.gain):
            best = second
    return None if best is None else CandidatePair(first, best, first.gain + best.gain)


def _beside(base: FittedBase, first: Candidate) -> LinearSystem:
    """The excerpt's system with a candidate in its base, free to change its shape a little."""
    system = base.without(base.excerpt[1], base.replaced(first.term))
    block = base.trial(first.term, first.shape)
    theta = np.append(1.0, system.with_block(block).solution.coefficients[len(system.unknown) :])
    silent = {joint: Columns(part.rows) for joint, part in block.columns.items()}
    extended, free = system.with_block(replace(block, columns=silent)), np.full(1, np.inf)
    for name in base.moving(first.term):
        # Over so much of a step of the grid a derivative is taken: between rounding and curvature.
        step, at = 0.05 * base.grid_step(first, name), first.shape[name]
        there = at * float(np.exp(step)) if base.logarithmic(first.term) else at + step
        moved = base.trial(first.term, {**first.shape, name: there})
        if not moved.finite:
            continue
        change = {j: theta @ (moved.columns[j].rows - part.rows) for j, part in block.columns.items()}
        rows = {j: Columns(np.stack([np.zeros_like(x), x])) for j, x in change.items()}
        extended = extended.with_block(Block((first.term, name), rows, -free, free))
    return extended.merged()


def _least_gain(base: FittedBase, step: Step, pair: CandidatePair) -> float:
    """Fall of the squared error on the excerpt below which no two such effects can each be large enough to be named
    beside the other."""
    joints = [joints_of(base.model, term)[0] for term in pair.terms]
    return max(base.gain_of(i, TORQUE.limit * step.floors[i]) for i in joints)


def _both(trail: Trail, pair: CandidatePair, together: Step, near: Sequence[CandidatePair]) -> Step | None:
    """The second of the two steps that a pair makes, if each passes every gate beside the other; near: pairs that are
    about as likely."""
    step = trail.last
    alone = [trail.with_candidates(step, c) for c in (pair.first, pair.second)]
    weighed = [
        rank(beside.base, [c.term], beside.floors).best
        for c, beside in ((pair.first, alone[1]), (pair.second, alone[0]))
    ]
    passed = [(c, a) for c, a in zip(weighed, alone, strict=True) if c is not None]
    if len(passed) < 2 or not is_accepted(step, together, pair.first.term):
        return None
    # Each must be accepted beside the other.
    if not all(is_accepted(a, together, t) for a, t in zip(alone, pair.terms[::-1], strict=True)):
        return None
    one, other = pair.terms
    if _alike(trail, one, other) and max(kept_alone(step, alone, together, (one.joint or 1) - 1)) >= MOST_OF_BOTH:
        return None
    if _rest_of_another(trail, pair.terms, together):
        return None
    (first, middle), (second, _) = sorted(passed, key=lambda item: -item[0].delta_bic)
    middle = middle.after(step, first, rivals=_in_place_of(first.term, second.term, near))
    return together.after(middle, second, rivals=_in_place_of(second.term, first.term, near))


def _in_place_of(term: Term, beside: Term, near: Sequence[CandidatePair]) -> tuple[Term, ...]:
    """What could stand for a term beside the other of its pair."""
    return tuple(t for p in near if beside in p.terms for t in p.terms if t not in (beside, term))


# backward ------------------------------------------------------------------------------------------------------------


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
        if _is_superfluous(trail, finding, without) or (best is None and not _is_likelier(trail, without)):
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
    return rank(base, _lacking(step, terms), step.floors)


def _is_superfluous(trail: Trail, finding: Step, without: Step) -> bool:
    """Whether later findings do without an earlier one, or that one is only what a later one's law lacks."""
    whole, last = trail.last, trail.last.term
    if not is_accepted(without, whole, finding.term):
        return True
    if not _alike(trail, finding.term, last):
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
        gone = next((f for f in open_ones if not is_accepted(trail.without(f.term), last, f.term)), None)
        if gone is None:
            return trail
        trail = trail.rebuilt([f for f in trail.findings if f is not gone], {}, (gone.term,))


def _rest_of_another(trail: Trail, terms: Sequence[Term], both: Step) -> bool:
    """Whether an effect found before, over the same quantities at the same joint, leaves hardly anything to these:
    then they are what that one's law lacks, and no effects of their own; both: the step with all of them.

    One law that nearly does it stands before two that do as well without it.
    """
    earlier = [f for f in trail.findings if all(_alike(trail, f.term, t) for t in terms)]
    kept = (_kept_alone(trail, f.term, terms, both) for f in earlier)
    return any(own >= MOST_OF_BOTH and (len(terms) > 1 or own >= later) for own, later in kept)


def _alike(trail: Trail, one: Term, other: Term) -> bool:
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


# rivals followed to their ends ---------------------------------------------------------------------------------------


def is_open(trail: Trail) -> bool:
    """Whether more may be sought; several of one effect at a joint count once."""
    named = {(f.term.effect, f.term.joint) for f in trail.findings}
    return not trail.suspicions and len(named) < MOST_FINDINGS


def branches(trail: Trail) -> tuple[int, list[Trail]]:
    """The number of the first finding that has rivals, and trails that have one of these in its place; none where
    nothing comes after it, or is left at its joint, that would separate them.

    A rival takes something else along (a spring in gravity's place bends the load that friction reads), so that the
    sets as wholes are apart where the first effects are not.
    """
    findings = trail.findings
    number = next((k for k, f in enumerate(findings) if f.rivals), None)
    if number is None:
        return 0, []
    later = len(findings) > number + 1
    if not later and remainder(trail.last, findings[number].joint_index) is None:
        return number, []
    made = [_instead(trail, number, term) for term in findings[number].rivals[:3]]  # time
    return number, [branch for branch in made if branch is not None]


def _instead(trail: Trail, number: int, term: Term) -> Trail | None:
    """A trail that differs from this one from a finding on: it has one of its rivals in its place; None where
    that rival was not weighed, or refitted is not accepted."""
    finding = trail.findings[number]
    candidate = finding.ranking.of(term)
    if candidate is None:
        return None
    before = finding.previous
    branch = replace(trail, last=before, taken_back=frozenset())
    after = branch.with_candidates(before, candidate)
    if not is_accepted(before, after, term):
        return None
    rivals = tuple(t for t in (finding.term, *finding.rivals) if t != term)
    return branch.to(after.after(before, candidate, finding.ranking, rivals))


def best_branch(trails: Sequence[Trail], number: int) -> Trail:
    """The trail whose whole set explains most, the first unless another is clearly better; its rivals at that finding
    are the terms of those that are not clearly worse."""
    ends = [t.last for t in trails]
    scores = whitened_bic(ends[0].base.system, ends)
    best = 0
    for k in range(1, len(trails)):
        if clearly_better(ends[k], ends[best], scores[k], scores[best]):
            best = k
    chosen = trails[best]
    if len(chosen.findings) <= number:
        return chosen
    worse = [clearly_better(ends[best], end, scores[best], score) for end, score in zip(ends, scores, strict=True)]
    heads = [t.findings[number].term if len(t.findings) > number else None for t in trails]
    finding = chosen.findings[number]
    lost = {head for head, gone in zip(heads, worse, strict=True) if gone and head is not None}
    refuted_ones = {head for head in lost if ruled_out(head, ends[best], finding.joint_index)}
    rivals = tuple(t for t in finding.rivals if t not in refuted_ones and t != finding.term)
    return with_rivals(chosen, {finding: rivals})


def with_rivals(trail: Trail, rivals: dict[Step, tuple[Term, ...]]) -> Trail:
    """The trail with other rivals at some of its findings, of which none is refuted."""
    last = trail.first
    for finding in trail.findings:
        last = replace(finding, before=last)
        if finding in rivals:
            last = replace(last, rivals=rivals[finding], refuted=())
    return trail.to(last)
