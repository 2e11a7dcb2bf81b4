"""Bodies that can be, for base parameters that were identified: what a simulator needs and a recording does not show.

The pseudo-inertia of a body is positive definite exactly if some mass has it. It is written by its log-Cholesky
parameters, in which every vector of numbers is such a body; those are sought whose base parameters are the given ones,
and among them the ones next to a reference in what nothing shows.
Source: Wensing, Kim & Slotine 2018 (pseudo-inertia); Rucker & Wensing 2022 (log-Cholesky parameters).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from runtime.exchange.full_regressor import PER_BODY
from runtime.exchange.settings import (
    BODY_LENGTH,
    EXACT_STEPS,
    EXACT_TORQUE,
    LARGEST_TURN,
    LEAST_GAIN,
    LEAST_GYRATION,
    LEAST_MASS,
    NEAR_REFERENCE,
    SEARCH_STEPS,
)

Array = NDArray[np.float64]

_UPPER = [(0, 1), (1, 2), (0, 2)]
"""Where s12, s23, s13 stand."""
_SCALE = np.array([1.0, 1.0, 1.0, 1.0, *[BODY_LENGTH] * 6])
"""By which log-Cholesky parameters are measured: three are shears and three lengths, m, beside logarithms."""


@dataclass(frozen=True)
class PhysicalBodies:
    """bodies (n, 10), as full_regressor orders them, each of a positive definite pseudo-inertia; rotors (n,);
    mismatch: rms of the torque that they miss, as a part of the torque's."""

    bodies: Array
    rotors: Array
    mismatch: float


def project(B: Array, W: Array, base: Array, bodies: Array, rotors: Array) -> PhysicalBodies:
    """The possible bodies with these base parameters that are next to a reference.

    B (p, 11 n), W (p, p)            of full_regressor.base_map     base (p,)
    bodies (n, 10), rotors (n,)      the reference; a rotor of 0 stays 0
    Where no possible bodies have these base parameters, the nearest in torque.
    """
    problem = _Problem(B, W, base, rotors > 0)
    start = problem.packed(np.array([log_cholesky(body) for body in bodies]), rotors)
    scale = problem.scale(len(bodies))

    x = start
    for near in NEAR_REFERENCE:
        x = _between(problem, x, start, scale / near)
    x = _exact(problem, x, scale)
    made, turning = problem.unpacked(x)
    full = np.concatenate([pseudo_parameters(theta) for theta in made])
    return PhysicalBodies(full.reshape(-1, PER_BODY), turning, float(np.linalg.norm(problem.missing(x))))


def rotors_asked(B: Array, W: Array, base: Array, bodies: Array, likely: Array, guessed: NDArray[np.bool_]) -> Array:
    """(n,) rotors beside which bodies (n, 10) come nearest to the base parameters, where the model file states none; at
    least the likely ones (n,), which stand where it does.

    From a rotor that is far too small the search bends bodies out of their shape instead, and ends at a flat one.
    """
    at = B.shape[1] - len(likely) + np.flatnonzero(guessed)
    left = W @ (base - B @ np.concatenate([bodies.ravel(), likely]))
    rotors = likely.copy()
    rotors[guessed] += np.maximum(np.linalg.lstsq(W @ B[:, at], left, rcond=None)[0], 0.0)
    return rotors


def _between(problem: _Problem, x: Array, start: Array, reach: Array) -> Array:
    """From x on to the least sum of what is missing and of the way from `start` in units of `reach`, squared."""
    found = least_squares(
        lambda x: np.concatenate([problem.missing(x), (x - start) / reach]),
        x,
        lambda x: np.concatenate([problem.slope(x), np.diag(1 / reach)]),
        x_scale=reach,
        max_nfev=SEARCH_STEPS,
    )
    return np.asarray(found.x)


def _exact(problem: _Problem, x: Array, scale: Array) -> Array:
    """Onto the base parameters themselves by Newton's steps of least length, as long as they come nearer; they do not
    where no possible bodies have them."""
    missing = problem.missing(x)
    for _ in range(EXACT_STEPS):
        if np.linalg.norm(missing) < EXACT_TORQUE:
            break
        step = -scale * (np.linalg.pinv(problem.slope(x) * scale) @ missing)
        step *= min(1.0, LARGEST_TURN / np.abs(step / scale).max())
        tried = problem.missing(x + step)
        if np.linalg.norm(tried) > LEAST_GAIN * np.linalg.norm(missing):
            break
        x, missing = x + step, tried
    return x


