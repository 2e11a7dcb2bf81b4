"""The page of a result of the loop, as sections with figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from msgspec import UNSET

from runtime.diagnosis.steps import Step, remainder, seconds_moving
from runtime.documents.diagnosis import HistoryEntry
from runtime.documents.fits import CompareDocument, JointEntry
from runtime.documents.parts import given
from runtime.documents.provenance import Provenance
from runtime.identification.compare import as_written, structure_entries, structure_shares
from runtime.identification.identify import fit_document
from runtime.model.terms import Term
from runtime.motion import spectra
from runtime.motion.settings import MORE_THAN_NOISE
from runtime.plain_json import plain
from runtime.report import diagnosed, findings, fits, loop, origin, reasons, replays
from runtime.report.diagnosed import finding_entry, ranking_entries
from runtime.report.findings import Context
from runtime.report.fits import Names
from runtime.report.page import page_figures as figures
from runtime.report.page.html import ReportPage, add_figures, embedded, part
from runtime.report.page.moving import of_result
from runtime.report.page.page_figures import drawn
from runtime.report.sections import Bullets, Commands, Facts, Group, Paragraph, Plots, Section, table, texts, words
from runtime.report.signals import joint_signals
from runtime.report.summary import Result, ResultSummary
from runtime.wording import number, numbered, percent, quantity, sentence, times_floor

TAGS = {
    "effect": "effect found",
    "more": "effect found, more is left",
    "clean": "clean",
    "unexplained": "unexplained",
    "refused": "refused",
    "comparison": "comparison",
}


_LONGEST_HEADLINE = 120
"""characters: two lines of the page"""


def write_report(directory: Path, result: Result | ResultSummary) -> Path:
    """Write `report.html` into a directory, which is made if it is not there. Raises OSError."""
    return report(result).write(directory)


def report(result: Result | ResultSummary) -> ReportPage:
    """The page of a comparison, a diagnosis or the whole loop."""
    summary = result if isinstance(result, ResultSummary) else ResultSummary(result)
    answer = verdict(summary)
    drawings: dict[str, Markup] = {}
    moving = of_result(summary)
    groups = [_errors(summary, drawings)]
    if moving is not None:
        drawings["moving"] = part("arm_motion.html.j2", "arm_motion", moving)
        groups.append(Group("The arm in motion", (Plots(("moving",)),), "motion"))
    if played := replays.errors(summary.replays):
        groups.append(Group("The model in motion", tuple(played), "replay"))
    groups += [_joint(summary, i, drawings) for i in summary.joint_order]
    groups += [
        *_findings(summary, drawings),
        *diagnosis_groups(summary),
        _parameters(summary),
        *_limits(summary),
        *_adding(summary),
        _recorded(summary),
    ]
    if warnings := texts(summary.document.warnings, "warning"):
        groups.append(Group(f"Warnings ({len(warnings)})", tuple(warnings), "warnings"))
    name = summary.first.fit.model.name
    provenance = given(summary.document.provenance)
    groups += origin_group(provenance)
    headline, further = headline_of(answer.sentence)
    return ReportPage(
        title=f"{name}: {answer.tag}",
        model=name,
        kind=answer.kind,
        tag=answer.tag,
        made="" if provenance is None else origin.made(provenance),
        headline=headline,
        short=[*further, *texts(filter(None, [answer.more])), *_short(summary)],
        groups=groups,
        drawings=drawings,
        document=plain(summary.document),
    )


def origin_group(provenance: Provenance | None) -> list[Group]:
    """What a result was made from, if it says so."""
    return [] if provenance is None else [Group("What it was made from", tuple(origin.sections(provenance)), "origin")]


def headline_of(reason: str) -> tuple[str, list[Section]]:
    """A reason as a sentence; of a long one the first clause, and below it a second sentence and the other clauses."""
    if len(reason) <= _LONGEST_HEADLINE:
        return sentence(reason), []
    whole, _, second = reason.removesuffix(".").partition(". ")
    first, *others = whole.split("; ")
    return sentence(first), [*texts([f"{second}."] if second else []), *([Bullets(tuple(others))] if others else [])]


class PageVerdict(NamedTuple):
    """The answer at the head of a page: its kind, that in words, a sentence, and a second one or ""."""

    kind: str
    tag: str
    sentence: str
    more: str


def verdict(summary: ResultSummary) -> PageVerdict:
    """The verdict, or where the model fails."""
    diagnosis = summary.diagnosis
    if diagnosis is None:
        return PageVerdict("comparison", TAGS["comparison"], _compared(summary), "")
    document = summary.document
    assert not isinstance(document, CompareDocument)
    kind = "more" if summary.more_is_left else document.verdict
    return PageVerdict(kind, TAGS[kind], sentence(document.reason), " ".join(loop.peaks(document)))


def _compared(summary: ResultSummary) -> str:
    parts, every = [], summary.first.joints
    loud = [s for s in every if len(every) == 1 or not s.at_floor]
    for s in loud:
        text = (
            f"joint {numbered(s.joint, s.name)}: the fitted model misses {percent(s.relative)} of the torque, "
            f"{number(times_floor(s.rms, s.floor.value), 2)} times the noise floor"
        )
        strongest = max(structure_shares(s).items(), key=lambda item: item[1], default=("", 0.0))
        if strongest[1] > 0.1:
            text += f"; {percent(strongest[1], 0)} of what it misses follows {strongest[0]}"
        parts.append(text)
    if not loud:
        return "The residual of every joint is at its noise floor."
    if quiet := len(every) - len(loud):
        one = "the other joint is at its noise floor"
        parts.append(one if quiet == 1 else f"the other {quiet} joints are at their noise floors")
    return sentence("; ".join(parts))


def _short(summary: ResultSummary) -> list[Section]:
    """Errors and floors, where the improved model is, and what to type next."""
    improved = getattr(summary.document, "improved_model", None)
    if len(summary.first.joints) == 1:
        made: list[Section] = [Facts(tuple(_facts(summary, 0)), large=True)]
    else:
        facts = [dict(_facts(summary, i)) for i in range(len(summary.first.joints))]
        names = list(dict.fromkeys(name for own in facts for name in own))
        rows = [(summary.called(i), *(own.get(name, "–") for name in names)) for i, own in enumerate(facts)]
        made = [table(("joint", *names), rows)]
    if improved:
        return [*made, Paragraph(f"The improved model is in {improved}.")]
    return [*made, Commands(tuple([*summary.copying(), *summary.adding()] or summary.drafting()[:1]))]


def _facts(summary: ResultSummary, joint: int) -> list[tuple[str, str]]:
    """Errors of a joint (0-based) before and after, and its floors."""
    first, last = summary.first, summary.last

    def fall(before: float, after: float) -> str:
        return " → ".join(dict.fromkeys((percent(before), percent(after))))

    facts = [("error", fall(first.fitted.relative[joint], last.fitted.relative[joint]))]
    facts.append(("noise floor", percent(summary.floor(joint))))
    floor = last.joints[joint].floor
    unexplained = summary.left is not None and joint in summary.left.unexplained
    if unexplained and floor.value > MORE_THAN_NOISE * floor.spectrum:
        facts.append(("noise of the instruments alone", percent(summary.floor(joint) * floor.spectrum / floor.value)))
    if first.held_out is not None and last.held_out is not None:
        facts.append(("error, held out", fall(first.held_out.relative[joint], last.held_out.relative[joint])))
        if (held := summary.held_out_floor(joint)) is not None:
            facts.append(("noise floor, held out", percent(held)))
    return facts


def history(summary: ResultSummary) -> list[HistoryEntry]:
    """The errors after each step."""
    return [
        HistoryEntry(
            added=None if step.added is None else str(step.added),
            rms=list(step.fitted.rms),
            relative=list(step.fitted.relative),
            held_out=None if step.held_out is None else list(step.held_out.rms),
            held_out_relative=None if step.held_out is None else list(step.held_out.relative),
            finding=UNSET,
        )
        for step in summary.steps
    ]


def _entries(step: Step) -> list[JointEntry]:
    return [series.document() for series in step.joints]


def _names(summary: ResultSummary) -> Names:
    return fits.names_of(_entries(summary.first))


def _quiet(summary: ResultSummary) -> list[int]:
    joints = range(len(summary.first.joints))
    return [i + 1 for i in joints if len(joints) > 1 and summary.at_floor(i)]


def _said_of_quiet(summary: ResultSummary, joint: int) -> str:
    if joint + 1 not in _quiet(summary):
        return ""
    if not summary.moves(joint):
        return "it never moves, and nothing of it is compared"
    return f"at its noise floor, error {percent(summary.last.fitted.relative[joint])}"


def _errors(summary: ResultSummary, drawings: dict[str, Markup]) -> Group:
    held = " The held-out recording is never fitted." if summary.first.held_out is not None else ""
    about = Paragraph(
        "Error: size of measured minus predicted torque over size of the measured torque, in the band that is compared."
        f"{held} A perfect model would leave the noise floor.",
        "note",
    )
    blocks: list[Section] = []
    for i in summary.joint_order:
        inside = tuple(_error_of(summary, i, drawings))
        aside = _said_of_quiet(summary, i)
        title = f"Joint {summary.called(i)}"
        blocks += (
            [Group(title, inside, folded=True if aside else None, aside=aside)]
            if len(summary.joint_order) > 1
            else inside
        )
    entries = _entries(summary.last)
    made = (about, fits.residuals(entries), *texts(fits.drives(entries)), *blocks)
    return Group("Error against the noise floor", made, "error")


def _error_of(summary: ResultSummary, joint: int, drawings: dict[str, Markup]) -> list[Section]:
    first, series = summary.first, summary.last.joints[joint]
    written, floor, of = as_written(first.fit), series.floor, series.force_unit
    steps = history(summary)
    sizes = ((fits.step_name(step), times_floor(step.rms[joint], floor.value)) for step in steps)
    times = "; ".join(f"{name} {number(size, 3)} × noise floor" for name, size in sizes)
    lines = [
        f"Noise floor: {quantity(floor.value, of)} ({percent(summary.floor(joint))} of the torque), from "
        f"{fits.SOURCES[floor.source]}; noise of the instruments alone: {quantity(floor.spectrum, of)}.",
        f"Residual: {times}.",
    ]
    relative = summary.held_out_floor(joint)
    if relative is not None:
        held = summary.held_out_floors[joint]
        lines.append(
            f"Noise floor of the held-out recording: {quantity(held.value, of)} ({percent(relative)}), from "
            f"{fits.SOURCES[held.source]}."
        )
    caption = f"Error of joint {joint + 1} after each step; the marks across the bars are the noise floor."
    error = drawn(figures.error(summary.steps, joint, relative), f"error{joint + 1}", caption)
    shares = figures.structure(first, summary.last, joint)
    names = add_figures(drawings, [error, *([shares] if shares else [])], f"error{joint + 1}")
    none = "The residual follows none of the signals: on average it depends on no position, velocity, acceleration, "
    none += "load, temperature or time."
    return [
        fits.errors_of_joint(steps, _entries(summary.last)[joint], None if written is None else written[joint]),
        *texts(lines, "note"),
        Plots(names),
        *([] if shares else [Paragraph(none, "note")]),
    ]


def _joint(summary: ResultSummary, joint: int, drawings: dict[str, Markup]) -> Group:
    first, last = summary.first, summary.last
    aside, own = _said_of_quiet(summary, joint), summary.findings_at(joint)
    names = add_figures(drawings, figures.of_joint(first, last, joint, own), f"joint{joint + 1}")
    if not aside and summary.moves(joint):
        added = " + ".join(dict.fromkeys(f.term.effect for f in own))
        numbers = embedded(joint_signals.of_joint(first, last, joint, added).embedded())
        drawings[f"signals{joint + 1}"] = part("arm_motion.html.j2", "signals", Markup(numbers))
    lines = "before (orange) and after (blue)" if last is not first else ""
    legend = (
        f"Dots: residual, sample by sample. Lines: its running mean {lines}; + and − are the two directions of motion. "
        "Grey band: the noise floor, ± one standard deviation."
    )
    if own:
        legend += " Dashed line: the torque that the added effects explain, with all parameters refitted."
    effects = " and ".join(dict.fromkeys(f.term.effect for f in own))
    title = f"Joint {summary.called(joint)}" + (f": {effects} added" if own and not aside else "")
    inside = (Paragraph(legend, "note"), Plots(names), Plots((f"signals{joint + 1}",)))
    return Group(title, inside, f"joint{joint + 1}", folded=True if aside else None, aside=aside)


# --- findings, for the page and the studio ---


def context(summary: ResultSummary) -> Context:
    """The joints of a result, with the noise floors of the best model."""
    places = {j.joint: j for j in _entries(summary.last)}
    return Context(places, {(f.term.effect, f.term.joint) for f in summary.findings})


def finding_title(summary: ResultSummary, number_: int) -> str:
    """A finding with its joint."""
    return _called(summary, summary.findings[number_].term)


def _called(summary: ResultSummary, term: Term) -> str:
    return f"{term.effect}{fits.at_named(term.joint, _names(summary))}"


def finding_card(summary: ResultSummary, number_: int, names: Sequence[str] = ()) -> list[Section]:
    """A finding in full, with the command that adds it; names: of its figures."""
    assert summary.diagnosis is not None
    entry = finding_entry(summary.diagnosis, summary.findings[number_])
    info = summary.diagnosis.model.library.effects[entry.effect]
    adding = Commands((summary.adding()[number_],))
    return [*findings.card(entry, context(summary), info, names), adding]


def _findings(summary: ResultSummary, drawings: dict[str, Markup]) -> list[Group]:
    if not summary.findings:
        return []
    about = Paragraph(
        "A candidate is judged by the torque that only it explains beside the fitted model, and by its score: the gain "
        "of the log-likelihood on whitened residuals over the dispersion, which is 1 where its law is right and the "
        "noise white. The score must exceed the price of having searched. It must pass all gates.",
        "note",
    )
    cards: list[Section] = [about]
    effects = summary.first.fit.model.library.effects
    for k, finding in enumerate(summary.findings):
        alone = len(summary.findings_at(finding.joint_index)) == 1
        own = figures.of_finding(finding, effects[finding.term.effect], f"finding{k + 1}", alone)
        names = add_figures(drawings, own, f"finding{k + 1}")
        cards.append(Group(f"{k + 1}. {finding_title(summary, k)}", tuple(finding_card(summary, k, names))))
    return [Group("Findings", tuple(cards), "findings")]


def diagnosis_groups(summary: ResultSummary) -> list[Group]:
    """What a diagnosis says beside its findings, for the page and the studio."""
    groups = []
    if made := experiments(summary):
        groups.append(Group("The experiment that would decide", tuple(made), "experiment"))
    if made := left_over(summary):
        guess = Paragraph("A guess at a term that explains most of it, as a declaration to read, correct and try:")
        commands = tuple(summary.drafting())
        further: list[Section] = [guess, Commands(commands)] if commands else []
        groups.append(Group("What is left unexplained", (*made, *further), "left-over"))
    if made := to_record(summary):
        groups.append(Group("What to record", tuple(made), "record"))
    if made := not_named(summary):
        title = "Not named beside them" if summary.findings else "Considered, and not named"
        groups.append(Group(title, tuple(made), "ruled-out"))
    return groups


def experiments(summary: ResultSummary) -> list[Section]:
    """The motions that separate each finding from its rivals."""
    if summary.diagnosis is None:
        return []
    separating = iter(summary.separating())
    commands = [[next(separating) for _ in f.rivals] for f in summary.findings]
    entries = [finding_entry(summary.diagnosis, f) for f in summary.findings]
    effects = summary.diagnosis.model.library.effects
    return findings.experiments(entries, effects, commands, context(summary))


def left_over(summary: ResultSummary) -> list[Section]:
    """What is known of the residual of every joint where nothing explains it."""
    if summary.left is None:
        return []
    made: list[Section] = []
    step = summary.left.last
    for i in summary.left.unexplained:
        series, what = step.joints[i], remainder(step, i)
        follows = fits.structure(series.document(), structure_entries(series))
        none = "The residual follows none of the signals that were recorded."
        said = reasons.of_joint(summary.left, summary.left.joints[i]) if what is None else reasons.left_over(what)
        inside = tuple(texts([sentence(said), follows or none, _line(step, i)]))
        made += [Group(f"Joint {summary.called(i)}", inside)] if len(step.joints) > 1 else inside
    return made


def unexplained_joints(summary: ResultSummary) -> list[int]:
    """Joints (from 1) whose residual nothing explains."""
    return [] if summary.left is None else [i + 1 for i in summary.left.unexplained]


def _line(step: Step, joint: int) -> str:
    residual, motion = step.fit.residual[joint], step.fit.motion
    line = spectra.strongest_line(residual, motion.row_rate(joint))
    if line is None:
        return "No line stands out in its spectrum."
    return (
        f"Strongest line of its spectrum: {line.frequency:.2f} Hz, with {percent(line.share, 0)} of its power. Look "
        "for something that turns, switches or rings at that frequency."
    )


def to_record(summary: ResultSummary) -> list[Section]:
    """The motions that determine what the data leave open, where the verdict is "refused"."""
    if summary.left is None or summary.left.verdict != "refused":
        return []
    effects = summary.left.model.library.effects
    values = summary.last.fit.inference.values
    tangled = [term for term, own in values.items() if any(e.with_others for e in own.values())]
    rows = [(_called(summary, t), effects[t.effect].experiment) for t in tangled or values]
    about = (
        "Slow and fast, in both directions, over the whole range of positions, and the same motion twice: repeats give "
        "the noise floor. These motions determine what the data leave open:"
    )
    return [Paragraph(about), table((words("effect in the model"), words("motion that brings it out")), rows)]


def not_named(summary: ResultSummary) -> list[Section]:
    """The candidates at the end of the search, and why none of them was named."""
    if summary.diagnosis is None:
        return []
    ranked = ranking_entries(summary.diagnosis.ranking, summary.diagnosis.model)
    return findings.not_named(ranked, summary.last.held_out is not None, context(summary))


def limits(summary: ResultSummary) -> list[Section]:
    """Detection limits of every joint."""
    if summary.left is None:
        return []
    return findings.limits_by_joint(summary.left.seen, summary.left.model, _names(summary), _quiet(summary))


# --- the rest of the page ---


def _limits(summary: ResultSummary) -> list[Group]:
    made = limits(summary)
    beside = " beside the findings" if summary.findings else ""
    about = f"Effects of this size would have been found in these recordings{beside}; a weaker effect may be present."
    return [Group("Detection limits", (Paragraph(about, "note"), *made), "limits")] if made else []


def _parameters(summary: ResultSummary) -> Group:
    first, last = summary.first.fit, summary.last.fit
    after, before = fit_document(last), None if first is last else fit_document(first)
    model, names, quiet = last.model, _names(summary), _quiet(summary)
    meanings: dict[tuple[str, str], str] = {("", lump.name): lump.meaning for lump in model.lumps}
    for term in last.inference.values:
        info = model.library.effects[term.effect]
        meanings |= {(term.name, p.name): p.meaning for p in (*info.parameters, *info.coefficients)}
    made: list[Section] = [
        Paragraph("Value ± half of the 95 % interval, which accounts for correlated residuals.", "note")
    ]
    made += fits.parameters_by_joint(after, before, names, meanings=meanings, quiet=quiet)
    if after.uncorrected is not None:
        earlier = None if before is None else before.uncorrected
        inside = tuple(fits.parameters_by_joint(after.uncorrected, earlier, names, meanings=meanings, quiet=quiet))
        made.append(Group("Without skew correction, standstill included", inside, folded=True))
    if summary.left is not None:
        alone = fits.recordings_alone(diagnosed.document(summary.left))
        made += [Group("Each recording alone", tuple(alone))] if alone else []
    return Group("Parameters", tuple(made), "parameters")


def _adding(summary: ResultSummary) -> list[Group]:
    commands = [*summary.copying(), *summary.adding(), *summary.refitting()]
    if not commands:
        return []
    improved = getattr(summary.document, "improved_model", None)
    lines = [f"{improved} holds the effects with their values. By hand, in the model as it was:"] if improved else []
    where = "In the folder in which this report was asked for:" if summary.given else "With the names of your files:"
    follow = Commands(tuple(commands))
    return [Group("Put it into the model", (*texts(lines), Paragraph(where, "note"), follow), "commands")]


def _recorded(summary: ResultSummary) -> Group:
    fit, document = fit_document(summary.last.fit), summary.document
    about = summary.invocation.about
    rows = [_range_of(summary, i) for i in range(len(summary.first.joints))]
    heads = ("moving for", "position", "speed up to", "acceleration up to", "temperature", "repeated")
    caption = "Range of motion, while moving and in the band"
    return Group(
        "Recordings, band and skew",
        (
            *texts([f"From the model file: {about}"] if about else [], "note"),
            table(("joint", *heads), rows, caption),
            *fits.basis(fit.band, fit.skew),
            *fits.delays(fit.delay),
            *texts(loop.sensors(document)),
        ),
        "method",
    )


def _range_of(summary: ResultSummary, joint: int) -> tuple[str, ...]:
    """The range of motion of a joint, on the rows that are compared."""
    series, motion = summary.first.joints[joint], summary.first.fit.motion
    of = series.position_unit
    ranges = ("–", "–", "–")
    if len(series.t):
        ranges = (
            f"{number(series.q.min(), 3)} … {number(series.q.max(), 3)} {of}",
            quantity(float(np.abs(series.qd).max()), f"{of}/s", 3),
            quantity(float(np.abs(series.qdd).max()), f"{of}/s^2", 3),
        )
    warmth = "not measured" if series.warmth is None else f"rises {number(float(np.ptp(series.warmth)), 2)} K"
    repeated = "no" if series.floor.repeating is None else "yes"
    moving = f"{number(seconds_moving(motion, joint), 3)} s"
    return (f"joint {summary.called(joint)}", moving, *ranges, warmth, repeated)
