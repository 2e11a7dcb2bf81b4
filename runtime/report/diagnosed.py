"""An inspection, a fit, a diagnosis, an improvement and a draft as the documents that --json prints."""

from __future__ import annotations

from msgspec import UNSET
from msgspec.structs import replace

from runtime.diagnosis import credibility
from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.grammar_search import Draft
from runtime.diagnosis.ranking import Ranking
from runtime.diagnosis.steps import Step, after_effect
from runtime.diagnosis.verdict import Diagnosis
from runtime.documents.diagnosis import (
    DiagnosedJoint,
    DiagnosisBand,
    DiagnosisBase,
    DraftBase,
    EvidenceEntry,
    FindingEntry,
    FitsEntry,
    HistoryEntry,
    ImprovementBase,
    LineAboveBand,
    RankedCandidate,
    TwistEvidence,
)
from runtime.documents.fits import JudgedFitDocument
from runtime.documents.parts import EffectAt, EncoderSkewEntry
from runtime.documents.recordings import InspectDocument
from runtime.fit_warnings import improper_inertia, suspicions
from runtime.identification.compare import structure_entries
from runtime.identification.identify import delay_entries, fit_document
from runtime.identification.twist import fit_twist
from runtime.inspection.inspection import Inspection
from runtime.loop.improve import Improvement
from runtime.model.loader import Model
from runtime.report import reasons, sensors


def inspected(found: Inspection) -> InspectDocument:
    """As `tendon inspect --json`."""
    fit, joints = found.believed, found.joints
    why = None if fit is None else reasons.unreliable(credibility.unreliable(fit, joints), fit, joints)
    improper = [] if fit is None else improper_inertia(fit)
    return found.document(unreliable=why or "; ".join(improper))


def judged(found: credibility.JudgedFit) -> JudgedFitDocument:
    """As `tendon identify --json`, but for what was written."""
    above = reasons.above_noise(found.joints) if found.verdict == "fitted" else []
    return fit_document(found.fit).as_part_of(
        JudgedFitDocument,
        verdict=found.verdict,
        reason=reasons.of_fit(found),
        joints=[joint.document() for joint in found.joints],
        recordings=found.recordings.recording_entries(),
        inconsistent=found.recordings.contradiction_entries(),
        warnings=[*reasons.warned(found.fit, found.joints, found.suspicions), *above],
    )


def document(diagnosis: Diagnosis) -> DiagnosisBase:
    """As `tendon diagnose --json`, but for what follows from it: with the signals that the residual follows at each
    unexplained joint."""
    found = _plain(diagnosis)
    joints = list(found.joints)
    for k in diagnosis.unexplained:
        joints[k] = replace(joints[k], structure=structure_entries(diagnosis.last.joints[k]))
    return replace(found, joints=joints)


def _plain(diagnosis: Diagnosis) -> DiagnosisBase:
    first, last = diagnosis.found.first, diagnosis.last.fit
    wrong = diagnosis.searched.suspicions or suspicions(last)
    band = first.fit.motion.band
    above = [LineAboveBand(joint=x.joint + 1, order=x.order, frequency_hz=x.frequency) for x in band.above]
    return DiagnosisBase(
        verdict=diagnosis.verdict,
        reason=reasons.reason(diagnosis),
        search=diagnosis.search,
        band=band.document().as_part_of(DiagnosisBand, above=above),
        skew=last.inference.skew_entry(),
        delay=delay_entries(last),
        joints=[
            s.document().as_part_of(DiagnosedJoint, verdict=v.verdict, reason=reasons.of_joint(diagnosis, v))
            for s, v in zip(first.joints, diagnosis.joints, strict=True)
        ],
        parameters=last.inference.inertial_entries(diagnosis.model),
        rotors=last.inference.rotor_entries(),
        encoder_skew=_encoder_skew(diagnosis.last),
        sensors=[worth.document() for worth in sensors.worth(diagnosis)],
        findings=[finding_entry(diagnosis, finding) for finding in diagnosis.findings],
        ruled_out=ranking_entries(diagnosis.ranking, diagnosis.model),
        would_have_seen=[limit.document() for limit in diagnosis.seen],
        recordings=diagnosis.recordings.recording_entries(),
        inconsistent=diagnosis.recordings.contradiction_entries(),
        warnings=[*reasons.warned(last, diagnosis.last.joints, wrong), *reasons.untried(diagnosis)],
    )


def _encoder_skew(step: Step) -> list[EncoderSkewEntry]:
    found = step.fit
    fits = (fit_twist(found, i) for i in range(found.model.n))
    return [f.skew.document().as_part_of(EncoderSkewEntry, joint=f.joint + 1) for f in fits if f is not None]


