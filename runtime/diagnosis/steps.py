"""Steps of a diagnosis: a structure fitted, its errors, what its residual holds beyond noise, and what was added.

A trail leads from the model as given to the last step. Nothing of it changes: a rule takes a trail and returns one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from runtime.arrays import Array
from runtime.diagnosis.candidates import Candidate, FittedBase
from runtime.diagnosis.gates import TORQUE
from runtime.diagnosis.heard import Errors
from runtime.diagnosis.ranking import NOT_RANKED, Ranking
from runtime.diagnosis.settings import ABOVE_NOISE, BUDGET, BURST_POWER, FLOOR_KNOWN, SLOW_AND_BURSTS, SLOW_DENSITY
from runtime.documents.parts import SearchEnd
from runtime.fit_warnings import Suspicion
from runtime.identification.compare import JointSeries, errors, series, series_on, structure_shares
from runtime.identification.drive_gains import told_gains
from runtime.identification.estimate import Estimate
from runtime.identification.fit import Fit
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import without_folded, without_untold
from runtime.identification.problem import Problem
from runtime.model.catalogue import EffectInfo
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term, Values, joints_of, structure
from runtime.motion import spectra
from runtime.motion.band import LineAbove
from runtime.motion.motion import Motion
from runtime.motion.settings import SOME
from runtime.progress import is_late


@dataclass(frozen=True, eq=False)
class Step:
    """A fitted structure: the model as given, or with a candidate that was added to the step before.

    chosen    what was added; None: the model as given      before   None for the first
    ranking   the comparison that it won          rivals   terms from which these data cannot separate it
    """

    fit: Fit
    joints: tuple[JointSeries, ...]
    fitted: Errors
    held_out: Errors | None = None
    chosen: Candidate | None = None
    before: Step | None = None
    ranking: Ranking = NOT_RANKED
    rivals: tuple[Term, ...] = ()

    @classmethod
    def of(
        cls,
        fit: Fit,
        joints: tuple[JointSeries, ...] | None = None,
        held_out: Errors | None = None,
    ) -> Step:
        """A fit with the errors of its joints; joints: the series of the fit where they are there already."""
        found = series(fit) if joints is None else joints
        motion = fit.motion
        left = tuple(r[motion.moving(i)] for i, r in enumerate(fit.residual))
        fitted = Errors(tuple(j.rms for j in found), tuple(j.relative for j in found), left)
        return cls(fit, found, fitted, held_out)

    def after(
        self, before: Step, chosen: Candidate, ranking: Ranking | None = None, rivals: Sequence[Term] = ()
    ) -> Step:
        """The same fit as the one with a candidate that was added to the step before."""
        won = Ranking((chosen,)) if ranking is None else ranking
        return replace(self, before=before, chosen=chosen, ranking=won, rivals=tuple(rivals))

    @property
    def floors(self) -> list[float]:
        """Of every joint what a perfect model may leave, in the unit of its torque."""
        return [s.noise for s in self.joints]

    @property
    def shapes(self) -> dict[Term, Values]:
        """Shape parameters of every term, as found."""
        return self.fit.shapes

    @property
    def values(self) -> dict[Term, Values]:
        """Shapes, and the parameters of what a further sensor shows: what stands in a model file with this step."""
        fit = self.fit
        return {**fit.shapes, **{t: {name: e.value for name, e in v.items()} for t, v in fit.witnessed.items()}}

    @property
    def base(self) -> FittedBase:
        """The fit as the base of candidates, with what was computed on it last."""
        return _base(self.fit)

    # of a step with a candidate -----------------------------------------------------------------------------------

    @property
    def candidate(self) -> Candidate:
        """What was added, of a step that added something."""
        assert self.chosen is not None
        return self.chosen

    @property
    def added(self) -> Term | None:
        """The term that was added; None for the model as given."""
        return None if self.chosen is None else self.chosen.term

    @property
    def term(self) -> Term:
        return self.candidate.term

    @property
    def previous(self) -> Step:
        """The step before."""
        assert self.before is not None
        return self.before

    @property
    def findings(self) -> tuple[Step, ...]:
        """The steps up to this one that added something, the first first."""
        return () if self.before is None else (*self.before.findings, self)

    @property
    def joint_index(self) -> int:
        """Of the joint (0-based) at which it shows: its own, or for one of the whole arm that where it shows most."""
        if self.term.joint is not None:
            return self.term.joint - 1
        both = zip(self.previous.fitted.rms, self.fitted.rms, strict=True)
        return int(np.argmin([-(1 - b / a) if a else 0.0 for a, b in both]))

    def share(self) -> float:
        """Part that it explains of what is above the noise; of the twist where that is what shows it."""
        if (twist := self.candidate.twist) is not None:
            return max(1 - (twist.after / twist.before) ** 2, 0.0)
        return max(explained(self.previous, self, self.joint_index), 0.0)


def explained(before: Step, after: Step, joint: int) -> float:
    """Part of a joint's squared error (0-based) above the noise floor that is gone."""
    was, now, floor = before.fitted.rms[joint], after.fitted.rms[joint], before.joints[joint].floor.value
    return (was**2 - now**2) / max(was**2 - floor**2, was**2 - now**2, 1e-300)


