"""Ways to read the columns of a recording, and what a fit of the model file's structure leaves of the torques in each.

A way that the data were meant to be read in is a signed permutation of the torques, a permutation of the positions, and
degrees at some of them. For each choice of positions the equations of motion are set up once; a torque's sign and place
only choose among moments, so that trying them costs one small system each.

Source: separable least squares, Golub & Pereyra 1973; that D(q) is positive definite, Siciliano, Sciavicco, Villani &
Oriolo, Robotics, 2009, chapter 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import pi

import numpy as np
from numpy.typing import NDArray

from runtime.identification.identify import Identification
from runtime.identification.problem import Problem, least_inertia
from runtime.identification.settings import LEAST_RECORDED, SUSPICION_SAMPLES
from runtime.model.catalogue import JointInfo
from runtime.motion.motion import Motion
from runtime.motion.piece import Piece
from runtime.recordings.columns import UNITS
from runtime.regression.bounded import bounded

Array = NDArray[np.float64]

DEGREE = UNITS["deg"][1]
"""rad."""
POSITION, TORQUE = "q", "tau"
"""What a recording has of each joint, as its columns are called."""


@dataclass(frozen=True)
class Reading:
    """Of each joint (0-based), whose columns its position and its torque are, and how these are to be taken.

    signs     of the torques, +1 or −1
    degrees   joints whose positions are
    motors    joints whose positions are the motor's, before the gear
    """

    positions: tuple[int, ...]
    torques: tuple[int, ...]
    signs: tuple[int, ...]
    degrees: frozenset[int] = frozenset()
    motors: frozenset[int] = frozenset()

    @classmethod
    def given(cls, n: int) -> Reading:
        """As the file says."""
        return cls(tuple(range(n)), tuple(range(n)), (1,) * n)

    def turned(self, joints: Sequence[int]) -> Reading:
        """With the other sign of these joints' torques."""
        return replace(self, signs=tuple(-s if i in joints else s for i, s in enumerate(self.signs)))

    def in_degrees(self, joints: Sequence[int]) -> Reading:
        """With positions of these joints in degrees."""
        return replace(self, degrees=self.degrees | set(joints), motors=self.motors - set(joints))

    def at_motors(self, joints: Sequence[int]) -> Reading:
        """With positions of these joints' motors."""
        return replace(self, motors=self.motors | set(joints), degrees=self.degrees - set(joints))

    def exchanged(self, one: int, other: int, what: Sequence[str]) -> Reading:
        """With positions, torques or both of two joints in each other's place."""

        def swapped(places: tuple[int, ...]) -> tuple[int, ...]:
            return tuple(places[{one: other, other: one}.get(i, i)] for i in range(len(places)))

        found = self
        if POSITION in what:
            degrees, motors = (
                frozenset({one: other, other: one}.get(i, i) for i in joints) for joints in (self.degrees, self.motors)
            )
            found = replace(found, positions=swapped(found.positions), degrees=degrees, motors=motors)
        if TORQUE in what:
            found = replace(found, torques=swapped(found.torques), signs=swapped(found.signs))
        return found


@dataclass(frozen=True)
class _Equations:
    """One joint's equations of motion for one way to read the positions, reduced to what a fit needs.

    gram   (K, K) of the regressor      fixed  (K,) its product with the part without free coefficient
    cross  (K, n) with each joint's torque at these rows
    power, mixed, own   (n,), (n,), scalar: squares of the torques, their products with the fixed part, its square
    rows   how many these are
    """

    gram: Array
    fixed: Array
    cross: Array
    power: Array
    mixed: Array
    own: float
    rows: int


