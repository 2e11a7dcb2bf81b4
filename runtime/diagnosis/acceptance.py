"""Whether an effect that passes the gates is accepted, once everything is refitted with it.

The gates weigh a candidate beside a base that stays as it was. Refitted, its values may turn out insignificant, its
torque may be taken over by the rest, a recording that was not fitted may contradict it, or it may be the rest of an
effect that was found before, in another form than that one's law.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import inf, log

import numpy as np

from runtime.diagnosis.gates import BIC, ERROR
from runtime.diagnosis.settings import (
    ABOVE_NOISE,
    AS_WELL,
    AT_THE_FLOOR,
    BIC_APART,
    CLEARLY_LESS,
    FAR_ABOVE_NOISE,
    HELD_OUT_FALLS_TO,
    LEAST_EXPLAINED,
    LEAST_FALL,
    LEAST_OF_EXCESS,
    MOST_LEFT,
    OUTWEIGHED,
    PREDICTED,
    VUONG_APART,
    WIDEST_ORDER,
)
from runtime.diagnosis.steps import Errors, Step
from runtime.identification.estimate import Estimate
from runtime.identification.fit import given_shape
from runtime.identification.problem import Problem, Skew
from runtime.identification.regressors import Regressors
from runtime.model.catalogue import EffectInfo
from runtime.model.loader import Model
from runtime.model.terms import Term, Values, joints_of, structure
from runtime.regression.system import LinearSystem, bic
from symbolic.described import DescribedParameter


def is_accepted(before: Step, after: Step, term: Term) -> bool:
    """Whether the error falls, at one of the term's own joints and elsewhere, by values that are significant."""
    own = own_joints(after.fit.model, term)
    fallen = any(error_falls(before, after, i) for i in own) and not _fails_held_out(before, after, term)
    sure = is_significant(after, term) or _together(before, after, term) or _predicts_held_out(before, after, term)
    of_its_kind = _pushes_back(after, term) and _comes_back(before, after, term)
    return fallen and sure and not _at_a_bound(after, term) and of_its_kind


def own_joints(model: Model, term: Term) -> tuple[int, ...]:
    """Joints (0-based) at which a term must show: its own, or any that it reaches where it belongs to the arm."""
    return joints_of(model, term) if term.joint is None else (term.joint - 1,)


def above_noise(step: Step, joints: Sequence[int]) -> bool:
    """Whether the error is above the noise at any of these joints (0-based)."""
    return any(step.fitted.rms[i] > AT_THE_FLOOR * step.floors[i] for i in joints)


def error_falls(before: Step, after: Step, joint: int) -> bool:
    """Whether a joint's error (0-based) is above the noise, and falls by more than chance and by a part of that."""
    was, now, noise = before.fitted.rms[joint], after.fitted.rms[joint], before.joints[joint].floor.value
    above = above_noise(before, (joint,)) and was**2 - now**2 > LEAST_OF_EXCESS * (was**2 - noise**2)
    return above and now < (1 - LEAST_FALL) * was


def _fails_held_out(before: Step, after: Step, term: Term) -> bool:
    """Whether recordings that were not fitted, if there are any, are not explained clearly better where a term acts."""
    return before.held_out is not None and not helps_held_out(before, after, term)


def helps_held_out(before: Step, after: Step, term: Term) -> bool:
    """Whether recordings that were not fitted are explained clearly better where a term acts; False without any. What
    does is kept, however wide its interval, and whatever else explains the fitted recordings as well."""
    return explains_better(after, before, acting(before.fit.model, term))


def _predicts_held_out(before: Step, after: Step, term: Term) -> bool:
    """Whether recordings that were not fitted are explained so much better that a term's size must be near the truth,
    though its shape is uncertain; what was found before and significant stays so."""
    given = structure(before.fit.model)
    found = [t for t in before.values if t not in given and t in after.values and is_significant(before, t)]
    return (
        explains_better(after, before, acting(before.fit.model, term), PREDICTED)
        and all(is_significant(after, t) for t in found)
        and _has_size(after, term, given_shape(after.fit, term))
    )


def is_significant(step: Step, term: Term) -> bool:
    """Whether the interval of a term's size excludes the value at which the effect vanishes."""
    return _has_size(step, term, step.fit.inference.values[term])


def _together(before: Step, after: Step, term: Term) -> bool:
    """Whether a term whose sizes are not significant one by one is likely as a whole: where the data do not tell them
    from what the model file has (a cable's first powers over a short range are gravity's sine and cosine as well), or
    where its scales are certain, which a law of no size would leave open.
    """
    shape, values = after.fit.model.library.effects[term.effect].shape, after.fit.inference.values[term]
    sizes, given = _sizes(after, term), structure(after.fit.model)
    found = {str(t) for t in before.values if t not in given}
    untold = len(sizes) > 1 and any(values[p.name].interval is None for p in sizes)
    untold = untold and not any(other.split()[0] in found for e in values.values() for other in e.with_others)
    scales = [p for p in shape if p not in sizes and p.grid is not None and p.grid.spacing == "log"]
    formed = bool(scales) and all(_excludes(values[p.name], 0.0) for p in scales)
    if not (untold or formed):
        return False
    plain, whole = whitened_bic(before.base.system, [before, after])
    return plain - whole > BIC.limit


