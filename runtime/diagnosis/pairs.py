"""Pairs of effects: where one effect stands for two, a search one by one starts with the wrong one.

Every candidate of a beam is put into the base, and the library is searched for the best second one beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis.candidates import Candidate, CandidateField
from runtime.diagnosis.evidence import CandidateBlock, Ground
from runtime.diagnosis.settings import PAIR_BEAM, PAIR_SHIFT
from runtime.model.terms import Term
from runtime.progress import of_each

Array = NDArray[np.float64]


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


def _beside(field: CandidateField, first: Candidate) -> tuple[Ground, float]:
    """The excerpt's ground with a candidate in its base, free to change its shape a little, and what that gains."""
    ground = field.without(field.excerpt[1], field.replaced(first.term))
    block = field.trial(first.term, first.shape)
    solution = ground.solve(block)
    theta = np.append(1.0, solution.coefficients[ground.size :])
    moves = []
    for name in field.moving(first.term):
        step = PAIR_SHIFT * field.grid_step(first, name)
        logarithmic = field.logarithmic(first.term)
        at = first.shape[name]
        shape = {**first.shape, name: at * float(np.exp(step)) if logarithmic else at + step}
        moved = field.trial(first.term, shape)
        if not moved.finite:
            continue
        moves.append({j: theta @ (moved.parts[j].columns - p.columns) for j, p in block.parts.items()})
    return _extended(ground, block, moves), first.gain


def _extended(ground: Ground, block: CandidateBlock, moves: Sequence[dict[int, Array]]) -> Ground:
    k, rows = len(block.lower), list(ground.rows)
    index = np.arange(ground.size, ground.size + k + len(moves))
    for joint, part in block.parts.items():
        row = rows[joint]
        columns = np.vstack([part.columns[1:], *(m[joint][None] for m in moves)])
        silent = np.zeros_like(columns)
        rows[joint] = replace(
            row,
            y=row.y - part.columns[0],
            base=np.vstack([row.base, columns]),
            noise=np.vstack([row.noise[:-1], silent, row.noise[-1:]]),
            index=np.append(row.index, index),
        )
    free = np.full(len(moves), np.inf)
    lower = np.concatenate([ground.lower, block.lower, -free])
    upper = np.concatenate([ground.upper, block.upper, free])
    return Ground(tuple(rows), lower, upper, level=ground.level, changes=ground.changes)
