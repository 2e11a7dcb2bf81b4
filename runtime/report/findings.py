"""Sections of a diagnosis: its findings with their evidence, the candidates that were not named and why, what is left.

A finding is shown on the terminal in a few lines (`brief`), and on a page in full (`card`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

from runtime.diagnosis.detection_limits import Limit
from runtime.documents.diagnosis import (
    CommandEntry,
    DiagnosisBase,
    DraftEntry,
    EvidenceEntry,
    FindingEntry,
    LimitEntry,
    RankedCandidate,
)
from runtime.documents.fits import JointEntry
from runtime.documents.parts import EffectAt, EstimateEntry, given
from runtime.model.catalogue import EffectInfo
from runtime.model.loader import Model
from runtime.model.terms import unit_of
from runtime.report.fits import Names, at_named, names_of
from runtime.report.sections import (
    Bullets,
    Cell,
    Commands,
    Facts,
    Group,
    Paragraph,
    Plots,
    Section,
    TableColumn,
    TableSection,
    table,
    texts,
    words,
)
from runtime.wording import number, percent, quantity, sentence, times_floor, told_apart, unit, whole
from symbolic.model_file.checks import at_joint

_NOTHING = 0.05
"""Part of the noise floor below which a candidate's own torque is negligible, whatever its other figures."""
_LEAST_GAIN = 0.05
"""Part of a finding's gain; a candidate in its place that gains less is not listed on the terminal."""
_MOST_CANDIDATES = 3
"""Candidates listed on the terminal."""
_MOST_COLUMNS = 3
"""Joints side by side in a table of detection limits; with more, the parameter is named once a row."""


Placed = EffectAt | FindingEntry | RankedCandidate
"""An effect at a joint."""


class Context(NamedTuple):
    """The joints of a result by number, with their noise floors and units; `also`: all effects that were named."""

    places: Mapping[int, JointEntry]
    also: Collection[tuple[str, int | None]] = ()

    @property
    def names(self) -> Names:
        """Names of the joints by number."""
        return names_of(self.places.values())

    def at(self, candidate: Placed, finding: Placed | None = None) -> JointEntry:
        """The joint at which a candidate is judged: its own, or that of the finding it competes with."""
        joint = candidate.joint or (finding.joint if finding else None) or 1
        return self.places[joint]

    def called(self, effect: Placed) -> str:
        """An effect with its joint."""
        return f"{effect.effect}{at_named(effect.joint, self.names)}"


def key(effect: Placed) -> tuple[str, int | None]:
    """An effect and its joint, to compare."""
    return effect.effect, effect.joint


# --- findings ---


def lead(finding: FindingEntry, context: Context) -> str:
    """How far a finding lowers the residual."""
    twist = given(finding.evidence.twist)
    before, after = (finding.rms_before, finding.rms_after) if twist is None else (twist.rms_before, twist.rms_after)
    what = "residual" if twist is None else "twist by the link-side encoder"
    of = context.at(finding).unit if twist is None else twist.unit
    return (
        f"{context.called(finding)}: {what} {number(before)} → {quantity(after, of)}, "
        f"{percent(finding.share)} of what was missing."
    )


def brief(finding: FindingEntry, context: Context) -> list[Section]:
    """A finding in a few lines: its values and evidence, and the strongest candidates beside it."""
    values = [valued(name, p) for name, p in finding.parameters.items()]
    items = [*_mounting(finding), *_held_out(finding, context), *values]
    rivals = {key(r) for r in finding.rivals}
    others = [
        e
        for e in finding.ranking
        if key(e) not in context.also
        and key(e) not in rivals
        and (e.joint in (None, finding.joint) or finding.joint is None)
        and e.evidence.gain > _LEAST_GAIN * finding.evidence.gain
    ]
    why = [f"{context.called(e)} {in_place_of(e, finding, context)}" for e in others[:_MOST_CANDIDATES]]
    left = [f"left over: {finding.remainder}"] if finding.remainder else []
    return [
        Paragraph(lead(finding, context)),
        Bullets(tuple(items)),
        evidence(finding.evidence, context.at(finding)),
        Bullets((*why, *_rivals(finding, context), *left)),
        Paragraph(""),
    ]


