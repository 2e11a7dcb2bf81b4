"""C99 of the effects library for NumPy: along the samples of a recording, in double precision.

All take the same arguments, whatever an effect reads: one array a signal, and the parameters as one array in declared
order. The states are simulated along the samples from their initial values.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from codegen import effect_functions as ef
from codegen.c.c_code import LOOP, Precision, Routine, assign, comment, declaration, indent, row
from codegen.tape.printers import Printer
from codegen.tape.tape import Tape
from symbolic.effects.declaration import DT, SIGNALS, Effect
from symbolic.functions import Output, SymbolicFunction

_TAKEN = frozenset({s.name for s in SIGNALS} | {"count", "s", "dt", "p", "x", "out", "k", "i", "j", "own", "row"})

LANES = 8
"""Choices of parameters along which a memory is simulated at once: what each waits for, the others fill, and they share
the processor's vectors."""


def signals_type(precision: Precision) -> str:
    """The struct of one array a signal."""
    arrays = [f"    const {precision.kind} *{s.name};" for s in SIGNALS]
    note = comment("An array a signal; those that an effect does not read may be null.")
    return "\n".join([note, "typedef struct {", *arrays, f"}} tendon_signals_{precision.suffix};"])


def columns_type(precision: Precision) -> str:
    """What `columns` of every effect are called as."""
    kind, suffix = precision.kind, precision.suffix
    note = comment("Columns along `count` samples, of one choice of parameters or, with a memory, of several at once.")
    arguments = f"size_t count, const tendon_signals_{suffix} *s, {kind} dt, const {kind} *p, {kind} *out"
    return f"{note}\ntypedef void tendon_columns_{suffix}({arguments});"


def batches(effect: Effect, precision: Precision) -> list[Routine]:
    """Along the samples: `columns` (rows: fixed part, then one a linear parameter), `torque` and, where there are
    any, `states`, and `columns` of several choices of parameters at once."""
    functions = [ef.columns(effect), ef.torque(effect), *([ef.states(effect)] if effect.states else [])]
    at_once = [_at_once(effect, precision)] if effect.states else []
    return [*(_batch(effect, function, precision) for function in functions), *at_once]


def _with_steps(effect: Effect, function: SymbolicFunction) -> Tape:
    """Outputs and the states' steps on one tape, which share what they have in common."""
    steps = tuple(sp.sympify(s.step) for s in effect.states)
    outputs = (*function.outputs, Output("x_next", steps, (len(steps),), "", ""))
    return Tape.of(replace(ef.step(effect), outputs=outputs, definitions=()))


def _at_once(effect: Effect, precision: Precision) -> Routine:
    """`columns` of LANES choices of parameters along the same samples."""
    kind, suffix, function = precision.kind, precision.suffix, ef.columns(effect)
    rows, width = len(function.outputs[0].expressions), len(effect.parameters)
    begun, begin = _in_lane(effect, ef.start(effect), "0", precision)
    tape, step = _in_lane(effect, function, "k", precision)
    read = {node.value for t in (begun, tape) for node in t.nodes if node.op == "leaf"}
    lanes = f"for (size_t j = 0; j < {LANES}; ++j) {{"
    body = [
        *([] if DT in read else ["(void)dt;"]),
        *(f"const {kind} *restrict {s.name} = s->{s.name};" for s in effect.signals if s.symbol in read),
        f"{kind} own[{width}][{LANES}];",
        f"{kind} x[{len(effect.states)}][{LANES}];",
        *("if (count == 0U) {", "    return;", "}", lanes),
        *(f"    for (size_t i = 0; i < {width}; ++i) {{", f"        own[i][j] = p[{width} * j + i];", "    }"),
        *(f"    {line}" for line in begin),
        *("}", "for (size_t k = 0; k < count; ++k) {"),
        *(f"    {kind} row[{rows}][{LANES}];", f"    {LOOP}", f"    {lanes}"),
        *(f"        {line}" for line in step),
        *("    }", f"    {lanes}", f"        for (size_t i = 0; i < {rows}; ++i) {{"),
        *(f"            out[({rows} * j + i) * count + k] = row[i][j];", "        }", "    }", "}"),
    ]
    what = f"{function.name} of {LANES} choices of parameters, p ({LANES}, {width})"
    arguments = ["size_t count", f"const tendon_signals_{suffix} *s", f"{kind} dt", f"const {kind} *restrict p"]
    head = f"void tendon_{function.name}_at_once_{suffix}"
    return Routine(
        comment(f"{what}; out ({LANES}, {rows}, count)."),
        declaration(head, [*arguments, f"{kind} *restrict out"]),
        indent(body, 1),
    )


