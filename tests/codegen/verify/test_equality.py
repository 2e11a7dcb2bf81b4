"""SymPy = C double = C float = CasADi, for every function and every effect, at inputs that hypothesis draws."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
import sympy as sp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from random_arms import MIXED, loaded

from codegen.verify import verify
from symbolic.effects import LIBRARY
from symbolic.effects.declaration import SIGNAL
from symbolic.model import derive
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm, Drive
from tests import one_joint
from tests.variants import slow

# Points of a subject a draw; with the draws below some 60 points a function.
POINTS = 3
QUIET = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
RANDOM = st.integers(0, 2**63 - 1).map(random.Random)


def hold(subject: verify.Subject, rng: random.Random) -> None:
    """Every target within the tolerance that verify.TARGETS justifies: 1e-12 or 1e-5 of the sum of |terms|."""
    cases, _ = verify.compare(subject, [subject.draw(rng) for _ in range(POINTS)])
    unequal = [case for case in cases if not case.equal]
    assert not unequal, unequal


@pytest.fixture(scope="module")
def effect_subjects() -> dict[str, list[verify.Subject]]:
    subjects: dict[str, list[verify.Subject]] = {name: [] for name in LIBRARY}
    for subject in verify.effect_subjects(tuple(LIBRARY.values())):
        name = subject.function.name.rsplit("_", 1)[0]
        subjects[name].append(subject)
    return subjects


@pytest.mark.parametrize("name", LIBRARY)
@given(rng=RANDOM)
@QUIET
def test_effect(name: str, effect_subjects: dict[str, list[verify.Subject]], rng: random.Random) -> None:
    assert effect_subjects[name]
    for subject in effect_subjects[name]:
        hold(subject, rng)


def test_an_effect_that_rises_to_one() -> None:
    """1 - exp(-x) of what is never negative is one operation, on every target."""
    qd, torque = SIGNAL["qd"].symbol, LIBRARY["offset"].parameters[0]
    rising = replace(LIBRARY["offset"], name="rising", torque=torque.symbol * (1 - sp.exp(-(qd**2))))
    for subject in verify.effect_subjects([rising]):
        hold(subject, random.Random(0))


@pytest.fixture(scope="module")
def paper_subjects(vishard4: Arm) -> list[verify.Subject]:
    return verify.arm_subjects(derive(vishard4))


@given(rng=RANDOM)
@settings(QUIET, max_examples=15)
def test_arm_of_the_paper(paper_subjects: list[verify.Subject], rng: random.Random) -> None:
    names = {subject.function.name for subject in paper_subjects}
    assert {"inverse_dynamics", "forward_dynamics", "contact_inverse", "contact_acceleration"} <= names
    for subject in paper_subjects:
        hold(subject, rng)


@pytest.fixture(scope="module", params=[slow(x) if x in ("prr", "rrrr", "rrprrrr") else x for x in MIXED])
def mixed_subjects(request: pytest.FixtureRequest) -> list[verify.Subject]:
    return verify.arm_subjects(derive(MIXED[request.param]))


@pytest.fixture(scope="module", params=["paper", "rp", "rprrp"])
def controller_subjects(request: pytest.FixtureRequest, vishard4: Arm) -> list[verify.Subject]:
    arm = vishard4 if request.param == "paper" else loaded(MIXED[request.param])
    return verify.controller_subjects(derive(arm), LIBRARY)


@given(rng=RANDOM)
@settings(QUIET, max_examples=10)
def test_compensation(controller_subjects: list[verify.Subject], rng: random.Random) -> None:
    """With all effects of the library at the first joint, friction by (7), springs and the plate."""
    assert {s.function.name for s in controller_subjects} == {"joint_compensation", "contact_compensation"}
    for subject in controller_subjects:
        hold(subject, rng)


@given(rng=RANDOM)
@settings(QUIET, max_examples=5)
def test_any_mixture_of_joints(mixed_subjects: list[verify.Subject], rng: random.Random) -> None:
    for subject in mixed_subjects:
        hold(subject, rng)


DRIVES = (
    Drive(law="pwm", gains={"torque_per_volt": 2.0, "back_emf": 0.3, "dead_duty": 0.1, "saturation": 0.8}),
    Drive(law="position_servo", gains={"kp": 20.0, "kd": 1.5, "ki": 4.0}),
)


@pytest.fixture(scope="module")
def driven_subject() -> verify.Subject:
    arm = MIXED["rp"]
    driven = [replace(joint, drive=drive) for joint, drive in zip(arm.joints, DRIVES, strict=True)]
    subjects = verify.arm_subjects(derive(replace(arm, joints=tuple(driven))))
    return next(subject for subject in subjects if subject.function.name == "drive_torque")


@given(rng=RANDOM)
@QUIET
def test_laws_of_drives(driven_subject: verify.Subject, rng: random.Random) -> None:
    """Within a dead zone, beyond it, and at a limit."""
    assert [a.name for a in driven_subject.function.inputs] == [
        *("q", "qd", "q_desired", "qd_desired", "duty", "bus_voltage", "error_integral")
    ]
    hold(driven_subject, rng)


def test_a_wrong_target_is_found(paper_subjects: list[verify.Subject]) -> None:
    """Were one output of one function wrong by a part in 10^9, the comparison would say so."""
    subject = paper_subjects[0]
    exact = subject.targets["C double"]

    def wrong(values: dict) -> list[float]:
        found = exact(values)
        return [found[0] * (1 + 1e-9), *found[1:]]

    spoilt = verify.Subject(subject.function, {"C double": wrong}, subject.draw)
    (case,), _ = verify.compare(spoilt, [subject.draw(random.Random(1))])
    assert not case.equal
    assert case.output == "tau[0]"
    assert case.ratio > 1


def test_vectors_replay(vishard4: Arm) -> None:
    """The report's vectors, read back from their hexadecimal floats, are what the float code returns."""
    report = verify.verify(vishard4, samples=2, seed=3, effects=())
    assert report.equal
    page = report.to_json()
    assert page["equal"] is True
    model = derive(vishard4)
    every = [*verify.arm_subjects(model), *verify.controller_subjects(model, LIBRARY)]
    subjects = {s.function.name: s for s in every}
    assert {v["function"] for v in page["vectors"]} == set(subjects)
    for vector in page["vectors"]:
        function = subjects[vector["function"]].function
        groups = {a.name: a.symbols for a in function.inputs}
        groups |= {function.struct.name: function.struct.symbols} if function.struct else {}
        values = {
            symbol: float.fromhex(text)
            for name, symbols in groups.items()
            for symbol, text in zip(symbols, vector["inputs"][name]["hex"], strict=True)
        }
        found = subjects[function.name].targets["C float"](values)
        (expected,) = vector["outputs"].values()
        for y, x, tolerance in zip(found, expected["decimal"], vector["tolerance"], strict=True):
            assert abs(y - x) <= tolerance


def test_the_same_seed_gives_the_same_report() -> None:
    arm = reader.parse(one_joint.model_text("", gravity=-9.81), "one.toml", LIBRARY)
    first, second = (verify.verify(arm, samples=3, seed=7, effects=()).to_json() for _ in range(2))
    assert first == second
