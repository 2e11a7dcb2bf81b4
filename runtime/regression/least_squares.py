"""Least squares from normal equations under bounds and a positive definite inertia matrix."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from runtime.regression.settings import INERTIA_CUTS, INERTIA_MARGIN, OPTIMAL, RANK, RIDGE, SOLVER_ACCURACY, WELL_POSED

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


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
    if not failed and np.diagonal(factor).min() > WELL_POSED:
        answer: Array = lapack.dpotrs(factor, moment / size, lower=True)[0] / size
        return answer
    value, vector = np.linalg.eigh(scaled)
    seen = value > RANK * value[-1]
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
    return int(np.sum(value > RANK * value[-1]))


def bounded(gram: Array, moment: Array, lower: Array, upper: Array, near: Array | None = None) -> Array:
    """argmin ½ θᵀ gram θ − momentᵀ θ with lower <= θ <= upper; unseen directions as in `solve`.

    gram (K, K); moment, lower, upper, near (K,). Source: the active-set method BVLS, Stark & Parker, "Bounded-variable
    least squares", Computational Statistics 10, 1995. It begins with all coefficients on the bounds that they would
    leave otherwise, and releases one of them at a time while that lowers the cost. A Gram matrix that is compensated
    for noise need not be positive: a release that brings nothing is taken back, so that there is an end.
    """
    inside = solve(gram, moment, near)
    if np.all((inside >= lower) & (inside <= upper)):
        return inside
    theta, held = _held_where_broken(gram, moment, lower, upper=upper, near=near)
    fixed, refused = lower == upper, np.zeros(len(theta), dtype=bool)
    while (loose := held & ~fixed & ~refused).any():
        # How much the cost falls with a coefficient that leaves its bound, per unit of its column's size.
        size = np.sqrt(np.where(np.diag(gram) > 0, np.diag(gram), np.inf))
        fall = (moment - gram @ theta) / size
        inward = np.where(loose, np.where(theta > lower, -fall, fall), 0.0)
        at = int(np.argmax(inward))
        if inward[at] <= OPTIMAL * float(np.max(np.abs(moment) / size)):
            break
        tried, now_held = _released(gram, moment, lower, upper=upper, near=near, theta=theta, held=held, at=at)
        if _cost(gram, moment, tried) < _cost(gram, moment, theta):
            theta, held, refused = tried, now_held, np.zeros(len(theta), dtype=bool)
        else:
            refused[at] = True
    return theta


def _held_where_broken(
    gram: Array, moment: Array, lower: Array, upper: Array, near: Array | None
) -> tuple[Array, Mask]:
    """A place within the bounds to begin from, optimal in the coefficients that are not held there (K,)."""
    held = lower == upper
    theta = np.where(held, lower, 0.0)
    for _ in range(len(theta) + 1):
        theta = _with_held(gram, moment, near, theta=theta, held=held)
        broken = ~held & ((theta < lower) | (theta > upper))
        if not broken.any():
            break
        held |= broken
        theta = np.where(held, np.clip(theta, lower, upper), theta)
    return theta, held


def _released(
    gram: Array,
    moment: Array,
    lower: Array,
    upper: Array,
    near: Array | None,
    theta: Array,
    held: Mask,
    at: int,
) -> tuple[Array, Mask]:
    """From theta with coefficient `at` free, too: as far towards each optimum as the bounds let it, holding what
    meets them."""
    held = held.copy()
    held[at] = False
    while True:
        goal = _with_held(gram, moment, near, theta=theta, held=held)
        broken = ~held & ((goal < lower) | (goal > upper))
        if not broken.any():
            return goal, held
        bound = np.where(goal > upper, upper, lower)
        part = np.full(len(theta), np.inf)
        part[broken] = (bound[broken] - theta[broken]) / (goal[broken] - theta[broken])
        step = float(part.min())
        held |= part <= step
        theta = np.where(part <= step, bound, np.clip(theta + step * (goal - theta), lower, upper))


def _with_held(gram: Array, moment: Array, near: Array | None, theta: Array, held: Mask) -> Array:
    """theta with its coefficients that are not held at their optimum."""
    free, answer = ~held, theta.copy()
    rest = moment[free] - gram[np.ix_(free, held)] @ theta[held]
    answer[free] = solve(gram[np.ix_(free, free)], rest, None if near is None else near[free])
    return answer


def _cost(gram: Array, moment: Array, theta: Array) -> float:
    return float(theta @ (0.5 * (gram @ theta) - moment))


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
    theta = bounded(gram, moment, lower, upper=upper, near=near)
    cut = violated(theta)
    if cut is None:
        return theta
    scale = np.sqrt(np.maximum(np.diag(gram), 0.0))
    scale = np.where(scale > 0, scale, 1.0)
    begin = np.zeros(len(theta)) if near is None else near
    # What the program seeks is counted from there, so that its ridge holds it there.
    g, m, cuts = gram / np.outer(scale, scale), (moment - gram @ begin) / scale, []
    lowest, highest = (lower - begin) * scale, (upper - begin) * scale
    for _ in range(INERTIA_CUTS):
        cuts.append(cut / scale / max(float(np.linalg.norm(cut / scale)), 1e-300))
        a = np.array(cuts)
        scaled = _quadratic_program(g, m, lowest, upper=highest, a=a, least=INERTIA_MARGIN - a @ (begin * scale))
        theta = begin + _snapped(scaled, lowest, highest) / scale
        cut = violated(theta)
        if cut is None:
            break
    return theta


def _snapped(theta: Array, lower: Array, upper: Array) -> Array:
    """Coefficients within the solver's accuracy of a bound, or beyond it, exactly on it."""
    near = SOLVER_ACCURACY * float(np.max(np.abs(theta), initial=0.0))
    theta = np.where(theta < lower + near, lower, theta)
    return np.where(theta > upper - near, upper, theta)


def _quadratic_program(g: Array, m: Array, lower: Array, upper: Array, a: Array, least: Array) -> Array:
    """argmin ½ xᵀ g x − mᵀ x with lower <= x <= upper and a x >= least.

    Directions of no positive size, of which the data say nothing, are given a ridge: a Gram matrix that is compensated
    for noise need have none. The dual of the least distance is one of non-negative least squares: Lawson & Hanson,
    Solving Least Squares Problems, 1974, chapter 23.
    """
    from scipy.optimize import nnls  # where it is used: it takes longer to load than a fit

    value, vector = np.linalg.eigh(g)
    positive = float(np.sum(value[value > 0])) or 1.0
    root = np.sqrt(np.maximum(value, RIDGE * positive / len(m)))
    back = vector / root  # x = back (u + goal), so that the cost is |u|²/2
    goal = back.T @ m
    has_lower, has_upper = np.isfinite(lower), np.isfinite(upper)
    unit = np.eye(len(m))
    rows = np.vstack([a, unit[has_lower], -unit[has_upper]])
    bounds = np.concatenate([least, lower[has_lower], -upper[has_upper]])
    push, need = rows @ back, bounds - rows @ (back @ goal)
    size = np.maximum(np.linalg.norm(push, axis=1), 1e-300)
    push, need = push / size[:, None], need / size
    pressing = nnls(np.vstack([push.T, need]), np.append(np.zeros(len(m)), 1.0))[0] > 0
    # What presses is met exactly, and not to the accuracy of the dual.
    shift = np.linalg.lstsq(push[pressing], need[pressing], rcond=None)[0] if pressing.any() else np.zeros(len(m))
    x: Array = back @ (goal + shift)
    return x
