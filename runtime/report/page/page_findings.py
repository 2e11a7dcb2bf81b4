"""The report's findings: their evidence, whom they were chosen before, and what else could and could not be seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from runtime.diagnosis.detection_limits import Limit
from runtime.diagnosis.diagnose import absent, finding_entry
from runtime.diagnosis.gates import Evidence
from runtime.diagnosis.remainder import remainder
from runtime.diagnosis.steps import Finding
from runtime.estimation.compare import JointSeries, structure_shares
from runtime.model.loader import Model
from runtime.model.terms import Term, at
from runtime.motion import spectrum
from runtime.report import reasons
from runtime.report.page import page_figures as figures
from runtime.report.page import page_parameters as parameters
from runtime.report.summary import ResultSummary
from runtime.wording import number, percent, quantity, times_floor, whole

Row = dict[str, Any]

_FOLLOWS = 0.02


def findings(summary: ResultSummary) -> list[Row]:
    """Every finding with its evidence, its rivals, the other candidates for its place, and figures."""
    return [card(summary, k) | {"figures": _figures(summary, k)} for k in range(len(summary.findings))]


def card(summary: ResultSummary, number_: int) -> Row:
    """A finding in words and numbers: evidence, law, values, rivals and the other candidates for its place."""
    diagnosis, finding = summary.diagnosis, summary.findings[number_]
    assert diagnosis is not None
    i = finding.joint_index
    series = finding.before.joints[i]
    info = diagnosis.model.library.effects[finding.term.effect]
    values = diagnosis.steps[-1].identification.inference.values.get(finding.term, {})
    held = None
    if finding.before.held_out is not None and finding.after.held_out is not None:
        held = _arrow(finding.before.held_out.relative[i], finding.after.held_out.relative[i])
    return {
        "title": f"{finding.term.effect} at joint {summary.called(i)}" if finding.term.joint else name(finding.term),
        "summary": info.summary,
        "equation": info.equation,
        "source": info.source,
        "evidence": _evidence(finding.evidence, series.floor.value, series.force_unit),
        "error": _arrow(finding.before.fitted.relative[i], finding.after.fitted.relative[i]),
        "held": held,
        "share": percent(finding.share(), 0),
        "parameters": parameters.estimates(values, info),
        "rivals": [name(t) for t in finding.rivals],
        "missing": [m.sentence() for m in absent(diagnosis, number_)],
        "candidates": _candidates(summary, finding),
        "remainder": finding_entry(diagnosis, number_).remainder,
        "command": summary.adding()[number_].line,
    }


def _figures(summary: ResultSummary, number_: int) -> list[figures.Drawn]:
    """What a finding explains."""
    finding, i = summary.findings[number_], summary.findings[number_].joint_index
    info = summary.first.identification.model.library.effects[finding.term.effect]
    return figures.of_finding(finding, info, f"finding{number_ + 1}", len(summary.findings_at(i)) == 1)


def name(term: Term) -> str:
    """An effect with its place, as the page calls it."""
    return f"{term.effect}{at(term)}"


def _arrow(before: float, after: float) -> str:
    return f"{percent(before)} → {percent(after)}"


def _evidence(evidence: Evidence, floor: float, unit: str) -> Row:
    parts = times_floor(evidence.eff, floor)
    own = "none" if parts < 0.005 else f"{quantity(evidence.eff, unit, 3)} ({number(parts, 3)} × floor)"
    return {
        "eff": own,
        "share": percent(min(evidence.share, 1.0), 0),
        "bic": whole(evidence.delta_bic),
        "cv": percent(1 - math.sqrt(max(1 - evidence.cv_gain, 0.0)), 1),
        "gain": whole(evidence.likelihood_gain),
    }


def _candidates(summary: ResultSummary, finding: Finding) -> Row:
    """All that were weighed for a finding's place, itself first, and why it was chosen and not they."""
    named = finding.evidence
    rows = [_weighed(finding, named, "named", "Named: it passes every gate, and the error falls as shown.")]
    also = [f.term for f in summary.findings if f is not finding]
    nothing: list[str] = []
    unearned: list[str] = []
    for other in finding.verdict.ranked:
        floor = _shown_at(finding, other.term).floor.value
        if other.term == named.term:
            continue
        if reasons.next_to_nothing(other, floor):
            nothing.append(name(other.term))
        elif reasons.unearned(other) and other.term not in also:
            unearned.append(name(other.term))
        else:
            kind = "rival" if other.term in finding.rivals else ""
            rows.append(_weighed(finding, other, kind, reasons.in_place_of(other, named, finding.rivals, floor, also)))
    weighed = {e.term for e in finding.verdict.ranked}
    blank = dict.fromkeys(("eff", "share", "cv", "bic"), "–")
    for rival in finding.rivals:
        if rival not in weighed:
            rows.append({"name": name(rival), "kind": "rival", "why": reasons.unweighed_rival(named), **blank})
    return {"rows": rows, "nothing": nothing, "unearned": unearned}


