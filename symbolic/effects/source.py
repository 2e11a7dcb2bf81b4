"""An effect written as the Python file that declares it, which `load_user_effects` reads back."""

from __future__ import annotations

import json
import keyword
import re
import textwrap
from collections.abc import Collection, Sequence
from dataclasses import MISSING, fields
from math import inf
from typing import Any

import sympy as sp
from sympy.printing.str import StrPrinter

from symbolic import units as u
from symbolic.effects.declaration import DT, SIGNAL, Effect, Grid, LinearForm, Parameter, State
from symbolic.elements import Element
from symbolic.primitives import WIDTHS, ramp, sgn, step

BANNER = "# A guess by tendon diagnose --draft: no law from the literature."
"""The first line of a file with a guess; a file without it belongs to the user and is never overwritten."""

_WIDTH = 120
_INDENT = " " * 4
_UNITS = {unit: name for name, unit in vars(u).items() if isinstance(unit, u.Unit)}
_BASE = {unit.powers[0][0]: name for unit, name in _UNITS.items() if [p for _, p in unit.powers] == [1]}
_IMPORTS = (
    ("math", ("inf",)),
    ("pathlib", ("Path",)),
    ("", ("sp",)),
    ("tendon.effects", ("u",)),
    (
        "tendon.effects",
        (
            *("DT", "SIGNAL", "Effect", "Grid", "LinearForm", "Parameter", "State"),
            *(sorted(w.name.upper() for w in WIDTHS)),
            *("absolute", "elements", "load_user_effects", "parameter", "ramp", "sgn", "state", "step"),
        ),
    ),
)
_KINDS = {"p": "parameter", "x": "state"}
_LINES = {"sp": "import sympy as sp", "u": "from tendon.effects import units as u"}


def python_source(effect: Effect, notes: Sequence[str] = (), beside: str | None = None) -> str:
    """A file for --effects that declares the effect.

    notes    paragraphs of the comment at the top
    beside   a file of effects, relative to this file's folder, whose effects are included
    """
    comment = [BANNER]
    for note in notes:
        plain = "".join(c if c.isprintable() else " " for c in note)
        comment += textwrap.wrap(plain, _WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False)
    symbols = {s.name: f'SIGNAL["{s.name}"].symbol' for s in effect.signals}
    variables = _variables(effect)
    symbols |= {name: f'{kind}("{name}")' for name, kind in variables.items()}
    scope = [f"{name} = {origin}" for name, origin in symbols.items()]
    taken = () if beside is None else (f"{_INDENT}*load_user_effects(Path(__file__).parent / {_text(beside)}),",)
    body = ["EFFECTS = (", *taken, f"{_INDENT}{_value(effect, 1, variables)},", ")"]
    whole = "\n".join([*scope, *([""] if scope else []), *body])
    return "\n".join([*comment, "", *_imports(whole), "", whole, ""])


def _variables(effect: Effect) -> dict[str, str]:
    """Parameters, coefficients and states that become variables of the same name, and the functions that make them."""
    names = {p.name: "parameter" for p in (*effect.parameters, *effect.coefficients)}
    names |= {s.name: "state" for s in effect.states if s.name not in names}
    imported = {name for _, found in _IMPORTS for name in found} | set(SIGNAL) | {"EFFECTS"}
    return {name: kind for name, kind in names.items() if name not in imported and not keyword.iskeyword(name)}


def _imports(body: str) -> list[str]:
    """The imports that the body needs, grouped as linters require."""
    used = set(re.findall(r"\b[A-Za-z_]\w*\b(?!=)", re.sub(r'"(\\.|[^"\\])*"', "", body)))
    groups: list[list[str]] = [[], [], []]
    for module, names in _IMPORTS:
        here = [name for name in names if name in used]
        group = groups[1 if not module else 2 if module.startswith("tendon") else 0]
        if here:
            group.append(_LINES.get(here[0]) or f"from {module} import {', '.join(here)}")
    lines = [line for group in groups if group for line in (*group, "")]
    return lines[:-1]


def _value(value: Any, depth: int, variables: Collection[str] = ()) -> str:
    """A value of a declaration as a Python expression, at indentation `depth`."""
    if isinstance(value, u.Unit):
        return _unit(value)
    if isinstance(value, sp.Expr):
        return _law(value, depth, variables)
    if isinstance(value, tuple):
        items = [_value(item, depth + 1, variables) for item in value]
        return _call("", items, depth) if items else "()"
    if isinstance(value, Effect | Parameter | Grid | State | LinearForm | Element):
        given = [f.name for f in fields(value) if f.default is MISSING or getattr(value, f.name) != f.default]
        items = [f"{name}={_value(getattr(value, name), depth + 1, variables)}" for name in given]
        place = "elements." if isinstance(value, Element) else ""
        return _call(place + type(value).__name__, items, depth)
    if isinstance(value, str):
        return _text(value, depth)
    if isinstance(value, float) and abs(value) == inf:
        return "inf" if value > 0 else "-inf"
    return repr(value)


