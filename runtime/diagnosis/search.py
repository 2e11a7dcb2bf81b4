"""The search over sets of terms: add, drop, swap. Screening proposes, a fit of all rows decides.

Of every joint the best candidates are refitted, each alone; the best of them are added one after another. What was
found before is then asked again. A set that was left for a better one is not made a second time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from runtime.diagnosis.acceptance import (
    above_noise,
    acting,
    explains_better,
    gained,
    lost_without,
    may_be_the_rest,
    own_joints,
    preferred,
    refitted,
)
from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.gates import FALL, HELD_OUT, ONCE, REST, SCORE
from runtime.diagnosis.ranking import Ranking, rank, weigh
from runtime.diagnosis.refits import (
    Refitted,
    best_of,
    clearly_worse,
    of_either,
    place_of,
    refit,
    share_a_joint,
    simplest,
    unknowns,
    weighed_anew,
)
from runtime.diagnosis.settings import (
    ALIKE,
    FINALISTS_OF_A_JOINT,
    HEARD_SIGMAS,
    LEAST_MOVING_S,
    LEAST_PRICE,
    MOST_FINDINGS,
    MOST_PAIRED,
    SHOWN_ALIKE,
)
from runtime.diagnosis.steps import CutShort, Step, Trail, seconds_moving, with_witnessed
from runtime.diagnosis.twist import Witnessed, witnessed
from runtime.model.terms import Term, joints_of
from runtime.motion.settings import MOST

# comparisons ---------------------------------------------------------------------------------------------------------


def compared(trail: Trail) -> Trail:
    """The trail with all candidates ranked beside its last step."""
    sought = trail.sought
    terms = [t for t in trail.last.base.terms() if sought is None or sought.intersection(joints_of(trail.model, t))]
    ranking = _ranked(trail.last, terms)
    known = (trail.refused.get(trail.company(c.term)) for c in ranking.candidates if c.passes)
    return replace(trail, ranking=ranking.with_refitted([c for c in known if c is not None]))


def _ranked(step: Step, terms: Iterable[Term]) -> Ranking:
    """Those of some terms that do not act only where the residual is below the noise."""
    base = step.base
    able = [t for t in terms if base.watched(t) or above_noise(step, own_joints(base.model, t))]
    return rank(base, able, step.floors)


def undecided(trail: Trail, joint: int) -> Candidate | None:
    """What a recording that is not fitted would decide of a joint (0-based), where there is none: the likeliest."""
    if trail.held_out is not None:
        return None
    open_ones = [c for c in trail.ranking.candidates if joint in own_joints(trail.model, c.term) and _repayable(c)]
    return max(open_ones, key=lambda c: c.evidence.score, default=None)


def _repayable(candidate: Candidate) -> bool:
    """Whether only that stands against a candidate which recordings that were not fitted answer."""
    missed = {r.gate.name for r in candidate.failed}
    near = candidate.evidence.score > replace(candidate.evidence, repaid=0.5 * HEARD_SIGMAS**2).due
    return bool(missed) and missed <= {SCORE.name, ONCE.name} and near


def not_borne_out(trail: Trail, joint: int) -> Candidate | None:
    """The likeliest candidate of a joint (0-based) that passed beside the last step and did not once all was refitted;
    None where a recording that is not fitted has decided."""
    if trail.held_out is not None:
        return None
    asked = [c for c in trail.ranking.candidates if any(r.gate is FALL for r in c.results) and not c.passes]
    here = [c for c in asked if joint in own_joints(trail.model, c.term)]
    return max(here, key=lambda c: c.evidence.gain, default=None)


def is_open(trail: Trail) -> bool:
    """Whether more may be sought; several of one effect at a joint count once."""
    named = {(f.term.effect, f.term.joint) for f in trail.findings}
    return not trail.suspicions and len(named) < MOST_FINDINGS * trail.model.n


# add -----------------------------------------------------------------------------------------------------------------


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
    made = refit(trail, ranking.candidates[0])
    if any(r.gate in (SCORE, FALL) for r in made.candidate.failed):
        return None
    # What else the torque lacks would bend a transmission to anything.
    fitted = made.step.fit.inference.values[one.term]
    alike = all(1 / SHOWN_ALIKE < fitted[name].value / e.value < SHOWN_ALIKE for name, e in one.values.items())
    return made.step.after(before, made.candidate, ranking) if alike else None


def lengthened(trail: Trail) -> Trail:
    """The trail with the best candidate of every joint at which one holds once all is refitted, the likeliest first."""
    winners: list[tuple[Refitted, tuple[Term, ...]]] = []
    asked: list[Candidate] = []
    try:
        for place in dict.fromkeys(place_of(trail, c.term) for c in trail.ranking.candidates):
            winners += _winner(trail, place, asked)
    except CutShort:
        pass  # what was found before is named
    # What recordings that were not fitted deny hangs on all joints.
    final = [c for c in asked if not c.passes and not any(r.gate is HELD_OUT for r in c.failed)]
    refused = {**trail.refused, **{trail.company(c.term): c for c in final}}
    trail = replace(trail, ranking=trail.ranking.with_refitted(asked), refused=refused)
    winners.sort(key=lambda item: -item[0].candidate.evidence.net)
    return _chained(trail, winners)


def _chained(trail: Trail, winners: Sequence[tuple[Refitted, tuple[Term, ...]]]) -> Trail:
    """The trail with the winners of all places; one that does as well in the place of one before is its rival."""
    ranking, added = trail.ranking, list[Refitted]()
    for best, rivals in winners:
        last = trail.last
        try:
            made = best if not added else refit(trail, best.candidate, stale=True)
        except CutShort:
            break
        if made.candidate.passes:
            trail = trail.to(made.step.after(last, made.candidate, ranking, rivals))
            added.append(best)
            continue
        for other in added:
            if share_a_joint(trail, other.term, best.term) and not clearly_worse(trail, best, other):
                known = next(f.rivals for f in trail.findings if f.term == other.term)
                trail = with_rivals(trail, {other.term: (*known, best.term)})
    return trail


def _winner(trail: Trail, place: int | None, asked: list[Candidate]) -> list[tuple[Refitted, tuple[Term, ...]]]:
    """The best candidate of a place that holds, with its rivals; asked: gets those that were refitted."""
    for batch in _batches(_able(trail, place)):
        those = _apart([refit(trail, c) for c in batch])
        asked += [one.candidate for one in those]
        found = best_of(trail, those)
        if found is not None:
            return [found]
    return []


def _apart(those: list[Refitted]) -> list[Refitted]:
    """Some refits of one place; the likeliest is alone if no other comes near it."""
    first, *rest = sorted(those, key=lambda one: -one.candidate.evidence.gain)
    if any(one.candidate.evidence.gain > MOST * first.candidate.evidence.gain for one in rest):
        return those
    asked = tuple(r for r in first.candidate.results if r.gate is not ONCE)
    return [replace(first, candidate=replace(first.candidate, alone=True, results=asked)), *rest]


def _able(trail: Trail, place: int | None) -> list[Candidate]:
    """Candidates of a place that pass, or may once recordings that are not fitted are heard, the likeliest first."""
    heard = trail.held_out is not None
    here = [c for c in trail.ranking.candidates if place_of(trail, c.term) == place and not trail.left_before(c.term)]
    able = [c for c in here if c.passes or (heard and _hopeful(c) and trail.company(c.term) not in trail.refused)]
    able = [c for c in able if seconds_moving(trail.motion, joints_of(trail.model, c.term)[0]) >= LEAST_MOVING_S]
    return sorted(able, key=lambda c: -c.evidence.gain)


def _batches(able: list[Candidate]) -> Iterator[list[Candidate]]:
    """The likeliest candidates and what gains nearly as much; then, where none of them holds, the next."""
    while able:
        batch = [c for c in able[:FINALISTS_OF_A_JOINT] if c.evidence.gain > MOST * able[0].evidence.gain]
        yield batch
        able = [c for c in able if c not in batch]


def _hopeful(candidate: Candidate) -> bool:
    """Whether only the score stands against a candidate, which its refit may raise or other recordings repay."""
    return [r.gate for r in candidate.failed] == [SCORE] and candidate.evidence.score > 0.5 * HEARD_SIGMAS**2


def add_further(trail: Trail, term: Term) -> Trail:
    """More of an effect of which a joint may have several, what explains most first, as long as they hold."""
    while trail.model.library.effects[term.effect].several:
        step = trail.last
        base = step.base
        alike = [t for t in base.terms() if (t.effect, t.joint) == (term.effect, term.joint)]
        ranking = weigh(base, [c for t in alike for c in base.each(t)], step.floors)
        able = sorted((c for c in ranking.candidates if c.passes), key=lambda c: -c.eff)
        made = (refit(trail, c) for c in able)
        found = next((one for one in made if one.candidate.passes), None)
        if found is None:
            return trail
        trail = trail.to(found.step.after(step, found.candidate, ranking))
    return trail


# drop, swap ----------------------------------------------------------------------------------------------------------


def mended(trail: Trail, fresh: Sequence[Term]) -> Trail:
    """The trail without findings that those added last have made superfluous, or with a likelier one in their place."""
    trail = without_replaced(trail)
    for finding in trail.findings:
        own = finding.term
        # Several of one effect are there because each has what the others have not.
        others = [t for t in fresh if t in trail.last.values and (t.effect, t.joint) != (own.effect, own.joint)]
        later = [t for t in others if share_a_joint(trail, own, t)]
        if later and finding.candidate.twist is None and own in {f.term for f in trail.findings}:
            trail = _asked_again(trail, finding, later)
    return trail


def _asked_again(trail: Trail, finding: Step, later: Sequence[Term]) -> Trail:
    """The trail with a finding dropped, swapped, or as it is; later: terms added since that share a joint."""
    without = trail.without(finding.term)
    superfluous = not _holds(without, trail.last, finding)
    if any(may_be_the_rest(trail.model, t, finding.term) for t in later):
        # One law that does it nearly alone stands before two.
        lost = lost_without(finding.previous, without, trail.last, finding.joint_index)
        superfluous |= not REST.asked(lost).passes
    if superfluous:
        # Of the two the later one is superfluous where it does not hold without the other.
        weak = [f for f in trail.findings if f.term in later and not _holds(finding.previous, without, f)]
        dropped = weak[0].term if weak else _least_missed(trail, finding, without)
        return trail.rebuilt([f for f in trail.findings if f.term != dropped], {}, (dropped,))
    ranking = _in_the_place(trail, finding, without)
    able = [c for c in ranking.candidates if c.passes and not trail.left_before(c.term, finding.term)]
    near = [c for c in able if c.evidence.net > able[0].evidence.net - ALIKE]
    best = simplest(trail, near) if near else finding.candidate
    if best.term == finding.term:
        return trail
    return _instead(trail, finding, best, _in_its_place(trail, finding, best), ranking) or trail


def _least_missed(trail: Trail, finding: Step, without: Step) -> Term:
    """Of a superfluous finding and those of its joints that are superfluous as well, that without which the rest is
    likeliest."""
    left = {finding.term: without}
    for other in (f for f in trail.findings if f.term != finding.term and share_a_joint(trail, f.term, finding.term)):
        rest = trail.without(other.term)
        if not _holds(rest, trail.last, other):
            left[other.term] = rest
    return max(left, key=lambda term: gained(left[term], trail.last))


def _holds(before: Step, after: Step, finding: Step) -> bool:
    """Whether a finding passes every gate between two steps, the second with it."""
    own = weighed_anew(before, finding.candidate)
    return refitted(before, after, replace(own, alone=finding.candidate.alone)).passes


def _in_the_place(trail: Trail, finding: Step, without: Step) -> Ranking:
    """Candidates of a finding's own comparison that could stand for it beside the step without it. What acts on none of
    its joints explains something else, and what contains another finding would take that one's place as well."""
    own = set(joints_of(trail.model, finding.term))
    others = {(f.term.effect, f.term.joint) for f in trail.findings if f.term != finding.term}
    effects = trail.model.library.effects
    terms = [
        t
        for t in without.base.terms()
        if finding.ranking.of(t)
        and own & set(joints_of(trail.model, t))
        and not any((g, t.joint) in others for g in effects[t.effect].generalises)
    ]
    return _ranked(without, terms)


