"""A trajectory on an arm, driven by a board: what was seen of it, what stopped it, and the recording it leaves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.execution import stops
from runtime.hardware.session import BoardRun, Session
from runtime.hardware.settings import Settings
from runtime.model.loader import Model
from runtime.planning.trajectory import Trajectory
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]

RUN_IN = 1
"""Cycles of a periodic motion before those that count: it starts from rest."""
SETTLE = 0.25
"""s that are recorded after a motion which is not periodic."""
_MICROSECONDS = 1e6


@dataclass(frozen=True)
class Stop:
    """A safe stop: t in s since the trial began; joint (1-based), None for the whole arm; name: of the reason."""

    t: float
    joint: int | None
    reason: str
    name: str


@dataclass(frozen=True)
class Trial:
    """One execution: t (N,); q as counted, q_desired, tau as commanded (n, N); saturated (N,).

    t   by the board's clock, from the first control period on
    """

    t: Array
    q: Array
    q_desired: Array
    tau: Array
    saturated: NDArray[np.bool_]
    stop: Stop | None

    @classmethod
    def without_motion(cls, n: int, name: str, reason: str) -> Trial:
        """One that could not begin, on an arm of n joints."""
        nothing = np.empty((n, 0))
        return cls(np.empty(0), nothing, nothing, nothing, np.empty(0, dtype=np.bool_), Stop(0.0, None, reason, name))


def run(
    session: Session, settings: Settings, seconds: float, every: int = 1, asked: Callable[[], int] = lambda: 0
) -> Trial:
    """What has been uploaded, for so long or until something stops it.

    every   control periods from one record to the next     asked   see Session.run
    """
    done = session.run(round(seconds / settings.dt), every, asked)
    page, rows = session.codec.document, done.rows
    return Trial(
        t=_times(rows, settings.dt),
        q=settings.positions(rows["counts"]),
        q_desired=rows["q_desired"].T.astype(np.float64),
        tau=rows["torque"].T.astype(np.float64),
        saturated=(rows["status"] & page["status"]["saturated"]) > 0,
        stop=_stop(done, settings, {reason["name"]: reason["text"] for reason in page["reasons"]}),
    )


def _times(rows: NDArray[Any], dt: float) -> Array:
    """(N,) s, as the board's clock stamped them; where that agrees with its control periods, those tell it finer."""
    nominal, stamps = dt * rows["period"].astype(np.float64), rows["time_us"]
    # The clock wraps, and so does the difference.
    since = np.cumsum(np.diff(stamps, prepend=stamps[:1]).astype(np.float64)) / _MICROSECONDS
    stamped = nominal[:1] + since
    return nominal if np.abs(stamped - nominal).max(initial=0.0) < 1.5 / _MICROSECONDS else stamped


def _stop(done: BoardRun, settings: Settings, texts: Mapping[str, str]) -> Stop | None:
    ended = done.ended
    if ended.reason == "done":
        return None
    last = int(done.rows["period"][-1]) if len(done.rows) else 0
    t = settings.dt * (last if ended.period is None else ended.period)
    return Stop(t, ended.joint, stops.words(ended, done.rows, settings, texts), ended.reason)


def length(trajectory: Trajectory, cycles: int) -> float:
    """s that a trial takes: run-in and cycles, or the motion once and what it takes to settle."""
    return (RUN_IN + cycles) * trajectory.duration if trajectory.periodic else trajectory.duration + SETTLE


def recorded(trials: Sequence[Trial], model: Model, noise: float, seed: int) -> Recording:
    """The trials that moved as one recording, a run each; noise of the torque sensor as a part of each joint's rms
    torque."""
    rng = np.random.default_rng([seed, len(trials)])
    trials = [trial for trial in trials if len(trial.t)]
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
