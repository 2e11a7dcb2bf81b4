"""Wrong data found by a fit: another sign, degrees read as radians, motors' angles, a missing gear ratio, exchanged
joints.

A reading says how the columns of a recording are to be taken. Every plausible one is fitted: the data are wrong where
another reading explains the torques far better, or where the inertia then comes to the model file's. A model that only
lacks an effect is explained no better by any of them: friction takes power and D(q) is positive definite.

Source: both properties, Siciliano, Sciavicco, Villani & Oriolo, Robotics, 2009, chapter 7; separable least squares,
Golub & Pereyra 1973.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import combinations, product
from math import isfinite, log, pi, prod

import numpy as np
from numpy.typing import NDArray

from runtime.identification.compare import errors
from runtime.identification.identify import Identification
from runtime.identification.problem import Problem, least_inertia
from runtime.identification.settings import (
    DOUBTED_RATIO,
    EXCHANGED_FALLS_TO,
    SUSPECTED_FROM,
    SUSPECTED_RATIO,
    TURNED_FALLS_TO,
)
from runtime.motion.motion import Motion
from runtime.motion.piece import Piece
from runtime.recordings.columns import UNITS, normal_unit
from runtime.regression.bounded import bounded

Array = NDArray[np.float64]

POSITION, TORQUE = "q", "tau"
"""Columns of a recording."""
RADIANS, DEGREES, MOTOR = "radians", "degrees", "motor"
"""What a position is: of the joint in rad (m), of the joint in degrees, or of the motor before the gear in rad."""
RATIO, MILLI, CURRENT = "ratio", "milli", "current"
"""What a torque is: the motor's before the gear, in thousandths of its unit, or a current that was read as a torque."""
_DEGREE = UNITS["deg"][1]


@dataclass(frozen=True)
class Reading:
    """How the columns of a recording are to be taken, an item a joint.

    positions, torques   joint (0-based) under whose number it is recorded
    signs                of the torques, +1 or −1
    units                of the positions: RADIANS, DEGREES or MOTOR
    """

    positions: tuple[int, ...]
    torques: tuple[int, ...]
    signs: tuple[int, ...]
    units: tuple[str, ...]

    @classmethod
    def given(cls, n: int) -> Reading:
        """As the file says."""
        return cls(tuple(range(n)), tuple(range(n)), (1,) * n, (RADIANS,) * n)

    def turned(self, joints: Collection[int]) -> Reading:
        """With the other sign of these joints' torques."""
        return replace(self, signs=tuple(-s if i in joints else s for i, s in enumerate(self.signs)))

    def measured_in(self, unit: str, joints: Collection[int]) -> Reading:
        """With positions of these joints in this unit."""
        return replace(self, units=tuple(unit if i in joints else u for i, u in enumerate(self.units)))

    def exchanged(self, one: int, other: int, what: Collection[str]) -> Reading:
        """With positions, torques or both of two joints exchanged."""
        columns = {POSITION: ("positions", "units"), TORQUE: ("torques", "signs")}
        rows = {name: getattr(self, name) for column in what for name in columns[column]}
        swap = {one: other, other: one}
        return replace(self, **{name: tuple(x[swap.get(i, i)] for i in range(len(x))) for name, x in rows.items()})

    def joints_in(self, *units: str) -> list[int]:
        """Joints (0-based) whose positions are in one of these units."""
        return [i for i, unit in enumerate(self.units) if unit in units]

    def exchanges(self) -> list[tuple[tuple[int, int], tuple[str, ...]]]:
        """Pairs of exchanged joints (0-based), and which of their columns are."""
        found: dict[tuple[int, int], tuple[str, ...]] = {}
        for what, places in ((POSITION, self.positions), (TORQUE, self.torques)):
            for i, source in enumerate(places):
                if i < source:
                    found[i, source] = (*found.get((i, source), ()), what)
        return sorted(found.items())


@dataclass(frozen=True)
class InertiaFactor:
    """Mistakes that together explain a joint's fitted inertia beside the stated one, both kg m² (kg).

    kinds         any of DEGREES, MOTOR, MILLI, CURRENT and RATIO
    alternatives  what explains it as well in place of the first of them
    """

    kinds: tuple[str, ...]
    fitted: float
    stated: float
    alternatives: tuple[str, ...] = ()


