"""The structs of a controller's step: what its caller owns, fills and reads."""

from __future__ import annotations

from codegen.c.records import Record, RecordField, of_struct
from symbolic.controller_law import Compensation
from symbolic.model import ArmModel
from symbolic.rigid_body.kinematics import Coordinates

MAX_DEGREE = 29
"""Its binomial coefficients times a degree are whole numbers of 32 bits."""
MIN_DEGREE = 4
"""As many points as the sums of a step read apart from their loop."""
COORDINATES = {"q": 0, "w": 1}
STATUS = {
    "saturated": (1, "a torque was limited"),
    "finished": (2, "the trajectory has ended, the arm is held there"),
    "invalid": (4, "no trajectory, or a torque that is no finite number: all torques are zero"),
}


def controller_records(model: ArmModel, found: Compensation) -> tuple[Record, ...]:
    """All structs in order of declaration, the first one that of the arm's own header."""
    name = model.arm.name
    coordinates = Coordinates(tuple(joint.type for joint in model.arm.joints))
    return (
        of_struct(f"{name}_parameters_f32", "", model.struct, declared=True),
        of_struct(f"{name}_effects_f32", "Parameters of the effects that are compensated.", found.effects),
        _spring(name, coordinates, found),
        _contact(name, found),
        _config(name, coordinates),
        _phase(name, coordinates),
        _trajectory(name, coordinates),
        _state(name, coordinates),
        _output(name, coordinates),
    )


def _record(name: str, what: str, meaning: str, *fields: RecordField) -> Record:
    return Record(f"{name}_{what}_f32", meaning, fields)


def _spring(name: str, coordinates: Coordinates, found: Compensation) -> Record:
    return _record(
        name,
        "spring",
        "A spring parallel to a joint, equation (2); all zero where there is none.",
        *(
            RecordField(lump, "float", coordinates.unit(p.unit.text("revolute"), p.unit.text("prismatic")), p.meaning)
            for spring in found.springs
            if spring.joint == 1
            for lump, (p, _) in zip(spring.names, spring.lumps, strict=True)
        ),
    )


def _contact(name: str, found: Compensation) -> Record:
    return _record(
        name,
        "contact",
        "The plate, equation (3), and its damper.",
        *(
            RecordField(f"{site.effect.name}_{p.name}", "float", p.unit.text(), p.meaning)
            for site in found.touched
            for p in site.effect.parameters
        ),
    )


def _config(name: str, coordinates: Coordinates) -> Record:
    n, unit = len(coordinates.types), coordinates.unit
    return _record(
        name,
        "config",
        f"The arm, its encoders and its gains; {name}_controller_prepare_f32 fills the last two fields.",
        RecordField("parameters", f"{name}_parameters_f32", "", "of the arm"),
        RecordField("effects", f"{name}_effects_f32", "", "that are compensated"),
        RecordField("rate", "float", "Hz", "of the control step"),
        RecordField("velocity_gain", "float", "1", "of the low-pass on the rates: 1 - exp(-2 pi cut-off/rate)"),
        RecordField("position_per_count", "float", unit("rad", "m"), "of one encoder count", n),
        RecordField("zero", "int32_t", "counts", "where the position is 0", n),
        RecordField("kp", "float", unit("N m/rad", "N/m"), "torque per error of position", n),
        RecordField("kd", "float", unit("N m s/rad", "N s/m"), "torque per error of rate", n),
        RecordField("torque_limit", "float", coordinates.force, "largest torque in either direction", n),
        RecordField("kept", "float", "1", "1 - velocity_gain"),
        RecordField(
            "rate_per_count", "float", unit("rad/s", "m/s"), "that a count a period adds to the filtered rate", n
        ),
    )


def _phase(name: str, coordinates: Coordinates) -> Record:
    n = len(coordinates.types)
    kinds = f"{name.upper()}_JOINT_COORDINATES or {name.upper()}_CONTACT_COORDINATES, equation (13)"
    return _record(
        name,
        "phase",
        f"A part of a trajectory, equation (9); {name}_controller_prepare_phase_f32 fills the last three fields.",
        RecordField("coordinates", "uint32_t", "", kinds),
        RecordField("degree", "uint32_t", "", f"of the polynomials, {MIN_DEGREE} to {name.upper()}_MAX_DEGREE"),
        RecordField("duration", "float", "s", "not less than a control period"),
        RecordField("points", "float", "", f"degree + 1 control points of {n} coordinates each", kind="pointer"),
        RecordField("contact", f"{name}_contact_f32", "", "the plate that it touches, or null", kind="pointer"),
        RecordField("spread", "float", "1", "degree - 1"),
        RecordField("first", "float", "1/s", "degree/duration: of the first derivative"),
        RecordField("second", "float", "1/s^2", "first (degree - 1)/duration: of the second derivative"),
    )


def _trajectory(name: str, coordinates: Coordinates) -> Record:
    n = len(coordinates.types)
    return _record(
        name,
        "trajectory",
        "What the controller follows.",
        RecordField("count", "uint32_t", "", "of the phases"),
        RecordField("periodic", "uint32_t", "", "1: the first phase follows the last one; 0: the arm rests at the end"),
        RecordField("elbow", "float", "1", "sign of sin q_2 in contact coordinates"),
        RecordField("springs", f"{name}_spring_f32", "", "parallel to the joints", n),
        RecordField("phases", f"{name}_phase_f32", "", "one after another", kind="pointer"),
    )


def _state(name: str, coordinates: Coordinates) -> Record:
    n = len(coordinates.types)
    return _record(
        name,
        "state",
        "What the controller keeps between two steps.",
        RecordField("counts", "int32_t", "counts", "of the last step", n),
        RecordField("q", "float", coordinates.unit("rad", "m"), "measured", n),
        RecordField("qd", "float", coordinates.unit("rad/s", "m/s"), "measured and filtered", n),
        RecordField("phase", "uint32_t", "", "from 0"),
        RecordField("tick", "uint32_t", "", "periods since tick 0"),
        RecordField("begin", "float", "s", "time within the phase at tick 0"),
        RecordField("elapsed", "float", "s", "time within the phase now"),
        RecordField("finished", "uint32_t", "", "1: at rest at the end"),
    )


def _output(name: str, coordinates: Coordinates) -> Record:
    n, unit = len(coordinates.types), coordinates.unit
    return _record(
        name,
        "output",
        "What a step gives.",
        RecordField("torque", "float", coordinates.force, "to hold until the next step", n),
        RecordField("q_desired", "float", unit("rad", "m"), "by the trajectory", n),
        RecordField("phase", "uint32_t", "", "of the trajectory, from 0"),
        RecordField(
            "status", "uint32_t", "", f"bits: {', '.join(f'{name.upper()}_{flag.upper()}' for flag in STATUS)}"
        ),
    )
