"""Whether a fit may be believed: errors beside noise floors, recordings beside each other, and why not.

One arm has one inertia, whatever it was doing. The structure that was fitted to all recordings together is fitted to
each of them alone, with the shapes, the shift between torque and motion and the weights of the common fit. What then
differs by more than chance, and by enough torque to matter, says that the recordings are not of one arm, or that the
base model is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np

from runtime.arrays import Array
from runtime.diagnosis.settings import FAR_ABOVE_NOISE, LEAST_MOVING_S, LEAST_PASSES
from runtime.diagnosis.steps import seconds_moving
from runtime.documents.fits import ContradictionEntry, RecordingFit
from runtime.fit_warnings import Suspicion, suspicions
from runtime.identification.compare import JointSeries, has_proper_inertia, series
from runtime.identification.estimate import Estimate
from runtime.identification.fit import Fit
from runtime.identification.problem import Problem, Skew
from runtime.identification.settings import INTERVAL_SIGMAS
from runtime.model.loader import LumpInfo
from runtime.motion.motion import Motion
from runtime.motion.settings import CERTAIN, LITTLE, MORE_THAN_NOISE, MOST, SOME
from runtime.recordings.recording import Recording
from runtime.wording import times_floor
from symbolic.model_file.arm import ROTOR


@dataclass(frozen=True)
class Table:
    """What one recording alone says.

    name   its file
    fit    its coefficients are in the order of the common layout
    left   residual over the instruments' noise, at the joint where it is largest
    """

    name: str
    fit: Fit
    left: float

    def document(self) -> RecordingFit:
        found = self.fit.inference.document(self.fit.model)
        return RecordingFit(recording=self.name, parameters=found.inertial, effects=found.effects)


@dataclass(frozen=True)
class Contradiction:
    """A parameter, with its effect and joint where it has one, that two recordings do not agree on.

    recordings, estimates   the two recordings' files, and the parameter's value in each
    """

    name: str
    unit: str
    recordings: tuple[str, ...]
    estimates: tuple[Estimate, ...]

    def document(self) -> ContradictionEntry:
        return ContradictionEntry(
            name=self.name,
            unit=self.unit,
            recordings=list(self.recordings),
            values=[e.value for e in self.estimates],
            intervals=[e.interval for e in self.estimates],
        )


@dataclass(frozen=True)
class Tables:
    """All recordings' tables, and where they contradict each other; empty with fewer than two recordings."""

    fit: Fit
    tables: tuple[Table, ...] = ()
    inertial: tuple[Contradiction, ...] = ()
    effects: tuple[Contradiction, ...] = ()

    @property
    def each_is_noise(self) -> bool:
        """Whether every recording alone is fitted to the noise: then nothing but the arm differs."""
        return all(table.left < MORE_THAN_NOISE for table in self.tables)

    @property
    def contradictory(self) -> bool:
        """Whether the arm is not the same in all recordings."""
        return bool(self.inertial or self.effects)

    def recording_entries(self) -> list[RecordingFit]:
        """What each recording says alone."""
        return [table.document() for table in self.tables]

    def contradiction_entries(self) -> list[ContradictionEntry]:
        """Parameters on which the recordings disagree."""
        return [c.document() for c in (*self.inertial, *self.effects)]


def compare(fit: Fit, names: Sequence[str], floors: Sequence[float]) -> Tables:
    """Tables of every recording in a fit of all; names: a file a recording; floors (n,) every joint's noise floor."""
    numbers = sorted({piece.recording for piece in fit.motion.pieces})
    if len(numbers) < 2:
        return Tables(fit)
    tables = tuple(_table(fit, number, _name(names, number), floors) for number in numbers)
    model, layout = fit.model, fit.problem.layout
    inertial = []
    if not fit.motion.rigid_given:
        for k, lump in enumerate(model.lumps):
            estimates = [t.fit.inference.lumps[k] for t in tables]
            inertial += _apart(fit, tables, lump.name, estimates=estimates, part=slice(k, k + 1), floors=floors)
    effects = []
    for term, part in layout.slices.items():
        for parameter in model.library.effects[term.effect].linear:
            estimates = [t.fit.inference.values[term][parameter.name] for t in tables]
            name = f"{term} {parameter.name}"
            effects += _apart(fit, tables, name, estimates=estimates, part=part, floors=floors)
    return Tables(fit, tables, tuple(inertial), tuple(effects))


def _name(names: Sequence[str], number: int) -> str:
    if number < len(names) and names.count(names[number]) == 1:
        return names[number]
    return f"recording {number + 1}"


