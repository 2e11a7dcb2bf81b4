"""C99 of an arm's functions for many samples, in explicit vectors of doubles.

Compilers do not vectorise loops of hundreds of operations. Values that depend on the parameters alone are computed
before the loop. Remaining samples, and all samples without vector types, use the function of one sample, which gives
the same bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from codegen.c.c_code import (
    C_DOUBLE,
    F64,
    Routine,
    batch_attribute,
    comment,
    declaration,
    indent,
    row,
    struct_argument,
    struct_leaves,
    taken,
)
from codegen.tape.numbering import ARITHMETIC
from codegen.tape.printers import Printer, Text
from codegen.tape.tape import Tape
from symbolic.functions import SymbolicFunction

OPERATIONS = frozenset((*ARITHMETIC, "const", "leaf", "sin", "cos"))
"""The operations of tendon_lanes_f64.h."""
_KIND = "tendon_lanes_f64"


def _pair(sine: str | None, cosine: str | None, angle: str) -> list[str]:
    if cosine is None:
        return [f"const {_KIND} {sine} = tendon_sin_lanes_f64({angle});"]
    if sine is None:
        return [f"const {_KIND} {cosine} = tendon_cos_lanes_f64({angle});"]
    return [f"{_KIND} {sine};", f"{_KIND} {cosine};", f"tendon_sincos_lanes_f64({angle}, &{sine}, &{cosine});"]


_LANES = replace(C_DOUBLE, pair=_pair, assign=lambda name, text: f"const {_KIND} {name} = {text};")


class _LanePrinter(Printer):
    """Prints a tape in vectors. before: statements on scalars, which depend on the parameters alone."""

    def __init__(self, function: SymbolicFunction, tape: Tape) -> None:
        struct = struct_leaves(function)
        leaves = {s: s.name for a in function.inputs for s in a.symbols}
        names = taken(function) | set(leaves.values()) | set(_RANGE)
        super().__init__(_LANES, tape, leaves | struct, names)
        self.before: list[str] = []
        self.uniform: list[bool] = []
        for node in tape.nodes:
            self.uniform.append(node.value in struct if node.op == "leaf" else all(self.uniform[a] for a in node.args))

    def _statement(self, i: int, text: Text) -> Text:
        with self._scalars(self.uniform[i]):
            return super()._statement(i, text)

    def _pair(self, angle: int) -> list[int]:
        with self._scalars(self.uniform[angle]):
            return super()._pair(angle)

    @contextmanager
    def _scalars(self, uniform: bool) -> Iterator[None]:
        """Prints a uniform value as a scalar before the loop."""
        kept = self.language, self.lines
        if uniform:
            self.language, self.lines = C_DOUBLE, self.before
        yield
        self.language, self.lines = kept

    def value(self, output: int, text: str) -> str:
        """The spelling of an output as a vector."""
        return f"tendon_spread_f64({text})" if self.uniform[output] else text


def batch(prefix: str, function: SymbolicFunction, tape: Tape) -> Routine:
    """Structure of arrays: element j of sample k stands at [j * count + k]. Outputs may not overlap inputs."""
    return Routine(
        comment(f"{function.name} of `count` samples; element j of sample k at [j * count + k]; no overlap."),
        declaration(
            f"void {prefix}_{function.name}_batch_{F64.suffix}", ["size_t count", *_arguments(prefix, function)]
        ),
        _body(f"{prefix}_{function.name}", function, tape, first="0U", last="count"),
        batch_attribute(function),
    )


def range_and_batch(prefix: str, function: SymbolicFunction, tape: Tape) -> list[Routine]:
    """The same for a function that another one continues, and before it the function of the samples first to last −
    1."""
    name, arguments = f"{prefix}_{function.name}", _arguments(prefix, function)
    passed = [a.name for a in function.arguments] + [o.name for o in function.outputs]
    return [
        Routine(
            comment(f"{function.name} of samples `first` to before `last` of `count`, as the batch has them."),
            declaration(f"void {name}_range_{F64.suffix}", [*(f"size_t {n}" for n in _RANGE), *arguments]),
            _body(name, function, tape, first="first", last="last"),
        ),
        Routine(
            comment(f"{function.name} of `count` samples; element j of sample k at [j * count + k]; no overlap."),
            declaration(f"void {name}_batch_{F64.suffix}", ["size_t count", *arguments]),
            indent([f"{name}_range_{F64.suffix}({', '.join(['count', '0U', 'count', *passed])});"], 1),
        ),
    ]


_RANGE = ("count", "first", "last")


def _arguments(prefix: str, function: SymbolicFunction) -> list[str]:
    inputs = [f"const {F64.kind} *restrict {a.name}" for a in function.inputs]
    outputs = [f"{F64.kind} *restrict {o.name}" for o in function.outputs]
    return [*struct_argument(prefix, function, F64), *inputs, *outputs]


def _body(name: str, function: SymbolicFunction, tape: Tape, first: str, last: str) -> str:
    vectors = ["#if defined(TENDON_LANES)", *_vectors(function, tape, last), "#endif"]
    return indent([f"size_t k = {first};", *vectors, *_rest(name, function, last)], 1).replace("    #", "#")


def _vectors(function: SymbolicFunction, tape: Tape, last: str) -> list[str]:
    """The loop over complete vectors."""
    printer = _LanePrinter(function, tape)
    lines, texts = printer.print()
    used = {node.value for node in tape.nodes if node.op == "leaf"}
    loads = [
        f"const {_KIND} {s.name} = tendon_load_f64({a.name} + {row(i)});"
        for a in function.inputs
        for i, s in enumerate(a.symbols)
        if s in used
    ]
    places = [f"{o.name} + {row(i)}" for o in function.outputs for i in range(len(o.expressions))]
    values = [printer.value(i, text) for i, text in zip(tape.outputs, texts, strict=True)]
    stores = [f"tendon_store_f64({place}, {value});" for place, value in zip(places, values, strict=True)]
    head = f"for (; {last} - k >= TENDON_LANES; k += TENDON_LANES) {{"
    return [*printer.before, head, *("    " + line for line in (*loads, *lines, *stores)), "}"]


def _rest(name: str, function: SymbolicFunction, last: str) -> list[str]:
    """The loop over the remaining samples."""
    pointer = [] if function.struct is None else [function.struct.name]
    sizes = {a.name: len(a.symbols) for a in function.inputs}
    results = {o.name: len(o.expressions) for o in function.outputs}
    call = [*pointer, *(f"{a.name}_k" if a.shape else f"{a.name}[k]" for a in function.inputs)]
    call += [f"{o}_k" for o in results]
    vectors = {a.name: sizes[a.name] for a in function.inputs if a.shape}
    lines = [f"double {v}_k[{size}];" for v, size in (vectors | results).items()]
    lines += _copies(vectors, "{0}_k[j] = {0}[j * count + k];")
    lines.append(f"{name}_f64({', '.join(call)});")
    lines += _copies(results, "{0}[j * count + k] = {0}_k[j];")
    return [f"for (; k < {last}; ++k) {{", *("    " + line for line in lines), "}"]


def _copies(sizes: dict[str, int], line: str) -> list[str]:
    loops = [(f"for (size_t j = 0U; j < {size}U; ++j) {{", "    " + line.format(v), "}") for v, size in sizes.items()]
    return [line for loop in loops for line in loop]


def in_lanes(tape: Tape) -> bool:
    """Whether vectors have all operations of a tape."""
    return {node.op for node in tape.nodes} <= OPERATIONS
