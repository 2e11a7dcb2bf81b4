"""Arms whose generated C others use, their files in a folder, and the same numbers by NumPy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import spatial_arms
from random_arms import MIXED, loaded

from codegen import prepare
from codegen.c.arm_effects import ArmEffects
from codegen.package.package import package_files
from runtime.arrays import Array
from runtime.model.loader import Library, Model
from runtime.notebook.effects_along import whole_torque
from symbolic.effects import shipped
from symbolic.effects.declaration import Effect
from symbolic.model import derive
from symbolic.model_file.arm import Arm, Drive

SAMPLES, DT = 40, 2.0**-7  # s; sums of it are exact, as is the product by which NumPy has the time


def busy() -> Arm:
    """Revolute and prismatic joints with a law of their drives and every effect that generated code can compute."""
    arm = loaded(replace(MIXED["rprrp"], name="busy"))
    library = shipped(space=False)
    gone = {site.effect.name for site, _ in ArmEffects.of(derive(arm), library).left_out}
    servo = Drive(law="position_servo", gains={"kp": 30.0, "kd": 2.0, "saturation": 5.0})
    joints = tuple(
        replace(j, drive=servo, effects={k: v for k, v in j.effects.items() if k not in gone}) for j in arm.joints
    )
    return replace(arm, joints=joints, effects={k: v for k, v in arm.effects.items() if k not in gone})


def spatial() -> Arm:
    """A spatial arm with names for its joints."""
    arm = spatial_arms.drawn("rpr", 3)
    named = tuple(replace(j, name=f"axis-{i} (of 3)") for i, j in enumerate(arm.joints, 1))
    return replace(arm, name="spatial", joints=named)


@dataclass(frozen=True)
class Packaged:
    """An arm and everything that is generated for it."""

    arm: Arm

    @property
    def name(self) -> str:
        return self.arm.name

    @cached_property
    def library(self) -> Mapping[str, Effect]:
        return shipped(self.arm.space)

    @cached_property
    def files(self) -> dict[str, str]:
        return package_files(derive(self.arm), self.library)

    def written(self, folder: Path) -> Path:
        """The folder with the files."""
        for path, text in self.files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text, encoding="utf-8")
        return folder

    @cached_property
    def model(self) -> Model:
        return Model(prepare.prepare_arm(self.arm), Library(prepare.prepare_effects(space=self.arm.space)))

    @cached_property
    def inputs(self) -> dict[str, Array]:
        """Samples (n, N) of every input of the arm's functions; qd is exactly zero now and then."""
        rng = np.random.default_rng(4)
        shapes = {name: shape for f in self.model.metadata["functions"].values() for name, shape in f["inputs"]}
        found = {name: rng.uniform(-2.0, 2.0, (*shape, SAMPLES)) for name, shape in sorted(shapes.items())}
        found["qd"][:, ::7] = 0.0
        return found

    def outputs(self) -> dict[str, Array]:
        """Every function of the arm by NumPy, (N, size) with the samples first."""
        model = self.model
        found = {}
        for name, page in model.metadata["functions"].items():
            result = model.call(name, {k: self.inputs[k] for k, _ in page["inputs"]}, model.lump_values)
            found[name] = np.ascontiguousarray(result.reshape(-1, SAMPLES).T)
        return found

    def torque(self) -> Array:
        """(N, n) with all effects, the samples as one motion."""
        motion = {name: self.inputs[name] for name in ("q", "qd", "qdd")}
        return np.ascontiguousarray(whole_torque(self.model, **motion, dt=DT).T)
