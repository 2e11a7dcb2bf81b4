"""Whether a fit may be believed: errors beside noise floors, recordings beside each other, and why not.

One arm has one inertia, whatever it was doing. The structure that was fitted to all recordings together is fitted to
each of them alone, with the shapes, the shift between torque and motion and the weights of the common fit. What then
differs by more than chance, and by enough torque to matter, says that the recordings are not of one arm, or that the
base model is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis.settings import CONTRADICTS, FAR_ABOVE_NOISE, LEAST_MOVING_S, MATERIAL, ONLY_NOISE
from runtime.diagnosis.steps import seconds_moving
from runtime.documents.fits import ContradictionEntry, JudgedFitDocument, RecordingFit
from runtime.fit_warnings import Suspicion, improper_inertia, suspicions, warnings
from runtime.identification.compare import JointSeries, series
from runtime.identification.covariance import Inference, infer
from runtime.identification.estimate import Estimate
from runtime.identification.identify import Identification
from runtime.identification.problem import Fit, Problem, Skew
from runtime.identification.settings import INTERVAL_SIGMAS
from runtime.model.terms import Term
from runtime.recordings.recording import Recording
from runtime.wording import quantity, times_floor
from symbolic.model_file.arm import ROTOR

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Table:
    """What one recording alone says.

    name   its file
    fit    its coefficients are in the order of the common layout
    left   residual over the instruments' noise, at the joint where it is largest
    """

    name: str
    fit: Fit
    inference: Inference
    left: float

    def document(self, identification: Identification) -> RecordingFit:
        fit = self.inference.document(identification.model)
        return RecordingFit(recording=self.name, parameters=fit.inertial, effects=fit.effects)


@dataclass(frozen=True)
class Contradiction:
    """A parameter that two recordings do not agree on. term: None for an inertial parameter; estimates a recording."""

    name: str
    unit: str
    term: Term | None
    names: tuple[str, ...]
    estimates: tuple[Estimate, ...]

    @property
    def label(self) -> str:
        """The parameter, with its effect and joint where it has one."""
        return self.name if self.term is None else f"{self.term} {self.name}"

    def document(self) -> ContradictionEntry:
        return ContradictionEntry(
            name=self.label,
            unit=self.unit,
            recordings=list(self.names),
            values=[e.value for e in self.estimates],
            intervals=[e.interval for e in self.estimates],
        )

    def __str__(self) -> str:
        values = [
            f"{quantity(e.value, self.unit, 3)} in {name}" for e, name in zip(self.estimates, self.names, strict=True)
        ]
        return f"{self.label} is {' and '.join(values)}"


@dataclass(frozen=True)
class Tables:
    """All recordings' tables, and where they contradict each other; empty with fewer than two recordings."""

    identification: Identification
    tables: tuple[Table, ...] = ()
    inertial: tuple[Contradiction, ...] = ()
    effects: tuple[Contradiction, ...] = ()

    @property
    def each_is_noise(self) -> bool:
        """Whether every recording alone is fitted to the noise: then nothing but the arm differs."""
        return all(table.left < ONLY_NOISE for table in self.tables)

    @property
    def refusal(self) -> str:
        """Why nothing can be named from recordings whose arm is not the same; empty if it is."""
        if self.inertial:
            apart, why = self.inertial, "another payload, another arm, or a base model that is wrong"
        elif self.effects:
            apart, why = self.effects, "temperature, load or wear"
        else:
            return ""
        return f"the recordings contradict each other: {'; '.join(map(str, apart))}: {why}; diagnose them one by one"

    @property
    def preface(self) -> str:
        """What differs between recordings that hold more than noise, as the beginning of a sentence."""
        return f"{self.refusal}; " if self.refusal else ""

    def recording_entries(self) -> list[RecordingFit]:
        """What each recording says alone."""
        return [table.document(self.identification) for table in self.tables]

    def contradiction_entries(self) -> list[ContradictionEntry]:
        """Parameters on which the recordings disagree."""
        return [c.document() for c in (*self.inertial, *self.effects)]