@dataclass(frozen=True)
class WrongData:
    """What is wrong with recordings; false where nothing is.

    reading      how they should be read
    errors       (n,) relative errors of the torques as recorded and as they should be read; None where only inertias
                 are wrong
    factors      joint (0-based) -> what its inertia says besides
    alike        joints (0-based) whose positions are in degrees, or as well the motor's
    """

    reading: Reading
    errors: tuple[Array, Array] | None = None
    factors: Mapping[int, InertiaFactor] = field(default_factory=dict)
    alike: Collection[int] = ()

    def __bool__(self) -> bool:
        return bool(self.factors) or self.reading != Reading.given(len(self.reading.signs))


def wrong_data(identification: Identification) -> WrongData:
    """What a fit of the model file's structure says of its recordings."""
    fitted, given = _Fitted(identification), Reading.given(identification.model.n)
    trials = _Trials(identification) if fitted.doubtful else None
    if trials is None or not trials.able:
        return WrongData(given, factors=fitted.inertia_factors(given, fitted.lumps, SUSPECTED_RATIO))
    before = fitted.errors_at_most(trials)
    reading, alike = _degrees_first(trials, _Search(trials, before).all_mistakes())
    lumps = fitted.lumps if reading == given else trials.lumps(reading)
    factors = fitted.inertia_factors(reading, lumps, SUSPECTED_RATIO)
    return WrongData(reading, (before, trials.errors(reading)), factors, alike)


def doubtful_data(identification: Identification) -> WrongData:
    """What the errors alone say where the data ask for an inertia that no arm has, and inertias that are wrong by no
    more than a bad guess.

    An effect that is missing at one joint, a wrist's coupled gear, spoils the inertia of every reading, and with it the
    surer test of `wrong_data`. For people to look at: no verdict follows from it.
    """
    fitted, given = _Fitted(identification), Reading.given(identification.model.n)
    trials = _Trials(identification) if fitted.doubtful else None
    if trials is None or not trials.able or not np.isinf(trials.errors(given)).any():
        return WrongData(given, factors=fitted.inertia_factors(given, fitted.lumps, DOUBTED_RATIO))
    trials = _Trials(identification, any_inertia=True)
    before = fitted.errors_at_most(trials)
    reading = _Search(trials, before).likeliest()
    return WrongData(reading, (before, trials.errors(reading)))


def turns(motion: Motion, joint: int) -> float:
    """Range of a joint's position (0-based) in turns, read as it is given."""
    low = min(float(p.q[joint].min()) for p in motion.pieces)
    return (max(float(p.q[joint].max()) for p in motion.pieces) - low) / (2 * pi)


# --- the fit of the data as they are ---

_INSTEAD = (DEGREES, MOTOR, RATIO)
"""What alike makes an inertia too small, the likeliest first."""
_TOGETHER = (
    *((DEGREES,), (MOTOR,), (MILLI,), (RATIO,), (CURRENT,), (CURRENT, MILLI)),
    *((DEGREES, RATIO), (MOTOR, RATIO), (DEGREES, MILLI), (DEGREES, CURRENT), (MOTOR, CURRENT)),
    *((DEGREES, CURRENT, MILLI), (MOTOR, CURRENT, MILLI), (MILLI, RATIO), (DEGREES, MOTOR, RATIO)),
)
"""Mistakes that are made alone or together, the likeliest first."""


