"""A board on a serial port: this computer's build of the machine behind a pseudo-terminal, in real time at 100 Hz."""

from __future__ import annotations

import json
import os
import re
import select
import shutil
import threading
import time
import tty
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import serial
from bench_arm import BENCH, motion, trajectory
from msgspec import UNSET

from codegen.prepare import prepare_arm, prepare_firmware
from runtime.execution.execute import SimulatedArm
from runtime.execution.real import decimation
from runtime.hardware import session
from runtime.hardware.boards import HostBoard, QemuBoard, UnicornBoard
from runtime.hardware.link import LinkError, LinkLost, SerialLink
from runtime.hardware.lockstep import Board
from runtime.hardware.settings import ControllerError, Settings
from runtime.model.loader import Library, Model
from runtime.notebook.arm import load
from runtime.notebook.planned import execute
from runtime.planning.evaluate import mounted
from runtime.recordings import recording
from runtime.recordings.columns import RecordedArm
from runtime.simulation.plant import Plant
from runtime.workspace.source import Source
from symbolic.effects import LIBRARY
from symbolic.model_file.arm import Arm
from tests.runtime.conftest import Refused, Run

SLOW = BENCH.replace("rate = 1000.0", "rate = 100.0").replace("velocity_cutoff = 100.0", "velocity_cutoff = 25.0")
PLAN = trajectory(motion([0.0, -0.3], [0.4, 0.4])[:1], periodic=False)


class Bench(threading.Thread):
    """The bench, its motor and its board, with a serial port; moved on by a control period every 10 ms, or later."""

    def __init__(self, model: Model, directory: Path, board: Callable[[Path, str, int], Board] = HostBoard) -> None:
        super().__init__(daemon=True)
        settings = Settings.of(directory, model, PLAN)
        self.arm = SimulatedArm(Plant(model, mounted(model, PLAN), settings.dt), settings)
        self.board = board(directory, model.name, model.n)
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.device = os.ttyname(self.slave)
        self.dt, self.over, self.deaf = settings.dt, threading.Event(), False
        self.clock = 1.0
        self.torques: list[float] = []
        self.place(0.0)

    def place(self, q: float) -> None:
        """Where someone has put the arm, at rest."""
        self.arm.start(np.array([q]), np.random.default_rng(0))

    def run(self) -> None:
        period, enabled = 0, False
        while not self.over.is_set():
            # Time is counted, not measured: a busy machine makes a slow board, not one that misses periods.
            period += 1
            due = time.monotonic() + self.dt
            while (left := due - time.monotonic()) > 0:
                if select.select([self.master], [], [], left)[0] and not self.deaf:
                    self.board.receive(os.read(self.master, 4096))
                    os.write(self.master, self.board.send())
            on, torque = self.board.period(self.arm.counts(), round(1e6 * self.clock * period * self.dt), 0)
            if on != enabled:
                enabled = on
                self.arm.enable(on)
            self.torques.append(float(torque[0]))
            self.arm.apply(torque)
            if not self.deaf:
                os.write(self.master, self.board.send())

    def close(self) -> None:
        self.over.set()
        if self.is_alive():
            self.join()
        self.board.close()
        for end in (self.master, self.slave):
            os.close(end)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    path = tmp_path_factory.mktemp("bench") / "bench.toml"
    path.write_text(SLOW)
    return Source.read(path, None)


@pytest.fixture(scope="module")
def arm(source: Source) -> Model:
    return source.compiled.model()


@pytest.fixture
def bench(source: Source, arm: Model) -> Iterator[Bench]:
    made = Bench(arm, source.compiled.controller())
    made.start()
    yield made
    made.close()


@pytest.fixture
def here(here: Path) -> Path:
    (here / "bench.toml").write_text(SLOW)
    PLAN.write(here / "plan.json")
    return here


