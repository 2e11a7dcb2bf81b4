"""Functions of the planar equation of motion in lumped parameters: inverse and forward dynamics, D, C, g, Y."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy as sp

from symbolic.functions import Author, Recorder, Suffixed, SymbolicFunction, output
from symbolic.rigid_body.base_parameters import Column, lumps_of, unit_lumps
from symbolic.rigid_body.lagrangian import NOTATION, Mechanics, lumped_bodies, mechanics
from symbolic.rigid_body.newton_euler import Chain, Lumps, inverse_dynamics, motion, notation, torques


def functions(
    author: Author, chain: Chain, symbols: dict[Column, sp.Symbol], frame: int, rotors: Sequence[sp.Expr]
) -> list[SymbolicFunction]:
    """All functions of D qdd + C qd + g = tau.

    symbols   the base parameters     frame   see newton_euler     rotors   (n,) rotor inertias, kg m² (kg)
    """
    lumps = lumps_of(symbols, chain.n)
    return [
        *_inverse_dynamics(author, chain, lumps, frame, rotors),
        *_closed_forms(author, chain, lumps, rotors),
        _forward_dynamics(author, chain, lumps, frame),
        _regressor(author, chain, tuple(symbols), frame),
    ]


def _inverse_dynamics(
    author: Author, chain: Chain, lumps: Lumps, frame: int, rotors: Sequence[sp.Expr]
) -> list[SymbolicFunction]:
    recorder = author.recorder()
    q, qd, qdd = (author.coordinates.symbols(name) for name in ("q", "qd", "qdd"))
    tau = inverse_dynamics(chain, lumps, frame, q, qd, qdd, recorder)
    whole = [recorder.let(f"whole{i + 1}", torque) for i, torque in enumerate(tau)]
    load = [torque - rotor * a for torque, rotor, a in zip(whole, rotors, qdd, strict=True)]
    return [
        author.function(
            "inverse_dynamics",
            ("q", "qd", "qdd"),
            output("tau", tau, (chain.n,), unit=author.coordinates.force, meaning="joint torques"),
            recorder,
            doc="tau = D(q) qdd + C(q, qd) qd + g(q).",
            source="Equation (1) without friction, springs and contact; Newton-Euler recursion on lumped parameters",
            notation=notation(frame),
        ),
        author.function(
            "link_load",
            ("q", "qd", "qdd"),
            output("load", load, (chain.n,), unit=author.coordinates.force, meaning="at the joints' outputs"),
            recorder,
            doc="Torque that every joint transmits to its link: inverse dynamics without the joint's own rotor.",
            source="Equation (1) less the model file's rotor inertia times qdd",
            notation=notation(frame) | {"whole": "torque of a joint, its rotor included"},
        ),
    ]


def _mechanics(author: Author, chain: Chain, lumps: Lumps, recorder: Recorder) -> Mechanics:
    q, qd = author.coordinates.symbols("q"), author.coordinates.symbols("qd")
    return mechanics(chain, lumped_bodies(lumps, chain, q), list(lumps.I), q, qd, recorder)


def _closed_forms(author: Author, chain: Chain, lumps: Lumps, rotors: Sequence[sp.Expr]) -> list[SymbolicFunction]:
    recorder, n = author.recorder(), chain.n
    m = _mechanics(author, chain, lumps, recorder)
    unit = author.coordinates.unit
    D = [e for row in m.D for e in row]
    C = [e for row in m.C for e in row]
    own = [recorder.let(f"D{i + 1}{i + 1}", m.D[i][i]) - rotor for i, rotor in enumerate(rotors)]
    links = [own[i] if i == j else e for i, row in enumerate(m.D) for j, e in enumerate(row)]
    inertia = "kg m^2, kg m or kg" if " or " in author.coordinates.force else unit("kg m^2", "kg")
    rate = "per entry: torque by rate" if " or " in author.coordinates.force else unit("kg m^2/s", "kg/s")
    return [
        author.function(
            "inertia",
            ("q",),
            output("D", D, (n, n), unit=inertia, meaning="inertia matrix, symmetric and positive definite"),
            recorder,
            doc="Inertia matrix D(q), rotors included.",
            source="Lagrangian; D of equation (1)",
            notation=NOTATION,
        ),
        author.function(
            "link_inertia",
            ("q",),
            output("D", links, (n, n), unit=inertia, meaning="inertia matrix without the rotors"),
            recorder,
            doc="Inertia of the links as the joints see it: D(q) less the rotors.",
            source="Lagrangian; the model file's rotor inertias",
            notation=NOTATION | {"D": "inertia of a joint, its rotor included"},
        ),
        author.function(
            "coriolis",
            ("q", "qd"),
            output("C", C, (n, n), unit=rate, meaning="Coriolis matrix; dD/dt - 2 C is skew-symmetric"),
            recorder,
            doc="Coriolis and centrifugal matrix C(q, qd) from Christoffel symbols.",
            source="Lagrangian; C of equation (1); Spong & Vidyasagar 1989",
            notation=NOTATION,
        ),
        author.function(
            "gravity",
            ("q",),
            output("g", m.g, (n,), unit=author.coordinates.force, meaning="gravity torques"),
            recorder,
            doc="Gravity torques g(q) = dV/dq; zero where the model file has no gravity.",
            source="Lagrangian",
            notation=NOTATION,
        ),
    ]


def _forward_dynamics(author: Author, chain: Chain, lumps: Lumps, frame: int) -> SymbolicFunction:
    recorder, n = author.recorder(), chain.n
    q, qd, tau = (author.coordinates.symbols(name) for name in ("q", "qd", "tau"))
    bias = inverse_dynamics(chain, lumps, frame, q, qd, [0] * n, recorder)
    D = _mechanics(author, chain, lumps, recorder).D
    qdd = solve_symmetric(D, [t - b for t, b in zip(tau, bias, strict=True)], recorder)
    return author.function(
        "forward_dynamics",
        ("q", "qd", "tau"),
        output("qdd", qdd, (n,), unit=author.coordinates.argument("qdd").unit, meaning="joint accelerations"),
        recorder,
        doc="qdd = D(q)^-1 (tau - C(q, qd) qd - g(q)).",
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
    recorder, n, p = author.recorder(), chain.n, len(columns)
    q, qd, qdd = (author.coordinates.symbols(name) for name in ("q", "qd", "qdd"))
    moving = motion(chain, frame, q, qd, qdd, recorder)
    parts = [
        torques(chain, unit_lumps(n, column), moving, qdd, Suffixed(recorder, f"_{column[0]}{column[1] + 1}"))
        for column in columns
    ]
    Y = [part[i] for i in range(n) for part in parts]
    return author.function(
        "regressor",
        ("q", "qd", "qdd"),
        output("Y", Y, (n, p), unit="torque by lump", meaning="derivative of the torques by the lumped parameters"),
        recorder,
        doc="tau = Y(q, qd, qdd) lumps, exactly: the torques have no part that is constant in the lumps.",
        source="Newton-Euler recursion with one lump at a time; Gautier & Khalil 1990",
        notation=notation(frame) | {"N": "moment of the lump that is named, alone"},
    )
