"""CasADi code of symbolic functions, with smooth switches of given width, and tables of parameters."""

from __future__ import annotations

import json
import keyword
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from codegen.c.c_code import description, legend
from codegen.pages import page
from codegen.tape.printers import Language, Printer, float64
from codegen.tape.tape import Tape
from symbolic import units as u
from symbolic.effects.declaration import Effect, Parameter, State
from symbolic.functions import Argument, Output, Struct, SymbolicFunction
from symbolic.model import ArmModel
from symbolic.model_file.arm import Joint
from symbolic.primitives import WIDTHS

_CALLS = {
    "exp": "ca.exp",
    "log": "ca.log",
    "sqrt": "ca.sqrt",
    "abs": "ca.fabs",
    "atan2": "ca.atan2",
    "max": "ca.fmax",
    "min": "ca.fmin",
    "sgn": "ca.sign",
    "pow": "_power",
    "rise": "_rise",
    "ramp": "ca.fmax",
}
"""Names that begin with _ are defined in the template."""
_FURTHER = {"ramp": ("0",)}
"""Arguments of a call that the operation does not have."""


def _pair(sine: str | None, cosine: str | None, angle: str) -> list[str]:
    lines = [f"{sine} = ca.sin({angle})"] if sine else []
    return lines + ([f"{cosine} = ca.cos({angle})"] if cosine else [])


CASADI = Language(
    literal=float64,
    call=lambda op, arguments: f"{_CALLS[op]}({', '.join([*arguments, *_FURTHER.get(op, ())])})",
    pair=_pair,
    assign=lambda name, text: f"{name} = {text}",
    reserved=frozenset(keyword.kwlist) | {"ca"},
)


WIDTH_UNITS = {"rate": u.RATE, "position": u.POSITION, "force": u.FORCE, "time": u.SECOND}
"""Units of the switches' widths, in the order of primitives.WIDTHS."""
WIDTH = Argument(
    "width",
    WIDTHS,
    (len(WIDTHS),),
    unit=", ".join(unit.text() for unit in WIDTH_UNITS.values()),
    meaning=f"half widths of the switches in {', '.join(WIDTH_UNITS)}",
)


@dataclass(frozen=True)
class Builder:
    """A Python function without arguments that returns a casadi.Function."""

    name: str
    doc: str
    body: str


def builder(function: SymbolicFunction, widths: bool = False, tape: Tape | None = None) -> Builder:
    """The builder of a function. widths: the last input is WIDTH, the widths of the switches."""
    tape = tape or Tape.of(function, "smooth")
    inputs = [*function.arguments, *([WIDTH] if widths else [])]
    leaves: dict[sp.Symbol, str] = {}
    lines = []
    for a in inputs:
        lines.append(_symbol(a.name, a.shape))
        # Elements with the name of an argument are spelt by their index.
        named = _has_names(a) and not {s.name for s in a.symbols} & {other.name for other in inputs}
        leaves |= dict(
            zip(a.symbols, [s.name for s in a.symbols] if named else _elements(a.name, a.shape), strict=True)
        )
        if named:
            lines += _unpacked(a)
    names, outputs = [a.name for a in inputs], [o.name for o in function.outputs]
    taken = frozenset(names) | {text for text in leaves.values() if text.isidentifier()} | set(outputs)
    statements, texts = Printer(CASADI, tape, leaves, taken).print()
    lines += statements
    for output in function.outputs:
        count = len(output.expressions)
        lines.append(f"{output.name} = {_output(output, texts[:count])}")
        texts = texts[count:]
    quoted = [", ".join(f'"{name}"' for name in group) for group in (names, outputs)]
    lines.append(f"inputs, outputs = [{', '.join(names)}], [{', '.join(outputs)}]")
    lines.append(f'return ca.Function("{function.name}", inputs, outputs, [{quoted[0]}], [{quoted[1]}])')
    return Builder(function.name, _doc(function, inputs, tape), "\n".join("    " + line for line in lines))


def _has_names(argument: Argument) -> bool:
    return argument.name in ("parameters", "p", "x", "width") and bool(argument.symbols)


