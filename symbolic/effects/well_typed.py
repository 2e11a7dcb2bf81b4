"""Whether a declaration of a user's own has in every field what the field is declared to hold: Python does not look."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Final, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import sympy as sp

from symbolic.described import Grid, UnitOfJoint
from symbolic.effects.declaration import Effect, Parameter
from symbolic.units import Unit

LONGEST_NAME: Final = 63
"""letters; C tells names by as many at least; C99 5.2.4.1."""

MOST_VALUES: Final = 200
"""values of a grid; each is a column along the whole recording, and the library takes some twenty; a choice."""

_NOT_DECLARED = ("gives_way",)
"""Set by the declaration itself."""


def mistake(effect: Effect) -> str | None:
    """The first thing that is wrong with the fields of a declaration, in one sentence; None where nothing is."""
    where = f"effect {_shown(effect.name)}"
    return next(_mistyped(effect, where), None) or next(_out_of_range(effect, where), None)


def _mistyped(value: Any, where: str) -> Iterator[str]:
    """Of the fields of a data class, and of what they consist of."""
    for name, hint in _hints(value.__class__).items():
        if name not in _NOT_DECLARED:
            yield from _mistake(getattr(value, name), hint, f"{where}: {name}")


@cache
def _hints(shape: type[Any]) -> dict[str, Any]:
    hints = get_type_hints(shape)
    return {f.name: hints[f.name] for f in fields(shape)}


def _mistake(value: Any, hint: Any, where: str) -> Iterator[str]:
    hint = Parameter if isinstance(hint, TypeVar) else hint
    if get_origin(hint) in (Union, UnionType):
        if value is None and NoneType in get_args(hint):
            return
        (hint,) = (kind for kind in get_args(hint) if kind is not NoneType)
    arguments = get_args(hint)
    if get_origin(hint) is Literal:
        if not isinstance(value, str) or value not in arguments:
            yield f"{where} is {_shown(value)}; expected {' or '.join(map(repr, arguments))}"
    elif get_origin(hint) is tuple:
        yield from _of_tuple(value, arguments, where)
    elif hint is sp.Expr:
        if isinstance(value, bool) or not isinstance(value, int | float | sp.Expr):
            yield f"{where} is {_shown(value)}; expected an expression of SymPy"
    elif is_dataclass(hint) and hint is not Unit:
        if type(value) is not hint:
            yield f"{where} is {_shown(value)}; expected {_word(hint)}(...)"
        else:
            yield from _mistyped(value, where)
    elif not _is_plain(value, hint):
        yield f"{where} is {_shown(value)}; expected {_EXPECTED.get(hint, _word(hint))}"


def _of_tuple(value: Any, arguments: tuple[Any, ...], where: str) -> Iterator[str]:
    if not isinstance(value, tuple):
        yield f"{where} is {_shown(value)}; expected a tuple: one of one item is written (item,)"
        return
    kinds = arguments[:1] * len(value) if arguments[-1] is Ellipsis else arguments
    if len(kinds) != len(value):
        yield f"{where} has {len(value)} items; expected {len(kinds)}"
        return
    for k, (each, kind) in enumerate(zip(value, kinds, strict=True), 1):
        yield from _mistake(each, kind, f"{where} item {k}")


_EXPECTED = {str: "a text", bool: "True or False", int: "a whole number", float: "a number", Unit: "a unit"}


def _is_plain(value: Any, hint: Any) -> bool:
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and not math.isnan(value)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return isinstance(value, Unit if hint is UnitOfJoint else hint)


def _out_of_range(effect: Effect, where: str) -> Iterator[str]:
    """Of what has the right types: names, bounds and grids that cannot be meant."""
    coefficients = effect.form.coefficients if effect.form else ()
    names = [effect.name, *(p.name for p in (*effect.parameters, *coefficients)), *(s.name for s in effect.states)]
    for name in names:
        if len(name) > LONGEST_NAME:
            yield f"{where}: {_shown(name)} has {len(name)} letters; expected at most {LONGEST_NAME}"
    for p in (*effect.parameters, *coefficients):
        if not p.bounds[0] < p.bounds[1]:
            yield f"{where}: {p.name}: bounds are {p.bounds}; expected the smaller one first"
        if p.grid is not None:
            yield from _of_grid(p.grid, f"{where}: {p.name}")


def _of_grid(grid: Grid, where: str) -> Iterator[str]:
    if not 1 <= grid.count <= MOST_VALUES:
        yield f"{where}: grid has {grid.count} values; expected 1 to {MOST_VALUES}"
    if not (math.isfinite(grid.low) and math.isfinite(grid.high) and grid.low <= grid.high):
        yield f"{where}: grid goes from {grid.low} to {grid.high}; expected finite numbers, the smaller one first"
    if grid.spacing == "log" and not grid.low > 0:
        yield f"{where}: grid begins at {grid.low}, spaced as its logarithm; expected more than 0, or spacing='linear'"


def _word(kind: Any) -> str:
    return str(kind.__name__)


def _shown(value: Any) -> str:
    """What was found, in a word."""
    return repr(value)[:40] if isinstance(value, str | int | float | bool | NoneType) else f"a {type(value).__name__}"
