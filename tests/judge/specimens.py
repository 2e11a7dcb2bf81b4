"""Recordings of one specimen of an arm with something changed in it, or with an effect of a size that a limit says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from runtime.recordings.recording import Recording

from .bench import LEVEL, Bench, Setting, bench, specimen
from .bodies import ARMS, BELIEVED
from .hidden import Hidden, Put, Rows, at
from .limits import hidden
from .motion import desired

SEED = 31
MORE = 0.3  # kg at the end-effector


def carrying(_rows: Rows, arm: dict[str, float], _amount: float) -> None:
    arm.update(PAYLOAD=MORE, PAYLOAD_TIME=0.0)


CHANGES: dict[str, Put] = {"payload": carrying, "thinner grease": at(0, VISCOUS_POSITIVE=0.77, VISCOUS_NEGATIVE=0.77)}


def of_two_joints(seed: int, name: str, change: str | None = None) -> Recording:
    """Half of a motion of its own, by the same specimen of the arm, with a change out of CHANGES or not."""
    rows = specimen(ARMS[2], BELIEVED, np.random.default_rng(5))
    rng = np.random.default_rng(seed)
    wanted = desired(rng, 2, "no_repeat")[..., :30_000]
    plant = bench(Setting(joints=2), wanted, rng, False, rows)
    put = [] if change is None else [(Hidden("", 1.0, (0.0, 1.0), CHANGES[change]), 0, 1.0)]
    return replace(plant.recording(plant.run(put)), path=Path(name))


def clean() -> Recording:
    """Of one joint."""
    plant = _plant()
    return plant.recording(plant.run([]))


def at_limit(limit: Mapping[str, Any], times: float) -> Recording:
    """The same with an effect `times` as strong as a limit of `would_have_seen`, and noise of another draw than that
    from which the limit was computed."""
    what, plant = hidden(limit, times), _plant()
    assert what is not None
    noise = LEVEL * np.random.default_rng(SEED + 1).standard_normal(plant.noise.shape)
    other = replace(plant, noise=noise)
    return other.recording(other.run([what]))


def _plant() -> Bench:
    """Half of a motion, which is enough for every effect of test_limits.py."""
    rng = np.random.default_rng(SEED)
    rows, wanted = specimen(ARMS[1], BELIEVED, rng), desired(rng, 1)
    return bench(Setting(), wanted[..., : wanted.shape[-1] // 2], rng, False, rows)
