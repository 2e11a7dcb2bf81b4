"""C99 of the effects library, for a controller and for NumPy.

A controller's functions take the signals that an effect reads, the step, the parameters, and a struct of the states.
The functions for NumPy run along the samples of a recording in double precision; they all take an array per signal and
joint, and the parameters as one array in declared order.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import sympy as sp

from codegen import effect_functions as ef
from codegen.c.c_code import LOOP, Precision, Routine, assign, comment, declaration, describe, identifier, indent, word
from codegen.tape.printers import Printer
from codegen.tape.tape import Tape
from symbolic.effects.declaration import DT, SIGNALS, Effect
from symbolic.functions import Argument, Output, SymbolicFunction

HEAD = comment(
    "What each effect adds to the motor torque of a joint, on the motor's side: friction has the sign of qd.",
    "Units are those of a revolute joint; at a prismatic one N stands for N m, and m for rad.",
    "An effect with a memory: _start before the first sample, then for every sample _torque and, after it, _step.",
)


@dataclass(frozen=True)
class Signature:
    """Arguments of a controller's function: scalars, then the struct of the states if it is read or written."""

    inputs: tuple[Argument, ...]
    reads_state: bool
    writes_state: bool


def check_names(effects: Sequence[Effect]) -> None:
    """Raise ValueError for a name that cannot stand in C."""
    for effect in effects:
        for what, name, fits in [
            ("effect", effect.name, identifier),
            *(("parameter", p.name, word) for p in effect.parameters),
            *(("state", s.name, identifier) for s in effect.states),
        ]:
            if not fits(name):
                raise ValueError(
                    f'effect "{effect.name}": the {what} name "{name}" cannot be used in C; '
                    "use letters, digits and _, and no word of C or Python"
                )


def signature(effect: Effect, function: SymbolicFunction, tape: Tape) -> Signature:
    """The arguments that a function's tape reads."""
    read = {node.value for node in tape.nodes if node.op == "leaf"}
    return Signature(
        tuple(a for a in _scalars(effect) if a.symbols[0] in read),
        bool(read & {s.symbol for s in effect.states}),
        function.outputs[0].name == "x_next",
    )


def _scalars(effect: Effect) -> list[Argument]:
    """Signals, step and parameters; a parameter with the name of another one gets the suffix _parameter."""
    signals = [Argument(s.name, (s.symbol,), (), unit=s.unit.text(), meaning=s.meaning) for s in effect.signals]
    signals.append(Argument("dt", (DT,), (), unit="s", meaning="step"))
    taken = {a.name for a in signals} | {"state"}
    names = {p.name: f"{p.name}_parameter" if p.name in taken else p.name for p in effect.parameters}
    return signals + [
        Argument(names[p.name], (p.symbol,), (), unit=p.unit.text(), meaning=p.meaning) for p in effect.parameters
    ]


def state_type(effect: Effect, precision: Precision) -> str:
    """The name of the struct of an effect's states."""
    return f"tendon_{effect.name}_state_{precision.suffix}"


def types(effects: Sequence[Effect], precision: Precision) -> list[str]:
    """A struct for every effect with states."""
    return [HEAD, *(_struct(effect, precision) for effect in effects if effect.states)]


def _struct(effect: Effect, precision: Precision) -> str:
    fields = [f"    {precision.kind} {s.name}; {comment(f'{s.unit.text()}: {s.meaning}')}" for s in effect.states]
    note = comment(f"The memory of {effect.name}.")
    name = state_type(effect, precision)
    # The headers of the library and of an arm both have it.
    first = [f"#ifndef {name.upper()}", f"#define {name.upper()}"]
    return "\n".join([note, *first, "typedef struct {", *fields, f"}} {name};", "#endif"])


def routines(effect: Effect, precision: Precision) -> list[Routine]:
    """The torque, and start and step of an effect with states."""
    functions = [ef.torque(effect), *([ef.start(effect), ef.step(effect)] if effect.states else [])]
    return [_call(effect, function, precision) for function in functions]


def _call(effect: Effect, function: SymbolicFunction, precision: Precision) -> Routine:
    tape = Tape.of(function)
    takes = signature(effect, function, tape)
    leaves = {a.symbols[0]: a.name for a in takes.inputs}
    leaves |= {s.symbol: f"state->{s.name}" for s in effect.states}
    taken = frozenset({a.name for a in takes.inputs} | {"state"} | {f"next_{s.name}" for s in effect.states})
    lines, texts = Printer(precision.language, tape, leaves, taken).print()
    arguments = [f"{precision.kind} {a.name}" for a in takes.inputs]
    if takes.writes_state:
        lines += _stored(effect, texts, takes.reads_state, precision)
        arguments.append(f"{state_type(effect, precision)} *state")
    else:
        lines.append(f"return {texts[0]};")
        arguments += [f"const {state_type(effect, precision)} *state"] * takes.reads_state
    head = f"{'void' if takes.writes_state else precision.kind} tendon_{function.name}_{precision.suffix}"
    return Routine(_comment(effect, function, takes, tape), declaration(head, arguments or ["void"]), indent(lines, 1))


