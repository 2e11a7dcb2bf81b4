"""Single words between host and board that are lost: nothing is taken for granted, everything is asked for again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from bench_arm import THERE_AND_BACK, trajectory
from driven import Rig, rig

from runtime.execution.trial import Trial
from runtime.hardware.link import Codec, ReceivedMessage
from runtime.hardware.lockstep import Fault
from runtime.model.loader import Model
from runtime.workspace.source import Source

PLAN = trajectory(THERE_AND_BACK)


@pytest.fixture
def one(bench: Source, arm: Model) -> Rig:
    return rig(arm, bench.compiled.controller(), PLAN).prepared()


@dataclass
class Losing:
    """Loses the messages that are chosen, and notes all."""

    codec: Codec
    chosen: Callable[[ReceivedMessage], bool] = lambda _: False
    seen: list[str] = field(default_factory=list)

    def __call__(self, frame: bytes) -> Sequence[bytes]:
        message = self.codec.decode(frame[:-1])
        assert isinstance(message, ReceivedMessage)
        self.seen.append(message.name)
        return [] if self.chosen(message) else [frame]


def number(k: int, chosen: Callable[[ReceivedMessage], bool]) -> Callable[[ReceivedMessage], bool]:
    """Of the messages that are chosen, the k-th."""
    left = k

    def hit(message: ReceivedMessage) -> bool:
        nonlocal left
        left -= chosen(message)
        return left == 0 and chosen(message)

    return hit


def stopped(one: Rig) -> Callable[[ReceivedMessage], bool]:
    states = one.session.codec.names("states")
    return lambda message: message.name == "state" and states[message.values["state"]] == "stopped"


def same(found: Trial, clean: Trial) -> bool:
    return found.stop is None and np.array_equal(found.q, clean.q) and np.array_equal(found.tau, clean.tau)


def test_the_encoders_are_asked_again(one: Rig) -> None:
    one.link.to_host = Losing(one.session.codec, number(1, lambda m: m.name == "telemetry"))
    assert one.session.counts() == tuple(one.arm.counts())


@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_report_of_the_end_that_is_lost(one: Rig, clean: Trial, k: int) -> None:
    """That it has stopped, that its drives are off: the run was whole, and the next one can begin."""
    one.link.to_host = Losing(one.session.codec, number(k, stopped(one)))
    assert same(one.run(), clean)
    one.session.upload(one.settings)


def test_no_stop_arrives_and_the_board_comes_to_its_end(one: Rig) -> None:
    """What was recorded is kept, and the next run can begin."""
    one.link.to_board = Losing(one.session.codec, lambda m: m.name == "stop")
    found = one.run(asked=lambda: int(one.arm.period >= 1385))
    assert found.stop is not None
    assert found.stop.name == "interrupted"
    assert len(found.t) > 1380
    one.session.upload(one.settings)


@pytest.mark.parametrize("name", ["arm", "run"])
def test_a_board_whose_answers_are_lost_is_told_to_stop(one: Rig, name: str) -> None:
    """It may have heard: nobody goes away from an arm that may move."""
    codec = one.session.codec
    one.link.to_host = Losing(codec, lambda m: m.name == "ack" and m.values["type"] == codec.number(name))
    one.link.to_board = heard = Losing(codec)
    found = one.run()
    assert found.stop is not None
    assert found.stop.name == "link_lost"
    assert f"the board does not answer ({name}, 5 times)" in found.stop.reason
    assert "stop" in heard.seen
    assert not one.arm.powered
    one.session.upload(one.settings)


def test_a_drive_that_fails_when_it_is_switched_on(one: Rig) -> None:
    """Between arm and run: it is the drive's fault and not one of the protocol."""

    def fail(_period: int, counts: np.ndarray) -> np.ndarray:
        if one.arm.powered:
            raise Fault("node 1: under-voltage")
        return counts

    def play(frame: bytes) -> Sequence[bytes]:
        # A board's time goes on while it is talked to.
        for _ in range(2):
            one.lockstep._play()
        return [frame]

    one.arm.twist = fail
    one.link.to_board = play
    found = one.run()
    assert found.stop is not None
    assert (found.stop.name, found.stop.reason) == ("drive", "node 1: under-voltage")
    assert not one.arm.powered
