"""Sufficient statistics that a board has added up, as a file: the layout of its products, their sums and rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from json import JSONDecodeError, dumps, loads
from pathlib import Path
from typing import Any

import numpy as np

from runtime import files
from runtime.arrays import Array
from runtime.recordings.recording import RecordingError


@dataclass(frozen=True)
class BoardSums:
    """Products of columns and torque of every joint, added up over rows.

    layout   of controller.json: the columns of each joint, its torque the last     path   of the file, for messages
    sums     (P,) the joints' lower triangles, row by row     rows   (n,) that were added
    """

    path: Path
    arm: str
    layout: Mapping[str, Any]
    sums: Array
    rows: Array

    @classmethod
    def read(cls, path: Path) -> BoardSums:
        """From a file. Raises RecordingError."""
        wrong = f"{path}: expected the statistics of a board, as tendon execute --statistics writes them"
        try:
            page = loads(path.read_text(encoding="utf-8"))
            layout, sums, rows = page["board"], np.array(page["sums"], dtype=float), np.array(page["rows"], dtype=float)
            joints = [len(joint["lumps"]) + len(joint["effects"]) + 1 for joint in layout["joints"]]
            arm = str(page["arm"])
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror or error}") from error
        except (JSONDecodeError, UnicodeDecodeError, KeyError, TypeError, ValueError) as error:
            raise RecordingError(wrong) from error
        if sums.shape != (sum(k * (k + 1) // 2 for k in joints),) or rows.shape != (len(joints),):
            raise RecordingError(f"{wrong}; the number of sums is not that of its layout")
        if not (np.isfinite(sums).all() and np.isfinite(rows).all()):
            raise RecordingError(f"{wrong}; a sum is no finite number")
        return cls(path, arm, layout, sums, rows)

    def write(self) -> None:
        """Into its file. Raises OSError."""
        page = {"arm": self.arm, "board": self.layout, "rows": self.rows.tolist(), "sums": self.sums.tolist()}
        files.replace(self.path, (dumps(page, indent=1) + "\n").encode())

    @property
    def triangles(self) -> list[Array]:
        """(k + 1, k + 1) symmetric products of each joint's k columns and its torque."""
        found, begin = [], 0
        for joint in self.layout["joints"]:
            size = len(joint["lumps"]) + len(joint["effects"]) + 1
            gram = np.zeros((size, size))
            gram[np.tril_indices(size)] = self.sums[begin : begin + size * (size + 1) // 2]
            found.append(gram + np.tril(gram, -1).T)
            begin += size * (size + 1) // 2
        return found


def added(parts: Sequence[BoardSums]) -> BoardSums:
    """The sums of several files of one board. Raises RecordingError."""
    first = parts[0]
    for other in parts[1:]:
        if (other.arm, other.layout) != (first.arm, first.layout):
            raise RecordingError(f"{other.path}: of another arm or firmware than {first.path}; give files of one board")
    sums, rows = sum(p.sums for p in parts), sum(p.rows for p in parts)
    return BoardSums(first.path, first.arm, first.layout, np.asarray(sums), np.asarray(rows))
