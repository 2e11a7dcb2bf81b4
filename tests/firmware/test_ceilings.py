"""A host that is wrong or means harm: what it sends can tighten the board's ceilings, and never lift them."""

from __future__ import annotations

import json
from dataclasses import replace
from math import exp, pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_arms import MIXED
from talk import DRIVE, PER_COUNT, SAFETY, Talk

from codegen import prepare
from codegen.firmware import source_tree
from runtime.hardware.boards import UnicornBoard
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file.arm import Arm, Control, Gains, Limits

RATE, CUTOFF = 1000.0, 100.0
COUNTS = 2048
POSITION, SPEED, TORQUE = (-1.5, 1.0), 2.0, 7.0
NOTHING = 3.4028234663852886e38
"""The largest float, which stands for no limit."""
LARGE = 3e38
MOST = {"silence": 2**31 - 1, "late": 2**32 - 1, "saturated": 2**31 - 1, "errors": 2**32 - 1, "jump": [2**31 - 1] * 2}
PERIODS = 200_000
"""Of a hostile host: two hundred times what any of its limits would need."""


def limited(arm: Arm) -> Arm:
    """With everything that ceilings are made from; the second joint without limits."""
    first, second = arm.joints
    told = {"gains": Gains(20.0, 3.0), "encoder_counts": COUNTS}
    first = replace(first, limits=Limits(POSITION, SPEED, TORQUE), gear_ratio=2 * pi / PER_COUNT / COUNTS, **told)
    second = replace(second, gear_ratio=2 * pi / PER_COUNT / COUNTS, **told)
    return replace(arm, joints=(first, second), controller=Control(RATE, CUTOFF, 1.0, 100.0))


ARM = limited(MIXED["rp"])
HOST = {**DRIVE, "rate": RATE, "velocity_gain": 0.5, "kp": [20.0, 20.0], "kd": [3.0, 3.0], "torque_limit": [5.0, 5.0]}


