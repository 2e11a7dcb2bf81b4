"""From a fitted model to named effects: forward, in pairs where one effect stood for two, and backward again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis import pairs
from runtime.diagnosis.candidates import Candidate, CandidateField
from runtime.diagnosis.gates import Evidence, Verdict, judge, rank
from runtime.diagnosis.pairs import CandidatePair
from runtime.diagnosis.settings import (
    BIC_APART,
    CLEARLY_LESS,
    HELD_OUT_FALLS_TO,
    LEAST_DELTA_BIC,
    LEAST_FALL,
    LEAST_MOVING_S,
    MOST_FINDINGS,
    MOST_PAIRS,
    MOST_RIVALS,
    PAIR_WORTH_FITTING,
)
from runtime.diagnosis.twist import Witnessed, witnessed
from runtime.estimation.compare import JointSeries, errors, series
from runtime.estimation.estimate import Estimate
from runtime.estimation.folds import bic
from runtime.estimation.identify import Identification, identify_motion
from runtime.estimation.problem import Problem
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term, Values, joints_of
from runtime.motion.motion import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Errors:
    """Error of every joint on one set of recordings: RMS and ‖τ − τ̂‖/‖τ‖."""

    rms: tuple[float, ...]
    relative: tuple[float, ...]


@dataclass(frozen=True)
class Step:
    """A fitted structure: after `added` (None: the model as given)."""

    added: Term | None
    identification: Identification
    joints: tuple[JointSeries, ...]
    fitted: Errors
    held_out: Errors | None

    @classmethod
    def of(
        cls,
        added: Term | None,
        identification: Identification,
        joints: tuple[JointSeries, ...] | None = None,
        held_out: Errors | None = None,
    ) -> Step:
        """With the errors of its joints; joints: the series of the identification where they are there already."""
        found = series(identification) if joints is None else joints
        errors = Errors(tuple(j.rms for j in found), tuple(j.relative for j in found))
        return cls(added, identification, found, errors, held_out)

    @property
    def floors(self) -> list[float]:
        return [s.floor.value for s in self.joints]

    @property
    def shapes(self) -> dict[Term, Values]:
        return self.identification.fit.shapes

    @property
    def values(self) -> dict[Term, Values]:
        """Shapes, and the parameters of what a further sensor shows: what stands in a model file with this step."""
        fit = self.identification.fit
        return {**fit.shapes, **{t: {name: e.value for name, e in v.items()} for t, v in fit.witnessed.items()}}


@dataclass(frozen=True)
class Finding:
    """A named effect: what speaks for it, what the data cannot tell from it, and against whom it was chosen."""

    evidence: Evidence
    rivals: tuple[Term, ...]
    verdict: Verdict
    before: Step
    after: Step

    @property
    def term(self) -> Term:
        return self.evidence.term

    @property
    def joint_index(self) -> int:
        """Of the joint (0-based) at which it shows: its own, or for one of the whole arm that where it shows most."""
        if self.term.joint is not None:
            return self.term.joint - 1
        falls = [1 - b / a if a else 0.0 for a, b in zip(self.before.fitted.rms, self.after.fitted.rms, strict=True)]
        return int(np.argmin([-f for f in falls]))

    def share(self) -> float:
        """(rms_before² − rms_after²) / (rms_before² − floor²), at most 1; of the twist where that is what shows it."""
        if self.evidence.twist is not None:
            return min(self.evidence.share, 1.0)
        i = self.joint_index
        before, after = self.before.fitted.rms[i], self.after.fitted.rms[i]
        excess = before**2 - self.before.joints[i].floor.value ** 2
        return float(np.clip((before**2 - after**2) / excess, 0.0, 1.0)) if excess > 0 else 0.0


@dataclass
class Search:
    """A search from one structure; each step refits everything before the next effect is sought.

    steps     the structure as given, then with each finding added
    findings  in the order in which they were added
    last      the last comparison of candidates
    names     files of the recordings, in their order
    """

    model: Model
    motion: Motion
    held_out: Motion | None = None
    steps: list[Step] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    last: Verdict = field(default_factory=lambda: Verdict((), ()))
    names: tuple[str, ...] = ()
    _field: CandidateField | None = None
    _taken_back: set[Term] = field(default_factory=set)

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
            identification = _beside(identification, start.witnessed)
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

    def advance(self) -> Finding | None:
        """Add what only a link-side encoder shows, or else the best candidate that passes every gate, or a pair that
        it stood for; None if nothing passes."""
        step = self.steps[-1]
        ground = self._field_of(step)
        self.last = judge(ground, step.floors)
        if self._show(step, witnessed(ground)):
            return self.findings[-1]
        finding = self._forward(step)
        pair = self._pair(step, finding)
        if pair is not None:
            self.findings += pair
            self.steps += [f.after for f in pair]
            self._leave_out_replaced()
        elif finding is not None:
            self.findings.append(finding)
            self.steps.append(finding.after)
            self._leave_out_replaced()
            for _ in range(MOST_FINDINGS):
                if not self._reconsider():
                    break
        else:
            return None
        return self.findings[-1]

    def _show(self, step: Step, found: Sequence[Witnessed]) -> bool:
        """Add what link-side encoders show and the torque does not; whether there was any.

        It changes no torque: the fit stays as it is.
        """
        in_torque = {e.term for e in self.last.ranked if e.passes}
        for one in (w for w in found if w.term not in in_torque):
            before = self.steps[-1]
            identification = _beside(before.identification, {one.term: one.values})
            self.steps.append(replace(before, added=one.term, identification=identification))
            self.findings.append(Finding(one.evidence, (), Verdict((one.evidence,), ()), before, self.steps[-1]))
        return self.steps[-1] is not step

    def _forward(self, step: Step) -> Finding | None:
        # A small part of much that is left may be true all the same: a recording that was not fitted can tell.
        vouched = self.held_out is not None
        able = [e for e in self.last.ranked if (e.passes or (vouched and e.small)) and self._able(e.term)]
        # What was taken back once would come and go for ever.
        able = [e for e in able if e.term not in self._taken_back]
        able.sort(key=lambda e: -e.delta_bic)
        for evidence in able:
            first = evidence is self.last.ranked[0]
            evidence, after = self._refitted(step, evidence, self.last if first else None)
            if self._better(step, after, evidence.term):
                group = (self.last.ranked[0].term, *self.last.rivals) if first else ()
                rivals = tuple(term for term in group if term != evidence.term)
                return Finding(evidence, rivals, self.last, step, after)
        return None

    def _able(self, term: Term) -> bool:
        """Whether the term's joint moves for long enough to say anything of it."""
        return any(seconds_moving(self.motion, i) >= LEAST_MOVING_S for i in joints_of(self.model, term)[:1])

    def _refitted(self, step: Step, evidence: Evidence, verdict: Verdict | None) -> tuple[Evidence, Step]:
        """The candidate and the step that adds it; one of its rivals instead, if that clearly leaves less.

        Candidates are ranked beside a base that was fitted without them; what an effect takes from others
        (a bristle from dry friction) shows only when everything is refitted.
        """
        rivals = verdict.rivals if verdict else ()
        contenders = [e for e in (verdict.ranked if verdict else ()) if e.term in rivals][:MOST_RIVALS]
        best, after = evidence, self._with(step, evidence.candidate)
        for rival in contenders:
            other = self._with(step, rival.candidate)
            joint = joints_of(self.model, rival.term)[0]
            if other.fitted.rms[joint] < (1 - CLEARLY_LESS) * after.fitted.rms[joint]:
                best, after = rival, other
        return best, after

    def _better(self, before: Step, after: Step, term: Term) -> bool:
        """Refitted as a whole, the error falls at one of the effect's joints and on the held-out recording, if any,
        by more than chance."""
        own = joints_of(self.model, term) if term.joint is None else (term.joint - 1,)
        falls = any(after.fitted.rms[i] < (1 - LEAST_FALL) * before.fitted.rms[i] for i in own)
        if before.held_out is None or after.held_out is None:
            return falls
        return falls and sum(r**2 for r in after.held_out.relative) < HELD_OUT_FALLS_TO * sum(
            r**2 for r in before.held_out.relative
        )

    def _pair(self, step: Step, single: Finding | None) -> tuple[Finding, Finding] | None:
        """Two effects that together explain clearly more than the best one with any second beside it."""
        if single is None and not any(e.delta_bic > LEAST_DELTA_BIC for e in self.last.ranked):
            return None
        ground = self._field_of(step)
        taken = None if single is None else single.term
        found = pairs.search(ground, [e.candidate for e in self.last.ranked])
        found = [p for p in found if not self._taken_back & set(p.terms)]
        own = [p for p in found if taken in p.terms]
        least = PAIR_WORTH_FITTING * own[0].gain if own else 0.0
        others = [p for p in found if taken not in p.terms and p.gain > least][:MOST_PAIRS]
        if not others:
            return None
        steps = [self._with(step, p.first, p.second) for p in others]
        beside = [self._with(step, own[0].first, own[0].second)] if own else []
        scores = self._whitened_bic(ground, [single.after if single else step, *steps, *beside])
        plain, scores, alternatives = scores[0], scores[1 : 1 + len(steps)], scores[1 + len(steps) :]
        best = int(np.argmin(scores))
        if plain - scores[best] < LEAST_DELTA_BIC or any(b - scores[best] < BIC_APART for b in alternatives):
            return None
        near = [p for p, score in zip(others, scores, strict=True) if 0 < score - scores[best] < BIC_APART]
        return self._both(step, others[best], steps[best], near)

    def _both(
        self, step: Step, pair: CandidatePair, together: Step, near: Sequence[CandidatePair]
    ) -> tuple[Finding, Finding] | None:
        """The findings of a pair, if each passes every gate beside the other; near: pairs that are about as likely."""
        alone = [self._with(step, c) for c in (pair.first, pair.second)]
        evidence = [
            rank(self._field_of(beside), [c.term], beside.floors).best
            for c, beside in ((pair.first, alone[1]), (pair.second, alone[0]))
        ]
        passed = [(e, a) for e, a in zip(evidence, alone, strict=True) if e is not None]
        if len(passed) < 2 or not self._better(step, together, pair.first.term):
            return None
        # On recordings that were not fitted, too, each must be worth having beside the other.
        if self.held_out and not all(
            self._better(a, together, t) for a, t in zip(alone, pair.terms[::-1], strict=True)
        ):
            return None
        (first, middle), (second, _) = sorted(passed, key=lambda item: -item[0].delta_bic)
        return (
            Finding(first, _instead(first.term, second.term, near), Verdict((first,), ()), step, middle),
            Finding(
                second,
                _instead(second.term, first.term, near),
                Verdict((second,), ()),
                middle,
                replace(together, added=second.term),
            ),
        )

    def _whitened_bic(self, ground: CandidateField, steps: Sequence[Step]) -> list[float]:
        """BIC of refitted structures under one noise model, that of the best of them."""
        fits = [s.identification for s in steps]
        rows = ground.ground.rows
        weighted = [sum(float(r.weight**2 * (e @ e)) for r, e in zip(rows, f.fit.residual, strict=True)) for f in fits]
        best = fits[int(np.argmin(weighted))].fit.residual
        noise = [r.autoregression(e) for r, e in zip(rows, best, strict=True)]
        total = sum(r.count for r in rows)
        found = []
        for f in fits:
            white = [r.whiten(e, ar) for r, e, ar in zip(rows, f.fit.residual, noise, strict=True)]
            fit = sum(bic(float(e @ e), r.count, 0) for r, e in zip(rows, white, strict=True) if r.count)
            found.append(fit + _unknowns(f.problem, f.fit.shapes) * float(np.log(total)))
        return found

    def _reconsider(self) -> bool:
        """Take back or exchange the first finding that later ones have made superfluous or less likely than another;
        whether there was one."""
        for k, finding in enumerate(self.findings[:-1]):
            if finding.evidence.twist is not None:
                continue
            rest = [(t, shape) for t, shape in self._so_far() if t != finding.term]
            without = self._step(None, self._structure(rest), self.steps[-1])
            verdict = judge(self._field_of(without), without.floors)
            own = next((e.delta_bic for e in verdict.ranked if e.passes and e.term == finding.term), -np.inf)
            best, others = verdict.best, [f for f in self.findings if f is not finding]
            if best is None or not self._better(without, self.steps[-1], finding.term):
                kept, shapes = others, {}
            elif best.delta_bic - own >= BIC_APART:
                others.insert(k, replace(finding, evidence=best, rivals=verdict.rivals, verdict=verdict))
                kept, shapes = others, {best.term: best.candidate.shape}
            else:
                continue
            self._taken_back.add(finding.term)
            self._rebuild(kept, shapes)
            return True
        return False

    def _leave_out_replaced(self) -> None:
        """A finding that the last one generalises stands in no structure any more: it was a special case of that one,
        whose evidence is then counted from where the replaced one began."""
        kept = [f for f in self.findings if f.term in self.steps[-1].values]
        if len(kept) == len(self.findings):
            return
        self._taken_back |= {f.term for f in self.findings} - {f.term for f in kept}
        self.findings = kept
        self._rebuild(kept, {})
        last = self.findings[-1]
        alone = rank(self._field_of(last.before), [last.term], last.before.floors).best
        if alone is not None:
            self.findings[-1] = replace(last, evidence=alone)

    def _rebuild(self, kept: Sequence[Finding], shapes: Mapping[Term, Values]) -> None:
        known = {**dict(self._so_far()), **shapes}
        steps, findings = self.steps[:1], []
        for k, finding in enumerate(kept):
            added = [(f.term, known[f.term]) for f in kept[: k + 1] if f.term in known]
            steps.append(self._step(finding.term, self._structure(added), self.steps[-1]))
            findings.append(replace(finding, before=steps[-2], after=steps[-1]))
        self.steps, self.findings = steps, findings


