"""Pairs of effects: where one effect stands for two, a search one by one starts with the wrong one.

Every candidate of a beam is put into the base, and the library is searched for the best second one beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from runtime.diagnosis.candidates import Candidate, CandidateField
from runtime.diagnosis.settings import PAIR_BEAM, PAIR_SHIFT
from runtime.model.terms import Term
from runtime.progress import of_each
from runtime.regression.system import Block, Columns, LinearSystem


@dataclass(frozen=True)
class CandidatePair:
    """Two candidates and the fall of the squared error on the excerpt that both make together."""

    first: Candidate
    second: Candidate
    gain: float

    @property
    def terms(self) -> tuple[Term, Term]:
        return self.first.term, self.second.term


def search(field: CandidateField, candidates: Sequence[Candidate]) -> list[CandidatePair]:
    """The best partner for each of the best candidates, the best pair first."""
    found: dict[frozenset[Term], CandidatePair] = {}
    beam = sorted((c for c in candidates if c.gain > 0), key=lambda c: -c.gain)[:PAIR_BEAM]
    for pair in of_each("pairs", lambda first: _partner(field, first), beam):
        if pair is not None:
            key = frozenset(pair.terms)
            if key not in found or pair.gain > found[key].gain:
                found[key] = pair
    return sorted(found.values(), key=lambda p: -p.gain)


def _partner(field: CandidateField, first: Candidate) -> CandidatePair | None:
    ground, gained = _beside(field, first)
    best: Candidate | None = None
    for term in field.terms():
        if term.joint not in (first.term.joint, None) or _alike(field, term, first.term):
            continue
        second = field.search(term, ground)
        if second is not None and (best is None or second.gain > best.gain):
            best = second
    return None if best is None else CandidatePair(first, best, gained + best.gain)


def _alike(field: CandidateField, a: Term, b: Term) -> bool:
    effects = field.model.library.effects
    return a == b or a.effect in effects[b.effect].generalises or b.effect in effects[a.effect].generalises


def _beside(field: CandidateField, first: Candidate) -> tuple[LinearSystem, float]:
    """The excerpt's system with a candidate in its base, free to change its shape a little, and what that gains."""
    ground = field.without(field.excerpt[1], field.replaced(first.term))
    block = field.trial(first.term, first.shape)
    theta = np.append(1.0, ground.with_block(block).solution.coefficients[len(ground.unknown) :])
    silent = {joint: Columns(part.rows) for joint, part in block.columns.items()}
    extended, free = ground.with_block(replace(block, columns=silent)), np.full(1, np.inf)
    for name in field.moving(first.term):
        step = PAIR_SHIFT * field.grid_step(first, name)
        logarithmic = field.logarithmic(first.term)
        at = first.shape[name]
        shape = {**first.shape, name: at * float(np.exp(step)) if logarithmic else at + step}
        moved = field.trial(first.term, shape)
        if not moved.finite:
            continue
        change = {j: theta @ (moved.columns[j].rows - part.rows) for j, part in block.columns.items()}
        rows = {j: Columns(np.stack([np.zeros_like(x), x])) for j, x in change.items()}
        extended = extended.with_block(Block((first.term, name), rows, -free, free))
    return extended.merged(), first.gain