def _in_its_place(trail: Trail, finding: Step, other: Candidate) -> Step:
    """The last step with another candidate in a finding's place, refitted."""
    kept = [(t, v) for t, v in trail.added() if t != finding.term]
    return trail.refitted(trail.structure([*kept, (other.term, other.shape)]), trail.last)


def _instead(trail: Trail, finding: Step, other: Candidate, there: Step, ranking: Ranking) -> Trail | None:
    """The trail with another candidate in a finding's place if that, refitted as `there`, is clearly better, or simpler
    and not clearly worse, which makes the two rivals."""
    own, groups = finding.term, of_either(trail, other.term, finding.term)
    dearer = other.evidence.price - finding.candidate.evidence.price
    better = preferred(there, trail.last, groups, dearer)
    simpler = unknowns(trail, other) < unknowns(trail, finding.candidate)
    worse = preferred(trail.last, there, groups, -dearer)
    if not better and not (simpler and not worse):
        return None
    rivals = () if better else (own,)
    findings = [
        f if f.term != own else replace(f, chosen=other, ranking=ranking, rivals=rivals) for f in trail.findings
    ]
    return trail.rebuilt(findings, {other.term: other.shape}, (own,))


def without_replaced(trail: Trail) -> Trail:
    """The trail without findings that the last one generalises: they were special cases of it, and its evidence is then
    counted from where the first of them began."""
    kept = [f for f in trail.findings if f.term in trail.last.values]
    if len(kept) == len(trail.findings):
        return trail
    trail = trail.rebuilt(kept, {}, [f.term for f in trail.findings if f not in kept])
    last = trail.last
    own = weighed_anew(last.previous, last.candidate)
    return trail.to(replace(last, chosen=refitted(last.previous, last, own)))