@lru_cache(maxsize=1)
def _base(fit: Fit) -> FittedBase:
    return FittedBase(fit)


class CutShort(Exception):
    """A search may fit no further structure."""


@dataclass
class SearchWork:
    """What a search has done, the same on any machine at any load; all trails of a search share it.

    budget   number of structures that it may fit to all rows     refits   that it has fitted
    ended    what cut it; complete: nothing yet                   open     whether the search goes on
    """

    budget: int = BUDGET
    refits: int = 0
    ended: SearchEnd = "complete"
    open: bool = True

    def goes_on(self, refits: int = 0) -> bool:
        """Whether the search may go on, and fit so many structures more."""
        spent = self.refits + refits > self.budget
        if self.open and (spent or is_late()):
            self.open, self.ended = False, "budget" if spent else "time"
        return self.open

    def count(self) -> None:
        """Count a structure before it is fitted; once the search has ended, none is counted. Raises CutShort."""
        if self.open and not self.goes_on(1):
            raise CutShort
        self.refits += self.open


@dataclass(frozen=True, eq=False)
class Trail:
    """The recordings and the steps that were taken on them.

    held_out     the motion that is never fitted            names       files of the recordings, in their order
    suspicions   what must be put right in the data before anything is sought
    last         the last step                              ranking     the last comparison of candidates
    left         sets of terms of shared joints that another took the place of: none is made again
    refused      candidates that did not hold once all was refitted, by term and the findings that shared its joints
    work         of the search: what it has done and may do
    sought       joints (0-based) at which effects are sought; None: all
    """

    model: Model
    motion: Motion
    held_out: Motion | None
    names: tuple[str, ...]
    suspicions: tuple[Suspicion, ...]
    last: Step
    ranking: Ranking = NOT_RANKED
    left: frozenset[frozenset[Term]] = field(default_factory=frozenset)
    refused: Mapping[tuple[Term, frozenset[Term]], Candidate] = field(default_factory=dict)
    work: SearchWork = field(default_factory=SearchWork)
    sought: frozenset[int] | None = None

    @classmethod
    def begun(cls, model: Model, motion: Motion, held_out: Motion | None, names: Sequence[str]) -> Trail:
        """The structure of the model file, fitted."""
        first = _fitted(model, motion, None, structure(model), None)
        held_out = held_out and without_folded(first.fit, held_out)
        if (told := without_untold(first.fit)) is not motion:
            motion, first = told, _fitted(model, told, held_out, structure(model), first)
        elif held_out is not None:
            first = replace(first, held_out=errors_elsewhere(first.fit, held_out))
        return cls(model, motion, held_out, tuple(names), (), first)

    @property
    def stopped(self) -> bool:
        """Whether the search was cut before nothing more passed."""
        return self.work.ended != "complete"

    @property
    def steps(self) -> tuple[Step, ...]:
        """From the first to the last."""
        return (self.first, *self.findings)

    @property
    def first(self) -> Step:
        return self.findings[0].previous if self.findings else self.last

    @property
    def findings(self) -> tuple[Step, ...]:
        """The steps that added something."""
        return self.last.findings

    def to(self, last: Step) -> Trail:
        """The trail that ends at another step."""
        return replace(self, last=last)

    def company(self, term: Term) -> tuple[Term, frozenset[Term]]:
        """A term and the findings that share a joint with it: what is found elsewhere changes no answer of it."""
        own = set(joints_of(self.model, term))
        return term, frozenset(f.term for f in self.findings if own & set(joints_of(self.model, f.term)))

    def left_before(self, term: Term, instead: Term | None = None) -> bool:
        """Whether the set that a term would make, in the place of another, was left for a better one."""
        return self.company(term)[1] - {instead} | {term} in self.left

    def structure(self, added: Sequence[tuple[Term, Values]]) -> Structure:
        """The structure as given with these terms in place of what they generalise, shapes as last found."""
        first = self.first.shapes
        latest = {**first, **self.last.shapes}
        known: Structure = {t: dict(latest[t]) for t in first}
        for term, shape in added:
            generalises = self.model.library.effects[term.effect].generalises
            for gone in [t for t in known if t.effect in generalises and t.joint == term.joint]:
                del known[gone]
            known[term] = dict(shape)
        return known

    def added(self) -> list[tuple[Term, Values]]:
        """All terms that were added, with their shapes as last found; not those that a later one generalises."""
        shapes = self.last.shapes
        return [(f.term, shapes[f.term]) for f in self.findings if f.term in shapes]

    def refitted(self, known: Structure, start: Step) -> Step:
        """Everything fitted for a structure, beginning at a step's values. Raises CutShort."""
        self.work.count()
        return _fitted(self.model, self.motion, self.held_out, known, start)

    def with_candidates(self, start: Step, *candidates: Candidate) -> Step:
        """All that was added so far and these candidates, refitted."""
        known = self.structure([*self.added(), *((c.term, c.shape) for c in candidates)])
        return self.refitted(known, start)

    def without(self, term: Term) -> Step:
        """The last step without one of the terms that were added, refitted."""
        rest = [(t, shape) for t, shape in self.added() if t != term]
        return self.refitted(self.structure(rest), self.last)

    def with_told_gains(self) -> Trail:
        """The trail with torques by the gains of drives that its last step tells, refitted: what was missing before
        moved them."""
        told = told_gains(self.last.fit)
        if not told or not self.findings:
            return self
        motion, held_out = self.motion.with_gains(told), self.held_out and self.held_out.with_gains(told)
        first = _fitted(self.model, motion, held_out, structure(self.model), self.first)
        return replace(self, motion=motion, held_out=held_out).rebuilt(self.findings, {}, (), first)

    def rebuilt(
        self, kept: Sequence[Step], shapes: Mapping[Term, Values], gone: Sequence[Term], first: Step | None = None
    ) -> Trail:
        """The trail with these findings alone, refitted one after another; gone: terms whose sets are not made again;
        first: the model as given, if not as it was fitted."""
        known, last = {**dict(self.added()), **shapes}, first or self.first
        for k, finding in enumerate(kept):
            added = [(f.term, known[f.term]) for f in kept[: k + 1] if f.term in known]
            made = self.refitted(self.structure(added), self.last)
            last = replace(
                made,
                before=last,
                chosen=finding.chosen,
                ranking=finding.ranking,
                rivals=finding.rivals,
            )
        return replace(self, last=last, left=self.left | {self.company(t)[1] for t in gone})


