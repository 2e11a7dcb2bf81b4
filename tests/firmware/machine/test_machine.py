"""The machine on this computer: what it takes and refuses, what stops it, and that no torque is ever held."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import ceil, floor, inf, nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule
from random_arms import MIXED
from talk import DRIVE, PER_COUNT, SAFETY, N, Step, Talk

from codegen import prepare
from codegen.firmware import source_tree
from runtime.execution import real
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file.arm import Arm, Limits

WIDE = Limits(position=(-1e6, 1e6), speed=1e6, torque=1e6)
"""So that what a test sends is what holds; test_ceilings.py has what happens beyond."""


def wide(arm: Arm) -> Arm:
    return replace(arm, joints=tuple(replace(joint, limits=WIDE) for joint in arm.joints))


ARM = wide(MIXED["rp"])
STATES = ("idle", "armed", "running", "stopped")


def brought_to(talk: Talk, state: str) -> Talk:
    talk.ready()
    if state in ("armed", "running", "stopped"):
        assert talk.say("arm") == "done"
    if state == "running":
        assert talk.say("run", {"periods": 0, "every": 1}) == "done"
    if state == "stopped":
        assert talk.say("stop") == "done"
        for _ in range(10):
            talk.step()
    assert talk.state()["state"] == state
    return talk


def values_of(talk: Talk, name: str) -> dict[str, Any]:
    """Some that are in range."""
    own = {"drive": DRIVE, "safety": SAFETY}.get(name)
    if own is not None:
        return dict(own)
    found: dict[str, Any] = {}
    for item in next(m for m in talk.codec.document["messages"] if m["name"] == name)["fields"]:
        value = max(item["low"], min(1, item["high"]))
        value = float(value) if item["type"] == "float" else int(value)
        found[item["name"]] = value if item["count"] is None else [value] * item["count"]
    return found


# --- who may say what, and when ---


def test_it_says_who_it_is(talk: Talk, table: dict[str, Any]) -> None:
    assert talk.reports[0].values == {"state": 0, "reason": 0, "joint": 0, "enabled": 0, "period": 0, "code": 0}
    assert talk.say("hello", sequence=4711) == "done"
    assert talk.report("identity") == {
        "version": table["version"],
        "joints": N,
        "state": 0,
        "reason": 0,
        "fingerprint": table["fingerprint"],
        "max_phases": table["max_phases"],
        "max_rows": table["max_rows"],
        "build": table["build"],
    }


def test_other_equations_of_the_same_layout_are_another_build(table: dict[str, Any]) -> None:
    """Gravity along another axis has the same messages."""
    gravity = (ARM.gravity[1] + 1.0, ARM.gravity[0], 0.0)
    other = source_tree.firmware_files(derive(replace(ARM, gravity=gravity)), LIBRARY)
    page = json.loads(other["protocol.json"])
    assert page["fingerprint"] == table["fingerprint"]
    assert page["build"] != table["build"]


@pytest.mark.parametrize("rate", [1000, 4000])
def test_the_pages_say_of_the_line_what_the_host_does(directory: Path, rate: int) -> None:
    model: Any = SimpleNamespace(controller={"rate": float(rate)})
    done = real.decimation(directory, model, 1_000_000)
    said = (directory / "PROTOCOL.md").read_text()
    assert f"one in {done} at {rate // 1000} kHz" in said
    most = re.search(r"(\d+) a second fill 90 % of the line", said)
    assert most is not None
    assert f"are good for {most[1]} Hz, 90 % of the line" in (directory / "README.md").read_text()


@pytest.mark.parametrize("state", STATES)
def test_every_command_in_every_state(directory: Path, table: dict[str, Any], state: str) -> None:
    for message in table["messages"]:
        if message["direction"] != "command":
            continue
        talk = brought_to(Talk(directory, ARM.name), state)
        allowed = not message["states"] or state in message["states"]
        result = talk.say(message["name"], values_of(talk, message["name"]))
        assert (result != "state") == allowed, message["name"]
        if not allowed:
            assert talk.detail == STATES.index(state)
            assert talk.state()["state"] == state


def test_a_command_is_done_once(talk: Talk) -> None:
    brought_to(talk, "armed")
    frame = talk.codec.encode("run", {"periods": 7, "every": 1}, talk.sequence + 1)
    first, again = talk.raw(frame), talk.raw(frame)
    assert [m.name for m in first] == ["ack", "state"]
    assert [m.name for m in again] == ["ack"]
    assert again[0].values == first[0].values
    talk.sequence += 1
    assert [talk.step().enabled for _ in range(7 + SAFETY["damping"] + 1)] == [True] * (7 + SAFETY["damping"]) + [False]
    assert talk.say("query") == "done"
    assert talk.report("counters")["duplicates"] == 1


def test_a_refused_command_that_comes_again_is_refused_again(talk: Talk) -> None:
    assert talk.say("run", {"periods": 1, "every": 1}) == "state"
    sequence = talk.sequence
    assert talk.say("run", {"periods": 1, "every": 1}, sequence) == "state"
    assert talk.say("alive", sequence=sequence) == "sequence", "the number of another command"


def test_numbers_go_round(talk: Talk) -> None:
    assert talk.say("hello", sequence=65534) == "done"
    assert [talk.say("alive") for _ in range(3)] == ["done"] * 3
    assert talk.sequence == 1


@given(st.integers(0, 65535), st.integers(0, 65535))
def test_what_is_out_of_sequence_is_refused(directory: Path, start: int, number: int) -> None:
    talk = Talk(directory, ARM.name)
    assert talk.say("hello", sequence=start) == "done"
    expected = "done" if number == (start + 1) % 65536 else "sequence"
    assert talk.say("alive", sequence=number) == expected
    if expected == "sequence":
        assert talk.detail == (start + 1) % 65536
        assert talk.say("alive", sequence=start + 1) == "done"


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("number", [0, 5, 60000])
def test_stop_is_heard_whatever_its_number(talk: Talk, state: str, number: int) -> None:
    brought_to(talk, state)
    assert talk.say("stop", sequence=number) == "done"
    assert talk.say("alive") == "done"
    expected = {"idle": ("idle", "none"), "stopped": ("stopped", "host")}.get(state, ("stopped", "host"))
    found = talk.state()
    assert (found["state"], found["reason"]) == expected


def test_hello_from_a_host_of_another_version_is_answered(talk: Talk) -> None:
    plain = bytes([99, talk.codec.number("hello"), 3, 0, 0, 0])
    plain += zlib.crc32(plain).to_bytes(4, "little")
    from runtime.hardware.link import cobs_encode

    assert [m.name for m in talk.raw(cobs_encode(plain) + b"\0")] == ["ack", "identity"]
    assert talk.raw(cobs_encode(b"\x63" + plain[1:-4] + zlib.crc32(plain[:-4]).to_bytes(4, "little")) + b"\0")
    stop = bytes([99, talk.codec.number("stop"), 4, 0, 0, 0])
    assert talk.raw(cobs_encode(stop + zlib.crc32(stop).to_bytes(4, "little")) + b"\0") == []
    talk.sequence = 3
    assert talk.say("query") == "done"
    assert talk.report("counters")["bad_header"] == 1


def test_reports_and_unknown_types_are_no_commands(talk: Talk) -> None:
    zeros = {name: 0 if count is None else [0] * count for name, count in talk.codec.fields("telemetry").items()}
    assert talk.say("telemetry", zeros) == "unknown"
    assert talk.say("query") == "done"
    assert talk.report("counters")["unknown"] == 1


# --- settings ---


@given(st.data())
def test_what_is_out_of_range_is_named(directory: Path, data: st.DataObject) -> None:
    talk = Talk(directory, ARM.name)
    brought_to(talk, "idle")
    messages = [m for m in talk.codec.document["messages"] if m["direction"] == "command" and m["fields"]]
    message = data.draw(st.sampled_from([m for m in messages if m["name"] != "commit"]))
    if message["name"] == "run":
        assert talk.say("arm") == "done"
    item = data.draw(st.sampled_from(message["fields"]))
    which = data.draw(st.integers(0, (item["count"] or 1) - 1))
    if item["type"] == "float":
        edges = [float(np.nextafter(np.float32(item["low"]), np.float32(-inf)))] if abs(item["low"]) < 1e38 else []
        edges += [float(np.nextafter(np.float32(item["high"]), np.float32(inf)))] if abs(item["high"]) < 1e38 else []
        bad = data.draw(st.sampled_from([*edges, nan, inf, -inf]))
    else:
        least, most = (-(2**31), 2**31 - 1) if item["type"] == "i32" else (0, 2**32 - 1)
        edges = [int(item["low"]) - 1, int(item["high"]) + 1]
        inside = [edge for edge in edges if least <= edge <= most]
        if not inside:
            return
        bad = data.draw(st.sampled_from(inside))
    values = values_of(talk, message["name"])
    if item["count"] is None:
        values[item["name"]] = bad
    else:
        values[item["name"]] = [*values[item["name"]]]
        values[item["name"]][which] = bad
    finite = isinstance(bad, int) or abs(bad) < inf
    assert talk.say(message["name"], values) == ("out_of_range" if finite else "not_finite")
    place = 0
    for field in message["fields"]:
        if field is item:
            break
        place += field["count"] or 1
    assert talk.detail == place + which


@given(st.data())
def test_every_value_within_its_range_is_taken(directory: Path, data: st.DataObject) -> None:
    talk = Talk(directory, ARM.name)
    name = data.draw(st.sampled_from(["parameters", "effects", "drive", "safety"]))
    values: dict[str, Any] = {}
    for item in next(m for m in talk.codec.document["messages"] if m["name"] == name)["fields"]:
        if item["type"] == "float":
            one = st.one_of(
                st.sampled_from([np.float32(item["low"]), np.float32(item["high"])]).map(float),
                st.floats(float(np.float32(item["low"])), float(np.float32(item["high"])), width=32),
            )
        else:
            one = st.integers(int(item["low"]), int(item["high"]))
        values[item["name"]] = (
            data.draw(one) if item["count"] is None else [data.draw(one) for _ in range(item["count"])]
        )
    if name == "safety":
        values["low"], values["high"] = zip(
            *(sorted(pair) for pair in zip(values["low"], values["high"], strict=True)), strict=True
        )
        values["early"], values["late"] = sorted((values["early"], values["late"]))
    assert talk.say(name, values) == "done"


def test_an_empty_range_of_position_is_refused(talk: Talk) -> None:
    assert talk.say("safety", {**SAFETY, "low": [-1.0, 0.5], "high": [1.0, 0.25]}) == "out_of_range"
    assert talk.detail == 4 * N - 1


def test_an_elbow_of_zero_is_refused(talk: Talk) -> None:
    (name, values), *_ = talk.parts(((0.0, 0.0),) * 5, 1.0, False)
    assert talk.say(name, {**values, "elbow": 0}) == "out_of_range"
    assert talk.detail == 2


def test_arm_says_what_is_missing(talk: Talk) -> None:
    bits = talk.codec.document["missing"]
    missing = sum(bits.values())
    assert talk.say("arm") == "incomplete"
    assert talk.detail == missing
    for name in ("parameters", "effects", "drive", "safety"):
        assert talk.say(name, values_of(talk, name)) == "done"
        missing -= bits[name]
        assert talk.say("arm") == "incomplete"
        assert talk.detail == missing
    talk.upload()
    assert talk.say("arm") == "done"


def test_a_refused_setting_changes_nothing(directory: Path) -> None:
    first, second = (Talk(directory, ARM.name).ready() for _ in range(2))
    for name, key in (("drive", "kp"), ("drive", "torque_limit"), ("safety", "tracking"), ("parameters", None)):
        values = {
            k: [9.0] * N if isinstance(v, list) and k != "zero" and k != "jump" else v
            for k, v in values_of(second, name).items()
        }
        values[key or next(reversed(values))] = [1.0, nan] if key else nan
        assert second.say(name, values) == "not_finite"
    torques = []
    for talk in (first, second):
        talk.run()
        torques.append([talk.step([120 + k, k]).torque.tobytes() for k in range(30)])
    assert torques[0] == torques[1]


# --- trajectories ---


def test_parts_in_another_order_are_refused(talk: Talk) -> None:
    rows = [(0.1 * k, 0.0) for k in range(20)]
    trajectory, phase, *points = talk.parts(rows, 1.0, False)
    assert talk.say(*phase) == "order", "before its trajectory"
    assert talk.say(*points[0]) == "order"
    assert talk.say(*trajectory) == "done"
    assert talk.say("phase", phase[1] | {"index": 1}) == "order"
    assert talk.detail == 0
    assert talk.say(*points[1]) == "order"
    assert talk.detail == 0
    assert talk.say(*points[0]) == "done"
    assert talk.say(*points[0]) == "order"
    assert talk.detail == 8
    assert talk.say("commit", {"checksum": 0}) == "incomplete"
    assert talk.say(*phase) == "done"
    assert talk.say(*phase) == "order", "more phases than it has"
    assert talk.say(*points[1]) == "done"
    assert talk.say(*points[2]) == "done"
    assert talk.say(*points[2]) == "order", "more rows than it has"
    assert talk.say("commit", {"checksum": 0}) == "checksum"
    checksum = 0
    for name, values in (trajectory, points[0], phase, points[1], points[2]):
        checksum = zlib.crc32(talk.codec.payload(name, values), checksum)
    assert talk.say("commit", {"checksum": checksum}) == "done"
    assert talk.say("commit", {"checksum": checksum}) == "incomplete", "nothing is open any more"


@pytest.mark.parametrize(
    ("degree", "first", "result"), [(4, 0, "done"), (4, 1, "out_of_range"), (5, 0, "out_of_range")]
)
def test_a_phase_keeps_to_the_rows_there_are(talk: Talk, degree: int, first: int, result: str) -> None:
    trajectory, (_, phase), *_ = talk.parts(((0.0, 0.0),) * 5, 1.0, False)
    assert talk.say(*trajectory) == "done"
    assert talk.say("phase", phase | {"degree": degree, "first_row": first}) == result


def test_a_new_trajectory_unmakes_the_old_one(talk: Talk) -> None:
    talk.ready()
    trajectory, *_ = talk.parts(((0.0, 0.0),) * 5, 1.0, False)
    assert talk.say(*trajectory) == "done"
    assert talk.say("arm") == "incomplete"
    assert talk.detail == talk.codec.document["missing"]["trajectory"]


def test_a_phase_shorter_than_a_period_is_refused(talk: Talk) -> None:
    talk.settings()
    for short in (0.0005, 0.000999, 0.00099999):
        talk.upload(duration=short)
        assert talk.say("arm") == "out_of_range"
    talk.upload(duration=0.001)
    assert talk.say("arm") == "done"


def test_the_largest_trajectory(talk: Talk, table: dict[str, Any]) -> None:
    """As many phases and rows as there is room for; followed to its end."""
    talk.settings(frozen=[9.0] * N)
    phases, rows = table["max_phases"], table["max_rows"]
    each = rows // phases
    points = [(0.001 * k, -0.001 * k) for k in range(rows)]
    (name, head), (_, phase), *others = talk.parts(points, 0.01, False)
    messages = [(name, head | {"count": phases})]
    messages += [("phase", phase | {"index": k, "degree": each - 1, "first_row": each * k}) for k in range(phases)]
    messages += others
    checksum = 0
    for name, values in messages:
        assert talk.say(name, values) == "done"
        checksum = zlib.crc32(talk.codec.payload(name, values), checksum)
    assert talk.say("commit", {"checksum": checksum}) == "done"
    talk.run()
    seen = set()
    for k in range(phases * 10 + 5):
        record = talk.step([100 + round(0.001 * rows * k / 165 / PER_COUNT), -3]).report("telemetry")
        assert record is not None
        seen.add(record["phase"])
    assert seen == set(range(phases))
    assert record["q_desired"][0] == pytest.approx(0.255)
    assert record["status"] & table["status"]["finished"]


# --- steps and telemetry ---


def test_where_the_arm_stands_is_told_in_idle(talk: Talk) -> None:
    assert talk.step().reports == []
    assert talk.say("query") == "done"
    record = talk.step([7, -8]).report("telemetry")
    assert record is not None
    assert (record["counts"], record["torque"], record["time_us"]) == ((7, -8), (0.0, 0.0), 2000)
    assert talk.step().reports == []


def test_telemetry_of_every_third_period(talk: Talk) -> None:
    talk.ready().run(every=3)
    periods = [r["period"] for _ in range(20) if (r := talk.step().report("telemetry"))]
    assert periods == list(range(0, 20, 3))


def test_a_query_leaves_the_grid_of_a_run_alone(talk: Talk) -> None:
    talk.ready().run(every=5)
    periods = []
    for k in range(30):
        for _ in range({7: 1, 8: 2, 14: 1, 15: 1}.get(k, 0)):
            assert talk.say("query") == "done"
        if record := talk.step().report("telemetry"):
            periods.append(record["period"])
    assert periods == [0, 5, 7, 8, 10, 14, 15, 20, 25]


@pytest.mark.parametrize("periods", [300, 307, 314])
def test_what_was_told_last_is_told_on(talk: Talk, periods: int) -> None:
    """Where a step computes nothing anew, also if the last one was not recorded."""
    talk.settings()
    talk.upload(SLOW, 2.0)
    talk.run(every=7)
    told_by_run = [r for k in range(periods) if (r := talk.step([100 + k // 2, -3]).report("telemetry"))]
    slope = (told_by_run[-1]["q_desired"][0] - told_by_run[-2]["q_desired"][0]) / 7
    assert talk.say("query") == "done"
    before = talk.step().report("telemetry")
    talk.step()
    talk.step()
    after = talk.step(us=5000).report("telemetry")
    assert before is not None
    assert after is not None
    assert after["q_desired"][0] == pytest.approx(before["q_desired"][0] + 2 * slope, abs=0.5 * slope)


def test_what_the_link_does_not_take_is_counted_and_seen(talk: Talk) -> None:
    talk.ready().run()
    for _ in range(20):
        talk.time_us += 1000
        talk.board.period(np.array(talk.counts, dtype=np.int32), talk.time_us, 0)
    periods = [m.values["period"] for m in talk.hear() if m.name == "telemetry"]
    assert periods == list(range(8))
    record = talk.step().report("telemetry")
    assert record is not None
    assert record["period"] == 20
    assert talk.say("query") == "done"
    assert talk.report("counters")["telemetry_lost"] == 12


def test_answers_that_are_not_fetched_are_counted(talk: Talk) -> None:
    for k in range(12):
        talk.board.receive(talk.codec.encode("alive", sequence=k + 1))
    assert sum(message.name == "ack" for message in talk.hear()) == 8
    talk.sequence = 11
    assert talk.say("alive") == "done", "the last one again: answered again"
    assert talk.say("query") == "done"
    assert talk.report("counters")["acks_lost"] == 4


def test_a_run_again_is_the_same_run(talk: Talk) -> None:
    talk.settings()
    talk.upload([(0.0, 0.0)] * 3 + [(0.3, 0.1)] * 3, 0.05, True)
    found = []
    for _ in range(2):
        talk.run(periods=80)
        torques = []
        for k in range(80):
            step = talk.step([100 + k % 7, k % 3])
            torques.append(step.torque.tobytes())
        found.append(torques)
        while talk.step([100, -3]).enabled:
            pass
        assert talk.say("reset") == "done"
        assert talk.state() == {"state": "idle", "reason": "none", "joint": 0, "enabled": 0, "period": 80, "code": 0}
    assert found[0] == found[1]


def test_reset_waits_for_the_drives(talk: Talk) -> None:
    talk.ready().run()
    talk.step()
    assert talk.say("stop") == "done"
    for _ in range(SAFETY["damping"]):
        assert talk.say("reset") == "state"
        assert talk.step().enabled
    assert not talk.step().enabled
    assert talk.say("reset") == "done"


def test_counters_of_an_encoder_may_overflow(talk: Talk) -> None:
    zero = 2**31 - 20
    talk.settings(zero=[zero, -(2**31) + 5])
    talk.upload([(0.0, 0.0)] * 3 + [(0.1, -0.1)] * 3, 0.1, False)
    talk.counts = [zero, -(2**31) + 5]
    talk.run()
    for k in range(100):
        step = talk.step([zero + k, -(2**31) + 5 - k])
        record = step.report("telemetry")
        assert record is not None
        assert talk.reasons[record["reason"]] == "none"
    assert step.enabled


# --- what stops the arm ---

SLOW = [(0.0, 0.0)] * 3 + [(1.0, 0.0)] * 3


def moving(talk: Talk, **changed: Any) -> None:
    """Running, twenty steps on, joint 1 at 1 count a step."""
    talk.settings(**changed)
    talk.upload(SLOW, 2.0)
    talk.run()
    for k in range(20):
        step = talk.step([100 + k, -3 + k])
        record = step.report("telemetry")
        assert record is not None
        assert talk.reasons[record["reason"]] == "none"


def moved(talk: Talk, first: int, second: int) -> list[int]:
    return [talk.counts[0] + first, talk.counts[1] + second]


def told(talk: Talk, step: Step, reason: str, joint: int) -> None:
    """The step's own record, and the report after it, name the reason."""
    record, state = step.report("telemetry"), step.report("state")
    assert record is not None
    assert state is not None
    names = [m.name for m in step.reports]
    assert names.index("telemetry") < names.index("state")
    assert talk.reasons[record["reason"]] == talk.reasons[state["reason"]] == reason
    assert state["joint"] == joint
    assert state["period"] == record["period"]
    assert step.report("counters") is not None


