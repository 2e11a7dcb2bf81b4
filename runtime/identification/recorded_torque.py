"""What a recorded torque has of the rigid arm's: all of it, or not the rotors', or not gravity's.

A torque that is measured at the link has neither the motor's inertia nor, behind the gear, its friction: friction that
is found there is that of bearings and seals. A driver that takes gravity out takes out what holds the arm still. What
was commanded has all of the motor's torque, and delay, lag, scale and saturation of the drive act on it.

Source: for the side of the gear, De Luca, Albu-Schaeffer, Haddadin & Hirzinger, IROS 2006, equations (1) and (2).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from runtime.arrays import Array
from runtime.model.loader import Model
from runtime.motion.motion import Motion
from runtime.motion.piece import Piece
from symbolic.model_file.arm import LINK_TORQUE, WEIGHTLESS

LINK_LOAD = "link_load"
"""The arm's function of the torques without the rotors."""
LINK_SIDE = "link_inertia"
"""The arm's function of the inertias without the rotors."""


def without_weight(motion: Motion) -> bool:
    """Whether all torques are declared to lack gravity."""
    return all(p.torque == WEIGHTLESS for p in motion.pieces)


def weight_regressor(model: Model, q: Array) -> Array:
    """(n, p, N) the regressor of the torque that holds the arm still at q (n, N): gravity's."""
    still = np.zeros_like(q)
    return model.regressor(q, still, still)


def rigid_regressor(model: Model, piece: Piece, at: slice) -> Array:
    """(n, p, N) derivative of the recorded torque by the base inertial parameters, at some samples of a piece."""
    q, qd, qdd = piece.q[:, at], piece.qd[:, at], piece.qdd[:, at]
    rows = model.regressor(q, qd, qdd)
    if piece.torque == WEIGHTLESS:
        rows = rows - weight_regressor(model, q)
    if piece.torque == LINK_TORQUE:
        rows = rows * _of_links(model)[:, None]
    return rows


def without_parameters(model: Model, piece: Piece) -> Array | None:
    """(n, N) the part of the rigid arm's torque that depends on no base inertial parameter; None: there is none. Of a
    torque at the link, minus the stated rotors that are parts of parameters with their links."""
    if piece.torque != LINK_TORQUE:
        return None
    none = np.zeros(len(model.lumps))
    return model.call(LINK_LOAD, {"q": piece.q, "qd": piece.qd, "qdd": piece.qdd}, none)


def rigid_torque(model: Model, piece: Piece, lumps: Array) -> Array:
    """(n, N) what the recorded torque has of D qdd + C qd + g."""
    own = lumps * _of_links(model) if piece.torque == LINK_TORQUE else lumps
    torque = model.inverse_dynamics(piece.q, piece.qd, piece.qdd, own)
    if piece.torque == WEIGHTLESS:
        still = np.zeros_like(piece.q)
        torque = torque - model.inverse_dynamics(piece.q, still, still, own)
    other = without_parameters(model, piece)
    return torque if other is None else torque + other


@lru_cache(maxsize=8)
def _of_links(model: Model) -> Array:
    """(p,) 1 for base inertial parameters that the links have a part in, 0 for those of a rotor alone."""
    q = 1.0 + np.arange(model.n)[:, None]
    load: Mapping[str, ArrayLike] = {"q": q, "qd": -q, "qdd": 1 / q}
    none = model.call(LINK_LOAD, load, np.zeros(len(model.lumps)))
    each = (model.call(LINK_LOAD, load, row) for row in np.eye(len(model.lumps)))
    return np.array([float(np.any(own != none)) for own in each])