def _table(common: Fit, number: int, name: str, floors: Sequence[float]) -> Table:
    """The common structure's linear unknowns from one recording."""
    own, terms = common.motion.of_recording(number), common.problem.layout.terms
    problem = Problem(common.model, own, terms, common.prediction, common.ahead, weights=common.problem.weights)
    solved = problem.solve(common.shapes, Skew(common.skew))
    fit = Fit(
        problem,
        problem.prediction(solved.coefficients, common.shapes),
        solved.coefficients,
        common.shapes,
        skew=common.skew,
        skew_free=False,
        residual=solved.residual,
        ahead=common.ahead,
    )
    rms = [np.sqrt(r @ r / max(1, own.moving(i).sum())) for i, r in enumerate(solved.residual)]
    left = max(times_floor(float(r), floor) for r, floor in zip(rms, floors, strict=True))
    return Table(name, fit, left)


def _apart(
    fit: Fit,
    tables: Sequence[Table],
    name: str,
    estimates: Sequence[Estimate],
    part: slice,
    floors: Sequence[float],
) -> list[Contradiction]:
    """The two recordings that contradict each other most clearly on one parameter, if any do."""
    found = []
    for (one, a), (two, b) in combinations(zip(tables, estimates, strict=True), 2):
        spread = float(np.hypot(deviation(a), deviation(b)))
        difference = abs(a.value - b.value)
        if spread > 0 and contradict(a.value, b.value, spread):
            apart = one.fit.coefficients[part] - two.fit.coefficients[part]
            if _exceeds_noise(fit, part, apart, floors):
                found.append((difference / spread, (one.name, two.name), (a, b)))
    if not found:
        return []
    _, names, pair = max(found, key=lambda item: item[0])
    return [Contradiction(name, pair[0].unit, names, pair)]


def contradict(one: float, other: float, spread: float) -> bool:
    """Whether two values of a parameter cannot both be right; `spread`: standard deviation of their difference."""
    difference = abs(one - other)
    return difference > CERTAIN * spread and difference > LITTLE * max(abs(one), abs(other))


@dataclass(frozen=True)
class WrongInFile:
    """A base inertial parameter whose value in the model file the data contradict.

    gross   by far, and by much of a joint's torque: then what is found beside it may only stand for it
    """

    lump: LumpInfo
    stated: float
    estimate: Estimate
    gross: bool


def wrong_in_file(fit: Fit) -> list[WrongInFile]:
    """Parameters of the model file that the data contradict."""
    found = []
    for k, (lump, e) in enumerate(zip(fit.model.lumps, fit.inference.lumps, strict=True)):
        if lump.value is not None and contradict(lump.value, e.value, deviation(e)):
            far = abs(lump.value - e.value) > SOME * max(abs(lump.value), abs(e.value))
            found.append(WrongInFile(lump, lump.value, e, far and _of_torque(fit, k, lump.value) > LITTLE))
    return found


def _of_torque(fit: Fit, lump: int, stated: float) -> float:
    """The torque that a parameter's difference from the file makes, as a part of a joint's, where it is largest."""
    motion, apart, part = fit.motion, fit.coefficients[lump] - stated, 0.0
    for i in range(motion.n):
        use = motion.moving(i)
        size = float(np.linalg.norm(motion.recorded(i, fit.skew)[use]))
        if size > 0:
            part = max(part, abs(apart) * float(np.linalg.norm(fit.problem.regressors.rigid(i)[lump, use])) / size)
    return part


def deviation(e: Estimate) -> float:
    """Standard deviation; infinite where the data do not determine the parameter alone."""
    if e.interval is None or not np.all(np.isfinite([e.value, *e.interval])):
        return float("inf")
    return (e.interval[1] - e.interval[0]) / (2 * INTERVAL_SIGMAS)


def _exceeds_noise(fit: Fit, part: slice, apart: Array, floors: Sequence[float]) -> bool:
    """Whether a difference of coefficients makes more torque than the noise, at some joint."""
    problem, shapes, motion = fit.problem, fit.shapes, fit.motion
    for i, floor in enumerate(floors):
        use = motion.moving(i)
        torque = (apart @ problem.rows(i, shapes)[0][part])[use]
        if use.any() and float(np.sqrt(np.mean(torque**2))) > floor:
            return True
    return False


Unreliable = Literal["short motion", "inseparable", "worse than zero", "improper inertia"]
"""Why a fit to data that do not look wrong may not be believed: no joint moves for long enough; the motion does not
separate parameters; zero torque would have no larger error; the error is large, the inertia at a physical bound."""