def soon(talk: Talk, counts: Sequence[int]) -> Step:
    """The step in which something is observed that is looked at in turn."""
    for _ in range(N):
        step = talk.step(counts)
        if step.report("state") is not None:
            break
    return step


def damped(talk: Talk, step: Step, qd: Sequence[float]) -> None:
    """Torque against the motion for as long as it was asked for, then none and the drives off."""
    kd, limit, gain = np.array(DRIVE["kd"]), np.array(DRIVE["torque_limit"]), DRIVE["velocity_gain"]
    rate = np.array(qd, dtype=float)
    for k in range(SAFETY["damping"]):
        if k:
            step = talk.step()
            rate = rate - gain * rate
        assert step.enabled
        assert step.torque == pytest.approx(np.clip(-kd * rate, -limit, limit), rel=1e-5, abs=1e-6)
    for _ in range(3):
        step = talk.step(moved(talk, 5, 5))
        assert not step.enabled
        assert not step.torque.any()


def without_torque(talk: Talk, step: Step) -> None:
    for _ in range(3):
        assert not step.enabled
        assert not step.torque.any()
        step = talk.step(moved(talk, 3, 3))


def rates(first: int, second: int) -> list[float]:
    """After twenty steps of a count each and one of these, filtered."""
    gain, each = DRIVE["velocity_gain"], PER_COUNT * DRIVE["rate"]
    before = each * (1 - (1 - gain) ** 19)
    return [before + gain * (each * last - before) for last in (first, second)]


