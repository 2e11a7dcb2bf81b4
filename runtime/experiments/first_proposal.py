"""The first motion of an arm with all that is to be known before anyone moves it: what it asks of the joints, what was
assumed, what is not checked, and how well each parameter will be told."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from runtime.arrays import Array
from runtime.documents.experiments import FirstMotionDocument, LimitedJoint, MotionPart
from runtime.documents.parts import IterationsEntry
from runtime.documents.recordings import AssumedNumber
from runtime.experiments.asking import ExperimentError
from runtime.experiments.design import place, propose
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
    LEAST_TORQUE,
    PERIOD,
    POSSIBLE_ARMS,
    SAMPLES_A_PERIOD,
    SHAPES_EVERY,
    UNSTATED_TORQUE,
)
from runtime.experiments.solids import MeshClearance
from runtime.identification.fit import Fit
from runtime.identification.identify import identify
from runtime.inspection.inspection import determined
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.progress import cut_short_by_interrupt, one_thread, within
from runtime.recordings.recording import Recording
from runtime.simulation.options import SimulationSettings
from runtime.simulation.settings import MARGIN, RATE
from runtime.simulation.simulate import Hidden, complete, simulate
from symbolic.model_file.arm import Arm
from symbolic.model_file.likely import LikelyNumber

Tell = Callable[[str], None]


@dataclass(frozen=True)
class ArmToMove:
    """An arm of which little may be known.

    model     as the file has it          likely   with likely numbers for what the file leaves out
    arm       that `likely` was made of   assumed  what was assumed
    start     (n,) rad (m), the pose from which it moves; None: the middle of the ranges
    moving    joints (0-based) that move; None: all      ranges   joint (0-based) -> (low, high), narrower ones
    room      keeps it clear of itself and of what stands around; unchecked: what nothing keeps it from, sentences
    shapes    the arm's collision shapes, for a last check of the finished motion; None: none are stated
    given     what recordings at hand tell; None: there are none
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
    shapes: MeshClearance | None = None
    given: AtHand | None = None


@dataclass(frozen=True)
class AtHand:
    """Recordings of the arm, and what they leave open.

    fit      of the model file to them        recordings   that were fitted
    rivals   effects of which one is missing and the recordings do not tell which
    """

    fit: Fit
    recordings: Sequence[Recording]
    rivals: tuple[Hidden, ...] = ()

    def known(self, information: ArmInformation) -> Array:
        """Their information about the unknowns of a motion's search."""
        told = [information.told(p.q, p.qd, p.qdd, 1 / p.dt) for p in self.fit.motion.pieces]
        return np.sum(told, axis=0)


@dataclass(frozen=True)
class ReadyArm:
    """An arm with the limits within which it is moved.

    moving   joints (0-based) that move     start   (n,) rad (m), where it is before and after
    noise    (n,) standard deviation of the recorded torques' noise, N m (N)
    """

    limits: SafeLimits
    moving: tuple[int, ...]
    start: Array
    noise: Array

    @classmethod
    def of(cls, to_move: ArmToMove, settings: ExperimentSettings, chosen: FirstMotionSettings) -> ReadyArm:
        """Raises ExperimentError, SimulationError."""
        ranges = to_move.ranges or {}
        likely = narrowed(to_move.likely, ranges)
        moving = tuple(range(likely.n)) if to_move.moving is None else tuple(to_move.moving)
        start = _start(likely, to_move)
        envelopes, usually = (
            [_envelope(likely, i, start[i], i in ranges, pace) for i in range(likely.n)]
            for pace in (chosen, FirstMotionSettings())
        )
        # What is assumed of the arm and of its noise is the same whatever pace is chosen.
        series, usual = (
            FourierMotion(each, moving, PERIOD, harmonics_of(PERIOD, FASTEST_HARMONIC)) for each in (envelopes, usually)
        )
        x = series.random(np.random.default_rng(settings.seed))
        path = usual.shape(x, np.arange(round(PERIOD * RATE)) / RATE)[0]
        values = complete(likely, path, {term: dict(v) for term, v in structure(likely).items()})
        arms = PossibleArms.of(likely, to_move.arm, values, to_move.assumed, POSSIBLE_ARMS, settings.seed)
        if to_move.given is not None:
            rivals = {rival.term: dict(rival.values) for rival in to_move.given.rivals}
            arms = replace(arms, wondered=complete(likely, path, rivals))
        information = ArmInformation(arms, SAMPLES_A_PERIOD, np.ones(likely.n))
        t = np.arange(SAMPLES_A_PERIOD) * PERIOD / SAMPLES_A_PERIOD
        made, made_usually = (information.outputs(*each.shape(x, t)) for each in (series, usual))
        noise = settings.noise * np.maximum(np.sqrt(np.mean(made_usually.tau**2, axis=0)), LEAST_TORQUE)
        enough = UNSTATED_TORQUE * information.largest_torque(made)[0].max(axis=0)
        stated = [joint.torque_limit for joint in likely.joints]
        torque = np.array([e if s is None else MARGIN * s for s, e in zip(stated, enough, strict=True)])
        information = replace(information, noise=noise)
        if to_move.given is not None:
            information = replace(information, known=to_move.given.known(information))
        limits = SafeLimits(information, envelopes, torque, chosen.tip_speed, to_move.room)
        _check_start(limits, start)
        return cls(limits, moving, start, noise)

    @property
    def ranges(self) -> dict[int, tuple[float, float]]:
        """Joint (0-based) -> (low, high), rad or m, of which motions within the joints' limits use a part."""
        return {
            i: (e.middle - e.reach / MARGIN, e.middle + e.reach / MARGIN) for i, e in enumerate(self.limits.envelopes)
        }


