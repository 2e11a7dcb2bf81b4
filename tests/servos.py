"""Recordings of a one-joint servo without a torque signal, from equations written apart from the library's.

The joint is that of plants.py, with two of its hidden effects. A position servo makes its torque from the error of
position and rate alone; a bridge puts a part of a sagging supply on a motor with back-EMF.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import plants

from runtime.arrays import Array
from runtime.simulation import demo

KP, KD = 300.0, 15.0  # N m/rad, N m s/rad
KT, OHM = 2.0, 2.0  # N m/A, ohm, at the joint's output
SUPPLY = 48.0  # V, without load
SERVO = f'law = "position_servo"\nkp = {KP}\nkd = {KD}\n'
BRIDGE = f'law = "pwm"\ntorque_constant = {KT}\nresistance = {OHM}\n'


@dataclass(frozen=True)
class ServoLog:
    """Columns by header cell, (N,) each, and the torque tau (N,) N m of the equations at these samples."""

    columns: Mapping[str, Array]
    tau: Array

    def write(self, path: Path, torque: bool = False) -> Path:
        """As CSV: the command's columns, or q and the torque."""
        kept = {
            cell: x for cell, x in self.columns.items() if not torque or cell in ("t [s]", "q1 [rad]", "qd1 [rad/s]")
        }
        kept |= {"tau1 [N m]": self.tau} if torque else {}
        rows = np.column_stack(list(kept.values()))
        np.savetxt(path, rows, fmt="%.12g", delimiter=",", header=",".join(kept), comments="")
        return path


def _loop(
    seed: int, advance: Callable[..., None], torque: Callable[[Array, float, float, float], Any]
) -> tuple[Array, ...]:
    """Time (N,), desired (3, N), counted angle and its rate (N,), under torque(desired, seen, rate, time), or what else
    advance makes its torque of."""
    t, desired = demo.motion(np.random.default_rng(seed), 2)
    state, angles, rates = [0.0] * 4, [], []
    for k, wanted in enumerate(desired.T):
        seen, rate = round(state[0] / demo.COUNT) * demo.COUNT, state[1]
        angles.append(seen)
        rates.append(rate)
        advance(state, torque(wanted, seen, rate, float(t[k])), float(t[k]))
    return t, desired, np.array(angles), np.array(rates)


def _friction(hidden: str | None, brake: float = 0.0) -> Callable[[float, int, float], float]:
    """That of plants.py; brake: N m s/rad of a motor's back-EMF, which acts at every instant."""

    def opposing(speed: float, side: int, _time: float) -> float:
        creep = plants.SIZES["stribeck"] * np.exp(-((speed / 0.15) ** 2)) if hidden == "stribeck" else 0.0
        return demo.friction(speed, side, hidden=False) + float(creep) + brake * speed

    return opposing


def _spring(hidden: str | None) -> Callable[[float, float], float]:
    size = plants.SIZES["linear_spring"] if hidden == "linear_spring" else 0.0
    return lambda q, _t: size * (q - 0.3)


def servo(hidden: str | None, seed: int, most: float = np.inf, every: int = 1) -> ServoLog:
    """A position servo, told position and rate, that measures its rate; most: N m that it makes.

    It closes its loop at every instant, on the joint's angle itself, and holds what it is told for a sample: that of
    its log, which has one of so many periods.
    """
    opposing, load, parts = _friction(hidden), _spring(hidden), 8
    h, steps, told = demo.PERIOD / parts, count(), 0.0

    def torque(want: Array, seen: Array, rate: Array) -> Array:
        return np.clip(KP * (want[0] - seen) + KD * (want[1] - rate), -most, most)

    def advance(state: demo.State, want: Array, time: float) -> None:
        nonlocal told
        if next(steps) % every == 0:
            told = KP * want[0] + KD * want[1]
        for _ in range(parts):
            q, qd = state[0], state[1]
            # Of the middle of the step, to the second order: an answer half a step late would be another inertia.
            made = told - KP * (q + h / 2 * qd) - KD * (qd + h / 2 * state[2])
            drive = min(max(made, -most), most) - load(q, time)
            side = 1 if (qd or drive) > 0 else -1
            held = opposing(abs(qd), side, time)
            stuck = qd == 0.0 and abs(drive) <= held
            new = 0.0 if stuck else qd + h * (drive - side * held) / demo.INERTIA
            new = 0.0 if qd * new < 0.0 else new
            state[:3] = [q + h / 2 * (qd + new), new, (new - qd) / h]

    t, wanted, q, qd = (x[..., ::every] for x in _loop(seed, advance, lambda want, *_: want))
    columns = {
        "t [s]": t,
        "q1 [rad]": q,
        "qd1 [rad/s]": qd,
        "q1_desired [rad]": wanted[0],
        "qd1_desired [rad/s]": wanted[1],
    }
    # The mean over the period that follows a sample, as a command is held: both are half a sample late.
    after = (np.append(x[1:], x[-1]) for x in (q, qd))
    return ServoLog(columns, (torque(wanted, q, qd) + torque(wanted, *after)) / 2)


def _supply(t: float) -> float:
    return float(SUPPLY - 3.0 * np.sin(0.7 * t) ** 2)


def _duty(want: Array, seen: float, rate: float, t: float) -> float:
    asked = KP * (want[0] - seen) + KD * (want[1] - rate)
    return float(np.clip((asked * OHM / KT + KT * rate) / _supply(t), -1.0, 1.0))


def bridge(hidden: str | None, seed: int) -> ServoLog:
    """A motor on a bridge, whose duty a controller sets."""

    t, wanted, q, qd = _loop(
        seed,
        demo.stick_slip(_friction(hidden, KT**2 / OHM), _spring(hidden)),
        lambda *at: KT / OHM * _duty(*at) * _supply(at[-1]),
    )
    supply = np.array([_supply(float(x)) for x in t])
    duty = np.array([_duty(*x) for x in zip(wanted.T, q, qd, t, strict=True)])
    columns = {"t [s]": t, "q1 [rad]": q, "qd1 [rad/s]": qd, "duty1": duty, "bus_voltage1 [V]": supply}
    return ServoLog(columns, KT / OHM * (duty * supply - KT * qd))


def model(drive: str, text: str) -> str:
    """A model file's text with a drive at its first joint."""
    return text.replace("[joint.link]", f"[joint.drive]\n{drive}[joint.link]", 1)
