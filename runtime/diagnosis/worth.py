"""Whether an effect that passes the gates is worth its name, once everything is refitted with it.

The gates weigh a candidate beside a base that stays as it was. Refitted, its values may turn out not to be told by
the data, its torque may be taken over by the rest, a recording that was not fitted may contradict it, or it may be
the rest of an effect that was found before, in another form than that one's law.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import floor

from runtime.diagnosis.settings import (
    AT_THE_FLOOR,
    CLEARLY_LESS,
    CONTRADICTS,
    FORETOLD,
    HELD_OUT_FALLS_TO,
    LEAST_FALL,
    LEAST_OF_EXCESS,
    MOST_OF_BOTH,
    UNRESOLVED_ORDER,
)
from runtime.diagnosis.steps import Errors, Step
from runtime.identification.covariance import given_shape
from runtime.identification.estimate import Estimate
from runtime.identification.settings import INTERVAL_SIGMAS
from runtime.model.catalogue import EffectInfo
from runtime.model.loader import Model
from runtime.model.terms import Term, joints_of, structure
from symbolic.described import DescribedParameter


def worth_its_name(before: Step, after: Step, term: Term) -> bool:
    """Whether the error falls, at one of the term's own joints and elsewhere, by values that the data tell."""
    own = own_joints(after.identification.model, term)
    fallen = any(falls(before, after, i) for i in own) and not worse_elsewhere(before, after)
    sure = told(after, term) or foretold(before, after, term)
    return fallen and sure and not stopped(after, term) and comes_back(after, term)


def own_joints(model: Model, term: Term) -> tuple[int, ...]:
    """Joints (0-based) at which a term must show: its own, or any that it reaches where it belongs to the arm."""
    return joints_of(model, term) if term.joint is None else (term.joint - 1,)


def missing_at(step: Step, joints: Sequence[int]) -> bool:
    """Whether the error is above the noise at any of these joints (0-based)."""
    return any(step.fitted.rms[i] > AT_THE_FLOOR * step.floors[i] for i in joints)


def falls(before: Step, after: Step, joint: int) -> bool:
    """Whether a joint's error (0-based) is above the noise, and falls by more than chance and by a part of that."""
    was, now, noise = before.fitted.rms[joint], after.fitted.rms[joint], before.joints[joint].floor.value
    above = missing_at(before, (joint,)) and was**2 - now**2 > LEAST_OF_EXCESS * (was**2 - noise**2)
    return above and now < (1 - LEAST_FALL) * was


def worse_elsewhere(before: Step, after: Step) -> bool:
    """Whether recordings that were not fitted, if there are any, are not explained clearly better."""
    if before.held_out is None or after.held_out is None:
        return False
    return squared(after.held_out) >= HELD_OUT_FALLS_TO * squared(before.held_out)


def foretold(before: Step, after: Step, term: Term) -> bool:
    """Whether recordings that were not fitted are explained so much better that a term's size must be near the truth,
    though it hangs on a shape that nobody knows; what was found before and told shall stay so."""
    if before.held_out is None or after.held_out is None:
        return False
    given, fitted = structure(before.identification.model), after.identification
    found = [t for t in before.values if t not in given and t in after.values and told(before, t)]
    return (
        squared(after.held_out) < FORETOLD * squared(before.held_out)
        and all(told(after, t) for t in found)
        and _sized(after, term, given_shape(fitted.problem, fitted.fit, term))
    )


def squared(errors: Errors) -> float:
    """Sum over the joints of the relative errors' squares."""
    return sum(r * r for r in errors.relative)  # a power of what has no end would be an error


def told(step: Step, term: Term) -> bool:
    """Whether the data tell how large a term is, whatever the rest of the model is."""
    return _sized(step, term, step.identification.inference.values[term])


