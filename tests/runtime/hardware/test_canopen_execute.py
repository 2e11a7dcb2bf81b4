"""`tendon execute --on canopen://…` from end to end: the simulated arm behind simulated drives on a virtual bus."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from runtime.cli import output
from runtime.cli.main import app
from runtime.documents.plans import ExecuteDocument
from runtime.execution import real
from runtime.execution.execute import SimulatedArm
from runtime.execution.results import PlannedCycle
from runtime.hardware import canopen_arm
from runtime.hardware.can_drive import Controlword
from runtime.hardware.canopen_arm import CanopenLink
from runtime.hardware.lockstep import Pace
from runtime.hardware.settings import Settings
from runtime.model.loader import Model
from runtime.plain_json import plain
from runtime.planning.trajectory import Phase, Trajectory
from runtime.recordings import recording
from runtime.recordings.columns import RecordedArm
from runtime.simulation.plant import Plant
from runtime.workspace.source import Source
from tests import one_joint
from tests.bench_arm import CONTROLLER, JOINT
from tests.runtime.hardware.canopen_drives import DISABLED, ENABLED, Drive, Drives
from tests.runtime.hardware.test_canopen import PATIENT, PERIOD, Time

DRIVE = "[joint.drive]\nnode = 5\ndirection = -1\n"
SLOWER = CONTROLLER.replace("1000.0", "500.0").replace("100.0", "60.0")
MODEL = one_joint.model_text(JOINT + DRIVE, "bench", controller=SLOWER)
RATED = 250  # mN m: 25 N m at the joint
_channels = itertools.count()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("canopen")
    (path / "bench.toml").write_text(MODEL)
    stations = [(0.0, 0.5), (0.5, 0.0)]
    phases = tuple(Phase("q", 0.3, np.array([[a] * 3 + [b] * 3])) for a, b in stations)
    motion = Trajectory(
        "bench", "there and back", phases, elbow=1.0, friction=True, periodic=False, springs={}, contact={}
    )
    motion.write(path / "motion.json")
    return path


@pytest.fixture(scope="module")
def bench(folder: Path) -> Source:
    return Source.read(folder / "bench.toml", None)


@pytest.fixture(scope="module")
def model(bench: Source) -> Model:
    return bench.compiled.model()


def _at_joint(torques: list[float]) -> np.ndarray:
    """N m behind the gear, of motors that turn against their joints."""
    return np.array([-100.0 * torque for torque in torques], dtype=np.float32)


class Braked(SimulatedArm):
    """The simulated arm, held until the first torque: it matters not for how many periods there is none."""

    def enable(self, on: bool) -> None:
        """The brake does not open yet."""

    def apply(self, torque: np.ndarray) -> None:
        if np.any(torque):
            super().enable(True)
        super().apply(torque)


class Motors:
    """The simulated arm, seen from its drives: torques and counts of the motors, which turn against their joints."""

    def __init__(self, model: Model, directory: Path, motion: Path) -> None:
        from runtime.planning.trajectory import read

        plan = PlannedCycle(model, read(motion, model))
        settings = Settings.of(directory, model, plan.trajectory)
        self.arm = Braked(Plant(model, plan.terms, settings.dt), settings)
        self.position = self._motors(self.arm.start(plan.motion.q[:, 0], np.random.default_rng([0, 0])))

    def __call__(self, torques: list[float]) -> list[int]:
        self.arm.apply(_at_joint(torques))
        return self._motors(self.arm.counts())

    def _motors(self, counts: np.ndarray) -> list[int]:
        return [-int(count) for count in counts]


def _refuse(*_: object) -> None:
    raise PermissionError


Bus = tuple[str, Drives]
Executed = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def executed(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Executed:
    """`tendon execute` in a time that passes with the periods: its exit status, its JSON or its complaint."""

    def run(on: str, *more: str, time: Time | None = None) -> tuple[int, dict[str, Any]]:
        time = time or Time()
        monkeypatch.setattr(os, "sched_setscheduler", _refuse)
        link = partial(CanopenLink, pace=Pace(PERIOD, time.now, time.sleep), patience=PATIENT)
        monkeypatch.setitem(
            real.LINES, "canopen", real.ArmLine(canopen_arm.parse_can_address, canopen_arm.check_link, link)
        )
        capsys.readouterr()
        arguments = ["execute", str(folder / "bench.toml"), str(folder / "motion.json"), "--on", on, "--json", "-"]
        status = output.run(app, [*arguments, *more])
        out, err = capsys.readouterr()
        if out.startswith("{"):
            document = json.loads(out)
            assert plain(msgspec.convert(document, ExecuteDocument)) == document
            return status, document
        # What is compiled the first time says so.
        complaint = "\n".join(line for line in err.strip().splitlines() if not line.endswith("…"))
        return status, {"text": out, "complaint": complaint}

    return run


@pytest.fixture
def drives(bench: Source, model: Model, folder: Path) -> Iterator[tuple[str, Drives]]:
    """A bus with the arm's drive on it, and how `--on` names it."""
    channel = f"execute-{next(_channels)}"
    motors = Motors(model, bench.compiled.controller(), folder / "motion.json")
    with Drives(channel, [Drive(5, rated=RATED, position=motors.position[0])], motors) as behind:
        yield f"canopen://{channel}?interface=virtual", behind


