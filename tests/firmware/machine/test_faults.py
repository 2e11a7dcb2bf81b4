"""Whatever fails, the arm is damped or without torque within 5 ms of its being seen, the reason has a name, the
recording is kept, and nothing hangs."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bench_arm import THERE_AND_BACK, trajectory
from driven import Faulty, Rig, rig
from emulation import places
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from runtime.execution.trial import Trial
from runtime.hardware.boards import HostBoard, QemuBoard, UnicornBoard
from runtime.hardware.lockstep import Counted, Fault
from runtime.hardware.session import Refused
from runtime.model.loader import Model
from runtime.workspace.source import Source

PLAN = trajectory(THERE_AND_BACK)
AT = 300
"""The control period of a run in which faults begin: joint 1 moves at 3 rad/s."""
BOARDS = [
    pytest.param(HostBoard, id="host"),
    pytest.param(UnicornBoard, id="unicorn"),
    pytest.param(
        QemuBoard,
        id="qemu",
        marks=pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="needs qemu-system-arm"),
    ),
]


Make = Callable[..., Rig]


@pytest.fixture
def make(bench: Source, arm: Model) -> Make:
    """A bench on a board; others of `driven.rig` as they come."""
    made: list[Rig] = []

    def on(board: Callable[..., Any] = HostBoard, **others: Any) -> Rig:
        target = "host" if board is HostBoard else "cortex-m4f"
        made.append(rig(arm, bench.compiled.controller(target), others.pop("plan", PLAN), board, **others))
        return made[-1]

    yield on  # type: ignore[misc]
    for one in made:
        one.session.close()


@pytest.fixture(scope="module")
def clean(bench: Source, arm: Model) -> Trial:
    """What is recorded where nothing fails."""
    found = rig(arm, bench.compiled.controller(), PLAN).driven()
    assert found.stop is None
    assert len(found.t) == 1400
    return found


def same(found: Trial, clean: Trial) -> bool:
    """Bit for bit."""
    return found.stop is None and all(
        np.array_equal(getattr(found, name), getattr(clean, name)) for name in ("t", "q", "q_desired", "tau")
    )


def check(found: Trial, name: str, about: int, clean: Trial) -> None:
    """Stopped about there by a reason of this name, recorded until then as if nothing had happened."""
    assert found.stop is not None
    assert found.stop.name == name, found.stop
    assert abs(found.stop.t - 1e-3 * about) < 0.05, found.stop
    count = min(AT, len(found.t))
    assert count > AT - 5  # the host reads a few periods at once
    np.testing.assert_array_equal(found.q[:, :count], clean.q[:, :count])
    np.testing.assert_allclose(found.t[:count], 1e-3 * np.arange(count), atol=1e-9)


# --- what the link does to frames ---


class Every:
    """Does something to every k-th frame."""

    def __init__(self, k: int, change: Callable[[bytes], Sequence[bytes]]) -> None:
        self.k, self.change, self.seen = k, change, 0

    def __call__(self, frame: bytes) -> Sequence[bytes]:
        self.seen += 1
        return [frame] if self.seen % self.k else self.change(frame)


def lost(_frame: bytes) -> Sequence[bytes]:
    return []


def doubled(frame: bytes) -> Sequence[bytes]:
    return [frame, frame]


def corrupted(frame: bytes) -> Sequence[bytes]:
    """One bit in the middle; a byte that becomes a delimiter is as good."""
    k = len(frame) // 2
    return [frame[:k] + bytes([frame[k] ^ 0x10]) + frame[k + 1 :]]


class Late:
    """Every k-th frame comes after the next one."""

    def __init__(self, k: int) -> None:
        self.k, self.seen, self.held = k, 0, b""

    def __call__(self, frame: bytes) -> Sequence[bytes]:
        self.seen += 1
        if self.seen % self.k == 0:
            self.held = frame
            return []
        found = [frame, self.held] if self.held else [frame]
        self.held = b""
        return found


@pytest.mark.parametrize("change", [Every(3, lost), Every(2, doubled), Late(4)], ids=["lost", "doubled", "late"])
def test_commands_that_are_lost_doubled_or_late_arrive_once(
    make: Make, clean: Trial, change: Callable[[bytes], Sequence[bytes]]
) -> None:
    """In the upload and in motion: repeated, and not done twice; the motion is that of a clean link."""
    one = make()
    one.link.to_board = change
    assert same(one.driven(), clean)


def test_a_corrupted_command_now_and_then_is_said_again(make: Make, clean: Trial) -> None:
    one = make()
    one.link.to_board = Every(11, corrupted)
    assert same(one.driven(), clean)


def test_answers_that_are_lost_are_asked_for_again(make: Make, clean: Trial) -> None:
    one = make().prepared()
    one.link.to_host = Every(2, lost)
    one.session.upload(one.settings)
    one.link.to_host = lambda frame: [frame]
    assert same(one.run(), clean)


def test_doubled_telemetry_is_taken_once(make: Make, clean: Trial) -> None:
    one = make()
    one.link.to_host = Every(2, doubled)
    assert same(one.driven(), clean)


class InMotion:
    """Does something to the frames from a control period of the run on."""

    def __init__(self, one: Rig, change: Callable[[bytes], Sequence[bytes]], until: float = np.inf) -> None:
        self.one, self.change, self.until = one, change, until

    def __call__(self, frame: bytes) -> Sequence[bytes]:
        return self.change(frame) if AT <= self.one.arm.period < self.until else [frame]


@pytest.mark.parametrize("change", [lost, corrupted, Late(2)], ids=["lost", "corrupted", "late"])
def test_telemetry_that_does_not_come_whole_stops_the_arm(
    make: Make, clean: Trial, change: Callable[[bytes], Sequence[bytes]]
) -> None:
    one = make()
    one.link.to_host = InMotion(one, change, AT + 20)
    check(one.driven(), "telemetry_lost", AT, clean)
    # That records are missing shows when the next one comes.
    one.check_safe(AT + 20)


@pytest.mark.parametrize("since", [1390, 1399])
def test_a_run_that_is_done_but_whose_last_records_are_lost_is_no_whole_one(make: Make, since: int) -> None:
    one = make()
    kind = one.session.codec.number("telemetry")
    telemetry = lambda frame: one.arm.period >= since and frame[2] == kind  # noqa: E731
    one.link.to_host = lambda frame: [] if telemetry(frame) else [frame]
    found = one.driven()
    assert found.stop is not None
    assert found.stop.name == "telemetry_lost"
    assert len(found.t) < 1400


def test_what_stopped_the_arm_counts_more_than_what_was_lost_at_that_moment(make: Make) -> None:
    one = make()
    kind = one.session.codec.number("telemetry")
    one.arm.twist = lambda period, counts: counts + (100_000 if period >= AT else 0)
    one.link.to_host = lambda frame: [] if one.arm.period >= AT - 5 and frame[2] == kind else [frame]
    found = one.driven()
    assert found.stop is not None
    assert (found.stop.name, found.stop.t) == ("encoder_jump", pytest.approx(1e-3 * AT))


@pytest.mark.parametrize("board", BOARDS)
def test_a_link_that_is_cut_both_ways(make: Make, clean: Trial, board: Callable[..., Any]) -> None:
    one = make(board)
    one.link.to_board = InMotion(one, lost)
    one.link.to_host = InMotion(one, lost)
    check(one.driven(), "link_lost", AT, clean)
    one.check_safe(AT + one.settings.safety["silence"] + 1)


def test_a_link_that_is_cut_towards_the_board(make: Make, clean: Trial) -> None:
    one = make()
    one.link.to_board = InMotion(one, lost)
    found = one.driven()
    check(found, "link_lost", AT + 175, clean)
    assert found.stop is not None
    assert "no valid frame from the host" in found.stop.reason
    one.check_safe(AT + one.settings.safety["silence"] + 1)


def test_a_board_that_says_nothing_any_more(make: Make, clean: Trial) -> None:
    """It may still hear: it is told to stop."""
    one = make()
    one.link.to_host = InMotion(one, lost)
    found = one.driven()
    check(found, "link_lost", AT, clean)
    one.check_safe(AT + 400)


def test_many_corrupted_commands_stop_the_arm(make: Make, clean: Trial) -> None:
    one = make()
    one.link.to_board = InMotion(one, lambda frame: [*corrupted(frame) * 5, frame], AT + 200)
    found = one.driven()
    check(found, "corrupted", AT + 25, clean)
    assert found.stop is not None
    one.check_safe(round(1e3 * found.stop.t))


def test_many_commands_out_of_order_stop_the_arm(make: Make, clean: Trial) -> None:
    one = make()
    strange = [one.session.codec.encode("alive", sequence=k) for k in (9000, 8000, 7000, 6000)]
    one.link.to_board = InMotion(one, lambda frame: [*strange, frame], AT + 200)
    found = one.driven()
    check(found, "sequence", AT + 25, clean)
    assert found.stop is not None
    one.check_safe(round(1e3 * found.stop.t))


class Noise:
    """A line that loses, doubles, delays, corrupts and invents frames, each with a probability, from a time on."""

    def __init__(self, seed: int, strength: float, one: Rig, since: int) -> None:
        self.rng, self.strength, self.one, self.since = np.random.default_rng(seed), strength, one, since
        self.held: list[bytes] = []

    def __call__(self, frame: bytes) -> Sequence[bytes]:
        if self.one.arm.period < self.since or self.rng.random() > self.strength:
            found, self.held = [*self.held, frame], []
            return found
        match self.rng.integers(6):
            case 0:
                return []
            case 1:
                return [frame, frame]
            case 2:
                self.held.append(frame)
                return []
            case 3:
                flips = self.rng.integers(0, 256, len(frame), dtype=np.uint8) * (self.rng.random(len(frame)) < 0.1)
                return [(np.frombuffer(frame, np.uint8) ^ flips).astype(np.uint8).tobytes()]
            case 4:
                return [frame[: self.rng.integers(len(frame))]]
            case _:
                return [self.rng.integers(0, 256, self.rng.integers(1, 200), dtype=np.uint8).tobytes(), frame]


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    seed=st.integers(0, 2**32 - 1),
    to_board=st.sampled_from([0.0, 0.02, 0.1, 0.5, 1.0]),
    to_host=st.sampled_from([0.0, 0.001, 0.01, 0.1, 1.0]),
    since=st.integers(1, 1500),
)
def test_whatever_a_line_does_to_a_run(
    make: Make, clean: Trial, seed: int, to_board: float, to_host: float, since: int
) -> None:
    """It comes to an end, with a name; what was recorded is true; in the end the drives are off."""
    one = make().prepared()
    one.link.to_board = Noise(seed, to_board, one, since)
    one.link.to_host = Noise(seed + 1, to_host, one, since)
    begun = one.link.now()
    found = one.run()
    assert one.link.now() - begun < 1.4 + 5.0
    count = len(found.t)
    if found.stop is None:
        assert same(found, clean)
    else:
        assert found.stop.name in {"telemetry_lost", "link_lost", "corrupted", "sequence", "host"}
        # The step that stopped the arm has another torque.
        np.testing.assert_array_equal(found.q[:, :count], clean.q[:, :count])
        np.testing.assert_array_equal(found.tau[:, : count - 1], clean.tau[:, : max(count - 1, 0)])
    one.wait(1.0)
    assert not one.arm.powered
    assert not any(torque.any() for torque in one.arm.torques[-5:])


# --- numbers that are none ---


@pytest.mark.parametrize(
    ("message", "field"), [("drive", "kp"), ("safety", "tracking"), ("parameters", "J1"), ("effects", "friction_scale")]
)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_settings_that_are_no_numbers_are_refused(make: Make, message: str, field: str, value: float) -> None:
    one = make().prepared()
    values = dict(getattr(one.settings, message))
    values[field] = [value] if isinstance(values[field], list) else value
    words = rf"does not accept {message}: refused: a value is infinite or no number \({field}\)"
    with pytest.raises(Refused, match=words):
        one.session.upload(replace(one.settings, **{message: values}))


def test_a_trajectory_that_is_no_number_is_refused(make: Make) -> None:
    one = make().prepared()
    points = one.settings.points.copy()
    points[2, 0] = np.nan
    with pytest.raises(Refused, match=r"does not accept points: refused: a value is infinite or no number \(values\)"):
        one.session.upload(replace(one.settings, points=points))
    # What is half there cannot be run.
    with pytest.raises(Refused, match=r"does not accept arm: refused: something has not been uploaded \(trajectory\)"):
        one.run()
    assert not one.arm.powered


def poke_host(board: HostBoard, kp: bytes, bad: bytes) -> None:
    memory = memoryview(board._memory).cast("B")
    at = bytes(memory).index(kp)
    memory[at : at + 4] = bad


def poke_unicorn(board: UnicornBoard, kp: bytes, bad: bytes) -> None:
    place, size = places(board.image.with_suffix(".elf"))["machine"]
    board.cpu.mem_write(place + bytes(board.cpu.mem_read(place, size)).index(kp), bad)


@pytest.mark.parametrize(("board", "poke"), [(HostBoard, poke_host), (UnicornBoard, poke_unicorn)])
def test_a_number_that_is_none_in_motion_takes_the_torque_away(
    make: Make, clean: Trial, board: Callable[..., Any], poke: Callable[..., None]
) -> None:
    """A gain in the board's memory is overwritten."""
    one = make(board)

    def spoil(period: int, counts: Any) -> Any:
        if period == AT:
            poke(one.lockstep.board, struct.pack("<f", 40.0), struct.pack("<f", np.nan))
        return counts

    one.arm.twist = spoil
    check(one.driven(), "not_finite", AT, clean)
    one.check_safe(AT)
    assert not np.array(one.arm.torques)[AT:].any()


