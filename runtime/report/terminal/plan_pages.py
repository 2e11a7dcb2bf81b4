"""A plan for people: what it costs, which springs it takes, what it asks of the joints."""

from __future__ import annotations

from collections.abc import Mapping

from runtime.report.terminal.cells import Document, empty_table, figure, say, show_table


def plan(document: Document) -> None:
    """The answer first, then joint by joint."""
    if not document["feasible"]:
        say(f"INFEASIBLE: {document['reason']}")
        return
    objective = document["objective"]
    unit = "" if objective["unit"] == "1" else f" {objective['unit']}"
    joints = ", ".join(map(str, objective["joints"]))
    say(
        f"{document['scenario']} in {document['cycle_time']:g} s, "
        f"{'with' if document['friction'] else 'without'} friction: {objective['goal']} of joint {joints} "
        f"{objective['value']:.4g}{unit}"
    )
    for spring in document["springs"]:
        say(f"spring at joint {spring['joint']}: {spring['text']}{_bought(document, spring)}")
    if len(document["catalogue"]) > 1:
        units = {str(spring["joint"]): spring["unit"] for spring in document["springs"]}
        others = "; ".join(_choice(c, units) for c in document["catalogue"])
        say(f"springs compared, the best first: {others}")
    table = empty_table("joint", "cost (N m)^2 s", "peak torque", "peak speed", "range")
    for joint in document["joints"]:
        low, high = joint["range"]
        table.add_row(
            str(joint["joint"]),
            figure(joint["cost"]),
            figure(joint["peak_torque"]),
            figure(joint["peak_speed"]),
            f"{low:.3f} to {high:.3f}",
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
    if not document["catalogue"]:
        return ""
    return f" (from the catalogue; sought {spring['sought']:.4g} {spring['unit']})"


def _choice(choice: Document, units: Mapping[str, str]) -> str:
    sizes = [item for key, by_joint in choice.items() if key != "cost" for item in by_joint.items()]
    springs = ", ".join(f"{size:g} {units[joint]}" for joint, size in sizes)
    return f"{springs} {figure(choice['cost']) if choice['cost'] is not None else 'infeasible'}"
