"""A trajectory executed on a real arm over a link: its limits, where it stands, the way to the start, the trials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path

import numpy as np
from msgspec import structs

from runtime.arrays import Array
from runtime.documents.plans import LinkEntry, PredictedJointEntry, PredictionEntry, StandingEntry
from runtime.execution.execute import SIMULATED, Execution
from runtime.execution.options import TRIALS_ON_A_REAL_ARM, ExecutionSettings
from runtime.execution.results import PlannedCycle
from runtime.execution.trial import Trial, length, run
from runtime.hardware import canopen_arm, link
from runtime.hardware.canopen_arm import CanopenLink
from runtime.hardware.link import BoardLink, Codec, LinkError, LinkLost, SerialLink
from runtime.hardware.session import Session
from runtime.hardware.settings import ControllerError, Settings
from runtime.model.loader import Model
from runtime.model.terms import SURFACE, Term, given
from runtime.planning.trajectory import Phase, Trajectory

_APPROACH_SPEED = 0.2
"""Fraction of a joint's speed limit on the way to a trajectory's start."""
_APPROACH_LEAST = 2.0
"""s; shortest duration of that way."""
_PEAK = 1.875
"""Largest speed of a polynomial of degree five from rest to rest, over its mean speed."""
_SPAN = 0.01
"""s over which counted positions are differentiated for the speed, so that encoder steps do not matter."""


@dataclass(frozen=True)
class ArmLine:
    """A kind of link to a real arm. All functions raise LinkError.

    parse   an address of --on
    check   whether the model fits, before anything is opened
    on_this_computer   whether the controller runs here, with room for long motions
    open    with the directory of the arm's firmware for this computer
    """

    parse: Callable[[str], object]
    check: Callable[[str, Model], object]
    open: Callable[[str, Model, Path], BoardLink]
    on_this_computer: bool = False


LINES: dict[str, ArmLine] = {
    link.SERIAL_SCHEME: ArmLine(
        link.serial_address, lambda _url, _model: None, lambda url, _model, _directory: SerialLink.of(url)
    ),
    canopen_arm.CAN_SCHEME: ArmLine(
        canopen_arm.parse_can_address, canopen_arm.check_link, CanopenLink, on_this_computer=True
    ),
}
"""By the scheme of their address."""

KNOWN = (*SIMULATED, "serial:///dev/ttyACM0", "canopen://can0")
"""Examples of --on."""


def scheme(on: str) -> str:
    """Of an address; empty for a word."""
    return on.partition("://")[0] if "://" in on else ""


def check_limits(model: Model) -> None:
    """Raise ControllerError that names every missing limit: a real arm moves only with all of them."""
    missing = []
    for number, joint in enumerate(model.joints, 1):
        keys = {"position": joint.position_limits, "speed": joint.speed_limit, "torque": joint.torque_limit}
        if absent := [name for name, value in keys.items() if value is None]:
            missing.append(f"{', '.join(absent)} at joint {number}")
    if missing:
        raise ControllerError(
            f'the model file of "{model.name}" has too few limits for a real arm; add to [joint.limits]: '
            f"{'; '.join(missing)} (position = [low, high] in rad or m, speed in rad/s or m/s, torque in N m or N)"
        )


def decimation(directory: Path, model: Model, baud: int | None) -> int:
    """Control periods per telemetry record, so that a line of `baud` carries them.

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
    every       control periods per record
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
        """Whether friction is compensated, also on the way to the start."""
        return self.settings.compensates(self.trajectory, self.model.controller)

    @property
    def trials(self) -> int:
        return TRIALS_ON_A_REAL_ARM if self.settings.trials is None else self.settings.trials

    def session(self, line: BoardLink) -> Session:
        return Session(line, Codec.from_json(self.directory / "protocol.json"))

    def board_settings(self, trajectory: Trajectory) -> Settings:
        """Settings of the board for a trajectory."""
        found = Settings.of(
            self.directory, self.model, trajectory, friction=self.compensated, tracking=self.settings.tracking_limit
        )
        return found if self.late is None else found.tolerating(self.late)


def execute_on(
    link: BoardLink, setup: Setup, ready: Callable[[], None], asked: Callable[[], int]
) -> tuple[Execution, LinkEntry]:
    """All trials, or up to the first one that is stopped, and the link's counts of frames; closes the link.

    ready   called once the board is known and has accepted everything, before anything moves
    asked   how often the user wants to stop; see Session.run

    Raises ControllerError if the arm stands elsewhere, LinkError, LinkLost.
    """
    session, plan, done = setup.session(link), PlannedCycle(setup.model, setup.trajectory), list[Trial]()
    try:
        session.identify()
        start, seconds = plan.motion.q[:, 0], length(setup.trajectory, setup.settings.cycles)
        settings = setup.board_settings(setup.trajectory)
        session.upload(settings)
        ready()
        while len(done) < setup.trials and not (done and done[-1].stop):
            try:
                way = _approach(session, setup, settings, start=start, asked=asked)
                if way is not None and way.stop is not None:
                    stop = structs.replace(way.stop, reason=f"on the way to the start: {way.stop.reason}")
                    done.append(replace(way, stop=stop))
                    continue
                session.upload(settings)
                done.append(run(session, settings, seconds, every=setup.every, asked=asked))
            except (LinkLost, LinkError, ControllerError) as error:
                # Earlier trials are kept.
                if not done:
                    raise
                name = "link_lost" if isinstance(error, LinkLost) else "refused"
                done.append(Trial.without_motion(setup.model.n, name, str(error)))
        figures, sums = session.figures(), session.blocks.sums(setup.model.name)
    finally:
        session.close()
    execution = Execution(
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
        sums=sums,
    )
    return execution, figures


