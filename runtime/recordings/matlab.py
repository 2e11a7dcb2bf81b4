"""MATLAB's .mat files of version 5 to 7.2, by SciPy: matrices, and structs as deep as they are nested."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from struct import error as StructError
from struct import unpack
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.recordings.arrays import ArrayContents, Variable, is_numeric
from runtime.recordings.errors import Refusal
from runtime.recordings.settings import MAX_BYTES, MOST_FIELDS

MAGIC = b"MATLAB 5.0"
_HEADER = 128
_COMPRESSED = 15
_DEEPEST = 8
_PIECE = 1 << 20


def opened(path: Path, refuse: Refusal) -> ArrayContents:
    """The numeric variables of a .mat file. Raises RecordingError."""
    from scipy.io import loadmat

    _check_lengths(path, refuse)
    # SciPy meets damaged files with whatever its parts raise.
    with refuse.on((Exception,), "the MATLAB file is damaged", "save it again"):
        variables = loadmat(path, struct_as_record=True, squeeze_me=False)
    found: list[Variable] = []
    for name, value in variables.items():
        if not name.startswith("__"):
            found += _within(name, value, _DEEPEST)
    if len(found) > MOST_FIELDS:
        refuse(f"has {len(found)} variables; expected at most {MOST_FIELDS}")
    return ArrayContents("MATLAB", found, refuse)


def _within(name: str, value: Any, depth: int) -> Iterator[Variable]:
    """The numeric arrays in a value, through structs and arrays of them."""
    if not isinstance(value, np.ndarray) or depth == 0:
        return
    if value.dtype.names:
        for k, entry in enumerate(value.flat):
            element = name if value.size == 1 else f"{name}({k + 1})"
            for part in value.dtype.names:
                yield from _within(f"{element}.{part}", entry[part], depth - 1)
    elif is_numeric(value.dtype):
        shape = tuple(n for n in value.shape if n != 1) or (1,)
        yield Variable(name, shape, _Kept(value.reshape(shape)))


class _Kept:
    """An array that is read already."""

    def __init__(self, values: NDArray[Any]) -> None:
        self.values = values

    def __call__(self) -> NDArray[Any]:
        return self.values


def _check_lengths(path: Path, refuse: Refusal) -> None:
    """Refuses a file whose elements are cut off, or unpack to more than can be kept, before anything is kept."""
    size, total = path.stat().st_size, 0
    damage = (StructError, zlib.error)
    with refuse.on(damage, "the MATLAB file is damaged or cut off", "copy it again"), open(path, "rb") as file:
        order = "<" if file.read(_HEADER)[-2:] == b"IM" else ">"
        while file.tell() < size:
            kind, length = unpack(f"{order}II", file.read(8))
            end = file.tell() + length
            if end > size:
                refuse("the MATLAB file is cut off; copy it again")
            total += _unpacked(file.read(length)) if kind == _COMPRESSED else length
            if total > MAX_BYTES:
                refuse(f"the MATLAB file unpacks to more than {MAX_BYTES // 10**9} GB; save what is needed of it")
            file.seek(end)


def _unpacked(data: bytes) -> int:
    """To how many bytes an element unpacks, counted up to the limit and not kept."""
    inflate, total, left = zlib.decompressobj(), 0, data
    while left and total <= MAX_BYTES:
        total += len(inflate.decompress(left, _PIECE))
        left = inflate.unconsumed_tail
    return total
