"""The judging sets: they share nothing with development, and every part of one is a fair sample."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from . import plan
from .cases import KINDS, Case
from .line import blank
from .space import DOWN


@pytest.fixture(scope="module")
def short() -> list[Case]:
    return list(plan.short())


def test_the_judging_set_shares_no_case_with_development() -> None:
    chosen = list(plan.judging(rounds=2))
    assert {c.seed for c in chosen} == {plan.FIRST_JUDGING_SEED, plan.FIRST_JUDGING_SEED + 1}
    assert {c.kind for c in chosen} == set(KINDS)
    assert len({blank(c).key for c in chosen}) == len(chosen)
    sizes = np.array([c.size for c in chosen if c.kind == "single"])
    assert np.all((sizes < 0.14) | ((sizes > 0.29) & (sizes < 0.46)) | (sizes >= 0.5))
    assert list(plan.judging(rounds=2)) == chosen
    clean = sum(c.kind == "clean" for c in plan.judging(rounds=4))
    assert clean >= 300


def test_the_short_set_is_one_of_its_own(short: list[Case]) -> None:
    assert list(plan.short()) == short
    assert len({blank(c).key for c in short}) == len(short) == sum(share.number for share in plan.SHORT)
    whole = {c.seed for c in plan.judging(rounds=5)}
    assert min(c.seed for c in short) >= plan.FIRST_JUDGING_SEED
    assert not whole & {c.seed for c in short}
    assert {c.setting.joints for c in short} == set(plan.JOINTS)


def test_a_part_of_the_short_set_has_some_of_every_class(short: list[Case]) -> None:
    counts = Counter(c.kind for c in short)
    for part in (len(short) // 4, len(short) // 2):
        of_part = Counter(c.kind for c in short[:part])
        assert set(of_part) == set(KINDS)
        for kind, number in counts.items():
            # Each share is spread evenly by itself, so that it is off by less than one case.
            shares = 1 + sum(kind in {x.kind for x in short if x.label in s.names} for s in plan.SHORT)
            assert of_part[kind] == pytest.approx(number * part / len(short), abs=max(3.0, shares))


def test_situations_are_drawn_and_keep_what_a_case_needs(short: list[Case]) -> None:
    plain = [c for c in short if c.kind != "clean"]
    assert len({str(c.setting) for c in plain}) > 20
    direct = [c for c in short if c.label in ("ripple_direct", "ripple_lines")]
    assert direct
    assert all(c.setting.gear_ratio == 1.0 and c.setting.logger.every <= plan.FASTER for c in direct)
    assert all(any(c.setting.gravity) for c in short if "gravity_left_out" in c.names)


def test_arms_in_space_keep_their_gravity_in_every_situation() -> None:
    chosen = list(plan.judging(("clean", "single", "pairs"), (6, 7), 1, "brief"))
    assert {c.setting.gravity for c in chosen} == {DOWN}
    assert {c.setting.joints for c in chosen} == {6, 7}
    assert {c.setting.excitation for c in chosen if c.kind != "clean"} == {"brief"}
    assert len({str(c.setting) for c in chosen}) > 20