@dataclass(frozen=True)
class _Fitted:
    """A fit of the data as they are."""

    identification: Identification

    @cached_property
    def able(self) -> list[int]:
        """Joints (0-based) that move; none where the user's own model gives the rigid torque."""
        motion = self.identification.motion
        return [] if motion.rigid_given else [i for i in range(motion.n) if motion.moving(i).any()]

    @property
    def lumps(self) -> Array:
        return self.identification.fit.coefficients[self.identification.problem.layout.lumps]

    @cached_property
    def errors(self) -> Array:
        """(n,) relative errors of the joints, on their rows that count."""
        motion, fit = self.identification.motion, self.identification.fit
        rows = [(residual, motion.torque(i, fit.skew), motion.moving(i)) for i, residual in enumerate(fit.residual)]
        return np.array([errors(residual[use], torque[use])[1] for residual, torque, use in rows])

    @property
    def doubtful(self) -> bool:
        """Whether enough of some joint's torque is left, or an effect came to its bound, for data to be wrong."""
        fit, layout = self.identification.fit, self.identification.problem.layout
        terms = [layout.slices[t] for t in layout.terms if t.joint and t.joint - 1 in self.able]
        idle = any(part.stop > part.start and not fit.coefficients[part].any() for part in terms)
        return idle or float(self.errors[self.able].max(initial=0.0)) > SUSPECTED_FROM

    def errors_at_most(self, trials: _Trials) -> Array:
        """(n,) relative errors of the data as they are, in the fit or in the trial, whichever are smaller.

        A trial weights joints by their torques; that alone lowers an error where other weights made a joint pay for
        its neighbours.
        """
        found: Array = np.minimum(self.errors, trials.errors(Reading.given(len(self.errors))))
        return found

    def inertia_factors(self, reading: Reading, lumps: Array, least: float) -> dict[int, InertiaFactor]:
        """Joints (0-based) whose inertia is wrong by a factor that mistakes explain.

        No fit shows these: an inertia and a friction that are all too small by one factor fit as well.
        lumps   base inertial parameters under the reading      least   smallest such factor
        """
        model = self.identification.model
        if not model.lumps_known:
            return {}
        rest, result = np.zeros((model.n, 1)), {}
        fitted, stated = (np.diagonal(model.inertia(rest, x)[:, :, 0]) for x in (lumps, model.lump_values))
        for i in self.able:
            if isfinite(stated[i]) and fitted[i] > 0 and stated[i] > 0:
                kinds, others = _explained(float(stated[i] / fitted[i]), self._sizes(i, reading), least)
                if kinds:
                    result[i] = InertiaFactor(kinds, float(fitted[i]), float(stated[i]), others)
        return result

    def _sizes(self, joint: int, reading: Reading) -> dict[str, float]:
        """By what each mistake that is possible at a joint (0-based) divides its inertia."""
        info, motion = self.identification.model.joints[joint], self.identification.motion
        sizes = {MILLI: UNITS["mA"][1]}
        if info.gear_ratio > SUSPECTED_RATIO:
            sizes[RATIO] = info.gear_ratio
        if info.torque_constant is not None and f"tau{reading.torques[joint] + 1}" not in motion.units:
            sizes[CURRENT] = info.torque_constant
        if turns(motion, reading.positions[joint]) > 1 and info.type == "revolute":
            stated = normal_unit(motion.units.get(f"q{reading.positions[joint] + 1}", ""))
            if reading.units[joint] != DEGREES and stated != "deg":
                sizes[DEGREES] = 1 / _DEGREE
            if reading.units[joint] != MOTOR and RATIO in sizes:
                sizes[MOTOR] = info.gear_ratio
        return sizes


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


# --- fits under other readings ---