def _in_lane(effect: Effect, function: SymbolicFunction, at: str, precision: Precision) -> tuple[Tape, list[str]]:
    """Statements of lane j at sample `at`: its states begun by `start`, or the rows of another function and the step
    that follows; and their tape."""
    leaves = {p.symbol: f"own[{i}][j]" for i, p in enumerate(effect.parameters)} | {DT: "dt"}
    leaves |= {s.symbol: f"x[{i}][j]" for i, s in enumerate(effect.states)}
    leaves |= {s.symbol: f"{s.name}[{at}]" for s in effect.signals}
    states = [f"x[{i}][j]" for i in range(len(effect.states))]
    begins = function is ef.start(effect)
    tape = Tape.of(function) if begins else _with_steps(effect, function)
    lines, texts = Printer(precision.language, tape, leaves, _TAKEN | {f"next{i}" for i in range(len(states))}).print()
    if begins:
        return tape, lines + assign(states, texts)
    rows = len(texts) - len(states)
    lines += assign([f"row[{i}][j]" for i in range(rows)], texts[:rows])
    lines += [precision.language.assign(f"next{i}", text) for i, text in enumerate(texts[rows:])]
    return tape, lines + assign(states, [f"next{i}" for i in range(len(states))])


def _batch(effect: Effect, function: SymbolicFunction, precision: Precision) -> Routine:
    kind, suffix = precision.kind, precision.suffix
    leaves = _leaves(effect) | {s.symbol: f"{s.name}[k]" for s in effect.signals}
    steps, tape = effect.states, _with_steps(effect, function)
    taken = _TAKEN | {f"next{i}" for i in range(len(steps))}
    lines, texts = Printer(precision.language, tape, leaves, taken).print()
    rows = len(function.outputs[0].expressions)
    lines += assign([f"out[{row(j)}]" for j in range(rows)], texts[:rows])
    lines += [precision.language.assign(f"next{i}", text) for i, text in enumerate(texts[rows:])]
    lines += assign([f"x[{i}]" for i in range(len(steps))], [f"next{i}" for i in range(len(steps))])
    before, pointers = [], {node.value for node in tape.nodes if node.op == "leaf"}
    if steps:
        start, extra = _start(effect, precision)
        before, pointers = start, pointers | extra
    head = [f"const {kind} *restrict {s.name} = s->{s.name};" for s in effect.signals if s.symbol in pointers]
    used = {leaves[symbol].split("[")[0] for symbol in pointers if symbol in leaves}
    unread = [name for name, read in (("s", head), ("dt", DT in pointers), ("p", "p" in used)) if not read]
    body = [*(f"(void){name};" for name in unread), *head, *before, *([] if steps else [LOOP])]
    body.append("for (size_t k = 0; k < count; ++k) {")
    arguments = ["size_t count", f"const tendon_signals_{suffix} *s", f"{kind} dt", f"const {kind} *restrict p"]
    return Routine(
        comment(f"{function.name} along `count` samples, {rows} row{'s' if rows > 1 else ''} in `out`."),
        declaration(
            f"void tendon_{function.name}_batch_{suffix}",
            [*arguments, f"{kind} *restrict out"],
        ),
        indent(body, 1) + "\n" + indent(lines, 2) + "\n    }",
    )


