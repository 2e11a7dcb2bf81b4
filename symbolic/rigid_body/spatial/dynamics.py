"""The functions that the recursion gives: inverse dynamics, the links' share of it, and the regressor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import sympy as sp

from symbolic.functions import Author, Continuation, SymbolicFunction, output
from symbolic.rigid_body.exact_rank import Column
from symbolic.rigid_body.spatial.base_parameters import MIRRORED, columns
from symbolic.rigid_body.spatial.geometry import Geometry
from symbolic.rigid_body.spatial.layout import SpatialLayout, moments_of
from symbolic.rigid_body.spatial.moments import Moments
from symbolic.rigid_body.spatial.recursion import motion, torques

NOTATION = {
    "c, s": "cosine and sine; c23 of q2 + q3",
    "w": "angular velocity",
    "v": "the same at the joint before",
    "al": "angular acceleration",
    "ww": "product of angular velocities",
    "p": "the same, after the difference from w",
    "U": "acceleration by place; u: its column along the joint",
    "a": "acceleration of the origin less gravity; b at the joint before",
    "lc, ls": "length along x and y",
    "r": "way along the axis",
    "S, Sxx, Syy, Sxy, Sx, Sy, Sz": "moments of a link along shared axes",
    "F, f": "force",
    "N": "moment",
}
"""What the recursion calls its values, for whoever reads the generated code: axes and number of the link at the end."""


def bodies(symbols: Mapping[Column, Any], n: int) -> tuple[list[Moments], list[Any]]:
    """The links' moments and the joints' rotors in the base parameters, whose signs are those of the inertia tensor."""
    return moments_of({c: -x if c[0] in MIRRORED else x for c, x in symbols.items()}, n)


def functions(
    author: Author, g: Geometry, layout: SpatialLayout, symbols: Mapping[Column, sp.Symbol], own: Sequence[Any]
) -> list[SymbolicFunction]:
    """inverse_dynamics, link_load, regressor. `g`: in SymPy's numbers; `symbols`: the base parameters; `own`: (n,) the
    rotors' inertias, kg m² (kg)."""
    recorder, n = author.recorder(), g.n
    q, qd, qdd = (author.coordinates.symbols(name) for name in ("q", "qd", "qdd"))
    moving = motion(g, layout.axes, q, qd, qdd, recorder)
    tau = torques(g, *bodies(symbols, n), moving, qdd, recorder)
    whole = [recorder.symbol(f"whole{i + 1}", torque) for i, torque in enumerate(tau)]
    load = [torque - rotor * a for torque, rotor, a in zip(whole, own, qdd, strict=True)]
    return [
        author.function(
            "inverse_dynamics",
            ("q", "qd", "qdd"),
            output("tau", tau, (n,), unit=author.coordinates.force, meaning="joint torques"),
            recorder,
            doc="tau = D(q) qdd + C(q, qd) qd + g(q).",
            source="Newton-Euler recursion on base parameters, in modified DH frames: Khalil & Kleinfinger 1987",
            notation=NOTATION,
        ),
        author.function(
            "link_load",
            ("q", "qd", "qdd"),
            output("load", load, (n,), unit=author.coordinates.force, meaning="at the joints' outputs"),
            recorder,
            doc="Torque that every joint transmits to its link: inverse dynamics without the joint's own rotor.",
            source="Inverse dynamics less the model file's rotor inertia times qdd",
            notation=NOTATION | {"whole": "torque of a joint, its rotor included"},
            continues=Continuation("inverse_dynamics", tuple((symbol, i) for i, symbol in enumerate(whole))),
        ),
        _regressor(author, g, tuple(symbols)),
    ]


def _regressor(author: Author, g: Geometry, kept: Sequence[Column]) -> SymbolicFunction:
    recorder, n = author.recorder(), g.n
    q, qd, qdd = (author.coordinates.symbols(name) for name in ("q", "qd", "qdd"))
    moving = motion(g, range(n), q, qd, qdd, recorder)
    found = columns(g, kept, moving, qdd, recorder)
    Y = [-found[c][i] if c[0] in MIRRORED else found[c][i] for i in range(n) for c in kept]
    return author.function(
        "regressor",
        ("q", "qd", "qdd"),
        output(
            "Y", Y, (n, len(kept)), unit="torque by lump", meaning="derivative of the torques by the lumped parameters"
        ),
        recorder,
        doc="tau = Y(q, qd, qdd) lumps, exactly: the torques have no part that is constant in the lumps.",
        source="The forces of one moment of mass at a time, along the joints; Gautier & Khalil 1990",
        notation=NOTATION | {"z": "axis of an inner joint", "y": "velocity of the origin by that joint"},
    )