def _beside(identification: Identification, shown: Mapping[Term, Mapping[str, Estimate]]) -> Identification:
    """The same with what further sensors show beside the torque."""
    fit = identification.fit
    return replace(identification, fit=replace(fit, witnessed={**fit.witnessed, **shown})) if shown else identification


def _instead(term: Term, beside: Term, near: Sequence[CandidatePair]) -> tuple[Term, ...]:
    """What could stand for a term beside the other of its pair."""
    return tuple(t for p in near if beside in p.terms for t in p.terms if t not in (beside, term))


def _unknowns(problem: Problem, shapes: dict[Term, Values]) -> int:
    return problem.layout.size + sum(len(s) for s in shapes.values())


def errors_elsewhere(identification: Identification, motion: Motion) -> Errors:
    """Error of a fit, all its values as they are, on another motion."""
    found = []
    for i, left in enumerate(residuals_elsewhere(identification, motion)):
        use = motion.moving(i)
        found.append(errors(left[use], motion.torque(i, identification.fit.skew)[use]))
    return Errors(tuple(rms for rms, _ in found), tuple(relative for _, relative in found))


def residuals_elsewhere(identification: Identification, motion: Motion) -> list[Array]:
    """Per joint (M,) what a fit, all its values as they are, leaves of the torque on another motion; zero in rows
    that do not count."""
    fit, model = identification.fit, identification.model
    problem = Problem(model, motion, tuple(fit.shapes), fit.prediction)
    found = []
    for i in range(model.n):
        x, fixed = problem.rows(i, fit.shapes)
        left = motion.torque(i, fit.skew) - (fixed + fit.coefficients @ x)
        found.append(np.where(motion.moving(i), left, 0.0))
    return found


def seconds_moving(motion: Motion, joint: int) -> float:
    """For how long a joint (0-based) moves faster than its encoder's noise."""
    return float(motion.moving(joint).sum()) / motion.row_rate
