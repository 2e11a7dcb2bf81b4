"""The declaration of an effect, from which everything else is generated, and the checks of a user's declaration.

The torque is an expression in SIGNALS, the effect's parameters and its states. Torques are those of the motor
(tau_m = D qdd + C qd + g + sum of effects): friction has the sign of qd, and a spring that pulls the joint forward is
negative. Parameters with role "linear" are solved exactly by identification, "shape" ones are searched on a grid,
"given" ones come from the model file or their default, because motion cannot identify them. A LinearForm states
coefficients in which the torque is linear where the declared parameters are not such: k (q - q0).
"""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass, replace
from types import NoneType, UnionType
from typing import Any, Final, Literal, TypeVar, Union, get_args, get_origin

import sympy as sp

from symbolic import units as u
from symbolic.described import DescribedEffect, DescribedParameter, Grid, UnitOfJoint, field_types
from symbolic.effects.signals import SIGNAL as SIGNAL
from symbolic.effects.signals import SIGNALS, Signal
from symbolic.elements import Element, converted
from symbolic.primitives import WIDTHS
from symbolic.units import Unit

DT = sp.Symbol("dt", positive=True)
"""Step of the recursion of effects with memory, s."""


@dataclass(frozen=True)
class Parameter(DescribedParameter):
    """A parameter of an effect, with its symbol."""

    unit: u.Unit

    @property
    def symbol(self) -> sp.Symbol:
        """Its symbol in a law."""
        return parameter(self.name)


def parameter(name: str) -> sp.Symbol:
    """The symbol of an effect's parameter."""
    return sp.Symbol(f"p_{name}", real=True)


@dataclass(frozen=True)
class State:
    """Memory of an effect.

    step      the next value, from this sample's states and signals and dt; a sample's torque is evaluated before it
    initial   may use the first sample's signals and the parameters, so that a recording may begin in equilibrium
    kind      "deflection": motor angle minus link angle, which a link-side encoder measures
    """

    name: str
    unit: u.Unit
    meaning: str
    step: sp.Expr
    initial: sp.Expr = sp.S.Zero
    kind: Literal["", "deflection"] = ""

    @property
    def symbol(self) -> sp.Symbol:
        """Its symbol in a law: the value before this sample's step."""
        return state(self.name)


def state(name: str) -> sp.Symbol:
    """The symbol of an effect's state."""
    return sp.Symbol(f"x_{name}", real=True)


@dataclass(frozen=True)
class LinearForm:
    """An effect's torque, linear in coefficients that are not its declared parameters.

    coefficients      each with unit and bounds; there may be more of them than linear parameters
    torque            the effect's torque, in `parameter(name)` of the coefficients
    from_parameters   the coefficients' values, in the effect's parameters
    recover           the linear parameters' values in declared order, in the coefficients and the other parameters
    """

    coefficients: tuple[Parameter, ...]
    torque: sp.Expr
    from_parameters: tuple[sp.Expr, ...]
    recover: tuple[sp.Expr, ...]


def _without(law: sp.Expr, parameters: Iterable[Parameter]) -> sp.Expr:
    return sp.sympify(law).xreplace({p.symbol: sp.S.Zero for p in parameters if p.space})


