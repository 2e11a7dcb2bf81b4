"""Whether a term that was added stays, once everything is refitted with it.

Screening weighs a candidate beside a base that stays as it was. Refitted, its torque may be taken over by the rest, a
recording that was not fitted may deny it, it may be no effect of its kind, or the rest of one that was found before.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from runtime.diagnosis import score
from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.gates import CONTACT, FALL, HELD_OUT, ONCE, REST, SCORE, SIZE, TURN, GateResult
from runtime.diagnosis.heard import Heard, heard, spread_over, steadily
from runtime.diagnosis.score import Evidence, likelihood
from runtime.diagnosis.settings import ABOVE_NOISE, ALIKE, FAR_ABOVE_NOISE, FLOOR_KNOWN, HEARD_SIGMAS
from runtime.diagnosis.steps import Step
from runtime.identification.regressors import Regressors
from runtime.model.loader import Model
from runtime.model.terms import Term, joints_of
from runtime.motion.settings import MOST
from runtime.regression.rows import JointRows
from symbolic.described import DescribedParameter

# a term with everything refitted -------------------------------------------------------------------------------------


def refitted(before: Step, after: Step, candidate: Candidate) -> Candidate:
    """A candidate with the evidence of two fits, without it and with it, and what the gates say of these."""
    term, model = candidate.term, after.fit.model
    said = None if after.held_out is None or before.held_out is None else told(after, before, term)
    rows = _rows(after)[joints_of(model, term)[0]].independent
    predicted = before.base.predicted(term, after.fit.coefficients[after.fit.problem.layout.slices[term]])
    dear = before.base.price(term, candidate.searched, candidate.among, rows, predicted)
    evidence = between(before, after, dear, said.repays if said else 0.0)
    # A fit of all rows is not the likeliest of coloured noise: what screening found beside the same base counts, too.
    if candidate.evidence.score > evidence.score:
        evidence = replace(candidate.evidence, repaid=evidence.repaid)
    kept = [r for r in candidate.results if r.gate is not SCORE and r.gate not in _REFITTED]
    results = [
        SCORE.asked(evidence.score, evidence.due),
        *kept,
        *_once(before, after, candidate, said),
        FALL.asked(max(_fall(before, after, i) for i in own_joints(model, term))),
        SIZE.asked(float(_at_a_bound(after, term))),
        *_of_its_kind(after, term),
        *_rest(before, after, term),
        *([HELD_OUT.asked(said.falls_to)] if said else []),
    ]
    return replace(candidate, evidence=evidence, predicted=predicted, results=tuple(results))


_REFITTED = (ONCE, FALL, SIZE, CONTACT, TURN, REST, HELD_OUT)


def between(without: Step, beside: Step, price: float = 0.0, repaid: float = 0.0) -> Evidence:
    """Of two fits, whitened by what the second leaves."""
    return score.between(_rows(beside), without.fit.residual, beside.fit.residual, price, repaid)


def _rows(step: Step) -> list[JointRows]:
    fit = step.fit
    return [fit.problem.joint_rows(i, fit.skew) for i in range(fit.model.n)]


def told(one: Step, other: Step, term: Term) -> Heard:
    """What recordings that were not fitted say of one step against another, where a term acts."""
    assert one.held_out is not None
    assert other.held_out is not None
    return heard(one.held_out, other.held_out, acting(one.fit.model, term))


def explains_better(one: Step, other: Step, groups: Sequence[Collection[int]]) -> bool:
    """Whether a step surely explains recordings that were not fitted better than another at a group of joints
    (0-based); False without any."""
    if one.held_out is None or other.held_out is None:
        return False
    return heard(one.held_out, other.held_out, groups).clear


def preferred(other: Step, best: Step, groups: Sequence[Collection[int]], cost: float) -> bool:
    """Whether a step is clearly better than another: recordings that were not fitted say so, or they say it less
    clearly, if there are any, and it is likelier by more than ALIKE beyond what it costs more, and surely from stretch
    to stretch."""
    if other.held_out is not None and best.held_out is not None:
        said = heard(other.held_out, best.held_out, groups)
        little = said.falls_to >= HELD_OUT.limit and said.sigmas <= HEARD_SIGMAS
        if said.clear or said.falls_to >= 1 or little:
            return said.clear
    return gained(other, best) - cost > ALIKE and steadily(other.fitted, best.fitted, groups) > HEARD_SIGMAS


def gained(other: Step, best: Step) -> float:
    """Logarithm of a step's likelihood on what was fitted over another's, each whitened by what it leaves."""
    joints = _rows(best)
    return likelihood(joints, other.fit.residual) - likelihood(joints, best.fit.residual)


def own_joints(model: Model, term: Term) -> tuple[int, ...]:
    """Joints (0-based) at which a term must show: its own, or any that it reaches where it belongs to the arm."""
    return joints_of(model, term) if term.joint is None else (term.joint - 1,)


def acting(model: Model, term: Term) -> list[Collection[int]]:
    """Groups of joints (0-based) of which one must show a term: each on which it acts, or all of the arm together."""
    return [joints_of(model, term)] if term.joint is None else [(i,) for i in joints_of(model, term)]


def above_noise(step: Step, joints: Sequence[int]) -> bool:
    """Whether the error is above the noise at any of these joints (0-based)."""
    return any(step.fitted.rms[i] > (1 - FLOOR_KNOWN) * step.floors[i] for i in joints)


def _once(before: Step, after: Step, candidate: Candidate, said: Heard | None) -> Iterator[GateResult]:
    """Over how much time a term acts, if others come near and recordings that were not fitted do not bear it out."""
    if not candidate.alone and (said is None or not said.clear):
        own = own_joints(after.fit.model, candidate.term)
        yield ONCE.asked(max(spread_over(after.fitted, before.fitted, i) for i in own))


def error_falls(before: Step, after: Step, joint: int) -> bool:
    """Whether a joint's error (0-based) is above the noise and falls."""
    return FALL.asked(_fall(before, after, joint)).passes


