"""A host's conversation with a board: who it is, what it is told, what it records, and what it does not accept."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_arm import BENCH, THERE_AND_BACK, motion, trajectory
from driven import Rig, rig

from runtime.cli import output
from runtime.cli.main import app
from runtime.execution.trial import Trial
from runtime.hardware.link import Codec, LinkLost
from runtime.hardware.session import Refused, Session
from runtime.interruption import listening
from runtime.model.loader import Model
from runtime.workspace.source import Source

PLAN = trajectory(THERE_AND_BACK)


@pytest.fixture
def one(bench: Source, arm: Model) -> Rig:
    return rig(arm, bench.compiled.controller(), PLAN)


# --- before a run ---


def test_the_board_says_who_it_is(one: Rig) -> None:
    page = one.session.codec.document
    found = one.session.identify()
    assert {name: found[name] for name in ("version", "joints", "fingerprint", "max_phases", "max_rows")} == {
        name: page[name] for name in ("version", "joints", "fingerprint", "max_phases", "max_rows")
    }


@pytest.mark.parametrize(
    ("others", "said"),
    [
        ({"version": 2}, "uses version 1 of the protocol, this host version 2; rebuild its firmware"),
        ({"fingerprint": 1}, "of another arm or another version"),
        ({"build": 0}, "was generated from other equations or by another version of Tendon"),
    ],
)
def test_a_board_of_something_else_is_refused(one: Rig, others: dict[str, int], said: str) -> None:
    """Another protocol, another layout; gravity along another axis is the same layout and other equations."""
    with pytest.raises(Refused, match=said):
        Session(one.link, Codec({**one.session.codec.document, **others})).identify()


def test_a_trajectory_that_is_too_long_is_refused(bench: Source, arm: Model) -> None:
    stations, room = [0.1 * (-1) ** k for k in range(17)], "the board has room for 16 and 256"
    with pytest.raises(Refused, match=f"the trajectory has 17 phases with 102 control points; {room}"):
        rig(arm, bench.compiled.controller(), trajectory(motion(stations, [0.2] * 17))).prepared()
    phases = tuple(replace(p, points=np.tile(p.points[:, :1], 30)) for p in motion([0.0] * 9, [0.2] * 9))
    with pytest.raises(Refused, match=f"the trajectory has 9 phases with 270 control points; {room}"):
        rig(arm, bench.compiled.controller(), trajectory(phases)).prepared()


def test_a_board_that_another_host_left_running_is_stopped_first(one: Rig) -> None:
    one.prepared()
    # The other host stops talking in the middle of its run.
    one.session._command("arm")
    one.session._command("run", {"periods": 0, "every": 1})
    for _ in range(5):
        one.link.read(0.01)
    assert one.arm.powered
    fresh = Session(one.link, one.session.codec)
    fresh.identify()
    assert not one.arm.powered
    one.session = fresh
    assert one.driven().stop is None


def test_the_encoders_are_read_before_anything_moves(one: Rig) -> None:
    one.prepared()
    assert one.session.counts() == tuple(one.arm.counts())
    assert not one.arm.powered


def test_encoders_do_not_start_at_zero(bench: Source, clean: Trial) -> None:
    """The same motion, counted from elsewhere, even across the end of the counter."""
    for zero in (12_345, 2**31 - 100, -(2**31) + 100):
        text = BENCH.replace("counts = 2000.0", f"counts = 2000.0\nzero = {zero}")
        source = replace(bench, text=text)
        found = rig(source.compiled.model(), source.compiled.controller(), PLAN).driven()
        assert found.stop is None
        np.testing.assert_array_equal(found.q, clean.q)
        np.testing.assert_array_equal(found.tau, clean.tau)


# --- a run ---


@pytest.mark.parametrize("every", [2, 3, 10])
def test_fewer_records_of_the_same_motion(one: Rig, clean: Trial, every: int) -> None:
    found = one.prepared().run(every=every)
    for name in ("t", "q", "q_desired", "tau", "saturated"):
        np.testing.assert_array_equal(getattr(found, name), getattr(clean, name)[..., ::every])


@pytest.mark.parametrize("every", [1, 3, 7])
def test_the_record_of_the_step_that_stopped_the_arm_is_there(one: Rig, clean: Trial, every: int) -> None:
    one.prepared()
    one.arm.twist = lambda period, counts: counts + (100_000 if period >= 500 else 0)
    found = one.run(every=every)
    assert found.stop is not None
    assert found.stop.name == "encoder_jump"
    assert found.t[-1] == found.stop.t == 0.5
    np.testing.assert_array_equal(found.q[:, :-1], clean.q[:, :500:every])
    assert found.tau[0, -1] == 0.0


def test_runs_follow_each_other(one: Rig, clean: Trial) -> None:
    one.prepared()
    for _ in range(3):
        one.lockstep.start(one.settings.points[0], np.random.default_rng(1))
        np.testing.assert_array_equal(one.run().tau, clean.tau)


def test_the_board_hears_of_the_host_often_enough(one: Rig) -> None:
    """Of the silence that it tolerates, never more than a third passes."""
    heard: list[float] = []

    def listen(frame: bytes) -> list[bytes]:
        heard.append(one.link.now())
        return [frame]

    one.link.to_board = listen
    assert one.driven().stop is None
    assert 0 < np.diff(heard).max() < 0.2 / 3
    assert len(heard) < 100


def test_a_run_that_cannot_begin_leaves_the_drives_off(one: Rig) -> None:
    """Armed, and then the run is refused."""
    one.prepared()
    with pytest.raises(Refused, match="does not accept run: refused: a value is outside its range"):
        one.run(every=0)
    one.wait(1.0)
    assert not one.arm.powered


class Slow:
    """A board whose drives need so many periods with power until they are ready."""

    def __init__(self, board: Any, periods: int, code: int) -> None:
        self.board, self.left, self.code = board, periods, code

    def __getattr__(self, name: str) -> Any:
        return getattr(self.board, name)

    def period(self, counts: Any, time_us: int, fault: int) -> Any:
        found = self.board.period(counts, time_us, self.code if self.left and not fault else fault)
        self.left -= bool(found[0] and self.left)
        return found


def slow(one: Rig, periods: int) -> None:
    one.lockstep.board = Slow(one.lockstep.board, periods, one.session.codec.document["not_ready"])
    one.prepared().session.counts()


def test_drives_that_need_time_are_waited_for(one: Rig, clean: Trial) -> None:
    slow(one, 3000)
    found = one.run()
    assert found.stop is None
    assert len(one.arm.torques) > 3000 + len(found.t)
    # It has sunk a little, without torque.
    np.testing.assert_allclose(found.q, clean.q, atol=1e-3)


def test_drives_that_never_become_ready_are_not_waited_for_long(one: Rig) -> None:
    slow(one, 10**9)
    before = one.link.now()
    with pytest.raises(Refused, match="does not accept run: refused: the drives are not ready yet"):
        one.run()
    assert 9.0 < one.link.now() - before < 12.0
    one.wait(1.0)
    assert not one.arm.powered


def test_the_user_does_not_wait_for_drives(one: Rig) -> None:
    slow(one, 10**9)
    found = one.run(asked=lambda: int(one.arm.period > 100))
    assert found.stop is not None
    assert found.stop.name == "interrupted"
    assert not one.arm.powered


def test_an_error_of_the_host_stops_the_arm(one: Rig) -> None:
    one.prepared()

    def fail() -> int:
        if one.arm.period > 100:
            raise ZeroDivisionError
        return 0

    with pytest.raises(ZeroDivisionError):
        one.run(asked=fail)
    one.wait(1.0)
    assert not one.arm.powered
    one.check_safe(140)


def test_what_was_asked_to_stop_before_does_not_begin(one: Rig) -> None:
    found = one.prepared().run(asked=lambda: 1)
    assert found.stop is not None
    assert found.stop.reason == "interrupted (Ctrl-C, or its terminal was closed)"
    assert len(found.t) == 0
    assert not one.arm.begun


def test_an_arm_that_stands_elsewhere_is_not_moved(one: Rig) -> None:
    one.prepared()
    one.lockstep.start(np.array([0.2]), np.random.default_rng(1))
    found = one.run()
    assert found.stop is not None
    assert (found.stop.name, found.stop.joint, found.stop.t) == ("start_position", 1, 0.0)
    assert found.stop.reason == "stands 0.2 rad from the trajectory's start, over the limit of 0.05"
    assert np.abs(np.array(one.arm.torques)).max() < 0.1


class Dead:
    """A line at whose end there is nothing; time passes."""

    baud, late, fault = None, None, None

    def __init__(self) -> None:
        self.time = 0.0

    def write(self, data: bytes) -> None:
        pass

    def read(self, timeout: float) -> bytes:
        self.time += timeout
        return b""

    def now(self) -> float:
        return self.time

    def close(self) -> None:
        pass


class Babbling(Dead):
    """A line that brings noise, and no end of it."""

    def read(self, timeout: float) -> bytes:
        self.time += min(timeout, 1e-3)
        return np.random.default_rng(round(1e4 * self.time)).integers(0, 256, 64, dtype=np.uint8).tobytes()


@pytest.mark.parametrize("line", [Dead, Babbling])
def test_no_wait_is_without_an_end(one: Rig, line: Callable[[], Any]) -> None:
    dead = line()
    with pytest.raises(LinkLost, match=r"the board does not answer \(hello, 30 times\)"):
        Session(dead, one.session.codec).identify()
    assert dead.time < 4.0


# --- Ctrl-C ---


@pytest.mark.usefixtures("interrupts")
def test_control_c_is_counted_and_the_third_one_interrupts() -> None:
    with listening() as asked:
        assert asked() == 0
        for count in (1, 2):
            signal.raise_signal(signal.SIGINT)
            assert asked() == count
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_closed_terminal_is_one_wish_to_stop_however_often_it_is_told(name: str) -> None:
    with listening() as asked:
        for _ in range(4):
            signal.raise_signal(getattr(signal, name))
            assert asked() == 1
        signal.raise_signal(signal.SIGINT)
        assert asked() == 2


TARGETS = [
    pytest.param("simulation", signal.SIGINT, marks=pytest.mark.slow),
    pytest.param("simulation", signal.SIGHUP, marks=pytest.mark.slow),
    pytest.param("simulation", signal.SIGTERM, marks=pytest.mark.slow),
    pytest.param(
        "qemu",
        signal.SIGINT,
        marks=pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="needs qemu-system-arm"),
    ),
]


def at_work(pid: int, seconds: float) -> None:
    """Waits until a process has used so much processor time more: later where the machine is busy."""

    def used() -> float:
        # The fields after the name, which stands in parentheses: user and system time are the 12th and 13th.
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    start = used()
    while used() < start + seconds:
        time.sleep(0.01)


@contextmanager
def executing(folder: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """`tendon execute` of the bench in a folder, for an hour."""
    (folder / "bench.toml").write_text(BENCH)
    PLAN.write(folder / "plan.json")
    # What is started in the background is born deaf to interrupts.
    program = "import signal; signal.signal(2, signal.default_int_handler); import runtime.cli.main as m; m.main()"
    command = [sys.executable, "-c", program, "execute", "bench.toml", "plan.json", "--cycles", "3000", "--trials", "1"]
    root = str(Path(__file__).resolve().parents[3])
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(  # type: ignore[call-overload]
        [*command, *options],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": root},
        text=True,
        start_new_session=True,
        **pipes,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def heard(process: subprocess.Popen[str], word: str) -> None:
    """Waits until a process has said so."""
    assert process.stderr is not None
    while word not in process.stderr.readline():
        assert process.poll() is None


@pytest.mark.parametrize(("on", "said"), TARGETS)
def test_control_c_stops_the_arm_and_the_recording_is_written(
    bench: Source, tmp_path: Path, on: str, said: signal.Signals
) -> None:
    """As a terminal does it: the signal goes to everything that was started there."""
    bench.compiled.controller("host" if on == "simulation" else "cortex-m4f")
    with executing(tmp_path, "--on", on, "--out", "run.csv", "--json", "-") as started:
        heard(started, "executing")
        at_work(started.pid, 0.4)
        os.killpg(started.pid, said)
        out, err = started.communicate(timeout=60)
    assert started.returncode == 1, err
    document = json.loads(out)
    assert document["status"] == "stopped"
    assert document["trials"][0]["stop"]["name"] == "interrupted"
    assert "interrupted (Ctrl-C, or its terminal was closed)" in document["reason"]
    assert len((tmp_path / "run.csv").read_text().splitlines()) > 100


@pytest.mark.parametrize("said", [pytest.param(signal.SIGINT, marks=pytest.mark.slow), signal.SIGTERM])
def test_a_simulated_run_is_stopped_within_a_second_and_its_recording_kept(
    bench: Source, tmp_path: Path, said: signal.Signals
) -> None:
    """Of three, since what else the machine does counts as well. What is hidden is chosen before the arm moves."""
    bench.compiled.controller()

    def took() -> float:
        with executing(tmp_path, "--on", "simulation", "--hide", "stribeck@1", "--out", "run.csv") as started:
            heard(started, "executing")
            at_work(started.pid, 0.5)
            began = time.monotonic()
            started.send_signal(said)
            _, err = started.communicate(timeout=20)
            seconds = time.monotonic() - began
        assert started.returncode == 1, err
        assert len((tmp_path / "run.csv").read_text().splitlines()) > 100
        return seconds

    assert any(took() < 1.0 for _ in range(3))


@pytest.mark.parametrize(
    ("said", "status"), [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, -signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_before_the_arm_moves_a_signal_ends_all_within_a_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: signal.Signals, status: int
) -> None:
    """While the controller is derived and compiled, in a cache of its own."""
    (tmp_path / "cache").mkdir(mode=0o700)
    monkeypatch.setenv("TENDON_CACHE", str(tmp_path / "cache"))

    def took() -> float:
        with executing(tmp_path, "--on", "simulation", "--out", "run.csv") as started:
            heard(started, "deriving")
            at_work(started.pid, 0.1)
            began = time.monotonic()
            started.send_signal(said)
            started.communicate(timeout=20)
            seconds = time.monotonic() - began
        assert started.returncode == status
        assert not (tmp_path / "run.csv").exists()
        return seconds

    assert any(took() < 1.0 for _ in range(3))


def test_more_periods_than_a_recording_may_have_are_refused(
    bench: Source, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before anything is computed, and in one line."""
    (tmp_path / "bench.toml").write_text(bench.text)
    PLAN.write(tmp_path / "plan.json")
    command = ["execute", str(tmp_path / "bench.toml"), str(tmp_path / "plan.json"), "--on", "simulation"]
    assert output.run(app, [*command, "--cycles", "10000", "--hide", "stribeck@1"]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("3 trials of 14001.4 s are 42004200 control periods; expected at most 5000000")


def test_a_terminal_that_is_closed_costs_no_recording(bench: Source, tmp_path: Path) -> None:
    """With all that is said there."""
    bench.compiled.controller()
    (tmp_path / "bench.toml").write_text(BENCH)
    PLAN.write(tmp_path / "plan.json")
    near, far = os.openpty()
    command = [sys.executable, "-c", _IN_A_TERMINAL, "execute", "bench.toml", "plan.json", "--on", "simulation"]
    started = subprocess.Popen(
        [*command, "--cycles", "3000", "--trials", "1", "--out", "run.csv", "--json", "e.json"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[3])},
        stdin=far,
        stdout=far,
        stderr=far,
        start_new_session=True,
    )
    os.close(far)
    said = b""
    while b"executing" not in said:
        said += os.read(near, 4096)
    at_work(started.pid, 0.4)
    os.close(near)
    assert started.wait(timeout=60) == 1
    assert json.loads((tmp_path / "e.json").read_text())["trials"][0]["stop"]["name"] == "interrupted"
    assert len((tmp_path / "run.csv").read_text().splitlines()) > 100


_IN_A_TERMINAL = """
import fcntl, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
import runtime.cli.main
runtime.cli.main.main()
"""
