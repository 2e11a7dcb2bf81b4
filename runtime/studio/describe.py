"""From what was fitted and found to the documents that the page shows; the words are those of the report."""

from __future__ import annotations

import itertools
import json
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from runtime.diagnosis.search import Search
from runtime.diagnosis.steps import Step
from runtime.estimation.compare import JointSeries, structure_entries, warnings
from runtime.estimation.estimate import Estimate
from runtime.estimation.suspicions import Suspicion
from runtime.inspection.inspection import Inspection
from runtime.model.catalogue import EffectInfo
from runtime.report import loop
from runtime.report.page import page_findings as cards
from runtime.report.page import page_parameters as parameters
from runtime.report.page import recorded_motion
from runtime.report.page.html_page import verdict as answer
from runtime.report.summary import ResultSummary, relative_floor
from runtime.studio.session import GivenRecording
from runtime.studio.shown import (
    Cure,
    EffectOffered,
    JointShown,
    ParameterRange,
    RecordingShown,
    Row,
    StepShown,
    VerdictShown,
)
from runtime.wording import MORE_THAN_NOISE, number, numbered
from symbolic.described import DescribedParameter


def step(index: int, summary: ResultSummary, held: Sequence[JointSeries], suspicions: Sequence[Suspicion]) -> StepShown:
    """A model that was fitted, and what of its recordings must be put right."""
    fitted = summary.first.identification
    band, skew = fitted.motion.band, parameters.skew(fitted.inference)
    return {
        "number": index,
        "sentence": answer(summary)["sentence"],
        "joints": [_joint(index, series, bool(held)) for series in summary.first.joints],
        "active": _active(summary.first),
        "inertial": parameters.inertial(fitted),
        "arm": _arm(summary),
        "cures": [cure(s) for s in suspicions],
        "warnings": warnings(fitted),
        "band": f"up to {number(band.cutoff)} Hz: {band.explained}",
        "skew": f"{skew['value']}, {skew['how']}",
    }


def _joint(index: int, series: JointSeries, held: bool) -> JointShown:
    floor = series.floor.value
    return {
        "joint": series.joint,
        "called": numbered(series.joint, series.name),
        "unit": series.force_unit,
        "position_unit": series.position_unit,
        "rms": series.rms,
        "relative": series.relative,
        "floor": floor,
        "instruments": relative_floor(series) * series.floor.spectrum / floor if floor else 0.0,
        "floor_source": series.floor.source,
        "floors": series.rms / floor if floor else None,
        "at_floor": not len(series.t) or series.rms < MORE_THAN_NOISE * floor,
        "repeatable": series.floor.repeatable(series.rms),
        "structure": [(entry.signal, entry.share) for entry in structure_entries(series)],
        "signals": f"step{index}-joint{series.joint}" if len(series.t) else None,
        "held": f"step{index}-held{series.joint}" if held else None,
    }


def _active(fitted: Step) -> list[Row]:
    """The effects of the model, with what the fit says of their parameters."""
    library = fitted.identification.model.library.effects
    return [
        {
            "effect": term.name,
            "joint": term.joint,
            "parameters": parameters.estimates(values, library[term.effect]),
            "ranges": _ranges(library[term.effect], values),
        }
        for term, values in fitted.identification.inference.values.items()
    ]


def _ranges(info: EffectInfo, values: Mapping[str, Estimate]) -> list[ParameterRange]:
    return [_range(info.parameter(name), e.value) for name, e in values.items()]


def _range(parameter: DescribedParameter, value: float) -> ParameterRange:
    """Between which values a parameter may be tried: as far off as it is large, on both sides."""
    low, high = parameter.bounds
    size = abs(value) or parameter.scale
    return {"name": parameter.name, "value": value, "low": max(low, value - size), "high": min(high, value + size)}


def _arm(summary: ResultSummary) -> Row | None:
    picture = recorded_motion.of_result(summary)
    return None if picture is None else picture | {"data": json.loads(picture["data"])}


