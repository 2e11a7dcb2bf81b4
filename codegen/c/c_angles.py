"""C99 of a function of one sample whose sines and cosines are taken together: as many angles at once as a vector holds.

An arm's angles are sums of its joints' alone, so that all are known before anything else is; one by one, their sines
and cosines take a third of the time of inverse dynamics. The bits are those of one angle after the other.
"""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp

from codegen.c.language import C_DOUBLE
from codegen.tape.printers import ATOM, Printer
from codegen.tape.tape import ARITHMETIC, Tape

_KNOWN = frozenset((*ARITHMETIC, "const", "leaf"))
_WIDEST = 8
"""Lanes of the widest vectors."""
_ARRAYS = {"sin": "sine", "cos": "cosine"}


class TogetherPrinter(Printer):
    """Prints a tape in double precision, its angles and their sines and cosines first."""

    def __init__(self, tape: Tape, leaves: Mapping[sp.Symbol, str], taken: frozenset[str]) -> None:
        self.known = _known(tape)
        places = _angles_first(tape, self.known)
        super().__init__(C_DOUBLE, _reordered(tape, places), leaves, taken | {"angle", *_ARRAYS.values()})
        self.known = [self.known[i] for i in places]

    def _pair(self, angle: int) -> list[int]:
        together = [a for a in self.angles if self.known[a]]
        if angle not in together or len(together) < 2:
            return super()._pair(angle)
        room = -(-len(together) // _WIDEST) * _WIDEST
        self.lines += [
            f"const double angle[{room}] = {{{', '.join(self.texts[a][0] for a in together)}}};",
            *(f"double {array}[{room}];" for array in _ARRAYS.values()),
            f"tendon_sincos_each_f64({len(together)}, angle, sine, cosine);",
        ]
        return [node for k, a in enumerate(together) for node in self._elements(a, k)]

    def _elements(self, angle: int, k: int) -> list[int]:
        """Sine and cosine of the k-th angle get their names."""
        nodes = self.angles[angle]
        for op, i in nodes.items():
            name = self.names.get(i) or self._fresh(f"{op}_{k + 1}")
            self.lines.append(self.language.assign(name, f"{_ARRAYS[op]}[{k}]"))
            self.texts[i] = name, ATOM
        return list(nodes.values())


def _known(tape: Tape) -> list[bool]:
    """Whether a node follows from inputs and parameters by arithmetic alone."""
    known: list[bool] = []
    for node in tape.nodes:
        known.append(node.op in _KNOWN and all(known[a] for a in node.args))
    return known


def _angles_first(tape: Tape, known: list[bool]) -> list[int]:
    """The nodes' order: what the known angles need, their sines and cosines, everything else."""
    first = {i for i, node in enumerate(tape.nodes) if node.op in _ARRAYS and known[node.args[0]]}
    needed = set(first)
    for i in range(len(tape.nodes) - 1, -1, -1):
        if i in needed:
            needed.update(tape.nodes[i].args)
    ahead, rest = sorted(needed - first), [i for i in range(len(tape.nodes)) if i not in needed]
    return [*ahead, *sorted(first), *rest]


def _reordered(tape: Tape, places: list[int]) -> Tape:
    at = {old: new for new, old in enumerate(places)}
    nodes = tuple(tape.nodes[i]._replace(args=tuple(at[a] for a in tape.nodes[i].args)) for i in places)
    return Tape(nodes, tuple(at[i] for i in tape.outputs), {at[i]: name for i, name in tape.names.items()})
