"""How C99 spells a tape, in double and in float, and what can be a name in it."""

from __future__ import annotations

import keyword
import re
import struct
from fractions import Fraction

from codegen.tape.printers import Language, float64


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
_ARGUMENTS = frozenset(["count", "parameters", "s", "p", "dt", "k", "out"])
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


C_DOUBLE, C_FLOAT = _c("double"), _c("float")


def word(name: str) -> bool:
    """Whether `name` is one in C and in Python, of an argument for example."""
    return re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) is not None and name not in _C_WORDS | set(keyword.kwlist)


def identifier(name: str) -> bool:
    """Whether `name` can stand in C and in Python beside the arguments of generated functions."""
    return word(name) and name not in _ARGUMENTS
