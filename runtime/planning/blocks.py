"""A nonlinear program as a sum of small blocks: one expression, evaluated at many places of the trajectory.

A place sees z = Z x of the unknowns x, where Z is sparse and constant because Bezier polynomials are linear in their
control points. So gradient, Jacobian and Hessian of the Lagrangian are those of the small expression, derived once, and
products with Z; an automatic derivative of the whole sum is dense and costs one sweep per unknown. IPOPT takes the sum
as CasADi functions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy import sparse

from runtime.arrays import Array

Row = tuple[ca.SX, float, float, str, str]
"""A constraint: expression, lower and upper bound, its description for messages, and its unit."""


@dataclass(frozen=True)
class Expression:
    """Cost, a scalar plus a sum of squares, and constraint rows with bounds, at one place of the motion.

    z, p      SX symbols (nz,), (np,); p may change from one solution to the next without a new program
    lower, upper, labels   of each row; a label is a description and a unit, for messages
    """

    z: ca.SX
    p: ca.SX
    cost: ca.SX
    squares: ca.SX
    rows: ca.SX
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    labels: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, z: ca.SX, p: ca.SX, cost: ca.SX, squares: ca.SX, rows: Sequence[Row]) -> Expression:
        """cost + squares · squares, where squares may have no elements."""
        lower, upper = (tuple(float(row[k]) for row in rows) for k in (1, 2))
        stacked = ca.vertcat(*(row[0] for row in rows)) if rows else ca.SX(0, 1)
        # Equal subexpressions are computed once: effects share many, and so do their derivatives.
        cost, squares, stacked = ca.cse([cost, squares, stacked])
        return cls(z, p, cost, squares, stacked, lower, upper, tuple((row[3], row[4]) for row in rows))

    @cached_property
    def value(self) -> ca.Function:
        """(z, p) -> cost including its squares, rows."""
        return ca.Function("value", [self.z, self.p], [self.cost + ca.sumsqr(self.squares), self.rows])

    @cached_property
    def slope(self) -> ca.Function:
        """(z, p) -> gradient of the cost (nz,), Jacobian of the rows."""
        slopes = [ca.gradient(self.cost + ca.sumsqr(self.squares), self.z), ca.jacobian(self.rows, self.z)]
        return ca.Function("slope", [self.z, self.p], slopes)

    @cached_property
    def hessian(self) -> ca.Function:
        """(z, p, weight, y) -> Hessian of weight · cost + y · rows, (nz, nz).

        A square has the Hessian 2 (∇r ∇rᵀ + r ∇²r). The second term is derived with r held, and the first, cheap once
        ∇r is known, is added.
        """
        weight, y = ca.SX.sym("weight"), ca.SX.sym("y", self.rows.numel())
        r = ca.SX.sym("r", self.squares.numel())
        curved, _ = ca.hessian(weight * (self.cost + 2 * ca.dot(r, self.squares)) + ca.dot(y, self.rows), self.z)
        slopes = ca.jacobian(self.squares, self.z)
        hessian = ca.substitute(curved, r, self.squares) + 2 * weight * (slopes.T @ slopes)
        return ca.Function("hessian", [self.z, self.p, weight, y], [hessian])


@dataclass(frozen=True)
class ProgramBlock:
    """An expression at several places of the motion.

    places    (N nz, nx) sparse, place after place: z of the unknowns
    weights   (N,) of the cost
    where     (N,) description of each place, for messages
    """

    expression: Expression
    places: sparse.csr_matrix
    weights: Array
    where: tuple[str, ...]

    @property
    def count(self) -> int:
        """N."""
        return len(self.weights)

    @property
    def lower(self) -> Array:
        """(N, rows)"""
        return np.tile(np.array(self.expression.lower), (self.count, 1))

    @property
    def upper(self) -> Array:
        """(N, rows)"""
        return np.tile(np.array(self.expression.upper), (self.count, 1))


@dataclass(frozen=True)
class Sum:
    """The sum of blocks as CasADi's solvers take it: the problem, and its exact derivatives."""

    problem: dict[str, ca.MX]
    derivatives: dict[str, ca.Function]

    def solver(self, options: Mapping[str, Any]) -> ca.Function:
        """IPOPT."""
        return ca.nlpsol("plan", "ipopt", self.problem, {**options, **self.derivatives})


def assemble(blocks: Sequence[ProgramBlock]) -> Sum:
    """One nonlinear program."""
    size, p = blocks[0].places.shape[1], ca.MX.sym("p", blocks[0].expression.p.numel())
    x = ca.MX.sym("x", size)
    counts = [block.expression.rows.numel() * block.count for block in blocks]
    scale, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", sum(counts))
    each = ca.vertsplit(multipliers, np.cumsum([0, *counts]).tolist())
    parts = [_block_functions(block, x, p, scale=scale, y=y) for block, y in zip(blocks, each, strict=True)]
    cost, rows, gradient, jacobian, hessian = zip(*parts, strict=True)
    f, g = sum(cost), ca.vertcat(*rows)
    functions = {
        "grad_f": ca.Function("grad_f", [x, p], [f, sum(gradient)], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [x, p], [g, ca.vertcat(*jacobian)], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "hess_lag",
            [x, p, scale, multipliers],
            [ca.triu(sum(hessian))],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }
    return Sum({"x": x, "p": p, "f": f, "g": g}, functions)


def _block_functions(block: ProgramBlock, x: ca.MX, p: ca.MX, scale: ca.MX, y: ca.MX) -> tuple[ca.MX, ...]:
    """Weighted cost, rows, gradient of the cost, Jacobian of the rows, Hessian of scale · cost + y · rows, by x."""
    own, count, nz = block.expression, block.count, block.expression.z.numel()
    columns = sparse.csc_matrix(block.places)
    columns.sort_indices()
    pattern = ca.Sparsity(block.count * nz, x.numel(), columns.indptr.tolist(), columns.indices.tolist())
    Z = ca.DM(pattern, columns.data)
    at = ca.reshape(Z @ x, nz, count), ca.repmat(p, 1, count)
    weights = ca.DM(block.weights).T
    cost, rows = own.value.map(count)(*at)
    slopes, jacobians = own.slope.map(count)(*at)
    hessians = own.hessian.map(count)(*at, scale * weights, ca.reshape(y, own.rows.numel(), count))
    return (
        ca.dot(weights, cost),
        ca.vec(rows),
        Z.T @ ca.vec(slopes * ca.repmat(weights, nz, 1)),
        ca.diagcat(*ca.horzsplit(jacobians, nz)) @ Z,
        Z.T @ (ca.diagcat(*ca.horzsplit(hessians, nz)) @ Z),
    )
