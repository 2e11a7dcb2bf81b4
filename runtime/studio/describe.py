"""Results of fits and diagnoses -> the documents that the page shows, in the words of the report.

Of the studio's modules this one, the tasks, the page and the server import the report.
"""

from __future__ import annotations

import itertools
import json
import re
import shlex
import sys
from collections.abc import Mapping, Sequence

from msgspec.structs import replace

from runtime.diagnosis.steps import Trail
from runtime.fit_warnings import Suspicion
from runtime.identification.compare import JointSeries, structure_entries
from runtime.identification.estimate import Estimate
from runtime.inspection.inspection import Inspection
from runtime.model.catalogue import EffectInfo
from runtime.model.terms import Term
from runtime.recordings.columns import MappedColumn, RecordedArm, needed_of, signals_of, units_of
from runtime.recordings.preview import FieldPreview
from runtime.report import diagnosed
from runtime.report.fits import estimate
from runtime.report.page import moving, reports
from runtime.report.sections import Group, Paragraph, Section, TableSection, texts
from runtime.report.summary import ResultSummary, relative_floor
from runtime.studio.documents import (
    ColumnOverview,
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
from runtime.studio.history import JointError, PlacedEffect
from runtime.studio.inputs import GivenRecording
from runtime.wording import numbered, unit


def spoken(message: str) -> str:
    """A message without what one would type: the page has controls for that."""
    named = re.sub(r"--map (\w+):", r"\1:", message)
    plain = re.sub(r" \([^()]*--[^()]*\)", "", named)
    return "; ".join(part for part in plain.split("; ") if "--" not in part and sys.executable not in part)


def columns(found: Sequence[FieldPreview]) -> list[ColumnOverview]:
    """What the columns of a recording contain."""
    return [
        ColumnOverview(
            name=preview.field.name,
            first=list(preview.first),
            least=preview.least if preview.samples else None,
            largest=preview.largest if preview.samples else None,
            outline=list(preview.outline),
        )
        for preview in found
    ]


def recording(
    given: GivenRecording, name: str, inspection: Inspection, guesses: Mapping[str, str], arm: RecordedArm
) -> RecordingOverview:
    """What was read of a recording, and what puts right what looks wrong with it. name: of its signal sets."""
    found, read = diagnosed.inspected(inspection), inspection.recording
    cells = {} if read is None else dict(read.cells)
    cures = [cure(s, {given.given.file: cells}) for s in inspection.found]
    if inspection.problem is not None and read is not None and not inspection.lawless:
        said = spoken(inspection.problem)
        cures.append(Cure(said=said, does="Split it at its gaps", readings={given.given.file: ()}, gaps=True))
    return RecordingOverview(
        clock=found.clock,
        problem=None if inspection.problem is None else spoken(inspection.problem),
        cures=cures,
        cells=cells,
        guesses=dict(guesses),
        ratios={k: joint.gear_ratio for k, joint in enumerate(arm.joints, 1) if joint.torque_constant is None},
        needed=needed_of(arm),
        units={signal: units_of(signal, arm) for signal in signals_of(arm)},
        signals=[] if read is None else [f"{name}-joint{k + 1}" for k in range(len(read.q))],
    )


def cure(suspicion: Suspicion, cells: Mapping[str, Mapping[str, str]]) -> Cure:
    """What looks wrong with recordings, and how each is read instead.

    cells   recording -> signal -> column, of the first recording as the suspicion names it
    """
    where = f"joint {suspicion.joint}: " if suspicion.joint else ""
    entries = map_entries(suspicion)
    if not entries:
        return Cure(said=spoken(f"{where}{suspicion.found}: {suspicion.cure}"))
    first = next(iter(cells.values()))
    readings = {
        file: tuple(carried for entry in entries if (carried := _carried(entry, first, own)) is not None)
        for file, own in cells.items()
    }
    return Cure(said=f"{where}{suspicion.found}", does="; ".join(_done(e, first) for e in entries), readings=readings)


def map_entries(suspicion: Suspicion) -> list[str]:
    """The entries of `--map` that put right what looks wrong; none where a person has to decide."""
    pairs = (pair for option in suspicion.maps for pair in itertools.pairwise(shlex.split(option)))
    return [entry for flag, entry in pairs if flag == "--map"]


def _carried(entry: str, named: Mapping[str, str], own: Mapping[str, str]) -> str | None:
    """An entry of `--map` for one recording as another one needs it, whose columns may have other names, units and
    signs; None where it has no such column."""
    signal, _, text = entry.partition("=")
    if signal not in named:
        return entry
    wanted = MappedColumn.of(text)
    source = next((s for s, cell in named.items() if MappedColumn.of(cell).name == wanted.name), signal)
    if source not in own:
        return None
    before, here = MappedColumn.of(named[source]), MappedColumn.of(own[source])
    unit = here.unit if wanted.unit == before.unit else wanted.unit
    return f"{signal}={MappedColumn(here.name, unit, here.turned != (wanted.turned != before.turned))}"


def _done(entry: str, cells: Mapping[str, str]) -> str:
    """What an entry of `--map` does, as a command."""
    signal, _, text = entry.partition("=")
    if signal not in cells:
        return f"Read the {signal} as that of the {text}"
    wanted, before = MappedColumn.of(text), MappedColumn.of(cells[signal])
    parts = []
    if wanted.name != before.name:
        parts.append(f"from the column {wanted.name}")
    if wanted.unit != before.unit:
        parts.append(f"in {wanted.unit}")
    if wanted.turned != before.turned:
        parts.append("with the opposite sign")
    return f"Read {signal} {' '.join(parts)}"


def step(
    index: int,
    summary: ResultSummary,
    held: Sequence[JointSeries],
    suspicions: Sequence[Suspicion],
    cells: Mapping[str, Mapping[str, str]],
) -> StepOverview:
    """A fitted model. cells: recording -> signal -> column, the first fitted recording first."""
    fitted = summary.first.fit
    library, picture = fitted.model.library.effects, moving.of_result(summary)
    joints = []
    for k, series in enumerate(summary.first.joints):
        floor, moves = series.floor, bool(len(series.t))
        joints.append(
            error(series, held[k] if held else None).as_part_of(
                JointOverview,
                instruments=relative_floor(series) * floor.spectrum / floor.value if floor.value else 0.0,
                at_floor=series.at_floor,
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
        arm=None if picture is None else embeddable(picture),
        cures=[cure(s, cells) for s in suspicions],
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
                card=[_folded(section) for section in reports.finding_card(summary, k)],
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
        details=[replace(group, folded=True) for group in (*reports.diagnosis_groups(summary), *further)],
    )


def _folded(section: Section) -> Section:
    if not isinstance(section, TableSection):
        return section
    return Group(section.caption or "Table", (replace(section, caption=""),), folded=True)


def embeddable(picture: Row) -> Row:
    """Variables of the arm's template with the data of its frames as a document."""
    return picture | {"data": json.loads(picture["data"])}
