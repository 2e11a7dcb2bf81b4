"""What further sensors would have read on a bench: link-side encoders, torque sensors at the output, rigid torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from runtime.arrays import Array

from .bench import Bench, Hiding
from .bodies import torque
from .plant import COUNT, PERIOD, Run

NOISE = 0.05  # N m, of a torque sensor at the output


def link_angles(run: Run) -> Array:
    """(n, N) rad, as encoders with the motors' counts read them."""
    angles: Array = np.round(run.link / COUNT) * COUNT
    return angles


def output_torque(bench: Bench, run: Run, hidden: Sequence[Hiding], seed: int) -> Array:
    """(n, N) N m transmitted to the links: what accelerates them, against what pushes them and against springs."""
    rows, arm = bench.plant(hidden)
    rate = np.gradient(run.link, PERIOD, axis=1)
    acceleration = np.zeros_like(rate)
    acceleration[:, 1:-1] = np.diff(run.link, 2, axis=1) / PERIOD**2
    links = [replace(body, rotor=0.0) for body in bench.bodies]
    found = torque(links, np.array([run.link, rate, acceleration]), _gravity(arm)) - bench.background
    for i, row in enumerate(rows):
        found[i] += row.get("SPRING", 0.0) * (run.link[i] - row.get("SPRING_REST", 0.0))
    return found + NOISE * np.random.default_rng(seed).standard_normal(found.shape)


def rigid_torque(bench: Bench, run: Run, hidden: Sequence[Hiding]) -> Array:
    """(n, N) N m, as a model of one's own predicts it from motion that a good filter has smoothed: rotors included."""
    q = run.q
    rate = np.gradient(q, PERIOD, axis=1)
    found: Array = torque(
        bench.bodies, np.array([q, rate, np.gradient(rate, PERIOD, axis=1)]), _gravity(bench.plant(hidden)[1])
    )
    return found


def _gravity(arm: dict[str, float]) -> tuple[float, float]:
    return arm.get("GRAVITY_X", 0.0), arm.get("GRAVITY_Y", 0.0)
