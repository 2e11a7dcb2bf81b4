"""The model file, read and checked: a planar Arm with Joints and Links, or a SpatialArm with its own; Contact."""

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
class Frame:
    """Where a frame stands in another, as URDF says it.

    xyz   (3,) m, of its origin
    rpy   (3,) rad, turned about the other's x, then its y, then its z: R = Rz(yaw) Ry(pitch) Rx(roll)
    """

    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class SpatialLink:
    """A body in the frame of the joint that moves it: mass in kg, centre of mass (3,) in m, inertia about the centre of
    mass along the joint frame's axes, (ixx, ixy, ixz, iyy, iyz, izz) in kg m². None: not known.
    """

    mass: float | None = None
    com: tuple[float, float, float] | None = None
    inertia: tuple[float, float, float, float, float, float] | None = None


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
    name             shown beside the number; None: it has none
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
    name: str | None = None


@dataclass(frozen=True)
class Joint(DescribedJoint):
    """A joint of a planar arm."""

    link: Link = field(kw_only=True)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Keys of the model file that say what inertia it moves, and are left out."""
        return _left_out(self)


@dataclass(frozen=True)
class SpatialJoint(DescribedJoint):
    """A joint of an arm in space.

    origin   of the joint's frame in that of the joint before (the first: in the base's), where q = 0
    axis     (3,) in the joint's frame, of any length but zero: it turns about it, or slides along it
    """

    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    origin: Frame = field(default_factory=Frame)
    link: SpatialLink = field(kw_only=True)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Keys of the model file that say what inertia it moves, and are left out."""
        return _left_out(self)


def _left_out(joint: Joint | SpatialJoint) -> tuple[str, ...]:
    stated = {"mass": joint.link.mass, "com": joint.link.com, "inertia": joint.link.inertia}
    return tuple(key for key, value in {**stated, ROTOR: joint.rotor_inertia}.items() if value is None)


@dataclass(frozen=True)
class Contact:
    """The plate at the end-effector: x_p of (12) in m; its effects carry (3)."""

    x: float
    effects: dict[str, Values] = field(default_factory=dict)


@dataclass(frozen=True)
class SerialArm:
    """What planar and spatial chains have in common.

    gravity    the acceleration vector, m/s², in the plane or in space
    effects    those of the whole arm
    inertial   base inertial parameters that an identification has put into the file; they override what follows from
               the links
    notes      what the file's reader has to say to a person beside its errors, a line each; no part of the arm
    """

    name: str
    gravity: tuple[float, ...]
    joints: tuple[Joint, ...] | tuple[SpatialJoint, ...]
    effects: dict[str, Values] = field(default_factory=dict)
    contact: Contact | None = None
    inertial: Values = field(default_factory=dict)
    controller: Control | None = None
    notes: tuple[str, ...] = field(default=(), compare=False, repr=False)


@dataclass(frozen=True)
class Arm(SerialArm):
    """A planar serial chain."""

    gravity: tuple[float, float]
    joints: tuple[Joint, ...]


@dataclass(frozen=True)
class SpatialArm(SerialArm):
    """A serial chain in space; tip: the flange or tool, in the last joint's frame. It has no contact with a plate."""

    gravity: tuple[float, float, float]
    joints: tuple[SpatialJoint, ...]
    tip: Frame = field(default_factory=Frame)