class Rounding(Braked):
    """With torques as coarse as a drive takes them: 1 per mille of 25 N m."""

    def apply(self, torque: np.ndarray) -> None:
        super().apply(_at_joint([-round(float(t) / 25.0 * 1000.0) / 1000.0 * RATED / 1000.0 for t in torque]))


def test_it_does_what_the_simulation_does_but_for_the_rounding_of_torques(
    executed: Executed, drives: Bus, model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = tmp_path / "simulation.csv", tmp_path / "drives.csv"
    with monkeypatch.context() as patch:
        patch.setattr("runtime.execution.execute.SimulatedArm", Rounding)
        status, simulated = executed("simulation", "--trials", "1", "--noise", "0", "--out", str(here))
    assert status == 0
    on, behind = drives
    status, found = executed(on, "--arm", "--out", str(there))
    assert (status, found.get("status")) == (0, "done"), found
    assert (behind.drives[0].state, behind.drives[0].target) == (DISABLED, 0)
    one, other = (recording.read(path, RecordedArm(model.joints, model.spatial)) for path in (here, there))
    assert len(one.t) > 300
    # The same counts and torques in every period, to the last bit.
    for name in ("t", "q", "tau", "q_desired"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert found["mean"] == simulated["mean"]
    assert found["drives"]["resolution"] == [pytest.approx(0.025)]
    assert found["drives"]["missed_answers"] == found["drives"]["overruns"] == 0
    assert found["next"][0]["command"].startswith("tendon compare ")


def test_a_drive_fails_in_motion(executed: Executed, drives: Bus, tmp_path: Path) -> None:
    out = tmp_path / "stopped.csv"
    on, behind = drives
    drive = behind.drives[0]

    def fail(_: int) -> None:
        if abs(drive.position) > 4000 and drive.state == ENABLED:
            behind.fail(drive, 0x2310, 0x03)

    behind.before = fail
    status, found = executed(on, "--arm", "--out", str(out))
    assert drive.torque == 0.0
    assert (status, found["status"]) == (1, "stopped")
    assert found["trials"][0]["stop"]["name"] == "drive"
    assert (
        'joint 1: the drive (node 5) left "operation enabled" for "fault": 0x2310, continuous over-current '
        "(error register: generic, current)"
    ) in found["reason"]
    # What was recorded ends where the fault came about, after 4000 counts of 200,000 in a turn.
    last = out.read_text().splitlines()[-1].split(",")
    assert float(last[1]) == pytest.approx(2 * np.pi * 4000 / 200_000, rel=0.05)
    assert float(last[2]) == 0.0


@pytest.mark.parametrize(("gap", "name"), [(0.009, None), (0.011, "watchdog")])
def test_a_computer_that_stalls_in_motion(executed: Executed, drives: Bus, gap: float, name: str | None) -> None:
    """10 ms between two control steps are let pass, more are a safe stop."""
    time = Time()
    on, behind = drives
    drive, stalled = behind.drives[0], []

    def busy(sync: int) -> None:
        if abs(drive.position) > 4000 and not stalled:
            stalled.append(sync)
            time.t += gap

    behind.before = busy
    status, found = executed(on, "--arm", time=time)
    assert (drive.state, drive.target) == (DISABLED, 0)
    assert stalled
    stop = found["trials"][0]["stop"]
    assert (status, stop and stop["name"]) == ((0, None) if name is None else (1, name))
    assert found["drives"]["overruns"] == 1


def test_drives_are_switched_on_and_off_for_each_trial(executed: Executed, drives: Bus) -> None:
    on, behind = drives
    status, found = executed(on, "--arm", "--trials", "2")
    words = [word for kind, word, *_ in behind.drives[0].heard if kind == "word"]
    assert (status, len(found["trials"])) == (0, 2)
    changes = [word for word, before in zip(words, [None, *words], strict=False) if word != before]
    trial = [Controlword.SHUTDOWN, Controlword.SWITCH_ON, Controlword.ENABLE_OPERATION, Controlword.DISABLE_VOLTAGE]
    assert changes == 2 * trial


def test_a_drive_that_does_not_go_off_is_told_and_the_recording_kept(
    executed: Executed, drives: Bus, model: Model, tmp_path: Path
) -> None:
    out = tmp_path / "run.csv"
    on, behind = drives
    drive = behind.drives[0]
    obey = drive.obey
    drive.obey = lambda word: None if word == 0 and drive.state == ENABLED else obey(word)  # type: ignore[method-assign]
    status, found = executed(on, "--arm", "--out", str(out))
    assert drive.torque == 0.0
    assert (status, found["status"]) == (1, "stopped")
    assert found["reason"].startswith("joint 1: the drive (node 5) did not report to be off; without this computer's")
    assert len(recording.read(out, RecordedArm(model.joints, model.spatial)).t) > 300


def test_what_a_person_reads(executed: Executed, drives: Bus, tmp_path: Path) -> None:
    on, _ = drives
    status, found = executed(on, "--arm", "--json", str(tmp_path / "figures.json"))
    assert status == 0
    said = " ".join(found["text"].split())
    assert "there and back on canopen://execute-" in said
    assert "frames fill 13.25 % of execute-" in said
    assert "joint 1: torques are rounded to 0.025 N m " in said
    assert json.loads((tmp_path / "figures.json").read_text())["drives"]["real_time"] is False


def test_nothing_moves_without_arm(executed: Executed, drives: Bus) -> None:
    on, behind = drives
    status, found = executed(on)
    assert (status, found["status"]) == (1, "refused")
    # Asked where it stands, and never told more than to be without power.
    assert found["board"]["standing"][0]["position"] == pytest.approx(found["board"]["standing"][0]["start"], abs=0.01)
    drive = behind.drives[0]
    assert (drive.state, drive.target) == (DISABLED, 0)
    assert {word for kind, word, *_ in drive.heard if kind == "word"} <= {Controlword.DISABLE_VOLTAGE}


@pytest.mark.parametrize(
    ("others", "expected"),
    [
        ({"counts": 4096}, "joint 1: the drive (node 5) has 4096 counts per turn of the motor"),
        ({"most": 900}, "joint 1: the drive (node 5) is limited to 22.5 N m (max torque (0x6072:00): 900 per mille"),
        ({"node": 6}, "joint 1: the drive (node 5) does not answer; is it on, and are its node id and bit rate right?"),
    ],
)
def test_a_drive_that_is_not_that_of_the_model_is_bad_input(
    executed: Executed, others: dict[str, int], expected: str
) -> None:
    channel = f"execute-{next(_channels)}"
    with Drives(channel, [Drive(**{"node": 5, "rated": RATED, **others})]) as behind:
        status, found = executed(f"canopen://{channel}?interface=virtual", "--arm")
        assert status == 2
        assert found["complaint"].startswith(expected)
        assert behind.drives[0].state == DISABLED


@pytest.mark.parametrize(
    ("on", "expected"),
    [
        ("canopen://x?interface=virtual&bitrate=125000", "1 drives at 500 Hz fill 106.0% of a bus of 0.125 Mbit/s"),
        ("canopen://x?interface=nonsense", "canopen://x: interface nonsense cannot be used here"),
        ("canopen://?interface=virtual", "expected canopen://can0?interface=socketcan&bitrate=1000000"),
    ],
)
def test_a_bus_that_cannot_be_used_is_bad_input(executed: Executed, on: str, expected: str) -> None:
    status, found = executed(on, "--arm")
    assert status == 2
    assert expected in found["complaint"]
    assert "\n" not in found["complaint"]


def test_a_model_without_a_controller_is_told_what_it_lacks(executed: Executed, folder: Path) -> None:
    whole = (folder / "bench.toml").read_text()
    begin, end = whole.index("[controller]"), whole.index("[[joint]]")
    try:
        (folder / "bench.toml").write_text(whole[:begin] + whole[end:])
        status, found = executed("canopen://x?interface=virtual", "--arm")
    finally:
        (folder / "bench.toml").write_text(whole)
    assert status == 2
    assert "lacks [controller]; tendon init --controller MODEL --write" in found["complaint"]


def test_what_can_be_said_without_the_bus_is_said_without_arm(executed: Executed) -> None:
    status, found = executed("canopen://x?interface=virtual&bitrate=125000")
    assert status == 2
    assert "set rate in [controller] to at most 370 Hz" in found["complaint"]