@pytest.fixture(autouse=True)
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """The board and its host share this process: on a busy machine either may wait for the other."""
    monkeypatch.setattr(session, "_SILENT", 1.0)
    monkeypatch.setattr(session, "_END", 30.0)  # the board's periods last longer then


@pytest.fixture
def called(here: Path, tendon: Run) -> Run:  # noqa: ARG001 - where the files are
    """`tendon execute` of the bench and its plan."""
    return partial(tendon, "execute", "bench.toml", "plan.json")


# --- a run ---


BOARDS = [
    pytest.param(HostBoard, id="host"),
    pytest.param(UnicornBoard, id="unicorn"),
    pytest.param(
        QemuBoard,
        id="qemu",
        marks=[
            pytest.mark.slow,
            pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="needs qemu-system-arm"),
        ],
    ),
]


@pytest.fixture
def behind(source: Source, arm: Model) -> Iterator[Callable[..., Bench]]:
    """A bench with a board of some kind: the firmware's image, emulated, behind a serial port."""
    made: list[Bench] = []

    def on(board: Callable[..., Any]) -> Bench:
        made.append(Bench(arm, source.compiled.controller("host" if board is HostBoard else "cortex-m4f"), board))
        made[-1].start()
        while not made[-1].torques:
            time.sleep(0.01)  # an emulator takes its time to start
        return made[-1]

    yield on
    for one in made:
        one.close()


@pytest.mark.parametrize("board", BOARDS)
def test_a_motion_over_a_serial_port(
    behind: Any, called: Run, tendon: Run, arm: Model, board: Callable[..., Any]
) -> None:
    """There and back, three times, and the recording goes through compare."""
    bench = behind(board)
    trajectory(motion([0.0, -0.3], [0.4, 0.4])).write(Path("plan.json"))
    files = ("--cycles", 2, "--out", "run.csv", "--json", "e.json", "--model-out", "mounted.toml")
    status, out, _ = called("--on", f"serial://{bench.device}?baud=115200", "--arm", *files)
    assert status == 0, out
    assert "The same on the simulated arm:" in out
    document = json.loads(Path("e.json").read_text())
    assert document["status"] == "done"
    assert document["every"] == 1
    assert document["link"]["damaged"] == {}
    assert document["link"]["board"]["bad_crc"] == 0
    assert len(document["trials"]) == 1
    back = recording.read(Path("run.csv"), RecordedArm(arm.joints, arm.spatial))
    np.testing.assert_allclose(np.diff(back.t), 0.01)
    assert len(back.t) == 240
    assert back.q[0].min() == pytest.approx(-0.3, abs=0.02)
    assert tendon("compare", "mounted.toml", "run.csv")[0] == 0


def test_without_arm_nothing_moves(bench: Bench, called: Run) -> None:
    """What it would do is shown, the board is asked whether it fits, and where the arm stands."""
    status, out, _ = called("--on", f"serial://{bench.device}")
    assert status == 1
    assert "room to the end of the range" in out
    assert "The board answers and takes the motion" in out
    assert re.search(r"joint 1: stands at -?0\.000 rad, the motion starts at -?0\.000\n", out)
    assert "REFUSED, nothing has moved: a real arm moves only with --arm" in out


