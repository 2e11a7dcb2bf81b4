"""A grammar of guesses: dimensionally consistent candidate laws for effects outside the library.

A guess is the product of a carrier (dry friction, a rate, an inertia, a load, a neighbour's motion) and a modulation (a
dependence on position, speed or time, or a lag). Every factor has a unit, and the coefficient's unit makes the product
a torque. A guess states the signals on which a missing law depends; it does not explain the mechanism.

Source: the products follow the terms of sparse identification, Brunton, Proctor & Kutz 2016, Discovering governing
equations from data by sparse identification of nonlinear dynamical systems, PNAS 113(15), with units kept.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from typing import Literal

import sympy as sp

from symbolic import units as u
from symbolic.effects.declaration import DT, SIGNAL, Effect, Grid, Parameter, State, parameter, state
from symbolic.primitives import WIDTH_FORCE, WIDTH_POSITION, WIDTH_RATE, WIDTH_TIME, absolute, ramp, sgn, step

PREFIX = "draft_"
"""Prefix of the names of guesses, which separates them from the library's effects."""

Q, QD, QDD, T = (SIGNAL[name].symbol for name in ("q", "qd", "qdd", "t"))
LOAD, PREDICTED = SIGNAL["load"].symbol, SIGNAL["predicted"].symbol
QD_NEXT, QD_PREVIOUS = SIGNAL["qd_next"].symbol, SIGNAL["qd_previous"].symbol
SPEED = absolute(QD, WIDTH_RATE)
POSITIVE = (0.0, inf)


@dataclass(frozen=True)
class Carrier:
    """The first factor of a guess. expr in `unit`; text as written ("" for 1); says: a noun phrase.

    inertial   if modulated over position, the law follows from a kinetic energy, so that energy is conserved
    """

    name: str
    says: str
    text: str
    expr: sp.Expr
    unit: u.Unit
    inertial: bool = False


@dataclass(frozen=True)
class ModulationPart:
    """A linear coefficient of a modulation and the factor that it multiplies."""

    name: str
    meaning: str
    text: str
    expr: sp.Expr
    unit: u.Unit = u.ONE


@dataclass(frozen=True)
class Modulation:
    """The second factor of a guess: a sum of parts. lag: the carrier passes a first-order lag.

    over   "position", "speed" or "time"; "" for none
    """

    name: str
    over: Literal["", "position", "speed", "time"]
    says: str
    parts: tuple[ModulationPart, ...]
    shape: tuple[Parameter, ...] = ()
    smooth: bool = True
    lag: bool = False


def _sole(text: str, expr: sp.Expr, unit: u.Unit = u.ONE) -> tuple[ModulationPart, ...]:
    return (ModulationPart("coefficient", "size of the term", text, expr=expr, unit=unit),)


def _shape(name: str, unit: u.Unit, meaning: str, grid: Grid, bounds: tuple[float, float] = POSITIVE) -> Parameter:
    return Parameter(name, unit, meaning, role="shape", bounds=bounds, grid=grid)


_PLACE = _shape(
    "place",
    u.POSITION,
    "where it happens",
    grid=Grid(0.04, 0.96, 12, of="position", spacing="linear"),
    bounds=(-inf, inf),
)
_WIDTH = _shape("width", u.POSITION, "from its middle to 1/e of it", Grid(0.06, 0.36, 3, "range"))
_WAVELENGTH = _shape("wavelength", u.POSITION, "distance after which it repeats", Grid(0.08, 3.2, 44, "range"))
_SPEED = _shape("speed", u.RATE, "at which it changes", Grid(0.01, 0.9, 12, "rate"))
_BEND = _shape("speed", u.RATE, "from which on it acts", Grid(0.04, 0.88, 12, of="rate", spacing="linear"))
_LASTING = _shape("time_constant", u.SECOND, "of its decay", Grid(0.03, 1.5, 7, "duration"))
_MOMENT = _shape("moment", u.SECOND, "from which on it acts", Grid(0.04, 0.96, 12, of="duration", spacing="linear"))
_LAG = _shape("time_constant", u.SECOND, "by which it follows late", Grid(0.003, 1.0, 10))

_AT, _PHASE = Q - parameter("place"), 2 * sp.pi * Q / parameter("wavelength")

