"""Ctrl-C: every long verb ends within a second of processor time with status 130 and leaves nothing half done."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import casadi as ca
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv

from runtime.cli import output
from runtime.interruption import heard_afterwards, heard_at_last, heard_in_casadi
from runtime.model.loader import Library
from runtime.planning import optimize
from runtime.simulation.motion_file import read_motion
from tests.runtime.planning import planning_cases

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no signals there")

PROGRAM = (
    "import signal\n"
    # What is started in the background is born deaf to interrupts.
    "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "from runtime.cli.main import main\n"
    "print('begun', file=__import__('sys').stderr, flush=True)\n"
    "main()\n"
)
LONG = [
    ("simulate", "drive", "--out", "new.csv", "--seconds", "3000"),
    ("inspect", "run.csv", "drive"),
    ("identify", "drive", "run.csv"),
    ("compare", "drive", "run.csv", "--report", "report"),
    ("diagnose", "drive", "run.csv", "--report", "report"),
    ("improve", "drive", "run.csv", "--out", "better.toml", "--report", "report"),
    ("generate", "panda"),
    ("verify", "panda"),
    ("firmware", "panda", "--target", "host"),
    ("experiment", "drive", "--between", "linear_spring@1,gravity", "--out", "motion.csv"),
    ("optimize", "scenario2", "--starts", "40", "--out", "plan.json"),
    ("sweep", "scenario2", "--over", "seed=0:9", "--table", "table.csv"),
    ("paper", "--out", "study"),
    ("demo",),
]
"""Verbs that take seconds."""
AT_WORK = 0.5
"""s of processor time after which a verb has imported its libraries and is at work."""


@contextmanager
def started(arguments: Sequence[str], folder: Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", PROGRAM, *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, cwd=folder, text=True, start_new_session=True, **pipes) as process:  # type: ignore[call-overload]
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording that takes seconds to read and to fit."""
    folder = tmp_path_factory.mktemp("recorded")
    t = np.arange(0.0, 1000.0, 0.001)
    q, qd, qdd = (sum(a * w**k * np.sin(w * t + k * np.pi / 2) for a, w in ((0.8, 1.1), (0.2, 5.3))) for k in range(3))
    tau = 0.24 * qdd + 1.1 * qd + np.sign(qd) + np.random.default_rng(0).normal(0.0, 0.05, len(t))
    csv.write_csv(pa.table({"t": t, "q1": q, "tau1": tau}), folder / "run.csv")
    return folder


def processor_time(group: int) -> float:
    """s that the processes of a group, and those that its leader has waited for, have used so far."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            pid, _, rest = stat.read_text().partition(" ")
            fields = rest.rpartition(")")[2].split()
            if int(fields[2]) == group:
                ticks += sum(map(int, fields[11 : 15 if int(pid) == group else 13]))
    return ticks / os.sysconf("SC_CLK_TCK")


def interrupted(arguments: Sequence[str], folder: Path) -> float:
    """s of processor time that a verb goes on when it is interrupted after AT_WORK of it."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with started(arguments, folder) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "begun\n"
        begun = processor_time(process.pid)
        while process.poll() is None and processor_time(process.pid) < begun + AT_WORK:
            time.sleep(0.02)
        assert process.poll() is None, process.communicate()
        used = processor_time(process.pid)
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=120)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert (process.returncode, out, err.splitlines()[-1:]) == (130, "", ["interrupted"])
    assert "Traceback" not in err
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime - used


@pytest.mark.parametrize("arguments", LONG, ids=lambda arguments: arguments[0])
def test_control_c_ends_a_verb(arguments: Sequence[str], recorded: Path) -> None:
    before = sorted(recorded.iterdir())
    assert interrupted(arguments, recorded) < 1.0
    kept = {"demo-report", "table.csv.journal"}
    assert [p for p in sorted(recorded.iterdir()) if p not in before and p.name not in kept] == []
    assert list(recorded.rglob(".*")) == []


