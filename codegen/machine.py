"""The machine: frames, protocol, states and guard around an arm's controller, as files of the firmware."""

from __future__ import annotations

from collections.abc import Mapping

from codegen import metadata
from codegen.controller import Controller
from codegen.protocol import Protocol
from symbolic.effects.declaration import Effect
from symbolic.model import ArmModel


def machine_files(model: ArmModel, library: Mapping[str, Effect]) -> dict[str, str]:
    """Relative path in the firmware's tree -> text.

    library   all effects by name; those that the model file activates are compensated
    """
    protocol = Protocol.of(Controller.of(model, library))
    return {"protocol.json": metadata.text(protocol.document())}