@dataclass(frozen=True)
class _Problem:
    """What is missing of the torques of some base parameters, by log-Cholesky parameters of bodies and logarithms of
    rotors."""

    B: Array
    W: Array
    base: Array
    turning: NDArray[np.bool_]

    @property
    def size(self) -> float:
        return float(np.linalg.norm(self.W @ self.base)) or 1.0

    def scale(self, n: int) -> Array:
        return np.concatenate([np.tile(_SCALE, n), np.ones(int(self.turning.sum()))])

    def packed(self, thetas: Array, rotors: Array) -> Array:
        return np.concatenate([thetas.ravel(), np.log(rotors[self.turning])])

    def unpacked(self, x: Array) -> tuple[Array, Array]:
        """Log-Cholesky parameters (n, 10) and rotors (n,)."""
        n = len(self.turning)
        rotors = np.zeros(n)
        rotors[self.turning] = np.exp(x[PER_BODY * n :])
        return x[: PER_BODY * n].reshape(n, PER_BODY), rotors

    def missing(self, x: Array) -> Array:
        """(p,); its length is the rms of the missing torque as a part of the torque's."""
        thetas, rotors = self.unpacked(x)
        full = np.concatenate([*(pseudo_parameters(theta) for theta in thetas), rotors])
        found: Array = self.W @ (self.B @ full - self.base) / self.size
        return found

    def slope(self, x: Array) -> Array:
        """Its derivative (p, size of x)."""
        thetas, rotors = self.unpacked(x)
        n = len(thetas)
        by = np.zeros((PER_BODY * n + n, len(x)))
        for body, theta in enumerate(thetas):
            place = slice(PER_BODY * body, PER_BODY * (body + 1))
            by[place, place] = pseudo_slopes(theta)
        for column, k in enumerate(np.flatnonzero(self.turning).tolist()):
            by[PER_BODY * n + k, PER_BODY * n + column] = rotors[k]
        found: Array = self.W @ (self.B @ by) / self.size
        return found


# --- one body ---


def _factor(theta: Array) -> Array:
    """U (4, 4), upper triangular, whose U Uᵀ is the pseudo-inertia; theta: alpha, d1 to d3, s12, s23, s13, t1 to t3."""
    U = np.eye(4)
    U[[0, 1, 2], [0, 1, 2]] = np.exp(theta[1:4])
    for value, (i, j) in zip(theta[4:7], _UPPER, strict=True):
        U[i, j] = value
    U[:3, 3] = theta[7:]
    scaled: Array = np.exp(theta[0]) * U
    return scaled


def _parameters(P: Array) -> Array:
    """The ten of a pseudo-inertia [[Σ, h], [hᵀ, m]]: I = tr(Σ) 1 − Σ."""
    moments = np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3]
    return np.array([P[3, 3], *P[:3, 3], *moments[np.triu_indices(3)]])


def pseudo_parameters(theta: Array) -> Array:
    """(10,) inertial parameters of log-Cholesky ones (10,)."""
    U = _factor(theta)
    return _parameters(U @ U.T)


def pseudo_slopes(theta: Array) -> Array:
    """Their derivative, (10, 10)."""
    U, columns = _factor(theta), []
    size = np.exp(theta[0])
    for k in range(PER_BODY):
        dU = np.zeros((4, 4))
        if k == 0:
            dU = U
        elif k <= 3:
            dU[k - 1, k - 1] = U[k - 1, k - 1]
        elif k <= 6:
            dU[_UPPER[k - 4]] = size
        else:
            dU[k - 7, 3] = size
        half = dU @ U.T
        columns.append(_parameters(half + half.T))
    return np.stack(columns, axis=1)


def log_cholesky(body: Array) -> Array:
    """(10,) of a body's inertial parameters; of one that cannot be, of the next that can, of LEAST_MASS and
    LEAST_GYRATION at least."""
    P = pseudo_inertia(body)
    m = max(body[0], LEAST_MASS)
    com = P[:3, 3] / m
    second = P[:3, :3] / m - np.outer(com, com)
    values, vectors = np.linalg.eigh(second)
    second = (vectors * np.maximum(values, LEAST_GYRATION**2)) @ vectors.T
    # An upper triangular factor is a lower one of the matrix read backwards.
    S = np.linalg.cholesky(second[::-1, ::-1])[::-1, ::-1]
    shears = [S[place] for place in _UPPER]
    return np.array([np.log(m) / 2, *np.log(np.diag(S)), *shears, *com])


def pseudo_inertia(body: Array) -> Array:
    """[[Σ, h], [hᵀ, m]] (4, 4) of a body's ten parameters: Σ = tr(I)/2 1 − I about the origin."""
    moments = np.zeros((3, 3))
    moments[np.triu_indices(3)] = body[4:]
    moments = moments + np.triu(moments, 1).T
    P = np.empty((4, 4))
    P[:3, :3] = np.trace(moments) / 2 * np.eye(3) - moments
    P[:3, 3] = P[3, :3] = body[1:4]
    P[3, 3] = body[0]
    return P


def is_possible(body: Array) -> bool:
    """Whether some mass has these ten parameters: a positive definite pseudo-inertia."""
    return bool(np.linalg.eigvalsh(pseudo_inertia(body))[0] > 0)
