"""A board that says what cannot be, or never ends: the host stops it with a reason that has a name, keeps what was
recorded, and hangs nowhere. Its frames are whole: what they say is not."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_arm import THERE_AND_BACK, trajectory
from driven import Rig, rig
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from runtime.execution import trial as trials
from runtime.execution.trial import Trial
from runtime.hardware.conversation import Refused, Statements, Untrusted
from runtime.hardware.link import Codec, LinkLost, ReceivedMessage
from runtime.model.loader import Model
from runtime.workspace.source import Source

PLAN = trajectory(THERE_AND_BACK)
AT = 300
"""The control period of a run from which on the board lies."""
PERIODS = 1400
Change = Callable[[dict[str, Any]], dict[str, Any]]


class Liar:
    """Reports of some messages, changed and framed anew; the rest as it is."""

    def __init__(self, codec: Codec, changes: Mapping[str, Change], when: Callable[[], bool] = lambda: True) -> None:
        self.codec, self.changes, self.when = codec, changes, when

    def __call__(self, frame: bytes) -> list[bytes]:
        message = self.codec.decode(frame[:-1])
        if isinstance(message, str) or message.name not in self.changes or not self.when():
            return [frame]
        changed = self.changes[message.name](dict(message.values))
        return [self.codec.encode(message.name, changed, message.sequence)]


def always(**changed: Any) -> Change:
    return lambda values: values | changed


@pytest.fixture
def make(bench: Source, arm: Model) -> Iterator[Callable[..., Rig]]:
    made: list[Rig] = []

    def on(**others: Any) -> Rig:
        made.append(rig(arm, bench.compiled.controller(), PLAN, **others))
        return made[-1]

    yield on
    for one in made:
        one.session.close()


def lying(make: Callable[..., Rig], **changes: Change) -> Rig:
    """Honest until the period AT of its run."""
    one = make().prepared()
    one.link.to_host = Liar(one.session.codec, changes, lambda: one.arm.period >= AT)
    return one


LIES = {
    "state number 77": {"telemetry": always(state=77)},
    "reason number 99": {"telemetry": always(reason=99)},
    "torque of joint 1 is not finite": {"telemetry": always(torque=(nan,))},
    "q_desired of joint 1 is not finite": {"telemetry": always(q_desired=(-inf,))},
    "torque 1e\\+09 at joint 1, over its limit": {"telemetry": always(torque=(1e9,))},
    "torque 1 at joint 1 in state armed": {"telemetry": always(state=1, torque=(1.0,))},
    "state running with reason tracking": {"telemetry": always(reason=7)},
    "state stopped with reason none": {"telemetry": always(state=3)},
}


@pytest.mark.parametrize("words", LIES)
def test_telemetry_that_cannot_be_stops_the_arm(make: Callable[..., Rig], clean: Trial, words: str) -> None:
    one = lying(make, **LIES[words])
    found = one.run()
    assert found.stop is not None
    assert found.stop.name == "untrusted"
    assert re.search(words, found.stop.reason), found.stop.reason
    assert found.stop.reason.startswith(trials.HOST["untrusted"])
    np.testing.assert_array_equal(found.q[:, : AT - 5], clean.q[:, : AT - 5])
    assert AT - 5 < len(found.t) < AT + 10
    one.check_safe(AT)


@pytest.mark.parametrize(
    "changed", [{"state": 9}, {"reason": 200}, {"joint": 200}, {"enabled": 7}, {"state": 2, "enabled": 1, "reason": 1}]
)
def test_a_last_word_that_cannot_be(make: Callable[..., Rig], changed: dict[str, int]) -> None:
    """The recording is whole by then; what the board says of its end is not."""
    one = make().prepared()
    one.link.to_host = Liar(one.session.codec, {"state": always(**changed)})
    found = one.run()
    assert found.stop is not None
    assert found.stop.name == "untrusted"
    assert len(found.t) <= PERIODS
    assert not one.arm.powered


def endless(make: Callable[..., Rig]) -> Rig:
    """A board that takes no end from the host's `run`, and says `running` for ever."""
    one = make().prepared()
    encode = one.session.codec.encode

    def without_end(name: str, values: Any = None, sequence: int = 0) -> bytes:
        return encode(name, {**values, "periods": 0} if name == "run" else values, sequence)

    one.session.codec.encode = without_end  # type: ignore[method-assign]
    return one


