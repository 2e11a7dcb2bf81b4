"""A tape as C99 (float or double) or as CasADi's Python.

Printers only know how an operation is spelt; what is computed is settled in the tape.
"""

from __future__ import annotations

import keyword
import re
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from codegen.tape.tape import Node, Tape

_SUM, _PRODUCT, _SIGN, _ATOM = range(1, 5)
_INFIX = {"add": (" + ", _SUM), "sub": (" - ", _SUM), "mul": (" * ", _PRODUCT), "div": (" / ", _PRODUCT)}
_LONGEST = 90
"""An expression longer than this gets a name of its own, so that lines stay readable."""

Text = tuple[str, int]
"""An expression and how tightly its outermost operation binds."""


@dataclass(frozen=True)
class Language:
    """literal(number); call(op, arguments); pair(sine, cosine, angle): statement(s); assign(name, text)."""

    literal: Callable[[Fraction], str]
    call: Callable[[str, list[str]], str]
    pair: Callable[[str | None, str | None, str], list[str]]
    assign: Callable[[str, str], str]
    reserved: frozenset[str]


def float64(number: Fraction) -> str:
    """Shortest decimal that reads back as the nearest double."""
    return repr(number.numerator / number.denominator)


def float32(number: Fraction) -> str:
    """Shortest decimal that reads back as the nearest float, with its suffix."""
    nearest = struct.unpack("<f", struct.pack("<f", number.numerator / number.denominator))[0]
    for digits in range(1, 10):
        text = f"{nearest:.{digits}g}"
        if struct.unpack("<f", struct.pack("<f", float(text)))[0] == nearest:
            break
    return (text if "." in text or "e" in text else text + ".0") + "f"


_C_WORDS = frozenset(
    [
        *("auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern"),
        *("float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed"),
        *("sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while"),
        *("asm", "typeof", "NULL", "bool", "true", "false"),
    ]
)
_ARGUMENTS = frozenset(["count", "parameters", "s", "p", "x", "dt", "k", "out"])
"""What generated functions call their own arguments and their loop's index."""


def _c(kind: str) -> Language:
    suffix = {"double": "f64", "float": "f32"}[kind]

    def pair(sine: str | None, cosine: str | None, angle: str) -> list[str]:
        if cosine is None:
            return [f"const {kind} {sine} = tendon_sin_{suffix}({angle});"]
        if sine is None:
            return [f"const {kind} {cosine} = tendon_cos_{suffix}({angle});"]
        return [f"{kind} {sine};", f"{kind} {cosine};", f"tendon_sincos_{suffix}({angle}, &{sine}, &{cosine});"]

    return Language(
        literal=float64 if kind == "double" else float32,
        call=lambda op, arguments: f"tendon_{op}_{suffix}({', '.join(arguments)})",
        pair=pair,
        assign=lambda name, text: f"const {kind} {name} = {text};",
        reserved=_C_WORDS,
    )


def _casadi() -> Language:
    names = {"exp": "ca.exp", "log": "ca.log", "sqrt": "ca.sqrt", "abs": "ca.fabs", "atan2": "ca.atan2"}
    names |= {"max": "ca.fmax", "min": "ca.fmin", "sgn": "ca.sign", "pow": "_power", "step": "_step", "ramp": "_ramp"}
    names |= {"rise": "_rise"}

    def pair(sine: str | None, cosine: str | None, angle: str) -> list[str]:
        lines = [f"{sine} = ca.sin({angle})"] if sine else []
        return lines + ([f"{cosine} = ca.cos({angle})"] if cosine else [])

    return Language(
        literal=float64,
        call=lambda op, arguments: f"{names[op]}({', '.join(arguments)})",
        pair=pair,
        assign=lambda name, text: f"{name} = {text}",
        reserved=frozenset(keyword.kwlist) | {"ca"},
    )


C_DOUBLE, C_FLOAT, CASADI = _c("double"), _c("float"), _casadi()


class Printer:
    """Prints one tape.

    leaves   how each input is spelt
    taken    the names of the function's arguments, which nothing else may have
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
        """(statements, one expression an output)."""
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
            self.texts[i] = names[op], _ATOM
        return list(nodes.values())

    def _statement(self, i: int, text: Text) -> Text:
        """A name for what has one, is read more than once or is too long to stand inside another expression."""
        if self.tape.nodes[i].op in ("leaf", "const") or (self.uses[i] == 1 and i in self.tape.outputs):
            return text
        name = self.names.get(i)
        if name is None:
            if self.uses[i] == 1 and len(text[0]) <= _LONGEST:
                return text
            self.numbered += 1
            name = self._fresh(f"t{self.numbered}")
        self.lines.append(self.language.assign(name, text[0]))
        return name, _ATOM

    def _fresh(self, name: str) -> str:
        while name in self.taken:
            name += "_"
        self.taken.add(name)
        return name

    def _expression(self, node: Node) -> Text:
        if node.op == "leaf":
            return self.leaves[node.value], _ATOM
        if node.op == "const":
            text = self.language.literal(node.value)
            return text, _SUM if node.value < 0 else _ATOM
        parts = [self.texts[a] for a in node.args]
        if node.op in _INFIX:
            sign, level = _INFIX[node.op]
            left, right = _inside(parts[0], level), _inside(parts[1], level + 1)
            return f"{left}{sign}{right}", level
        if node.op == "neg":
            return "-" + _inside(parts[0], _ATOM), _SIGN
        return self.language.call(node.op, [text for text, _ in parts]), _ATOM


def _inside(text: Text, level: int) -> str:
    return text[0] if text[1] >= level else f"({text[0]})"


def identifier(name: str) -> bool:
    """Whether `name` can stand in C and in Python."""
    taken = _C_WORDS | _ARGUMENTS | set(keyword.kwlist)
    return re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) is not None and name not in taken
