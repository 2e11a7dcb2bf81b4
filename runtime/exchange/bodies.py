"""Physically possible bodies for identified base parameters: simulators need them, and a recording does not show them.

The regressor of all inertial parameters comes from a Newton-Euler recursion on NumPy arrays. Compared with the
generated regressor it gives the linear map from full to base parameters, in whatever frames those were derived.
A body is possible if its pseudo-inertia is positive definite. Every vector of log-Cholesky parameters is such a body,
so the search runs over them: bodies with the given base parameters, as close as possible to a reference.
Source: Atkeson, An & Hollerbach 1986 (regressor of a body); Gautier & Khalil 1990 (base parameters);
Wensing, Kim & Slotine 2018 (pseudo-inertia); Rucker & Wensing 2022 (log-Cholesky parameters).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from runtime.arrays import Array
from runtime.exchange.settings import (
    BODY_LENGTH,
    EXACT_STEPS,
    EXACT_TORQUE,
    LARGEST_TURN,
    LEAST_GAIN,
    LEAST_GYRATION,
    LEAST_MASS,
    MAP_RATE,
    MAP_STATES,
    NEAR_REFERENCE,
    SEARCH_STEPS,
)
from runtime.model.kinematics import in_frame_before, unit_axis
from symbolic.model_file.arm import Arm

PER_BODY = 10
"""Inertial parameters of a body: m; m x, m y, m z; Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the joint frame's origin."""


def full_regressor(arm: Arm, q: Array, qd: Array, qdd: Array) -> Array:
    """Derivative of the joint torques by all inertial parameters.

    q, qd, qdd (n, N). Returns (n, 11 n, N): PER_BODY columns per body from the base outwards, then one per rotor.
    """
    n, N = q.shape
    axes = [unit_axis(joint) for joint in arm.joints]
    moved = [in_frame_before(joint, at) for joint, at in zip(arm.joints, q, strict=True)]
    out = np.zeros((n, (PER_BODY + 1) * n, N))
    # Rate, its derivative, and acceleration less gravity of a joint's frame, in its own axes.
    w, wd, a = np.zeros((3, N)), np.zeros((3, N)), np.repeat(-np.array(arm.gravity)[:, None], N, axis=1)
    for k, (joint, (R, p)) in enumerate(zip(arm.joints, moved, strict=True)):
        a = a + np.cross(wd, p, axis=0) + np.cross(w, np.cross(w, p, axis=0), axis=0)
        w, wd, a = (np.einsum("baN,bN->aN", R, v) for v in (w, wd, a))
        along = axes[k][:, None]
        if joint.type == "revolute":
            wd = wd + np.cross(w, along * qd[k], axis=0) + along * qdd[k]
            w = w + along * qd[k]
        else:
            a = a + 2 * np.cross(w, along * qd[k], axis=0) + along * qdd[k]
        wrench = _body_wrench(w, wd, a)
        for j in range(k, -1, -1):
            # Forces are rows 0 to 2, moments about the origin of frame j rows 3 to 5.
            rows = wrench[3:] if arm.joints[j].type == "revolute" else wrench[:3]
            out[j, PER_BODY * k : PER_BODY * (k + 1)] = np.einsum("a,acN->cN", axes[j], rows)
            R, p = moved[j]
            force = np.einsum("abN,bcN->acN", R, wrench[:3])
            moment = np.einsum("abN,bcN->acN", R, wrench[3:]) + np.cross(p[:, None], force, axis=0)
            wrench = np.concatenate([force, moment])
        out[k, PER_BODY * n + k] = qdd[k]
    return out


def mobilities(arm: Arm, bodies: Array, rotors: Array, elastic: NDArray[np.bool_]) -> Array:
    """Each link's acceleration by a unit of torque on it, with all joints at 0, (n,) 1/(kg m²) or 1/kg.

    bodies (n, 10), rotors (n,)      elastic (n,)   whether a joint's rotor is before a spring, so that it stays behind
    """
    n = len(arm.joints)
    still = np.zeros((n, n))
    moved = full_regressor(replace(arm, gravity=(0.0, 0.0, 0.0)), still, still, np.eye(n))
    inertia = np.einsum("npN,p->nN", moved, np.concatenate([bodies.ravel(), np.where(elastic, 0.0, rotors)]))
    found: Array = np.diag(np.linalg.inv(inertia))
    return found


