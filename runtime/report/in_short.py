"""A result in a few lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from runtime.documents.diagnosis import (
    DiagnosisBase,
    DiagnosisDocument,
    FindingEntry,
    HistoryEntry,
    ImprovementDocument,
)
from runtime.documents.fits import CompareDocument, JointEntry, JudgedFitDocument
from runtime.wording import number, percent, quantity, sentence
from symbolic.model_file.checks import at_joint

_MOST = 6
"""Joints and findings."""


def lines(document: JudgedFitDocument | CompareDocument | DiagnosisDocument | ImprovementDocument | Any) -> list[str]:
    """At most a dozen lines: the verdict if there is one, the steps of a loop, and where each joint stands."""
    if isinstance(document, JudgedFitDocument):
        refused = [_verdict(document)] if document.verdict == "refused" else []
        fitted = ", ".join(f"{p.name} {quantity(p.fit, p.unit)}" for p in document.inertial if p.fit is not None)
        return [*refused, f"fitted: {fitted}"]
    if isinstance(document, ImprovementDocument):
        return [*map(_step, document.history), f"What is left: {_verdict(document)}"]
    if isinstance(document, DiagnosisDocument):
        joints, findings = document.joints[:_MOST], document.findings[:_MOST]
        return [_verdict(document), *map(_joint, joints), *map(_finding, findings)]
    if isinstance(document, CompareDocument):
        return [_joint(joint) for joint in document.joints[:_MOST]]
    return [_plan(document), *(_spring(spring) for spring in document["springs"])]


def _verdict(document: JudgedFitDocument | DiagnosisBase) -> str:
    return f"{document.verdict.upper()}: {sentence(document.reason)}"


def _plan(document: Mapping[str, Any]) -> str:
    objective = document["objective"]
    return (
        f"{document['scenario']} in {document['cycle_time']:g} s: {objective['goal']} "
        f"{quantity(objective['value'], objective['unit'])}"
    )


def _spring(spring: Mapping[str, Any]) -> str:
    return f"spring at joint {spring['joint']}: {spring['text']}"


def _step(step: HistoryEntry) -> str:
    def errors(values: Sequence[float | None]) -> str:
        return ", ".join("–" if v is None else percent(v) for v in values)

    name = "as in the file, fitted" if step.added is None else f"+ {step.added}"
    held = step.held_out_relative
    return f"{name}: {errors(step.relative)} of the torque" + (f", held out {errors(held)}" if held else "")


def _joint(joint: JointEntry) -> str:
    floors = number(joint.rms / joint.floor, 2) if joint.floor else "–"
    return f"joint {joint.joint}: misses {percent(joint.relative)} of the torque, {floors} times the noise floor"


def _finding(finding: FindingEntry) -> str:
    values = ", ".join(
        f"{name} {quantity(p.value, p.unit)}" for name, p in finding.parameters.items() if p.value is not None
    )
    rivals = ", ".join(f"{r.effect}{at_joint(r.joint)}" for r in finding.rivals)
    text = f"{finding.effect}{at_joint(finding.joint)}: {values}"
    return text + (f"; inseparable from {rivals}" if rivals else "")
