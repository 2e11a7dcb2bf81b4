"""Work of many parts: in order, told to who listens, ended by an exception."""

from __future__ import annotations

import itertools
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime import progress
from runtime.progress import Progress, each, heard_by, of_each, of_long, on_cores, steps, within
from runtime.report import terminal


@given(st.lists(st.integers(0, 5), max_size=30))
def test_results_come_in_the_order_of_the_parts(parts: list[int]) -> None:
    assert of_each("squares", lambda part: part * part, parts) == [part * part for part in parts]


def test_every_part_is_told_and_the_time_left_falls_to_nothing() -> None:
    told: list[Progress] = []
    with heard_by(told.append):
        of_each("waits", lambda _: time.sleep(0.01), range(8))
    of_each("unheard", str, range(3))
    assert [(p.what, p.done, p.parts) for p in told] == [("waits", k, 8) for k in range(1, 9)]
    assert told[0].left > 0.0 == told[-1].left


def test_steps_are_told_and_what_they_tell_of_themselves_is_not() -> None:
    told: list[Progress] = []
    with heard_by(told.append):
        for part in each("outer", range(3)):
            of_each("inner", str, range(part))
    assert [(p.what, p.done, p.parts) for p in told] == [("outer", k, 3) for k in (1, 2, 3)]
    assert told[-1].left == 0.0
    with heard_by(told.append), steps("more than thought", 1) as step:
        step()
        step()
    assert told[-1].left == 0.0


def test_where_no_line_can_be_written_over_one_comes_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = itertools.count()
    monkeypatch.setattr(time, "monotonic", lambda: float(next(now)))
    with terminal.working("waiting"):
        for _ in each("waits", range(300)):
            pass
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 59, "one every 10 s, and none when less than a second is left"
    assert all(re.fullmatch(r"waiting … waits \d+ of 300 \(\d+%\), \d+ s left", line) for line in lines)


def test_an_exception_ends_the_work() -> None:
    def fails(part: int) -> int:
        if part == 2:
            raise ValueError("two")
        return part

    with pytest.raises(ValueError, match="two"):
        of_each("parts", fails, range(5))


def test_long_parts_are_done_one_by_one_on_one_core() -> None:
    done: list[int] = []
    with on_cores(1):
        results = of_long(done.append, range(3))
        next(results)
    assert done == [0]


@pytest.mark.skipif(sys.platform != "linux", reason="one process there")
def test_long_parts_are_done_elsewhere_from_the_first_on() -> None:
    with on_cores(2):
        found = list(of_long(lambda part: (part * part, os.getpid()), range(4)))
    assert [square for square, _ in found] == [0, 1, 4, 9]
    assert os.getpid() not in {process for _, process in found}


def asleep(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


@pytest.mark.skipif(sys.platform != "linux", reason="one process there")
def test_long_parts_elsewhere_end_where_no_further_one_is_asked_for() -> None:
    began = time.monotonic()
    with on_cores(2):
        results = of_long(asleep, [0.0, 60.0, 60.0])
        assert next(results) == 0.0
        results.close()
    assert time.monotonic() - began < 30.0


@pytest.mark.skipif(sys.platform != "linux", reason="one process there")
def test_long_parts_elsewhere_end_when_the_time_has_passed() -> None:
    """The one that is done comes, the others are not waited for, nor begun here."""
    began = time.monotonic()
    with on_cores(2), within(1.0):
        assert list(of_long(asleep, [0.0, 60.0, 60.0])) == [0.0]
    assert time.monotonic() - began < 30.0


@pytest.mark.skipif(sys.platform != "linux", reason="one process there")
def test_the_rest_is_done_elsewhere_in_order_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first part is taken to be so long that the others are given to two processes."""
    monkeypatch.setattr(progress, "_WORTH_FORKING", 0.0)
    told: list[Progress] = []

    def work(part: int) -> tuple[int, int]:
        return part * part, os.getpid()

    with on_cores(2), heard_by(told.append):
        found = of_each("squares", work, range(12))
    assert [square for square, _ in found] == [part * part for part in range(12)]
    assert len({process for _, process in found}) == 3
    assert [p.done for p in told] == list(range(1, 13))
    with on_cores(1):
        assert {process for _, process in of_each("here", work, range(7))} == {os.getpid()}


@pytest.mark.skipif(sys.platform != "linux", reason="one process there")
@pytest.mark.parametrize("ended", ["raises", "dies"])
def test_a_part_elsewhere_that_raises_ends_the_work_and_one_that_dies_is_done_here(
    ended: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "_WORTH_FORKING", 0.0)

    def work(part: int) -> int:
        (tmp_path / str(os.getpid())).touch()
        if part == 5 and ended == "raises":
            raise ValueError("five")
        if part == 5 and os.getpid() != here:
            os._exit(9)
        return part

    here = os.getpid()
    with on_cores(2):
        if ended == "raises":
            with pytest.raises(ValueError, match="five"):
                of_each("parts", work, range(9))
        else:
            assert of_each("parts", work, range(9)) == list(range(9))
    elsewhere = {int(worked.name) for worked in tmp_path.iterdir()} - {here}
    assert elsewhere
    for process in elsewhere:
        with pytest.raises(ChildProcessError):
            os.waitpid(process, os.WNOHANG)


@pytest.mark.skipif(sys.platform != "linux", reason="one process there")
def test_an_interrupt_ends_all_processes_within_a_second() -> None:
    code = (
        "import os, signal, time\n"
        "from runtime.progress import of_each, on_cores\n"
        # What is started in the background is born deaf to interrupts.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def work(part):\n"
        "    os.write(1, b'%d\\n' % part)\n"
        "    time.sleep(0.3 if part == 0 else 60)\n"
        "with on_cores(2):\n"
        "    of_each('waits', work, range(9))\n"
    )
    command = [sys.executable, "-c", code]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
    ) as process:
        assert process.stdout is not None
        assert sorted(process.stdout.readline() for _ in range(3)) == [b"0\n", b"1\n", b"2\n"]
        began = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(5) == -signal.SIGINT
        assert time.monotonic() - began < 1.0
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
