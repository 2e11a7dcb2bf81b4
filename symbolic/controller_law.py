"""Torques that a controller adds to inverse dynamics at the measured motion: friction (7), springs (2), the plate (3).

Every active effect without memory that reads only the measured motion is compensated. Parallel springs and the plate
belong to a trajectory, not to the arm: they are always compensated, with their own parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from symbolic.described import declared
from symbolic.effects.declaration import SIGNAL, SIGNALS, Effect, Parameter
from symbolic.effects.signals import ArmOutput, ArmSlope, Coordinate, Given, JointConstant
from symbolic.functions import Argument, Coordinates, Output, Recorder, Struct, SymbolicFunction
from symbolic.model import ArmModel
from symbolic.rigid_body.base_parameters import exact

HAS_NEXT = SIGNAL["has_next"].symbol
C_U, C_E = sp.Symbol("friction_scale", real=True), sp.Symbol("friction_slope", nonnegative=True)
Reading = dict[sp.Symbol, sp.Expr]


@dataclass(frozen=True)
class Site:
    """An active effect and its joint (1-based); None for an effect of the arm or the contact."""

    effect: Effect
    joint: int | None = None

    def __str__(self) -> str:
        return self.effect.name if self.joint is None else f"{self.effect.name}@{self.joint}"

    @property
    def obstacle(self) -> str | None:
        """Why a controller cannot compensate it; None if it can."""
        if self.effect.states:
            return "has a memory"
        unknown = [s.name for s in self.effect.signals if s.known_to != "controller"]
        return f"reads {', '.join(unknown)}" if unknown else None

    def symbol(self, parameter: Parameter) -> sp.Symbol:
        """The symbol of a parameter at this site."""
        owner = self.effect.scope if self.joint is None else f"joint{self.joint}"
        return sp.Symbol(f"{owner}_{self.effect.name}_{parameter.name}", real=True)

    @property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """Symbols of all parameters, in declared order."""
        return tuple(self.symbol(p) for p in self.effect.parameters)

    def torque(self, joint: int, reading: Reading) -> sp.Expr:
        """The effect's torque at a joint (1-based) with these signals."""
        own = {p.symbol: self.symbol(p) for p in self.effect.parameters}
        return self.effect.torque.xreplace({**reading, **own, HAS_NEXT: sp.Integer(joint == self.joint)})

    def acts_on(self, joint: int) -> bool:
        """Whether the effect acts on a joint (1-based)."""
        if self.joint is None:
            return True
        return joint == self.joint or (self.effect.scope == "joints" and joint == self.joint + 1)


@dataclass(frozen=True)
class Spring:
    """A spring of a trajectory at a joint (1-based).

    usual   the default kind; other kinds have their name in front of their parameters' names
    """

    effect: Effect
    joint: int
    usual: bool = True

    @property
    def lumps(self) -> tuple[tuple[Parameter, sp.Expr], ...]:
        """The controller's parameters, with expressions in the effect's parameters: coefficients of the usual spring,
        which avoid repeated products, and the parameters themselves of others."""
        form = self.effect.form if self.usual else None
        solved = zip(form.coefficients, form.from_parameters, strict=True) if form else ()
        used = self._law.free_symbols
        rest = [p for p in self.effect.parameters if p.symbol in used and not (form and p in form.coefficients)]
        return (*solved, *((p, p.symbol) for p in rest))

    @property
    def _law(self) -> sp.Expr:
        return self.effect.form.torque if self.usual and self.effect.form else self.effect.torque

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its lumps, unique among the springs of a joint."""
        return tuple(p.name if self.usual else f"{self.effect.name}_{p.name}" for p, _ in self.lumps)

    @property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """Symbols of its lumps, in order."""
        return tuple(sp.Symbol(f"joint{self.joint}_spring_{name}", real=True) for name in self.names)

    def torque(self, reading: Reading) -> sp.Expr:
        """Its torque at the joint with these signals."""
        own = {p.symbol: symbol for (p, _), symbol in zip(self.lumps, self.symbols, strict=True)}
        return self._law.xreplace({**reading, **own})


@dataclass(frozen=True)
class Compensation:
    """A controller's generated functions besides those of the arm, and their parameters.

    springs         that a trajectory may have, joint by joint, the usual one first
    touched         contact effects that a trajectory may have
    effects         struct of c_u, c_e and the compensated effects' parameters; None where unknown
    compensated     sites in the order of their fields
    uncompensated   the other active effects
    functions       joint_compensation, contact_compensation
    """

    springs: tuple[Spring, ...]
    touched: tuple[Site, ...]
    effects: Struct
    compensated: tuple[Site, ...]
    uncompensated: tuple[Site, ...]
    functions: tuple[SymbolicFunction, ...]


def compensation(model: ArmModel, library: Mapping[str, Effect]) -> Compensation:
    """The compensation of an arm's active effects. library: all declarations by name."""
    kinds = [e for e in library.values() if e.brought and e.scope == "joint"]
    joints = range(1, len(model.arm.joints) + 1)
    springs = tuple(Spring(effect, joint, effect is kinds[0]) for joint in joints for effect in kinds)
    touched: list[Site] = []
    for effect in (e for e in library.values() if e.brought and e.scope == "contact"):
        # Of several that give the same signal, the first.
        if not any(p.gives and site.effect.giving(p.gives) for site in touched for p in effect.parameters):
            touched.append(Site(effect))
    stated = [(site, values) for site, values in active(model, library) if not site.effect.brought]
    known = [(site, values) for site, values in stated if site.obstacle is None]
    compensated, effects = tuple(site for site, _ in known), _struct(model, known)
    return Compensation(
        springs,
        tuple(touched),
        effects,
        compensated=compensated,
        uncompensated=tuple(site for site, _ in stated if site.obstacle is not None),
        functions=(
            _joints(model, effects, springs, touched=touched, sites=compensated),
            _contact(model, effects, touched, compensated),
        ),
    )


