"""C99 of symbolic functions: the spelling of a tape in C, and functions of one or of many samples.

A double-precision function of one sample computes all sines and cosines together in vectors, with the same bits: one by
one they take a third of the time of inverse dynamics.
"""

from __future__ import annotations

import keyword
import re
import struct
import textwrap
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from codegen.tape.numbering import ARITHMETIC
from codegen.tape.printers import ATOM, Language, Printer, float64
from codegen.tape.tape import Tape
from symbolic.functions import Argument, Continuation, Output, Struct, SymbolicFunction


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
"""Names of arguments and loop indices in generated functions."""


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
    """Whether `name` is an identifier in C and in Python."""
    return re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) is not None and name not in _C_WORDS | set(keyword.kwlist)


def identifier(name: str) -> bool:
    """Whether `name` is an identifier that differs from the arguments of generated functions."""
    return word(name) and name not in _ARGUMENTS


_KNOWN = frozenset((*ARITHMETIC, "const", "leaf"))
_WIDEST = 8
"""Lanes of the widest vectors."""
_ARRAYS = {"sin": "sine", "cos": "cosine"}


class TogetherPrinter(Printer):
    """Prints a tape in double precision, beginning with the angles and their sines and cosines."""

    def __init__(self, tape: Tape, leaves: Mapping[sp.Symbol, str], taken: frozenset[str]) -> None:
        # Whether a node follows from inputs and parameters by arithmetic alone.
        self.known: list[bool] = []
        for node in tape.nodes:
            self.known.append(node.op in _KNOWN and all(self.known[a] for a in node.args))
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
        """Names for sine and cosine of the k-th angle."""
        nodes = self.angles[angle]
        for op, i in nodes.items():
            name = self.names.get(i) or self._fresh(f"{op}_{k + 1}")
            self.lines.append(self.language.assign(name, f"{_ARRAYS[op]}[{k}]"))
            self.texts[i] = name, ATOM
        return list(nodes.values())


def _angles_first(tape: Tape, known: list[bool]) -> list[int]:
    """The order of the nodes: those that known angles need, their sines and cosines, all others."""
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


@dataclass(frozen=True)
class Precision:
    """kind: the C type; suffix: the end of every name."""

    kind: str
    suffix: str
    language: Language


F64 = Precision("double", "f64", C_DOUBLE)
F32 = Precision("float", "f32", C_FLOAT)


COMPACT = "TENDON_COMPACT"
"""Attribute of functions that are compiled for size."""
WHOLE = "TENDON_WHOLE"
"""Attribute that inlines all calls: a fifth faster where sines and cosines take a third of the time."""
AS_WRITTEN = "TENDON_AS_WRITTEN"
"""Attribute that keeps the order of operations, so that functions with many results store each at once. Otherwise a
regressor compiles in twice the time and is a fifth slower."""
_MANY_RESULTS = ("regressor", "coriolis", "tip_load")
LOOP = "TENDON_INDEPENDENT"
"""Pragma for loops with independent iterations."""


HEAD = (
    "Inputs come first and outputs last; an output may not overlap an input. Matrices stand row by row: element (i, j) "
    "of one with n columns, both from 0, at [n i + j]. q, qd and qdd begin with joint 1."
)
"""Comment at the head of an arm's header."""


@dataclass(frozen=True)
class Routine:
    """A generated function: comment, declaration without semicolon, body, and an attribute of its definition."""

    comment: str
    declaration: str
    body: str
    attribute: str = ""


def comment(*lines: str) -> str:
    """A wrapped C comment; comment delimiters in the text are broken up."""
    wrapped = [
        part
        for line in lines
        for part in textwrap.wrap(
            line.replace("*/", "* /").replace("/*", "/ *"), 112, subsequent_indent="  ", break_long_words=False
        )
    ]
    return "/* " + "\n * ".join(wrapped) + " */"


def operations(count: Mapping[str, int]) -> str:
    """A tape's count as text: "73 operations (34 add, 12 sub, 27 mul) and 3 sincos"."""
    kinds = ", ".join(f"{count[op]} {op}" for op in ARITHMETIC if op in count)
    total = count["arithmetic"]
    text = f"{total} operation{'' if total == 1 else 's'}" + (f" ({kinds})" if kinds else "")
    others = [f"{n} {op}" for op, n in count.items() if op not in (*ARITHMETIC, "arithmetic") and n]
    return text + "".join(f" and {other}" for other in others)


