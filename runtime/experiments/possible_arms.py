"""The arms that a model file may describe: the likeliest, and how far its numbers may be off.

Bodies are moved about by random linear maps of their pseudo-inertia, which leave them possible; rotors and the torques
of effects are scaled. The spread of the base inertial parameters follows from the map from bodies to them.
Source: Wensing, Kim & Slotine 2018 (pseudo-inertia); Swevers et al. 1997 (excitation with uncertain torque limits).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.exchange.bodies import PER_BODY, base_map, inertial_parameters, pseudo_inertia
from runtime.experiments.settings import ASSUMED_SPREAD, BODY_SPREAD, FRICTION_SPREAD, SPREAD_DRAWS
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term, structure
from symbolic.model_file.arm import ROTOR, Arm
from symbolic.model_file.frames import parameters
from symbolic.model_file.likely import LikelyNumber, likely_bodies

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PossibleArms:
    """The likeliest arm and its spread.

    model    with likely numbers for all that its file leaves out; values: of all its effects
    lumps    (p,) base inertial parameters of the likeliest arm
    spread   (p, r) lumps + spread z is a possible arm for z (r,) of independent standard normal numbers, but for the
             skewness of the draws
    draws    (K, p) base inertial parameters of K possible arms
    factors  (K, terms) of the torques of the effects, in the order of `values`
    """

    model: Model
    arm: Arm
    values: Structure
    lumps: Array
    spread: Array
    draws: Array
    factors: Array

    @classmethod
    def of(
        cls, model: Model, arm: Arm, values: Structure, assumed: Sequence[LikelyNumber], count: int, seed: int
    ) -> PossibleArms:
        """arm: as the model has it; assumed: numbers that its file leaves out; count: of draws."""
        rng = np.random.default_rng(seed)
        lumps = model.lump_values
        B, _ = base_map(arm, model.regressor)
        bodies = np.array([parameters(body) for body in likely_bodies(arm)])
        rotors = np.array([joint.rotor_inertia or 0.0 for joint in arm.joints])
        guessed = {a.joint - 1 for a in assumed if a.parameter == ROTOR}
        sizes = np.array([ASSUMED_SPREAD if i in guessed else BODY_SPREAD for i in range(model.n)])
        total = count + SPREAD_DRAWS
        full = np.empty((total, (PER_BODY + 1) * model.n))
        for i, body in enumerate(bodies):
            full[:, PER_BODY * i : PER_BODY * (i + 1)] = _moved(body, rng, total)
        full[:, PER_BODY * model.n :] = rotors * np.exp(sizes * rng.standard_normal((total, model.n)))
        # As far as the file's own numbers, which may be identified ones, are the middle.
        off = (full - np.concatenate([bodies.ravel(), rotors])) @ B.T
        spread = np.linalg.qr(off[count:] / np.sqrt(SPREAD_DRAWS))[1].T
        factors = np.exp(FRICTION_SPREAD * rng.standard_normal((count, len(values))))
        return cls(model, arm, values, lumps, spread, draws=lumps + off[:count], factors=factors)

    @property
    def open_terms(self) -> list[Term]:
        """The effects of the model file that have an unknown value."""
        stated = structure(self.model)
        return [term for term, known in self.values.items() if set(known) - set(stated[term])]


def _moved(body: Array, rng: np.random.Generator, count: int) -> Array:
    """(count, 10) possible bodies about this one: P -> A P Aᵀ, A the unit matrix and a little noise."""
    P = pseudo_inertia(body)
    A = np.eye(4) + BODY_SPREAD / 2 * rng.standard_normal((count, 4, 4))
    return inertial_parameters(A @ P @ A.transpose(0, 2, 1))
