"""Where the end-effector is, how it moves, and what a mass there asks of the joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy as sp

from symbolic.functions import Author, SymbolicFunction, output
from symbolic.model_file.arm import Arm
from symbolic.rigid_body.base_parameters import unit_lumps
from symbolic.rigid_body.lagrangian import Components, derivative, distal_points, moved, rational
from symbolic.rigid_body.newton_euler import Chain, motion, notation, torques
from symbolic.straightline import Recorder

NOTATION = {"theta": "absolute angle of a link", "c, s": "cosine and sine; c12 of q1 + q2"}


def functions(author: Author, arm: Arm, chain: Chain, frame: int) -> list[SymbolicFunction]:
    """tip, tip_jacobian, tip_rate, tip_load, moment_jacobian. `chain`: lengths in m, gravity in m/s²."""
    return [
        _tip(author, chain),
        *_tip_motion(author, chain),
        _tip_load(author, chain, frame),
        _moment(author, arm),
    ]


def base_coordinates(vector: Components, directions: dict[int, tuple[Any, Any]]) -> tuple[Any, Any]:
    """(x, y) of a vector given by components along directions (cos, sin)."""
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


def _tip(author: Author, chain: Chain) -> SymbolicFunction:
    recorder, q = author.recorder(), author.coordinates.symbols("q")
    x, y = base_coordinates(distal_points(chain, q)[-1], directions(chain.revolute, q, recorder))
    angle = sum(q[i] for i, turns in enumerate(chain.revolute) if turns)
    return author.function(
        "tip",
        ("q",),
        output("p", (x, y, angle), (3,), unit="m, m, rad", meaning="x, y and absolute angle of the last link"),
        recorder,
        doc="Position and angle of the end-effector, the distal point of the last link.",
        source="Forward kinematics; p_4 of equation (12)",
        notation=NOTATION,
    )


def _tip_motion(author: Author, chain: Chain) -> list[SymbolicFunction]:
    recorder, q, qd = author.recorder(), author.coordinates.symbols("q"), author.coordinates.symbols("qd")
    turned = directions(chain.revolute, q, recorder)
    columns = _columns(distal_points(chain, q)[-1], chain, turned, recorder)
    rows = [[x for x, _ in columns], [y for _, y in columns], [int(turns) for turns in chain.revolute]]
    rates = [sum((slope * rate for slope, rate in zip(row, qd, strict=True)), sp.Integer(0)) for row in rows]
    unit = author.coordinates.unit("m/rad", "1")
    return [
        author.function(
            "tip_jacobian",
            ("q",),
            output("J", [e for row in rows for e in row], (3, chain.n), unit=unit, meaning="rows x, y, angle"),
            recorder,
            doc="Derivative of the end-effector's position and angle by q.",
            source="J of equation (1)",
            notation=NOTATION | {"x, y": "derivative of the tip by the angle of a joint"},
        ),
        author.function(
            "tip_rate",
            ("q", "qd"),
            output("v", rates, (3,), unit="m/s, m/s, rad/s", meaning="rates of x, y and angle"),
            recorder,
            doc="Rate of the end-effector's position and angle.",
            source="J qd, with J of equation (1)",
            notation=NOTATION | {"x, y": "derivative of the tip by the angle of a joint"},
        ),
    ]


def _columns(
    point: Components,
    chain: Chain,
    turned: dict[int, tuple[Any, Any]],
    recorder: Recorder,
    weights: Sequence[Any] | None = None,
) -> list[tuple[Any, Any]]:
    """∂point/∂q_i in base coordinates, for a point on the last link: sums from the tip inwards.

    weights (n,): by how much the point moves per slide of joint i; 1 for a plain point.
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
    moving = motion(chain, frame, q, qd, qdd, recorder)
    load = torques(chain, unit_lumps(n, ("mu", n - 1)), moving, qdd, recorder)
    return author.function(
        "tip_load",
        ("q", "qd", "qdd"),
        output("load", load, (n,), unit=author.coordinates.unit("N m/kg", "N/kg"), meaning="torque per unit mass"),
        recorder,
        doc="Torques that a unit mass at the end-effector asks of the joints: J^T (acceleration - gravity).",
        source="Newton-Euler recursion with one point mass",
        notation=notation(frame),
    )


NOMINAL_MASS = 1.0
"""kg; stands for a link's mass that is not known: the gravity that a fit then finds is that of a link of this mass."""


def _moment(author: Author, arm: Arm) -> SymbolicFunction:
    recorder, q = author.recorder(), author.coordinates.symbols("q")
    lengths = tuple(map(rational, arm.lengths))
    chain = Chain(tuple(j.type == "revolute" for j in arm.joints), lengths, None)
    total: Components = {}
    masses = [rational(NOMINAL_MASS if j.link.mass is None else j.link.mass) for j in arm.joints]
    for i, (joint, point) in enumerate(zip(arm.joints, distal_points(chain, q)[:-1], strict=True)):
        # An unknown centre of mass is taken in the middle of the link, 1 m from the joint if the link has no length.
        along, across, _ = (rational(c) for c in joint.link.com or (arm.lengths[i] / 2 or 1.0, 0.0, 0.0))
        centre = moved(point, chain.frames[i], along if chain.revolute[i] else along + q[i], across)
        for frame, (x, y) in centre.items():
            total = moved(total, frame, masses[i] * x, masses[i] * y)
    outer = [sum(masses[i:], sp.Integer(0)) for i in range(chain.n)]
    columns = _columns(total, chain, directions(chain.revolute, q, recorder), recorder, outer)
    rows = [*(x for x, _ in columns), *(y for _, y in columns)]
    return author.function(
        "moment_jacobian",
        ("q",),
        output("M", rows, (2, chain.n), unit=author.coordinates.unit("kg m/rad", "kg"), meaning="rows x, y"),
        recorder,
        doc="Derivative of the arm's first mass moment, the sum of mass times position, by q; masses of the model file.",
        source="Potential energy V = -gravity . sum m_i c_i",
        notation=NOTATION | {"x, y": "derivative of the moment by the angle of a joint"},
    )
