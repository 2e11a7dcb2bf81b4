"""The gates through which a candidate must pass, and the comparison of those that do.

First ranking by cross-validated error; then the autoregressive model of the winner's residual whitens
all rows, and BIC ranks. Every gate must open: on clean recordings a difference in BIC alone names an
effect more often than not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.candidates import Candidate, Field
from runtime.evidence import LEAST_OWN, Block, Ground, bic, log_likelihood, vuong
from runtime.terms import Term, joints_of
from runtime.witness import Witness
from runtime.wording import whole

Array = NDArray[np.float64]

LEAST_DELTA_BIC = 30.0
LEAST_LIKELIHOOD_GAIN = 15.0
LEAST_ERROR_FALL = 0.01
LEAST_EFFECT = 0.15
LEAST_SHARE = 0.25
MOST_NOISE = 0.4
"""Part of its own torque (of the square) that a second reading of the encoders may change."""
VUONG_APART = 2.33
BIC_APART = 10.0
_FINALISTS = 8
_OF_A_JOINT = 3


@dataclass(frozen=True)
class Evidence:
    """What speaks for one candidate.

    eff               torque that only this candidate explains, RMS
    share             eff² over the variance that the base leaves above the noise floor
    delta_bic         fall of BIC on whitened rows
    likelihood_gain   cross-validated log-likelihood, whitened
    cv_gain           fall of the cross-validated squared error, relative
    parameters        number of unknowns of base and candidate
    residual          whitened, all joints' rows that count
    """

    candidate: Candidate
    eff: float
    share: float
    delta_bic: float
    likelihood_gain: float
    cv_gain: float
    failed: tuple[str, ...]
    parameters: int
    residual: Array

    @property
    def term(self) -> Term:
        return self.candidate.term

    @property
    def passes(self) -> bool:
        return not self.failed

    def to_json(self) -> dict[str, Any]:
        return {
            "eff": self.eff,
            "share_of_excess": self.share,
            "delta_bic": self.delta_bic,
            "cv_gain": self.cv_gain,
            "cv_log_likelihood_gain": self.likelihood_gain if np.isfinite(self.likelihood_gain) else None,
            "failed_gates": list(self.failed),
        }


@dataclass(frozen=True)
class Verdict:
    """All finalists, the best first; rivals: terms that the data cannot tell from the best."""

    ranked: tuple[Evidence, ...]
    rivals: tuple[Term, ...]

    @property
    def best(self) -> Evidence | None:
        return self.ranked[0] if self.ranked and self.ranked[0].passes else None


@dataclass
class Bench:
    """A field's ground before and after whitening by the noise model of its best candidate.

    floors (n,): every joint's noise floor
    """

    field: Field
    floors: Sequence[float]
    best: Block | None

    @cached_property
    def witness(self) -> Witness:
        return Witness(self.field)

    @cached_property
    def autoregression(self) -> list[Array]:
        ground = self.field.ground
        residual = ground.solve(self.best).residual
        return [row.autoregression(r) for row, r in zip(ground.rows, residual, strict=True)]

    @cached_property
    def white(self) -> Ground:
        return self.field.ground.whitened(self.autoregression)

    @cached_property
    def base_error(self) -> float:
        """Squared error without a candidate, and cross-validated; of the plain rows."""
        return self.field.ground.solve().sse

    @cached_property
    def base_held(self) -> float:
        return float(self.field.ground.cross_validate(None)[0].sum())

    @cached_property
    def base_bic(self) -> float:
        return bic(self.white.solve().sse, self.white.count, self.white.rank())

    @cached_property
    def base_likelihood(self) -> float:
        return log_likelihood(*self.white.cross_validate(None), self.white.fold_sizes)

    def weigh(self, candidate: Candidate, block: Block) -> Evidence:
        """All evidence for a candidate with its columns on the field's whole motion."""
        field = self.field
        replaced = field.replaced(candidate.term)
        plain, white = field.without(field.ground, replaced), field.without(self.white, replaced)
        whitened = white.whiten_block(block, self.autoregression)
        after = white.solve(whitened)
        parameters = white.rank(whitened) + candidate.searched
        delta = self.base_bic - bic(after.sse, white.count, parameters)
        gain = log_likelihood(*white.cross_validate(whitened), white.fold_sizes) - self.base_likelihood
        solution = plain.solve(block)
        fall = max(self.base_error - solution.sse, 0.0)
        cv_gain = 1 - float(plain.cross_validate(block)[0].sum()) / self.base_held
        joints = joints_of(field.model, candidate.term)
        own = joints[0]
        scale = field.rms(own)
        eff = scale * float(np.sqrt(fall / max(1, field.ground.rows[own].count)))
        over = sum(max(1 - (self.floors[i] / r) ** 2, 0.0) for i in joints if (r := field.rms(i)) > 0)
        share = eff**2 / max(scale**2 * over, eff**2, 1e-300)
        failed = _failed(delta, gain, cv_gain, eff / self.floors[own], share, candidate.at_edge)
        theta = np.append(1.0, solution.coefficients[plain.size :])
        failed += _doubts(plain, block, theta) + self.witness.doubts(plain, candidate, block, theta)
        residual = np.concatenate([row.used(r) for row, r in zip(white.rows, after.residual, strict=True)])
        return Evidence(candidate, eff, share, delta, gain, cv_gain, failed, parameters, residual)