def compare(identification: Identification, names: Sequence[str], floors: Sequence[float]) -> Tables:
    """Tables of every recording in a fit of all; names: a file a recording; floors (n,) every joint's noise floor."""
    numbers = sorted({piece.recording for piece in identification.motion.pieces})
    if len(numbers) < 2:
        return Tables(identification)
    tables = tuple(_table(identification, number, _name(names, number), floors) for number in numbers)
    model, layout = identification.model, identification.problem.layout
    inertial = []
    if not identification.motion.rigid_given:
        for k, lump in enumerate(model.lumps):
            estimates = [t.inference.lumps[k] for t in tables]
            inertial += _apart(
                identification, tables, None, name=lump.name, estimates=estimates, part=slice(k, k + 1), floors=floors
            )
    effects = []
    for term, part in layout.slices.items():
        for parameter in model.library.effects[term.effect].linear:
            estimates = [t.inference.values[term][parameter.name] for t in tables]
            effects += _apart(
                identification, tables, term, name=parameter.name, estimates=estimates, part=part, floors=floors
            )
    return Tables(identification, tables, tuple(inertial), tuple(effects))


def _name(names: Sequence[str], number: int) -> str:
    if number < len(names) and names.count(names[number]) == 1:
        return names[number]
    return f"recording {number + 1}"


def _table(identification: Identification, number: int, name: str, floors: Sequence[float]) -> Table:
    """The common structure's linear unknowns from one recording."""
    common, motion = identification.fit, identification.motion
    own = motion.of_recording(number)
    problem = Problem(
        identification.model, own, identification.problem.layout.terms, prediction=common.prediction, ahead=common.ahead
    )
    problem.weights = common.weights
    solved = problem.solve(common.shapes, Skew(common.skew))
    theta = solved.coefficients
    prediction = problem.prediction(theta, common.shapes)
    fit = Fit(
        prediction,
        theta,
        common.shapes,
        skew=common.skew,
        skew_free=False,
        residual=solved.residual,
        weights=common.weights,
        ahead=common.ahead,
    )
    rms = [np.sqrt(r @ r / max(1, own.moving(i).sum())) for i, r in enumerate(solved.residual)]
    left = max(times_floor(float(r), floor) for r, floor in zip(rms, floors, strict=True))
    return Table(name, fit, infer(problem, fit), left)


