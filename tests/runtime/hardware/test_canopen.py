"""Drives of CiA 402 on a virtual CAN bus: states, scaling, enabling, running, faults, quick stop, lost nodes."""

from __future__ import annotations

import errno
import itertools
import os
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.hardware import can_drive, canopen_arm
from runtime.hardware.can_drive import Controlword, Scale
from runtime.hardware.canopen_arm import MISSED, CanAddress, CanopenArm
from runtime.hardware.link import LinkError
from runtime.hardware.lockstep import Fault, Pace, Precedence
from runtime.model.catalogue import joint_info
from tests.runtime.hardware.canopen_drives import (
    DISABLED,
    ENABLED,
    FAULTY,
    QUICK_STOPPED,
    READY,
    SWITCHED_ON,
    Drive,
    Drives,
    Entry,
)

PERIOD = 0.002
PATIENT = 20.0  # s: no answer is missing because the machine is busy
RNG = np.random.default_rng(0)


# --- the profile ---


def matches(pattern: str) -> Callable[[int], bool]:
    """A statusword against a line of the standard's table, such as xxxx xxxx x01x 0111."""
    bits = pattern.replace(" ", "")[::-1]
    return lambda word: all(bit == "x" or int(bit) == word >> k & 1 for k, bit in enumerate(bits))


STANDARD = {
    "xxxx xxxx x0xx 0000": "not ready to switch on",
    "xxxx xxxx x1xx 0000": "switch on disabled",
    "xxxx xxxx x01x 0001": "ready to switch on",
    "xxxx xxxx x01x 0011": "switched on",
    "xxxx xxxx x01x 0111": "operation enabled",
    "xxxx xxxx x00x 0111": "quick stop active",
    "xxxx xxxx x0xx 1111": "fault reaction active",
    "xxxx xxxx x0xx 1000": "fault",
}


def test_every_statusword_is_read_as_the_standard_has_it() -> None:
    table = [(matches(pattern), name) for pattern, name in STANDARD.items()]
    for word in range(2**16):
        expected = [name for is_it, name in table if is_it(word)] or ["no state of CiA 402"]
        assert [can_drive.state_of(word).value] == expected


@pytest.mark.parametrize("state", [DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOPPED, FAULTY])
@pytest.mark.parametrize("before", list(Controlword))
def test_from_every_state_a_drive_is_switched_on(state: str, before: Controlword) -> None:
    drive = Drive(1, state=state, word=int(before))
    for _ in range(6):
        drive.refresh()
        before = can_drive.towards_enabled(can_drive.state_of(drive.entries[0x6041, 0].value), before)
        drive.obey(before)
    assert drive.state == ENABLED


ratios = st.floats(1e-2, 1e5)
rated = st.floats(1e-3, 1e3)


def torque_of(scale: Scale, per_mille: int) -> float:
    """Torque at the joint of a target torque."""
    return scale.direction * per_mille * scale.resolution


@given(ratios, rated, st.sampled_from([1, -1]), st.integers(-32767, 32767))
def test_what_a_drive_is_told_is_what_was_meant(gear: float, motor: float, direction: int, steps: int) -> None:
    scale = Scale(gear, direction, motor)
    torque = torque_of(scale, steps)
    assert scale.per_mille(torque) == steps
    # 1000 per mille are the rated torque at the motor, the gear's multiple of it at the joint.
    assert torque == pytest.approx(direction * steps / 1000 * motor * gear, rel=1e-12)


@given(ratios, rated, st.sampled_from([1, -1]), st.integers(0, 65535), st.floats(-1e9, 1e9))
def test_torque_is_rounded_to_the_nearest_step_and_never_over_the_maximum(
    gear: float, motor: float, direction: int, most: int, torque: float
) -> None:
    scale = Scale(gear, direction, motor, most)
    steps = scale.per_mille(torque)
    assert abs(steps) <= min(most, 32767)
    if abs(torque) <= scale.largest:
        assert abs(torque_of(scale, steps) - torque) <= scale.resolution * (0.5 + 1e-9)
    else:
        assert torque_of(scale, steps) == pytest.approx(np.copysign(scale.largest, torque))


