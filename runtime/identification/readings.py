"""Other readings of a recording's columns, and fits of an identification's structure under them.

A reading says how the columns are to be taken: another sign, degrees read as radians, motors' angles, exchanged joints.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from runtime.arrays import Array
from runtime.identification.fit import Fit
from runtime.identification.problem import Problem, least_inertia
from runtime.identification.settings import EXCERPT, WORK_TELLS
from runtime.motion.motion import Motion
from runtime.motion.piece import Piece
from runtime.recordings.columns import UNITS
from runtime.regression.rows import Block, Columns, JointRows
from runtime.regression.system import LinearSystem

POSITION, TORQUE = "q", "tau"
"""Columns of a recording."""
RADIANS, DEGREES, MOTOR = "radians", "degrees", "motor"
"""What a position is: of the joint in rad (m), of the joint in degrees, or of the motor before the gear in rad."""
DEGREE = UNITS["deg"][1]


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


def turns(motion: Motion, joint: int) -> float:
    """Range of a joint's position (0-based) in turns, read as it is given."""
    low = min(float(p.q[joint].min()) for p in motion.pieces)
    return (max(float(p.q[joint].max()) for p in motion.pieces) - low) / (2 * pi)


def moving_joints(fit: Fit) -> list[int]:
    """Joints (0-based) that move; none where the user's own model gives the rigid torque."""
    motion = fit.motion
    return [] if motion.rigid_given else [i for i in range(motion.n) if motion.moving(i).any()]


@dataclass(frozen=True)
class TrialFit:
    """A fit under a reading: (n,) relative errors of the torques, infinite where a joint moves without one, base
    inertial parameters, and whether some arm has such an inertia."""

    errors: Array
    lumps: Array
    physical: bool

    @property
    def physical_errors(self) -> Array:
        """(n,) relative errors; infinite where no arm has such an inertia."""
        return self.errors if self.physical else np.full_like(self.errors, np.inf)


def _last_at_start(q: Array) -> int:
    """Number of samples of a position (N,) until it is for the last time where it began."""
    crossed = np.flatnonzero(np.diff(np.sign(q - q[0]) >= 0))
    return int(crossed[-1]) + 1 if len(crossed) else 0