def describe(function: SymbolicFunction, tape: Tape) -> str:
    """The description of a function as a C comment."""
    return comment(*description(function, function.inputs, tape))


def description(function: SymbolicFunction, inputs: Sequence[Argument], tape: Tape) -> list[str]:
    """What a function returns, its arguments with shapes and units, its source and its operation count."""
    return [
        f"{function.name}: {function.doc}",
        *(f"in   {quantity(a)}" for a in inputs),
        *(f"out  {quantity(o)}" for o in function.outputs),
        f"Source: {function.source}",
        f"Operations: {operations(tape.count())}",
    ]


def quantity(a: Argument | Output) -> str:
    """An argument with its shape and unit."""
    shape = f" ({' x '.join(map(str, a.shape))})" if a.shape else ""
    unit = f" [{a.unit}]" if a.unit else ""
    return f"{a.name}{shape}{unit}: {a.meaning}"


def legend(function: SymbolicFunction, tape: Tape) -> str:
    """The meaning of the equations' names that remain in the tape."""
    stems = {found[0] for name in tape.names.values() if (found := re.match(r"[A-Za-z]+", name))}
    return "; ".join(f"{names}: {text}" for names, text in function.notation.items() if stems & set(names.split(", ")))


def notation(function: SymbolicFunction, tape: Tape) -> str:
    """The legend as a comment at the head of a body, or nothing."""
    text = legend(function, tape)
    return "    " + comment(text).replace("\n", "\n    ") + "\n" if text else ""


def struct_type(prefix: str, struct: Struct, precision: Precision) -> str:
    """The typedef of the parameters, with unit and meaning of each field."""
    fields = [
        f"    {precision.kind} {s.name}; {comment(f'{unit}: {meaning}')}"
        for s, unit, meaning in zip(struct.symbols, struct.units, struct.meanings, strict=True)
    ]
    name = f"{prefix}_{struct.name}_{precision.suffix}"
    return "\n".join(["typedef struct {", *fields, f"}} {name};"])


def defaults(prefix: str, struct: Struct, precision: Precision, left_open: Collection[str] = ()) -> Routine:
    """The function that fills the struct with the model file's values; those without one are NaN.

    left_open   names of further fields that the model file leaves open
    """
    unknown = f'__builtin_nan{"f" if precision is F32 else ""}("")'
    lines = [
        f"    {struct.name}->{s.name} = {unknown if value is None else precision.language.literal(Fraction(value))};"
        + (f" {comment('not in the model file: to be set')}" if value is None or s.name in left_open else "")
        for s, value in zip(struct.symbols, struct.defaults, strict=True)
    ]
    name = f"{prefix}_default_{struct.name}_{precision.suffix}"
    return Routine(
        comment("Fills the structure with the values of the model file."),
        f"void {name}({prefix}_{struct.name}_{precision.suffix} *{struct.name})",
        "\n".join(lines),
    )


def call(prefix: str, function: SymbolicFunction, tape: Tape, precision: Precision) -> Routine:
    """One sample per call: inputs first, outputs last, matrices row by row. Outputs may not overlap inputs."""
    if function.continues is not None:
        return _continued_call(prefix, function, function.continues, tape=tape, precision=precision)
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
    if precision is F64:
        whole = function.name in ("inverse_dynamics", "forward_dynamics")
        return f"{WHOLE} " if whole else batch_attribute(function)
    # A controller calls these in contact phases only, where there is time; their sines and cosines take much room.
    return f"{COMPACT} " if function.name.startswith("contact_") else ""


def batch_attribute(function: SymbolicFunction) -> str:
    """The attribute of a function of many samples."""
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
    """One assignment per output."""
    return [f"{target} = {text};" for target, text in zip(targets, texts, strict=True)]


def struct_leaves(function: SymbolicFunction) -> dict[sp.Symbol, str]:
    """Spelling of the fields of the parameter struct."""
    struct = function.struct
    return {} if struct is None else {s: f"{struct.name}->{s.name}" for s in struct.symbols}


