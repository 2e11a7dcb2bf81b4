"""Proves that the tapes of a spatial arm equal its Lagrangian, modulo a prime.

Masses, moments, rotors and the state are random residues; the base parameters follow from them, and each tape is
evaluated with the same numbers. The comparison is exact, except for the frames, whose decimals are compared with the
model file's. lagrangian.py computes the expected values.
"""

from __future__ import annotations

import dataclasses
import functools
import operator
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import sympy as sp

from codegen.tape.tape import Tape, balanced
from codegen.verify import lagrangian
from codegen.verify.lagrangian import (
    ELEMENTS,
    PRIME,
    ExactChain,
    ExactPosture,
    Square,
    pseudo_inertia,
    residue,
)
from symbolic.functions import SymbolicFunction, Turn, random_turn
from symbolic.model import ASSUMED_SHARE, ArmModel
from symbolic.model_file.arm import Link
from symbolic.rigid_body.base_parameters import Lump, exact
from symbolic.rigid_body.kinematics import NOMINAL_MASS
from symbolic.rigid_body.spatial.geometry import Geometry, geometry, offset_symbol
from symbolic.rigid_body.spatial.kinematics import nominal_com

LOADS: Mapping[str, tuple[int, int]] = {
    "1": (3, 3),
    "x": (0, 3),
    "y": (1, 3),
    "z": (2, 3),
    "xx": (0, 0),
    "yy": (1, 1),
    "zz": (2, 2),
    "xy": (0, 1),
    "xz": (0, 2),
    "yz": (1, 2),
}
"""Columns of tip_load, and the element of the pseudo-inertia that each corresponds to."""
POINTS = 10
"""Random states of a proof; one would be enough, see lagrangian.py."""


@dataclass(frozen=True)
class FunctionProof:
    """The proof of a function at random points modulo PRIME. differs: the first element that is not equal."""

    function: str
    points: int
    differs: str | None

    @property
    def equal(self) -> bool:
        """Whether every output was equal at every point."""
        return self.differs is None


def prove_model(model: ArmModel, seed: int) -> tuple[FunctionProof, ...]:
    """Proofs of all functions of a spatial arm; none for a planar one, whose equations are derived from the
    Lagrangian."""
    if not model.arm.space:
        return ()
    return tuple(prove(model, {f.name: Tape.of(f) for f in model.functions}, seed=seed))


def prove(model: ArmModel, tapes: Mapping[str, Tape], points: int = POINTS, seed: int = 0) -> list[FunctionProof]:
    """Proofs of the frames and of all functions of a spatial arm.

    tapes   by function; each is also evaluated with the order of sums in double precision
    """
    assert model.arm.space
    frames = geometry(model.arm)
    chain = lagrangian.exact_file_chain(frames)
    apart = lagrangian.deviation(model.arm, chain)
    proofs = [FunctionProof("frames", 1, f"by {apart:.2g} (m, rad)" if apart > lagrangian.ROUNDING else None)]
    rng = random.Random(seed)
    states = [_State.drawn(rng, model, frames, ExactChain.of(chain)) for _ in range(points)]
    inputs = {symbol: [state.inputs[symbol] for state in states] for symbol in states[0].inputs}
    for function in model.functions:
        expected = [TRUTH[function.name](state) for state in states]
        orders = (tapes[function.name], balanced(tapes[function.name]))
        found = (_differs(function, tape.evaluate(inputs, operations(points)), expected, states) for tape in orders)
        proofs.append(FunctionProof(function.name, points, next((name for name in found if name), None)))
    return proofs


def _differs(
    function: SymbolicFunction,
    found: Sequence[Sequence[int]],
    expected: Sequence[Sequence[int]],
    states: Sequence[_State],
) -> str | None:
    """The first element that differs. found (elements, points), expected (points, elements)"""
    for values, truth, state in zip(zip(*found, strict=True), expected, states, strict=True):
        if function.name == "regressor":
            values = tuple(
                sum(y * x for y, x in zip(row, state.lumps, strict=True)) for row in _rows(values, len(state.lumps))
            )
        assert len(values) == len(truth), function.name
        wrong = (i for i, (x, y) in enumerate(zip(values, truth, strict=True)) if (x - y) % PRIME)
        if (first := next(wrong, None)) is not None:
            return f"{function.outputs[0].name}[{first}]"
    return None


