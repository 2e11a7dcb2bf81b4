"""Comparison, diagnosis and loop on the terminal, short: from the same dictionaries that --json writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from runtime.report import sensors_said
from runtime.report.terminal.cells import (
    Document,
    Names,
    at_named,
    delay_lines,
    empty_table,
    figure,
    fit_table,
    interval,
    is_narrow,
    joint_cell,
    joints_table,
    names_of,
    percent,
    place,
    say,
    several,
    show_table,
    unit,
)
from runtime.wording import fall, numbered, times_floor, told_apart
from symbolic.model_file.checks import at_joint

_MOST_CLOSE = 3
_MOST_ABREAST = 3
_THAN = {"<": "less", ">": "more"}
_WORTH_A_LINE = 0.05


def compare(document: Document) -> None:
    """Where the model fails: the residual's size, and what it follows."""
    joints_table(document)
    _structure(document)
    _warnings(document)


def _structure(document: Document) -> None:
    """What the residual of each joint follows, where it is said."""
    for joint in document["joints"]:
        follows = [f"{s['signal']} {percent(s['share'])}" for s in joint.get("structure", []) if s["share"] > 0.005]
        if follows:
            where = numbered(joint["joint"], joint.get("name"))
            say(f"Joint {where}: of the residual's power, explained by {', '.join(follows)}.")


def diagnosis(document: Document) -> None:
    """The verdict in one sentence, then its evidence, and what to type next."""
    say(f"{document['verdict'].upper()}: {document['reason']}", "")
    joints_table(document)
    _structure(document)
    _draft(document)
    for finding in document["findings"]:
        _finding(finding, document)
    if document["verdict"] != "effect":
        _not_named(document)
    _peaks(document)
    say(*sensors_said.sentences(document))
    delay_lines(document)
    say("Base inertial parameters:")
    fit_table({"inertial": document["parameters"], "rotors": document["rotors"], "effects": []}, names_of(document))
    _recordings(document)
    _seen(document)
    _warnings(document)
    _commands(document)


def _peaks(document: Document) -> None:
    """What stands out of the spectrum of what is called noise."""
    if document["verdict"] != "clean" or not document["peaks"]:
        return
    names, found = names_of(document), []
    for peak in document["peaks"]:
        frequencies = ", ".join(f"{f:.2f} Hz" for f in peak["frequencies_hz"])
        found.append(f"joint {numbered(peak['joint'], names.get(peak['joint']))} at {frequencies}")
    say(f"Peaks in the spectrum of what is left, which hold little of it: {'; '.join(found)}.")


def _not_named(document: Document) -> None:
    """The strongest candidates that were not named, one line each."""
    floors = [j["floor"] for j in document["joints"]]
    own = [(times_floor(e["evidence"]["eff"], floors[(e["joint"] or 1) - 1]), e) for e in document["ruled_out"]]
    entries = [e for size, e in sorted(own, key=lambda item: -item[0]) if size > _WORTH_A_LINE]
    if not entries:
        return
    say("Closest to a name:")
    for e in entries[:_MOST_CLOSE]:
        why = _failed(e["evidence"])[:2] or ["passes every gate, but added, the error does not fall"]
        say(f"  {e['effect']}{at_named(e['joint'], names_of(document))}: {'; '.join(why)}")
    say("")


def _recordings(document: Document) -> None:
    """Inertial parameters of each recording alone, and whatever else differs between them."""
    if not document["recordings"]:
        return
    names = [r["recording"] for r in document["recordings"]]
    table = empty_table("each recording alone", *names, "unit")
    for rows in zip(*(r["parameters"] for r in document["recordings"]), strict=True):
        table.add_row(rows[0]["name"], *(figure(p["fit"]) for p in rows), unit(rows[0]))
    lumps = {p["name"] for p in document["parameters"]}
    for apart in (p for p in document["inconsistent"] if p["name"] not in lumps):
        known = dict(zip(apart["recordings"], apart["values"], strict=True))
        table.add_row(apart["name"], *(figure(known.get(name)) for name in names), unit(apart))
    show_table(table)
    apart_names = ", ".join(p["name"] for p in document["inconsistent"])
    say(f"They disagree on {apart_names}." if apart_names else "They agree.", "")


