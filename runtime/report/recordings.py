"""Sections of inspect, simulate and experiment."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from msgspec import UnsetType

from runtime.documents.experiments import FirstMotionDocument
from runtime.documents.parts import EffectAt, given
from runtime.documents.recordings import (
    AssumedNumber,
    ClockEntry,
    DeterminedParameter,
    DriveLawEntry,
    ExperimentDocument,
    InspectDocument,
    MovedJoint,
    PromiseEntry,
    SimulateDocument,
    TrialDiagnosis,
)
from runtime.inspection.drive_laws import RECORDED
from runtime.model.terms import Term
from runtime.report.fits import delays
from runtime.report.sections import Bullets, Group, Paragraph, Section, cut, table, texts
from runtime.wording import joints_said, number, numbered, percent, quantity, sentence
from symbolic.model_file.checks import at_joint, quote

_MOST_FIELDS = 24
_MUCH_WIDER = 3.0
_DETERMINED = {
    "well": "Well determined",
    "hardly": "Poorly determined",
    "together": "Determined only in combination",
    "no": "Not determined",
}

_TORQUES = {
    "motor": "of the motors, times the gear ratios",
    "link": "measured at the links, without the friction and inertia of motors",
    "command": "as commanded: what the drives do to them is left in the error",
    "gravity_compensated": "without gravity, which the driver took out",
}
"""Kind of torque -> words."""


def inspection(document: InspectDocument) -> list[Section]:
    """A file's contents, its clock and signals, how well it determines the model, and what looks wrong."""
    fields = len(document.fields)
    heading = f"{document.file}: {document.format}, {fields} field{'s' if fields != 1 else ''}"
    made: list[Section] = list(texts([heading, *document.notes]))
    if document.clock is None:
        families = Counter(re.sub(r"_?\d+$", "", f.name) for f in document.fields)
        names = [quote(name) + (f" ({many})" if many > 1 else "") for name, many in families.items()]
        more = f" and {len(names) - _MOST_FIELDS} more" if len(names) > _MOST_FIELDS else ""
        made.append(Paragraph(f"Fields: {', '.join(names[:_MOST_FIELDS])}{more}"))
    else:
        made += _recorded(document, document.clock)
        if not document.suspicions:  # a fit to wrong data determines nothing
            made += texts(_fit(document))
    if not isinstance(document.promises, UnsetType):
        made += _kept(document.promises)
    return [*made, *texts(wrong(document))]


def _kept(promises: Sequence[PromiseEntry]) -> list[Section]:
    """Whether the motion told what it promised, and what it told less well."""
    well = [p for p in promises if p.promised == "well"]
    kept = [p for p in well if p.told == "well"]
    lines = [f"told well as promised: {len(kept)} of {len(well)} parameters"]
    wider = [p for p in kept if p.width and p.promised_width and p.width > _MUCH_WIDER * p.promised_width]
    if len(kept) < len(well):
        lines.append(f"promised and not told well: {_joined([p.name for p in well if p.told != 'well'])}")
    if wider:
        said = [f"{p.name} {number(p.width, 2)} for {number(p.promised_width, 2)} {p.unit}" for p in wider]
        lines.append(f"intervals more than {_MUCH_WIDER:g} times as wide: {', '.join(said)}")
    return [Group("Against what was promised of the motion", (Bullets(tuple(lines)),))]


