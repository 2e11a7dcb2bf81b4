"""Results for people: tables from the same dictionaries that --json writes."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

Document = Mapping[str, Any]
_PATIENCE = 2.0  # s
_MOST_CLOSE = 3
_WORTH_A_LINE = 0.05


@contextmanager
def working(what: str) -> Iterator[Callable[[str], None]]:
    """Says on standard error what is going on: a spinner on a terminal, else one line after two seconds.

    Gives a function for lines of progress in between.
    """
    console = Console(stderr=True, markup=False, highlight=False, soft_wrap=True)
    if console.is_terminal:
        with console.status(f"{what} …"):
            yield console.print
        return
    timer = threading.Timer(_PATIENCE, lambda: print(f"{what} …", file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield lambda line: print(line, file=sys.stderr, flush=True)
    finally:
        timer.cancel()


def say(*lines: str) -> None:
    """Plain lines on standard output."""
    for line in lines:
        _console().print(line, soft_wrap=True)


def effects(document: Document) -> None:
    """The library, one line an effect."""
    table = _table("effect", "scope", "parameters", "what it is")
    for effect in document["effects"]:
        parameters = ", ".join(p["name"] for p in effect["parameters"])
        table.add_row(effect["name"], effect["scope"], parameters, effect["summary"])
    _console().print(table)


def effect(document: Document) -> None:
    """One effect's page."""
    say(f"{document['name']}: {document['summary']}", f"  {document['equation']}", "")
    table = _table("parameter", "unit", "role", "bounds", "meaning")
    for p in document["parameters"]:
        units = dict.fromkeys(p["unit"].values())
        low, high = p["bounds"]
        bounds = f"{'-∞' if low is None else f'{low:g}'} … {'∞' if high is None else f'{high:g}'}"
        table.add_row(p["name"], " or ".join(units), p["role"], bounds, p["meaning"])
    _console().print(table)
    facts = {
        "acts on": document["scope"],
        "family": document["family"],
        "memory": ", ".join(s if isinstance(s, str) else s["name"] for s in document["states"]),
        "replaces": ", ".join(document["generalises"]),
        "trace": document["trace"],
        "experiment": document["experiment"],
        "source": document["source"],
    }
    say(*(f"{name + ':':12}{text}" for name, text in facts.items() if text))


def identify(document: Document) -> None:
    """Base inertial parameters and effects with their 95 % intervals, with and without skew correction."""
    skew = document["skew"]
    origin = "estimated" if skew.get("estimated") else "given"
    say(f"Band up to {_g(document['band']['cutoff_hz'])} Hz: {document['band']['reason']}.")
    say(f"Skew between torque and motion: {_g(skew['value'])} {skew['unit']} ({origin}){_interval(skew)}.")
    _fit(document)
    if document.get("uncorrected"):
        say("Without skew correction:")
        _fit(document["uncorrected"])


def _fit(document: Document) -> None:
    table = _table("joint", "parameter", "file", "fit", "95 % interval", "unit")
    for p in document["inertial"]:
        table.add_row(_joint(p["joint"]), p["name"], _g(p["model"]), _g(p["fit"]), _interval(p, ""), _unit(p))
    for entry in document["effects"]:
        for name, p in entry["parameters"].items():
            label = f"{entry['effect']}: {name}"
            table.add_row(_joint(entry["joint"]), label, "", _g(p["value"]), _interval(p, ""), _unit(p))
    _console().print(table)


def compare(document: Document) -> None:
    """Where the model fails: the residual's size, and what it follows."""
    _joints(document)
    _structure(document)
    _warnings(document)


def _structure(document: Document) -> None:
    """What the residual of each joint follows, where it is said."""
    for joint in document["joints"]:
        follows = [f"{s['signal']} {_percent(s['share'])}" for s in joint.get("structure", []) if s["share"] > 0.005]
        if follows:
            say(f"Joint {joint['joint']}: of the residual's power, explained by " + ", ".join(follows) + ".")


def diagnosis(document: Document) -> None:
    """The verdict in one sentence, then its evidence, and what to type next."""
    say(f"{document['verdict'].upper()}: {document['reason']}", "")
    _joints(document)
    _structure(document)
    _draft(document)
    for finding in document["findings"]:
        _finding(finding, document)
    if document["verdict"] != "effect":
        _not_named(document)
    say("Base inertial parameters:")
    _fit({"inertial": document["parameters"], "effects": []})
    _seen(document)
    _warnings(document)
    _commands(document)


def _not_named(document: Document) -> None:
    """The strongest candidates that were not named, one line each."""
    floors = [j["floor"] for j in document["joints"]]
    own = [(e["evidence"]["eff"] / floors[(e["joint"] or 1) - 1], e) for e in document["ruled_out"]]
    entries = [e for size, e in sorted(own, key=lambda item: -item[0]) if size > _WORTH_A_LINE]
    if not entries:
        return
    say("Closest to a name:")
    for e in entries[:_MOST_CLOSE]:
        why = e["evidence"]["failed_gates"] or ["passes every gate, but added, the error does not fall"]
        say(f"  {e['effect']}{_at(e['joint'])}: {'; '.join(why[:2])}")
    say("")