def _unpacked(argument: Argument) -> list[str]:
    """The statement that assigns the elements of a vector to names."""
    names = ", ".join(s.name for s in argument.symbols)
    # Lines may only end after the names' commas.
    text = f"({names}{',' if len(argument.symbols) == 1 else ''})~=~ca.vertsplit({argument.name})"
    return [line.replace("~", " ") for line in textwrap.wrap(text, 112, subsequent_indent="    ")]


def _symbol(name: str, shape: tuple[int, ...]) -> str:
    size = "".join(f", {n}" for n in shape)
    return f'{name} = ca.SX.sym("{name}"{size})'


def _elements(name: str, shape: tuple[int, ...]) -> list[str]:
    """Elements by index; with two indices, as CasADi is column-major and a SymbolicFunction row-major."""
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


def _doc(function: SymbolicFunction, inputs: list[Argument], tape: Tape) -> str:
    """A wrapped docstring; quotes and backslashes in the text are replaced."""
    names = legend(function, tape)
    lines = [*description(function, inputs, tape), *([f"Names: {names}"] if names else [])]
    wrapped = [
        part
        for line in lines
        for part in textwrap.wrap(line.replace("\\", "/").replace('"', "'"), 112, subsequent_indent="  ")
    ]
    return '"""' + "\n    ".join(wrapped) + '\n    """'


def arm_tables(model: ArmModel) -> str:
    """PARAMETERS, JOINTS, EFFECTS and parameters() of an arm."""
    arm, struct = model.arm, model.struct
    contact = {} if arm.contact is None else arm.contact.effects
    return page(
        "casadi/arm_tables.py.j2",
        name=arm.name,
        count=len(struct.symbols),
        example=struct.symbols[0].name,
        parameters=_struct(struct),
        joints=[_entry(_joint(joint)) for joint in arm.joints],
        effects=_rows({**arm.effects, **contact}),
    ).rstrip()


def effect_tables(effects: Sequence[Effect]) -> str:
    """PARAMETERS, STATES, WIDTHS, parameters() and widths() of the library."""
    return page(
        "casadi/effect_tables.py.j2",
        parameters=[_group(e.name, map(_parameter, e.parameters)) for e in effects],
        states=[_group(e.name, map(_quantity, e.states)) for e in effects if e.states],
        widths=[f'"{name}": {literal(unit.text())},' for name, unit in WIDTH_UNITS.items()],
        arguments=", ".join(WIDTH_UNITS),
    ).rstrip()


def literal(value: Any) -> str:
    """A value of JSON as Python writes it."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{literal(k)}: {literal(v)}" for k, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "(" + ", ".join(map(literal, value)) + ("," if len(value) == 1 else "") + ")"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)


def _struct(struct: Struct) -> list[str]:
    rows = zip(struct.symbols, struct.defaults, struct.units, struct.meanings, strict=True)
    return [f"{literal(s.name)}: {literal((value, unit, text))}," for s, value, unit, text in rows]


def _joint(joint: Joint) -> dict[str, object]:
    limits = joint.limits
    return {
        "type": joint.type,
        "gear_ratio": joint.gear_ratio,
        "position_limits": limits.position,
        "speed_limit": limits.speed,
        "torque_limit": limits.torque,
        "effects": {name: dict(values) for name, values in joint.effects.items()},
    }


def _entry(data: Mapping[str, Any]) -> list[str]:
    *plain, (name, last) = data.items()
    rows = [f"{literal(k)}: {literal(v)}," for k, v in plain]
    return [*rows, f"{literal(name)}: {{", *(f"    {row}" for row in _rows(last)), "},"]


def _rows(data: Mapping[str, Any]) -> list[str]:
    return [f"{literal(k)}: {literal(v)}," for k, v in data.items()]


def _group(name: str, rows: Iterable[str]) -> list[str]:
    return [f"{literal(name)}: {{", *(f"    {row}" for row in rows), "},"]


def _quantity(quantity: Parameter | State) -> str:
    return f"{literal(quantity.name)}: {literal((quantity.unit.text(), quantity.meaning))},"


def _parameter(parameter: Parameter) -> str:
    return f"{literal(parameter.name)}: {literal((parameter.unit.text(), parameter.meaning, parameter.default))},"
