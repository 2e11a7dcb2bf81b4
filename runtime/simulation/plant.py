"""A simulated arm that a controller drives: advanced by control periods."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from runtime.arrays import Array
from runtime.interruption import heard_in_casadi
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Structure
from runtime.simulation.integrator import Integrator


class Plant:
    """A simulated arm with `terms` (all values known), advanced by control periods.

    q and qd are the motors' angles and rates divided by the gear ratio. Raises PlantError.
    """

    def __init__(self, model: Model, terms: Structure, period: float) -> None:
        self.model, self.terms, self.period = model, terms, period
        with heard_in_casadi():
            made = Integrator(model, Prediction(model.lump_values, terms), period)
            self.step, self.widths = made.step, made.widths
            state, command = ca.MX.sym("state", made.one.size1_in(0)), ca.MX.sym("command", model.n)
            after = made.one.fold(made.substeps)(state, ca.repmat(command, 1, made.substeps), ca.MX(0, made.substeps))
            self._advance = ca.Function("period", [state, command], [after])
            self._rest = made.rest()
        self._state: Array = np.zeros(self._advance.size1_in(0))
        self._command: Array = np.zeros(model.n)
        # Calls without copies or conversions.
        self._buffer, self._run = self._advance.buffer()
        for k, array in enumerate((self._state, self._command)):
            self._buffer.set_arg(k, memoryview(array))  # type: ignore[arg-type, call-arg]
        self._buffer.set_res(0, memoryview(self._state))  # type: ignore[arg-type, call-arg]
        self.reset(np.zeros(model.n))

    @property
    def q(self) -> Array:
        """(n,) rad or m."""
        return self._state[: self.model.n]

    @property
    def qd(self) -> Array:
        """(n,) rad/s or m/s."""
        return self._state[self.model.n : 2 * self.model.n]

    @property
    def t(self) -> float:
        """Time in s since `reset`."""
        return float(self._state[-1])

    def reset(self, q: ArrayLike, qd: ArrayLike | None = None) -> None:
        """To q (n,) and t = 0, at rest unless rates qd (n,) are given."""
        n = self.model.n
        self._state[:] = np.asarray(self._rest(np.asarray(q, dtype=np.float64))).ravel()
        if qd is not None:
            self._state[n : 2 * n] = qd

    def advance(self, torque: ArrayLike) -> None:
        """Advances by one control period under constant torques (n,)."""
        self._command[:] = torque
        self._run()