# a runner-up with a second of its own --------------------------------------------------------------------------------


def paired(trail: Trail) -> Trail:
    """The trail with a finding's runner-up and the best candidate beside that, where one effect stood for two."""
    seconds = {place_of(trail, c.term): c for c in reversed(trail.ranking.candidates) if c.passes}
    for place, second in seconds.items():
        here = [f for f in trail.findings if place_of(trail, f.term) == place and f.candidate.twist is None]
        found = _pair_instead(trail, here[-1], second) if here and place is not None else None
        if found is not None:
            return found
    return trail


def _pair_instead(trail: Trail, finding: Step, second: Candidate) -> Trail | None:
    kept, own, rest = [(t, v) for t, v in trail.added() if t != finding.term], trail.last, [finding.candidate]
    for k, first in enumerate(_runners_up(trail, finding)):
        if k == 0 and (made := refit(trail, second)).candidate.passes:
            own, rest = made.step, [finding.candidate, second]
        one = trail.refitted(trail.structure([*kept, (first.term, first.shape)]), trail.last)
        here = place_of(trail, first.term)
        beside = [t for t in one.base.terms() if t != finding.term and place_of(trail, t) == here]
        other = _ranked(one, beside).best
        if other is None:
            continue
        alone = trail.refitted(trail.structure([*kept, (other.term, other.shape)]), one)
        # Its shape was that of one which stands for both.
        again = _ranked(alone, [first.term]).best
        if again is None or gained(alone, own) + again.evidence.gain < 0:
            continue
        both = [(other.term, alone.shapes[other.term]), (again.term, again.shape)]
        pair = trail.refitted(trail.structure([*kept, *both]), alone)
        cost = again.evidence.price + other.evidence.price - sum(c.evidence.price for c in rest)
        each = refitted(alone, pair, again), refitted(one, pair, other)
        if may_be_the_rest(trail.model, first.term, other.term) or may_be_the_rest(trail.model, other.term, first.term):
            lost = [lost_without(finding.previous, x, pair, finding.joint_index) for x in (alone, one)]
            if not REST.asked(min(lost)).passes:
                continue
        if all(c.passes for c in each) and preferred(pair, own, acting(trail.model, first.term), cost):
            trail = trail.rebuilt([f for f in trail.findings if f is not finding], {}, (finding.term,))
            for candidate in each:
                made = refit(trail, candidate, stale=True)
                trail = trail.to(made.step.after(trail.last, made.candidate, finding.ranking))
            return trail
    return None


