"""The sums of a tape in another order, so that none waits longer than it must for its last term.

A recursion adds to what it has from the joint before. Added up from the left, each sum begins with what arrives last,
and a processor that can do four operations at once does one after another. Terms are joined in the order in which they
can be known, the earliest two first, as Huffman joins the rarest: as many operations, and the longest chain of them is
two thirds as long. Source: D. Huffman 1952; M. Golumbic, Combinatorial merging, 1976.
"""

from __future__ import annotations

import heapq

from codegen.tape.numbering import Node
from codegen.tape.tape import Tape

_SUM = ("add", "sub")
_WAIT = {"leaf": 0, "const": 0, "sin": 12, "cos": 12, "div": 4}
"""Operations' worth of time from the last argument to the value; those that are not listed: one."""

Term = tuple[int, int, int]
"""(when it is known, its place among the new nodes, its sign)."""


def balanced(tape: Tape) -> Tape:
    """The same outputs; what has a name keeps its terms."""
    return _Balancing(tape).tape()


class _Balancing:
    """New nodes as they are made."""

    def __init__(self, tape: Tape) -> None:
        self.old = tape
        self.nodes: list[Node] = []
        self.known: list[int] = []
        self.place: dict[int, int] = {}
        uses, read_by_sums = tape.uses(), {a for node in tape.nodes if node.op in _SUM for a in node.args}
        self.inner = [
            node.op in _SUM and uses[i] == 1 and i in read_by_sums and i not in tape.names
            for i, node in enumerate(tape.nodes)
        ]

    def tape(self) -> Tape:
        for i, node in enumerate(self.old.nodes):
            if self.inner[i]:
                continue
            if node.op in _SUM:
                self.place[i] = self._summed(self._terms(i, 1))
            else:
                self.place[i] = self._node(Node(node.op, tuple(map(self.place.__getitem__, node.args)), node.value))
        names = {self.place[i]: name for i, name in self.old.names.items()}
        return Tape(tuple(self.nodes), tuple(self.place[i] for i in self.old.outputs), names)

    def _node(self, node: Node) -> int:
        self.nodes.append(node)
        self.known.append(max(map(self.known.__getitem__, node.args), default=0) + _WAIT.get(node.op, 1))
        return len(self.nodes) - 1

    def _terms(self, i: int, sign: int) -> list[Term]:
        """What is added up at a node, through the sums inside it."""
        a, b = self.old.nodes[i].args
        other = sign if self.old.nodes[i].op == "add" else -sign
        found = []
        for arg, its in ((a, sign), (b, other)):
            if self.inner[arg]:
                found += self._terms(arg, its)
            else:
                place = self.place[arg]
                found.append((self.known[place], place, its))
        return found

    def _summed(self, terms: list[Term]) -> int:
        """The earliest two joined until one is left, which has the sign of the whole."""
        heapq.heapify(terms)
        while len(terms) > 1:
            (_, a, first), (_, b, second) = heapq.heappop(terms), heapq.heappop(terms)
            if first == second:
                place, sign = self._node(Node("add", (a, b))), first
            else:
                place, sign = self._node(Node("sub", (a, b) if first > 0 else (b, a))), 1
            heapq.heappush(terms, (self.known[place], place, sign))
        ((_, place, sign),) = terms
        assert sign > 0, "a sum that the tape has without a negation has a term without one"
        return place
