"""Sections of a fit: band, offset between clocks, residuals, parameters; what identify, compare and others share."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from math import inf, isfinite
from typing import NamedTuple

from runtime.diagnosis.credibility import contradict, deviation
from runtime.documents.diagnosis import DiagnosisBase, FloorEntry, HistoryEntry
from runtime.documents.fits import (
    CompareDocument,
    FitDocument,
    FitParameters,
    InertialEntry,
    JointEntry,
    JudgedFitDocument,
    RotorEntry,
    StatisticsFitDocument,
    StructureShare,
)
from runtime.documents.parts import BandEntry, DelayEntry, EstimateEntry, SkewEntry, given
from runtime.identification.estimate import Estimate
from runtime.motion.settings import MORE_THAN_NOISE
from runtime.report.sections import Cell, Group, Paragraph, Section, TableColumn, TableSection, table, texts, words
from runtime.wording import (
    AS_GIVEN,
    fixed,
    joints_said,
    milliseconds,
    number,
    numbered,
    percent,
    quantity,
    sentence,
    unit,
)
from symbolic.model_file.checks import at_joint

Names = Mapping[int, str | None]
Fit = FitDocument | FitParameters | JudgedFitDocument
Meanings = Mapping[tuple[str, str], str]
"""What a parameter means, by effect ("" for a base parameter) and name."""

SOURCES = {"repeats": "repeated motion", "spectrum": "the spectra of torque and encoder"}
_LEAST_STRUCTURE = 0.005
"""Share of the residual's power below which a signal is not listed."""


def names_of(joints: Iterable[JointEntry]) -> Names:
    """Names of the joints by number; None for a joint without one."""
    return {j.joint: given(j.name) for j in joints}


def at_named(joint: int | None, names: Names) -> str:
    """Where an effect acts, to follow its name: ` at joint 1 (elbow)`."""
    name = None if joint is None else names.get(joint)
    return at_joint(joint) if name is None else f"{at_joint(joint)} ({name})"


def place(joint: int | None, names: Names) -> str:
    """A joint in a column of joints."""
    return "arm" if joint is None else numbered(joint, names.get(joint))


# --- verbs ---


def identification(document: JudgedFitDocument) -> list[Section]:
    """Parameters with their 95 % intervals, the residuals, and whether the fit is credible."""
    names = names_of(document.joints)
    made: list[Section] = [*basis(document.band, document.skew), *delays(document.delay)]
    made.append(parameters(document, None, names))
    if document.uncorrected:
        made += [Paragraph("Without skew correction:"), parameters(document.uncorrected, None, names)]
    made += [residuals(document.joints), *texts(drives(document.joints)), *texts(document.warnings, "warning")]
    if document.verdict == "refused":
        made.append(Group("", (Paragraph(f"REFUSED: {document.reason}"),)))
    return made


def identification_of_sums(document: StatisticsFitDocument) -> list[Section]:
    """Parameters with their 95 % intervals, and what the board's rows leave of each joint's torque."""
    left = [
        (str(joint), number(rms), str(rows))
        for joint, (rms, rows) in enumerate(zip(document.rms, document.rows, strict=True), 1)
    ]
    return [
        Paragraph("By what the board added up: the noise of its encoders is not compensated, nor a skew or delay."),
        parameters(document, None, dict.fromkeys(range(1, len(document.rows) + 1))),
        table(("joint", "residual rms [N m or N]", "rows added up"), left),
    ]


def comparison(document: CompareDocument) -> list[Section]:
    """Where the model fails: the size of the residual, and the signals that it follows."""
    follows = (structure(joint, joint.structure) for joint in document.joints)
    return [
        residuals(document.joints),
        *texts(drives(document.joints)),
        *texts(line for line in follows if line),
        *texts(document.warnings, "warning"),
    ]


def judged_in_short(document: JudgedFitDocument) -> list[str]:
    """The fitted base parameters in a line."""
    refused = [verdict_line(document)] if document.verdict == "refused" else []
    fitted = ", ".join(f"{p.name} {quantity(p.fit, p.unit)}" for p in document.inertial if p.fit is not None)
    return [*refused, f"fitted: {fitted}"]


def joint_in_short(joint: JointEntry) -> str:
    """How far a joint's torque is missed."""
    floors = number(joint.rms / joint.floor, 2) if joint.floor else "–"
    return f"joint {joint.joint}: misses {percent(joint.relative)} of the torque, {floors} times the noise floor"


def verdict_line(document: JudgedFitDocument | DiagnosisBase) -> str:
    """The verdict and its reason."""
    return f"{document.verdict.upper()}: {sentence(document.reason)}"


# --- what they share ---


