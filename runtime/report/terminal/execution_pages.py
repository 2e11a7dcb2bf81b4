"""An execution on the terminal, from the dictionary that --json writes."""

from __future__ import annotations

from runtime.report.terminal.cells import (
    Document,
    at_named,
    empty_table,
    figure,
    percent,
    say,
    show_table,
)
from runtime.wording import fixed, numbered

_SAME_RATE = 0.01


def show(document: Document) -> None:
    """What ran, costs and tracking beside the plan's, the plate, why it stopped, and what to type next."""
    if document["status"] == "refused" and document.get("reason") and not document["exceeded"]:
        if document.get("prediction"):
            prediction(document["prediction"])
        if board := document.get("board"):
            _board(board)
        say(f"REFUSED, nothing has moved: {document['reason']}.")
        return
    plan = document["plan"]
    friction = "compensated" if document["friction_compensation"] else "not compensated"
    say(f"{plan['scenario']} on {document['on']}: {_trials(document)}; friction {friction}.")
    _arm(document)
    if image := document.get("image"):
        say(f"Firmware for {image['target']}, {image['text']} bytes, by {image['compiler']}.")
    if document.get("every", 1) > 1:
        say(f"The line carries one record in {document['every']} control periods; the others are left out.")
    _clock(document)
    _frames(document)
    if document.get("drives"):
        _drives(document)
    if document["uncompensated"]:
        say(f"The controller does not compensate: {', '.join(document['uncompensated'])}.")
    if document["mean"] is not None:
        _table(document)
        _total(document)
        _plate(document)
    _end(document)


def prediction(document: Document) -> None:
    """What the simulated arm did, before a real one does it."""
    say("The same on the simulated arm:")
    table = empty_table("joint", "peak torque", "limit", "", "speed", "limit", "", "room to the end of the range")
    for joint in document["joints"]:
        force, unit = joint["force_unit"], joint["position_unit"]
        row = (joint["torque"], joint["torque_limit"], force, joint["speed"], joint["speed_limit"], f"{unit}/s")
        cells = [cell if isinstance(cell, str) else f"{cell:.3g}" for cell in row]
        table.add_row(numbered(joint["joint"], joint["name"]), *cells, f"{joint['room']:.3g} {unit}")
    show_table(table)
    if document["plate"] is not None:
        say(f"The end-effector {_beside_plate(document['plate'])}.")


def _board(document: Document) -> None:
    """Where the arm stands, before it is asked to move."""
    if document["standing"] is None:
        say(f"The arm cannot be asked where it stands: {document['text']}.")
        return
    say("The board answers and takes the motion; the arm")
    for joint in document["standing"]:
        unit, here, start = joint["position_unit"], joint["position"], joint["start"]
        called = numbered(joint["joint"], joint["name"])
        say(f"  joint {called}: stands at {here:.3f} {unit}, the motion starts at {start:.3f}")


def _beside_plate(distance: float) -> str:
    if distance < 0:
        return f"presses the plate down by {-100 * distance:.2f} cm"
    return f"stays {100 * distance:.2f} cm off the plate"


def _clock(document: Document) -> None:
    """Whether the board keeps the rate that its controller reckons with."""
    period, measured = document["period"], document["period_measured"]
    if measured is not None and abs(measured / period - 1.0) > _SAME_RATE:
        say(
            f"The board's records are {1e3 * measured:.4g} ms apart, by the model file {1e3 * period:.4g} ms:"
            " set its timer to the rate in [controller], or the rate to the timer's."
        )


def _frames(document: Document) -> None:
    """Whether the link damaged any."""
    link = document.get("link") or {}
    here, there = sum(link.get("damaged", {}).values()), link.get("board") or {}
    lost = sum(there.get(kind, 0) for kind in ("bad_frame", "bad_crc", "bad_header"))
    if here or lost:
        say(f"The link has damaged {lost} frames on their way to the board and {here} on their way back.")


def _trials(document: Document) -> str:
    done = sum(len(trial["cycles"]) for trial in document["trials"])
    count = len(document["trials"])
    each = f", {done} cycles of {figure(document['plan']['duration'])} s" if document["plan"]["periodic"] else ""
    return f"{count} trial{'' if count == 1 else 's'}{each}"