def judge(field: Field, floors: Sequence[float]) -> Verdict:
    """Rank every candidate against the field; `floors` are all joints' noise floors."""
    return rank(field, field.terms(), floors)


def rank(field: Field, terms: Sequence[Term], floors: Sequence[float]) -> Verdict:
    """Rank these candidates against the field; `floors` are all joints' noise floors."""
    finalists = [field.refine(c) for c in _finalists(field, terms)]
    if not finalists:
        return Verdict((), ())
    blocks = [field.block(c.term, c.shape) for c in finalists]
    held = [
        field.without(field.ground, field.replaced(c.term)).cross_validate(b)[0].sum()
        for c, b in zip(finalists, blocks, strict=True)
    ]
    bench = Bench(field, floors, blocks[int(np.argmin(held))])
    evidence = [bench.weigh(c, b) for c, b in zip(finalists, blocks, strict=True)]
    evidence.sort(key=lambda e: (not e.passes, -e.delta_bic))
    return Verdict(tuple(evidence), _rivals(evidence))


def _finalists(field: Field, terms: Sequence[Term]) -> list[Candidate]:
    """The candidates with the least cross-validated errors on the excerpt, among them some of every joint, and every
    transmission that an encoder watches."""
    ground = field.excerpt[1]
    found = [c for c in map(field.search, terms) if c is not None]

    def held(c: Candidate) -> float:
        block = field.trial(c.term, c.shape)
        return float(field.without(ground, field.replaced(c.term)).cross_validate(block)[0].sum())

    scored = sorted(found, key=held)
    chosen = scored[:_FINALISTS]
    for joint in {c.term.joint for c in scored}:
        of_joint = [c for c in scored if c.term.joint == joint][:_OF_A_JOINT]
        chosen += [c for c in of_joint if c not in chosen]
    chosen += [c for c in scored if c not in chosen and field.watched(c.term)]
    return chosen


def _failed(delta: float, gain: float, cv_gain: float, effect: float, share: float, at_edge: bool) -> tuple[str, ...]:
    gates = (
        (delta > LEAST_DELTA_BIC, f"whitened BIC falls by {whole(delta)}, not by {LEAST_DELTA_BIC:g}"),
        (gain > LEAST_LIKELIHOOD_GAIN, f"held-out log-likelihood gains {whole(gain)}, not {LEAST_LIKELIHOOD_GAIN:g}"),
        (1 - np.sqrt(max(1 - cv_gain, 0.0)) > LEAST_ERROR_FALL, "held-out error does not fall by 1 %"),
        (effect > LEAST_EFFECT, f"its own torque is {effect:.2f} of the noise floor, not {LEAST_EFFECT:g}"),
        (share > LEAST_SHARE, f"it explains {100 * share:.0f} % of what is left, not {100 * LEAST_SHARE:.0f} %"),
        (not at_edge, "its shape lies at the edge of what was searched"),
    )
    return tuple(text for ok, text in gates if not ok)


def _doubts(ground: Ground, block: Block, theta: Array) -> tuple[str, ...]:
    """What speaks against a candidate's torque itself, (1 + k,) `theta` of its columns."""
    own, whole = ground.own({i: theta @ p.columns for i, p in block.parts.items()})
    noise, _ = ground.own({i: theta @ p.noise for i, p in block.parts.items() if p.noise is not None})
    found = []
    if own < LEAST_OWN * whole:
        found.append(f"the model as it is can produce all but {100 * own / whole:.2g} % of its torque")
    if noise > MOST_NOISE * own:
        found.append("another reading of the encoders would give another torque")
    return tuple(found)


def _rivals(evidence: Sequence[Evidence]) -> tuple[Term, ...]:
    """Those that pass, too, and that neither Vuong's test nor BIC sets apart from the first."""
    first = evidence[0]
    if not first.passes:
        return ()
    found = []
    for other in evidence[1:]:
        apart = vuong(first.residual, other.residual) >= VUONG_APART and (
            first.delta_bic - other.delta_bic >= BIC_APART
        )
        if other.passes and not apart:
            found.append(other.term)
    return tuple(found)
