"""What is in a recording, as the terminal shows it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import msgspec

from runtime.documents.parts import DelayEntry
from runtime.report.terminal.cells import Document, delay_lines, empty_table, figure, say, show_table
from runtime.wording import joints_said, numbered, quantity
from symbolic.model_file.checks import quote

_MOST_FIELDS = 24


def inspection(document: Document) -> None:
    """A file's contents, its clock and signals, what its data can tell, and what looks wrong with the cure."""
    _file(document)
    if document["clock"]:
        _clock(document)
        _signals(document)
        _joints(document)
        _motion(document)
        _parameters(document)
    else:
        _fields(document)
    _wrong(document)


def _file(document: Document) -> None:
    fields = len(document["fields"])
    say(f"{document['file']}: {document['format']}, {fields} field{'s' if fields != 1 else ''}")
    say(*(f"{note}" for note in document["notes"]))


def _fields(document: Document) -> None:
    families = Counter(re.sub(r"_?\d+$", "", f["name"]) for f in document["fields"])
    names = [quote(name) + (f" ({many})" if many > 1 else "") for name, many in families.items()]
    more = f" and {len(names) - _MOST_FIELDS} more" if len(names) > _MOST_FIELDS else ""
    say(f"Fields: {', '.join(names[:_MOST_FIELDS])}{more}")


def _clock(document: Document) -> None:
    clock = document["clock"]
    gaps = f"{clock['gaps']} gap{'s' if clock['gaps'] != 1 else ''}"
    runs = f", {clock['runs']} runs" if clock["runs"] > 1 else ""
    steps = "even steps"
    if clock["jitter"]:
        steps = f"jitter {quantity(clock['jitter'], 's', 2)}, longest step {quantity(clock['longest_step'], 's', 3)}"
    rate = f"{quantity(clock['seconds'], 's')} at {quantity(clock['rate_hz'], 'Hz')}"
    say(f"{clock['samples']} samples, {rate}; {steps}, {gaps}{runs}")


def _signals(document: Document) -> None:
    table = empty_table("signal", "field", "unit", "least", "largest", "resolution", "noise")
    for s in document["signals"]:
        numbers = [figure(s[key]) for key in ("least", "largest", "resolution", "noise")]
        table.add_row(s["signal"], "" if s["field"] == s["signal"] else s["field"], s["unit"], *numbers)
    show_table(table)


def _joints(document: Document) -> None:
    for j in document["joints"]:
        who = f"Joint {numbered(j['joint'], j['name'])}"
        if not j["moves"]:
            say(f"{who}: is held")
            continue
        passive = "" if j["powered"] else "; its torque never changes"
        far, fast = quantity(j["range"], j["unit"]), quantity(j["top_speed"], f"{j['unit']}/s")
        say(f"{who}: moves over {far}, up to {fast}{passive}")


def _motion(document: Document) -> None:
    for shift in document["shifts"]:
        how = "later" if shift["value"] > 0 else "earlier"
        say(f"{shift['signal']} is {quantity(abs(shift['value']), 's', 3)} {how} than its position")
    if document["repeats"]:
        seconds = document["repeats"]["seconds"]
        say(f"Motion that is repeated: {quantity(seconds, 's', 3)}" if seconds else "No motion is repeated")
    if any(delay["estimated"] for delay in document["delay"]):
        delay_lines(msgspec.convert(document["delay"], list[DelayEntry]))


def _parameters(document: Document) -> None:
    if document["suspicions"]:  # a fit of wrong data tells nothing
        return
    words = {
        "well": "These data tell",
        "hardly": "They hardly tell",
        "together": "Together only",
        "no": "They do not tell",
    }
    for kind, text in words.items():
        names = [p["name"] for p in document["parameters"] if p["told"] == kind]
        if names:
            say(f"{text}: {_together(names)}")
    if document["misses"]:
        errors = [f"{100 * m['part']:.3g} % at joint {m['joint']}" for m in document["misses"]]
        say(f"Of the torque the model's best fit misses {', '.join(errors)}")
    if document["inertias"]:
        found = [f"{quantity(j['value'], j['unit'], 3)} at joint {j['joint']}" for j in document["inertias"]]
        said = "if that cannot be, the torques are in another unit or those of the motor"
        say(f"The fit's inertia, which the model file leaves open: {', '.join(found)}; {said}")


def _together(names: Sequence[str]) -> str:
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
    effects = [said + (f" at {joints_said(joints)}" if joints else "") for said, joints in alike.items()]
    return "; ".join([", ".join(lumps), *effects] if lumps else effects)


def _wrong(document: Document) -> None:
    if document["problem"]:
        say(f"Not to be used as it is: {document['problem']}")
    if document["suggested"]:
        say(f"Perhaps: {' '.join(document['suggested'])}")
    if document["unfitted"]:
        say(f"No fit: {document['unfitted']}")
    for s in document["suspicions"]:
        say(f"Joint {s['joint']}: {s['found']}; {s['cure']}")
    if len(document["suspicions"]) > 1 and document["cures"]:
        say(f"All at once: {' '.join(document['cures'])}")
    if document["unreliable"]:
        say(f"The fit may not be believed: {document['unreliable']}")
    if not any(document[key] for key in ("problem", "suspicions", "unfitted", "unreliable")):
        say("Nothing looks wrong." if document["parameters"] else "Nothing looks wrong; with MODEL more can be told.")