def basis(band: BandEntry, offset: SkewEntry) -> list[Section]:
    """The frequency band, and the offset between the clocks of torque and motion."""
    first = f"Band up to {quantity(band.cutoff_hz, 'Hz')}: {band.reason}."
    origin = "estimated" if offset.estimated else "given" if given(offset.given) else "assumed"
    low, high = offset.interval or (None, None)
    within = "" if low is None or high is None else f", 95 % in [{number(low)}, {number(high)}]"
    skew = f"{number(offset.value)} {offset.unit} ({origin}){within}"
    return texts([first, f"Skew between torque and motion: {skew}."])


def delays(entries: Sequence[DelayEntry]) -> list[Section]:
    """Delay from torque to motion, or from command to torque, and how much of it is assumed; joints that agree share a
    line."""
    alike: dict[tuple[str, str], list[int]] = {}
    for d in entries:
        parts = [f"{milliseconds(d.assumed)} ms assumed, from a hold"] if d.assumed else []
        parts += [f"{milliseconds(d.estimated)} ms estimated"] if d.estimated else []
        low, high = d.interval or (None, None)
        known = low is not None and high is not None and isfinite(low) and isfinite(high)
        within = f", 95 % in [{milliseconds(low)}, {milliseconds(high)}]" if known else ""
        hold = given(d.hold)
        parts += [f"a command is held for {milliseconds(hold)} ms"] if hold else []
        way = "command to torque" if hold else "torque to motion"
        said = f"{milliseconds(d.value)} ms{within} ({'; '.join(parts)})"
        alike.setdefault((way, said), []).append(d.joint)
    return texts(
        f"Delay from {way}, {'every joint' if 1 < len(joints) == len(entries) else joints_said(joints)}: {said}."
        for (way, said), joints in alike.items()
    )


def residuals(joints: Sequence[JointEntry]) -> TableSection:
    """Residual of each joint beside its noise floor."""
    heads, said = _in_units(("residual rms", "noise floor"), joints)
    rows = []
    for j in joints:
        repeats = {True: "yes", False: "no", None: "unknown"}[j.repeatable]
        repeats = "noise" if j.repeatable and j.rms <= MORE_THAN_NOISE * j.floor else repeats
        rows.append(
            (
                numbered(j.joint, given(j.name)),
                said(j.rms or None, j),
                percent(j.relative) if j.rms else "–",
                said(j.floor, j),
                j.floor_source,
                repeats if j.rms else "never moves",
            )
        )
    return table(("joint", heads[0], "of the torque", heads[1], "floor from", "repeatable"), rows)


def _in_units(
    heads: Sequence[str], joints: Sequence[JointEntry]
) -> tuple[list[str], Callable[[float | None, JointEntry], str]]:
    """Headings of columns of torques, and how a value of a joint is written: the unit stands in the heading where it
    is that of all joints, else behind each value."""
    units = {j.unit for j in joints}
    if len(units) == 1:
        return [f"{head} [{unit(*units)}]" for head in heads], lambda value, _: number(value)
    return list(heads), lambda value, joint: "–" if value is None else quantity(value, joint.unit)


def drives(joints: Sequence[JointEntry]) -> Iterator[str]:
    """The residual of every joint whose torque a drive's law makes, in the unit of its command, and its gains."""
    for joint in joints:
        if drive := given(joint.drive):
            gains = "".join(f"; {name} {_gain(gain)}" for name, gain in drive.gains.items())
            where = numbered(joint.joint, given(joint.name))
            yield f"Joint {where}: {quantity(drive.rms, drive.unit)} of the command of its {drive.law} drive{gains}."


def _gain(gain: EstimateEntry) -> str:
    ends = " (no scale)" if gain.interval is None else f" ({number(gain.interval[0])} to {number(gain.interval[1])})"
    return f"{number(gain.value)} {unit(gain.unit)}{ends}"


def structure(joint: JointEntry, shares: Sequence[StructureShare]) -> str:
    """The signals that a joint's residual follows; empty if there are none."""
    follows = [f"{s.signal} {percent(s.share, 1)}" for s in shares if s.share > _LEAST_STRUCTURE]
    where = numbered(joint.joint, given(joint.name))
    text = f"Joint {where}: share of the residual's power that each signal explains: {', '.join(follows)}."
    return text if follows else ""


