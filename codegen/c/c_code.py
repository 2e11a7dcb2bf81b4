"""C99 text of symbolic functions: declarations, comments and bodies, as finished strings for the templates."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from codegen.c.c_angles import TogetherPrinter
from codegen.c.language import C_DOUBLE, C_FLOAT
from codegen.tape.numbering import ARITHMETIC
from codegen.tape.printers import Language, Printer
from codegen.tape.tape import Tape
from symbolic.functions import Argument, Output, Struct, SymbolicFunction


@dataclass(frozen=True)
class Precision:
    """kind: the C type; suffix: the end of every name."""

    kind: str
    suffix: str
    language: Language


F64 = Precision("double", "f64", C_DOUBLE)
F32 = Precision("float", "f32", C_FLOAT)


COMPACT = "TENDON_COMPACT"
"""Tells the compiler that a function is to be small rather than fast."""
WHOLE = "TENDON_WHOLE"
"""Tells the compiler to take in all that a function calls: a fifth faster where sines and cosines are a third of it."""
AS_WRITTEN = "TENDON_AS_WRITTEN"
"""Tells the compiler to leave operations in their order: what a function of many results has computed is stored at once
then. Ordered anew, a regressor takes the compiler twice as long and is a fifth slower."""
_MANY_RESULTS = ("regressor", "coriolis", "tip_load")
LOOP = "TENDON_INDEPENDENT"
"""Tells the compiler that a loop's iterations do not depend on each other."""


HEAD = (
    "Inputs come first and outputs last; an output may not overlap an input. Matrices stand row by row: element (i, j) "
    "of one with n columns, both from 0, at [n i + j]. q, qd and qdd begin with joint 1."
)
"""What holds for all functions of an arm's header."""


@dataclass(frozen=True)
class Routine:
    """A generated function: comment, declaration without semicolon, and the body's lines.

    attribute   of its definition
    """

    comment: str
    declaration: str
    body: str
    attribute: str = ""


def comment(*lines: str) -> str:
    """A C comment that no text can end early, wrapped."""
    wrapped = [
        part
        for line in lines
        for part in textwrap.wrap(
            line.replace("*/", "* /").replace("/*", "/ *"), 112, subsequent_indent="  ", break_long_words=False
        )
    ]
    return "/* " + "\n * ".join(wrapped) + " */"


def operations(tape: Tape) -> str:
    """For example "73 operations (34 add, 12 sub, 27 mul) and 3 sincos"."""
    count = tape.count()
    kinds = ", ".join(f"{count[op]} {op}" for op in ARITHMETIC if op in count)
    total = count["arithmetic"]
    text = f"{total} operation{'' if total == 1 else 's'}" + (f" ({kinds})" if kinds else "")
    others = [f"{n} {op}" for op, n in count.items() if op not in (*ARITHMETIC, "arithmetic") and n]
    return text + "".join(f" and {other}" for other in others)


def describe(function: SymbolicFunction, tape: Tape) -> str:
    """The description of a function as a C comment."""
    return comment(*description(function, function.inputs, tape))


def description(function: SymbolicFunction, inputs: Sequence[Argument], tape: Tape) -> list[str]:
    """What a function returns, its arguments with shapes and units, its source and its price."""

    def line(a: Argument | Output) -> str:
        shape = f" ({' x '.join(map(str, a.shape))})" if a.shape else ""
        unit = f" [{a.unit}]" if a.unit else ""
        return f"{a.name}{shape}{unit}: {a.meaning}"

    return [
        f"{function.name}: {function.doc}",
        *(f"in   {line(a)}" for a in inputs),
        *(f"out  {line(o)}" for o in function.outputs),
        f"Source: {function.source}",
        f"Operations: {operations(tape)}",
    ]


def legend(function: SymbolicFunction, tape: Tape) -> str:
    """What the names that the equations gave stand for, those that are left in the tape."""
    stems = {found[0] for name in tape.names.values() if (found := re.match(r"[A-Za-z]+", name))}
    return "; ".join(f"{names}: {text}" for names, text in function.notation.items() if stems & set(names.split(", ")))


def notation(function: SymbolicFunction, tape: Tape) -> str:
    """The legend as a comment at the head of a body, or nothing."""
    text = legend(function, tape)
    return "    " + comment(text).replace("\n", "\n    ") + "\n" if text else ""


def struct_type(prefix: str, struct: Struct, precision: Precision) -> str:
    """The typedef of the parameters, a comment with unit and meaning a field."""
    fields = [
        f"    {precision.kind} {s.name}; {comment(f'{unit}: {meaning}')}"
        for s, unit, meaning in zip(struct.symbols, struct.units, struct.meanings, strict=True)
    ]
    name = f"{prefix}_{struct.name}_{precision.suffix}"
    return "\n".join(["typedef struct {", *fields, f"}} {name};"])


def defaults(prefix: str, struct: Struct, precision: Precision) -> Routine:
    """Fills the struct with the values that follow from the model file; those that it leaves open are 0."""
    lines = [
        f"    {struct.name}->{s.name} = {precision.language.literal(Fraction(value or 0.0))};"
        + ("" if value is not None else f" {comment('not in the model file: to be set')}")
        for s, value in zip(struct.symbols, struct.defaults, strict=True)
    ]
    name = f"{prefix}_default_{struct.name}_{precision.suffix}"
    return Routine(
        comment("Fills the structure with the values of the model file."),
        f"void {name}({prefix}_{struct.name}_{precision.suffix} *{struct.name})",
        "\n".join(lines),
    )


