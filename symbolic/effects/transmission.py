"""The transmission between motor and link, and how a linear differential equation becomes a step."""

from __future__ import annotations

from functools import partial
from math import inf, pi

import sympy as sp

from symbolic import units as u
from symbolic.effects.declaration import DT, SIGNAL, Effect, Grid, Parameter, State, parameter, state
from symbolic.elements import Compliance, Gap
from symbolic.primitives import WIDTH_FORCE, WIDTH_POSITION, sgn, step

LOAD, LINK_INERTIA, COUPLING = (SIGNAL[name].symbol for name in ("load", "link_inertia", "coupling"))
COUPLING_RATE, COUPLING_SLOPE = (SIGNAL[name].symbol for name in ("coupling_rate", "coupling_slope"))


def linear_step(A: sp.Matrix, x: sp.Matrix, early: sp.Matrix, late: sp.Matrix, h: sp.Expr) -> sp.Matrix:
    """One step of dx/dt = A x + b(t) over h by Radau IIA with two stages.

    It is of third order and L-stable: a mode far faster than the samples vanishes at once in place of
    ringing, so that stiffness may grow without limit.

    A   (m, m) frozen during the step     x   (m, 1) now     early, late   (m, 1) b at h/3 and at h
    Returns (m, 1). Source: Hairer & Wanner 1996, Solving Ordinary Differential Equations II, IV.5.
    """
    one = sp.eye(A.rows)
    H = h * A
    first = x + h * (5 * early - late) / 12
    second = x + h * (3 * early + late) / 4
    # The stages' blocks are polynomials in H, so they commute, and one m by m system remains.
    system = one - sp.Rational(2, 3) * H + H * H / 6
    right = (one - sp.Rational(5, 12) * H) * second + sp.Rational(3, 4) * H * first
    return system.adjugate() * right / system.det()


_K, _D = parameter("stiffness"), parameter("damping")
_DEFLECTION, _RATE, _BEFORE = state("deflection"), state("rate"), state("load")
# The step needs the load of the samples to come; it is continued in a straight line from the last two.
_SLOPE = LOAD - _BEFORE
_AHEAD = LOAD + _SLOPE
# The step in plain symbols: what stands for them may be long, and its matrices would be expanded.
_STEP = _H, _X, _V, _EARLY, _LATE = sp.symbols("h x v early late")
_PLAIN = linear_step(
    sp.Matrix([[0, 1], [-_K / LINK_INERTIA, -_D / LINK_INERTIA]]),
    sp.Matrix([_X, _V]),
    sp.Matrix([0, _EARLY / LINK_INERTIA]),
    late=sp.Matrix([0, _LATE / LINK_INERTIA]),
    h=_H,
)


def _stepped(*there: sp.Expr) -> sp.Matrix:
    return _PLAIN.xreplace(dict(zip(_STEP, there, strict=True)))


_NEXT = _stepped(DT, _DEFLECTION, _RATE, LOAD + _SLOPE / 3, _AHEAD)


def _missed(acceleration: sp.Expr) -> sp.Expr:
    return -(COUPLING * acceleration + COUPLING_RATE * _RATE + COUPLING_SLOPE * _DEFLECTION)


_transmission = partial(Effect, scope="joint", family="transmission")

ELASTICITY = _transmission(
    name="elasticity",
    torque=_missed(state("acceleration")),
    parameters=(
        Parameter(
            "stiffness",
            u.STIFFNESS,
            "of the transmission",
            role="shape",
            bounds=(0.0, inf),
            grid=Grid((2 * pi * 5) ** 2, (2 * pi * 200) ** 2, 25, "link_inertia"),
            kind="stiffness",
        ),
        Parameter(
            "damping",
            u.VISCOUS,
            "of the transmission",
            role="shape",
            bounds=(0.0, inf),
            grid=Grid(0.005, 0.5, 3, "critical"),
            kind="damping",
        ),
    ),
    states=(
        State("deflection", u.POSITION, "motor less link", _NEXT[0], initial=LOAD / _K, kind="deflection"),
        State("rate", u.RATE, "of the deflection", _NEXT[1]),
        State(
            "acceleration",
            u.ACCELERATION,
            "of the deflection",
            (_AHEAD - _D * _NEXT[1] - _K * _NEXT[0]) / LINK_INERTIA,
        ),
        State("load", u.FORCE, "of the last sample", LOAD, initial=LOAD),
    ),
    elements=(Compliance(_K, _D),),
    summary="The link hangs on the motor by a spring: the transmission gives way and resonates.",
    equation="-(J delta_dd + c delta_d + g delta),  J delta_dd + d delta_d + k delta = load,  J, c and g how the link "
    "side's torque grows with acceleration, rate and position",
    trace="The residual is proportional to the fourth derivative of position and peaks at the resonance sqrt(k/J).",
    experiment="Motion over two decades of frequency up to half the resonance, or steps of acceleration.",
    source="Spong 1987, Modeling and control of elastic joint robots, ASME J. Dynamic Systems, Measurement, and "
    "Control 109(4)",
)

