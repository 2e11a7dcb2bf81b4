"""How large an MJCF file becomes when MuJoCo unfolds it: what stands in other files, and what is repeated."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from symbolic.model_file.exchange import xml_file
from symbolic.model_file.exchange.xml_file import XmlNode

MAX_UNFOLDED = 10_000
"""Elements with all their repetitions; MuJoCo takes a second for them, and squares it for more. The largest models of
robots that are published for it have a few thousand."""
MAX_NUMBERS = 100_000_000
"""Of a grid of heights or colours, of which nothing is read."""
REPEATED = ("replicate", "composite", "flexcomp")
"""Elements that stand for `count` times, in each of up to three directions, what is in them."""
GRIDS = {"hfield": ("nrow", "ncol"), "texture": ("width", "height")}
"""Elements that fill memory by numbers."""
INCLUDED, ATTACHED = "include", "attach"
OTHER_FILES = (INCLUDED, "model")
"""Elements whose `file` is MJCF that MuJoCo reads, too."""


def check_unfolded(root: XmlNode, path: Path) -> None:
    """Nothing in the file, nor in those that it names, becomes more than MAX_UNFOLDED elements.

    Raises ModelError, at the line where it does.
    """
    _Unfolding(path.parent, {path.resolve()}).add(root)


@dataclass
class _Unfolding:
    """The elements of a file and of what it includes, added up.

    seen: files that were read; largest: elements of the largest of the models that it may attach; attached: how often
    it attaches one, each taken to be the largest
    """

    folder: Path
    seen: set[Path]
    count: int = 0
    largest: int = 0
    attached: float = 0.0

    def add(self, root: XmlNode) -> None:
        """A file's own, and those of the files that it names."""
        todo = [(root, 1.0)]
        while todo:
            node, times = todo.pop()
            if node.tag in REPEATED:
                times *= math.prod(_counts(node, "count"))
            if math.prod(max(_counts(node, key)) for key in GRIDS.get(node.tag, ())) > MAX_NUMBERS:
                node.fail(f"<{node.tag}> has more numbers than a robot needs; make it smaller, or leave it out")
            self.count += round(min(times, 1.0 + MAX_UNFOLDED))
            if node.tag == ATTACHED:
                self.attached += min(times, 1.0 + MAX_UNFOLDED)
            if node.tag in OTHER_FILES and node.attributes.get("file"):
                self._other(node.tag, self.folder / node.attributes["file"])
            if self.count + self.attached * self.largest > MAX_UNFOLDED:
                node.fail(f"unfolds into more than {MAX_UNFOLDED:,} elements; expected the description of a robot")
            todo += [(child, times) for child in node.children]

    def _other(self, tag: str, path: Path) -> None:
        """With a file that is named; of one that is not there, or was there before, MuJoCo says so itself."""
        if not path.is_file() or path.resolve() in self.seen:
            return
        self.seen.add(path.resolve())
        root = xml_file.read(path)
        if tag == INCLUDED:
            self.add(root)
            return
        model = _Unfolding(self.folder, self.seen)
        model.add(root)
        size = model.count + round(model.attached * model.largest)
        self.count, self.largest = self.count + size, max(self.largest, size)


def _counts(node: XmlNode, key: str) -> list[float]:
    """The numbers of an attribute that are above 1; what is none, MuJoCo says itself."""
    found = [1.0]
    for word in node.attributes.get(key, "").split():
        try:
            found.append(max(1.0, float(word)))
        except ValueError:
            continue
    return found
