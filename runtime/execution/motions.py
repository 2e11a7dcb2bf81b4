"""A motion from a file as a trajectory that a controller follows: checked against rate and limits, then written as
polynomials through its samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, comb
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from runtime.arrays import Array
from runtime.documents.plans import PlayedEntry
from runtime.experiments.pieces import Envelope
from runtime.model.loader import JointInfo, Model
from runtime.model.terms import check_complete, structure
from runtime.planning.scenario import is_spring
from runtime.planning.settings import LEAST_POSITION_EXCESS
from runtime.planning.trajectory import Phase, Trajectory, TrajectoryError, read
from runtime.simulation.motion_file import MotionFile, is_motion, read_motion_file
from runtime.wording import number

UNCHECKED = "NOT CHECKED:"
"""Begins a comment of a motion's file that says what nothing keeps the arm from."""
_FOREIGN = "The file does not say what was checked: collisions, floor and surroundings were not."
_GAP = 3.0
"""A step between samples is a gap if it is longer than this multiple of the median."""
_BETWEEN = {"revolute": 0.01, "prismatic": 0.002}
"""Largest difference in rad, m between the motion and the one through every second sample: beyond it, nothing is known
of the motion between the samples."""
_OVER = 1.02
"""Times a joint's speed limit, up to which neighbouring samples may be apart: they are rounded."""
_JUMPS = 0.5
"""Change of the speed from one step to the next, part of it, by which a step is a jump and no fast motion."""
_MOST_SLOWED = 20.0
"""Larger ratios to a limit are mistakes in the file, and slower motion is no remedy."""
_JERKED = 2.0
"""Times a joint's usual acceleration by which it may change from one sample to the next."""
_AT_REST = 0.01
"""Part of a joint's usual speed at which a motion may begin and end."""

DEGREE = 15
"""Of the polynomials of a phase: three conditions at either end, and ten points between."""
_LONGEST = 0.512
"""s by the file's time; a phase is halved until the polynomials agree with the samples."""
_SHORTEST = 0.016
"""s; shortest phase by the file's time."""
_CLOSE = {"revolute": 2e-5, "prismatic": 1e-5}
"""rad, m; largest distance between polynomials and samples: a fraction of a geared joint's tracking error."""
_ROUNDING = 1e-6
"""Part of a step by which a motion may be longer than a whole number of steps."""
_CLOSE_ACCELERATION = 0.02
"""Largest difference in acceleration, part of the joint's largest: it is fed forward."""


