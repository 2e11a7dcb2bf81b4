"""Arms whose rotors or links a user's model file leaves open, their recordings, and what users do to a torque."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from runtime.fit_warnings import Suspicion, doubts, suspicions
from runtime.identification.identify import identify
from runtime.model.loader import Model
from runtime.recordings.recording import Recording
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import simulate
from runtime.workspace.source import Source
from tests.sources import ROOT

RATIO, CONSTANT = 101.0, 12.0
"""Of all joints; N m/A at the output."""
ROTORS = {"ur10": (1.5, 2.0, 1.2, 0.4, 0.4, 0.3), "panda": (0.6, 0.6, 0.5, 0.4, 0.2, 0.2, 0.15)}
OPEN = {"rotors": ("rotor_inertia",), "rotors and inertias": ("rotor_inertia", "inertia"), "masses": ("mass", "com")}
"""What a user's file leaves out."""


def true_text(arm: str) -> str:
    """The shipped model file with rotors, gears and, in the plane, gravity along −y."""
    text = (ROOT / "symbolic" / "arms" / f"{arm}.toml").read_text(encoding="utf-8")
    if arm in ROTORS:
        rotors = iter(ROTORS[arm])
        text = re.sub(
            r"(?m)^gear_ratio = 1\b.*$", lambda _: f"gear_ratio = {RATIO:g}\nrotor_inertia = {next(rotors)}", text
        )
        return re.sub(r'(?m)^torque = "link".*\n', "", text)
    return text.replace("gravity = [0.0, 0.0]", "gravity = [0.0, -9.81]")


def users_text(arm: str, left_open: str) -> str:
    """What a user has of it."""
    text = true_text(arm)
    for key in OPEN[left_open]:
        text = re.sub(rf"(?m)^{key} = .*\n", "", text)
    return text


def source(arm: str, text: str) -> Source:
    return Source(Path(f"{arm}.toml"), text)


@cache
def users_model(arm: str, left_open: str) -> Model:
    return source(arm, users_text(arm, left_open)).compiled.model()


@cache
def sound(arm: str, seed: int = 1) -> Recording:
    """30 s at 1 kHz, with rotors and friction, from the whole model."""
    made, _ = simulate(true_model(arm), settings=SimulationSettings(seed=seed, seconds=30))
    return made


@cache
def true_model(arm: str) -> Model:
    return source(arm, true_text(arm)).compiled.model()


def weight(arm: str, recording: Recording) -> np.ndarray:
    """(n, N) N m, what holds the arm still."""
    still = np.zeros_like(recording.q)
    return true_model(arm).inverse_dynamics(recording.q, still, still)


def without_gravity(arm: str, recording: Recording) -> Recording:
    return replace(recording, tau=recording.tau - weight(arm, recording))


def suspected(model: Model, recording: Recording) -> tuple[Suspicion, ...]:
    return suspicions(identify(model, [recording]))


def doubted(model: Model, recording: Recording) -> tuple[Suspicion, ...]:
    return doubts(identify(model, [recording]))


MISTAKES: dict[str, tuple[Callable[[Recording], Recording], str, str]] = {
    "before the gear": (lambda r: replace(r, tau=r.tau / RATIO), "ratio", "times the gear ratio of "),
    "twice the gear": (lambda r: replace(r, tau=r.tau * RATIO), "twice", "divide tau"),
    "mN m": (lambda r: replace(r, tau=1000 * r.tau), "milli", "[mN m]"),
    "mA": (lambda r: replace(r, tau=1000 * r.tau / CONSTANT), "milli", "[mA]"),
    "kN m": (lambda r: replace(r, tau=r.tau / 1000), "whole", "[kN m]"),
    "sign": (lambda r: replace(r, tau=-r.tau), "sign", '="-tau'),
    "degrees": (lambda r: replace(r, q=np.degrees(r.q)), "degrees", "[deg]"),
}
"""What was done to a recording, the kind of suspicion, and a part of what to type."""