def test_a_board_that_runs_on_is_stopped_after_the_plan(make: Callable[..., Rig], clean: Trial) -> None:
    one = endless(make)
    found = one.run()
    assert found.stop is not None
    assert found.stop.name == "overrun"
    assert f"{PERIODS} periods were planned" in found.stop.reason
    assert PERIODS <= len(found.t) < PERIODS + 10
    np.testing.assert_array_equal(found.q[:, :PERIODS], clean.q)
    assert not one.arm.powered


def test_a_board_whose_time_stands_still_is_stopped_by_that_of_the_link(make: Callable[..., Rig]) -> None:
    """Always the same period, which is no gap."""
    one, first = endless(make), dict[str, Any]()

    def again(values: dict[str, Any]) -> dict[str, Any]:
        return first.setdefault("of the run", values) if values["state"] == 2 else values

    codec = one.session.codec
    one.link.to_host = Liar(codec, {"telemetry": again})
    found = one.run()
    assert found.stop is not None
    assert found.stop.name == "overrun"
    assert len(found.t) == 1
    assert one.arm.period < 2 * PERIODS + 2000
    assert not one.arm.powered


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"max_phases": 0}, "the board has room for 0 and 256; play a shorter motion"),
        ({"max_rows": 3}, "the board has room for 16 and 3; play a shorter motion"),
        ({"joints": 7}, "of another arm or another version"),
        ({"state": 33}, "state number 33"),
        ({"reason": 33}, "reason number 33"),
        ({"version": 9, "state": 33}, "version 9 of the protocol"),
    ],
)
def test_an_identity_that_cannot_be_is_refused(make: Callable[..., Rig], changed: dict[str, int], words: str) -> None:
    one = make()
    one.link.to_host = Liar(one.session.codec, {"identity": always(**changed)})
    with pytest.raises((Refused, Untrusted), match=words):
        one.prepared()
    assert not one.arm.powered


def test_a_board_with_lower_ceilings_than_its_model_file_is_refused(make: Callable[..., Rig]) -> None:
    one = make()
    # In the answer to `drive`, whose sixth value is its joint's torque limit.
    number = one.session.codec.number("drive")
    one.link.to_host = Liar(
        one.session.codec, {"ack": lambda v: v | {"detail": 7 if v["type"] == number else v["detail"]}}
    )
    with pytest.raises(Refused, match=r"lower ceiling for torque_limit \(drive\)"):
        one.prepared()


def test_a_host_keeps_to_the_ceilings_by_itself(make: Callable[..., Rig]) -> None:
    """So that no limit that it names is one that the board does not keep."""
    one = make(tracking=1e300).prepared()
    ceilings = one.session.codec.document["ceilings"]
    assert one.settings.safety["tracking"] == ceilings["tracking"]
    for name in ("torque_limit", "kp", "kd"):
        assert (np.array(one.settings.drive[name]) <= ceilings[name]).all()
    for name in ("speed", "silence", "late"):
        assert (np.array(one.settings.safety[name]) <= ceilings[name]).all()


def test_what_an_honest_board_says_is_believed(make: Callable[..., Rig]) -> None:
    one = make()
    one.driven()
    assert one.session.impossible is None


def test_words_for_every_reason_of_the_host() -> None:
    assert {"overrun", "untrusted"} <= set(trials.HOST)


# --- host and board against each other ---