@dataclass(frozen=True)
class _State:
    """A random state of an arm with random bodies, modulo PRIME.

    rotors   (n,) from the model file, random if unknown
    own      (n,) rotors that link_load and link_inertia exclude
    lumps    values of the base parameters
    values   of all symbols except the torques
    """

    model: ArmModel
    posture: ExactPosture
    qd: list[int]
    qdd: list[int]
    rotors: list[int]
    own: list[int]
    lumps: list[int]
    values: dict[sp.Symbol, Any]

    @classmethod
    def drawn(cls, rng: random.Random, model: ArmModel, frames: Geometry, chain: ExactChain) -> _State:
        n, joints = frames.n, model.arm.joints
        q = [random_turn(rng, PRIME) if turns else rng.randrange(PRIME) for turns in chain.revolute]
        qd, qdd = ([rng.randrange(PRIME) for _ in range(n)] for _ in range(2))
        bodies = [[rng.randrange(PRIME) for _ in ELEMENTS] for _ in range(n)]
        stated = [joint.rotor_inertia for joint in joints]
        rotors = [rng.randrange(PRIME) if value is None else residue(exact(value)) for value in stated]
        lumps = [_merged(lump, bodies, rotors) for lump in model.lumps]
        values: dict[sp.Symbol, Any] = dict(zip(model.struct.symbols, lumps, strict=False))
        for j, rest in enumerate(frames.rests, 1):
            if isinstance(rest, Turn):
                values[offset_symbol(j)] = Turn(residue(rest.cos), residue(rest.sin))
        for name, vector in (("q", q), ("qd", qd), ("qdd", qdd)):
            values |= dict(zip(_symbols(name, n), vector, strict=True))
        own = [_own_rotor(model, i, rotors[i], lumps) for i in range(n)]
        posture = chain.posture(q, [pseudo_inertia(body) for body in bodies])
        return cls(model, posture, qd, qdd, rotors, own, lumps, values)

    @functools.cached_property
    def torques(self) -> list[int]:
        """(n,) torques with the rotors."""
        rigid = self.posture.torques(self.qd, self.qdd)
        return [t + rotor * a for t, rotor, a in zip(rigid, self.rotors, self.qdd, strict=True)]

    @functools.cached_property
    def inputs(self) -> dict[sp.Symbol, Any]:
        """The values of all symbols."""
        return self.values | dict(zip(_symbols("tau", self.posture.n), self.torques, strict=True))

    def load(self) -> list[int]:
        """(n,) torques at the joints' outputs."""
        return [t - rotor * a for t, rotor, a in zip(self.torques, self.own, self.qdd, strict=True)]

    def inertia(self, rotors: Sequence[int]) -> list[int]:
        """D, flat."""
        rows = enumerate(zip(self.posture.inertia, rotors, strict=True))
        return [x + rotor * (i == j) for i, (row, rotor) in rows for j, x in enumerate(row)]

    def links(self) -> list[int]:
        """(n,) rotors that link_inertia includes."""
        return [a - b for a, b in zip(self.rotors, self.own, strict=True)]

    def tip_rate(self) -> list[int]:
        return [sum(x * v for x, v in zip(row, self.qd, strict=True)) for row in self.posture.tip_jacobian()]

    def tip_load(self) -> list[int]:
        columns = self.posture.tip_torques(self.qd, self.qdd, [_unit_load(place) for place in LOADS.values()])
        return _flat(zip(*columns, strict=True))

    def moment_jacobian(self) -> list[int]:
        arm = self.model.arm
        assert arm.space
        bodies = tuple(pseudo_inertia(_mass(joint.link, nominal_com(arm, j))) for j, joint in enumerate(arm.joints))
        return _flat(dataclasses.replace(self.posture, bodies=bodies).moment_jacobian())