NONE = Modulation("", "", "", _sole("", sp.S.One))
WAVE = Modulation(
    "wave",
    "position",
    "in a wave over the position",
    parts=(
        ModulationPart("cosine", "size of the part largest at q = 0", "cos(2 pi q/wavelength)", sp.cos(_PHASE)),
        ModulationPart("sine", "size of the part that is zero at q = 0", "sin(2 pi q/wavelength)", sp.sin(_PHASE)),
    ),
    shape=(_WAVELENGTH,),
)
SLOPE = Modulation("slope", "position", "in proportion to the position", _sole("q", Q, u.POSITION))
PARABOLA = Modulation(
    "parabola",
    "position",
    "in a parabola over the position",
    (
        ModulationPart("slope", "part in proportion to the position", "q", expr=Q, unit=u.POSITION),
        ModulationPart("curvature", "part in proportion to its square", "q^2", expr=Q**2, unit=u.POSITION**2),
    ),
)
CUBIC = Modulation(
    "cubic",
    "position",
    "in a cubic over the position",
    (
        *PARABOLA.parts,
        ModulationPart("bend", "part in proportion to its cube", "q^3", expr=Q**3, unit=u.POSITION**3),
    ),
)
BUMP = Modulation(
    "bump",
    "position",
    "around one place",
    parts=_sole("exp(-((q - place)/width)^2)", sp.exp(-((_AT / parameter("width")) ** 2))),
    shape=(_PLACE, _WIDTH),
)
SIDE = Modulation(
    "side",
    "position",
    "on one side of a place only",
    parts=_sole("[q > place]", step(_AT, WIDTH_POSITION)),
    shape=(_PLACE,),
    smooth=False,
)
ABOVE = Modulation(
    "above",
    "position",
    "with the distance beyond a place",
    parts=_sole("(q - place)+", ramp(_AT, WIDTH_POSITION), u.POSITION),
    shape=(_PLACE,),
    smooth=False,
)
BELOW = Modulation(
    "below",
    "position",
    "with the distance short of a place",
    parts=_sole("(place - q)+", ramp(-_AT, WIDTH_POSITION), u.POSITION),
    shape=(_PLACE,),
    smooth=False,
)
POSITIONS = (WAVE, SLOPE, PARABOLA, CUBIC, BUMP, SIDE, ABOVE, BELOW)

_RELATIVE = QD / parameter("speed")
SLOW = Modulation(
    "slow", "speed", "at low speed only", parts=_sole("exp(-(qd/speed)^2)", sp.exp(-(_RELATIVE**2))), shape=(_SPEED,)
)
FADING = Modulation(
    "fading",
    "speed",
    "less the faster it moves",
    parts=_sole("exp(-|qd|/speed)", sp.exp(-SPEED / parameter("speed"))),
    shape=(_SPEED,),
)
PEAK = Modulation(
    "peak",
    "speed",
    "about a speed more than beyond it",
    parts=_sole("1/(1 + (qd/speed)^2)", 1 / (1 + _RELATIVE**2)),
    shape=(_SPEED,),
)
FROM = Modulation(
    "from",
    "speed",
    "from a speed on",
    parts=_sole("[|qd| > speed]", step(SPEED - parameter("speed"), WIDTH_RATE)),
    shape=(_BEND,),
    smooth=False,
)
BEYOND = Modulation(
    "beyond",
    "speed",
    "with the speed beyond a limit",
    parts=_sole("(|qd| - speed)+", ramp(SPEED - parameter("speed"), WIDTH_RATE), u.RATE),
    shape=(_BEND,),
    smooth=False,
)
SPEEDS = (SLOW, FADING, PEAK, FROM, BEYOND)

DRIFT = Modulation("drift", "time", "in proportion to the time", _sole("t", T, u.SECOND))
DECAY = Modulation(
    "decay",
    "time",
    "dying away",
    parts=_sole("exp(-t/time_constant)", sp.exp(-T / parameter("time_constant"))),
    shape=(_LASTING,),
)
AFTER = Modulation(
    "after",
    "time",
    "from a moment on",
    parts=_sole("[t > moment]", step(T - parameter("moment"), WIDTH_TIME)),
    shape=(_MOMENT,),
    smooth=False,
)
TIMES = (DRIFT, DECAY, AFTER)
LATE = Modulation("late", "time", "following late", parts=_sole("", sp.S.One), shape=(_LAG,), lag=True)