def errors_of_joint(
    history: Sequence[HistoryEntry], joint: JointEntry, written: tuple[float, float] | None
) -> TableSection:
    """Error of one joint after each step, fitted and held out.

    written   rms and relative error with the values of the model file, if it states all
    """
    i, held = joint.joint - 1, any(step.held_out for step in history)
    heads, _ = _in_units(("rms", "held-out rms"), [joint])
    rows = [] if written is None else [["the file's own values", percent(written[1]), number(written[0])]]
    for step in history:
        row = [step_name(step), percent(step.relative[i]), number(step.rms[i])]
        if step.held_out is not None and step.held_out_relative is not None:
            row += [percent_or_dash(step.held_out_relative[i]), number(step.held_out[i])]
        rows.append(row)
    columns = ("model", "error", heads[0], *(("held-out error", heads[1]) if held else ()))
    return table(columns, [row + ["–"] * (len(columns) - len(row)) for row in rows])


def percent_or_dash(value: float | None) -> str:
    """A part in per cent; a dash where it is unknown."""
    return "–" if value is None else percent(value)


def errors_by_joint(
    history: Sequence[HistoryEntry], joints: Sequence[JointEntry], held_out_floors: Sequence[JointEntry | FloorEntry]
) -> list[Section]:
    """Error of every joint, a column a step; what was held out in a table of its own."""
    names = names_of(joints)
    floors: Sequence[JointEntry | FloorEntry] = joints
    fitted = [(step_name(s), s.relative, s.rms) for s in history]
    held = [(step_name(s), s.held_out_relative, s.held_out) for s in history if s.held_out_relative and s.held_out]
    made: list[Section] = []
    for what, steps, least in (("error, rms", fitted, floors), ("held out, rms", held, held_out_floors)):
        if not least or not steps:
            continue
        (title,), said = _in_units((what,), joints)
        rows = [
            (
                place(j.joint, names),
                *(f"{percent_or_dash(relative[k])}, {said(rms[k], j)}" for _, relative, rms in steps),
                f"{said(floor.floor, j)} ({floor.floor_source})",
            )
            for k, (j, floor) in enumerate(zip(joints, least, strict=True))
        ]
        made.append(table((title, *(name for name, *_ in steps), "noise floor"), rows))
    return made


def step_name(step: HistoryEntry) -> str:
    """What a step did to the model."""
    return f"+ {step.added}" if step.added else AS_GIVEN


# --- parameters ---


class _Fitted(NamedTuple):
    """A parameter with its value in the model file, fitted before and after."""

    joint: int | None
    label: str
    stated: float | None
    before: Estimate | None
    after: Estimate | None
    meaning: str

    def cells(self, names: Names, both: bool) -> list[str | Cell]:
        some = self.after or self.before
        assert some is not None
        values = [self.before, self.after] if both else [self.after]
        known = "–" if self.stated is None else number(self.stated)
        return [
            place(self.joint, names),
            self.label,
            Cell(known, flag="contradicts" if self.contradicts else ""),
            *(estimate(e) or "–" for e in values),
            unit(some.unit) or "1",
        ]

    @property
    def difference(self) -> str:
        """How far the fit is from the value of the model file, relative to it."""
        if not self.stated or self.after is None or not isfinite(self.after.value):
            return "–"
        off = 100 * (self.after.value - self.stated) / abs(self.stated)
        return f"{'+' if off > 0 else ''}{fixed(off, 1)} %".replace("-", "−")

    @property
    def contradicts(self) -> bool:
        """Whether the value of the model file and the fit cannot both be right."""
        e = self.after
        return self.stated is not None and e is not None and contradict(self.stated, e.value, deviation(e))


def parameters(after: Fit, before: Fit | None, names: Names) -> TableSection:
    """All parameters in one table, with the joint in the first column."""
    return _parameter_table(_pairs(after, before, {}), names, before is not None)


def parameters_by_joint(
    after: Fit, before: Fit | None, names: Names, meanings: Meanings, quiet: Iterable[int]
) -> list[Section]:
    """A table a joint, then one of the whole arm, with the difference from the file and the meaning of each parameter.

    quiet   joints whose tables are folded away
    """
    rows = _pairs(after, before, meanings)
    places = sorted({row.joint for row in rows}, key=lambda joint: joint or inf)
    made: list[Section] = []
    for joint in places:
        own = [row for row in rows if row.joint == joint]
        wrong = sum(row.contradicts for row in own)
        aside = f"{wrong} contradict{'s' if wrong == 1 else ''} the model file" if wrong else ""
        title = "Whole arm" if joint is None else f"Joint {place(joint, names)}"
        plain = _parameter_table(own, names, before is not None)
        # The heading names the joint.
        cells = [(*cells[1:], row.difference, row.meaning) for cells, row in zip(plain.rows, own, strict=True)]
        shown = _without_empty(table((*plain.columns[1:], "fit − file", words("meaning")), cells))
        closed = joint is None or joint in quiet
        made.append(shown if len(places) == 1 else Group(title, (shown,), folded=closed, aside=aside))
    return made


