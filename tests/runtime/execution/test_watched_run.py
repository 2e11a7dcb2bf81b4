"""A watched model on the board: floors from a recording, then a joint whose friction grows in the middle of a run."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from runtime.documents.plans import WatchedEntry
from runtime.execution import execute as execution
from runtime.execution.options import ExecutionSettings
from runtime.hardware.boards import HostBoard, QemuBoard, UnicornBoard
from runtime.hardware.lockstep import Board, Float32
from runtime.hardware.settings import ControllerError
from runtime.planning.trajectory import Phase, Trajectory
from runtime.workspace.source import Source
from runtime.workspace.watching import monitor_entry, propose_monitor
from tests.watched_arm import MONITOR, watch_text, watched_text

pytestmark = pytest.mark.xdist_group("watched")
PLAIN = watched_text(2).replace(MONITOR, "").replace(watch_text(0.08), "")
CHANGES = 5.0
"""s of powered motion, after which a joint's friction grows."""


def there_and_back() -> Trajectory:
    stations = [np.array([[a] * 3 + [b] * 3, [a / 2] * 3 + [b / 2] * 3]) for a, b in ((0.0, -1.2), (-1.2, 0.0))]
    phases = tuple(Phase("q", 0.9, points) for points in stations)
    return Trajectory("arm", "there and back", phases, elbow=1.0, friction=True, periodic=True, springs={}, contact={})


class RubbingArm(execution.SimulatedArm):
    """One whose second joint rubs more from a time on, by `more` N m."""

    more = 0.0
    periods = 0

    def apply(self, torque: Float32) -> None:
        self.periods += 1
        lost = np.zeros(len(torque))
        if self.periods * self.plant.period > CHANGES:
            lost[1] = self.more * np.sign(self.plant.qd[1])
        super().apply((torque - lost).astype(np.float32))


@pytest.fixture(scope="module")
def watched() -> Source:
    """The arm with floors from what it did itself."""
    source = Source(Path("arm.toml"), PLAIN)
    settings = ExecutionSettings(trials=2, cycles=8, noise=0.02)
    done = execution.execute(source.compiled.model(), source.compiled.controller(), there_and_back(), settings)
    assert done.recording is not None
    return source.with_text(propose_monitor(source, source.compiled.model(), [done.recording]).text)


@pytest.fixture
def said(watched: Source, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[WatchedEntry]]:
    """What the monitor says at the end of a run."""

    def run(
        more: float, cycles: int, board: Callable[..., Board] = HostBoard, target: str = "host"
    ) -> list[WatchedEntry]:
        monkeypatch.setattr(RubbingArm, "more", more)
        monkeypatch.setattr(execution, "SimulatedArm", RubbingArm)
        compiled = watched.compiled
        settings = ExecutionSettings(trials=1, cycles=cycles, seed=3)
        plan, directory = there_and_back(), compiled.controller(target)
        done = execution.execute(compiled.model(), directory, plan, settings, board=board).document()
        assert done.status == "done", done.reason
        entries = done.trials[0].watched
        assert isinstance(entries, list)
        return entries

    return run


def test_the_model_file_gets_what_the_recording_shows(watched: Source) -> None:
    monitor, entry = watched.arm().monitor, monitor_entry(watched)
    assert monitor is not None
    assert entry is not None
    assert [joint.floor for joint in entry.joints] == [joint.floor for joint in monitor.joints]
    assert all(0.05 < joint.floor < 0.5 for joint in monitor.joints)
    assert all(joint.hours >= 1000 * 2 / entry.false_alarms for joint in entry.joints)
    assert "proposed: measured on" in watched.text


def test_a_recording_without_motion_gives_no_floor() -> None:
    source = Source(Path("arm.toml"), PLAIN)
    settings = ExecutionSettings(trials=1, cycles=1)
    done = execution.execute(source.compiled.model(), source.compiled.controller(), there_and_back(), settings)
    assert done.recording is not None
    with pytest.raises(ControllerError, match=r"joint 1 moves faster than .* for .* s; its floor needs 10 s of motion"):
        propose_monitor(source, source.compiled.model(), [done.recording])


def test_a_model_that_holds_is_believed(said: Callable[..., list[WatchedEntry]]) -> None:
    assert [(entry.verdict, entry.signal, entry.since) for entry in said(0.0, 15)] == [("holds", "none", None)] * 2


@pytest.mark.parametrize(("more", "verdict", "soon"), [(0.2, "drifts", 6.0), (1.0, "broken", 3.0)])
def test_more_friction_is_found(
    said: Callable[..., list[WatchedEntry]], more: float, verdict: str, soon: float
) -> None:
    first, second = said(more, 12)
    assert first.verdict == "holds"
    assert (second.verdict, second.signal) == (verdict, "velocity")
    assert second.since is not None
    assert CHANGES - 2.0 < second.since < CHANGES + soon


@pytest.mark.parametrize("board", [UnicornBoard, pytest.param(partial(QemuBoard), marks=pytest.mark.slow)])
def test_the_emulated_board_says_the_same(said: Callable[..., list[WatchedEntry]], board: Callable[..., Board]) -> None:
    assert said(1.0, 3, board, "cortex-m4f") == said(1.0, 3)
