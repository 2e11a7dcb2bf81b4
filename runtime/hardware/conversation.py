"""What a board may say: numbers that the protocol has, and no two that contradict each other or what it was told.

A frame with a right checksum is from whoever wrote it. A host that follows unknown states, or records numbers that are
none, would be led by a board that is broken, of another make, or none at all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np

from runtime.hardware.link import BoardLink, Codec, Decoder, LinkError, LinkLost, ReceivedMessage

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


_ATTEMPTS, _ANSWER = 5, 0.1
"""How often a command is sent, and s that its answer may take each time."""
_ALIVES = 4
"""Signs of life in the time that the board waits for one."""


class Refused(LinkError):
    """The board does not do what it was asked; the message says why."""


class NotReady(Refused):
    """Its drives need time."""


class Untrusted(LinkError):
    """The board says what cannot be; the message says what."""


class Conversation:
    """Commands and answers over a link, which it closes.

    lie   words for the first thing that the board has said and that cannot be, None if there is none
    """

    def __init__(self, link: BoardLink, codec: Codec) -> None:
        self.link, self.codec = link, codec
        self.lie: str | None = None
        self._statements = Statements(codec)
        self._decoder = Decoder(codec)
        self._names = {table: codec.names(table) for table in ("states", "reasons", "results")}
        self._sequence = 0
        self._unanswered: tuple[int, bytes] | None = None
        self._acks: dict[int, ReceivedMessage] = {}
        self._identity: ReceivedMessage | None = None
        self._state: dict[str, Any] | None = None
        self._telemetry: list[dict[str, Any]] = []
        self._counters: dict[str, int] | None = None
        self._silence = self._due = 0.0

    def close(self) -> None:
        self.link.close()

    def figures(self) -> dict[str, Any]:
        """What the link did to frames: those that arrived damaged here, by kind, and what the board has counted."""
        return {"damaged": dict(self._decoder.errors), "board": self._counters}

    def _hello(self, attempts: int = _ATTEMPTS) -> dict[str, Any]:
        """The board's identity; the commands that follow are numbered from here."""
        self._identity = self._unanswered = None
        # Of a board of another version, the identity is all that can be read.
        self._repeat("hello", self._frame("hello")[1], lambda: self._identity is not None, attempts)
        assert self._identity is not None
        return self._identity.values

    def _stop(self) -> None:
        """Whatever else is under way; the board takes it in every state, whatever its number."""
        self._unanswered = self._frame("stop")
        self.link.write(self._unanswered[1])

    def _stay_alive(self) -> None:
        """A sign of life, when it is time for one."""
        if self.link.now() >= self._due:
            self._say("alive")

    def _say(self, name: str) -> None:
        """A command that is not waited for. If the last of them was not answered, that one again: no number is left
        out, and none is done twice."""
        if not self._unheard:
            self._acks.clear()
            self._unanswered = self._frame(name)
        assert self._unanswered is not None
        self.link.write(self._unanswered[1])
        self._due = self.link.now() + self._silence / _ALIVES

    @property
    def _unheard(self) -> bool:
        return self._unanswered is not None and self._unanswered[0] not in self._acks

    def _command(self, name: str, values: Any = None) -> int:
        """A command until it is acknowledged; the detail of its answer. Raises Refused, LinkLost, Untrusted."""
        number, frame = self._frame(name, values)
        self._repeat(name, frame, lambda: number in self._acks)
        self._due = self.link.now() + self._silence / _ALIVES
        ack = self._acks.pop(number)
        result = self._names["results"].get(ack.values["result"], "unknown")
        if result != "done":
            refused = NotReady if result == "not_ready" else Refused
            raise refused(self._refusal(name, ack.values))
        detail: int = ack.values["detail"]
        return detail

    def _ask(self, told: Callable[[], bool], otherwise: str) -> None:
        """A query, until what it is to bring has come: a new one each time, as none is done twice.

        Raises LinkLost that says `otherwise`, Untrusted.
        """
        for _ in range(_ATTEMPTS):
            self._command("query")
            deadline = self.link.now() + _ANSWER
            while not told() and (left := deadline - self.link.now()) > 0:
                self._listen(left)
            if told():
                return
            self._believe()
        raise LinkLost(otherwise)

    def _repeat(self, name: str, frame: bytes, answered: Callable[[], bool], attempts: int = _ATTEMPTS) -> None:
        """Send a frame until it is answered. Raises LinkLost, Untrusted."""
        for _ in range(attempts):
            self.link.write(frame)
            deadline = self.link.now() + _ANSWER
            while not answered() and (left := deadline - self.link.now()) > 0:
                self._listen(left)
            self._believe()
            if answered():
                return
        raise LinkLost(f"the board does not answer ({name}, {attempts} times); is its firmware running?")

    def _refusal(self, name: str, ack: dict[str, Any]) -> str:
        texts = {result["number"]: result["text"] for result in self.codec.document["results"]}
        detail = self._detail(name, self._names["results"].get(ack["result"], ""), ack["detail"])
        return f"the board does not take {name}: {texts.get(ack['result'], 'refused')}{detail and f' ({detail})'}"

    def _detail(self, name: str, result: str, number: int) -> str:
        """What the number beside a result stands for."""
        if result in ("not_finite", "out_of_range"):
            return self._value(name, number) or f"phase {number + 1}"
        if result == "incomplete":
            return ", ".join(part for part, bit in self.codec.document["missing"].items() if number & bit)
        if result == "state":
            return self._names["states"].get(number, "")
        return f"{number} is expected" if result in ("sequence", "order") else ""

    def _value(self, name: str, number: int) -> str:
        """Which field of a command a value's number, from 0, is of; empty if of none."""
        values = [field for field, count in self.codec.fields(name).items() for _ in range(count or 1)]
        return values[number] if number < len(values) else ""

    def _frame(self, name: str, values: Any = None) -> tuple[int, bytes]:
        self._sequence = (self._sequence + 1) & 0xFFFF
        self._acks.pop(self._sequence, None)
        return self._sequence, self.codec.encode(name, values, self._sequence)

    def _believe(self) -> None:
        """Raise Untrusted if the board has said what cannot be."""
        if self.lie is not None:
            raise Untrusted(self.lie)

    def _listen(self, timeout: float) -> None:
        """Whatever comes within so many s, sorted."""
        for message in self._decoder.feed(self.link.read(timeout)):
            if (wrong := self._statements.wrong(message)) is not None:
                self.lie = self.lie or f"the board says what cannot be ({message.name}): {wrong}"
            elif message.name == "telemetry":
                self._telemetry.append(message.values)
            elif message.name == "ack":
                self._acks[message.values["sequence"]] = message
            elif message.name == "state":
                self._state = message.values
            elif message.name == "identity":
                self._identity = message
            elif message.name == "counters":
                self._counters = message.values
