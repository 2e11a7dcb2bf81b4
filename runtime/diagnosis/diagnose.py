"""Which physical effect is missing? From a fitted model's residual to named, ranked findings, or to silence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from runtime.diagnosis import consistency, detection_limits, sensor_worth, telling_signals
from runtime.diagnosis.branches import complete
from runtime.diagnosis.credibility import poor_excitation, wrong_data
from runtime.diagnosis.further_sensors import FailedGate
from runtime.diagnosis.gates import Verdict
from runtime.diagnosis.grammar_search import Wider, best
from runtime.diagnosis.remainder import above_band, after_effect, physics, remainder
from runtime.diagnosis.search import Search
from runtime.diagnosis.settings import FAR_MORE, LEAST_EXPLAINED, LEAST_MOVING_S
from runtime.diagnosis.steps import Finding, Step, seconds_moving
from runtime.documents.diagnosis import (
    DiagnosedJoint,
    DiagnosisBand,
    DiagnosisBase,
    FindingEntry,
    LineAboveBand,
    RankedCandidate,
)
from runtime.documents.parts import EffectAt, EncoderSkewEntry
from runtime.fit_warnings import suspicions, warnings
from runtime.identification.covariance import Inference
from runtime.identification.identify import prepared, refuse_copies, without_tip_rests
from runtime.identification.twist import fit_twist
from runtime.model.loader import Model
from runtime.model.terms import Term, structure
from runtime.motion.motion import Motion, prepare
from runtime.recordings.recording import Recording, RecordingError
from runtime.wording import numbered, per_turn


@dataclass(frozen=True)
class Diagnosis:
    """The verdict on a model and recordings. `steps`: the model as given, then with each finding added."""

    verdict: Literal["effect", "clean", "unexplained", "refused"]
    reason: str
    steps: tuple[Step, ...]
    findings: tuple[Finding, ...]
    last: Verdict
    seen: tuple[detection_limits.Limit, ...]
    recordings: consistency.Tables | None = None

    @property
    def model(self) -> Model:
        return self.steps[0].identification.model

    @property
    def sensors(self) -> tuple[sensor_worth.SensorWorth, ...]:
        """What further sensors were worth."""
        verdicts = [*(f.verdict for f in self.findings), self.last]
        weighed = [e for verdict in verdicts for e in verdict.ranked]
        return sensor_worth.of(self.steps[0].identification.motion, weighed, [f.evidence for f in self.findings])

    def document(self) -> DiagnosisBase:
        """As `tendon diagnose --json`, but for what follows from it."""
        band, last = self.steps[0].identification.motion.band, self.steps[-1].identification
        return DiagnosisBase(
            verdict=self.verdict,
            reason=self.reason,
            band=band.document().as_part_of(
                DiagnosisBand,
                above=[LineAboveBand(joint=x.joint + 1, order=x.order, frequency_hz=x.frequency) for x in band.above],
            ),
            skew=last.inference.skew_entry(),
            delay=last.delay_entries(),
            joints=[s.document().as_part_of(DiagnosedJoint) for s in self.steps[0].joints],
            parameters=last.inference.inertial_entries(self.model),
            rotors=last.inference.rotor_entries(),
            encoder_skew=_encoder_skew(self.steps[-1]),
            sensors=[worth.document() for worth in self.sensors],
            findings=[finding_entry(self, k) for k in range(len(self.findings))],
            ruled_out=_ranking(self.last),
            would_have_seen=[limit.document() for limit in self.seen],
            recordings=[] if self.recordings is None else self.recordings.recording_entries(),
            inconsistent=[] if self.recordings is None else self.recordings.contradiction_entries(),
            warnings=warnings(last),
        )


def _encoder_skew(step: Step) -> list[EncoderSkewEntry]:
    """Of each joint with a link-side encoder, by how long that is read later than the motor's."""
    found = step.identification
    fits = (fit_twist(found.problem, found.fit, i) for i in range(found.model.n))
    return [f.skew.document().as_part_of(EncoderSkewEntry, joint=f.joint + 1) for f in fits if f is not None]


def finding_entry(diagnosis: Diagnosis, number: int) -> FindingEntry:
    """Finding `number` (from 0), as in `tendon diagnose --json`."""
    finding = diagnosis.findings[number]
    i = finding.joint_index
    info = diagnosis.model.library.effects[finding.term.effect]
    later = {f.joint_index for f in diagnosis.findings[number + 1 :]}
    values = diagnosis.steps[-1].identification.inference.values.get(finding.term, {})
    held = [None if s.held_out is None else s.held_out.rms[i] for s in (finding.before, finding.after)]
    return FindingEntry(
        effect=finding.term.effect,
        joint=finding.term.joint,
        share=finding.share(),
        rms_before=finding.before.fitted.rms[i],
        rms_after=finding.after.fitted.rms[i],
        held_out_before=held[0],
        held_out_after=held[1],
        evidence=finding.evidence.document(),
        parameters={name: e.document() for name, e in values.items()},
        rivals=[EffectAt(effect=t.effect, joint=t.joint) for t in finding.rivals],
        missing_signals=telling_signals.entries(absent(diagnosis, number)),
        ranking=_ranking(finding.verdict),
        experiment=info.experiment,
        remainder=after_effect(diagnosis.steps[-1], i, info) if i not in later else None,
    )