@dataclass(frozen=True)
class PlayedMotion:
    """A motion on an arm, at a part `speed` of the pace of its file."""

    model: Model
    file: MotionFile
    speed: float

    @property
    def unchecked(self) -> list[str]:
        """What nothing keeps the arm from, as its file says: sentences."""
        said = [line.removeprefix(UNCHECKED).strip() for line in self.file.comments if line.startswith(UNCHECKED)]
        return said or [_FOREIGN]

    @property
    def rate(self) -> float:
        """Hz; of the samples as they are played."""
        return float(self.speed / np.median(np.diff(self.file.t)))

    def check(self) -> None:
        """Raise TrajectoryError, with the line, if the samples are too far apart, jump, or do not begin and end at
        rest."""
        self._check_sampling()
        for i, joint in enumerate(self.model.joints):
            self._check_range(i, joint)
            self._check_steps(i, joint)
            self._check_ends(i, joint)

    def _line(self, k: int) -> str:
        return f"{self.file.path} line {self.file.first + k}"

    def _check_sampling(self) -> None:
        t, q = self.file.t, self.file.q
        steps = np.diff(t)
        k = int(np.argmax(steps))
        if steps[k] > _GAP * np.median(steps):
            raise TrajectoryError(
                f"{self._line(k + 1)}: {steps[k]:.4g} s after the sample before it, the others are "
                f"{np.median(steps):.4g} s apart; expected a motion without gaps"
            )
        if len(t) < 2 * len(_COARSE):
            return
        coarse = make_interp_spline(t[::2], q[:, ::2].T, k=len(_COARSE) - 1)(t[1:-1:2]).T
        apart = np.abs(coarse - q[:, 1:-1:2])
        for i, joint in enumerate(self.model.joints):
            k, most = int(np.argmax(apart[i])), _BETWEEN[joint.type]
            if apart[i, k] > most:
                raise TrajectoryError(
                    f"{self._line(2 * k + 1)}: q{i + 1} is {apart[i, k]:.3g} {joint.position_unit} from where its "
                    f"neighbours put it, at {1 / np.median(steps):.4g} Hz; expected at most {most:g}: sample the "
                    "motion faster, or smooth it"
                )

    def _check_range(self, i: int, joint: JointInfo) -> None:
        if joint.position_limits is None:
            return
        low, high = joint.position_limits
        beyond = np.maximum(low - self.file.q[i], self.file.q[i] - high)
        k = int(np.argmax(beyond))
        if beyond[k] > LEAST_POSITION_EXCESS * max(abs(low), abs(high)):
            raise TrajectoryError(
                f"{self._line(k)}: q{i + 1} is {self.file.q[i, k]:.4g} {joint.position_unit}, outside the joint's "
                f"range of {low:.4g} to {high:.4g}"
            )

    def _check_steps(self, i: int, joint: JointInfo) -> None:
        """Speed and acceleration from sample to sample, by differences."""
        steps = np.diff(self.file.t) / self.speed
        rate = np.diff(self.file.q[i]) / steps
        unit = joint.position_unit
        k, limit = int(np.argmax(np.abs(rate))), joint.speed_limit
        if limit is not None and (fastest := float(abs(rate[k]))) > _OVER * limit:
            jumps = abs(rate[k] - rate[k - 1]) > _JUMPS * fastest
            raise TrajectoryError(
                f"{self._line(k + 1)}: q{i + 1} steps by {self.file.q[i, k + 1] - self.file.q[i, k]:.3g} {unit} in "
                f"{1e3 * steps[k]:.3g} ms, {fastest:.3g} {unit}/s; the joint's limit is {limit:.3g}"
                f"{'' if jumps else self._remedy(fastest / limit)}"
            )
        acceleration = np.diff(rate) / ((steps[1:] + steps[:-1]) / 2)
        change = np.abs(np.diff(acceleration))
        usual = Envelope.of(joint).acceleration
        k = int(np.argmax(change))
        if change[k] > _JERKED * usual:
            raise TrajectoryError(
                f"{self._line(k + 2)}: the acceleration of q{i + 1} changes by {change[k]:.3g} {unit}/s^2 from one "
                f"sample to the next, more than {_JERKED * usual:.3g}; expected smooth positions with enough digits "
                f"for {self.rate:.4g} Hz{self._remedy(float(np.sqrt(change[k] / (_JERKED * usual))))}"
            )

    def _remedy(self, ratio: float) -> str:
        return f"; or --speed {number(0.98 * self.speed / ratio, 2)}" if ratio < _MOST_SLOWED else ""

    def _check_ends(self, i: int, joint: JointInfo) -> None:
        usual, ends = Envelope.of(joint).speed, self.file.spline.derivative()([0.0, self.file.seconds])[:, i]
        for k, what, speed in ((0, "begins", ends[0]), (len(self.file.t) - 1, "ends", ends[1])):
            if abs(self.speed * speed) > _AT_REST * usual:
                raise TrajectoryError(
                    f"{self._line(k)}: the motion {what} while q{i + 1} moves at {self.speed * speed:.3g} "
                    f"{joint.position_unit}/s; expected it to begin and end at rest"
                )

    def sampled(self, rate: float) -> tuple[Array, Array, Array, Array]:
        """Times (N,) from 0 on, positions, speeds and accelerations (n, N) at a rate, Hz; the motion ends
        with or within the last step."""
        seconds = self.file.seconds / self.speed
        t = np.arange(ceil(seconds * rate - _ROUNDING) + 1) / rate
        within = np.minimum(self.speed * t, self.file.seconds)
        q, qd, qdd = (np.ascontiguousarray(self.file.spline(within, nu=k).T) * self.speed**k for k in range(3))
        # Rests are exact: ROS 2's controllers refuse a motion that does not end at rest.
        qd[:, [0, -1]] = qdd[:, [0, -1]] = 0.0
        return t, q, qd, qdd

    def document(self, trajectory: Trajectory) -> PlayedEntry:
        """Of the motion as `trajectory` follows it."""
        return PlayedEntry(
            samples=len(self.file.t),
            rate=self.rate,
            controller_rate=1.0 / (self._period / self.speed),
            seconds=trajectory.duration,
            phases=len(trajectory.phases),
        )

    # --- as polynomials ---

    def trajectory(self) -> Trajectory:
        """Polynomials through the samples, with the springs and the contact of the model. Raises ModelError where one
        of them lacks a value."""
        terms = structure(self.model)
        check_complete(self.model, terms)
        springs = {term: dict(v) for term, v in terms.items() if is_spring(self.model.library[term.effect])}
        contact = {t.effect: dict(v) for t, v in terms.items() if self.model.library[t.effect].scope == "contact"}
        return Trajectory(
            arm=self.model.name,
            scenario=self.file.path.name,
            phases=tuple(self._phases()),
            periodic=False,
            elbow=1.0,
            friction=True,
            springs={term.joint: values for term, values in springs.items() if term.joint is not None},
            contact=contact,
            effects={term.joint: term.effect for term in springs if term.joint is not None},
        )

    def _phases(self) -> Iterator[Phase]:
        """As long ones as agree with the samples; all but the last last whole control periods."""
        fit, period = _Fit.of(self.file.spline, self.model.joints, self.file.seconds), self._period
        begin = 0.0
        while (left := self.file.seconds - begin) > 0.5 * period:
            seconds = min(_LONGEST, left)
            while True:
                whole = period * max(1, round(seconds / period))
                seconds = left if whole > left - 0.5 * period else whole
                points, agrees = fit.points(begin, seconds)
                if agrees or seconds <= max(_SHORTEST, period):
                    break
                seconds /= 2
            yield Phase("q", seconds / self.speed, points)
            begin += seconds

    @property
    def _period(self) -> float:
        rate = None if self.model.controller is None else self.model.controller["rate"]
        return self.speed / rate if rate else float(np.median(np.diff(self.file.t)))