def _has_size(step: Step, term: Term, values: Mapping[str, Estimate]) -> bool:
    sizes = _sizes(step, term)
    return not sizes or any(_excludes(values[p.name], p.neutral) for p in sizes)


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


def _excludes(e: Estimate, neutral: float) -> bool:
    return e.interval is not None and not e.interval[0] <= neutral <= e.interval[1]


def _pushes_back(step: Step, term: Term) -> bool:
    """Whether a contact's torque is rather one over its depth than over the rate. What resists motion more than it
    pushes back is drag over a part of the range. True of a term that is no contact."""
    fit, joint = step.fit, (term.joint or 1) - 1
    info = fit.model.library.effects[term.effect]
    contact = info.of_kind("contact")
    if contact is None:
        return True
    own = fit.problem.layout.slices[term]
    columns = fit.problem.rows(joint, fit.shapes)[0][own][:, fit.motion.moving(joint)]
    torques = fit.coefficients[own, None] * columns
    at = [c.name for c in info.coefficients].index(contact.name)
    pushing, rest = torques[at], torques.sum(axis=0) - torques[at]
    return bool(pushing @ pushing > rest @ rest)


def _comes_back(before: Step, after: Step, term: Term) -> bool:
    """Whether a line over the motor's angle comes back after a turn of the motor or of the joint: the nearest whole
    order of one of them is not clearly less likely than the line's own. True of a term that is no line.

    Any other line is one over time, a law over the position, or chance. Where the interval is wide beside the distance
    of whole orders, one is near wherever the line is: it must explain as well as the line's own order does.
    """
    model = after.fit.model
    line = model.library.effects[term.effect].line
    if line is None or term.joint is None:
        return True
    order = after.fit.inference.values[term][line.name]
    if order.interval is None:
        return False
    width = order.interval[1] - order.interval[0]
    for count in {1.0, model.joints[term.joint - 1].gear_ratio}:
        whole, apart = round(order.value * count) / count, BIC_APART if width * count < WIDEST_ORDER else AS_WELL
        if whole and width * count < 1.0:
            own, other = whitened_bic(before.base.system, [after, _with_shape(after, term, {line.name: whole})])
            if other - own < apart:
                return True
    return False


def _with_shape(step: Step, term: Term, shape: Values) -> Step:
    fit = step.fit
    shapes = {**fit.shapes, term: {**fit.shapes[term], **shape}}
    solved = fit.problem.solve(shapes, Skew(fit.skew))
    return replace(step, fit=replace(fit, shapes=shapes, coefficients=solved.coefficients, residual=solved.residual))


# one effect beside another -------------------------------------------------------------------------------------------


def same_signals(one: EffectInfo, other: EffectInfo) -> bool:
    """Whether two effects of a joint act over the same quantities, so that one may be the rest of the other."""
    return bool(set(one.signals) & set(other.signals))


def kept_alone(none: Step, alone: Sequence[Step], both: Step, joint: int) -> list[float]:
    """Parts of the fall of the squared error at a joint (0-based) that remain with one of two findings alone.

    none   the step without either     alone   with the first only, with the second only     both   with both
    """
    whole = none.fitted.rms[joint] ** 2 - both.fitted.rms[joint] ** 2
    return [(none.fitted.rms[joint] ** 2 - step.fitted.rms[joint] ** 2) / max(whole, 1e-300) for step in alone]


def acting(model: Model, term: Term) -> list[Collection[int]]:
    """Groups of joints (0-based) of which one must show a term: each on which it acts, or all of the arm together."""
    return [joints_of(model, term)] if term.joint is None else [(i,) for i in joints_of(model, term)]


def explains_better(one: Step, other: Step, groups: Sequence[Collection[int]], part: float = HELD_OUT_FALLS_TO) -> bool:
    """Whether a step explains recordings that were not fitted clearly better than another: to a part of the squared
    error at one group of joints (0-based), and none of the joints worse than chance makes it.

    Joints share inertias, and those of a better structure are others: what a joint loses by that is outweighed where
    the likelihood gains many times as much at the group.
    """
    here, there = one.held_out, other.held_out
    if here is None or there is None:
        return False
    gain = max((_likelier(here, there, group) for group in groups), default=-inf)
    lost = sum(_likelier(there, here, (i,)) for i in range(len(here.rms)) if _is_worse(here, there, i))
    return gain > -log(part) and lost <= OUTWEIGHED * gain


def _likelier(here: Errors, there: Errors, group: Collection[int]) -> float:
    """By how much a row of some joints (0-based) is likelier than with other errors, in twice the log-likelihood, each
    with its own variance."""
    return log(max(there.squared(group), 1e-300)) - log(max(here.squared(group), 1e-300))