def absent(diagnosis: Diagnosis, number: int) -> tuple[telling_signals.Missing, ...]:
    """The signals that are not in the recordings and would tell a finding from its rivals."""
    finding, motion = diagnosis.findings[number], diagnosis.steps[0].identification.motion
    return telling_signals.missing(diagnosis.model, motion, finding.term, finding.rivals)


def _ranking(verdict: Verdict) -> list[RankedCandidate]:
    """Every finalist with what speaks for it and which gates it failed."""
    return [RankedCandidate(effect=e.term.effect, joint=e.term.joint, evidence=e.document()) for e in verdict.ranked]


def diagnose(
    model: Model, recordings: Sequence[Recording], held_out: Sequence[Recording] = (), wider: Wider | None = None
) -> Diagnosis:
    """Fit the model file's structure, then name what is missing, the first first, or say why nothing can be named.

    wider   asked for where findings leave something: a guess that explains far more says that physics is missing
            which the library does not have, and that the effects that came nearest only stand for it
    """
    return conclude(complete(begin(model, recordings, held_out)), wider)


def begin(model: Model, recordings: Sequence[Recording], held_out: Sequence[Recording] = ()) -> Search:
    """A search on recordings; the held-out ones are judged in the same band and never fitted."""
    motion = prepared(model, recordings)
    search = Search(model, motion, _held_out(motion, held_out, model) if held_out else None)
    refuse_copies([*recordings, *held_out])
    search.names = tuple(r.path.name for r in recordings)
    search.suspicions = suspicions(search.start(structure(model)).identification)
    return search


def _held_out(fitted: Motion, recordings: Sequence[Recording], model: Model) -> Motion:
    motion = without_tip_rests(model, prepare(recordings, fitted.band, model))
    if motion.rigid_given != fitted.rigid_given:
        has, lacks = ("has", "do not") if motion.rigid_given else ("has no", "do")
        raise RecordingError(
            f"{recordings[0].path}: {has} tau1_rigid and the recordings that are fitted {lacks}; "
            "give the rigid-body torque in all of them or in none"
        )
    return motion


def conclude(search: Search, wider: Wider | None = None) -> Diagnosis:
    """The verdict, once nothing more passes the gates, and what would have been seen; `wider` as for `diagnose`."""
    able = [i for i in range(search.model.n) if seconds_moving(search.motion, i) >= LEAST_MOVING_S]
    floors = search.steps[-1].floors
    seen = () if search.suspicions else tuple(detection_limits.of(search.ground(), floors, able))
    return replace(judged(search, wider), seen=seen)


def judged(search: Search, wider: Wider | None = None) -> Diagnosis:
    """As `conclude`, without what would have been seen."""
    step = search.steps[-1]
    compared = consistency.compare(step.identification, search.names, [s.floor.spectrum for s in step.joints])
    verdict, reason = _verdict(search, compared)
    outdone = _outdone(search, wider) if verdict == "effect" and wider else None
    if outdone:
        verdict, reason = "unexplained", compared.preface + outdone
    reason += above_band(search.steps[-1])
    named = {f.term for f in search.findings}
    findings = tuple(
        replace(f, rivals=tuple(t for t in f.rivals if t not in named))
        for f in (search.findings if verdict == "effect" else ())
    )
    steps = tuple(search.steps if findings else search.steps[:1])
    return Diagnosis(
        verdict, reason, steps, findings=findings, last=_withheld(search, verdict), seen=(), recordings=compared
    )


def _withheld(search: Search, verdict: str) -> Verdict:
    """The last comparison; findings that recordings of different arms made are in it as ruled out."""
    if verdict != "refused" or not search.findings:
        return search.last
    named = {f.term for f in search.findings}
    text = "the recordings contradict each other, so that what is missing in which of them is not known"
    why = FailedGate("recordings", text)
    mine = tuple(replace(f.evidence, failed=(*f.evidence.failed, why)) for f in search.findings)
    return Verdict((*mine, *(e for e in search.last.ranked if e.term not in named)), ())


