"""Wrong data found by a fit: another sign, degrees read as radians, motors' angles, a missing gear ratio, exchanged
joints.

A reading says how the columns of a recording are to be taken. Every plausible one is fitted: the data are wrong where
another reading explains the torques far better, or where the inertia then comes to the model file's. A model that only
lacks an effect is explained no better by any of them: friction takes power and D(q) is positive definite.

Source: both properties, Siciliano, Sciavicco, Villani & Oriolo, Robotics, 2009, chapter 7.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, combinations, product

import numpy as np

from runtime.arrays import Array
from runtime.identification.compare import errors
from runtime.identification.factors import Factor, Weightless, factors, rotorless_torques, weightless_torque
from runtime.identification.fit import Fit
from runtime.identification.readings import DEGREES, MOTOR, POSITION, TORQUE, Reading, Trials, moving_joints
from runtime.identification.settings import DOUBTED_RATIO, FALLS_TO, SUSPECTED_FROM, SUSPECTED_RATIO


@dataclass(frozen=True)
class WrongData:
    """What is wrong with recordings.

    reading      how they should be read
    errors       (n,) relative errors of the torques as recorded and as they should be read; None where only inertias
                 are wrong
    factors      joint (0-based) -> what its inertia, or what the file states of its links, says besides
    alike        joints (0-based) whose positions are in degrees, or as well the motor's
    weightless   gravity that is not in the torques; then nothing else was looked for
    rotorless    joints (0-based) whose torque has neither rotor nor friction
    """

    reading: Reading
    errors: tuple[Array, Array] | None = None
    factors: Mapping[int, Factor] = field(default_factory=dict)
    alike: Collection[int] = ()
    weightless: Weightless | None = None
    rotorless: Collection[int] = ()


def wrong_data(fit: Fit) -> WrongData:
    """What a fit of the model file's structure says of its recordings."""
    given, lumps = Reading.given(fit.model.n), fit.prediction.lumps
    weightless = weightless_torque(fit)
    if weightless is not None and not weightless.alone:
        return WrongData(given, weightless=weightless)
    trials = _trials(fit)
    if trials is None:
        return WrongData(given, factors=_factors(fit, given, lumps, SUSPECTED_RATIO))
    search = _Search(trials, lambda reading: trials.fit(reading).physical_errors, _errors(fit))
    before = search.before
    reading, alike = search.degrees_first(search.all_mistakes())
    lumps = lumps if reading == given else trials.fit(reading).lumps
    apart = _factors(fit, reading, lumps, SUSPECTED_RATIO)
    return WrongData(reading, (before, search.errors(reading)), apart, alike)


def doubtful_data(fit: Fit) -> WrongData:
    """What the errors alone say where the data ask for an inertia that no arm has, and inertias that are wrong by no
    more than a bad guess.

    An effect that is missing at one joint, a wrist's coupled gear, spoils the inertia of every reading, and with it the
    surer test of `wrong_data`. For people to look at: no verdict follows from it.
    """
    given, trials, weightless = Reading.given(fit.model.n), _trials(fit), weightless_torque(fit)
    if weightless is not None:
        return WrongData(given, weightless=weightless)
    if trials is None or trials.fit(given).physical:
        lumps = fit.prediction.lumps
        rotorless = rotorless_torques(fit)
        return WrongData(given, factors=_factors(fit, given, lumps, DOUBTED_RATIO), rotorless=rotorless)
    search = _Search(trials, lambda reading: trials.fit(reading).errors, _errors(fit))
    reading = search.likeliest()
    return WrongData(reading, (search.before, search.errors(reading)))


# --- the fit of the data as they are ---


def _factors(fit: Fit, reading: Reading, lumps: Array, least: float) -> dict[int, Factor]:
    apart = factors(fit, reading, lumps, least)
    rotorless = rotorless_torques(fit) if apart else ()
    return {i: factor for i, factor in apart.items() if i not in rotorless}


def _errors(fit: Fit) -> Array:
    """(n,) relative errors of the joints, on their rows that count."""
    motion = fit.motion
    rows = [(residual, motion.torque(i, fit.skew), motion.moving(i)) for i, residual in enumerate(fit.residual)]
    return np.array([errors(residual[use], torque[use])[1] for residual, torque, use in rows])


def _trials(fit: Fit) -> Trials | None:
    """None where no joint has a torque, or where too little of every torque is left, and no effect came to its bound,
    for data to be wrong."""
    layout, moving = fit.problem.layout, moving_joints(fit)
    terms = [fit.coefficients[layout.slices[t]] for t in layout.terms if t.joint and t.joint - 1 in moving]
    idle = any(len(own) and not own.any() for own in terms)
    if not idle and float(_errors(fit)[moving].max(initial=0.0)) <= SUSPECTED_FROM:
        return None
    trials = Trials(fit)
    return trials if trials.able else None


# --- the search over readings ---

_EXCHANGES = ((TORQUE,), (POSITION,), (POSITION, TORQUE))
"""What of two joints may be exchanged: drivers log joints in the order of their names."""
_Change = tuple[Reading, Sequence[int]]
"""A reading, the joints (0-based) that it concerns, and the part to which the error of each must fall."""


