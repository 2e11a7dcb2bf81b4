"""A nonlinear program as a sum of small blocks: one expression, evaluated at many places of the trajectory.

A place sees z = Z x of the unknowns x, where Z is sparse and constant because Bezier polynomials are linear in their
control points. So gradient, Jacobian and Hessian of the Lagrangian are those of the small expression, derived once, and
products with Z; an automatic derivative of the whole sum is dense and costs one sweep per unknown. IPOPT takes the sum
as CasADi functions, the dense interior-point method as NumPy arrays computed for all places at once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]

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
        """(z, p, weight, y) -> Hessian of weight · cost + y · rows, (nz, nz)."""
        _, _, weight, y, _ = self.hessian_part.sx_in()
        slopes = ca.jacobian(self.squares, self.z)
        hessian = self.hessian_part(self.z, self.p, weight, y, self.squares) + 2 * weight * (slopes.T @ slopes)
        return ca.Function("hessian", [self.z, self.p, weight, y], [hessian])

    @cached_property
    def slope_parts(self) -> ca.Function:
        """(z, p) -> gradient of the cost without its squares (nz,), Jacobian of the rows, squares r, their Jacobian."""
        slopes = [ca.gradient(self.cost, self.z), ca.jacobian(self.rows, self.z)]
        return ca.Function("parts", [self.z, self.p], [*slopes, self.squares, ca.jacobian(self.squares, self.z)])

    @cached_property
    def hessian_part(self) -> ca.Function:
        """(z, p, weight, y, r) -> Hessian of weight · cost + y · rows without the products of slopes, (nz, nz).

        A square has the Hessian 2 (∇r ∇rᵀ + r ∇²r). This is the second term, for given r: the first is cheap to add
        once ∇r is known.
        """
        weight, y = ca.SX.sym("weight"), ca.SX.sym("y", self.rows.numel())
        r = ca.SX.sym("r", self.squares.numel())
        curved, _ = ca.hessian(weight * (self.cost + 2 * ca.dot(r, self.squares)) + ca.dot(y, self.rows), self.z)
        return ca.Function("hessian_part", [self.z, self.p, weight, y, r], [curved])

    @cached_property
    def instructions(self) -> tuple[Instructions, Instructions, Instructions]:
        """Of `value`, `slope_parts` and `hessian_part`, for many places at once."""
        value, slope, hessian = map(Instructions.of, (self.value, self.slope_parts, self.hessian_part))
        return value, slope, hessian


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


# --- for IPOPT ---


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


# --- CasADi functions at many places at once ---


@dataclass(frozen=True)
class Instructions:
    """A function as CasADi's list of scalar operations, and the sizes (rows, columns) of its inputs and outputs.

    code (k, 4): operation, result, operands; constants (c,); registers: how many it needs
    """

    code: NDArray[np.int32]
    constants: Array
    registers: int
    takes: tuple[tuple[int, int], ...]
    gives: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, function: ca.Function) -> Instructions:
        """Of a function of SX expressions with dense inputs; its outputs become dense."""
        symbols = [ca.SX.sym("in", *function.size_in(i)) for i in range(function.n_in())]
        dense = ca.Function("dense", symbols, [ca.densify(result) for result in function.call(symbols)])
        code: list[list[int]] = []
        constants: list[float] = []
        for k in range(dense.n_instructions()):
            operation = dense.instruction_id(k)
            result, operands = dense.instruction_output(k), dense.instruction_input(k)
            if operation == ca.OP_CONST:
                operands = [len(constants)]
                constants.append(dense.instruction_constant(k))
            elif operation == ca.OP_OUTPUT:
                result, operands = result[:1], [*operands, result[1]]
            code.append([operation, *result, *operands, 0][:4])
        takes = tuple(dense.size_in(i) for i in range(dense.n_in()))
        gives = tuple(dense.size_out(i) for i in range(dense.n_out()))
        return cls(np.array(code, dtype=np.int32).reshape(-1, 4), np.array(constants), dense.sz_w(), takes, gives)


@dataclass(frozen=True)
class Machine:
    """The compiled interpreter of instructions, part of the library of effects; it exports its operation numbers."""

    library: ctypes.CDLL

    @cached_property
    def lanes(self) -> int:
        """Places per register."""
        return ctypes.c_int32.in_dll(self.library, "tendon_machine_lanes").value

    @cached_property
    def _numbers(self) -> NDArray[np.int32]:
        """Its number of each CasADi operation; −1 where it has none."""
        names = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(self.library, "tendon_machine_operations")))
        own = {getattr(ca, f"OP_{name}"): number for number, name in enumerate(names.decode().split())}
        return np.array([own.get(operation, -1) for operation in range(max(own) + 1)], dtype=np.int32)

    def code(self, instructions: Instructions) -> NDArray[np.int32]:
        """(k, 4) with its own numbers. Raises NotImplementedError for an operation that it does not have."""
        operations = instructions.code[:, 0]
        known = np.append(self._numbers, np.int32(-1))[np.minimum(operations, len(self._numbers))]
        if (known < 0).any():
            raise NotImplementedError(
                f"CasADi's operation {operations[known < 0][0]} is none of codegen/casadi/machine.py"
            )
        return np.column_stack([known, instructions.code[:, 1:]])


class Batch:
    """A function at N places, without copies: inputs (N, size), outputs (N, columns, rows)."""

    def __init__(self, machine: Machine, instructions: Instructions, count: int) -> None:
        self.inputs = [np.zeros((count, rows * columns)) for rows, columns in instructions.takes]
        # CasADi stores matrices column by column.
        self.outputs = [np.zeros((count, columns, rows)) for rows, columns in instructions.gives]
        registers = np.zeros((instructions.registers, machine.lanes))
        self._kept = machine.code(instructions), instructions.constants, registers
        own = (ctypes.c_void_p(array.ctypes.data) for array in self._kept)
        takes = _addresses(self.inputs), _sizes(instructions.takes)
        gives = _addresses(self.outputs), _sizes(instructions.gives)
        self._arguments = ctypes.c_size_t(count), ctypes.c_size_t(len(instructions.code)), *own, *takes, *gives
        self._run = machine.library.tendon_machine_run

    def __call__(self, *inputs: Array) -> list[Array]:
        """The outputs, which the next call overwrites; an input (size,) is the same at all places."""
        for own, values in zip(self.inputs, inputs, strict=True):
            own[:] = values
        self._run(*self._arguments)
        return self.outputs


def _addresses(arrays: Sequence[Array]) -> ctypes.Array[ctypes.c_void_p]:
    return (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))


def _sizes(shapes: Sequence[tuple[int, int]]) -> ctypes.Array[ctypes.c_size_t]:
    return (ctypes.c_size_t * len(shapes))(*(rows * columns for rows, columns in shapes))


# --- for the dense interior-point method ---


class BlockSlopes(NamedTuple):
    """First derivatives of a block by z: Jacobians of its rows (N, rows, nz), the squares in its cost (N, s), and their
    Jacobians (N, s, nz)."""

    rows: Array
    squares: Array
    of_squares: Array


@dataclass(frozen=True)
class NumericBlock:
    """A block as dense arrays: unknowns (k,) of x that it sees, maps (N, nz, k) from them to z.

    z is small, so that a sum over places of Gᵀ Σ G is formed in z, where the Hessian is formed too, and both go to x
    together: many rows of constraints cost little.
    """

    block: ProgramBlock
    machine: Machine

    @cached_property
    def unknowns(self) -> NDArray[np.int64]:
        return np.unique(self.block.places.indices).astype(np.int64)

    @cached_property
    def maps(self) -> Array:
        dense = self.block.places[:, self.unknowns].toarray()
        return np.ascontiguousarray(
            dense.reshape(self.block.count, self.block.expression.z.numel(), len(self.unknowns))
        )

    @cached_property
    def _flat(self) -> Array:
        return self.maps.reshape(-1, len(self.unknowns))

    @cached_property
    def _batches(self) -> tuple[Batch, Batch, Batch]:
        value, slope, hessian = (
            Batch(self.machine, instructions, self.block.count) for instructions in self.block.expression.instructions
        )
        return value, slope, hessian

    def seen(self, x: Array) -> Array:
        """(N, nz) z at every place."""
        return (self._flat @ x[self.unknowns]).reshape(self.block.count, -1)

    def value(self, x: Array, p: Array) -> tuple[float, Array]:
        """Cost, and rows (N, rows)."""
        cost, rows = self._batches[0](self.seen(x), p)
        return float(self.block.weights @ cost.ravel()), rows.reshape(self.block.count, -1).copy()

    def slope(self, x: Array, p: Array) -> tuple[Array, BlockSlopes]:
        """Gradient (N, nz) of the weighted cost by z, and the slopes of rows and squares."""
        gradient, jacobian, squares, of_squares = self._batches[1](self.seen(x), p)
        slopes = [np.ascontiguousarray(part.transpose(0, 2, 1)) for part in (jacobian, of_squares)]
        found = BlockSlopes(slopes[0], squares[:, 0].copy(), slopes[1])
        whole = gradient[:, 0] + 2 * _times(found.squares, found.of_squares)
        return self.block.weights[:, None] * whole, found

    def hessian(self, x: Array, p: Array, slopes: BlockSlopes, scale: float, y: Array) -> Array:
        """(N, nz, nz) of scale · cost + y (N, rows) · rows, with the slopes at x."""
        weight = scale * self.block.weights
        inner = slopes.of_squares.transpose(0, 2, 1) @ slopes.of_squares
        part = self._batches[2](self.seen(x), p, weight[:, None], y, slopes.squares)[0]
        found: Array = part + 2 * weight[:, None, None] * inner
        return found

    def add_gradient(self, total: Array, v: Array) -> None:
        """Add a gradient v (N, nz) by z to one by x."""
        total[self.unknowns] += v.ravel() @ self._flat

    def add_hessian(self, total: Array, m: Array) -> None:
        """Add a Hessian m (N, nz, nz) by z to one by x."""
        whole = self._flat.T @ (m @ self.maps).reshape(-1, len(self.unknowns))
        total[np.ix_(self.unknowns, self.unknowns)] += whole


@dataclass(frozen=True)
class Kernels:
    """All blocks of a program in numbers. Rows stand in one vector, block after block, place after place."""

    blocks: tuple[NumericBlock, ...]
    size: int

    @classmethod
    def of(cls, blocks: Sequence[ProgramBlock], machine: Machine) -> Kernels:
        return cls(tuple(NumericBlock(b, machine) for b in blocks), blocks[0].places.shape[1])

    @cached_property
    def _ends(self) -> list[slice]:
        ends = np.cumsum([0, *(b.block.expression.rows.numel() * b.block.count for b in self.blocks)]).tolist()
        return [slice(a, b) for a, b in pairwise(ends)]

    def value(self, x: Array, p: Array) -> tuple[float, Array]:
        """Cost, and all rows (m,)."""
        parts = [block.value(x, p) for block in self.blocks]
        return sum(cost for cost, _ in parts), np.concatenate([rows.ravel() for _, rows in parts])

    def slope(self, x: Array, p: Array) -> tuple[Array, list[BlockSlopes]]:
        """Gradient (nx,) of the cost, and the slopes of each block."""
        gradient, found = np.zeros(self.size), []
        for block in self.blocks:
            slope, slopes = block.slope(x, p)
            block.add_gradient(gradient, slope)
            found.append(slopes)
        return gradient, found

    def condensed(
        self, x: Array, p: Array, slopes: Sequence[BlockSlopes], *, scale: float, y: Array, sigma: Array
    ) -> Array:
        """(nx, nx): Hessian of scale · cost + y · rows, plus Jᵀ diag(sigma) J, with the slopes at x."""
        total = np.zeros((self.size, self.size))
        for block, here, place in zip(self.blocks, slopes, self._ends, strict=True):
            G, own = here.rows, here.rows.shape[:2]
            m = block.hessian(x, p, here, scale=scale, y=y[place].reshape(own))
            m += G.transpose(0, 2, 1) @ (sigma[place].reshape(own)[:, :, None] * G)
            block.add_hessian(total, m)
        return total

    def jacobian_transposed_times(self, slopes: Sequence[BlockSlopes], y: Array) -> Array:
        """(nx,) Jᵀ y."""
        total = np.zeros(self.size)
        for block, here, place in zip(self.blocks, slopes, self._ends, strict=True):
            block.add_gradient(total, _times(y[place].reshape(here.rows.shape[:2]), here.rows))
        return total

    def jacobian_times(self, slopes: Sequence[BlockSlopes], dx: Array) -> Array:
        """(m,) J dx."""
        parts = zip(self.blocks, slopes, strict=True)
        return np.concatenate([(here.rows @ block.seen(dx)[:, :, None]).ravel() for block, here in parts])

    def jacobian_rows(self, slopes: Sequence[BlockSlopes], rows: NDArray[np.bool_]) -> Array:
        """(k, nx) the chosen rows of J, dense."""
        found = []
        for block, here, place in zip(self.blocks, slopes, self._ends, strict=True):
            at, which = np.nonzero(rows[place].reshape(here.rows.shape[:2]))
            if len(at):
                dense = np.zeros((len(at), self.size))
                dense[:, block.unknowns] = _times(here.rows[at, which], block.maps[at])
                found.append(dense)
        return np.concatenate(found) if found else np.zeros((0, self.size))


def _times(v: Array, matrices: Array) -> Array:
    """(N, k) vᵀ M at every place, v (N, r) and matrices (N, r, k)."""
    product: Array = (v[:, None] @ matrices)[:, 0]
    return product
