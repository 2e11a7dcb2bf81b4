"""What inspect, simulate and experiment print on the terminal."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from runtime.documents.parts import EffectAt
from runtime.documents.recordings import (
    ClockEntry,
    ExperimentDocument,
    InspectDocument,
    MovedJoint,
    SeparationEntry,
    SimulateDocument,
    TrialDiagnosis,
)
from runtime.model.terms import Term
from runtime.report.terminal.cells import delay_lines, empty_table, figure, say, show_table
from runtime.wording import joints_said, number, numbered, quantity, sentence
from symbolic.model_file.checks import at_joint, quote

_MOST_FIELDS = 24
_DETERMINED = {
    "well": "Well determined",
    "hardly": "Poorly determined",
    "together": "Determined only in combination",
    "no": "Not determined",
}


def inspection(document: InspectDocument) -> None:
    """A file's contents, its clock and signals, how well it determines the model, and what looks wrong."""
    fields = len(document.fields)
    say(f"{document.file}: {document.format}, {fields} field{'s' if fields != 1 else ''}", *document.notes)
    if document.clock is None:
        families = Counter(re.sub(r"_?\d+$", "", f.name) for f in document.fields)
        names = [quote(name) + (f" ({many})" if many > 1 else "") for name, many in families.items()]
        more = f" and {len(names) - _MOST_FIELDS} more" if len(names) > _MOST_FIELDS else ""
        say(f"Fields: {', '.join(names[:_MOST_FIELDS])}{more}")
    else:
        _recorded(document, document.clock)
        if not document.suspicions:  # a fit to wrong data determines nothing
            _fit(document)
    _wrong(document)


def _recorded(document: InspectDocument, clock: ClockEntry) -> None:
    gaps = f"{clock.gaps} gap{'s' if clock.gaps != 1 else ''}"
    runs = f", {clock.runs} runs" if clock.runs > 1 else ""
    steps = "even steps"
    if clock.jitter:
        steps = f"jitter {quantity(clock.jitter, 's', 2)}, longest step {quantity(clock.longest_step, 's', 3)}"
    rate = f"{quantity(clock.seconds, 's')} at {quantity(clock.rate_hz, 'Hz')}"
    say(f"{clock.samples} samples, {rate}; {steps}, {gaps}{runs}")
    table = empty_table("signal", "field", "unit", "least", "largest", "resolution", "noise")
    for s in document.signals:
        numbers = map(figure, (s.least, s.largest, s.resolution, s.noise))
        table.add_row(s.signal, "" if s.field == s.signal else s.field, s.unit, *numbers)
    show_table(table)
    for j in document.joints:
        text = "is held"
        if j.moves:
            far, fast = quantity(j.range, j.unit), quantity(j.top_speed, f"{j.unit}/s")
            text = f"moves over {far}, up to {fast}" + ("" if j.powered else "; its torque never changes")
        say(f"Joint {numbered(j.joint, j.name)}: {text}")
    for shift in document.shifts:
        how = "later" if shift.value > 0 else "earlier"
        say(f"{shift.signal} is {quantity(abs(shift.value), 's', 3)} {how} than its position")
    if document.repeats:
        seconds = document.repeats.seconds
        say(f"Repeated motion: {quantity(seconds, 's', 3)}" if seconds else "No motion is repeated")
    if any(delay.estimated for delay in document.delay):
        delay_lines(document.delay)


def _fit(document: InspectDocument) -> None:
    for kind, text in _DETERMINED.items():
        names = [p.name for p in document.parameters if p.told == kind]
        if names:
            say(f"{text}: {_joined(names)}")
    if document.misses:
        errors = [f"{100 * m.part:.3g} % at joint {m.joint}" for m in document.misses]
        say(f"Part of the torque that the model's best fit misses: {', '.join(errors)}")
    if document.inertias:
        found = [f"{quantity(j.value, j.unit, 3)} at joint {j.joint}" for j in document.inertias]
        doubt = "if that is implausible, the torques are in another unit, or those of the motor before the gear"
        say(f"Fitted inertia, which the model file leaves open: {', '.join(found)}; {doubt}")


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
    effects = [text + (f" at {joints_said(joints)}" if joints else "") for text, joints in alike.items()]
    return "; ".join([", ".join(lumps), *effects] if lumps else effects)


