"""Periodic motions as finite Fourier series, which begin and end each period at rest.

Source: Swevers, Ganseman, Tükel, De Schutter & Van Brussel 1997, Optimal robot excitation and identification.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import null_space

from runtime.arrays import Array
from runtime.experiments.pieces import Envelope


@dataclass(frozen=True)
class FourierMotion:
    """Series of all joints with a common period; unknowns x (n, k) are dimensionless: of size 1 at the limits.

    moving      joints (0-based) that move; the others stay in the middle
    harmonics   multiples of 1/period in the series
    At the beginning of a period rate and acceleration are zero, so that it can begin and end at rest.
    """

    envelopes: Sequence[Envelope]
    moving: Sequence[int]
    period: float
    harmonics: tuple[int, ...]

    @property
    def size(self) -> int:
        """k, unknowns of a joint."""
        return 2 * len(self.harmonics) - 1

    def shape(self, x: Array, t: Array) -> tuple[Array, Array, Array]:
        """q, qd, qdd (n, N) at times t (N,) s."""
        middle = np.array([[e.middle] for e in self.envelopes])
        made = [np.einsum("nk,nkN->nN", x, basis) for basis in self.bases(t)]
        return middle + made[0], made[1], made[2]

    def bases(self, t: Array) -> tuple[Array, Array, Array]:
        """Derivatives of q, qd and qdd by each joint's unknowns, (n, k, N)."""
        w = 2 * np.pi * np.array(self.harmonics) / self.period
        angle = w[:, None] * t
        one, none = np.ones((1, len(t))), np.zeros((1, len(t)))
        waves = (
            np.vstack([one, np.cos(angle), np.sin(angle)]),
            np.vstack([none, -w[:, None] * np.sin(angle), w[:, None] * np.cos(angle)]),
            np.vstack([none, -(w**2)[:, None] * np.cos(angle), -(w**2)[:, None] * np.sin(angle)]),
        )
        found = [np.einsum("njk,jN->nkN", self._maps, wave) for wave in waves]
        return found[0], found[1], found[2]

    @cached_property
    def _maps(self) -> Array:
        """(n, 1 + 2 harmonics, k) from unknowns to the coefficients of 1, cosines and sines: each unknown of size 1
        drives its joint to one of its limits, and the period begins at rest."""
        w = 2 * np.pi * np.array(self.harmonics) / self.period
        maps = []
        for i, e in enumerate(self.envelopes):
            size = np.minimum(np.minimum(e.reach, e.speed / w), e.acceleration / w**2)
            scale = np.diag([e.reach, *size, *size])
            none = np.zeros_like(w)
            at_rest = np.array([[0.0, *none, *(w * size)], [0.0, *(w**2 * size), *none]])
            own = scale @ null_space(at_rest / np.abs(at_rest).max(axis=1, keepdims=True))
            maps.append(own if i in self.moving else np.zeros_like(own))
        return np.stack(maps)

    def random(self, rng: np.random.Generator) -> Array:
        """Unknowns of a random motion well within the limits."""
        return rng.standard_normal((len(self.envelopes), self.size)) / np.sqrt(self.size)


def harmonics_of(period: float, fastest: float) -> tuple[int, ...]:
    """About evenly spaced on a logarithmic scale from one oscillation in a period to `fastest`, Hz."""
    found = np.unique(np.round(np.geomspace(1, max(fastest * period, 2), 9)).astype(int))
    return tuple(int(k) for k in found)