def card(finding: FindingEntry, context: Context, info: EffectInfo, figures: Sequence[str]) -> list[Section]:
    """A finding in full: law, values, evidence, figures, rivals, and every candidate for its place."""
    values = tuple(valued(name, p, info.parameter(name).meaning) for name, p in finding.parameters.items())
    rivals = texts(map(sentence, _rivals(finding, context)))
    none = Paragraph("No rival: no other candidate that passes the gates explains the data as well.")
    return [
        Paragraph(info.summary),
        Paragraph(f"torque = {info.equation}", "code"),
        Paragraph(lead(finding, context)),
        *texts(map(sentence, [*_mounting(finding), *_held_out(finding, context)])),
        Bullets(values),
        evidence(finding.evidence, context.at(finding)),
        *([Plots(tuple(figures))] if figures else []),
        *(rivals or [none]),
        *_candidates(finding, context),
        *([Paragraph(f"What remains: {finding.remainder}.", "warning")] if finding.remainder else []),
        Paragraph(f"Literature: {info.source}", "note"),
    ]


def _mounting(finding: FindingEntry) -> list[str]:
    said = given(finding.mounting)
    return [] if said is None else [said]


def _held_out(finding: FindingEntry, context: Context) -> list[str]:
    if finding.held_out_before is None or finding.held_out_after is None:
        return []
    after = quantity(finding.held_out_after, context.at(finding).unit)
    return [f"held out: {number(finding.held_out_before)} → {after}"]


def _rivals(finding: FindingEntry, context: Context) -> list[str]:
    """The effects that the data cannot separate from a finding, and what would."""
    if not finding.rivals:
        return []
    lines = [
        f"these data cannot separate it from {', '.join(map(context.called, finding.rivals))}",
        f"motion that would: {finding.experiment}",
    ]
    signals = [f"{s.signal} (from {', '.join(s.rivals)})" for s in finding.missing_signals]
    return lines + ([f"signals that would, if recorded: {', '.join(signals)}"] if signals else [])


def valued(name: str, p: EstimateEntry, meaning: str = "") -> str:
    """A parameter with its value and 95 % interval."""
    text = f"{name} = {number(p.value)}{unit(p.unit, ' ')}{interval(p)}"
    return f"{text}: {meaning}" if meaning else text


def interval(p: EstimateEntry) -> str:
    """A 95 % interval and the parameters from which a value is inseparable, to follow the value."""
    text = f", 95 % in [{number(p.interval[0])}, {number(p.interval[1])}]" if p.interval else ""
    others = given(p.inseparable_from)
    return f"{text}, only together with {', '.join(others)}" if others else text


def evidence(weighed: EvidenceEntry, place: JointEntry) -> Facts:
    """What speaks for a candidate."""
    twist = given(weighed.twist)
    own = _own(weighed, place) if twist is None else quantity(twist.eff, twist.unit, 3)
    facts = (
        (f"{'torque' if twist is None else 'twist'} that only it explains", own),
        ("gain of the log-likelihood", whole(weighed.gain)),
        ("dispersion", number(weighed.dispersion, 3)),
        ("score", f"{whole(weighed.score)}, for a price of {whole(weighed.price)}"),
    )
    return Facts(facts)


def _own(weighed: EvidenceEntry, place: JointEntry) -> str:
    parts = times_floor(weighed.eff, place.floor)
    return "none" if parts < 0.005 else f"{quantity(weighed.eff, place.unit, 3)} ({number(parts, 3)} × noise floor)"


# --- candidates ---


