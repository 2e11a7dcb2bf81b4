"""Why a candidate was named, could not be ruled out, or was ruled out: a sentence each."""

from __future__ import annotations

from collections.abc import Collection

from runtime.diagnosis.gates import Evidence
from runtime.model.terms import Term, at
from runtime.wording import fall, percent, whole

_NOTHING = 0.05
"""Below this part of the noise floor a candidate's own torque is next to nothing, and no other figure matters."""


def in_place_of(
    other: Evidence, named: Evidence, rivals: Collection[Term], floor: float, also: Collection[Term] = ()
) -> str:
    """Why `named` was chosen and not `other`, both weighed on the same residual.

    floor   of the other's joint
    also    what else was named, before or after
    """
    if other.term in also:
        return f"Named too: beside {named.term.effect}, it is a finding of its own."
    if other.term in rivals:
        return (
            f"Not ruled out: it passes every gate too and explains {_share(other)} of what is missing, "
            f"{named.term.effect} {_share(named)}. {_bic(other, named)}; with Vuong's test of the likelihoods that is "
            "not enough to tell the two apart."
        )
    if not other.passes:
        return _failing(other, floor)
    if None not in (other.term.joint, named.term.joint) and other.term.joint != named.term.joint:
        return (
            f"Set aside: it acts at another joint, and was weighed again once {named.term.effect}{at(named.term)} was "
            "in the model."
        )
    if other.delta_bic > named.delta_bic:
        return (
            f"Ruled out: weighed by itself it passes every gate, but with it added and everything fitted again, "
            f"the error falls less than with {named.term.effect}."
        )
    if other.share >= named.share:
        # Of what is missing where each of them acts, which need not be the same joints.
        return (
            f"Ruled out: it passes every gate by itself, but {_bic(other, named)}, and Vuong's test of the likelihoods "
            "agrees."
        )
    return (
        f"Ruled out: it passes every gate by itself, but explains {_share(other)} of what is missing, "
        f"{named.term.effect} {_share(named)}. {_bic(other, named)}, and Vuong's test of the likelihoods agrees."
    )


def unweighed_rival(named: Evidence) -> str:
    """Why a rival that was found together with another effect, in a pair, could not be ruled out."""
    return (
        f"Not ruled out: in the place of {named.term.effect}, beside what else was named, it fits about as well; "
        "BIC does not tell the two apart."
    )


def not_named(other: Evidence, floor: float, held_out: bool) -> str:
    """Why a candidate was not added once the search had ended."""
    if other.passes:
        also = " or on the held-out recording" if held_out else ""
        return f"Passes every gate, but with it added the error does not fall on what was fitted{also}."
    return _failing(other, floor)


def next_to_nothing(evidence: Evidence, floor: float) -> bool:
    """Whether a candidate explains so little that it needs no reason of its own."""
    return not evidence.passes and evidence.eff < _NOTHING * floor


def unearned(evidence: Evidence) -> bool:
    """Whether a candidate's parameters cost more than it explains, which is all that there is to say of it."""
    return not evidence.passes and evidence.delta_bic <= 0


def _failing(other: Evidence, floor: float) -> str:
    if next_to_nothing(other, floor):
        return "Ruled out: it explains next to nothing that the fitted model does not explain already."
    if unearned(other):
        return f"Ruled out: it does not earn its parameters; with it, BIC {fall(other.delta_bic)}."
    return f"Ruled out: {'; '.join(other.failed)}."


def _share(evidence: Evidence) -> str:
    return percent(min(evidence.share, 1.0), 0)


def _bic(other: Evidence, named: Evidence) -> str:
    ahead = named.delta_bic - other.delta_bic
    if abs(ahead) < 0.5:
        return "BIC is the same for both"
    better = named.term if ahead > 0 else other.term
    return f"BIC prefers {better.effect}{at(better)} by {whole(abs(ahead))}"