# --- encoders, drives, time ---


@pytest.mark.parametrize("board", BOARDS)
def test_an_encoder_that_jumps(make: Make, clean: Trial, board: Callable[..., Any]) -> None:
    one = make(board)
    one.arm.twist = lambda period, counts: counts + (100_000 if period >= AT else 0)
    found = one.driven()
    check(found, "encoder_jump", AT, clean)
    assert found.stop is not None
    assert found.stop.joint == 1
    assert "counts in a control period, the limit is" in found.stop.reason
    one.check_safe(AT)
    assert not np.array(one.arm.torques)[AT:].any()


def test_an_encoder_that_freezes(make: Make, clean: Trial) -> None:
    """At 3 rad/s it is seen after the desired travel that is allowed without a count."""
    one, frozen = make(), []

    def freeze(period: int, counts: Any) -> Any:
        if period == AT:
            frozen.append(counts)
        return frozen[0] if frozen else counts

    one.arm.twist = freeze
    found = one.driven()
    desired = clean.q_desired[0]
    seen = next(k for k in range(AT, 1400) if abs(desired[k] - desired[AT]) > one.settings.safety["frozen"][0])
    check(found, "encoder_frozen", seen, clean)
    one.check_safe(seen)
    assert found.stop is not None
    assert "has not counted while the joint was to move by 0.25 rad" in found.stop.reason