def errors(fitted: Step, held: Sequence[JointSeries]) -> list[dict[str, Any]]:
    """Of every joint, as history.JointError has them."""
    found = []
    for k, series in enumerate(fitted.joints):
        own = held[k] if held else None
        found.append(
            {
                "joint": series.joint,
                "called": numbered(series.joint, series.name),
                "unit": series.force_unit,
                "rms": series.rms,
                "relative": series.relative,
                "floor": series.floor.value,
                "relative_floor": relative_floor(series),
                "held": None if own is None else own.relative,
                "held_floor": None if own is None else relative_floor(own),
            }
        )
    return found


def verdict(summary: ResultSummary) -> VerdictShown:
    """A diagnosis."""
    said = answer(summary)
    return {
        "kind": said["kind"],
        "tag": said["tag"],
        "sentence": said["sentence"],
        "more": said["more"],
        "findings": [_card(summary, k) for k in range(len(summary.findings))],
        "ruled_out": cards.ruled_out(summary),
        "limits": cards.limits(summary),
        "left_over": cards.left_over(summary),
        "to_record": cards.to_record(summary),
        "experiments": [_experiment(row) for row in cards.experiments(summary)],
        "sensors": loop.sensors(summary.document),
        "warnings": list(summary.document.warnings),
        "commands": [command.document().to_json() for command in summary.commands],
    }


def _card(summary: ResultSummary, index: int) -> Row:
    finding = summary.findings[index]
    fitted = finding.after.identification
    library = fitted.model.library.effects
    return cards.card(summary, index) | {
        "effect": finding.term.name,
        "joint": finding.term.joint,
        "shows_at": finding.joint_index + 1,
        "ranges": _ranges(library[finding.term.effect], fitted.inference.values.get(finding.term, {})),
        "rival_terms": [{"effect": t.name, "joint": t.joint} for t in finding.rivals],
    }


def _experiment(row: Row) -> Row:
    return row | {"commands": [command.document().to_json() for command in row["commands"]]}


def offered(search: Search) -> list[EffectOffered]:
    """The effects that the recordings can weigh and the model has not, by family."""
    library, places = search.model.library.effects, dict[str, list[int | None]]()
    for term in search.ground().terms():
        places.setdefault(term.effect, []).append(term.joint)
    names = sorted(places, key=lambda name: (library[name].family, name))
    return [
        {
            "effect": name,
            "family": library[name].family,
            "summary": library[name].summary,
            "equation": library[name].equation,
            "places": places[name],
        }
        for name in names
    ]


def recording(index: int, given: GivenRecording, inspection: Inspection, joints: int) -> RecordingShown:
    """What was read of a recording, and what would put right what looks wrong with it."""
    document = inspection.document().to_json()
    found = [cure(s) for s in inspection.found]
    if inspection.problem is not None and inspection.recording is not None:
        found.append({"said": inspection.problem, "maps": [], "gaps": True})
    if document["suggested"]:
        maps = [entry for option in document["suggested"] for entry in _entries(option)]
        found.append({"said": str(inspection.problem), "maps": maps, "gaps": False})
    return {
        "name": given.given.name,
        "held_out": given.held_out,
        "inspection": document | {"file": given.given.name},
        "problem": inspection.problem,
        "cures": found,
        "signals": [f"recording{index}-joint{k}" for k in range(1, joints + 1)],
    }


def cure(suspicion: Suspicion) -> Cure:
    """What looks wrong, and the entries of `--map` that put it right; none where a person must decide."""
    where = f"joint {suspicion.joint}: " if suspicion.joint else ""
    maps = [entry for option in suspicion.maps for entry in _entries(option)]
    return {"said": f"{where}{suspicion.found}: {suspicion.cure}", "maps": maps, "gaps": False}


def _entries(option: str) -> list[str]:
    """The entries of options as one types them: --map tau1="-tau1"."""
    parts = shlex.split(option)
    return [entry for flag, entry in itertools.pairwise(parts) if flag in ("--map", "--columns")]