def struct_argument(prefix: str, function: SymbolicFunction, precision: Precision) -> list[str]:
    """The C argument with the parameters, if the function has any."""
    struct = function.struct
    return [] if struct is None else [f"const {prefix}_{struct.name}_{precision.suffix} *{struct.name}"]


def taken(function: SymbolicFunction) -> frozenset[str]:
    """Names of a function's arguments and outputs in C, which nothing else may have."""
    return frozenset({"count", "k"} | {a.name for a in function.arguments} | {o.name for o in function.outputs})


def unused(function: SymbolicFunction, tape: Tape) -> list[str]:
    """Statements that mark arguments as unused: the signature is the same whichever symbols remain."""
    used = {node.value for node in tape.nodes if node.op == "leaf"}
    return [f"(void){a.name};" for a in function.arguments if not used & set(a.symbols)]


def declaration(head: str, arguments: list[str]) -> str:
    """A declaration on one line if it fits, else with one argument per line."""
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


BLOCK = 256
"""Samples that one function computes before the next continues; they are still in the first or second level cache
then."""


def _continued_call(
    prefix: str, function: SymbolicFunction, continued: Continuation, tape: Tape, precision: Precision
) -> Routine:
    """The same for a function that continues another one, which is called first. tape: of the whole function."""
    kind, suffix = precision.kind, precision.suffix
    (output,) = function.outputs
    arguments = [f"const {kind} {a.name}[{len(a.symbols)}]" for a in function.inputs]
    arguments = [*struct_argument(prefix, function, precision), *arguments]
    arguments.append(f"{kind} {output.name}[{len(output.expressions)}]")
    first = f"{prefix}_{continued.function}_{suffix}({', '.join(_passed(function))});"
    lines = [first, *_rest(function, continued, precision, str)]
    head = declaration(f"void {prefix}_{function.name}_{suffix}", arguments)
    return Routine(describe(function, tape), head, indent(lines, 1))


def continued_batch(prefix: str, function: SymbolicFunction, continued: Continuation) -> Routine:
    """The same as c_lanes.batch for a function that continues another one, whose range function is called first."""
    (output,) = function.outputs
    inputs = [f"const {F64.kind} *restrict {a.name}" for a in function.inputs]
    arguments = [
        "size_t count",
        *struct_argument(prefix, function, F64),
        *inputs,
        f"{F64.kind} *restrict {output.name}",
    ]
    passed = ", ".join(["count", "first", "last", *_passed(function)])
    rest = _rest(function, continued, F64, row)
    body = [
        f"for (size_t first = 0U; first < count; first += {BLOCK}U) {{",
        f"    const size_t last = (count - first < {BLOCK}U) ? count : first + {BLOCK}U;",
        f"    {prefix}_{continued.function}_range_{F64.suffix}({passed});",
        *([f"    {LOOP}", "    for (size_t k = first; k < last; ++k) {"] if rest else []),
        *(f"        {line}" for line in rest),
        *(["    }"] if rest else []),
        "}",
    ]
    return Routine(
        comment(f"{function.name} of `count` samples; element j of sample k at [j * count + k]; no overlap."),
        declaration(f"void {prefix}_{function.name}_batch_{F64.suffix}", arguments),
        indent(body, 1),
    )


def _passed(function: SymbolicFunction) -> list[str]:
    return [*(a.name for a in function.arguments), function.outputs[0].name]


def _rest(
    function: SymbolicFunction, continued: Continuation, precision: Precision, index: Callable[[int], str]
) -> list[str]:
    """Statements for the elements that differ from the continued function's. index: spelling of an element's index."""
    (output,) = function.outputs
    leaves = struct_leaves(function)
    leaves |= {s: f"{a.name}[{index(i)}]" for a in function.inputs for i, s in enumerate(a.symbols)}
    leaves |= {symbol: f"{output.name}[{index(i)}]" for symbol, i in continued.values}
    places = [i for symbol, i in continued.values if output.expressions[i] != symbol]
    tape = Tape.from_expressions([output.expressions[i] for i in places], (), leaves, where=function.name)
    lines, texts = Printer(precision.language, tape, leaves, taken(function) | {"first", "last"}).print()
    return lines + assign([f"{output.name}[{index(i)}]" for i in places], texts)
