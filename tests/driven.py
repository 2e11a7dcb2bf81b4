"""The bench of one joint, driven through a session, with links and arms that fail on purpose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from runtime.execution.execute import SimulatedArm
from runtime.execution.trial import Trial, run
from runtime.hardware.boards import HostBoard
from runtime.hardware.link import BoardLink, Codec
from runtime.hardware.lockstep import Board, Clock, Counts, Lockstep, SteppedArm
from runtime.hardware.session import Session
from runtime.hardware.settings import Settings
from runtime.model.loader import Model
from runtime.planning.evaluate import mounted
from runtime.planning.trajectory import Trajectory
from runtime.simulation.plant import Plant

Frames = Callable[[bytes], Sequence[bytes]]
WITHIN = 5
"""Control periods (of 1 ms) in which a fault must have been answered."""


def as_they_are(frame: bytes) -> Sequence[bytes]:
    return [frame]


@dataclass
class Faulty:
    """A link that does to frames what `to_board` and `to_host` say; frames have their delimiter."""

    link: BoardLink
    to_board: Frames = as_they_are
    to_host: Frames = as_they_are
    baud: int | None = None
    late: float | None = None
    _rest: bytes = b""

    def write(self, data: bytes) -> None:
        for frame in data.split(b"\0")[:-1]:
            for sent in self.to_board(frame + b"\0"):
                self.link.write(sent)

    def read(self, timeout: float) -> bytes:
        *whole, self._rest = (self._rest + self.link.read(timeout)).split(b"\0")
        return b"".join(found for frame in whole for found in self.to_host(frame + b"\0"))

    @property
    def fault(self) -> str | None:
        return self.link.fault

    def now(self) -> float:
        return self.link.now()

    def close(self) -> None:
        self.link.close()


@dataclass
class Watched:
    """An arm of which every period with powered drives is noted; twist: what its encoders say instead, and when."""

    arm: SteppedArm
    twist: Callable[[int, Counts], Counts] = lambda _, counts: counts
    counted: list[Counts] = field(default_factory=list)
    torques: list[NDArray[np.float32]] = field(default_factory=list)
    on: list[bool] = field(default_factory=list)
    powered: bool = False
    begun: bool = False

    @property
    def period(self) -> int:
        """Of the run: periods since the drives came on."""
        return len(self.torques)

    def start(self, q: Any, rng: np.random.Generator) -> Counts:
        for past in (self.counted, self.torques, self.on):
            past.clear()
        self.begun = False
        self._last = self.arm.start(q, rng)
        return self._last

    def counts(self) -> Counts:
        self._last = self.twist(self.period, self.arm.counts())
        return self._last

    def enable(self, on: bool) -> None:
        self.powered, self.begun = on, self.begun or on
        self.arm.enable(on)

    def apply(self, torque: NDArray[np.float32]) -> None:
        if self.begun:
            self.counted.append(np.array(self._last))
            self.torques.append(np.array(torque))
            self.on.append(self.powered)
        self.arm.apply(torque)


@dataclass
class Rig:
    """A session with the bench; parts may be replaced before the first command."""

    model: Model
    directory: Path
    settings: Settings
    arm: Watched
    lockstep: Lockstep
    link: Faulty
    session: Session
    seconds: float

    def prepared(self) -> Rig:
        q = self.settings.points[0].astype(np.float64)
        self.lockstep.start(q, np.random.default_rng(1))
        self.session.identify()
        self.session.upload(self.settings)
        return self

    def run(self, every: int = 1, asked: Callable[[], int] = lambda: 0) -> Trial:
        return run(self.session, self.settings, self.seconds, every=every, asked=asked)

    def driven(self) -> Trial:
        return self.prepared().run()

    def wait(self, seconds: float) -> None:
        """As long in the link's time, without a word."""
        end = self.link.now() + seconds
        while self.link.now() < end:
            self.lockstep.read(0.02)

    def check_safe(self, observed: int, missed: int | None = None) -> None:
        """From WITHIN periods after the criterion was met on, every torque damps or is zero, and in the end the drives
        are off. missed: a step in which nothing was measured."""
        counts, drive = np.array(self.arm.counted).T, self.settings.drive
        gain, kd = drive["velocity_gain"], np.array(drive["kd"])
        raw = np.diff(counts, axis=1, prepend=counts[:, :1]) * self.settings.position_per_count[:, None] * drive["rate"]
        if missed is not None:
            raw = np.delete(raw, missed, axis=1)
        qd = lfilter([gain], [1.0, gain - 1.0], raw.astype(float), axis=1)
        if missed is not None:
            qd = np.insert(qd, missed, qd[:, missed - 1], axis=1)
        limit = np.array(self.settings.drive["torque_limit"])[:, None]
        damping = np.clip(-kd[:, None] * qd, -limit, limit)
        torque = np.array(self.arm.torques, dtype=np.float64).T
        after = slice(observed + WITHIN, None)
        assert torque.shape[1] > observed
        held = (torque != 0) & (np.abs(torque - damping) > 1e-4 * (1 + np.abs(damping)))
        assert not held[:, after].any(), observed + WITHIN + np.nonzero(held[:, after].any(axis=0))[0][:5]
        assert not self.arm.powered
        assert not self.arm.torques[-1].any()


def rig(
    model: Model,
    directory: Path,
    plan: Trajectory,
    board: Callable[[Path, str, int], Board] = HostBoard,
    cycles: float = 1.0,
    clock: Clock | None = None,
    **settings: Any,
) -> Rig:
    told = Settings.of(directory, model, plan, **settings)
    arm = Watched(SimulatedArm(Plant(model, mounted(model, plan), told.dt), told))
    lockstep = Lockstep(board(directory, model.name, model.n), arm, told.dt, clock)
    link = Faulty(lockstep)
    session = Session(link, Codec.from_json(directory / "protocol.json"))
    return Rig(model, directory, told, arm, lockstep, link, session, cycles * plan.duration)