def standing(link: BoardLink, setup: Setup) -> list[StandingEntry]:
    """Where each joint stands and where the trajectory starts. Nothing moves, the drives stay without power; closes the
    link.

    Raises LinkError, LinkLost.
    """
    session = setup.session(link)
    try:
        session.identify()
        settings = setup.board_settings(setup.trajectory)
        session.upload(settings)
        here, start = _here(session, settings), PlannedCycle(setup.model, setup.trajectory).motion.q[:, 0]
    finally:
        session.close()
    return [
        StandingEntry(
            joint=k + 1,
            name=joint.name,
            position=float(here[k]),
            start=float(start[k]),
            position_unit=joint.position_unit,
        )
        for k, joint in enumerate(setup.model.joints)
    ]


def _here(session: Session, settings: Settings) -> Array:
    """(n,) rad (m) where the arm stands."""
    return settings.positions(np.array([session.counts()], dtype=np.int32))[:, 0]


def _approach(
    session: Session, setup: Setup, settings: Settings, start: Array, asked: Callable[[], int]
) -> Trial | None:
    """Drive to `start` (n,) slowly, on straight lines of the joints, if --approach allows it; None if the arm stands
    there."""
    here, joints = _here(session, settings), setup.model.joints
    apart = np.abs(here - start)
    if (apart <= np.array(settings.safety["start"])).all():
        return None
    if not setup.settings.approach:
        places = (
            f"joint {k + 1} stands at {here[k]:.3f} {joint.position_unit}, the trajectory starts at {start[k]:.3f}"
            for k, joint in enumerate(joints)
        )
        raise ControllerError(
            f"the arm is not where the trajectory starts: {'; '.join(places)}; bring it there, or pass --approach"
        )
    speeds = [_APPROACH_SPEED * (joint.speed_limit or np.inf) for joint in joints]
    duration = max(_APPROACH_LEAST, _PEAK * float(np.max(apart / speeds)))
    phases = (Phase("q", duration, np.column_stack([here, here, here, start, start, start])),)
    way = replace(setup.trajectory, scenario="approach", phases=phases, periodic=False)
    for excess in PlannedCycle(setup.model, way).exceeded():
        raise ControllerError(f"there is no straight way to the start: {excess.text}")
    settings = setup.board_settings(way)
    session.upload(settings)
    return run(session, settings, length(way, 1), every=setup.every, asked=asked)


# --- the same motion on the simulated arm, before a real one moves ---


def prediction(execution: Execution) -> PredictionEntry:
    """Extremes over all trials, of which there is at least one, beside the limits, which are all given."""
    trials, plan, dt = execution.trials, execution.plan, execution.dt
    torque = np.max([np.abs(trial.tau).max(axis=1) for trial in trials], axis=0)
    low, high = np.array([joint.position_limits for joint in plan.model.joints], dtype=np.float64).T
    room = np.min([np.minimum(trial.q.min(axis=1) - low, high - trial.q.max(axis=1)) for trial in trials], axis=0)
    speeds = []
    for trial in trials:
        span = min(max(1, round(_SPAN / dt)), trial.q.shape[1] - 1)
        speeds.append(np.abs(trial.q[:, span:] - trial.q[:, :-span]).max(axis=1) / (span * dt))
    speed = np.max(speeds, axis=0)
    contact = plan.trajectory.contact or (plan.model.contact["effects"] if plan.model.contact else {})
    surface = given(plan.model.library, {Term(name): values for name, values in contact.items()}, SURFACE)
    tip_y = min(float(plan.model.tip(trial.q)[1].min()) for trial in trials)
    joints = [
        PredictedJointEntry(
            joint=k + 1,
            name=joint.name,
            torque=float(torque[k]),
            torque_limit=joint.torque_limit or np.inf,
            force_unit=joint.force_unit,
            speed=float(speed[k]),
            speed_limit=joint.speed_limit or np.inf,
            room=float(room[k]),
            position_unit=joint.position_unit,
        )
        for k, joint in enumerate(plan.model.joints)
    ]
    return PredictionEntry(joints=joints, plate=None if surface is None else tip_y - surface)
