"""What would take without end is refused, or answers at once: pipes, absurd cycle times, thousands of phases."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from runtime.cli import output
from runtime.cli.main import app
from runtime.hardware import canopen_arm, link
from runtime.hardware.link import LinkError
from runtime.model.loader import Model
from runtime.planning import trajectory
from runtime.planning.settings import MOST_PHASES
from runtime.recordings import recording
from runtime.recordings.contents import RecordingError
from runtime.workspace.names import ARMS
from symbolic.model_file import checks, reader
from symbolic.model_file.checks import ModelError
from tests.runtime.conftest import Refused

PROGRAM = "from runtime.cli.main import main; main()"
LATER = """
import os, sys, time
while True:
    try:
        descriptor = os.open(sys.argv[1], os.O_WRONLY | os.O_NONBLOCK)
        break
    except OSError:  # nobody reads yet
        time.sleep(0.01)
os.set_blocking(descriptor, True)
os.write(descriptor, b"x" * 50000)
os.write(descriptor, b"x" * 50000)
"""


def test_a_pipe_into_which_nobody_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "LONGEST_WAIT", 0.05)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(ModelError, match=r"pipe: cannot be read: delivered nothing within 0\.05 s; expected a file"):
        reader.read_text(pipe)
    with pytest.raises(
        RecordingError, match=r"pipe: is a pipe or a device, which can be read only once; save it to a file first"
    ):
        recording.read(pipe, None)
    assert output.run(app, ["effects", "--effects", str(pipe)]) == 2


def test_a_pipe_into_which_somebody_writes(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen([sys.executable, "-c", LATER, str(pipe)]):
        assert reader.read_text(pipe) == "x" * 100_000


def test_a_model_comes_out_of_a_pipe(here: Path) -> None:
    """Once: nothing is looked up in it again."""
    os.mkfifo("pipe")
    writing = "import sys; open('pipe', 'w').write(open(sys.argv[1]).read())"
    with subprocess.Popen([sys.executable, "-c", writing, str(ARMS / "drive.toml")]):
        assert output.run(app, ["generate", "pipe", "--out", "made"]) == 0
    assert (here / "made" / "drive_f32.c").is_file()


def test_a_number_of_400_digits_is_a_seed_like_any_other(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    assert output.run(app, ["simulate", "drive", "--out", str(path), "--seconds", "5", "--seed", "9" * 400]) == 0
    assert path.is_file()


@pytest.mark.parametrize("seconds", ["1e300", "inf", "nan", "1e9", "9" * 400, "0", "-1"])
def test_a_cycle_time_that_cannot_be_meant(refused: Refused, seconds: str) -> None:
    assert "--cycle-time" in refused("optimize", "scenario1", "--cycle-time", seconds)


def phases(count: int, seconds: float = 0.01) -> str:
    ends = [[0.0, 0.0, 0.1, 0.1], [0.1, 0.1, 0.0, 0.0]]
    motion = [{"coordinates": "q", "duration": seconds, "points": [ends[k % 2]]} for k in range(count)]
    return json.dumps(
        {"format": trajectory.FORMAT, "arm": "drive", "scenario": "s", "periodic": True, "springs": [], "contact": {}}
        | {"phases": motion}
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (phases(15_000), f"phases: found 15000; expected at most {MOST_PHASES}"),
        (phases(2, 1e300), "phases: their durations are 2e+300 s together; expected at most 3600 s"),
        (phases(2, 1e-320), "phase 1: duration is 9.99989e-321 s; expected at least 1e-06 s"),
        ('{"format": ' + "9" * 10_000 + "}", "not valid JSON"),
        (" " * 20_000_001, "is larger than 20 MB"),
    ],
)
def test_a_trajectory_that_cannot_be_meant(drive: Model, tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "plan.json"
    path.write_text(text)
    with pytest.raises(trajectory.TrajectoryError) as caught:
        trajectory.read(path, drive)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "address", ["serial://[::1", "serial://[", "serial:///dev/x?baud=" + "9" * 5000, "serial://x?baud=²"]
)
def test_an_address_that_is_none(address: str) -> None:
    with pytest.raises(LinkError, match="expected serial:///dev/ttyACM0"):
        link.serial_address(address)
    with pytest.raises(LinkError, match="expected canopen://can0"):
        canopen_arm.parse_can_address("canopen://[::1")


def test_a_small_file_that_unpacks_to_much_fills_no_memory(tmp_path: Path) -> None:
    """300 MB of header in 300 kB, in a process that may have 1 GB."""
    script = (
        "import gzip, sys\n"
        "with gzip.open(sys.argv[1], 'wb', compresslevel=1) as file:\n"
        "    file.write(b't,q1,tau1,')\n"
        "    for _ in range(300): file.write(b'x' * 1_000_000)\n"
    )
    path = tmp_path / "run.csv.gz"
    subprocess.run([sys.executable, "-c", script, str(path)], check=True)

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_DATA, (1_000_000_000, 1_000_000_000))

    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, "compare", "drive", str(path)],
        capture_output=True,
        text=True,
        preexec_fn=limited,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 2
    assert done.stderr.startswith(f"{path} line 1: is longer than")


def opened(pid: int, path: Path) -> bool:
    """Whether a process has a file open."""
    return any(os.path.realpath(each) == str(path) for each in Path(f"/proc/{pid}/fd").iterdir())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_long_reading_is_ended_within_a_second(tmp_path: Path, number: signal.Signals) -> None:
    path = tmp_path / "run.csv"
    row = "".join(f"{k / 1000},{k % 7},{k % 5}\n" for k in range(1000))
    path.write_text("t,q1,tau1\n" + row * 4900)

    def took() -> float:
        command = [sys.executable, "-c", "import signal; signal.signal(2, signal.default_int_handler)\n" + PROGRAM]
        with subprocess.Popen([*command, "inspect", str(path)], stderr=subprocess.PIPE) as process:
            while not opened(process.pid, path):
                assert process.poll() is None
                time.sleep(0.01)
            began = time.monotonic()
            process.send_signal(number)
            process.communicate(timeout=20)
            return time.monotonic() - began

    assert any(took() < 1.0 for _ in range(3))


@pytest.mark.parametrize("step", [1e-9, 1e-6])
def test_a_clock_in_another_unit_is_refused_before_anything_is_filtered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], step: float
) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t,q1,tau1\n" + "".join(f"{k * step!r},{(k * k) % 1000 / 1000},{k % 7}\n" for k in range(6000)))
    assert output.run(app, ["compare", "drive", str(path)]) == 2
    assert f"the median step of t is {step:.4g} s; expected at least 1e-05 s" in capsys.readouterr().err