def test_a_search_for_a_motion_ends_with_the_best_so_far(tmp_path: Path) -> None:
    """At the first Ctrl-C, which every process of the search hears."""
    with started(["experiment", "ur10", "--seconds", "40", "--out", "motion.csv"], tmp_path) as process:
        assert process.stderr is not None
        said = iter(process.stderr.readline, "")
        assert any(line.startswith("searching the Fourier motion") for line in said)
        time.sleep(0.3)
        os.killpg(process.pid, signal.SIGINT)
        rest = "".join(said)
        assert process.wait(timeout=120) == output.NO, rest
    assert "ending with the best so far" in rest
    assert read_motion(tmp_path / "motion.csv", 6).shape[1] > 20_000


@pytest.mark.usefixtures("interrupts")
def test_ctrl_c_that_something_dropped_comes_again() -> None:
    with heard_at_last():
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            time.sleep(60)
    time.sleep(0.3)  # not after the end


@pytest.mark.usefixtures("interrupts")
def test_what_tidies_up_after_ctrl_c_is_not_disturbed() -> None:
    tidied = []
    with heard_at_last(), suppress(KeyboardInterrupt):
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            time.sleep(0.5)
            tidied.append(1)
    assert tidied


def casadi_is_asked() -> None:
    """CasADi turns its argument into a matrix; meanwhile comes Ctrl-C."""

    class Pressed:
        def __DM__(self) -> ca.DM:
            os.kill(os.getpid(), signal.SIGINT)
            return ca.DM(1.0)

    with suppress(NotImplementedError):
        ca.sin(Pressed())


@pytest.mark.usefixtures("interrupts")
def test_control_c_is_not_lost_in_casadi() -> None:
    casadi_is_asked()
    with pytest.raises(KeyboardInterrupt), heard_in_casadi():
        casadi_is_asked()
    with heard_in_casadi():
        pass
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("interrupts")
@pytest.mark.parametrize("error", [NotImplementedError, RuntimeError])
def test_what_control_c_became_in_casadi_is_control_c_again(error: type[Exception]) -> None:
    def fails(pressed: bool) -> None:
        with suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT if pressed else 0)
        raise error("no such argument")

    with pytest.raises(KeyboardInterrupt), heard_in_casadi():
        fails(pressed=True)
    with pytest.raises(error), heard_in_casadi():
        fails(pressed=False)


@pytest.mark.usefixtures("interrupts")
def test_control_c_waits_for_the_end_where_it_would_be_forgotten() -> None:
    done = []

    def work() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        done.append("all")

    with pytest.raises(KeyboardInterrupt), heard_afterwards():
        work()
    assert done == ["all"]


def test_control_c_while_compiled_code_is_imported(capsys: pytest.CaptureFixture[str]) -> None:
    def importing(**_: object) -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise ImportError("initialization failed") from error

    assert output.run(importing, ["list"]) == 130  # type: ignore[arg-type]
    assert capsys.readouterr().err == "interrupted\n"


@pytest.mark.usefixtures("interrupts")
@pytest.mark.parametrize("seconds", [0.05, 0.1])
def test_a_solver_does_not_take_control_c_for_an_answer(library: Library, seconds: float) -> None:
    """IPOPT ends where it is; what it has then is no plan. seconds: of processor time until Ctrl-C."""
    model = planning_cases.arm(library, "rr")
    scenario = planning_cases.and_back(model, 1.0, {"q1": 0.0, "q2": 0.0}, {"q1": 1.0, "q2": -1.0})
    solver = optimize.Planner(model, scenario).fine
    x = optimize.random_start(solver.program, np.random.default_rng(0))
    alarmed = signal.signal(signal.SIGPROF, lambda *_: os.kill(os.getpid(), signal.SIGINT))
    try:
        signal.setitimer(signal.ITIMER_PROF, seconds)
        with pytest.raises(KeyboardInterrupt):
            deque((solver.run(x, 0.1) for _ in range(10_000)), 1)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, alarmed)
