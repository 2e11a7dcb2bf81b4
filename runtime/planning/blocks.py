"""A nonlinear program as a sum of small blocks: one expression, evaluated at many places of the trajectory.

Each place sees z = Z x of the unknowns x, sparse and constant because Bezier polynomials are linear in
their control points. So gradient, Jacobian and Hessian of the Lagrangian are exact and cheap: those of the small
expression, derived once, and congruences with Z. An automatic derivative of the whole sum is dense and costs
a sweep an unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from runtime.planning.batch import Instructions

Array = NDArray[np.float64]


Row = tuple[ca.SX, float, float, str, str]
"""A constraint: expression, lower and upper bound, what it is for a person, and its unit."""


@dataclass(frozen=True)
class Expression:
    """cost(z, p), a scalar, the sum of squares(z, p), and rows(z, p), constraints with bounds, at an instant.

    z, p      SX symbols (nz,), (np,); p is what one solution may change from the next without a new program
    cost, squares   what is not there is zero, or has no rows; both count
    lower, upper, labels   of each row; what it is and its unit: for people
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
        lower, upper = (tuple(float(row[k]) for row in rows) for k in (1, 2))
        stacked = ca.vertcat(*(row[0] for row in rows)) if rows else ca.SX(0, 1)
        return cls(z, p, cost, squares, stacked, lower, upper, tuple((row[3], row[4]) for row in rows))

    @cached_property
    def _lean(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Cost, squares and rows, equal parts computed once: effects share much, and derivatives inherit it."""
        cost, squares, rows = ca.cse([self.cost, self.squares, self.rows])
        return cost, squares, rows

    @cached_property
    def value(self) -> ca.Function:
        """(z, p) -> cost with its squares, rows."""
        cost, squares, rows = self._lean
        return ca.Function("value", [self.z, self.p], [cost + ca.sumsqr(squares), rows])

    @cached_property
    def slope(self) -> ca.Function:
        """(z, p) -> gradient of the cost (nz,), Jacobian of the rows."""
        cost, squares, rows = self._lean
        slopes = [ca.gradient(cost + ca.sumsqr(squares), self.z), ca.jacobian(rows, self.z)]
        return ca.Function("slope", [self.z, self.p], slopes)

    @cached_property
    def curvature(self) -> ca.Function:
        """(z, p, weight, y) -> Hessian of weight · cost + y · rows at a place, (nz, nz)."""
        _, squares, _ = self._lean
        _, _, weight, y, _ = self.bent.sx_in()
        slopes = ca.jacobian(squares, self.z)
        hessian = self.bent(self.z, self.p, weight, y, squares) + 2 * weight * (slopes.T @ slopes)
        return ca.Function("second", [self.z, self.p, weight, y], [hessian])

    @cached_property
    def squared(self) -> ca.Function:
        """(z, p) -> gradient of the cost without its squares (nz,), Jacobian of the rows, squares r, their Jacobian."""
        cost, squares, rows = self._lean
        slopes = [ca.gradient(cost, self.z), ca.jacobian(rows, self.z), squares, ca.jacobian(squares, self.z)]
        return ca.Function("squared", [self.z, self.p], slopes)

    @cached_property
    def bent(self) -> ca.Function:
        """(z, p, weight, y, r) -> Hessian of weight · cost + y · rows without the squares of slopes, (nz, nz).

        Of a square's two terms, 2 (∇r ∇rᵀ + r ∇²r), this has the second, r given: the first costs next to nothing
        where ∇r is known.
        """
        weight, y = ca.SX.sym("weight"), ca.SX.sym("y", self.rows.numel())
        cost, squares, rows = self._lean
        r = ca.SX.sym("r", squares.numel())
        curved, _ = ca.hessian(weight * (cost + 2 * ca.dot(r, squares)) + ca.dot(y, rows), self.z)
        return ca.Function("bent", [self.z, self.p, weight, y, r], [curved])

    @cached_property
    def instructions(self) -> ExpressionInstructions:
        """For many places at once."""
        return ExpressionInstructions(*map(Instructions.of, (self.value, self.squared, self.bent)))


@dataclass(frozen=True)
class ExpressionInstructions:
    """Those of `value`, `squared` and `bent`."""

    value: Instructions
    slope: Instructions
    curvature: Instructions


@dataclass(frozen=True)
class ProgramBlock:
    """An expression at several places of the motion.

    places    (N nz, nx) sparse, place after place: z of the unknowns
    weights   (N,) of the cost
    where     (N,) of each place: for people
    """

    expression: Expression
    places: sparse.csr_matrix
    weights: Array
    where: tuple[str, ...]

    @property
    def count(self) -> int:
        return len(self.weights)

    @property
    def lower(self) -> Array:
        """(N, rows)"""
        return np.tile(np.array(self.expression.lower), (self.count, 1))

    @property
    def upper(self) -> Array:
        """(N, rows)"""
        return np.tile(np.array(self.expression.upper), (self.count, 1))

    @cached_property
    def _map(self) -> ca.DM:
        return _dm(self.places)

    def seen(self, x: Any) -> Any:
        """z at every place, (nz, N)."""
        return ca.reshape(self._map @ x, self.expression.z.numel(), self.count)

    def values(self, x: Any, p: Any) -> tuple[Any, Any]:
        """Weighted cost, and all rows place after place."""
        cost, rows = self.expression.value.map(self.count)(self.seen(x), ca.repmat(p, 1, self.count))
        return ca.dot(ca.DM(self.weights).T, cost), ca.vec(rows)

    def first(self, x: Any, p: Any) -> tuple[Any, Any]:
        """Gradient of the cost (nx,), Jacobian of the rows (N rows, nx)."""
        slopes, jacobians = self.expression.slope.map(self.count)(self.seen(x), ca.repmat(p, 1, self.count))
        weighted = slopes * ca.repmat(ca.DM(self.weights).T, self.expression.z.numel(), 1)
        blocks = ca.horzsplit(jacobians, self.expression.z.numel())
        return self._map.T @ ca.vec(weighted), ca.diagcat(*blocks) @ self._map

    def second(self, x: Any, p: Any, scale: Any, multipliers: Any) -> Any:
        """Hessian of scale · cost + multipliers · rows, (nx, nx)."""
        found = self.expression.curvature.map(self.count)(
            self.seen(x),
            ca.repmat(p, 1, self.count),
            scale * ca.DM(self.weights).T,
            ca.reshape(multipliers, self.expression.rows.numel(), self.count),
        )
        blocks = ca.horzsplit(found, self.expression.z.numel())
        return self._map.T @ (ca.diagcat(*blocks) @ self._map)


def _dm(matrix: sparse.spmatrix) -> ca.DM:
    column = sparse.csc_matrix(matrix)
    column.sort_indices()
    rows, columns = column.shape
    pattern = ca.Sparsity(rows, columns, column.indptr.tolist(), column.indices.tolist())
    return ca.DM(pattern, column.data)


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
    parts = [block.values(x, p) for block in blocks]
    cost, rows = sum(c for c, _ in parts), ca.vertcat(*(r for _, r in parts))
    slopes = [block.first(x, p) for block in blocks]
    gradient, jacobian = sum(s for s, _ in slopes), ca.vertcat(*(j for _, j in slopes))
    scale, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows.numel())
    split = np.cumsum([0, *(block.expression.rows.numel() * block.count for block in blocks)]).tolist()
    each = ca.vertsplit(multipliers, split)
    hessian = sum(block.second(x, p, scale, y) for block, y in zip(blocks, each, strict=True))
    functions = {
        "grad_f": ca.Function("grad_f", [x, p], [cost, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [x, p], [rows, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "hess_lag",
            [x, p, scale, multipliers],
            [ca.triu(hessian)],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }
    return Sum({"x": x, "p": p, "f": cost, "g": rows}, functions)
