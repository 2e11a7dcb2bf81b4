"""A plan for people: what it costs, which springs it takes, what it asks of the joints."""

from __future__ import annotations

from collections.abc import Mapping

from runtime.report.terminal.cells import Document, empty_table, figure, say, show_table
from runtime.wording import fixed, joints_said, numbered


def plan(document: Document) -> None:
    """The answer first, then joint by joint."""
    if not document["feasible"]:
        say(f"INFEASIBLE: {document['reason']}")
        return
    objective = document["objective"]
    unit = "" if objective["unit"] == "1" else f" {objective['unit']}"
    joints = joints_said(objective["joints"], len(document["joints"]))
    say(
        f"{document['scenario']} in {document['cycle_time']:g} s, "
        f"{'with' if document['friction'] else 'without'} friction: {objective['goal']} of {joints} "
        f"{figure(objective['value'])}{unit}"
    )
    for spring in document["springs"]:
        say(f"spring at joint {spring['joint']}: {spring['text']}{_bought(document, spring)}")
    if len(document["catalogue"]) > 1:
        units = {str(spring["joint"]): spring["unit"] for spring in document["springs"]}
        others = "; ".join(_choice(c, units) for c in document["catalogue"])
        say(f"springs compared, the best first: {others}")
    table = empty_table("joint", "cost", "peak torque", "peak speed", "range")
    for joint in document["joints"]:
        (low, high), position, force = joint["range"], joint["units"]["position"], joint["units"]["force"]
        table.add_row(
            numbered(joint["joint"], joint["name"]),
            f"{figure(joint['cost'])} ({force})^2 s",
            f"{figure(joint['peak_torque'])} {force}",
            f"{figure(joint['peak_speed'])} {position}/s",
            f"{fixed(low)} to {fixed(high)} {position}",
        )
    show_table(table)
    solver = document["solver"]
    met = sum(a["met"] for a in solver["attempts"])
    say(f"{met} of {len(solver['attempts'])} starts met all constraints; {solver['seconds']:.2f} s")
    for term, why in document["left_out"].items():
        say(f"not in the plan: {term}, {why}")
    for warning in document["warnings"]:
        say(f"warning: {warning}")


def _bought(document: Document, spring: Document) -> str:
    """What was sought, where the spring had to be one of a catalogue."""
    if not any(str(spring["joint"]) in sizes for choice in document["catalogue"] for sizes in _sizes(choice)):
        return ""
    return f" (from the catalogue; sought {figure(spring['sought'])} {spring['unit']})"


def _sizes(choice: Document) -> list[Mapping[str, float]]:
    """By joint, of springs that can be bought; apart, those that are sized in different units."""
    return [by_joint for key, by_joint in choice.items() if key != "cost"]


def _choice(choice: Document, units: Mapping[str, str]) -> str:
    sizes = [item for by_joint in _sizes(choice) for item in by_joint.items()]
    springs = ", ".join(f"{size:g} {units[joint]}" for joint, size in sizes)
    return f"{springs} {figure(choice['cost']) if choice['cost'] is not None else 'infeasible'}"
