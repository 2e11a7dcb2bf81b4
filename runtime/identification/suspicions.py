"""Wrong data, told by a fit: another sign, degrees read as radians, motors' angles, a missing gear ratio,
exchanged joints.

A hypothesis is refitted with the data put right. It is a suspicion where the torque is then explained far better, or,
where no fit can tell (an inertia and a friction that are all too small by one factor fit as well), where the inertia
comes to the model file's. A model that merely lacks an effect is explained no better by any of them: friction takes
power and a D(q) is positive definite, whatever else acts. Mistakes seldom come alone: with one put right the next is
looked for, and where no single one tells, two at once.

Source: Siciliano, Sciavicco, Villani & Oriolo, Robotics, 2009, chapter 7, for both properties.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from runtime.identification import factors, put_right
from runtime.identification.identify import Identification
from runtime.identification.put_right import Suspicion as Suspicion
from runtime.identification.readings import POSITION, TORQUE, Reading, Readings, turns
from runtime.identification.settings import (
    DOUBTED_RATIO,
    EXCHANGED_FALLS_TO,
    LEAST_TELLING_RATIO,
    MISTAKES_AT_MOST,
    SIGNS_TRIED_TOGETHER,
    SUSPECTED_FROM,
    TURNED_FALLS_TO,
)
from runtime.motion.motion import Motion

Array = NDArray[np.float64]

_EXCHANGES = ((TORQUE,), (POSITION,), (POSITION, TORQUE))
"""What two joints may have in each other's place: drivers log joints in the order of their names."""


def suspicions(identification: Identification) -> tuple[Suspicion, ...]:
    """What a fit of the model file's structure says of its recordings; empty where they can be believed."""
    able, given = _able(identification), Reading.given(identification.model.n)
    if not able:
        return ()
    lumps = identification.fit.coefficients[identification.problem.layout.lumps]
    readings = Readings(identification)
    if not _doubtful(identification, able) or not readings.able:
        by_factor = factors.found(identification, able, lumps, reading=given, least=LEAST_TELLING_RATIO)
        return put_right.told(identification, given, None, by_factor)
    before = _as_given(identification, readings)
    reading, alike = _degrees_first(readings, _Search(readings, before).all_mistakes())
    lumps = lumps if reading == given else readings.lumps(reading)
    by_factor = factors.found(identification, able, lumps, reading=reading, least=LEAST_TELLING_RATIO)
    return put_right.told(identification, reading, (before, readings.errors(reading)), by_factor=by_factor, alike=alike)


def _degrees_first(readings: Readings, reading: Reading) -> tuple[Reading, frozenset[int]]:
    """A reading with positions in degrees where those of motors are no surer, and the joints (0-based) where they are
    alike."""
    alike: set[int] = set()
    for i in sorted(reading.degrees | reading.motors):
        degrees, motors = reading.in_degrees((i,)), reading.at_motors((i,))
        low, high = sorted(readings.errors(r)[i] for r in (degrees, motors))
        if readings.model.joints[i].gear_ratio > LEAST_TELLING_RATIO and low > TURNED_FALLS_TO * high:
            reading, alike = degrees, alike | {i}
    return reading, frozenset(alike)


def doubts(identification: Identification) -> tuple[Suspicion, ...]:
    """What the errors alone say of data that ask for an inertia that no arm has, and inertias that are out by no more
    than a bad guess; empty where nothing does.

    An effect that is missing at one joint, a wrist's coupled gear, spoils the inertia of every trial, and with it the
    surer test of `suspicions`. For people to look at: no verdict rests on it.
    """
    able, given = _able(identification), Reading.given(identification.model.n)
    if not able:
        return ()
    lumps = identification.fit.coefficients[identification.problem.layout.lumps]
    by_factor = factors.found(identification, able, lumps, reading=given, least=DOUBTED_RATIO)
    readings = Readings(identification)
    doubtful = _doubtful(identification, able) and readings.able
    if not doubtful or not np.isinf(readings.errors(given)).any():
        return put_right.told(identification, given, None, by_factor)
    readings = Readings(identification, any_inertia=True)
    before = _as_given(identification, readings)
    reading = _Search(readings, before).likeliest()
    return put_right.told(identification, reading, (before, readings.errors(reading)), {})


def relative_errors(motion: Motion, residual: Sequence[Array], skew: float) -> Array:
    """(n,) ‖τ − τ̂‖/‖τ‖ of every joint on its rows that count; 0 where there are none."""
    found = np.zeros(motion.n)
    for i in range(motion.n):
        use = motion.moving(i)
        total = float(np.linalg.norm(motion.torque(i, skew)[use]))
        found[i] = float(np.linalg.norm(residual[i][use])) / total if total else 0.0
    return found


def _able(identification: Identification) -> list[int]:
    """Joints (0-based) of which something can be told."""
    motion = identification.motion
    return [] if motion.rigid_given else [i for i in range(motion.n) if motion.moving(i).any()]


def _doubtful(identification: Identification, able: Sequence[int]) -> bool:
    """Whether the fit leaves enough of some joint's torque, or stopped at a bound, for wrong data to be behind it."""
    fit, layout = identification.fit, identification.problem.layout
    errors = relative_errors(identification.motion, fit.residual, fit.skew)
    terms = [layout.slices[t] for t in layout.terms if t.joint and t.joint - 1 in able]
    idle = any(part.stop > part.start and not fit.coefficients[part].any() for part in terms)
    return idle or float(errors[list(able)].max()) > SUSPECTED_FROM


