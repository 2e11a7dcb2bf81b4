"""Torques of a chain in space by the full inertial parameters of its bodies, and what of them its base parameters show.

A Newton-Euler recursion on NumPy arrays that knows nothing of the generated code: held against its regressor of base
parameters, it gives the linear map from the ones to the others, whatever frames those were derived in.
Source: Atkeson, An & Hollerbach 1986 (the regressor of a body); Gautier & Khalil 1990 (base parameters).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.exchange.settings import MAP_RATE, MAP_STATES

Array = NDArray[np.float64]
PER_BODY = 10
"""m; m x, m y, m z; Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the origin of the joint's frame."""


@dataclass(frozen=True)
class ChainGeometry:
    """Where the joints of a chain are: everything but its inertias.

    turned (n, 3, 3), place (n, 3) m   of each joint's frame in the one before, where q = 0
    axis (n, 3)                         unit vectors in the joints' frames     revolute (n,)
    gravity (3,) m/s²                   in base axes
    """

    turned: Array
    place: Array
    axis: Array
    revolute: NDArray[np.bool_]
    gravity: Array

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.axis)


def full_regressor(chain: ChainGeometry, q: Array, qd: Array, qdd: Array) -> Array:
    """Derivative of the joints' torques by all inertial parameters.

    q, qd, qdd (n, N). Returns (n, 11 n, N): PER_BODY columns a body, from the base outwards, then one a rotor.
    """
    n, N = q.shape
    moved = [_moved(chain, k, q[k]) for k in range(n)]
    motion = _motion(chain, moved, qd, qdd)
    out = np.zeros((n, (PER_BODY + 1) * n, N))
    for k in range(n):
        wrench = _body_wrench(*motion[k])
        for j in range(k, -1, -1):
            # Forces are rows 0 to 2, moments about the origin of frame j rows 3 to 5.
            rows = wrench[3:] if chain.revolute[j] else wrench[:3]
            out[j, PER_BODY * k : PER_BODY * (k + 1)] = np.einsum("a,acN->cN", chain.axis[j], rows)
            R, p = moved[j]
            force = np.einsum("abN,bcN->acN", R, wrench[:3])
            moment = np.einsum("abN,bcN->acN", R, wrench[3:]) + np.cross(p[:, None], force, axis=0)
            wrench = np.concatenate([force, moment])
        out[k, PER_BODY * n + k] = qdd[k]
    return out


def base_map(chain: ChainGeometry, regressor: Callable[[Array, Array, Array], Array]) -> tuple[Array, Array]:
    """The base parameters as combinations of all inertial ones, and what a unit of each is worth in torque.

    regressor   the generated one: q, qd, qdd (n, N) -> (n, p, N)
    Returns B (p, 11 n) with base = B full, exact but for rounding; and W (p, p) whose W·base has the mean square of
    the torques over the states that were drawn.
    """
    rng = np.random.default_rng(0)
    q = rng.uniform(-np.pi, np.pi, (chain.n, MAP_STATES))
    qd, qdd = rng.uniform(-MAP_RATE, MAP_RATE, (2, chain.n, MAP_STATES))
    base = np.moveaxis(regressor(q, qd, qdd), 1, 2).reshape(chain.n * MAP_STATES, -1)
    full = np.moveaxis(full_regressor(chain, q, qd, qdd), 1, 2).reshape(chain.n * MAP_STATES, -1)
    B = np.linalg.lstsq(base, full, rcond=None)[0]
    return np.where(np.abs(B) < 1e-10 * np.abs(B).max(), 0.0, B), np.linalg.qr(base)[1] / np.sqrt(MAP_STATES)


def _moved(chain: ChainGeometry, k: int, q: Array) -> tuple[Array, Array]:
    """Rotation (3, 3, N) and origin (3, N) of joint k's own frame at q (N,) in the one before."""
    R, p, a = chain.turned[k], chain.place[k], chain.axis[k]
    if not chain.revolute[k]:
        return np.repeat(R[:, :, None], len(q), axis=2), p[:, None] + (R @ a)[:, None] * q
    K = np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
    turn = np.eye(3)[:, :, None] + K[:, :, None] * np.sin(q) + (K @ K)[:, :, None] * (1 - np.cos(q))
    return np.einsum("ab,bcN->acN", R, turn), np.repeat(p[:, None], len(q), axis=1)


def _motion(
    chain: ChainGeometry, moved: list[tuple[Array, Array]], qd: Array, qdd: Array
) -> list[tuple[Array, Array, Array]]:
    """Of every joint's frame in its own axes: rate, its derivative, acceleration of the origin less gravity, (3, N)."""
    N = qd.shape[1]
    w, wd, a = np.zeros((3, N)), np.zeros((3, N)), np.repeat(-chain.gravity[:, None], N, axis=1)
    found = []
    for k, (R, p) in enumerate(moved):
        a = a + np.cross(wd, p, axis=0) + np.cross(w, np.cross(w, p, axis=0), axis=0)
        w, wd, a = (np.einsum("baN,bN->aN", R, v) for v in (w, wd, a))
        along = chain.axis[k][:, None]
        if chain.revolute[k]:
            wd = wd + np.cross(w, along * qd[k], axis=0) + along * qdd[k]
            w = w + along * qd[k]
        else:
            a = a + 2 * np.cross(w, along * qd[k], axis=0) + along * qdd[k]
        found.append((w, wd, a))
    return found


def _body_wrench(w: Array, wd: Array, a: Array) -> Array:
    """Force and moment about the frame's origin that a body's motion asks for, by its parameters: (6, 10, N)."""
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
