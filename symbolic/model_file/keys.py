"""The keys of the model file, planar and spatial, and JSON schemas made from such declarations for editors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from symbolic.model_file.arm import TORQUES
from symbolic.model_file.checks import Place, found
from symbolic.model_file.drive_laws import GAIN_KEYS, LAW
from symbolic.model_file.fields import (
    Choice,
    Field,
    FieldRow,
    Flag,
    Inner,
    Interval,
    JointType,
    Label,
    Misplaced,
    Name,
    NamedNumbers,
    Number,
    NumberRow,
    OpenTable,
    Real,
    Schema,
    Several,
    Table,
    Whole,
    WholeNumber,
    read,
    rows,
    table_schema,
)

if TYPE_CHECKING:
    from symbolic.effects.declaration import Effect

MAX_JOINTS = 7
MAX_NODE = 126
"""Largest CANopen node id of a drive; 127 is left to the computer."""


@dataclass(frozen=True)
class Joints(Several):
    """The [[joint]] tables, each with the units of its joint type."""

    def read(self, place: Place, value: Any, _: JointType) -> tuple[dict[str, Any], ...]:
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            place.fail(f"{self.key} is {found(value)}; expected one [[joint]] table a joint, from the base outwards")
        if not 1 <= len(value) <= MAX_JOINTS:
            place.fail(f"found {len(value)} joints; expected 1 to {MAX_JOINTS} [[joint]] tables")
        return tuple(
            # An invalid type is refused when the key is read.
            read(
                place.inside(f"joint {k}"),
                one,
                self.fields,
                "prismatic" if one.get("type") == "prismatic" else "revolute",
            )
            for k, one in enumerate(value, 1)
        )

    def schema(self) -> Schema:
        return {**super().schema(), "minItems": 1, "maxItems": MAX_JOINTS}


UNKNOWN = "unknown if left out"

MASS = Number("mass", f"of the link; {UNKNOWN}", unit="kg", low=0.0, default=None)
MOVED = "the body that the joint moves"
ABOUT_COM = "about the centre of mass"
LINK = (
    Number("length", "distance to the next joint or the tip", unit="m", low=0.0),
    MASS,
    NumberRow(
        "com", f"centre of mass, along and across the link; {UNKNOWN}", ("along", "across"), unit="m", default=None
    ),
    Number("inertia", f"{ABOUT_COM}; {UNKNOWN}", unit="kg m^2", low=0.0, default=None),
)
SPATIAL_LINK = (
    MASS,
    NumberRow("com", f"centre of mass in the joint's frame; {UNKNOWN}", ("x", "y", "z"), unit="m", default=None),
    NumberRow(
        "inertia",
        f"{ABOUT_COM}, along the axes of the joint's frame: ixx, ixy, ixz, iyy, iyz, izz; {UNKNOWN}",
        ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
        unit="kg m^2",
        default=None,
    ),
    Misplaced(
        "length",
        "belongs to planar arms; on a spatial arm, use the origin of the next joint, and [tip] for the last link",
    ),
)


def _frame(of: str) -> Inner:
    zero = (0.0, 0.0, 0.0)
    turned = "rotation about x, then y, then z of the previous frame: R = Rz(yaw) Ry(pitch) Rx(roll)"
    return Inner(
        "origin",
        "where a frame stands in the one before",
        (
            NumberRow("xyz", f"origin of {of}", ("x", "y", "z"), unit="m", default=zero),
            NumberRow("rpy", turned, ("roll", "pitch", "yaw"), unit="rad", default=zero, tiny=True),
        ),
        default={},
    )


PLACE = (
    _frame("the joint's frame in the previous joint's frame (the first: in the base frame) at q = 0"),
    NumberRow(
        "axis",
        "axis of rotation or translation in the joint's frame, of any length",
        ("x", "y", "z"),
        default=(0.0, 0.0, 1.0),
        tiny=True,
    ),
)
IN_SPACE = "belongs to a spatial arm, whose gravity has three numbers; a planar arm has {} instead"
NOT_IN_THE_PLANE = tuple(Misplaced(key, IN_SPACE.format("length in [joint.link]")) for key in ("origin", "axis"))
LIMITS = (
    Interval("position", "range, the lower end first", unit=("rad", "m"), default=None),
    Number("speed", "maximum in either direction", unit=("rad/s", "m/s"), positive=True, default=None),
    Number(
        "torque", "maximum in either direction, at the joint's output", unit=("N m", "N"), positive=True, default=None
    ),
)
GAINS = (
    Number("kp", "position gain at the joint's output", unit=("N m/rad", "N/m"), low=0.0),
    Number("kd", "velocity gain at the joint's output", unit=("N m s/rad", "N s/m"), low=0.0),
)
ENCODER = (
    WholeNumber("counts", "encoder counts per motor revolution", unit="counts per turn of the motor", positive=True),
    Whole(
        "zero",
        "encoder count at joint position 0",
        low=-(2**31),
        high=2**31 - 1,
        expected="a whole number of 32 bits, the encoder count at joint position 0",
        unit="counts",
        default=0,
    ),
)
DRIVE = (
    Whole(
        "node",
        "CANopen node id of the drive, unique",
        low=1,
        high=MAX_NODE,
        expected=f"the drive's CANopen node id, a whole number from 1 to {MAX_NODE}",
        default=None,
    ),
    Choice(
        "direction",
        "-1 if the motor's positive direction is the joint's negative one",
        (1, -1),
        "1, or -1 if the motor counts against the joint",
        default=1,
    ),
    Number(
        "rated_torque",
        "of the motor; read from the drive if left out",
        unit="N m at the motor",
        positive=True,
        default=None,
    ),
    LAW,
    *GAIN_KEYS,
)
JOINT_MONITOR = (
    Number(
        "floor",
        "RMS of the joint's residual in the monitor's band while the model holds",
        unit=("N m", "N"),
        positive=True,
    ),
    Number("load_floor", "what it has more for each N m (N) of rigid-body torque", low=0.0, default=0.0),
    Number("slowest", "at a lower speed the joint is not judged", unit=("rad/s", "m/s"), low=0.0, default=0.0),
    Number(
        "freedom",
        "degrees of freedom of the residual's energy in a window; those of noise in the band if left out",
        positive=True,
        default=None,
    ),
)
EFFECTS = "an active effect with its parameters; an empty table: its values are unknown (tendon effects)"


JOINT = (
    Label("name", "shown beside the joint's number", default=None),
    Choice("type", "revolute, or prismatic", ("revolute", "prismatic"), '"revolute" or "prismatic"'),
    Number(
        "rotor_inertia",
        f"of motor and gear at the joint's output: the motor's times gear_ratio squared; {UNKNOWN}",
        unit=("kg m^2", "kg"),
        low=0.0,
        default=None,
    ),
    Number("gear_ratio", "motor turns per joint turn (motor rad per metre)", positive=True),
)


def _joint(*body: Field) -> tuple[Field, ...]:
    return (
        *JOINT,
        *body,
        OpenTable("effects", EFFECTS, "EFFECT", "[joint.effects.…], one an effect", default={}),
        Number(
            "torque_constant",
            "torque at the joint's output per motor current: the motor's times gear_ratio",
            unit=("N m/A at the joint's output", "N/A at the joint's output"),
            positive=True,
            default=None,
        ),
        Inner("limits", "what motions keep", LIMITS, default={}),
        Inner("controller", "gains of the joint's controller", GAINS, default=None),
        Inner("encoder", "of the motor", ENCODER, default=None),
        Inner("monitor", "what the board's monitor compares the joint's residual with", JOINT_MONITOR, default=None),
        Inner("drive", "servo drive: on a CAN bus, and the law of its torque", DRIVE, default=None),
    )


CONTROLLER = (
    Number("rate", "of the control step", unit="Hz", positive=True),
    Number(
        "velocity_cutoff",
        "of the low-pass filter on the differentiated encoder, at most rate/2",
        unit="Hz",
        positive=True,
    ),
    Number("friction_scale", "c_u of (7): the compensated fraction of friction", low=0.0, high=1.0),
    Number(
        "friction_slope", "c_e of (7): how fast compensation starts from standstill", unit="s/rad (s/m)", positive=True
    ),
)
MONITOR = (
    Number("cutoff", "of the low-pass on the residual", unit="Hz", positive=True),
    Number("false_alarms", "of the whole arm, in a thousand hours of motion", low=1e-6, high=1e3, default=1.0),
    Flag("statistics", "whether the board adds up what identify --statistics needs", default=False),
)
CONTACT = (
    Number("x", "position of the plate's axis, x_p of (12), in the base frame", unit="m"),
    OpenTable("effects", EFFECTS, "EFFECT", "[contact.effects.…], one an effect", default={}),
)


def _model(gravity: Field, joint: Sequence[Field], *end: Field) -> tuple[Field, ...]:
    return (
        Name("name", "name of the arm, a C identifier"),
        gravity,
        Choice(
            "torque",
            "what recorded torques are: of the motor, at the link behind the gear, the controller's command, or with "
            "gravity taken out by the driver; a recording may say something else",
            TORQUES,
            " or ".join(f'"{torque}"' for torque in TORQUES),
            default=None,
        ),
        Joints("joint", "one a joint, from the base outwards", tuple(joint)),
        OpenTable("effects", f"of the whole arm: {EFFECTS}", "EFFECT", "[effects.…], one an effect", default={}),
        *end,
        NamedNumbers(
            "inertial",
            "base inertial parameters, as tendon identify --write writes them; they override the links' values",
            unit="SI units",
            default={},
        ),
        Inner("controller", "what the joints' controllers share", CONTROLLER, default=None),
        Inner("monitor", "of the model on the board, by [joint.monitor]", MONITOR, default=None),
    )


PLANAR = _model(
    NumberRow("gravity", "acceleration vector in the plane of motion", ("x", "y"), unit="m/s^2"),
    _joint(Inner("link", MOVED, LINK), *NOT_IN_THE_PLANE),
    Inner("contact", "a plate at the end-effector", CONTACT, default=None),
    Misplaced("tip", IN_SPACE.format("the length of the last link")),
)
SPATIAL = _model(
    NumberRow("gravity", "acceleration vector", ("x", "y", "z"), unit="m/s^2"),
    _joint(*PLACE, Inner("link", MOVED, SPATIAL_LINK, default={})),
    Inner("tip", "flange or tool", (_frame("the tip's frame (flange or tool) in the last joint's frame"),), default={}),
    Misplaced("contact", "belongs to planar arms: the plate of [contact] moves in the plane; leave it out"),
)


def fields_of(place: Place, table: Table) -> tuple[Field, ...]:
    """The keys of a model file: SPATIAL if gravity has three numbers, PLANAR if two. Raises ModelError otherwise."""
    gravity = table.get("gravity", [])
    if "gravity" in table and (not isinstance(gravity, list) or len(gravity) not in (2, 3)):
        place.fail(
            f"gravity is {found(gravity)}; expected a list of two numbers in m/s^2 for a planar arm, of three for one "
            "in space"
        )
    return SPATIAL if len(gravity) == 3 else PLANAR


def model_file_rows() -> list[FieldRow]:
    """All keys of a planar arm's model file, with unit, meaning and default, for the guide."""
    return rows(PLANAR)


