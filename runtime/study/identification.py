"""Table I: the identification experiment (5), (6) on the simulated arm, and the friction identified from it.

The arm has the printed parameters; the fit knows the terms of (4) and none of their values. As in the paper, one joint
after the other follows cosines of several speeds, under PD control with the frictionless inverse dynamics, and friction
is the motor torque minus those.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, pi
from pathlib import Path

import numpy as np
from scipy.interpolate import BPoly

from runtime.arrays import Array
from runtime.documents.paper import (
    ClaimEntry,
    CosineEntry,
    RecoveredEntry,
    Table1Assumed,
    Table1Entry,
    Table1JointEntry,
    Table1Published,
)
from runtime.execution.execute import execute
from runtime.execution.options import ExecutionSettings
from runtime.identification.estimate import Estimate
from runtime.identification.fit import Fit
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import prepared
from runtime.identification.regressors import Regressors
from runtime.identification.settings import NOMINAL_SKEW
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term
from runtime.motion.band import choose_band
from runtime.motion.filters import differentiator
from runtime.planning.trajectory import Phase, Trajectory
from runtime.recordings.recording import Recording
from runtime.simulation.equations import PlantError
from runtime.simulation.simulate import Hidden
from runtime.study.published import PRECISION, TABLE_1, TRIALS

AMPLITUDE = pi / 4
"""rad, a of (5); assumed: the link sweeps 90 degrees, as it does in scenario 1."""
START = 0.0
"""rad, q_i0 of (5); assumed: the straight arm turns away from where the plate stands."""
SECONDS = 10.0
"""s; least duration of each trial after its run-in; assumed."""
_DERIVATIVES = 7
"""Derivatives of half a cosine that its polynomial matches at both ends: degree 13, within 1e-9 rad."""

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
    """Motion q_i0 + a (1 + cos ωt) of a joint (1-based), the others rest at zero; speed: the largest, a ω, rad/s."""

    joint: int
    speed: float

    def __str__(self) -> str:
        return f"joint {self.joint} at {self.speed:g} rad/s"

    @property
    def omega(self) -> float:
        """rad/s."""
        return self.speed / AMPLITUDE

    def trajectory(self, model: Model) -> Trajectory:
        """One period in two polynomials, one for each direction."""
        half = pi / self.omega
        # The derivatives of cos at 0 are 1, 0, -1, 0, ...; those at pi are their negatives.
        swing = [AMPLITUDE * self.omega**k * (1, 0, -1, 0)[k % 4] for k in range(_DERIVATIVES)]
        top = [START + AMPLITUDE + swing[0], *swing[1:]]
        bottom = [START + AMPLITUDE - swing[0], *(-x for x in swing[1:])]
        there = BPoly.from_derivatives([0.0, half], [top, bottom]).c[:, 0]
        phases = tuple(
            Phase("q", half, np.array([points if k == self.joint else 0.0 * points for k in range(1, model.n + 1)]))
            for points in (there, there[::-1])
        )
        return Trajectory(
            arm=model.name,
            scenario=f"identification of {self}",
            phases=phases,
            periodic=True,
            elbow=1.0,
            friction=False,
            springs={},
            contact={},
        )


COSINES = tuple(Cosine(joint, speed) for joint, row in enumerate(TABLE_1, 1) for speed in row.speeds)
"""The motions of Table I."""


def printed() -> list[Hidden]:
    """Effects of the simulated arm with the values of Table I; the model file has another cubic term of joint 4."""
    found: Structure = {}
    for joint, row in enumerate(TABLE_1, 1):
        for column, (effect, parameter) in PLACES.items():
            found.setdefault(Term(effect, joint), {})[parameter] = getattr(row, column)
    return [Hidden(term, values) for term, values in found.items()]


def record(
    model: Model,
    controller: Path,
    cosines: Sequence[Cosine] = COSINES,
    *,
    trials: int = TRIALS,
    seconds: float = SECONDS,
    done: Callable[[Cosine], None] = lambda _: None,
) -> dict[Cosine, Recording]:
    """The experiment, without friction compensation and springs.

    controller   directory of the arm's compiled controller
    done         called after each cosine
    Raises PlantError if the arm is stopped.
    """
    found = {}
    for seed, cosine in enumerate(cosines):
        trajectory = cosine.trajectory(model)
        cycles = ceil(seconds / trajectory.duration)
        settings = ExecutionSettings(trials, cycles, seed, friction_compensation=False)
        made = execute(model, controller, trajectory, settings, changed=printed())
        if made.recording is None or not made.completed:
            raise PlantError(f"{trajectory.scenario}: {made.reason}")
        found[cosine] = made.recording
        done(cosine)
    return found


# --- the fit ---


@dataclass(frozen=True)
class Recovered:
    """A parameter of Table I. column: of published.Friction; ours: as identified, with its 95 % interval."""

    joint: int
    column: str
    paper: float
    ours: Estimate

    @property
    def within_precision(self) -> bool:
        """Whether it equals the printed value to the printed precision."""
        return abs(self.ours.value - self.paper) <= PRECISION

    @property
    def within_interval(self) -> bool:
        """Whether the interval contains the printed value."""
        low, high = self.ours.interval or (np.nan, np.nan)
        return low <= self.paper <= high

    @property
    def met(self) -> bool:
        """Whether the printed value counts as recovered."""
        return self.within_precision or self.within_interval

    def claim(self) -> ClaimEntry:
        """That the parameter is recovered."""
        interval = ", ".join(f"{end:.3f}" for end in self.ours.interval or ())
        return ClaimEntry(
            text=f"joint {self.joint}: {self.column}",
            paper=f"{self.paper:g}",
            ours=f"{self.ours.value:.3f} [{interval}]",
            holds=self.met,
            unclaimed="",
        )

    def entry(self) -> RecoveredEntry:
        return RecoveredEntry(
            joint=self.joint,
            name=self.column,
            unit=self.ours.unit,
            paper=self.paper,
            ours=self.ours.known_value,
            interval=self.ours.known_interval,
            difference=self.ours.value / self.paper - 1.0,
            within_precision=bool(self.within_precision),
            within_interval=bool(self.within_interval),
            met=bool(self.met),
        )


@dataclass(frozen=True)
class JointFriction:
    """Friction of a joint (1-based), identified from the recordings of its cosines, in their order."""

    model: Model
    joint: int
    cosines: tuple[Cosine, ...]
    fit: Fit

    @cached_property
    def parameters(self) -> tuple[Recovered, ...]:
        """In the order of Table I's columns."""
        values, row = self.fit.inference.values, TABLE_1[self.joint - 1]
        return tuple(
            Recovered(self.joint, column, getattr(row, column), values[Term(effect, self.joint)][parameter])
            for column, (effect, parameter) in PLACES.items()
        )

    def measured(self) -> list[tuple[Array, Array]]:
        """Speed (M,) rad/s and friction torque (M,) N m in each trial.

        The torque is the recorded one minus that of the inverse dynamics, both within the band of the fit.
        """
        found, i = self.fit, self.joint - 1
        speed = found.motion.rows("qd", i)[i]
        whole = Regressors(found.model, found.motion.with_standstill)
        torque = found.motion.recorded(i, found.skew) - whole.measured(i)
        trials = [found.motion.row_piece(i) == k for k in range(len(found.motion.pieces))]
        return [(speed[trial], torque[trial]) for trial in trials]

    def friction(self, speeds: Array) -> Array:
        """(4) as identified, N m at speeds (N,) rad/s."""
        return self._friction(self.fit.prediction.values, speeds)

    def printed_friction(self, speeds: Array) -> Array:
        """(4) with the paper's parameters."""
        return self._friction({item.term: item.values for item in printed() if item.term.joint == self.joint}, speeds)

    def _friction(self, terms: Mapping[Term, Mapping[str, float]], speeds: Array) -> Array:
        library = self.model.library
        return np.sum([library.torque(t.effect, {"qd": speeds}, values) for t, values in terms.items()], axis=0)

    def entry(self) -> Table1JointEntry:
        """Without compensation a joint lags behind its cosine and does not reach its speed."""
        motion = self.fit.motion
        cosines = []
        for number, cosine in enumerate(self.cosines):
            trials = [piece for piece in motion.pieces if piece.recording == number]
            reached = max(float(np.abs(piece.qd[self.joint - 1]).max()) for piece in trials)
            cosines.append(CosineEntry(speed=cosine.speed, omega=cosine.omega, reached=reached, trials=len(trials)))
        return Table1JointEntry(
            joint=self.joint,
            cosines=cosines,
            band=motion.band.document(),
            skew=self.fit.inference.skew_entry(),
            parameters=[parameter.entry() for parameter in self.parameters],
        )