def _candidates(finding: FindingEntry, context: Context) -> list[Section]:
    """Everything that was weighed for a finding's place, itself first."""
    named = RankedCandidate(effect=finding.effect, joint=finding.joint, evidence=finding.evidence)
    also = {k for k in context.also if k != key(finding)}
    rivals = {key(r): r for r in finding.rivals}
    rows = [_row(named, "named", "Named: it passes every gate.", place=context.at(named, finding), context=context)]
    rest = []
    for e in finding.ranking:
        if key(e) == key(finding):
            continue
        if _group(e, context.at(e, finding)) and key(e) not in also:
            rest.append(e)
            continue
        why = _as_reason(in_place_of(e, finding, context))
        rows.append(_row(e, "rival" if key(e) in rivals else "", why, place=context.at(e, finding), context=context))
    weighed = {key(e) for e in finding.ranking}
    pair = (
        f"Not ruled out: in place of {finding.effect}, beside the other findings, it fits about as well; "
        "the likelihood does not separate the two."
    )
    rows += [(Cell(context.called(r), note="rival"), *"–––––", pair) for k, r in rivals.items() if k not in weighed]
    shown = _table(rows, "Candidates for its place")
    return [TableSection(shown.columns, shown.rows, shown.caption, bold=(0,)), *_rest(rest, context, finding)]


def not_named(ranked: Iterable[RankedCandidate], held_out: bool, context: Context) -> list[Section]:
    """The candidates at the end of the search, and why none of them was named."""
    rows, rest = [], []
    for e in ranked:
        if _group(e, context.at(e)):
            rest.append(e)
        else:
            rows.append(
                _row(e, "", _as_reason(why_not_named(e, context, held_out)), place=context.at(e), context=context)
            )
    table_ = [_table(rows, "Candidates for what is left")] if rows else []
    return [*table_, *_rest(rest, context, None)]


def closest(document: DiagnosisBase, context: Context) -> list[Section]:
    """The strongest candidates that were not named, a line each."""
    sized = [(times_floor(e.evidence.eff, context.at(e).floor), e) for e in document.ruled_out]
    entries = [e for size, e in sorted(sized, key=lambda item: -item[0]) if size > _NOTHING]
    lines = [f"{context.called(e)} {why_not_named(e, context, held_out=False)}" for e in entries[:_MOST_CANDIDATES]]
    return [Paragraph("Closest candidates:"), Bullets(tuple(lines)), Paragraph("")] if lines else []


def _row(e: RankedCandidate, kind: str, why: str, place: JointEntry, context: Context) -> tuple[str | Cell, ...]:
    return (
        Cell(context.called(e), note=kind),
        _own(e.evidence, place),
        whole(e.evidence.gain),
        number(e.evidence.dispersion, 3),
        whole(e.evidence.score),
        whole(e.evidence.price),
        why,
    )


def _table(rows: Iterable[Sequence[str | Cell]], caption: str) -> TableSection:
    heads = ("torque that only it explains", "gain", "dispersion", "score", "price")
    return table((words("candidate"), *heads, words("why, or why not")), rows, caption)


def _rest(candidates: Sequence[RankedCandidate], context: Context, finding: FindingEntry | None) -> list[Section]:
    """Candidates that need no row: those that explain next to nothing, and those that gain nothing."""
    texts_ = []
    for kind, what in (
        ("unearned", "Ruled out because the likelihood gains nothing with them"),
        ("nothing", "Ruled out because they explain next to nothing that the fitted model does not"),
    ):
        own = [context.called(e) for e in candidates if _group(e, context.at(e, finding)) == kind]
        if own:
            texts_.append(Paragraph(f"{what}: {', '.join(dict.fromkeys(own))}.", "note"))
    return list(texts_)


def _group(e: RankedCandidate, place: JointEntry) -> str:
    if not e.evidence.failed_gates:
        return ""
    if e.evidence.eff < _NOTHING * place.floor:
        return "nothing"
    return "unearned" if e.evidence.score <= 0 else ""


def _failing(e: RankedCandidate, place: JointEntry) -> str:
    if _group(e, place) == "nothing":
        return "is ruled out: it explains next to nothing that the fitted model does not"
    if _group(e, place) == "unearned":
        return "is ruled out: the likelihood gains nothing with it"
    return f"is ruled out: {'; '.join(e.evidence.failed_gates)}"


