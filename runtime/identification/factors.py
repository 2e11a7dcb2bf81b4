"""Factors between what a fit finds and what the model file states that mistakes with units and gears explain: a missing
gear ratio, mA or mN m, a current read as a torque, and gravity that was taken out of a torque.

No error of a fit shows these: an inertia and a friction that are all too small by one factor fit as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, log, prod
from typing import Literal

import numpy as np

from runtime.arrays import Array
from runtime.identification.fit import Fit
from runtime.identification.problem import Problem
from runtime.identification.readings import DEGREE, DEGREES, MOTOR, Reading, Trials, moving_joints, turns
from runtime.identification.settings import (
    BEYOND_LIMIT,
    EXCERPT,
    LITTLE_FRICTION,
    SUSPECTED_RATIO,
    USUAL_CONSTANTS,
    USUAL_RATIOS,
)
from runtime.identification.stated_parts import (
    StatedPart,
    of_all_stated,
    of_stated_gravity,
    stated_lumps,
    stated_part,
    without_weight,
)
from runtime.model.terms import Term, Values
from runtime.motion.settings import LITTLE, MOST, SOME
from runtime.recordings.columns import UNITS, normal_unit
from symbolic.model_file.arm import LINK_TORQUE
from symbolic.model_file.checks import SMALLEST

RATIO, MILLI, CURRENT = "ratio", "milli", "current"
"""What a torque is: the motor's before the gear, in thousandths of its unit, or a current that was read as a torque."""
TWICE, WHOLE = "twice", "whole"
"""What else it is: multiplied by the gear ratio once more than it should be, or a thousand times of what was read."""
Compared = Literal["inertia", "stated values", "rotor", "limit"]


@dataclass(frozen=True)
class Factor:
    """Mistakes that together explain what a fit finds at a joint beside what the model file states.

    kinds           any of DEGREES, MOTOR, MILLI, CURRENT, RATIO, TWICE and WHOLE
    fitted, stated  kg m² (kg) of inertias, N m (N) of others
    alternatives    what explains it as well in place of the first of them
    of              the joint's inertia; the torque (RMS) of all stated values, or of its rotor; its largest torque
    """

    kinds: tuple[str, ...]
    fitted: float
    stated: float
    alternatives: tuple[str, ...] = ()
    of: Compared = "inertia"


@dataclass(frozen=True)
class Weightless:
    """Recorded torques without the weight of the arm's masses, or with it although they are declared to lack it.

    joint     (0-based) where most is missing      alone   whether no other joint tells it
    weight    of the stated masses, N m (N), RMS; None where the file leaves masses open
    declared  whether the torques are declared to lack it
    """

    joint: int
    weight: float | None
    alone: bool
    declared: bool = False


def factors(fit: Fit, reading: Reading, lumps: Array, least: float) -> dict[int, Factor]:
    """Joints (0-based) at which a factor that mistakes explain lies between the fit and the model file.

    lumps   base inertial parameters under the reading      least   smallest such factor
    """
    model = fit.model
    if fit.motion.rigid_given:
        return {}
    if not model.lumps_known:
        return _of_torques(fit, reading)
    rest, result = np.zeros((model.n, 1)), {}
    fitted, stated = (np.diagonal(model.inertia(rest, x)[:, :, 0]) for x in (lumps, model.lump_values))
    for i in moving_joints(fit):
        if isfinite(stated[i]) and fitted[i] > 0 and stated[i] > 0:
            kinds, others = _explained(float(stated[i] / fitted[i]), _sizes(fit, i, reading), least)
            if kinds:
                result[i] = Factor(kinds, float(fitted[i]), float(stated[i]), others)
    return result


def weightless_torque(fit: Fit) -> Weightless | None:
    """Gravity that the recorded torques lack or have, against what is declared; None where they are as declared."""
    model, moving = fit.model, moving_joints(fit)
    if not moving or not any(model.gravity):
        return None
    motion, _ = fit.motion.excerpt(EXCERPT)
    problem = Problem(model, motion, fit.problem.layout.terms, fit.problem.regressors.prediction)
    torques = [motion.torque(i, fit.skew) for i in range(motion.n)]
    parts = of_stated_gravity(problem, fit.shapes, torques)
    heavy = {i: part for i, part in parts.items() if i in moving and part.weighs}
    declared = without_weight(motion)
    if heavy and all(part.present if declared else part.absent for part in heavy.values()):
        most = max(heavy, key=lambda i: heavy[i].stated)
        return Weightless(most, heavy[most].stated, alone=len(heavy) == 1, declared=declared)
    return None if heavy or declared else _better_without_weight(problem, fit.shapes, torques, moving)


