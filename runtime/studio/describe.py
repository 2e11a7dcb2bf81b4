"""Results of fits and diagnoses -> the documents that the page shows, in the words of the report.

Of the studio's modules this one, tasks.py, page/view.py and the server import the report.
"""

from __future__ import annotations

import itertools
import json
import shlex
from collections.abc import Mapping, Sequence

from runtime.diagnosis.steps import Trail
from runtime.fit_warnings import Suspicion
from runtime.identification.compare import JointSeries, structure_entries
from runtime.identification.estimate import Estimate
from runtime.inspection.inspection import Inspection
from runtime.model.catalogue import EffectInfo
from runtime.model.terms import Term
from runtime.report import diagnosed
from runtime.report.fits import estimate
from runtime.report.page import moving, reports
from runtime.report.sections import Group, Paragraph, texts
from runtime.report.summary import ResultSummary, relative_floor
from runtime.studio.documents import (
    Cure,
    EffectOffered,
    EffectOverview,
    FindingOverview,
    JointOverview,
    ParameterRange,
    RecordingOverview,
    Row,
    StepOverview,
    VerdictOverview,
)
from runtime.studio.session import JointError, PlacedEffect
from runtime.wording import MORE_THAN_NOISE, numbered, unit


def recording(index: int, name: str, inspection: Inspection, joints: int) -> RecordingOverview:
    """What was read of a recording, and what puts right what looks wrong with it."""
    found = diagnosed.inspected(inspection)
    cures = [cure(s) for s in inspection.found]
    if inspection.problem is not None and inspection.recording is not None:
        cures.append(Cure(said=inspection.problem, gaps=True))
    if found.suggested:
        cures.append(Cure(said=str(inspection.problem), maps=_entries(found.suggested)))
    return RecordingOverview(
        name=name,
        clock=found.clock,
        problem=inspection.problem,
        cures=cures,
        signals=[f"recording{index}-joint{k}" for k in range(1, joints + 1)],
    )


def cure(suspicion: Suspicion) -> Cure:
    """What looks wrong, and the entries of `--map` that put it right; none where a person has to decide."""
    where = f"joint {suspicion.joint}: " if suspicion.joint else ""
    return Cure(said=f"{where}{suspicion.found}: {suspicion.cure}", maps=_entries(suspicion.maps))


def _entries(options: Sequence[str]) -> tuple[str, ...]:
    """The entries of options as typed: --map tau1="-tau1"."""
    pairs = (pair for option in options for pair in itertools.pairwise(shlex.split(option)))
    return tuple(entry for flag, entry in pairs if flag in ("--map", "--columns"))


def step(
    index: int, summary: ResultSummary, held: Sequence[JointSeries], suspicions: Sequence[Suspicion]
) -> StepOverview:
    """A fitted model."""
    fitted = summary.first.fit
    library, picture = fitted.model.library.effects, moving.of_result(summary)
    joints = []
    for k, series in enumerate(summary.first.joints):
        floor, moves = series.floor, bool(len(series.t))
        joints.append(
            error(series, held[k] if held else None).as_part_of(
                JointOverview,
                instruments=relative_floor(series) * floor.spectrum / floor.value if floor.value else 0.0,
                at_floor=not moves or series.rms < MORE_THAN_NOISE * floor.value,
                structure=[(entry.signal, entry.share) for entry in structure_entries(series)],
                signals=f"step{index}-joint{series.joint}" if moves else None,
                held_signals=f"step{index}-held{series.joint}" if held else None,
            )
        )
    return StepOverview(
        sentence=reports.verdict(summary).sentence,
        joints=joints,
        active=[
            EffectOverview(**_effect(term, library[term.effect], values))
            for term, values in fitted.inference.values.items()
        ],
        arm=None if picture is None else picture | {"data": json.loads(picture["data"])},
        cures=[cure(s) for s in suspicions],
    )


def error(series: JointSeries, held: JointSeries | None) -> JointError:
    """The error of a joint; `held`: of the same joint in the held-out recordings."""
    return JointError(
        joint=series.joint,
        called=numbered(series.joint, series.name),
        unit=series.force_unit,
        rms=series.rms,
        relative=series.relative,
        floor=series.floor.value,
        relative_floor=relative_floor(series),
        held=None if held is None else held.relative,
        held_floor=None if held is None else relative_floor(held),
    )


def _effect(term: Term, info: EffectInfo, values: Mapping[str, Estimate]) -> Row:
    """Fields of EffectOverview. A parameter may be tried as far from its value as that is large."""
    ranges = []
    for name, e in values.items():
        parameter = info.parameter(name)
        size = abs(e.value) or parameter.scale
        low, high = max(parameter.bounds[0], e.value - size), min(parameter.bounds[1], e.value + size)
        ranges.append(ParameterRange(name=name, unit=unit(e.unit), value=e.value, low=low, high=high))
    return {
        "placed": PlacedEffect(term.name, term.joint),
        "values": "; ".join(f"{name} {estimate(e)}{unit(e.unit, ' ')}" for name, e in values.items()),
        "ranges": ranges,
    }


def offered(trail: Trail) -> list[EffectOffered]:
    """The effects that the recordings can show and the model has not, by family."""
    library, places = trail.model.library.effects, dict[str, list[int | None]]()
    for term in trail.last.base.terms():
        places.setdefault(term.effect, []).append(term.joint)
    return [
        EffectOffered(
            effect=name,
            title=f"{name} ({library[name].family})",
            summary=library[name].summary,
            equation=library[name].equation,
            places=places[name],
        )
        for name in sorted(places, key=lambda name: (library[name].family, name))
    ]


def verdict(summary: ResultSummary) -> VerdictOverview:
    """A diagnosis."""
    said = reports.verdict(summary)
    about = Paragraph("An effect of this size would have been named; a smaller one may be present.", "note")
    parts = {
        "Detection limits": [about, *limits] if (limits := reports.limits(summary)) else [],
        "Warnings": texts(summary.document.warnings, "warning"),
    }
    findings = []
    for k, finding in enumerate(summary.findings):
        fitted = finding.fit
        info, values = fitted.model.library.effects[finding.term.effect], fitted.inference.values.get(finding.term, {})
        findings.append(
            FindingOverview(
                **_effect(finding.term, info, values),
                title=reports.finding_title(summary, k),
                shows_at=finding.joint_index + 1,
                rivals=[PlacedEffect(t.name, t.joint) for t in finding.rivals],
                card=reports.finding_card(summary, k),
            )
        )
    further = [Group(title, tuple(inside), title.split()[-1].lower()) for title, inside in parts.items() if inside]
    return VerdictOverview(
        kind=said.kind,
        tag=said.tag,
        sentence=said.sentence,
        more=said.more,
        findings=findings,
        unexplained=reports.unexplained_joints(summary),
        details=[*reports.diagnosis_groups(summary), *further],
    )