_COARSE = range(6)


def read_either(path: Path, model: Model, speed: float = 1.0) -> tuple[Trajectory, PlayedMotion | None]:
    """A trajectory, or a motion's file and the trajectory through its samples; by the file's content, at a part `speed`
    of its pace. Raises SimulationError, TrajectoryError."""
    if not is_motion(path):
        return slower(read(path, model), speed), None
    played = read_played(path, model, speed)
    return played.trajectory(), played


def read_played(path: Path, model: Model, speed: float) -> PlayedMotion:
    """A motion's file for an arm, checked. Raises SimulationError, TrajectoryError."""
    found = PlayedMotion(model, read_motion_file(path, model.n), speed)
    found.check()
    return found


def slower(trajectory: Trajectory, speed: float) -> Trajectory:
    phases = tuple(replace(phase, duration=phase.duration / speed) for phase in trajectory.phases)
    return replace(trajectory, phases=phases)


@dataclass(frozen=True)
class _Fit:
    """Bernstein polynomials of DEGREE to a spline: position, rate and acceleration agree at both ends, the points
    between are those of least squares.

    close, close_acceleration   (n,) largest differences
    """

    splines: tuple[BSpline, BSpline, BSpline]
    close: Array
    close_acceleration: Array

    @classmethod
    def of(cls, spline: BSpline, joints: Sequence[JointInfo], seconds: float) -> _Fit:
        second = spline.derivative(2)
        t = np.linspace(0.0, seconds, 1 + round(seconds / _SHORTEST))
        largest = np.abs(second(t)).max(axis=0)
        usual = [Envelope.of(joint).acceleration for joint in joints]
        return cls(
            (spline, spline.derivative(), second),
            np.array([_CLOSE[joint.type] for joint in joints]),
            _CLOSE_ACCELERATION * np.maximum(largest, 0.01 * np.array(usual)),
        )

    def points(self, begin: float, seconds: float) -> tuple[Array, bool]:
        """(n, DEGREE + 1) control points of a phase, and whether they agree with the samples."""
        basis, d = _basis(), DEGREE
        q, qd, qdd = (spline(begin + seconds * np.array([0.0, 1.0])) for spline in self.splines)
        first, second = seconds * qd / d, seconds**2 * qdd / (d * (d - 1))
        points = np.zeros((d + 1, q.shape[1]))
        points[0], points[1], points[2] = q[0], q[0] + first[0], q[0] + 2 * first[0] + second[0]
        points[d], points[d - 1], points[d - 2] = q[1], q[1] - first[1], q[1] - 2 * first[1] + second[1]
        wanted = self.splines[0](begin + seconds * basis.u)
        points[3 : d - 2] = basis.inner @ (wanted - basis.values @ points)
        apart = np.abs(basis.values @ points - wanted).max(axis=0)
        curved = basis.second @ np.diff(points, 2, axis=0) * d * (d - 1) / seconds**2
        apart_acceleration = np.abs(curved - self.splines[2](begin + seconds * basis.u)).max(axis=0)
        agrees = (apart <= self.close).all() and (apart_acceleration <= self.close_acceleration).all()
        return points.T, bool(agrees)


@dataclass(frozen=True)
class _Basis:
    """Bernstein polynomials at places u (K,) of a phase: values (K, d + 1), those of degree d - 2 (K, d - 1), and the
    points between the ends from what is left of the values, (d - 5, K)."""

    u: Array
    values: Array
    second: Array
    inner: Array


@lru_cache(maxsize=1)
def _basis() -> _Basis:
    u = (1 - np.cos(np.linspace(0.0, np.pi, 4 * DEGREE + 1))) / 2
    values = _bernstein(DEGREE, u)
    inner = np.linalg.pinv(values[:, 3 : DEGREE - 2]).astype(np.float64)
    return _Basis(u, values, _bernstein(DEGREE - 2, u), inner)


def _bernstein(degree: int, u: Array) -> Array:
    return np.stack([comb(degree, k) * u**k * (1 - u) ** (degree - k) for k in range(degree + 1)], axis=1)
