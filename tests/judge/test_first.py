"""First motions before the judge: comparable with today's excitation, and what they are compared on is the same."""

from __future__ import annotations

import numpy as np
import pytest

from tests import bank
from tests.judge import cases as judging
from tests.judge.bench import Setting
from tests.judge.cases import FIRST, Case, Made, cases
from tests.kept import kept

SEED = 42


def one(excitation: str, size: float = 1.0) -> Case:
    return next(iter(cases(["stribeck"], [1], [size], [SEED], Setting(excitation=excitation))))


@pytest.fixture(scope="module")
def made() -> dict[str, Made]:
    return {kind: judging.make(one(kind)) for kind in ("full", FIRST)}


def test_as_much_of_the_effect_is_hidden_in_the_same_arm(made: dict[str, Made]) -> None:
    today, first = made["full"], made[FIRST]
    assert first.amounts == today.amounts
    assert first.plant == today.plant
    assert first.model == today.model
    assert not np.array_equal(first.recording.q, first.held_out.q)


def test_a_first_motion_keeps_to_what_todays_excitation_reaches(made: dict[str, Made]) -> None:
    setting = Setting()
    typical = judging._wanted(np.random.default_rng(setting.joints), setting)
    for recorded in (made[FIRST].recording, made[FIRST].held_out):
        # The controller overshoots a little.
        assert recorded.q.max() < typical[0].max() + 0.02
        assert recorded.q.min() > typical[0].min() - 0.02
        assert np.abs(np.gradient(recorded.q[0], recorded.t)).max() < 1.05 * np.abs(typical[1]).max()
        assert recorded.t[-1] == pytest.approx(typical.shape[-1] * 1e-3, rel=0.1)


def test_a_clear_effect_is_named_along_a_first_motion() -> None:
    row = kept(bank.judged, one(FIRST))
    assert (row.outcome, row.extra) == ("right", 0), row


def test_a_clean_arm_is_clean_along_a_first_motion() -> None:
    row = kept(bank.judged, Case("clean", "clean", (), Setting(excitation=FIRST), 0.0, SEED))
    assert (row.verdict, row.named) == ("clean", ""), row
