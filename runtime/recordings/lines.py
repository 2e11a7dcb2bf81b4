"""Lines of a text, plain or gzip, in blocks: never more of it in memory than a block, however long it is."""

from __future__ import annotations

import codecs
import gzip
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from runtime.recordings.errors import RecordingError, Refusal
from runtime.recordings.settings import BLOCK, HEAD, LONGEST_LINE, MAX_BYTES

GZIP = b"\x1f\x8b"
_MARK = codecs.BOM_UTF8
_WIDE = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True)
class TextBlock:
    """Whole lines, ended by "\\n" alone. line: the number of the first in the file, from 1."""

    text: str
    line: int


def check_file(path: Path, expected: str, refuse: Refusal) -> None:
    """Refuses what is no regular file: what is read several times, a pipe gives but once. Raises RecordingError."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        refuse(f"no such file; expected {expected}")
    except (OSError, ValueError) as error:
        refuse(f"cannot be read: {getattr(error, 'strerror', None) or error}")
    if stat.S_ISDIR(mode):
        refuse(f"is a directory; expected {expected}")
    if not stat.S_ISREG(mode):
        refuse("is no file but a pipe or a device; save it to a file first")


def blocks(path: Path, refuse: Refusal, size: int = BLOCK) -> Iterator[TextBlock]:
    """A text in blocks of some `size` bytes. Raises RecordingError."""
    with _read(path, refuse) as file:
        left, line, total = b"", 1, 0
        while data := file.read(size):
            if not total:
                _check_text(data, file, refuse)
                data = data.removeprefix(_MARK)
            total += len(data)
            if total > MAX_BYTES:
                refuse(f"is larger than {MAX_BYTES // 10**9} GB; split it into several recordings")
            data = _ends(left + data, file)
            end = data.rfind(b"\n") + 1
            left = data[end:]
            if len(left) > LONGEST_LINE:
                line += data.count(b"\n")
                what = "expected a sample, or the names of columns"
                refuse(f"is longer than {LONGEST_LINE} bytes; {what}", f"line {line}")
            if end:
                yield TextBlock(_decoded(data[:end], line, refuse), line)
                line += data.count(b"\n", 0, end)
        if left:
            yield TextBlock(_decoded(left, line, refuse), line)


def _ends(data: bytes, file: IO[bytes]) -> bytes:
    """Lines of any system, ended by "\\n" alone."""
    if b"\r" not in data:
        return data
    if data.endswith(b"\r"):  # the other half of a line's end may come next
        data += file.read(1)
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


@contextmanager
def _read(path: Path, refuse: Refusal) -> Iterator[IO[bytes]]:
    """The file's bytes, decompressed as they are read."""
    try:
        with open(path, "rb") as file:
            packed = file.read(len(GZIP)) == GZIP
            file.seek(0)
            if not packed:
                yield _in_utf_8(file)
                return
            with gzip.open(file) as unpacked:
                yield _in_utf_8(unpacked)  # type: ignore[arg-type]
    except RecordingError:
        raise
    except EOFError:
        refuse("the gzip file is cut off; copy it again")
    except (zlib.error, gzip.BadGzipFile) as error:
        refuse(f"the gzip file is damaged ({error}); copy it again")
    except (OSError, ValueError) as error:
        refuse(f"cannot be read: {getattr(error, 'strerror', None) or error}")


def _in_utf_8(file: IO[bytes]) -> IO[bytes]:
    """A text as Windows writes it for itself, in the encoding of all others."""
    wide = file.read(len(_WIDE[0])) in _WIDE
    file.seek(0)
    return codecs.EncodedFile(file, "utf-8", "utf-16") if wide else file


def _check_text(data: bytes, file: IO[bytes], refuse: Refusal) -> None:
    """Refuses what unpacks to something else than text before it is unpacked whole, however large it may become."""
    if isinstance(file, gzip.GzipFile) and b"\0" in data[:HEAD]:
        refuse("the gzip file holds no text; expected a recording in CSV, or another format without gzip")


def _decoded(data: bytes, line: int, refuse: Refusal) -> str:
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line += data.count(b"\n", 0, error.start)
        refuse(f"byte 0x{data[error.start]:02x} is not UTF-8; save the recording as UTF-8", f"line {line}")
