"""The report's tables of parameters: what was fitted, before and after, beside what the model file says."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from runtime.diagnosis.consistency import Tables
from runtime.estimation.covariance import Inference, estimate
from runtime.estimation.estimate import Estimate
from runtime.estimation.identify import Identification
from runtime.model.catalogue import EffectInfo
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.wording import number, quantity, unit

Row = dict[str, Any]

_CONTRADICTS = 0.05


def tables(first: Identification, last: Identification) -> list[Row]:
    """Effects' parameters: with the skew that was found, then as if torque and encoder were simultaneous."""
    before, after = (first.inference, last.inference) if first is not last else (None, last.inference)
    tables = [_table(first.model, "With skew correction", before, after)]
    if last.uncorrected is not None:
        plain = first.uncorrected if first is not last else None
        tables.append(_table(first.model, "Without skew correction, standstill included", plain, last.uncorrected))
    return tables


def _table(model: Model, title: str, before: Inference | None, after: Inference) -> Row:
    written = structure(model)
    rows = []
    for k, lump in enumerate(model.lumps):
        earlier = None if before is None else before.lumps[k]
        rows.append(_row(f"joint {lump.joint}", lump.name, lump.meaning, lump.value, earlier, after.lumps[k]))
    terms = list(dict.fromkeys([*(before.values if before else ()), *after.values]))
    for term in terms:
        old = before.values.get(term, {}) if before else {}
        new = after.values.get(term, {})
        for name in {**old, **new}:
            known = written.get(term, {}).get(name)
            where = "arm" if term.joint is None else f"joint {term.joint}"
            rows.append(_row(where, f"{term.name}: {name}", "", known, old.get(name), new.get(name)))
    return {"title": title, "both": before is not None, "rows": rows}


def _row(
    where: str, name: str, meaning: str, known: float | None, before: Estimate | None, after: Estimate | None
) -> Row:
    some = after or before
    assert some is not None
    return {
        "where": where,
        "name": name,
        "meaning": meaning,
        "unit": unit(some.unit),
        "file": "" if known is None else number(known),
        "before": estimate(before),
        "after": estimate(after),
    }


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
        outside = e.interval is not None and known is not None and not e.interval[0] <= known <= e.interval[1]
        rows.append(
            {
                "name": info.name,
                "meaning": info.meaning,
                "joint": info.joint,
                "file": "" if known is None else quantity(known, info.unit),
                "fit": estimate(e) + unit(e.unit, " "),
                "off": "" if off is None else f"{100 * off:+.1f} %".replace("-", "−"),
                "contradicts": outside and abs(off or 0.0) > _CONTRADICTS,
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