def test_python_asks_the_same_questions_before_an_arm_moves(
    bench: Bench, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not told to move, it looks and predicts; told to, it says the prediction and moves."""
    mine, on = load(here / "bench.toml"), f"serial://{bench.device}?baud=115200"
    looked = execute(mine, here / "plan.json", on=on)
    assert (looked.status, looked.recording) == ("refused", None)
    assert "move=True" in str(looked.reason)
    assert looked.prediction is not None
    assert looked.document.board is not UNSET
    done = execute(mine, here / "plan.json", on=on, move=True, cycles=1)
    assert (done.status, done.document.on) == ("done", on)
    assert done.recording is not None
    assert done.prediction is not None
    assert np.abs(done.recording.tau[0]).max() < 1.5 * done.prediction.joints[0].torque
    assert "room to the end of the range" in capsys.readouterr().out
    for wrong in ({"hide": "linear_spring@1"}, {"on": "/dev/ttyACM0"}, {"on": "simulation", "move": True}):
        with pytest.raises(
            (ControllerError, LinkError), match=r"--hide is for the sim|did you mean serial://|--arm is for a real arm"
        ):
            execute(mine, here / "plan.json", **{"on": on, **wrong})


def test_without_arm_and_without_a_board(called: Run) -> None:
    status, out, _ = called("--on", "serial:///dev/nowhere")
    assert status == 1
    assert "room to the end of the range" in out
    assert "The arm cannot be asked where it stands: /dev/nowhere: there is no such port" in out
    assert "REFUSED, nothing has moved: a real arm moves only with --arm" in out


def test_a_slow_line_carries_fewer_records_and_says_so(bench: Bench, called: Run) -> None:
    """38 bytes of 10 bits, 100 times a second: 38 kbit/s, of which 90 % of 19200 is less than a half."""
    status, out, _ = called("--on", f"serial://{bench.device}?baud=19200", "--arm", "--out", "run.csv")
    assert status == 0, out
    assert "The line carries one record in 3 control periods; the others are left out." in out
    t = np.genfromtxt("run.csv", delimiter=",", skip_header=1)[:, 0]
    np.testing.assert_allclose(np.diff(t), 0.03)


def test_the_boards_own_clock_stamps_the_records(bench: Bench, called: Run) -> None:
    """A timer that is set 2 % too slow shows in the recording, and is told."""
    bench.clock = 1.02
    status, out, _ = called("--on", f"serial://{bench.device}", "--arm", "--out", "run.csv")
    assert status == 0, out
    assert "The board's records are 10.2 ms apart, by the model file 10 ms: set its timer" in " ".join(out.split())
    t = np.genfromtxt("run.csv", delimiter=",", skip_header=1)[:, 0]
    np.testing.assert_allclose(np.diff(t), 0.0102)


def test_an_arm_that_stands_elsewhere_is_not_moved(bench: Bench, called: Run) -> None:
    bench.place(0.2)
    status, _, err = called("--on", f"serial://{bench.device}", "--arm")
    assert status == 2
    assert "the arm is not where the trajectory starts: joint 1 stands at 0.200 rad, the trajectory starts at 0" in err
    assert not any(bench.torques)


def test_it_is_driven_to_the_start_if_that_is_wanted(bench: Bench, called: Run) -> None:
    bench.place(0.2)
    status, out, _ = called("--on", f"serial://{bench.device}", "--arm", "--approach", "--json", "e.json")
    assert status == 0, out
    assert json.loads(Path("e.json").read_text())["mean"]["q_min"][0] == pytest.approx(-0.3, abs=0.02)


def test_what_was_recorded_before_something_fails_is_kept(bench: Bench, called: Run) -> None:
    """The motion ends elsewhere than it starts: there is no second one."""
    files = ("--out", "run.csv", "--json", "e.json")
    status, _, _ = called("--on", f"serial://{bench.device}", "--arm", "--trials", 2, *files)
    assert status == 1
    document = json.loads(Path("e.json").read_text())
    assert [len(trial["cycles"]) for trial in document["trials"]] == [1, 0]
    assert "trial 2 at t = 0 s: the arm is not where the trajectory starts" in document["reason"]
    assert len(Path("run.csv").read_text().splitlines()) == 66


def test_a_cable_that_is_pulled_in_motion(bench: Bench, called: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_END", 1.0)  # nobody answers until then

    def pull() -> None:
        # Twenty control periods of motion, however long a busy machine takes for them.
        while sum(map(bool, bench.torques)) < 20:
            time.sleep(0.01)
        bench.deaf = True

    threading.Thread(target=pull, daemon=True).start()
    status, out, _ = called("--on", f"serial://{bench.device}", "--arm", "--out", "run.csv", "--json", "e.json")
    assert status == 1
    assert "SAFE STOP" in out
    document = json.loads(Path("e.json").read_text())
    assert document["trials"][0]["stop"]["name"] == "link_lost"
    assert len(Path("run.csv").read_text().splitlines()) > 5
    # The board stops by itself: until then this waits, and the test ends by its patience otherwise.
    deadline = time.monotonic() + 30.0
    while any(bench.torques[-10:]) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(bench.torques[-10:])


@pytest.mark.parametrize(
    ("rate", "baud", "every"),
    [(1000, 1_000_000, 1), (1000, 115_200, 7), pytest.param(4000, 1_000_000, 4, marks=pytest.mark.slow)],
)
def test_a_record_each_control_period_at_1_khz_over_1_mbaud(
    vishard4: Arm, library: Library, rate: int, baud: int, every: int
) -> None:
    """Of the paper's arm: 73 bytes, of 10 bits each, and a tenth of the line left for acknowledgements."""
    assert vishard4.controller is not None
    made = replace(vishard4, controller=replace(vishard4.controller, rate=float(rate)))
    model = Model(prepare_arm(made), library)
    assert decimation(prepare_firmware(made, LIBRARY), model, baud) == every


# --- what is in the way before it ---


@pytest.mark.parametrize("key", ["position", "speed", "torque"])
def test_no_real_arm_moves_without_limits(called: Run, here: Path, key: str) -> None:
    line = next(line for line in SLOW.splitlines() if line.startswith(f"{key} = "))
    (here / "bench.toml").write_text(SLOW.replace(f"{line}\n", "", 1))
    status, out, err = called("--on", "serial:///dev/nowhere", "--arm")
    assert (status, out) == (2, "")
    assert f"too few limits for a real arm; add to [joint.limits]: {key} at joint 1" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--on", "serial:///dev/nowhere"], "/dev/nowhere: there is no such port; is the board plugged in?"),
        (["--on", "serial://"], "expected serial:///dev/ttyACM0 or serial:///dev/ttyUSB0?baud=1000000"),
        (["--on", "serial:///dev/nowhere?baud=fast"], "expected serial:///dev/ttyACM0"),
        (["--on", "serial:///dev/nowhere?speed=1"], 'unknown key "speed"; expected baud and dtr: serial:///dev/tty'),
        (["--on", "serial:///dev/nowhere?dtr=no"], "expected serial:///dev/ttyACM0"),
        (["--on", "/dev/ttyACM0"], "canopen://can0; did you mean serial:///dev/ttyACM0?"),
        (["--on", "serial:///dev/nowhere", "--hide", "offset@1:torque=1"], "--hide is for the simulated arm"),
        (
            ["--on", "telnet://board"],
            "--on telnet://board: no such target; there is: simulation, unicorn, qemu, serial",
        ),
    ],
)
def test_mistakes_are_one_line(here: Path, refused: Refused, arguments: list[str], message: str) -> None:  # noqa: ARG001
    assert message in refused("execute", "bench.toml", "plan.json", *arguments, "--arm")


