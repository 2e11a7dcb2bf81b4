"""The machine: frames, protocol, states and guard around an arm's controller, as files of the firmware."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any

from codegen import metadata
from codegen.c.controller import Controller
from codegen.firmware import protocol_code, protocol_page
from codegen.firmware.messages import SIZES
from codegen.firmware.protocol import ACKS, HEADER, MISSING, NOT_READY, OUTRUN, REASONS, TELEMETRY_RECORDS, Protocol
from codegen.pages import BANNER, page
from symbolic.effects.declaration import Effect
from symbolic.model import ArmModel
from symbolic.rigid_body.kinematics import Coordinates


def machine_files(model: ArmModel, library: Mapping[str, Effect], equations: Mapping[str, str]) -> dict[str, str]:
    """Relative path in the firmware's tree -> text.

    library     all effects by name; those that the model file activates are compensated
    equations   the sources of the same model that the machine calls, by path
    """
    name, controller = model.arm.name, Controller.of(model, library)
    protocol = Protocol.of(controller)
    own = {"banner": f"/* {BANNER} */", "crc_table": protocol_code.crc_table()}
    people = {"banner_text": f"{BANNER} Link to the arm {name}.", **protocol_page.holes(protocol)}
    machine = {"banner": f"/* {BANNER} Machine of the arm {name}. */", **_holes(controller, protocol)}
    files = {
        "src/tendon_frame.h": page("firmware/tendon_frame.h.j2", **own),
        "src/tendon_frame.c": page("firmware/tendon_frame.c.j2", **own),
        f"src/{name}_machine.h": page("firmware/machine.h.j2", **machine),
        f"src/{name}_machine.c": page("firmware/machine.c.j2", **machine),
    }
    build = _checksum({**equations, **files, **_protocol_files(protocol, 0)})
    files |= {
        **_protocol_files(protocol, build),
        "PROTOCOL.md": page("firmware/PROTOCOL.md.j2", **people),
        "protocol.json": metadata.text(protocol.document(build)),
    }
    return dict(sorted(files.items()))


def _protocol_files(protocol: Protocol, build: int) -> dict[str, str]:
    name = protocol.arm
    holes = {"banner": f"/* {BANNER} Link to the arm {name}. */", **protocol_code.holes(protocol, build)}
    return {f"src/{name}_protocol.{kind}": page(f"firmware/protocol.{kind}.j2", **holes) for kind in ("h", "c")}


def _checksum(files: Mapping[str, str]) -> int:
    """CRC-32 of paths and texts."""
    return zlib.crc32("\0".join(part for item in sorted(files.items()) for part in item).encode())


def _holes(controller: Controller, protocol: Protocol) -> dict[str, Any]:
    """What the pages of machine.h and machine.c need."""
    name = protocol.arm
    records = {record.name.removeprefix(f"{name}_"): record for record in controller.records}
    zero = [f"(reason == {name.upper()}_REASON_{reason.name.upper()})" for reason in REASONS if reason.torque == "zero"]
    return {
        "name": name,
        "NAME": name.upper(),
        "n": len(protocol.types),
        "guard": f"TENDON_{name.upper()}_MACHINE_H",
        "looks": protocol.looks,
        "force": Coordinates(protocol.types).force,
        "telemetry_records": TELEMETRY_RECORDS,
        "acks": ACKS,
        "without_torque": "\n        || ".join(zero),
        "infinity": "0xff000000U",
        # Of two floats that are meant to be one period, the product may be less by two roundings.
        "one_period": "0.999999f",
        "not_ready": f"0x{NOT_READY:08x}U",
        "outrun": f"{OUTRUN}f",
        "spring": [field.name for field in records["spring_f32"].fields],
        "contact": [field.name for field in records["contact_f32"].fields],
        "counters": [item.name for item in protocol.message("counters").fields],
        "low_place": protocol.message("safety").place("low"),
        "high_place": protocol.message("safety").place("high"),
        "early_place": protocol.message("safety").place("early"),
        "late_place": protocol.message("safety").place("late"),
        "elbow_place": protocol.message("trajectory").place("elbow"),
        "row_place": protocol.message("phase").place("first_row"),
        "everything": f"{sum(MISSING.values())}U",
        "header": _places(),
    }


def _places() -> dict[str, int]:
    """Bytes from a frame's begin to each field of its header."""
    places, at = {}, 0
    for name, kind in HEADER:
        places[name] = at
        at += SIZES[kind]
    return places