def _recorded(document: InspectDocument, clock: ClockEntry) -> list[Section]:
    gaps = f"{clock.gaps} gap{'s' if clock.gaps != 1 else ''}"
    runs = f", {clock.runs} runs" if clock.runs > 1 else ""
    steps = "even steps"
    if clock.jitter:
        steps = f"jitter {quantity(clock.jitter, 's', 2)}, longest step {quantity(clock.longest_step, 's', 3)}"
    rate = f"{quantity(clock.seconds, 's')} at {quantity(clock.rate_hz, 'Hz')}"
    rows = [
        (
            s.signal,
            "" if s.field == s.signal else s.field,
            s.unit,
            *(number(x) for x in (s.least, s.largest, s.resolution, s.noise)),
        )
        for s in document.signals
    ]
    lines = []
    for j in document.joints:
        text = "is held"
        if j.moves:
            far, fast = quantity(j.range, j.unit), quantity(j.top_speed, f"{j.unit}/s")
            text = f"moves over {far}, up to {fast}" + ("" if j.powered else "; its torque never changes")
        lines.append(f"Joint {numbered(j.joint, j.name)}: {text}")
    for shift in document.shifts:
        how = "later" if shift.value > 0 else "earlier"
        lines.append(f"{shift.signal} is {quantity(abs(shift.value), 's', 3)} {how} than its position")
    if document.torque and document.torque.by:
        lines.append(f"Torques: {_TORQUES[document.torque.kind]}, by {document.torque.by}")
    lines += drive_laws(document.drive_laws)
    if document.repeats:
        seconds = document.repeats.seconds
        lines.append(f"Repeated motion: {quantity(seconds, 's', 3)}" if seconds else "No motion is repeated")
    estimated = any(delay.estimated or given(delay.hold) for delay in document.delay)
    return [
        Paragraph(f"{clock.samples} samples, {rate}; {steps}, {gaps}{runs}"),
        table(("signal", "field", "unit", "least", "largest", "resolution", "noise"), rows),
        *texts(lines),
        *(delays(document.delay) if estimated else []),
    ]


def drive_laws(laws: Sequence[DriveLawEntry]) -> list[str]:
    """How the torque may come about, a line for joints alike; nothing where only the torque is recorded."""
    if all(entry.law == RECORDED for entry in laws):
        return []
    own: dict[int, list[str]] = {}
    for entry in laws:
        columns = ", ".join(re.sub(r"\d+", "", column) for column in entry.columns)
        needs = f" from {columns} (needs {' or '.join(' and '.join(keys) for keys in entry.needs)})"
        own.setdefault(entry.joint, []).append("torque as recorded" if entry.law == RECORDED else f"{entry.law}{needs}")
    alike: dict[str, list[int]] = {}
    for joint, said in own.items():
        alike.setdefault("; ".join(said), []).append(joint)
    lines = [f"Drive laws for {joints_said(joints)}: {said}" for said, joints in alike.items()]
    return [*lines, "Gains that [joint.drive] of the model file leaves out are fitted."]


def _fit(document: InspectDocument) -> list[str]:
    lines = told(document.parameters)
    if document.misses:
        errors = [f"{percent(m.part)} at joint {m.joint}" for m in document.misses]
        lines.append(f"Part of the torque that the model's best fit misses: {', '.join(errors)}")
    if document.inertias:
        found = [f"{quantity(j.value, j.unit, 3)} at joint {j.joint}" for j in document.inertias]
        doubt = "if that is implausible, the torques are in another unit, or those of the motor before the gear"
        lines.append(f"Fitted inertia, which the model file leaves open: {', '.join(found)}; {doubt}")
    return lines


def _joined(names: Sequence[str]) -> str:
    """Names of parameters; those of an effect (`viscous@2 coefficient`) once for all joints that share them."""
    own: dict[str, list[str]] = {}
    for name in names:
        term, _, parameter = name.partition(" ")
        own.setdefault(term, []).append(parameter)
    lumps = [name for name, parameters in own.items() if parameters == [""]]
    alike: dict[str, list[int]] = {}
    for term in (term for term in own if term not in lumps):
        effect, _, joint = term.partition("@")
        alike.setdefault(f"{effect} ({', '.join(own[term])})", []).extend([int(joint)] if joint else [])
    return "; ".join([*([", ".join(lumps)] if lumps else []), *_at_joints(alike)])


def _at_joints(joints: dict[str, list[int]]) -> list[str]:
    return [text + (f" at {joints_said(own)}" if own else "") for text, own in joints.items()]


def wrong(document: InspectDocument) -> list[str]:
    """What is wrong with a recording, what looks wrong, and what to do; one line if nothing is."""
    lines = []
    if document.problem:
        lines.append(f"Not usable as it is: {document.problem}")
    if document.suggested:
        lines.append(f"Perhaps: {' '.join(document.suggested)}")
    if document.unfitted:
        lines.append(f"No fit: {document.unfitted}")
    lines += [f"Joint {s.joint}: {s.found}; {s.cure}" for s in document.suspicions]
    if len(document.suspicions) > 1 and document.cures:
        lines.append(f"All at once: {' '.join(document.cures)}")
    if document.unreliable:
        lines.append(f"The fit is unreliable: {document.unreliable}")
    if not (document.problem or document.suspicions or document.unfitted or document.unreliable):
        lines.append(
            "Nothing looks wrong." if document.parameters else "Nothing looks wrong; with MODEL more can be checked."
        )
    return lines


