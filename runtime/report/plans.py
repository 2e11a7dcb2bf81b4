"""Sections of optimize and sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from runtime.report.sections import Paragraph, Section, TableSection, table, texts, words
from runtime.wording import joints_said, number, numbered, percent, quantity, unit

Document = Mapping[str, Any]

_GOALS = {
    "torque_squared": "the squared torque over a cycle",
    "peak_torque": "the largest torque over its limit",
    "electrical_energy": "the electrical energy",
    "positive_work": "the positive work",
}
_AT_ZERO = 1e-6
"""Part of a range below which an end of it counts as 0, as a solver's accuracy has it."""
_MOST_LETTERS = 100
"""Letters of a reason in a table's cell; --json and the table of jobs have all of it."""


def plan(document: Document) -> list[Section]:
    """A plan: its cost, its springs, what it asks of every joint, and how the solver fared."""
    if not document["feasible"]:
        return [Paragraph(f"INFEASIBLE: {document['reason']}")]
    solver = document["solver"]
    met = sum(a["met"] for a in solver["attempts"])
    return [
        *texts([headline(document), *springs(document)]),
        joints(document),
        Paragraph(f"{met} of {len(solver['attempts'])} starts met all constraints; {solver['seconds']:.2f} s"),
        *warnings(document),
    ]


def headline(document: Document) -> str:
    """What a plan costs; a plan that was read from its file has no objective, only costs of its joints."""
    friction = "with" if document["friction"] else "without"
    begin = f"{document['scenario']} in {number(document['cycle_time'], 6)} s, {friction} friction: "
    goal = document.get("objective")
    if goal is None:
        return f"{begin}{_GOALS['torque_squared']} of all joints is {_total(document['joints'])}"
    of = joints_said(goal["joints"], len(document["joints"]))
    return f"{begin}{_GOALS[goal['goal']]} of {of} is {quantity(goal['value'], goal['unit'])}"


def _total(entries: Sequence[Document]) -> str:
    units = {joint["units"]["force"] for joint in entries}
    total = sum(joint["cost"] for joint in entries)
    return quantity(total, f"({units.pop()})^2 s") if len(units) == 1 else f"{number(total)} in SI"


def springs(document: Document) -> list[str]:
    """Every spring, and the springs of a catalogue that were compared."""
    catalogue = document.get("catalogue", [])
    lines = []
    for spring in document["springs"]:
        bought = any(str(spring["joint"]) in sizes for choice in catalogue for sizes in _sizes(choice))
        sought = f" (from the catalogue; sought {quantity(spring['sought'], spring['unit'])})" if bought else ""
        lines.append(f"Spring at joint {spring['joint']}: {spring['text']}{sought}.")
    if len(catalogue) > 1:
        units = {str(spring["joint"]): spring["unit"] for spring in document["springs"]}
        lines.append(f"Springs compared, the best first: {'; '.join(_choice(c, units) for c in catalogue)}.")
    return lines


def _sizes(choice: Document) -> list[Mapping[str, float]]:
    """Sizes by joint of springs that can be bought; springs that are sized in different units stand apart."""
    return [by_joint for key, by_joint in choice.items() if key != "cost"]


def _choice(choice: Document, units: Mapping[str, str]) -> str:
    sizes = [item for by_joint in _sizes(choice) for item in by_joint.items()]
    listed = ", ".join(f"{size:g} {units[joint]}" for joint, size in sizes)
    return f"{listed} {'infeasible' if choice['cost'] is None else number(choice['cost'])}"


def joints(document: Document) -> TableSection:
    """What a plan asks of every joint, and its limits."""
    rows = []
    for joint in document["joints"]:
        limits, position, force = joint["limits"], joint["units"]["position"], joint["units"]["force"]
        allowed = limits["position"]
        rows.append(
            (
                numbered(joint["joint"], joint["name"]),
                quantity(joint["cost"], f"({force})^2 s"),
                quantity(joint["peak_torque"], force),
                _stated(limits["torque"], force),
                quantity(joint["peak_speed"], f"{position}/s"),
                _stated(limits["speed"], f"{position}/s"),
                span(joint["range"], position),
                "none stated" if allowed is None else span(allowed, position),
            )
        )
    return table(("joint", "cost", "peak torque", "limit", "peak speed", "limit", "range", "limits"), rows)


def span(ends: Sequence[float], of: str) -> str:
    """A range; an end that is 0 to a solver's accuracy is 0."""
    far = max(map(abs, ends))
    low, high = (0.0 if abs(end) < _AT_ZERO * far else end for end in ends)
    return f"{number(low)} … {quantity(high, of)}"


def _stated(limit: float | None, of: str) -> str:
    return "none stated" if limit is None else quantity(limit, of)


def warnings(document: Document) -> list[Section]:
    """What a user should know before relying on a plan."""
    left_out = document.get("left_out", {})
    lines = [*document.get("warnings", []), *(f"not in the plan: {term}, {why}" for term, why in left_out.items())]
    return list(texts(lines, "warning"))


def sweep(document: Document) -> list[Section]:
    """A row a variation: the best cost, how the seeds spread about it, its springs, and what failed."""
    variations = document["variations"]
    several = any(v["jobs"] > 1 for v in variations)
    sprung = any(v["springs"] for v in variations)
    wrong = any(v["reason"] for v in variations)
    rows = []
    for v in variations:
        cells = ["" if x is None else f"{x:g}" if isinstance(x, float) else str(x) for x in v["at"].values()]
        cells.append(number(v["best"]))
        if several:
            cells += [number(v["median"]), number(v["worst"]), "–" if v["close"] is None else percent(v["close"])]
        if sprung:
            cells.append("; ".join(map(_spring_sizes, v["springs"])))
        if wrong:
            reason = v["reason"] or ""
            shortened = reason if len(reason) <= _MOST_LETTERS else reason[: _MOST_LETTERS - 1] + "…"
            counts = {"infeasible": v["infeasible"], "failed": v["failed"]}
            cells += [", ".join(f"{count} {what}" for what, count in counts.items() if count), shortened]
        rows.append(cells)
    spread = ("median", "worst", "within 1 %") if several else ()
    heads = (*variations[0]["at"], "best", *spread, *(("springs",) if sprung else ()))
    new = document["jobs"] - document["found_finished"]
    return [
        Paragraph(f"{document['scenario']}, {document['arm']}: {document['goal']}"),
        table((*heads, *(("no plan", words("why")) if wrong else ())), rows),
        Paragraph(f"{document['table']}: {document['jobs']} jobs, {new} of them now, {document['seconds']:.1f} s"),
    ]


def _spring_sizes(spring: Document) -> str:
    size, *others = (number(value) for key, value in spring.items() if key not in ("joint", "unit"))
    return f"{spring['joint']}: {', '.join((size + unit(spring['unit'], ' '), *others))}"
