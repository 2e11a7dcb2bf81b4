"""The machine: frames, protocol, states and guard around an arm's controller, as files of the firmware.

The machine itself is written by hand (codegen.firmware.handwritten); here is what it includes: the arm's numbers, the
controller's types and functions under fixed names, the messages.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any

from codegen import metadata
from codegen.banner import BANNER
from codegen.c.c_code import comment
from codegen.c.controller import Controller
from codegen.c.controller_records import STATUS
from codegen.firmware import protocol_code, protocol_page
from codegen.firmware.ceilings import Ceilings
from codegen.firmware.handwritten import machine_sources
from codegen.firmware.messages import LARGEST
from codegen.firmware.protocol import ACKS, NOT_READY, OUTRUN, REASONS, TELEMETRY_RECORDS, Protocol, records_of
from codegen.pages import page
from symbolic.effects.declaration import Effect
from symbolic.model import ArmModel

_FIXED = {"state": "controller_state"}
"""What the machine calls a record of the controller, where that is not the record's own name."""


def machine_files(model: ArmModel, library: Mapping[str, Effect], equations: Mapping[str, str]) -> dict[str, str]:
    """Relative path in the firmware's tree -> text.

    library     all effects by name; those that the model file activates are compensated
    equations   the sources of the same model that the machine calls, by path
    """
    controller = Controller.of(model, library)
    protocol = Protocol.of(controller)
    people = {"banner_text": f"{BANNER} Link to the arm {protocol.arm}.", **protocol_page.holes(protocol)}
    files = {
        **machine_sources(),
        "src/tendon_arm.h": page("firmware/tendon_arm.h.j2", **_numbers(protocol), ceilings=None),
        "src/tendon_controller.h": page("firmware/tendon_controller.h.j2", **_names(controller)),
    }
    # Without the ceilings: a model file with tighter limits needs no new firmware.
    build = _checksum({**equations, **files, **_messages(controller, protocol, 0)})
    files |= {
        "src/tendon_arm.h": page(
            "firmware/tendon_arm.h.j2", **_numbers(protocol), ceilings=_ceilings(protocol.ceilings)
        ),
        **_messages(controller, protocol, build),
        "PROTOCOL.md": page("firmware/PROTOCOL.md.j2", **people),
        "protocol.json": metadata.text(protocol.document(build)),
    }
    return dict(sorted(files.items()))


def _checksum(files: Mapping[str, str]) -> int:
    """CRC-32 of paths and texts."""
    return zlib.crc32("\0".join(part for item in sorted(files.items()) for part in item).encode())


def _messages(controller: Controller, protocol: Protocol, build: int) -> dict[str, str]:
    holes = {
        "banner": f"/* {BANNER} Link to the arm {protocol.arm}. */",
        **protocol_code.holes(controller, protocol, build),
    }
    return {f"src/tendon_messages.{kind}": page(f"firmware/tendon_messages.{kind}.j2", **holes) for kind in ("h", "c")}


def _numbers(protocol: Protocol) -> dict[str, Any]:
    """What the page of tendon_arm.h needs."""
    bits = sum(1 << reason.number for reason in REASONS if reason.torque == "zero")
    return {
        "banner": f"/* {BANNER} Numbers of the arm {protocol.arm}. */",
        "name": protocol.arm,
        "n": len(protocol.types),
        "looks": protocol.looks,
        "telemetry_records": TELEMETRY_RECORDS,
        "acks": ACKS,
        "not_ready": f"0x{NOT_READY:08x}U",
        "outrun": f"{OUTRUN}f",
        "no_limit": f"{LARGEST:.9g}f",
        "without_torque": f"0x{bits:x}U",
        "status": [
            {"name": flag.upper(), "bit": bit, "comment": comment(text)} for flag, (bit, text) in STATUS.items()
        ],
    }


def _ceilings(ceilings: Ceilings) -> dict[str, Any]:
    """What the page of tendon_arm.h needs of them."""
    return {**vars(ceilings), "rows": " \\\n    " + ", \\\n    ".join(ceilings.rows())}


def _names(controller: Controller) -> dict[str, Any]:
    """What the page of tendon_controller.h needs."""
    name = controller.model.arm.name
    return {
        "banner": f"/* {BANNER} Controller of the arm {name}. */",
        "name": name,
        "types": [
            {"own": record.name, "fixed": f"tendon_{_FIXED.get(short, short)}"}
            for short, record in records_of(controller).items()
        ],
    }