def _seen(document: Document) -> None:
    """What would have been seen: whole for a clean bill, which is worth as much as that."""
    seen = document["would_have_seen"]
    if not seen:
        return
    if document["verdict"] != "clean":
        say(f"Limits of what these recordings would have shown: {len(seen)}, with --report or --json.")
        return
    joints = sorted({s["joint"] for s in seen}, key=lambda joint: joint or len(seen))
    table = empty_table("would have been seen", *(place(joint) for joint in joints))
    for effect in sorted({s["effect"] for s in seen}):
        found = {s["joint"]: s for s in seen if s["effect"] == effect}
        alike = {(s["parameter"], _side(s)[0], unit(s)) for s in found.values()}
        if len(joints) > _MOST_ABREAST and len(alike) == 1:
            parameter, side, of = alike.pop()
            label = f"{effect}: {parameter} {side}" + (f", {of}" if of else "")
            table.add_row(label, *(_amount(_side(found[j])[1]) if j in found else "–" for j in joints))
        else:
            table.add_row(effect, *(_limit(found.get(joint)) for joint in joints))
    show_table(table)
    say(f"That is: a {_sentence(seen[0])} would have been seen. Less may be there, unseen.")
    if len(joints) > _MOST_ABREAST:
        say("Of what shape each was taken to be: --json, or --report.")


def _side(seen: Document) -> tuple[str, float]:
    """On which side of which value it would have been seen."""
    return ("<", seen["below"]) if "below" in seen else (">", seen["above"])


def _sentence(seen: Document) -> str:
    side, value = _side(seen)
    where = f"{seen['effect']}{at_joint(seen['joint'])}"
    text = f"{where} whose {seen['parameter']} is {_THAN[side]} than {_amount(value)} {unit(seen)}"
    assumed = ", ".join(f"{name} {figure(x)}" for name, x in seen["with"].items())
    return text.rstrip() + (f" (with {assumed} in SI)" if assumed else "")


def _amount(value: float) -> str:
    """Two digits; of a factor as many as tell it from 1, with which there is nothing."""
    return told_apart(value, 1.0) if f"{value:.2g}" == "1" else f"{value:.2g}"


def _limit(seen: Document | None) -> str:
    if seen is None:
        return "–"
    side, value = _side(seen)
    assumed = ", ".join(f"{name} {x:.2g}" for name, x in seen["with"].items() if x)
    return f"{seen['parameter']} {side} {_amount(value)} {unit(seen)}".rstrip() + (f" ({assumed})" if assumed else "")


def _warnings(document: Document) -> None:
    say(*(f"Warning: {warning}" for warning in document.get("warnings") or []))


def _commands(document: Document) -> None:
    commands = document.get("commands") or []
    if document.get("improved_model"):
        say("", f"The improved model is in {document['improved_model']}.")
    if commands:
        say("", "Next:")
    for command in commands:
        say(f"  {command['command']}", f"      {command['what']}")