def test_a_torque_at_its_limit_for_too_long(make: Make) -> None:
    """Something holds the joint, and nothing but the torque tells: the tracking error is allowed."""
    one = make(tracking=3.0)
    safety = {**one.settings.safety, "saturated": 100, "frozen": [3.0]}
    one.settings = replace(one.settings, safety=safety, drive={**one.settings.drive, "torque_limit": [5.0]})
    held = []
    one.arm.twist = lambda _, counts: held.append(counts) or held[0]
    found = one.driven()
    assert found.stop is not None
    assert found.stop.name == "torque_limit"
    assert found.stop.reason == "the torque has been at its limit of 5 N m for 0.1 s"
    first = int(np.argmax(found.saturated))
    assert found.stop.t == pytest.approx(1e-3 * (first + 100), abs=2e-3)
    one.check_safe(first + 101)


class Sleepy(Counted):
    """A clock that oversleeps a period once."""

    def __init__(self, period: float, one: Callable[[], Rig]) -> None:
        super().__init__(period)
        self.one, self.slept = one, 0

    def period(self) -> int:
        if self.one().arm.period == AT:
            self.slept = 1000
        return super().period() + self.slept


@pytest.mark.parametrize("board", BOARDS)
def test_a_control_period_that_was_missed(make: Make, clean: Trial, board: Callable[..., Any]) -> None:
    made: list[Rig] = []
    made.append(make(board, clock=Sleepy(1e-3, lambda: made[0])))
    found = made[0].driven()
    check(found, "watchdog", AT, clean)
    # The board's clock is what the recording goes by.
    assert found.t[-1] - found.t[-2] == pytest.approx(2e-3)
    made[0].check_safe(AT, missed=AT)


