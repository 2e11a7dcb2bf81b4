"""How far the model's motion comes from the recorded one, and whether that is what the torque's error promises.

Every window is played twice: under what drove the arm, and without the part of the torque that the model does not
explain in its band. The difference of both is what the torque's error promises of the motion, with all that friction
and a controller make of it; what the second still misses has other causes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Literal

import numpy as np
from msgspec import UNSET

from runtime.arrays import Array
from runtime.documents.replays import MotionErrorEntry, ReplayedJoint
from runtime.identification.fit import Fit
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import prepared, without_tip_rests
from runtime.model.loader import Model
from runtime.model.terms import Prediction, check_complete, structure
from runtime.motion.motion import Motion, prepare
from runtime.motion.settings import CERTAIN
from runtime.recordings.recording import Recording, RecordingError, drives_of
from runtime.replay.driven_arm import OPEN_LOOP, DrivenArm, Feedback, Windows
from runtime.replay.settings import AGREES, RESTING, RUNAWAY, SAME_PERIOD, SHORTEST, START, STEP, STRETCH, WINDOWS
from runtime.replay.track import Track, tracks
from runtime.simulation.integrator import Integrator
from symbolic.model_file.arm import Gains


@dataclass(frozen=True, eq=False)
class PlayedWindows:
    """Windows of a recording as the model moves in them; all (W, K, n), the first sample is the recorded state.

    recorded, played   positions     without   played without the torque that the model does not explain
    """

    windows: Windows
    dt: float
    recorded: Array
    played: Array
    without: Array

    def error(self, joint: int, beside: PlayedWindows | None = None) -> MotionErrorEntry:
        """Of a joint (0-based); beside: the same windows by other equations."""
        recorded, played, without = (x[:, :, joint] for x in (self.recorded, self.played, self.without))
        moved = _rms(recorded - recorded[:, :1])
        rms = _rms(played - recorded)
        there = np.isfinite(rms) and rms < RUNAWAY * max(moved, 1e-12)
        return MotionErrorEntry(
            seconds=self.windows.length * self.dt,
            windows=len(recorded),
            rms=rms if there else None,
            share=rms / moved if there and moved > 0 else None,
            promised=_finite(_rms(played - without)),
            rest=_finite(_rms(without - recorded)),
            apart=UNSET if beside is None else _finite(_rms(played - beside.played[:, :, joint])),
        )


@dataclass(frozen=True, eq=False)
class Replay:
    """A model with its parameters, driven by what drove the arm in some recordings.

    known   parameters      motion   of the recordings, in the band of the fit
    skew    samples by which the torque is taken later      longest_step  s, of the integration
    Raises PlantError, ModelError, RecordingError.
    """

    model: Model
    known: Prediction
    motion: Motion
    recordings: Sequence[Recording]
    skew: float
    longest_step: float = STEP

    @classmethod
    def of_file(cls, model: Model, recordings: Sequence[Recording]) -> Replay:
        """With the values of the model file; the time between torque and motion is estimated."""
        terms = structure(model)
        check_complete(model, terms)
        motion = prepared(model, recordings)
        return cls(
            model, Prediction(model.lump_values, terms), motion, recordings, fit_motion(model, motion, terms).skew
        )

    @classmethod
    def of_fit(cls, fit: Fit, recordings: Sequence[Recording]) -> Replay:
        """With the values of a fit, on recordings that were not fitted."""
        motion = without_tip_rests(fit.model, prepare(recordings, fit.motion.band, fit.model))
        return cls(fit.model, fit.prediction, motion, recordings, fit.skew)

    @cached_property
    def tracks(self) -> list[Track]:
        """The recordings as they are played."""
        if any(r.tau_rigid is not None for r in self.recordings):
            raise RecordingError(
                f"{self.recordings[0].path}: its rigid-body torque is that of your own model, which cannot be moved: a "
                "replay needs the arm's masses and frames in the model file"
            )
        periods = {piece.dt for piece in self.motion.pieces}
        if max(periods) > min(periods) * (1 + SAME_PERIOD):
            raise RecordingError(
                f"{self.recordings[0].path}: these recordings have samples every {min(periods):.4g} to "
                f"{max(periods):.4g} s; expected one rate: replay them one after the other"
            )
        return tracks(self.model, self.known, self.motion, self.recordings, self.skew)

    @cached_property
    def made(self) -> Integrator:
        """The equations and their steps."""
        first = self.motion.pieces[0]
        posture = first.q[:, len(first.t) // 2]
        return Integrator(self.model, self.known, first.dt, first.torque, self.longest_step, posture)

    @cached_property
    def controllers(self) -> list[Literal["gains", "law"] | None]:
        """What makes each joint's torque in closed loop."""
        drives = drives_of(self.recordings)
        return [
            "law" if drive is not None else "gains" if joint.gains is not None else None
            for drive, joint in zip(drives, self.model.joints, strict=True)
        ]

    @cached_property
    def torqued(self) -> DrivenArm:
        """The model under the recorded torques."""
        return self._arm([OPEN_LOOP] * self.model.n)

    @cached_property
    def commanded(self) -> DrivenArm:
        """The model under recorded torques, and under recorded commands where drives have laws."""
        return self._arm([OPEN_LOOP if drive is None else Feedback(drive) for drive in drives_of(self.recordings)])

    @cached_property
    def controlled(self) -> DrivenArm:
        """The model in closed loop: with the drives' laws and with stated gains."""
        pairs = zip(drives_of(self.recordings), self.model.joints, strict=True)
        return self._arm([self._gains(joint.gains) if drive is None else Feedback(drive) for drive, joint in pairs])

    def _gains(self, gains: Gains | None) -> Feedback:
        late = self.skew * self.motion.pieces[0].dt
        return OPEN_LOOP if gains is None else Feedback(None, gains.kp, gains.kd, late)

    def _arm(self, feedback: Sequence[Feedback]) -> DrivenArm:
        coefficients = {i: each.drive.acting for i, each in enumerate(feedback) if each.drive is not None}
        return DrivenArm(self.model, self.made, tuple(feedback), coefficients, self.made.equations)

    @cached_property
    def opened(self) -> list[PlayedWindows]:
        """Windows under the recorded torque, of all lengths for which a stretch is long enough."""
        found = (self._windows(seconds) for seconds in WINDOWS)
        return [self._under_torque(windows) for windows in found if windows is not None]

    @property
    def longest(self) -> PlayedWindows | None:
        """The longest of these windows, if there are any."""
        return self.opened[-1] if self.opened else None

    @cached_property
    def closed_loop(self) -> PlayedWindows | None:
        """The whole recording under its controller; None where no joint has one."""
        if not any(self.controllers):
            return None
        longest = (max(len(track.t) for track in self.tracks) - 1) * self.motion.pieces[0].dt
        windows = self._windows(longest / ceil(longest / STRETCH))
        return None if windows is None else self._played(self.controlled, windows)

    def _windows(self, seconds: float) -> Windows | None:
        length = round(seconds / self.motion.pieces[0].dt)
        windows = Windows.of(self.tracks, length) if length >= SHORTEST else None
        return windows if windows is not None and windows.starts else None

    def _under_torque(self, windows: Windows) -> PlayedWindows:
        return self._played(self.torqued, windows)

    def _played(self, arm: DrivenArm, windows: Windows) -> PlayedWindows:
        start = arm.starts(self.tracks, windows)
        played, without = (arm.play(start, arm.read(self.tracks, windows, part)) for part in (0.0, 1.0))
        return PlayedWindows(windows, self.tracks[0].dt, windows.cut(self.tracks, "q"), played, without)

    @cached_property
    def joints(self) -> list[ReplayedJoint]:
        """The errors of every joint's motion."""
        return [self._joint(i, self.closed_loop) for i in range(self.model.n)]

    def _error(self, k: int, joint: int) -> MotionErrorEntry:
        """Of a joint (0-based) in the windows of the k-th length."""
        return self.opened[k].error(joint)

    def _joint(self, i: int, closed: PlayedWindows | None) -> ReplayedJoint:
        joint = self.model.joints[i]
        errors = [self._error(k, i) for k in range(len(self.opened))]
        agrees, reason = self._agreement(i, errors)
        return ReplayedJoint(
            joint=i + 1,
            name=joint.name,
            unit=joint.position_unit,
            controller=self.controllers[i],
            open_loop=errors,
            closed_loop=None if closed is None or self.controllers[i] is None else closed.error(i),
            agrees=agrees,
            reason=reason,
        )

    def _agreement(self, i: int, errors: Sequence[MotionErrorEntry]) -> tuple[bool | None, str]:
        """Whether the torque's error makes most of the motion's in open loop, and if not, what does."""
        if not np.isfinite(self.motion.standstill[i]):
            return None, "it does not move"
        if not errors:
            return None, "no stretch of the recording is long enough for a window"
        last = errors[-1]
        if last.promised is None or last.rest is None:
            return False, f"in windows of {last.seconds:.3g} s the model's motion runs away"
        if last.promised >= AGREES * last.rest:
            return True, "the torque's error makes most of it"
        resting = float(np.average([t.resting[i] for t in self.tracks], weights=[len(t.t) for t in self.tracks]))
        if resting > RESTING:
            return False, f"it rests for {100 * resting:.0f} % of the time, where dry friction takes up any torque"
        rate = float(self.motion.standstill[i]) / CERTAIN
        unit = self.model.joints[i].position_unit
        if rate * last.seconds / np.sqrt(3) > START * last.rest:
            return False, f"the rate at which a window begins is known to {rate:.2g} {unit}/s only"
        cutoff = self.motion.cutoff(i)
        return False, f"the states in which windows begin make most of it, or torque above {cutoff:.3g} Hz"


def _rms(x: Array) -> float:
    with np.errstate(all="ignore"):
        return float(np.sqrt(np.mean(x[:, 1:] ** 2)))


def _finite(x: float) -> float | None:
    return x if np.isfinite(x) else None