def _finding(finding: Document, document: Document) -> None:
    evidence, torque = finding["evidence"], document["joints"][(finding["joint"] or 1) - 1]["unit"]
    shown = evidence.get("twist")
    before, after = (shown or finding)["rms_before"], (shown or finding)["rms_after"]
    what = f"twist by the link-side encoder, {shown['unit']}," if shown else "residual"
    names = names_of(document)
    where = at_named(finding["joint"], names)
    say(
        f"{finding['effect']}{where}: {what} {figure(before)} -> {figure(after)}, "
        f"{percent(finding['share'])} of what was missing."
    )
    if finding["held_out_before"] is not None:
        say(f"  held out: {figure(finding['held_out_before'])} -> {figure(finding['held_out_after'])}")
    _values(finding["parameters"])
    own = f"{shown['eff']:.3g} {shown['unit']}" if shown else f"{evidence['eff']:.3g} {torque}"
    say(
        f"  evidence: it alone explains {own}; BIC {fall(evidence['delta_bic'])}, "
        f"the squared error on unseen stretches {fall(evidence['cv_gain'], percent)}"
    )
    rivals = [(r["effect"], r["joint"]) for r in finding["rivals"]]
    named = [(f["effect"], f["joint"]) for f in _found(document)]
    behind = [e for e in finding["ranking"] if (e["effect"], e["joint"]) not in [*named, *rivals]]
    behind = [e for e in behind if e["joint"] in (None, finding["joint"]) or finding["joint"] is None]
    behind = [e for e in behind if e["evidence"]["share_of_excess"] > _WORTH_A_LINE][:_MOST_CLOSE]
    say(*(_set_aside(entry, finding, names) for entry in behind))
    if rivals:
        others = ", ".join(f"{effect}{at_named(joint, names)}" for effect, joint in rivals)
        say(f"  this data cannot tell it from {others}")
        say(f"  what would: {finding['experiment']}")
        signals = [f"{s['signal']} (from {', '.join(s['rivals'])})" for s in finding["missing_signals"]]
        say(*(["  so would, if it were recorded: " + ", ".join(signals)] if signals else []))
    if finding["remainder"]:
        say(f"  left over: {finding['remainder']}")
    say("")


def _failed(evidence: Document) -> list[str]:
    """Why a candidate was not named by its own figures; that its parameters cost more than it explains is enough."""
    failed: list[str] = evidence["failed_gates"]
    if failed and evidence["delta_bic"] < 0:
        return [f"it does not earn its parameters: with it, BIC {fall(evidence['delta_bic'])}"]
    return failed


def _set_aside(other: Document, finding: Document, names: Names) -> str:
    """A candidate that would explain something by itself, and why the finding was named and not that."""
    evidence, better = other["evidence"], finding["evidence"]["delta_bic"] - other["evidence"]["delta_bic"]
    if failed := _failed(evidence):
        why = failed[0]
    elif better > 0:
        why = f"BIC prefers {finding['effect']} by {better:.0f}"
    else:
        why = "with it added and everything fitted again, the error falls less"
    share = percent(min(evidence["share_of_excess"], 1.0))
    where = f"{other['effect']}{at_named(other['joint'], names)}"
    return f"  rather than {where}, which by itself would explain {share} of what was missing, but {why}"


def _found(document: Document) -> list[Document]:
    """All findings of a diagnosis, or of every step of a loop."""
    if "history" in document:
        return [entry["finding"] for entry in document["history"] if entry.get("finding")]
    return list(document["findings"])


def _draft(document: Document) -> None:
    """A guess at what no effect explains, or why there is none, where one was asked for."""
    draft = document.get("draft")
    if draft is None:
        say(*filter(None, [document.get("draft_reason")]))
        return
    say(
        f"A guess{at_named(draft['joint'], names_of(document))}, no law: {draft['effect']} = {draft['equation']}",
        f"  residual {figure(draft['rms_before'])} -> {figure(draft['rms_after'])} {draft['unit']} (noise floor "
        f"{figure(draft['floor'])}), {percent(draft['share'])} of what was missing.",
    )
    _values(draft["parameters"])
    say(
        f"  written to {draft['file']}; watch the error fall with it, then add it:",
        *(f"    {c}" for c in draft["next"]),
    )
    say("")


def _values(parameters: Mapping[str, Document]) -> None:
    for name, p in parameters.items():
        say(f"  {name} = {figure(p['value'])} {unit(p)}".rstrip() + interval(p))