def _fitted(model: Model, motion: Motion, held_out: Motion | None, known: Structure, start: Step | None) -> Step:
    before = None if start is None else start.fit
    fit = fit_motion(model, motion, known, start=before)
    if before is not None:
        fit = with_witnessed(fit, before.witnessed)
    held = None if held_out is None else errors_elsewhere(fit, held_out)
    return Step.of(fit, held_out=held)


def with_witnessed(fit: Fit, witnessed: Mapping[Term, Mapping[str, Estimate]]) -> Fit:
    """The same with terms that further sensors show and the torque does not."""
    return replace(fit, witnessed={**fit.witnessed, **witnessed}) if witnessed else fit


def errors_elsewhere(fit: Fit, motion: Motion) -> Errors:
    """Error of a fit, all its values as they are, on another motion."""
    found, kept, motion = [], [], fit.on(motion)
    for i, left in enumerate(residuals_elsewhere(fit, motion)):
        use = motion.moving(i)
        found.append(errors(left[use], motion.recorded(i, fit.skew)[use]))
        kept.append(left[use])
    return Errors(tuple(rms for rms, _ in found), tuple(relative for _, relative in found), tuple(kept))


def residuals_elsewhere(fit: Fit, motion: Motion) -> list[Array]:
    """Per joint (M,) what a fit, all its values as they are, leaves of the torque on another motion; zero in rows
    that do not count."""
    model, motion = fit.model, fit.on(motion)
    problem = Problem(model, motion, tuple(fit.shapes), prediction=fit.prediction, ahead=fit.ahead)
    found = []
    for i in range(model.n):
        with np.errstate(over="ignore", invalid="ignore"):  # what is simulated along another motion may have no end
            x, fixed = problem.rows(i, fit.shapes)
            left = motion.torque(i, fit.skew) - (fixed + fit.coefficients @ x)
        found.append(np.where(motion.moving(i), left, 0.0))
    return found