def test_done(talk: Talk) -> None:
    talk.settings()
    talk.upload(SLOW, 2.0)
    talk.run(periods=20)
    for k in range(20):
        assert talk.step([100 + k, -3 + k]).report("state") is None
    step = talk.step(moved(talk, 1, 1))
    told(talk, step, "done", 0)
    damped(talk, step, rates(1, 1))


def test_stopped_by_the_host(talk: Talk) -> None:
    moving(talk)
    assert talk.say("stop") == "done"
    assert talk.reasons[talk.report("state")["reason"]] == "host"
    assert talk.report("state")["period"] == 20
    damped(talk, talk.step(moved(talk, 1, 1)), rates(1, 1))


def test_the_torque_limit_holds_for_the_damping(talk: Talk) -> None:
    moving(talk, speed=[1e9] * N, tracking=[9.0] * N)
    step = talk.step(moved(talk, 100, -150))
    assert talk.say("stop") == "done"
    step = talk.step(moved(talk, 100, -150))
    assert step.torque.tolist() == [-DRIVE["torque_limit"][0], DRIVE["torque_limit"][1]]
    assert talk.step().torque[1] == pytest.approx(27, abs=1)


@pytest.mark.parametrize("silence", [1, 7])
def test_silence(talk: Talk, silence: int) -> None:
    talk.settings(silence=silence)
    talk.upload()
    assert talk.say("arm") == "done"
    assert talk.say("run", {"periods": 0, "every": 1}) == "done"
    for _ in range(silence):
        assert talk.step().report("state") is None
    assert talk.say("alive") == "done"
    for _ in range(silence):
        assert talk.step().report("state") is None
    told(talk, talk.step(), "link_lost", 0)


