"""The arm that a model file describes: a serial chain of joints and links, in space or in a plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NamedTuple, get_args

ROTOR = "rotor_inertia"
"""The model file's key for a rotor's inertia."""

Torque = Literal["motor", "link", "command", "gravity_compensated"]
"""What the recorded torque of an arm is: the motor's times the gear ratio; measured behind the gear, without the
motor's inertia; what the controller asked of the drives; without gravity, which the driver took out."""
TORQUES: tuple[Torque, ...] = get_args(Torque)
MOTOR_TORQUE, LINK_TORQUE, COMMAND, WEIGHTLESS = TORQUES

Vector = tuple[float, float, float]

Values = dict[str, float]
"""Parameter values of one active effect; unknown parameters are absent."""


@dataclass(frozen=True)
class ProposedValue:
    """A value that a model file lacks, proposed.

    joint   counted from 1; None: of the whole arm     table   keys of the tables around it     why   for a comment
    """

    joint: int | None
    table: tuple[str, ...]
    key: str
    value: float
    why: str


class OpenNumber(NamedTuple):
    """A number that the model file leaves out, and that no identified base parameter replaces.

    joint       counted from 1; None: of the whole arm or its contact
    parameter   key of the model file, of an effect `effect.parameter`
    value       what generated code takes for it; None: nothing
    """

    joint: int | None
    parameter: str
    value: float | None


@dataclass(frozen=True)
class Frame:
    """The pose of a frame in another one, as in URDF.

    xyz   (3,) m, the origin
    rpy   (3,) rad, rotations about the fixed axes x, then y, then z: R = Rz(yaw) Ry(pitch) Rx(roll)
    """

    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Link:
    """A body, in the frame of the joint that moves it; None where unknown.

    mass      kg
    com       (3,) m, centre of mass
    inertia   (ixx, ixy, ixz, iyy, iyz, izz) kg m², about the centre of mass, along the joint frame's axes
    """

    mass: float | None = None
    com: Vector | None = None
    inertia: tuple[float, float, float, float, float, float] | None = None


@dataclass(frozen=True)
class CollisionShape:
    """A solid on a link, as URDFs state them for collisions; model files have none.

    body    number of the joint that moves it, 0 for the base     frame   in that joint's frame
    link    its name in the URDF                                  mesh    its file, of kind "mesh"
    size    m: edges of a box; radius of a sphere; radius and length of a cylinder or capsule, along z; scale of a mesh
    """

    body: int
    link: str
    frame: Frame
    kind: Literal["box", "sphere", "cylinder", "capsule", "mesh"]
    size: tuple[float, ...]
    mesh: Path | None = None


@dataclass(frozen=True)
class Limits:
    """Position range (rad or m), maximum speed (rad/s or m/s) and torque (N m or N); None where not stated."""

    position: tuple[float, float] | None = None
    speed: float | None = None
    torque: float | None = None


@dataclass(frozen=True)
class Gains:
    """Gains of a joint's controller: kp in N m/rad (N/m), kd in N m s/rad (N s/m)."""

    kp: float
    kd: float


@dataclass(frozen=True)
class Control:
    """Settings that all joint controllers share; keys.CONTROLLER describes them."""

    rate: float
    velocity_cutoff: float
    friction_scale: float
    friction_slope: float


@dataclass(frozen=True)
class JointMonitor:
    """What the residual of a joint is while its model holds; keys.JOINT_MONITOR describes it."""

    floor: float
    load_floor: float
    slowest: float
    freedom: float | None


@dataclass(frozen=True)
class ArmMonitor:
    """Settings of the monitor on the board; keys.MONITOR describes them. joints: one a joint"""

    cutoff: float
    false_alarms: float
    joints: tuple[JointMonitor, ...]
    statistics: bool = False


