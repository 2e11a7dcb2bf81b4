"""Motions for the animation of the arm: the seconds of a recording with the largest residual, a plan, an execution."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.diagnosis.steps import Step
from runtime.execution.execute import Execution
from runtime.execution.trial import RUN_IN, Trial
from runtime.model.loader import Model
from runtime.motion.motion import Motion
from runtime.motion.piece import Piece
from runtime.planning.evaluate import Effort, at_times
from runtime.planning.trajectory import Trajectory
from runtime.report.page.arm_motion import (
    MOST_FRAMES,
    ArmMotion,
    Course,
    JointMarks,
    frames,
    picture,
)
from runtime.report.plots.motion_plots import JointCycles
from runtime.report.summary import ResultSummary

Rows = NDArray[np.intp]

_STEP = 0.01
"""Time from one frame of a plan to the next, s, unless that makes too many frames."""
LONGEST = 12.0
"""Longest part of a recording that is shown, s; frames are then at most 0.05 s apart."""


def of_result(summary: ResultSummary) -> dict[str, Any] | None:
    """Variables of the template for the measured motion, with the residual at the joints.

    None if the recording has `tau_rigid`: the model file then does not describe the arm's links.
    """
    if summary.first.fit.motion.rigid_given:
        return None
    window = _largest_residual(summary.first)
    shown = window[frames(len(window))]
    motion = summary.last.fit.motion
    t = motion.row_time(_clock(motion))[shown]
    steps = {"residual": summary.last}
    if summary.first is not summary.last:
        steps = {"residual before": summary.first, "after": summary.last}
    marks = tuple(JointMarks(name, _floors(step, summary.last, window, shown)) for name, step in steps.items())
    moving = _motion(summary.last, shown, t, marks)
    where = f"{t[0]:.1f} s to {t[-1]:.1f} s{_of_which(summary, int(shown[0]))}"
    as_seen = "as demanded, dashed, and as it was measured" if len(moving.courses) > 1 else "as it was measured"
    what = f"The arm {as_seen}, from {where}: the {t[-1] - t[0]:.0f} s with the largest residual"
    if len(marks) > 1:
        what += "; the rings at its joints are the residual before, the discs after"
    else:
        what += "; the discs at its joints are the residual"
    return picture(moving, f"{what}, by colour and size in noise floors.")


def _motion(step: Step, shown: Rows, t: Array, marks: tuple[JointMarks, ...]) -> ArmMotion:
    motion, model = step.fit.motion, step.fit.model
    courses = [Course("measured", motion.rows("q", _clock(motion))[:, shown])]
    piece, samples = _samples(motion, shown)
    if (rows := piece.sensors.q_desired) is not None:
        demanded = rows[:, samples]
        courses.insert(0, Course("demanded", np.where(np.isnan(demanded), courses[0].q, demanded)))
    return ArmMotion(model=model, t=t, courses=tuple(courses), marks=marks)


def _clock(motion: Motion) -> int:
    """The joint (0-based) whose rows are the frames: one with the narrowest band."""
    return motion.views[0].joints[0]


def _samples(motion: Motion, shown: Rows) -> tuple[Piece, Rows]:
    of = motion.row_piece(_clock(motion))
    number = int(of[shown[0]])
    piece = motion.pieces[number]
    return piece, piece.centres[shown - int(np.argmax(of == number))]


def _largest_residual(step: Step) -> Rows:
    """Rows of the interval, at most LONGEST in one piece, with the largest sum of squared residuals in noise floors."""
    motion = step.fit.motion
    weight = np.sum([_squares(step, step, i) for i in range(motion.n)], axis=0)
    total = np.concatenate([[0.0], np.cumsum(weight)])
    of, count = motion.row_piece(_clock(motion)), max(2, round(LONGEST * motion.row_rate(_clock(motion))))
    starts = np.searchsorted(of, np.arange(len(motion.pieces) + 1))
    ends = np.minimum(np.arange(len(weight)) + count, starts[of + 1])
    start = int(np.argmax(total[ends] - total[:-1]))
    # An interval that the end of its piece cuts short begins earlier.
    first = max(int(starts[of[start]]), int(ends[start]) - count)
    return np.arange(first, ends[start])


def _squares(step: Step, floors: Step, joint: int) -> Array:
    """Squared residual (M,) of a joint in squared noise floors, at the frames' rows; 0 where it is not compared."""
    found = step.fit
    at = found.motion.nearest_rows(joint, _clock(found.motion))
    floor = floors.joints[joint].floor.value
    return np.where(found.motion.moving(joint)[at], found.residual[joint][at] / (floor or np.inf), 0.0) ** 2


def _floors(step: Step, floors: Step, window: Rows, shown: Rows) -> Array:
    """Rms residual (n, F) between a frame and the next, in noise floors; NaN where the joint is at rest.

    floors   the step whose noise floors are used: the error of a wrong model raises the floor from repeats
    """
    motion = step.fit.motion
    starts = shown - window[0]
    out = np.full((motion.n, len(shown)), np.nan)
    for i in range(motion.n):
        use = motion.moving(i)[motion.nearest_rows(i, _clock(motion))][window]
        counts = np.add.reduceat(use.astype(float), starts)
        sums = np.add.reduceat(_squares(step, floors, i)[window], starts)
        some = counts > 0
        out[i, some] = np.sqrt(sums[some] / counts[some])
    return out


