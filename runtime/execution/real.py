"""A trajectory executed on a real arm over a link: where it stands, how it gets to the start, the trials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.execution.demand import PlannedCycle
from runtime.execution.execute import Execution
from runtime.execution.options import TRIALS_ON_A_REAL_ARM, ExecutionSettings
from runtime.execution.trial import Trial, length, run
from runtime.hardware.link import BoardLink, Codec, LinkError, LinkLost
from runtime.hardware.session import Session
from runtime.hardware.settings import ControllerError, Settings
from runtime.model.loader import Model
from runtime.planning.trajectory import Phase, Trajectory

Array = NDArray[np.float64]

_APPROACH_SPEED = 0.2
"""Of a joint's limit of speed, on the way to a trajectory's start."""
_APPROACH_LEAST = 2.0
"""s that the way takes at least."""
_PEAK = 1.875
"""Largest speed of a polynomial of degree five from rest to rest, by its mean speed."""


def decimation(directory: Path, model: Model, baud: int | None) -> int:
    """Control periods from one telemetry record to the next, so that a line of `baud` carries them.

    directory   of the arm's compiled controller
    """
    if baud is None:
        return 1
    assert model.controller is not None
    codec, rate = Codec.from_json(directory / "protocol.json"), model.controller["rate"]
    zeros = {name: 0 if count is None else [0] * count for name, count in codec.fields("telemetry").items()}
    size, line = len(codec.encode("telemetry", zeros)), codec.document["line"]
    return max(1, ceil(size * line["bits"] * rate / (line["share"] * baud)))


@dataclass(frozen=True)
class Setup:
    """What is executed, and how.

    directory   of the arm's compiled controller
    every       control periods from one record to the next
    late        see BoardLink
    """

    directory: Path
    model: Model
    trajectory: Trajectory
    settings: ExecutionSettings
    every: int
    late: float | None

    @property
    def compensated(self) -> bool:
        """Whether friction is, on the way to the start, too."""
        return self.settings.compensates(self.trajectory)

    @property
    def trials(self) -> int:
        return TRIALS_ON_A_REAL_ARM if self.settings.trials is None else self.settings.trials

    def told(self, trajectory: Trajectory) -> Settings:
        """What the board is told before it drives a trajectory."""
        found = Settings.of(self.directory, self.model, trajectory, self.compensated, self.settings.tracking_limit)
        return found if self.late is None else found.tolerating(self.late)


def execute_on(
    link: BoardLink, setup: Setup, ready: Callable[[], None], asked: Callable[[], int]
) -> tuple[Execution, dict[str, Any]]:
    """All trials, or up to the first that is stopped, and what became of the frames; the link is closed.

    ready   called once the board is known and has taken everything, before anything moves
    asked   whether the user wants to stop; see Session.run

    Raises ControllerError where the arm stands elsewhere, LinkError, LinkLost.
    """
    session = Session(link, Codec.from_json(setup.directory / "protocol.json"))
    try:
        return _Executing(session, setup, ready, asked).all(), session.figures()
    finally:
        session.close()


def standing(link: BoardLink, setup: Setup) -> list[dict[str, Any]]:
    """Where each joint stands and where the trajectory starts. Nothing moves, the drives stay without power; the link
    is closed.

    Raises LinkError, LinkLost.
    """
    session = Session(link, Codec.from_json(setup.directory / "protocol.json"))
    try:
        session.identify()
        settings = setup.told(setup.trajectory)
        session.upload(settings)
        here, start = _here(session, settings), PlannedCycle(setup.model, setup.trajectory).motion.q[:, 0]
    finally:
        session.close()
    return [
        {
            "joint": k,
            "name": joint.name,
            "position": float(here[k - 1]),
            "start": float(start[k - 1]),
            "position_unit": joint.position_unit,
        }
        for k, joint in enumerate(setup.model.joints, 1)
    ]


def _here(session: Session, settings: Settings) -> Array:
    """(n,) rad (m) where the arm stands."""
    return settings.positions(np.array([session.counts()], dtype=np.int32))[:, 0]


@dataclass(frozen=True)
class _Executing:
    session: Session
    setup: Setup
    ready: Callable[[], None]
    asked: Callable[[], int]

    def all(self) -> Execution:
        setup = self.setup
        self.session.identify()
        settings, plan = setup.told(setup.trajectory), PlannedCycle(setup.model, setup.trajectory)
        start, done = plan.motion.q[:, 0], list[Trial]()
        seconds = length(setup.trajectory, setup.settings.cycles)
        self.session.upload(settings)
        self.ready()
        while len(done) < setup.trials and not (done and done[-1].stop):
            try:
                done.append(self._trial(start, settings, seconds))
            except (LinkLost, LinkError, ControllerError) as error:
                # What has been recorded is kept.
                if not done:
                    raise
                name = "link_lost" if isinstance(error, LinkLost) else "refused"
                done.append(Trial.without_motion(setup.model.n, name, str(error)))
        return Execution(
            plan=plan,
            dt=settings.dt * setup.every,
            compensated=setup.compensated,
            uncompensated=settings.uncompensated,
            arm=plan.terms,
            hidden=frozenset(),
            seed=0,
            noise=0.0,
            excess=(),
            trials=tuple(done),
        )

    def _trial(self, start: Array, settings: Settings, seconds: float) -> Trial:
        way = self._to(start, settings)
        if way is not None and way.stop is not None:
            return replace(way, stop=replace(way.stop, reason=f"on the way to the start: {way.stop.reason}"))
        self.session.upload(settings)
        return run(self.session, settings, seconds, self.setup.every, self.asked)

    def _to(self, start: Array, settings: Settings) -> Trial | None:
        """Drive to `start` (n,), if that is wanted and the arm does not stand there; None if it does."""
        here = _here(self.session, settings)
        apart = np.abs(here - start)
        if (apart <= np.array(settings.safety["start"])).all():
            return None
        if not self.setup.settings.approach:
            raise ControllerError(_elsewhere(self.setup.model, here, start))
        way = self._way(here, start)
        outside = [str(excess) for excess in PlannedCycle(self.setup.model, way).exceeded()]
        if outside:
            raise ControllerError(f"there is no straight way to the start: {outside[0]}")
        settings = self.setup.told(way)
        self.session.upload(settings)
        return run(self.session, settings, length(way, 1), self.setup.every, self.asked)

    def _way(self, here: Array, start: Array) -> Trajectory:
        """From rest to rest on straight lines of the joints, slowly."""
        setup = self.setup
        speeds = [_APPROACH_SPEED * (joint.speed_limit or np.inf) for joint in setup.model.joints]
        duration = max(_APPROACH_LEAST, _PEAK * float(np.max(np.abs(start - here) / speeds)))
        points = np.column_stack([here, here, here, start, start, start])
        return replace(setup.trajectory, scenario="approach", phases=(Phase("q", duration, points),), periodic=False)


def _elsewhere(model: Model, here: Array, start: Array) -> str:
    joints = (
        f"joint {k + 1} stands at {here[k]:.3f} {joint.position_unit}, the trajectory starts at {start[k]:.3f}"
        for k, joint in enumerate(model.joints)
    )
    return f"the arm is not where the trajectory starts: {'; '.join(joints)}; bring it there, or pass --approach"
