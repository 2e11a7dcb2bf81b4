"""What a simulator brings to the judge: its arms, what can be hidden in them, its bench and its users' model files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array

from .bench import Bench, Setting, bench, specimen
from .bodies import ARMS, Bodies, model_text
from .hidden import ENTRIES, PAIRS, Entry, Rows

Benches = Callable[[Setting, Array, np.random.Generator, bool, Rows], Bench]
Specimens = Callable[[Bodies, Sequence[str], np.random.Generator], Rows]
Files = Callable[[Setting, int, Sequence[str], Sequence[float]], str]
"""(setting, seed, believed effects, gravity that the user knows) -> the model file."""


@dataclass(frozen=True)
class World:
    """arms: by the number of joints; specimen: an arm's rows before anything is hidden; knows: whether true parameters
    can be compared with intervals; held_out: the part of a motion that is recorded a second time."""

    arms: Callable[[int], Bodies]
    entries: Mapping[str, Entry]
    pairs: Sequence[tuple[str, str]]
    bench: Benches
    specimen: Specimens
    model_text: Files
    knows: bool
    held_out: float


def _file(setting: Setting, _seed: int, believed: Sequence[str], gravity: Sequence[float]) -> str:
    return model_text(ARMS[setting.joints], believed, gravity, setting.gear_ratio)


PLANT = World(ARMS.__getitem__, ENTRIES, PAIRS, bench, specimen, _file, True, 1.0)
"""The judge's own simulator."""


def world_of(setting: Setting) -> World:
    """ImportError where the package mujoco is missing and wanted."""
    if not setting.simulator:
        return PLANT
    from .mujoco_world import MUJOCO

    return MUJOCO
