"""What is said of a recording that cannot be used: one line with the file and, where it applies, the place in it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NoReturn


class RecordingError(ValueError):
    """A recording that cannot be used; the message is one line with the file and, where it applies, the place."""


def printable(text: object) -> str:
    """Text for a message: one line, nothing that a terminal would act on."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in os.fsdecode(str(text)))


@dataclass(frozen=True)
class Refusal:
    """Refuses a file. shown: its name as people read it."""

    shown: str

    def __call__(self, message: str, place: str = "") -> NoReturn:
        """Raises RecordingError. place: where in the file, such as "line 812"."""
        at = f" {printable(place)}" if place else ""
        raise RecordingError(f"{self.shown}{at}: {printable(message)}")

    @contextmanager
    def on(self, errors: tuple[type[Exception], ...], what: str, cure: str) -> Iterator[None]:
        """Refuses the file where reading it fails in one of these ways. what: what is wrong then; cure: what to do."""
        try:
            yield
        except RecordingError:
            raise
        except errors as error:
            reason = str(error).partition("\n")[0][:200] or type(error).__name__
            self(f"{what} ({reason}); {cure}")
