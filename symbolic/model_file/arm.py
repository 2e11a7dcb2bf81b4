"""The model file, read and checked: Arm, Joint, Link, Contact."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

ROTOR = "rotor_inertia"
"""The key of the model file under which a rotor's inertia stands."""

Values = dict[str, float]
"""Parameter values of one active effect; parameters that are not yet known are absent."""


@dataclass(frozen=True)
class Link:
    """Length and centre of mass (along, across) in m; mass in kg; inertia about the centre of mass in kg m².

    None: not known.
    """

    length: float
    mass: float | None = None
    com: tuple[float, float] | None = None
    inertia: float | None = None


@dataclass(frozen=True)
class Limits:
    """Range of position (rad or m), largest speed (rad/s or m/s) and torque (N m or N); None: not stated."""

    position: tuple[float, float] | None = None
    speed: float | None = None
    torque: float | None = None


@dataclass(frozen=True)
class Gains:
    """Of a joint's controller: kp in N m/rad (N/m), kd in N m s/rad (N s/m)."""

    kp: float
    kd: float


@dataclass(frozen=True)
class Control:
    """What the joints' controllers share.

    rate              of the control step, Hz
    velocity_cutoff   of the low-pass on the differentiated encoder, Hz
    friction_scale    c_u of (7)
    friction_slope    c_e of (7), s/rad (s/m)
    """

    rate: float
    velocity_cutoff: float
    friction_scale: float
    friction_slope: float


@dataclass(frozen=True)
class Drive:
    """The servo drive of a joint on a CAN bus.

    node           its CANopen node id
    direction      1; −1 where the motor's positive direction is the joint's negative one
    rated_torque   of the motor, N m; None: as the drive itself says
    """

    node: int
    direction: int = 1
    rated_torque: float | None = None


@dataclass(frozen=True)
class DescribedJoint:
    """A joint without its link: what the generated metadata says of it.

    rotor_inertia    at the joint's output (kg m² or kg), None: not known; torque_constant at the joint (N m/A or N/A)
    encoder_counts   per turn of the motor; encoder_zero: of them where the position is 0
    """

    type: Literal["revolute", "prismatic"]
    rotor_inertia: float | None
    gear_ratio: float
    torque_constant: float | None = None
    limits: Limits = field(default_factory=Limits)
    gains: Gains | None = None
    encoder_counts: int | None = None
    encoder_zero: int = 0
    drive: Drive | None = None
    effects: dict[str, Values] = field(default_factory=dict)


@dataclass(frozen=True)
class Joint(DescribedJoint):
    """A joint of the model file."""

    link: Link = field(kw_only=True)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Keys of the model file that say what inertia it moves, and are left out."""
        stated = {"mass": self.link.mass, "com": self.link.com, "inertia": self.link.inertia}
        return tuple(key for key, value in {**stated, ROTOR: self.rotor_inertia}.items() if value is None)


@dataclass(frozen=True)
class Contact:
    """The plate at the end-effector: x_p of (12) in m; its effects carry (3)."""

    x: float
    effects: dict[str, Values] = field(default_factory=dict)


@dataclass(frozen=True)
class Arm:
    """A planar serial chain. gravity (2,) m/s²; effects: those of the whole arm.

    inertial: base inertial parameters that an identification has put into the file; they override
    what follows from the links.
    """

    name: str
    gravity: tuple[float, float]
    joints: tuple[Joint, ...]
    effects: dict[str, Values] = field(default_factory=dict)
    contact: Contact | None = None
    inertial: Values = field(default_factory=dict)
    controller: Control | None = None
