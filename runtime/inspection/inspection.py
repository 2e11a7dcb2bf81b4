"""Inspection of a recording: its document, and checks of the signals that need no model.

The integral of a rate is compared with its position, which needs no differentiation: units, signs, exchanged joints. If
a joint returns to its start, its torque has done positive work, because friction dissipates.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.documents.recordings import (
    ClockShiftEntry,
    DeterminedParameter,
    FieldEntry,
    InertiaEntry,
    InspectDocument,
    MissEntry,
    OtherClock,
    RepeatsEntry,
    SuspicionEntry,
    TorqueEntry,
)
from runtime.fit_warnings import Suspicion, doubts, suspicions
from runtime.identification.compare import JointSeries, series
from runtime.identification.drive_gains import with_gains
from runtime.identification.estimate import Estimate
from runtime.identification.fit import Fit
from runtime.identification.identify import delay_entries, identify
from runtime.identification.problem import configurations
from runtime.identification.settings import WORK_TELLS
from runtime.inspection.drive_laws import allowed
from runtime.inspection.guesses import map_options, unit_in_name
from runtime.inspection.settings import FOLLOWS, MANY_TURNS, SCALE_OFF
from runtime.inspection.signals import (
    clock_entry,
    integrated,
    joint_entries,
    moves,
    scale,
    shift_entries,
    signal_entries,
)
from runtime.model.loader import Model
from runtime.motion import repeats
from runtime.motion.clock import grid
from runtime.motion.settings import MOST
from runtime.recordings import recording
from runtime.recordings.columns import UNITS, RecordedArm
from runtime.recordings.contents import Contents, RecordingError, Refusal, map_option, printable
from runtime.recordings.recording import Recording
from symbolic.model_file.arm import MOTOR_TORQUE
from symbolic.model_file.checks import quote

MISREAD = "field"
"""Kind of a suspicion that a field is another signal than it is read as, so that no fit is meaningful."""
_JOINT_SIGNAL = re.compile(r"(q|qd|tau)(\d+)(?:_link|_desired)?", re.ASCII)
_DIMENSIONS = {"q": ("angle",), "qd": ("angular rate",), "tau": ("torque", "current")}
"""Dimensions of a joint's signals: a unit at the end of a field's name counts only if it has one of these."""


def by_signals(recording: Recording) -> list[Suspicion]:
    """Suspicions that do not depend on the arm: fields read in SI although their names end in another unit, and rates
    that are not the derivatives of their positions."""
    found = []
    for signal, cell in recording.cells.items():
        known = _JOINT_SIGNAL.fullmatch(signal)
        unit = unit_in_name(cell) if known and signal not in recording.units else None
        if known is None or unit is None or UNITS[unit][0] not in _DIMENSIONS[known[1]]:
            continue
        if recording.types[int(known[2]) - 1] == "revolute":
            said = f"{signal} is read in SI, and the name of its field, {quote(cell)}, ends in the unit {unit}"
            kind = "degrees" if unit == "deg" else "unit"
            found.append(_cured(int(known[2]), kind, said, "if so,", map_option(recording.cells, signal, unit=unit)))
    named = {suspicion.joint for suspicion in found}
    return [*found, *(s for s in of_rates(recording) if s.joint not in named)]


def without_model(recording: Recording) -> list[Suspicion]:
    """Suspicions about positions and torques, for recordings without a model."""
    made = [number for number, law in enumerate(recording.driven, 1) if law is not None]
    return [*over_turns(recording), *(s for s in _braking(recording) if s.joint not in made)]


def of_rates(recording: Recording) -> list[Suspicion]:
    """Measured rates that are not the derivatives of their positions."""
    found: list[Suspicion] = []
    if recording.qd is None:
        return found
    samples = max(recording.segments, key=lambda s: s.stop - s.start)
    t, q = recording.t[samples], recording.q[:, samples]
    complete = [i for i, qd in enumerate(recording.qd) if np.isfinite(qd).all() and np.ptp(q[i])]
    integrals = {i: integrated(recording.qd[i, samples], t) for i in complete}
    integrals = {i: integral for i, integral in integrals.items() if np.ptp(integral) > 0}
    for i, integral in integrals.items():
        factor, explained = scale(q[i], integral, t)
        if explained > FOLLOWS:
            found += _scaled(recording, i, factor)
            continue
        others = {j: scale(q[i], other, t)[1] for j, other in integrals.items() if j != i}
        best = max(others, key=lambda j: others[j], default=None)
        position, rate = f"q{i + 1}", f"qd{i + 1}"
        if best is not None and others[best] > FOLLOWS:
            said = f"qd{best + 1} is the derivative of {position}, and {rate} is not"
            cure = map_option(recording.cells, rate, f"qd{best + 1}")
            found.append(_cured(i + 1, "exchanged", said, "expected both under one number:", cure))
        elif explained < MOST and moves(recording.q[i], grid(recording)):
            said = f"{rate} is not the derivative of {position}, which explains {100 * explained:.2g} % of its integral"
            asked = f"are {position} and {rate} read from the right fields? Name them with --map, or drop {rate}"
            found.append(Suspicion(i + 1, MISREAD, said, asked))
    return found


def rates_in_degrees(recording: Recording, joints: Sequence[int]) -> list[Suspicion]:
    """Rates of joints (1-based) whose positions are in degrees, if they are the derivatives of these positions."""
    found, wrong = [], {s.joint for s in of_rates(recording)}
    for joint in joints if recording.qd is not None else ():
        if joint not in wrong:
            said = f"qd{joint} is read in the unit of q{joint} a second"
            cure = map_option(recording.cells, f"qd{joint}", unit="deg/s")
            found.append(_cured(joint, "unit", said, "if that is deg/s,", cure))
    return found


def _scaled(recording: Recording, joint: int, factor: float) -> list[Suspicion]:
    """A rate that is a multiple of the derivative of its position: a wrong sign or unit."""
    q, qd = f"q{joint + 1}", f"qd{joint + 1}"
    said = f"{qd} is {factor:.3g} times the derivative of {q}"
    if abs(abs(factor) - 1) < SCALE_OFF:
        if factor > 0:
            return []
        cure, other = (map_option(recording.cells, name, turned=True) for name in (qd, q))
        expected = f"expected the same sign: pass {cure}, or {other}"
        return [Suspicion(joint + 1, "sign", said, cure=expected, maps=(cure,))]
    units = _units_of(abs(factor))
    if units is None:
        return [Suspicion(joint + 1, "unit", said, f"check the units of {qd}, {q} and t, and state them with --map")]
    cures = (map_option(recording.cells, name, unit=of) for name, of in zip((q, qd), units, strict=True) if of)
    return [_cured(joint + 1, "unit", said, "expected rad and rad/s:", *cures)]


def _units_of(factor: float) -> tuple[str, str] | None:
    """Units of a position and its rate ("" for SI) if the rate is `factor` times the derivative.

    The nearest pair of those that fit, such as deg/s for rad or rpm for turns; of equally near ones the one with SI.
    None: no pair fits.
    """
    positions, rates = ("", "deg", "rev", "mrad"), ("", "deg/s", "rpm", "rev/s", "mrad/s")
    size = {unit: UNITS[unit][1] if unit else 1.0 for unit in positions + rates}
    off = {(q, qd): abs(float(np.log(factor * size[qd] / size[q]))) for q in positions for qd in rates if q or qd}
    q, qd = min(off, key=lambda pair: (round(off[pair], 9), sum(map(bool, pair))))
    return (q, qd) if off[q, qd] < np.log1p(SCALE_OFF) else None


def over_turns(recording: Recording) -> list[Suspicion]:
    """Positions over many turns without a stated unit, which may be degrees."""
    found = []
    for i, q in enumerate(recording.q):
        turns = float(np.ptp(q)) / (2 * pi)
        if recording.types[i] == "revolute" and turns > MANY_TURNS and f"q{i + 1}" not in recording.units:
            cure, said = map_option(recording.cells, f"q{i + 1}", unit="deg"), f"its position covers {turns:.3g} turns"
            found.append(_cured(i + 1, "degrees", said, "if it is in degrees,", cure))
    return found


def _braking(recording: Recording) -> list[Suspicion]:
    """Joints that return to their start and whose torque did negative work, which friction cannot explain.

    The sign may be wrong, or the torque may be another joint's; with several joints the message lists both.
    """
    work, part = _work(recording)
    # A joint that ends further from its start than half of its range may have done its work on a load.
    returned = np.abs(recording.q[:, -1] - recording.q[:, 0]) <= np.ptp(recording.q, axis=1) / 2
    found = []
    for i in np.flatnonzero(returned & (np.diagonal(part) < -WORK_TELLS)):
        joint, said = int(i) + 1, "its torque brakes the motion on average, as friction does and no motor"
        cure = map_option(recording.cells, f"tau{joint}", turned=True)
        if f"tau{joint}" not in recording.currents:
            said = f"{said} (work of {work[i, i]:.3g} J)"
        if len(recording.q) == 1:
            found.append(_cured(joint, "sign", said, "expected positive torque towards positive positions:", cure))
            continue
        # Torques may be exchanged if each drives the other joint's motion.
        exchanges = []
        for j in np.flatnonzero((part[:, i] > WORK_TELLS) & (part[i] > WORK_TELLS)):
            names = f"tau{joint}", f"tau{int(j) + 1}"
            exchanges.append(" ".join(map_option(recording.cells, a, b) for a, b in (names, names[::-1])))
        other = " or ".join(exchanges) or "name them in the order of the joints"
        expected = f"if its sign is wrong, pass {cure}; if torques are exchanged, {other}"
        found.append(Suspicion(joint, "sign or order", said, expected))
    return found


def _work(recording: Recording) -> tuple[Array, Array]:
    """(n, n) work in J of the torque of one joint (row) on the motion of another (column), and the same as a part of
    the largest work that torques and speeds of these sizes can do."""
    n = len(recording.q)
    work, effort = np.zeros((n, n)), np.zeros((n, n))
    for samples in recording.segments:
        q, tau = recording.q[:, samples], recording.tau[:, samples]
        travel, middle = np.diff(q, axis=1), (tau[:, 1:] + tau[:, :-1]) / 2
        work += middle @ travel.T
        effort += np.outer(np.linalg.norm(middle, axis=1), np.linalg.norm(travel, axis=1))
    return work, np.divide(work, effort, out=np.zeros((n, n)), where=effort > 0)


def _cured(joint: int, kind: str, said: str, when: str, *maps: str) -> Suspicion:
    return Suspicion(joint, kind, said, cure=f"{when} pass {' '.join(maps)}", maps=maps)


@dataclass(frozen=True)
class Inspection:
    """What a file contains.

    contents    its fields, whether or not they are understood
    recording   None if the file cannot be read, even with gaps split and samples dropped
    problem     why the file cannot be used as it is, with place and cure; None: it can
    names       of the model's joints
    lawless     it has no torque, and the model file no law of a drive: read by the first law that its columns allow
    fitted      the fit of a model, if there is one     unfitted   why the fit failed
    """

    path: Path
    contents: Contents
    recording: Recording | None
    problem: str | None
    names: tuple[str | None, ...]
    lawless: bool = False
    fitted: Fit | None = None
    unfitted: str | None = None

    @cached_property
    def found(self) -> list[Suspicion]:
        """What looks wrong: by the fit if there is one, as in other verbs, else by the signals alone."""
        if self.recording is None:
            return []
        signals = by_signals(self.recording)
        if any(s.kind == MISREAD for s in signals):
            return signals
        if self.fitted is None:
            found, uncertain = without_model(self.recording), []
        else:
            found = list(self._by_fit or doubts(self.fitted))
            # Without a stated inertia, no fit distinguishes degrees from radians.
            uncertain = [] if self.fitted.model.lumps_known else over_turns(self.recording)
        for further in (signals, uncertain):
            found += [s for s in further if s.joint not in {t.joint for t in found}]
        degrees = dict.fromkeys(s.joint for s in found if s.kind == "degrees")
        return [*found, *rates_in_degrees(self.recording, list(degrees))]

    @cached_property
    def _by_fit(self) -> tuple[Suspicion, ...]:
        return () if self.fitted is None else suspicions(self.fitted)

    @property
    def usable(self) -> bool:
        """Whether the file can be used as it is: a fit's doubts do not keep a verb from its answer."""
        doubted = doubts(self.fitted) if self.fitted is not None and not self._by_fit else ()
        return self.problem is None and all(suspicion in doubted for suspicion in self.found)

    @property
    def believed(self) -> Fit | None:
        """The fit, if the data look right."""
        return None if self.found else self.fitted

    @cached_property
    def joints(self) -> tuple[JointSeries, ...]:
        """What that fit leaves at each joint."""
        return () if self.believed is None else series(self.believed)

    def document(self, unreliable: str) -> InspectDocument:
        """The document of `tendon inspect --json`; unreliable: why the fit may not be believed."""
        recording, fitted, believed = self.recording, self.fitted, self.believed
        unnamed = None if recording else re.search(r"no column (\w+)", self.problem or "")
        return InspectDocument(
            file=str(self.path),
            format=self.contents.format,
            fields=[FieldEntry(name=f.name, clock=f.clock) for f in self.contents.fields],
            problem=self.problem,
            suggested=map_options(self.contents.fields, unnamed[1]) if unnamed else [],
            notes=list(recording.notes if recording else self.contents.notes),
            clock=clock_entry(recording) if recording else None,
            clocks=[
                OtherClock(
                    clock=clock.name,
                    signals=list(clock.signals),
                    rate_hz=clock.rate,
                    shift=None if clock.shift is None else ClockShiftEntry(**vars(clock.shift)),
                    corrected=clock.corrected,
                )
                for clock in (recording.clocks if recording else ())
            ],
            signals=signal_entries(recording) if recording else [],
            joints=joint_entries(recording, self.names) if recording else [],
            shifts=shift_entries(recording) if recording else [],
            repeats=None if fitted is None else RepeatsEntry(seconds=repeats.find(fitted.motion)[0].seconds),
            delay=[] if fitted is None else delay_entries(fitted),
            parameters=[] if fitted is None else determined(fitted),
            unfitted=self.unfitted,
            misses=[MissEntry(joint=s.joint, part=s.relative) for s in self.joints if len(s.t)],
            unreliable=unreliable,
            inertias=[] if believed is None else _inertias(believed),
            torque=None
            if recording is None
            else TorqueEntry(kind=recording.torque or MOTOR_TORQUE, by=recording.torque_by or None),
            drive_laws=[] if recording is None else allowed(recording.cells, len(recording.q)),
            suspicions=[SuspicionEntry(joint=s.joint, kind=s.kind, found=s.found, cure=s.cure) for s in self.found],
            cures=list(dict.fromkeys(option for s in self.found for option in s.maps)),
        )


