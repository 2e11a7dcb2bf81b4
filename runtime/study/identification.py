"""Table I: the identification experiment (5), (6) on the simulated arm, and the friction found in its recordings.

The printed parameters are hidden in the arm; the fit knows which terms (4) has, and none of their values. As in the
paper one joint after the other follows cosines of several speeds, under PD control with the frictionless inverse
dynamics, and friction is what the motors gave beyond those.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, pi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly

from runtime.estimation.estimate import Estimate
from runtime.estimation.identify import Identification, identify_motion, prepared
from runtime.estimation.regressors import Regressors
from runtime.estimation.settings import NOMINAL_SKEW
from runtime.execution.execute import execute
from runtime.execution.options import ExecutionSettings
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term
from runtime.motion.band import choose_band
from runtime.motion.filters import differentiator
from runtime.planning.trajectory import Phase, Trajectory
from runtime.recordings.recording import Recording
from runtime.simulation.plant import PlantError
from runtime.simulation.simulate import Hidden
from runtime.study.options import TRIALS
from runtime.study.published import PRECISION, TABLE_1

Array = NDArray[np.float64]

AMPLITUDE = pi / 4
"""rad, a of (5); assumed: the link sweeps 90 degrees, as it does in scenario 1."""
START = 0.0
"""rad, q_i0 of (5); assumed: the straight arm turns away from where the plate stands."""
SECONDS = 10.0
"""Of motion that each trial has at least, besides the cycle that runs it in; assumed."""
_DERIVATIVES = 7
"""Of half a cosine, that its polynomial has at both ends: degree 13, within 1e-9 rad."""

PLACES: Mapping[str, tuple[str, str]] = {
    "positive": ("coulomb_asymmetric", "positive"),
    "negative": ("coulomb_asymmetric", "negative"),
    "viscous": ("viscous", "coefficient"),
    "cubic": ("viscous_cubic", "coefficient"),
}
"""Effect and parameter of each column of Table I."""


# --- the experiment ---


@dataclass(frozen=True)
class Cosine:
    """A joint (1-based) on q_i0 + a (1 + cos ωt), the others at rest at zero; speed: the largest, a ω, rad/s."""

    joint: int
    speed: float

    def __str__(self) -> str:
        return f"joint {self.joint} at {self.speed:g} rad/s"

    @property
    def omega(self) -> float:
        """rad/s."""
        return self.speed / AMPLITUDE

    def trajectory(self, model: Model) -> Trajectory:
        """One period, in two polynomials: there and back."""
        half = pi / self.omega
        # The derivatives of cos at 0 are 1, 0, -1, 0, ...; those at pi are their negatives.
        swing = [AMPLITUDE * self.omega**k * (1, 0, -1, 0)[k % 4] for k in range(_DERIVATIVES)]
        top = [START + AMPLITUDE + swing[0], *swing[1:]]
        bottom = [START + AMPLITUDE - swing[0], *(-x for x in swing[1:])]
        there = BPoly.from_derivatives([0.0, half], [top, bottom]).c[:, 0]
        phases = tuple(self._phase(model, half, points) for points in (there, there[::-1]))
        name = f"identification of {self}"
        return Trajectory(model.name, name, phases, periodic=True, elbow=1.0, friction=False, springs={}, contact={})

    def _phase(self, model: Model, duration: float, points: Array) -> Phase:
        rows = np.zeros((model.n, len(points)))
        rows[self.joint - 1] = points
        return Phase("q", duration, rows)


COSINES = tuple(Cosine(joint, speed) for joint, row in enumerate(TABLE_1, 1) for speed in row.speeds)
"""Those of Table I."""


def printed() -> list[Hidden]:
    """Table I as the arm has it: the model file's cubic term of joint 4 is another."""
    found: Structure = {}
    for joint, row in enumerate(TABLE_1, 1):
        for column, (effect, parameter) in PLACES.items():
            found.setdefault(Term(effect, joint), {})[parameter] = getattr(row, column)
    return [Hidden(term, values) for term, values in found.items()]