@pytest.mark.parametrize("torque", [float("nan"), float("inf"), -float("inf")])
def test_a_torque_that_is_no_number_is_not_commanded(torque: float) -> None:
    with pytest.raises(ValueError, match="cannot be commanded"):
        Scale(100.0, 1, 0.25).per_mille(torque)


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (0x3220, "0x3220, DC link under-voltage"),
        (0x2311, "0x2311, continuous over-current"),
        (0x7399, "0x7399, sensor"),
        (0x8FFF, "0x8FFF, monitoring"),
        (0xFF07, "0xFF07, specific to the device, see its manual"),
        (0xB000, "0xB000"),
    ],
)
def test_errors_in_words(code: int, text: str) -> None:
    assert can_drive.error_text(code) == text


# --- the bus ---


def test_addresses() -> None:
    assert canopen_arm.parse_can_address("canopen://can0") == CanAddress("can0", "socketcan", 1_000_000)
    assert canopen_arm.parse_can_address("canopen://PCAN_USBBUS1?interface=pcan&bitrate=500000") == CanAddress(
        "PCAN_USBBUS1", "pcan", 500_000
    )
    assert canopen_arm.parse_can_address("canopen:///dev/ttyACM0?interface=slcan").channel == "/dev/ttyACM0"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("canopen://", "expected canopen://can0?interface=socketcan&bitrate=1000000"),
        ("canopen://can0?speed=3", 'unknown key "speed"; expected interface and bitrate'),
        ("canopen://can0?bitrate=fast", "bitrate is fast; expected 10000 to 1000000 bit/s"),
        ("canopen://can0?bitrate=", "bitrate is ; expected"),
        ("canopen://can0?bitrate=2000000", "bitrate is 2000000; expected"),
    ],
)
def test_addresses_that_are_none(text: str, expected: str) -> None:
    with pytest.raises(LinkError) as caught:
        canopen_arm.parse_can_address(text)
    assert expected in str(caught.value)
    assert str(caught.value).startswith(f"--on {text}: ")


def stuffed(data: bytes, identifier: int = 0x201) -> int:
    """Bits of a frame on the wire, stuff bits and the gap included, from CiA's and Bosch's frame, bit by bit."""
    bits = [0] + [identifier >> k & 1 for k in range(10, -1, -1)] + [0, 0, 0]
    bits += [len(data) >> k & 1 for k in range(3, -1, -1)]
    bits += [byte >> k & 1 for byte in data for k in range(7, -1, -1)]
    crc = 0
    for bit in bits:
        crc = (crc << 1 & 0x7FFF) ^ (0x4599 if bit ^ crc >> 14 else 0)
    bits += [crc >> k & 1 for k in range(14, -1, -1)]
    count, run, last = 0, 0, None
    for bit in bits:
        run = run + 1 if bit == last else 1
        last, count = bit, count + 1
        if run == 5:
            last, run, count = 1 - bit, 1, count + 1
    return count + 1 + 2 + 7 + 3  # CRC delimiter, acknowledgement, end of frame, gap


@given(st.binary(max_size=8), st.integers(0, 0x7FF))
def test_no_frame_is_longer_than_it_is_counted(data: bytes, identifier: int) -> None:
    assert stuffed(data, identifier) <= canopen_arm.frame_bits(len(data))


def test_what_four_joints_fill_of_a_bus() -> None:
    assert canopen_arm.frame_bits(8) == 135
    assert canopen_arm.bus_load(4, 1000.0, 1_000_000) == pytest.approx(0.895)
    canopen_arm.check_bus_load(4, 500.0, CanAddress("can0"))
    with pytest.raises(LinkError) as caught:
        canopen_arm.check_bus_load(4, 1000.0, CanAddress("can0"))
    assert str(caught.value) == (
        "canopen://can0: 4 drives at 1000 Hz fill 89.5% of a bus of 1 Mbit/s, over 80%; "
        "set rate in [controller] to at most 890 Hz, or drive the joints from a board"
    )
    canopen_arm.check_bus_load(4, 890.0, CanAddress("can0"))


