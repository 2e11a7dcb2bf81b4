"""Sections of diagnose and improve on the terminal, and any result of the loop in a few lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from runtime.documents.diagnosis import (
    DiagnosisBase,
    DiagnosisDocument,
    FindingEntry,
    HistoryEntry,
    ImprovementDocument,
)
from runtime.documents.fits import CompareDocument, JudgedFitDocument
from runtime.documents.parts import given
from runtime.report import findings, fits, replays
from runtime.report.findings import Context
from runtime.report.fits import place
from runtime.report.sections import Commands, Group, Paragraph, Section, texts
from runtime.wording import milliseconds, number, percent, quantity
from symbolic.model_file.checks import at_joint

LoopDocument = CompareDocument | DiagnosisDocument | ImprovementDocument
Judged = DiagnosisDocument | ImprovementDocument

_FALLEN = 0.98
"""ratio; an error that falls by less is not said to fall: two digits would hardly show it."""

_MOST_LINES = 6
"""Joints and findings of a result in a few lines."""


def sections(document: LoopDocument) -> list[Section]:
    """A result of compare, diagnose or improve, as the terminal prints it."""
    if isinstance(document, CompareDocument):
        return fits.comparison(document)
    return diagnosis(document) if isinstance(document, DiagnosisDocument) else improvement(document)


def diagnosis(document: DiagnosisDocument) -> list[Section]:
    """The verdict in one sentence, its evidence, and what to type next."""
    around = context(document, document.findings)
    follows = (fits.structure(joint, given(joint.structure) or []) for joint in document.joints)
    made: list[Section] = [
        *texts([f"{document.verdict.upper()}: {document.reason}", ""]),
        fits.residuals(document.joints),
        *texts(fits.drives(document.joints)),
        *texts(line for line in follows if line),
    ]
    if document.draft is not None:
        made += findings.draft(document.draft, around.names)
    elif reason := given(document.draft_reason):
        made.append(Paragraph(reason))
    for finding in document.findings:
        made += findings.brief(finding, around)
    if document.verdict != "effect":
        made += findings.closest(document, around)
    return [
        *made,
        *texts([*peaks(document), *sensors(document)]),
        *fits.delays(document.delay),
        Paragraph("Base inertial parameters:"),
        fits.inertial_parameters(document, around.names),
        *fits.recordings_alone(document),
        *findings.limits_table(document),
        *texts(document.warnings, "warning"),
        *follow_up(document),
    ]


def improvement(document: ImprovementDocument) -> list[Section]:
    """The verdict in one sentence, the error after every step, fitted and held out, and what was added."""
    added = [finding for step in document.history if (finding := given(step.finding)) is not None]
    around = context(document, added)
    made = [
        *texts([f"{document.verdict.upper()}: {document.reason}", ""]),
        *errors(document),
        *replays.errors(given(document.replay) or []),
    ]
    for finding in added:
        made += findings.brief(finding, around)
    before, after = document.identification.before, document.identification.after
    return [
        *made,
        *texts(sensors(document)),
        *fits.delays(document.delay),
        fits.parameters(after, before, around.names),
        *texts(fits.drives(document.joints)),
        *texts([*balance(document), ""]),
        *findings.closest(document, around),
        *texts(peaks(document)),
        *findings.limits_table(document),
        *texts(document.warnings, "warning"),
        *follow_up(document),
    ]


def balance(document: ImprovementDocument) -> list[str]:
    """By how much the error fell at which joints, and how large what nothing explains is there."""
    first, last, names = document.history[0], document.history[-1], fits.names_of(document.joints)
    gained = []
    for k, joint in enumerate(document.joints):
        if last.relative[k] < _FALLEN * first.relative[k]:
            text = f"joint {place(joint.joint, names)} {percent(first.relative[k])} → {percent(last.relative[k])}"
            if (before := first.held_out_relative) and (after := last.held_out_relative):
                text += f" (held out {fits.percent_or_dash(before[k])} → {fits.percent_or_dash(after[k])})"
            gained.append(text)
    left = [
        f"joint {place(joint.joint, names)} {percent(joint.relative)} of its torque, "
        f"{quantity(joint.rms, joint.unit, 2)}, {number(joint.rms / joint.floor, 2)} times its noise floor"
        for joint in document.joints
        if joint.verdict == "unexplained" and joint.floor
    ]
    return [
        *([f"Gained, error of the torque: {'; '.join(gained)}."] if gained else []),
        *([f"Unexplained: {'; '.join(left)}."] if left else []),
    ]


def errors(document: ImprovementDocument) -> list[Section]:
    """Error after each step; of a single joint a row a step, of several a row a joint."""
    held = given(document.held_out_floors) or []
    if len(document.joints) > 1:
        return fits.errors_by_joint(document.history, document.joints, held)
    (joint,) = document.joints
    lines = [f"Noise floor (rms): joint 1 {quantity(joint.floor, joint.unit)} ({joint.floor_source})."]
    lines += [f"  held out: joint 1 {quantity(f.floor, joint.unit)} ({f.floor_source})." for f in held]
    return [fits.errors_of_joint(document.history, joint, None), *texts([*lines, ""])]


def context(document: DiagnosisBase, named: Sequence[FindingEntry]) -> Context:
    """The joints that findings and candidates refer to; named: all findings."""
    return Context({j.joint: j for j in document.joints}, {findings.key(f) for f in named})


def peaks(document: Judged) -> list[str]:
    """Peaks in the spectrum of a residual that counts as noise."""
    if not document.peaks or not findings.only_noise(document):
        return []
    names = fits.names_of(document.joints)
    found = [
        f"joint {place(peak.joint, names)} at {', '.join(f'{f:.2f} Hz' for f in peak.frequencies_hz)}"
        for peak in document.peaks
    ]
    return [f"Peaks in the spectrum of the residual, with little of its power: {'; '.join(found)}."]


def sensors(document: LoopDocument) -> list[str]:
    """Offset between motor and link-side encoders, and what further sensors contributed."""
    if isinstance(document, CompareDocument):
        return []
    lines = []
    for e in document.encoder_skew:
        low, high = map(milliseconds, e.interval or (0.0, 0.0))
        within = f", 95 % in [{low}, {high}] ms" if e.interval else ""
        later = f"the link-side encoder is read {milliseconds(e.value)} ms later than the motor's"
        lines.append(f"Joint {e.joint}: {later}{within}.")
    return [*lines, *(f"Contribution of the sensors: {sensor.said}." for sensor in document.sensors)]


def follow_up(document: Judged) -> list[Section]:
    """Where the improved model is, and the commands to type next."""
    made: list[Section] = []
    if document.improved_model:
        made.append(Group("", (Paragraph(f"The improved model is in {document.improved_model}."),)))
    if document.commands:
        made.append(Group("Next", (Commands(tuple(document.commands)),)))
    return made


def in_short(document: LoopDocument | JudgedFitDocument | Any) -> list[str]:
    """At most a dozen lines: the verdict if there is one, the steps of a loop, and where each joint stands."""
    if isinstance(document, JudgedFitDocument):
        return fits.judged_in_short(document)
    if isinstance(document, ImprovementDocument):
        return [fits.verdict_line(document), *map(_step, document.history)]
    joints = [fits.joint_in_short(joint) for joint in document.joints[:_MOST_LINES]]
    if isinstance(document, CompareDocument):
        return joints
    return [fits.verdict_line(document), *joints, *map(_finding, document.findings[:_MOST_LINES])]


def _step(step: HistoryEntry) -> str:
    fitted = ", ".join(map(fits.percent_or_dash, step.relative))
    held = ", ".join(map(fits.percent_or_dash, step.held_out_relative or ()))
    return f"{fits.step_name(step)}: {fitted} of the torque" + (f", held out {held}" if held else "")


def _finding(finding: FindingEntry) -> str:
    values = ", ".join(
        f"{name} {quantity(p.value, p.unit)}" for name, p in finding.parameters.items() if p.value is not None
    )
    rivals = ", ".join(f"{r.effect}{at_joint(r.joint)}" for r in finding.rivals)
    text = f"{finding.effect}{at_joint(finding.joint)}: {values}"
    return text + (f"; inseparable from {rivals}" if rivals else "")
