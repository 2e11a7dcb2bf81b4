"""The simulated drive of `tendon demo`, written independently of the library's equations.

One joint with a harmonic drive under position control at 1 kHz, integrated in closed loop. Friction opposes the motion
and holds the joint at rest (Karnopp's stick rule), the controller reads encoder counts, and the recording contains its
torque command with noise. The hidden effect is extra friction at low speed.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.recordings import recording

State = list[float]
Advance = Callable[[State, float, float], None]
"""(state, torque N m, time s): advances the state by one period; state[0] is the motor's angle at the joint, rad."""

PERIOD = 1e-3
SUBSTEPS = 4
INERTIA = 0.2365  # kg m^2: rotor 0.10 and link 0.1365, as drive.toml has them
COUNT = 2 * np.pi / 200_000  # rad at the joint
TORQUE_NOISE = 0.2  # N m, standard deviation of the recorded torque
COULOMB = {1: 1.72, -1: 1.05}  # N m, Table I of the paper, joint 4
VISCOUS, CUBIC = 1.14, -0.015
CREEP, CREEP_SPEED = 0.6, 0.15  # N m, rad/s, of the hidden effect
STIFFNESS, DAMPING = 340.0, 12.5  # N m/rad, N m s/rad, of the position controller, 6 Hz
RATE_FILTER = 0.3  # weight of a new difference of counts in the controller's rate


def record(seed: int, hidden: bool = True, repeats: int = 2) -> tuple[Array, Array, Array]:
    """A recording of the drive: t (N,) s, q (N,) rad, tau (N,) N m at the joint, all at 1 kHz.

    The seed determines motion and noise. The motion takes about 36 s and is made `repeats` times.
    """
    rng = np.random.default_rng(seed)
    t, desired = motion(rng, repeats)
    q, torque = closed_loop(desired, stick_slip(lambda speed, side, *_: friction(speed, side, hidden)))
    noise: Array = TORQUE_NOISE * rng.standard_normal(len(t))
    return t, q, torque + noise


def friction(speed: float, side: int, hidden: bool) -> float:
    """Magnitude of the friction torque, N m, at |qd| = speed in the direction `side` (+1 or -1)."""
    steady = COULOMB[side] + VISCOUS * speed + CUBIC * speed**3
    return steady + CREEP * exp(-(speed * speed) / (CREEP_SPEED * CREEP_SPEED)) if hidden else steady


def motion(rng: np.random.Generator, repeats: int) -> tuple[Array, Array]:
    """t (N,) s and the desired angle, rate and acceleration (3, N): slow legs, fast swings and a sweep, repeated."""
    pieces = [np.zeros(300)]
    for speed in (0.03, 0.07, 0.12, 0.2, 0.35):
        scaled = speed * rng.uniform(0.85, 1.15)
        pieces += [_leg(scaled, 1.6), _leg(-scaled, 1.6)]
    for speed in (0.6, 1.2, 2.4, 3.6, 4.6):
        amplitude = rng.uniform(0.45, 0.7)
        peak = speed * rng.uniform(0.9, 1.05)
        turns = max(1, round(2.0 * peak / (2 * np.pi * amplitude)))
        phase = np.arange(0.0, turns * 2 * np.pi * amplitude / peak, PERIOD) * peak / amplitude
        pieces += [peak * np.sin(phase), np.zeros(200)]
    # Two running means of 60 ms leave no jumps in acceleration and keep the distance travelled.
    mean, rest = np.full(60, 1 / 60), np.zeros(60)
    padded = np.concatenate([rest, *pieces, rest])
    smooth = np.convolve(np.convolve(padded, mean, "same"), mean, "same")
    block = np.concatenate([smooth, _sweep(rng.uniform(10.0, 14.0))])
    rate = np.tile(block, repeats)
    angle = np.cumsum(rate) * PERIOD
    t = np.arange(len(rate), dtype=np.float64) * PERIOD
    return t, np.stack([angle, rate, np.gradient(rate, PERIOD)])


def _leg(speed: float, seconds: float) -> Array:
    return np.concatenate([np.full(round(seconds / PERIOD), speed), np.zeros(100)])


def _sweep(highest: float, acceleration: float = 12.0, seconds: float = 4.0) -> Array:
    """Rate of a swept sine from 1.5 Hz to `highest` Hz at an acceleration amplitude in rad/s^2, faded in and out."""
    t = np.arange(0.0, seconds, PERIOD)
    frequency = 1.5 * (highest / 1.5) ** (t / seconds)
    phase = 2 * np.pi * np.cumsum(frequency) * PERIOD
    wave = acceleration / (2 * np.pi * frequency) * np.sin(phase) * np.sin(np.pi * t / seconds) ** 0.5
    return wave - wave.mean() * np.sin(np.pi * t / seconds) ** 2 / np.mean(np.sin(np.pi * t / seconds) ** 2)


def closed_loop(desired: Array, advance: Advance, state: State | None = None) -> tuple[Array, Array]:
    """Encoder angle and torque command, (N,) each, along desired (3, N).

    The controller is that of the paper's identification: PD with the inertia's torque, without friction.
    """
    state = [0.0, 0.0] if state is None else state
    counts, torques = [], []
    last, rate = 0.0, 0.0
    for k, (angle, wanted, acceleration) in enumerate(desired.T.tolist()):
        seen = round(state[0] / COUNT) * COUNT
        rate += RATE_FILTER * ((seen - last) / PERIOD - rate)
        last = seen
        torque = INERTIA * acceleration + STIFFNESS * (angle - seen) + DAMPING * (wanted - rate)
        counts.append(seen)
        torques.append(torque)
        advance(state, torque, k * PERIOD)
    return np.array(counts), np.array(torques)


def stick_slip(
    opposing: Callable[[float, int, float], float],
    load: Callable[[float, float], float] | None = None,
    inertia: float = INERTIA,
) -> Advance:
    """A rigid joint with dry friction: state (angle, rate).

    opposing(speed, side, time)   magnitude of friction, N m; at speed 0 the limit up to which it holds the joint
    load(angle, time)             other torque against the motor, N m
    """
    h = PERIOD / SUBSTEPS

    def advance(state: State, torque: float, time: float) -> None:
        angle, rate = state[0], state[1]
        for j in range(SUBSTEPS):
            drive = torque - load(angle, time + j * h) if load else torque
            side = 1 if (rate or drive) > 0 else -1
            held = opposing(abs(rate), side, time)
            if rate == 0.0 and abs(drive) <= held:
                continue
            new = rate + h * (drive - side * held) / inertia
            # A sign change within the substep is a stop; the next substep decides whether friction holds.
            new = 0.0 if rate * new < 0.0 else new
            angle += 0.5 * h * (rate + new)
            rate = new
        state[0], state[1] = angle, rate

    return advance


SEEDS = {"fitted.csv.gz": 1, "held_out.csv.gz": 2}


def record_files(directory: Path) -> list[Path]:
    """Records the drive with two different motions into `directory`. Raises OSError."""
    paths = []
    for name, seed in SEEDS.items():
        path = directory / name
        t, q, tau = record(seed)
        run = np.zeros(len(t), dtype=np.int64)
        whole = recording.Recording(
            path,
            t,
            run,
            q=q[None],
            tau=tau[None],
            types=("revolute",),
            segments=(slice(0, len(t)),),
            temperature=(None,),
        )
        recording.write(path, whole)
        paths.append(path)
    return paths
