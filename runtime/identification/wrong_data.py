"""Wrong data found by a fit: another sign, degrees read as radians, motors' angles, a missing gear ratio, exchanged
joints.

A reading says how the columns of a recording are to be taken. Every plausible one is fitted: the data are wrong where
another reading explains the torques far better, or where the inertia then comes to the model file's. A model that only
lacks an effect is explained no better by any of them: friction takes power and D(q) is positive definite.

Source: both properties, Siciliano, Sciavicco, Villani & Oriolo, Robotics, 2009, chapter 7.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, combinations, product
from math import isfinite, log, pi, prod

import numpy as np
from numpy.typing import NDArray

from runtime.identification.compare import errors
from runtime.identification.fit import Fit
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
from runtime.regression.system import Block, Columns, JointRows, LinearSystem

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
    """What is wrong with recordings.

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


def wrong_data(fit: Fit) -> WrongData:
    """What a fit of the model file's structure says of its recordings."""
    given, lumps = Reading.given(fit.model.n), fit.prediction.lumps
    trials = _trials(fit)
    if trials is None:
        return WrongData(given, factors=_inertia_factors(fit, given, lumps, SUSPECTED_RATIO))
    search = _Search(trials, lambda reading: trials.fit(reading).physical_errors, _errors(fit))
    before = search.before
    reading, alike = search.degrees_first(search.all_mistakes())
    lumps = lumps if reading == given else trials.fit(reading).lumps
    factors = _inertia_factors(fit, reading, lumps, SUSPECTED_RATIO)
    return WrongData(reading, (before, search.errors(reading)), factors, alike)


def doubtful_data(fit: Fit) -> WrongData:
    """What the errors alone say where the data ask for an inertia that no arm has, and inertias that are wrong by no
    more than a bad guess.

    An effect that is missing at one joint, a wrist's coupled gear, spoils the inertia of every reading, and with it the
    surer test of `wrong_data`. For people to look at: no verdict follows from it.
    """
    given, trials = Reading.given(fit.model.n), _trials(fit)
    if trials is None or trials.fit(given).physical:
        lumps = fit.prediction.lumps
        return WrongData(given, factors=_inertia_factors(fit, given, lumps, DOUBTED_RATIO))
    search = _Search(trials, lambda reading: trials.fit(reading).errors, _errors(fit))
    reading = search.likeliest()
    return WrongData(reading, (search.before, search.errors(reading)))


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


def _errors(fit: Fit) -> Array:
    """(n,) relative errors of the joints, on their rows that count."""
    motion = fit.motion
    rows = [(residual, motion.torque(i, fit.skew), motion.moving(i)) for i, residual in enumerate(fit.residual)]
    return np.array([errors(residual[use], torque[use])[1] for residual, torque, use in rows])


def _moving_joints(fit: Fit) -> list[int]:
    """Joints (0-based) that move; none where the user's own model gives the rigid torque."""
    motion = fit.motion
    return [] if motion.rigid_given else [i for i in range(motion.n) if motion.moving(i).any()]


def _trials(fit: Fit) -> _Trials | None:
    """None where no joint has a torque, or where too little of every torque is left, and no effect came to its bound,
    for data to be wrong."""
    layout, moving = fit.problem.layout, _moving_joints(fit)
    terms = [fit.coefficients[layout.slices[t]] for t in layout.terms if t.joint and t.joint - 1 in moving]
    idle = any(len(own) and not own.any() for own in terms)
    if not idle and float(_errors(fit)[moving].max(initial=0.0)) <= SUSPECTED_FROM:
        return None
    trials = _Trials(fit)
    return trials if trials.able else None


def _inertia_factors(fit: Fit, reading: Reading, lumps: Array, least: float) -> dict[int, InertiaFactor]:
    """Joints (0-based) whose inertia is wrong by a factor that mistakes explain.

    No fit shows these: an inertia and a friction that are all too small by one factor fit as well.
    lumps   base inertial parameters under the reading      least   smallest such factor
    """
    model = fit.model
    if not model.lumps_known:
        return {}
    rest, result = np.zeros((model.n, 1)), {}
    fitted, stated = (np.diagonal(model.inertia(rest, x)[:, :, 0]) for x in (lumps, model.lump_values))
    for i in _moving_joints(fit):
        if isfinite(stated[i]) and fitted[i] > 0 and stated[i] > 0:
            kinds, others = _explained(float(stated[i] / fitted[i]), _sizes(fit, i, reading), least)
            if kinds:
                result[i] = InertiaFactor(kinds, float(fitted[i]), float(stated[i]), others)
    return result


