"""First motions: what `tendon experiment` proposes for a user's model file, within the range, the speed and the
acceleration of today's excitation and about as long. The motion is all that the judge takes from the library that it
judges.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import tomlkit

from runtime.arrays import Array
from runtime.experiments.excitation import NoRoom
from runtime.experiments.first import MotionPlanner
from runtime.experiments.first_proposal import ArmToMove, ReadyArm
from runtime.experiments.options import ExperimentSettings, FirstMotionSettings
from runtime.simulation.settings import MARGIN
from runtime.workspace.source import Source
from tests.kept import kept

from .motion import PERIOD

ANY_TIP_SPEED = 20.0
"""m/s; today's excitation keeps to none."""
ANY_TORQUE = 1e9
"""N m."""


def first_motion(text: str, ordinary: Array, number: int) -> Array:
    """Angles (n, N) rad at 1 kHz, one motion of several for a model file.

    ordinary   (3, n, N) of today's excitation, about the middle of whose range the arm moves
    number     0 for the motion that is fitted, 1 for the one that is held out
    """
    angle, rate, acceleration = ordinary
    low, high = angle.min(axis=1), angle.max(axis=1)
    found: Array = kept(
        searched,
        within(text, low, high, np.abs(rate).max(axis=1)),
        np.abs(acceleration).max(axis=1),
        seconds=float(round(angle.shape[1] * PERIOD)),
        number=number,
    )
    return found


def within(text: str, low: Array, high: Array, speed: Array) -> str:
    """The model file with limits (n,) that a motion reaches: proposed ones keep a margin to what a file states."""
    document = tomlkit.parse(text)
    middle, reach = (low + high) / 2, (high - low) / 2 / MARGIN
    for joint, at, half, fastest in zip(document["joint"], middle, reach, speed / MARGIN, strict=True):
        stated = tomlkit.inline_table()
        stated.update({"position": [float(at - half), float(at + half)], "speed": float(fastest)})
        joint["limits"] = stated
    return tomlkit.dumps(document)


def searched(text: str, acceleration: Array, seconds: float, number: int) -> Array:
    """(n, N) rad; the motion that is proposed for a model file.

    acceleration   (n,) rad/s^2; no file states one, and what is assumed in its place is a robot's, not today's
    excitation's. The torque has no limit, as that excitation has none.
    """
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "model.toml"
        path.write_text(text, encoding="utf-8")
        compiled = Source.read(path, None).compiled
        model = compiled.model()
        likely, assumed = compiled.with_likely_numbers()
        to_move = ArmToMove(model, likely.model(), likely.arm, assumed, NoRoom(), [])
        chosen = FirstMotionSettings(seconds=max(seconds, 20.0), tip_speed=ANY_TIP_SPEED)
        ready = ReadyArm.of(to_move, ExperimentSettings(seed=number), chosen)
        pairs = zip(ready.limits.envelopes, acceleration.tolist(), strict=True)
        envelopes = [replace(envelope, acceleration=most) for envelope, most in pairs]
        limits = replace(ready.limits, envelopes=envelopes, torque=np.full(len(envelopes), ANY_TORQUE))
        planner = MotionPlanner(limits, ready.moving, ready.start, chosen.seconds)
        return planner.motion(number, lambda _: None).path
