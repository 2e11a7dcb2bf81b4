"""The arms that a model file may describe: the likeliest, and how far its numbers may be off.

Bodies are moved about by random linear maps of their pseudo-inertia, which leave them possible; rotors and the torques
of effects are scaled. The spread of the base inertial parameters follows from the map from bodies to them.
Source: Wensing, Kim & Slotine 2018 (pseudo-inertia); Swevers et al. 1997 (excitation with uncertain torque limits).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import truncnorm

from runtime.arrays import Array
from runtime.exchange.bodies import PER_BODY, base_map, inertial_parameters, pseudo_inertia
from runtime.experiments.settings import (
    ASSUMED_SPREAD,
    BODY_SPREAD,
    FARTHEST,
    FRICTION_SPREAD,
    SPREAD_DRAWS,
    SURE_SPREADS,
)
from runtime.model.loader import Model
from runtime.model.terms import Structure
from symbolic.model_file.arm import ROTOR, Arm
from symbolic.model_file.frames import parameters
from symbolic.model_file.likely import LikelyNumber, likely_bodies


@dataclass(frozen=True)
class PossibleArms:
    """The likeliest arm and its spread.

    model    with likely numbers for all that its file leaves out; values: of all its effects
    lumps    (p,) base inertial parameters of the likeliest arm
    spread   (p, r) lumps + spread z covers the possible arms for z (r,) of independent standard normal numbers
    draws    (K, p) base inertial parameters of K possible arms
    factors  (K, terms) of the torques of the effects, in the order of `values`
    wondered effects that it may have besides, with moderate values: the likeliest arm has none of them
    """

    model: Model
    arm: Arm
    values: Structure
    lumps: Array
    spread: Array
    draws: Array
    factors: Array
    wondered: Structure = field(default_factory=dict)

    @classmethod
    def of(
        cls, model: Model, arm: Arm, values: Structure, assumed: Sequence[LikelyNumber], count: int, seed: int
    ) -> PossibleArms:
        """arm: as the model has it; assumed: numbers that its file leaves out; count: of draws."""
        rng = np.random.default_rng(seed)
        lumps, n, total = model.lump_values, model.n, count + SPREAD_DRAWS
        B, _ = base_map(arm, model.regressor)
        bodies = np.array([parameters(body) for body in likely_bodies(arm)])
        rotors = np.array([joint.rotor_inertia or 0.0 for joint in arm.joints])
        guessed = {a.joint - 1 for a in assumed if a.parameter == ROTOR}
        sizes = np.array([ASSUMED_SPREAD if i in guessed else BODY_SPREAD for i in range(n)])
        off = np.empty((total, (PER_BODY + 1) * n))
        for i, body in enumerate(bodies):
            off[:, PER_BODY * i : PER_BODY * (i + 1)] = _moved(body, rng, total) - body
        off[:count, PER_BODY * n :] = rotors * (_factors(rng, sizes, (count, n)) - 1.0)
        off[count:, PER_BODY * n :] = rotors * upper(sizes) * rng.standard_normal((SPREAD_DRAWS, n))
        # About the file's own base parameters, which may be identified ones.
        off = off @ B.T
        spread = np.linalg.qr(off[count:] / np.sqrt(SPREAD_DRAWS))[1].T
        factors = _factors(rng, np.full(len(values), FRICTION_SPREAD), (count, len(values)))
        return cls(model, arm, values, lumps, spread, draws=lumps + off[:count], factors=factors)


def upper(sizes: ArrayLike) -> Array:
    """Standard deviations of normal numbers that reach as far up as these factors do: SURE_SPREADS of them from 1."""
    return (np.exp(FARTHEST * np.asarray(sizes)) - 1.0) / SURE_SPREADS


def _factors(rng: np.random.Generator, sizes: Array, shape: tuple[int, int]) -> Array:
    """Factors whose logarithms have these standard deviations, within FARTHEST of them."""
    return np.exp(sizes * truncnorm.rvs(-FARTHEST, FARTHEST, size=shape, random_state=rng))


def _moved(body: Array, rng: np.random.Generator, count: int) -> Array:
    """(count, 10) possible bodies about this one: P -> A P Aᵀ, A the unit matrix and a little noise, with lengths in
    units of the body's radius."""
    P = pseudo_inertia(body)
    radius = np.sqrt(np.trace(P[:3, :3]) / P[3, 3]) if P[3, 3] > 0 else 1.0
    unit = np.array([radius, radius, radius, 1.0])
    # A mass without extension keeps to its place.
    A = np.eye(4) + BODY_SPREAD / 2 * rng.standard_normal((count, 4, 4)) * unit[:, None] / np.where(unit > 0, unit, 1.0)
    return inertial_parameters(A @ P @ A.transpose(0, 2, 1))
