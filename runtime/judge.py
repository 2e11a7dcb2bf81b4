"""The gates through which a candidate must pass, and the comparison of those that do.

First ranking by cross-validated error; then the autoregressive model of the winner's residual whitens
all rows, and BIC ranks. Every gate must open: on clean recordings a difference in BIC alone names an
effect more often than not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.candidates import Candidate, Field
from runtime.evidence import bic, log_likelihood, vuong
from runtime.terms import Term, joints_of
from runtime.wording import whole

Array = NDArray[np.float64]

LEAST_DELTA_BIC = 30.0
LEAST_LIKELIHOOD_GAIN = 15.0
LEAST_ERROR_FALL = 0.01
LEAST_EFFECT = 0.15
LEAST_SHARE = 0.25
VUONG_APART = 2.33
BIC_APART = 10.0
_FINALISTS = 8


@dataclass(frozen=True)
class Evidence:
    """What speaks for one candidate.

    eff               torque that only this candidate explains, RMS
    share             eff² over the variance that the base leaves above the noise floor
    delta_bic         fall of BIC on whitened rows
    likelihood_gain   cross-validated log-likelihood, whitened
    cv_gain           fall of the cross-validated squared error, relative
    """

    candidate: Candidate
    eff: float
    share: float
    delta_bic: float
    likelihood_gain: float
    cv_gain: float
    failed: tuple[str, ...]
    whitened_residual: Array

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
    """All finalists at one joint, the best first; rivals: terms that the data cannot tell from the best."""

    ranked: tuple[Evidence, ...]
    rivals: tuple[Term, ...]

    @property
    def best(self) -> Evidence | None:
        return self.ranked[0] if self.ranked and self.ranked[0].passes else None


def judge(field: Field, joint: int, floors: Sequence[float]) -> Verdict:
    """Rank every candidate at a joint (0-based) against the field; `floors` are all joints' noise floors."""
    return rank(field, field.terms(joint), floors)


def rank(field: Field, terms: Sequence[Term], floors: Sequence[float]) -> Verdict:
    """Rank these candidates against the field; `floors` are all joints' noise floors."""
    found = [c for c in (field.search(term) for term in terms) if c is not None]
    scored = sorted(found, key=lambda c: _relative_error(field, c))
    finalists = [field.refine(c) for c in scored[:_FINALISTS]]
    if not finalists:
        return Verdict((), ())
    best = min(finalists, key=lambda c: _relative_error(field, c))
    evidence = [_weigh(field, c, best, floors) for c in finalists]
    evidence.sort(key=lambda e: (not e.passes, -e.delta_bic))
    return Verdict(tuple(evidence), _rivals(evidence))


def _relative_error(field: Field, candidate: Candidate) -> float:
    """Cross-validated squared error relative to the base's."""
    joints = joints_of(field.model, candidate.term)
    base = field.rows(joints).cross_validate([None])[0].sum()
    return float(candidate.rows.cross_validate([c for _, c in candidate.choices])[0].sum() / base)


def _weigh(field: Field, candidate: Candidate, best: Candidate, floors: Sequence[float]) -> Evidence:
    joints = joints_of(field.model, candidate.term)
    base, rows = field.rows(joints), candidate.rows
    plain = base.solve()
    ar = _autoregression(field, candidate, best)
    white_base = base.whitened(ar)
    white_rows = replace(rows.whitened(ar), level=white_base.level)
    block = rows.whiten_block(candidate.block, ar)
    choices = [rows.whiten_block(c, ar) for _, c in candidate.choices]
    before, after = white_base.solve(), white_rows.solve(block)
    delta = bic(before.sse, base.count, base.rank()) - bic(after.sse, rows.count, candidate.parameters)
    sizes = base.fold_sizes
    gain = log_likelihood(*white_rows.cross_validate(choices), sizes)
    gain -= log_likelihood(*white_base.cross_validate([None]), sizes)
    fall = max(plain.sse - candidate.solution.sse, 0.0)
    # Of the first joint's torque, also where an effect is judged on several joints' rows.
    eff = float(np.sqrt(fall * len(joints) / base.count))
    weights = field.weights(joints)
    over = [w**2 * max(field.rms(i) ** 2 - floors[i] ** 2, 0.0) for i, w in zip(joints, weights, strict=True)]
    excess = max(sum(over), eff**2, 1e-300)
    cv_gain = 1 - _relative_error(field, candidate)
    share = eff**2 / excess
    failed = _failed(delta, gain, cv_gain, eff / floors[joints[0]], share, candidate.at_edge)
    return Evidence(candidate, eff, share, delta, gain, cv_gain, failed, after.residual)


def _autoregression(field: Field, candidate: Candidate, best: Candidate) -> Array:
    """Noise model from the best candidate's residual on the rows that this candidate is judged on."""
    joints, of_best = joints_of(field.model, candidate.term), joints_of(field.model, best.term)
    if joints == of_best:
        return best.rows.autoregression(best.solution.residual)
    return candidate.rows.autoregression(candidate.solution.residual)


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


def _rivals(evidence: Sequence[Evidence]) -> tuple[Term, ...]:
    """Those that pass, too, and that neither Vuong's test nor BIC sets apart from the first."""
    first = evidence[0]
    if not first.passes:
        return ()
    found = []
    for other in evidence[1:]:
        if not other.passes or len(other.whitened_residual) != len(first.whitened_residual):
            continue
        use = first.candidate.rows.use
        statistic = vuong(first.whitened_residual, other.whitened_residual, use)
        if statistic < VUONG_APART or first.delta_bic - other.delta_bic < BIC_APART:
            found.append(other.term)
    return tuple(found)