# --- drives ---


class Time:
    """A clock that only sleeping moves."""

    def __init__(self) -> None:
        self.t = 0.0

    def now(self) -> float:
        return self.t

    def sleep(self, seconds: float) -> None:
        self.t += seconds


def pace(period: float = PERIOD) -> Pace:
    time = Time()
    return Pace(period, time.now, time.sleep)


def model(*joints: dict[str, Any]) -> Any:
    """What an arm on a bus reads of a model; joint k has node k + 10."""
    made = []
    for k, given_ in enumerate(joints, 1):
        plain = {
            "type": "revolute",
            "rotor_inertia": 0.1,
            "gear_ratio": 100.0,
            "torque_constant": None,
            "limits": {"position": None, "speed": None, "torque": 20.0},
            "gains": None,
            "encoder_counts": 2000,
            "encoder_zero": 0,
            "drive": {"node": k + 10, "direction": 1, "rated_torque": None, "law": None, "gains": {}},
            "effects": {},
            "name": None,
            "units": {"force": "N m", "position": "rad"},
        }
        made.append(joint_info(plain | given_))
    return SimpleNamespace(name="bench", n=len(made), joints=tuple(made))


_channels = itertools.count()


class Inertias:
    """Motors that torque turns, in counts; a count a period for each N m and period."""

    def __init__(self, n: int) -> None:
        self.speed, self.position, self.torques = [0.0] * n, [0.0] * n, [0.0] * n

    def __call__(self, torques: list[float]) -> list[int]:
        self.torques = torques
        for k, torque in enumerate(torques):
            self.speed[k] += 10.0 * torque
            self.position[k] += self.speed[k]
        return [round(position) for position in self.position]


@contextmanager
def bench(
    *joints: dict[str, Any], patience: float = PATIENT, drives: dict[int, Drive] | None = None
) -> Iterator[tuple[CanopenArm, Drives]]:
    """An arm on a bus of its own, with a drive a joint behind it."""
    channel = f"test-{next(_channels)}"
    made = model(*joints)
    there = [(drives or {}).get(k) or Drive(k + 10) for k in range(1, made.n + 1)]
    with Drives(channel, there, Inertias(made.n)) as behind:
        arm = CanopenArm(made, CanAddress(channel, "virtual"), pace(), patience)
        try:
            yield arm, behind
        finally:
            arm.close()


@contextmanager
def enabled(*joints: dict[str, Any], patience: float = PATIENT) -> Iterator[tuple[CanopenArm, Drives]]:
    """A bench whose drives are on."""
    with bench(*joints, patience=patience) as (arm, behind):
        arm.start(np.zeros(len(joints)), RNG)
        arm.enable(True)
        yield arm, behind


def running(arm: CanopenArm, torque: list[float], periods: int) -> np.ndarray:
    """Counts after so many periods at these torques."""
    counts = arm.counts()
    for _ in range(periods):
        arm.apply(torque)
        counts = arm.counts()
    return counts


