"""The decision at the end of a trail: what is missing, or why nothing can be named."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from runtime.diagnosis import credibility, detection_limits
from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.gates import RECORDINGS
from runtime.diagnosis.grammar_search import Draft, Wider, best
from runtime.diagnosis.ranking import Ranking
from runtime.diagnosis.search import undecided
from runtime.diagnosis.settings import FAR_MORE, LEAST_EXPLAINED
from runtime.diagnosis.steps import Step, Trail, after_effect, physics, remainder
from runtime.identification.identify import unsound
from runtime.model.loader import Model

Verdict = Literal["effect", "clean", "unexplained", "refused"]
Why = Literal[
    "wrong data",
    "unsound fit",
    "contradiction",
    "comes nearest",
    "outdone",
    "found",
    "excitation",
    "nothing explains",
    "noise",
]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The verdict on a model and recordings.

    why         what decided           joint  (0-based) of which that is said, where it is one
    trail       the model as given, then every step           findings  its steps that added something, where named
    ranking     the last comparison of candidates, with what was withheld
    recordings  the parameters of each recording alone
    draft       a guess that explains far more than the findings        undecided  what a second recording would decide
    seen        how large each effect would have had to be
    """

    verdict: Verdict
    why: Why
    trail: Trail
    findings: tuple[Step, ...]
    ranking: Ranking
    recordings: credibility.Tables
    joint: int | None = None
    draft: Draft | None = None
    undecided: Candidate | None = None
    seen: tuple[detection_limits.Limit, ...] = ()

    @property
    def steps(self) -> tuple[Step, ...]:
        """The model as given, then with each finding added."""
        return (self.trail.first, *self.findings)

    @property
    def last(self) -> Step:
        return self.steps[-1]

    @property
    def model(self) -> Model:
        return self.trail.first.fit.model


def decide(trail: Trail, wider: Wider | None = None) -> Diagnosis:
    """The verdict, once nothing more passes the gates; wider as for `stages.diagnose`. What would have been seen is
    left out."""
    last = trail.last
    compared = credibility.compare(last.fit, trail.names, [s.floor.spectrum for s in last.joints])
    verdict, why, joint = _decided(trail, compared)
    draft = None
    if verdict == "effect" and wider is not None:
        draft = _outdone(trail, wider)
        if draft is not None:
            verdict, why, joint = "unexplained", "outdone", draft.step.joint_index
    named = {f.term for f in trail.findings}
    found = Diagnosis(verdict, why, trail, (), _withheld(trail, verdict, compared), compared, joint, draft)
    if verdict == "effect":
        before, findings = trail.first, []
        for finding in trail.findings:
            rivals = tuple(t for t in finding.rivals if t not in named)
            before = replace(finding, before=before, rivals=rivals)
            findings.append(before)
        return replace(found, findings=tuple(findings))
    if why == "nothing explains" and joint is not None:
        return replace(found, undecided=undecided(trail, joint))
    return found


def _withheld(trail: Trail, verdict: Verdict, compared: credibility.Tables) -> Ranking:
    """The last comparison; findings that recordings of different arms made are in it as ruled out."""
    if verdict != "refused" or not trail.findings:
        return trail.ranking
    named = {f.term for f in trail.findings}
    closed = RECORDINGS.asked(max(1.0, float(len(compared.inertial) + len(compared.effects))))
    mine = tuple(replace(f.candidate, results=(*f.candidate.results, closed)) for f in trail.findings)
    return Ranking((*mine, *(c for c in trail.ranking.candidates if c.term not in named)))


def _decided(trail: Trail, compared: credibility.Tables) -> tuple[Verdict, Why, int | None]:
    first, last, joints = trail.first, trail.last, range(trail.model.n)
    if trail.suspicions:
        return "refused", "wrong data", None
    if any(unsound(s.fit) is not None for s in trail.steps):
        return "refused", "unsound fit", None
    if compared.contradictory and (compared.each_is_noise or not any(physics(last, i) for i in joints)):
        return "refused", "contradiction", None
    for i in {f.joint_index for f in trail.findings if f.candidate.twist is None}:
        if physics(last, i) and explained(first, last, i) < LEAST_EXPLAINED:
            return "unexplained", "comes nearest", i
    if trail.findings:
        return "effect", "found", None
    if credibility.poor_excitation(first.fit) is not None:
        return "refused", "excitation", None
    left = next((i for i in joints if remainder(first, i)), None)
    if left is not None:
        return "unexplained", "nothing explains", left
    return "clean", "noise", None


def _outdone(trail: Trail, wider: Wider) -> Draft | None:
    """A guess that explains far more than the findings at its joint, which leave something; None if none does."""
    first, last = trail.first, trail.last
    for i in sorted({f.joint_index for f in trail.findings}):
        here = [f for f in trail.findings if f.joint_index == i]
        if not after_effect(last, i, trail.model.library.effects[here[-1].term.effect]):
            continue
        found = best(first, *wider(), (i,))
        named = sum(f.candidate.delta_bic for f in here)
        if found is None or found.step.candidate.delta_bic < FAR_MORE * named:
            continue
        if found.step.fitted.rms[i] < last.fitted.rms[i]:
            return found
    return None


def explained(first: Step, last: Step, joint: int) -> float:
    """Part of a joint's squared error (0-based) above the noise floor that is gone."""
    before, after, floor = first.fitted.rms[joint], last.fitted.rms[joint], first.joints[joint].floor.value
    return (before**2 - after**2) / max(before**2 - floor**2, before**2 - after**2, 1e-300)