def _fall(before: Step, after: Step, joint: int) -> float:
    """Part by which a joint's error (0-based) falls, fitted or held out, the lesser; 0 where it is at the noise."""
    if not above_noise(before, (joint,)):
        return 0.0
    pairs = [(before.fitted, after.fitted), (before.held_out, after.held_out)]
    return min(1 - now.rms[joint] / max(was.rms[joint], 1e-300) for was, now in pairs if was and now)


# is it an effect of its kind? ----------------------------------------------------------------------------------------


def _at_a_bound(step: Step, term: Term) -> bool:
    values, sizes = step.fit.inference.values[term], _sizes(step, term)
    inertial = {lump.name for lump in step.fit.model.lumps}
    bound = any(values[p.name].value in p.bounds and values[p.name].value != p.neutral for p in sizes)
    return bound or (bool(sizes) and all(inertial & set(values[p.name].with_others) for p in sizes))


def _sizes(step: Step, term: Term) -> list[DescribedParameter]:
    """The parameters that size a term. None of a transmission: its intervals hold biases of the load whose size is not
    known, and the gates alone say whether it is there."""
    info = step.fit.model.library.effects[term.effect]
    if info.gives_way:
        return []
    contact = info.of_kind("contact")
    if contact is not None:
        return [contact]
    return [p for p in info.shape if p.kind == "stiffness"] or list(info.linear) or list(info.shape[:1])


def _of_its_kind(after: Step, term: Term) -> list[GateResult]:
    info = after.fit.model.library.effects[term.effect]
    found = []
    if info.of_kind("contact") is not None:
        found.append(CONTACT.asked(_pushing(after, term)))
    if info.line is not None and term.joint is not None:
        found.append(TURN.asked(_off_the_turn(after, term)))
    return found


def _pushing(step: Step, term: Term) -> float:
    """The part of a contact's push that the torque shows, in that direction of motion in which it is less."""
    fit, joint = step.fit, (term.joint or 1) - 1
    info, own = fit.model.library.effects[term.effect], fit.problem.layout.slices[term]
    contact, series = info.of_kind("contact"), step.joints[joint]
    assert contact is not None
    torques = fit.coefficients[own, None] * fit.problem.rows(joint, fit.shapes)[0][own][:, fit.motion.moving(joint)]
    push = torques[[c.name for c in info.coefficients].index(contact.name)]
    without = series.residual + torques.sum(axis=0)
    ways = [way for way in (series.qd > 0, series.qd < 0) if push[way].any()]
    return min((float(without[way] @ push[way]) / float(push[way] @ push[way]) for way in ways), default=0.0)