def _as_given(identification: Identification, readings: Readings) -> Array:
    """(n,) relative errors of the data as they are.

    A trial weighs the joints by their torques, and where the fit's other weights make a joint pay for its neighbours,
    that alone lowers its error.
    """
    fit = identification.fit
    fitted = relative_errors(identification.motion, fit.residual, fit.skew)
    given: Array = np.minimum(fitted, readings.errors(Reading.given(identification.model.n)))
    return given


class _Search:
    """From the data as they are, whose relative errors are `before` (n,), to those with all mistakes put right."""

    def __init__(self, readings: Readings, before: Array) -> None:
        self.readings, self.able = readings, readings.able
        self.reading, self.before = Reading.given(len(before)), before

    def all_mistakes(self) -> Reading:
        """One mistake after another, and two at once where no single one tells."""
        for _ in range(MISTAKES_AT_MOST):
            found = self._best(self._turned()) or self._best(self._degrees()) or self._best(self._exchanged())
            found = found or self._best(self._pairs())
            if found is None:
                break
            self.reading, self.before = found, self.readings.errors(found)
            if self.before[self.able].max() < SUSPECTED_FROM:
                break
        return self._all_in_degrees()

    def _all_in_degrees(self) -> Reading:
        """Where some positions are in degrees, all that cover more than a turn, unless less is explained so: a logger
        has one unit, and of a joint that is mostly friction no fit tells it."""
        further = self._wide() if self.reading.degrees else []
        whole = self.reading.in_degrees(further)
        return whole if self._whole(self.readings.errors(whole)) <= self._whole(self.before) else self.reading

    def likeliest(self) -> Reading:
        """The single mistake that the errors alone tell."""
        return (
            self._best(self._exchanged())
            or self._best(self._degrees())
            or self._best(t for t in self._turned() if len(t[1]) in (1, len(self.able)))
            or self.reading
        )

    def _best(self, trials: Iterator[tuple[Reading, Sequence[int], float]]) -> Reading | None:
        """Of readings, with the joints (0-based) that they concern and the part to which the error of each must fall,
        the one that explains most of the torques."""
        passed: list[tuple[float, int, Reading]] = []
        for reading, joints, falls_to in trials:
            errors = self.readings.errors(reading)
            if np.all(errors[list(joints)] < falls_to * self.before[list(joints)]):
                passed.append((self._whole(errors), len(passed), reading))
        best = min(passed, default=None)
        return best[2] if best is not None and best[0] < self._whole(self.before) else None

    def _whole(self, errors: Array) -> float:
        return float(np.mean(errors[self.able] ** 2))

    def _turned(self) -> Iterator[tuple[Reading, Sequence[int], float]]:
        """Joints whose torque has the other sign than what they need to move so: one, all of them, or some."""
        several = range(2, len(self.able)) if len(self.able) <= SIGNS_TRIED_TOGETHER else ()
        for joints in {tuple(self.able), *((i,) for i in self.able)}:
            yield self.reading.turned(joints), joints, TURNED_FALLS_TO
        for count in several:
            for some in combinations(self.able, count):
                yield self.reading.turned(some), some, EXCHANGED_FALLS_TO

    def _degrees(self) -> Iterator[tuple[Reading, Sequence[int], float]]:
        """Joints whose positions are explained far better when converted from degrees, or from the motor's: all that
        move so far, or one."""
        wide = self._wide()
        for joints in {tuple(wide), *((i,) for i in wide)} if wide else ():
            yield self.reading.in_degrees(joints), joints, TURNED_FALLS_TO
            if min(self.readings.model.joints[i].gear_ratio for i in joints) > LEAST_TELLING_RATIO:
                yield self.reading.at_motors(joints), joints, TURNED_FALLS_TO

    def _wide(self) -> list[int]:
        """Joints whose positions cover more than a turn."""
        kinds, left = self.readings.model.joints, set(self.able) - self.reading.degrees - self.reading.motors
        place = self.reading.positions
        return [i for i in sorted(left) if turns(self.readings.motion, place[i]) > 1 and kinds[i].type == "revolute"]

    def _exchanged(self) -> Iterator[tuple[Reading, Sequence[int], float]]:
        """Two joints in each other's place."""
        doubtful = [i for i in self.able if self.before[i] > SUSPECTED_FROM]
        for (i, j), what in product(combinations(doubtful, 2), _EXCHANGES):
            yield self.reading.exchanged(i, j, what), (i, j), EXCHANGED_FALLS_TO

    def _pairs(self) -> Iterator[tuple[Reading, Sequence[int], float]]:
        """Joints that are exchanged or in degrees, and degrees or another sign besides."""
        wide = self._wide()
        signs = {tuple(self.able), *((i,) for i in self.able)}
        for reading, joints, _ in self._exchanged():
            if wide:
                both = {*joints, *wide}
                yield reading.in_degrees(wide), sorted(both), EXCHANGED_FALLS_TO
            for some in signs:
                yield reading.turned(some), sorted({*joints, *some}), EXCHANGED_FALLS_TO
        for reading, joints, _ in self._degrees():
            for some in signs:
                yield reading.turned(some), sorted({*joints, *some}), EXCHANGED_FALLS_TO