class _Trials:
    """Fits of an identification's structure on an excerpt of its motion, under one reading after another.

    The equations of motion are set up once for each way to read the positions: of each joint the Gram matrix of its
    regressor (K,), the part without free coefficient, and every joint's torque (n,) at its rows. Sign and place of a
    torque only choose among its columns, so that a trial costs one small system.
    any_inertia   whether an inertia that no arm has is accepted
    able          joints (0-based) with a torque in the excerpt; of others nothing can be found
    """

    def __init__(self, identification: Identification, any_inertia: bool = False) -> None:
        self.model, self.fit, self.any_inertia = identification.model, identification.fit, any_inertia
        # Enough for mistakes that concern most of the torque.
        self.motion, _ = identification.motion.excerpt(20_000)
        self.able = [i for i in range(self.motion.n) if self._has_torque(i)]
        self._prediction, self._layout = identification.problem.regressors.prediction, identification.problem.layout
        self._tables: dict[tuple[tuple[int, ...], tuple[str, ...]], dict[int, Array]] = {}
        self._solved: dict[Reading, tuple[Array, Array]] = {}

    def errors(self, reading: Reading) -> Array:
        """(n,) relative errors, joints weighted by their torques; infinite where no arm has such an inertia, or where
        the torque is zero while the joint moves."""
        return self._solution(reading)[0]

    def lumps(self, reading: Reading) -> Array:
        """Base inertial parameters under a reading."""
        return self._solution(reading)[1][self._layout.lumps]

    def mean_square(self, errors: Array) -> float:
        return float(np.mean(errors[self.able] ** 2))

    def wide(self, reading: Reading) -> list[int]:
        """Revolute joints (0-based) whose positions, taken as radians, cover more than a turn."""
        able = set(self.able) & set(reading.joints_in(RADIANS))
        revolute = [i for i in sorted(able) if self.model.joints[i].type == "revolute"]
        return [i for i in revolute if turns(self.motion, reading.positions[i]) > 1]

    def _solution(self, reading: Reading) -> tuple[Array, Array]:
        if reading not in self._solved:
            self._solved[reading] = self._solve(reading)
        return self._solved[reading]

    def _solve(self, reading: Reading) -> tuple[Array, Array]:
        layout, errors, weights = self._layout, np.zeros(self.motion.n), {}
        size, grams = layout.size, self._grams(reading)
        gram, moment = np.zeros((size, size)), np.zeros(size)
        for i, own in grams.items():
            source = size + 1 + reading.torques[i]
            if not _is_torque(own[source, source]):
                errors[i] = np.inf
                continue
            weights[i] = 1 / own[source, source]
            gram += weights[i] * own[:size, :size]
            moment += weights[i] * (reading.signs[i] * own[:size, source] - own[:size, size])
        theta = bounded(gram, moment, layout.lower, upper=layout.upper, near=layout.stated)
        if not self.any_inertia and not self._is_physical(reading, theta[layout.lumps]):
            return np.full(self.motion.n, np.inf), theta
        for i, weight in weights.items():
            residual = np.concatenate([theta, [1.0], np.zeros(self.motion.n)])
            residual[size + 1 + reading.torques[i]] = -reading.signs[i]
            errors[i] = float(np.sqrt(max(weight * (residual @ grams[i] @ residual), 0.0)))
        return errors, theta

    def _has_torque(self, joint: int) -> bool:
        torque = self.motion.torque(joint, self.fit.skew)[self.motion.moving(joint)]
        return len(torque) > 0 and _is_torque(float(torque @ torque) / len(torque))

    def _is_physical(self, reading: Reading, lumps: Array) -> bool:
        """Whether D is positive definite along the motion."""
        mix = self._mix(reading)
        return least_inertia(self.model, self.motion.changed(lambda p: replace(p, q=mix @ p.q)), lumps)[0] > 0

    def _mix(self, reading: Reading) -> Array:
        """(n, n) positions in rad of those that are given."""
        sizes = [{RADIANS: 1.0, DEGREES: _DEGREE, MOTOR: 1 / joint.gear_ratio} for joint in self.model.joints]
        scales = np.array([size[unit] for size, unit in zip(sizes, reading.units, strict=True)])
        mix: Array = np.eye(len(scales))[list(reading.positions)] * scales[:, None]
        return mix

    def _grams(self, reading: Reading) -> dict[int, Array]:
        """Joint (0-based) -> (K + 1 + n, K + 1 + n) moments, mean squares, of the joints with a torque."""
        key = reading.positions, reading.units
        if key not in self._tables:
            motion = _mixed(self.motion, self._mix(reading))
            problem = Problem(self.model, motion, self._layout.terms, self._prediction)
            of_one = [motion.changed(partial(_all_torques_of, j)) for j in range(motion.n)]
            self._tables[key] = {}
            for i in self.able:
                use = motion.moving(i)
                x, fixed = (rows[..., use] for rows in problem.rows(i, self.fit.shapes))
                stacked = np.stack([*x, fixed, *(other.torque(i, self.fit.skew)[use] for other in of_one)])
                self._tables[key][i] = stacked @ stacked.T / max(len(fixed), 1)
        return self._tables[key]


def _is_torque(mean_square: float) -> bool:
    """Whether a torque is more than what a filter leaves once the recorded one has become zero."""
    return mean_square > 1e-30**2


def _mixed(motion: Motion, mix: Array) -> Motion:
    """The motion with its positions mixed (n, n)."""
    if np.array_equal(mix, np.eye(motion.n)):
        return motion

    def change(p: Piece) -> Piece:
        q, qd, qdd, own = (mix @ x for x in (p.q, p.qd, p.qdd, p.qdd_denoised))
        return replace(p, q=q, qd=qd, qdd=qdd, qdd_denoised=own)

    held = np.isinf(motion.standstill)
    standstill = np.where(held, np.inf, mix @ np.where(held, 0.0, motion.standstill))
    return motion.changed(change).resting(standstill, motion.quiet)


def _all_torques_of(joint: int, p: Piece) -> Piece:
    """With one joint's torque (0-based) at all joints."""
    return replace(p, tau=np.tile(p.tau[joint], (len(p.tau), 1)))


# --- the search over readings ---

_EXCHANGES = ((TORQUE,), (POSITION,), (POSITION, TORQUE))
"""What of two joints may be exchanged: drivers log joints in the order of their names."""
_Trial = tuple[Reading, Sequence[int], float]
"""A reading, the joints (0-based) that it concerns, and the part to which the error of each must fall."""


def _degrees_first(trials: _Trials, reading: Reading) -> tuple[Reading, Collection[int]]:
    """A reading with degrees in place of motors' angles where these are no surer, and the joints (0-based) where both
    fit alike."""
    alike: set[int] = set()
    for i in reading.joints_in(DEGREES, MOTOR):
        degrees, motors = (reading.measured_in(unit, (i,)) for unit in (DEGREES, MOTOR))
        low, high = sorted(trials.errors(r)[i] for r in (degrees, motors))
        if trials.model.joints[i].gear_ratio > SUSPECTED_RATIO and low > TURNED_FALLS_TO * high:
            reading, alike = degrees, alike | {i}
    return reading, alike


