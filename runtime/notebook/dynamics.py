"""An arm's functions, from its generated C: one sample (n,), or many (N, n) in one call without a loop in Python."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from runtime.arrays import Array
from runtime.model.catalogue import LoaderError
from runtime.model.loader import Model
from runtime.notebook.effects_along import whole_torque


class ArmFunctions(ABC):
    """Functions of q, qd, qdd and tau in SI, at the joints' side of the gears: rad or m, N m or N.

    Each argument is (n,), or (N, n) with the samples first; they broadcast as NumPy's do, so that 0 means zero at every
    joint. Friction and other effects are in `torque` alone.
    A wrong shape raises LoaderError, and an arm whose file leaves masses or inertias open ModelError.
    """

    @property
    @abstractmethod
    def model(self) -> Model:
        """The generated functions, with the samples last."""

    @property
    def name(self) -> str:
        """The arm's name in its model file."""
        return self.model.name

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.model.n

    def inverse_dynamics(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Torques of the motors, D q̈ + C q̇ + g with the rotors, (n,) or (N, n)."""
        return self._call("inverse_dynamics", q=q, qd=qd, qdd=qdd)

    def torque(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, dt: float | None = None) -> Array:
        """Torques of the motors with friction and all other effects of the model file, (n,) or (N, n).

        dt   s from sample to sample, for effects that depend on what was before: the samples are then one motion
        Raises ModelError if a value is unknown.
        """
        turned = self._turned({"q": q, "qd": qd, "qdd": qdd})
        rows = {name: array.reshape(self.n, -1) for name, array in turned.items()}
        return whole_torque(self.model, **rows, dt=dt).T.reshape(turned["q"].T.shape)

    def forward_dynamics(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> Array:
        """Accelerations under the torques tau, (n,) or (N, n) rad/s² or m/s²."""
        return self._call("forward_dynamics", q=q, qd=qd, tau=tau)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """D(q) with the rotors, (n, n) or (N, n, n) kg m²."""
        return self._call("inertia", q=q)

    def coriolis(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Coriolis matrix C(q, q̇), so that Ḋ − 2C is skew-symmetric; (n, n) or (N, n, n) kg m²/s."""
        return self._call("coriolis", q=q, qd=qd)

    def gravity(self, q: ArrayLike) -> Array:
        """Torques that hold the arm against gravity, (n,) or (N, n). Rotor inertias may be unknown."""
        model, lumps = self.model, None
        if not model.lumps_known:
            # Unknown parameters may be anything where gravity does not depend on them.
            unknown = [lump.value is None for lump in model.lumps]
            if not self.regressor(q, 0.0, 0.0)[..., unknown].any():
                lumps = model.lumps_or(np.zeros(len(unknown)))
        return self._call("inverse_dynamics", lumps, q=q, qd=0.0, qdd=0.0)

    def tip(self, q: ArrayLike) -> Array:
        """The tip in the base frame, (3,) or (N, 3): x, y, z in m; of a planar arm x, y and the angle in rad."""
        return self._call("tip", q=q)

    def jacobian(self, q: ArrayLike) -> Array:
        """Derivative of the tip's pose by q in base axes, (6, n) or (N, 6, n): along x, y, z, then about them. Of a
        planar arm (3, n) or (N, 3, n)."""
        return self._call("tip_jacobian", q=q)

    def regressor(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Derivative of the inverse dynamics by the base inertial parameters `arm.model.lumps`, (n, p) or (N, n, p)."""
        return self._call("regressor", q=q, qd=qd, qdd=qdd)

    def _call(self, function: str, lumps: Array | None = None, **given: ArrayLike) -> Array:
        """Arguments with the samples first, and the result likewise; lumps: other base inertial parameters."""
        turned = self._turned(given)
        if lumps is None and function not in _GEOMETRY:
            lumps = self.model.lump_values
        result = self.model.call(function, turned, lumps)
        return np.moveaxis(result, -1, 0) if turned["q"].ndim == 2 else result

    def _turned(self, given: Mapping[str, ArrayLike]) -> dict[str, Array]:
        """Arguments, checked and broadcast, each joint's samples side by side, as the generated code takes them."""
        model, n = self.model, self.model.n
        arrays = [np.asarray(value, dtype=np.float64) for value in given.values()]
        for name, array in zip(given, arrays, strict=True):
            if array.ndim > 2 or (array.ndim and array.shape[-1] != n) or (name == "q" and not array.ndim):
                raise LoaderError(f"{model.name}: {name} has shape {array.shape}; expected {_shapes(n)}")
        if any(array.shape != arrays[0].shape for array in arrays):
            try:
                arrays = list(np.broadcast_arrays(*arrays))
            except ValueError as error:
                listed = ", ".join(f"{name} {array.shape}" for name, array in zip(given, arrays, strict=True))
                raise LoaderError(f"{model.name}: {listed} differ; expected {_shapes(n)} for each") from error
        return {name: np.ascontiguousarray(array.T) for name, array in zip(given, arrays, strict=True)}


_GEOMETRY = ("tip", "tip_jacobian", "regressor")
"""Functions that need no base inertial parameters."""


def _shapes(n: int) -> str:
    return f"({n},) or (N, {n})"
