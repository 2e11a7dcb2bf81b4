"""Which candidates are weighed on the whole recording."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from runtime.diagnosis import ranking
from runtime.diagnosis.candidates import Candidate, FittedBase
from runtime.model.terms import Term


class _Field:
    """Of two joints: a candidate of each term, whose error on the excerpt is its joint's number."""

    model = SimpleNamespace(n=2)
    replaced = staticmethod(lambda _: ())
    without = staticmethod(lambda ground, _: ground)
    trial = staticmethod(lambda term, _: term)
    watched = staticmethod(lambda term: term.joint == 2)

    @property
    def excerpt(self) -> tuple[None, _Field]:
        return None, self

    def search(self, term: Term) -> Candidate:
        return Candidate(term, {"speed": 0.1}, 1, 1.0, np.inf)

    def refine(self, candidate: Candidate) -> Candidate:
        return candidate

    solution = SimpleNamespace(held_out=[np.array([100.0])], sse=100.0)

    def with_block(self, block: Term) -> SimpleNamespace:
        error = float(block.joint or 0)
        return SimpleNamespace(solution=SimpleNamespace(held_out=[np.array([error])], sse=error))


def test_no_candidate_is_weighed_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one that is hopeful at its joint, leaves least there and has an encoder on either side."""
    weighed: list[Term] = []
    monkeypatch.setattr(ranking, "weigh", lambda _, candidates, __: weighed.extend(c.term for c in candidates))
    terms = [Term(f"effect{k}", joint) for joint in (1, 2) for k in range(12)]
    ranking.rank(cast(FittedBase, _Field()), terms, (1.0, 1.0))
    assert {t.joint for t in weighed} == {1, 2}
    assert len(weighed) == len(set(weighed))
