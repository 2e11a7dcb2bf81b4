"""What a fit says only up to numbers that the model file leaves out, and no motion tells."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from runtime.identification.regressors import LINK_LOAD, LINK_SIDE
from runtime.model.loader import Model
from runtime.model.terms import Term

_OF_LINK = frozenset({LINK_LOAD, LINK_SIDE})
_OF_MASSES = frozenset({"moment_jacobian"})
"""The arm's functions that need a joint's rotor apart from its link, and the links' masses apart from one another."""


def open_rotors(model: Model, terms: Iterable[Term]) -> tuple[int, ...]:
    """Joints (0-based) whose rotor's inertia the model file leaves out, no rigid motion tells, and a term hangs on."""
    found = {term.joint - 1 for term in terms if term.joint is not None and _reads(model, term) & _OF_LINK}
    told = {lump.name for lump in model.lumps}
    return tuple(sorted(i for i in found if model.joints[i].rotor_inertia is None and f"I{i + 1}" not in told))


def untold(model: Model, terms: Iterable[Term]) -> list[str]:
    """For every term whose values hang on masses that nobody knows, in words: what was taken in their place."""
    return [text for text in (_masses(model, term) for term in terms) if text is not None]


def _masses(model: Model, term: Term) -> str | None:
    if not _reads(model, term) & _OF_MASSES or not any({"mass", "com"} & {*j.unknown} for j in model.joints):
        return None
    return (
        f"{term}: the model file leaves masses or centres of mass out: its values hold for 1 kg in the middle of each "
        "such link; state gravity in the model file in its place, and the moments of the links are identified"
    )


def _reads(model: Model, term: Term) -> set[Any]:
    """The arm's functions whose outputs a term reads; what hangs on the arm without being an output is its load."""
    read = [model.library.signal[name] for name in model.library.effects[term.effect].signals]
    outputs = {s.source["function"] for s in read if s.source is not None and s.source["kind"] == "ArmOutput"}
    return outputs | {LINK_LOAD for s in read if s.source is None and s.needs == "arm"}
