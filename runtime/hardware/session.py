"""A run on a board: identify it, upload settings and trajectory, run, and record the telemetry without gaps."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.hardware.conversation import Conversation, NotReady, Refused, Untrusted
from runtime.hardware.link import DELIMITER, BoardLink, Codec, LinkLost, Values
from runtime.hardware.settings import Settings

_BLOCK = 4096
_LOOK_AFTER, _RATE_TOLERANCE = 0.1, 0.05
"""Time in s after which the board's control period is compared with the nominal one, and the part it may differ."""
_MICROSECONDS = 1e6
_TYPES = {"u8": "<u1", "u16": "<u2", "u32": "<u4", "i32": "<i4", "float": "<f4"}


class Log:
    """The telemetry of a run up to the first gap.

    last   period of the last record; None before the first
    gap    what is missing at the first gap, after which nothing is added; None: no gap
    over   whether the board has reported the end of the run
    The last record is that of the step that stopped the arm, whatever its period; the step after a complete run is not
    recorded.
    """

    def __init__(self, every: int, codec: Codec) -> None:
        self.every = every
        self.last: int | None = None
        message = next(item for item in codec.document["messages"] if item["name"] == "telemetry")
        self._type = np.dtype([(f["name"], _TYPES[f["type"]], f["count"] or ()) for f in message["fields"]])
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
        """(N,) records with the fields of the message."""
        return np.concatenate([*self._whole, np.array(self._recent, dtype=self._type)])

    def take(self, rows: list[Values]) -> None:
        """Adds `rows` and clears them."""
        for row in rows:
            if self.gap is None and not self.over:
                self._add(row)
        rows.clear()

    def missing(self, periods: int) -> str | None:
        """What is missing of the telemetry of a run of so many periods; None if it is complete."""
        if self.gap is None and self._expected < periods:
            return f"the telemetry from period {self._expected} on is missing"
        return self.gap

    def beyond(self, periods: int) -> bool:
        """Whether the board reports a period after the last one of the run."""
        return self._running >= periods

    def wrong_rate(self, dt: float, late: float) -> str | None:
        """The difference of the board's control period from dt, if it is too large. late: allowed delay of one, s."""
        if self._begun is None or self.last is None or self.last == self._begun:
            return None
        periods, seconds = self.last - self._begun, self._elapsed / _MICROSECONDS
        nominal = dt * periods
        if max(nominal, seconds) < _LOOK_AFTER or abs(seconds - nominal) <= _RATE_TOLERANCE * nominal + late:
            return None
        return (
            f"its control periods take {1e3 * seconds / periods:.3g} ms; the model file says {1e3 * dt:.3g} ms; "
            "set its timer to the rate in [controller], or that rate to the timer's"
        )

    def _add(self, row: Values) -> None:
        if self._states[row["state"]] == "running":
            self._running = max(self._running, row["period"])
        if row["period"] > self._expected:
            self.gap = f"the telemetry of period {self._expected} is missing before that of {row['period']}"
        elif self._states[row["state"]] == "running":
            if row["period"] == self._expected:
                self._append(row)
                self._expected += self.every
        else:
            self.over = True
            if self._reasons[row["reason"]] != "done":
                self._append(row)

    def _append(self, row: Values) -> None:
        self.last = row["period"]
        if self._begun is None:
            self._begun = row["period"]
        else:
            # The board's clock wraps at 2^32 µs.
            self._elapsed += (row["time_us"] - self._stamp) & 0xFFFFFFFF
        self._stamp = row["time_us"]
        self._recent.append(tuple(row.values()))
        # Arrays take a tenth of the memory of tuples.
        if len(self._recent) >= _BLOCK:
            self._whole.append(np.array(self._recent, dtype=self._type))
            self._recent.clear()


_GREETINGS = 30
"""How often `hello` is sent: some boards restart when their port is opened."""
_CHUNK = 0.002
"""Timeout in s of one read during a run, so that faults are answered within a few ms."""
_SILENT = 0.3
"""Time in s without telemetry after which the board counts as lost."""
_READY = 10.0
"""Time in s until the drives must be ready."""
_END = 1.0
"""Time in s for a stop, besides the damping."""
_PATIENCE = 5.0
"""Time in s for stopping a motion that another host has left."""
_TRAJECTORY = ("trajectory", "phase", "points")
_UNSAID = ("done", "link_lost", "telemetry_lost")
"""Reasons that an impossible report of the board explains better."""
_LOWERED = ("drive", "safety")
"""Commands whose answer states whether the board lowered a value."""


@dataclass(frozen=True)
class Ended:
    """Why a run ended: a reason of the protocol, or of the host (interrupted, telemetry_lost, link_lost, other_rate,
    overrun, untrusted).

    joint    1-based; None for the whole arm      period   of the run in which it happened
    detail   the host's explanation; None if the reason suffices
    code     of a drive's fault
    """

    reason: str
    joint: int | None = None
    period: int | None = None
    detail: str | None = None
    code: int = 0


