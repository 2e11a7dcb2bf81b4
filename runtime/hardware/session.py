"""The telemetry of a run: checked for gaps, kept in arrays."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.hardware.conversation import Conversation, NotReady, Refused, Untrusted
from runtime.hardware.link import DELIMITER, BoardLink, Codec, LinkLost
from runtime.hardware.settings import Settings

_BLOCK = 4096
_LOOK_AFTER, _RATE_TOLERANCE = 0.1, 0.05
"""s of a run after which the board's control period is compared with the nominal one; part by which it may differ."""
_MICROSECONDS = 1e6
_TYPES = {"u8": "<u1", "u16": "<u2", "u32": "<u4", "i32": "<i4", "float": "<f4"}


class Log:
    """The telemetry of a run as long as it is whole.

    last   period of its last record, None before the first
    gap    words for the first record that was missing, after which nothing is added; None
    over   whether the board has said that it runs no more
    It ends with the record of the step that stopped the arm, whatever its period; a step that found the run done is
    none of it.
    """

    def __init__(self, every: int, codec: Codec) -> None:
        self.every = every
        self.last: int | None = None
        self._type = _record_type(codec)
        self._states, self._reasons = codec.names("states"), codec.names("reasons")
        self._whole: list[NDArray[Any]] = []
        self._recent: list[tuple[Any, ...]] = []
        self._expected = 0
        self.gap: str | None = None
        self.over = False
        self._running = -1
        self._begun: int | None = None
        self._elapsed = self._stamp = 0

    def rows(self) -> NDArray[Any]:
        """(N,) with the fields of the message."""
        return np.concatenate([*self._whole, np.array(self._recent, dtype=self._type)])

    def take(self, rows: list[dict[str, Any]]) -> None:
        """Add and clear `rows`."""
        for row in rows:
            if self.gap is None and not self.over:
                self._add(row)
        rows.clear()

    def missing(self, periods: int) -> str | None:
        """What a run that went through so many periods should have left, and has not; None if it is whole."""
        if self.gap is None and self._expected < periods:
            return f"the telemetry of period {self._expected} is missing, and what came after it"
        return self.gap

    def beyond(self, periods: int) -> bool:
        """Whether the board says that it runs, after as many periods as a run was to have."""
        return self._running >= periods

    def off(self, dt: float, late: float) -> str | None:
        """Words for a board that keeps another control period than dt; late: s that a single one may be longer."""
        if self._begun is None or self.last is None or self.last == self._begun:
            return None
        periods, seconds = self.last - self._begun, self._elapsed / _MICROSECONDS
        nominal = dt * periods
        if max(nominal, seconds) < _LOOK_AFTER or abs(seconds - nominal) <= _RATE_TOLERANCE * nominal + late:
            return None
        return (
            f"its control periods take {1e3 * seconds / periods:.3g} ms, by the model file {1e3 * dt:.3g} ms; "
            "set its timer to the rate in [controller], or the rate to the timer's"
        )

    def _add(self, row: dict[str, Any]) -> None:
        if self._states[row["state"]] == "running":
            self._running = max(self._running, row["period"])
        if row["period"] > self._expected:
            self.gap = f"the telemetry of period {self._expected} is missing, that of {row['period']} is there"
        elif self._states[row["state"]] == "running":
            if row["period"] == self._expected:
                self._append(row)
                self._expected += self.every
        else:
            self.over = True
            if self._reasons[row["reason"]] != "done":
                self._append(row)

    def _append(self, row: dict[str, Any]) -> None:
        self.last = row["period"]
        if self._begun is None:
            self._begun = row["period"]
        else:
            # The board's clock wraps, and so does the difference.
            self._elapsed += (row["time_us"] - self._stamp) & 0xFFFFFFFF
        self._stamp = row["time_us"]
        self._recent.append(tuple(row.values()))
        # Of an hour at 1 kHz, arrays are a tenth as large as what they are made of.
        if len(self._recent) >= _BLOCK:
            self._whole.append(np.array(self._recent, dtype=self._type))
            self._recent.clear()


def _record_type(codec: Codec) -> np.dtype[Any]:
    """Of a telemetry message."""
    message = next(item for item in codec.document["messages"] if item["name"] == "telemetry")
    return np.dtype([(field["name"], _TYPES[field["type"]], field["count"] or ()) for field in message["fields"]])


