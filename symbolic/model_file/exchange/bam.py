"""Parameters of BAM (Better Actuator Models), a JSON file for the servo of each joint.

BAM's friction stops the joint with a torque up to frictionloss + damping |qd|. Source: Duclusaud, Passault, Padois &
Daffarra 2025, Extended friction models for the physics simulation of servo actuators; Rhoban/bam, its models m1 to m4.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from symbolic import elements as e
from symbolic.model_file.exchange.exporting import ExportedArm, ExportedJoint

GAUSSIAN = 2.0
"""BAM's alpha of exp(-(qd/v)^alpha), as friction at creep falls here."""
MODELS = {(False, False): "m1", (True, False): "m2", (False, True): "m3", (True, True): "m4"}
"""By whether friction falls with the rate, and whether it grows with the load."""


def bam_files(made: ExportedArm, out: Path, servo: str) -> dict[Path, bytes]:
    """The file of each joint; where there are several, its number stands before the suffix. servo: BAM's name of it."""
    one = len(made.joints) == 1
    paths = [out if one else out.with_stem(f"{out.stem}_{k}") for k in range(1, len(made.joints) + 1)]
    texts = (json.dumps(parameters_of(joint, servo), indent=2) + "\n" for joint in made.joints)
    return {path: text.encode() for path, text in zip(paths, texts, strict=True)}


def parameters_of(joint: ExportedJoint, servo: str) -> dict[str, str | float]:
    """BAM's parameters of a joint by their names, at its output, in SI. BAM has defaults for what is left out:
    friction that is not there is stated as 0, and motor and rotor where they are known."""
    creeping, loads = joint.of(e.CreepFriction), joint.of(e.LoadFriction)
    falls, grows = bool(creeping), bool(loads)
    found: dict[str, str | float] = {"model": MODELS[falls, grows], "actuator": servo, **_motor(joint)}
    found |= {"friction_base": joint.friction, "friction_viscous": joint.damping}
    if falls:
        found |= {"friction_stribeck": float(sum(element.torque for element in creeping))}
        found |= {"dtheta_stribeck": float(creeping[0].speed), "alpha": GAUSSIAN}
    if grows:
        # The outer torque stands against the motor's: their difference is twice the load where little accelerates.
        found |= {"load_friction_base": float(sum(element.coefficient for element in loads)) / 2}
    if falls and grows:
        found |= {"load_friction_stribeck": 0.0}
    return found


def unsaid_of(made: ExportedArm) -> Iterator[str]:
    """What the files do not say of the motors, so that BAM's defaults count."""
    for k, joint in enumerate(made.joints, 1):
        stated = parameters_of(joint, "")
        if lacking := [name for name in ("kt", "R", "armature") if name not in stated]:
            yield f"{', '.join(lacking)} of joint {k}: not known, so that BAM's own counts"


def _motor(joint: ExportedJoint) -> dict[str, float]:
    drive = joint.joint.drive
    gains = {} if drive is None else drive.gains
    known = {
        "kt": gains.get("torque_constant", joint.joint.torque_constant),
        "R": gains.get("resistance"),
        "armature": joint.joint.rotor_inertia,
    }
    return {name: value for name, value in known.items() if value is not None}