def _start(effect: Effect, precision: Precision) -> tuple[list[str], set[sp.Symbol]]:
    """Statements that set the states from the first sample, and what they read."""
    tape = Tape.of(ef.start(effect))
    leaves = _leaves(effect) | {s.symbol: f"{s.name}[0]" for s in effect.signals}
    lines, texts = Printer(precision.language, tape, leaves, _TAKEN).print()
    lines += assign([f"x[{i}]" for i in range(len(texts))], texts)
    block = [f"{precision.kind} x[{len(texts)}];", "if (count == 0U) {", "    return;", "}"]
    block += ["{", *("    " + line for line in lines), "}"] if len(lines) > len(texts) else lines
    return block, {node.value for node in tape.nodes if node.op == "leaf"}


def _leaves(effect: Effect) -> dict[sp.Symbol, str]:
    leaves = {p.symbol: f"p[{i}]" for i, p in enumerate(effect.parameters)}
    leaves |= {s.symbol: f"x[{i}]" for i, s in enumerate(effect.states)}
    return leaves | {DT: "dt"}


def decimation(precision: Precision) -> Routine:
    """The filter that takes torque and regressors into the band: only the outputs that are kept are computed."""
    kind = precision.kind
    body = f"""for (size_t k = 0; k < count; ++k) {{
    const {kind} *restrict window = x + k * factor;
    {kind} lane[8] = {{0}};
    {kind} rest = 0;
    size_t i = 0;
    for (; i + 8 <= taps; i += 8) {{
        for (size_t j = 0; j < 8; ++j) {{
            lane[j] += window[i + j] * kernel[i + j];
        }}
    }}
    for (; i < taps; ++i) {{
        rest += window[i] * kernel[i];
    }}
    out[k] = ((lane[0] + lane[4]) + (lane[1] + lane[5])) + ((lane[2] + lane[6]) + (lane[3] + lane[7])) + rest;
}}"""
    arguments = ["size_t count", "size_t factor", "size_t taps", f"const {kind} *restrict kernel"]
    return Routine(
        comment(
            "FIR filter with decimation: out[k] = sum over i < taps of kernel[i] x[k factor + i], for k < count.",
            "Eight lanes, so that the sum has one order whatever the width of the processor's vectors.",
        ),
        declaration(
            f"void tendon_decimate_{precision.suffix}",
            [*arguments, f"const {kind} *restrict x", f"{kind} *restrict out"],
        ),
        indent(body.splitlines(), 1),
    )


def in_band(precision: Precision) -> Routine:
    """The columns of many choices of parameters through that filter: what is thrown away never leaves the cache."""
    kind, suffix = precision.kind, precision.suffix
    body = """const size_t kept = (count < taps) ? 0U : (count - taps) / factor + 1U;
for (size_t first = 0; first < choices; first += lanes) {
    columns(count, s, dt, p + first * width, scratch);
    for (size_t i = 0; i < lanes * rows && first * rows + i < choices * rows; ++i) {
        const KIND *x = scratch + i * count;
        KIND *target = out + (first * rows + i) * kept;
        size_t k = 0;
        while (k < count && x[k] == 0) {
            ++k;
        }
        if (k < count) {
            tendon_decimate_SUFFIX(kept, factor, taps, kernel, x, target);
        } else {
            for (k = 0; k < kept; ++k) {
                target[k] = 0;
            }
        }
    }
}"""
    body = body.replace("KIND", kind).replace("SUFFIX", suffix)
    return Routine(
        comment(
            "Columns (rows, count) of `choices` choices of `width` parameters, p (choices, width) filled up to whole "
            "lanes, filtered and decimated: out (choices, rows, kept).",
            "lanes: choices that `columns` takes at once; scratch (lanes, rows, count).",
        ),
        declaration(
            f"void tendon_in_band_{suffix}",
            [
                *(f"tendon_columns_{suffix} *columns", "size_t lanes", "size_t rows", "size_t width"),
                *("size_t choices", "size_t count", f"const tendon_signals_{suffix} *s", f"{kind} dt"),
                *(f"const {kind} *restrict p", "size_t factor", "size_t taps", f"const {kind} *restrict kernel"),
                *(f"{kind} *restrict scratch", f"{kind} *restrict out"),
            ],
        ),
        indent(body.splitlines(), 1),
    )