def _all_or_one(joints: Sequence[int]) -> set[tuple[int, ...]]:
    return {tuple(joints), *((i,) for i in joints)} if joints else set()


class _Search:
    """From the data as they are to the reading that puts them right.

    errors   (n,) relative errors under a reading
    turnable joints (0-based) whose torque may have the other sign: those that do not drive their own motion
    before   (n,) those of the data as they are, in the fit or in a trial, whichever are smaller: a trial weights joints
             by their torques, which lowers an error where other weights made a joint pay for its neighbours
    """

    def __init__(self, trials: Trials, errors: Callable[[Reading], Array], fitted: Array) -> None:
        self.trials, self.able, self.errors = trials, trials.able, errors
        driving = trials.driving()
        self.turnable = [i for i in self.able if i not in driving]
        self.reading = Reading.given(len(fitted))
        self.before: Array = np.minimum(fitted, errors(self.reading))

    def all_mistakes(self) -> Reading:
        """One mistake after another, two at once where no single one is found; more than three wait for the next
        look."""
        for _ in range(3):
            found = self._best(chain(self._turned(), self._some_turned())) or self._best(self._scaled())
            found = found or self._best(self._exchanged()) or self._best(self._pairs())
            if found is None:
                break
            self.reading, self.before = found, self.errors(found)
            if self.before[self.able].max() < SUSPECTED_FROM:
                break
        return self._all_in_degrees()

    def _all_in_degrees(self) -> Reading:
        """Where some positions are in degrees, all that cover more than a turn, unless less is explained so: a logger
        has one unit, and no fit shows it of a joint that is mostly friction."""
        further = self.trials.wide(self.reading) if DEGREES in self.reading.units else []
        every = self.reading.measured_in(DEGREES, further)
        return every if self._mean_square(self.errors(every)) <= self._mean_square(self.before) else self.reading

    def degrees_first(self, reading: Reading) -> tuple[Reading, Collection[int]]:
        """A reading with degrees in place of motors' angles where these are no surer, and the joints (0-based) where
        both fit alike."""
        alike: set[int] = set()
        for i in reading.joints_in(DEGREES, MOTOR):
            degrees, motors = (reading.measured_in(unit, (i,)) for unit in (DEGREES, MOTOR))
            own, other = (float(self.errors(r)[i]) for r in (degrees, motors))
            if self.trials.model.joints[i].gear_ratio > SUSPECTED_RATIO and other > FALLS_TO * own:
                reading = degrees
                alike |= {i} if own > FALLS_TO * other else set()
        return reading, alike

    def likeliest(self) -> Reading:
        """The single mistake that the errors alone show."""
        found = self._best(self._exchanged()) or self._best(self._scaled()) or self._best(self._turned())
        return found or self.reading

    def _best(self, changes: Iterable[_Change]) -> Reading | None:
        """Of the readings that lower the errors enough, the one that explains most of the torques."""
        best, least = None, self._mean_square(self.before)
        for reading, joints in changes:
            errors, concerned = self.errors(reading), list(joints)
            size = self._mean_square(errors)
            if size < least and np.all(errors[concerned] < FALLS_TO * self.before[concerned]):
                best, least = reading, size
        return best

    def _mean_square(self, errors: Array) -> float:
        return float(np.mean(errors[self.able] ** 2))

    def _turned(self) -> Iterator[_Change]:
        for joints in _all_or_one(self.turnable):
            yield self.reading.turned(joints), joints

    def _some_turned(self) -> Iterator[_Change]:
        few = 7  # whose 127 combinations of signs take less than a second
        for count in range(2, len(self.turnable)) if len(self.turnable) <= few else ():
            for some in combinations(self.turnable, count):
                yield self.reading.turned(some), some

    def _scaled(self) -> Iterator[_Change]:
        """Positions in degrees, or of the motor: of one joint that covers more than a turn, or of all that do."""
        for joints in _all_or_one(self.trials.wide(self.reading)):
            yield self.reading.measured_in(DEGREES, joints), joints
            if min(self.trials.model.joints[i].gear_ratio for i in joints) > SUSPECTED_RATIO:
                yield self.reading.measured_in(MOTOR, joints), joints

    def _exchanged(self) -> Iterator[_Change]:
        doubtful = [i for i in self.able if self.before[i] > SUSPECTED_FROM]
        for (i, j), what in product(combinations(doubtful, 2), _EXCHANGES):
            yield self.reading.exchanged(i, j, what), (i, j)

    def _pairs(self) -> Iterator[_Change]:
        """Joints that are exchanged or in another unit, and degrees or another sign besides."""
        wide = self.trials.wide(self.reading)
        for reading, joints in self._exchanged():
            if wide:
                yield reading.measured_in(DEGREES, wide), sorted({*joints, *wide})
            yield from self._with_a_sign(reading, joints)
        for reading, joints in self._scaled():
            yield from self._with_a_sign(reading, joints)

    def _with_a_sign(self, reading: Reading, joints: Sequence[int]) -> Iterator[_Change]:
        for some in _all_or_one(self.able):
            yield reading.turned(some), sorted({*joints, *some})
