"""Documents of diagnose and improve: the verdict, its evidence, and the steps of the loop."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import UNSET, UnsetType

from runtime.documents.fits import (
    Delays,
    EachRecording,
    FitDocument,
    Inconsistent,
    InertialEntry,
    JointEntry,
    RotorEntry,
    Skew,
    StructureShare,
    Warnings,
)
from runtime.documents.parts import (
    BandEntry,
    Document,
    EffectAt,
    EncoderSkewEntry,
    EstimateEntry,
    JointNumber,
    JointOrArm,
    SearchEnd,
    Unit,
    key,
)
from runtime.documents.provenance import Origin
from runtime.documents.replays import ReplayStep

Verdict = Annotated[
    Literal["effect", "clean", "unexplained", "refused"],
    key(
        "effect: a finding passed every gate; clean: nothing but noise is left; unexplained: more is left and no "
        "effect explains it; refused: the data cannot decide"
    ),
]


class LineAboveBand(Document, frozen=True, kw_only=True):
    """A line in the torque's spectrum over the motor's angle that lies above a joint's band."""

    joint: JointNumber
    order: Annotated[float, key("periods per turn of the motor", "1")]
    frequency_hz: Annotated[float, key("its frequency at the highest speed", "Hz")]


class DiagnosisBand(BandEntry, frozen=True, kw_only=True):
    """Frequency band of a diagnosis."""

    above: Annotated[list[LineAboveBand], key("lines of the torque that lie above the band")]


class DiagnosedJoint(JointEntry, frozen=True, kw_only=True):
    """Residual torque of a joint with the structure of the model file, and what is said of the joint."""

    verdict: Verdict
    reason: Annotated[str, key("one sentence for a person")]
    structure: Annotated[
        list[StructureShare] | UnsetType, key("signals that an unexplained residual follows; absent at other joints")
    ] = UNSET


class TwistEvidence(Document, frozen=True, kw_only=True):
    """What the link-side encoder shows of a candidate where the motor torque does not."""

    rms_before: Annotated[float, key("unexplained twist without the candidate, rms", "`unit`")]
    rms_after: Annotated[float, key("unexplained twist with it, rms", "`unit`")]
    eff: Annotated[float, key("twist that only the candidate explains, rms", "`unit`")]
    unit: Unit


class EvidenceEntry(Document, frozen=True, kw_only=True):
    """What speaks for and against a candidate."""

    eff: Annotated[float, key("torque that only this effect explains, rms", "the joint's `unit`")]
    gain: Annotated[float, key("gain of the log-likelihood on whitened rows", "1")]
    dispersion: Annotated[float, key("of the term's own score: 1 where its law is right and the noise white", "1")]
    score: Annotated[float, key("gain over the dispersion, if that is above 1", "1")]
    price: Annotated[
        float,
        key(
            "what the score must exceed: joints, shapes and unknowns searched, less what held-out data repay; more "
            "where few stretches of time tell the dispersion",
            "1",
        ),
    ]
    failed_gates: Annotated[list[str], key("a sentence for each gate that the candidate failed")]
    twist: Annotated[TwistEvidence | UnsetType, key("evidence of the link-side encoder; absent without it")] = UNSET


class RankedCandidate(EffectAt, frozen=True, kw_only=True):
    """A candidate with its evidence."""

    evidence: Annotated[EvidenceEntry, key("what speaks for and against it")]


class MissingSignal(Document, frozen=True, kw_only=True):
    """A signal that was not recorded and would separate a finding from rivals."""

    signal: Annotated[str, key("column of a recording")]
    rivals: Annotated[list[str], key("effects from which it would separate the finding")]