@dataclass(frozen=True)
class Table1:
    """Table I for the joints whose cosines were recorded."""

    fits: tuple[JointFriction, ...]

    @property
    def parameters(self) -> tuple[Recovered, ...]:
        """Joint by joint, in the order of Table I's columns."""
        return tuple(parameter for fit in self.fits for parameter in fit.parameters)

    def joint(self, number: int) -> JointFriction:
        """Friction of a joint (1-based)."""
        return next(fit for fit in self.fits if fit.joint == number)

    def entry(self) -> Table1Entry:
        """Every figure in SI, with the published and the assumed values of the experiment."""
        return Table1Entry(
            published=Table1Published(speeds=[list(row.speeds) for row in TABLE_1], precision=PRECISION),
            assumed=Table1Assumed(amplitude=AMPLITUDE, start=START),
            joints=[fit.entry() for fit in self.fits],
            claims=[parameter.claim() for parameter in self.parameters],
        )


def table1(model: Model, recordings: Mapping[Cosine, Recording]) -> Table1:
    """Friction of each joint that moved, from its own recordings: in others it creeps, where (4) does not hold.

    Raises RecordingError.
    """
    joints = sorted({cosine.joint for cosine in recordings})
    return Table1(
        tuple(_fit(model, joint, {c: r for c, r in recordings.items() if c.joint == joint}) for joint in joints)
    )


