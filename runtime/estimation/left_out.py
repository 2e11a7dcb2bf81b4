"""What a fit says only up to numbers that the model file leaves out, and no motion tells."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from runtime.model.loader import Model
from runtime.model.terms import Term

_OF_LINK = frozenset({"link_load", "link_inertia"})
_OF_MASSES = frozenset({"moment_jacobian"})
"""The arm's functions that need a joint's rotor apart from its link, and the links' masses apart from one another."""


def untold(model: Model, terms: Iterable[Term]) -> list[str]:
    """For every term that hangs on such a number, in words: on which, and what was taken in its place."""
    return [text for term in terms for text in (_rotor(model, term), _masses(model, term)) if text is not None]


def _rotor(model: Model, term: Term) -> str | None:
    if term.joint is None or not _reads(model, term) & _OF_LINK:
        return None
    open_rotor = model.joints[term.joint - 1].rotor_inertia is None
    if not open_rotor or any(lump.name == f"I{term.joint}" for lump in model.lumps):
        return None
    return (
        f"joint {term.joint}: the model file leaves rotor_inertia out, and no rigid motion tells it from the link's "
        f"inertia: the values of {term} hold if the two are equal; state it if you know it"
    )


def _masses(model: Model, term: Term) -> str | None:
    if not _reads(model, term) & _OF_MASSES or not any({"mass", "com"} & {*j.unknown} for j in model.joints):
        return None
    return (
        f"{term}: the model file leaves masses or centres of mass out: its values hold for 1 kg in the middle of each "
        "such link; state gravity in the model file in its place, and the moments of the links are identified"
    )


def _reads(model: Model, term: Term) -> set[Any]:
    """The arm's functions whose outputs a term reads."""
    library = model.library
    sources = (library.signal[name].source for name in library.effects[term.effect].signals)
    return {source["function"] for source in sources if source is not None and source["kind"] == "ArmOutput"}