def test_drives_are_set_up_enabled_run_and_switched_off() -> None:
    with bench({}, {}) as (arm, behind):
        assert arm.start(np.zeros(2), RNG).tolist() == [0, 0]
        assert [drive.state for drive in behind.drives] == [DISABLED, DISABLED]
        writes = {(i, s): v for kind, i, s, v in behind.drives[1].heard if kind == "write"}
        assert (writes[0x1A00, 1], writes[0x1A00, 2]) == (0x60410010, 0x60640020)
        assert (writes[0x1600, 1], writes[0x1600, 2]) == (0x60400010, 0x60710010)
        assert (writes[0x1800, 1], writes[0x1800, 2], writes[0x1400, 1]) == (0x18C, 1, 0x20C)
        assert (writes[0x60C2, 1], writes[0x60C2, 2]) == (2, -3)
        assert writes[0x6060, 0] == 10
        arm.enable(True)
        assert [drive.state for drive in behind.drives] == [ENABLED, ENABLED]
        words = [word for kind, word, *_ in behind.drives[0].heard if kind == "word"]
        assert words == [Controlword.SHUTDOWN, Controlword.SWITCH_ON, Controlword.ENABLE_OPERATION]
        counts = running(arm, [1.0, -2.0], 3)
        # 1 N m at the joint is 10 mN m at the motor: 0.1 counts a period and period, 1 + 2 + 3 of them.
        assert behind.advance.torques == [0.01, -0.02]
        assert counts.tolist() == [round(0.6), round(-1.2)]
        assert counts.dtype == np.int32
        arm.enable(False)
        assert [drive.state for drive in behind.drives] == [DISABLED, DISABLED]
        assert [drive.target for drive in behind.drives] == [0, 0]


def test_nothing_is_commanded_before_the_drives_are_on() -> None:
    with bench({}) as (arm, behind):
        arm.start(np.zeros(1), RNG)
        running(arm, [5.0], 4)
        assert not [item for item in behind.drives[0].heard if item[0] == "word"]


def test_a_motor_that_turns_against_its_joint() -> None:
    turned = {"drive": {"node": 11, "direction": -1, "rated_torque": 0.5, "law": None, "gains": {}}}
    with bench(turned) as (arm, behind):
        behind.advance.position = [40.0]
        assert arm.start(np.zeros(1), RNG).tolist() == [-40]
        arm.enable(True)
        assert running(arm, [5.0], 5)[0] > -40
        # 5 N m are 50 mN m at the motor: a tenth of the rated torque that the model file states.
        assert behind.drives[0].target == -100


@pytest.mark.parametrize("position", [-(2**31), 2**31 - 1])
def test_counts_at_the_ends_of_the_register(position: int) -> None:
    for direction, expected in ((1, position), (-1, -position if position > 0 else position)):
        with bench({"drive": {"node": 11, "direction": direction, "rated_torque": None, "law": None, "gains": {}}}) as (
            arm,
            behind,
        ):
            behind.advance = None
            behind.drives[0].position = position
            assert arm.start(np.zeros(1), RNG).tolist() == [expected]


def test_a_fault_in_motion_stops_every_drive_and_says_why() -> None:
    with enabled({}, {}, {}) as (arm, behind):
        running(arm, [1.0, 1.0, 1.0], 5)
        behind.fail(behind.drives[1], 0x7305, 0x21)
        with pytest.raises(Fault) as caught:
            running(arm, [1.0, 1.0, 1.0], 2)
        assert str(caught.value) == (
            'joint 2: the drive (node 12) left "operation enabled" for "fault": '
            "0x7305, incremental encoder 1 (error register: generic, profile)"
        )
        words = [item[1:] for item in behind.drives[0].heard if item[0] == "word"]
        first = words.index((Controlword.QUICK_STOP, 0))
        # Not one torque after the first sign of it, at no drive.
        assert all(torque == 0 for _, torque in words[first:])
        assert [drive.state for drive in behind.drives] == [DISABLED, FAULTY, DISABLED]
        for use in (arm.counts, lambda: arm.apply([1.0, 1.0, 1.0])):
            with pytest.raises(Fault, match="incremental encoder"):
                use()
        assert [drive.torque for drive in behind.drives] == [0.0, 0.0, 0.0]


def test_a_fault_without_an_emergency_message_is_asked_for() -> None:
    with enabled({}) as (arm, behind):
        behind.drives[0].fail(0x2310)
        with pytest.raises(Fault, match="0x2310, continuous over-current"):
            running(arm, [0.0], 2)


