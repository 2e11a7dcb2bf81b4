"""Exact evaluation for proofs: fractions, rational angles, dual numbers for derivatives; and random arms."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any

import sympy as sp

from symbolic.functions import SymbolicFunction, Turn
from symbolic.model import ArmModel, derive
from symbolic.model_file.arm import Arm, Joint, planar, planar_link
from symbolic.rigid_body.base_parameters import RecursionLayout, base_parameters, choose_layout, exact, exact_chain
from symbolic.rigid_body.lagrangian import Body, Mechanics, distal_points, mechanics, moved, rational
from symbolic.rigid_body.newton_euler import Chain, Gravity


def _half_tangent(t: Fraction) -> Turn:
    """The angle 2 atan(t), rational for rational t."""
    return Turn((1 - t * t) / (1 + t * t), (t + t) / (1 + t * t))


def _physical_bodies(arm: Arm, chain: Chain, q: list[Any]) -> list[Body]:
    """Masses at the centres of mass, as the model file states them, in exact numbers."""
    bodies = []
    points = distal_points(chain, q)
    for i, joint in enumerate(arm.joints):
        link = joint.link
        along, across = rational(link.com[0]), rational(link.com[1])
        if not chain.revolute[i]:
            along = along + q[i]
        centre = moved(points[i], chain.frames[i], along, across)
        bodies.append(Body(rational(link.mass), centre, (0, 0), {}, rational(link.inertia[5])))
    return bodies


@dataclass(frozen=True)
class Dual:
    """value + slope ε with ε² = 0: f(x + ẋ ε) carries ḟ as its slope."""

    value: Any
    slope: Any

    @staticmethod
    def of(x: Any) -> Dual:
        return x if isinstance(x, Dual) else Dual(x, 0)

    def __add__(self, other: Any) -> Dual:
        other = Dual.of(other)
        return Dual(self.value + other.value, self.slope + other.slope)

    def __mul__(self, other: Any) -> Dual:
        other = Dual.of(other)
        return Dual(self.value * other.value, self.slope * other.value + self.value * other.slope)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slope)

    def __sub__(self, other: Any) -> Dual:
        return self + -Dual.of(other)

    def __rsub__(self, other: Any) -> Dual:
        return Dual.of(other) - self


def moving(q: Any, rate: Fraction) -> Any:
    """A joint position as a dual number that moves at `rate`."""
    if isinstance(q, Turn):
        return Turn(Dual(q.cos, -q.sin * rate), Dual(q.sin, q.cos * rate))
    return Dual(q, rate)


def evaluate(expr: Any, values: dict[sp.Symbol, Any], known: dict[sp.Expr, Any]) -> Any:
    """`expr` over whatever ring the values come from; angles are Turns. `known` keeps what is evaluated already."""
    expr = sp.sympify(expr)
    if expr not in known:
        known[expr] = _evaluate(expr, values, known)
    return known[expr]


def _evaluate(expr: sp.Expr, values: dict[sp.Symbol, Any], known: dict[sp.Expr, Any]) -> Any:
    if expr.is_Symbol:
        return values[expr]
    if expr.is_Rational:
        return Fraction(int(expr.p), int(expr.q))
    parts = [evaluate(a, values, known) for a in expr.args]
    if expr.is_Add:
        return sum(parts[1:], parts[0])
    if expr.is_Mul and isinstance(parts[-1], Turn):
        assert parts[:-1] == [-1], "only whole turns stay rational"
        return -parts[-1]
    if expr.is_Mul:
        product = parts[0]
        for part in parts[1:]:
            product = product * part
        return product
    if expr.is_Pow and int(expr.exp) == expr.exp:
        return parts[0] ** int(expr.exp) if not isinstance(parts[0], Dual) else parts[0] * parts[0]
    assert expr.func in (sp.cos, sp.sin), expr
    return parts[0].cos if expr.func is sp.cos else parts[0].sin


def call(function: SymbolicFunction, values: dict[sp.Symbol, Any]) -> list[Any]:
    """All outputs, flat; `values` for the symbols of inputs and struct."""
    known: dict[sp.Expr, Any] = {}
    values = dict(values)
    for symbol, expr in function.definitions:
        values[symbol] = evaluate(expr, values, known)
    return [evaluate(e, values, known) for output in function.outputs for e in output.expressions]


@dataclass(frozen=True)
class Case:
    """An arm with its model, the Lagrangian of its physical parameters, and exact values of both's constants."""

    arm: Arm
    model: ArmModel
    layout: RecursionLayout
    truth: Mechanics
    constants: dict[sp.Symbol, Any]
    lumps: tuple[Fraction, ...]

    @property
    def n(self) -> int:
        return len(self.arm.joints)

    def point(self, seed: int) -> dict[str, list[Any]]:
        """A random rational state: q (Turns where revolute), qd, qdd."""
        rng = random.Random(seed)

        def number() -> Fraction:
            return Fraction(rng.randint(-20, 20), rng.randint(1, 9))

        q = [_half_tangent(number()) if j.type == "revolute" else number() for j in self.arm.joints]
        return {"q": q, "qd": [number() for _ in q], "qdd": [number() for _ in q]}

    def values(self, **vectors: list[Any]) -> dict[sp.Symbol, Any]:
        named = {
            sp.Symbol(f"{name}{i}", real=True): v for name, vector in vectors.items() for i, v in enumerate(vector, 1)
        }
        return self.constants | named

    def call(self, name: str, **vectors: list[Any]) -> list[Any]:
        return call(self.model.function(name), self.values(**vectors))

    def matrix(self, name: str, **vectors: list[Any]) -> list[list[Any]]:
        rows, columns = self.model.function(name).outputs[0].shape
        flat = self.call(name, **vectors)
        return [flat[i * columns : (i + 1) * columns] for i in range(rows)]

    def true(self, part: Any, **vectors: list[Any]) -> Any:
        """A part of `truth` (a list, a matrix, an expression) in numbers."""
        values, known = self.values(**vectors), {}

        def number(x: Any) -> Any:
            return [number(e) for e in x] if isinstance(x, list) else evaluate(x, values, known)

        return number(part)