def _sizes(fit: Fit, joint: int, reading: Reading) -> dict[str, float]:
    """By what each mistake that is possible at a joint (0-based) divides its inertia."""
    info, motion = fit.model.joints[joint], fit.motion
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


@dataclass(frozen=True)
class _Trial:
    """A fit under a reading: (n,) relative errors of the torques, infinite where a joint moves without one, base
    inertial parameters, and whether some arm has such an inertia."""

    errors: Array
    lumps: Array
    physical: bool

    @property
    def physical_errors(self) -> Array:
        """(n,) relative errors; infinite where no arm has such an inertia."""
        return self.errors if self.physical else np.full_like(self.errors, np.inf)


class _Trials:
    """Fits of an identification's structure on an excerpt of its motion, joints weighted by their torques.

    The equations are set up once for each way to read the positions, and an orthogonal transformation leaves as many
    rows as they have columns, with the same squared errors (Golub & Van Loan, Matrix Computations, QR). Sign and place
    of a torque only choose another right-hand side, so that a trial is one small system.
    able   joints (0-based) with a torque in the excerpt; of others nothing can be found
    """

    def __init__(self, fit: Fit) -> None:
        self.model, self.problem, self.found = fit.model, fit.problem, fit
        # Enough for mistakes that concern most of the torque.
        self.motion, _ = fit.motion.excerpt(20_000)
        every = range(self.motion.n)
        self.able = [i for i in every if _is_torque(self.motion.torque(i, self.found.skew)[self.motion.moving(i)])]
        self._rows: dict[tuple[tuple[int, ...], tuple[str, ...]], dict[int, Array]] = {}
        self._fits: dict[Reading, _Trial] = {}

    def fit(self, reading: Reading) -> _Trial:
        """The trial of a reading; kept."""
        if reading not in self._fits:
            self._fits[reading] = self._fit(reading)
        return self._fits[reading]

    def wide(self, reading: Reading) -> list[int]:
        """Revolute joints (0-based) whose positions, taken as radians, cover more than a turn."""
        revolute = [i for i in reading.joints_in(RADIANS) if i in self.able and self.model.joints[i].type == "revolute"]
        return [i for i in revolute if turns(self.motion, reading.positions[i]) > 1]

    def _fit(self, reading: Reading) -> _Trial:
        layout, columns, n = self.problem.layout, {}, self.motion.n
        joints: list[JointRows] = []
        for joint, rows in self._rows_of(reading).items():
            columns[len(joints)] = Columns(rows[:-n])
            torque = reading.signs[joint] * rows[-n + reading.torques[joint]]
            weight = 1 / float(np.linalg.norm(torque)) if _is_torque(torque) else 0.0
            every, whole = np.ones(len(torque), dtype=bool), np.zeros(len(torque), dtype=np.intp)
            joints.append(JointRows(torque, every, whole, weight, stretches=(slice(0, len(torque)),)))
        system = LinearSystem.of(joints, [Block("model", columns, layout.lower, layout.upper, near=layout.stated)])
        theta, found = system.least(), np.zeros(n)
        left = zip(joints, system.residual(theta), strict=True)
        found[self.able] = [own.weight * np.linalg.norm(r) if own.weight else np.inf for own, r in left]
        lumps, mix = theta[layout.lumps], self._mix(reading)
        least = least_inertia(self.model, self.motion.changed(lambda p: replace(p, q=mix @ p.q)), lumps)
        return _Trial(found, lumps, least > 0)

    def _mix(self, reading: Reading) -> Array:
        """(n, n) positions in rad of those that are given."""
        sizes = [{RADIANS: 1.0, DEGREES: _DEGREE, MOTOR: 1 / joint.gear_ratio} for joint in self.model.joints]
        scales = np.array([size[unit] for size, unit in zip(sizes, reading.units, strict=True)])
        mix: Array = np.eye(len(scales))[list(reading.positions)] * scales[:, None]
        return mix

    def _rows_of(self, reading: Reading) -> dict[int, Array]:
        """Joint (0-based) with a torque -> (1 + K + n, M): the part without free coefficient, the columns, and the
        torques of all joints in its band; M is at most 1 + K + n."""
        key = reading.positions, reading.units
        if key not in self._rows:
            motion, skew, found = _mixed(self.motion, self._mix(reading)), self.found.skew, {}
            problem = Problem(self.model, motion, self.problem.layout.terms, self.problem.regressors.prediction)
            for i in self.able:
                columns, fixed = problem.rows(i, self.found.shapes)
                torques = [[p.equation(p.delayed(tau, skew), i) for tau in p.tau] for p in motion.pieces_of(i)]
                rows = np.vstack([fixed, columns, np.concatenate(torques, axis=1)])[:, motion.moving(i)]
                found[i] = np.asarray(np.linalg.qr(rows.T, mode="r")).T
            self._rows[key] = found
        return self._rows[key]


