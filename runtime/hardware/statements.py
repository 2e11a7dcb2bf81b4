"""What a board may say: numbers that the protocol has, and no two that contradict each other or what it was told.

A frame with a right checksum is from whoever wrote it. A host that follows unknown states, or records numbers that are
none, would be led by a board that is broken, of another make, or none at all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np

from runtime.hardware.frames import Codec, ReceivedMessage

_OFF, _UNPOWERED = ("idle",), ("idle", "armed")
"""States without power, and those without torque."""


class Statements:
    """Of the board of one arm, by its protocol. It holds what the board was told of torques."""

    def __init__(self, codec: Codec) -> None:
        page = codec.document
        self._joints: int = page["joints"]
        self._states, self._reasons = codec.names("states"), codec.names("reasons")
        self._limits: Sequence[float] = page["ceilings"]["torque_limit"]
        self._ceilings = self._limits
        self._version: int = page["version"]
        self._checks: Mapping[str, Callable[[Mapping[str, Any]], str | None]] = {
            "identity": self._identity,
            "state": self._state,
            "telemetry": self._telemetry,
        }

    def told(self, torque_limit: Sequence[float]) -> None:
        """What `drive` has said; the board's ceilings hold besides."""
        self._limits = np.minimum(np.asarray(torque_limit, dtype=np.float32), self._ceilings).tolist()

    def wrong(self, message: ReceivedMessage) -> str | None:
        """Words for what cannot be as the message says it; None if it can."""
        check = self._checks.get(message.name)
        return None if check is None else check(message.values)

    def _identity(self, values: Mapping[str, Any]) -> str | None:
        # Another version may have other states.
        return self._standing(values) if values["version"] == self._version else None

    def _standing(self, values: Mapping[str, Any]) -> str | None:
        """State and reason, which three messages have."""
        state, reason = values["state"], values["reason"]
        if state not in self._states:
            return f"a state of the number {state}, which the protocol does not have"
        if reason not in self._reasons:
            return f"a reason of the number {reason}, which the protocol does not have"
        if (self._states[state] == "stopped") != (self._reasons[reason] != "none"):
            return f"the state {self._states[state]} with the reason {self._reasons[reason]}"
        return None

    def _state(self, values: Mapping[str, Any]) -> str | None:
        if (wrong := self._standing(values)) is not None:
            return wrong
        state, enabled = self._states[values["state"]], values["enabled"]
        if values["joint"] > self._joints:
            return f"joint {values['joint']} of {self._joints}"
        if enabled not in (0, 1) or (state != "stopped" and bool(enabled) == (state in _OFF)):
            return f"the state {state} with drives that are {'on' if enabled else 'off'}"
        return None

    def _telemetry(self, values: Mapping[str, Any]) -> str | None:
        if (wrong := self._standing(values)) is not None:
            return wrong
        state = self._states[values["state"]]
        for name in ("torque", "q_desired"):
            for joint, value in enumerate(values[name], 1):
                if not isfinite(value):
                    return f"{name} of joint {joint} is no finite number"
        for joint, (torque, limit) in enumerate(zip(values["torque"], self._limits, strict=True), 1):
            if abs(torque) > limit:
                return f"a torque of {torque:.4g} at joint {joint}, over its limit of {limit:.4g}"
            if torque and state in _UNPOWERED:
                return f"a torque of {torque:.4g} at joint {joint} in the state {state}"
        return None