@dataclass(frozen=True)
class Drive:
    """The servo drive of a joint; keys.DRIVE describes its data.

    node    on a CAN bus, or None     law   how it makes torque, or None     gains   of the law, those that are known
    """

    node: int | None = None
    direction: int = 1
    rated_torque: float | None = None
    law: str | None = None
    gains: Values = field(default_factory=dict)


@dataclass(frozen=True)
class DescribedJoint:
    """A joint without its link, as in the generated metadata.

    rotor_inertia     at the joint's output (kg m² or kg); None where unknown
    torque_constant   at the joint's output (N m/A or N/A)
    encoder_counts    per motor revolution; encoder_zero: the count at joint position 0
    name              shown beside the number, or None
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
    """A joint, its pose in the chain and the link that it moves.

    origin   of the joint's frame in the previous joint's frame (the first: in the base frame) at q = 0
    axis     (3,) of rotation or translation in the joint's frame, of any length but zero
    """

    axis: Vector = (0.0, 0.0, 1.0)
    origin: Frame = field(default_factory=Frame)
    link: Link = field(kw_only=True)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Keys for the inertia of rotor and link that the model file omits."""
        stated = {"mass": self.link.mass, "com": self.link.com, "inertia": self.link.inertia}
        return tuple(key for key, value in {**stated, ROTOR: self.rotor_inertia}.items() if value is None)


@dataclass(frozen=True)
class Contact:
    """The plate at the end-effector: x_p of equation (12) in m; its effects model equation (3)."""

    x: float
    effects: dict[str, Values] = field(default_factory=dict)


@dataclass(frozen=True)
class Arm:
    """A serial chain, planar or spatial.

    gravity    (3,) m/s², acceleration vector in the base frame
    tip        flange or tool, in the last joint's frame
    effects    of the whole arm
    inertial   identified base inertial parameters; they override the values computed from the links
    monitor    of the model on the board, or None
    torque     what recorded torques are, unless a recording says something else; None: not stated
    space      False: the arm moves in the plane of x and y, and its file states lengths (see `planar`)
    notes      warnings of the file's reader, a line each; not compared
    """

    name: str
    gravity: Vector
    joints: tuple[Joint, ...]
    tip: Frame = field(default_factory=Frame)
    effects: dict[str, Values] = field(default_factory=dict)
    contact: Contact | None = None
    inertial: Values = field(default_factory=dict)
    controller: Control | None = None
    monitor: ArmMonitor | None = None
    torque: Torque | None = None
    space: bool = True
    notes: tuple[str, ...] = field(default=(), compare=False, repr=False)

    @property
    def lengths(self) -> tuple[float, ...]:
        """(n,) m, link lengths of a planar arm: the distance along x to the next joint or the tip."""
        return tuple(frame.xyz[0] for frame in (*(joint.origin for joint in self.joints[1:]), self.tip))

    @property
    def stated_gravity(self) -> tuple[float, ...]:
        """Gravity with the components that the file has: (3,) of a spatial arm, (2,) of a planar one."""
        return self.gravity if self.space else self.gravity[:2]


def planar(arm: Arm, lengths: Sequence[float]) -> Arm:
    """A planar arm: joints turn about z or slide along x and are `lengths` (n,) m apart along x at q = 0."""
    before = (0.0, *lengths)
    joints = tuple(
        replace(
            joint,
            axis=(0.0, 0.0, 1.0) if joint.type == "revolute" else (1.0, 0.0, 0.0),
            origin=Frame((length, 0.0, 0.0)),
        )
        for joint, length in zip(arm.joints, before, strict=False)
    )
    return replace(arm, joints=joints, tip=Frame((before[-1], 0.0, 0.0)), space=False)


def planar_link(mass: float | None, com: tuple[float, float] | None, inertia: float | None) -> Link:
    """A link of a planar arm; its inertias about x and y, which have no effect, equal that about z (kg m²)."""
    return Link(
        mass,
        None if com is None else (*com, 0.0),
        None if inertia is None else (inertia, 0.0, 0.0, inertia, 0.0, inertia),
    )