def _is_torque(torque: Array) -> bool:
    """Whether it is more than what a filter leaves once the recorded torque has become zero."""
    return float(np.linalg.norm(torque)) > 1e-30


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


# --- the search over readings ---

_EXCHANGES = ((TORQUE,), (POSITION,), (POSITION, TORQUE))
"""What of two joints may be exchanged: drivers log joints in the order of their names."""
_Change = tuple[Reading, Sequence[int], float]
"""A reading, the joints (0-based) that it concerns, and the part to which the error of each must fall."""


def _all_or_one(joints: Sequence[int]) -> set[tuple[int, ...]]:
    return {tuple(joints), *((i,) for i in joints)} if joints else set()


class _Search:
    """From the data as they are to the reading that puts them right.

    errors   (n,) relative errors under a reading
    before   (n,) those of the data as they are, in the fit or in a trial, whichever are smaller: a trial weights joints
             by their torques, which lowers an error where other weights made a joint pay for its neighbours
    """

    def __init__(self, trials: _Trials, errors: Callable[[Reading], Array], fitted: Array) -> None:
        self.trials, self.able, self.errors = trials, trials.able, errors
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
            low, high = sorted(self.errors(r)[i] for r in (degrees, motors))
            if self.trials.model.joints[i].gear_ratio > SUSPECTED_RATIO and low > TURNED_FALLS_TO * high:
                reading, alike = degrees, alike | {i}
        return reading, alike

    def likeliest(self) -> Reading:
        """The single mistake that the errors alone show."""
        found = self._best(self._exchanged()) or self._best(self._scaled()) or self._best(self._turned())
        return found or self.reading

    def _best(self, changes: Iterable[_Change]) -> Reading | None:
        """Of the readings that lower the errors enough, the one that explains most of the torques."""
        best, least = None, self._mean_square(self.before)
        for reading, joints, falls_to in changes:
            errors, concerned = self.errors(reading), list(joints)
            size = self._mean_square(errors)
            if size < least and np.all(errors[concerned] < falls_to * self.before[concerned]):
                best, least = reading, size
        return best

    def _mean_square(self, errors: Array) -> float:
        return float(np.mean(errors[self.able] ** 2))

    def _turned(self) -> Iterator[_Change]:
        """The other sign of the torque of one joint, or of all."""
        for joints in _all_or_one(self.able):
            yield self.reading.turned(joints), joints, TURNED_FALLS_TO

    def _some_turned(self) -> Iterator[_Change]:
        """The other sign of the torques of some joints, where there are few."""
        few = 7  # whose 127 combinations of signs take less than a second
        for count in range(2, len(self.able)) if len(self.able) <= few else ():
            for some in combinations(self.able, count):
                yield self.reading.turned(some), some, EXCHANGED_FALLS_TO

    def _scaled(self) -> Iterator[_Change]:
        """Positions in degrees, or of the motor: of one joint that covers more than a turn, or of all that do."""
        for joints in _all_or_one(self.trials.wide(self.reading)):
            yield self.reading.measured_in(DEGREES, joints), joints, TURNED_FALLS_TO
            if min(self.trials.model.joints[i].gear_ratio for i in joints) > SUSPECTED_RATIO:
                yield self.reading.measured_in(MOTOR, joints), joints, TURNED_FALLS_TO

    def _exchanged(self) -> Iterator[_Change]:
        """Two joints in each other's place."""
        doubtful = [i for i in self.able if self.before[i] > SUSPECTED_FROM]
        for (i, j), what in product(combinations(doubtful, 2), _EXCHANGES):
            yield self.reading.exchanged(i, j, what), (i, j), EXCHANGED_FALLS_TO

    def _pairs(self) -> Iterator[_Change]:
        """Joints that are exchanged or in another unit, and degrees or another sign besides."""
        wide = self.trials.wide(self.reading)
        for reading, joints, _ in self._exchanged():
            if wide:
                yield reading.measured_in(DEGREES, wide), sorted({*joints, *wide}), EXCHANGED_FALLS_TO
            yield from self._with_a_sign(reading, joints)
        for reading, joints, _ in self._scaled():
            yield from self._with_a_sign(reading, joints)

    def _with_a_sign(self, reading: Reading, joints: Sequence[int]) -> Iterator[_Change]:
        for some in _all_or_one(self.able):
            yield reading.turned(some), sorted({*joints, *some}), EXCHANGED_FALLS_TO
