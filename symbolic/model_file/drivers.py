"""What the drivers of well-known arms publish as torque, by the names of the arms' joints."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from symbolic.model_file.arm import Torque


@dataclass(frozen=True)
class KnownDriver:
    """joints: pattern of all of its joints' names     torque: None: it has published several kinds
    says: beside the model file's key
    """

    joints: str
    torque: Torque | None
    says: str


KNOWN_DRIVERS = (
    KnownDriver(r".*(panda|fr3|fer)_joint\d", "link", "Franka's drivers publish tau_J, measured behind the gears"),
    KnownDriver(r".*(lbr_(iiwa_joint_|A)|iiwa_joint_|med\d*_A)\d", "link", "FRI's torque sensors are behind the gears"),
    KnownDriver(
        r".*(shoulder_pan|shoulder_lift|elbow|wrist_[123])(_joint)?",
        None,
        '"gravity_compensated" for effort of the ROS 2 driver since PolyScope 5.23, X 10.11; currents are the motor\'s',
    ),
)
"""Source: libfranka, RobotState::tau_J; KUKA Sunrise.FRI, getMeasuredTorque; Universal Robots ROS 2 driver, parameter
use_currents_as_efforts and pull request 1551."""


def known_driver(joints: Iterable[str | None]) -> KnownDriver | None:
    """The driver of an arm with these joints' names; None for an arm that is not known."""
    names = [name or "" for name in joints]
    return next((d for d in KNOWN_DRIVERS if names and all(re.fullmatch(d.joints, name) for name in names)), None)