def _runners_up(trail: Trail, finding: Step) -> list[Candidate]:
    """Candidates that nearly were the finding, neither of them a case of the other."""
    effects, own = trail.model.library.effects, finding.term
    named = {f.term for f in trail.findings}
    return [
        c
        for c in sorted(finding.ranking.candidates, key=lambda c: -c.evidence.gain)
        if place_of(trail, c.term) == place_of(trail, own)
        and c.term not in named
        and not trail.left_before(c.term, own)
        and c.evidence.score > LEAST_PRICE
        and own.effect not in effects[c.term.effect].generalises
        and c.term.effect not in effects[own.effect].generalises
    ][:MOST_PAIRED]


# rivals --------------------------------------------------------------------------------------------------------------


def with_rivals_decided(trail: Trail) -> Trail:
    """The trail with its findings' rivals in their places, all else refitted: one that is clearly better is swapped in,
    those that are clearly worse are none.

    A rival bends others (a spring in gravity's place the load that friction reads): sets part where effects do not.
    """
    for finding in [f for f in trail.findings if f.rivals and len(trail.findings) > 1]:
        alike = []
        for term in finding.rivals:
            candidate = finding.ranking.of(term)
            if candidate is None:
                alike.append(term)
                continue
            there = _in_its_place(trail, finding, candidate)
            swapped = _instead(trail, finding, candidate, there, finding.ranking)
            if swapped is not None:
                return swapped
            cost = finding.candidate.evidence.price - candidate.evidence.price
            if not preferred(trail.last, there, of_either(trail, term, finding.term), cost):
                alike.append(term)
        trail = with_rivals(trail, {finding.term: tuple(alike)})
    return trail


def with_rivals(trail: Trail, rivals: dict[Term, tuple[Term, ...]]) -> Trail:
    """The trail with other rivals of some of its findings."""
    last = trail.first
    for finding in trail.findings:
        last = replace(finding, before=last, rivals=rivals.get(finding.term, finding.rivals))
    return trail.to(last)


def no_worse(trail: Trail, shown: Sequence[Step]) -> Trail:
    """The trail, or one that ends at a step which explains recordings that were not fitted clearly better."""
    each = [(i,) for i in range(trail.model.n)]
    better = [s for s in (*trail.steps, *shown) if explains_better(s, trail.last, each)]
    return trail.to(better[-1]) if better else trail