def call(prefix: str, function: SymbolicFunction, tape: Tape, precision: Precision) -> Routine:
    """One sample a call: inputs first, outputs last; matrices row by row. Outputs may not overlap inputs."""
    kind, name = precision.kind, f"{prefix}_{function.name}_{precision.suffix}"
    arguments = struct_argument(prefix, function, precision)
    leaves = struct_leaves(function)
    for a in function.inputs:
        if a.shape:
            arguments.append(f"const {kind} {a.name}[{len(a.symbols)}]")
            leaves |= {s: f"{a.name}[{i}]" for i, s in enumerate(a.symbols)}
        else:
            arguments.append(f"{kind} {a.name}")
            leaves[a.symbols[0]] = a.name
    arguments += [f"{kind} {o.name}[{len(o.expressions)}]" for o in function.outputs]
    if precision is F64:
        printer: Printer = TogetherPrinter(tape, leaves, taken(function))
    else:
        printer = Printer(precision.language, tape, leaves, taken(function))
    lines, texts = printer.print()
    targets = [f"{o.name}[{i}]" for o in function.outputs for i in range(len(o.expressions))]
    lines = unused(function, tape) + lines + assign(targets, texts)
    body = notation(function, tape) + indent(lines, 1)
    return Routine(
        describe(function, tape), declaration(f"void {name}", arguments), body, _attribute(function, precision)
    )


def _attribute(function: SymbolicFunction, precision: Precision) -> str:
    """Of one call."""
    if precision is F64:
        whole = function.name in ("inverse_dynamics", "forward_dynamics")
        return f"{WHOLE} " if whole else batch_attribute(function)
    # A controller calls these in contact phases only, where there is time; their sines and cosines take much room.
    return f"{COMPACT} " if function.name.startswith("contact_") else ""


def batch_attribute(function: SymbolicFunction) -> str:
    """Of many samples."""
    return f"{AS_WRITTEN} " if function.name in _MANY_RESULTS else ""


def batch(prefix: str, function: SymbolicFunction, tape: Tape, precision: Precision = F64) -> Routine:
    """Structure of arrays: element j of sample k stands at [j * count + k]. Outputs may not overlap inputs."""
    kind, name = precision.kind, f"{prefix}_{function.name}_batch_{precision.suffix}"
    arguments = ["size_t count", *struct_argument(prefix, function, precision)]
    leaves = struct_leaves(function)
    for a in function.inputs:
        arguments.append(f"const {kind} *restrict {a.name}")
        leaves |= {s: f"{a.name}[{row(i)}]" for i, s in enumerate(a.symbols)}
    arguments += [f"{kind} *restrict {o.name}" for o in function.outputs]
    lines, texts = Printer(precision.language, tape, leaves, taken(function)).print()
    targets = [f"{o.name}[{row(i)}]" for o in function.outputs for i in range(len(o.expressions))]
    lines += assign(targets, texts)
    body = [*unused(function, tape), LOOP, "for (size_t k = 0; k < count; ++k) {"]
    return Routine(
        comment(f"{function.name} of `count` samples; element j of sample k at [j * count + k]; no overlap."),
        declaration(f"void {name}", arguments),
        indent(body, 1) + "\n" + indent(lines, 2) + "\n    }",
        batch_attribute(function),
    )


def row(j: int) -> str:
    """Index of sample k in row j."""
    return "k" if j == 0 else "count + k" if j == 1 else f"{j} * count + k"


def assign(targets: list[str], texts: list[str]) -> list[str]:
    """One statement an output."""
    return [f"{target} = {text};" for target, text in zip(targets, texts, strict=True)]


def struct_leaves(function: SymbolicFunction) -> dict[sp.Symbol, str]:
    """How the fields of the parameter struct are spelt."""
    struct = function.struct
    return {} if struct is None else {s: f"{struct.name}->{s.name}" for s in struct.symbols}


def struct_argument(prefix: str, function: SymbolicFunction, precision: Precision) -> list[str]:
    """The argument that holds the parameters, in C; none for a function without."""
    struct = function.struct
    return [] if struct is None else [f"const {prefix}_{struct.name}_{precision.suffix} *{struct.name}"]


def taken(function: SymbolicFunction) -> frozenset[str]:
    """Names that a function's arguments and results have in C, so that nothing else may."""
    return frozenset({"count", "k"} | {a.name for a in function.arguments} | {o.name for o in function.outputs})


def unused(function: SymbolicFunction, tape: Tape) -> list[str]:
    """The signature is fixed whatever symbols survive; the others are named as unused."""
    used = {node.value for node in tape.nodes if node.op == "leaf"}
    return [f"(void){a.name};" for a in function.arguments if not used & set(a.symbols)]


def declaration(head: str, arguments: list[str]) -> str:
    """On one line if it fits, else an argument a line."""
    line = f"{head}({', '.join(arguments)})"
    return line if len(line) <= 110 else f"{head}(\n    " + ",\n    ".join(arguments) + ")"


def indent(lines: list[str], depth: int) -> str:
    """Statements as a block, long ones over several lines."""
    pad = "    " * depth
    parts = [
        textwrap.wrap(line, 116, initial_indent=pad, subsequent_indent=pad + "    ", break_on_hyphens=False)
        if len(line) > 110
        else [pad + line]
        for line in lines
    ]
    return "\n".join(part for group in parts for part in group)
