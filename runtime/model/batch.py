"""CasADi functions at many places at once, without copies, by the compiled interpreter of codegen/casadi/machine.py."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
