"""C99 of the effects library: functions that take what an effect reads by name, and nothing else.

The signals come first, then the step, then the parameters, and last the memory, in a struct of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from codegen import effect_functions as ef
from codegen.c.c_code import Precision, Routine, assign, comment, declaration, describe, indent
from codegen.c.language import identifier, word
from codegen.tape.printers import Printer
from codegen.tape.tape import Tape
from symbolic.effects.declaration import DT, Effect
from symbolic.functions import Argument, SymbolicFunction

HEAD = comment(
    "What each effect adds to the motor torque of a joint, on the motor's side: friction has the sign of qd.",
    "Units are those of a revolute joint; at a prismatic one N stands for N m, and m for rad.",
    "An effect with a memory: _start before the first sample, then for every sample _torque and, after it, _step.",
)


@dataclass(frozen=True)
class Signature:
    """Scalars by value, in order; state: whether the struct of the states comes after them, and is written."""

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
    """What a function takes: of all that an effect may read, what its tape does."""
    read = {node.value for node in tape.nodes if node.op == "leaf"}
    return Signature(
        tuple(a for a in _scalars(effect) if a.symbols[0] in read),
        bool(read & {s.symbol for s in effect.states}),
        function.outputs[0].name == "x_next",
    )


def _scalars(effect: Effect) -> list[Argument]:
    """Signals, step and parameters; a parameter that is called as one of the others says that it is a parameter."""
    signals = [Argument(s.name, (s.symbol,), (), s.unit.text(), s.meaning) for s in effect.signals]
    signals.append(Argument("dt", (DT,), (), "s", "step"))
    taken = {a.name for a in signals} | {"state"}
    names = {p.name: f"{p.name}_parameter" if p.name in taken else p.name for p in effect.parameters}
    return signals + [Argument(names[p.name], (p.symbol,), (), p.unit.text(), p.meaning) for p in effect.parameters]


def _state_type(effect: Effect, precision: Precision) -> str:
    return f"tendon_{effect.name}_state_{precision.suffix}"


def types(effects: Sequence[Effect], precision: Precision) -> list[str]:
    """A struct of the states for every effect that has a memory."""
    return [HEAD, *(_struct(effect, precision) for effect in effects if effect.states)]


def _struct(effect: Effect, precision: Precision) -> str:
    fields = [f"    {precision.kind} {s.name}; {comment(f'{s.unit.text()}: {s.meaning}')}" for s in effect.states]
    note = comment(f"The memory of {effect.name}.")
    return "\n".join([note, "typedef struct {", *fields, f"}} {_state_type(effect, precision)};"])


def routines(effect: Effect, precision: Precision) -> list[Routine]:
    """Torque a call, and step and start for an effect with states."""
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
        arguments.append(f"{_state_type(effect, precision)} *state")
    else:
        lines.append(f"return {texts[0]};")
        arguments += [f"const {_state_type(effect, precision)} *state"] * takes.reads_state
    head = f"{'void' if takes.writes_state else precision.kind} tendon_{function.name}_{precision.suffix}"
    return Routine(_comment(effect, function, takes, tape), declaration(head, arguments or ["void"]), indent(lines, 1))


def _stored(effect: Effect, texts: list[str], together: bool, precision: Precision) -> list[str]:
    """together: all next states are computed before the first is written."""
    targets = [f"state->{s.name}" for s in effect.states]
    if not together or len(targets) == 1:
        return assign(targets, texts)
    names = [f"next_{s.name}" for s in effect.states]
    return [precision.language.assign(*pair) for pair in zip(names, texts, strict=True)] + assign(targets, names)


def _comment(effect: Effect, function: SymbolicFunction, takes: Signature, tape: Tape) -> str:
    """The function as its C has it, described."""
    names, units = ", ".join(s.name for s in effect.states), ", ".join(s.unit.text() for s in effect.states)
    memory = Argument("state", tuple(s.symbol for s in effect.states), (), units, names)
    inputs = takes.inputs + ((memory,) if takes.reads_state else ())
    outputs = function.outputs
    if takes.writes_state:
        outputs = (replace(outputs[0], name="state", shape=(), unit=units, meaning=f"{names}: {outputs[0].meaning}"),)
    return describe(replace(function, inputs=inputs, outputs=outputs), tape)