@dataclass(frozen=True)
class BoardRun:
    """A run's telemetry without gaps, (N,) records with the fields of the message, and how it ended."""

    rows: NDArray[Any]
    ended: Ended


class Session(Conversation):
    """The conversation with a board over a link; always close it."""

    def __init__(self, link: BoardLink, codec: Codec) -> None:
        super().__init__(link, codec)
        self._dt = self._damping = self._late = 0.0

    # --- before a run ---

    def identify(self) -> Values:
        """Checks that the board runs the firmware of this model, and leaves it idle; its identity.

        Raises Refused, LinkLost, Untrusted.
        """
        # Ends a frame that was cut off before.
        self.link.write(DELIMITER)
        found, own = self._hello(_GREETINGS), self.codec.document
        if found["version"] != own["version"]:
            raise Refused(
                f"the board uses version {found['version']} of the protocol, this host version {own['version']}; "
                "rebuild its firmware (tendon firmware) and load it"
            )
        if (found["fingerprint"], found["joints"]) != (own["fingerprint"], own["joints"]):
            raise Refused(
                f"the board's firmware is of another arm or another version ({found['joints']} joints, fingerprint "
                f"{found['fingerprint']:08x}; expected {own['joints']}, {own['fingerprint']:08x}); "
                "rebuild it (tendon firmware) and load it"
            )
        if found["build"] != own["build"]:
            raise Refused(
                "the board's firmware was generated from other equations or by another version of Tendon (build "
                f"{found['build']:08x}; expected {own['build']:08x}); rebuild it (tendon firmware) and load it"
            )
        if self._names["states"][found["state"]] != "idle":
            self._rest()
        return found

    def upload(self, settings: Settings) -> None:
        """Uploads all that a run needs. Raises Refused, also for lower ceilings of the board; LinkLost, Untrusted."""
        page = self.codec.document
        self._check_room(len(settings.phases), len(settings.points))
        self._dt = settings.dt
        self._silence = settings.safety["silence"] * settings.dt
        self._damping = settings.safety["damping"] * settings.dt
        self._late = settings.safety["late"] / _MICROSECONDS
        self._statements.limit(settings.drive["torque_limit"])
        checksum = 0
        for name, values in settings.messages(page["rows_a_message"]):
            if name in _TRAJECTORY:
                checksum = zlib.crc32(self.codec.payload(name, values), checksum)
            detail = self._command(name, values)
            if name in _LOWERED and detail:
                raise Refused(
                    f"the board has a lower ceiling for {self._value(name, detail - 1)} ({name}); its firmware was "
                    "built with tighter limits: rebuild it (tendon firmware) and load it, or tighten the model file"
                )
        self._command("commit", {"checksum": checksum})

    def _check_room(self, phases: int, rows: int) -> None:
        """Raises Refused if the board cannot hold a trajectory; nothing is sent in pieces while it moves."""
        assert self._identity is not None
        room = self._identity.values
        if phases > room["max_phases"] or rows > room["max_rows"]:
            size = 4 * self.codec.document["joints"] * rows / 1024
            raise Refused(
                f"the trajectory has {phases} phases with {rows} control points; the board has room for "
                f"{room['max_phases']} and {room['max_rows']}; play a shorter motion, or build its firmware with room "
                f"for this one (make MACROS='-DTENDON_MAX_PHASES={phases}U -DTENDON_MAX_ROWS={rows}U'), which takes "
                f"{size:.0f} KB of its memory"
            )

    def counts(self) -> tuple[int, ...]:
        """Encoder counts (n,) now. Raises Refused, LinkLost, Untrusted."""
        self._telemetry.clear()
        self._ask(
            lambda: bool(self._telemetry),
            "the board answers, but its control period does not run; check the timer that calls tendon_board_period",
        )
        return tuple(self._telemetry.pop()["counts"])

    # --- a run ---

    def run(self, periods: int, every: int = 1, asked: Callable[[], int] = lambda: 0) -> BoardRun:
        """Arms and runs the board for `periods` control periods, with telemetry in every `every`-th; idle afterwards.

        asked   whether the user wants to stop: 0 no, 1 yes, 2 without waiting for the board
        A lost link, an impossible report and a board that runs on end the run; what was recorded is returned.
        Raises Refused.
        """
        log = Log(every, self.codec)
        if asked():
            return BoardRun(log.rows(), Ended("interrupted"))
        self._telemetry.clear()
        self._state = None
        try:
            ended = self._driven(periods, log, asked)
        except BaseException:
            # Whatever happened here, the arm must stop.
            with suppress(LinkLost):
                self._stop()
            raise
        with suppress(LinkLost, Refused, Untrusted):
            self._gather()
        return BoardRun(log.rows(), ended)

    def _gather(self) -> None:
        """Asks for the statistics that are left on the board, where it adds up any; it is idle, and stays so."""
        if self.blocks.layout is None:
            return
        before = len(self.blocks.complete)
        self._command("query")
        deadline = self.link.now() + _END
        while len(self.blocks.complete) == before and self.link.now() < deadline:
            self._listen(_CHUNK)

    def _driven(self, periods: int, log: Log, asked: Callable[[], int]) -> Ended:
        reported: Ended | None = None
        try:
            ended = self._begin(periods, log, asked) or self._follow(periods, log, asked)
        except Untrusted as error:
            ended = Ended("untrusted", period=log.last, detail=str(error))
        except LinkLost as lost:
            log.take(self._telemetry)
            ended = Ended("link_lost", period=log.last, detail=str(lost))
        except Refused:
            with suppress(LinkLost):
                self._leave(log, asked)
            raise
        # A board that cannot be heard may still hear.
        with suppress(LinkLost):
            reported = self._leave(log, asked)
        ended = ended or reported
        if self.impossible is not None and (ended is None or ended.reason in _UNSAID):
            return Ended("untrusted", period=log.last, detail=self.impossible)
        if ended is None:
            return Ended("link_lost", period=log.last, detail="the board does not report its stop")
        if ended.reason == "done" and (missing := log.missing(periods)) is not None:
            return Ended("telemetry_lost", period=log.last, detail=missing)
        return ended

    def _begin(self, periods: int, log: Log, asked: Callable[[], int]) -> Ended | None:
        """Switches the drives on and starts the run when they are ready (None), or ends because the user wants to stop.

        Raises LinkLost, and Refused unless the board has stopped by itself meanwhile.
        """
        deadline = self.link.now() + _READY
        try:
            self._command("arm")
            while True:
                try:
                    self._command("run", {"periods": periods, "every": log.every})
                    return None
                except NotReady:
                    if self.link.now() > deadline:
                        raise
                self._listen(_CHUNK)
                if asked():
                    return Ended("interrupted")
        except Refused:
            self._state = None
            self._ask(lambda: self._state is not None, "the board does not report its state")
            if not self._stopped:
                raise
            return None

    def _follow(self, periods: int, log: Log, asked: Callable[[], int]) -> Ended | None:
        """Records until the board has stopped (None) or the host must stop it. Raises LinkLost, Untrusted."""
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
            # If this computer runs the control steps, it measures its own delays.
            if self.link.late is None and (wrong := log.wrong_rate(self._dt, self._late)) is not None:
                return Ended("other_rate", period=log.last, detail=wrong)
            if (silent := self.link.now() - heard) > _SILENT + 2 * log.every * self._dt:
                return Ended("link_lost", period=log.last, detail=f"nothing from the board for {silent:.2g} s")
        return None

    def _leave(self, log: Log, asked: Callable[[], int]) -> Ended | None:
        """Stops the board, waits until its drives are off, and resets it; its reported end, or None."""
        damped = self.link.now() + self._damping
        if not self._stopped:
            # Forgets the state from before the stop.
            self._state = None
            if not log.over:
                self._stop()
        said, ended = self.link.now(), self._board_ended()
        while not self._resting and self.link.now() < damped + _END and asked() < 2:
            # Commands and answers may be lost.
            now = self.link.now()
            if now >= (said + _CHUNK if self._unheard else self._due):
                said = now
                self._say("alive" if self._stopped and now < damped else "query")
            self._listen(_CHUNK)
            log.take(self._telemetry)
            ended = ended or self._board_ended()
        if self._resting:
            # The board has stopped, even if it no longer hears this. `hello` restarts the numbers of the commands,
            # because the last ones may be lost.
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
            detail = detail or "a drive that was ready is not any more"
        return Ended(reason, state["joint"] or None, state["period"], detail=detail, code=state["code"])

    @property
    def _stopped(self) -> bool:
        return self._state is not None and self._names["states"][self._state["state"]] == "stopped"

    @property
    def _resting(self) -> bool:
        if self._state is None or self._state["enabled"]:
            return False
        return self._names["states"][self._state["state"]] in ("idle", "stopped")

    def _rest(self) -> None:
        """Brings the board to idle from the state in which another host left it."""
        assert self._identity is not None
        if self._names["states"][self._identity.values["state"]] != "stopped":
            self._command("stop")
        self._state = None
        deadline = self.link.now() + _PATIENCE
        while not self._resting:
            if self.link.now() > deadline:
                raise LinkLost("the board does not report that its drives are off")
            self._command("query")
            self._listen(_CHUNK)
        self._command("reset")
