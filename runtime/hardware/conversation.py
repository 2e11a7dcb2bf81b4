"""Commands to a board and its answers, with a check of what it reports.

A frame with a correct checksum may still come from a broken board or another firmware. So states and reasons must be
those of the protocol, must not contradict each other, and torques must respect the limits that were sent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite

import numpy as np

from runtime.documents.plans import LinkEntry
from runtime.hardware.blocks import Blocks
from runtime.hardware.link import BoardLink, Codec, Decoder, LinkError, LinkLost, ReceivedMessage, Values

_OFF, _UNPOWERED = ("idle",), ("idle", "armed")
"""States with the drives off, and states without torque."""


class Statements:
    """Checks the messages of a board against its protocol and the torque limits that it was sent."""

    def __init__(self, codec: Codec) -> None:
        page = codec.document
        self._joints: int = page["joints"]
        self._states, self._reasons = codec.names("states"), codec.names("reasons")
        self._limits: Sequence[float] = page["ceilings"]["torque_limit"]
        self._ceilings = self._limits
        self._version: int = page["version"]
        self._checks: Mapping[str, Callable[[Values], str | None]] = {
            # Another version may have other states.
            "identity": lambda values: self._standing(values) if values["version"] == self._version else None,
            "state": self._state,
            "telemetry": self._telemetry,
        }

    def limit(self, torque_limit: Sequence[float]) -> None:
        """Sets the torque limits of the message `drive`; the board's own ceilings stay in force."""
        self._limits = np.minimum(np.asarray(torque_limit, dtype=np.float32), self._ceilings).tolist()

    def wrong(self, message: ReceivedMessage) -> str | None:
        """What is impossible in a message; None if nothing is."""
        check = self._checks.get(message.name)
        return None if check is None else check(message.values)

    def _standing(self, values: Values) -> str | None:
        """Checks state and reason, which three messages have."""
        state, reason = values["state"], values["reason"]
        if state not in self._states:
            return f"state number {state}, which is not in the protocol"
        if reason not in self._reasons:
            return f"reason number {reason}, which is not in the protocol"
        if (self._states[state] == "stopped") != (self._reasons[reason] != "none"):
            return f"state {self._states[state]} with reason {self._reasons[reason]}"
        return None

    def _state(self, values: Values) -> str | None:
        if (wrong := self._standing(values)) is not None:
            return wrong
        state, enabled = self._states[values["state"]], values["enabled"]
        if values["joint"] > self._joints:
            return f"joint {values['joint']} of {self._joints}"
        if enabled not in (0, 1) or (state != "stopped" and bool(enabled) == (state in _OFF)):
            return f"state {state} with the drives {'on' if enabled else 'off'}"
        return None

    def _telemetry(self, values: Values) -> str | None:
        if (wrong := self._standing(values)) is not None:
            return wrong
        state = self._states[values["state"]]
        for name in ("torque", "q_desired"):
            for joint, value in enumerate(values[name], 1):
                if not isfinite(value):
                    return f"{name} of joint {joint} is not finite"
        for joint, (torque, limit) in enumerate(zip(values["torque"], self._limits, strict=True), 1):
            if abs(torque) > limit:
                return f"torque {torque:.4g} at joint {joint}, over its limit {limit:.4g}"
            if torque and state in _UNPOWERED:
                return f"torque {torque:.4g} at joint {joint} in state {state}"
        return None


_ATTEMPTS, _ANSWER = 5, 0.1
"""How often a command is sent, and the time in s for its answer each time."""
_ALIVES = 4
"""Number of `alive` messages in the time after which the board misses them."""


class Refused(LinkError):
    """The board refuses a command; the message says why."""


class NotReady(Refused):
    """The drives are not ready yet."""


class Untrusted(LinkError):
    """The board reports something impossible; the message says what."""


