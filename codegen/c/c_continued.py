"""C99 of functions that go on from the output of another one: that one is called, and the elements that differ are
computed in its place.

An arm's link load is its inverse dynamics but for a product and a difference a joint. Compiled as a whole, both would
take the compiler twice as long as one.
"""

from __future__ import annotations

from collections.abc import Callable

from codegen.c.c_code import (
    F64,
    LOOP,
    Precision,
    Routine,
    assign,
    comment,
    declaration,
    describe,
    indent,
    row,
    struct_argument,
    struct_leaves,
    taken,
)
from codegen.tape.printers import Printer
from codegen.tape.tape import Tape
from symbolic.functions import Continuation, SymbolicFunction

BLOCK = 256
"""Samples that one function computes before the other goes on: those of an arm are still in the processor's first or
second cache then."""


def call(prefix: str, function: SymbolicFunction, continued: Continuation, tape: Tape, precision: Precision) -> Routine:
    """One sample a call, as c_code.call has it. `tape`: of the function as a whole."""
    kind, suffix = precision.kind, precision.suffix
    (output,) = function.outputs
    arguments = [f"const {kind} {a.name}[{len(a.symbols)}]" for a in function.inputs]
    arguments = [*struct_argument(prefix, function, precision), *arguments]
    arguments.append(f"{kind} {output.name}[{len(output.expressions)}]")
    first = f"{prefix}_{continued.function}_{suffix}({', '.join(_passed(function))});"
    lines = [first, *_rest(function, continued, precision, str)]
    head = declaration(f"void {prefix}_{function.name}_{suffix}", arguments)
    return Routine(describe(function, tape), head, indent(lines, 1))


def batch(prefix: str, function: SymbolicFunction, continued: Continuation) -> Routine:
    """Structure of arrays, as c_lanes.batch has it; the other function's samples from one to another are called."""
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
    """The statements on the elements that differ. `index`: how an element's place is spelt."""
    (output,) = function.outputs
    leaves = struct_leaves(function)
    leaves |= {s: f"{a.name}[{index(i)}]" for a in function.inputs for i, s in enumerate(a.symbols)}
    leaves |= {symbol: f"{output.name}[{index(i)}]" for symbol, i in continued.values}
    places = [i for symbol, i in continued.values if output.expressions[i] != symbol]
    tape = Tape.from_expressions([output.expressions[i] for i in places], (), leaves, where=function.name)
    lines, texts = Printer(precision.language, tape, leaves, taken(function) | {"first", "last"}).print()
    return lines + assign([f"{output.name}[{index(i)}]" for i in places], texts)
