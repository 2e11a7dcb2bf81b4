"""Least squares from normal equations under bounds and a positive definite inertia matrix."""

from __future__ import annotations

from collections.abc import Callable

import casadi
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_CUTS = 30
_RANK = 1e-10
_MARGIN = 1e-6
_ACCURACY = 1e-8


def minimise(
    gram: Array, moment: Array, lower: Array, upper: Array, violated: Callable[[Array], Array | None]
) -> Array:
    """argmin ½ θᵀ gram θ − momentᵀ θ with lower <= θ <= upper and c·θ > 0 for every cut of `violated`.

    gram (K, K), moment (K,). `violated(θ)` gives a cut (K,) that θ breaks, or None. Directions that
    the data do not see take the smallest coefficients. The unconstrained solution is returned
    whenever it is admissible, which on good data is always.
    """
    scale = np.sqrt(np.maximum(np.diag(gram), 0.0))
    scale = np.where(scale > 0, scale, 1.0)
    g, m = gram / np.outer(scale, scale), moment / scale
    theta = _least_norm(g, m)
    cuts: list[Array] = []
    for _ in range(_CUTS):
        x = theta / scale
        cut = violated(x)
        inside = bool(np.all(x >= lower - 1e-9 * np.abs(x)) and np.all(x <= upper + 1e-9 * np.abs(x)))
        if inside and cut is None:
            break
        if cut is not None:
            cuts.append(cut / scale / max(float(np.linalg.norm(cut / scale)), 1e-300))
        theta = _quadratic_program(g, m, lower * scale, upper * scale, cuts)
    return _snapped(theta, lower * scale, upper * scale) / scale


def _snapped(theta: Array, lower: Array, upper: Array) -> Array:
    """Coefficients within the solver's accuracy of a bound, or beyond it, exactly on it."""
    near = _ACCURACY * float(np.max(np.abs(theta), initial=0.0))
    theta = np.where(theta < lower + near, lower, theta)
    return np.where(theta > upper - near, upper, theta)


def _least_norm(g: Array, m: Array) -> Array:
    value, vector = np.linalg.eigh(g)
    if not len(value):
        return m
    keep = value > _RANK * value[-1]
    return vector[:, keep] @ ((vector[:, keep].T @ m) / value[keep])


def _quadratic_program(g: Array, m: Array, lower: Array, upper: Array, cuts: list[Array]) -> Array:
    size = len(m)
    a = np.array(cuts) if cuts else np.zeros((0, size))
    # The ridge makes directions that the data do not see unique; it moves nothing that they do see.
    h = g + 1e-12 * np.trace(g) / size * np.eye(size)
    solver = casadi.conic(
        "fit",
        "qrqp",
        {"h": casadi.DM(h).sparsity(), "a": casadi.DM(a).sparsity()},
        {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False},
    )
    answer = solver(h=h, a=a, g=-m, lbx=lower, ubx=upper, lba=np.full(len(a), _MARGIN), uba=np.full(len(a), np.inf))
    return np.array(answer["x"]).ravel()