def spatial_file_rows() -> list[FieldRow]:
    """The keys of a spatial arm's model file that differ from a planar arm's, for the guide."""
    planar = rows(PLANAR)
    return [row for row in rows(SPATIAL) if row not in planar]


# --- JSON schemas of whole files, for editors ---

DRAFT = "http://json-schema.org/draft-07/schema#"
_LINES = r"(_([2-9]|[1-9][0-9]+))?$"
"""Suffix of an effect that a joint may have several of."""


def model_schema(planar: Mapping[str, Effect], spatial: Mapping[str, Effect]) -> Schema:
    """JSON schema of model files, from the effects of planar and of spatial arms by name. An unknown effect may be a
    user's own and is accepted as a table of numbers."""
    kinds = {"planar": _arm_schema(PLANAR, planar.values()), "spatial": _arm_schema(SPATIAL, spatial.values())}
    refer = {kind: {"$ref": f"#/definitions/{kind}"} for kind in kinds}
    in_space = {"properties": {"gravity": {"type": "array", "minItems": 3}}, "required": ["gravity"]}
    return {
        "$schema": DRAFT,
        "title": "Tendon: model file of a robot arm",
        "if": in_space,
        "then": refer["spatial"],
        "else": refer["planar"],
        # Accepts everything; editors that do not evaluate "if" take their proposals from here.
        "anyOf": [*refer.values(), True],
        "definitions": kinds,
    }


