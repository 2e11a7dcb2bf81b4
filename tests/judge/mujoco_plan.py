"""The sets of cases of MuJoCo's arms: one to develop with, one to judge by, whose seeds nobody develops with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .bench import Setting
from .cases import Case
from .mujoco_world import MUJOCO
from .plan import Share, Sizes, drawn

FIRST = {"development": 4000, "judging": 30_000}
"""Seeds."""
RATES = (1, 2, 4, 8)
"""Periods of the drives a step: 1000 to 125 Hz."""
LEVELS = (0.2, 0.1)
"""N m, of the torque's noise. Below, it would show the few ms in which MuJoCo's friction comes to rest."""
OF_SINGLE: Sizes = {"half": lambda _: 0.5, "large": lambda _: 2.0}
"""In noise floors: hard to name, and to be named always."""
CLEAN = ("clean", "clean_coloured", "clean_x10", "clean_low_noise")
NUMBERS: dict[str, dict[int, int]] = {
    "single": {1: 20, 4: 8, 6: 9, 7: 7},
    "half": {1: 14, 4: 5, 6: 5, 7: 4},
    "clean": {1: 12, 4: 8, 6: 10, 7: 8},
    "pairs": {1: 8, 4: 4, 6: 5, 7: 4},
    "forms": {1: 8, 4: 3, 6: 3, 7: 2},
    "unknown": {1: 6, 4: 4, 6: 5, 7: 4},
    "inside": {1: 5, 4: 2, 6: 2, 7: 2},
}
"""Cases of a class, by the number of joints."""


def _shares() -> list[Share]:
    out = []
    for kind, by_joints in NUMBERS.items():
        for n, number in by_joints.items():
            size = "half" if kind == "half" else "large"
            out.append(Share(names("single" if kind == "half" else kind, n), n, number, size, "fourier"))
    return out


def names(kind: str, n: int) -> tuple[str, ...]:
    """What a case of a class can be on the arm of n joints."""
    if kind == "clean":
        return CLEAN
    if kind == "pairs":
        pairs = ["+".join(pair) for pair in MUJOCO.pairs]
        return tuple(pairs)
    arm = MUJOCO.arms(n)
    return tuple(k for k, e in MUJOCO.entries.items() if e.kind == kind and e.fits(arm))


def _recorded(case: Case, rng: np.random.Generator) -> Setting:
    """The case's setting at a rate and a noise that are drawn."""
    every, level = int(rng.choice(RATES)), float(rng.choice(LEVELS))
    if case.kind == "clean":
        level = max(case.setting.level, min(LEVELS))
    return replace(case.setting, logger=replace(case.setting.logger, every=every), level=level)


def mujoco(purpose: str) -> list[Case]:
    """The set for "development" or for "judging"."""
    rng = np.random.default_rng([FIRST[purpose], *map(ord, "mujoco")])
    base = Setting(simulator="mujoco")
    return drawn(_shares(), FIRST[purpose], rng, base, _recorded, OF_SINGLE)
