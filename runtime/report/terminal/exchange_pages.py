"""What import and export say on the terminal."""

from __future__ import annotations

import shlex

from runtime.report.terminal.cells import COMMAND, Document, empty_table, figure, say, show_table


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
    show_table(table)
    say(*document["notes"])
    model = shlex.quote(document["out"])
    say(
        "",
        "Next, with recordings of the arm:",
        f"  {COMMAND}inspect RECORDING {model}",
        "      says what is in one, and what looks wrong about it",
        f"  {COMMAND}improve {model} RECORDING --held-out ANOTHER",
        "      finds what is unknown, and what the model lacks",
    )


def _range(joint: Document) -> str:
    unit = "rad" if joint["type"] == "revolute" else "m"
    position = joint["limits"]["position"]
    return "" if position is None else f"{position[0]:.4g} to {position[1]:.4g} {unit}"


def exported(document: Document) -> None:
    """The bodies of the written arm, how well they stand for the model, and what the file cannot say."""
    say(f"{document['out']}: {document['name']}")
    table = empty_table("joint", "name", "mass [kg]", "centre [m]", "rotor", "damping", "friction")
    for joint in document["joints"]:
        com = ", ".join(f"{value:.3g}" for value in joint["com"])
        said = (figure(joint[word]) for word in ("damping", "friction"))
        rotor = figure(joint["rotor_inertia"] or None)
        table.add_row(str(joint["joint"]), joint["name"], f"{joint['mass']:.4g}", com, rotor, *said)
    show_table(table)
    if document["missing"] > ROUNDING:
        say(
            "No bodies that can be have the model's base parameters: these miss "
            f"{100 * document['missing']:.2g} % of its torques."
        )
    if document["unsaid"]:
        say(f"The file does not say: {'; '.join(document['unsaid'])}.")
    if document["kept"]:
        say(f"The file into which it was written keeps its own: {'; '.join(document['kept'])}.")


ROUNDING = 1e-9
"""Part of the torque that rounding may miss."""