def series_elsewhere(fit: Fit, motion: Motion) -> tuple[JointSeries, ...]:
    """Every joint's torque and prediction of a fit, all its values as they are, on another motion."""
    problem = Problem(fit.model, fit.on(motion), tuple(fit.shapes), prediction=fit.prediction, ahead=fit.ahead)
    return series_on(fit, problem, residuals_elsewhere(fit, motion))


def seconds_moving(motion: Motion, joint: int) -> float:
    """For how long a joint (0-based) moves faster than its encoder's noise."""
    return float(motion.moving(joint).sum()) / motion.row_rate(joint)


# what a residual holds beyond noise: physics that comes back with the motion, or a disturbance from outside ---------


@dataclass(frozen=True)
class RepeatingResidual:
    """What comes back with the motion.

    part     of the residual's variance
    follows  the signal that it follows most, after an effect was added; None: not asked
    own      whether the added effect reads that signal: then its law has another form
    """

    part: float
    follows: str | None = None
    own: bool = False


@dataclass(frozen=True)
class Disturbance:
    """What does not come back with the motion: a line, a slow part or bursts.

    line     the strongest frequency, with its part of the power      slow    ratio of densities, low to upper band
    bursts   s at which seconds begin that are as bad as half of the second worst
    repeats  whether the recordings repeat any motion
    """

    line: spectra.SpectralLine | None
    slow: float | None
    bursts: tuple[float, ...]
    repeats: bool


Remainder = RepeatingResidual | Disturbance


def remainder(step: Step, joint: int) -> Remainder | None:
    """What a joint's residual (0-based) holds beyond noise; None if it is noise, white or evenly coloured."""
    return physics(step, joint) or outside(step, joint)


def physics(step: Step, joint: int) -> RepeatingResidual | None:
    """What comes back with the motion at a joint (0-based)."""
    s = step.joints[joint]
    # Errors of coarse encoder steps come back with the motion, too; they are in the instruments' noise.
    if s.resolved and s.floor.repeatable(s.rms) and s.rms > ABOVE_NOISE * s.floor.spectrum:
        return RepeatingResidual(min(1.0, ((s.floor.repeating or 0.0) / s.rms) ** 2))
    return None


