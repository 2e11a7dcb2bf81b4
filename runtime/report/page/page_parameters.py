"""The report's tables of parameters: what was fitted, before and after, beside what the model file says."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from math import inf, isfinite
from typing import Any

from runtime.diagnosis.consistency import Tables, contradict, deviation
from runtime.estimation.covariance import Inference, estimate
from runtime.estimation.estimate import Estimate
from runtime.estimation.identify import Identification
from runtime.model.catalogue import EffectInfo
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.report.summary import ResultSummary
from runtime.wording import number, quantity, unit

Row = dict[str, Any]


def tables(summary: ResultSummary) -> list[Row]:
    """What was fitted, before and after: with the skew that was found, then as if torque and encoder were
    simultaneous."""
    first, last = summary.first.identification, summary.last.identification
    both = first is not last
    pairs: list[tuple[str, Inference | None, Inference]]
    pairs = [("With skew correction", first.inference, last.inference)]
    if last.uncorrected is not None:
        pairs.append(("Without skew correction, standstill included", first.uncorrected, last.uncorrected))
    return [
        {"title": title, "both": both, "places": by_place(summary, _rows(last.model, before if both else None, after))}
        for title, before, after in pairs
    ]


def by_place(summary: ResultSummary, rows: list[Row]) -> list[Row]:
    """Rows of every joint, then of the whole arm; joints at their noise floor fold away, and what of them the file has
    otherwise is counted."""
    ordered = sorted(rows, key=lambda row: row["joint"] or inf)
    places = [(joint, list(own)) for joint, own in groupby(ordered, key=lambda row: row["joint"])]
    return [
        {
            "place": "Whole arm" if joint is None else f"Joint {summary.called(joint - 1)}",
            "open": joint is not None and not summary.at_floor(joint - 1),
            "contradicting": sum(row["contradicts"] for row in own),
            "rows": own,
        }
        for joint, own in places
    ]


def _rows(model: Model, before: Inference | None, after: Inference) -> list[Row]:
    written = structure(model)
    rows = []
    for k, lump in enumerate(model.lumps):
        earlier = None if before is None else before.lumps[k]
        rows.append(_row(lump.joint, lump.name, lump.value, earlier, after.lumps[k]))
    terms = list(dict.fromkeys([*(before.values if before else ()), *after.values]))
    for term in terms:
        old = before.values.get(term, {}) if before else {}
        new = after.values.get(term, {})
        for name in {**old, **new}:
            known = written.get(term, {}).get(name)
            rows.append(_row(term.joint, f"{term.name}: {name}", known, old.get(name), new.get(name)))
    return rows


def _row(joint: int | None, name: str, known: float | None, before: Estimate | None, after: Estimate | None) -> Row:
    some = after or before
    assert some is not None
    return {
        "joint": joint,
        "name": name,
        "unit": unit(some.unit),
        "file": "" if known is None else number(known),
        "before": estimate(before),
        "after": estimate(after),
        "contradicts": after is not None and _contradicts(known, after),
    }


def _contradicts(known: float | None, e: Estimate) -> bool:
    """Whether what the model file says cannot be what the data say."""
    return known is not None and contradict(known, e.value, deviation(e))


def estimates(values: Mapping[str, Estimate], info: EffectInfo) -> list[Row]:
    """An effect's parameters with what they mean."""
    return [
        {"name": name, "value": estimate(e), "unit": unit(e.unit), "meaning": info.parameter(name).meaning}
        for name, e in values.items()
    ]


def inertial(identification: Identification) -> list[Row]:
    """Base inertial parameters of the model file beside those of the data."""
    rows = []
    for info, e in zip(identification.model.lumps, identification.inference.lumps, strict=True):
        known = info.value
        off = (e.value - known) / abs(known) if known and isfinite(e.value) else None
        rows.append(
            {
                "name": info.name,
                "meaning": info.meaning,
                "joint": info.joint,
                "file": "" if known is None else quantity(known, info.unit),
                "fit": estimate(e) + unit(e.unit, " "),
                "off": "" if off is None else f"{100 * off:+.1f} %".replace("-", "−"),
                "contradicts": _contradicts(known, e),
            }
        )
    return rows


def recordings(compared: Tables | None) -> Row | None:
    """Inertial parameters of each recording alone, and effects' that differ between them; None for one recording."""
    if compared is None or not compared.tables:
        return None
    lumps = compared.identification.model.lumps
    apart = {c.name for c in compared.inertial}
    rows = [
        {
            "name": info.name,
            "values": [estimate(t.inference.lumps[k]) for t in compared.tables],
            "unit": unit(info.unit),
            "differs": info.name in apart,
        }
        for k, info in enumerate(lumps)
    ]
    for c in compared.effects:
        assert c.term is not None
        values = [estimate(t.inference.values[c.term][c.name]) for t in compared.tables]
        rows.append({"name": f"{c.term} {c.name}", "values": values, "unit": unit(c.unit), "differs": True})
    return {"names": [t.name for t in compared.tables], "rows": rows}


def skew(inference: Inference) -> Row:
    """By how many samples the torque is late, and how that is known."""
    found = Estimate(inference.skew, inference.skew_interval, "samples")
    how = "estimated from the data" if inference.skew_interval else "not estimated: as given or assumed"
    return {"value": f"{estimate(found)} samples", "how": how}