def test_arm_is_not_for_the_simulation(called: Run) -> None:
    assert "--arm is for a real arm, and --on simulation is none" in called("--on", "simulation", "--arm")[2]


def test_a_port_that_another_program_holds(bench: Bench) -> None:
    first = SerialLink.of(f"serial://{bench.device}")
    with pytest.raises(LinkError, match="another program uses this port; close it first"):
        SerialLink.of(f"serial://{bench.device}")
    first.close()
    SerialLink.of(f"serial://{bench.device}").close()


def test_opening_a_port_need_not_reset_the_board(bench: Bench) -> None:
    """By DTR or RTS, that is set where nothing else is said; a board that talks again only later is waited for."""
    for query, line in (("", True), ("?baud=115200", True), ("?dtr=1", True), ("?dtr=0", False)):
        link = SerialLink.of(f"serial://{bench.device}{query}")
        assert (link._port.dtr, link._port.rts) == (line, line)
        link.close()


def test_a_port_without_permission(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise serial.SerialException(13, "could not open port /dev/ttyACM0: [Errno 13] Permission denied")

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(LinkError, match="no permission; join the group that owns it: sudo usermod -aG dialout"):
        SerialLink("/dev/ttyACM0")


def test_nobody_at_the_other_end(called: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_GREETINGS", 3)
    master, slave = os.openpty()
    tty.setraw(slave)
    status, _, err = called("--on", f"serial://{os.ttyname(slave)}", "--arm")
    os.close(master)
    os.close(slave)
    assert status == 2
    assert "the board does not answer (hello, 3 times); is its firmware running?" in err


def test_a_port_that_goes_away_is_a_lost_link() -> None:
    master, slave = os.openpty()
    link = SerialLink(os.ttyname(slave))
    os.close(slave)
    os.close(master)
    with pytest.raises(LinkLost, match="is gone"):
        link.read(0.05)
    link.close()


def swing(path: Path, seconds: float, start: float = 0.0) -> Path:
    """A motion's file: a smooth swing of the joint from `start` and back."""
    t = np.arange(0.0, seconds, 0.001)
    q = start - 0.3 * (1 - np.cos(2 * np.pi * t / seconds)) ** 2
    path.write_text("t [s],q1 [rad]\n" + "".join(f"{a:.3f},{b:.10f}\n" for a, b in zip(t, q, strict=True)))
    return path


def test_a_motions_file_is_played_where_the_board_has_room_and_the_arm_stands_at_its_start(
    bench: Bench, here: Path, tendon: Run
) -> None:
    def played(path: Path) -> tuple[int, str, str]:
        on = ("--on", f"serial://{bench.device}", "--arm", "--out", "run.csv")
        return tendon("execute", "bench.toml", path, *on)

    status, _, err = played(swing(here / "long.csv", 12.0))
    assert status == 2
    assert "phases with 384 control points; the board has room for 16 and 256; play a shorter motion, or build" in err
    status, _, err = played(swing(here / "elsewhere.csv", 4.0, start=-0.4))
    assert status == 2
    assert "joint 1 stands at 0.0" in err
    assert "the trajectory starts at -0.400" in err
    assert not (here / "run.csv").exists()
    status, out, _ = played(swing(here / "swing.csv", 4.0))
    assert status == 0
    assert out.startswith("NOT CHECKED:")
    assert recording.read(here / "run.csv", None).q.min() == pytest.approx(-1.2, abs=0.05)


def test_firmware_of_another_arm(bench: Bench, called: Run, here: Path) -> None:
    """The same joint with another effect to compensate: other settings, so another layout."""
    (here / "bench.toml").write_text(SLOW + "[joint.effects.offset]\ntorque = 0.1\n")
    status, _, err = called("--on", f"serial://{bench.device}", "--arm")
    assert status == 2
    assert "the board's firmware is of another arm or another version" in err
    assert "rebuild it (tendon firmware)" in err


def test_the_serial_library_is_an_extra(called: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "serial", None)
    assert "a serial port needs pyserial: pip install pyserial" in called("--on", "serial:///dev/x", "--arm")[2]


def test_emulators_that_are_missing_say_what_to_install(called: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    which = shutil.which
    monkeypatch.setattr(shutil, "which", lambda name: None if name == "qemu-system-arm" else which(name))
    status, _, err = called("--on", "qemu")
    assert status == 2
    assert "apt install qemu-system-arm" in err.splitlines()[-1]
    monkeypatch.setitem(__import__("sys").modules, "unicorn", None)
    assert "--on unicorn needs the emulator: pip install unicorn" in called("--on", "unicorn")[2]
