"""What identify, compare, diagnose and improve print on the terminal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from runtime.documents.diagnosis import (
    DiagnosisDocument,
    DraftEntry,
    EvidenceEntry,
    FindingEntry,
    HistoryEntry,
    ImprovementDocument,
    LimitEntry,
    RankedCandidate,
)
from runtime.documents.fits import (
    CompareDocument,
    FitDocument,
    FittedEffect,
    InertialEntry,
    JointEntry,
    JudgedFitDocument,
    RotorEntry,
    StructureShare,
)
from runtime.documents.parts import EstimateEntry, given
from runtime.report import sensors_said
from runtime.report.terminal.cells import (
    Names,
    at_named,
    delay_lines,
    empty_table,
    figure,
    interval,
    is_narrow,
    joint_cell,
    percent,
    place,
    say,
    show_table,
    unit_cell,
)
from runtime.wording import MORE_THAN_NOISE, fall, numbered, times_floor, told_apart
from symbolic.model_file.checks import at_joint

_MOST_CANDIDATES = 3
_MOST_COLUMNS = 3
"""Joints beside each other in a table; with more, a row each."""
_LEAST_SHARE = 0.05
_LEAST_STRUCTURE = 0.005
Judged = DiagnosisDocument | ImprovementDocument


def identify(document: JudgedFitDocument) -> None:
    """Base inertial parameters and effects with their 95 % intervals, the residuals, and whether to believe the fit."""
    skew, names = document.skew, _names(document.joints)
    origin = "estimated" if skew.estimated else "given" if given(skew.given) else "assumed"
    say(f"Band up to {figure(document.band.cutoff_hz)} Hz: {document.band.reason}.")
    say(f"Skew between torque and motion: {figure(skew.value)} {skew.unit} ({origin}){interval(skew)}.")
    delay_lines(document.delay)
    _fit_table(document.inertial, document.rotors, document.effects, names)
    if other := document.uncorrected:
        say("Without skew correction:")
        _fit_table(other.inertial, other.rotors, other.effects, names)
    _joints_table(document.joints)
    _warnings(document.warnings)
    if document.verdict == "refused":
        say("", f"REFUSED: {document.reason}")


def show(document: CompareDocument | DiagnosisDocument | ImprovementDocument) -> None:
    """A result of compare, diagnose or improve."""
    if isinstance(document, CompareDocument):
        compare(document)
    elif isinstance(document, DiagnosisDocument):
        diagnosis(document)
    else:
        improvement(document)


def compare(document: CompareDocument) -> None:
    """Where the model fails: the size of the residual, and what it follows."""
    _joints_table(document.joints)
    for joint in document.joints:
        _structure(joint, joint.structure)
    _warnings(document.warnings)


def diagnosis(document: DiagnosisDocument) -> None:
    """The verdict in one sentence, then its evidence, and what to type next."""
    say(f"{document.verdict.upper()}: {document.reason}", "")
    _joints_table(document.joints)
    for joint in document.joints:
        _structure(joint, given(joint.structure) or [])
    names = _names(document.joints)
    if document.draft is not None:
        _draft(document.draft, names)
    elif reason := given(document.draft_reason):
        say(reason)
    for finding in document.findings:
        _finding(finding, document, document.findings)
    if document.verdict != "effect":
        _closest_candidates(document)
    _peaks(document)
    say(*sensors_said.sentences(document))
    delay_lines(document.delay)
    say("Base inertial parameters:")
    _fit_table(document.parameters, document.rotors, [], names)
    _recordings(document)
    _limits(document)
    _warnings(document.warnings)
    _commands(document)


def improvement(document: ImprovementDocument) -> None:
    """The error at every step, fitted and held out, what was added, and the verdict on what is left."""
    if len(document.joints) > _MOST_COLUMNS:
        _errors_by_joint(document)
    else:
        _errors_by_step(document)
    say("")
    findings = [finding for step in document.history if (finding := given(step.finding)) is not None]
    for finding in findings:
        _finding(finding, document, findings)
    say(*sensors_said.sentences(document))
    delay_lines(document.delay)
    _refit(document.identification.before, document.identification.after, _names(document.joints))
    say(f"What is left: {document.verdict.upper()}: {document.reason}", "")
    _closest_candidates(document)
    _peaks(document)
    _limits(document)
    _warnings(document.warnings)
    _commands(document)


def _names(joints: Sequence[JointEntry]) -> Names:
    return {j.joint: given(j.name) for j in joints}


def _joints_table(joints: Sequence[JointEntry]) -> None:
    table = empty_table("joint", "residual rms", "of the torque", "noise floor", "floor from", "repeatable")
    for j in joints:
        repeats = {True: "yes", False: "no", None: "unknown"}[j.repeatable]
        table.add_row(
            numbered(j.joint, given(j.name)),
            figure(j.rms or None),
            percent(j.relative if j.rms else None),
            figure(j.floor),
            j.floor_source,
            (repeats if j.rms > MORE_THAN_NOISE * j.floor else "noise") if j.rms else "never moves",
        )
    show_table(table)


def _fit_table(
    inertial: Sequence[InertialEntry], rotors: Sequence[RotorEntry], effects: Sequence[FittedEffect], names: Names
) -> None:
    """A narrow screen has room for the numbers of joints alone; the table of residuals has their names."""
    names = {} if is_narrow() else names
    rows: list[tuple[int | None, str, str, float | None, InertialEntry | RotorEntry | EstimateEntry]] = []
    rows += [(p.joint, p.name, figure(p.model), p.fit, p) for p in inertial]
    rows += [(p.joint, f"{p.name}, further", "", p.fit, p) for p in rotors]
    rows += [
        (e.joint, f"{e.name}: {name}", figure(p.model), p.value, p) for e in effects for name, p in e.parameters.items()
    ]
    table = empty_table("joint", "parameter", "file", "fit", "95 % interval", "unit")
    for joint, label, stated, fitted, p in rows:
        table.add_row(joint_cell(joint, names), label, stated, figure(fitted), interval(p, ""), unit_cell(p.unit))
    show_table(table)


def _structure(joint: JointEntry, structure: Sequence[StructureShare]) -> None:
    follows = [f"{s.signal} {percent(s.share)}" for s in structure if s.share > _LEAST_STRUCTURE]
    if follows:
        where = numbered(joint.joint, given(joint.name))
        say(f"Joint {where}: share of the residual's power that each signal explains: {', '.join(follows)}.")


def _peaks(document: Judged) -> None:
    if document.verdict != "clean" or not document.peaks:
        return
    names = _names(document.joints)
    found = [
        f"joint {joint_cell(peak.joint, names)} at {', '.join(f'{f:.2f} Hz' for f in peak.frequencies_hz)}"
        for peak in document.peaks
    ]
    say(f"Peaks in the spectrum of the residual, with little of its power: {'; '.join(found)}.")


def _closest_candidates(document: Judged) -> None:
    """The strongest candidates that were not named, one line each."""
    floors, names = [j.floor for j in document.joints], _names(document.joints)
    sized = [(times_floor(e.evidence.eff, floors[(e.joint or 1) - 1]), e) for e in document.ruled_out]
    entries = [e for size, e in sorted(sized, key=lambda item: -item[0]) if size > _LEAST_SHARE]
    if not entries:
        return
    say("Closest candidates:")
    for e in entries[:_MOST_CANDIDATES]:
        why = _failed(e.evidence)[:2] or ["passes every gate, but adding it does not lower the error"]
        say(f"  {e.effect}{at_named(e.joint, names)}: {'; '.join(why)}")
    say("")


def _recordings(document: DiagnosisDocument) -> None:
    """Inertial parameters of each recording alone, and whatever else differs between them."""
    if not document.recordings:
        return
    names = [r.recording for r in document.recordings]
    table = empty_table("each recording alone", *names, "unit")
    for rows in zip(*(r.parameters for r in document.recordings), strict=True):
        table.add_row(rows[0].name, *(figure(p.fit) for p in rows), unit_cell(rows[0].unit))
    lumps = {p.name for p in document.parameters}
    for apart in (p for p in document.inconsistent if p.name not in lumps):
        known = dict(zip(apart.recordings, apart.values, strict=True))
        table.add_row(apart.name, *(figure(known.get(name)) for name in names), unit_cell(apart.unit))
    show_table(table)
    apart_names = ", ".join(p.name for p in document.inconsistent)
    say(f"They disagree on {apart_names}." if apart_names else "They agree.", "")


def _limits(document: Judged) -> None:
    """Detection limits: all of them for a clean verdict, which is worth as much as they are."""
    limits = document.would_have_seen
    if not limits:
        return
    if document.verdict != "clean":
        say(f"These recordings give {len(limits)} detection limits; --report and --json list them.")
        return
    joints = sorted({s.joint for s in limits}, key=lambda joint: joint or len(limits))
    table = empty_table("detection limit", *(place(joint) for joint in joints))
    for effect in sorted({s.effect for s in limits}):
        found = {s.joint: s for s in limits if s.effect == effect}
        alike = {(s.parameter, _side(s)[0], unit_cell(s.unit)) for s in found.values()}
        if len(joints) > _MOST_COLUMNS and len(alike) == 1:
            parameter, side, of = alike.pop()
            label = f"{effect}: {parameter} {side}" + (f", {of}" if of else "")
            table.add_row(label, *(_amount(_side(found[j])[1]) if j in found else "–" for j in joints))
        else:
            table.add_row(effect, *(_limit(found.get(joint)) for joint in joints))
    show_table(table)
    say(f"For example, {_sentence(limits[0])} would have been found; a weaker effect may be present.")
    if len(joints) > _MOST_COLUMNS:
        say("The values assumed for the other parameters are in --json and --report.")


def _side(limit: LimitEntry) -> tuple[str, float]:
    below = given(limit.below)
    return (">", given(limit.above) or 0.0) if below is None else ("<", below)


def _sentence(limit: LimitEntry) -> str:
    side, value = _side(limit)
    than = {"<": "less", ">": "more"}[side]
    where = f"{limit.effect}{at_joint(limit.joint)}"
    text = f"{where} with {limit.parameter} {than} than {_amount(value)} {unit_cell(limit.unit)}"
    assumed = ", ".join(f"{name} {figure(x)}" for name, x in limit.assumed.items())
    return text.rstrip() + (f" (and {assumed}, in SI)" if assumed else "")


def _amount(value: float) -> str:
    """Two digits; of a factor as many as distinguish it from 1, at which there is no effect."""
    return told_apart(value, 1.0) if f"{value:.2g}" == "1" else f"{value:.2g}"


def _limit(limit: LimitEntry | None) -> str:
    if limit is None:
        return "–"
    side, value = _side(limit)
    assumed = ", ".join(f"{name} {x:.2g}" for name, x in limit.assumed.items() if x)
    text = f"{limit.parameter} {side} {_amount(value)} {unit_cell(limit.unit)}".rstrip()
    return text + (f" ({assumed})" if assumed else "")


def _warnings(warnings: Sequence[str]) -> None:
    say(*(f"Warning: {warning}" for warning in warnings))


def _commands(document: Judged) -> None:
    if document.improved_model:
        say("", f"The improved model is in {document.improved_model}.")
    if document.commands:
        say("", "Next:")
    for command in document.commands:
        say(f"  {command.command}", f"      {command.what}")


def _finding(finding: FindingEntry, document: Judged, findings: Sequence[FindingEntry]) -> None:
    """An effect that was named, and the candidates that were not; findings: all of them."""
    evidence, names = finding.evidence, _names(document.joints)
    twist = given(evidence.twist)
    before, after = (finding.rms_before, finding.rms_after) if twist is None else (twist.rms_before, twist.rms_after)
    what = "residual" if twist is None else f"twist by the link-side encoder, {twist.unit},"
    say(
        f"{finding.effect}{at_named(finding.joint, names)}: {what} {figure(before)} -> {figure(after)}, "
        f"{percent(finding.share)} of what was missing."
    )
    if finding.held_out_before is not None:
        say(f"  held out: {figure(finding.held_out_before)} -> {figure(finding.held_out_after)}")
    _values(finding.parameters)
    torque = document.joints[(finding.joint or 1) - 1].unit
    own = f"{evidence.eff:.3g} {torque}" if twist is None else f"{twist.eff:.3g} {twist.unit}"
    say(
        f"  evidence: it alone explains {own}; BIC {fall(evidence.delta_bic)}, "
        f"the cross-validated squared error {fall(evidence.cv_gain, percent)}"
    )
    named = {*((f.effect, f.joint) for f in findings), *((r.effect, r.joint) for r in finding.rivals)}
    others = [
        e
        for e in finding.ranking
        if (e.effect, e.joint) not in named
        and (e.joint in (None, finding.joint) or finding.joint is None)
        and e.evidence.share_of_excess > _LEAST_SHARE
    ]
    say(*(_set_aside(entry, finding, names) for entry in others[:_MOST_CANDIDATES]))
    if finding.rivals:
        rivals = ", ".join(f"{r.effect}{at_named(r.joint, names)}" for r in finding.rivals)
        say(f"  these data cannot separate it from {rivals}", f"  motion that would: {finding.experiment}")
        signals = [f"{s.signal} (from {', '.join(s.rivals)})" for s in finding.missing_signals]
        say(*(["  signals that would, if recorded: " + ", ".join(signals)] if signals else []))
    if finding.remainder:
        say(f"  left over: {finding.remainder}")
    say("")


def _failed(evidence: EvidenceEntry) -> list[str]:
    """Why a candidate was not named by its own figures; that its parameters cost more than it explains is enough."""
    if evidence.failed_gates and evidence.delta_bic < 0:
        return [f"it does not earn its parameters: with it, BIC {fall(evidence.delta_bic)}"]
    return evidence.failed_gates


def _set_aside(other: RankedCandidate, finding: FindingEntry, names: Names) -> str:
    """A candidate that would explain something by itself, and why the finding was named instead."""
    evidence, better = other.evidence, finding.evidence.delta_bic - other.evidence.delta_bic
    if failed := _failed(evidence):
        why = failed[0]
    elif better > 0:
        why = f"BIC prefers {finding.effect} by {better:.0f}"
    else:
        why = "with it added and everything refitted, the error falls less"
    share = percent(min(evidence.share_of_excess, 1.0))
    where = f"{other.effect}{at_named(other.joint, names)}"
    return f"  rather than {where}, which by itself would explain {share} of what was missing, but {why}"


def _draft(draft: DraftEntry, names: Names) -> None:
    """A guess at what no effect explains."""
    say(
        f"A guess{at_named(draft.joint, names)}, no law: {draft.effect} = {draft.equation}",
        f"  residual {figure(draft.rms_before)} -> {figure(draft.rms_after)} {draft.unit} (noise floor "
        f"{figure(draft.floor)}), {percent(draft.share)} of what was missing.",
    )
    _values(draft.parameters)
    say(f"  written to {draft.file}; see whether the error falls with it, then add it:")
    say(*(f"    {command}" for command in draft.next), "")


def _values(parameters: Mapping[str, EstimateEntry]) -> None:
    for name, p in parameters.items():
        say(f"  {name} = {figure(p.value)} {unit_cell(p.unit)}".rstrip() + interval(p))


def _errors_by_step(document: ImprovementDocument) -> None:
    """A row a model, the joints' errors one after the other in its cells."""

    def cell(values: Sequence[float | None] | None, show: Callable[[float | None], str]) -> str:
        return "–" if values is None else ", ".join(map(show, values))

    held = any(step.held_out for step in document.history)
    table = empty_table("model", "error", "rms", *(["held-out error", "held-out rms"] if held else []))
    for step in document.history:
        row = [_model(step), cell(step.relative, percent), cell(step.rms, figure)]
        if held:
            row += [cell(step.held_out_relative, percent), cell(step.held_out, figure)]
        table.add_row(*row)
    show_table(table)
    floors = [(j.joint, j.floor, j.floor_source) for j in document.joints]
    held_out = [(j.joint, j.floor, j.floor_source) for j in given(document.held_out_floors) or []]
    for text, entries in (("Noise floor (rms)", floors), ("  held out", held_out)):
        if entries:
            each = ", ".join(f"joint {joint} {figure(floor)} ({source})" for joint, floor, source in entries)
            say(f"{text}: {each}.")


