"""HDF5, and MATLAB's files since version 7.3, which are HDF5 behind 512 bytes of their own."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.recordings.arrays import ArrayContents, Variable, is_numeric
from runtime.recordings.errors import Refusal
from runtime.recordings.extras import require
from runtime.recordings.settings import MOST_FIELDS

SIGNATURE = b"\x89HDF\r\n\x1a\n"
MATLAB = b"MATLAB 7.3"
_DAMAGED = (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError, MemoryError)
AFTER_OTHERS = 512
"""Where the signature stands in a file that begins with something of another program."""


def opened(path: Path, refuse: Refusal) -> ArrayContents:
    """The datasets of an HDF5 file; links to other files are not followed. Raises RecordingError."""
    require("h5py", "hdf5", "HDF5, and MATLAB since 7.3,", refuse)
    import h5py

    variables: list[Variable] = []
    with open(path, "rb") as begin:
        matlab = begin.read(len(MATLAB)) == MATLAB

    def visit(name: str, node: Any) -> bool | None:
        if isinstance(node, h5py.Dataset) and _is_plain(node) and not name.startswith("#"):
            shown = name.replace("/", ".") if matlab else name
            _add(variables, shown, node, partial(_load, path, name, None, refuse), path, name, refuse)
        return True if len(variables) > MOST_FIELDS else None

    with refuse.on(_DAMAGED, "the HDF5 file is damaged or cut off", "copy it again"), h5py.File(path, "r") as file:
        file.visititems(visit)
    return ArrayContents("MATLAB 7.3" if matlab else "HDF5", variables, refuse)


def _add(variables: list[Variable], shown: str, node: Any, load: Any, path: Path, name: str, refuse: Refusal) -> None:
    shape = tuple(int(n) for n in node.shape or ())
    if node.dtype.names:
        variables += [
            Variable(f"{shown}.{part}", shape, partial(_load, path, name, part, refuse))
            for part in node.dtype.names
            if is_numeric(node.dtype[part])
        ]
    elif is_numeric(node.dtype):
        variables.append(Variable(shown, shape, load))


def _is_plain(node: Any) -> bool:
    """Whether a dataset's numbers stand in this file and are no text."""
    return not node.is_virtual and not node.external and node.attrs.get("MATLAB_class") != b"char"


def _load(path: Path, name: str, part: str | None, refuse: Refusal) -> NDArray[Any]:
    import h5py

    with refuse.on(_DAMAGED, f"{name} is damaged or cut off", "copy the file again"), h5py.File(path, "r") as file:
        values = file[name][()]
    return np.asarray(values if part is None else values[part])