def why_not_named(e: RankedCandidate, context: Context, held_out: bool) -> str:
    """Why a candidate was not added once the search had ended."""
    if not e.evidence.failed_gates:
        also = " or by the held-out recording" if held_out else ""
        return f"passes every gate, but is not borne out once everything is fitted with it{also}"
    return _failing(e, context.at(e))


def in_place_of(other: RankedCandidate, finding: FindingEntry, context: Context) -> str:
    """Why a finding was named and not another candidate, both weighed on the same residual."""
    named, weighed = finding.evidence, other.evidence
    if key(other) in context.also and key(other) != key(finding):
        return f"is named too: beside {finding.effect}, it is a finding of its own"
    if key(other) in map(key, finding.rivals):
        gains = f"gain {whole(weighed.gain)} against {whole(named.gain)}"
        return f"is not ruled out: it is as likely as {finding.effect} within what the data tell ({gains})"
    if weighed.failed_gates:
        return _failing(other, context.at(other, finding))
    if None not in (other.joint, finding.joint) and other.joint != finding.joint:
        return (
            f"is set aside: it acts at another joint, and was weighed again with {context.called(finding)} in the model"
        )
    if weighed.gain > named.gain:
        return (
            "is ruled out: it passes every gate by itself, but with it added and everything refitted, the error falls "
            f"less than with {finding.effect}"
        )
    less = f"{whole(named.gain - weighed.gain)} less than {context.called(finding)}"
    return f"is ruled out: it passes every gate by itself, but gains {less}"


def _as_reason(why: str) -> str:
    return sentence(why.removeprefix("is "))


# --- a guess ---


def draft(guess: DraftEntry, names: Names) -> list[Section]:
    """A guess at what no effect of the library explains."""
    return [
        Paragraph(f"A guess{at_named(guess.joint, names)}, no law: {guess.effect} = {guess.equation}"),
        Bullets(
            (
                f"residual {number(guess.rms_before)} → {quantity(guess.rms_after, guess.unit)} (noise floor "
                f"{number(guess.floor)}), {percent(guess.share)} of what was missing.",
                *(valued(name, p) for name, p in guess.parameters.items()),
                f"written to {guess.file}; see whether the error falls with it, then add it:",
                *(f"  {command}" for command in guess.next),
            )
        ),
        Paragraph(""),
    ]


# --- detection limits ---


def only_noise(document: DiagnosisBase) -> bool:
    """Whether all that is left at any joint is noise."""
    said = {joint.verdict for joint in document.joints}
    return document.verdict in ("clean", "effect") and said - {"refused"} == {"clean"}


def limits_table(document: DiagnosisBase) -> list[Section]:
    """All detection limits in one table where noise is left, which is only as sure as they are; else their number."""
    limits = document.would_have_seen
    if not limits:
        return []
    if not only_noise(document):
        return [Paragraph(f"These recordings give {len(limits)} detection limits; --report and --json list them.")]
    joints = sorted({s.joint for s in limits}, key=lambda joint: joint or len(limits))
    rows: list[list[str]] = []
    for effect in sorted({s.effect for s in limits}):
        found = {s.joint: s for s in limits if s.effect == effect}
        alike = {(s.parameter, _side(s)[0], s.unit) for s in found.values()}
        if len(joints) > _MOST_COLUMNS and len(alike) == 1:
            parameter, side, of = alike.pop()
            label = f"{effect}: {parameter} {side}{unit(of, ', ')}"
            rows.append([label, *(_amount(_side(found[j])[1]) if j in found else "–" for j in joints)])
        else:
            rows.append([effect, *(_limit(found.get(joint)) for joint in joints)])
    heads = ("arm" if joint is None else f"joint {joint}" for joint in joints)
    first, (side, value) = limits[0], _side(limits[0])
    than = {"<": "less", ">": "more"}[side]
    assumed = ", ".join(f"{name} {number(x)}" for name, x in first.assumed.items())
    example = (
        f"{first.effect}{at_joint(first.joint)} with {first.parameter} {than} than {_amount(value)}"
        f"{unit(first.unit, ' ')}" + (f" (and {assumed}, in SI)" if assumed else "")
    )
    made: list[Section] = [
        table(("detection limit", *heads), rows),
        Paragraph(f"For example, {example} would have been found; a weaker effect may be present."),
    ]
    if len(joints) > _MOST_COLUMNS:
        made.append(Paragraph("The values assumed for the other parameters are in --json and --report."))
    return made


