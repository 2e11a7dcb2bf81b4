"""A host's conversation with a board: who are you, here is what you need, arm, run, what do you see, stop.

No wait is without a deadline, and all of them are kept by the link's own clock.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from runtime.hardware.frames import DELIMITER, Codec, Decoder, ReceivedMessage
from runtime.hardware.link import BoardLink, LinkError, LinkLost
from runtime.hardware.settings import Settings
from runtime.hardware.telemetry import Log

_ATTEMPTS, _ANSWER = 5, 0.1
"""How often a command is sent, and s that its answer may take each time."""
_GREETINGS = 30
"""The same of the first word: some boards start anew when their port is opened."""
_CHUNK = 0.002
"""s of one read in a run: what is missing or wrong in it is answered within a few ms."""
_ALIVES = 4
"""Signs of life in the time that the board waits for one."""
_SILENT = 0.3
"""s without telemetry after which the board counts as lost."""
_READY = 10.0
"""s that drives may take until they are ready."""
_END = 1.0
"""s that a board may take for a stop, besides its damping."""
_PATIENCE = 5.0
"""s that it may damp what another host has left in motion."""
_MICROSECONDS = 1e6
_TRAJECTORY = ("trajectory", "phase", "points")


class Refused(LinkError):
    """The board does not do what it was asked; the message says why."""


class _NotReady(Refused):
    """Its drives need time."""


@dataclass(frozen=True)
class Ended:
    """Why a run is over: a reason of the protocol, or of the host (interrupted, telemetry_lost, link_lost,
    other_rate).

    joint    1-based, None for the whole arm      period   of the run in which it came about
    detail   words of the host's, None where the reason says it all; code: of a drive's fault
    """

    reason: str
    joint: int | None = None
    period: int | None = None
    detail: str | None = None
    code: int = 0


@dataclass(frozen=True)
class BoardRun:
    """rows: the run's telemetry (N,), without gaps, up to the end; its fields are those of the message."""

    rows: NDArray[Any]
    ended: Ended