def test_after_a_fault_the_arm_can_be_started_again() -> None:
    with enabled({}) as (arm, behind):
        behind.fail(behind.drives[0], 0x3210)
        with pytest.raises(Fault, match="DC link over-voltage"):
            running(arm, [1.0], 2)
        arm.start(np.zeros(1), RNG)
        arm.enable(True)
        assert behind.drives[0].state == ENABLED
        running(arm, [1.0], 3)


def test_a_fault_that_stays_is_refused() -> None:
    faulty = Drive(11, state=FAULTY, holds_fault=True)
    with bench({}, drives={1: faulty}) as (arm, _):
        faulty.entries[0x603F, 0].value = 0x4310
        arm.start(np.zeros(1), RNG)
        with pytest.raises(Fault) as caught:
            arm.enable(True)
        assert str(caught.value) == (
            "joint 1: the drive (node 11) could not be switched on within 3 s: it is in "
            '"fault": 0x4310, the drive is too hot'
        )


def test_quick_stop_by_the_drive_itself() -> None:
    with enabled({}, {}) as (arm, behind):
        behind.drives[1].state = QUICK_STOPPED
        with pytest.raises(Fault, match=r'joint 2: the drive \(node 12\) left "operation enabled" for "quick stop'):
            running(arm, [1.0, 1.0], 2)
        assert [drive.state for drive in behind.drives] == [DISABLED, DISABLED]


def test_a_lost_node_is_a_fault_after_as_many_periods_as_are_stated() -> None:
    with enabled({}, {}, patience=0.5) as (arm, behind):
        running(arm, [1.0, 1.0], 2)
        behind.drives[1].silent = True
        for _ in range(MISSED - 1):
            arm.apply([1.0, 1.0])
            arm.counts()
        arm.apply([1.0, 1.0])
        with pytest.raises(Fault) as caught:
            arm.counts()
        assert str(caught.value).startswith("joint 2: the drive (node 12) has not answered 3 times in a row; ")
        assert "did not report to be off; without this computer's heartbeat they switch off" in str(caught.value)
        assert (behind.drives[0].state, behind.drives[0].target) == (DISABLED, 0)
        # What the drive that hears nothing any more was told to do then.
        behind.drives[1].lose_host()
        assert behind.drives[1].state == DISABLED


def test_an_answer_that_is_missed_once_is_no_fault() -> None:
    with enabled({}, patience=0.3) as (arm, behind):
        before = running(arm, [0.0], 3)
        behind.drives[0].silent = True
        assert arm.counts().tolist() == before.tolist()
        behind.drives[0].silent = False
        running(arm, [0.0], 3)
        assert arm.missed == 1


def test_the_first_position_is_one_that_a_drive_has_told() -> None:
    slow = Drive(11, position=777)
    operational = slow.manage
    # It takes a while to become operational.
    slow.manage = lambda command: command != 1 and operational(command)  # type: ignore[method-assign]
    with bench({}, drives={1: slow}, patience=0.02) as (arm, behind):
        behind.advance = None

        def later(sync: int) -> None:
            if sync == 4:
                operational(1)

        behind.before = later
        assert arm.start(np.zeros(1), RNG).tolist() == [777]


def test_a_drive_that_answers_no_sync() -> None:
    deaf = Drive(11)
    deaf.tpdo = lambda: None  # type: ignore[method-assign]
    with (
        bench({}, drives={1: deaf}, patience=0.001) as (arm, _),
        pytest.raises(Fault, match=r"joint 1: the drive \(node 11\) answers no SYNC"),
    ):
        arm.start(np.zeros(1), RNG)


def test_the_drives_watch_this_computer() -> None:
    with bench({}) as (arm, behind):
        arm.start(np.zeros(1), RNG)
        entries = behind.drives[0].entries
        assert (entries[0x1016, 1].value, entries[0x6007, 0].value) == (127 << 16 | 100, 2)
        running(arm, [0.0], 50)
        # They begin to watch with the first heartbeat: not while this computer is still busy with other things.
        assert behind.heartbeats == 0
        arm.enable(True)
        before = behind.heartbeats
        running(arm, [0.0], 50)
        # 50 periods of 2 ms: a heartbeat each 10 ms, from the loop itself.
        assert behind.heartbeats - before in (9, 10, 11)
        arm.close()
        assert entries[0x1016, 1].value & 0xFFFF == 0