def inspect(path: Path, arm: RecordedArm | None, mapping: Mapping[str, str], allow_gaps: bool = False) -> Inspection:
    """Inspects a file. arm: None: as many joints as the file names. Raises RecordingError if it is not a recording."""
    refuse = Refusal(printable(path))
    return of_contents(recording.opened(path, refuse), path, arm, mapping, allow_gaps, refuse)


def of_contents(
    contents: Contents,
    path: Path,
    arm: RecordedArm | None,
    mapping: Mapping[str, str],
    allow_gaps: bool,
    refuse: Refusal,
) -> Inspection:
    """Inspects the contents of a recording, named by its path."""
    names = tuple(joint.name for joint in arm.joints) if arm else ()
    problem: str | None = None
    # A file that cannot be used as it is may be readable with gaps split and samples dropped, or without a torque.
    any_law = arm and replace(arm, any_law=True)
    for reader, gaps in ((arm, allow_gaps), (arm, True), (any_law, True)):
        try:
            read = recording.checked(contents, path, reader, mapping, gaps, refuse)
            return Inspection(path, contents, read, problem=problem, names=names, lawless=reader is not arm)
        except RecordingError as error:
            problem = problem or str(error)
    return Inspection(path, contents, None, problem=problem, names=names)


def with_model(inspection: Inspection, model: Model) -> Inspection:
    """The same with a fit of the model's structure."""
    if inspection.recording is None or inspection.lawless:
        return inspection
    try:
        made = with_gains(model, [inspection.recording], 1)
        return replace(inspection, recording=made[0], fitted=identify(model, made))
    except RecordingError as error:
        return replace(inspection, unfitted=str(error))