def test_silence_while_armed(talk: Talk) -> None:
    talk.settings(silence=5)
    talk.upload()
    assert talk.say("arm") == "done"
    steps = [talk.step() for _ in range(6)]
    assert [step.report("state") is None for step in steps] == [True] * 5 + [False]
    told(talk, steps[-1], "link_lost", 0)


@pytest.mark.parametrize("noise", [b"\x05\x01\0", b"\x01\x01\0", b"\x07\x01\x02\x03\x04\x05\x06\x07\x08\0"])
def test_too_much_noise(talk: Talk, noise: bytes) -> None:
    moving(talk)
    for _ in range(SAFETY["errors"]):
        assert talk.raw(noise) == []
    found = talk.raw(noise)
    assert [talk.reasons[m.values["reason"]] for m in found if m.name == "state"] == ["corrupted"]
    damped(talk, talk.step(moved(talk, 1, 1)), rates(1, 1))


def test_noise_before_the_run_does_not_count(talk: Talk) -> None:
    talk.ready()
    for _ in range(10):
        talk.raw(b"\x05\x01\0")
    talk.run()
    assert talk.step().report("state") is None
    assert talk.raw(b"\x05\x01\0") == []


def test_too_many_out_of_sequence(talk: Talk) -> None:
    moving(talk)
    after = talk.sequence
    for k in range(SAFETY["errors"] + 1):
        assert talk.say("alive", sequence=after + 100 + k) == "sequence"
    assert talk.reasons[talk.report("state")["reason"]] == "sequence"
    damped(talk, talk.step(moved(talk, 1, 1)), rates(1, 1))


