"""The first motion of an arm with all that is to be known before anyone moves it: what it asks of the joints, what was
assumed, what is not checked, and how well each parameter will be told."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime.documents.experiments import FirstMotionDocument, LimitedJoint, MotionPart
from runtime.documents.recordings import AssumedNumber
from runtime.experiments.design import ExperimentError
from runtime.experiments.excitation import Room
from runtime.experiments.first import FirstMotion, MotionPlanner, SafeLimits, derivatives
from runtime.experiments.fourier import FourierMotion, harmonics_of
from runtime.experiments.information import ArmInformation
from runtime.experiments.options import ExperimentSettings, FirstMotionSettings
from runtime.experiments.pieces import Envelope
from runtime.experiments.possible_arms import PossibleArms
from runtime.experiments.separation import narrowed, noisy, stated
from runtime.experiments.settings import (
    CHECK_RATE,
    FARTHEST_REACH,
    FASTEST_HARMONIC,
    PERIOD,
    POSSIBLE_ARMS,
    SAMPLES_A_PERIOD,
    UNSTATED_TORQUE,
)
from runtime.identification.identify import identify
from runtime.inspection.inspection import determined
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.progress import within
from runtime.simulation.options import SimulationSettings
from runtime.simulation.settings import MARGIN, RATE
from runtime.simulation.simulate import complete, simulate
from symbolic.model_file.arm import Arm
from symbolic.model_file.likely import LikelyNumber

Array = NDArray[np.float64]
Tell = Callable[[str], None]


@dataclass(frozen=True)
class ArmToMove:
    """An arm of which little may be known.

    model     as the file has it          likely   with likely numbers for what the file leaves out
    arm       that `likely` was made of   assumed  what was assumed
    start     (n,) rad (m), the pose from which it moves; None: the middle of the ranges
    moving    joints (0-based) that move; None: all      ranges   joint (0-based) -> (low, high), narrower ones
    room      keeps it clear of itself and of what stands around; unchecked: what nothing keeps it from, sentences
    """

    model: Model
    likely: Model
    arm: Arm
    assumed: Sequence[LikelyNumber]
    room: Room
    unchecked: Sequence[str]
    start: Array | None = None
    moving: Sequence[int] | None = None
    ranges: Mapping[int, tuple[float, float]] | None = None


@dataclass(frozen=True)
class FirstProposal:
    """Motions for one arm: the first, and another one for validation; and what a recording along the first would tell,
    as `tendon inspect` tells it of a recorded one."""

    to_move: ArmToMove
    limits: SafeLimits
    first: FirstMotion
    check: FirstMotion | None
    noise: Array
    document: FirstMotionDocument


def propose_first(
    to_move: ArmToMove,
    settings: ExperimentSettings = ExperimentSettings(),
    chosen: FirstMotionSettings = FirstMotionSettings(),
    check: bool = False,
    tell: Tell | None = None,
) -> FirstProposal:
    """The first motion, and with `check` another one. Raises ExperimentError, SimulationError."""
    say = tell or (lambda _: None)
    if settings.noise <= 0:
        raise ExperimentError("without noise everything would be told; give a noise above 0")
    say(f"a motion of about {chosen.seconds:g} s; the search takes at most {settings.time_limit:g} s")
    with within(settings.time_limit / (2 if check else 1)):
        limits, moving, noise, start = _prepared(to_move, settings, chosen)
        planner = MotionPlanner(limits, moving, start, chosen.seconds)
        first = planner.motion(settings.seed, say)
    other = None
    if check:
        say("searching another motion for validation")
        with within(settings.time_limit / 2):
            other = replace(planner, seconds=chosen.seconds / 2).motion(settings.seed + 1, lambda _: None)
    say("predicting what a recording would tell")
    document = _document(to_move, limits, first, noise, settings.seed)
    return FirstProposal(to_move, limits, first, other, noise, document)


def _prepared(
    to_move: ArmToMove, settings: ExperimentSettings, chosen: FirstMotionSettings
) -> tuple[SafeLimits, Sequence[int], Array, Array]:
    """Limits, the joints that move, the noise (n,) of the torques, and the start pose (n,)."""
    likely = narrowed(to_move.likely, to_move.ranges or {})
    moving = tuple(range(likely.n)) if to_move.moving is None else tuple(to_move.moving)
    start = _start(likely, to_move)
    envelopes = [_envelope(likely, i, start[i], i in (to_move.ranges or {}), chosen.speed) for i in range(likely.n)]
    series = FourierMotion(envelopes, moving, PERIOD, harmonics_of(PERIOD, FASTEST_HARMONIC))
    x = series.random(np.random.default_rng(settings.seed))
    path = series.shape(x, np.arange(round(PERIOD * RATE)) / RATE)[0]
    values = complete(likely, path, {term: dict(v) for term, v in structure(likely).items()})
    arms = PossibleArms.of(likely, to_move.arm, values, to_move.assumed, POSSIBLE_ARMS, settings.seed)
    information = ArmInformation(arms, SAMPLES_A_PERIOD, np.ones(likely.n))
    made = information.outputs(*series.shape(x, np.arange(SAMPLES_A_PERIOD) * PERIOD / SAMPLES_A_PERIOD))
    noise = settings.noise * np.maximum(np.sqrt(np.mean(made.tau**2, axis=0)), 1e-9)
    usual = UNSTATED_TORQUE * information.largest_torque(made)[0].max(axis=0)
    stated = [joint.torque_limit for joint in likely.joints]
    torque = np.array([u if s is None else MARGIN * s for s, u in zip(stated, usual, strict=True)])
    limits = SafeLimits(replace(information, noise=noise), envelopes, torque, chosen.tip_speed, to_move.room)
    _check_start(limits, start)
    return limits, moving, noise, start


def _start(model: Model, to_move: ArmToMove) -> Array:
    middle = np.array([Envelope.of(joint).middle for joint in model.joints])
    if to_move.start is None:
        return middle
    if len(to_move.start) != model.n:
        raise ExperimentError(f"--start: found {len(to_move.start)} numbers, expected {model.n}, one for each joint")
    for i, (joint, at) in enumerate(zip(model.joints, to_move.start, strict=True), 1):
        low, high = joint.position_limits or (-np.inf, np.inf)
        if not low <= at <= high:
            raise ExperimentError(
                f"--start: joint {i} at {at:g} {joint.position_unit} is outside its range, {low:g} to {high:g}"
            )
    return np.array(to_move.start)


def _envelope(model: Model, i: int, start: float, chosen: bool, speed: float) -> Envelope:
    """Around the start, not farther than a first motion goes where the user chose no range, and slower on request."""
    joint = model.joints[i]
    own = Envelope.of(joint)
    low, high = own.middle - own.reach, own.middle + own.reach
    if joint.type == "revolute" and not chosen:
        low, high = max(low, start - FARTHEST_REACH), min(high, start + FARTHEST_REACH)
    return replace(
        own,
        middle=(low + high) / 2,
        reach=(high - low) / 2,
        speed=speed * own.speed,
        acceleration=speed**2 * own.acceleration,
    )


def _check_start(limits: SafeLimits, start: Array) -> None:
    clear = float(limits.room.least(start[:, None])[0])
    if clear < 0:
        raise ExperimentError(
            f"at the start pose the arm is {-clear:.3g} m closer to itself or its surroundings than the margins allow; "
            "give another one with --start Q1,Q2,..."
        )


def _document(
    to_move: ArmToMove, limits: SafeLimits, first: FirstMotion, noise: Array, seed: int
) -> FirstMotionDocument:
    likely, values = to_move.likely, limits.information.arms.values
    made, _ = simulate(stated(likely, values), settings=SimulationSettings(noise=0.0), motion=first.path)
    told = determined(identify(to_move.model, [noisy(made, noise, seed)]))
    q, qd, qdd = (part[:, :: round(RATE / CHECK_RATE)] for part in derivatives(first.path))
    torque, tip_speed = limits.largest(q, qd, qdd)
    likeliest = np.abs(made.tau).max(axis=1)
    joints = [
        LimitedJoint(
            joint=i + 1,
            name=joint.name,
            position=(float(q[i].min()), float(q[i].max())),
            position_unit=joint.position_unit,
            position_stated=joint.position_limits is not None,
            speed=float(np.abs(qd[i]).max()),
            speed_limit=limits.envelopes[i].speed,
            speed_stated=joint.speed_limit is not None,
            acceleration=float(np.abs(qdd[i]).max()),
            acceleration_limit=limits.envelopes[i].acceleration,
            torque=float(likeliest[i]),
            torque_at_most=float(torque[i].max()),
            torque_limit=float(limits.torque[i]),
            torque_stated=joint.torque_limit is not None,
            force_unit=joint.force_unit,
        )
        for i, joint in enumerate(likely.joints)
    ]
    return FirstMotionDocument(
        seconds=first.seconds,
        parts=[MotionPart(name=name, seconds=seconds) for name, seconds in first.parts],
        start=[float(x) for x in first.start],
        joints=joints,
        tip_speed=float(tip_speed.max()),
        tip_speed_limit=limits.tip_speed,
        information=first.nats,
        parameters=told,
        assumed=[AssumedNumber(**vars(number)) for number in to_move.assumed],
        unchecked=list(to_move.unchecked),
        out=None,
        held_out=None,
    )