def _inertias(fitted: Fit) -> list[InertiaEntry]:
    """The fitted inertia that each moving joint moves, on the average of the motion: at other positions it is not told;
    none if the model file states all inertias."""
    model, motion = fitted.model, fitted.motion
    if model.lumps_known or motion.rigid_given:
        return []
    lumps = fitted.coefficients[fitted.problem.layout.lumps]
    q = configurations([p.q for p in motion.pieces])
    moved = np.mean(np.einsum("iit->it", model.inertia(q, lumps)), axis=1)
    units = ["kg" if joint.type == "prismatic" else "kg m^2" for joint in model.joints]
    able = [i for i in range(model.n) if motion.moving(i).any()]
    return [InertiaEntry(joint=i + 1, value=float(moved[i]), unit=units[i]) for i in able]


def determined(fitted: Fit) -> list[DeterminedParameter]:
    """How well the recording determines each parameter."""
    inference = fitted.inference
    lumps = zip(fitted.model.lumps, inference.lumps, strict=True)
    rows: list[tuple[str, int | None, Estimate]] = [(lump.name, None, e) for lump, e in lumps]
    for term, values in inference.values.items():
        rows += [(f"{term} {name}", term.joint, e) for name, e in values.items()]
    found = []
    for name, joint, e in rows:
        told = "together" if e.with_others else "no"
        if not e.with_others and e.known_interval is not None:
            low, high = e.known_interval
            told = "well" if high - low < abs(e.value) else "hardly"  # a half width of half of the value
        found.append(e.document().as_part_of(DeterminedParameter, name=name, joint=joint, told=told))
    return found
