"""A host's end of the link to the machine on this computer: one command, one answer; one step, its record."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.hardware.boards import HostBoard
from runtime.hardware.link import Codec, Decoder, ReceivedMessage
from runtime.hardware.lockstep import Board

N = 2
"""Joints of the arm that is spoken to."""
PER_COUNT = 2.0**-10
DRIVE: dict[str, Any] = {
    "rate": 1000.0,
    "velocity_gain": 0.5,
    "position_per_count": [PER_COUNT] * N,
    "zero": [100, -3],
    "kp": [64.0, 32.0],
    "kd": [2.0, 0.5],
    "torque_limit": [40.0, 50.0],
}
SAFETY: dict[str, Any] = {
    "tracking": [0.5] * N,
    "speed": [20.0] * N,
    "low": [-2.0] * N,
    "high": [2.0] * N,
    "start": [0.25] * N,
    "jump": [200] * N,
    "frozen": [1.5] * N,
    "saturated": 50,
    "silence": 100_000,
    "errors": 3,
    "early": 500,
    "late": 1500,
    "damping": 4,
}


@dataclass
class Step:
    """What a control period gave, and what the board had to say after it."""

    enabled: bool
    torque: NDArray[np.float32]
    reports: list[ReceivedMessage]

    def report(self, name: str) -> dict[str, Any] | None:
        """The last one of this name."""
        return next((message.values for message in reversed(self.reports) if message.name == name), None)


@dataclass
class Talk:
    """One board, just started."""

    directory: Path
    name: str
    n: int = N
    sequence: int = 0
    time_us: int = 0
    counts: list[int] = field(default_factory=list)
    made: Callable[[Path, str, int], Board] = HostBoard

    def __post_init__(self) -> None:
        self.counts = self.counts or list(self.each(DRIVE["zero"]))
        self.board = self.made(self.directory, self.name, self.n)
        self.codec = Codec.from_json(self.directory / "protocol.json")
        self.decoder = Decoder(self.codec)
        self.results = self.codec.names("results")
        self.reasons = self.codec.names("reasons")
        self.reports: list[ReceivedMessage] = self.hear()

    def hear(self) -> list[ReceivedMessage]:
        found = []
        while data := self.board.send():
            found += self.decoder.feed(data)
        return found

    def raw(self, data: bytes) -> list[ReceivedMessage]:
        self.board.receive(data)
        return self.hear()

    def say(self, name: str, values: Mapping[str, Any] | None = None, sequence: int | None = None) -> str:
        """The result's name; `reports`: all that came back."""
        self.sequence = (self.sequence + 1 if sequence is None else sequence) & 0xFFFF
        self.reports = self.raw(self.codec.encode(name, values, self.sequence))
        answers = [message.values for message in self.reports if message.name == "ack"]
        assert len(answers) == 1
        assert (answers[0]["type"], answers[0]["sequence"]) == (self.codec.number(name), self.sequence)
        self.detail = answers[0]["detail"]
        return self.results[answers[0]["result"]]

    def report(self, name: str) -> dict[str, Any]:
        """The last one of this name, after the last command."""
        return next(message.values for message in reversed(self.reports) if message.name == name)

    def state(self) -> dict[str, Any]:
        """By a query; names for numbers."""
        assert self.say("query") == "done"
        found = self.report("state")
        return found | {"state": self.codec.names("states")[found["state"]], "reason": self.reasons[found["reason"]]}

    def step(self, counts: Sequence[int] | None = None, us: int = 1000, fault: int = 0) -> Step:
        """The next control period, where the encoders stand or at other `counts`."""
        self.counts = self.counts if counts is None else list(counts)
        self.time_us += us
        wrapped = np.array([(c + 2**31) % 2**32 - 2**31 for c in self.counts], dtype=np.int32)
        enabled, torque = self.board.period(wrapped, self.time_us & 0xFFFFFFFF, fault)
        return Step(enabled, torque.copy(), self.hear())

    # --- whole parts of a session ---

    def each(self, value: Any) -> Any:
        """A value a joint, in turn, where there is a list of them."""
        return [value[j % len(value)] for j in range(self.n)] if isinstance(value, list) else value

    def settings(self, **changed: Any) -> None:
        """All of them; changed: fields of drive or safety."""
        for name in ("parameters", "effects"):
            assert self.say(name, dict.fromkeys(self.codec.fields(name), 0.5)) == "done"
        for name, values in (("drive", DRIVE), ("safety", SAFETY)):
            assert self.say(name, {key: self.each(changed.get(key, value)) for key, value in values.items()}) == "done"

    def parts(
        self, rows: Sequence[Sequence[float]], duration: float, periodic: bool
    ) -> list[tuple[str, dict[str, Any]]]:
        """The messages of a trajectory of one phase with these control points, without the commit."""
        size = self.codec.document["rows_a_message"]
        head = {
            name: 0.0 if count is None else [0.0] * count for name, count in self.codec.fields("trajectory").items()
        }
        head |= {"count": 1, "periodic": int(periodic), "elbow": 1, "rows": len(rows)}
        phase = {
            "index": 0,
            "coordinates": 0,
            "degree": len(rows) - 1,
            "duration": duration,
            "touches": 0,
            "first_row": 0,
        }
        messages = [("trajectory", head), ("phase", phase)]
        for first in range(0, len(rows), size):
            flat = [value for row in rows[first : first + size] for value in row]
            messages.append(("points", {"first_row": first, "values": flat + [0.0] * (size * self.n - len(flat))}))
        return messages

    def upload(self, rows: Sequence[Sequence[float]] = (), duration: float = 1.0, periodic: bool = False) -> None:
        """A trajectory of one phase; as it stands, one that rests at zero."""
        checksum = 0
        for name, values in self.parts(rows or [[0.0] * self.n] * 5, duration, periodic):
            assert self.say(name, values) == "done"
            checksum = zlib.crc32(self.codec.payload(name, values), checksum)
        assert self.say("commit", {"checksum": checksum}) == "done"

    def run(self, periods: int = 0, every: int = 1) -> None:
        """Armed, a few steps, and on; the next step is the first one of the run."""
        assert self.say("arm") == "done"
        for _ in range(3):
            self.step()
        assert self.say("run", {"periods": periods, "every": every}) == "done"

    def ready(self, **changed: Any) -> Talk:
        """Settings and a trajectory at rest are there."""
        self.settings(**changed)
        self.upload()
        return self
