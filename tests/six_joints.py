"""A six-joint arm to plan for, to execute on and to compile for: geometry of a UR10e, controllers, limits."""

from __future__ import annotations

from dataclasses import replace

from symbolic.model_file.arm import Arm, Control, Gains, Limits
from tests.spatial_arms import known

_GAINS = ((9000.0, 900.0), (9000.0, 900.0), (6000.0, 500.0), (900.0, 60.0), (900.0, 60.0), (600.0, 40.0))
_FRICTION = ((9.0, 8.0), (9.0, 10.0), (6.0, 6.0), (2.0, 2.2), (2.0, 2.0), (2.0, 1.8))
START = {f"q{i}": q for i, q in enumerate((0.0, -1.4, 1.6, -0.2, 1.2, 0.0), 1)}
"""A posture away from all limits and singularities."""


def six_joints() -> Arm:
    """With dry and viscous friction, encoders, limits and controllers."""
    arm = known("ur10e")
    joints = tuple(
        replace(
            joint,
            gains=Gains(*gains),
            encoder_counts=4096,
            limits=Limits((-6.2, 6.2), 3.0, 330.0),
            effects={
                "coulomb_asymmetric": {"positive": positive, "negative": negative},
                "viscous": {"coefficient": positive},
            },
        )
        for joint, gains, (positive, negative) in zip(arm.joints, _GAINS, _FRICTION, strict=True)
    )
    return replace(arm, name="six", joints=joints, controller=Control(1000.0, 60.0, 0.9, 10.0))