TORQUE = Carrier("torque", "A torque whatever the motion", "", expr=sp.S.One, unit=u.ONE)
DRY = Carrier("dry", "Dry friction", "sgn(qd)", expr=sgn(QD, WIDTH_RATE), unit=u.ONE)
FORWARDS = Carrier("forwards", "A torque in forward motion", "[qd > 0]", expr=step(QD, WIDTH_RATE), unit=u.ONE)
BACKWARDS = Carrier("backwards", "A torque in backward motion", "[qd < 0]", expr=step(-QD, WIDTH_RATE), unit=u.ONE)
FORWARDS_VISCOUS = Carrier(
    "forwards_viscous", "Viscous friction in forward motion", "qd+", expr=ramp(QD, WIDTH_RATE), unit=u.RATE
)
BACKWARDS_VISCOUS = Carrier(
    "backwards_viscous", "Viscous friction in backward motion", "(-qd)+", expr=ramp(-QD, WIDTH_RATE), unit=u.RATE
)
VISCOUS = Carrier("viscous", "Viscous friction", "qd", expr=QD, unit=u.RATE)
EVEN = Carrier("even", "A torque with the speed, whatever its direction", "|qd|", expr=SPEED, unit=u.RATE)
DRAG = Carrier("drag", "Drag with the square of the speed", "|qd| qd", expr=SPEED * QD, unit=u.RATE**2)
INERTIA = Carrier("inertia", "An inertia", "qdd", expr=QDD, unit=u.ACCELERATION, inertial=True)
CARRIED = Carrier("load", "A part of the load", "load", expr=LOAD, unit=u.FORCE)
LOAD_DRY = Carrier(
    "load_dry",
    "Friction under load",
    "|load| sgn(qd)",
    expr=absolute(LOAD, WIDTH_FORCE) * sgn(QD, WIDTH_RATE),
    unit=u.FORCE,
)
EFFORT = Carrier("effort", "A part of the motor torque", "predicted", expr=PREDICTED, unit=u.FORCE)

ALONE = (
    Carrier(
        "load_viscous",
        "Viscous friction under load",
        "|load| qd",
        expr=absolute(LOAD, WIDTH_FORCE) * QD,
        unit=u.FORCE * u.RATE,
    ),
    Carrier(
        "load_square",
        "Friction with the square of the load",
        "load^2 sgn(qd)",
        expr=LOAD**2 * DRY.expr,
        unit=u.FORCE**2,
    ),
    Carrier(
        "effort_dry",
        "Friction with the motor torque",
        "|predicted| sgn(qd)",
        expr=absolute(PREDICTED, WIDTH_FORCE) * DRY.expr,
        unit=u.FORCE,
    ),
    Carrier(
        "load_even", "The load's magnitude, whatever its sign", "|load|", expr=absolute(LOAD, WIDTH_FORCE), unit=u.FORCE
    ),
)
"""Carriers that are only used without a modulation."""


def _neighbours() -> Iterable[Carrier]:
    for name, other in (("next", QD_NEXT), ("previous", QD_PREVIOUS)):
        against, rubbing = sgn(QD - other, WIDTH_RATE), absolute(other, WIDTH_RATE) * DRY.expr
        rows = (
            ("viscous", f"Drag of the {name} joint", f"qd_{name}", other, u.RATE),
            ("dry", f"Dry friction of the {name} joint", f"sgn(qd_{name})", sgn(other, WIDTH_RATE), u.ONE),
            ("against", f"Dry friction against the {name} joint", f"sgn(qd - qd_{name})", against, u.ONE),
            ("rubs", f"Dry friction with the speed of the {name} joint", f"|qd_{name}| sgn(qd)", rubbing, u.RATE),
            ("product", f"A product of this rate and the {name} one's", f"qd qd_{name}", QD * other, u.RATE**2),
            ("square", f"The square of the {name} joint's rate", f"qd_{name}^2", other**2, u.RATE**2),
        )
        for kind, says, text, expr, unit in rows:
            yield Carrier(f"{name}_{kind}", says, text, expr=expr, unit=unit)


