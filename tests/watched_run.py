"""A watched arm that moves there and back while something about it changes, simulated with the firmware's machine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.documents.plans import WatchedEntry
from runtime.execution import execute as execution
from runtime.execution.options import ExecutionSettings
from runtime.hardware.boards import HostBoard
from runtime.hardware.lockstep import Board, Float32
from runtime.planning.trajectory import Phase, Trajectory
from runtime.simulation.plant import Plant
from runtime.workspace.source import Source
from runtime.workspace.watching import propose_monitor
from tests.watched_arm import MONITOR, watch_text, watched_text

PLAIN = watched_text(2).replace(MONITOR, "").replace(watch_text(0.08), "")
CHANGES = 5.0
"""s of powered motion, after which something changes."""
Change = Callable[[Plant], NDArray[np.float64]]
"""Torque (n,) that is lost from then on."""


def there_and_back() -> Trajectory:
    """Both joints, in 1.8 s."""
    stations = [np.array([[a] * 3 + [b] * 3, [a / 2] * 3 + [b / 2] * 3]) for a, b in ((0.0, -1.2), (-1.2, 0.0))]
    phases = tuple(Phase("q", 0.9, points) for points in stations)
    return Trajectory("arm", "there and back", phases, elbow=1.0, friction=True, periodic=True, springs={}, contact={})


def with_floors() -> Source:
    """The arm with floors from what it did itself."""
    source = Source(Path("arm.toml"), PLAIN)
    settings = ExecutionSettings(trials=2, cycles=8, noise=0.02)
    done = execution.execute(source.compiled.model(), source.compiled.controller(), there_and_back(), settings)
    assert done.recording is not None
    return source.with_text(propose_monitor(source, source.compiled.model(), [done.recording]).text)


def at_second_joint(torque: float) -> NDArray[np.float64]:
    return np.array([0.0, torque])


def friction(more: float) -> Change:
    """More dry friction at the second joint, N m."""
    return lambda plant: at_second_joint(more * float(np.sign(plant.qd[1])))


def said_of(
    watched: Source,
    change: Change,
    cycles: int,
    seed: int = 3,
    board: Callable[..., Board] = HostBoard,
    target: str = "host",
) -> list[WatchedEntry]:
    """What the monitor says at the end of a run in which something changes."""

    class ChangedArm(execution.SimulatedArm):
        periods = 0

        def apply(self, torque: Float32) -> None:
            self.periods += 1
            late = self.periods * self.plant.period > CHANGES
            super().apply((torque - change(self.plant)).astype(np.float32) if late else torque)

    compiled, before = watched.compiled, execution.SimulatedArm
    settings = ExecutionSettings(trials=1, cycles=cycles, seed=seed)
    execution.SimulatedArm = ChangedArm  # type: ignore[misc]
    try:
        done = execution.execute(
            compiled.model(), compiled.controller(target), there_and_back(), settings, board=board
        ).document()
    finally:
        execution.SimulatedArm = before  # type: ignore[misc]
    assert done.status == "done", done.reason
    entries = done.trials[0].watched
    assert isinstance(entries, list)
    return entries