def _side(limit: LimitEntry) -> tuple[str, float]:
    below = given(limit.below)
    return (">", given(limit.above) or 0.0) if below is None else ("<", below)


def _amount(value: float) -> str:
    return told_apart(value, 1.0) if number(value, 2) == "1" else number(value, 2)


def _limit(limit: LimitEntry | None) -> str:
    if limit is None:
        return "–"
    side, value = _side(limit)
    assumed = ", ".join(f"{name} {number(x, 2)}" for name, x in limit.assumed.items() if x)
    text = f"{limit.parameter} {side} {_amount(value)}{unit(limit.unit, ' ')}"
    return text + (f" ({assumed})" if assumed else "")


def limits_by_joint(seen: Sequence[Limit], model: Model, names: Names, quiet: Iterable[int]) -> list[Section]:
    """Detection limits in full, a table a joint and one of the whole arm; quiet: joints that are folded away."""
    effects = model.library.effects
    ordered = sorted(seen, key=lambda limit: (effects[limit.term.effect].family, limit.term.effect))
    places = sorted({limit.term.joint for limit in ordered}, key=lambda joint: joint or math.inf)
    made: list[Section] = []
    for joint in places:
        rows = []
        for limit in (limit for limit in ordered if limit.term.joint == joint):
            info = effects[limit.term.effect]
            meanings = {p.name: p.meaning for p in (*info.parameters, *info.coefficients)}
            found = Cell(limit_words(limit, model), note=meanings.get(limit.parameter, ""))
            rows.append((limit.term.effect, found, info.summary))
        columns = (words("effect"), TableColumn("would have been found with", "estimate"), words("what it is"))
        closed = len(places) > 1 and (joint is None or joint in quiet)
        title = (
            "Whole arm"
            if joint is None
            else f"Joint {joint if names.get(joint) is None else f'{joint} {names[joint]}'}"
        )
        made.append(Group(title, (table(columns, rows),), folded=closed))
    return made


def limit_words(limit: Limit, model: Model) -> str:
    """What would have been seen, without the effect's name: `torque more than 0.05 N m, with speed 0.2 rad/s`."""
    than = "more than" if limit.side == "above" else "less than"
    others = [
        f"{name.replace('_', ' ')} {quantity(value, unit_of(model, limit.term, name), 2)}"
        for name, value in limit.assumed.items()
    ]
    amount = told_apart(limit.value, 1.0, 3) if number(limit.value, 3) == "1" else number(limit.value, 3)
    text = f"{limit.parameter.replace('_', ' ')} {than} {amount}{unit(limit.unit, ' ')}"
    return text + (f", with {', '.join(others)}" if others else "")


# --- what to do next ---


def experiments(
    findings: Sequence[FindingEntry],
    effects: Mapping[str, EffectInfo],
    separating: Sequence[Sequence[CommandEntry]],
    context: Context,
) -> list[Section]:
    """For every finding, the motion that brings it and its rivals out; separating: commands that design it."""
    made: list[Section] = []
    for finding, commands in zip(findings, separating, strict=True):
        terms: list[Placed] = [finding, *finding.rivals]
        rows = [(context.called(t), effects[t.effect].trace, effects[t.effect].experiment) for t in terms]
        columns = (words("effect"), words("its trace in a residual"), words("motion that brings it out"))
        alone = Paragraph("It has no rival in these data; this motion would measure it best.", "note")
        follow = Commands(tuple(commands)) if commands else alone
        made.append(Group(" or ".join(map(context.called, terms)), (table(columns, rows), follow)))
    return made