class Trials:
    """Fits of an identification's structure on an excerpt of its motion, joints weighted by their torques.

    The equations are set up once for each way to read the positions, and an orthogonal transformation leaves as many
    rows as they have columns, with the same squared errors (Golub & Van Loan, Matrix Computations, QR). Sign and place
    of a torque only choose another right-hand side, so that a trial is one small system.
    able   joints (0-based) with a torque in the excerpt; of others nothing can be found
    """

    def __init__(self, fit: Fit) -> None:
        self.model, self.problem, self.found = fit.model, fit.problem, fit
        self.motion, _ = fit.motion.excerpt(EXCERPT)
        every = range(self.motion.n)
        self.able = [i for i in every if _is_torque(self.motion.torque(i, self.found.skew)[self.motion.moving(i)])]
        self._rows: dict[tuple[tuple[int, ...], tuple[str, ...]], dict[int, Array]] = {}
        self._systems: dict[tuple[tuple[int, ...], tuple[str, ...]], LinearSystem] = {}
        self._fits: dict[Reading, TrialFit] = {}

    def fit(self, reading: Reading) -> TrialFit:
        """The trial of a reading; kept."""
        if reading not in self._fits:
            self._fits[reading] = self._fit(reading)
        return self._fits[reading]

    def equation(self, reading: Reading, joint: int) -> tuple[Array, Array, Array]:
        """A joint's (0-based) columns (K, M), acceleration (M,) and torque (M,) less what has no free coefficient, as
        few rows as say the same; their norms are RMS values."""
        rows, size = self._rows_of(reading)[joint], self.problem.layout.size
        torque = reading.signs[joint] * rows[reading.torques[joint] - self.motion.n] - rows[0]
        scale = 1 / np.sqrt(np.count_nonzero(self.motion.moving(joint)))
        return scale * rows[1 : 1 + size], scale * rows[1 + size], scale * torque

    def driving(self) -> set[int]:
        """Joints (0-based) whose torque did positive work on their own motion, as far as it came back to its start: its
        sign is right, as only friction takes power over a closed way."""
        work, effort = np.zeros(self.motion.n), np.zeros(self.motion.n)
        for piece in self.found.motion.pieces:
            for i, (q, qd, tau) in enumerate(zip(piece.q, piece.qd, piece.tau, strict=True)):
                way = slice(0, _last_at_start(q))
                work[i] += tau[way] @ qd[way]
                effort[i] += np.linalg.norm(tau[way]) * np.linalg.norm(qd[way])
        return set(np.flatnonzero(work > WORK_TELLS * effort).tolist())

    def wide(self, reading: Reading) -> list[int]:
        """Revolute joints (0-based) whose positions, taken as radians, cover more than a turn."""
        revolute = [i for i in reading.joints_in(RADIANS) if i in self.able and self.model.joints[i].type == "revolute"]
        return [i for i in revolute if turns(self.motion, reading.positions[i]) > 1]

    def _fit(self, reading: Reading) -> TrialFit:
        layout, columns, n = self.problem.layout, {}, self.motion.n
        joints: list[JointRows] = []
        for joint, rows in self._rows_of(reading).items():
            columns[len(joints)] = Columns(rows[: 1 + layout.size])
            torque = reading.signs[joint] * rows[-n + reading.torques[joint]]
            weight = 1 / float(np.linalg.norm(torque)) if _is_torque(torque) else 0.0
            every, whole = np.ones(len(torque), dtype=bool), np.zeros(len(torque), dtype=np.intp)
            joints.append(JointRows(torque, every, whole, weight))
        block = Block("model", columns, layout.lower, layout.upper, near=layout.stated)
        key = reading.positions, reading.units
        system = self._systems[key] = LinearSystem.of(joints, [block], self._systems.get(key))
        theta, found = system.least(), np.zeros(n)
        left = zip(joints, system.residual(theta), strict=True)
        found[self.able] = [own.weight * np.linalg.norm(r) if own.weight else np.inf for own, r in left]
        lumps, mix = theta[layout.lumps], self._mix(reading)
        least = least_inertia(self.model, [mix @ p.q for p in self.motion.pieces], lumps)
        return TrialFit(found, lumps, least > 0)

    def _mix(self, reading: Reading) -> Array:
        """(n, n) positions in rad of those that are given."""
        sizes = [{RADIANS: 1.0, DEGREES: DEGREE, MOTOR: 1 / joint.gear_ratio} for joint in self.model.joints]
        scales = np.array([size[unit] for size, unit in zip(sizes, reading.units, strict=True)])
        mix: Array = np.eye(len(scales))[list(reading.positions)] * scales[:, None]
        return mix

    def _rows_of(self, reading: Reading) -> dict[int, Array]:
        """Joint (0-based) with a torque -> (2 + K + n, M): the part without free coefficient, the columns, the
        acceleration, and the torques of all joints in its band; M is at most 2 + K + n."""
        key = reading.positions, reading.units
        if key not in self._rows:
            motion, skew, found = _mixed(self.motion, self._mix(reading)), self.found.skew, {}
            problem = Problem(self.model, motion, self.problem.layout.terms, self.problem.regressors.prediction)
            for i in self.able:
                columns, fixed = problem.rows(i, self.found.shapes)
                torques = [
                    [p.equation(p.torque_late(j, skew), i) for j in range(len(p.tau))] for p in motion.pieces_of(i)
                ]
                own = problem.regressors.acceleration(i)
                rows = np.vstack([fixed, columns, own, np.concatenate(torques, axis=1)])[:, motion.moving(i)]
                found[i] = np.asarray(np.linalg.qr(rows.T, mode="r")).T
            self._rows[key] = found
        return self._rows[key]


def _is_torque(torque: Array) -> bool:
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
