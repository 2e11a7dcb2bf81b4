"""A user's file on its way in: of a length that can be meant, and from something that answers."""

from __future__ import annotations

import os
import select
import stat
from pathlib import Path
from typing import BinaryIO, Final

from symbolic.model_file.checks import Place, printable

LONGEST_WAIT: Final = 10.0
"""s; a program that writes into a pipe has begun by then, or nobody is there; a choice."""

MAX_BYTES: Final = 1_000_000
"""length in bytes; of a model file or a scenario, of which the largest that ship have 5000; a choice."""


def opened(path: Path | str) -> BinaryIO:
    """A file, opened for reading; of a pipe or a device, once something can be read from it. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        kind = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(kind):
            raise IsADirectoryError(21, "is a directory", str(path))
        if not stat.S_ISREG(kind):
            waiting = select.poll()
            waiting.register(descriptor, select.POLLIN)
            if not waiting.poll(1e3 * LONGEST_WAIT):
                raise TimeoutError(110, f"nothing came out of it in {LONGEST_WAIT:g} s; expected a file", str(path))
            os.set_blocking(descriptor, True)
        return open(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_bytes(path: Path | str, most: int, expected: str) -> bytes:
    """The whole file, of `most` bytes. expected: what it should have been, for messages. Raises ModelError."""
    place = Place(printable(str(path)))
    try:
        with opened(path) as file:
            data = file.read(most + 1)
    except FileNotFoundError:
        place.fail(f"no such file; expected {expected}")
    except IsADirectoryError:
        place.fail(f"is a directory; expected {expected}")
    except (OSError, ValueError) as error:
        place.fail(f"cannot be read: {printable(getattr(error, 'strerror', None) or str(error))}")
    if len(data) > most:
        place.fail(f"is larger than {most // 1_000_000} MB; expected {expected}")
    return data


def read_text(path: Path | str, most: int, expected: str) -> str:
    """The same as text in UTF-8, with its own line ends. Raises ModelError."""
    data = read_bytes(path, most, expected)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        place = Place(f"{printable(str(path))} line {line}")
        place.fail(f"byte 0x{data[error.start]:02x} is not UTF-8; save the file as UTF-8")