def improvement(document: Document) -> None:
    """The error at every step, fitted and held out, what was added, and the verdict on what is left."""
    if len(document["joints"]) > _MOST_ABREAST:
        _errors_by_joint(document)
    else:
        _errors_by_step(document)
    say("")
    for finding in _found(document):
        _finding(finding, document)
    say(*sensors_said.sentences(document))
    delay_lines(document)
    _refit(document["identification"]["before"], document["identification"]["after"], names_of(document))
    say(f"What is left: {document['verdict'].upper()}: {document['reason']}", "")
    _not_named(document)
    _peaks(document)
    _seen(document)
    _warnings(document)
    _commands(document)


def _errors_by_step(document: Document) -> None:
    """A row a model, the joints' errors one after the other in its cells."""
    history = document["history"]
    held = any(step.get("held_out") for step in history)
    headings = ["model", "error", "rms"] + (["held-out error", "held-out rms"] if held else [])
    table = empty_table(*headings)
    for step in history:
        row = [_model(step), several(step["relative"], percent), several(step["rms"], figure)]
        if held:
            row += [several(step.get("held_out_relative"), percent), several(step.get("held_out"), figure)]
        table.add_row(*row)
    show_table(table)
    say(f"Noise floor (rms): {_floors(document['joints'])}.")
    if document.get("held_out_floors"):
        say(f"  held out: {_floors(document['held_out_floors'])}.")


def _errors_by_joint(document: Document) -> None:
    """A row a joint, a column a model; what was held out in a table of its own."""
    joints, names, history = document["joints"], names_of(document), document["history"]
    kinds = [("error, rms", "relative", "rms", joints)]
    if document.get("held_out_floors"):
        kinds.append(("held out", "held_out_relative", "held_out", document["held_out_floors"]))
    for title, relative, rms, floors in kinds:
        steps = [step for step in history if step.get(rms)]
        table = empty_table(title, *map(_model, steps), "noise floor")
        for i, (joint, floor) in enumerate(zip(joints, floors, strict=True)):
            cells = [f"{percent(step[relative][i])}, {figure(step[rms][i])}" for step in steps]
            least = f"{figure(floor['floor'])} {unit(joint)} ({floor['floor_source']})"
            table.add_row(joint_cell(joint["joint"], names), *cells, least)
        show_table(table)


def _model(step: Document) -> str:
    """The model of a step by what was added there."""
    return f"+ {step['added']}" if step["added"] else "as in the file"


def _floors(joints: Sequence[Document]) -> str:
    return ", ".join(f"joint {j['joint']} {figure(j['floor'])} ({j['floor_source']})" for j in joints)


def _refit(before: Document, after: Document, names: Names) -> None:
    """Every parameter as the file has it, fitted without and with what was added."""
    names = {} if is_narrow() else names
    table = empty_table("joint", "parameter", "file", "before", "after", "95 % interval", "unit")
    earlier = {(p["joint"], p["name"]): p["fit"] for p in before["inertial"]}
    for new in after["inertial"]:
        old = earlier.get((new["joint"], new["name"]))
        cells = [figure(new["model"]), figure(old), figure(new["fit"]), interval(new, ""), unit(new)]
        table.add_row(joint_cell(new["joint"], names), new["name"], *cells)
    fits = [
        {(e["name"], e["joint"]): e["parameters"] for e in identification["effects"]}
        for identification in (before, after)
    ]
    for effect, joint in dict.fromkeys([*fits[0], *fits[1]]):
        old, new = (fit.get((effect, joint), {}) for fit in fits)
        for name in dict.fromkeys([*old, *new]):
            p = new.get(name) or old[name]
            values = [figure(fit[name]["value"]) if name in fit else "–" for fit in (old, new)]
            cells = ["–", *values, interval(p, "") if name in new else "–", unit(p)]
            table.add_row(joint_cell(joint, names), f"{effect}: {name}", *cells)
    show_table(table)