def _shown_at(finding: Finding, term: Term) -> JointSeries:
    """The joint at which a candidate for a finding's place shows: its own, or else the finding's."""
    return finding.before.joints[finding.joint_index if term.joint is None else term.joint - 1]


def _weighed(finding: Finding, evidence: Evidence, kind: str, why: str) -> Row:
    series = _shown_at(finding, evidence.term)
    return _row(evidence, kind, why, series.floor.value, series.force_unit)


def _row(evidence: Evidence, kind: str, why: str, floor: float, unit: str) -> Row:
    return {"name": name(evidence.term), "kind": kind, "why": why} | _evidence(evidence, floor, unit)


def ruled_out(summary: ResultSummary) -> Row:
    """The strongest candidates at every joint once the search has ended, and what kept each from being named."""
    rows: list[Row] = []
    nothing: list[str] = []
    unearned: list[str] = []
    if summary.diagnosis is None:
        return {"rows": rows, "nothing": nothing, "unearned": unearned}
    held_out = summary.last.held_out is not None
    for evidence in summary.diagnosis.last.ranked:
        series = summary.last.joints[(evidence.term.joint or 1) - 1]
        floor = series.floor.value
        if reasons.next_to_nothing(evidence, floor):
            nothing.append(name(evidence.term))
        elif reasons.unearned(evidence):
            unearned.append(name(evidence.term))
        else:
            rows.append(_row(evidence, "", reasons.not_named(evidence, floor, held_out), floor, series.force_unit))
    return {"rows": rows, "nothing": list(dict.fromkeys(nothing)), "unearned": unearned}


def experiments(summary: ResultSummary) -> list[Row]:
    """For every finding: what brings it out and what brings out each of its rivals, and how to get the motion."""
    effects = summary.first.identification.model.library.effects
    separating = iter(summary.separating())
    rows = []
    for finding in summary.findings:
        terms = (finding.term, *finding.rivals)
        rows.append(
            {
                "title": " or ".join(map(name, terms)),
                "rivals": bool(finding.rivals),
                "terms": [
                    {"name": name(t), "trace": effects[t.effect].trace, "experiment": effects[t.effect].experiment}
                    for t in terms
                ],
                "commands": [next(separating) for _ in finding.rivals],
            }
        )
    return rows


def limits(summary: ResultSummary) -> list[Row]:
    """Per joint, then the whole arm: what would have been seen, sorted by family and name."""
    if summary.left is None:
        return []
    effects = summary.left.model.library.effects
    seen = sorted(summary.left.seen, key=lambda limit: (effects[limit.term.effect].family, limit.term.effect))
    places = sorted({limit.term.joint for limit in seen}, key=lambda joint: joint or math.inf)
    return [
        {
            "place": "Whole arm" if place is None else f"Joint {summary.called(place - 1)}",
            "open": place is not None and not summary.at_floor(place - 1),
            "rows": [_limit(limit, summary.left.model) for limit in seen if limit.term.joint == place],
        }
        for place in places
    ]


def _limit(limit: Limit, model: Model) -> Row:
    info = model.library.effects[limit.term.effect]
    known = {p.name: p.meaning for p in (*info.parameters, *info.coefficients)}
    return {
        "effect": limit.term.effect,
        "limit": limit.words(model),
        "parameter": known.get(limit.parameter, ""),
        "what": info.summary,
    }


def left_over(summary: ResultSummary) -> list[Row]:
    """Where the verdict at the end is "unexplained": what is known of every joint's residual."""
    if summary.left is None or summary.left.verdict != "unexplained":
        return []
    step = summary.left.steps[-1]
    rows = []
    for i, series in enumerate(step.joints):
        what = remainder(step, i)
        if what is None:
            continue
        line = spectrum.strongest_line(step.identification.fit.residual[i], step.identification.motion.row_rate(i))
        rows.append(
            {
                "joint": series.joint,
                "called": summary.called(i),
                "what": what,
                "follows": follows(structure_shares(series)),
                "line": None if line is None else f"{line.frequency:.2f} Hz",
                "line_share": None if line is None else percent(line.share, 0),
            }
        )
    return rows


def follows(shares: dict[str, float]) -> str:
    """The signals that a residual is structured over, the strongest first; empty if there is none."""
    strong = sorted(((share, signal) for signal, share in shares.items() if share > _FOLLOWS), reverse=True)
    return ", ".join(f"{signal} ({percent(share, 0)})" for share, signal in strong)


def to_record(summary: ResultSummary) -> list[Row]:
    """Where the verdict is "refused": the motions that bring out what the data leave open."""
    if summary.left is None or summary.left.verdict != "refused":
        return []
    effects = summary.left.model.library.effects
    return [{"name": name(t), "experiment": effects[t.effect].experiment} for t in _open(summary)]


def _open(summary: ResultSummary) -> Sequence[Term]:
    """Terms with a parameter that the data show only together with others; all active ones if there is none."""
    values = summary.last.identification.inference.values
    tangled = [term for term, own in values.items() if any(e.with_others for e in own.values())]
    return tangled or list(values)
