"""Values that only count: the recursion run on them says how many operations it takes, much faster than on SymPy.

Equal operations are one, signs travel with the value, numbers fold: what a tape of code generation does, too.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from symbolic.straightline import Count

_Node = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class CountedValue:
    """± a node of a OperationCounter."""

    counter: OperationCounter
    sign: int
    node: int

    def __neg__(self) -> CountedValue:
        return CountedValue(self.counter, -self.sign, self.node)

    def __add__(self, other: Any) -> Any:
        counter = self.counter
        if not isinstance(other, CountedValue):
            return self if other == 0 else counter.make("shift", other * self.sign, self.node, self.sign)
        if self.node == other.node:
            return 0 if self.sign != other.sign else self * 2
        if self.sign == other.sign:
            return counter.make("add", min(self.node, other.node), max(self.node, other.node), self.sign)
        above, below = (self.node, other.node) if self.sign > 0 else (other.node, self.node)
        if ("sub", below, above) in counter.known:
            return counter.make("sub", below, above, -1)
        return counter.make("sub", above, below, 1)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, CountedValue):
            return self.counter.make(
                "mul", min(self.node, other.node), max(self.node, other.node), self.sign * other.sign
            )
        if other == 0:
            return 0
        if abs(other) == 1:
            return self if other > 0 else -self
        return self.counter.make("scale", abs(other), self.node, self.sign if other > 0 else -self.sign)

    __rmul__ = __mul__


class OperationCounter:
    """Notes over counted values."""

    def __init__(self) -> None:
        self.known: dict[_Node, int] = {}

    def leaf(self, name: str) -> CountedValue:
        """An input."""
        return self.make("leaf", name, None, 1)

    def make(self, operation: str, a: Any, b: Any, sign: int) -> CountedValue:
        """The value of an operation on a and b: one that is there already costs nothing."""
        key = (operation, a, b)
        node = self.known.get(key)
        if node is None:
            node = self.known[key] = len(self.known)
        return CountedValue(self, sign, node)

    def let(self, name: str, value: Any) -> Any:  # noqa: ARG002
        """The value itself: names cost nothing."""
        return value

    def sincos(self, angle: Any) -> tuple[Any, Any]:
        """Cosine and sine; of an angle that is no input, 1 and 0."""
        if not isinstance(angle, CountedValue):
            return 1, 0
        return self.make("cos", angle.node, None, 1), self.make("sin", angle.node, None, angle.sign)

    def count(self, outputs: Iterable[Any]) -> Count:
        """What the outputs take."""
        nodes = list(self.known)
        todo = [o.node for o in outputs if isinstance(o, CountedValue)]
        live: set[int] = set()
        while todo:
            i = todo.pop()
            if i not in live:
                live.add(i)
                todo += _arguments(nodes[i])
        kinds = [nodes[i] for i in live]
        angles = {a for operation, a, _ in kinds if operation in ("sin", "cos")}
        return Count(sum(operation not in ("leaf", "sin", "cos") for operation, _, _ in kinds), len(angles))


def _arguments(node: _Node) -> tuple[int, ...]:
    operation, a, b = node
    if operation == "leaf":
        return ()
    return {"sin": (a,), "cos": (a,), "shift": (b,), "scale": (b,)}.get(operation, (a, b))