def _law(law: sp.Expr, depth: int, variables: Collection[str]) -> str:
    """An expression; a long sum or product has a line for each of its parts."""
    flat = expression(law, variables)
    if len(flat) + len(_INDENT) * depth < _WIDTH - 12 or not isinstance(law, sp.Add | sp.Mul):
        return flat
    inner, end = _INDENT * (depth + 1), _INDENT * depth
    sign = "+" if isinstance(law, sp.Add) else "*"
    parts = [expression(part, variables) for part in law.args]
    if sign == "*":
        parts = [f"({text})" if isinstance(p, sp.Add) else text for p, text in zip(law.args, parts, strict=True)]
    lines = [parts[0], *(f"- {t[1:]}" if sign == "+" and t.startswith("-") else f"{sign} {t}" for t in parts[1:])]
    return "(\n" + "".join(f"{inner}{line}\n" for line in lines) + f"{end})"


def _call(name: str, items: list[str], depth: int) -> str:
    """A call on one line if it fits, otherwise with one item per line."""
    flat = f"{name}({', '.join(items)}{',' if not name and len(items) == 1 else ''})"
    if "\n" not in flat and len(flat) + len(_INDENT) * depth < _WIDTH - 16 and name != "Effect":
        return flat
    inner, end = _INDENT * (depth + 1), _INDENT * depth
    return f"{name}(\n" + "".join(f"{inner}{item},\n" for item in items) + f"{end})"


def _text(text: str, depth: int = 0) -> str:
    """A string literal; a long one as several on lines of their own."""
    room = _WIDTH - len(_INDENT) * (depth + 1) - 16
    if len(text) <= room:
        return json.dumps(text, ensure_ascii=False)
    parts = textwrap.wrap(text, room, drop_whitespace=False, break_on_hyphens=False)
    if "".join(parts) != text:
        return json.dumps(text, ensure_ascii=False)
    inner = _INDENT * (depth + 1)
    return "(\n" + "".join(f"{inner}{json.dumps(p, ensure_ascii=False)}\n" for p in parts) + f"{_INDENT * depth})"


def _unit(unit: u.Unit) -> str:
    """A unit by its name, else as the product that gives the same powers in the same order."""
    if unit in _UNITS:
        return f"u.{_UNITS[unit]}"
    text = ""
    for symbol, power in unit.powers:
        size = abs(power)
        factor = f"u.{_BASE[symbol]}" + ("" if size == 1 else f"**{size}")
        joint = " * " if power > 0 else " / "
        text = text + joint + factor if text else factor if power > 0 else f"u.ONE / {factor}"
    return text


def expression(law: sp.Expr, variables: Collection[str] = ()) -> str:
    """Python that evaluates to `law`; parameters and states named in `variables` are variables of that name."""
    text = str(
        _Printer(frozenset(variables)).doprint(
            law.replace(lambda e: isinstance(e, sp.Add), lambda e: _absolutes(*e.args))
        )
    )
    return re.sub(r"(?<![*])([*/])(?![*])", r" \1 ", text)


class _Absolute(sp.Function):
    """|x| instead of the sum of two ramps, for printing."""

    nargs = (2,)


def _absolutes(*terms: sp.Expr) -> sp.Expr:
    left = list(terms)
    for term in terms:
        if isinstance(term, ramp) and term in left:
            x, width = term.args
            if (mirrored := ramp(-x, width)) in left:
                left = [t for t in left if t not in (term, mirrored)]
                left.append(_Absolute(-x if x.could_extract_minus_sign() else x, width))
    return sp.Add(*left)


class _Printer(StrPrinter):
    """SymPy's printer with functions from `sp`, and symbols and primitives as in declarations."""

    def __init__(self, variables: frozenset[str]) -> None:
        super().__init__({"order": "none"})
        self._variables = variables

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        if expr == DT:
            return "DT"
        if expr in WIDTHS:
            return str(expr.name.upper())
        if expr.name in SIGNAL:
            return str(expr.name)
        kind, _, name = expr.name.partition("_")
        return name if name in self._variables else f'{_KINDS[kind]}("{name}")'

    def _print_Function(self, expr: sp.Function) -> str:
        name = "absolute" if isinstance(expr, _Absolute) else expr.func.__name__
        own = isinstance(expr, _Absolute | sgn | step | ramp)
        return f"{'' if own else 'sp.'}{name}({self.stringify(expr.args, ', ')})"

    def _print_LatticeOp(self, expr: sp.Expr) -> str:
        return f"sp.{expr.func.__name__}({self.stringify(expr.args, ', ')})"

    def _print_Pow(self, expr: sp.Pow, rational: bool = False) -> str:
        if abs(expr.exp) == sp.Rational(1, 2):
            root = f"sp.sqrt({self._print(expr.base)})"
            return root if expr.exp > 0 else f"1/{root}"
        return str(super()._print_Pow(expr, rational))

    def _print_Rational(self, expr: sp.Rational) -> str:
        return f"sp.Rational({expr.p}, {expr.q})"

    def _print_Float(self, expr: sp.Float) -> str:
        return repr(float(expr))

    def _print_Pi(self, _: Any) -> str:
        return "sp.pi"
