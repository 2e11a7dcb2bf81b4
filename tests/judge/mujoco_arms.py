"""The arms that ship with Tendon, in MuJoCo: planar ones built joint by joint, UR10 and Panda read from their URDFs.

The user's model file has every body's mass and inertia up to OFF wrong, body by body.
"""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import tomlkit

from runtime.arrays import Array

from .bodies import Bodies, Body
from .space import SECOND, SPATIAL, SpatialBody

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = ROOT / "symbolic" / "arms"
ROBOTS = ROOT / "tests" / "robots"
NAMES = {1: "drive", 4: "vishard4", 6: "ur10", 7: "panda"}
"""By the number of joints."""
URDF = {6: "ur10_robot.urdf", 7: "panda.urdf"}
FINGERS = ("panda_finger_joint1", "panda_finger_joint2")
"""Are fixed in the arm that ships."""
OFF = 0.05
VARIANTS = 3
"""Different model files of an arm; each is compiled once."""


def spec(n: int) -> mujoco.MjSpec:
    """The arm of n joints alone: without friction, rotors and drives."""
    if n not in URDF:
        return _planar(_plane(n))
    made = mujoco.MjSpec.from_file(str(ROBOTS / URDF[n]))
    for equality in list(made.equalities):
        made.delete(equality)
    for joint in list(made.joints):
        if joint.name in FINGERS:
            made.delete(joint)
    for joint in made.joints:
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        joint.damping, joint.frictionloss = [0.0, 0.0, 0.0], 0.0
    return made


def _planar(bodies: Sequence[Body]) -> mujoco.MjSpec:
    made = mujoco.MjSpec()
    parent, reach = made.worldbody, 0.0
    for number, body in enumerate(bodies, 1):
        # A flat body: what it has about the other two axes is never felt.
        flat = 0.6 * body.inertia
        parent = parent.add_body(
            name=f"link{number}",
            pos=[reach, 0.0, 0.0],
            mass=body.mass,
            ipos=[*body.com, 0.0],
            inertia=[flat, flat, body.inertia],
            explicitinertial=True,
        )
        parent.add_joint(name=f"joint{number}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
        reach = body.length
    return made


def _file(n: int) -> dict[str, Any]:
    return tomllib.loads((SHIPPED / f"{NAMES[n]}.toml").read_text(encoding="utf-8"))


def _plane(n: int) -> tuple[Body, ...]:
    """Bodies and frictions as the file of a planar arm has them; frictions that it does not state are the drive's."""
    out = []
    for joint in _file(n)["joint"]:
        link, effects = joint["link"], joint["effects"]
        dry = effects["coulomb_asymmetric"] or {"positive": 1.72, "negative": 1.05}
        body = Body(
            joint["rotor_inertia"],
            link["length"],
            link["mass"],
            (link["com"][0], link["com"][1]),
            link["inertia"],
            (dry["positive"], dry["negative"]),
            effects["viscous"].get("coefficient", 1.14),
            effects["viscous_cubic"].get("coefficient", -0.015),
        )
        out.append(body)
    return tuple(out)


@functools.cache
def bodies(n: int) -> Bodies:
    """The arm of n joints as the judge's regressors want it; in space by its places in the compiled MuJoCo model."""
    return _plane(n) if n not in URDF else _spatial(n)


def _spatial(n: int) -> tuple[SpatialBody, ...]:
    """Frictions and rotors are those of the judge's own arm of as many joints, which has the same proportions."""
    model = spec(n).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    out = []
    for joint, like in zip(range(model.njnt), SPATIAL[n], strict=True):
        body = model.jnt_bodyid[joint]
        axes = _axes(data.xaxis[joint])
        turned = axes.T @ data.ximat[body].reshape(3, 3)
        tensor = turned @ np.diag(model.body_inertia[body]) @ turned.T
        com = axes.T @ (data.xipos[body] - data.xanchor[joint])
        out.append(
            SpatialBody(
                (0, 0.0, 0.0),
                float(model.body_mass[body]),
                tuple(com.tolist()),
                tuple(float(tensor[i, j]) for i, j in SECOND),
                like.rotor,
                like.dry,
                like.viscous,
                like.cubic,
                like.noise,
                (tuple(map(tuple, axes.tolist())), tuple(data.xanchor[joint].tolist())),
            )
        )
    return tuple(out)


def _axes(z: Array) -> Array:
    """(3, 3) a frame whose third axis is z."""
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z]).T


def model_text(n: int, seed: int, believed: Sequence[str], gravity: Sequence[float], ratio: float) -> str:
    """The model file of a user: the shipped one with masses that are off, and effects of unknown values."""
    variant = seed % VARIANTS
    rng = np.random.default_rng([variant, n])
    document = tomlkit.parse((SHIPPED / f"{NAMES[n]}.toml").read_text(encoding="utf-8"))
    document["name"] = f"mujoco{n}_{variant}"
    document["gravity"] = list(gravity)
    for key in ("controller", "contact"):
        document.pop(key, None)
    for joint in document["joint"]:
        factor = float(rng.uniform(1 - OFF, 1 + OFF))
        link = joint["link"]
        link["mass"] = factor * float(link["mass"])
        shape = link["inertia"]
        link["inertia"] = [factor * float(x) for x in shape] if isinstance(shape, list) else factor * float(shape)
        joint["gear_ratio"] = ratio
        for key in ("controller", "encoder"):
            joint.pop(key, None)
        joint["effects"] = {name: {} for name in believed}
    return tomlkit.dumps(document)
