"""Cases of MuJoCo's arms from end to end, and that their sets are apart."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

pytest.importorskip("mujoco", minversion="4.0", reason="needs mujoco 4: pip install -e '.[mjcf]'")

from symbolic.model_file import reader
from tests import bank
from tests.judge import mujoco_arms, mujoco_plan, plan
from tests.judge.bench import Setting
from tests.judge.bodies import BELIEVED, in_space
from tests.judge.cases import Case, cases
from tests.judge.line import blank
from tests.judge.mujoco_hidden import MECHANISMS
from tests.judge.recorder import Logger
from tests.judge.space import DOWN
from tests.kept import kept
from tests.variants import slow

SEED = 42
SETTING = Setting(simulator="mujoco", excitation="fourier", logger=Logger(every=4))

ALONE = {"coupled_gear@7": 2.5}
"""Floors that the inertia of the coupled motor makes without any friction of it."""


def one(name: str, n: int, size: float = 2.0) -> Case:
    return next(iter(cases([name], [n], [size], [SEED], SETTING)))


@pytest.mark.parametrize("case", ["linear_spring@1", *map(slow, ("stribeck@4", "linear_spring@6", "coupled_gear@7"))])
def test_a_mechanism_of_mujoco_is_named(case: str) -> None:
    name, _, n = case.partition("@")
    row = kept(bank.judged, one(name, int(n)))
    assert row.outcome == "right", row
    assert row.sizes[0] == pytest.approx(ALONE.get(case, 2.0), rel=0.11)
    assert 0.95 < row.ratio < 1.5


@pytest.mark.parametrize("n", [1, slow(4), slow(6), slow(7)])
def test_nothing_is_named_where_nothing_is_hidden(n: int) -> None:
    row = kept(bank.judged, replace(one("clean", n), setting=replace(SETTING, joints=n, gravity=_gravity(n))))
    assert (row.verdict, row.named) == ("clean", ""), row.reason


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(4132, id="friction that saturates faster than the band tells its size"),
        *map(slow, (4020, 4029, 4101, 4103)),
    ],
)
def test_a_case_of_the_development_set(seed: int) -> None:
    """4020: a motor's first order in a band that it leaves. 4029: a cable whose powers are gravity's as well. 4101:
    many turns that are eliminated. 4103: encoders of 50 counts, whose steps make a line."""
    row = kept(bank.judged, next(c for c in mujoco_plan.mujoco("development") if c.seed == seed))
    assert row.outcome == "right", row
    assert not row.extra


def _gravity(n: int) -> tuple[float, ...]:
    return DOWN if in_space(mujoco_arms.bodies(n)) else (0.0, 0.0)


@pytest.mark.parametrize("n", mujoco_arms.NAMES)
def test_the_users_masses_are_a_little_off(n: int) -> None:
    factors = set()
    for seed in range(mujoco_arms.VARIANTS):
        arm = reader.parse(mujoco_arms.model_text(n, seed, BELIEVED, _gravity(n), 100.0), "judge.toml")
        assert all(tuple(joint.effects) == BELIEVED for joint in arm.joints)
        for joint, body in zip(arm.joints, mujoco_arms.bodies(n), strict=True):
            assert joint.link.mass == pytest.approx(body.mass, rel=mujoco_arms.OFF + 0.03)  # a Panda's fingers apart
            factors.add(round(joint.link.mass / body.mass, 6))
    assert len(factors) == mujoco_arms.VARIANTS * n


def test_the_sets_are_apart() -> None:
    development, judging = mujoco_plan.mujoco("development"), mujoco_plan.mujoco("judging")
    assert max(c.seed for c in development) < plan.FIRST_JUDGING_SEED
    others = {c.seed for c in plan.short()} | set(range(plan.FIRST_JUDGING_SEED, plan.FIRST_JUDGING_SEED + 100))
    assert not others & {c.seed for c in judging}
    for chosen in (development, judging):
        assert (
            len({blank(c).key for c in chosen})
            == len(chosen)
            == sum(number for by_joints in mujoco_plan.NUMBERS.values() for number in by_joints.values())
        )
        assert {c.setting.joints for c in chosen} == set(mujoco_arms.NAMES)
        rates = Counter(c.setting.logger.every for c in chosen)
        assert set(rates) == set(mujoco_plan.RATES)
        hidden = {name for c in chosen for name in c.names}
        assert len(hidden) > 0.9 * len(MECHANISMS)