def finding_entry(diagnosis: Diagnosis, finding: Step) -> FindingEntry:
    """A finding as in `tendon diagnose --json`."""
    i, term = finding.joint_index, finding.term
    info = diagnosis.model.library.effects[term.effect]
    later = diagnosis.findings[diagnosis.findings.index(finding) + 1 :]
    left = None if any(f.joint_index == i for f in later) else after_effect(diagnosis.last, i, info)
    values = diagnosis.last.fit.inference.values.get(term, {})
    both = finding.previous, finding
    held = [None if s.held_out is None else s.held_out.rms[i] for s in both]
    held_error = [None if s.held_out is None else s.held_out.relative[i] for s in both]
    return FindingEntry(
        effect=term.effect,
        joint=term.joint,
        share=finding.share(),
        rms_before=finding.previous.fitted.rms[i],
        rms_after=finding.fitted.rms[i],
        held_out_before=held[0],
        held_out_after=held[1],
        error_before=finding.previous.fitted.relative[i],
        error_after=finding.fitted.relative[i],
        held_out_error_before=held_error[0],
        held_out_error_after=held_error[1],
        evidence=evidence_entry(finding.candidate, diagnosis.model),
        parameters={name: e.document() for name, e in values.items()},
        rivals=[EffectAt(effect=t.effect, joint=t.joint) for t in finding.rivals],
        missing_signals=sensors.entries(sensors.absent(diagnosis, finding)),
        ranking=ranking_entries(finding.ranking, diagnosis.model),
        experiment=info.experiment,
        remainder=None if left is None else reasons.left_over(left, info.name),
        mounting=reasons.of_gravity(finding, diagnosis.last) or UNSET,
    )


def ranking_entries(ranking: Ranking, model: Model) -> list[RankedCandidate]:
    """Every finalist with what speaks for it and which gates stayed closed."""
    return [
        RankedCandidate(effect=c.term.effect, joint=c.term.joint, evidence=evidence_entry(c, model))
        for c in ranking.candidates
    ]


def evidence_entry(candidate: Candidate, model: Model) -> EvidenceEntry:
    """What the gates were asked of a candidate, and what they said."""
    said, twist = candidate.evidence, candidate.twist
    return EvidenceEntry(
        eff=candidate.eff,
        gain=said.gain,
        dispersion=said.dispersion,
        score=said.score,
        price=said.due,
        failed_gates=reasons.closed_gates(candidate, model),
        twist=UNSET
        if twist is None
        else TwistEvidence(rms_before=twist.before, rms_after=twist.after, eff=twist.eff, unit=twist.unit),
    )


def improved(improvement: Improvement) -> ImprovementBase:
    """As `tendon improve --json`, without the keys that follow from it: what is left, and the word for the whole."""
    found = improvement.found
    first, last = found.steps[0].fit, found.last.fit
    return _plain(improvement.left).as_part_of(
        ImprovementBase,
        verdict=improvement.verdict,
        reason=reasons.of_improvement(improvement),
        sensors=[worth.document() for worth in sensors.worth(found)],
        history=[_history(found, step) for step in found.steps],
        identification=FitsEntry(before=fit_document(first), after=fit_document(last)),
    )


def _history(found: Diagnosis, step: Step) -> HistoryEntry:
    return HistoryEntry(
        added=None if step.added is None else str(step.added),
        rms=list(step.fitted.rms),
        relative=list(step.fitted.relative),
        held_out=None if step.held_out is None else list(step.held_out.rms),
        held_out_relative=None if step.held_out is None else list(step.held_out.relative),
        finding=UNSET if step.added is None else finding_entry(found, step),
    )


def drafted(draft: Draft) -> DraftBase:
    """The key "draft" of `tendon diagnose --json`, without the file."""
    step, model = draft.step, draft.step.fit.model
    i, before = step.joint_index, step.previous
    return DraftBase(
        effect=draft.term.effect,
        joint=draft.term.joint,
        equation=model.library.effects[draft.term.effect].equation,
        share=step.share(),
        rms_before=before.fitted.rms[i],
        rms_after=step.fitted.rms[i],
        floor=before.joints[i].floor.value,
        unit=before.joints[i].force_unit,
        evidence=evidence_entry(step.candidate, model),
        parameters={name: e.document() for name, e in step.fit.inference.values[draft.term].items()},
        others=[EffectAt(effect=t.effect, joint=t.joint) for t in draft.others],
    )
