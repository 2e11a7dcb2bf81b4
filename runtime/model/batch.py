"""CasADi functions at many places at once, without copies."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from runtime.arrays import Array


class Batch:
    """A function of SX expressions at N places: inputs (N, size), outputs (N, columns, rows), all dense."""

    def __init__(self, function: ca.Function, count: int) -> None:
        symbols = [ca.SX.sym("in", *function.size_in(i)) for i in range(function.n_in())]
        dense = ca.Function("dense", symbols, [ca.densify(result) for result in function.call(symbols)])
        self.inputs = [np.zeros((count, dense.numel_in(i))) for i in range(dense.n_in())]
        # CasADi stores matrices column by column.
        self.outputs = [np.zeros((count, dense.size2_out(i), dense.size1_out(i))) for i in range(dense.n_out())]
        # What is kept here holds the memory that the function reads and writes.
        self._mapped = dense.map(count)
        buffer: Any
        buffer, self._run = self._mapped.buffer()
        for place, arrays in ((buffer.set_arg, self.inputs), (buffer.set_res, self.outputs)):
            for i, array in enumerate(arrays):
                if array.size:
                    place(i, array.reshape(-1).data)
        self._buffer = buffer

    def __call__(self, *inputs: Array) -> list[Array]:
        """The outputs, which the next call overwrites; an input (size,) is the same at all places."""
        for own, values in zip(self.inputs, inputs, strict=True):
            own[:] = values
        self._run()
        return self.outputs