def _seen(document: Document) -> None:
    """What would have been seen: whole for a clean bill, which is worth as much as that."""
    seen = document["would_have_seen"]
    if not seen:
        return
    if document["verdict"] != "clean":
        say(f"Limits of what these recordings would have shown: {len(seen)}, with --report or --json.")
        return
    joints = sorted({s["joint"] for s in seen}, key=lambda joint: joint or len(seen))
    table = _table("would have been seen", *(_place(joint) for joint in joints))
    for effect in sorted({s["effect"] for s in seen}):
        found = {s["joint"]: s for s in seen if s["effect"] == effect}
        table.add_row(effect, *(_limit(found.get(joint)) for joint in joints))
    _console().print(table)


def _limit(seen: Document | None) -> str:
    if seen is None:
        return "–"
    side, value = ("<", seen["below"]) if "below" in seen else (">", seen["above"])
    return f"{seen['parameter']} {side} {value:.2g} {_unit(seen)}".rstrip()


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
    before, after = finding["rms_before"], finding["rms_after"]
    say(
        f"{finding['effect']}{_at(finding['joint'])}: residual {_g(before)} -> {_g(after)}, "
        f"{_percent(finding['share'])} of what was missing."
    )
    if finding["held_out_before"] is not None:
        say(f"  held out: {_g(finding['held_out_before'])} -> {_g(finding['held_out_after'])}")
    _values(finding["parameters"])
    evidence, unit = finding["evidence"], document["joints"][(finding["joint"] or 1) - 1]["unit"]
    say(
        f"  evidence: it alone explains {evidence['eff']:.3g} {unit}; BIC falls by {evidence['delta_bic']:.0f}, "
        f"the squared error on unseen stretches by {_percent(evidence['cv_gain'])}"
    )
    rivals = [(r["effect"], r["joint"]) for r in finding["rivals"]]
    here = (finding["effect"], finding["joint"])
    behind = [e for e in finding["ranking"] if (e["effect"], e["joint"]) not in [here, *rivals]]
    behind = [e for e in behind if e["evidence"]["share_of_excess"] > _WORTH_A_LINE][:_MOST_CLOSE]
    if behind:
        names = (f"{e['effect']}{_at(e['joint'])} ({_percent(e['evidence']['share_of_excess'])})" for e in behind)
        say(f"  ruled out, with what each would explain of that: {', '.join(names)}")
    if rivals:
        say(f"  this data cannot tell it from {', '.join(f'{effect}{_at(joint)}' for effect, joint in rivals)}")
        say(f"  what would: {finding['experiment']}")
    if finding["remainder"]:
        say(f"  left over: {finding['remainder']}")
    say("")


def _draft(document: Document) -> None:
    """A guess at what no effect explains, or why there is none, where one was asked for."""
    draft = document.get("draft")
    if draft is None:
        say(*filter(None, [document.get("draft_reason")]))
        return
    say(
        f"A guess{_at(draft['joint'])}, no law: {draft['effect']} = {draft['equation']}",
        f"  residual {_g(draft['rms_before'])} -> {_g(draft['rms_after'])} {draft['unit']} (noise floor "
        f"{_g(draft['floor'])}), {_percent(draft['share'])} of what was missing.",
    )
    _values(draft["parameters"])
    say(
        f"  written to {draft['file']}; watch the error fall with it, then add it:",
        *(f"    {c}" for c in draft["next"]),
    )
    say("")


def _values(parameters: Mapping[str, Document]) -> None:
    for name, p in parameters.items():
        say(f"  {name} = {_g(p['value'])} {_unit(p)}".rstrip() + _interval(p))


def improvement(document: Document) -> None:
    """The error at every step, fitted and held out, what was added, and the verdict on what is left."""
    history = document["history"]
    held = any(step.get("held_out") for step in history)
    headings = ["model", "error", "rms"] + (["held-out error", "held-out rms"] if held else [])
    table = _table(*headings)
    for step in history:
        row = [f"+ {step['added']}" if step["added"] else "as in the file"]
        row += [_list(step["relative"], _percent), _list(step["rms"], _g)]
        if held:
            row += [_list(step.get("held_out_relative"), _percent), _list(step.get("held_out"), _g)]
        table.add_row(*row)
    _console().print(table)
    say(f"Noise floor (rms): {_floors(document['joints'])}.")
    if document.get("held_out_floors"):
        say(f"  held out: {_floors(document['held_out_floors'])}.")
    say("")
    for entry in history:
        if entry.get("finding"):
            _finding(entry["finding"], document)
    _refit(document["identification"]["before"], document["identification"]["after"])
    say(f"What is left: {document['verdict'].upper()}: {document['reason']}", "")
    _not_named(document)
    _seen(document)
    _warnings(document)
    _commands(document)


def _floors(joints: Sequence[Document]) -> str:
    return ", ".join(f"joint {j['joint']} {_g(j['floor'])} ({j['floor_source']})" for j in joints)