def _stored(effect: Effect, texts: list[str], together: bool, precision: Precision) -> list[str]:
    """Statements that store the next states. together: all are computed before the first is stored."""
    targets = [f"state->{s.name}" for s in effect.states]
    if not together or len(targets) == 1:
        return assign(targets, texts)
    names = [f"next_{s.name}" for s in effect.states]
    return [precision.language.assign(*pair) for pair in zip(names, texts, strict=True)] + assign(targets, names)


def _comment(effect: Effect, function: SymbolicFunction, takes: Signature, tape: Tape) -> str:
    """The comment of a function, with the arguments that its C has."""
    names, units = ", ".join(s.name for s in effect.states), ", ".join(s.unit.text() for s in effect.states)
    memory = Argument("state", tuple(s.symbol for s in effect.states), (), unit=units, meaning=names)
    inputs = takes.inputs + ((memory,) if takes.reads_state else ())
    outputs = function.outputs
    if takes.writes_state:
        outputs = (replace(outputs[0], name="state", shape=(), unit=units, meaning=f"{names}: {outputs[0].meaning}"),)
    return describe(replace(function, inputs=inputs, outputs=outputs), tape)


LANES = 8
"""Choices of parameters that are simulated at once, in vectors and without waiting for each other."""

_TAKEN = frozenset({s.name for s in SIGNALS} | set("sijkpx") | {"count", "joints", "dt", "out", "at", "own"})
_EACH_JOINT = "for (size_t at = 0; at < joints; ++at) {"
_EACH_SAMPLE = "for (size_t k = 0; k < count; ++k) {"
_EACH_LANE = f"for (size_t j = 0; j < {LANES}; ++j) {{"


def signals_type(precision: Precision) -> str:
    """The struct with an array per signal."""
    arrays = [f"    const {precision.kind} *{s.name};" for s in SIGNALS]
    note = comment("An array a signal; those that an effect does not read may be null.")
    return "\n".join([note, "typedef struct {", *arrays, f"}} tendon_signals_{precision.suffix};"])


def arguments_of(precision: Precision) -> list[str]:
    """Arguments of functions along samples."""
    kind, suffix = precision.kind, precision.suffix
    read = [f"const tendon_signals_{suffix} *s", f"{kind} dt", f"const {kind} *restrict p"]
    return ["size_t count", "size_t joints", *read, f"{kind} *restrict out"]


def columns_type(precision: Precision) -> str:
    """The type of the function `columns` of every effect."""
    note = comment("Columns along `count` samples at `joints` joints, of one choice of parameters or of several.")
    arguments = ", ".join(arguments_of(precision)).replace("restrict ", "")
    return f"{note}\ntypedef void tendon_columns_{precision.suffix}({arguments});"


_FILTERS = Path(__file__).parent / "templates" / "filters_f64.c"
_DEFINITION = re.compile(r"(/\*.*?\*/)\n(void .*?\))\n\{\n(.*?)\n\}\n", re.DOTALL)


def filters() -> list[Routine]:
    """The decimating FIR filter that takes torque and regressors into the band: one column, LANES columns, and the
    columns of many choices of parameters. The C is handwritten for double precision and LANES = 8."""
    return [Routine(*found) for found in _DEFINITION.findall(_FILTERS.read_text(encoding="utf-8"))]


def batches(effect: Effect, precision: Precision) -> list[Routine]:
    """Functions along samples: `columns` (rows: fixed part, then one per linear parameter) and `torque`; with states
    also `states`, and `columns` for several choices of parameters at once."""
    functions = [ef.columns(effect), ef.torque(effect), *([ef.states(effect)] if effect.states else [])]
    found = [_AlongSamples(effect, function, precision).routine() for function in functions]
    return [*found, *([_AtOnce(effect, functions[0], precision).routine()] if effect.states else [])]