def _without_empty(shown: TableSection) -> TableSection:
    """The table without columns in which no row has a value."""
    kept = [k for k in range(len(shown.columns)) if any(row[k] not in ("–", Cell("–")) for row in shown.rows)]
    return table((shown.columns[k] for k in kept), ([row[k] for k in kept] for row in shown.rows), shown.caption)


def inertial_parameters(document: DiagnosisBase, names: Names) -> TableSection:
    """Base inertial parameters and rotors of a diagnosis."""
    fit = FitParameters(inertial=document.parameters, rotors=document.rotors, effects=[])
    return parameters(fit, None, names)


def _pairs(after: Fit, before: Fit | None, meanings: Meanings) -> list[_Fitted]:
    """Every parameter of either fit, base parameters first."""
    old = {} if before is None else {key: entry for key, (entry, _) in _entries(before).items()}
    new = _entries(after)
    made = []
    for key in [*new, *(key for key in old if key not in new)]:
        joint, effect, name = key
        entry, stated = new.get(key, (None, None))
        label = f"{effect}: {name}" if effect else name
        made.append(
            _Fitted(joint, label, stated, before=old.get(key), after=entry, meaning=meanings.get((effect, name), ""))
        )
    return made


def _entries(fit: Fit) -> dict[tuple[int | None, str, str], tuple[Estimate, float | None]]:
    """Estimates with the values of the model file, by joint, effect and name."""
    found: dict[tuple[int | None, str, str], tuple[Estimate, float | None]] = {}
    for p in fit.inertial:
        found[p.joint, "", p.name] = estimated(p), p.model
    for r in fit.rotors:
        found[r.joint, "", f"{r.name}, further"] = estimated(r), None
    for e in fit.effects:
        for name, v in e.parameters.items():
            found[e.joint, e.name, name] = estimated(v), v.model
    return found


def estimated(entry: InertialEntry | RotorEntry | EstimateEntry) -> Estimate:
    """An entry of a document as an estimate."""
    value = entry.value if isinstance(entry, EstimateEntry) else entry.fit
    return Estimate(
        float("nan") if value is None else value, entry.interval, entry.unit, tuple(given(entry.inseparable_from) or ())
    )


def _parameter_table(rows: Sequence[_Fitted], names: Names, both: bool) -> TableSection:
    fitted = ("before", "after") if both else ("fit",)
    estimates = [TableColumn(name, "estimate") for name in fitted]
    heads = [words("joint"), words("parameter"), TableColumn("file"), *estimates, TableColumn("unit")]
    return table(heads, (row.cells(names, both) for row in rows))


def recordings_alone(document: DiagnosisBase | JudgedFitDocument) -> list[Section]:
    """Base parameters of each recording alone, and the parameters on which recordings disagree."""
    if not document.recordings:
        return []
    names = [r.recording for r in document.recordings]
    apart = {p.name: p for p in document.inconsistent}
    rows: list[list[str | Cell]] = []
    for entries in zip(*(r.parameters for r in document.recordings), strict=True):
        p = entries[0]
        name = Cell(p.name, flag="differs" if p.name in apart else "")
        rows.append([name, *(estimate(estimated(e)) for e in entries), unit(p.unit) or "1"])
        apart.pop(p.name, None)
    for c in apart.values():
        known = {
            name: estimate(Estimate(value, interval, c.unit))
            for name, value, interval in zip(c.recordings, c.values, c.intervals, strict=True)
        }
        rows.append([Cell(c.name, flag="differs"), *(known.get(name, "–") for name in names), unit(c.unit) or "1"])
    disagree = ", ".join(p.name for p in document.inconsistent)
    said = f"They disagree on {disagree}." if disagree else "They agree."
    believed = disagree or document.verdict != "refused"
    return [table(("each recording alone", *names, "unit"), rows), *texts([said] if believed else [])]


def estimate(e: Estimate | None) -> str:
    """Value ± half of its 95 % interval, to the digits that the interval supports."""
    if e is None:
        return ""
    if e.interval is None:
        together = f" (only together with {', '.join(e.with_others)})" if e.with_others else ""
        return number(e.value) + together
    half = (e.interval[1] - e.interval[0]) / 2
    if half <= 0 or not isfinite(half):
        return number(e.value)
    places = 1 - math.floor(math.log10(half))
    if not -6 <= places <= 9:
        return f"{number(e.value)} ± {number(half, 2)}"
    shown = max(0, places)
    return f"{round(e.value, places):.{shown}f} ± {round(half, places):.{shown}f}".replace("-", "−")