def test_a_torque_that_is_no_number(talk: Talk) -> None:
    """Values that are finite each, but not together."""
    wide = dict.fromkeys(("tracking", "speed", "high"), [3e38] * N)
    talk.settings(**wide, low=[-3e38] * N, torque_limit=[3e38] * N)
    assert talk.say("parameters", dict.fromkeys(talk.codec.fields("parameters"), 3e38)) == "done"
    talk.upload([(0.0, 0.0)] * 3 + [(1.0, 3e38)] * 3, 0.02, True)
    talk.run()
    for _ in range(40):
        step = talk.step()
        if step.report("state") is not None:
            break
    told(talk, step, "not_finite", step.report("state")["joint"])
    without_torque(talk, step)


def test_no_number_in_the_first_step(talk: Talk) -> None:
    """Of which it is not asked whether it is near the start."""
    talk.settings(**dict.fromkeys(("tracking", "speed", "high", "torque_limit"), [3e38] * N), low=[-3e38] * N)
    assert talk.say("parameters", dict.fromkeys(talk.codec.fields("parameters"), 3e38)) == "done"
    talk.upload([(1.0, 3e38)] + [(3e38, -3e38)] * 4, 0.002, True)
    talk.run()
    step = talk.step()
    told(talk, step, "not_finite", step.report("state")["joint"])
    without_torque(talk, step)


@pytest.mark.parametrize("joint", [1, 2])
def test_tracking(talk: Talk, joint: int) -> None:
    """Exactly at the limit it runs on; beyond it by one unit in the last place it stops."""
    counts = [100, -3]
    counts[joint - 1] += 64
    error = 64 * PER_COUNT
    for limit, stops in ((error, False), (float(np.nextafter(np.float32(error), np.float32(0))), True)):
        one = Talk(talk.directory, ARM.name)
        one.ready(tracking=[limit if k == joint else 9.0 for k in (1, 2)], speed=[1e9] * N)
        one.run()
        one.step()
        step = one.step(counts)
        assert (step.report("state") is not None) == stops
        if stops:
            told(one, step, "tracking", joint)
            raw = [0.0, 0.0]
            raw[joint - 1] = 64 * PER_COUNT * 1000 * DRIVE["velocity_gain"]
            damped(one, step, raw)


@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_speed(talk: Talk, joint: int, sign: int) -> None:
    exact = 8 * PER_COUNT * 1000 * DRIVE["velocity_gain"]
    counts = [100, -3]
    counts[joint - 1] += 8 * sign
    for limit, stops in ((exact, False), (float(np.nextafter(np.float32(exact), np.float32(0))), True)):
        one = Talk(talk.directory, ARM.name)
        one.ready(speed=[limit if k == joint else 1e9 for k in (1, 2)])
        one.run()
        # A joint is looked at every other period: the second one in the first step after the begin of the run.
        for _ in range(N + 1 - joint):
            one.step()
        step = one.step(counts)
        assert (step.report("state") is not None) == stops
        if stops:
            told(one, step, "speed", joint)


def test_speed_while_armed(talk: Talk) -> None:
    talk.ready(speed=[1.0, 3.0])
    assert talk.say("arm") == "done"
    talk.step()
    assert talk.step(moved(talk, 2, 0)).report("state") is None
    step = talk.step(moved(talk, 0, 7))
    told(talk, step, "speed", 2)
    damped(talk, step, [0.5 * 2 * PER_COUNT * 500, 7 * PER_COUNT * 500])


@pytest.mark.parametrize(
    ("low", "high", "to"), [(-0.25, 9.0, -0.25), (-9.0, 0.25, 0.25), (0.0, 0.0, 0.0), (-0.0, -0.0, 0.0)]
)
def test_position(talk: Talk, low: float, high: float, to: float) -> None:
    """Ends included."""
    talk.ready(low=[low, -9.0], high=[high, 9.0], speed=[1e9] * N, jump=[1000] * N)
    talk.run()
    talk.step()
    end = 100 + round(to / PER_COUNT)
    assert talk.step([end, -3]).report("state") is None
    assert talk.step([end, -3]).report("state") is None
    told(talk, soon(talk, [end + (1 if to == high else -1), -3]), "position", 1)


@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize("before", range(2 * N))
def test_every_joint_is_looked_at_within_as_many_periods_as_there_are(talk: Talk, joint: int, before: int) -> None:
    talk.ready(high=[0.25, 0.25], speed=[1e9] * N, jump=[1000] * N)
    talk.run()
    for _ in range(1 + before):
        talk.step()
    counts = [100, -3]
    counts[joint - 1] += 257
    told(talk, soon(talk, counts), "position", joint)


@pytest.mark.parametrize("name", ["r", "rrprrrr"])
def test_arms_of_one_and_of_seven_joints_are_looked_at_within_five_periods(name: str) -> None:
    arm = wide(MIXED[name])
    n, directory = len(arm.joints), prepare.prepare_firmware(arm, LIBRARY)
    for joint in range(1, n + 1):
        for before in range(5):
            talk = Talk(directory, arm.name, n)
            talk.ready(high=[0.25], speed=[1e9], jump=[1000])
            talk.run()
            for _ in range(1 + before):
                assert talk.step().report("state") is None
            counts = list(talk.counts)
            counts[joint - 1] += 257
            states = [state for _ in range(5) if (state := talk.step(counts).report("state")) is not None]
            assert [talk.reasons[state["reason"]] for state in states[:1]] == ["position"]
            assert states[0]["joint"] == joint