def _emergency(_: CanopenArm, behind: Drives, k: int) -> None:
    behind.fail(behind.drives[k], 0x2320)


def _brake(_: CanopenArm, behind: Drives, k: int) -> None:
    behind.drives[k].state = QUICK_STOPPED


def _disable(_: CanopenArm, behind: Drives, k: int) -> None:
    behind.drives[k].state = DISABLED


def _restart(_: CanopenArm, behind: Drives, k: int) -> None:
    behind.drives[k].manage(129)
    behind.drives[k].state = DISABLED
    behind.send(0x700 + behind.drives[k].node, b"\0")


def _no_number(arm: CanopenArm, _: Drives, k: int) -> None:
    arm.apply([float("nan") if j == k else 1.0 for j in range(3)])


@given(
    st.sampled_from([_emergency, _brake, _disable, _restart, _no_number]),
    st.integers(0, 2),
    st.integers(1, 8),
    st.lists(st.floats(-30.0, 30.0), min_size=3, max_size=3),
)
@settings(max_examples=25)
def test_whatever_fails_no_drive_holds_a_torque(
    fail: Callable[[CanopenArm, Drives, int], None], k: int, periods: int, torque: list[float]
) -> None:
    with enabled({}, {}, {}) as (arm, behind):
        running(arm, torque, periods)

        def goes_on() -> None:
            fail(arm, behind, k)
            running(arm, torque, 2)

        with pytest.raises(Fault, match=f"joint {k + 1}: |a torque of nan cannot be commanded"):
            goes_on()
        assert all(drive.state in (DISABLED, FAULTY) for drive in behind.drives)
        assert [drive.torque for drive in behind.drives] == [0.0] * 3


@pytest.mark.parametrize("periods", [2, 3])
def test_drives_that_were_being_switched_on_are_switched_off(periods: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """By whatever is between: someone presses Ctrl-C while the drives have power already and are not all on yet."""
    with bench({}) as (arm, behind):
        arm.start(np.zeros(1), RNG)
        period, passed = arm.pace.period, itertools.count()

        def interrupted() -> int:
            if next(passed) == periods:
                raise KeyboardInterrupt
            return period()

        with monkeypatch.context() as patch:
            patch.setattr(arm.pace, "period", interrupted)
            with pytest.raises(KeyboardInterrupt):
                arm.enable(True)
        drive = behind.drives[0]
        assert drive.state not in (DISABLED, FAULTY)
        arm.close()
        assert (drive.state, drive.target) == (DISABLED, 0)


def test_closing_in_motion_takes_the_power() -> None:
    with enabled({}, {}) as (arm, behind):
        running(arm, [3.0, 3.0], 3)
        arm.close()
        assert [(drive.state, drive.target) for drive in behind.drives] == [(DISABLED, 0)] * 2
        arm.close()


# --- refusals before any motion ---


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({(0x608F, 1): 4096}, "has 4096 counts per turn of the motor (encoder increments (0x608F:01)), and the model"),
        ({(0x608F, 2): 0}, "has no counts per turn of the motor"),
        ({(0x1000, 0): 0x00030191}, "has the profile 401; expected a servo drive, CiA 402"),
        ({(0x6502, 0): 0x01AD}, "has no cyclic synchronous torque mode (supported drive modes (0x6502:00))"),
        ({(0x6076, 0): 0}, "has motor rated torque (0x6076:00) 0; set it, or rated_torque under [joint.drive]"),
        ({(0x6072, 0): 500}, "is limited to 12.5 N m (max torque (0x6072:00): 500 per mille of 0.25 N m), less than"),
        ({(0x1016, 1): None}, "(Object does not exist); it would keep its last torque if this computer stopped"),
        ({(0x6007, 0): None}, "refuses abort connection option code (0x6007:00) to be set to 2"),
        ({(0x6064, 0): None}, "refuses TPDO 1, entry 2 (0x1A00:02) to be set to"),
    ],
)
def test_a_drive_that_does_not_fit_is_refused(change: dict[tuple[int, int], int | None], expected: str) -> None:
    drive = Drive(11)
    for key, value in change.items():
        if value is None:
            del drive.entries[key]
        else:
            drive.entries[key].value = value
    if (0x6064, 0) in change:
        drive.refresh = lambda: None  # type: ignore[method-assign]
    with bench({}, drives={1: drive}) as (arm, _):
        with pytest.raises(LinkError) as caught:
            arm.start(np.zeros(1), RNG)
        assert str(caught.value).startswith("joint 1: the drive (node 11) ")
        assert expected in str(caught.value)
        assert drive.state == DISABLED