def _fit(model: Model, joint: int, recordings: Mapping[Cosine, Recording]) -> JointFriction:
    known: Structure = {Term(effect, joint): {} for effect, _ in PLACES.values()}
    motion = prepared(model, _with_rigid_torque(model, list(recordings.values())))
    # The only delay between torque and encoder is that the controller holds each torque for a period.
    found = fit_motion(model, motion, known, skew=NOMINAL_SKEW)
    return JointFriction(model, joint, tuple(recordings), found)


def _with_rigid_torque(model: Model, recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings with the torque of the inverse dynamics along their motion.

    A joint that moves alone determines one of the arm's ten base parameters only. The paper takes all of them as known,
    and so does this fit: the simulated arm has the model's inertia.
    """
    cutoff = choose_band(recordings, np.abs(model.inertia(np.zeros(model.n)))).cutoffs.max()
    found = []
    for recording in recordings:
        derive, torque = differentiator(cutoff, 1 / recording.dt), np.empty_like(recording.tau)
        ends = ((0, 0), (derive.half, derive.half))
        for segment in recording.segments:
            # The fit drops the ends, where the kernel is not covered by samples.
            whole = np.pad(recording.q[:, segment], ends, "reflect", reflect_type="odd")
            q, qd, qdd = (np.array(part) for part in zip(*(derive(row) for row in whole), strict=True))
            torque[:, segment] = model.inverse_dynamics(q, qd, qdd)
        found.append(replace(recording, tau_rigid=torque))
    return found
