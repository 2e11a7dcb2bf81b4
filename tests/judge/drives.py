"""Recordings without a torque: the same runs of the plant, with what each drive was told in the torque's place.

The motion and the torque are those of the run that has a torque, its noise included: the noise is what a drive makes
beside its law. A servo compares the demanded position with the angle itself, at the drives' period; the recording has
what the encoder reads of it, at the logger's. Between two samples a bridge's duty is the mean, as a torque is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import tomlkit
from scipy import signal

from runtime.arrays import Array
from runtime.recordings.recording import Recording

from . import recorder
from .bench import Bench
from .plant import PERIOD, Run

FORMS = ("servo", "servo_open", "pwm", "pwm_open")
"""What is recorded in place of a torque: demanded positions, or duties and the supply's voltage; open: by a drive whose
gains the model file does not state."""
SUPPLY, SAG = 24.0, 2.0  # V
BRAKING = 8.0  # V that the motor induces at FAST
FAST = 4.0  # rad/s


@dataclass(frozen=True)
class Motor:
    """A joint's drive: a servo's kp, N m/rad, and kd, N m s/rad; a motor's k, N m/A or V s/rad, at the joint, and its
    resistance, ohm."""

    kp: float
    kd: float
    k: float
    resistance: float

    @property
    def gains(self) -> dict[str, float]:
        """By the names of the laws' coefficients."""
        return {"kp": self.kp, "kd": self.kd, "torque_per_volt": self.k / self.resistance}

    def keys(self, form: str) -> dict[str, float | str]:
        """Of its table in the model file."""
        servo = form.startswith("servo")
        gains = {"kp": self.kp, "kd": self.kd} if servo else {"torque_constant": self.k, "resistance": self.resistance}
        return {"law": "position_servo" if servo else "pwm", **(gains if not form.endswith("open") else {})}


def motors(bench: Bench) -> tuple[Motor, ...]:
    """Of a bench's joints: servos with the gains of its controllers, motors that can do twice what those ask for."""
    k = BRAKING / FAST
    strong = [0.2 * row["KP"] + 10.0 * body.noise for row, body in zip(bench.rows, bench.bodies, strict=True)]
    rows = zip(bench.rows, strong, strict=True)
    return tuple(Motor(row["KP"], row["KD"], k, k * (SUPPLY - SAG - BRAKING) / most) for row, most in rows)


def stated(text: str, form: str, drives: Sequence[Motor]) -> str:
    """A model file's text with the drives of its joints."""
    document = tomlkit.parse(text)
    for joint, drive in zip(document["joint"], drives, strict=True):
        joint["drive"] = drive.keys(form)
    return tomlkit.dumps(document)


def recording(bench: Bench, run: Run, drives: Sequence[Motor], form: str) -> Recording:
    """What the bench's logger writes of a run: commands, and a torque of NaN, as one that is not recorded."""
    whole = bench.recording(run)
    written = whole.with_torques(np.full_like(whole.tau, np.nan))
    if form.startswith("servo"):
        told = np.array([_demanded(x, tau, q) for x, tau, q in zip(drives, run.tau + bench.noise, run.q, strict=True)])
        return replace(written, q_desired=np.ascontiguousarray(told[:, bench.logged]))
    supply = SUPPLY - SAG * np.sin(0.7 * bench.t[bench.logged]) ** 2
    rate = recorder.means(run.rate, bench.logged, recorder.held(bench.setting.logger))
    k, resistance = (np.array([[getattr(x, name)] for x in drives]) for name in ("k", "resistance"))
    duty = (whole.tau * resistance / k + k * rate) / supply
    if np.abs(duty).max() > 1.0:
        raise ValueError(f"the bridge is asked for {np.abs(duty).max():.2f} of its supply")
    return replace(written, commands={"duty": duty, "bus_voltage": np.tile(supply, (len(duty), 1))})


def _demanded(drive: Motor, tau: Array, q: Array) -> Array:
    """(N,) rad at which kp e + kd de/dt = tau for the error e of the angle q (N,), both held over a period."""
    decay = np.exp(-drive.kp / drive.kd * PERIOD)
    held = np.concatenate([tau[:1], tau[:-1]]) / drive.kp
    error, _ = signal.lfilter([1 - decay], [1, -decay], held, zi=[decay * held[0]])
    return np.asarray(q + error)