class Other(Counted):
    """A timer that is set to another period than the model file has."""

    def __init__(self, ratio: float) -> None:
        super().__init__(1e-3)
        self.ratio = ratio

    def period(self) -> int:
        return round(super().period() * self.ratio)


@pytest.mark.parametrize(("ratio", "taken"), [(1.25, "1.25 ms"), (0.8, "0.8 ms")])
@pytest.mark.parametrize("every", [1, 3])
def test_a_board_that_keeps_another_rate_is_stopped(make: Make, ratio: float, taken: str, every: int) -> None:
    """Within what a single period may take, and all the same each rate that is measured is wrong."""
    found = make(clock=Other(ratio)).prepared().run(every=every)
    assert found.stop is not None
    assert found.stop.name == "other_rate"
    assert f"its control periods take {taken}; the model file says 1 ms" in found.stop.reason
    assert found.t[-1] < 0.2


def test_a_timer_that_is_a_little_off_is_not(make: Make) -> None:
    assert make(clock=Other(1.03)).driven().stop is None


def within(arm: Model, low: float, high: float) -> Model:
    """The same arm with another range."""
    other = copy(arm)
    other.joints = tuple(replace(joint, limits=replace(joint.limits, position=(low, high))) for joint in arm.joints)
    return other


def test_an_error_beyond_the_end_of_the_range_is_tracking_until_it_is_none(
    bench: Source, arm: Model, clean: Trial
) -> None:
    """The range is the plan's, which may touch its ends."""
    beyond = float(clean.q.min()) + 0.02
    assert same(rig(within(arm, beyond, 1.8), bench.compiled.controller(), PLAN).driven(), clean)
    stop = rig(within(arm, -1.1, 1.8), bench.compiled.controller(), PLAN).driven().stop
    assert stop is not None
    assert stop.name == "position"
    assert "is outside -1.15 to 1.85" in stop.reason