_GREETINGS = 30
"""How often the first word is sent: some boards start anew when their port is opened."""
_CHUNK = 0.002
"""s of one read in a run: what is missing or wrong in it is answered within a few ms."""
_SILENT = 0.3
"""s without telemetry after which the board counts as lost."""
_READY = 10.0
"""s that drives may take until they are ready."""
_END = 1.0
"""s that a board may take for a stop, besides its damping."""
_PATIENCE = 5.0
"""s that it may damp what another host has left in motion."""
_TRAJECTORY = ("trajectory", "phase", "points")
_UNSAID = ("done", "link_lost", "telemetry_lost")
"""Ends of a run of which a board that says what cannot be is the better account."""
_LOWERED = ("drive", "safety")
"""Commands whose answer says whether the board has lowered a value."""


@dataclass(frozen=True)
class Ended:
    """Why a run is over: a reason of the protocol, or of the host (interrupted, telemetry_lost, link_lost,
    other_rate, overrun, untrusted).

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


class Session(Conversation):
    """One host's conversation over a link; close it, whatever happened."""

    def __init__(self, link: BoardLink, codec: Codec) -> None:
        super().__init__(link, codec)
        self._dt = self._damping = self._late = 0.0

    # --- before a run ---

    def identify(self) -> dict[str, Any]:
        """The board's identity; it is idle then. Raises Refused for firmware that is not of this model, LinkLost,
        Untrusted."""
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
        if (found["max_phases"], found["max_rows"]) != (own["max_phases"], own["max_rows"]):
            raise Refused(
                f"the board says that it holds {found['max_phases']} phases and {found['max_rows']} control points; by "
                f"its protocol it is {own['max_phases']} and {own['max_rows']}: it is not what it says it is"
            )
        if self._names["states"][found["state"]] != "idle":
            self._rest()
        return found

    def upload(self, settings: Settings) -> None:
        """Everything that a run needs. Raises Refused, also by lower ceilings of the board; LinkLost, Untrusted."""
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
        self._statements.told(settings.drive["torque_limit"])
        checksum = 0
        for name, values in settings.messages(page["rows_a_message"]):
            if name in _TRAJECTORY:
                checksum = zlib.crc32(self.codec.payload(name, values), checksum)
            detail = self._command(name, values)
            if name in _LOWERED and detail:
                raise Refused(
                    f"the board keeps to a ceiling of its own below {self._value(name, detail - 1)} ({name}); its "
                    "firmware was built with tighter limits: build it anew (tendon firmware) and load it, or tighten "
                    "the model file"
                )
        self._command("commit", {"checksum": checksum})

    def counts(self) -> tuple[int, ...]:
        """(n,) what the encoders read now. Raises Refused, LinkLost, Untrusted."""
        self._telemetry.clear()
        self._ask(
            lambda: bool(self._telemetry),
            "the board answers, but no control period passes there: look at the timer behind tendon_board_period",
        )
        return tuple(self._telemetry.pop()["counts"])

    # --- a run ---

    def run(self, periods: int, every: int = 1, asked: Callable[[], int] = lambda: 0) -> BoardRun:
        """Arm and run for so many control periods, with telemetry in every so many; idle again afterwards.

        asked   whether the user wants to stop: 0 no, 1 yes, 2 without waiting for the board
        Raises Refused. A link that is lost ends the run, as does a board that says what cannot be or runs on after the
        last period, and what was recorded until then is returned.
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
            ended = self._begin(periods, log, asked) or self._follow(periods, log, asked)
        except Untrusted as lie:
            ended = Ended("untrusted", period=log.last, detail=str(lie))
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
        if self.lie is not None and (ended is None or ended.reason in _UNSAID):
            return Ended("untrusted", period=log.last, detail=self.lie)
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
        except NotReady:
            if self.link.now() > deadline:
                raise
            self._listen(_CHUNK)
            return False
        return True

    def _follow(self, periods: int, log: Log, asked: Callable[[], int]) -> Ended | None:
        """Until the board has stopped (None) or the host has to stop it. Raises LinkLost, Untrusted."""
        heard = self.link.now()
        end = heard + periods * self._dt * (1.0 + _RATE_TOLERANCE) + self._late + _END
        while not (self._stopped or log.over):
            if asked():
                return Ended("interrupted", period=log.last)
            self._stay_alive()
            self._listen(_CHUNK)
            self._believe()
            if self._telemetry:
                heard = self.link.now()
            log.take(self._telemetry)
            if not self._stopped and (log.beyond(periods) or self.link.now() > end):
                return Ended("overrun", period=log.last, detail=f"{periods} periods were planned")
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
            with suppress(LinkLost, Refused, Untrusted):
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