def simulation(document: SimulateDocument) -> list[Section]:
    """What is in a simulated recording."""
    lines = [f"{document.out}: {document.samples} samples, {quantity(document.seconds, 's')}"]
    assumed: dict[str, list[int]] = {}
    for entry in document.effects:
        if entry.hidden:
            values = ", ".join(f"{name} {number(value)}" for name, value in entry.values.items())
            lines.append(f"hidden: {entry.effect}{at_joint(entry.joint)}: {values}")
        if entry.assumed:
            assumed.setdefault(entry.effect, []).extend([entry.joint] if entry.joint else [])
    if assumed:
        places = "; ".join(_at_joints(assumed))
        lines.append(f"open in the model file, simulated with moderate values (see --json): {places}")
    commands: dict[tuple[str, str], list[int]] = {}
    for drive in document.drives:
        commands.setdefault((drive.law, drive.command), []).append(drive.joint)
    for (law, command), joints in commands.items():
        lines.append(
            f"{joints_said(joints)}: no torque is recorded, but {command}: the command at which its {law} drive makes "
            "the torque exactly"
        )
    return [*texts(lines), *assumed_numbers(document.assumed)]


def assumed_numbers(assumed: Sequence[AssumedNumber]) -> list[Section]:
    """What the model file leaves out and which number was taken, a line each; nothing where it states all."""
    if not assumed:
        return []
    lines = [
        f"joint {numbered(a.joint, a.name)}: {a.parameter}"
        + (f" {quantity(a.value, a.unit)}" if a.value is not None else "")
        + f" ({a.reason})"
        for a in assumed
    ]
    return [Group("Not in the model file, and assumed", (Bullets(tuple(lines)),))]


def experiment(document: ExperimentDocument) -> list[Section]:
    """The verdict, the motion and what it asks of the joints, what it separates, and what the diagnosis made of it."""
    lines = [("SEPARATED: " if document.separated else "NOT SEPARATED: ") + sentence(document.reason)]
    lines += [*cut(document.search), ""]
    for rival in document.rivals:
        values = ", ".join(f"{name} {number(value)}" for name, value in rival.values.items())
        lines.append(f"{_name(rival)} was simulated with {values}")
    motion = document.motion
    moved = [*motion.pieces, *map(_joint, motion.joints)]
    if not all(j.position_stated and j.speed_stated and j.torque_stated for j in motion.joints):
        moved.append(
            "assumed: limits that the model file does not state; the torque's is what the ordinary excitation needs"
        )
    after = [_trials("this motion", document.trials), _trials("the ordinary excitation", document.ordinary_trials)]
    for change in document.relief:
        enough = "enough" if change.enough else "not enough"
        after.append(f"With {change.change}: {number(change.sigmas, 3)} standard deviations apart, {enough}.")
    if document.out:
        after.append(f"Written: {document.out}")
    separations = []
    for s in document.separations:
        other = "the model as it is" if s.explained_by is None else _name(s.explained_by)
        sizes = f"{number(s.after, 3)}, with the ordinary excitation {number(s.before, 3)}"
        separations.append(f"{_name(s.hidden)} by {other}: {sizes}")
    return [
        *texts([*lines, f"Motion: {number(motion.seconds, 3)} s, {motion.times} times through"]),
        Bullets(tuple(moved)),
        Group(
            "Residual torque of one effect when another is fitted instead, in noise floors",
            (Bullets(tuple(separations)),),
        ),
        *texts(["", *after]),
    ]