class _Search:
    """From the data as they are, whose relative errors are `before` (n,), to the reading that puts them right."""

    def __init__(self, trials: _Trials, before: Array) -> None:
        self.trials, self.able = trials, trials.able
        self.reading, self.before = Reading.given(len(before)), before

    def all_mistakes(self) -> Reading:
        """One mistake after another, two at once where no single one is found; more than three wait for the next
        look."""
        for _ in range(3):
            found = self._best(self._turned()) or self._best(self._scaled()) or self._best(self._exchanged())
            found = found or self._best(self._pairs())
            if found is None:
                break
            self.reading, self.before = found, self.trials.errors(found)
            if self.before[self.able].max() < SUSPECTED_FROM:
                break
        return self._all_in_degrees()

    def _all_in_degrees(self) -> Reading:
        """Where some positions are in degrees, all that cover more than a turn, unless less is explained so: a logger
        has one unit, and no fit shows it of a joint that is mostly friction."""
        further = self.trials.wide(self.reading) if DEGREES in self.reading.units else []
        every, size = self.reading.measured_in(DEGREES, further), self.trials.mean_square
        return every if size(self.trials.errors(every)) <= size(self.before) else self.reading

    def likeliest(self) -> Reading:
        """The single mistake that the errors alone show."""
        return (
            self._best(self._exchanged())
            or self._best(self._scaled())
            or self._best(t for t in self._turned() if len(t[1]) in (1, len(self.able)))
            or self.reading
        )

    def _best(self, readings: Iterator[_Trial]) -> Reading | None:
        """Of the readings that lower the errors enough, the one that explains most of the torques."""
        passed: list[tuple[float, int, Reading]] = []
        for reading, joints, falls_to in readings:
            errors = self.trials.errors(reading)
            if np.all(errors[list(joints)] < falls_to * self.before[list(joints)]):
                passed.append((self.trials.mean_square(errors), len(passed), reading))
        best = min(passed, default=None)
        return best[2] if best is not None and best[0] < self.trials.mean_square(self.before) else None

    @staticmethod
    def _all_or_one(joints: Sequence[int]) -> set[tuple[int, ...]]:
        return {tuple(joints), *((i,) for i in joints)} if joints else set()

    def _turned(self) -> Iterator[_Trial]:
        """The other sign of the torque of one joint, of all, or of some where there are few."""
        for joints in self._all_or_one(self.able):
            yield self.reading.turned(joints), joints, TURNED_FALLS_TO
        few = 7  # whose 127 combinations of signs take a second
        for count in range(2, len(self.able)) if len(self.able) <= few else ():
            for some in combinations(self.able, count):
                yield self.reading.turned(some), some, EXCHANGED_FALLS_TO

    def _scaled(self) -> Iterator[_Trial]:
        """Positions in degrees, or of the motor: of one joint that covers more than a turn, or of all that do."""
        for joints in self._all_or_one(self.trials.wide(self.reading)):
            yield self.reading.measured_in(DEGREES, joints), joints, TURNED_FALLS_TO
            if min(self.trials.model.joints[i].gear_ratio for i in joints) > SUSPECTED_RATIO:
                yield self.reading.measured_in(MOTOR, joints), joints, TURNED_FALLS_TO

    def _exchanged(self) -> Iterator[_Trial]:
        """Two joints in each other's place."""
        doubtful = [i for i in self.able if self.before[i] > SUSPECTED_FROM]
        for (i, j), what in product(combinations(doubtful, 2), _EXCHANGES):
            yield self.reading.exchanged(i, j, what), (i, j), EXCHANGED_FALLS_TO

    def _pairs(self) -> Iterator[_Trial]:
        """Joints that are exchanged or in another unit, and degrees or another sign besides."""
        wide = self.trials.wide(self.reading)
        for reading, joints, _ in self._exchanged():
            if wide:
                yield reading.measured_in(DEGREES, wide), sorted({*joints, *wide}), EXCHANGED_FALLS_TO
            yield from self._with_a_sign(reading, joints)
        for reading, joints, _ in self._scaled():
            yield from self._with_a_sign(reading, joints)

    def _with_a_sign(self, reading: Reading, joints: Sequence[int]) -> Iterator[_Trial]:
        for some in self._all_or_one(self.able):
            yield reading.turned(some), sorted({*joints, *some}), EXCHANGED_FALLS_TO
