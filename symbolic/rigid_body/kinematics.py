"""The end-effector's position, rates and loads, and the coordinates of the contact phase of a four-joint arm.

The contact phase has w = φ(q) of equation (13): w = [p_4x, p_2y, q_3abs, q_4], x of the end-effector, y of the END of
link 2 (only then is det J_w = l_1 l_2 sin q_2, which is the paper's statement), absolute angle of link 3, angle of
joint 4. Given the last two and their derivatives, links 1 and 2 solve a 2×2 system in closed form. It is regular
wherever sin q_2 ≠ 0; an LU decomposition of J_w would also divide by cos q_1.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import sympy as sp

from symbolic.functions import Argument, Author, Recorder, SymbolicFunction, output
from symbolic.model_file.arm import Arm
from symbolic.rigid_body.base_parameters import lumps_of
from symbolic.rigid_body.lagrangian import Components, derivative, distal_points, moved, rational
from symbolic.rigid_body.newton_euler import Chain, motion, notation, torques

NOTATION = {"theta": "absolute angle of a link", "c, s": "cosine and sine; c12 of q1 + q2"}


def functions(author: Author, arm: Arm, chain: Chain, frame: int) -> list[SymbolicFunction]:
    """tip, tip_jacobian, tip_rate, tip_load, moment_jacobian. chain: lengths in m, gravity in m/s²."""
    return [*_tip(author, chain), _tip_load(author, chain, frame), _moment(author, arm)]


def base_coordinates(vector: Components, directions: dict[int, tuple[Any, Any]]) -> tuple[Any, Any]:
    """(x, y) of a vector given by its components along directions (cos, sin)."""
    x: Any = 0
    y: Any = 0
    for k, (along, across) in vector.items():
        c, s = directions[k]
        x, y = x + along * c - across * s, y + along * s + across * c
    return x, y


def directions(revolute: Sequence[bool], q: Sequence[Any], recorder: Recorder) -> dict[int, tuple[Any, Any]]:
    """(cos, sin) of the absolute angle of every frame."""
    result: dict[int, tuple[Any, Any]] = {0: (sp.Integer(1), sp.Integer(0))}
    angle: Any = 0
    for i, turns in enumerate(revolute):
        if turns:
            angle = recorder.let(f"theta{i + 1}", angle + q[i])
            result[i + 1] = recorder.sincos(angle)
    return result


def _tip(author: Author, chain: Chain) -> list[SymbolicFunction]:
    recorder, q, qd = author.recorder(), author.coordinates.symbols("q"), author.coordinates.symbols("qd")
    turned, point = directions(chain.revolute, q, recorder), distal_points(chain, q)[-1]
    angle = sum(q[i] for i, turns in enumerate(chain.revolute) if turns)
    position = (*base_coordinates(point, turned), angle)
    columns = _columns(point, chain, turned, recorder)
    rows = [[x for x, _ in columns], [y for _, y in columns], [int(turns) for turns in chain.revolute]]
    rates = [sum((slope * rate for slope, rate in zip(row, qd, strict=True)), sp.Integer(0)) for row in rows]
    unit = author.coordinates.unit("m/rad", "1")
    made = partial(author.function, recorder=recorder)
    slopes = NOTATION | {"x, y": "derivative of the tip by the angle of a joint"}
    return [
        made(
            "tip",
            ("q",),
            output("p", position, unit="m, m, rad", meaning="x, y and absolute angle of the last link"),
            doc="Position and angle of the end-effector, the distal point of the last link.",
            source="Forward kinematics; p_4 of equation (12)",
            notation=NOTATION,
        ),
        made(
            "tip_jacobian",
            ("q",),
            output("J", rows, unit=unit, meaning="rows x, y, angle"),
            doc="Derivative of the end-effector's position and angle by q.",
            source="J of equation (1)",
            notation=slopes,
        ),
        made(
            "tip_rate",
            ("q", "qd"),
            output("v", rates, unit="m/s, m/s, rad/s", meaning="rates of x, y and angle"),
            doc="Rate of the end-effector's position and angle.",
            source="J qd, with J of equation (1)",
            notation=slopes,
        ),
    ]


def _columns(
    point: Components,
    chain: Chain,
    turned: dict[int, tuple[Any, Any]],
    recorder: Recorder,
    weights: Sequence[Any] | None = None,
) -> list[tuple[Any, Any]]:
    """∂point/∂q_i in base coordinates, for a point on the last link, by sums from the tip inwards.

    weights   (n,) motion of the point per slide of joint i; None: 1
    """
    x: Any = 0
    y: Any = 0
    columns: list[tuple[Any, Any]] = [(0, 0)] * chain.n
    for i in reversed(range(chain.n)):
        slope = derivative(point, chain, i)
        dx, dy = base_coordinates({slope[0]: slope[1:]}, turned) if slope else (0, 0)
        if chain.revolute[i]:
            x, y = recorder.let(f"x{i + 1}", x + dx), recorder.let(f"y{i + 1}", y + dy)
            columns[i] = (x, y)
        else:
            weight = 1 if weights is None else weights[i]
            columns[i] = (weight * dx, weight * dy)
    return columns


def _tip_load(author: Author, chain: Chain, frame: int) -> SymbolicFunction:
    recorder, n = author.recorder(), chain.n
    q, qd, qdd = (author.coordinates.symbols(name) for name in ("q", "qd", "qdd"))
    moving = motion(chain, frame, q, qd=qd, qdd=qdd, notes=recorder)
    load = torques(chain, lumps_of({("mu", n - 1): 1}, n), moving, qdd=qdd, notes=recorder)
    return author.function(
        "tip_load",
        ("q", "qd", "qdd"),
        output("load", load, unit=author.coordinates.unit("N m/kg", "N/kg"), meaning="torque per unit mass"),
        recorder,
        doc="Torques that a unit mass at the end-effector asks of the joints: J^T (acceleration - gravity).",
        source="Newton-Euler recursion with one point mass",
        notation=notation(frame),
    )


NOMINAL_MASS = 1.0
"""kg; replaces an unknown link mass; a gravity effect fitted to such a model refers to this mass."""


def _moment(author: Author, arm: Arm) -> SymbolicFunction:
    recorder, q = author.recorder(), author.coordinates.symbols("q")
    lengths = tuple(map(rational, arm.lengths))
    chain = Chain(tuple(j.type == "revolute" for j in arm.joints), lengths, None)
    total: Components = {}
    masses = [rational(NOMINAL_MASS if j.link.mass is None else j.link.mass) for j in arm.joints]
    for i, (joint, point) in enumerate(zip(arm.joints, distal_points(chain, q)[:-1], strict=True)):
        # An unknown centre of mass is put in the middle of the link, or 1 m from the joint if the link has no length.
        along, across, _ = (rational(c) for c in joint.link.com or (arm.lengths[i] / 2 or 1.0, 0.0, 0.0))
        centre = moved(point, chain.frames[i], along if chain.revolute[i] else along + q[i], across)
        for frame, (x, y) in centre.items():
            total = moved(total, frame, masses[i] * x, masses[i] * y)
    outer = [sum(masses[i:], sp.Integer(0)) for i in range(chain.n)]
    columns = _columns(total, chain, directions(chain.revolute, q, recorder), recorder=recorder, weights=outer)
    rows = list(zip(*columns, strict=True))
    return author.function(
        "moment_jacobian",
        ("q",),
        output("M", rows, unit=author.coordinates.unit("kg m/rad", "kg"), meaning="rows x, y"),
        recorder,
        doc="Derivative of the arm's first mass moment, the sum of mass times position, by q; "
        "masses of the model file.",
        source="Potential energy V = -gravity . sum m_i c_i",
        notation=NOTATION | {"x, y": "derivative of the moment by the angle of a joint"},
    )


W_UNIT = "m, m, rad, rad"
CONTACT_NOTATION = {
    "theta": "absolute angle of a link",
    "c, s": "cosine and sine; c12 of q1 + q2",
    "x, y": "extent of a link",
    "r": "extents along y from here to the tip",
    "w": "absolute rate of a link",
    "ww": "w squared",
    "al": "absolute acceleration of a link",
    "ax, ay": "what links 1 and 2 have to add to the acceleration of p_4x, p_2y",
}
"""The meaning of names in the generated code."""


def has_contact_phase(chain: Chain) -> bool:
    """Whether the coordinates of (13) exist: four revolute joints, and nonzero lengths of links 1 and 2."""
    return chain.revolute == (True,) * 4 and chain.lengths[0] != 0 and chain.lengths[1] != 0


def contact_functions(author: Author, chain: Chain) -> list[SymbolicFunction]:
    """contact_coordinates, _jacobian, _bias, _inverse, _acceleration. chain: lengths in m."""
    recorder = author.recorder()
    made = partial(author.function, recorder=recorder, notation=CONTACT_NOTATION)
    q, angle = author.coordinates.symbols("q"), sp.Integer(0)
    angles, x, y = [], [], []  # absolute angles, and the links' extents along x and y
    for i, length in enumerate(chain.lengths):
        angle = recorder.let(f"theta{i + 1}", angle + q[i])
        c, s = recorder.sincos(angle)
        angles.append(angle)
        x.append(recorder.let(f"x{i + 1}", length * c))
        y.append(recorder.let(f"y{i + 1}", length * s))
    w = [sum(x), y[0] + y[1], angles[2], q[3]]
    r4 = recorder.let("r4", y[3])
    r3 = recorder.let("r3", r4 + y[2])
    r2 = recorder.let("r2", r3 + y[1])
    rows = [[-r2 - y[0], -r2, -r3, -r4], [x[0] + x[1], x[1], 0, 0], [1, 1, 1, 0], [0, 0, 0, 1]]
    rates: list[Any] = [0]
    for i, qd in enumerate(author.coordinates.symbols("qd"), 1):
        rates.append(recorder.let(f"w{i}", rates[-1] + qd))
    squares = [recorder.let(f"ww{i}", rate * rate) for i, rate in enumerate(rates[1:], 1)]
    bias = [-sum(a * b for a, b in zip(x, squares, strict=True)), -y[0] * squares[0] - y[1] * squares[1], 0, 0]
    wdd = _w("wdd", "m/s^2, m/s^2, rad/s^2, rad/s^2", "second derivative of w")
    qdd = _acceleration(recorder, chain.lengths, wdd.symbols, squares, extents=(x, y), q2=q[1])
    return [
        made(
            "contact_coordinates",
            ("q",),
            output("w", w, unit=W_UNIT, meaning="p_4x, p_2y, absolute angle of link 3, q_4"),
            doc="Coordinates w = phi(q) of the contact phase.",
            source="Equation (13); p_2 is the end of link 2",
        ),
        made(
            "contact_jacobian",
            ("q",),
            output("J_w", rows, unit="m/rad, m/rad, 1, 1 by row", meaning="derivative of w by q"),
            doc="J_w = dw/dq, singular exactly where sin q_2 = 0: det J_w = l_1 l_2 sin q_2.",
            source="Equation (14)",
        ),
        made(
            "contact_bias",
            ("q", "qd"),
            output("b_w", bias, unit="m/s^2, m/s^2, rad/s^2, rad/s^2", meaning="acceleration of w at qdd = 0"),
            doc="b_w = (dJ_w/dt) qd.",
            source="Equation (14), with the factor qd",
        ),
        _inverse(author, chain.lengths),
        made(
            "contact_acceleration",
            ("q", "qd", wdd),
            output("qdd", qdd, unit="rad/s^2", meaning="joint accelerations"),
            doc="qdd = J_w^-1 (wdd - b_w); infinite where sin q_2 = 0.",
            source="Equation (14), solved for qdd",
        ),
    ]


def _w(name: str, unit: str, meaning: str) -> Argument:
    return Argument(
        name, tuple(sp.Symbol(f"{name}{i}", real=True) for i in range(1, 5)), (4,), unit=unit, meaning=meaning
    )


def _inverse(author: Author, lengths: tuple[Any, ...]) -> SymbolicFunction:
    recorder = author.recorder()
    let = recorder.let
    w = _w("w", W_UNIT, "p_4x, p_2y, absolute angle of link 3, q_4")
    elbow = Argument("elbow", (sp.Symbol("elbow", real=True),), (), unit="1", meaning="sign of sin q_2: 1 or -1")
    w1, w2, w3, w4 = w.symbols
    l1, l2, l3, l4 = lengths
    c3, _ = recorder.sincos(w3)
    c4, _ = recorder.sincos(let("theta4", w3 + w4))
    x = let("x", w1 - l3 * c3 - l4 * c4)
    cosine = let("c2", (x * x + w2 * w2 - l1 * l1 - l2 * l2) / (2 * l1 * l2))
    sine = let("s2", elbow.symbols[0] * sp.sqrt(1 - cosine * cosine))
    along, across = let("along", l1 + l2 * cosine), let("across", l2 * sine)
    q1 = let("first", sp.atan2(w2 * along - x * across, x * along + w2 * across))
    q2 = let("second", sp.atan2(sine, cosine))
    q = [q1, q2, w3 - q1 - q2, w4]
    return author.function(
        "contact_inverse",
        (w, elbow),
        output("q", q, unit="rad", meaning="joint positions; not a number where w is out of reach"),
        recorder,
        doc="q = phi^-1(w) on the side of the elbow that is asked for; q_1 and q_2 within (-pi, pi].",
        source="Equation (13), triangle of links 1 and 2",
        notation={
            "x": "x of the end of link 2",
            "theta": "absolute angle of a link",
            "c, s": "cosine and sine of q2",
            "along, across": "end of link 2 in the frame of link 1",
            "first, second": "q1, q2",
        },
    )


def _acceleration(
    recorder: Recorder,
    lengths: tuple[Any, ...],
    wdd: Sequence[Any],
    squares: Sequence[Any],
    extents: tuple[list[Any], list[Any]],
    q2: Any,
) -> list[Any]:
    """qdd (4,) for wdd. squares: of the links' absolute rates; extents: of the links along x and y."""
    let, (x, y), w = recorder.let, extents, squares
    v1, v2, al3, v4 = wdd
    al4 = let("al4", al3 + v4)
    # Required contributions of links 1 and 2 to the accelerations of p_4x and p_2y:
    # [−y1 −y2; x1 x2] [al1; al2] = [ax; ay], of determinant x1 y2 − x2 y1 = l1 l2 sin q_2.
    ax = let("ax", v1 + x[0] * w[0] + x[1] * w[1] + x[2] * w[2] + x[3] * w[3] + y[2] * al3 + y[3] * al4)
    ay = let("ay", v2 + y[0] * w[0] + y[1] * w[1])
    # Exactly 0 at q_2 = 0, unlike a difference of products.
    scale = let("scale", 1 / let("det", lengths[0] * lengths[1] * recorder.sincos(q2)[1]))
    al1 = let("al1", (x[1] * ax + y[1] * ay) * scale)
    al2 = let("al2", -(x[0] * ax + y[0] * ay) * scale)
    return [al1, al2 - al1, al3 - al2, v4]