def active(model: ArmModel, library: Mapping[str, Effect]) -> Iterable[tuple[Site, Mapping[str, float]]]:
    """The model file's effects with their values."""
    for number, joint in enumerate(model.arm.joints, 1):
        yield from ((Site(declared(name, library), number), values) for name, values in joint.effects.items())
    yield from ((Site(declared(name, library)), values) for name, values in model.arm.effects.items())
    if model.arm.contact is not None:
        yield from ((Site(declared(name, library)), values) for name, values in model.arm.contact.effects.items())


def _struct(model: ArmModel, sites: Sequence[tuple[Site, Mapping[str, float]]]) -> Struct:
    arm, coordinates = model.arm, _coordinates(model)
    scale, slope = (arm.controller.friction_scale, arm.controller.friction_slope) if arm.controller else (None, None)
    fields: list[tuple[sp.Symbol, str, str, float | None]] = [
        (C_U, "1", "c_u of (7); 0: friction is not compensated", scale),
        (C_E, coordinates.unit("s/rad", "s/m"), "c_e of (7)", slope),
    ]
    for site, values in sites:
        kind = "revolute" if site.joint is None else arm.joints[site.joint - 1].type
        for p in site.effect.parameters:
            value = values.get(p.name, p.default)
            fields.append((site.symbol(p), p.unit.text(kind), p.meaning, value))
    symbols, units, meanings, defaults = zip(*fields, strict=True)
    return Struct("effects", symbols, units, meanings=meanings, defaults=defaults)


def _coordinates(model: ArmModel) -> Coordinates:
    return Coordinates(tuple(joint.type for joint in model.arm.joints))


# --- the functions ---


def nested(terms: sp.Expr, x: sp.Symbol) -> sp.Expr:
    """A sum with powers of x in Horner form, x (a + x^2 (b + ...)), which needs fewer products."""
    by_power: dict[int, sp.Expr] = {}
    rest = sp.S.Zero
    for term in sp.Add.make_args(terms):
        coefficient, power = term.as_coeff_exponent(x)
        if power.is_Integer and power > 0 and not coefficient.has(x):
            by_power[int(power)] = by_power.get(int(power), sp.S.Zero) + coefficient
        else:
            rest += term
    inner, above = sp.S.Zero, 0
    for power in sorted(by_power, reverse=True):
        inner = by_power[power] + x ** (above - power) * inner if above else by_power[power]
        above = power
    return rest + x**above * inner if above else rest


def underestimated(friction: sp.Expr, qd: sp.Expr) -> sp.Expr:
    """The compensated part of a joint's friction: slightly less, and zero at rest; equation (7)."""
    return C_U * friction * (1 - sp.exp(-C_E * sp.Abs(qd)))


def _joints(
    model: ArmModel, effects: Struct, springs: Sequence[Spring], touched: Sequence[Site], sites: Sequence[Site]
) -> SymbolicFunction:
    def torque(number: int, reading: Reading) -> sp.Expr:
        here = [site for site in sites if site.acts_on(number) and site.effect.scope != "contact"]
        friction = sum((site.torque(number, reading) for site in here if site.effect.rubs), sp.S.Zero)
        rest = sum((site.torque(number, reading) for site in here if not site.effect.rubs), sp.S.Zero)
        spring = sum((s.torque(reading) for s in springs if s.joint == number), sp.S.Zero)
        qd = reading[SIGNAL["qd"].symbol]
        return underestimated(nested(friction, qd), qd) + spring + rest

    columns = ", ".join(name for spring in springs if spring.joint == 1 for name in spring.names)
    return _function(
        model,
        effects,
        touched,
        torque,
        name="joint_compensation",
        brought=_brought("springs", springs, f"a row a joint: {columns}"),
        doc="Torques of friction, springs and the other static effects of joints and arm at the measured motion.",
        source="Equations (2), (4) and (7); the effects' own sources are in the library",
    )