def _arm(document: Document) -> None:
    """In what the arm differs from the model."""
    names = {j["joint"]: j.get("name") for j in document["joints"]}
    for entry in document["effects"]:
        if entry["hidden"] or entry["changed"]:
            values = ", ".join(f"{name} {figure(value)}" for name, value in entry["values"].items())
            how = "hidden" if entry["hidden"] else "changed"
            say(f"{how}: {entry['effect']}{at_named(entry['joint'], names)}: {values}")


def _drives(document: Document) -> None:
    """How well this computer kept time, and what the drives made of its torques."""
    drives = document["drives"]
    say(
        f"The drives' frames fill {percent(drives['load'])} of {drives['channel']}. Periods began late by "
        f"{1e3 * drives['late_rms']:.2g} ms rms, {1e3 * drives['late_worst']:.2g} ms at worst; "
        f"{drives['overruns']} left out, {drives['missed_answers']} answers late or missing."
    )
    if drives["overruns"] and not drives["real_time"]:
        say("  Without real-time priority (ulimit -r 30, or as root) a busy computer is late.")
    for joint, step, limited in zip(document["joints"], drives["resolution"], drives["limited_by_drive"], strict=True):
        less = f"; its drive held back in {limited} periods" if limited else ""
        called = numbered(joint["joint"], joint["name"])
        say(f"  joint {called}: torques are rounded to {figure(step)} {joint['force_unit']}{less}")


def _table(document: Document) -> None:
    plan, mean, spread = document["plan"], document["mean"], document["spread"]
    headings = ["joint", "cost planned", "executed", "±", "tracking rms", "max", "range planned", "reached", "peak", ""]
    table = empty_table(*headings)
    for k, joint in enumerate(document["joints"]):
        table.add_row(
            numbered(joint["joint"], joint["name"]),
            figure(plan["cost"][k]),
            figure(mean["cost"][k]),
            "–" if spread is None else f"{spread['cost'][k]:.2g}",
            f"{mean['tracking_rms'][k]:.3g}",
            f"{mean['tracking_max'][k]:.3g} {joint['position_unit']}",
            _range(plan["q_min"][k], plan["q_max"][k]),
            _range(mean["q_min"][k], mean["q_max"][k]),
            f"{mean['peak_torque'][k]:.3g}",
            joint["force_unit"],
        )
    show_table(table)


def _range(low: float, high: float) -> str:
    return f"{fixed(low)} … {fixed(high)}"


def _total(document: Document) -> None:
    plan, mean, spread = document["plan"], document["mean"], document["spread"]
    unit = "(N m)^2 s" if all(j["force_unit"] == "N m" for j in document["joints"]) else "in SI"
    scatter = "" if spread is None else f" ± {spread['total']:.2g}"
    more = "" if not plan["total"] else f", {_signed(mean['total'] / plan['total'] - 1)}"
    say(f"Cost of a cycle: {figure(mean['total'])}{scatter} {unit}; planned {figure(plan['total'])}{more}.")
    if not plan["friction"]:
        modelled = figure(plan["modelled"]["total"])
        say(f"  It was planned without friction; with the model's friction the plan itself costs {modelled}.")
    if mean["saturated"]:
        say(f"Torques were at their limits for {percent(mean['saturated'])} of the time.")


def _signed(ratio: float) -> str:
    return f"{percent(abs(ratio))} {'more' if ratio > 0 else 'less'} than that"


def _plate(document: Document) -> None:
    planned, reached = document["plan"]["compression"], document["mean"]["compression"]
    if reached or planned:
        say(f"Plate: pressed down by {100 * reached:.2f} cm, planned {100 * planned:.2f} cm.")


def _end(document: Document) -> None:
    if document["status"] == "refused":
        say("REFUSED before the motion, nothing was executed:", *(f"  {item['text']}" for item in document["exceeded"]))
    if document["status"] == "stopped":
        say(f"SAFE STOP: {document['reason']}.")
    if document["recording"]:
        say(f"Recording: {document['recording']}")
    elif document["trials"]:
        say("With --out RUN.csv.gz the recording is kept.")
    if document["model_out"]:
        say(f"Model with the springs and contact of this motion: {document['model_out']}")
    if document["next"]:
        say("", "Next:")
    elif document["recording"]:
        say("The motion brings springs or a contact of its own: with --model-out FILE, compare against that model.")
    for command in document["next"]:
        say(f"  {command['command']}", f"      {command['what']}")
