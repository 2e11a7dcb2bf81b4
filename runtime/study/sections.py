"""Sections of the study: its tables beside the paper's, and which numbers are what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from runtime.report.sections import Paragraph, Section, table, texts, words
from runtime.study.tables import Claim
from runtime.wording import number, percent

WHAT_IS_WHAT = (
    "Published: costs and stiffnesses, Table I, gear ratio, pulley, the softer plate, phases and degrees.",
    "Calibrated on the published costs: what joint 4 moves, its cubic friction; the geometry of the arm, where plate "
    "and apex are, the plates' friction, the stiffer plate's pretension.",
    "Assumed: gains, encoders, noise, limits of position, what is hidden in the simulated arm, the springs between 1.3 "
    "and 5.1 kN/m, the amplitudes of the identification. The arm's file says it number by number.",
)


def costs(title: str, rows: Sequence[Mapping[str, Any]]) -> list[Section]:
    """Table II or III."""
    experiment = any(row["experiment"] for row in rows)
    heads = ["case", "T, s"] + (["plate, N/m"] if rows[0]["plate"] else [])
    heads += ["simulation", "paper", "difference"] + (["experiment", "paper", "difference"] if experiment else [])
    cells_of = []
    for row in rows:
        cells = [row["case"], f"{row['cycle_time']:g}"] + ([f"{row['plate']:g}"] if row["plate"] else [])
        cells += _beside(row["simulation"]) + (_beside(row["experiment"]) if experiment else [])
        cells_of.append([*cells, number(row["stiffness"]["ours"]), number(row["stiffness"]["paper"])])
    return [Paragraph(title), table((*heads, "spring, N/m", "paper"), cells_of), Paragraph(_summary(rows))]


def _beside(pair: Mapping[str, float]) -> list[str]:
    return [f"{pair['ours']:.1f}", f"{pair['paper']:.1f}", percent(pair["difference"])]


def _summary(rows: Sequence[Mapping[str, Any]]) -> str:
    off = [abs(row["simulation"]["difference"]) for row in rows]
    return f"Simulation: {percent(sum(off) / len(off))} off on average, {percent(max(off))} at most. Costs in N²m²s."


def claims(found: Sequence[Claim]) -> list[Section]:
    """What the paper says, and whether it holds here; what is not reproduced, and why."""
    rows = [(claim.text, claim.paper, claim.ours, "yes" if claim.holds else "NO") for claim in found]
    made: list[Section] = [table((words("the paper says"), "paper", "here", "holds"), rows)]
    for claim in found:
        if not claim.holds:
            why = f"not claimed: {claim.unclaimed}" if claim.unclaimed else "it should come out"
            made.append(Paragraph(f'Not reproduced: "{claim.text} {claim.paper}", here {claim.ours}; {why}.'))
    return made


def figure5(spread: Mapping[float, float]) -> Paragraph:
    """By how much the savings with and without friction differ."""
    worst = max(spread, key=lambda T: spread[T])
    return Paragraph(
        f"Figure 5: from {min(spread):g} to {max(spread):g} s, the spring's savings with and without friction differ "
        f"by at most {spread[worst]:.2f} N²m²s, at {worst:g} s."
    )


def study(document: Mapping[str, Any]) -> list[Section]:
    """The tables and figures that were asked for."""
    made: list[Section] = []
    if "table1" in document:
        title = "Table I: parameters hidden in the simulated arm, and what the identification makes of them"
        made += [Paragraph(title), *claims([Claim(**claim) for claim in document["table1"]["claims"]])]
    for name, title in (("table2", "Table II: scenario 1"), ("table3", "Table III: scenario 2")):
        if name in document:
            made += costs(title, document[name]["rows"])
            made += claims([Claim(**claim) for claim in document[name]["claims"]])
    if "spread" in document:
        made.append(figure5({float(T): value for T, value in document["spread"].items()}))
    lines = [f"drawn: {path}" for path in document["figures"]]
    if document["kept"]:
        stem = document["kept"][0]
        lines.append(f"kept {len(document['kept'])} executed cases; ask why one differs from its plan:")
        lines.append(f"  tendon diagnose {stem}.toml {stem}.csv.gz")
    return [*made, *texts([*lines, "", *WHAT_IS_WHAT])]
