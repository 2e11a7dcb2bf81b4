"""CasADi text of symbolic functions: one builder a function, smooth surrogates of named width."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import sympy as sp

from codegen.c.c_code import legend, operations
from codegen.tape.printers import CASADI, Printer
from codegen.tape.tape import Tape
from symbolic.functions import Output, SymbolicFunction
from symbolic.primitives import WIDTHS


@dataclass(frozen=True)
class Builder:
    """A Python function without arguments that returns a casadi.Function."""

    name: str
    doc: str
    body: str


def builder(function: SymbolicFunction, widths: bool = False, tape: Tape | None = None) -> Builder:
    """`widths`: the last input is `width`, the widths of the surrogates in the order of primitives.WIDTHS."""
    tape = tape or Tape.of(function, "smooth")
    leaves: dict[sp.Symbol, str] = {}
    lines, names = [], []
    if function.struct is not None:
        leaves |= {s: f"{function.struct.name}[{i}]" for i, s in enumerate(function.struct.symbols)}
        lines.append(_symbol(function.struct.name, (len(function.struct.symbols),)))
        names.append(function.struct.name)
    for a in function.inputs:
        leaves |= dict(zip(a.symbols, _elements(a.name, a.shape), strict=True))
        lines.append(_symbol(a.name, a.shape))
        names.append(a.name)
    if widths:
        leaves |= {s: f"width[{i}]" for i, s in enumerate(WIDTHS)}
        lines.append(_symbol("width", (len(WIDTHS),)))
        names.append("width")
    taken = frozenset(names) | {o.name for o in function.outputs}
    statements, texts = Printer(CASADI, tape, leaves, taken).print()
    lines += statements
    for output in function.outputs:
        count = len(output.expressions)
        lines.append(f"{output.name} = {_output(output, texts[:count])}")
        texts = texts[count:]
    outputs = [o.name for o in function.outputs]
    quoted = [", ".join(f'"{name}"' for name in group) for group in (names, outputs)]
    lines.append(f"inputs, outputs = [{', '.join(names)}], [{', '.join(outputs)}]")
    lines.append(f'return ca.Function("{function.name}", inputs, outputs, [{quoted[0]}], [{quoted[1]}])')
    return Builder(function.name, _doc(function, tape), "\n".join("    " + line for line in lines))


def _symbol(name: str, shape: tuple[int, ...]) -> str:
    size = "".join(f", {n}" for n in shape)
    return f'{name} = ca.SX.sym("{name}"{size})'


def _elements(name: str, shape: tuple[int, ...]) -> list[str]:
    """CasADi counts down the columns, a SymbolicFunction along the rows; two indices say which is meant."""
    if not shape:
        return [name]
    if len(shape) == 1:
        return [f"{name}[{i}]" for i in range(shape[0])]
    return [f"{name}[{i}, {j}]" for i in range(shape[0]) for j in range(shape[1])]


def _output(output: Output, texts: list[str]) -> str:
    if not output.shape:
        return f"ca.SX({texts[0]})"
    if len(output.shape) == 1:
        return f"ca.SX(ca.vertcat({', '.join(texts)}))"
    width = output.shape[1]
    rows = [f"ca.horzcat({', '.join(texts[i : i + width])})" for i in range(0, len(texts), width)]
    return f"ca.SX(ca.vertcat({', '.join(rows)}))"


def _doc(function: SymbolicFunction, tape: Tape) -> str:
    """A docstring that no text can end early."""
    lines = [
        f"{function.name}: {function.doc}",
        *(f"in   {a.name} [{a.unit}]: {a.meaning}" for a in function.inputs),
        *(f"out  {o.name} [{o.unit}]: {o.meaning}" for o in function.outputs),
        f"Source: {function.source}",
        *([f"Names: {names}"] if (names := legend(function, tape)) else []),
        f"Operations: {operations(tape)}",
    ]
    wrapped = [
        part
        for line in lines
        for part in textwrap.wrap(line.replace("\\", "/").replace('"', "'"), 112, subsequent_indent="  ")
    ]
    return '"""' + "\n    ".join(wrapped) + '\n    """'
