"""What import and export say on the terminal."""

from __future__ import annotations

from runtime.report.terminal.cells import Document, console, empty_table, say


def imported(document: Document) -> None:
    """The joints of the new arm, and what a person should know of it."""
    joints = document["joints"]
    count = "1 joint" if len(joints) == 1 else f"{len(joints)} joints"
    say(f"{document['out']}: {document['name']}, {count} from {document['base']} to {document['tip']}")
    table = empty_table("joint", "name", "type", "mass [kg]", "range", "unknown")
    for joint in joints:
        effects = [name for name, values in joint["effects"].items() if not values]
        mass = "" if joint["mass"] is None else f"{joint['mass']:.4g}"
        unknown = ", ".join([*joint["unknown"], *effects])
        table.add_row(str(joint["joint"]), joint["name"], joint["type"], mass, _range(joint), unknown)
    console().print(table)
    say(*document["notes"])


def _range(joint: Document) -> str:
    unit = "rad" if joint["type"] == "revolute" else "m"
    position = joint["limits"]["position"]
    return "" if position is None else f"{position[0]:.4g} to {position[1]:.4g} {unit}"