def _refit(before: Document, after: Document) -> None:
    """Every parameter as the file has it, fitted without and with what was added."""
    table = _table("joint", "parameter", "file", "before", "after", "95 % interval", "unit")
    for old, new in zip(before["inertial"], after["inertial"], strict=True):
        cells = [_g(old["model"]), _g(old["fit"]), _g(new["fit"]), _interval(new, ""), _unit(new)]
        table.add_row(_joint(new["joint"]), new["name"], *cells)
    fits = [
        {(e["effect"], e["joint"]): e["parameters"] for e in identification["effects"]}
        for identification in (before, after)
    ]
    for effect, joint in dict.fromkeys([*fits[0], *fits[1]]):
        old, new = (fit.get((effect, joint), {}) for fit in fits)
        for name in dict.fromkeys([*old, *new]):
            p = new.get(name) or old[name]
            values = [_g(fit[name]["value"]) if name in fit else "–" for fit in (old, new)]
            cells = ["–", *values, _interval(p, "") if name in new else "–", _unit(p)]
            table.add_row(_joint(joint), f"{effect}: {name}", *cells)
    _console().print(table)


def verify(document: Document) -> None:
    """The worst case of each target, as a part of its tolerance, and every case that is not equal."""
    cases: Sequence[Document] = document["cases"]
    worst: dict[str, Document] = {}
    for case in cases:
        if case["target"] not in worst or _ratio(case) > _ratio(worst[case["target"]]):
            worst[case["target"]] = case
    wrong = [case for case in cases if not case["equal"]]
    table = _table("target", "functions", "worst", "of its tolerance", "SymPy", "target's", "at")
    for case in [*worst.values(), *(case for case in wrong if case not in worst.values())]:
        at = ", ".join(f"{name}={_short(value)}" for name, value in case["inputs"].items())
        count = sum(other["target"] == case["target"] for other in cases)
        table.add_row(
            case["target"],
            str(count),
            f"{case['function']}: {case['output']}",
            _percent(case["ratio"]),
            _digits(case["expected"]),
            _digits(case["found"]),
            at,
        )
    _console().print(table)
    vectors = f"{len(document['vectors'])} test vectors with --json"
    if wrong:
        say(f"NOT equal: {len(wrong)} of {len(cases)} comparisons; {vectors}.")
    else:
        say(f"Equal: {len(cases)} comparisons at {document['samples']} points each; {vectors}.")


def _ratio(case: Document) -> float:
    return float("inf") if case["ratio"] is None else float(case["ratio"])


def _digits(value: float | None) -> str:
    return "–" if value is None else f"{value:.9g}"


def simulation(document: Document) -> None:
    """What is in a simulated recording."""
    hidden = [entry for entry in document["effects"] if entry["hidden"]]
    say(f"{document['out']}: {document['samples']} samples, {_g(document['seconds'])} s")
    for entry in hidden:
        values = ", ".join(f"{name} {_g(value)}" for name, value in entry["values"].items())
        say(f"hidden: {entry['effect']}{_at(entry['joint'])}: {values}")


# --- cells ---


def _joints(document: Document) -> None:
    table = _table("joint", "residual rms", "of the torque", "noise floor", "floor from", "repeatable")
    for j in document["joints"]:
        repeats = {True: "yes", False: "no", None: "unknown"}[j.get("repeatable")]
        table.add_row(
            _joint(j["joint"]), _g(j["rms"]), _percent(j["relative"]), _g(j["floor"]), j["floor_source"], repeats
        )
    _console().print(table)


def _console() -> Console:
    # Off a terminal, a fixed width keeps tables whole in files and pipes.
    width = None if sys.stdout.isatty() else 140
    return Console(markup=False, highlight=False, width=width)


def _table(*headings: str) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for k, heading in enumerate(headings):
        table.add_column(heading, overflow="fold", no_wrap=k == 0)
    return table


def _g(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.2f} %" if abs(value) < 0.1 else f"{100 * value:.1f} %"


def _interval(p: Document, before: str = ", 95 % in ") -> str:
    interval = p.get("interval")
    text = f"{before}[{_g(interval[0])}, {_g(interval[1])}]" if interval else ""
    tangled = p.get("inseparable_from")
    return f"{text} only together with {', '.join(tangled)}".strip() if tangled else text


def _unit(p: Document) -> str:
    return "" if p["unit"] == "1" else str(p["unit"])


def _list(values: Sequence[float] | None, show: Any) -> str:
    return "–" if values is None else ", ".join(show(v) for v in values)


def _joint(joint: int | None) -> str:
    return "arm" if joint is None else str(joint)


def _place(joint: int | None) -> str:
    return "arm" if joint is None else f"joint {joint}"


def _at(joint: int | None) -> str:
    return "" if joint is None else f" on joint {joint}"


def _short(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return "[" + " ".join(_short(v) for v in value) + "]"
    return f"{value:.3g}" if isinstance(value, (int, float)) else str(value)