def file_schema(title: str, fields: Sequence[Field]) -> Schema:
    """JSON schema of a file whose keys do not depend on each other."""
    return {"$schema": DRAFT, "title": title, **table_schema(fields)}


def _arm_schema(fields: Sequence[Field], effects: Iterable[Effect]) -> Schema:
    known = tuple(effects)
    made = table_schema(fields)
    own = made["properties"]
    own["effects"] |= _effects_schema(known, ("arm",))
    own["joint"]["items"]["properties"]["effects"] |= _effects_schema(known, ("joint", "joints"))
    if "contact" in own:
        own["contact"]["properties"]["effects"] |= _effects_schema(known, ("contact",))
    return made


def _effects_schema(known: Sequence[Effect], scopes: Sequence[str]) -> Schema:
    """Schema of an `effects` table for these scopes; all parameters are optional."""
    here = [effect for effect in known if effect.scope in scopes]
    elsewhere = "|".join(effect.name for effect in known if effect.scope not in scopes)
    made: Schema = {
        "properties": {effect.name: _effect_schema(effect) for effect in here if not effect.several},
        "patternProperties": {f"^{effect.name}{_LINES}": _effect_schema(effect) for effect in here if effect.several},
    }
    return {**made, "propertyNames": {"not": {"pattern": f"^({elsewhere})$"}}} if elsewhere else made


def _effect_schema(effect: Effect) -> Schema:
    return {
        "type": "object",
        "description": effect.summary,
        "properties": {
            p.name: {
                "type": "number",
                "description": f"{p.meaning}; {p.unit.text('revolute')}",
                **Real(p.name, p.meaning, *p.bounds).schema(),
            }
            for p in effect.parameters
        },
        "additionalProperties": False,
    }
