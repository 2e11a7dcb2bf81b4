"""One score: what a term adds to the likelihood, over the dispersion of its own score, against the price of the search.

Residuals r0 (without) and r1 (with), whitened by the same filters; every joint j has a variance of its own:

    gain        dL = -1/2 sum_j n_j log(sigma_1j^2 / sigma_0j^2)        n_j independent of the rows_j rows
    dispersion  lambda = sum_j w_j^2 sum_b (x_b . r1_b)^2 / sigma_1j^4  /  sum_j w_j x.x / sigma_1j^2
                over stretches b of equal x_b . x_b; w_j = n_j / rows_j; x = r0 - r1, what only the term explains
    score       G = dL / max(lambda, 1)

lambda is the sandwich over the model's variance in the term's direction: 1 where the law is right and the noise is
white. It is larger where residuals are coloured, and largest where the law is wrong, as what is left of the true one
stays correlated with the wrong one's score. G says that a term is there, dL orders those that are.

Source: quasi-likelihood with a dispersion, Wedderburn 1974; White 1982; the robust likelihood ratio, Kent 1982.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.diagnosis.settings import HEARD_SIGMAS, LEAST_PRICE, STRETCHES
from runtime.regression.rows import JointRows

Residuals = Sequence[Array]
"""By joint (M,)."""


@dataclass(frozen=True)
class Evidence:
    """What speaks for a term.

    gain  of the log-likelihood      dispersion  of its score      price  of having searched
    stretches  of time over which its torque is spread: so many tell the dispersion
    repaid  of the price, by recordings that were not fitted
    """

    gain: float
    dispersion: float
    stretches: float
    price: float
    repaid: float = 0.0

    @property
    def score(self) -> float:
        """The gain over the dispersion."""
        return self.gain / max(self.dispersion, 1.0)

    @property
    def due(self) -> float:
        """What the score must exceed for the price to be paid by a dispersion that so few stretches tell; either kind
        of recording must be clear for itself.

        Source: the likelihood ratio of Student's distribution in the place of the normal one's, Lange, Little & Taylor
        1989.
        """
        asked = max(self.price - self.repaid, 0.5 * HEARD_SIGMAS**2)
        return 0.5 * self.stretches * float(np.expm1(2 * asked / (self.stretches + 1)))

    @property
    def net(self) -> float:
        """The gain less the price: what orders terms that are there."""
        return self.gain - self.price


_UNKNOWN = float("nan")
NOT_WEIGHED = Evidence(_UNKNOWN, _UNKNOWN, _UNKNOWN, _UNKNOWN)


def price(places: int, unknowns: int, count: int) -> float:
    """Of a term that was sought at so many places (joints times points of its grid) with so many unknowns on `count`
    independent rows. Source: Chen & Chen 2008, the extended BIC."""
    return max(LEAST_PRICE, float(np.log(max(places, 1))) + 0.5 * unknowns * float(np.log(max(count, 2))))


def between(
    joints: Sequence[JointRows], without: Residuals, beside: Residuals, price: float, repaid: float = 0.0
) -> Evidence:
    """Of a term: residuals without and with it, each of a fit of its own, whitened by what makes the second white."""
    by = [rows.whitening(r) for rows, r in zip(joints, beside, strict=True)]
    before, after = ([white(r) for white, r in zip(by, residual, strict=True)] for residual in (without, beside))
    independent = [rows.independent if rows.count else 0 for rows in joints]
    return Evidence(gain(independent, before, after), *dispersion(independent, before, after), price, repaid)


def likelihood(joints: Sequence[JointRows], residual: Residuals) -> float:
    """Logarithm, up to a constant, of a fit's residuals, whitened by its own filter and no other fit's."""
    # Filters begin with 1: they change no volume.
    white = [(rows.independent, rows.whitening(r)(r)) for rows, r in zip(joints, residual, strict=True) if rows.count]
    return -0.5 * sum(n * float(np.log(max(float(np.mean(r**2)), 1e-300))) for n, r in white)


def gain(independent: Sequence[int], before: Residuals, after: Residuals) -> float:
    """Of the log-likelihood, of whitened residuals."""
    found = 0.0
    for n, r0, r1 in zip(independent, before, after, strict=True):
        if n and r0.any():
            found -= 0.5 * n * float(np.log(max(float(r1 @ r1), 1e-300) / float(r0 @ r0)))
    return found


def dispersion(independent: Sequence[int], before: Residuals, after: Residuals) -> tuple[float, float]:
    """Of a term's own score, of whitened residuals without and with it; 1 of white noise beside the right law; and the
    number of stretches over which its torque is spread."""
    meat, bread = 0.0, list[float]()
    # Of neither figure the size of the torque is asked, which may be anything.
    size = max((float(np.abs(r0 - r1).max(initial=0.0)) for r0, r1 in zip(before, after, strict=True)), default=0.0)
    for n, r0, r1 in zip(independent, before, after, strict=True):
        if size and n and r1.any():
            weight, own, square = n / len(r1), (r0 - r1) / size, float(np.mean(r1**2))
            edges = stretches(own**2)
            sums = np.add.reduceat(own * r1, edges)
            meat += weight**2 * float(sums @ sums) / square**2
            bread += (weight / square * np.add.reduceat(own**2, edges)).tolist()
    parts = np.array(bread)
    whole = float(parts.sum())
    return (meat / whole, whole**2 / float(parts @ parts)) if whole > 0 else (1.0, 1.0)


def stretches(squares: Array, least: int = 1) -> NDArray[np.intp]:
    """Where stretches (S,) begin that hold equal parts of a sum of squares (m,): STRETCHES, or as many as have so many
    rows at least."""
    total, edges = np.cumsum(squares), [0]
    if total[-1] > 0:
        for end in np.searchsorted(total, total[-1] * np.arange(1, STRETCHES) / STRETCHES) + 1:
            if edges[-1] + least <= end <= len(squares) - least:
                edges.append(int(end))
    return np.array(edges)