@dataclass(frozen=True)
class _AlongSamples:
    """A function of an effect along the samples at every joint, with its states."""

    effect: Effect
    function: SymbolicFunction
    precision: Precision

    @property
    def rows(self) -> int:
        return len(self.function.outputs[0].expressions)

    def routine(self) -> Routine:
        effect, kind, states = self.effect, self.precision.kind, len(self.effect.states)
        arguments = {"s": {s.symbol for s in effect.signals}, "dt": {DT}, "p": {p.symbol for p in effect.parameters}}
        body = [
            *(f"(void){name};" for name, symbols in arguments.items() if not symbols & self._read),
            *([f"{kind} x[{states}];", "if (count == 0U) {", "    return;", "}"] if states else []),
            *self._at_joints(),
        ]
        rows = f"{self.rows} row{'s' if self.rows > 1 else ''}"
        note = comment(f"{self.function.name} along `count` samples, {rows} a joint in `out`.")
        return Routine(note, self._declared("batch"), indent(body, 1))

    def _declared(self, how: str) -> str:
        head = f"void tendon_{self.function.name}_{how}_{self.precision.suffix}"
        return declaration(head, arguments_of(self.precision))

    @cached_property
    def _start(self) -> Tape:
        return Tape.of(ef.start(self.effect))

    @cached_property
    def _step(self) -> Tape:
        return Tape.of(ef.step(self.effect))

    @cached_property
    def _both(self) -> Tape:
        """Outputs and steps of the states on one tape, with shared operations."""
        steps = tuple(sp.sympify(s.step) for s in self.effect.states)
        outputs = (*self.function.outputs, Output("x_next", steps, (len(steps),), unit="", meaning=""))
        return Tape.of(replace(ef.step(self.effect), outputs=outputs, definitions=()))

    @cached_property
    def _read(self) -> set[object]:
        return _leaves(self._both) | _leaves(self._start)

    def _at_joints(self) -> list[str]:
        """The loops over joints and samples; every joint has its own states, or all share them."""
        between = {s.symbol for s in self.effect.signals if s.between}
        own = _leaves(self._step) | _leaves(self._start)
        if not between or between & own:
            sample = self._in_lanes(self._both, self.rows)
            vectors = [] if self.effect.states else [LOOP]
            joint = [*self._arrays(self._read, "at"), *self._begun(), *vectors, *_block(_EACH_SAMPLE, sample)]
            return _block(_EACH_JOINT, joint)
        # A compliance at one joint acts on all joints, and its states read signals that all share.
        felt = Tape.of(self.function)
        joint = [*self._arrays(_leaves(felt) - own, "at"), *self._in_lanes(felt, self.rows)]
        sample = [*_block(_EACH_JOINT, joint), *self._in_lanes(self._step, 0)]
        return [*self._arrays(own, "0"), *self._begun(), *_block(_EACH_SAMPLE, sample)]

    def _arrays(self, read: set[object], at: str) -> list[str]:
        names = [s.name for s in self.effect.signals if s.symbol in read]
        return [f"const {self.precision.kind} *restrict {name} = s[{at}].{name};" for name in names]

    def _begun(self) -> list[str]:
        """Statements that initialise the states from the first sample."""
        if not self.effect.states:
            return []
        lines, texts = self._printed(self._start, "0")
        begun = [*lines, *assign([self._state(i) for i in range(len(texts))], texts)]
        # A block of its own keeps the names of intermediate values free.
        return self._each_lane(_block("{", begun) if lines else begun)

    def _in_lanes(self, tape: Tape, rows: int) -> list[str]:
        """Statements at sample k: the given number of output rows, then the next states."""
        lines, texts = self._printed(tape, "k")
        lines += assign([self._out(i) for i in range(rows)], texts[:rows])
        lines += [self.precision.language.assign(f"next{i}", text) for i, text in enumerate(texts[rows:])]
        steps = range(len(texts) - rows)
        return self._each_lane(lines + assign([self._state(i) for i in steps], [f"next{i}" for i in steps]))

    def _printed(self, tape: Tape, at: str) -> tuple[list[str], list[str]]:
        leaves = {p.symbol: self._parameter(i) for i, p in enumerate(self.effect.parameters)} | {DT: "dt"}
        leaves |= {s.symbol: self._state(i) for i, s in enumerate(self.effect.states)}
        leaves |= {s.symbol: f"{s.name}[{at}]" for s in self.effect.signals}
        taken = _TAKEN | {f"next{i}" for i in range(len(self.effect.states))}
        return Printer(self.precision.language, tape, leaves, taken).print()

    def _each_lane(self, lines: list[str]) -> list[str]:
        return lines

    def _parameter(self, i: int) -> str:
        return f"p[{i}]"

    def _state(self, i: int) -> str:
        return f"x[{i}]"

    def _out(self, i: int) -> str:
        return f"out[({self.rows}U * at + {i}U) * count + k]"


@dataclass(frozen=True)
class _AtOnce(_AlongSamples):
    """The same for LANES choices of parameters."""

    def routine(self) -> Routine:
        kind, width = self.precision.kind, len(self.effect.parameters)
        own = [f"for (size_t i = 0; i < {width}; ++i) {{", f"    own[i][j] = p[{width} * j + i];", "}"]
        body = [
            *([] if DT in self._read else ["(void)dt;"]),
            f"{kind} own[{width}][{LANES}];",
            f"{kind} x[{len(self.effect.states)}][{LANES}];",
            *("if (count == 0U) {", "    return;", "}"),
            *_block(_EACH_LANE, own),
            *self._at_joints(),
        ]
        what = f"{self.function.name} of {LANES} choices of parameters, p ({LANES}, {width})"
        note = comment(f"{what}; out (joints, {self.rows}, count, {LANES}).")
        return Routine(note, self._declared("at_once"), indent(body, 1))

    def _each_lane(self, lines: list[str]) -> list[str]:
        return [LOOP, *_block(_EACH_LANE, lines)]

    def _parameter(self, i: int) -> str:
        return f"own[{i}][j]"

    def _state(self, i: int) -> str:
        return f"x[{i}][j]"

    def _out(self, i: int) -> str:
        return f"out[(({self.rows}U * at + {i}U) * count + k) * {LANES}U + j]"


def _leaves(tape: Tape) -> set[object]:
    return {node.value for node in tape.nodes if node.op == "leaf"}


def _block(head: str, lines: list[str]) -> list[str]:
    return [head, *(f"    {line}" for line in lines), "}"]