def _wrong(document: InspectDocument) -> None:
    if document.problem:
        say(f"Not usable as it is: {document.problem}")
    if document.suggested:
        say(f"Perhaps: {' '.join(document.suggested)}")
    if document.unfitted:
        say(f"No fit: {document.unfitted}")
    for s in document.suspicions:
        say(f"Joint {s.joint}: {s.found}; {s.cure}")
    if len(document.suspicions) > 1 and document.cures:
        say(f"All at once: {' '.join(document.cures)}")
    if document.unreliable:
        say(f"The fit is not to be believed: {document.unreliable}")
    if not (document.problem or document.suspicions or document.unfitted or document.unreliable):
        say("Nothing looks wrong." if document.parameters else "Nothing looks wrong; with MODEL more can be checked.")


def simulation(document: SimulateDocument) -> None:
    """What is in a simulated recording."""
    say(f"{document.out}: {document.samples} samples, {figure(document.seconds)} s")
    assumed: dict[str, list[int]] = {}
    for entry in document.effects:
        if entry.hidden:
            values = ", ".join(f"{name} {figure(value)}" for name, value in entry.values.items())
            say(f"hidden: {entry.effect}{at_joint(entry.joint)}: {values}")
        if entry.assumed:
            assumed.setdefault(entry.effect, []).extend([entry.joint] if entry.joint else [])
    if assumed:
        places = "; ".join(name + (f" at {joints_said(joints)}" if joints else "") for name, joints in assumed.items())
        say(f"open in the model file, simulated with moderate values (see --json): {places}")


def experiment(document: ExperimentDocument) -> None:
    """The verdict, the motion and what it asks of the joints, what it separates, and what the diagnosis made of it."""
    say(("SEPARATED: " if document.separated else "NOT SEPARATED: ") + sentence(document.reason), "")
    for rival in document.rivals:
        values = ", ".join(f"{name} {number(value)}" for name, value in rival.values.items())
        say(f"{_name(rival)} was simulated with {values}")
    motion = document.motion
    say(f"Motion: {number(motion.seconds, 3)} s, {motion.times} times through")
    say(*(f"  {piece}" for piece in motion.pieces), *map(_joint, motion.joints))
    if not all(j.position_stated and j.speed_stated and j.torque_stated for j in motion.joints):
        say("  assumed: limits that the model file does not state; the torque's is what the ordinary excitation needs")
    say("", "Residual torque of one effect when another is fitted instead, in noise floors:")
    say(*map(_separation, document.separations), "")
    _trials("this motion", document.trials)
    _trials("the ordinary excitation", document.ordinary_trials)
    for change in document.relief:
        enough = "enough" if change.enough else "not enough"
        say(f"With {change.change}: {number(change.sigmas, 3)} standard deviations apart, {enough}.")
    if document.out:
        say(f"Written: {document.out}")


def _name(place: EffectAt) -> str:
    return str(Term(place.effect, place.joint))


def _joint(j: MovedJoint) -> str:
    low, high, least, most = (number(x, 3) for x in (*j.position, *j.position_limits))
    stated = j.position_stated, j.speed_stated, j.torque_stated
    position, speed, torque = ("" if known else " assumed" for known in stated)
    force, with_rivals = number(j.torque, 3), number(j.torque_with_rivals, 3)
    rivals = f", {with_rivals} with a rival" if with_rivals != force else ""
    return (
        f"  joint {numbered(j.joint, j.name)}: {low} to {high} {j.position_unit} (of {least} to {most}{position}), "
        f"up to {number(j.speed, 3)} {j.position_unit}/s (of {number(j.speed_limit, 3)}{speed}) "
        f"and {force} {j.force_unit}{rivals} (of {number(j.torque_limit, 3)}{torque})"
    )


def _separation(s: SeparationEntry) -> str:
    other = "the model as it is" if s.explained_by is None else _name(s.explained_by)
    return f"  {_name(s.hidden)} by {other}: {number(s.after, 3)}, with the ordinary excitation {number(s.before, 3)}"


def _trials(motion: str, trials: Sequence[TrialDiagnosis]) -> None:
    wrong = dict.fromkeys(str(t.problem) for t in trials if not t.right)
    say(f"Diagnosed with {motion}: " + (f"{'; '.join(wrong)}." if wrong else f"right in all {len(trials)} recordings."))