class Against(RuleBasedStateMachine):
    """A session and the firmware's machine, with somebody between them who says what neither has said.

    Whatever is said, a call of the session ends in time by its link's clock, gives a run or raises what a user is told
    in words; the arm's torques stay within the ceilings; and after a run that was stopped the drives go off.
    """

    model: Model
    directory: Path

    @initialize()
    def begin(self) -> None:
        self.one = rig(self.model, self.directory, PLAN)
        q = self.one.settings.points[0].astype(np.float64)
        self.one.lockstep.start(q, np.random.default_rng(1))
        self.codec = self.one.session.codec
        self.numbers = Statements(self.codec)
        self.ceilings = np.array(self.codec.document["ceilings"]["torque_limit"])
        self.change: Callable[[ReceivedMessage], list[bytes]] | None = None
        self.left, self.known = 0, False
        self.one.link.to_host = self.between

    def between(self, frame: bytes) -> list[bytes]:
        message = self.codec.decode(frame[:-1])
        if self.change is None or isinstance(message, str) or self.one.arm.period < self.left:
            return [frame]
        return self.change(message)

    def within(self, seconds: float, call: Callable[[], Any]) -> Any:
        """A call of the session, which ends in so many s of its link."""
        begun = self.one.link.now()
        try:
            return call()
        except (Refused, Untrusted, LinkLost):
            return None
        finally:
            assert self.one.link.now() - begun < seconds

    @rule(data=st.data(), periods=st.integers(0, 120), name=st.sampled_from(["telemetry", "state", "identity", "ack"]))
    def lies(self, data: st.DataObject, periods: int, name: str) -> None:
        """One field of a report, from some period of the run on."""
        fields = next(m for m in self.codec.document["messages"] if m["name"] == name)["fields"]
        field = data.draw(st.sampled_from(fields))
        if field["type"] == "float":
            value: Any = data.draw(st.one_of(st.sampled_from([nan, inf, -inf, 3e38]), st.floats(width=32)))
        else:
            low, high = (
                (-(2**31), 2**31 - 1) if field["type"] == "i32" else (0, 2 ** (8 * int(field["type"] != "u8") + 8) - 1)
            )
            high = 2**32 - 1 if field["type"] == "u32" else high
            value = data.draw(st.one_of(st.integers(low, min(high, 9)), st.integers(low, high)))
        changed = {field["name"]: value if field["count"] is None else (value,) * field["count"]}
        self.left = periods

        def change(message: ReceivedMessage) -> list[bytes]:
            values = message.values | changed if message.name == name else message.values
            return [self.codec.encode(message.name, values, message.sequence)]

        self.change = change

    @rule(periods=st.integers(0, 120), name=st.sampled_from(["telemetry", "state", "identity", "ack", "counters"]))
    def swallows(self, periods: int, name: str) -> None:
        self.left = periods
        self.change = lambda m: [] if m.name == name else [self.codec.encode(m.name, m.values, m.sequence)]

    @rule()
    def is_honest(self) -> None:
        self.change = None

    @rule(data=st.data(), name=st.sampled_from(["drive", "safety", "stop", "arm", "run", "reset", "alive", "query"]))
    def another_host_speaks(self, data: st.DataObject, name: str) -> None:
        """With whatever the ranges let pass; its number is a guess."""
        item = next(m for m in self.codec.document["messages"] if m["name"] == name)
        values: dict[str, Any] = {}
        for field in item["fields"]:
            value = data.draw(st.sampled_from([field["low"], field["high"]]))
            value = float(value) if field["type"] == "float" else int(value)
            values[field["name"]] = value if field["count"] is None else [value] * field["count"]
        self.one.lockstep.write(self.codec.encode(name, values, data.draw(st.integers(0, 40))))

    @rule()
    def identifies(self) -> None:
        found = self.within(40.0, self.one.session.identify)
        self.known = self.known or found is not None

    @precondition(lambda self: self.known)
    @rule()
    def uploads(self) -> None:
        self.within(30.0, lambda: self.one.session.upload(self.one.settings))

    @precondition(lambda self: self.known)
    @rule(periods=st.integers(1, 150))
    def runs(self, periods: int) -> None:
        done = self.within(40.0, lambda: self.one.session.run(periods))
        if done is not None:
            rows = done.rows
            assert done.ended.reason in trials.HOST or done.ended.reason in set(self.codec.names("reasons").values())
            assert np.isfinite(rows["torque"]).all()
            assert np.isfinite(rows["q_desired"]).all()
            assert len(rows) <= periods + 50
        # It was told to stop, if it did not by itself: the damping is soon over.
        self.one.wait(self.one.settings.safety["silence"] * 1e-3 + 1.5)
        assert not self.one.arm.powered

    @invariant()
    def torques_are_within_the_ceilings(self) -> None:
        if hasattr(self, "one") and self.one.arm.torques:
            torques = np.abs(self.one.arm.torques)
            assert np.isfinite(torques).all()
            assert (torques <= self.ceilings).all()

    def teardown(self) -> None:
        if hasattr(self, "one"):
            self.one.session.close()


def played(bench: Source, arm: Model, examples: int) -> None:
    Against.model, Against.directory = arm, bench.compiled.controller()
    run_state_machine_as_test(Against, settings=settings(max_examples=examples, stateful_step_count=12, deadline=None))


def test_host_and_board_against_each_other(bench: Source, arm: Model) -> None:
    played(bench, arm, 15)


@pytest.mark.slow
def test_host_and_board_against_each_other_for_long(bench: Source, arm: Model) -> None:
    played(bench, arm, 300)


def test_the_protocol_page_is_the_one_of_the_board(bench: Source) -> None:
    """What the host holds a board to is written down beside its firmware."""
    page = json.loads((bench.compiled.controller() / "protocol.json").read_text())
    assert set(page["ceilings"]) >= {"torque_limit", "speed", "tracking", "low", "high", "kp", "kd", "silence", "late"}