@dataclass(frozen=True)
class JudgedFit:
    """A fit, the errors that it leaves at every joint, each recording's own, and what looks wrong with the data."""

    fit: Fit
    joints: tuple[JointSeries, ...]
    recordings: Tables
    suspicions: tuple[Suspicion, ...]

    @cached_property
    def why(self) -> Literal["wrong data", "contradiction"] | Unreliable | None:
        """Why it may not be believed; None where nothing speaks against it."""
        if self.suspicions:
            return "wrong data"
        return "contradiction" if self.recordings.contradictory else unreliable(self.fit, self.joints)

    @property
    def verdict(self) -> Literal["fitted", "refused"]:
        return "fitted" if self.why is None else "refused"


def judged(fit: Fit, recordings: Sequence[Recording]) -> JudgedFit:
    """A fit to these recordings, with what speaks against it."""
    joints = series(fit)
    names = [r.path.name for r in recordings]
    tables = compare(fit, names, [s.floor.spectrum for s in joints])
    return JudgedFit(fit, joints, tables, suspicions(fit, names))


def unreliable(fit: Fit, joints: Sequence[JointSeries]) -> Unreliable | None:
    """Why a fit to data that do not look wrong may not be believed; None if nothing speaks against it."""
    poor = poor_excitation(fit)
    if poor is not None:
        return poor
    if any(s.relative >= 1 for s in joints):
        return "worse than zero"
    far = any(map(far_above_noise, joints))
    return "improper inertia" if far and not has_proper_inertia(fit) else None


def poor_excitation(fit: Fit) -> Literal["short motion", "inseparable"] | None:
    """Why the motion does not determine the parameters; None if it does."""
    if max(moving_times(fit.motion)) < LEAST_MOVING_S:
        return "short motion"
    return "inseparable" if inseparable(fit) else None


def moving_times(motion: Motion) -> list[float]:
    """Seconds for which each joint moves."""
    return [seconds_moving(motion, i) for i in range(motion.n)]


def inseparable(fit: Fit) -> list[str]:
    """Parameters that the motion of the joints that move does not separate from others."""
    able = [s >= LEAST_MOVING_S for s in moving_times(fit.motion)]
    joints = [None, *(i + 1 for i, moves in enumerate(able) if moves)]
    return [name for joint in joints for name in _inseparable_effects(fit, joint)] + inseparable_inertia(fit)


def _inseparable_effects(fit: Fit, joint: int | None) -> list[str]:
    """Parameters of the effects of a joint (from 1), or of the arm, that the motion does not separate from others."""
    return [
        f"{term} {name}"
        for term, values in fit.inference.values.items()
        for name, e in values.items()
        if term.joint == joint and e.with_others and not any(w.startswith(ROTOR) for w in e.with_others)
    ]


def inseparable_inertia(fit: Fit) -> list[str]:
    """Base inertial parameters that the motion does not separate; none where a joint is held: inertias of the others
    are seen as sums only, and stay divided as in the file."""
    if min(moving_times(fit.motion)) < LEAST_MOVING_S:
        return []
    return [lump.name for lump, e in zip(fit.model.lumps, fit.inference.lumps, strict=True) if e.with_others]


def tangled(fit: Fit, joint: int) -> list[str]:
    """Why the motion of a joint (0-based) that moves cannot tell one law from another, as names of what it does not
    separate: its effects' parameters, or position and speed, which a single pass ties to each other."""
    found = _inseparable_effects(fit, joint + 1)
    return [*found, "position from speed"] if passes(fit, joint) < LEAST_PASSES else found


def passes(fit: Fit, joint: int) -> float:
    """How often a joint (0-based) passes each position of its range, on average; of a turn where it turns further."""
    motion = fit.motion
    use = motion.moving(joint)
    if not use.any():
        return 0.0
    q, qd = motion.rows("q", joint)[joint, use], motion.rows("qd", joint)[joint, use]
    reach = float(np.ptp(q))
    if fit.model.joints[joint].type == "revolute":
        reach = min(reach, 2 * np.pi)
    return float(np.sum(np.abs(qd))) / motion.row_rate(joint) / reach if reach else np.inf


def far_above_noise(joint: JointSeries) -> bool:
    """Whether a joint's error is far above its noise floor."""
    return joint.rms > FAR_ABOVE_NOISE * joint.noise


def mostly_missed(joints: Sequence[JointSeries]) -> list[JointSeries]:
    """Joints of whose torque more is missed than found, and that is no noise."""
    return [s for s in joints if s.relative > MOST and far_above_noise(s)]
