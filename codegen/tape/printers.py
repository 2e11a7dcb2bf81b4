"""Prints a tape in any language with names, infix arithmetic and functions. A Language only defines the spelling."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from codegen.tape.numbering import Node
from codegen.tape.tape import Tape

_SUM, _PRODUCT, _SIGN, ATOM = range(1, 5)
_INFIX = {"add": (" + ", _SUM), "sub": (" - ", _SUM), "mul": (" * ", _PRODUCT), "div": (" / ", _PRODUCT)}
_LONGEST = 90
"""A longer expression gets its own name, so that lines stay readable."""

Text = tuple[str, int]
"""An expression and the precedence of its outermost operation."""


@dataclass(frozen=True)
class Language:
    """The spelling of a tape's operations, except + - * / and names, which are the same in all languages.

    literal    a number
    call       an operation on its arguments: "exp", "log", "sqrt", "abs", "pow", "atan2", "max", "min";
               "rise" (x): 1 - exp(-x); "sgn" (x): -1, 0 or 1; and, where switches are not lowered to surrogates,
               "step" (x): 1 for x > 0, else 0; "ramp" (x): x for x > 0, else 0; "gate" (x, a): a for x > 0, else 0;
               "side" (x, a, b): a for x > 0, b for x < 0, else 0
    pair       statements that assign sine and cosine of an angle to these names; None for one that is not needed
    assign     the statement that assigns a text to a name
    reserved   words that cannot be names
    """

    literal: Callable[[Fraction], str]
    call: Callable[[str, list[str]], str]
    pair: Callable[[str | None, str | None, str], list[str]]
    assign: Callable[[str, str], str]
    reserved: frozenset[str]


def float64(number: Fraction) -> str:
    """Shortest decimal that reads back as the nearest double."""
    return repr(number.numerator / number.denominator)


class Printer:
    """Prints one tape.

    leaves   spelling of each input
    taken    names of the function's arguments, which nothing else may have
    """

    def __init__(self, language: Language, tape: Tape, leaves: Mapping[sp.Symbol, str], taken: frozenset[str]) -> None:
        self.language, self.tape, self.leaves = language, tape, leaves
        self.taken = set(language.reserved) | set(taken)
        self.uses = tape.uses()
        self.texts: list[Text] = []
        self.lines: list[str] = []
        self.angles: dict[int, dict[str, int]] = {}
        for i, node in enumerate(tape.nodes):
            if node.op in ("sin", "cos"):
                self.angles.setdefault(node.args[0], {})[node.op] = i
        self.names = {i: self._fresh(name) for i, name in sorted(tape.names.items())}
        self.numbered = 0

    def print(self) -> tuple[list[str], list[str]]:
        """(statements, one expression per output)."""
        self.texts = [("", 0)] * len(self.tape.nodes)
        done: set[int] = set()
        for i, node in enumerate(self.tape.nodes):
            if i in done:
                continue
            if node.op in ("sin", "cos"):
                done.update(self._pair(node.args[0]))
            else:
                self.texts[i] = self._statement(i, self._expression(node))
        return self.lines, [self.texts[i][0] for i in self.tape.outputs]

    def _pair(self, angle: int) -> list[int]:
        """Sine and cosine of one angle together."""
        number = len([i for i in self.angles if i < angle]) + 1
        nodes = self.angles[angle]
        names = {op: self.names.get(i) or self._fresh(f"{op}_{number}") for op, i in nodes.items()}
        self.lines += self.language.pair(names.get("sin"), names.get("cos"), self.texts[angle][0])
        for op, i in nodes.items():
            self.texts[i] = names[op], ATOM
        return list(nodes.values())

    def _statement(self, i: int, text: Text) -> Text:
        """Assigns a value to a name if it has one, is read more than once or is too long for another expression."""
        if self.tape.nodes[i].op in ("leaf", "const") or (self.uses[i] == 1 and i in self.tape.outputs):
            return text
        name = self.names.get(i)
        if name is None:
            if self.uses[i] == 1 and len(text[0]) <= _LONGEST:
                return text
            self.numbered += 1
            name = self._fresh(f"t{self.numbered}")
        self.lines.append(self.language.assign(name, text[0]))
        return name, ATOM

    def _fresh(self, name: str) -> str:
        while name in self.taken:
            name += "_"
        self.taken.add(name)
        return name

    def _expression(self, node: Node) -> Text:
        if node.op == "leaf":
            return self.leaves[node.value], ATOM
        if node.op == "const":
            text = self.language.literal(node.value)
            return text, _SUM if node.value < 0 else ATOM
        parts = [self.texts[a] for a in node.args]
        if node.op in _INFIX:
            sign, level = _INFIX[node.op]
            left, right = _inside(parts[0], level), _inside(parts[1], level + 1)
            return f"{left}{sign}{right}", level
        if node.op == "neg":
            return "-" + _inside(parts[0], ATOM), _SIGN
        return self.language.call(node.op, [text for text, _ in parts]), ATOM


def _inside(text: Text, level: int) -> str:
    return text[0] if text[1] >= level else f"({text[0]})"