def _errors_by_joint(document: ImprovementDocument) -> None:
    """A row a joint, a column a model; what was held out in a table of its own."""
    joints, names, history = document.joints, _names(document.joints), document.history
    fitted = [(step, step.relative, step.rms) for step in history]
    held = [(s, s.held_out_relative, s.held_out) for s in history if s.held_out_relative and s.held_out]
    floors = [(j.floor, j.floor_source) for j in joints]
    held_floors = [(j.floor, j.floor_source) for j in given(document.held_out_floors) or []]
    for title, steps, least in (("error, rms", fitted, floors), ("held out", held, held_floors)):
        if not least:
            continue
        table = empty_table(title, *(_model(step) for step, *_ in steps), "noise floor")
        for i, (joint, (floor, source)) in enumerate(zip(joints, least, strict=True)):
            cells = [f"{percent(relative[i])}, {figure(rms[i])}" for _, relative, rms in steps]
            table.add_row(joint_cell(joint.joint, names), *cells, f"{figure(floor)} {unit_cell(joint.unit)} ({source})")
        show_table(table)


def _model(step: HistoryEntry) -> str:
    return f"+ {step.added}" if step.added else "as in the file"


def _refit(before: FitDocument, after: FitDocument, names: Names) -> None:
    """Every parameter as the file has it, fitted without and with what was added."""
    names = {} if is_narrow() else names
    table = empty_table("joint", "parameter", "file", "before", "after", "95 % interval", "unit")
    earlier = {(p.joint, p.name): p.fit for p in before.inertial}
    for p in after.inertial:
        values = [figure(p.model), figure(earlier.get((p.joint, p.name))), figure(p.fit)]
        table.add_row(joint_cell(p.joint, names), p.name, *values, interval(p, ""), unit_cell(p.unit))
    fits = [{(e.name, e.joint): e.parameters for e in fit.effects} for fit in (before, after)]
    for effect, joint in dict.fromkeys([*fits[0], *fits[1]]):
        old, new = (fit.get((effect, joint), {}) for fit in fits)
        for name in dict.fromkeys([*old, *new]):
            last = new.get(name) or old[name]
            values = [figure(fit[name].value) if name in fit else "–" for fit in (old, new)]
            cells = ["–", *values, interval(last, "") if name in new else "–", unit_cell(last.unit)]
            table.add_row(joint_cell(joint, names), f"{effect}: {name}", *cells)
    show_table(table)