NEIGHBOURS = tuple(_neighbours())

GRAMMAR: tuple[tuple[Carrier, tuple[Modulation, ...]], ...] = (
    (TORQUE, (*POSITIONS, *SPEEDS, *TIMES)),
    (DRY, (*POSITIONS, *SPEEDS, *TIMES, LATE)),
    (FORWARDS, (*POSITIONS, *SPEEDS)),
    (BACKWARDS, (*POSITIONS, *SPEEDS)),
    (VISCOUS, (*POSITIONS, *SPEEDS, *TIMES, LATE)),
    (FORWARDS_VISCOUS, POSITIONS),
    (BACKWARDS_VISCOUS, POSITIONS),
    (EVEN, (NONE, *POSITIONS)),
    (DRAG, (NONE, *POSITIONS)),
    (INERTIA, (*POSITIONS, *SPEEDS, *TIMES)),
    (CARRIED, (*POSITIONS, *TIMES, LATE)),
    (LOAD_DRY, (*POSITIONS, *SPEEDS, *TIMES)),
    (EFFORT, (*TIMES, LATE)),
    *((carrier, (NONE,)) for carrier in ALONE),
    *((carrier, (NONE, WAVE, SLOPE, SLOW, FROM)) for carrier in NEIGHBOURS),
)
"""The modulations that are tried with each carrier."""


def drafts() -> tuple[Effect, ...]:
    """All guesses, as effects of one joint, in the order of the grammar."""
    found = []
    for carrier, modulations in GRAMMAR:
        for modulation in modulations:
            if modulation.smooth or not (carrier.inertial and modulation.over == "position"):
                found.append(draft(carrier, modulation))
    return tuple(found)


_EXPERIMENT = {
    "": "Other speeds, loads and postures, one at a time, to see on what the term depends.",
    "position": "The whole range at several constant speeds in both directions: does the pattern keep its position?",
    "speed": "Many constant speeds in both directions over the same part of the range.",
    "time": "The same motion at the beginning, in the middle and at the end of a long recording.",
}

_FOLLOWED = state("followed")


def draft(carrier: Carrier, modulation: Modulation) -> Effect:
    """The guess for a carrier and a modulation."""
    over = "the position" if modulation.over == "position" else "the " + (modulation.over or "rate")
    says = f"{carrier.says}, {modulation.says}" if modulation.says else carrier.says
    size = sum((parameter(p.name) * p.expr for p in modulation.parts), sp.S.Zero)
    terms = " + ".join(" ".join(filter(None, (p.name, p.text))) for p in modulation.parts)
    factor = f"({terms})" if len(modulation.parts) > 1 else terms
    torque, equation = size * carrier.expr, " ".join(filter(None, (factor, carrier.text)))
    states: tuple[State, ...] = ()
    if modulation.lag:
        # dx/dt = (carrier - x)/T, exact for a carrier that is constant during dt.
        after = carrier.expr + (_FOLLOWED - carrier.expr) * sp.exp(-DT / parameter("time_constant"))
        states = (State("followed", carrier.unit, "what it follows, through a first-order lag", after),)
        torque, equation = size * _FOLLOWED, f"{factor} x,  dx/dt = ({carrier.text} - x)/time_constant"
    elif carrier.inertial and modulation.over == "position":
        # d/dt of dT/dqd less dT/dq with T = m(q) qd^2/2.
        torque += sp.factor_terms(sp.diff(size, Q)) * QD**2 / 2
        equation = f"m qdd + dm/dq qd^2/2,  m = {terms}"
    return Effect(
        name=PREFIX + "_".join(filter(None, (carrier.name, modulation.name))),
        scope="joint",
        family="draft",
        torque=torque,
        parameters=(
            *(Parameter(p.name, u.FORCE / (carrier.unit * p.unit), p.meaning) for p in modulation.parts),
            *modulation.shape,
        ),
        states=states,
        summary=f"A guess. {says}.",
        equation=equation,
        trace=f"The residual is proportional to {carrier.text or 'a constant'}, with a factor that depends on {over}.",
        experiment=_EXPERIMENT[modulation.over],
        source="None: this is a guess from one set of recordings, not a law from the literature.",
    )