def test_a_gear_ratio_in_the_drive_is_refused() -> None:
    drive = Drive(11)
    drive.entries |= {(0x6091, 1): Entry("I", 100), (0x6091, 2): Entry("I", 1)}
    with (
        bench({}, drives={1: drive}) as (arm, _),
        pytest.raises(LinkError, match="divides positions by a gear ratio of 100:1"),
    ):
        arm.start(np.zeros(1), RNG)


def test_a_node_that_is_not_there() -> None:
    drive = Drive(11, silent=True)
    with (
        bench({}, drives={1: drive}) as (arm, _),
        pytest.raises(LinkError, match="does not answer; is it on, and are its node id and bit rate right"),
    ):
        arm.start(np.zeros(1), RNG)


def test_joints_without_drives_are_named() -> None:
    with pytest.raises(LinkError) as caught:
        CanopenArm(model({"drive": None}, {}, {"drive": None}), CanAddress("x", "virtual"), pace())
    assert str(caught.value) == ('the model file of "bench" names no drive at joint 1, 3; add [joint.drive] with node')


def test_without_the_packages_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "canopen", None)
    with pytest.raises(LinkError) as caught:
        canopen_arm.open_network(CanAddress("can0"), print)
    assert str(caught.value) == (
        'canopen://can0: canopen is not installed; python -m pip install "canopen>=2.3" "python-can>=4.4"'
    )


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (OSError(errno.ENODEV, "No such device"), "there is no such CAN channel; list the channels with ip link"),
        (OSError(errno.EAFNOSUPPORT, "x"), "this system has no SocketCAN; load it (modprobe can_raw)"),
        (can.CanInitializationError("busy"), "cannot be opened through socketcan: busy"),
        (can.CanInterfaceNotImplementedError("x"), "interface socketcan cannot be used here: x"),
    ],
)
def test_a_channel_that_cannot_be_opened(monkeypatch: pytest.MonkeyPatch, error: Exception, expected: str) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(can, "Bus", fail)
    with pytest.raises(LinkError) as caught:
        canopen_arm.open_network(CanAddress("can0"), print)
    assert str(caught.value).startswith(f"canopen://can0: {expected}")


# --- a bus that fails in use ---


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (errno.ENOBUFS, "no frame is acknowledged; check the drives"),
        (errno.ENETDOWN, "the channel is down or the bus is off; check wiring, termination and bit rate"),
        (None, "the bus cannot be used any more: broken"),
    ],
)
def test_a_bus_that_takes_no_frames_is_a_fault(
    monkeypatch: pytest.MonkeyPatch, code: int | None, expected: str
) -> None:
    with enabled({}) as (arm, _):

        def fail(*_: object) -> None:
            raise can.CanOperationError("broken", code)

        with monkeypatch.context() as patch:
            patch.setattr(arm._network.bus, "send", fail)
            with pytest.raises(Fault) as caught:
                arm.counts()
        assert expected in str(caught.value)