TRUTH: Mapping[str, Callable[[_State], list[int]]] = {
    "inverse_dynamics": lambda s: s.torques,
    "link_load": _State.load,
    "inertia": lambda s: s.inertia(s.rotors),
    "link_inertia": lambda s: s.inertia(s.links()),
    "coriolis": lambda s: _flat(s.posture.coriolis(s.qd)),
    "gravity": lambda s: s.posture.gravity(),
    "forward_dynamics": lambda s: s.qdd,
    "regressor": lambda s: s.torques,
    "tip": lambda s: [row[3] for row in s.posture.tip()[:3]],
    "tip_rotation": lambda s: _flat(row[:3] for row in s.posture.tip()[:3]),
    "tip_jacobian": lambda s: _flat(s.posture.tip_jacobian()),
    "tip_rate": _State.tip_rate,
    "tip_load": _State.tip_load,
    "moment_jacobian": _State.moment_jacobian,
}
"""Expected values of every function; for the regressor, of its product with the base parameters."""


def _unit_load(place: tuple[int, int]) -> Square:
    return np.array([[int((i, j) in (place, place[::-1])) for j in range(4)] for i in range(4)], dtype=object)


def _merged(lump: Lump, bodies: Sequence[Sequence[int]], rotors: Sequence[int]) -> int:
    """The value of a base parameter for physical parameters."""
    total = 0
    for joint, element, factor in lump.parts:
        own = rotors[joint - 1] if element == "I" else bodies[joint - 1][ELEMENTS.index(element)]
        total += residue(factor) * own
    return total % PRIME


def _own_rotor(model: ArmModel, i: int, rotor: int, lumps: Sequence[int]) -> int:
    """The model file's rotor; if it is unknown, the base parameter that is the rotor alone, or the assumed share of the
    base parameter that contains it."""
    if model.arm.joints[i].rotor_inertia is not None:
        return rotor
    holding = [
        (lump, value)
        for lump, value in zip(model.lumps, lumps, strict=True)
        if any(p[:2] == (i + 1, "I") for p in lump.parts)
    ]
    for lump, value in holding:
        if len(lump.parts) == 1:
            return value
    share = Fraction(ASSUMED_SHARE.p, ASSUMED_SHARE.q)
    return residue(share) * holding[0][1] % PRIME if len(holding) == 1 else 0


def _mass(link: Link, com: Sequence[float]) -> list[int]:
    """Mass and first moments, nominal if unknown; no second moments."""
    m = exact(NOMINAL_MASS if link.mass is None else link.mass)
    first = [m * exact(c) for c in (com if link.com is None else link.com)]
    return [*[0] * 6, *map(residue, first), residue(m)]


def operations(points: int) -> Mapping[str, Callable[..., Any]]:
    """Operations on lists of residues, one per point, and on angles as lists of Turns. Sums are reduced by the product
    or comparison that reads them."""
    return {
        "const": lambda number: [residue(number)] * points,
        "add": lambda a, b: list(map(operator.add, a, b)),
        "sub": lambda a, b: list(map(operator.sub, a, b)),
        "mul": lambda a, b: [x * y % PRIME for x, y in zip(a, b, strict=True)],
        "div": lambda a, b: [x * pow(y, -1, PRIME) % PRIME for x, y in zip(a, b, strict=True)],
        "neg": lambda a: list(map(operator.neg, a)),
        "sin": lambda a: [x.sin % PRIME for x in a],
        "cos": lambda a: [x.cos % PRIME for x in a],
    }


def _symbols(name: str, n: int) -> list[sp.Symbol]:
    return [sp.Symbol(f"{name}{i}", real=True) for i in range(1, n + 1)]


def _rows(flat: Sequence[int], columns: int) -> list[Sequence[int]]:
    return [flat[i : i + columns] for i in range(0, len(flat), columns)]


def _flat(rows: Any) -> list[int]:
    return [x for row in rows for x in row]