@pytest.fixture(scope="module")
def ceilings(table: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = table["ceilings"]
    return found


def hostile(talk: Talk, value: float) -> Talk:
    """Every limit as far up as a message can say it."""
    wide = dict.fromkeys(("tracking", "speed", "high", "start", "frozen"), [value] * 2)
    gains = dict.fromkeys(("kp", "kd"), [1e9] * 2)
    for name, own, changed in (
        ("drive", HOST, {**gains, "torque_limit": [value] * 2}),
        ("safety", SAFETY, {**wide, **MOST, "low": [-value] * 2, "early": 0}),
    ):
        assert talk.say(name, {**own, **changed}) == "done"
    for name in ("parameters", "effects"):
        assert talk.say(name, dict.fromkeys(talk.codec.fields(name), 0.5)) == "done"
    talk.upload()
    return talk


def test_they_come_from_the_model_file(ceilings: dict[str, Any], directory: Path) -> None:
    """And for a joint without limits from tendon_board.h."""
    board = (directory / "src" / "tendon_board.h").read_text() if (directory / "src").exists() else None
    assert ceilings["torque_limit"] == [TORQUE, 10_000.0]
    assert ceilings["speed"] == [2 * SPEED, 10.0]
    assert ceilings["tracking"] == [1.0, 0.5]
    assert (ceilings["low"][0], ceilings["high"][0]) == pytest.approx((POSITION[0] - 0.1, POSITION[1] + 0.1))
    assert (ceilings["low"][1], ceilings["high"][1]) == (-100.0, 100.0)
    assert (ceilings["kp"], ceilings["kd"]) == ([200.0] * 2, [30.0] * 2)
    assert (ceilings["silence"], ceilings["late"]) == (RATE, 20_000)
    assert ceilings["velocity_gain"] == pytest.approx(0.5 * (1 - exp(-2 * pi * CUTOFF / RATE)))
    assert board is None or "TENDON_MOST_FORCE 10000.0f" in board


def test_the_page_says_of_which_joints_it_knows_no_limit(directory: Path) -> None:
    of_all = replace(ARM, joints=tuple(replace(joint, limits=Limits(torque=TORQUE)) for joint in ARM.joints))
    pages = {
        "For joint 2 the": (directory / "PROTOCOL.md").read_text(),
        "For joints 1, 2 the": source_tree.firmware_files(derive(MIXED["rp"]), LIBRARY)["PROTOCOL.md"],
        "": source_tree.firmware_files(derive(of_all), LIBRARY)["PROTOCOL.md"],
    }
    for said, page in pages.items():
        assert (f"{said} model file has no torque limit" in page) == bool(said)
        assert ("protects no gear" in page) == bool(said)


@pytest.mark.parametrize("value", [LARGE, NOTHING, 1e6])
def test_whatever_it_sends_the_torque_keeps_to_the_ceiling(talk: Talk, ceilings: dict[str, Any], value: float) -> None:
    """With gains that ask for all there is, at the edge of what tracking lets pass."""
    hostile(talk, value).run()
    most, largest = np.array(ceilings["torque_limit"]), np.zeros(2)
    for k in range(40):
        step = talk.step([100 + 20 * (k % 2), -3])
        largest = np.maximum(largest, np.abs(step.torque))
    assert (largest <= most).all()
    assert largest[0] == most[0]


def test_what_was_lowered_is_told(talk: Talk) -> None:
    """One more than the first value; nothing for what is within, or was no limit to begin with."""
    n, told = 2, {}
    for key, changed in (("kp", {"kp": [1.0, 1e9]}), ("torque_limit", {"torque_limit": [LARGE, 1.0]}), ("", {})):
        assert talk.say("drive", {**HOST, **changed}) == "done"
        told[key] = talk.detail
    assert told == {"kp": 1 + 2 + 2 * n + 1, "torque_limit": 1 + 2 + 4 * n, "": 0}
    inside = {
        **SAFETY,
        "silence": 500,
        "speed": [SPEED] * n,
        "tracking": [0.1] * n,
        "low": [-1.0] * n,
        "high": [1.0] * n,
    }
    for values, detail in (
        (inside, 0),
        ({**inside, "tracking": [0.1, 9.0], "late": 2**32 - 1}, 2),
        ({**inside, "low": [-2.0, -1.0]}, 1 + 2 * n),
        ({**inside, "late": 2**32 - 1}, 1 + 7 * n + 4),
        ({**inside, "speed": [NOTHING] * n, "low": [-NOTHING] * n, "high": [NOTHING] * n}, 0),
    ):
        assert talk.say("safety", values) == "done"
        assert talk.detail == detail


@pytest.mark.parametrize("zero", [0.0, -0.0, 1e-7])
def test_a_torque_limit_of_zero_is_none(talk: Talk, zero: float) -> None:
    """It would leave an arm without damping."""
    assert talk.say("drive", {**HOST, "torque_limit": [5.0, zero]}) == "out_of_range"
    assert talk.detail == 2 + 5 * 2 - 1


@pytest.mark.parametrize(
    ("key", "value", "place"),
    [
        ("rate", 1.0, 0),
        ("rate", 1100.0, 0),
        ("velocity_gain", 0.01, 1),
        ("position_per_count", [PER_COUNT, PER_COUNT / 100], 3),
        ("position_per_count", [1e3 * PER_COUNT, PER_COUNT], 2),
    ],
)
def test_facts_of_the_board_cannot_be_told_otherwise(talk: Talk, key: str, value: Any, place: int) -> None:
    """With a rate of 1 Hz or an encoder of a thousandth of its step, no guard would see anything."""
    assert talk.say("drive", {**HOST, key: value}) == "out_of_range"
    assert talk.detail == place


def left_alone(talk: Talk, most: np.ndarray) -> tuple[int, dict[str, Any]]:
    """Periods of a run until the board stops it, and what it then reports; the host says nothing."""
    for silent in range(PERIODS):
        step = talk.step()
        assert (np.abs(step.torque) <= most).all()
        if (state := step.report("state")) is not None:
            return silent, state
    raise AssertionError(f"it runs on after {PERIODS} periods")


def test_silence_has_an_end(talk: Talk, ceilings: dict[str, Any]) -> None:
    """The host is gone; it had asked for two thousand million periods of patience."""
    hostile(talk, LARGE).run()
    silent, state = left_alone(talk, np.array(ceilings["torque_limit"]))
    assert talk.reasons[state["reason"]] == "link_lost"
    assert silent == ceilings["silence"]


def test_a_step_that_comes_late_is_seen(talk: Talk, ceilings: dict[str, Any]) -> None:
    hostile(talk, LARGE).run()
    assert talk.step(us=ceilings["late"]).report("state") is None
    state = talk.step(us=ceilings["late"] + 1).report("state")
    assert state is not None
    assert talk.reasons[state["reason"]] == "watchdog"


@pytest.mark.parametrize(("reason", "counts"), [("speed", 8), ("position", 2), ("tracking", 1025)])
def test_guards_cannot_be_lifted(talk: Talk, reason: str, counts: int) -> None:
    """A joint that runs away: jumps by more than tracking lets pass, or follows a trajectory too fast or too far."""
    hostile(talk, LARGE)
    if reason != "tracking":
        # Along with the joint, so that tracking is no reason.
        talk.upload([[0.5 * k * counts, 0.0] for k in range(5)], 2.0 / PER_COUNT / 1000)
    talk.run()
    at = 100
    for _ in range(4000):
        at += counts
        if (state := talk.step([at, -3]).report("state")) is not None:
            break
        talk.say("alive")
    assert state is not None
    assert (talk.reasons[state["reason"]], state["joint"]) == (reason, 1)


@given(
    st.lists(st.floats(2.0**-10, float(np.float32(NOTHING)), width=32), min_size=2, max_size=2),
    st.lists(st.floats(width=32, allow_nan=False, allow_infinity=False), min_size=4, max_size=4),
    st.lists(st.integers(-2000, 2000), min_size=1, max_size=20),
)
def test_any_limits_and_any_motion(directory: Path, limits: list[float], ends: list[float], motion: list[int]) -> None:
    """Torques within the ceilings and within what was sent, and none outside the range of position."""
    talk = Talk(directory, ARM.name)
    first, second = sorted(ends[:2]), sorted(ends[2:])
    hostile(talk, LARGE)
    assert talk.say("drive", {**HOST, "kp": [1e9] * 2, "torque_limit": limits}) == "done"
    wide = dict.fromkeys(("tracking", "speed", "start", "frozen"), [LARGE] * 2)
    ranges = {"low": [first[0], second[0]], "high": [first[1], second[1]]}
    assert talk.say("safety", {**SAFETY, **wide, **MOST, **ranges, "early": 0}) == "done"
    talk.run()
    most = np.minimum(talk.codec.document["ceilings"]["torque_limit"], np.float32(limits))
    for counts in motion:
        step = talk.step([100 + counts, -3])
        assert np.isfinite(step.torque).all()
        assert (np.abs(step.torque) <= most).all()
        outside = not POSITION[0] - 0.102 <= counts * PER_COUNT <= POSITION[1] + 0.102
        if outside:
            break
    # Looked at in turn: within as many periods as there are joints.
    for _ in range(2 if outside else 0):
        talk.step([100 + counts, -3])
    assert not outside or talk.state()["state"] == "stopped"


def test_tighter_limits_are_the_same_build() -> None:
    """A firmware for wide limits serves a model file that was made tighter; equations of another arm do not."""

    def page(arm: Arm) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(source_tree.firmware_files(derive(arm), LIBRARY)["protocol.json"])
        return found

    first, second = ARM.joints
    tight = replace(ARM, joints=(replace(first, limits=Limits((-1.0, 1.0), 1.0, 1.0)), second))
    assert page(tight)["build"] == page(ARM)["build"]
    assert page(tight)["ceilings"] != page(ARM)["ceilings"]


def test_a_hostile_host_of_an_emulated_board() -> None:
    """The image for a Cortex-M4F: silent after `run`, with every limit lifted, it stops the arm itself."""
    pytest.importorskip("unicorn")
    built = prepare.prepare_firmware(ARM, LIBRARY, "cortex-m4f")
    talk = Talk(built, ARM.name, made=UnicornBoard)
    ceilings = talk.codec.document["ceilings"]
    try:
        hostile(talk, LARGE).run()
        silent, state = left_alone(talk, np.array(ceilings["torque_limit"]))
        assert talk.reasons[state["reason"]] == "link_lost"
        assert silent == ceilings["silence"]
    finally:
        talk.board.close()
