"""Functions of the planar equation of motion in lumped parameters: inverse and forward dynamics, D, C, g, Y."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import sympy as sp

from symbolic.functions import Author, Continuation, Recorder, Suffixed, SymbolicFunction, output
from symbolic.rigid_body.base_parameters import Column, lumps_of
from symbolic.rigid_body.lagrangian import NOTATION, Body, Mechanics, distal_points, mechanics
from symbolic.rigid_body.newton_euler import Chain, Lumps, inverse_dynamics, motion, notation, torques

EQUATIONS = {
    "inverse_dynamics": (("q", "qd", "qdd"), "tau", "joint torques", "tau = D(q) qdd + C(q, qd) qd + g(q)."),
    "link_load": (
        ("q", "qd", "qdd"),
        "load",
        "at the joints' outputs",
        "Torque that every joint transmits to its link: inverse dynamics without the joint's own rotor.",
    ),
    "inertia": (
        ("q",),
        "D",
        "inertia matrix, symmetric and positive definite",
        "Inertia matrix D(q), rotors included.",
    ),
    "link_inertia": (
        ("q",),
        "D",
        "inertia matrix without the rotors",
        "Inertia of the links as the joints see it: D(q) less the rotors.",
    ),
    "coriolis": (
        ("q", "qd"),
        "C",
        "Coriolis matrix; dD/dt - 2 C is skew-symmetric",
        "Coriolis and centrifugal matrix C(q, qd) from Christoffel symbols.",
    ),
    "gravity": (
        ("q",),
        "g",
        "gravity torques",
        "Gravity torques g(q) = dV/dq; zero where the model file has no gravity.",
    ),
    "forward_dynamics": (("q", "qd", "tau"), "qdd", "joint accelerations", "qdd = D(q)^-1 (tau - C(q, qd) qd - g(q))."),
    "regressor": (
        ("q", "qd", "qdd"),
        "Y",
        "derivative of the torques by the lumped parameters",
        "tau = Y(q, qd, qdd) lumps, exactly: the torques have no part that is constant in the lumps.",
    ),
}
"""Inputs, output, meaning of the output and description of the functions that planar and spatial arms have."""


def equation(
    author: Author,
    recorder: Recorder,
    name: str,
    values: Sequence[Any],
    *,
    source: str,
    notation: Mapping[str, str],
    continues: Continuation | None = None,
) -> SymbolicFunction:
    """One of EQUATIONS; values: (n,), or the rows of a matrix."""
    inputs, label, meaning, doc = EQUATIONS[name]
    coordinates = author.coordinates
    mixed = " or " in coordinates.force
    units = {
        "D": "kg m^2, kg m or kg" if mixed else coordinates.unit("kg m^2", "kg"),
        "C": "per entry: torque by rate" if mixed else coordinates.unit("kg m^2/s", "kg/s"),
        "Y": "torque by lump",
        "qdd": coordinates.argument("qdd").unit,
    }
    made = output(label, values, unit=units.get(label, coordinates.force), meaning=meaning)
    return author.function(name, inputs, made, recorder, doc=doc, source=source, notation=notation, continues=continues)


def functions(
    author: Author, chain: Chain, symbols: dict[Column, sp.Symbol], frame: int, rotors: Sequence[sp.Expr]
) -> list[SymbolicFunction]:
    """All functions of D qdd + C qd + g = tau.

    symbols   the base parameters     frame   see newton_euler     rotors   (n,) rotor inertias, kg m² (kg)
    """
    lumps = lumps_of(symbols, chain.n)
    return [
        *_inverse_dynamics(author, chain, lumps, frame=frame, rotors=rotors),
        *_closed_forms(author, chain, lumps, rotors),
        _forward_dynamics(author, chain, lumps, frame),
        _regressor(author, chain, tuple(symbols), frame),
    ]


def _inverse_dynamics(
    author: Author, chain: Chain, lumps: Lumps, frame: int, rotors: Sequence[sp.Expr]
) -> list[SymbolicFunction]:
    recorder = author.recorder()
    q, qd, qdd = (author.coordinates.symbols(name) for name in ("q", "qd", "qdd"))
    tau = inverse_dynamics(chain, lumps, frame, q=q, qd=qd, qdd=qdd, notes=recorder)
    whole = [recorder.let(f"whole{i + 1}", torque) for i, torque in enumerate(tau)]
    load = [torque - rotor * a for torque, rotor, a in zip(whole, rotors, qdd, strict=True)]
    made = partial(equation, author, recorder)
    return [
        made(
            "inverse_dynamics",
            tau,
            source="Equation (1) without friction, springs and contact; Newton-Euler recursion on lumped parameters",
            notation=notation(frame),
        ),
        made(
            "link_load",
            load,
            source="Equation (1) less the model file's rotor inertia times qdd",
            notation=notation(frame) | {"whole": "torque of a joint, its rotor included"},
        ),
    ]


def _mechanics(author: Author, chain: Chain, lumps: Lumps, recorder: Recorder) -> Mechanics:
    q, qd = author.coordinates.symbols("q"), author.coordinates.symbols("qd")
    points, bodies = distal_points(chain, q), []
    for i, revolute in enumerate(chain.revolute):
        about, moment = points[i if revolute else i + 1], (lumps.h[i], lumps.hy[i])
        bodies.append(Body(lumps.mu[i], points[i + 1], moment, about=about, inertia=lumps.J[i]))
    return mechanics(chain, bodies, list(lumps.I), q=q, qd=qd, notes=recorder)


def _closed_forms(author: Author, chain: Chain, lumps: Lumps, rotors: Sequence[sp.Expr]) -> list[SymbolicFunction]:
    recorder = author.recorder()
    m = _mechanics(author, chain, lumps, recorder)
    own = [recorder.let(f"D{i + 1}{i + 1}", m.D[i][i]) - rotor for i, rotor in enumerate(rotors)]
    links = [[own[i] if i == j else e for j, e in enumerate(row)] for i, row in enumerate(m.D)]
    made = partial(equation, author, recorder, notation=NOTATION)
    return [
        made("inertia", m.D, source="Lagrangian; D of equation (1)"),
        made(
            "link_inertia",
            links,
            source="Lagrangian; the model file's rotor inertias",
            notation=NOTATION | {"D": "inertia of a joint, its rotor included"},
        ),
        made("coriolis", m.C, source="Lagrangian; C of equation (1); Spong & Vidyasagar 1989"),
        made("gravity", m.g, source="Lagrangian"),
    ]


def _forward_dynamics(author: Author, chain: Chain, lumps: Lumps, frame: int) -> SymbolicFunction:
    recorder, n = author.recorder(), chain.n
    q, qd, tau = (author.coordinates.symbols(name) for name in ("q", "qd", "tau"))
    bias = inverse_dynamics(chain, lumps, frame, q=q, qd=qd, qdd=[0] * n, notes=recorder)
    D = _mechanics(author, chain, lumps, recorder).D
    qdd = solve_symmetric(D, [t - b for t, b in zip(tau, bias, strict=True)], recorder)
    return equation(
        author,
        recorder,
        "forward_dynamics",
        qdd,
        source="Equation (1) solved for qdd by D = L diag(d) L^T",
        notation=notation(frame)
        | NOTATION
        | {"L, d": "D = L diag(d) L^T", "Ld": "L diag(d)", "e": "1/d", "z, x": "substitution"},
    )


def solve_symmetric(D: list[list[Any]], right: list[Any], recorder: Recorder) -> list[Any]:
    """Solve D x = right for a positive definite D (n, n), by D = L diag(d) Lᵀ; reads only the lower triangle."""
    n, let = len(D), recorder.let
    L = [[sp.Integer(0)] * n for _ in range(n)]
    scaled = [[sp.Integer(0)] * n for _ in range(n)]  # L diag(d)
    inverse: list[Any] = []
    x = list(right)
    for i in range(n):
        for j in range(i):
            scaled[i][j] = let(f"Ld{i + 1}{j + 1}", D[i][j] - sum(scaled[i][k] * L[j][k] for k in range(j)))
        for j in range(i):
            L[i][j] = let(f"L{i + 1}{j + 1}", scaled[i][j] * inverse[j])
        pivot = let(f"d{i + 1}", D[i][i] - sum(scaled[i][k] * L[i][k] for k in range(i)))
        inverse.append(let(f"e{i + 1}", 1 / pivot))
        x[i] = let(f"z{i + 1}", x[i] - sum(L[i][k] * x[k] for k in range(i)))
    for i in reversed(range(n)):
        x[i] = let(f"x{i + 1}", x[i] * inverse[i] - sum(L[k][i] * x[k] for k in range(i + 1, n)))
    return x


def _regressor(author: Author, chain: Chain, columns: tuple[Column, ...], frame: int) -> SymbolicFunction:
    recorder, n = author.recorder(), chain.n
    q, qd, qdd = (author.coordinates.symbols(name) for name in ("q", "qd", "qdd"))
    moving = motion(chain, frame, q, qd=qd, qdd=qdd, notes=recorder)
    parts = []
    for kind, i in columns:
        notes = Suffixed(recorder, f"_{kind}{i + 1}")
        parts.append(torques(chain, lumps_of({(kind, i): 1}, n), moving, qdd=qdd, notes=notes))
    Y = list(zip(*parts, strict=True))
    return equation(
        author,
        recorder,
        "regressor",
        Y,
        source="Newton-Euler recursion with one lump at a time; Gautier & Khalil 1990",
        notation=notation(frame) | {"N": "moment of the lump that is named, alone"},
    )
