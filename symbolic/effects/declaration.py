"""What an effect is: one declaration from which everything else is generated.

The torque is an expression in SIGNALS, the effect's parameters and its states. Torques stand on the
motor's side (tau_m = D qdd + C qd + g + sum of effects), so friction has the sign of qd and a spring
that pulls the joint forward is negative. Parameters with role "linear" enter the torque at most
linearly; identification solves them exactly and searches only the "shape" parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Literal

import sympy as sp

from symbolic import units as u
from symbolic.primitives import WIDTHS


@dataclass(frozen=True)
class Signal:
    """A quantity that effects may read, one value a joint and sample."""

    symbol: sp.Symbol
    unit: u.Unit
    meaning: str

    @property
    def name(self) -> str:
        return self.symbol.name


def _signal(name: str, unit: u.Unit, meaning: str) -> Signal:
    return Signal(sp.Symbol(name, real=True), unit, meaning)


SIGNALS: tuple[Signal, ...] = (
    _signal("q", u.POSITION, "joint position"),
    _signal("qd", u.RATE, "joint rate"),
    _signal("qdd", u.ACCELERATION, "joint acceleration"),
    _signal("t", u.SECOND, "time since the start of the run"),
    _signal("load", u.FORCE, "predicted torque transmitted to the link: D qdd + C qd + g without the own rotor"),
    _signal("link_inertia", u.INERTIA, "inertia of the link side as this joint sees it, without the own rotor"),
    _signal("level", u.FORCE, "predicted magnitude of the joint's Coulomb friction in the present direction"),
    _signal("predicted", u.FORCE, "predicted motor torque, all active effects included"),
    _signal("predicted_rate", u.FORCE / u.SECOND, "time derivative of the predicted motor torque"),
    _signal("warmth", u.KELVIN, "rise of the measured temperature since the start; 0 where none is measured"),
    _signal("unmeasured", u.KELVIN, "1 K where no temperature is measured, else 0"),
    _signal("qd_next", u.RATE, "rate of the next joint outwards; 0 at the last"),
    _signal("qd_previous", u.RATE, "rate of the joint before; 0 at the first"),
    _signal("has_next", u.ONE, "1 if the effect's second joint is the next one outwards, else 0"),
    _signal("moment_x", u.FORCE * u.SECOND**2 / u.METRE, "derivative of the arm's first mass moment along base x by q"),
    _signal("moment_y", u.FORCE * u.SECOND**2 / u.METRE, "derivative of the arm's first mass moment along base y by q"),
    _signal("tip_load", u.FORCE / u.KILOGRAM, "torque that a unit mass at the end-effector asks of this joint"),
    _signal("tip_y", u.METRE, "end-effector's y in the base frame"),
    _signal("tip_yd", u.METRE / u.SECOND, "rate of the end-effector's y"),
    _signal("tip_row", u.FORCE / u.NEWTON, "derivative of the end-effector's y by q"),
    _signal("ratio", u.ONE / u.POSITION, "gear ratio per unit of position: motor turns' angle by q"),
)
SIGNAL = {s.name: s for s in SIGNALS}
DT = sp.Symbol("dt", positive=True)
"""Step of the recursion of effects with memory, s."""


@dataclass(frozen=True)
class Grid:
    """Where a shape parameter is looked for: `count` values from `low` to `high` times the data's `of`.

    of: "one", "rate" (largest |qd|), "load" (largest |load|), "duration" (of the longest run), or
    "position", whose values run from the smallest to the largest q (low = 0, high = 1).
    """

    low: float
    high: float
    count: int
    of: Literal["one", "rate", "position", "load", "duration"] = "one"
    spacing: Literal["log", "linear"] = "log"


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect; `bounds` are physical (dissipation, order), in SI."""

    name: str
    unit: u.Unit
    meaning: str
    role: Literal["linear", "shape"] = "linear"
    bounds: tuple[float, float] = (-inf, inf)
    grid: Grid | None = None

    @property
    def symbol(self) -> sp.Symbol:
        return parameter(self.name)


def parameter(name: str) -> sp.Symbol:
    """The symbol under which an effect's torque refers to its parameter."""
    return sp.Symbol(f"p_{name}", real=True)


@dataclass(frozen=True)
class State:
    """Memory: `step` gives the next value from the states and signals of this sample and dt."""

    name: str
    unit: u.Unit
    meaning: str
    step: sp.Expr
    initial: sp.Expr = sp.Integer(0)

    @property
    def symbol(self) -> sp.Symbol:
        return state(self.name)


def state(name: str) -> sp.Symbol:
    """The symbol under which an effect's torque and steps refer to its state."""
    return sp.Symbol(f"x_{name}", real=True)


@dataclass(frozen=True)
class Effect:
    """One physical effect.

    name         as users write it
    scope        "joint"; "joints" (acts on a joint and the next one outwards); "arm"; "contact"
    family       "friction", "spring", "drive", "transmission", "load", "contact"
    torque       what it adds to the motor torque of the joint whose signals are given
    parameters   linear ones and shape ones
    states       memory, empty for a static effect
    dissipates   its power torque * qd is never negative within the bounds (or, for contact, work on the plate)
    generalises  effects whose torques are special cases: adding this one replaces them
    summary      one sentence
    equation     the law as a person writes it
    trace        what it leaves in a residual, one sentence
    experiment   the motion that would bring it out, one sentence
    source       literature
    """

    name: str
    scope: Literal["joint", "joints", "arm", "contact"]
    family: str
    torque: sp.Expr
    parameters: tuple[Parameter, ...]
    summary: str
    equation: str
    trace: str
    experiment: str
    source: str
    states: tuple[State, ...] = field(default=())
    dissipates: bool = False
    generalises: tuple[str, ...] = field(default=())

    @property
    def linear(self) -> tuple[Parameter, ...]:
        return tuple(p for p in self.parameters if p.role == "linear")

    @property
    def shape(self) -> tuple[Parameter, ...]:
        return tuple(p for p in self.parameters if p.role == "shape")

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Those it reads, in the order of SIGNALS."""
        used = self.torque.free_symbols.union(*(s.step.free_symbols for s in self.states))
        return tuple(s for s in SIGNALS if s.symbol in used)

    @property
    def columns(self) -> tuple[sp.Expr, ...]:
        """Derivatives of the torque by the linear parameters: the effect's regressor, (k,)."""
        return tuple(sp.diff(self.torque, p.symbol) for p in self.linear)

    @property
    def fixed(self) -> sp.Expr:
        """The torque with all linear parameters at zero; 0 for most effects."""
        return self.torque.subs({p.symbol: 0 for p in self.linear})


def check(effect: Effect) -> None:
    """Raise ValueError where a declaration contradicts itself (an effect of a user's own file is read, too)."""
    known = {s.symbol for s in SIGNALS} | set(WIDTHS) | {DT}
    known |= {p.symbol for p in effect.parameters} | {s.symbol for s in effect.states}
    used = effect.torque.free_symbols.union(*(s.step.free_symbols for s in effect.states))
    if used - known:
        names = ", ".join(sorted(s.name for s in used - known))
        raise ValueError(f'effect "{effect.name}" uses {names}, which is neither a signal, a parameter nor a state')
    linear = {p.symbol for p in effect.linear}
    for column in effect.columns:
        if column.free_symbols & linear:
            raise ValueError(f'effect "{effect.name}" is not linear in all of its linear parameters')
    for p in effect.shape:
        if p.grid is None:
            raise ValueError(f'effect "{effect.name}": shape parameter "{p.name}" needs a grid to be searched on')
