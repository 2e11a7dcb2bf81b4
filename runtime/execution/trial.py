"""A trajectory on an arm, driven by a board: what was seen of it, why it was stopped, and the recording of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from runtime.arrays import Array
from runtime.documents.plans import StopEntry, WatchedEntry
from runtime.hardware.session import Ended, Session
from runtime.hardware.settings import Settings
from runtime.model.loader import Model
from runtime.planning.trajectory import Trajectory
from runtime.recordings.recording import Recording

RUN_IN = 1
"""Cycles of a periodic motion before those that count, because it starts from rest."""
SETTLE = 0.25
"""s that are recorded after a motion that is not periodic."""
_MICROSECONDS = 1e6

HOST = {
    "interrupted": "interrupted (Ctrl-C, or its terminal was closed)",
    "telemetry_lost": "telemetry of the board is lost",
    "link_lost": "the link to the board is lost",
    "other_rate": "the board runs at another rate",
    "overrun": "the board ran on after the end of the plan and was stopped",
    "untrusted": "the board cannot be trusted and was stopped",
}
"""Reasons of this end of the link; the board has its own."""


@dataclass(frozen=True)
class Trial:
    """One execution: q as counted, q_desired, tau as commanded (n, N); saturated (N,).

    t         (N,) s by the board's clock, from the first control period on
    watched   what the board's monitor says of each joint; None: it has none
    """

    t: Array
    q: Array
    q_desired: Array
    tau: Array
    saturated: NDArray[np.bool_]
    stop: StopEntry | None
    watched: tuple[WatchedEntry, ...] | None = None

    @classmethod
    def without_motion(cls, n: int, name: str, reason: str) -> Trial:
        """One that could not begin, on an arm of n joints."""
        nothing = np.empty((n, 0))
        stop = StopEntry(t=0.0, joint=None, reason=reason, name=name)
        saturated = np.empty(0, dtype=np.bool_)
        return cls(t=np.empty(0), q=nothing, q_desired=nothing, tau=nothing, saturated=saturated, stop=stop)


def run(
    session: Session, settings: Settings, seconds: float, *, every: int = 1, asked: Callable[[], int] = lambda: 0
) -> Trial:
    """Execute what has been uploaded for so long, or until something stops it.

    every   control periods from one record to the next     asked   see Session.run
    """
    done = session.run(round(seconds / settings.dt), every, asked)
    page, rows, ended, stop = session.codec.document, done.rows, done.ended, None
    if ended.reason != "done":
        last = int(rows["period"][-1]) if len(rows) else 0
        t = settings.dt * (last if ended.period is None else ended.period)
        texts = {reason["name"]: reason["text"] for reason in page["reasons"]}
        reason = words(ended, rows, settings, texts)
        stop = StopEntry(t=t, joint=ended.joint, reason=reason, name=ended.reason)
    return Trial(
        t=_times(rows, settings.dt),
        q=settings.positions(rows["counts"]),
        q_desired=rows["q_desired"].T.astype(np.float64),
        tau=rows["torque"].T.astype(np.float64),
        saturated=(rows["status"] & page["status"]["saturated"]) > 0,
        stop=stop,
        watched=_watched(page, rows, settings.dt),
    )


def _watched(page: Mapping[str, Any], rows: NDArray[Any], dt: float) -> tuple[WatchedEntry, ...] | None:
    """What the monitor of a board said at last of each joint, and since when."""
    if "verdicts" not in page or not len(rows):
        return None
    verdicts, signals = ({number: word for word, number in page[name].items()} for name in ("verdicts", "signals"))
    found = []
    for k in range(page["joints"]):
        verdict = rows["verdict"][:, k]
        held = np.flatnonzero(verdict == page["verdicts"]["holds"])
        first = 0 if not len(held) else int(held[-1]) + 1
        found.append(
            WatchedEntry(
                joint=k + 1,
                verdict=verdicts[int(verdict[-1])],
                signal=signals[int(rows["signal"][-1, k])],
                since=None if first == len(rows) else dt * float(rows["period"][first]),
            )
        )
    return tuple(found)


def _times(rows: NDArray[Any], dt: float) -> Array:
    """(N,) s by the stamps of the board's clock; if they agree with its control periods, by those: they are finer."""
    nominal, stamps = dt * rows["period"].astype(np.float64), rows["time_us"]
    # The clock wraps, and so does the difference.
    since = np.cumsum(np.diff(stamps, prepend=stamps[:1]).astype(np.float64)) / _MICROSECONDS
    stamped = nominal[:1] + since
    return nominal if np.abs(stamped - nominal).max(initial=0.0) < 1.5 / _MICROSECONDS else stamped


