"""The words between a host and a board: numbered commands, repeated until they are answered, and what comes back.

No wait is without a deadline, and all of them are kept by the link's own clock. What a board may not say is not heard:
the first such thing is kept, and the session decides what becomes of it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from runtime.hardware.frames import Codec, Decoder, ReceivedMessage
from runtime.hardware.link import BoardLink, LinkError, LinkLost
from runtime.hardware.statements import Statements

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
