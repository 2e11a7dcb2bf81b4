"""The way of a textbook: SymPy's LagrangesMethod, common subexpressions taken out, printed as C."""

from __future__ import annotations

from collections.abc import Mapping

import casadi
import sympy as sp
from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

from symbolic.model_file.arm import Arm


def c_code(arm: Arm, name: str) -> tuple[str, int]:
    """`void NAME(const double *q, const double *qd, const double *qdd, double *tau)` and its number of operations.

    For revolute joints without gravity; the model file's numbers are folded in, which favours this variant.
    """
    groups, shared, outputs = _equations(arm)
    operations = int(sp.count_ops([e for _, e in shared] + outputs))
    lines = ["#include <math.h>", f"void {name}(const double *q, const double *qd, const double *qdd, double *tau);"]
    lines.append(f"void {name}(const double *q, const double *qd, const double *qdd, double *tau)\n{{")
    for group, source in zip(groups, ("q", "qd", "qdd"), strict=True):
        used = set().union(*(e.free_symbols for _, e in shared), *(e.free_symbols for e in outputs))
        lines += [f"    const double {s} = {source}[{i}];" for i, s in enumerate(group) if s in used]
    # A square is a product, as the C library's pow would cost more than all the rest.
    printer = {"Pow": [(lambda _, exponent: exponent == 2, lambda base, _: f"({base})*({base})")]}
    lines += [f"    const double {s} = {sp.ccode(e, user_functions=printer)};" for s, e in shared]
    lines += [f"    tau[{i}] = {sp.ccode(e, user_functions=printer)};" for i, e in enumerate(outputs)]
    return "\n".join([*lines, "}", ""]), operations


def casadi_function(arm: Arm) -> casadi.Function:
    """The same equations: tau of q, qd, qdd."""
    groups, shared, outputs = _equations(arm)
    symbols = [casadi.SX.sym(name, len(arm.joints)) for name in ("q", "qd", "qdd")]
    known = {s: x for group, symbol in zip(groups, symbols, strict=True) for s, x in zip(group, symbol.nz, strict=True)}
    for name, expression in shared:
        known[name] = _in_casadi(expression, known)
    return casadi.Function("lagrange", symbols, [casadi.vertcat(*(_in_casadi(e, known) for e in outputs))])


def _in_casadi(expression: sp.Expr, known: Mapping[sp.Symbol, casadi.SX]) -> casadi.SX:
    names = sorted(expression.free_symbols, key=str)
    functions = {"sin": casadi.sin, "cos": casadi.cos}
    return sp.lambdify(names, expression, modules=[functions, "math"])(*(known[s] for s in names))


def _equations(arm: Arm) -> tuple[list[tuple[sp.Symbol, ...]], list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Symbols of q, qd, qdd, common subexpressions, and the torques."""
    n = len(arm.joints)
    q, time = dynamicsymbols(f"q1:{n + 1}"), dynamicsymbols._t
    equations = LagrangesMethod(_kinetic_energy(arm, q, time), q).form_lagranges_equations()
    groups = [sp.symbols(f"{letter}0:{n}", real=True) for letter in ("q", "v", "a")]
    for order in (2, 1, 0):
        known = {sp.diff(x, time, order): s for x, s in zip(q, groups[order], strict=True)}
        equations = equations.subs(known)
    shared, outputs = sp.cse([e.evalf(17) for e in equations], order="none")
    return groups, shared, outputs


def _kinetic_energy(arm: Arm, q: list[sp.Expr], time: sp.Symbol) -> sp.Expr:
    energy, angle = sp.Integer(0), sp.Integer(0)
    x = y = sp.Integer(0)
    for joint, stated, qi in zip(arm.joints, arm.lengths, q, strict=True):
        link = joint.link
        length, mass, inertia, rotor = (
            sp.Rational(repr(v)) for v in (stated, link.mass, link.inertia[5], joint.rotor_inertia)
        )
        along, across, _ = (sp.Rational(repr(v)) for v in link.com)
        angle += qi
        cos, sin = sp.cos(angle), sp.sin(angle)
        centre = (x + along * cos - across * sin, y + along * sin + across * cos)
        speed = sum(sp.diff(c, time) ** 2 for c in centre)
        energy += (mass * speed + inertia * sp.diff(angle, time) ** 2 + rotor * sp.diff(qi, time) ** 2) / 2
        x, y = x + length * cos, y + length * sin
    return energy