def test_a_frame_that_is_not_taken_once_stops_the_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    with enabled({}) as (arm, behind):
        running(arm, [4.0], 3)
        send, failures = arm._network.bus.send, [can.CanOperationError("full", errno.ENOBUFS)]

        def once(*given_: object) -> None:
            if failures:
                raise failures.pop()
            send(*given_)

        with monkeypatch.context() as patch:
            patch.setattr(arm._network.bus, "send", once)
            with pytest.raises(Fault, match="no frame is acknowledged"):
                arm.apply([4.0])
        assert (behind.drives[0].state, behind.drives[0].target) == (DISABLED, 0)


def test_a_drive_that_has_restarted_is_set_up_anew() -> None:
    with bench({}) as (arm, behind):
        arm.start(np.zeros(1), RNG)
        drive = behind.drives[0]
        drive.manage(129)
        drive.__post_init__()
        behind.send(0x700 + drive.node, b"\0")
        with pytest.raises(Fault, match=r"joint 1: the drive \(node 11\) has restarted by itself; check its supply"):
            running(arm, [0.0], 2)
        arm.start(np.zeros(1), RNG)
        arm.enable(True)
        assert drive.state == ENABLED
        assert drive.entries[0x6007, 0].value == 2


def test_an_error_frame_of_bus_off_is_a_fault() -> None:
    with enabled({}) as (arm, behind):
        frame = can.Message(arbitration_id=0x40, data=bytes(8), is_error_frame=True, is_extended_id=False)
        behind._bus.send(frame)
        with pytest.raises(Fault, match="the bus is off; check wiring, termination and bit rate"):
            running(arm, [0.0], 3)
        assert behind.drives[0].state == DISABLED


# --- time ---


def test_periods_begin_when_they_should() -> None:
    time = Time()
    kept = Pace(0.002, time.now, time.sleep)
    begun = []
    for work in (0.0005, 0.0015, 0.0, 0.001):
        begun.append(kept.period())
        time.t += work
    assert begun == [0, 2000, 4000, 6000]
    assert (kept.kept.worst, kept.kept.overruns, kept.kept.periods) == (pytest.approx(0.0, abs=1e-12), 0, 4)


def test_a_period_that_is_missed_shows_and_is_not_made_up_for() -> None:
    time = Time()
    kept = Pace(0.002, time.now, time.sleep)
    kept.period()
    time.t += 0.0075
    assert [kept.period() for _ in range(3)] == [7500, 9500, 11500]
    assert kept.kept.overruns == 1
    assert kept.kept.worst == pytest.approx(0.0055)


def test_what_is_left_out_is_not_reported() -> None:
    time = Time()
    kept = Pace(0.002, time.now, time.sleep)
    assert [kept.period(), kept.period()] == [0, 2000]
    with kept.left_out():
        for _ in range(500):
            kept.period()
    assert [kept.period(), kept.period()] == [4000, 6000]
    assert kept.kept.overruns == 0


def test_precedence_is_taken_and_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int]] = []
    monkeypatch.setattr("os.sched_setscheduler", lambda _, policy, p: asked.append((policy, p.sched_priority)))
    before = sys.getswitchinterval()
    taken = Precedence()
    assert taken.granted
    assert sys.getswitchinterval() < before
    taken.give_up()
    assert sys.getswitchinterval() == before
    assert asked == [(os.SCHED_FIFO, 30), (os.SCHED_OTHER, 0)]


def test_struct_of_what_goes_over_the_bus() -> None:
    """Controlword and torque as the standard has them: little endian, 16 bits each."""
    seen: list[bytes] = []
    with bench({}) as (arm, behind):
        drive = behind.drives[0]
        take = drive.rpdo
        drive.rpdo = lambda data: (seen.append(data), take(data))[1]  # type: ignore[method-assign]
        arm.start(np.zeros(1), RNG)
        arm.enable(True)
        running(arm, [-10.0], 1)
    # 10 N m of 25 N m at the joint.
    assert struct.pack("<Hh", 0x000F, -400) in seen