class FindingEntry(Document, frozen=True, kw_only=True):
    """An effect that passed every gate."""

    effect: Annotated[str, key("name of the effect")]
    joint: JointOrArm
    share: Annotated[float, key("(rms_before² − rms_after²) / (rms_before² − floor²)", "1")]
    rms_before: Annotated[float, key("residual of the joint without the effect, rms", "the joint's `unit`")]
    rms_after: Annotated[float, key("residual with it, rms", "the joint's `unit`")]
    held_out_before: Annotated[
        float | None, key("the same on held-out recordings, without the effect; null without any", "the joint's `unit`")
    ]
    held_out_after: Annotated[
        float | None, key("the same on held-out recordings, with it; null without any", "the joint's `unit`")
    ]
    error_before: Annotated[float, key("residual of the joint over its torque, without the effect", "1")]
    error_after: Annotated[float, key("the same with it", "1")]
    held_out_error_before: Annotated[float | None, key("error_before on held-out recordings; null without any", "1")]
    held_out_error_after: Annotated[float | None, key("error_after on held-out recordings; null without any", "1")]
    evidence: Annotated[EvidenceEntry, key("what speaks for it")]
    parameters: Annotated[dict[str, EstimateEntry], key("fitted parameters by name")]
    rivals: Annotated[list[EffectAt], key("effects from which these data cannot separate it")]
    missing_signals: Annotated[list[MissingSignal], key("signals that would separate it from its rivals")]
    ranking: Annotated[list[RankedCandidate], key("all finalists of this step, the best first")]
    experiment: Annotated[str, key("motion that would bring the effect out")]
    remainder: Annotated[str | None, key("what is left at the joint with the effect; null if only noise")]
    mounting: Annotated[
        str | UnsetType, key("how the base is mounted and what to type; absent for effects other than gravity")
    ] = UNSET

    def __repr__(self) -> str:
        at = "" if self.joint is None else f"@{self.joint}"
        return f"<{self.effect}{at}: error {self.error_before:.3g} -> {self.error_after:.3g}, {self.parameters}>"


class SensorEntry(Document, frozen=True, kw_only=True):
    """What further sensors of one kind contributed."""

    columns: Annotated[list[str], key("columns of the recording")]
    decided: Annotated[list[EffectAt], key("effects that only this sensor ruled out")]
    against: Annotated[list[EffectAt], key("other effects that it speaks against")]
    shown: Annotated[list[EffectAt], key("effects that it shows and the motor torque does not")]
    said: Annotated[str, key("the same in one sentence")]


class LimitEntry(Document, frozen=True, kw_only=True):
    """A detection limit: a parameter beyond which an effect would have been found in these recordings."""

    effect: Annotated[str, key("name of the effect")]
    joint: JointOrArm
    parameter: Annotated[str, key("name of the parameter")]
    above: Annotated[float | UnsetType, key("found if larger than this; absent if `below` is there", "`unit`")] = UNSET
    below: Annotated[float | UnsetType, key("found if smaller than this; absent if `above` is there", "`unit`")] = UNSET
    unit: Unit
    assumed: Annotated[dict[str, float], key("assumed values of the other parameters", "SI")] = msgspec.field(
        name="with"
    )


class DraftBase(Document, frozen=True, kw_only=True):
    """A guess at a law that is not in the library, fitted."""

    effect: Annotated[str, key("name of the guess")]
    joint: JointOrArm
    equation: Annotated[str, key("its torque")]
    share: Annotated[float, key("share of the residual variance above the noise floor that it explains", "1")]
    rms_before: Annotated[float, key("residual of the joint without the guess, rms", "`unit`")]
    rms_after: Annotated[float, key("residual with it, rms", "`unit`")]
    floor: Annotated[float, key("noise floor, rms", "`unit`")]
    unit: Unit
    evidence: Annotated[EvidenceEntry, key("what speaks for it")]
    parameters: Annotated[dict[str, EstimateEntry], key("fitted parameters by name")]
    others: Annotated[list[EffectAt], key("guesses that explain nearly as much")]


class DraftEntry(DraftBase, frozen=True, kw_only=True):
    """A guess at a law that is not in the library, written to a file."""

    file: Annotated[str, key("file of the drafted effect")]
    next: Annotated[list[str], key("commands that try it")]


class FloorEntry(Document, frozen=True, kw_only=True):
    """Noise floor of a joint on the held-out recordings."""

    joint: JointNumber
    floor: Annotated[float, key("noise floor, rms", "the joint's `unit`")]
    floor_source: Annotated[str, key("repeats or spectrum")]


class PeaksEntry(Document, frozen=True, kw_only=True):
    """Peaks in the spectrum of a joint's residual."""

    joint: JointNumber
    frequencies_hz: Annotated[list[float], key("their frequencies", "Hz")]


class CommandEntry(Document, frozen=True, kw_only=True):
    """A command to type next."""

    what: Annotated[str, key("what it does")]
    command: Annotated[str, key("the command line")]