def _of_which(summary: ResultSummary, row: int) -> str:
    """Number of the recording and of the run, if there are several."""
    motion = summary.last.fit.motion
    piece = motion.pieces[motion.row_piece(_clock(motion))[row]]
    text = ""
    if len({p.recording for p in motion.pieces}) > 1:
        text = f" of recording {piece.recording + 1}"
    if len({p.run for p in motion.pieces if p.recording == piece.recording}) > 1:
        text += f" of run {piece.run}"
    return text


# --- a plan ---


def planned(model: Model, trajectory: Trajectory) -> dict[str, Any]:
    """Variables of the template for one cycle of a trajectory."""
    count = int(np.clip(np.ceil(trajectory.duration / _STEP), 2, MOST_FRAMES))
    t = np.linspace(0.0, trajectory.duration, count, endpoint=not trajectory.periodic)
    seen = at_times(model, trajectory, t)
    moving = ArmMotion(
        model=model,
        t=t,
        courses=(Course("planned", seen.motion.q),),
        goes_on=trajectory.periodic,
    )
    kind = "repeated" if trajectory.periodic else "from rest to rest"
    what = (
        f"The planned motion of {model.name}, {trajectory.duration:g} s, {kind}; the thin line is the path of the tip."
    )
    return picture(moving, what)


# --- an execution ---


@dataclass(frozen=True)
class ExecutedCycles:
    """The cycles after the run-in, at the samples of the first; without any, the last seconds before a stop."""

    result: Execution

    @cached_property
    def whole(self) -> list[tuple[Trial, float]]:
        """Trials, each with the time at which a cycle begins, s."""
        plan = self.result.plan.trajectory
        first, most = (RUN_IN, None) if plan.periodic else (0, 1)
        found = []
        for trial in self.result.trials:
            count = int(len(trial.t) * self.result.dt / plan.duration + 1e-9)
            found += [(trial, k * plan.duration) for k in range(first, count)][:most]
        return found

    @cached_property
    def _shown(self) -> tuple[Trial, NDArray[np.intp]]:
        """Trial of the cycle that is shown, and the samples of its frames."""
        dt, duration = self.result.dt, self.result.plan.trajectory.duration
        count = max(1, round(duration / dt))
        if self.whole:
            trial, begins = self.whole[0]
            start = round(begins / dt)
        else:
            trial = max(self.result.trials, key=lambda one: len(one.t))
            start = max(0, len(trial.t) - count)
        return trial, start + frames(min(count, len(trial.t) - start))

    @cached_property
    def t(self) -> Array:
        """Time (F,) since the trial began, s."""
        return np.asarray(self._shown[1] * self.result.dt, dtype=np.float64)

    @cached_property
    def planned(self) -> Effort:
        """The plan at the frames, with every effect of the model."""
        return at_times(self.result.plan.model, self.result.plan.trajectory, self.t, friction=True)

    def over_each_other(self, name: str) -> Array:
        """`q` or `tau` of the cycles (n, K, F) at the frames."""
        trial, at = self._shown
        if not self.whole:
            return np.asarray(getattr(trial, name)[:, at][:, None])
        places = at * self.result.dt - self.whole[0][1]
        rows = []
        for one, begins in self.whole:
            values = getattr(one, name)
            rows.append(values[:, np.minimum(np.rint((begins + places) / self.result.dt).astype(int), len(one.t) - 1)])
        return np.stack(rows, axis=1)

    @cached_property
    def _springs(self) -> dict[int, Array]:
        """Torques of the springs along the plan, by joint (1-based)."""
        return {joint: self.planned.spring[joint - 1] for joint in sorted(self.result.plan.trajectory.springs)}

    def motion(self) -> ArmMotion:
        """The first cycle after the run-in."""
        plan, (trial, at) = self.result.plan, self._shown
        tau = self.over_each_other("tau")
        marks: tuple[JointMarks, ...] = ()
        if tau.shape[1] > 1:
            # The differences between cycles are the noise floor, as from repeated motion.
            scatter = np.sqrt(np.mean(np.var(tau, axis=1, ddof=1), axis=1, keepdims=True))
            apart = np.abs(tau.mean(axis=1) - self.planned.tau)
            marks = (JointMarks("executed less planned", apart / np.maximum(scatter, 1e-12)),)
        return ArmMotion(
            model=plan.model,
            t=self.t,
            courses=(Course("planned", self.planned.motion.q), Course("executed", trial.q[:, at])),
            marks=marks,
            goes_on=plan.trajectory.periodic and bool(self.whole),
        )

    def picture(self) -> dict[str, Any]:
        """Variables of the template for the arm as planned and as it moved."""
        which = "the first cycle that counts" if self.whole else "the last seconds before the stop"
        text = f"The arm as planned, dashed, and as it moved, {which}"
        if len(self.whole) > 1:
            text += (
                "; the discs are the torque executed less that of the plan, the mean of all cycles, against the noise "
                "floor: what differs from cycle to cycle"
            )
        return picture(self.motion(), f"{text}.")

    @cached_property
    def joints(self) -> list[JointCycles]:
        """Position and torque of every joint, planned and executed."""
        q, tau = self.over_each_other("q"), self.over_each_other("tau")
        return [
            JointCycles(
                self.t - self.t[0],
                self.planned.motion.q[i],
                q[i],
                torque_planned=self.planned.tau[i],
                torque=tau[i],
                spring=self._springs.get(i + 1),
                position_unit=joint.position_unit,
                force_unit=joint.force_unit,
            )
            for i, joint in enumerate(self.result.plan.model.joints)
        ]