def _better_without_weight(
    problem: Problem, shapes: Mapping[Term, Values], torques: Sequence[Array], joints: Sequence[int]
) -> Weightless | None:
    """The same where the file leaves the masses open: what moves has mass, and mass has a weight."""
    motion, weighing = problem.motion, []
    with_weight, without, right = [], [], []
    for i in joints:
        use = motion.moving(i)
        columns, fixed = problem.rows(i, shapes)
        weights = np.zeros_like(columns)
        weights[problem.layout.lumps] = problem.regressors.weights(i)
        weighing += [i] * bool(weights.any())
        scale = 1 / max(float(np.linalg.norm(torques[i][use])), SMALLEST)
        with_weight.append(scale * columns[:, use])
        without.append(scale * (columns - weights)[:, use])
        right.append(scale * (torques[i] - fixed)[use])
    before, after = (_left(rows, right) for rows in (with_weight, without))
    heavy = [joints.index(i) for i in weighing]
    if len(heavy) < 2 or np.linalg.norm(after) > MOST * np.linalg.norm(before):
        return None
    if after[heavy].max() > SOME:
        return None
    most = max(heavy, key=lambda k: before[k])
    return Weightless(joints[most], None, alone=False)


def _left(rows: Sequence[Array], right: Sequence[Array]) -> Array:
    """(n,) what a common least-squares fit leaves of each joint's right-hand side (M,); rows (K, M)."""
    columns = np.concatenate(rows, axis=1).T
    scale = np.maximum(np.linalg.norm(columns, axis=0), SMALLEST)
    found = np.linalg.lstsq(columns / scale, np.concatenate(right), rcond=None)[0] / scale
    return np.array([float(np.linalg.norm(y - found @ x)) for x, y in zip(rows, right, strict=True)])


def rotorless_torques(fit: Fit) -> tuple[int, ...]:
    """Joints (0-based) whose recorded torque has neither the stated rotor's inertia nor friction, where it is so at all
    that tell; empty where one of them has."""
    if fit.motion.rigid_given or any(p.torque == LINK_TORQUE for p in fit.motion.pieces):
        return ()
    trials, given, found, links = Trials(fit), Reading.given(fit.model.n), [], []
    known, values = stated_lumps(fit.model)
    for i in trials.able:
        rotor, (columns, acceleration, torque) = fit.model.joints[i].rotor_inertia, trials.equation(given, i)
        if not rotor:
            continue
        lumps, own = columns[: len(known)], rotor * acceleration
        rest, others = values @ lumps - own, np.vstack([lumps[~known], columns[len(known) :]])
        part, link = (stated_part(x, np.vstack([y, others]), torque) for x, y in ((own, rest), (rest, own)))
        links += [link] if link.weighs else []
        if part.weighs:
            if part.present or part.spread > SOME or _friction(fit, columns, i) > LITTLE_FRICTION * part.recorded:
                return ()
            found.append(i)
    # A torque in another unit has little of the rotors, too, but of the links as well.
    return tuple(found) if links and all(link.present for link in links) else ()


def _friction(fit: Fit, columns: Array, joint: int) -> float:
    """RMS of the fitted friction of a joint (0-based), in the rows of these columns (K, M)."""
    layout, library = fit.problem.layout, fit.model.library
    rubbing = [layout.slices[t] for t in layout.terms if t.joint == joint + 1 and library.effects[t.effect].rubs]
    return float(np.linalg.norm(sum((fit.coefficients[s] @ columns[s] for s in rubbing), start=np.zeros(1))))


# --- inertias, where the model file states all ---

_INSTEAD = (DEGREES, MOTOR, RATIO)
"""What alike makes an inertia too small, the likeliest first."""
_TOGETHER = (
    *((DEGREES,), (MOTOR,), (MILLI,), (RATIO,), (CURRENT,), (CURRENT, MILLI)),
    *((DEGREES, RATIO), (MOTOR, RATIO), (DEGREES, MILLI), (DEGREES, CURRENT), (MOTOR, CURRENT)),
    *((DEGREES, CURRENT, MILLI), (MOTOR, CURRENT, MILLI), (MILLI, RATIO), (DEGREES, MOTOR, RATIO)),
    *((TWICE,), (WHOLE,)),
)
"""Mistakes that are made alone or together, the likeliest first."""


def _sizes(fit: Fit, joint: int, reading: Reading) -> dict[str, float]:
    """By what each mistake that is possible at a joint (0-based) divides its inertia."""
    info, motion = fit.model.joints[joint], fit.motion
    thousandth = UNITS["mA"][1]
    sizes = {WHOLE: 1 / thousandth}
    if not _in_thousandths(fit, reading.torques[joint]):
        sizes[MILLI] = thousandth
    if info.gear_ratio > SUSPECTED_RATIO:
        sizes |= {RATIO: info.gear_ratio, TWICE: 1 / info.gear_ratio}
    if info.torque_constant is not None and f"tau{reading.torques[joint] + 1}" not in motion.units:
        sizes[CURRENT] = info.torque_constant
    if turns(motion, reading.positions[joint]) > 1 and info.type == "revolute":
        stated = normal_unit(motion.units.get(f"q{reading.positions[joint] + 1}", ""))
        if reading.units[joint] != DEGREES and stated != "deg":
            sizes[DEGREES] = 1 / DEGREE
        if reading.units[joint] != MOTOR and RATIO in sizes:
            sizes[MOTOR] = info.gear_ratio
    return sizes