MoreIsLeft = Annotated[bool, key("whether effects were found and more than noise is left")]
Peaks = Annotated[list[PeaksEntry], key("joints whose residual has peaks in its spectrum")]
Commands = Annotated[list[CommandEntry], key("what to type next")]
ImprovedModel = Annotated[str | None, key("file of the improved model; null if none was written")]
HeldOutFloors = Annotated[
    list[FloorEntry] | UnsetType, key("noise floors of the held-out recordings; absent without any")
]


class SearchEntry(Document, frozen=True, kw_only=True):
    """How far the search for missing effects came."""

    refits: Annotated[int, key("structures that it fitted to all rows", "1")]
    budget: Annotated[int, key("structures that it might fit", "1")]
    ended: Annotated[SearchEnd, key("complete: nothing more passes; budget or time: what cut it before that")]


class DiagnosisBase(Document, frozen=True, kw_only=True):
    """Verdict on a model and recordings."""

    verdict: Verdict
    reason: Annotated[str, key("the verdict in one sentence; of a search that was cut, a second one says so")]
    search: Annotated[SearchEntry, key("how far the search for missing effects came")]
    band: Annotated[DiagnosisBand, key("frequency band of the comparison")]
    skew: Skew
    delay: Delays
    joints: Annotated[list[DiagnosedJoint], key("residual of each joint with the structure of the model file")]
    parameters: Annotated[list[InertialEntry], key("base inertial parameters, fitted with all findings")]
    rotors: Annotated[list[RotorEntry], key("rotor inertias missing from tau_rigid; empty without that column")]
    encoder_skew: Annotated[
        list[EncoderSkewEntry], key("offset between motor and link-side encoder of each joint that has both")
    ]
    sensors: Annotated[list[SensorEntry], key("what further sensors contributed")]
    findings: Annotated[list[FindingEntry], key("effects to add, in the order in which they were found")]
    ruled_out: Annotated[list[RankedCandidate], key("candidates of the last step, none of which was named")]
    would_have_seen: Annotated[list[LimitEntry], key("detection limits of these recordings")]
    recordings: EachRecording
    inconsistent: Inconsistent
    warnings: Warnings


class DiagnosisDocument(DiagnosisBase, frozen=True, kw_only=True):
    """Which effect is missing: `tendon diagnose --json`."""

    draft: Annotated[DraftEntry | None, key("the guess that --draft asked for; null without one")]
    more_is_left: MoreIsLeft
    peaks: Peaks
    commands: Commands
    improved_model: ImprovedModel
    provenance: Origin = UNSET
    draft_reason: Annotated[str | UnsetType, key("why there is no draft; absent unless --draft asked for one")] = UNSET


class HistoryEntry(Document, frozen=True, kw_only=True):
    """The model after a step of the loop."""

    added: Annotated[str | None, key("effect that was added; null for the model as given")]
    rms: Annotated[list[float], key("residual of each joint, rms", "the joint's `unit`")]
    relative: Annotated[list[float], key("norm of the residual over that of the torque, of each joint", "1")]
    held_out: Annotated[
        list[float | None] | None, key("rms on the held-out recordings; null without any", "the joint's `unit`")
    ]
    held_out_relative: Annotated[
        list[float | None] | None, key("relative on the held-out recordings; null without any", "1")
    ]
    finding: Annotated[FindingEntry | UnsetType, key("the finding that was added; absent in the first entry")] = UNSET


class FitsEntry(Document, frozen=True, kw_only=True):
    """The fits before and after all additions."""

    before: Annotated[FitDocument, key("fit of the model as given")]
    after: Annotated[FitDocument, key("fit with everything that was added")]


class ImprovementBase(DiagnosisBase, frozen=True, kw_only=True):
    """Diagnosis of the improved model, and the steps that led to it."""

    history: Annotated[list[HistoryEntry], key("the model as given, then after each addition")]
    identification: Annotated[FitsEntry, key("parameters before and after")]


class ImprovementDocument(ImprovementBase, frozen=True, kw_only=True):
    """What was added and what the error did: `tendon improve --json`, `tendon demo --json`."""

    held_out_floors: HeldOutFloors = UNSET
    replay: Annotated[
        list[ReplayStep] | UnsetType,
        key("how far each model's motion is off, on held-out recordings if there are any; absent without --replay"),
    ] = UNSET
    more_is_left: MoreIsLeft
    peaks: Peaks
    commands: Commands
    improved_model: ImprovedModel
    provenance: Origin = UNSET
