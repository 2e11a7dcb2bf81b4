"""The transmission between motor and link, and how a linear differential equation becomes a step."""

from __future__ import annotations

from math import inf, pi

import sympy as sp

from symbolic import units as u
from symbolic.effects.declaration import DT, SIGNAL, Effect, Grid, Parameter, State, parameter, state

LOAD, LINK_INERTIA, COUPLING = (SIGNAL[name].symbol for name in ("load", "link_inertia", "coupling"))


def linear_step(A: sp.Matrix, x: sp.Matrix, early: sp.Matrix, late: sp.Matrix) -> sp.Matrix:
    """One step of dx/dt = A x + b(t) over DT by Radau IIA with two stages.

    It is of third order and L-stable: a mode far faster than the samples vanishes at once in place of
    ringing, so that stiffness may grow without limit.

    A   (m, m) frozen during the step     x   (m, 1) now     early, late   (m, 1) b at DT/3 and at DT
    Returns (m, 1). Source: Hairer & Wanner 1996, Solving Ordinary Differential Equations II, IV.5.
    """
    one = sp.eye(A.rows)
    H = DT * A
    first = x + DT * (5 * early - late) / 12
    second = x + DT * (3 * early + late) / 4
    # The stages' blocks are polynomials in H, so they commute, and one m by m system remains.
    system = one - sp.Rational(2, 3) * H + H * H / 6
    right = (one - sp.Rational(5, 12) * H) * second + sp.Rational(3, 4) * H * first
    return system.adjugate() * right / system.det()


_K, _D = parameter("stiffness"), parameter("damping")
_DEFLECTION, _RATE, _BEFORE = state("deflection"), state("rate"), state("load")
# The step needs the load of the samples to come; it is continued in a straight line from the last two.
_SLOPE = LOAD - _BEFORE
_AHEAD = LOAD + _SLOPE
_NEXT = linear_step(
    sp.Matrix([[0, 1], [-_K / LINK_INERTIA, -_D / LINK_INERTIA]]),
    sp.Matrix([_DEFLECTION, _RATE]),
    sp.Matrix([0, (LOAD + _SLOPE / 3) / LINK_INERTIA]),
    sp.Matrix([0, _AHEAD / LINK_INERTIA]),
)

ELASTICITY = Effect(
    name="elasticity",
    scope="joint",
    family="transmission",
    # The link accelerates by qdd - delta_dd in place of qdd, and takes the other links along.
    torque=-COUPLING * state("acceleration"),
    parameters=(
        Parameter(
            "stiffness",
            u.STIFFNESS,
            "of the transmission",
            "shape",
            (0.0, inf),
            Grid((2 * pi * 5) ** 2, (2 * pi * 200) ** 2, 28, "link_inertia"),
        ),
        Parameter("damping", u.VISCOUS, "of the transmission", "shape", (0.0, inf), Grid(0.003, 0.6, 6, "critical")),
    ),
    states=(
        State("deflection", u.POSITION, "motor less link", _NEXT[0], initial=LOAD / _K),
        State("rate", u.RATE, "of the deflection", _NEXT[1]),
        State(
            "acceleration",
            u.ACCELERATION,
            "of the deflection",
            (_AHEAD - _D * _NEXT[1] - _K * _NEXT[0]) / LINK_INERTIA,
        ),
        State("load", u.FORCE, "of the last sample", LOAD, initial=LOAD),
    ),
    summary="The link hangs on the motor by a spring: the transmission gives way and resonates.",
    equation="-J delta_dd,  J delta_dd + d delta_d + k delta = load,  J the inertia of the link side",
    trace="The residual follows the fourth derivative of position and peaks at the resonance sqrt(k/J).",
    experiment="Motion over two decades of frequency up to half the resonance, or steps of acceleration.",
    source="Spong 1987, Modeling and control of elastic joint robots, ASME J. Dynamic Systems, Measurement, and "
    "Control 109(4)",
)

EFFECTS = (ELASTICITY,)