@dataclass(frozen=True, kw_only=True)
class Effect(DescribedEffect[Parameter]):
    """One physical effect: its description and its equations.

    torque   added to the motor torque of the joint whose signals are given
    states   memory; empty for a static effect
    form     coefficients in which the torque is linear, if these are not the linear parameters
    elements what its law is the sum of in simulators, in the parameters; empty: simulators have nothing like it
    """

    torque: sp.Expr
    states: tuple[State, ...] = ()
    form: LinearForm | None = None
    elements: tuple[Element, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "gives_way", any(s.between for s in self.signals))

    @property
    def coefficients(self) -> tuple[Parameter, ...]:
        """The unknowns of identification, (k,): the form's coefficients, otherwise the linear parameters."""
        return self.form.coefficients if self.form else self.linear

    @functools.cached_property
    def signals(self) -> tuple[Signal, ...]:
        """The signals that it reads, in the order of SIGNALS."""
        used = _symbols(self)
        return tuple(s for s in SIGNALS if s.symbol in used)

    @property
    def deflection(self) -> str | None:
        """The name of the state that a link-side encoder measures, or None."""
        return next((s.name for s in self.states if s.kind == "deflection"), None)

    @property
    def columns(self) -> tuple[sp.Expr, ...]:
        """The effect's regressor, (k,): derivatives of the torque by the coefficients."""
        return tuple(sp.diff(self._linear_torque, c.symbol) for c in self.coefficients)

    @property
    def fixed(self) -> sp.Expr:
        """The torque with all coefficients at zero; 0 for most effects."""
        return self._linear_torque.subs({c.symbol: 0 for c in self.coefficients})

    @property
    def _linear_torque(self) -> sp.Expr:
        return self.form.torque if self.form else self.torque

    def elements_at(self, values: Mapping[str, float]) -> tuple[Element, ...]:
        """The elements in numbers. values: of the parameters; those that are given may be left out."""
        known = {p.symbol: values.get(p.name, p.default) for p in self.parameters}
        return tuple(converted(e, lambda law: float(sp.sympify(law).subs(known))) for e in self.elements)

    def in_plane(self) -> Effect:
        """The effect on a planar arm: parameters that only spatial arms have are zero and omitted.

        Raises ValueError if it still reads a signal that only spatial arms have.
        """
        kept = tuple(p for p in self.parameters if not p.space)
        torque = _without(self.torque, self.parameters)
        elements = tuple(converted(e, lambda law: _without(law, self.parameters)) for e in self.elements)
        effect = replace(self, parameters=kept, torque=torque, form=self._form_in_plane(torque), elements=elements)
        if self.known_size is not None and any(p.space for p in self.linear):
            effect = replace(effect, known_size=replace(self.known_size, at_most=True))
        if beyond := [s.name for s in effect.signals if s.space]:
            raise ValueError(f'effect "{self.name}" reads {beyond[0]}, which only a spatial arm has')
        return effect

    def _form_in_plane(self, torque: sp.Expr) -> LinearForm | None:
        """The form for the planar torque; None if that is linear in the parameters themselves."""
        if self.form is None or (left := _without(self.form.torque, self.form.coefficients)) == torque:
            return None
        there = zip(self.form.coefficients, self.form.from_parameters, strict=True)
        back = zip(self.linear, self.form.recover, strict=True)
        return LinearForm(
            coefficients=tuple(c for c in self.form.coefficients if not c.space),
            torque=left,
            from_parameters=tuple(_without(law, self.parameters) for c, law in there if not c.space),
            recover=tuple(_without(law, self.form.coefficients) for p, law in back if not p.space),
        )


_NAME = re.compile(r"[a-z][a-z0-9_]*")


def check(effect: Effect) -> None:
    """Raise ValueError if a declaration contradicts itself."""
    if wrong := next(_contradictions(effect), None):
        raise ValueError(f'effect "{effect.name}"{wrong}')


