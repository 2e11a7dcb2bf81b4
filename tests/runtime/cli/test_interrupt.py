"""Ctrl-C: every verb that takes long ends within a second with status 130 and leaves nothing half done."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from runtime.cli import output
from runtime.interruption import heard_afterwards, heard_in_casadi
from runtime.model.loader import Library
from runtime.planning import optimize
from runtime.planning.interior_point import Bounded, Manner
from runtime.planning.optimize import random_start
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
    """A folder with a recording that takes some seconds to read and to fit."""
    folder = tmp_path_factory.mktemp("recorded")
    with started(["simulate", "drive", "--out", "run.csv", "--seconds", "1000"], folder) as process:
        assert process.wait(60) == 0
    return folder


def interrupted(arguments: Sequence[str], folder: Path) -> float:
    """For how long a verb goes on when it is interrupted at work, s."""
    with started(arguments, folder) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "begun\n"
        time.sleep(0.8)
        assert process.poll() is None, process.communicate()
        began = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=10)
        took = time.monotonic() - began
    assert (process.returncode, out) == (130, "")
    assert err.splitlines()[-1] == "interrupted"
    assert "Traceback" not in err
    return took


@pytest.mark.parametrize("arguments", LONG, ids=lambda arguments: arguments[0])
def test_control_c_ends_a_verb(arguments: Sequence[str], recorded: Path) -> None:
    before = sorted(recorded.iterdir())
    # Of three, since what else the machine does counts as well.
    assert any(interrupted(arguments, recorded) < 1.0 for _ in range(3))
    kept = {"demo-report", "table.csv.journal"}
    assert [p for p in sorted(recorded.iterdir()) if p not in before and p.name not in kept] == []
    assert list(recorded.rglob(".*")) == []


def casadi_is_asked() -> None:
    """CasADi turns its argument into a matrix; meanwhile comes Ctrl-C."""

    class Pressed:
        def __DM__(self) -> ca.DM:
            os.kill(os.getpid(), signal.SIGINT)
            return ca.DM(1.0)

    with suppress(NotImplementedError):
        ca.sin(Pressed())


@pytest.fixture
def own_ctrl_c() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("own_ctrl_c")
def test_control_c_is_not_lost_in_casadi() -> None:
    casadi_is_asked()
    with pytest.raises(KeyboardInterrupt), heard_in_casadi():
        casadi_is_asked()
    with heard_in_casadi():
        pass
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("own_ctrl_c")
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


@pytest.mark.usefixtures("own_ctrl_c")
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


@pytest.mark.parametrize("seconds", [0.3, 0.6])
def test_a_solver_does_not_take_control_c_for_an_answer(library: Library, seconds: float) -> None:
    """IPOPT ends where it is; what it has then is no plan."""
    model = planning_cases.arm(library, "rr")
    scenario = planning_cases.and_back(model, 1.0, {"q1": 0.0, "q2": 0.0}, {"q1": 1.0, "q2": -1.0})
    solver = optimize.Planner(model, scenario).fine
    x = random_start(solver.program, np.random.default_rng(0))
    p = solver.program.task.p.vector(solver.program.task.values(0.1, 1.0))
    whole = Bounded(solver._kernels, p, *solver.rows, *solver.bounds({}))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            deque((solver._by_ipopt(Manner(1e-8, 400, 0.1, 1e-2), x, whole) for _ in range(10_000)), 1)
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)
