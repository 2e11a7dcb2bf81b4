"""The line to a board: bytes there and back, and its own clock."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol


class LinkError(RuntimeError):
    """The line cannot be opened; the message says what to do."""


class LinkLost(RuntimeError):
    """The line that was there is gone; the message says how."""


class BoardLink(Protocol):
    """Both directions of a line. All may raise LinkLost.

    A link has a time of its own, so that a simulated board is waited for in its time and not in that of a busy
    machine: every deadline is kept by `now`.

    baud    bits per second of a serial line; None where there is no such bound
    late    s between two control steps at most where this end keeps the time; None: as a board's timer does
    fault   words for what has failed where this end of the link drives the arm itself; None: nothing, or the board does
    """

    baud: int | None
    late: float | None
    fault: str | None

    def write(self, data: bytes) -> None:
        """Send these bytes; waits no longer than the line takes."""

    def read(self, timeout: float) -> bytes:
        """What has come, at once if something has; b"" if nothing comes within `timeout` s of this link's time."""

    def now(self) -> float:
        """s, from any beginning; grows in `read`."""

    def figures(self) -> Mapping[str, Any]:
        """What became of it, for --json."""

    def close(self) -> None:
        """Give the line back; may be called twice."""