def _contradictions(effect: Effect) -> Iterator[str]:
    for kind, named in (
        ("parameter", effect.parameters),
        ("coefficient", effect.coefficients),
        ("state", effect.states),
        ("effect", (effect,)),
    ):
        names = [each.name for each in named]
        if wrong := [name for name in names if not _NAME.fullmatch(name)]:
            yield f': {kind} "{wrong[0]}" must be lower-case letters, digits and _'
        if len(set(names)) < len(names):
            yield f" names a {kind} twice"
    known = {s.symbol for s in SIGNALS} | set(WIDTHS)
    known |= {p.symbol for p in effect.parameters} | {s.symbol for s in effect.states}
    steps = _union(s.step for s in effect.states)
    if unknown := _symbols(effect) - known - (steps & {DT}):
        uses = ", ".join(sorted(s.name for s in unknown))
        yield f" uses {uses}, which is neither a signal, a parameter nor a state"
    fields = _union(getattr(element, f.name) for element in effect.elements for f in dataclasses.fields(element))
    if strange := fields - {p.symbol for p in effect.parameters}:
        yield f": its elements use {', '.join(sorted(s.name for s in strange))}; expected its parameters alone"
    coefficients = {c.symbol for c in effect.coefficients}
    if any(column.free_symbols & coefficients for column in effect.columns):
        yield " is not linear in all of its linear parameters"
    for p in effect.parameters:
        if (p.role == "shape") != (p.grid is not None):
            yield f': "{p.name}" needs a grid if and only if its role is "shape"'
        if p.default is None if p.role == "given" else p.role == "linear" and p.default is not None:
            yield f': "{p.name}" needs a default where its role is "given", and has none where it is "linear"'
    yield from _unfit_roles(effect)
    if form := effect.form:
        if len(form.coefficients) != len(form.from_parameters) or len(form.recover) != len(effect.linear):
            yield ": its form needs an expression for each coefficient, and one back for each linear parameter"
        there = dict(zip((c.symbol for c in form.coefficients), form.from_parameters, strict=True))
        if sp.simplify(form.torque.subs(there, simultaneous=True) - effect.torque) != 0:
            yield ": its form is not the same torque"


def _unfit_roles(effect: Effect) -> Iterator[str]:
    """Contradictions between fields on which other rooms rely."""
    if effect.has_gap and not effect.gives_way:
        yield " has a gap but reads no signal of a compliant transmission"
    beside = [s.name for s in effect.signals if s.needs not in ("motion", "time", "effect")]
    if effect.carried and (beside or effect.states):
        what = f"reads {beside[0]}" if beside else "has a memory"
        yield f" is carried by the transmission, a part of its load, and {what}"
    sizes = [p.name for p in effect.parameters if p.planned == "size"]
    if effect.brought and effect.scope == "joint" and len(sizes) != 1:
        yield ' is planned with: exactly one parameter must be its planned="size"'
    for p in effect.parameters:
        needs = {"critical": "stiffness", "end": "side"}.get(p.grid.of, "") if p.grid else ""
        if needs and not any(other.kind == needs for other in effect.parameters):
            yield f': the grid of "{p.name}" needs a parameter of kind "{needs}"'


def _symbols(effect: Effect) -> set[sp.Symbol]:
    return _union([effect.torque, *(s.step for s in effect.states), *(s.initial for s in effect.states)])


def _union(expressions: Iterable[sp.Expr]) -> set[sp.Symbol]:
    """The symbols of the expressions; unlike free_symbols, shared parts are visited once."""
    seen: set[sp.Basic] = set()
    todo: list[sp.Basic] = list(map(sp.sympify, expressions))
    while todo:
        e = todo.pop()
        if e not in seen:
            seen.add(e)
            todo += e.args
    return {e for e in seen if isinstance(e, sp.Symbol)}


_OPERATORS = {sp.Add: "add", sp.Mul: "mul", sp.Pow: "pow", sp.atan2: "atan2", sp.cos: "cos", sp.sin: "sin"}


def prefix(expr: sp.Expr) -> Any:
    """`expr` as JSON: a number, a parameter's name, or [operator, argument...].

    Operators: add, mul (any number of arguments), pow, atan2 (two), cos, sin (one). Raises ValueError for any other.
    """
    if expr.is_Number:
        return float(expr)
    if expr.is_Symbol:
        return expr.name.removeprefix("p_")
    if expr.func not in _OPERATORS:
        allowed = "+, *, powers, atan2, cos and sin"
        raise ValueError(f"{expr.func.__name__} cannot stand in the form of an effect; use {allowed}")
    return [_OPERATORS[expr.func], *map(prefix, expr.args)]


LONGEST_NAME: Final = 63
"""characters; C distinguishes names by at least as many; C99 5.2.4.1."""

MOST_VALUES: Final = 200
"""values of a grid; each is a column over the whole recording, and the library uses some twenty; a choice."""

_NOT_DECLARED = ("gives_way",)
"""Set by the declaration itself."""


