"""The way of a search: structures that were fitted one after another, with what each step added.

What to add or to take back is decided in `search`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from runtime.diagnosis.candidates import Candidate, CandidateField
from runtime.diagnosis.gates import Evidence
from runtime.diagnosis.steps import Finding, Step, errors_elsewhere
from runtime.diagnosis.worth import needless, same_signals
from runtime.identification.estimate import Estimate
from runtime.identification.identify import Identification, identify_motion
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term, Values
from runtime.motion.motion import Motion


@dataclass
class Trail:
    """Structures fitted to a motion; each step refits everything.

    steps     the structure as given, then with each finding added
    findings  in the order in which they were added
    """

    model: Model
    motion: Motion
    held_out: Motion | None = None
    steps: list[Step] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    _field: CandidateField | None = None

    def start(self, known: Structure) -> Step:
        self.steps.append(self._step(None, known, None))
        return self.steps[-1]

    def ground(self) -> CandidateField:
        """The last step as the field on which candidates compete, with what was computed on it."""
        return self._field_of(self.steps[-1])

    def _field_of(self, step: Step) -> CandidateField:
        identification = step.identification
        if self._field is None or self._field.fit is not identification.fit:
            self._field = CandidateField(identification.problem, identification.fit)
        return self._field

    def _step(self, added: Term | None, known: Structure, before: Step | None) -> Step:
        start = before.identification.fit if before else None
        identification = identify_motion(self.model, self.motion, known, start=start)
        if start:
            identification = with_shown(identification, start.witnessed)
        held = None if self.held_out is None else errors_elsewhere(identification, self.held_out)
        return Step.of(added, identification, held_out=held)

    def _structure(self, added: Sequence[tuple[Term, Values]]) -> Structure:
        """The structure as given with these terms in place of what they generalise, shapes as last found."""
        latest = {**self.steps[0].shapes, **self.steps[-1].shapes}
        known: Structure = {t: dict(latest[t]) for t in self.steps[0].shapes}
        for term, shape in added:
            generalises = self.model.library.effects[term.effect].generalises
            for gone in [t for t in known if t.effect in generalises and t.joint == term.joint]:
                del known[gone]
            known[term] = dict(shape)
        return known

    def _so_far(self) -> list[tuple[Term, Values]]:
        shapes = self.steps[-1].shapes
        return [(f.term, shapes[f.term]) for f in self.findings if f.term in shapes]

    def _with(self, step: Step, *candidates: Candidate) -> Step:
        added = [*self._so_far(), *((c.term, c.shape) for c in candidates)]
        return self._step(candidates[-1].term, self._structure(added), step)

    def _with_instead(self, evidence: Evidence, without: Step) -> Step:
        added = [(t, v) for t, v in self._so_far() if t in without.shapes]
        added.append((evidence.term, evidence.candidate.shape))
        return self._step(evidence.term, self._structure(added), without)

    def _rebuild(self, kept: Sequence[Finding], shapes: Mapping[Term, Values]) -> None:
        known = {**dict(self._so_far()), **shapes}
        steps, findings = self.steps[:1], []
        for k, finding in enumerate(kept):
            added = [(f.term, known[f.term]) for f in kept[: k + 1] if f.term in known]
            steps.append(self._step(finding.term, self._structure(added), self.steps[-1]))
            findings.append(replace(finding, before=steps[-2], after=steps[-1]))
        self.steps, self.findings = steps, findings

    def _rest_of_another(self, terms: Sequence[Term], both: Step) -> bool:
        """Whether an effect found before, over the same quantities at the same joint, leaves hardly anything to these:
        then they are what that one's law lacks, and no effects of their own; both: the step with all of them."""
        earlier = [f for f in self.findings if all(self._alike(f.term, t) for t in terms)]
        return any(self._superfluous(f.term, terms, both) == 1 for f in earlier)

    def _alike(self, one: Term, other: Term) -> bool:
        """Whether a later term may be the rest of one before, at the same joint: over the same quantities, or after one
        whose law is one form of many."""
        one_info, other_info = (self.model.library.effects[t.effect] for t in (one, other))
        if one.joint is None or one.joint != other.joint or one.effect == other.effect:
            return False
        contained = one.effect in other_info.generalises or other.effect in one_info.generalises
        return not contained and (one_info.one_form or same_signals(one_info, other_info))

    def _superfluous(self, earlier: Term, terms: Sequence[Term], both: Step) -> int | None:
        """As `needless` of an earlier finding and later terms; `both`: the step with all of them."""
        added = {f.term for f in self.findings} | set(terms)
        shapes = [(t, v) for t, v in both.shapes.items() if t in added]
        none, first, second = (
            self._step(None, self._structure([(t, v) for t, v in shapes if t not in gone]), both)
            for gone in ((earlier, *terms), tuple(terms), (earlier,))
        )
        return needless(none, (first, second), both, (earlier.joint or 1) - 1)


def with_shown(identification: Identification, shown: Mapping[Term, Mapping[str, Estimate]]) -> Identification:
    """The same with what further sensors show beside the torque."""
    fit = identification.fit
    return replace(identification, fit=replace(fit, witnessed={**fit.witnessed, **shown})) if shown else identification
