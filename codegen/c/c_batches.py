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

_TAKEN = frozenset({s.name for s in SIGNALS} | {"count", "s", "dt", "p", "x", "out", "k"})


def signals_type(precision: Precision) -> str:
    """The struct of one array a signal."""
    arrays = [f"    const {precision.kind} *{s.name};" for s in SIGNALS]
    note = comment("An array a signal; those that an effect does not read may be null.")
    return "\n".join([note, "typedef struct {", *arrays, f"}} tendon_signals_{precision.suffix};"])


def batches(effect: Effect, precision: Precision) -> list[Routine]:
    """Along the samples: `columns` (rows: fixed part, then one a linear parameter), `torque` and, where there are
    any, `states`."""
    functions = [ef.columns(effect), ef.torque(effect), *([ef.states(effect)] if effect.states else [])]
    return [_batch(effect, function, precision) for function in functions]


def _batch(effect: Effect, function: SymbolicFunction, precision: Precision) -> Routine:
    kind, suffix = precision.kind, precision.suffix
    leaves = _leaves(effect) | {s.symbol: f"{s.name}[k]" for s in effect.signals}
    steps = tuple(sp.sympify(s.step) for s in effect.states)
    # Outputs and steps on one tape share what they have in common.
    merged = replace(
        ef.step(effect), outputs=(*function.outputs, Output("x_next", steps, (len(steps),), "", "")), definitions=()
    )
    tape = Tape.of(merged)
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
