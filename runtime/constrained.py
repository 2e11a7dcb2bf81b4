"""Least squares from normal equations under bounds and a positive definite inertia matrix."""

from __future__ import annotations

from collections.abc import Callable

import casadi
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Array = NDArray[np.float64]

_CUTS = 30
_RANK = 1e-9
_WELL_POSED = 1e-3
"""Smallest pivot of a scaled Cholesky factor below which directions may be unseen."""
_MARGIN = 1e-6
_ACCURACY = 1e-8
_RIDGES = (1e-12, 1e-9, 1e-6)
"""Of the mean curvature: makes directions that the data do not see unique and moves nothing that they do see. The
solver gives up where a Hessian is singular to rounding, or is not positive definite after the noise is taken off."""


def solve(gram: Array, moment: Array, near: Array | None = None) -> Array:
    """Least squares from normal equations; directions that the data do not see stay at `near` (K,), None: at zero.

    gram (K, K), moment (K,). A Gram matrix that is compensated for noise may have directions of negative
    size: noise is all that they hold, and they count as unseen.
    """
    if not len(moment):
        return moment
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    there = size > 0
    if not there.all():
        theta = np.zeros(len(moment)) if near is None else near.copy()
        if there.any():
            theta[there] = solve(gram[np.ix_(there, there)], moment[there], None if near is None else near[there])
        return theta
    scaled = gram / np.outer(size, size)
    factor, failed = lapack.dpotrf(scaled, lower=True)
    if not failed and np.diagonal(factor).min() > _WELL_POSED:
        answer: Array = lapack.dpotrs(factor, moment / size, lower=True)[0] / size
        return answer
    value, vector = np.linalg.eigh(scaled)
    seen = value > _RANK * value[-1]
    begin = np.zeros(len(moment)) if near is None else near
    rest = moment / size - scaled @ (begin * size)
    return begin + (vector[:, seen] @ ((vector[:, seen].T @ rest) / value[seen])) / size


def inverse(gram: Array) -> Array:
    """(K, K) by which `solve` answers any moment."""
    return np.array([solve(gram, unit) for unit in np.eye(len(gram))]).reshape(gram.shape).T


def rank(gram: Array) -> int:
    """Number of separate directions that the data see."""
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    there = size > 0
    if not there.any():
        return 0
    value = np.linalg.eigvalsh(gram[np.ix_(there, there)] / np.outer(size[there], size[there]))
    return int(np.sum(value > _RANK * value[-1]))


def bounded(gram: Array, moment: Array, lower: Array, upper: Array, near: Array | None = None) -> Array:
    """As `solve`, with each coefficient at the bound that it would otherwise leave."""
    held = lower == upper
    theta = np.where(held, lower, 0.0)
    for _ in range(len(theta) + 1):
        free = ~held
        rest = moment[free] - gram[np.ix_(free, held)] @ theta[held]
        theta[free] = solve(gram[np.ix_(free, free)], rest, None if near is None else near[free])
        broken = free & ((theta < lower) | (theta > upper))
        if not broken.any():
            break
        held |= broken
        theta = np.where(held, np.clip(theta, lower, upper), theta)
    return theta


def minimise(
    gram: Array,
    moment: Array,
    lower: Array,
    upper: Array,
    violated: Callable[[Array], Array | None],
    near: Array | None = None,
) -> Array:
    """argmin ½ θᵀ gram θ − momentᵀ θ with lower <= θ <= upper and c·θ > 0 for every cut of `violated`.

    `violated(θ)` gives a cut (K,) that θ breaks, or None: on good data always None, and the answer is
    that of `bounded`. Directions that the data do not see stay at `near` (K,), None: at zero.
    """
    theta = bounded(gram, moment, lower, upper, near)
    cut = violated(theta)
    if cut is None:
        return theta
    scale = np.sqrt(np.maximum(np.diag(gram), 0.0))
    scale = np.where(scale > 0, scale, 1.0)
    begin = np.zeros(len(theta)) if near is None else near
    # What the program seeks is counted from there, so that its ridge holds it there.
    g, m, cuts = gram / np.outer(scale, scale), (moment - gram @ begin) / scale, []
    lowest, highest = (lower - begin) * scale, (upper - begin) * scale
    for _ in range(_CUTS):
        cuts.append(cut / scale / max(float(np.linalg.norm(cut / scale)), 1e-300))
        a = np.array(cuts)
        scaled = _quadratic_program(g, m, lowest, highest, a, _MARGIN - a @ (begin * scale))
        theta = begin + _snapped(scaled, lowest, highest) / scale
        cut = violated(theta)
        if cut is None:
            break
    return theta


def _snapped(theta: Array, lower: Array, upper: Array) -> Array:
    """Coefficients within the solver's accuracy of a bound, or beyond it, exactly on it."""
    near = _ACCURACY * float(np.max(np.abs(theta), initial=0.0))
    theta = np.where(theta < lower + near, lower, theta)
    return np.where(theta > upper - near, upper, theta)


def _quadratic_program(g: Array, m: Array, lower: Array, upper: Array, a: Array, least: Array) -> Array:
    """argmin ½ xᵀ g x − mᵀ x with lower <= x <= upper and a x >= least."""
    size, x = len(m), np.zeros(len(m))
    quiet = {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False}
    for ridge in _RIDGES:
        h = g + ridge * np.trace(g) / size * np.eye(size)
        solver = casadi.conic("fit", "qrqp", {"h": casadi.DM(h).sparsity(), "a": casadi.DM(a).sparsity()}, quiet)
        answer = solver(h=h, a=a, g=-m, lbx=lower, ubx=upper, lba=least, uba=np.full(len(a), np.inf))
        x = np.array(answer["x"]).ravel()
        if solver.stats()["success"]:
            break
    return x