def case(arm: Arm) -> Case:
    base = base_parameters(arm)
    layout, model = choose_layout(arm, base), derive(arm)
    unit = exact(arm.lengths[layout.reference - 1]) if layout.reference else Fraction(1)
    lumps = tuple(value * unit ** layout.metres(kind) for (kind, _), value in base.values.items())
    chain = exact_chain(arm)
    constants: dict[sp.Symbol, Any] = {f.symbol: f.value for f in layout.fields}
    gravity = None
    if chain.gravity is not None:
        # An inclined gravity's strength is irrational: its angle carries it, and the strength is 1.
        own = Gravity(*(sp.Symbol(f"true_{x}", real=True) for x in ("x", "y", "strength", "angle")))
        constants |= {own.x: exact(arm.gravity[0]), own.y: exact(arm.gravity[1])}
        constants |= {own.strength: Fraction(1), own.angle: chain.gravity.angle}
        for field in layout.fields:
            if field.symbol.name == "gravity_angle":
                constants[field.symbol] = chain.gravity.angle
            elif field.symbol.name.startswith("gravity") and field.symbol.name[7:10] in ("", "_by"):
                constants[field.symbol] = 1 / unit
        gravity = own
    q, qd = ([sp.Symbol(f"{x}{i + 1}", real=True) for i in range(chain.n)] for x in ("q", "qd"))
    metric = Chain(chain.revolute, tuple(map(rational, arm.lengths)), gravity)
    rotors = [rational(j.rotor_inertia) for j in arm.joints]
    truth = mechanics(metric, _physical_bodies(arm, metric, q), rotors, q, qd)
    constants |= dict(zip(model.struct.symbols, lumps, strict=False))
    return Case(arm, model, layout, truth, constants, lumps)


def random_arm(n: int, seed: int) -> Arm:
    """n joints of random type; numbers as people write them; sometimes a zero length, an off-line mass, gravity."""
    rng = random.Random(1000 * n + seed)
    off_line, gravity = rng.random() < 0.5, rng.choice([(0.0, 0.0), (0.0, -9.81), (9.81, 0.0), (3.1, -8.7)])
    mix = rng.choice([("revolute",), ("revolute", "prismatic"), ("revolute", "revolute", "prismatic")])

    def joint() -> tuple[Joint, float]:
        length = rng.choice([0.0, 0.3]) if rng.random() < 0.2 else rng.randint(5, 60) / 100
        across = rng.randint(-9, 9) / 100 if off_line and rng.random() < 0.7 else 0.0
        link = planar_link(rng.randint(1, 90) / 10, (rng.randint(-20, 60) / 100, across), rng.randint(1, 99) / 1000)
        return Joint(rng.choice(mix), rng.choice([0.0, 0.25, 0.49]), 100.0, link=link), length

    joints, lengths = zip(*(joint() for _ in range(n)), strict=True)
    return planar(Arm("random", (*gravity, 0.0), joints), lengths)


@cache
def random_case(n: int, seed: int) -> Case:
    return case(random_arm(n, seed))


def chain_of(types: str, gravity: tuple[float, float] = (0.0, 0.0), across: float = 0.0) -> Arm:
    """An ordinary arm by the letters of its joints, R or P."""
    lengths = (0.23, 0.17, 0.19, 0.18, 0.21, 0.16, 0.2)
    link = planar_link(2.5, (0.11, across), 0.012)
    joints = tuple(Joint("revolute" if t == "R" else "prismatic", 0.3, 100.0, link=link) for t in types)
    return planar(Arm("chain", (*gravity, 0.0), joints), lengths[: len(types)])


def in_floats(model: ArmModel, name: str) -> Callable[..., list[float]]:
    """A function of the model on lists of floats, one list an input, with the struct's defaults; outputs flat."""
    f = model.function(name)
    inputs = [list(argument.symbols) for argument in f.inputs]
    struct = list(model.struct.symbols)
    outputs = [e for output in f.outputs for e in output.expressions]
    compiled = sp.lambdify([struct, *inputs], outputs, modules="math", cse=lambda _: (list(f.definitions), outputs))
    return lambda *vectors: compiled(model.struct.defaults, *vectors)