def test_a_drive_that_fails(make: Make, clean: Trial) -> None:
    one = make()

    def fail(period: int, counts: Any) -> Any:
        if period >= AT:
            raise Fault("joint 1: the drive is in state fault: over-temperature")
        return counts

    one.arm.twist = fail
    found = one.driven()
    check(found, "drive", AT, clean)
    assert found.stop is not None
    assert "over-temperature" in found.stop.reason
    assert not np.array(one.arm.torques)[AT:].any()


def test_a_motor_that_turns_the_wrong_way(make: Make) -> None:
    """What follows the trajectory drives away from it, and what damps drives on: that is over before the arm has
    become much faster than it was at the stop."""
    one = make()
    apply, rates = one.arm.arm.apply, []

    def wrong(torque: Any) -> None:
        apply(-torque)
        rates.append(float(one.arm.arm.plant.qd[0]))  # type: ignore[attr-defined]

    one.arm.arm.apply = wrong  # type: ignore[method-assign]
    found = one.driven()
    assert found.stop is not None
    last = len(found.t) - 1
    off = one.arm.on.index(False)
    limit = max(one.settings.safety["speed"][0], abs(rates[last]))
    assert last < off < last + 100
    assert max(np.abs(rates)) < 1.5 * limit
    assert not np.array(one.arm.torques)[off:].any()


# --- the user ---


@pytest.mark.parametrize("board", BOARDS)
def test_the_user_stops_the_arm(make: Make, clean: Trial, board: Callable[..., Any]) -> None:
    one = make(board).prepared()
    check(one.run(asked=lambda: int(one.arm.period >= AT)), "interrupted", AT + 20, clean)
    one.check_safe(AT)


def test_twice_does_not_wait_for_the_board(make: Make, clean: Trial) -> None:
    """Not even for one that does not answer: it was told to stop, and stops by itself as well."""
    one = make().prepared()
    one.link.to_host = InMotion(one, lost)
    before = one.link.now()
    check(one.run(asked=lambda: 2 * int(one.arm.period >= AT)), "interrupted", AT, clean)
    assert one.link.now() - before < 0.5


def test_after_a_stop_it_runs_again(make: Make, clean: Trial) -> None:
    one = make().prepared()
    assert one.run(asked=lambda: int(one.arm.period >= AT)).stop is not None
    one.lockstep.start(one.settings.points[0].astype(float), np.random.default_rng(1))
    assert same(one.run(), clean)


def test_a_stop_before_the_first_step_leaves_the_drives_off(make: Make) -> None:
    """The arm has been carried elsewhere since the last run, which is no motion that could be damped."""
    one = make()
    one.settings = replace(one.settings, safety={**one.settings.safety, "jump": [2**31 - 1]})
    assert one.driven().stop is None
    one.lockstep.start(one.settings.points[3].astype(float), np.random.default_rng(1))
    wishes = iter([0])
    found = one.run(asked=lambda: next(wishes, 1))
    assert found.stop is not None
    assert found.stop.name == "interrupted"
    assert not one.arm.begun


def test_frames_come_whole_through_the_faulty_link(make: Make, clean: Trial) -> None:
    """The tests' own link does nothing by itself."""
    assert isinstance(make().link, Faulty)
    assert same(make().driven(), clean)
