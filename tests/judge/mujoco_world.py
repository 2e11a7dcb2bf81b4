"""MuJoCo as a world of the judge: its arms, its bench and the model files of its users."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from runtime.arrays import Array

from . import mujoco_arms, mujoco_plant
from .bench import Bench, Hiding, Setting, built, specimen
from .bodies import Bodies
from .hidden import Hidden, Rows
from .mujoco_hidden import MECHANISMS, PAIRS
from .plant import Run
from .world import World


class MujocoBench(Bench):
    """A bench whose arm MuJoCo moves."""

    def part(self, what: Hidden) -> Bench:
        """One repeat of a motion that has four, unless the effect has a time of its own."""
        if self.setting.excitation != "fourier" or what.push is not None or what.truth == "payload":
            return self
        count = self.motion.shape[-1] // 4
        cut = {name: getattr(self, name)[..., :count] for name in ("motion", "forward", "warm", "background", "noise")}
        return replace(self, **cut, warmth=self.warmth[:, :count], period=self.period[:count])

    def run(self, hidden: Sequence[Hiding]) -> Run:
        """MuJoCo's arm with effects hidden in it. Raises RanAwayError."""
        rows, arm = self.plant(hidden)
        pushes = self.background.copy()
        for what, joint, amount in hidden:
            if what.push is not None:
                pushes[joint] += what.push(self.t, amount)
        return mujoco_plant.simulate(self.n, rows, arm, self.motion, self.forward, pushes)


def _bench(setting: Setting, wanted: Array, rng: np.random.Generator, warms: bool, rows: Rows) -> Bench:
    made = built(mujoco_arms.bodies(setting.joints), setting, wanted, rng, warms, rows)
    return MujocoBench(**{f.name: getattr(made, f.name) for f in fields(made)})


def _specimen(bodies: Bodies, believed: Sequence[str], rng: np.random.Generator) -> Rows:
    """As the judge's own, with dry friction that is the same in both directions: MuJoCo has no other."""
    rows = specimen(bodies, believed, rng)
    for row in rows:
        row["DRY_POSITIVE"] = row["DRY_NEGATIVE"] = 0.5 * (row["DRY_POSITIVE"] + row["DRY_NEGATIVE"])
    return rows


def _file(setting: Setting, seed: int, believed: Sequence[str], gravity: Sequence[float]) -> str:
    return mujoco_arms.model_text(setting.joints, seed, believed, gravity, setting.gear_ratio)


MUJOCO = World(mujoco_arms.bodies, MECHANISMS, PAIRS, _bench, _specimen, _file, knows=False, held_out=0.5)
