"""What the drive adds between the torque that is recorded and the torque that acts."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import inf

import sympy as sp

from symbolic import units as u
from symbolic.effects.declaration import SIGNAL, Effect, Grid, LinearForm, Parameter, parameter
from symbolic.elements import Delay, Gain, Lag, Wave

Q, RATIO = SIGNAL["q"].symbol, SIGNAL["ratio"].symbol
PREDICTED, PREDICTED_RATE = SIGNAL["predicted"].symbol, SIGNAL["predicted_rate"].symbol

_ANGLE = parameter("order") * RATIO * Q

NOT_NEGATIVE = (0.0, inf)

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
            bounds=NOT_NEGATIVE,
            grid=Grid(-1.0, 1.0, 3, of="line", spacing="linear"),
        ),
        Parameter("amplitude", u.FORCE, "at the joint", bounds=NOT_NEGATIVE),
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
    elements=(Wave(parameter("amplitude"), parameter("order"), parameter("phase")),),
    summary="A torque that repeats with the motor's revolution: cogging, commutation, wave generator.",
    equation="A cos(n N q + phi)",
    trace="Over the motor's angle, a wave that repeats every revolution or fraction of one, at any speed.",
    experiment="Slow constant speed over ten revolutions of the motor, so that the wave stays below the cut-off.",
    source="Holtz & Springob 1996, Identification and compensation of torque ripple in high-precision permanent magnet "
    "motor drives, IEEE Trans. Industrial Electronics 43(2)",
    sits_at="motor",
    several=True,
)

_POWER = (parameter("exponent") - 1) / 2

TORQUE_SATURATION = _drive(
    name="torque_saturation",
    torque=PREDICTED * (parameter("coefficient") * PREDICTED**2) ** _POWER,
    parameters=(
        Parameter(
            "coefficient",
            u.ONE / u.FORCE**2,
            "inverse square of the torque at which half of the recorded one acts",
            bounds=NOT_NEGATIVE,
        ),
        Parameter(
            "exponent",
            u.ONE,
            "power of the torque: 3 for a magnet that saturates, 15 for a limit beyond which nothing acts",
            role="shape",
            bounds=(2.0, 16.0),
            # The two kinds alone: a motion hardly tells the powers between them apart.
            grid=Grid(3.0, 15.0, 2, spacing="linear"),
            default=3.0,
        ),
    ),
    form=LinearForm(
        coefficients=(Parameter("excess", u.ONE, "of the recorded torque at 1 N m", bounds=NOT_NEGATIVE),),
        torque=parameter("excess") * PREDICTED * (PREDICTED**2) ** _POWER,
        from_parameters=(parameter("coefficient") ** _POWER,),
        recover=(parameter("excess") ** (1 / _POWER),),
    ),
    summary="The torque constant falls at large current, or the drive has a limit: the recorded torque is too large.",
    equation="tau (c tau^2)^((n - 1)/2), tau the predicted torque: c tau^3 unless n is stated",
    trace="Over the predicted torque, a curve that is visible only at the peaks.",
    experiment="Motion with the largest accelerations in both directions, and with small ones.",
    source="Hanselman 2006, Brushless Permanent Magnet Motor Design",
    sits_at="motor",
)

TORQUE_SCALE = _drive(
    name="torque_scale",
    torque=(parameter("factor") - 1) * PREDICTED,
    parameters=(Parameter("factor", u.ONE, "recorded torque over true torque", bounds=NOT_NEGATIVE, neutral=1.0),),
    elements=(Gain(parameter("factor")),),
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
    elements=(Delay(parameter("time")),),
    summary="Torque and motion are not recorded at the same instant: hold, bus cycle, filter.",
    equation="T d(tau)/dt, tau the predicted torque",
    trace="The residual is proportional to the torque's time derivative, so that it grows with frequency.",
    experiment="Motion over two decades of frequency; the residual of an elasticity grows faster with frequency.",
    source="Ljung 1999, System Identification: Theory for the User",
    sits_at="motor",
)

COMMAND_DELAY = replace(
    TORQUE_DELAY,
    name="command_delay",
    scope="arm",
    summary="All joints' torques are recorded before they act, by the same time: bus, computer, hold of the command.",
    trace="At every joint, the residual is proportional to the torque's time derivative, with the same factor.",
    experiment="All joints at once over two decades of frequency; a joint that is alone tells its own time only.",
    alike_at_joints="torque_delay",
)

TORQUE_LAG = _drive(
    name="torque_lag",
    # u = tau + T d(tau)/dt: exact, whatever the time. A delay is the same to first order, and is named where the band
    # tells no more.
    torque=parameter("time_constant") * PREDICTED_RATE,
    parameters=(
        Parameter(
            "time_constant",
            u.SECOND,
            "after it, 1/e of a step of the recorded torque is still missing from the acting one",
            bounds=NOT_NEGATIVE,
            kind="lag",
            abroad="lag",
        ),
    ),
    elements=(Lag(parameter("time_constant")),),
    summary="The acting torque follows the recorded one with a first-order lag: winding, current control, filter.",
    equation="T d(tau)/dt, tau the predicted torque: u = tau + T d(tau)/dt is recorded",
    trace="At low frequency that of torque_delay; near 1/T, the recorded torque is larger than the acting one.",
    experiment="Motion up to the frequency 1/(2 pi T); below a tenth of it, a lag cannot be told from a delay.",
    source="Isermann 2005, Mechatronic Systems: Fundamentals, Springer",
    sits_at="motor",
    generalises=("torque_delay",),
)

COMMAND_LAG = replace(
    TORQUE_LAG,
    name="command_lag",
    scope="arm",
    summary="All joints' torques follow the recorded ones with the same first-order lag, as equal drives' do.",
    trace="At every joint that of torque_lag, with the same time constant.",
    experiment="All joints at once up to the frequency 1/(2 pi T); below a tenth of it, a lag looks like a delay.",
    alike_at_joints="torque_lag",
    generalises=("command_delay",),
)

EFFECTS = (
    TORQUE_RIPPLE,
    TORQUE_SATURATION,
    TORQUE_SCALE,
    TORQUE_DELAY,
    COMMAND_DELAY,
    TORQUE_LAG,
    COMMAND_LAG,
)