def _verdict(
    search: Search, compared: consistency.Tables
) -> tuple[Literal["effect", "clean", "unexplained", "refused"], str]:
    first, last = search.steps[0], search.steps[-1]
    if search.suspicions:
        return "refused", wrong_data(search.suspicions)
    disagreement = _disagreement(search.model, last.identification.inference)
    preface = compared.preface + disagreement
    unsound = next((why for s in search.steps if (why := s.identification.unsound)), None)
    if unsound:
        return "refused", compared.preface + unsound
    if compared.refusal and (compared.each_is_noise or not any(physics(last, i) for i in range(search.model.n))):
        return "refused", disagreement + compared.refusal
    for i in {f.joint_index for f in search.findings if f.evidence.twist is None}:
        rest = physics(last, i)
        if rest and _explained(first, last, i) < LEAST_EXPLAINED:
            near = ", ".join(str(f.term) for f in search.findings if f.joint_index == i)
            share = 100 * _explained(first, last, i)
            return "unexplained", (
                f"{preface}joint {_called(i, last)}: {near} comes nearest, but explains only {share:.0f} % of what is "
                f"above the noise: {rest}"
            )
    if search.findings:
        found = "; ".join(_sentence(f, last) for f in search.findings)
        return "effect", f"{preface}the model lacks {found}"
    refusal = poor_excitation(first.identification)
    if refusal:
        return "refused", preface + refusal
    for i in range(search.model.n):
        rest = remainder(first, i)
        if rest:
            why = f"{preface}joint {_called(i, last)}: no effect of the library explains the residual: {rest}"
            return "unexplained", why + _undecided(search, i)
    text = ", ".join(f"{s.rms:.3g} {s.force_unit}" for s in last.joints)
    return "clean", f"{preface}the residual is noise ({text}): the recordings show no missing effect"


def _undecided(search: Search, joint: int) -> str:
    """What a second recording would decide, as the end of a sentence."""
    near = search.undecided(joint)
    if near is None:
        return ""
    return (
        f"; {near.term} would explain {100 * near.share:.0f} % of what is above the noise floor, which stretches that "
        "were left out in turn do not bear out: record the motion again and give that as --held-out"
    )


def _outdone(search: Search, wider: Wider) -> str | None:
    """That a guess explains far more than the findings at its joint, which leave something; None if none does."""
    first, last = search.steps[0], search.steps[-1]
    for i in sorted({f.joint_index for f in search.findings}):
        here = [f for f in search.findings if f.joint_index == i]
        if not after_effect(last, i, search.model.library.effects[here[-1].term.effect]):
            continue
        found = best(first, *wider(), (i,))
        named = sum(f.evidence.delta_bic for f in here)
        if found is None or found.finding.evidence.delta_bic < FAR_MORE * named:
            continue
        if found.finding.after.fitted.rms[i] < last.fitted.rms[i]:
            info = found.finding.after.identification.model.library.effects[found.term.effect]
            return (
                f"joint {_called(i, last)}: {', '.join(str(f.term) for f in here)} came nearest, but a term that "
                f"no effect of the library has explains far more, {info.equation}: physics is missing that is not in "
                "the library"
            )
    return None


def _explained(first: Step, last: Step, joint: int) -> float:
    """Part of a joint's squared error above the noise floor that is gone."""
    before, after, floor = first.fitted.rms[joint], last.fitted.rms[joint], first.joints[joint].floor.value
    return (before**2 - after**2) / max(before**2 - floor**2, before**2 - after**2, 1e-300)


def _sentence(finding: Finding, last: Step) -> str:
    i, shown = finding.joint_index, finding.evidence.twist
    before, after = finding.before.fitted.relative[i], finding.after.fitted.relative[i]
    joint = finding.term.joint
    where = "" if joint is None else f" at joint {_called(joint - 1, last)}"
    text = f"{finding.term.effect}{where}{_order(finding.term, last)} "
    if shown is None:
        text += f"(error {100 * before:.2f} % to {100 * after:.2f} %)"
    else:
        text += f"(twist unexplained by the skew of the encoders {shown.before:.2g} to {shown.after:.2g} {shown.unit})"
    if finding.rivals:
        text += f", which these data cannot tell from {', '.join(map(str, finding.rivals))}"
    return text


def _called(joint: int, step: Step) -> str:
    """A joint (0-based) by its number and the model file's name."""
    return numbered(joint + 1, step.joints[joint].name)


def _order(term: Term, last: Step) -> str:
    """Of a line over the motor's angle, how often it repeats."""
    model = last.identification.model
    line = model.library.effects[term.effect].line
    if line is None or term.joint is None:
        return ""
    return f" at {per_turn(last.shapes[term][line.name], model.joints[term.joint - 1].gear_ratio)}"


def _disagreement(model: Model, inference: Inference) -> str:
    """Inertial parameters of the file that the data contradict, as the beginning of a sentence."""
    wrong = []
    for lump, e in zip(model.lumps, inference.lumps, strict=True):
        if lump.value is not None and consistency.contradict(lump.value, e.value, consistency.deviation(e)):
            wrong.append(f"{lump.name} is {lump.value:.4g} {lump.unit} in the model file, {e.value:.4g} in the data")
    return f"check the model file first: {'; '.join(wrong)}; " if wrong else ""