def _apart(
    identification: Identification,
    tables: Sequence[Table],
    term: Term | None,
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
            if _worth(identification, part, apart, floors):
                found.append((difference / spread, (one.name, two.name), (a, b)))
    if not found:
        return []
    _, names, pair = max(found, key=lambda item: item[0])
    return [Contradiction(name, pair[0].unit, term, names=names, estimates=pair)]


def contradict(one: float, other: float, spread: float) -> bool:
    """Whether two values of a parameter cannot both be right; `spread`: standard deviation of their difference."""
    difference = abs(one - other)
    return difference > CONTRADICTS * spread and difference > MATERIAL * max(abs(one), abs(other))


def deviation(e: Estimate) -> float:
    """Standard deviation; infinite where the data do not tell the parameter alone."""
    if e.interval is None or not np.all(np.isfinite([e.value, *e.interval])):
        return float("inf")
    return (e.interval[1] - e.interval[0]) / (2 * INTERVAL_SIGMAS)


def _worth(identification: Identification, part: slice, apart: Array, floors: Sequence[float]) -> bool:
    """Whether a difference of coefficients makes more torque than the noise, at some joint."""
    problem, shapes, motion = identification.problem, identification.fit.shapes, identification.motion
    for i, floor in enumerate(floors):
        use = motion.moving(i)
        torque = (apart @ problem.rows(i, shapes)[0][part])[use]
        if use.any() and float(np.sqrt(np.mean(torque**2))) > floor:
            return True
    return False


@dataclass(frozen=True)
class JudgedFit:
    """A fit, the errors that it leaves at every joint, each recording's own, and why it may not be believed.

    reason: a sentence a person can act on, or none
    """

    identification: Identification
    joints: tuple[JointSeries, ...]
    recordings: Tables
    reason: str

    @property
    def verdict(self) -> Literal["fitted", "refused"]:
        return "refused" if self.reason else "fitted"

    def document(self) -> JudgedFitDocument:
        """As `tendon identify --json`, but for what was written."""
        return self.identification.document().as_part_of(
            JudgedFitDocument,
            verdict=self.verdict,
            reason=self.reason or _fitted(self.joints),
            joints=[joint.document() for joint in self.joints],
            recordings=self.recordings.recording_entries(),
            inconsistent=self.recordings.contradiction_entries(),
            warnings=[*warnings(self.identification), *([] if self.reason else above_noise(self.joints))],
        )


def judged(identification: Identification, recordings: Sequence[Recording]) -> JudgedFit:
    """A fit to these recordings, with what speaks against it."""
    joints = series(identification)
    names = [r.path.name for r in recordings]
    tables = compare(identification, names, [s.floor.spectrum for s in joints])
    return JudgedFit(identification, joints, tables, _reason(identification, joints, tables))


def _reason(identification: Identification, joints: Sequence[JointSeries], tables: Tables) -> str:
    return wrong_data(suspicions(identification)) or tables.refusal or unreliable(identification, joints)


def unreliable(identification: Identification, joints: Sequence[JointSeries]) -> str:
    """Why a fit to data that do not look wrong may not be believed; empty if nothing speaks against it."""
    return poor_excitation(identification) or _unphysical(identification, joints)


def _fitted(joints: Sequence[JointSeries]) -> str:
    errors = ", ".join(f"{100 * s.relative:.3g} % of the torque at joint {s.joint}" for s in joints if len(s.t))
    return f"the fit misses {errors}"


def wrong_data(found: Sequence[Suspicion]) -> str:
    """Suspicions as the reason of a refusal; empty without one."""
    return f"the data look wrong: {'; '.join(map(str, found))}" if found else ""


def poor_excitation(identification: Identification) -> str | None:
    """Why the motion does not tell the parameters; None if it does."""
    motion, inference = identification.motion, identification.inference
    seconds = [seconds_moving(motion, i) for i in range(motion.n)]
    if max(seconds) < LEAST_MOVING_S:
        return f"the joints move for {max(seconds):.1f} s only; record at least {LEAST_MOVING_S:g} s of motion"
    able = [s >= LEAST_MOVING_S for s in seconds]
    tangled = [
        f"{term} {name}"
        for term, values in inference.values.items()
        for name, e in values.items()
        if e.with_others and (term.joint is None or able[term.joint - 1]) and not _by_a_rotor(e)
    ]
    # With a joint held, inertias of the others are seen as sums only, and stay divided as in the file.
    tangled += [
        lump.name
        for lump, e in zip(identification.model.lumps, inference.lumps, strict=True)
        if e.with_others and all(able)
    ]
    if tangled:
        return f"the motion does not separate {', '.join(tangled)}; move over more speeds, accelerations and positions"
    return None


def _by_a_rotor(e: Estimate) -> bool:
    """Whether it is told together with a rotor that the model file leaves out: no other motion would change that."""
    return any(name.startswith(ROTOR) for name in e.with_others)


def _unphysical(identification: Identification, joints: Sequence[JointSeries]) -> str:
    """That a fit is worse than none, or far above the noise at the bound of what is physical; empty if neither."""
    worthless = [s for s in joints if s.relative >= 1]
    if worthless:
        at = " and ".join(f"joint {s.joint} {100 * s.relative:.3g} %" for s in worthless)
        return f"the fit is worse than no torque at all (it misses at {at} of it): the model or the data is wrong"
    if any(_far(s) for s in joints):
        return "; ".join(improper_inertia(identification))
    return ""


def _far(joint: JointSeries) -> bool:
    return joint.rms > FAR_ABOVE_NOISE * joint.floor.value


def above_noise(joints: Sequence[JointSeries]) -> list[str]:
    """Joints whose error is far above the noise."""
    return [
        f"joint {s.joint}: the fit misses {100 * s.relative:.3g} % of the torque, {s.rms / s.floor.value:.2g} times "
        "its noise floor: what the model lacks is in its parameters, too; tendon diagnose looks for it"
        for s in joints
        if s.floor.value > 0 and _far(s)
    ]