def base_map(arm: Arm, regressor: Callable[[Array, Array, Array], Array]) -> tuple[Array, Array]:
    """The map from full to base parameters, and a weight that converts base parameters to torque.

    regressor   the generated one: q, qd, qdd (n, N) -> (n, p, N)
    Returns B (p, 11 n) with base = B full; and W (p, p) such that |W base|² is the mean square torque of random states.
    """
    rng, n = np.random.default_rng(0), len(arm.joints)
    q = rng.uniform(-np.pi, np.pi, (n, MAP_STATES))
    qd, qdd = rng.uniform(-MAP_RATE, MAP_RATE, (2, n, MAP_STATES))
    base = np.moveaxis(regressor(q, qd, qdd), 1, 2).reshape(n * MAP_STATES, -1)
    full = np.moveaxis(full_regressor(arm, q, qd, qdd), 1, 2).reshape(n * MAP_STATES, -1)
    B = np.linalg.lstsq(base, full, rcond=None)[0]
    return np.where(np.abs(B) < 1e-10 * np.abs(B).max(), 0.0, B), np.linalg.qr(base)[1] / np.sqrt(MAP_STATES)


def _body_wrench(w: Array, wd: Array, a: Array) -> Array:
    """Force and moment about the frame's origin for a body's motion, per inertial parameter: (6, 10, N)."""
    N = w.shape[1]
    out = np.zeros((6, PER_BODY, N))
    out[:3, 0] = a
    for k, e in enumerate(np.eye(3)):
        e = e[:, None]
        out[:3, 1 + k] = np.cross(wd, e, axis=0) + np.cross(w, np.cross(w, e, axis=0), axis=0)
        out[3:, 1 + k] = np.cross(e, a, axis=0)
    for k, (i, j) in enumerate([(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        out[3:, 4 + k] = unit @ wd + np.cross(w, unit @ w, axis=0)
    return out


# --- physically possible bodies ---

_UPPER = [(0, 1), (1, 2), (0, 2)]
"""Places of s12, s23, s13."""
_SCALE = np.array([1.0, 1.0, 1.0, 1.0, *[BODY_LENGTH] * 6])
"""Scales of the log-Cholesky parameters: logarithms, then three shears and three lengths in m."""


@dataclass(frozen=True)
class PhysicalBodies:
    """Possible bodies (n, 10) in the order of full_regressor, and rotors (n,).

    mismatch   RMS torque error against the base parameters, as a part of the RMS torque
    """

    bodies: Array
    rotors: Array
    mismatch: float


def project(B: Array, W: Array, base: Array, bodies: Array, rotors: Array) -> PhysicalBodies:
    """The possible bodies with these base parameters nearest to a reference.

    B (p, 11 n), W (p, p)            of base_map     base (p,)
    bodies (n, 10), rotors (n,)      the reference; a rotor of 0 stays 0
    If no possible bodies have these base parameters, those with the nearest torque.
    """
    turning = rotors > 0
    problem = _Problem(B, W / (float(np.linalg.norm(W @ base)) or 1.0), base, turning)
    start = np.concatenate([*(log_cholesky(body) for body in bodies), np.log(rotors[turning])])
    scale = np.concatenate([np.tile(_SCALE, len(bodies)), np.ones(int(turning.sum()))])
    x = start
    for near in NEAR_REFERENCE:
        x = _nearest(problem, x, start, scale / near)
    # Newton steps of least length to the exact base parameters, as long as the torque error falls.
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
    made, found = problem.unpacked(x)
    return PhysicalBodies(np.array([*map(pseudo_parameters, made)]), found, float(np.linalg.norm(missing)))


def _nearest(problem: _Problem, x: Array, start: Array, reach: Array) -> Array:
    """Minimises squared torque error plus squared distance from `start` in units of `reach`, beginning at x."""
    found = least_squares(
        lambda x: np.concatenate([problem.missing(x), (x - start) / reach]),
        x,
        lambda x: np.concatenate([problem.slope(x), np.diag(1 / reach)]),
        x_scale=reach,
        max_nfev=SEARCH_STEPS,
    )
    return np.asarray(found.x)


def rotors_asked(B: Array, W: Array, base: Array, bodies: Array, likely: Array, guessed: NDArray[np.bool_]) -> Array:
    """(n,) rotor inertias with which bodies (n, 10) fit the base parameters best, where they are `guessed`.

    likely (n,)   the stated ones, and lower bounds for the guessed ones
    With a rotor far too small, the search would deform the bodies instead, and end at a flat one.
    """
    at = B.shape[1] - len(likely) + np.flatnonzero(guessed)
    left = W @ (base - B @ np.concatenate([bodies.ravel(), likely]))
    rotors = likely.copy()
    rotors[guessed] += np.maximum(np.linalg.lstsq(W @ B[:, at], left, rcond=None)[0], 0.0)
    return rotors


@dataclass(frozen=True)
class _Problem:
    """Torque error as a function of log-Cholesky parameters of bodies and logarithms of rotors; W converts it to a part
    of the RMS torque."""

    B: Array
    W: Array
    base: Array
    turning: NDArray[np.bool_]

    def unpacked(self, x: Array) -> tuple[Array, Array]:
        """Log-Cholesky parameters (n, 10) and rotors (n,)."""
        n = len(self.turning)
        rotors = np.zeros(n)
        rotors[self.turning] = np.exp(x[PER_BODY * n :])
        return x[: PER_BODY * n].reshape(n, PER_BODY), rotors

    def missing(self, x: Array) -> Array:
        """Torque error (p,); its norm is the RMS error as a part of the RMS torque."""
        thetas, rotors = self.unpacked(x)
        full = np.concatenate([*(pseudo_parameters(theta) for theta in thetas), rotors])
        found: Array = self.W @ (self.B @ full - self.base)
        return found

    def slope(self, x: Array) -> Array:
        """Derivative of the torque error, (p, size of x)."""
        thetas, rotors = self.unpacked(x)
        n = len(thetas)
        by = np.zeros((PER_BODY * n + n, len(x)))
        for body, theta in enumerate(thetas):
            place = slice(PER_BODY * body, PER_BODY * (body + 1))
            by[place, place] = pseudo_slopes(theta)
        for column, k in enumerate(np.flatnonzero(self.turning).tolist()):
            by[PER_BODY * n + k, PER_BODY * n + column] = rotors[k]
        found: Array = self.W @ (self.B @ by)
        return found


# --- one body ---


def pseudo_parameters(theta: NDArray[Any]) -> NDArray[Any]:
    """Inertial parameters (10,) of log-Cholesky parameters (10,): alpha, d1 to d3, s12, s23, s13, t1 to t3. With them U
    (4, 4) is upper triangular, and U Uᵀ the pseudo-inertia [[Σ, h], [hᵀ, m]], where I = tr(Σ) 1 − Σ."""
    U = np.eye(4, dtype=theta.dtype)
    U[[0, 1, 2], [0, 1, 2]] = np.exp(theta[1:4])
    for value, (i, j) in zip(theta[4:7], _UPPER, strict=True):
        U[i, j] = value
    U[:3, 3] = theta[7:]
    U = np.exp(theta[0]) * U
    return inertial_parameters(U @ U.T)


def inertial_parameters(P: NDArray[Any]) -> NDArray[Any]:
    """The ten inertial parameters (..., 10) of pseudo-inertias (..., 4, 4)."""
    second = P[..., :3, :3]
    moments = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - second
    rows, columns = np.triu_indices(3)
    return np.concatenate([P[..., 3, 3:], P[..., :3, 3], moments[..., rows, columns]], axis=-1)


def pseudo_slopes(theta: Array) -> Array:
    """Derivative (10, 10) of pseudo_parameters, by complex steps: exact, for its functions are analytic."""
    step = 1e-30
    return np.stack([pseudo_parameters(theta + 1j * step * e).imag / step for e in np.eye(PER_BODY)], axis=1)


def log_cholesky(body: Array) -> Array:
    """Log-Cholesky parameters (10,) of a body; of an impossible body, those of a near possible one with at least
    LEAST_MASS and LEAST_GYRATION."""
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
    """Pseudo-inertia [[Σ, h], [hᵀ, m]] (4, 4) of ten inertial parameters: Σ = tr(I)/2 1 − I about the origin."""
    moments = np.zeros((3, 3))
    moments[np.triu_indices(3)] = body[4:]
    moments = moments + np.triu(moments, 1).T
    P = np.empty((4, 4))
    P[:3, :3] = np.trace(moments) / 2 * np.eye(3) - moments
    P[:3, 3] = P[3, :3] = body[1:4]
    P[3, 3] = body[0]
    return P


def is_possible(body: Array) -> bool:
    """Whether these ten parameters are physically possible: their pseudo-inertia is positive definite."""
    return bool(np.linalg.eigvalsh(pseudo_inertia(body))[0] > 0)
