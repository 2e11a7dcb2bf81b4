"""What the drive adds between the torque that is recorded and the torque that acts."""

from __future__ import annotations

from functools import partial
from math import inf

import sympy as sp

from symbolic import units as u
from symbolic.effects.declaration import SIGNAL, Effect, Grid, LinearForm, Parameter, parameter

Q, RATIO = SIGNAL["q"].symbol, SIGNAL["ratio"].symbol
PREDICTED, PREDICTED_RATE = SIGNAL["predicted"].symbol, SIGNAL["predicted_rate"].symbol

_ANGLE = parameter("order") * RATIO * Q

_drive = partial(Effect, scope="joint", family="drive")

TORQUE_RIPPLE = _drive(
    name="torque_ripple",
    torque=parameter("amplitude") * sp.cos(_ANGLE + parameter("phase")),
    parameters=(
        Parameter(
            "order",
            u.ONE,
            "periods per revolution of the motor, k / N for k periods per revolution of the joint; 2 is the wave "
            "generator of a harmonic drive",
            role="shape",
            bounds=(0.0, inf),
            grid=Grid(-1.0, 1.0, 3, of="line", spacing="linear"),
        ),
        Parameter("amplitude", u.FORCE, "at the joint", bounds=(0.0, inf)),
        Parameter("phase", u.ONE, "at q = 0, in rad", bounds=(-float(sp.pi), float(sp.pi))),
    ),
    form=LinearForm(
        coefficients=(
            Parameter("cosine", u.FORCE, "amplitude of the part that is largest at q = 0"),
            Parameter("sine", u.FORCE, "amplitude of the part that is zero at q = 0"),
        ),
        torque=parameter("cosine") * sp.cos(_ANGLE) + parameter("sine") * sp.sin(_ANGLE),
        from_parameters=(
            parameter("amplitude") * sp.cos(parameter("phase")),
            -parameter("amplitude") * sp.sin(parameter("phase")),
        ),
        recover=(
            sp.sqrt(parameter("cosine") ** 2 + parameter("sine") ** 2),
            sp.atan2(-parameter("sine"), parameter("cosine")),
        ),
    ),
    summary="A torque that repeats with the motor's revolution: cogging, commutation, wave generator.",
    equation="A cos(n N q + phi)",
    trace="Over the motor's angle, a wave that repeats every revolution or fraction of one, at any speed.",
    experiment="Slow constant speed over ten revolutions of the motor, so that the wave stays below the cut-off.",
    source="Holtz & Springob 1996, Identification and compensation of torque ripple in high-precision permanent magnet "
    "motor drives, IEEE Trans. Industrial Electronics 43(2)",
    sits_at="motor",
    several=True,
)

TORQUE_SATURATION = _drive(
    name="torque_saturation",
    torque=parameter("coefficient") * PREDICTED**3,
    parameters=(
        Parameter(
            "coefficient", u.ONE / u.FORCE**2, "excess of the recorded torque per cubed torque", bounds=(0.0, inf)
        ),
    ),
    summary="The motor's torque constant falls at large current, so that the current overstates the torque.",
    equation="c tau^3, tau the predicted torque",
    trace="Over the predicted torque, a cubic curve that is visible only at the peaks.",
    experiment="Motion with the largest accelerations in both directions, and with small ones.",
    source="Hanselman 2006, Brushless Permanent Magnet Motor Design",
    sits_at="motor",
)

TORQUE_SCALE = _drive(
    name="torque_scale",
    torque=(parameter("factor") - 1) * PREDICTED,
    parameters=(Parameter("factor", u.ONE, "recorded torque over true torque", bounds=(0.0, inf), neutral=1.0),),
    summary="The recorded torque is wrong by a factor: torque constant, gear ratio, amplifier gain.",
    equation="(factor - 1) tau, tau the predicted torque",
    trace="The residual is proportional to the torque; if all parameters are fitted, they absorb it.",
    experiment="A known mass or spring at the joint; without one, only parameters that are not fitted reveal it.",
    source="Gautier & Briot 2014, Global identification of joint drive gains and dynamic parameters of robots, "
    "ASME J. Dynamic Systems, Measurement, and Control 136(5)",
    sits_at="motor",
)

TORQUE_DELAY = _drive(
    name="torque_delay",
    # recorded(t) = predicted(t + time) to first order: good for times short against the motion's.
    torque=parameter("time") * PREDICTED_RATE,
    parameters=(
        Parameter(
            "time",
            u.SECOND,
            "positive: the recorded torque is ahead of the recorded motion, as a command is that acts only later; "
            "negative: it is behind, as a filtered current is",
            kind="lead",
        ),
    ),
    summary="Torque and motion are not recorded at the same instant: hold, bus cycle, filter.",
    equation="T d(tau)/dt, tau the predicted torque",
    trace="The residual is proportional to the torque's time derivative, so that it grows with frequency.",
    experiment="Motion over two decades of frequency; the residual of an elasticity grows faster with frequency.",
    source="Ljung 1999, System Identification: Theory for the User",
    sits_at="motor",
)

EFFECTS = (TORQUE_RIPPLE, TORQUE_SATURATION, TORQUE_SCALE, TORQUE_DELAY)