@given(st.floats(-3.0, 3.0, width=32), st.floats(0.0, 3.0, width=32), st.integers(-4000, 4000))
def test_a_range_in_whole_counts(directory: Path, low: float, wide: float, counts: int) -> None:
    """Within the range of the message to the last count; of what no count lies in, one remains."""
    high, per_count = float(np.float32(low + wide)), float(np.float32(0.0011))
    talk = Talk(directory, ARM.name)
    free = dict.fromkeys(("speed", "start", "frozen"), [1e6] * N)
    talk.settings(
        low=[low, -9.0], high=[high, 9.0], position_per_count=[per_count] * N, zero=[0, 0], jump=[9000] * N, **free
    )
    talk.upload([[counts * per_count, 0.0]] * 5)
    talk.counts = [counts, 0]
    talk.run()
    first, last = ceil(low / per_count - 1e-4), floor(high / per_count + 1e-4)
    stops = talk.step().report("state") is not None
    if counts < first - 1 or counts > max(first, last) + 1:
        assert stops
    if first + 1 <= counts <= last - 1:
        assert not stops


def test_a_torque_at_its_limit_for_too_long(talk: Talk) -> None:
    talk.ready(torque_limit=[1000.0, 1e-3], saturated=5)
    talk.run()
    for _ in range(5):
        assert talk.step([100, 30]).report("state") is None
    step = talk.step([100, 30])
    told(talk, step, "torque_limit", 2)


def test_an_encoder_that_does_not_count(talk: Talk) -> None:
    """Within as many periods as there are joints."""
    talk.settings(frozen=[9.0, 0.25], tracking=[9.0] * N)
    talk.upload([(0.0, k / 4) for k in range(5)], 0.1)
    talk.run()
    for k in range(60):
        step = talk.step([100 + k % 2, -3])
        if step.report("state") is not None:
            break
    record = step.report("telemetry")
    assert record is not None
    assert 0.25 < record["q_desired"][1] < 0.25 + (N + 1) * 0.01
    told(talk, step, "encoder_frozen", 2)
    without_torque(talk, step)


