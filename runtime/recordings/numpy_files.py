"""NumPy's .npy and .npz: arrays by name; nothing is unpickled."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from runtime.recordings.arrays import ArrayContents, Variable, is_numeric
from runtime.recordings.errors import Refusal
from runtime.recordings.settings import MAX_BYTES, MOST_FIELDS

NPY = b"\x93NUMPY"
ZIP = b"PK\x03\x04"
_DAMAGED = (ValueError, EOFError, KeyError, OSError, zipfile.BadZipFile, zlib.error, RuntimeError, MemoryError)
_ALONE = "column"
"""The name of the array in a file that holds one."""


def opened(path: Path, refuse: Refusal) -> ArrayContents:
    """The arrays of a .npy or .npz file. Raises RecordingError."""
    with refuse.on(_DAMAGED, "the NumPy file is damaged or cut off", "copy it again"), open(path, "rb") as file:
        alone = file.read(len(NPY)) == NPY
        file.seek(0)
        again = partial(_alone, path)
        variables = _variables(_ALONE, file, again, refuse) if alone else _of_archive(path, refuse)
    return ArrayContents("NumPy", variables, refuse)


def _of_archive(path: Path, refuse: Refusal) -> list[Variable]:
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        if any(m.filename.startswith("xl/") for m in members):
            refuse("is an Excel workbook; save the sheet as CSV")
        members = [m for m in members if m.filename.endswith(".npy")]
        if not members:
            refuse("is a ZIP archive without NumPy arrays; expected a recording, or unpack it first")
        if len(members) > MOST_FIELDS:
            refuse(f"has {len(members)} arrays; expected at most {MOST_FIELDS}")
        found = []
        for member in members:
            name = member.filename.removesuffix(".npy")
            with archive.open(member) as file:
                again = partial(_member, path, member.filename)
                found += _variables(name, file, again, refuse, member.file_size)
        return found


def _alone(path: Path) -> IO[bytes]:
    return open(path, "rb")


def _member(path: Path, name: str) -> IO[bytes]:
    with zipfile.ZipFile(path) as archive:
        return archive.open(name)


def _variables(
    name: str, file: IO[bytes], again: Callable[[], IO[bytes]], refuse: Refusal, length: int | None = None
) -> list[Variable]:
    """The numeric arrays behind a header. length: in bytes of what follows, as the archive states it."""
    version = npy.read_magic(file)
    read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read_header(file)
    size = int(np.prod([float(n) for n in shape])) * dtype.itemsize
    if size > MAX_BYTES or (length is not None and size > length):
        refuse(f"{name} states {shape} numbers; expected what the file holds, {MAX_BYTES // 10**9} GB at most")
    if dtype.names:
        return [
            Variable(f"{name}.{part}", tuple(shape), partial(_load, again, part, refuse))
            for part in dtype.names
            if is_numeric(dtype[part])
        ]
    return [Variable(name, tuple(shape), partial(_load, again, None, refuse))] if is_numeric(dtype) else []


def _load(again: Callable[[], IO[bytes]], part: str | None, refuse: Refusal) -> NDArray[Any]:
    with refuse.on(_DAMAGED, "the NumPy file is damaged or cut off", "copy it again"), again() as file:
        values = npy.read_array(file, allow_pickle=False)
    return np.asarray(values if part is None else values[part])
