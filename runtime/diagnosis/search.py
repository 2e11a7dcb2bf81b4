"""Forward: a trail lengthened by the best candidate, or by a pair where one effect stood for two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from runtime.diagnosis.acceptance import (
    above_noise,
    acting,
    error_falls,
    explains_better,
    is_accepted,
    is_significant,
    kept_alone,
    less_likely_cases,
    own_joints,
    preferred,
    simplest,
    whitened_bic,
)
from runtime.diagnosis.candidates import Candidate, FittedBase
from runtime.diagnosis.gates import BIC, TORQUE
from runtime.diagnosis.pruning import lacking, may_be_the_rest, rest_of_another
from runtime.diagnosis.ranking import rank, weigh
from runtime.diagnosis.settings import (
    BIC_APART,
    LEAST_MOVING_S,
    MOST_OF_BOTH,
    SHOWN_ALIKE,
)
from runtime.diagnosis.steps import Step, Trail, seconds_moving, with_witnessed
from runtime.diagnosis.twist import Witnessed, witnessed
from runtime.model.terms import Term, joints_of
from runtime.progress import of_each
from runtime.regression.rows import Block, Columns
from runtime.regression.system import LinearSystem

# comparisons ---------------------------------------------------------------------------------------------------------


def compared(trail: Trail) -> Trail:
    """The trail with all candidates ranked beside its last step."""
    base, sought = trail.last.base, trail.sought
    terms = [t for t in base.terms() if sought is None or sought.intersection(joints_of(trail.model, t))]
    return replace(trail, ranking=rank(base, lacking(trail.last, terms), trail.last.floors))


def undecided(trail: Trail, joint: int) -> Candidate | None:
    """What a recording that is not fitted would decide of a joint (0-based), the strongest; None where there is such a
    recording, or nothing that depends on one."""
    if trail.held_out is not None:
        return None
    open_ones = [c for c in trail.ranking.candidates if c.answerable and joint in own_joints(trail.model, c.term)]
    return max(open_ones, key=lambda c: c.delta_bic, default=None)


def not_borne_out(trail: Trail, joint: int) -> Candidate | None:
    """The strongest candidate of a joint (0-based) that passes every gate beside the last step and was not accepted
    once all was refitted; None where there is none, or a recording that is not fitted has decided."""
    if trail.held_out is not None:
        return None
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
            if is_accepted(step, found, found.term) and not rest_of_another(trail, (found.term,), found):
                # Where the first has no significant values, the data do not separate the next from it either.
                others = tuple(t for t in alike if t != found.term) if found.term in alike else ()
                return found if first else replace(found, rivals=others)
            if not any(error_falls(step, found, i) for i in own_joints(trail.model, found.term)):
                alike = [t for t in alike if t != found.term]
    return None


def _moves_enough(trail: Trail, term: Term) -> bool:
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
    if not all(may_be_the_rest(trail, single.term, t) for t in pair.terms):
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
    if (
        may_be_the_rest(trail, one, other)
        and max(kept_alone(step, alone, together, (one.joint or 1) - 1)) >= MOST_OF_BOTH
    ):
        return None
    if rest_of_another(trail, pair.terms, together):
        return None
    (first, middle), (second, _) = sorted(passed, key=lambda item: -item[0].delta_bic)
    middle = middle.after(step, first, rivals=_in_place_of(first.term, second.term, near))
    return together.after(middle, second, rivals=_in_place_of(second.term, first.term, near))


def _in_place_of(term: Term, beside: Term, near: Sequence[CandidatePair]) -> tuple[Term, ...]:
    return tuple(t for p in near if beside in p.terms for t in p.terms if t not in (beside, term))
