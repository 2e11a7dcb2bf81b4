"""A result in a few lines, from the dictionary that --json writes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from runtime.wording import number, percent, quantity, sentence
from symbolic.model_file.checks import at_joint

Document = Mapping[str, Any]
_MOST = 6


def lines(document: Document) -> list[str]:
    """At most a dozen lines: the verdict if there is one, the steps of a loop, and where each joint stands."""
    if "objective" in document:
        return [_plan(document), *(_spring(spring) for spring in document["springs"])]
    if "inertial" in document:
        refused = [_verdict(document)] if document["verdict"] == "refused" else []
        return [*refused, _parameters(document)]
    if "history" in document:
        return [*map(_step, document["history"]), f"What is left: {_verdict(document)}"]
    verdict = [_verdict(document)] if "verdict" in document else []
    joints = [_joint(joint) for joint in document["joints"][:_MOST]]
    return verdict + joints + [_finding(finding) for finding in document.get("findings", [])[:_MOST]]


def _verdict(document: Document) -> str:
    return f"{document['verdict'].upper()}: {sentence(document['reason'])}"


def _plan(document: Document) -> str:
    objective = document["objective"]
    return (
        f"{document['scenario']} in {document['cycle_time']:g} s: {objective['goal']} "
        f"{quantity(objective['value'], objective['unit'])}"
    )


def _spring(spring: Document) -> str:
    return f"spring at joint {spring['joint']}: {spring['text']}"


def _step(step: Document) -> str:
    def errors(values: Any) -> str:
        return ", ".join(percent(v) for v in values)

    name = "as in the file, fitted" if step["added"] is None else f"+ {step['added']}"
    held = step.get("held_out_relative")
    return f"{name}: {errors(step['relative'])} of the torque" + (f", held out {errors(held)}" if held else "")


def _joint(joint: Document) -> str:
    floors = number(joint["rms"] / joint["floor"], 2) if joint["floor"] else "–"
    return f"joint {joint['joint']}: misses {percent(joint['relative'])} of the torque, {floors} times the noise floor"


def _finding(finding: Document) -> str:
    values = ", ".join(
        f"{name} {quantity(p['value'], p['unit'])}"
        for name, p in finding["parameters"].items()
        if p["value"] is not None
    )
    rivals = ", ".join(f"{r['effect']}{at_joint(r['joint'])}" for r in finding["rivals"])
    text = f"{finding['effect']}{at_joint(finding['joint'])}: {values}"
    return text + (f"; not told from {rivals}" if rivals else "")


def _parameters(document: Document) -> str:
    inertial = [f"{p['name']} {quantity(p['fit'], p['unit'])}" for p in document["inertial"] if p["fit"] is not None]
    return "fitted: " + ", ".join(inertial)