_HALF = parameter("gap") / 2
# A rate far below those that any gap is crossed with: it keeps quotients finite at rest.
_CREEP = sp.Rational(1, 10**7)
# Mean acceleration of the deflection over the step if nothing touches.
_FREE = (LOAD + _SLOPE / 2) / LINK_INERTIA


def _outside(deflection: sp.Expr, side: int) -> sp.Expr:
    return step(side * deflection - _HALF, WIDTH_POSITION)


def _pressed(side: int) -> sp.Expr:
    """1 if the flank on this side (+1, -1) carries torque now: it is touched and would not have to pull."""
    push = _K * (side * _DEFLECTION - _HALF) + _D * side * _RATE
    return _outside(_DEFLECTION, side) * step(push, WIDTH_FORCE)


def _met(side: int) -> sp.Expr:
    """1 if the free deflection passes the flank on this side within the step."""
    reached = _DEFLECTION + _RATE * DT + _FREE * DT**2 / 2
    return _outside(reached, side) * (1 - _outside(_DEFLECTION, side))


def _until(side: int) -> sp.Expr:
    """When the free deflection meets the flank on this side, if it does."""
    distance, rate, drive = _HALF - side * _DEFLECTION, side * _RATE, side * _FREE
    # The root of rate t + drive t^2/2 = distance in the form that is finite without drive; 0 at rest on the flank.
    # Max is no switch of the physics: below it nothing is met.
    impact = sp.sqrt(sp.Max(rate**2 + 2 * drive * distance, _CREEP**2))
    return 2 * distance / (rate + impact + _CREEP)


def _gap_step() -> sp.Matrix:
    """Deflection and rate of the next sample: free up to a flank, the rest of the step on it.

    What is pressed stays so for the whole step. If it comes off within it, it is held back for less than a
    step: an error that only takes energy away.
    """
    free = 1 - _pressed(1) - _pressed(-1)
    side = _pressed(1) - _pressed(-1) + free * (_met(1) - _met(-1))
    on = DT * (1 - free) + free * (_met(1) * (DT - _until(1)) + _met(-1) * (DT - _until(-1)))
    off = DT - on
    rest = _K * side * _HALF
    return _stepped(
        on,
        _DEFLECTION + _RATE * off + _FREE * off**2 / 2,
        _RATE + _FREE * off,
        _AHEAD - _SLOPE * sp.Rational(2, 3) * on / DT + rest,
        _AHEAD + rest,
    )


_ACROSS = _gap_step()

BACKLASH = _transmission(
    name="backlash",
    # The mean accelerations of the last two steps, continued by half a step to this sample: an impact shorter than
    # a sample leaves its whole momentum in them, which the acceleration at the samples would miss.
    torque=_missed((3 * state("acceleration") - state("acceleration_before")) / 2),
    parameters=(
        Parameter(
            "gap",
            u.POSITION,
            "free play from flank to flank, at the joint",
            role="shape",
            bounds=(0.0, inf),
            grid=Grid(1e-5, 0.05, 13, "range"),
            kind="play",
        ),
        Parameter(
            "stiffness",
            u.STIFFNESS,
            "of the transmission in contact",
            role="shape",
            bounds=(0.0, inf),
            grid=Grid((2 * pi * 20) ** 2, (2 * pi * 150) ** 2, 3, "link_inertia"),
            kind="stiffness",
        ),
        Parameter(
            "damping",
            u.VISCOUS,
            "of the transmission in contact",
            role="shape",
            bounds=(0.0, inf),
            grid=Grid(0.05, 0.4, 2, "critical"),
            kind="damping",
        ),
    ),
    states=(
        State(
            "deflection",
            u.POSITION,
            "motor less link",
            _ACROSS[0],
            initial=LOAD / _K + _HALF * sgn(LOAD, WIDTH_FORCE),
            kind="deflection",
        ),
        State("rate", u.RATE, "of the deflection", _ACROSS[1]),
        State("acceleration", u.ACCELERATION, "of the deflection, mean of the last step", (_ACROSS[1] - _RATE) / DT),
        State("acceleration_before", u.ACCELERATION, "the same, of the step before", state("acceleration")),
        State("load", u.FORCE, "of the last sample", LOAD, initial=LOAD),
    ),
    elements=(Gap(parameter("gap"), _K, _D),),
    summary="The link hangs behind a gap: where the load changes its sign it is free, then it strikes the other flank.",
    equation="-(J delta_dd + c delta_d + g delta),  J delta_dd + T = load,  T = s (k x + d x_d)+ for "
    "x = |delta| - gap/2 > 0, s = sgn(delta)",
    trace="When the load changes sign, the load is briefly missing from the torque; then an impact follows.",
    experiment="Accelerations in both directions without other load, some so small that the gap takes ten samples.",
    # Without a gap it is the spring, but for flanks that cannot pull.
    generalises=("elasticity",),
    source="Nordin, Galic & Gutman 1997, New models for backlash and gear play, Int. J. Adaptive Control and Signal "
    "Processing 11(1)",
    has_gap=True,
)

EFFECTS = (ELASTICITY, BACKLASH)
