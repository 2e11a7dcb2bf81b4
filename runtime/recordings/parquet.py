"""Parquet: a column for each signal, or a list of the joints' values in each row; LeRobot's data sets among them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.recordings.arrays import ArrayContents, Variable
from runtime.recordings.errors import Refusal
from runtime.recordings.extras import require
from runtime.recordings.settings import LARGEST_MATRIX, MOST_FIELDS

MAGIC = b"PAR1"
_LEROBOT = frozenset(("observation.state", "episode_index", "frame_index"))
_TORQUE = re.compile(r"torque|effort|current|tau", re.IGNORECASE)


def opened(path: Path, refuse: Refusal) -> ArrayContents:
    """The columns of a Parquet file. Raises RecordingError."""
    require("pyarrow", "parquet", "Parquet", refuse)
    from pyarrow import ArrowException, parquet

    damage = (ArrowException, OSError, ValueError, MemoryError)
    with (
        refuse.on(damage, "the Parquet file is damaged or cut off", "copy it again"),
        parquet.ParquetFile(path) as file,
    ):
        schema, rows = file.schema_arrow, file.metadata.num_rows
        refuse_without_torque(schema.names, refuse)
        if len(schema) > MOST_FIELDS:
            refuse(f"has {len(schema)} columns; expected at most {MOST_FIELDS}")
        widths = [_width(file, entry) for entry in schema]
    variables = [
        Variable(name, (rows,) if width is None else (rows, width), partial(_load, path, name, refuse))
        for name, width in zip(schema.names, widths, strict=True)
        if width != 0
    ]
    return ArrayContents("Parquet", variables, refuse)


def refuse_without_torque(names: Sequence[str], refuse: Refusal) -> None:
    """Refuses a data set for learning to imitate that holds no torque."""
    if set(names) >= _LEROBOT and not any(_TORQUE.search(name) for name in names):
        refuse(
            "is a LeRobot data set: it has positions (observation.state) and actions, but neither torque nor current, "
            "without which no model can be compared; record the motors' torque or current as well"
        )


def _width(file: Any, entry: Any) -> int | None:
    """None for a column of numbers, else how many each row lists; 0 for what holds no numbers."""
    from pyarrow import types

    kind = entry.type
    if types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_temporal(kind):
        return None
    if types.is_fixed_size_list(kind) and types.is_floating(kind.value_type):
        return int(kind.list_size)
    if types.is_list(kind) and types.is_floating(kind.value_type):
        first = next(file.iter_batches(batch_size=1, columns=[entry.name]), None)
        size = 0 if first is None or not len(first) else len(first.column(0)[0] or ())
        return size if size <= LARGEST_MATRIX else 0
    return 0


def _load(path: Path, name: str, refuse: Refusal) -> NDArray[Any]:
    from pyarrow import ArrowException, parquet, types

    damage = (ArrowException, OSError, ValueError, MemoryError)
    with refuse.on(damage, f"{name} is damaged, or not as long in each row", "write the file again"):
        column = parquet.read_table(path, columns=[name]).column(0).combine_chunks()
        if types.is_fixed_size_list(column.type) or types.is_list(column.type):
            values = column.flatten().to_numpy(zero_copy_only=False)
            return np.asarray(values).reshape(len(column), -1)
        return np.asarray(column.to_numpy(zero_copy_only=False))