class Readings:
    """The structure of an identification, refitted on an excerpt of its motion under one reading after another.

    any_inertia   whether one that no arm has is believed as well
    able          joints (0-based) whose torque is there in the excerpt; of no other can anything be told
    """

    def __init__(self, identification: Identification, any_inertia: bool = False) -> None:
        self.model, self.fit, self.any_inertia = identification.model, identification.fit, any_inertia
        self.motion, _ = identification.motion.excerpt(SUSPICION_SAMPLES)
        self.able = [i for i in range(self.motion.n) if self._torque_is_there(i)]
        self._terms = identification.problem.layout.terms
        self._prediction = identification.problem.regressors.prediction
        self._layout = identification.problem.layout
        self._tables: dict[tuple[tuple[int, ...], frozenset[int], frozenset[int]], dict[int, _Equations]] = {}
        self._errors: dict[Reading, Array] = {}
        self._coefficients: dict[Reading, Array] = {}

    def errors(self, reading: Reading) -> Array:
        """(n,) relative errors, every joint weighted by its torque; infinite where no arm has such an inertia, or where
        another joint's torque is none while this one moves."""
        if reading not in self._errors:
            self._errors[reading] = self._solved(reading)
        return self._errors[reading]

    def lumps(self, reading: Reading) -> Array:
        """Base inertial parameters under a reading."""
        self.errors(reading)
        return self._coefficients[reading][self._layout.lumps]

    def _solved(self, reading: Reading) -> Array:
        equations = self._table(reading)
        size, errors = self._layout.size, np.zeros(self.motion.n)
        gram, moment = np.zeros((size, size)), np.zeros(size)
        right = {}
        for i, joint in equations.items():
            source, sign = reading.torques[i], reading.signs[i]
            if joint.power[source] <= joint.rows * LEAST_RECORDED**2:
                errors[i] = np.inf
                continue
            weight = 1 / joint.power[source]
            right[i] = (
                weight,
                sign * joint.cross[:, source] - joint.fixed,
                joint.power[source] - 2 * sign * joint.mixed[source] + joint.own,
            )
            gram += weight * joint.gram
            moment += weight * right[i][1]
        theta = bounded(gram, moment, self._layout.lower, upper=self._layout.upper, near=self._layout.stated)
        self._coefficients[reading] = theta
        if not self.any_inertia and not self._possible(reading, theta[self._layout.lumps]):
            return np.full(self.motion.n, np.inf)
        for i, (weight, product, power) in right.items():
            left = power - 2 * theta @ product + theta @ equations[i].gram @ theta
            errors[i] = float(np.sqrt(max(weight * left, 0.0)))
        return errors

    def _torque_is_there(self, joint: int) -> bool:
        torque = self.motion.torque(joint, self.fit.skew)[self.motion.moving(joint)]
        return float(torque @ torque) > len(torque) * LEAST_RECORDED**2

    def _possible(self, reading: Reading, lumps: Array) -> bool:
        """Whether an arm can have such an inertia."""
        mix = _mix(reading, self.model.joints)
        there = self.motion.changed(lambda p: replace(p, q=mix @ p.q))
        return least_inertia(self.model, there, lumps)[0] > 0

    def _table(self, reading: Reading) -> dict[int, _Equations]:
        key = reading.positions, reading.degrees, reading.motors
        if key not in self._tables:
            motion = _moved(self.motion, _mix(reading, self.model.joints))
            self._tables[key] = self._equations(Problem(self.model, motion, self._terms, self._prediction))
        return self._tables[key]

    def _equations(self, problem: Problem) -> dict[int, _Equations]:
        motion = problem.motion
        of_one = [motion.changed(partial(_all_torques_of, j)) for j in range(motion.n)]
        found = {}
        for i in self.able:
            use = motion.moving(i)
            x, fixed = (rows[..., use] for rows in problem.rows(i, self.fit.shapes))
            torques = np.array([other.torque(i, self.fit.skew)[use] for other in of_one])
            power = np.sum(torques**2, axis=1)
            own = float(fixed @ fixed)
            found[i] = _Equations(
                x @ x.T, x @ fixed, x @ torques.T, power=power, mixed=torques @ fixed, own=own, rows=len(fixed)
            )
        return found


def turns(motion: Motion, joint: int) -> float:
    """Over how many turns a joint (0-based) moves, its position read as it is given."""
    low = min(float(p.q[joint].min()) for p in motion.pieces)
    return (max(float(p.q[joint].max()) for p in motion.pieces) - low) / (2 * pi)


def _mix(reading: Reading, joints: Sequence[JointInfo]) -> Array:
    """(n, n) positions in rad of those that are given."""
    mix = np.eye(len(reading.positions))[list(reading.positions)]
    mix[sorted(reading.degrees)] *= DEGREE
    for i in reading.motors:
        mix[i] /= joints[i].gear_ratio
    return mix


def _moved(motion: Motion, mix: Array) -> Motion:
    """The motion with its positions mixed so."""
    if np.array_equal(mix, np.eye(motion.n)):
        return motion

    def change(p: Piece) -> Piece:
        q, qd, qdd, slow = (mix @ x for x in (p.q, p.qd, p.qdd, p.slow))
        return replace(p, q=q, qd=qd, qdd=qdd, slow=slow)

    standing = np.where(np.isinf(motion.standstill), 0.0, motion.standstill)
    standstill = np.where(np.isinf(motion.standstill), np.inf, mix @ standing)
    return motion.changed(change).resting(standstill, motion.quiet)


def _all_torques_of(joint: int, p: Piece) -> Piece:
    """With one joint's torque (0-based) at all joints."""
    return replace(p, tau=np.tile(p.tau[joint], (len(p.tau), 1)))