def length(trajectory: Trajectory, cycles: int) -> float:
    """s that a trial takes: run-in and cycles, or the motion once and the time to settle."""
    return (RUN_IN + cycles) * trajectory.duration if trajectory.periodic else trajectory.duration + SETTLE


def recorded(trials: Sequence[Trial], model: Model, noise: float, seed: int) -> Recording:
    """The trials that moved as one recording, a run each; noise: of the torque sensor, as a part of each joint's rms
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


# --- why an arm was stopped ---


def words(ended: Ended, rows: NDArray[Any], settings: Settings, texts: Mapping[str, str]) -> str:
    """One sentence with the measured value and the limit. rows: the run's telemetry (N,); texts: the protocol's, by
    name of the reason."""
    if ended.reason == "drive":
        return ended.detail or f"{texts[ended.reason]} (code {ended.code})"
    # Either end may lose the link; this end has details.
    if ended.detail or ended.reason not in texts:
        return HOST[ended.reason] + (f": {ended.detail}" if ended.detail else "")
    if ended.joint is not None and len(rows) and rows[-1]["period"] == ended.period:
        return _measured(ended.reason, ended.joint - 1, rows, settings) or texts[ended.reason]
    return texts[ended.reason]


def _measured(reason: str, k: int, rows: NDArray[Any], settings: Settings) -> str | None:
    """What was measured at joint k (0-based) in the last period, beside its limit; None if the reason has no values."""
    safety, joint = settings.safety, settings.model.joints[k]
    unit, position = joint.position_unit, float(settings.positions(rows["counts"][-1:])[k, 0])
    error = abs(position - rows[-1]["q_desired"][k])
    match reason:
        case "tracking":
            return f"tracking error {error:.3g} {unit} is over the limit of {safety['tracking'][k]:.3g}"
        case "start_position":
            return f"stands {error:.3g} {unit} from the trajectory's start, over the limit of {safety['start'][k]:.3g}"
        case "speed":
            return _speed(k, rows, settings)
        case "position":
            return f"position {position:.4g} {unit} is outside {safety['low'][k]:.4g} to {safety['high'][k]:.4g}"
        case "torque_limit":
            seconds, limit = safety["saturated"] * settings.dt, settings.drive["torque_limit"][k]
            return f"the torque has been at its limit of {limit:.4g} {joint.force_unit} for {seconds:.3g} s"
        case "encoder_frozen":
            travel = safety["frozen"][k]
            return f"the encoder has not counted while the joint was to move by {travel:.3g} {unit}"
        case "encoder_jump" if len(rows) < 2:
            return f"the encoder jumps by more than {safety['jump'][k]} counts in a control period"
        case "encoder_jump":
            jump = int(np.diff(rows["counts"][-2:, k])[0])
            return f"the encoder jumps by {jump} counts in a control period, the limit is {safety['jump'][k]}"
    return None


def _speed(k: int, rows: NDArray[Any], settings: Settings) -> str:
    unit, limit = settings.model.joints[k].position_unit, f"{settings.safety['speed'][k]:.3g}"
    if len(rows) != int(rows["period"][-1]) + 1:
        # The controller's filter runs through all periods, and some are missing here.
        return f"speed is over the limit of {limit} {unit}/s"
    q, gain = settings.positions(rows["counts"])[k], settings.drive["velocity_gain"]
    raw = np.diff(q, prepend=q[0]) * settings.drive["rate"]
    speed = abs(float(lfilter([gain], [1.0, gain - 1.0], raw)[-1]))
    return f"speed {speed:.3g} {unit}/s is over the limit of {limit}"
