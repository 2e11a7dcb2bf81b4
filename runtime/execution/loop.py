"""A trajectory on an arm: the control loop, what stops it, and the recording it leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.execution.controller import Controller
from runtime.loader import Model
from runtime.planning.trajectory import Trajectory
from runtime.recording import Recording

Array = NDArray[np.float64]

OVERSPEED = 1.5
"""Of a joint's limit of speed, which the plan keeps: more than tracking needs."""
TRACKING = {"revolute": 0.5, "prismatic": 0.1}
"""rad, m: a larger tracking error is a safe stop."""
RUN_IN = 1
"""Cycles of a periodic motion before those that count: it starts from rest."""
SETTLE = 0.25
"""s that are recorded after a motion which is not periodic."""


class Fault(RuntimeError):
    """The arm can no longer be driven: its motion is no number, the link to it is gone."""


class Arm(Protocol):
    """What can be executed on. All may raise Fault."""

    def start(self, q: Array, rng: np.random.Generator) -> NDArray[np.int32]: ...

    def counts(self) -> NDArray[np.int32]: ...

    def apply(self, torque: ArrayLike) -> None: ...


@dataclass(frozen=True)
class Stop:
    """A safe stop: t in s since the trial began; joint (1-based), None for the whole arm."""

    t: float
    joint: int | None
    reason: str


@dataclass(frozen=True)
class Guard:
    """When to stop. (n,) each; inf where there is no limit.

    tracking   largest error of position      speed   largest measured rate
    low, high  range of position
    """

    tracking: Array
    speed: Array
    low: Array
    high: Array
    units: tuple[str, ...]

    @classmethod
    def of(cls, model: Model, tracking: float | None) -> Guard:
        """The joints' limits; `tracking` (rad, m) for all joints, or by their type."""
        joints = model.joints
        ranges = np.array([j.position_limits or (-inf, inf) for j in joints])
        return cls(
            np.array([TRACKING[j.type] if tracking is None else tracking for j in joints]),
            np.array([OVERSPEED * j.speed_limit if j.speed_limit else inf for j in joints]),
            ranges[:, 0],
            ranges[:, 1],
            tuple(j.position_unit for j in joints),
        )

    def check(self, t: float, controller: Controller) -> Stop | None:
        """After a step of the controller: why the arm has to stop, if it has."""
        q, qd = controller.q, controller.qd
        error = np.abs(q - controller.q_desired)
        fine = (error <= self.tracking) & (np.abs(qd) <= self.speed) & (q >= self.low) & (q <= self.high)
        if fine.all() and not controller.invalid:
            return None
        k = int(np.argmin(fine & np.isfinite(controller.torque)))
        return Stop(t, k + 1, self._reason(k, controller))

    def _reason(self, k: int, controller: Controller) -> str:
        q, qd, unit = float(controller.q[k]), float(controller.qd[k]), self.units[k]
        error = abs(q - float(controller.q_desired[k]))
        if error > self.tracking[k]:
            return f"tracking error {error:.3g} {unit} is over the limit of {self.tracking[k]:.3g}"
        if abs(qd) > self.speed[k]:
            return f"speed {abs(qd):.3g} {unit}/s is over the limit of {self.speed[k]:.3g}"
        if not self.low[k] <= q <= self.high[k]:
            return f"position {q:.4g} {unit} is outside {self.low[k]:.4g} to {self.high[k]:.4g}"
        return "the controller met a number that is not finite"


@dataclass(frozen=True)
class Trial:
    """One execution: t (N,); q as counted, q_desired, tau as commanded (n, N); saturated (N,)."""

    t: Array
    q: Array
    q_desired: Array
    tau: Array
    saturated: NDArray[np.bool_]
    stop: Stop | None


def run(
    arm: Arm, controller: Controller, guard: Guard, start: Array, seconds: float, rng: np.random.Generator
) -> Trial:
    """The controller's trajectory from rest at `start` (n,), for so long or until the guard stops it."""
    count = round(seconds / controller.dt)
    q, q_desired, tau = (np.empty((controller.n, count)) for _ in range(3))
    saturated = np.zeros(count, dtype=bool)
    counts, stop, k = arm.start(start, rng), None, 0
    controller.reset(counts)
    while k < count and stop is None:
        torque = controller.step(counts)
        q[:, k], q_desired[:, k], tau[:, k] = controller.q, controller.q_desired, torque
        saturated[k] = controller.saturated
        stop = guard.check(k * controller.dt, controller)
        k += 1
        if stop is None:
            try:
                arm.apply(torque)
                counts = arm.counts()
            except Fault as fault:
                stop = Stop(k * controller.dt, None, str(fault))
    return Trial(
        controller.dt * np.arange(k, dtype=np.float64), q[:, :k], q_desired[:, :k], tau[:, :k], saturated[:k], stop
    )


def length(trajectory: Trajectory, cycles: int) -> float:
    """s that a trial takes: run-in and cycles, or the motion once and what it takes to settle."""
    return (RUN_IN + cycles) * trajectory.duration if trajectory.periodic else trajectory.duration + SETTLE


def recorded(trials: Sequence[Trial], model: Model, noise: float, seed: int) -> Recording:
    """The trials as one recording, a run each; noise of the torque sensor as a part of each joint's rms torque."""
    rng = np.random.default_rng([seed, len(trials)])
    tau = np.concatenate([trial.tau for trial in trials], axis=1)
    tau += noise * np.sqrt(np.mean(tau**2, axis=1, keepdims=True)) * rng.standard_normal(tau.shape)
    ends = np.cumsum([len(trial.t) for trial in trials]).tolist()
    return Recording(
        path=Path("execution"),
        t=np.concatenate([trial.t for trial in trials]),
        run=np.concatenate([np.full(len(trial.t), k) for k, trial in enumerate(trials, 1)]),
        q=np.concatenate([trial.q for trial in trials], axis=1),
        tau=tau,
        types=tuple(joint.type for joint in model.joints),
        segments=tuple(slice(a, b) for a, b in zip([0, *ends], ends, strict=False)),
        temperature=(None,) * model.n,
        q_desired=np.concatenate([trial.q_desired for trial in trials], axis=1),
    )
