"""What a CasADi module says of its parameters, as Python literals: names, values of the model file, units, meanings."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from codegen.casadi.casadi_code import WIDTH_UNITS
from codegen.pages import page
from symbolic.effects.declaration import Effect, Parameter, State
from symbolic.functions import Struct
from symbolic.model import ArmModel
from symbolic.model_file.arm import Joint


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


def _joint(joint: Joint) -> dict[str, Any]:
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
    """A dictionary, a line an item; the items of the last value on lines of their own."""
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