def _is_worse(here: Errors, there: Errors, joint: int) -> bool:
    """Whether a joint's error (0-based) is clearly larger than another, by more than stretches of time differ."""
    change = here.squares[joint] - there.squares[joint]
    clear = HELD_OUT_FALLS_TO * here.squared((joint,)) > there.squared((joint,))
    return clear and float(change.sum()) > VUONG_APART * float(np.std(change) * np.sqrt(len(change)))


def preferred(other: Step, best: Step, joint: int) -> bool:
    """Whether a step clearly leaves less than another at a joint (0-based): of recordings that were not fitted where
    they decide, else of those that were."""
    if explains_better(best, other, [(joint,)]):
        return False
    less = other.fitted.rms[joint] < (1 - CLEARLY_LESS) * best.fitted.rms[joint]
    return explains_better(other, best, [(joint,)]) or less


def simplest(terms: Sequence[Term], steps: Sequence[Step], best: int) -> int:
    """The best term, or the special case of it that leaves hardly more. A gap of almost no width is a spring by another
    integration, whose rounding would choose."""
    joint = (terms[best].joint or 1) - 1
    most = steps[best].fitted.rms[joint] / (1 - ERROR.limit)
    for k in _special_cases(steps[best], terms, terms[best]):
        if steps[k].fitted.rms[joint] <= most and not explains_better(steps[best], steps[k], [(joint,)]):
            return k
    return best


def less_likely_cases(system: LinearSystem, terms: Sequence[Term], steps: Sequence[Step], best: int) -> list[Term]:
    """Terms that are special cases of the best one and clearly less likely than it: steps, one a term.

    Candidates are weighed under one variance for all joints, in which what a special case leaves at one or two hardly
    counts on an arm of many, and Vuong's test is for models of which none contains the other. Refitted, every joint has
    a variance of its own, and the likelihood alone sets them apart.
    """
    special = _special_cases(steps[best], terms, terms[best])
    if not special:
        return []
    scores = whitened_bic(system, steps)
    return [terms[k] for k in special if scores[k] - scores[best] >= BIC_APART]


def _special_cases(step: Step, terms: Sequence[Term], of: Term) -> list[int]:
    generalises = step.fit.model.library.effects[of.effect].generalises
    return [k for k, t in enumerate(terms) if t.effect in generalises and t.joint == of.joint]


# whole structures ----------------------------------------------------------------------------------------------------


def whitened_bic(system: LinearSystem, steps: Sequence[Step]) -> list[float]:
    """BIC of each step, residuals whitened by the noise of the best of them; system: of any of them."""
    fits = [s.fit for s in steps]
    joints = system.joints
    weighted = [sum(float(r.weight**2 * (e @ e)) for r, e in zip(joints, f.residual, strict=True)) for f in fits]
    best = fits[int(np.argmin(weighted))].residual
    by = [r.whitening(e) for r, e in zip(joints, best, strict=True)]
    total = sum(r.independent for r in joints)
    found = []
    for f in fits:
        white = [whitened(e) for whitened, e in zip(by, f.residual, strict=True)]
        fit = sum(bic(float(e @ e), r.independent, 0) for r, e in zip(joints, white, strict=True) if r.count)
        found.append(fit + _unknowns(f.problem, f.shapes) * float(np.log(total)))
    return found


def _unknowns(problem: Problem, shapes: dict[Term, Values]) -> int:
    return problem.layout.size + sum(len(s) for s in shapes.values())


def clearly_better(one: Step, other: Step, score: float, other_score: float) -> bool:
    """Whether a step explains recordings that were not fitted clearly better than another, or where these do not
    decide, is clearly likelier; scores: of `whitened_bic`."""
    each = [(i,) for i in range(one.fit.model.n)]
    if explains_better(one, other, each):
        return True
    if explains_better(other, one, each):
        return False
    return score <= other_score - BIC_APART


def ruled_out(term: Term, best: Step, joint: int) -> bool:
    """Whether a step that is clearly more likely rules out a term at a joint (0-based).

    The blows in a gap follow from motion above the band, which a simulation does not know: an error of theirs says
    little where what stands in their place leaves far more than noise as well.
    """
    here = best.joints[joint]
    rugged = best.fit.model.library.effects[term.effect].has_gap
    return not rugged or here.rms < ABOVE_NOISE * here.floor.spectrum


def only_nearest(first: Step, last: Step, joint: int) -> bool:
    """Whether findings leave so much at a joint (0-based) that is no noise, beside what they explain, that they are no
    evidence for their laws: of any set of laws one comes nearest.

    What comes back with the motion is no noise. Where no motion is repeated, nor any recording held out, an error far
    above the noise is none.
    """
    left = last.joints[joint]
    before, after, spectrum = first.fitted.rms[joint], left.rms, left.floor.spectrum
    if left.floor.repeating is not None:
        return after > ABOVE_NOISE * spectrum and left.floor.repeating**2 > MOST_LEFT * (before**2 - after**2)
    far = after > FAR_ABOVE_NOISE * spectrum and last.held_out is None
    return far and before**2 - after**2 < LEAST_EXPLAINED * (before**2 - spectrum**2)


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
