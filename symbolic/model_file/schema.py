"""JSON schemas of the files that users write, for editors, from the same declarations by which they are read.

A schema says which keys there are, what kind of value stands under each and within which range; what depends on several
values at once (a friction's name that fits its joint, parts that add up to 1) is the reader's to say.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, Any

from symbolic.model_file import fields as f
from symbolic.model_file import keys
from symbolic.model_file import tables as t
from symbolic.model_file.checks import MAX_LABEL, MAX_NAME

if TYPE_CHECKING:
    from symbolic.effects.declaration import Effect

Schema = dict[str, Any]

DRAFT = "http://json-schema.org/draft-07/schema#"
_NAME: Schema = {"type": "string", "pattern": "^[A-Za-z_][A-Za-z0-9_]*$", "maxLength": MAX_NAME}
_NUMBERS: Schema = {"type": "object", "additionalProperties": {"type": "number"}}
_LINES = r"(_([2-9]|[1-9][0-9]+))?$"
"""Behind the name of an effect that a joint may have several of."""


def table(fields: Sequence[f.Field]) -> Schema:
    """Of a table with these keys and no others."""
    own = [field for field in fields if not isinstance(field, f.Misplaced)]
    made: Schema = {
        "type": "object",
        "properties": {},
        "additionalProperties": False,
        "required": [field.key for field in own if field.default is f.REQUIRED],
    }
    for field in own:
        if isinstance(field, t.PerJoint):
            made["patternProperties"] = {r"^q[1-9]\d?$": _said(field, value(field.kind(field.key, field.meaning)))}
        elif isinstance(field, t.Others):
            made["additionalProperties"] = _said(field, value(field.kind(field.key, field.meaning)))
        else:
            made["properties"][field.key] = _said(field, value(field))
    return made


def _said(field: f.Field, schema: Schema) -> Schema:
    """With what an editor shows beside the key."""
    row = next(iter(field.rows("")), None)
    unit = field.unit if isinstance(field.unit, str) else f"{field.unit[0]} ({field.unit[1]})"
    default = row.default if row is not None and field.default not in (f.REQUIRED, None, {}) else ""
    parts = [field.meaning, *([unit] if unit else []), *([f"default: {default}"] if default else [])]
    return {**schema, "description": "; ".join(parts)}


@singledispatch
def value(field: f.Field) -> Schema:
    """What may stand under a key."""
    raise TypeError(f"{type(field).__name__} has no schema")


@value.register
def _(field: f.Real) -> Schema:
    limits: Schema = {"type": "number"}
    if field.positive:
        limits["exclusiveMinimum"] = 0
    elif math.isfinite(field.low):
        limits["minimum"] = field.low
    if math.isfinite(field.high):
        limits["maximum"] = field.high
    return limits


@value.register
def _(field: f.WholeNumber) -> Schema:
    return {**value.dispatch(f.Real)(field), "type": "integer"}


@value.register
def _(field: f.Numbers) -> Schema:
    return {"type": "array", "items": value.dispatch(f.Real)(field)}


@value.register
def _(field: f.Whole) -> Schema:
    return {"type": "integer", "minimum": field.low, "maximum": field.high}


@value.register
def _(field: f.Choice) -> Schema:
    return {"enum": list(field.values)}


@value.register
def _(_: f.Flag) -> Schema:
    return {"type": "boolean"}


@value.register
def _(_: f.Text) -> Schema:
    return {"type": "string"}


@value.register
def _(_: f.Name) -> Schema:
    return dict(_NAME)


@value.register
def _(_: f.Label) -> Schema:
    return {"type": "string", "pattern": r"^[A-Za-z0-9_][A-Za-z0-9_ .:/()-]*$", "maxLength": MAX_LABEL}


def _row(count: int) -> Schema:
    return {"type": "array", "items": {"type": "number"}, "minItems": count, "maxItems": count}


@value.register
def _(_: f.Pair) -> Schema:
    return _row(2)


@value.register
def _(_: f.Bounds) -> Schema:
    return {"anyOf": [{"type": "number"}, _row(2)]}


@value.register
def _(field: f.NumberRow) -> Schema:
    return _row(len(field.names))


@value.register
def _(_: f.JointNumbers) -> Schema:
    return {"type": "array", "items": {"type": "integer", "minimum": 1}, "uniqueItems": True}


@value.register
def _(_: t.OpenTable) -> Schema:
    return {"type": "object", "additionalProperties": dict(_NUMBERS)}


@value.register
def _(_: t.NamedNumbers) -> Schema:
    return {**_NUMBERS, "propertyNames": dict(_NAME)}


@value.register
def _(field: t.Inner) -> Schema:
    return table(field.fields)


@value.register
def _(field: t.Named) -> Schema:
    return {"type": "object", "additionalProperties": table(field.fields), "propertyNames": dict(_NAME)}


@value.register
def _(field: t.Several) -> Schema:
    return {"type": "array", "items": table(field.fields)}


@value.register
def _(field: keys.Joints) -> Schema:
    return {"type": "array", "items": table(field.fields), "minItems": 1, "maxItems": keys.MAX_JOINTS}


# --- whole files ---


def model_schema(planar: Mapping[str, Effect], spatial: Mapping[str, Effect]) -> Schema:
    """Of model files; with the effects by name of an arm in the plane, and of one in space. A name that none of them
    has may be one of the user's own, and stands for a table of numbers."""
    kinds = {"planar": _arm(keys.PLANAR, planar.values()), "spatial": _arm(keys.SPATIAL, spatial.values())}
    refer = {kind: {"$ref": f"#/definitions/{kind}"} for kind in kinds}
    in_space = {"properties": {"gravity": {"type": "array", "minItems": 3}}, "required": ["gravity"]}
    return {
        "$schema": DRAFT,
        "title": "Tendon: model file of a robot arm",
        "if": in_space,
        "then": refer["spatial"],
        "else": refer["planar"],
        # Forbids nothing: where editors look for keys to propose, which do not follow the condition.
        "anyOf": [*refer.values(), True],
        "definitions": kinds,
    }