def record(
    model: Model,
    controller: Path,
    cosines: Sequence[Cosine] = COSINES,
    trials: int = TRIALS,
    seconds: float = SECONDS,
    done: Callable[[Cosine], None] = lambda _: None,
) -> dict[Cosine, Recording]:
    """The experiment; friction is not compensated, and no spring is mounted.

    controller   directory of the arm's compiled controller
    done         called after each cosine
    Raises PlantError where the arm stops.
    """
    found = {}
    for seed, cosine in enumerate(cosines):
        trajectory = cosine.trajectory(model)
        cycles = ceil(seconds / trajectory.duration)
        settings = ExecutionSettings(trials, cycles, seed, friction_compensation=False)
        made = execute(model, controller, trajectory, settings, changed=printed())
        if made.recording is None or not made.completed:
            raise PlantError(f"{trajectory.scenario}: {made.to_json()['reason']}")
        found[cosine] = made.recording
        done(cosine)
    return found


# --- what it tells ---


@dataclass(frozen=True)
class Recovered:
    """A parameter of Table I. column: of published.Friction; ours: as identified, with its 95 % interval."""

    joint: int
    column: str
    paper: float
    ours: Estimate

    @property
    def within_precision(self) -> bool:
        """Whether it is the printed value, as far as that is printed."""
        return abs(self.ours.value - self.paper) <= PRECISION

    @property
    def within_interval(self) -> bool:
        """Whether the interval holds the printed value."""
        low, high = self.ours.interval or (np.nan, np.nan)
        return low <= self.paper <= high

    @property
    def met(self) -> bool:
        """Whether the printed value counts as recovered."""
        return self.within_precision or self.within_interval

    def to_json(self) -> dict[str, Any]:
        """difference: relative to the paper's."""
        return {
            "joint": self.joint,
            "name": self.column,
            "unit": self.ours.unit,
            "paper": self.paper,
            "ours": self.ours.known_value,
            "interval": self.ours.known_interval,
            "difference": self.ours.value / self.paper - 1.0,
            "within_precision": self.within_precision,
            "within_interval": self.within_interval,
            "met": self.met,
        }


@dataclass(frozen=True)
class JointFriction:
    """What was identified at a joint (1-based) from the recordings of its cosines, which are in their order."""

    model: Model
    joint: int
    cosines: tuple[Cosine, ...]
    identification: Identification

    @cached_property
    def parameters(self) -> tuple[Recovered, ...]:
        """In the order of Table I's columns."""
        values, row = self.identification.inference.values, TABLE_1[self.joint - 1]
        return tuple(
            Recovered(self.joint, column, getattr(row, column), values[Term(effect, self.joint)][parameter])
            for column, (effect, parameter) in PLACES.items()
        )

    def measured(self) -> list[tuple[Array, Array]]:
        """Speed (M,) rad/s and friction torque (M,) N m in each trial.

        The torque is the recorded one less that of the inverse dynamics, both within the band of the fit.
        """
        found, i = self.identification, self.joint - 1
        speed = found.motion.rows("qd", i)[i]
        whole = Regressors(found.model, found.motion.with_standstill)
        torque = found.motion.recorded(i, found.fit.skew) - whole.measured(i)
        trials = [found.motion.row_piece(i) == k for k in range(len(found.motion.pieces))]
        return [(speed[trial], torque[trial]) for trial in trials]

    def friction(self, speeds: Array) -> Array:
        """(4) as identified, N m at speeds (N,) rad/s."""
        return self._friction(self.identification.fit.prediction.values, speeds)

    def printed_friction(self, speeds: Array) -> Array:
        """(4) with the paper's parameters."""
        return self._friction({item.term: item.values for item in printed() if item.term.joint == self.joint}, speeds)

    def _friction(self, terms: Mapping[Term, Mapping[str, float]], speeds: Array) -> Array:
        library = self.model.library
        return np.sum([library.torque(t.effect, {"qd": speeds}, values) for t, values in terms.items()], axis=0)

    def to_json(self) -> dict[str, Any]:
        """reached: the largest speed in either direction; without compensation a joint lags behind its cosine."""
        motion = self.identification.motion
        cosines = []
        for number, cosine in enumerate(self.cosines):
            trials = [piece for piece in motion.pieces if piece.recording == number]
            reached = max(float(np.abs(piece.qd[self.joint - 1]).max()) for piece in trials)
            cosines.append({"speed": cosine.speed, "omega": cosine.omega, "reached": reached, "trials": len(trials)})
        return {
            "joint": self.joint,
            "cosines": cosines,
            "band": motion.band.document(),
            "skew": self.identification.inference.skew_entry(),
            "parameters": [parameter.to_json() for parameter in self.parameters],
        }