def _in_thousandths(fit: Fit, joint: int) -> bool:
    """Whether a joint's torque (0-based) is read in mN m, mN or mA."""
    unit = fit.motion.units.get(f"tau{joint + 1}")
    return unit is not None and UNITS[normal_unit(unit)][1] == UNITS["mA"][1]


def _explained(ratio: float, sizes: Mapping[str, float], least: float) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Kinds of mistakes of these sizes that explain a ratio, and alternatives to the first of them."""
    sizes_together = {k: prod(sizes[kind] for kind in k) for k in _TOGETHER if sizes.keys() >= set(k)}
    off = {k: abs(log(ratio / size)) for k, size in sizes_together.items() if abs(log(size)) > log(least)}
    # Data sheets are as uncertain as a factor of two.
    near = [k for k, distance in off.items() if distance < log(2)]
    if not near or near[0][0] not in _INSTEAD:
        return (near[0] if near else ()), ()
    alike = [kinds for kinds in near if kinds[0] in _INSTEAD and kinds[1:] == near[0][1:]]
    best = min(alike, key=lambda kinds: off[kinds])
    return best, tuple(kinds[0] for kinds in alike if kinds != best)


# --- torques, where the model file leaves inertias open ---

Kinds = tuple[str, ...]


def _of_torques(fit: Fit, reading: Reading) -> dict[int, Factor]:
    """Joints (0-based) whose torque differs from that of what the file states by a factor that mistakes explain.

    A logger has one unit: of mistakes that explain a joint as well, that which explains most joints.
    """
    trials = Trials(fit)
    found: dict[int, tuple[Compared, StatedPart, list[Kinds]]] = {}
    for i in trials.able:
        for of, part in _stated_parts(fit, trials, reading, i):
            # The link's inertia adds to the rotor's.
            most = SUSPECTED_RATIO if of == "rotor" else 1.0
            alike = _torque_mistakes(fit, reading, joint=i, part=abs(part.value), most=most)
            if alike:
                found[i] = of, part, alike
                break
    sure = [alike for of, _, alike in found.values() if of != "limit"] or [alike for _, _, alike in found.values()]
    counts, first = Counter(kinds for alike in sure for kinds in alike), Counter(alike[0] for alike in sure)
    result = {}
    for i, (of, part, alike) in found.items():
        # A limit that is exceeded tells no factor.
        every = list(counts) if of == "limit" else alike
        ordered = sorted(every, key=lambda kinds: (-counts[kinds], -first[kinds]))
        others = tuple(kinds[0] for kinds in ordered[1:])
        result[i] = Factor(ordered[0], abs(part.value) * part.stated, part.stated, others, of=of)
    return result


def _stated_parts(fit: Fit, trials: Trials, reading: Reading, joint: int) -> Iterator[tuple[Compared, StatedPart]]:
    """What is far from what the file states: torque of all stated values, of the rotor, the limit of the torque."""
    info = fit.model.joints[joint]
    columns, acceleration, torque = trials.equation(reading, joint)
    found = of_all_stated(fit.model, columns, torque)
    if found.far_below or found.far_above:
        yield "stated values", found
    if info.rotor_inertia:
        found = stated_part(info.rotor_inertia * acceleration, columns[len(fit.model.lumps) :], torque)
        if found.far_below:
            yield "rotor", found
    largest = max(float(np.abs(p.tau[reading.torques[joint]]).max()) for p in fit.motion.pieces)
    if info.torque_limit and largest > BEYOND_LIMIT * info.torque_limit:
        yield "limit", StatedPart(largest / info.torque_limit, 0.0, True, info.torque_limit, largest)


def _torque_mistakes(fit: Fit, reading: Reading, joint: int, part: float, most: float) -> list[Kinds]:
    """Kinds of mistakes that make of a joint's torque (0-based) such a part of what was compared, the likeliest first.

    What the file does not know of gear and motor may be whatever is usual. most: the torque over what was compared
    """
    info, source = fit.model.joints[joint], reading.torques[joint]
    many, constant = 1 / UNITS["mA"][1], info.torque_constant
    ratios = (info.gear_ratio, info.gear_ratio) if info.gear_ratio > 1 else USUAL_RATIOS
    sizes: dict[Kinds, tuple[float, float]] = {(RATIO,): (1 / ratios[1], 1 / ratios[0]), (WHOLE,): (1 / many, 1 / many)}
    if not _in_thousandths(fit, source):
        sizes[MILLI,] = (many, many) if constant else (many / USUAL_CONSTANTS[1], many / USUAL_CONSTANTS[0])
        if constant and f"tau{source + 1}" not in fit.motion.units:
            sizes |= {(CURRENT,): (1 / constant, 1 / constant), (CURRENT, MILLI): (many / constant, many / constant)}
    sizes[TWICE,] = ratios
    off = {kinds: max(log(low / part), log(part / (most * high)), 0.0) for kinds, (low, high) in sizes.items()}
    # As uncertain as in _explained.
    near = [kinds for kinds, distance in off.items() if distance < log(2)]
    return sorted(near, key=lambda kinds: not (sizes[kinds][0] == sizes[kinds][1] and off[kinds] < log(1 + LITTLE)))
