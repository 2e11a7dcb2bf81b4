"""Every key of the model file: what it means, its unit and range, and what holds where it is left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from symbolic.model_file.checks import Place, found
from symbolic.model_file.fields import (
    Choice,
    FieldRow,
    Inner,
    Interval,
    JointType,
    Name,
    NamedNumbers,
    Number,
    OpenTable,
    Pair,
    Several,
    Table,
    Whole,
    WholeNumber,
    read,
    rows,
)

MAX_JOINTS = 7
MAX_NODE = 126
"""Node ids on a CAN bus end at 127, which is left to the computer."""


@dataclass(frozen=True)
class Joints(Several):
    """[[joint]] tables, each with units of its type."""

    def read(self, place: Place, value: Any, _: JointType) -> tuple[dict[str, Any], ...]:
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            place.fail(f"{self.key} is {found(value)}; expected one [[joint]] table a joint, from the base outwards")
        if not 1 <= len(value) <= MAX_JOINTS:
            place.fail(f"found {len(value)} joints; expected 1 to {MAX_JOINTS} [[joint]] tables")
        return tuple(
            read(place.inside(f"joint {k}"), table, self.fields, _joint_type(table)) for k, table in enumerate(value, 1)
        )


def _joint_type(table: Table) -> JointType:
    """For units; what else stands there is refused before there are any."""
    return "prismatic" if table.get("type") == "prismatic" else "revolute"


UNKNOWN = "if left out, unknown"

LINK = (
    Number("length", "to the next joint, or to the tip", unit="m", low=0.0),
    Number("mass", f"of the link; {UNKNOWN}", unit="kg", low=0.0, default=None),
    Pair("com", f"centre of mass, along and across the link; {UNKNOWN}", unit="m", default=None),
    Number("inertia", f"about the centre of mass; {UNKNOWN}", unit="kg m^2", low=0.0, default=None),
)
LIMITS = (
    Interval("position", "range, the smaller end first", unit=("rad", "m"), default=None),
    Number("speed", "largest, either way", unit=("rad/s", "m/s"), positive=True, default=None),
    Number("torque", "largest, either way, at the joint's output", unit=("N m", "N"), positive=True, default=None),
)
GAINS = (
    Number("kp", "gain of position, at the joint's output", unit=("N m/rad", "N/m"), low=0.0),
    Number("kd", "gain of speed, at the joint's output", unit=("N m s/rad", "N s/m"), low=0.0),
)
ENCODER = (
    WholeNumber("counts", "of the encoder a turn of the motor", unit="counts per turn of the motor", positive=True),
    Whole(
        "zero",
        "what the encoder counts where the joint's position is 0",
        -(2**31),
        2**31 - 1,
        "a whole number of 32 bits, what the encoder counts at position 0",
        unit="counts",
        default=0,
    ),
)
DRIVE = (
    Whole(
        "node",
        "the drive's CANopen node id, another for every drive",
        1,
        MAX_NODE,
        f"the drive's CANopen node id, a whole number from 1 to {MAX_NODE}",
    ),
    Choice(
        "direction",
        "-1 where the motor's positive direction is the joint's negative one",
        (1, -1),
        "1, or -1 where the motor counts against the joint",
        default=1,
    ),
    Number(
        "rated_torque",
        "of the motor; if left out, as the drive itself says",
        unit="N m at the motor",
        positive=True,
        default=None,
    ),
)
EFFECTS = "the effects that are there and their parameters; empty: its values are not known (tendon effects)"

JOINT = (
    Choice("type", "revolute, or prismatic", ("revolute", "prismatic"), '"revolute" or "prismatic"'),
    Number(
        "rotor_inertia",
        f"motor and gear at the joint's output: that of the motor times gear_ratio squared; {UNKNOWN}",
        unit=("kg m^2", "kg"),
        low=0.0,
        default=None,
    ),
    Number("gear_ratio", "turns of the motor a turn of the joint (rad of the motor a metre)", positive=True),
    Inner("link", "the body that the joint moves", LINK),
    OpenTable("effects", EFFECTS, "EFFECT", "[joint.effects.…], one an effect", default={}),
    Number(
        "torque_constant",
        "torque at the joint's output by the motor's current: that of the motor times gear_ratio",
        unit=("N m/A at the joint's output", "N/A at the joint's output"),
        positive=True,
        default=None,
    ),
    Inner("limits", "what motions keep", LIMITS, default={}),
    Inner("controller", "gains of the joint's controller", GAINS, default=None),
    Inner("encoder", "of the motor", ENCODER, default=None),
    Inner("drive", "servo drive on a CAN bus", DRIVE, default=None),
)
CONTROLLER = (
    Number("rate", "of the control step", unit="Hz", positive=True),
    Number("velocity_cutoff", "of the low-pass on the differentiated encoder, up to rate/2", unit="Hz", positive=True),
    Number("friction_scale", "c_u of (7): the part of the friction that is compensated", low=0.0, high=1.0),
    Number("friction_slope", "c_e of (7): how soon after standstill", unit="s/rad (s/m)", positive=True),
)
CONTACT = (
    Number("x", "of the plate's axis, x_p of (12), in the base frame", unit="m"),
    OpenTable("effects", EFFECTS, "EFFECT", "[contact.effects.…], one an effect", default={}),
)

MODEL = (
    Name("name", "of the arm: a C identifier"),
    Pair("gravity", "acceleration vector in the plane of motion", unit="m/s^2"),
    Joints("joint", "one a joint, from the base outwards", JOINT),
    OpenTable("effects", f"of the whole arm: {EFFECTS}", "EFFECT", "[effects.…], one an effect", default={}),
    Inner("contact", "a plate at the end-effector", CONTACT, default=None),
    NamedNumbers(
        "inertial",
        "base inertial parameters as tendon identify --write puts them there, over what follows from the links",
        unit="SI units",
        default={},
    ),
    Inner("controller", "what the joints' controllers share", CONTROLLER, default=None),
)


def model_file_rows() -> list[FieldRow]:
    """Every key of the model file, with unit, meaning and default, for a guide."""
    return rows(MODEL)
