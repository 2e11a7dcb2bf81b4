"""Blocks of sufficient statistics that a board sends in parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from runtime.hardware.link import Values
from runtime.recordings.board_sums import BoardSums


@dataclass
class Blocks:
    """Parts of blocks by number and place; a block of which a part is lost is left out, with its rows.

    layout   of protocol.json; None where the board adds nothing up
    """

    layout: Mapping[str, Any] | None
    _parts: dict[int, dict[int, Values]] = field(default_factory=dict)

    def take(self, part: Values) -> None:
        """Adds a message `statistics`."""
        self._parts.setdefault(part["number"], {})[part["place"]] = part

    @property
    def complete(self) -> list[list[Values]]:
        """The parts of every block that is complete, in order."""
        if self.layout is None:
            return []
        return [
            [parts[place] for place in sorted(parts)]
            for parts in self._parts.values()
            if sum(len(part["high"]) for part in parts.values()) >= self.layout["products"]
        ]

    def sums(self, arm: str) -> BoardSums | None:
        """All complete blocks together; None without any."""
        blocks = self.complete
        if not blocks or self.layout is None:
            return None
        each = [np.concatenate([np.add(part["high"], part["low"]) for part in block]) for block in blocks]
        rows = np.sum([block[0]["rows"] for block in blocks], axis=0).astype(np.float64)
        sums = np.sum(each, axis=0)[: self.layout["products"]]
        return BoardSums(Path("board"), arm, self.layout, sums, rows)