def file_schema(title: str, fields: Sequence[f.Field]) -> Schema:
    """Of a file whose keys do not depend on each other."""
    return {"$schema": DRAFT, "title": title, **table(fields)}


def _arm(fields: Sequence[f.Field], effects: Iterable[Effect]) -> Schema:
    known = tuple(effects)
    made = table(fields)
    own = made["properties"]
    own["effects"] |= _effects(known, ("arm",))
    own["joint"]["items"]["properties"]["effects"] |= _effects(known, ("joint", "joints"))
    if "contact" in own:
        own["contact"]["properties"]["effects"] |= _effects(known, ("contact",))
    return made


def _effects(known: Sequence[Effect], scopes: Sequence[str]) -> Schema:
    """The effects that may stand in a table; each with its parameters, all of which may be left out."""
    here = [effect for effect in known if effect.scope in scopes]
    elsewhere = "|".join(effect.name for effect in known if effect.scope not in scopes)
    made: Schema = {
        "properties": {effect.name: _effect(effect) for effect in here if not effect.several},
        "patternProperties": {f"^{effect.name}{_LINES}": _effect(effect) for effect in here if effect.several},
    }
    return {**made, "propertyNames": {"not": {"pattern": f"^({elsewhere})$"}}} if elsewhere else made


def _effect(effect: Effect) -> Schema:
    return {
        "type": "object",
        "description": effect.summary,
        "properties": {
            p.name: {"type": "number", "description": f"{p.meaning}; {p.unit.text('revolute')}", **_bounds(*p.bounds)}
            for p in effect.parameters
        },
        "additionalProperties": False,
    }


def _bounds(low: float, high: float) -> Schema:
    return {key: x for key, x in (("minimum", low), ("maximum", high)) if math.isfinite(x)}