def first_motion(document: FirstMotionDocument) -> list[Section]:
    """What is not checked first; then the motion, what it asks of the joints, and what a recording of it would tell."""
    rows = [
        (
            numbered(j.joint, j.name),
            f"{number(j.position[0], 3)} to {number(j.position[1], 3)} {j.position_unit}",
            _of(j.speed, j.speed_limit, f"{j.position_unit}/s", j.speed_stated),
            _of(j.acceleration, j.acceleration_limit, f"{j.position_unit}/s^2", stated=False),
            _of(j.torque_at_most, j.torque_limit, j.force_unit, j.torque_stated),
        )
        for j in document.joints
    ]
    moved = [f"{part.name} ({quantity(part.seconds, 's', 3)})" for part in document.parts]
    written = [f"Written: {path}" for path in (document.out, document.held_out) if path]
    motion = f"Motion: {quantity(document.seconds, 's', 3)}, from {_pose(document)} and back to it"
    return [
        Group("NOT CHECKED", (Bullets(tuple(document.unchecked)),)),
        *texts(["", motion, *cut(document.search)]),
        Bullets(tuple(moved)),
        table(("joint", "range", "speed", "acceleration", "torque of any possible arm"), rows),
        *texts([f"Speed of the tip: {_of(document.tip_speed, document.tip_speed_limit, 'm/s', stated=True)}"]),
        *texts(["* assumed: the model file states no limit"]),
        *assumed_numbers(document.assumed),
        *_at_hand(document),
        Group("A recording of it would tell", (Bullets(tuple(told(document.parameters))),)),
        *texts(written),
    ]


def _at_hand(document: FirstMotionDocument) -> list[Section]:
    """What the recordings at hand tell, and what they leave open."""
    if document.before is None:
        return []
    open_ones = [_name(rival) for rival in document.rivals or []]
    lines = told(document.before) + ([f"Not told apart: {', '.join(open_ones)}"] if open_ones else [])
    return [Group("The recordings at hand tell", (Bullets(tuple(lines)),))]


def motion_notes(document: FirstMotionDocument) -> list[str]:
    """Lines of comment at the top of a motion's file."""
    return [
        *not_checked(document.unchecked),
        f"begins and ends at {_pose(document)}: bring the arm there first, and play it slowly first",
    ]


def not_checked(unchecked: Sequence[str]) -> list[str]:
    """Lines of comment that say what nothing keeps the arm from."""
    return [f"NOT CHECKED: {said}" for said in unchecked]


def _pose(document: FirstMotionDocument) -> str:
    return f"({', '.join(number(x, 3) for x in document.start)})"


def _of(value: float, limit: float, unit: str, stated: bool) -> str:
    return f"{number(value, 3)} of {number(limit, 3)} {unit}" + ("" if stated else " *")


def told(parameters: Sequence[DeterminedParameter]) -> list[str]:
    """Names of the parameters by how well they are determined, a line for each kind."""
    lines = []
    for kind, text in _DETERMINED.items():
        names = [p.name for p in parameters if p.told == kind]
        lines += [f"{text}: {_joined(names)}"] if names else []
    return lines


def _name(place: EffectAt) -> str:
    return str(Term(place.effect, place.joint))


def _joint(j: MovedJoint) -> str:
    low, high, least, most = (number(x, 3) for x in (*j.position, *j.position_limits))
    stated = j.position_stated, j.speed_stated, j.torque_stated
    position, speed, torque = ("" if known else " assumed" for known in stated)
    force, with_rivals = number(j.torque, 3), number(j.torque_with_rivals, 3)
    rivals = f", {with_rivals} with a rival" if with_rivals != force else ""
    return (
        f"joint {numbered(j.joint, j.name)}: {low} to {high} {j.position_unit} (of {least} to {most}{position}), "
        f"up to {number(j.speed, 3)} {j.position_unit}/s (of {number(j.speed_limit, 3)}{speed}) "
        f"and {force} {j.force_unit}{rivals} (of {number(j.torque_limit, 3)}{torque})"
    )


def _trials(motion: str, trials: Sequence[TrialDiagnosis]) -> str:
    if not trials:
        return f"Diagnosed with {motion}: not, the time had ended."
    wrong = dict.fromkeys(str(t.problem) for t in trials if not t.right)
    return f"Diagnosed with {motion}: " + (
        f"{'; '.join(wrong)}." if wrong else f"right in all {len(trials)} recordings."
    )
