"""From a fitted model to named effects: forward, in pairs where one effect stood for two, and backward again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from runtime.diagnosis import pairs
from runtime.diagnosis.candidates import CandidateField
from runtime.diagnosis.gates import Evidence, Verdict, rank, weigh
from runtime.diagnosis.likelihood import outgrown, plainest, whitened_bic
from runtime.diagnosis.pairs import CandidatePair
from runtime.diagnosis.settings import (
    BIC_APART,
    LEAST_DELTA_BIC,
    LEAST_EFFECT,
    LEAST_MOVING_S,
    LEAST_VOUCHED_SHARE,
    MOST_FINDINGS,
    MOST_PAIRS,
    MOST_RIVALS,
    PAIR_WORTH_FITTING,
    SHOWN_ALIKE,
)
from runtime.diagnosis.steps import Finding, Step, seconds_moving
from runtime.diagnosis.trail import Trail, with_shown
from runtime.diagnosis.twist import Witnessed, witnessed
from runtime.diagnosis.worth import (
    falls,
    missing_at,
    needless,
    own_joints,
    preferred,
    refuted,
    squared,
    told,
    worth_its_name,
)
from runtime.fit_warnings import Suspicion
from runtime.model.terms import Term, joints_of


@dataclass
class Search(Trail):
    """What to add, to exchange and to take back along a trail.

    last      the last comparison of candidates
    names     files of the recordings, in their order
    suspicions  what must be put right in the data before anything is sought
    """

    last: Verdict = field(default_factory=lambda: Verdict((), ()))
    names: tuple[str, ...] = ()
    suspicions: tuple[Suspicion, ...] = ()
    _taken_back: set[Term] = field(default_factory=set)

    @property
    def open(self) -> bool:
        """Whether more may be sought; several of one effect at a joint count once."""
        named = {(f.term.effect, f.term.joint) for f in self.findings}
        return not self.suspicions and len(named) < MOST_FINDINGS

    def advance(self) -> Finding | None:
        """Add what only a link-side encoder shows, or else the best candidate that passes every gate, or a pair that
        it stood for; None if nothing passes."""
        step = self.steps[-1]
        self.last = self._judged(step)
        if self._show(step, witnessed(self._field_of(step))):
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
            self._further(finding.term)
            for _ in range(MOST_FINDINGS):
                if not self._reconsider():
                    break
        else:
            return None
        return self.findings[-1]

    def _judged(self, step: Step) -> Verdict:
        """Candidates against a step."""
        ground = self._field_of(step)
        return rank(ground, self._lacking(step, ground.terms()), step.floors)

    def _in_place(self, step: Step, gone: Term) -> Verdict:
        """Candidates that could stand for a finding against the step without it. What acts on none of its joints
        explains something else, and what contains another finding would take that one's place as well."""
        ground, own = self._field_of(step), set(joints_of(self.model, gone))
        others = {(f.term.effect, f.term.joint) for f in self.findings if f.term != gone}
        terms = [
            t
            for t in ground.terms()
            if own & set(joints_of(self.model, t))
            and not any((g, t.joint) in others for g in self.model.library.effects[t.effect].generalises)
        ]
        return rank(ground, self._lacking(step, terms), step.floors)

    def _lacking(self, step: Step, terms: Sequence[Term]) -> list[Term]:
        """Those of some terms that do not act only where the residual is below the noise."""
        ground = self._field_of(step)
        return [t for t in terms if ground.watched(t) or missing_at(step, own_joints(self.model, t))]

    def _further(self, term: Term) -> None:
        """Add more of an effect of which a joint may have several, what explains most first, as long as they pass."""
        while self.model.library.effects[term.effect].several:
            step = self.steps[-1]
            ground = self._field_of(step)
            alike = [t for t in ground.terms() if (t.effect, t.joint) == (term.effect, term.joint)]
            verdict = weigh(ground, [c for t in alike for c in ground.each(t)], step.floors)
            able = sorted((e for e in verdict.ranked if e.passes), key=lambda e: -e.eff)
            tried = ((e, self._with(step, e.candidate)) for e in able)
            found = next(((e, after) for e, after in tried if worth_its_name(step, after, e.term)), None)
            if found is None:
                return
            self.findings.append(Finding(found[0], (), verdict, before=step, after=found[1]))
            self.steps.append(found[1])

    def _show(self, step: Step, found: Sequence[Witnessed]) -> bool:
        """Add what link-side encoders show; whether there was any that the torque alone does not.

        Where the torque falls with it, too, once all is refitted from there, it is fitted to the torque; else the fit
        stays as it is.
        """
        in_torque = {e.term for e in self.last.ranked if e.passes}
        for one in (w for w in found if w.term not in in_torque):
            before = self.steps[-1]
            finding = self._fitted_to_torque(before, one)
            if finding is None:
                same = with_shown(before.identification, {one.term: one.values})
                after = replace(before, added=one.term, identification=same)
                finding = Finding(one.evidence, (), Verdict((one.evidence,), ()), before=before, after=after)
            self.steps.append(finding.after)
            self.findings.append(finding)
        return self.steps[-1] is not step

    def _fitted_to_torque(self, before: Step, one: Witnessed) -> Finding | None:
        """A transmission that encoders show, from its values there; None if the torque does not fall with it."""
        ground = self._field_of(before)
        shown = {name: e.value for name, e in one.values.items()}
        choices = [{**c, **shown} for c in ground.choices(one.term)]
        if not choices or not missing_at(before, own_joints(self.model, one.term)):
            return None
        verdict = weigh(ground, [ground.best_of(one.term, choices)], before.floors)
        if not verdict.ranked:
            return None
        (evidence,) = verdict.ranked
        after = self._with(before, evidence.candidate)
        if not worth_its_name(before, after, one.term) or not _as_shown(after, one):
            return None
        return Finding(evidence, (), verdict, before=before, after=after)

    def _forward(self, step: Step) -> Finding | None:
        able = [e for e in self.last.ranked if (e.passes or self._vouched(e)) and self._able(e.term)]
        # What was taken back once would come and go for ever.
        able = [e for e in able if e.term not in self._taken_back]
        able.sort(key=lambda e: -e.delta_bic)
        alike = [e.term for e in self.last.ranked[:1]] + [*self.last.rivals]
        for evidence in able:
            first = evidence is self.last.ranked[0]
            finding = self._refitted(step, evidence, self.last.rivals if first else ())
            if worth_its_name(step, finding.after, finding.term) and not self._rest_of_another(
                (finding.term,), finding.after
            ):
                # Where the first has no values that the data tell, the data do not tell the next from it either.
                others = tuple(t for t in alike if t != finding.term) if finding.term in alike else ()
                return finding if first else replace(finding, rivals=others)
            if not any(falls(step, finding.after, i) for i in own_joints(self.model, finding.term)):
                alike = [t for t in alike if t != finding.term]
        return None

    def _vouched(self, evidence: Evidence) -> bool:
        """Whether a recording that was not fitted can tell if what gates on the fitted ones hold against it matters."""
        return self.held_out is not None and _answerable(evidence)

    def undecided(self, joint: int) -> Evidence | None:
        """What a recording that is not fitted would decide of a joint (0-based), the strongest; None where there is
        such a recording, or nothing that hangs on one."""
        open_ones = [e for e in self.last.ranked if _answerable(e) and joint in own_joints(self.model, e.term)]
        return max(open_ones, key=lambda e: e.delta_bic, default=None) if self.held_out is None else None

    def _able(self, term: Term) -> bool:
        """Whether the term's joint moves for long enough to say anything of it."""
        return any(seconds_moving(self.motion, i) >= LEAST_MOVING_S for i in joints_of(self.model, term)[:1])

    def _refitted(self, step: Step, evidence: Evidence, rivals: Sequence[Term]) -> Finding:
        """The candidate, with the step that adds it; one of its rivals instead, if that clearly leaves less.

        Candidates are ranked beside a base that was fitted without them; what an effect takes from others
        (a bristle from dry friction) shows only when everything is refitted. Recordings that were not fitted decide
        where they can.
        """
        others = [e for e in self.last.ranked if e.term in rivals and e is not evidence][:MOST_RIVALS]
        special = self.model.library.effects[evidence.term.effect].generalises
        others += [e for e in self.last.ranked if e.passes and e.term.effect in special and e not in others]
        tried = [evidence, *others]
        steps = [self._with(step, e.candidate) for e in tried]
        best = 0
        for k, (other, after) in enumerate(zip(tried, steps, strict=True)):
            joint = joints_of(self.model, other.term)[0]
            if preferred(after, steps[best], joint):
                best = k
        best = plainest([e.term for e in tried], steps, best)
        lost = tuple(e.term for e, after in zip(tried, steps, strict=True) if refuted(after, steps[best]))
        terms = [e.term for e in tried]
        gone = {terms[best], *outgrown(self._field_of(step).ground, terms, steps, best)}
        alike = tuple(t for t in (evidence.term, *rivals) if t not in gone)
        return Finding(tried[best], alike, self.last, before=step, after=steps[best], refuted=lost)

    def instead(self, number: int, term: Term) -> Search | None:
        """A search that differs from this one from a finding on: it has one of its rivals in its place; None where
        that rival was not weighed, or refitted is not worth its name."""
        finding = self.findings[number]
        evidence = next((e for e in finding.verdict.ranked if e.term == term), None)
        if evidence is None:
            return None
        begun = self.steps[: number + 1]
        other = replace(self, steps=begun, findings=self.findings[:number], _field=None, _taken_back=set())
        after = other._with(begun[-1], evidence.candidate)
        if not worth_its_name(begun[-1], after, term):
            return None
        rivals = tuple(t for t in (finding.term, *finding.rivals) if t != term)
        other.findings.append(Finding(evidence, rivals, finding.verdict, before=begun[-1], after=after))
        other.steps.append(after)
        return other

    def _pair(self, step: Step, single: Finding | None) -> tuple[Finding, Finding] | None:
        """Two effects that together explain clearly more than the best one with any second beside it; not in the place
        of one whose values the data tell if they do not tell theirs."""
        if single is None and not any(e.delta_bic > LEAST_DELTA_BIC for e in self.last.ranked):
            return None
        ground = self._field_of(step)
        taken = None if single is None else single.term
        found = pairs.search(ground, [e.candidate for e in self.last.ranked])
        found = [p for p in found if not self._taken_back & set(p.terms)]
        own = [p for p in found if taken in p.terms]
        least = own[0].gain if own else 0.0
        others = [
            p
            for p in found
            if taken not in p.terms and p.gain > PAIR_WORTH_FITTING * max(least, self._least_gain(ground, step, p))
        ][:MOST_PAIRS]
        if not others:
            return None
        steps = [self._with(step, p.first, p.second) for p in others]
        alone = single.after if single else step
        plain, *scores = whitened_bic(ground.ground, [alone, *steps])
        best = int(np.argmin(scores))
        if plain - scores[best] < LEAST_DELTA_BIC:
            return None
        if own:
            beside = self._with(step, own[0].first, own[0].second)
            alternative, *scores = whitened_bic(ground.ground, [beside, *steps])
            best = int(np.argmin(scores))
            if alternative - scores[best] < BIC_APART:
                return None
        if single and told(single.after, single.term) and not all(told(steps[best], t) for t in others[best].terms):
            return None
        near = [p for p, score in zip(others, scores, strict=True) if 0 < score - scores[best] < BIC_APART]
        return self._both(step, others[best], steps[best], near)

    def _least_gain(self, field: CandidateField, step: Step, pair: CandidatePair) -> float:
        """Fall of the squared error on the excerpt below which no two such effects can each be large enough to be named
        beside the other."""
        joints = [joints_of(self.model, term)[0] for term in pair.terms]
        return max(field.gain_of(i, LEAST_EFFECT * step.floors[i]) for i in joints)

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
        if len(passed) < 2 or not worth_its_name(step, together, pair.first.term):
            return None
        # Each must be worth having beside the other.
        if not all(worth_its_name(a, together, t) for a, t in zip(alone, pair.terms[::-1], strict=True)):
            return None
        one, other = pair.terms
        if self._alike(one, other) and needless(step, alone, together, (one.joint or 1) - 1) is not None:
            return None
        if self._rest_of_another(pair.terms, together):
            return None
        (first, middle), (second, _) = sorted(passed, key=lambda item: -item[0].delta_bic)
        return (
            Finding(first, _instead(first.term, second.term, near), Verdict((first,), ()), before=step, after=middle),
            Finding(
                second,
                _instead(second.term, first.term, near),
                Verdict((second,), ()),
                before=middle,
                after=replace(together, added=second.term),
            ),
        )

    def _reconsider(self) -> bool:
        """Take back or exchange the first finding that later ones have made superfluous or less likely than another;
        whether there was one."""
        last = self.findings[-1].term
        for k, finding in enumerate(self.findings[:-1]):
            if (finding.term.effect, finding.term.joint) == (last.effect, last.joint):
                continue  # several of one effect are there because each has what the others have not
            if finding.evidence.twist is not None:
                continue
            without = self._without(finding.term)
            verdict = self._in_place(without, finding.term)
            own = next((e.delta_bic for e in verdict.ranked if e.passes and e.term == finding.term), -np.inf)
            best, others = verdict.best, [f for f in self.findings if f is not finding]
            apart = best is not None and best.delta_bic - own >= BIC_APART
            if self._taken_over(finding, without) or (best is None and not self._clearly_likelier(without)):
                kept, shapes = others, {}
            elif best is not None and apart and not self._worse_with(best, finding, without):
                others.insert(k, replace(finding, evidence=best, rivals=verdict.rivals, verdict=verdict))
                kept, shapes = others, {best.term: best.candidate.shape}
            else:
                continue
            self._taken_back.add(finding.term)
            self._rebuild(kept, shapes)
            return True
        return False

    def take_back_untold(self) -> None:
        """Take back findings, the least likely first, whose size the data no longer tell beside all others."""
        while True:
            last = self.steps[-1]
            open_ones = [f for f in self.findings if f.evidence.twist is None and not told(last, f.term)]
            open_ones.sort(key=lambda f: f.evidence.delta_bic)
            gone = next((f for f in open_ones if not worth_its_name(self._without(f.term), last, f.term)), None)
            if gone is None:
                return
            self._taken_back.add(gone.term)
            self._rebuild([f for f in self.findings if f is not gone], {})

    def _without(self, term: Term) -> Step:
        """The last step without one of its findings, refitted."""
        rest = [(t, shape) for t, shape in self._so_far() if t != term]
        return self._step(None, self._structure(rest), self.steps[-1])

    def _taken_over(self, finding: Finding, without: Step) -> bool:
        """Whether later findings do without an earlier one, or that one is only what a later one's law lacks."""
        whole, last = self.steps[-1], self.findings[-1]
        if not worth_its_name(without, whole, finding.term):
            return True
        alike = self._alike(finding.term, last.term)
        return alike and self._superfluous(finding.term, (last.term,), whole) == 0

    def _clearly_likelier(self, without: Step) -> bool:
        """Whether all findings, refitted, are likelier than without one of them, by as much as a candidate must be.

        The gates weigh all joints under one variance, in which what one joint gains may drown in what others leave.
        """
        plain, whole = whitened_bic(self._field_of(without).ground, [without, self.steps[-1]])
        return plain - whole > LEAST_DELTA_BIC

    def _worse_with(self, evidence: Evidence, instead: Finding, without: Step) -> bool:
        """Whether another effect in a finding's place, all refitted, is not clearly likelier, explains hardly more than
        that finding does as a special case, or explains less of recordings that were not fitted."""
        whole, other = self.steps[-1], self._with_instead(evidence, without)
        likely, other_way = whitened_bic(self._field_of(without).ground, [whole, other])
        if likely - other_way < BIC_APART or plainest((evidence.term, instead.term), (other, whole), 0):
            return True
        if whole.held_out is None or other.held_out is None:
            return False
        return squared(other.held_out) > squared(whole.held_out)

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


def _as_shown(after: Step, one: Witnessed) -> bool:
    """Whether a fit to the torque has a transmission about as its encoders show it: what else the torque lacks would
    bend it to anything."""
    fitted = after.identification.inference.values[one.term]
    return all(1 / SHOWN_ALIKE < fitted[name].value / e.value < SHOWN_ALIKE for name, e in one.values.items())


def _answerable(evidence: Evidence) -> bool:
    return evidence.answerable and evidence.share > LEAST_VOUCHED_SHARE


def _instead(term: Term, beside: Term, near: Sequence[CandidatePair]) -> tuple[Term, ...]:
    """What could stand for a term beside the other of its pair."""
    return tuple(t for p in near if beside in p.terms for t in p.terms if t not in (beside, term))