def mistake(effect: Effect) -> str | None:
    """The first invalid field of a declaration, in one sentence, or None: Python does not check types itself."""
    where = f"effect {_shown(effect.name)}"
    return next(_mistyped(effect, where), None) or next(_out_of_range(effect, where), None)


def _mistyped(value: Any, where: str) -> Iterator[str]:
    for name, hint in field_types(value.__class__).items():
        if name not in _NOT_DECLARED:
            yield from _mistake(getattr(value, name), hint, f"{where}: {name}")


def _mistake(value: Any, hint: Any, where: str) -> Iterator[str]:
    hint = Parameter if isinstance(hint, TypeVar) else sp.Expr if hint is Any else hint
    if get_origin(hint) in (Union, UnionType):
        if value is None and NoneType in get_args(hint):
            return
        (hint,) = (kind for kind in get_args(hint) if kind is not NoneType)
    arguments = get_args(hint)
    if get_origin(hint) is Literal:
        if not isinstance(value, str) or value not in arguments:
            yield f"{where} is {_shown(value)}; expected {' or '.join(map(repr, arguments))}"
    elif get_origin(hint) is tuple:
        if not isinstance(value, tuple):
            yield f"{where} is {_shown(value)}; expected a tuple: one of one item is written (item,)"
            return
        kinds = arguments[:1] * len(value) if arguments[-1] is Ellipsis else arguments
        if len(kinds) != len(value):
            yield f"{where} has {len(value)} items; expected {len(kinds)}"
            return
        for k, (each, kind) in enumerate(zip(value, kinds, strict=True), 1):
            yield from _mistake(each, kind, f"{where} item {k}")
    elif hint is sp.Expr:
        if isinstance(value, bool) or not isinstance(value, int | float | sp.Expr):
            yield f"{where} is {_shown(value)}; expected an expression of SymPy"
    elif is_dataclass(hint) and hint is not Unit:
        fits = isinstance(value, hint) if hint is Element else type(value) is hint
        if not fits:
            yield f"{where} is {_shown(value)}; expected {_word(hint)}(...)"
        else:
            yield from _mistyped(value, where)
    elif not _is_plain(value, hint):
        yield f"{where} is {_shown(value)}; expected {_EXPECTED.get(hint, _word(hint))}"


_EXPECTED = {str: "a text", bool: "True or False", int: "a whole number", float: "a number", Unit: "a unit"}


def _is_plain(value: Any, hint: Any) -> bool:
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and not math.isnan(value)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return isinstance(value, Unit if hint is UnitOfJoint else hint)


def _out_of_range(effect: Effect, where: str) -> Iterator[str]:
    """Names, bounds and grids with the right types but impossible values."""
    coefficients = effect.form.coefficients if effect.form else ()
    names = [effect.name, *(p.name for p in (*effect.parameters, *coefficients)), *(s.name for s in effect.states)]
    for name in names:
        if len(name) > LONGEST_NAME:
            yield f"{where}: {_shown(name)} has {len(name)} letters; expected at most {LONGEST_NAME}"
    for p in (*effect.parameters, *coefficients):
        if not p.bounds[0] < p.bounds[1]:
            yield f"{where}: {p.name}: bounds are {p.bounds}; expected the smaller one first"
        grid, here = p.grid or Grid(1, 1, 1), f"{where}: {p.name}: grid"
        if not 1 <= grid.count <= MOST_VALUES:
            yield f"{here} has {grid.count} values; expected 1 to {MOST_VALUES}"
        if not (math.isfinite(grid.low) and math.isfinite(grid.high) and grid.low <= grid.high):
            yield f"{here} goes from {grid.low} to {grid.high}; expected finite numbers, the smaller one first"
        if grid.spacing == "log" and not grid.low > 0:
            yield f"{here} begins at {grid.low}, spaced as its logarithm; expected more than 0, or spacing='linear'"


def _word(kind: Any) -> str:
    return str(kind.__name__)


def _shown(value: Any) -> str:
    return repr(value)[:40] if isinstance(value, str | int | float | bool | NoneType) else f"a {type(value).__name__}"