def _contact(model: ArmModel, effects: Struct, touched: Sequence[Site], sites: Sequence[Site]) -> SymbolicFunction:
    here = [*touched, *(site for site in sites if site.effect.scope == "contact")]
    return _function(
        model,
        effects,
        touched,
        lambda number, reading: sum((site.torque(number, reading) for site in here), sp.S.Zero),
        name="contact_compensation",
        brought=_brought("contact", touched, ", ".join(s.name for site in touched for s in site.symbols)),
        doc="Torques of the plate, and of other effects of the contact, at the measured motion.",
        source="Equation (3)",
    )


def _brought(name: str, sites: Sequence[Site | Spring], meaning: str) -> Argument:
    symbols = tuple(s for site in sites for s in site.symbols)
    return Argument(name, symbols, (len(symbols),), unit="as declared", meaning=meaning)


def _function(
    model: ArmModel,
    effects: Struct,
    touched: Sequence[Site],
    torque: Callable[[int, Reading], sp.Expr],
    *,
    name: str,
    brought: Argument,
    doc: str,
    source: str,
) -> SymbolicFunction:
    """A function of the torques that `torque` returns for each joint (1-based) and its signals."""
    coordinates, fields, own = _coordinates(model), model.struct.symbols, effects.symbols
    inputs = (
        Argument("parameters", fields, (len(fields),), unit="as named", meaning="of the arm"),
        Argument(effects.name, own, (len(own),), unit="as named", meaning="c_u, c_e and parameters"),
        brought,
        coordinates.argument("q"),
        coordinates.argument("qd"),
    )
    recorder = Recorder([s.name for argument in inputs for s in argument.symbols])
    torques = tuple(torque(number, reading) for number, reading in enumerate(_readings(model, touched, recorder), 1))
    output = Output("tau", torques, (len(torques),), unit=coordinates.force, meaning="added to the motor torque")
    return SymbolicFunction(name, inputs, (output,), doc=doc, source=source, definitions=recorder.live(torques))


def _readings(model: ArmModel, touched: Sequence[Site], recorder: Recorder) -> list[Reading]:
    """Every joint's signals in positions and rates."""
    there = [s for s in SIGNALS if model.arm.space or not s.space]
    read = [(s, s.source) for s in there if s.known_to == "controller"]
    signals = [(s, source) for s, source in read if source is not None and not isinstance(source, ArmSlope)]
    named = {source.function for _, source in signals if isinstance(source, ArmOutput)}
    outputs = {f.name: _replayed(model, f.name, recorder) for f in model.functions if f.name in named}
    given = {p.gives: site.symbol(p) for site in touched for p in site.effect.parameters if p.gives}
    return [
        {
            s.symbol: given[s.name] if isinstance(source, Given) else sp.sympify(_read(model, source, i, outputs))
            for s, source in signals
        }
        for i in range(len(model.arm.joints))
    ]


def _read(
    model: ArmModel, source: Coordinate | ArmOutput | JointConstant, joint: int, outputs: Mapping[str, list[sp.Expr]]
) -> Any:
    """A signal at a joint (0-based), for an effect that sits there."""
    match source:
        case Coordinate(name, step):
            there = joint + step
            return _coordinates(model).symbols(name)[there] if 0 <= there < len(model.arm.joints) else 0
        case ArmOutput(name, index):
            place = 0
            for length, i in zip(model.function(name).outputs[0].shape, index, strict=False):
                place = place * length + (i if isinstance(i, int) else joint)
            return outputs[name][place]
        case JointConstant(name):
            return sp.Rational(exact(getattr(model.arm.joints[joint], name)))


def _replayed(model: ArmModel, name: str, recorder: Recorder) -> list[sp.Expr]:
    """The outputs of one of the arm's functions, with its definitions recorded again."""
    function = model.function(name)
    known: dict[sp.Symbol, sp.Expr] = {}
    for symbol, expression in function.definitions:
        known[symbol] = recorder.let(symbol.name, expression.xreplace(known))
    return [e.xreplace(known) for e in function.outputs[0].expressions]