def test_an_encoder_that_counts_now_and_then_is_not_frozen(talk: Talk) -> None:
    talk.settings(frozen=[0.05, 9.0], tracking=[9.0] * N, saturated=1000)
    talk.upload([(k / 4, 0.0) for k in range(5)], 0.2)
    talk.run()
    for k in range(200):
        assert talk.step([100 + k // 4, -3]).report("state") is None


@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_an_encoder_that_jumps(talk: Talk, joint: int, sign: int) -> None:
    moving(talk, speed=[1e9] * N, tracking=[99.0] * N, low=[-99.0] * N, high=[99.0] * N)
    jump = [0, 0]
    jump[joint - 1] = sign * SAFETY["jump"][0]
    assert talk.step(moved(talk, *jump)).report("state") is None
    jump[joint - 1] += sign
    step = talk.step(moved(talk, *jump))
    told(talk, step, "encoder_jump", joint)
    without_torque(talk, step)


@pytest.mark.parametrize("state", ["armed", "running"])
@pytest.mark.parametrize(("kept", "untimely"), [(1500, 1501), (500, 499), (1000, 0)])
def test_a_period_that_is_not_kept(talk: Talk, state: str, kept: int, untimely: int) -> None:
    """Missed, or a timer that is too fast, or a clock that stands still: the trajectory would go by too fast and every
    rate be taken for less than it is."""
    brought_to(talk, state)
    for _ in range(3):
        talk.step()
    assert talk.step(us=kept).report("state") is None
    step = talk.step(us=untimely)
    told(talk, step, "watchdog", 0)
    damped(talk, step, [0.0, 0.0])


def test_a_longest_period_below_the_shortest_is_refused(talk: Talk) -> None:
    assert talk.say("safety", {**SAFETY, "early": 1501}) == "out_of_range"
    assert talk.detail == 7 * N + 4
    assert talk.say("safety", {**SAFETY, "early": 1500}) == "done"


def test_after_a_missed_period_the_damping_goes_by_the_last_rate(talk: Talk) -> None:
    """What was counted over several periods is no rate."""
    moving(talk)
    step = talk.step(moved(talk, 50, 50), us=50_000)
    told(talk, step, "watchdog", 0)
    each = PER_COUNT * 1000 * (1 - 0.5**19)
    damped(talk, step, [each, each])


def test_a_period_missed_in_the_damping(talk: Talk) -> None:
    """What was counted meanwhile is no rate; the last one is good for one step, and is not held for a second."""
    moving(talk, damping=20)
    assert talk.say("stop") == "done"
    first, gap, next_ = talk.step(moved(talk, 1, 1)), talk.step(moved(talk, 30, 30), us=30_000), talk.step()
    each = PER_COUNT * 1000
    assert first.torque[0] == pytest.approx(-2 * each, rel=1e-4)
    assert gap.torque.tolist() == first.torque.tolist()
    assert next_.torque[0] == pytest.approx(-each, rel=1e-4), "half as fast, by a joint that stands"
    assert talk.step(us=0).enabled
    without_torque(talk, talk.step(us=0))


def test_the_clock_goes_round(talk: Talk) -> None:
    talk.time_us = 2**32 - 10_500
    talk.ready().run()
    for _ in range(30):
        assert talk.step().report("state") is None


@pytest.mark.parametrize(
    ("counts", "us", "reason"), [(5000, 1000, "encoder_jump"), (0, 50_000, "watchdog"), (0, 0, "watchdog")]
)
def test_nothing_is_overlooked_between_arm_and_run(talk: Talk, counts: int, us: int, reason: str) -> None:
    wide = dict.fromkeys(("start", "tracking", "speed", "high"), [1e9] * N)
    talk.ready(**wide, low=[-1e9] * N).run()
    told(talk, talk.step(moved(talk, counts, 0), us), reason, int(counts > 0))


def test_a_run_begins_with_the_rate_that_the_arm_has(talk: Talk) -> None:
    talk.ready(start=[0.5] * N)
    assert talk.say("arm") == "done"
    for _ in range(20):
        talk.step(moved(talk, 5, 0))
    assert talk.say("run", {"periods": 0, "every": 1}) == "done"
    talk.step(moved(talk, 5, 0))
    assert talk.say("stop") == "done"
    assert talk.step(moved(talk, 5, 0)).torque[0] == pytest.approx(-2 * 5 * PER_COUNT * 1000, rel=1e-4)


@pytest.mark.parametrize("run", [False, True])
def test_a_stop_before_the_first_step_leaves_the_drives_off(talk: Talk, run: bool) -> None:
    talk.ready().step()
    assert talk.say("arm") == "done"
    assert not run or talk.say("run", {"periods": 0, "every": 1}) == "done"
    assert talk.say("stop") == "done"
    assert talk.report("state")["enabled"] == 0
    steps = [talk.step(moved(talk, 1, 1)) for _ in range(5)]
    assert not any(step.enabled or step.torque.any() for step in steps)
    assert [step.report("telemetry") is None for step in steps] == [False] + [True] * 4
    assert talk.say("reset") == "done"


def test_standing_elsewhere_than_the_trajectory_starts(talk: Talk) -> None:
    away = round(SAFETY["start"][1] / PER_COUNT)
    for distance, stops in ((away, False), (away + 1, True), (-away, False), (-away - 1, True)):
        one = Talk(talk.directory, ARM.name)
        one.ready()
        one.counts = [100, -3 + distance]
        one.run()
        step = one.step()
        assert (step.report("state") is not None) == stops
        if stops:
            told(one, step, "start_position", 2)
            damped(one, step, [0.0, 0.0])


@pytest.mark.parametrize("state", ["armed", "running"])
def test_a_fault_of_a_drive(talk: Talk, state: str) -> None:
    brought_to(talk, state)
    talk.step()
    step = talk.step(fault=0xDEADBEEF)
    told(talk, step, "drive", 0)
    assert step.report("state")["code"] == 0xDEADBEEF
    without_torque(talk, step)


def test_drives_that_need_time(talk: Talk, table: dict[str, Any]) -> None:
    """From before they are powered; as a fault, it counts once the arm runs."""
    late = table["not_ready"]
    talk.ready().step(fault=late)
    assert talk.say("arm") == "done"
    assert talk.say("run", {"periods": 0, "every": 1}) == "not_ready"
    for _ in range(50):
        step = talk.step(fault=late)
        assert step.enabled
        assert not step.torque.any()
        assert step.report("state") is None
    assert talk.say("run", {"periods": 0, "every": 1}) == "not_ready"
    talk.step()
    assert talk.say("run", {"periods": 0, "every": 1}) == "done"
    talk.step()
    step = talk.step(fault=late)
    told(talk, step, "drive", 0)
    assert step.report("state")["code"] == late
    without_torque(talk, step)


def test_drives_that_do_not_become_ready_are_switched_off_by_a_stop(talk: Talk, table: dict[str, Any]) -> None:
    talk.ready().step(fault=table["not_ready"])
    assert talk.say("arm") == "done"
    talk.step(fault=table["not_ready"])
    assert talk.say("stop") == "done"
    step = talk.step(moved(talk, 1, 1), fault=table["not_ready"])
    without_torque(talk, step)


@pytest.mark.parametrize("jump", [True, False])
def test_damping_ends_where_it_cannot_be_trusted(talk: Talk, jump: bool) -> None:
    moving(talk)
    assert talk.say("stop") == "done"
    assert talk.step(moved(talk, 1, 1)).torque.any()
    step = talk.step(moved(talk, 500, 1)) if jump else talk.step(moved(talk, 1, 1), fault=1)
    without_torque(talk, step)
    assert talk.state()["reason"] == "host"


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("limit", "at_stop", "most"), [(4.0, 0.9766, 4.0), (0.5, 0.9766, 1.25 * 0.9766), (0.5, 0.0, 0.5)]
)
def test_damping_that_drives_ends(talk: Talk, sign: int, limit: float, at_stop: float, most: float) -> None:
    """A joint that gets faster than its limit, and than it was: a sign is wrong."""
    talk.settings(speed=[9.0] * N, damping=1000)
    assert talk.say("safety", {**SAFETY, "speed": [9.0, limit], "damping": 1000}) == "done"
    talk.upload()
    assert talk.say("arm") == "done"
    talk.step()
    rate, gain, each = 0.0, DRIVE["velocity_gain"], PER_COUNT * DRIVE["rate"]
    if at_stop:
        while rate < min(limit, 0.99 * at_stop):
            step = talk.step(moved(talk, 0, sign))
            rate += gain * (each - rate)
    if at_stop < limit:
        assert talk.say("stop") == "done"
    else:
        told(talk, step, "speed", 2)
        most = max(limit, 1.25 * rate)
    for k in range(200):
        counts = 1 if k % 8 else 1 + k // 16
        rate += gain * (counts * each - rate)
        step = talk.step(moved(talk, 0, sign * counts))
        assert step.enabled == (rate <= most)
        assert (step.torque[1] * sign < 0) == step.enabled
        if not step.enabled:
            break
    without_torque(talk, step)


def test_a_second_stop_ends_the_damping(talk: Talk) -> None:
    moving(talk)
    assert talk.say("stop") == "done"
    assert talk.step(moved(talk, 1, 1)).torque.any()
    assert talk.say("stop") == "done"
    without_torque(talk, talk.step(moved(talk, 1, 1)))


def test_a_stop_that_is_said_again_is_the_same_one(talk: Talk) -> None:
    """Also where another command came in between; and its number is not the last one then."""
    moving(talk)
    assert talk.say("stop") == "done"
    number = talk.sequence
    step = talk.step(moved(talk, 1, 1))
    assert talk.say("alive") == "done"
    assert talk.say("stop", sequence=number) == "done"
    talk.sequence = number + 1
    assert talk.say("query") == "done"
    assert talk.report("counters")["duplicates"] == 1
    for _ in range(SAFETY["damping"] - 1):
        step = talk.step(moved(talk, 1, 1))
        assert step.torque.any()
    assert not talk.step().enabled


def test_a_stop_after_one_of_the_boards_own_is_the_first(talk: Talk) -> None:
    moving(talk)
    told(talk, talk.step(moved(talk, 1, 1), us=5000), "watchdog", 0)
    assert talk.say("stop") == "done"
    assert talk.step(moved(talk, 1, 1)).torque.any()
    assert talk.state()["reason"] == "watchdog"
    assert talk.say("stop") == "done"
    without_torque(talk, talk.step(moved(talk, 1, 1)))


def test_the_number_of_an_old_stop_stops_a_new_run(talk: Talk) -> None:
    brought_to(talk, "running")
    talk.step()
    assert talk.say("stop", sequence=77) == "done"
    for _ in range(SAFETY["damping"] + 1):
        talk.step()
    assert talk.say("reset") == "done"
    talk.run()
    talk.step()
    assert talk.say("stop", sequence=77) == "done"
    assert talk.state()["state"] == "stopped"


def test_every_reason_is_tested_here(table: dict[str, Any]) -> None:
    text = Path(__file__).read_text()
    assert [r["name"] for r in table["reasons"] if f'"{r["name"]}"' not in text] == []


# --- anything, in any order ---


class Anything(RuleBasedStateMachine):
    """Commands, steps and noise in any order, beside a few sentences of what must hold."""

    directory: Path

    @initialize(ready=st.booleans())
    def start(self, ready: bool) -> None:
        self.talk = Talk(self.directory, ARM.name)
        self.state, self.reason, self.enabled = 0, 0, 0
        self.fresh, self.rate, self.at_stop = True, np.zeros(N), np.zeros(N)
        if ready:
            self.talk.ready(silence=60, errors=2)

    def note(self, reports: Sequence[Any]) -> None:
        for message in reports:
            if message.name == "state":
                after = message.values
                assert (self.state, after["state"]) in {
                    *((k, k) for k in range(4)), (0, 1), (1, 2), (1, 3), (2, 3), (3, 0), (0, 3),
                }  # fmt: skip
                if self.state != 3:
                    self.at_stop = np.abs(self.rate)
                self.state, self.reason, self.enabled = after["state"], after["reason"], after["enabled"]
                assert (self.reason == 0) == (self.state != 3)
                assert self.enabled == 1 or self.state in (0, 3)

    @rule(data=st.data())
    def command(self, data: st.DataObject) -> None:
        name = data.draw(
            st.sampled_from(["arm", "arm", "run", "run", "alive", "stop", "reset", "reset", "query", "drive", "points"])
        )
        values = values_of(self.talk, name)
        if name == "run":
            values = {"periods": data.draw(st.integers(0, 9)), "every": 1}
        before = self.state
        result = self.talk.say(name, values)
        self.fresh = self.fresh or (name == "arm" and result == "done")
        self.note(self.talk.reports)
        if result != "done":
            assert self.state == before

    @rule(data=st.binary(max_size=20))
    def noise(self, data: bytes) -> None:
        self.note(self.talk.raw(data + b"\0"))

    @rule(offset=st.integers(-50, 50))
    def out_of_sequence(self, offset: int) -> None:
        after = self.talk.sequence
        result = self.talk.say("alive", sequence=after + 5 + abs(offset))
        assert result == "sequence"
        self.note(self.talk.reports)
        self.talk.sequence = after

    @rule(
        first=st.integers(-3, 3),
        second=st.one_of(st.integers(-3, 3), st.integers(-(2**31), 2**31 - 1)),
        us=st.sampled_from([1000] * 30 + [0, 499, 1501, 2**31]),
        fault=st.sampled_from([0] * 40 + [5]),
    )
    def step(self, first: int, second: int, us: int, fault: int) -> None:
        self.advance([first, second], us, fault)

    def advance(self, travel: Sequence[int], us: int = 1000, fault: int = 0) -> Step:
        before, were, fresh = self.state, self.enabled, self.fresh
        untimely = not fresh and not SAFETY["early"] <= us <= SAFETY["late"]
        self.measure(travel, untimely)
        step = self.talk.step(moved(self.talk, *travel), us, fault)
        self.note(step.reports)
        assert step.enabled == bool(self.enabled)
        limit = np.array(DRIVE["torque_limit"], dtype=np.float32)
        assert (np.abs(step.torque) <= limit).all()
        if self.state == 3 and step.enabled:
            expected = np.clip(-np.array(DRIVE["kd"]) * self.rate, -limit, limit)
            assert step.torque == pytest.approx(expected, rel=1e-4, abs=1e-4)
            assert (np.abs(self.rate) <= 1.0001 * np.maximum(1.25 * self.at_stop, SAFETY["speed"])).all()
        elif self.state != 2:
            assert not step.torque.any()
        if fault or untimely:
            assert before in (0, 3) or self.state == 3
        if fault:
            assert not (before == 3 and were) or not step.enabled
        return step

    def measure(self, travel: Sequence[int], untimely: bool) -> None:
        """The rates that the board has, where it looks."""
        if self.state in (1, 2) or self.enabled:
            if self.fresh:
                self.rate = np.zeros(N)
            elif not untimely:
                self.rate = self.rate + DRIVE["velocity_gain"] * (np.array(travel) * PER_COUNT * 1000 - self.rate)
            self.fresh = False

    @precondition(lambda self: self.state == 3)
    @rule()
    def wait(self) -> None:
        """Stopped drives go off in so many periods."""
        for _ in range(SAFETY["damping"] + 1):
            step = self.advance([0, 0])
        assert not step.enabled
        assert self.talk.say("reset") == "done"
        self.note(self.talk.reports)
        assert self.state == 0


@pytest.mark.usefixtures("directory")
def test_anything_in_any_order(directory: Path) -> None:
    from hypothesis.stateful import run_state_machine_as_test

    Anything.directory = directory
    run_state_machine_as_test(Anything, settings=settings(max_examples=60, stateful_step_count=40, deadline=None))


def every_piece(data: bytes) -> Iterator[bytes]:
    yield from (data[k : k + 1] for k in range(len(data)))


def test_bytes_in_any_pieces(talk: Talk) -> None:
    """Byte by byte, with steps in between, as a serial line brings them."""
    stream = b"".join(
        talk.codec.encode(name, values_of(talk, name), k) for k, name in enumerate(["hello", "drive", "safety"], 1)
    )
    answers = []
    for piece in every_piece(b"\0\0" + stream):
        answers += [m for m in talk.raw(piece) if m.name == "ack"]
        talk.step()
    assert [talk.results[m.values["result"]] for m in answers] == ["done"] * 3