@dataclass(frozen=True)
class Table1:
    """Table I as far as its cosines were recorded."""

    fits: tuple[JointFriction, ...]

    @property
    def parameters(self) -> tuple[Recovered, ...]:
        """Joint by joint, in the order of Table I's columns."""
        return tuple(parameter for fit in self.fits for parameter in fit.parameters)

    def joint(self, number: int) -> JointFriction:
        """Of a joint (1-based) that was recorded."""
        return next(fit for fit in self.fits if fit.joint == number)

    def to_json(self) -> dict[str, Any]:
        """Every figure in SI; what of the experiment is published and what is assumed is told apart."""
        return {
            "published": {"speeds": [list(row.speeds) for row in TABLE_1], "precision": PRECISION},
            "assumed": {"amplitude": AMPLITUDE, "start": START},
            "joints": [fit.to_json() for fit in self.fits],
        }


def table1(model: Model, recordings: Mapping[Cosine, Recording]) -> Table1:
    """Friction of each joint that moved. Raises RecordingError.

    Each from its own recordings: in those of others it creeps, and what it then feels is no friction of (4).
    """
    joints = sorted({cosine.joint for cosine in recordings})
    return Table1(
        tuple(_fit(model, joint, {c: r for c, r in recordings.items() if c.joint == joint}) for joint in joints)
    )


def _fit(model: Model, joint: int, recordings: Mapping[Cosine, Recording]) -> JointFriction:
    known: Structure = {Term(effect, joint): {} for effect, _ in PLACES.values()}
    motion = prepared(model, _with_rigid_torque(model, list(recordings.values())))
    # The controller holds each torque for a period, and nothing else lies between it and the encoder.
    found = identify_motion(model, motion, known, skew=NOMINAL_SKEW)
    return JointFriction(model, joint, tuple(recordings), found)


def _with_rigid_torque(model: Model, recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings with what the inverse dynamics ask for their motion.

    A joint that moves alone tells its own inertia and no more of the arm's ten base parameters. The paper takes all
    of them as known, and so do we: the simulated arm has the model's inertia.
    """
    cutoff = choose_band(recordings, np.abs(model.inertia(np.zeros(model.n)))).cutoffs.max()
    return [replace(r, tau_rigid=_rigid_torque(model, r, cutoff)) for r in recordings]


def _rigid_torque(model: Model, recording: Recording, cutoff: float) -> Array:
    derive = differentiator(cutoff, 1 / recording.dt)
    found = np.empty_like(recording.tau)
    for segment in recording.segments:
        # The ends, which no whole kernel covers, are dropped by the fit for the same reason.
        whole = np.pad(recording.q[:, segment], ((0, 0), (derive.half, derive.half)), "reflect", reflect_type="odd")
        q, qd, qdd = (np.array(part) for part in zip(*(derive(row) for row in whole), strict=True))
        found[:, segment] = model.inverse_dynamics(q, qd, qdd)
    return found
