"""Parameter tables of several recordings, side by side: one arm has one inertia, whatever it was doing.

The structure that was fitted to all recordings together is fitted to each of them alone, with the shapes, the shift
between torque and motion and the weights of the common fit. What then differs by more than chance, and by enough
torque to matter, says that the recordings are not of one arm, or that the base model is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis.settings import CONTRADICTS, MATERIAL, ONLY_NOISE
from runtime.documents.fits import ContradictionEntry, RecordingFit
from runtime.identification.covariance import Inference, infer
from runtime.identification.estimate import Estimate
from runtime.identification.identify import Identification
from runtime.identification.problem import Fit, Problem, Skew
from runtime.identification.settings import INTERVAL_SIGMAS
from runtime.model.terms import Term
from runtime.wording import quantity, times_floor

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
