"""Motions from files on the simulated arm: what the file says is played, and what cannot be is refused by its line."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from bench_arm import BENCH
from numpy.typing import NDArray

from runtime.notebook.arm import load
from runtime.notebook.planned import execute
from runtime.recordings import recording
from tests.runtime.conftest import Run


@pytest.fixture
def played(tendon: Run) -> Run:
    """`tendon execute` of the bench and its motion."""
    Path("bench.toml").write_text(BENCH)

    def execute(*arguments: object, on: str = "simulation") -> tuple[int, str, str]:
        return tendon("execute", "bench.toml", "motion.csv", "--on", on, *arguments)

    return execute


def swings(seconds: float, rate: float = 1000.0, size: float = 0.6) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times and positions: two swings that begin and end at rest."""
    t = np.arange(round(seconds * rate) + 1) / rate
    fade = np.sin(np.pi * t / seconds) ** 4
    return t, size * fade * np.sin(4 * np.pi * t / seconds)


def write(t: Sequence[float], q: Sequence[float], notes: Sequence[str] = (), digits: int = 10) -> None:
    lines = [*(f"# {note}" for note in notes), "t [s],q1 [rad]"]
    Path("motion.csv").write_text(
        "\n".join([*lines, *(f"{a:.4f},{b:.{digits}f}" for a, b in zip(t, q, strict=True))]) + "\n"
    )


@pytest.mark.parametrize(("speed", "rate"), [(1.0, 1000.0), (0.2, 1000.0), (1.0, 200.0)])
def test_what_is_played_is_what_the_file_says(played: Run, speed: float, rate: float) -> None:
    t, q = swings(4.0, rate)
    write(t, q, ["NOT CHECKED: the cat", "another comment"])
    status, out, _ = played("--speed", speed, "--out", "run.csv", "--json", "-")
    assert status == 0
    said = json.loads(out)
    assert said["unchecked"] == ["the cat"]
    assert (said["speed"], said["played"]["samples"]) == (speed, len(t))
    assert said["played"]["rate"] == pytest.approx(speed * rate)
    assert len(said["trials"]) == 1
    made = recording.read(Path("run.csv"), None)
    assert made.t[-1] == pytest.approx(4.0 / speed + 0.25, abs=0.01)
    assert made.q_desired is not None
    wanted = np.interp(speed * made.t, t, q)
    assert np.abs(made.q_desired[0] - wanted).max() < (1e-4 if rate == 1000.0 else 1e-3)
    assert np.abs(made.q[0] - wanted).max() < 0.03


def test_the_terminal_begins_with_what_is_not_checked(played: Run) -> None:
    write(*swings(2.0), ["NOT CHECKED: the cat"])
    assert played()[1].startswith("NOT CHECKED:\n  the cat\n")
    write(*swings(2.0))
    assert "The file does not say what was checked" in played()[1].splitlines()[1]


def test_a_board_of_this_computer_holds_long_motions(played: Run) -> None:
    write(*swings(20.0, 100.0))
    assert played()[0] == 0
    status, out, _ = played("--json", "-", on="unicorn")
    assert status == 0
    assert json.loads(out)["played"]["phases"] > 30


def test_what_the_motion_asks_of_the_torque_is_checked_at_the_pace_that_it_is_played(played: Run) -> None:
    write(*swings(0.5, size=0.17))
    status, out, _ = played("--out", "run.csv")
    assert status == 1
    assert "REFUSED before the motion" in out
    assert "torque of joint 1" in out
    assert "beyond the limit of 25" in out
    assert not Path("run.csv").exists()
    assert played("--speed", 0.3)[0] == 0


def jump(t: NDArray[np.float64], q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return t, q + 0.01 * (t > 1.0)


@pytest.mark.parametrize(
    ("made", "digits", "words"),
    [
        (jump(*swings(2.0)), 10, "line 1003: q1 steps by 0.0138 rad in 1 ms, 13.8 rad/s; the joint's limit is 5\n"),
        (swings(2.0), 3, "from one sample to the next"),
        (tuple(np.delete(x, slice(400, 500)) for x in swings(2.0)), 10, "line 402: 0.101 s after the sample before it"),
        (tuple(x[:700] for x in swings(2.0)), 10, "line 701: the motion ends while q1 moves at"),
        (swings(2.0, 10.0), 10, "from where its neighbours put it, at 10 Hz"),
    ],
)
def test_what_a_controller_cannot_play_is_refused_by_line(
    played: Run, made: tuple[NDArray[np.float64], NDArray[np.float64]], digits: int, words: str
) -> None:
    write(*made, digits=digits)
    status, out, err = played("--out", "run.csv")
    assert (status, out) == (2, "")
    assert words in err
    assert not Path("run.csv").exists()


def test_a_motion_brings_no_model(played: Run) -> None:
    write(*swings(2.0))
    status, _, err = played("--model-out", "other.toml")
    assert status == 2
    assert "a motion brings no springs" in err


def test_a_notebook_plays_motions(played: Run) -> None:  # noqa: ARG001 (where the files are)
    write(*swings(2.0))
    done = execute(load("bench.toml"), "motion.csv", speed=0.5)
    assert done.recording is not None
    assert done.recording.t[-1] == pytest.approx(4.25, abs=0.01)