class Session:
    """One host's conversation over a link; close it, whatever happened."""

    def __init__(self, link: BoardLink, codec: Codec) -> None:
        self.link, self.codec = link, codec
        self._decoder = Decoder(codec)
        self._names = {table: codec.names(table) for table in ("states", "reasons", "results")}
        self._sequence = 0
        self._unanswered: tuple[int, bytes] | None = None
        self._acks: dict[int, ReceivedMessage] = {}
        self._identity: ReceivedMessage | None = None
        self._state: dict[str, Any] | None = None
        self._telemetry: list[dict[str, Any]] = []
        self._counters: dict[str, int] | None = None
        self._dt = self._silence = self._damping = self._late = self._due = 0.0

    def close(self) -> None:
        self.link.close()

    # --- before a run ---

    def identify(self) -> dict[str, Any]:
        """The board's identity; it is idle then. Raises Refused for firmware that is not of this model, LinkLost."""
        # Ends whatever half a frame the line has brought before.
        self.link.write(DELIMITER)
        found, own = self._hello(_GREETINGS), self.codec.document
        if found["version"] != own["version"]:
            raise Refused(
                f"the board speaks version {found['version']} of the protocol, this host version {own['version']}; "
                "build its firmware anew (tendon firmware) and load it"
            )
        if (found["fingerprint"], found["joints"]) != (own["fingerprint"], own["joints"]):
            raise Refused(
                f"the board's firmware is of another arm or another version ({found['joints']} joints, fingerprint "
                f"{found['fingerprint']:08x}; expected {own['joints']}, {own['fingerprint']:08x}); "
                "build it anew (tendon firmware) and load it"
            )
        if found["build"] != own["build"]:
            raise Refused(
                "the board's firmware has been generated from other equations or by another version of Tendon (build "
                f"{found['build']:08x}; expected {own['build']:08x}); build it anew (tendon firmware) and load it"
            )
        if self._names["states"][found["state"]] != "idle":
            self._rest()
        return found

    def upload(self, settings: Settings) -> None:
        """Everything that a run needs. Raises Refused, LinkLost."""
        page = self.codec.document
        for what, count, most in (
            ("phases", len(settings.phases), page["max_phases"]),
            ("control points", len(settings.points), page["max_rows"]),
        ):
            if count > most:
                raise Refused(f"the trajectory has {count} {what}; the board takes {most}")
        self._dt = settings.dt
        self._silence = settings.safety["silence"] * settings.dt
        self._damping = settings.safety["damping"] * settings.dt
        self._late = settings.safety["late"] / _MICROSECONDS
        checksum = 0
        for name, values in settings.messages(page["rows_a_message"]):
            if name in _TRAJECTORY:
                checksum = zlib.crc32(self.codec.payload(name, values), checksum)
            self._command(name, values)
        self._command("commit", {"checksum": checksum})

    def counts(self) -> tuple[int, ...]:
        """(n,) what the encoders read now. Raises Refused, LinkLost."""
        self._telemetry.clear()
        self._ask(
            lambda: bool(self._telemetry),
            "the board answers, but no control period passes there: look at the timer behind tendon_board_period",
        )
        return tuple(self._telemetry.pop()["counts"])

    def figures(self) -> dict[str, Any]:
        """What the link did to frames: those that arrived damaged here, by kind, and what the board has counted."""
        return {"damaged": dict(self._decoder.errors), "board": self._counters}

    # --- a run ---

    def run(self, periods: int, every: int = 1, asked: Callable[[], int] = lambda: 0) -> BoardRun:
        """Arm and run for so many control periods, with telemetry in every so many; idle again afterwards.

        asked   whether the user wants to stop: 0 no, 1 yes, 2 without waiting for the board
        Raises Refused. A link that is lost ends the run, and what was recorded until then is returned.
        """
        log = Log(every, self.codec)
        if asked():
            return BoardRun(log.rows(), Ended("interrupted"))
        self._telemetry.clear()
        self._state = None
        try:
            ended = self._driven(periods, log, asked)
        except BaseException:
            # Whatever has happened here, the arm does not go on.
            with suppress(LinkLost):
                self._stop()
            raise
        return BoardRun(log.rows(), ended)

    def _driven(self, periods: int, log: Log, asked: Callable[[], int]) -> Ended:
        told: Ended | None = None
        try:
            ended = self._begin(periods, log, asked) or self._follow(log, asked)
        except LinkLost as lost:
            log.take(self._telemetry)
            ended = Ended("link_lost", period=log.last, detail=str(lost))
        except Refused:
            with suppress(LinkLost):
                self._leave(log, asked)
            raise
        # One that is heard no more may hear all the same.
        with suppress(LinkLost):
            told = self._leave(log, asked)
        ended = ended or told
        if ended is None:
            return Ended("link_lost", period=log.last, detail="the board does not say that it has stopped")
        if ended.reason == "done" and (missing := log.missing(periods)) is not None:
            return Ended("telemetry_lost", period=log.last, detail=missing)
        return ended

    def _begin(self, periods: int, log: Log, asked: Callable[[], int]) -> Ended | None:
        """Drives on, and on the way as soon as they are ready (None), unless the user wants to stop.

        Raises Refused, but not of a board that has stopped by itself meanwhile; LinkLost.
        """
        deadline = self.link.now() + _READY
        try:
            self._command("arm")
            while not self._runs(periods, log.every, deadline):
                if asked():
                    return Ended("interrupted")
        except Refused:
            self._state = None
            self._ask(lambda: self._state is not None, "the board does not tell its state")
            if not self._stopped:
                raise
        return None

    def _runs(self, periods: int, every: int, deadline: float) -> bool:
        """Told to run; False where the drives need more time, and until the deadline have it."""
        try:
            self._command("run", {"periods": periods, "every": every})
        except _NotReady:
            if self.link.now() > deadline:
                raise
            self._listen(_CHUNK)
            return False
        return True

    def _follow(self, log: Log, asked: Callable[[], int]) -> Ended | None:
        """Until the board has stopped (None) or the host has to stop it."""
        heard = self.link.now()
        while not (self._stopped or log.over):
            if asked():
                return Ended("interrupted", period=log.last)
            self._stay_alive()
            self._listen(_CHUNK)
            if self._telemetry:
                heard = self.link.now()
            log.take(self._telemetry)
            if not self._stopped and log.gap is not None:
                return Ended("telemetry_lost", period=log.last, detail=log.gap)
            # Where this end keeps the time, it knows how late it is.
            if self.link.late is None and (off := log.off(self._dt, self._late)) is not None:
                return Ended("other_rate", period=log.last, detail=off)
            if (silent := self.link.now() - heard) > _SILENT + 2 * log.every * self._dt:
                return Ended("link_lost", period=log.last, detail=f"nothing from the board for {silent:.2g} s")
        return None

    def _leave(self, log: Log, asked: Callable[[], int]) -> Ended | None:
        """Stopped with its drives off, and idle again; what the board says of its stop, None if it says nothing."""
        damped = self.link.now() + self._damping
        if not self._stopped:
            # Whatever it has said before this is past.
            self._state = None
            if not log.over:
                self._stop()
        said, ended = self.link.now(), self._board_ended()
        while not self._resting and self.link.now() < damped + _END and asked() < 2:
            # Its last words may be lost, as may be what it is told.
            now = self.link.now()
            if now >= (said + _CHUNK if self._unheard else self._due):
                said = now
                self._say("alive" if self._stopped and now < damped else "query")
            self._listen(_CHUNK)
            log.take(self._telemetry)
            ended = ended or self._board_ended()
        if self._resting:
            # A board that no longer hears this has stopped all the same; why, it has said. Some of the last words may
            # have been lost, so the commands are numbered anew.
            with suppress(LinkLost, Refused):
                self._hello()
                self._command("reset")
        elif not self._stopped:
            self._stop()
        return ended

    def _board_ended(self) -> Ended | None:
        if not self._stopped:
            return None
        assert self._state is not None
        state = self._state
        reason = self._names["reasons"][state["reason"]]
        detail = self.link.fault if reason == "drive" else None
        if reason == "drive" and state["code"] == self.codec.document["not_ready"]:
            detail = detail or "a drive that was ready no longer is"
        return Ended(reason, state["joint"] or None, state["period"], detail, state["code"])

    @property
    def _stopped(self) -> bool:
        return self._state is not None and self._names["states"][self._state["state"]] == "stopped"

    @property
    def _resting(self) -> bool:
        """Whether its drives are off, and stay so until it is told otherwise."""
        if self._state is None or self._state["enabled"]:
            return False
        return self._names["states"][self._state["state"]] in ("idle", "stopped")

    def _rest(self) -> None:
        """From any state to idle, after another host has left the board in it."""
        assert self._identity is not None
        if self._names["states"][self._identity.values["state"]] != "stopped":
            self._command("stop")
        self._state = None
        deadline = self.link.now() + _PATIENCE
        while not self._resting:
            if self.link.now() > deadline:
                raise LinkLost("the board does not say that its drives are off")
            self._command("query")
            self._listen(_CHUNK)
        self._command("reset")

    # --- words ---

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

    def _command(self, name: str, values: Any = None) -> None:
        """A command until it is acknowledged. Raises Refused, LinkLost."""
        number, frame = self._frame(name, values)
        self._repeat(name, frame, lambda: number in self._acks)
        self._due = self.link.now() + self._silence / _ALIVES
        ack = self._acks.pop(number)
        result = self._names["results"].get(ack.values["result"], "unknown")
        if result != "done":
            refused = _NotReady if result == "not_ready" else Refused
            raise refused(self._refusal(name, ack.values))

    def _ask(self, told: Callable[[], bool], otherwise: str) -> None:
        """A query, until what it is to bring has come: a new one each time, as none is done twice.

        Raises LinkLost that says `otherwise`.
        """
        for _ in range(_ATTEMPTS):
            self._command("query")
            deadline = self.link.now() + _ANSWER
            while not told() and (left := deadline - self.link.now()) > 0:
                self._listen(left)
            if told():
                return
        raise LinkLost(otherwise)

    def _repeat(self, name: str, frame: bytes, answered: Callable[[], bool], attempts: int = _ATTEMPTS) -> None:
        """Send a frame until it is answered. Raises LinkLost."""
        for _ in range(attempts):
            self.link.write(frame)
            deadline = self.link.now() + _ANSWER
            while not answered() and (left := deadline - self.link.now()) > 0:
                self._listen(left)
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
            values = [field for field, count in self.codec.fields(name).items() for _ in range(count or 1)]
            return values[number] if number < len(values) else f"phase {number + 1}"
        if result == "incomplete":
            return ", ".join(part for part, bit in self.codec.document["missing"].items() if number & bit)
        if result == "state":
            return self._names["states"].get(number, "")
        return f"{number} is expected" if result in ("sequence", "order") else ""

    def _frame(self, name: str, values: Any = None) -> tuple[int, bytes]:
        self._sequence = (self._sequence + 1) & 0xFFFF
        self._acks.pop(self._sequence, None)
        return self._sequence, self.codec.encode(name, values, self._sequence)

    def _listen(self, timeout: float) -> None:
        """Whatever comes within so many s, sorted."""
        for message in self._decoder.feed(self.link.read(timeout)):
            if message.name == "telemetry":
                self._telemetry.append(message.values)
            elif message.name == "ack":
                self._acks[message.values["sequence"]] = message
            elif message.name == "state":
                self._state = message.values
            elif message.name == "identity":
                self._identity = message
            elif message.name == "counters":
                self._counters = message.values
