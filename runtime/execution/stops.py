"""Why an arm was stopped, in words: what was measured, what the limit is, in which unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from runtime.hardware.session import Ended
from runtime.hardware.settings import Settings

Array = NDArray[np.float64]

HOST = {
    "interrupted": "interrupted (Ctrl-C, or its terminal was closed)",
    "telemetry_lost": "telemetry of the board is lost",
    "link_lost": "the link to the board is lost",
    "other_rate": "the board keeps another rate",
    "overrun": "the board ran on after the plan was over and was stopped",
    "untrusted": "the board cannot be trusted and was stopped",
}
"""Reasons of the host; the board has its own."""


def words(ended: Ended, rows: NDArray[Any], settings: Settings, texts: Mapping[str, str]) -> str:
    """One sentence. rows: the run's telemetry (N,); texts: the reasons by name, as the protocol has them."""
    if ended.reason == "drive":
        return ended.detail or f"{texts[ended.reason]} (code {ended.code})"
    # Both ends may lose the link; the host says what it has seen.
    if ended.detail or ended.reason not in texts:
        return HOST[ended.reason] + (f": {ended.detail}" if ended.detail else "")
    if ended.joint is not None and ended.reason in _MEASURED and len(rows) and rows[-1]["period"] == ended.period:
        return _MEASURED[ended.reason](ended.joint - 1, rows, settings)
    return texts[ended.reason]


def _position(k: int, rows: NDArray[Any], settings: Settings) -> float:
    return float(settings.positions(rows["counts"][-1:])[k, 0])


def _unit(k: int, settings: Settings) -> str:
    return settings.model.joints[k].position_unit


def _tracking(k: int, rows: NDArray[Any], settings: Settings) -> str:
    error = abs(_position(k, rows, settings) - rows[-1]["q_desired"][k])
    return f"tracking error {error:.3g} {_unit(k, settings)} is over the limit of {settings.safety['tracking'][k]:.3g}"


def _start(k: int, rows: NDArray[Any], settings: Settings) -> str:
    error = abs(_position(k, rows, settings) - rows[-1]["q_desired"][k])
    limit = settings.safety["start"][k]
    return f"stands {error:.3g} {_unit(k, settings)} from the trajectory's start, over the limit of {limit:.3g}"


def _speed(k: int, rows: NDArray[Any], settings: Settings) -> str:
    limit = f"over the limit of {settings.safety['speed'][k]:.3g} {_unit(k, settings)}/s"
    if len(rows) != int(rows["period"][-1]) + 1:
        # Not every period is there, and the filter runs through all of them.
        return f"speed is {limit}"
    q, gain = settings.positions(rows["counts"])[k], settings.drive["velocity_gain"]
    raw = np.diff(q, prepend=q[0]) * settings.drive["rate"]
    speed = abs(float(lfilter([gain], [1.0, gain - 1.0], raw)[-1]))
    return f"speed {speed:.3g} {_unit(k, settings)}/s is over the limit of {settings.safety['speed'][k]:.3g}"


def _range(k: int, rows: NDArray[Any], settings: Settings) -> str:
    low, high = (settings.safety[end][k] for end in ("low", "high"))
    return f"position {_position(k, rows, settings):.4g} {_unit(k, settings)} is outside {low:.4g} to {high:.4g}"


def _saturated(k: int, _rows: NDArray[Any], settings: Settings) -> str:
    seconds = settings.safety["saturated"] * settings.dt
    limit, unit = settings.drive["torque_limit"][k], settings.model.joints[k].force_unit
    return f"the torque has been at its limit of {limit:.4g} {unit} for {seconds:.3g} s"


def _frozen(k: int, _rows: NDArray[Any], settings: Settings) -> str:
    travel = settings.safety["frozen"][k]
    return f"the encoder has not counted while the joint was to move by {travel:.3g} {_unit(k, settings)}"


def _jump(k: int, rows: NDArray[Any], settings: Settings) -> str:
    if len(rows) < 2:
        return f"the encoder jumps by more than {settings.safety['jump'][k]} counts in a control period"
    jump = int(np.diff(rows["counts"][-2:, k])[0])
    return f"the encoder jumps by {jump} counts in a control period, the limit is {settings.safety['jump'][k]}"


_MEASURED: Mapping[str, Callable[[int, NDArray[Any], Settings], str]] = {
    "tracking": _tracking,
    "start_position": _start,
    "speed": _speed,
    "position": _range,
    "torque_limit": _saturated,
    "encoder_frozen": _frozen,
    "encoder_jump": _jump,
}