def after_effect(step: Step, joint: int, effect: EffectInfo) -> Remainder | None:
    """What is left at a joint (0-based) once an effect was named and added; None if it is noise."""
    s = step.joints[joint]
    part = (s.floor.repeating or 0.0) ** 2 / s.rms**2 if s.rms else 0.0
    if part < SOME or s.rms < (1 + FLOOR_KNOWN) * s.floor.spectrum or not s.resolved:
        return outside(step, joint)
    shares = structure_shares(s)
    strongest = max(shares, key=lambda name: shares[name])
    signal = step.fit.model.library.signal
    own = {signal[name].seen_over for name in effect.signals}
    is_own = strongest in own or (strongest == "direction" and "velocity" in own)
    return RepeatingResidual(min(part, 1.0), strongest, is_own)


def lines_above(step: Step) -> list[LineAbove]:
    """Lines of the torque over the motor's angle above the band which would be named within it and are not known from
    below it."""
    model, known = step.fit.model, dict[int, list[float]]()
    for term, shape in step.shapes.items():
        line = model.library.effects[term.effect].line
        if line is not None and term.joint is not None:
            known.setdefault(term.joint - 1, []).append(shape[line.name])
    return [
        line
        for line in step.fit.motion.band.above
        if line.rms > TORQUE.limit * step.floors[line.joint]
        and not any(abs(line.order / order - 1) < 0.01 for order in known.get(line.joint, ()))
    ]


def outside(step: Step, joint: int) -> Disturbance | None:
    """A line, a slow part or bursts that stand out of the noise of a joint (0-based)."""
    found = step.fit
    motion, residual, use = found.motion, found.residual[joint], found.motion.moving(joint)
    s = step.joints[joint]
    if not s.resolved:
        return None
    read = np.where(use, found.problem.reread(joint, found.shapes, found.coefficients), 0.0)
    left, rate = motion.noise_left(joint), motion.row_rate(joint)
    # At least half is the torque's own noise, though the encoder's was estimated larger.
    white = max(s.rms**2 - float(np.mean(read[use] ** 2)), 0.5 * s.rms**2) if use.any() else 1.0
    expected = white * left / (np.mean(left[use]) if use.any() else 1.0) + _smooth(read**2, rate)
    worst, rows = spectra.bursts(residual, use, expected, rate)
    if motion.band.jittered:
        # Noise is then loud where the motion is fast, and where the clocks that stamped it are apart.
        worst = 1.0
    slow = spectra.slow_over_white(residual, use, rate, motion.cutoff(joint)) / _slow_by_elimination(motion, joint)
    both = slow > SLOW_AND_BURSTS[0] and worst > SLOW_AND_BURSTS[1]
    line = spectra.strongest_line(residual, rate)
    if line is not None and line.share * s.rms**2 < float(np.mean(read[use] ** 2)):
        line = None  # coarse steps of an encoder come evenly where the speed is even
    is_slow = (slow > SLOW_DENSITY or both) and line is None
    in_bursts = worst > BURST_POWER or both
    if line is None and not is_slow and not in_bursts:
        return None
    times = tuple(float(t) for t in motion.row_time(joint)[rows]) if in_bursts else ()
    return Disturbance(line, slow if is_slow else None, times, s.floor.repeating is not None)


def _slow_by_elimination(motion: Motion, joint: int) -> float:
    """Density at low frequencies over that of the rest that white noise has at a joint (0-based) once turns were
    eliminated; 1 where none was."""
    eliminated, draws = motion.eliminated(joint), 16
    if not eliminated.shape[1]:
        return 1.0
    use, noise = motion.moving(joint), np.random.default_rng(0).standard_normal((eliminated.shape[0], draws))
    left = (noise - eliminated @ (eliminated.T @ noise)) * use[:, None]
    at = motion.row_rate(joint), motion.cutoff(joint)
    return float(np.mean([spectra.slow_over_white(x, use, *at) for x in left.T]))


def _smooth(x: Array, rate: float) -> Array:
    # Of a motion of less than a second, over all of it.
    width = min(len(x), max(1, round(rate)))
    return np.convolve(x, np.full(width, 1 / width), "same")
