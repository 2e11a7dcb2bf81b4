"""The contact phase of a 4R arm: w = φ(q) of equation (13), its derivatives and its inverse.

w = [p_4x, p_2y, q_3abs, q_4]: x of the end-effector, y of the END of link 2 (only then is
det J_w = l_1 l_2 sin q_2, which is the paper's statement), absolute angle of link 3, angle of joint 4.
Given the last two and their derivatives, links 3 and 4 move as prescribed, and links 1 and 2 solve a 2×2
system in closed form. It is regular wherever sin q_2 ≠ 0; an LU of J_w would also divide by cos q_1.
"""

from __future__ import annotations

from typing import Any

import sympy as sp

from symbolic.functions import Argument, Author, SymbolicFunction, output
from symbolic.rigid_body.newton_euler import Chain
from symbolic.straightline import Recorder

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
"""What these functions call their values, for whoever reads the generated code."""


def has_contact_phase(chain: Chain) -> bool:
    """Whether the arm has the coordinates of (13): four revolute joints, no length of links 1 and 2 zero."""
    return chain.revolute == (True,) * 4 and chain.lengths[0] != 0 and chain.lengths[1] != 0


def contact_functions(author: Author, chain: Chain) -> list[SymbolicFunction]:
    """contact_coordinates, _jacobian, _bias, _inverse, _acceleration. `chain`: lengths in m."""
    return [make(author, chain.lengths) for make in (_coordinates, _jacobian, _bias, _inverse, _acceleration)]


def _w(name: str, unit: str, meaning: str) -> Argument:
    return Argument(name, tuple(sp.Symbol(f"{name}{i}", real=True) for i in range(1, 5)), (4,), unit, meaning)


def _links(author: Author, lengths: tuple[Any, ...], recorder: Recorder) -> tuple[list[Any], list[Any], list[Any]]:
    """Absolute angles, and each link's extent along x and y."""
    angle: Any = 0
    angles, x, y = [], [], []
    for i, q in enumerate(author.coordinates.symbols("q")):
        angle = recorder.let(f"theta{i + 1}", angle + q)
        c, s = recorder.sincos(angle)
        angles.append(angle)
        x.append(recorder.let(f"x{i + 1}", lengths[i] * c))
        y.append(recorder.let(f"y{i + 1}", lengths[i] * s))
    return angles, x, y


def _rates(author: Author, name: str, recorder: Recorder) -> list[Any]:
    w: Any = 0
    rates = []
    for i, qd in enumerate(author.coordinates.symbols(name)):
        w = recorder.let(f"w{i + 1}", w + qd)
        rates.append(w)
    return rates


def _coordinates(author: Author, lengths: tuple[Any, ...]) -> SymbolicFunction:
    recorder = author.recorder()
    angles, x, y = _links(author, lengths, recorder)
    w = [sum(x), y[0] + y[1], angles[2], author.coordinates.symbols("q")[3]]
    return author.function(
        "contact_coordinates",
        ("q",),
        output("w", w, (4,), unit=W_UNIT, meaning="p_4x, p_2y, absolute angle of link 3, q_4"),
        recorder,
        doc="Coordinates w = phi(q) of the contact phase.",
        source="Equation (13); p_2 is the end of link 2",
        notation=CONTACT_NOTATION,
    )


def _jacobian(author: Author, lengths: tuple[Any, ...]) -> SymbolicFunction:
    recorder = author.recorder()
    _, x, y = _links(author, lengths, recorder)
    x4 = recorder.let("r4", y[3])
    x3 = recorder.let("r3", x4 + y[2])
    x2 = recorder.let("r2", x3 + y[1])
    rows = [-x2 - y[0], -x2, -x3, -x4, x[0] + x[1], x[1], 0, 0, 1, 1, 1, 0, 0, 0, 0, 1]
    return author.function(
        "contact_jacobian",
        ("q",),
        output("J_w", rows, (4, 4), unit="m/rad, m/rad, 1, 1 by row", meaning="derivative of w by q"),
        recorder,
        doc="J_w = dw/dq, singular exactly where sin q_2 = 0: det J_w = l_1 l_2 sin q_2.",
        source="Equation (14)",
        notation=CONTACT_NOTATION,
    )


def _bias(author: Author, lengths: tuple[Any, ...]) -> SymbolicFunction:
    recorder = author.recorder()
    _, x, y = _links(author, lengths, recorder)
    squares = [recorder.let(f"ww{i + 1}", w * w) for i, w in enumerate(_rates(author, "qd", recorder))]
    bias = [-sum(a * b for a, b in zip(x, squares, strict=True)), -y[0] * squares[0] - y[1] * squares[1], 0, 0]
    return author.function(
        "contact_bias",
        ("q", "qd"),
        output("b_w", bias, (4,), unit="m/s^2, m/s^2, rad/s^2, rad/s^2", meaning="acceleration of w at qdd = 0"),
        recorder,
        doc="b_w = (dJ_w/dt) qd.",
        source="Equation (14), with the factor qd",
        notation=CONTACT_NOTATION,
    )


def _inverse(author: Author, lengths: tuple[Any, ...]) -> SymbolicFunction:
    recorder = author.recorder()
    let = recorder.let
    w = _w("w", W_UNIT, "p_4x, p_2y, absolute angle of link 3, q_4")
    elbow = Argument("elbow", (sp.Symbol("elbow", real=True),), (), "1", "sign of sin q_2: 1 or -1")
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
    return author.function(
        "contact_inverse",
        (w, elbow),
        output(
            "q",
            [q1, q2, w3 - q1 - q2, w4],
            (4,),
            unit="rad",
            meaning="joint positions; not a number where w is out of reach",
        ),
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


def _acceleration(author: Author, lengths: tuple[Any, ...]) -> SymbolicFunction:
    recorder = author.recorder()
    let = recorder.let
    wdd = _w("wdd", "m/s^2, m/s^2, rad/s^2, rad/s^2", "second derivative of w")
    _, x, y = _links(author, lengths, recorder)
    w = [let(f"ww{i + 1}", r * r) for i, r in enumerate(_rates(author, "qd", recorder))]
    v1, v2, al3, v4 = wdd.symbols
    al4 = let("al4", al3 + v4)
    # What links 1 and 2 have to contribute to the accelerations of p_4x and p_2y:
    # [−y1 −y2; x1 x2] [al1; al2] = [ax; ay], of determinant x1 y2 − x2 y1 = l1 l2 sin q_2.
    ax = let("ax", v1 + x[0] * w[0] + x[1] * w[1] + x[2] * w[2] + x[3] * w[3] + y[2] * al3 + y[3] * al4)
    ay = let("ay", v2 + y[0] * w[0] + y[1] * w[1])
    _, elbow = recorder.sincos(author.coordinates.symbols("q")[1])
    determinant = let("det", lengths[0] * lengths[1] * elbow)  # exactly 0 at q_2 = 0, unlike a difference of products
    scale = let("scale", 1 / determinant)
    al1 = let("al1", (x[1] * ax + y[1] * ay) * scale)
    al2 = let("al2", -(x[0] * ax + y[0] * ay) * scale)
    return author.function(
        "contact_acceleration",
        ("q", "qd", wdd),
        output("qdd", [al1, al2 - al1, al3 - al2, v4], (4,), unit="rad/s^2", meaning="joint accelerations"),
        recorder,
        doc="qdd = J_w^-1 (wdd - b_w); infinite where sin q_2 = 0.",
        source="Equation (14), solved for qdd",
        notation=CONTACT_NOTATION,
    )