@dataclass(frozen=True)
class FirstProposal:
    """Motions for one arm: the first, and another one for validation; and what a recording along the first would tell,
    as `tendon inspect` tells it of a recorded one."""

    to_move: ArmToMove
    ready: ReadyArm
    first: FirstMotion
    check: FirstMotion | None
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
    say(f"a motion of about {chosen.seconds:g} s")
    motions = 2 if check else 1
    with one_thread(), cut_short_by_interrupt(say), within(settings.seconds / motions):
        ready = ReadyArm.of(to_move, settings, chosen)
        planner = MotionPlanner(ready.limits, ready.moving, ready.start, chosen.seconds)
        parts, came = _between_rivals(to_move, ready, settings, say)
        left = None if settings.budget is None else (settings.budget - sum(one.iterations for one in came)) // motions
        first = planner.motion(settings.seed, say, parts, left)
    came, other = [*came, first.search], None
    if check:
        say("searching another motion for validation")
        with one_thread(), within(settings.seconds / 2):
            other = replace(planner, seconds=chosen.seconds / 2).motion(settings.seed + 1, lambda _: None, budget=left)
        came.append(other.search)
    if to_move.shapes is not None:
        say("checking the collision shapes along it")
        for motion in (first, other):
            if motion is not None:
                _check_shapes(to_move.shapes, motion)
    say("predicting what a recording would tell")
    most = settings.budget or sum(one.budget for one in came)
    search = IterationsEntry.of(sum(one.iterations for one in came), most, [one.ended for one in came])
    document = _document(to_move, ready, first, settings.seed, search)
    return FirstProposal(to_move, ready, first, other, document)


def _between_rivals(
    to_move: ArmToMove, ready: ReadyArm, settings: ExperimentSettings, say: Tell
) -> tuple[list[tuple[str, Array]], list[IterationsEntry]]:
    """The part of the motion that separates rivals, if the recordings at hand leave some and one does; and how far its
    search came, which takes at most half of what the whole may."""
    given = to_move.given
    if given is None or not given.rivals:
        return [], []
    *before, last = (str(rival.term) for rival in given.rivals)
    part = f"what tells {', '.join(before)} and {last} apart"
    say(f"looking for {part}")
    found = propose(
        to_move.model,
        given.rivals,
        replace(
            settings,
            budget=None if settings.budget is None else max(settings.budget // 2, 1),
            time_limit=None if settings.time_limit is None else settings.time_limit / 2,
        ),
        say,
        moving=ready.moving,
        ranges=ready.ranges,
        likely=to_move.likely,
        free=ready.limits.is_free,
    )
    return [(part, found.motion)] if found.separated else [], [found.search]


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


def _envelope(model: Model, i: int, start: float, ranged: bool, chosen: FirstMotionSettings) -> Envelope:
    """Around the start, not farther than a first motion goes where the user chose no range, and slower on request."""
    joint = model.joints[i]
    own = Envelope.of(joint)
    low, high = own.middle - own.reach, own.middle + own.reach
    if joint.type == "revolute" and not ranged:
        low, high = max(low, start - FARTHEST_REACH), min(high, start + FARTHEST_REACH)
    return replace(
        own,
        middle=(low + high) / 2,
        reach=(high - low) / 2,
        speed=chosen.speed * own.speed,
        acceleration=chosen.speed**2 * own.speed / chosen.speeding_up,
    )


def _check_start(limits: SafeLimits, start: Array) -> None:
    nearest = limits.room.worst(start[:, None])
    if nearest.distance < 0:
        raise ExperimentError(
            f"at the start pose {nearest.between} are {-nearest.distance:.3g} m closer than the margins allow; give "
            "another one with --start Q1,Q2,..."
        )


def _check_shapes(shapes: MeshClearance, motion: FirstMotion) -> None:
    nearest = shapes.worst(motion.without_repeats[:, ::SHAPES_EVERY])
    if nearest.distance < 0:
        raise ExperimentError(
            f"by their collision shapes {nearest.between} come {-nearest.distance:.3g} m closer than the margins "
            "allow; state larger radii of links in a scene file, or narrow the ranges"
        )


def _document(
    to_move: ArmToMove, ready: ReadyArm, first: FirstMotion, seed: int, search: IterationsEntry
) -> FirstMotionDocument:
    likely, limits = to_move.likely, ready.limits
    values = limits.information.arms.values
    made, _ = simulate(stated(likely, values), settings=SimulationSettings(noise=0.0), motion=first.path)
    at_hand = [] if to_move.given is None else list(to_move.given.recordings)
    told = determined(identify(to_move.model, [*at_hand, noisy(made, ready.noise, seed)]))
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
        before=None if to_move.given is None else determined(to_move.given.fit),
        rivals=None if to_move.given is None else [place(rival.term) for rival in to_move.given.rivals],
        assumed=[AssumedNumber(**vars(number)) for number in to_move.assumed],
        unchecked=list(to_move.unchecked),
        search=search,
        out=None,
        held_out=None,
    )