def _sized(step: Step, term: Term, values: Mapping[str, Estimate]) -> bool:
    """Whether one of the parameters that size a term lies away from where the effect vanishes."""
    sizes = _sizes(step, term)
    return not sizes or any(_away(values[p.name], p.neutral) for p in sizes)


def stopped(step: Step, term: Term) -> bool:
    """Whether a parameter that sizes a term stopped at the bound of what is physical, or none of them is more than an
    inertial parameter by another name."""
    values, sizes = step.identification.inference.values[term], _sizes(step, term)
    inertial = {lump.name for lump in step.identification.model.lumps}
    bound = any(_at_a_bound(values[p.name].value, p) for p in sizes)
    return bound or (bool(sizes) and all(inertial & set(values[p.name].with_others) for p in sizes))


def _sizes(step: Step, term: Term) -> list[DescribedParameter]:
    """The parameters that size a term. None of a transmission: its intervals hold biases of the load that are not
    known in size, and the gates alone say whether it is there."""
    info = step.identification.model.library.effects[term.effect]
    if info.gives_way:
        return []
    return [p for p in info.shape if p.kind == "stiffness"] or list(info.linear) or list(info.shape[:1])


def _at_a_bound(value: float, p: DescribedParameter) -> bool:
    """Whether a value stopped at the bound of what is physical, and not where the effect vanishes."""
    return value in p.bounds and value != p.neutral


def _away(e: Estimate, neutral: float) -> bool:
    if e.interval is None:
        return False
    return not e.interval[0] <= neutral <= e.interval[1]


def comes_back(step: Step, term: Term) -> bool:
    """Whether a line over the motor's angle can come back after a turn of the motor or of the joint: its order counts
    whole periods of one of them, as far as the data tell one order from the next. Any other line is one over time, or
    chance. As where values contradict each other, a whole number must lie well outside the interval to be ruled out."""
    model = step.identification.model
    line = model.library.effects[term.effect].line
    if line is None or term.joint is None:
        return True
    order, ratio = step.identification.inference.values[term][line.name], model.joints[term.joint - 1].gear_ratio
    if order.interval is None or max(1.0, ratio) * (order.interval[1] - order.interval[0]) > UNRESOLVED_ORDER:
        return True
    middle, half = (order.interval[1] + order.interval[0]) / 2, (order.interval[1] - order.interval[0]) / 2
    beyond = half * CONTRADICTS / INTERVAL_SIGMAS
    return any(floor((middle + beyond) * n) >= (middle - beyond) * n for n in (1.0, ratio))


def same_signals(one: EffectInfo, other: EffectInfo) -> bool:
    """Whether two effects of a joint act over the same quantities, so that one may be the rest of the other."""
    return bool(set(one.signals) & set(other.signals))


def needless(none: Step, alone: Sequence[Step], both: Step, joint: int) -> int | None:
    """Which of two effects (0, 1) the other one nearly makes superfluous; None if each is worth having.

    none   the step without either     alone   with the first only, with the second only     both   with both
    """
    whole = none.fitted.rms[joint] ** 2 - both.fitted.rms[joint] ** 2
    kept = [(none.fitted.rms[joint] ** 2 - step.fitted.rms[joint] ** 2) / max(whole, 1e-300) for step in alone]
    if max(kept) < MOST_OF_BOTH:
        return None
    return 1 if kept[0] >= kept[1] else 0


def preferred(other: Step, best: Step, joint: int) -> bool:
    """Whether a step clearly leaves less than another: of recordings that were not fitted where they tell, else at
    a joint (0-based) of those that were."""
    if refuted(other, best):
        return False
    return refuted(best, other) or other.fitted.rms[joint] < (1 - CLEARLY_LESS) * best.fitted.rms[joint]


def refuted(step: Step, best: Step) -> bool:
    """Whether another step explains recordings that were not fitted clearly better."""
    if step.held_out is None or best.held_out is None:
        return False
    return squared(best.held_out) < HELD_OUT_FALLS_TO * squared(step.held_out)