def _off_the_turn(after: Step, term: Term) -> float:
    """By how much the interval of a line's order over the motor's angle misses the nearest whole one, of a turn of the
    motor or of the joint, part of the distance of whole orders; infinite where it holds any."""
    model, line = after.fit.model, after.fit.model.library.effects[term.effect].line
    assert line is not None
    assert term.joint is not None
    order, missed = after.fit.inference.values[term][line.name], [float("inf")]
    low, high = order.interval or (-np.inf, np.inf)
    for count in (1.0, model.joints[term.joint - 1].gear_ratio):
        at, half = order.value * count, 0.5 * count * (high - low)
        if half < 0.5 and round(at):
            missed.append(max(abs(at - round(at)) - half, 0.0))
    return min(missed)


# one effect beside another -------------------------------------------------------------------------------------------


def may_be_the_rest(model: Model, one: Term, other: Term) -> bool:
    """Whether of two terms that share a joint one may be what the other's law lacks: they act over the same quantities,
    or the first's law is one form of many."""
    one_info, other_info = (model.library.effects[t.effect] for t in (one, other))
    if one.effect == other.effect or not set(joints_of(model, one)) & set(joints_of(model, other)):
        return False
    contained = one.effect in other_info.generalises or other.effect in one_info.generalises
    return not contained and (one_info.one_form or not set(one_info.signals).isdisjoint(other_info.signals))


def lost_without(none: Step, alone: Step, both: Step, joint: int) -> float:
    """Part of the fall of the squared error with two terms at a joint (0-based), from `none` to `both`, that one of
    them alone does not reach."""
    was, one, now = (step.fitted.rms[joint] ** 2 for step in (none, alone, both))
    return (one - now) / max(was - now, 1e-300)


def _rest(before: Step, after: Step, term: Term) -> list[GateResult]:
    """Whether a term is only what the law of one that was found before lacks."""
    model, parts, own = after.fit.model, [], set(joints_of(after.fit.model, term))
    for finding in before.findings:
        if finding.term != term and may_be_the_rest(model, finding.term, term):
            shared = own & set(joints_of(model, finding.term))
            parts.append(max(lost_without(finding.previous, before, after, i) for i in shared))
    return [REST.asked(min(parts))] if parts else []


def only_nearest(first: Step, last: Step, joint: int) -> bool:
    """Whether findings leave so much at a joint (0-based) that is no noise, beside what they explain, that they are no
    evidence for their laws: of any set of laws one comes nearest.

    What comes back with the motion is no noise. Where no motion is repeated, nor any recording held out, an error far
    above the noise is none.
    """
    left = last.joints[joint]
    before, after, spectrum = first.fitted.rms[joint], left.rms, left.floor.spectrum
    if left.floor.repeating is not None:
        return after > ABOVE_NOISE * spectrum and left.floor.repeating**2 > MOST * (before**2 - after**2)
    far = after > FAR_ABOVE_NOISE * spectrum and last.held_out is None
    return far and before**2 - after**2 < MOST * (before**2 - spectrum**2)


# dry friction's presliding under another name ------------------------------------------------------------------------


def bristles(finding: Step) -> tuple[Term, ...]:
    """What passes every gate as well and carries the joint's dry friction, where a finding took most of that over.

    After a reversal dry friction grows over a displacement and not at once. A law of the position that holds the same
    loop takes that friction over, and only its form separates it from bristles of the friction: that of springs and
    sliders side by side is a law of dry friction, too.
    Source: Al-Bender, Lampaert & Swevers, The generalized Maxwell-slip model, IEEE Trans. Automatic Control 50, 2005.
    """
    model = finding.fit.model
    others = [c.term for c in finding.ranking.candidates if c.passes and c.term.joint == finding.term.joint]
    carrying = tuple(t for t in others if t != finding.term and _levels(model, t))
    info = model.library.effects[finding.term.effect]
    # A loop needs a memory; a transmission's is no friction.
    if not carrying or _levels(model, finding.term) or not info.states or info.gives_way:
        return ()
    taken = all(_level(finding, t) < 0.5 * _level(finding.previous, t) for t in carrying)
    return carrying if taken else ()


def _levels(model: Model, term: Term) -> list[str]:
    read = model.library.effects[term.effect].signals
    return [name for name in read if model.library.signal[name].needs == "friction"]


def _level(step: Step, term: Term) -> float:
    """Mean magnitude of the joint's dry friction that a term reads, as a step has it."""
    found = step.fit
    joint = (term.joint or 1) - 1
    signals = Regressors(found.model, found.motion, found.prediction).signals(joint)
    names = _levels(found.model, term)
    return float(np.mean([np.mean(np.abs(s.at(name, joint))) for s in signals for name in names]))