class Conversation:
    """Commands and answers over a link, which it closes.

    impossible   the first impossible thing that the board reported; None: nothing
    blocks       statistics that it has sent
    """

    def __init__(self, link: BoardLink, codec: Codec) -> None:
        self.link, self.codec = link, codec
        self.impossible: str | None = None
        self._statements = Statements(codec)
        self._decoder = Decoder(codec)
        self._names = {table: codec.names(table) for table in ("states", "reasons", "results")}
        self._sequence = 0
        self._unanswered: tuple[int, bytes] | None = None
        self._acks: dict[int, ReceivedMessage] = {}
        self._identity: ReceivedMessage | None = None
        self._state: Values | None = None
        self._telemetry: list[Values] = []
        self.blocks = Blocks(codec.document.get("statistics"))
        self._counters: dict[str, int] | None = None
        self._silence = self._due = 0.0

    def close(self) -> None:
        self.link.close()

    def figures(self) -> LinkEntry:
        """Numbers of frames that arrived damaged here, by kind, and of those that the board counted."""
        return LinkEntry(damaged=dict(self._decoder.errors), board=self._counters)

    def _hello(self, attempts: int = _ATTEMPTS) -> Values:
        """The board's identity; commands are numbered from here."""
        self._identity = self._unanswered = None
        # Of a board with another version, only the identity can be read.
        self._repeat("hello", self._frame("hello")[1], lambda: self._identity is not None, attempts)
        assert self._identity is not None
        return self._identity.values

    def _stop(self) -> None:
        self._unanswered = self._frame("stop")
        self.link.write(self._unanswered[1])

    def _stay_alive(self) -> None:
        if self.link.now() >= self._due:
            self._say("alive")

    def _say(self, name: str) -> None:
        """Sends a command without waiting for its answer. If the last one is unanswered, sends that again, so that no
        number is skipped and no command is executed twice."""
        if not self._unheard:
            self._acks.clear()
            self._unanswered = self._frame(name)
        assert self._unanswered is not None
        self.link.write(self._unanswered[1])
        self._due = self.link.now() + self._silence / _ALIVES

    @property
    def _unheard(self) -> bool:
        return self._unanswered is not None and self._unanswered[0] not in self._acks

    def _command(self, name: str, values: Values | None = None) -> int:
        """Sends a command until it is acknowledged; the detail of the answer. Raises Refused, LinkLost, Untrusted."""
        number, frame = self._frame(name, values)
        self._repeat(name, frame, lambda: number in self._acks)
        self._due = self.link.now() + self._silence / _ALIVES
        ack = self._acks.pop(number)
        result = self._names["results"].get(ack.values["result"], "unknown")
        if result != "done":
            refused = NotReady if result == "not_ready" else Refused
            texts = {result["number"]: result["text"] for result in self.codec.document["results"]}
            why = f" ({meant})" if (meant := self._detail(name, result, ack.values["detail"])) else ""
            raise refused(f"the board does not accept {name}: {texts.get(ack.values['result'], 'refused')}{why}")
        return int(ack.values["detail"])

    def _ask(self, answered: Callable[[], bool], otherwise: str) -> None:
        """Sends queries until the wanted message arrives; each is new, because none is executed twice.

        Raises LinkLost with the message `otherwise`, Untrusted.
        """
        for _ in range(_ATTEMPTS):
            self._command("query")
            deadline = self.link.now() + _ANSWER
            while not answered() and (left := deadline - self.link.now()) > 0:
                self._listen(left)
            if answered():
                return
            self._believe()
        raise LinkLost(otherwise)

    def _repeat(self, name: str, frame: bytes, answered: Callable[[], bool], attempts: int = _ATTEMPTS) -> None:
        """Sends a frame until it is answered. Raises LinkLost, Untrusted."""
        for _ in range(attempts):
            self.link.write(frame)
            deadline = self.link.now() + _ANSWER
            while not answered() and (left := deadline - self.link.now()) > 0:
                self._listen(left)
            self._believe()
            if answered():
                return
        raise LinkLost(f"the board does not answer ({name}, {attempts} times); is its firmware running?")

    def _detail(self, name: str, result: str, number: int) -> str:
        """The meaning of the number that comes with a result."""
        if result in ("not_finite", "out_of_range"):
            return self._value(name, number) or f"phase {number + 1}"
        if result == "incomplete":
            return ", ".join(part for part, bit in self.codec.document["missing"].items() if number & bit)
        if result == "state":
            return self._names["states"].get(number, "")
        return f"{number} is expected" if result in ("sequence", "order") else ""

    def _value(self, name: str, number: int) -> str:
        """The field of a command that has its value of this number, counted from 0; empty if none has."""
        values = [field for field, count in self.codec.fields(name).items() for _ in range(count or 1)]
        return values[number] if number < len(values) else ""

    def _frame(self, name: str, values: Values | None = None) -> tuple[int, bytes]:
        self._sequence = (self._sequence + 1) & 0xFFFF
        self._acks.pop(self._sequence, None)
        return self._sequence, self.codec.encode(name, values, self._sequence)

    def _believe(self) -> None:
        """Raises Untrusted if the board reported something impossible."""
        if self.impossible is not None:
            raise Untrusted(self.impossible)

    def _listen(self, timeout: float) -> None:
        """Receives messages for up to `timeout` s and sorts them by kind."""
        for message in self._decoder.feed(self.link.read(timeout)):
            if (wrong := self._statements.wrong(message)) is not None:
                self.impossible = self.impossible or f"the board reports something impossible ({message.name}): {wrong}"
            elif message.name == "telemetry":
                self._telemetry.append(message.values)
            elif message.name == "statistics":
                self.blocks.take(message.values)
            elif message.name == "ack":
                self._acks[message.values["sequence"]] = message
            elif message.name == "state":
                self._state = message.values
            elif message.name == "identity":
                self._identity = message
            elif message.name == "counters":
                self._counters = dict(message.values)
