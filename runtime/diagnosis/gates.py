"""The gates through which a candidate must pass, and the comparison of those that do.

First ranking by cross-validated error; then the autoregressive model of the winner's residual whitens
all rows, and BIC ranks. Every gate must open: on clean recordings a difference in BIC alone names an
effect more often than not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from runtime.diagnosis.candidates import Candidate, CandidateField
from runtime.diagnosis.further_sensors import FailedGate, FurtherSensors, Gate
from runtime.diagnosis.settings import (
    BIC_APART,
    FINALISTS,
    FINALISTS_OF_A_JOINT,
    GAP_OVER_NOISE,
    LEAST_DELTA_BIC,
    LEAST_EFFECT,
    LEAST_ERROR_FALL,
    LEAST_LIKELIHOOD_GAIN,
    LEAST_SHARE,
    LEAST_SHARE_OF_ONE,
    MOST_NOISE,
    OF_WHAT_IS_LEFT,
    VUONG_APART,
    WORTH_A_LOOK,
)
from runtime.documents.diagnosis import EvidenceEntry, TwistEvidence
from runtime.model.loader import Model
from runtime.model.terms import Term, joints_of
from runtime.progress import of_each
from runtime.regression.noise import Whitening, vuong
from runtime.regression.settings import LEAST_OWN
from runtime.regression.system import Block, LinearSystem, Solution
from runtime.wording import times_floor, told_apart, whole_apart

Array = NDArray[np.float64]

_ANSWERED: frozenset[Gate] = frozenset({"share", "likelihood", "error"})
"""Gates that a recording which was not fitted answers better."""


@dataclass(frozen=True)
class Shown:
    """What a further sensor shows of a candidate that the motor torque does not: RMS of what is unexplained on the
    sensor's rows without and with it, and of what only it explains there."""

    before: float
    after: float
    eff: float
    unit: str

    def document(self) -> TwistEvidence:
        return TwistEvidence(rms_before=self.before, rms_after=self.after, eff=self.eff, unit=self.unit)


@dataclass(frozen=True)
class Evidence:
    """What speaks for one candidate.

    eff               torque that only this candidate explains, RMS
    share             eff² over the variance that the base leaves above the noise floor
    delta_bic         fall of BIC on whitened rows
    likelihood_gain   cross-validated log-likelihood, whitened
    cv_gain           fall of the cross-validated squared error, relative
    parameters        number of unknowns of base and candidate
    residual          whitened, all joints' rows that count
    twist             set where a link-side encoder's rows were weighed in the place of the torque's: then eff is 0
    """

    candidate: Candidate
    eff: float
    share: float
    delta_bic: float
    likelihood_gain: float
    cv_gain: float
    failed: tuple[FailedGate, ...]
    parameters: int
    residual: Array
    twist: Shown | None = None

    @property
    def term(self) -> Term:
        return self.candidate.term

    @property
    def passes(self) -> bool:
        """Whether no gate is failed."""
        return not self.failed

    @property
    def answerable(self) -> bool:
        """Whether all that speaks against it is that it explains a small part of what is left, or little of stretches
        that were left out in turn: a recording that was not fitted tells more of both."""
        return bool(self.failed) and all(failed.gate in _ANSWERED for failed in self.failed)

    def document(self) -> EvidenceEntry:
        return EvidenceEntry(
            eff=self.eff,
            share_of_excess=self.share,
            delta_bic=self.delta_bic,
            cv_gain=self.cv_gain,
            cv_log_likelihood_gain=self.likelihood_gain if np.isfinite(self.likelihood_gain) else None,
            failed_gates=[failed.text for failed in self.failed],
            twist=UNSET if self.twist is None else self.twist.document(),
        )


@dataclass(frozen=True)
class Verdict:
    """All finalists, the best first; rivals: terms that the data cannot tell from the best."""

    ranked: tuple[Evidence, ...]
    rivals: tuple[Term, ...]

    @property
    def best(self) -> Evidence | None:
        """The strongest candidate if it passes every gate."""
        return self.ranked[0] if self.ranked and self.ranked[0].passes else None


@dataclass(frozen=True)
class Figures:
    """What the gates look at: equations without and with a candidate, plain and whitened.

    searched   number of shape parameters that were searched
    among      number of places, each of its own, among which the shape was chosen
    unit       N m (N): RMS at the candidate's own joint of a torque whose weighted square is 1
    excess     variance above the noise floors, in units of the residual's at the own joint, before anything was added
    measured   squared error of the model on the measured torque, before anything was added
    count      rows of the own joint
    """

    before: Solution
    after: Solution
    white_before: Solution
    white_after: Solution
    searched: int
    among: int
    unit: float
    excess: float
    measured: float
    count: int

    @property
    def eff(self) -> float:
        """RMS torque that only this effect explains, at its own joint, N m (N)."""
        return self.unit * float(np.sqrt(max(self.before.sse - self.after.sse, 0.0)))

    @property
    def share(self) -> float:
        """Part, 0 to 1, of what is above the noise floor that the effect takes away."""
        more = (self.before.sse - self.measured) / max(1, self.count)
        return self.eff**2 / max(self.unit**2 * self.count * (self.excess + more), self.eff**2, 1e-300)

    @property
    def delta_bic(self) -> float:
        """By how much BIC falls once the noise is white, the search through shapes and candidates charged."""
        # The largest of many chances is larger by twice the logarithm of their number.
        searched = self.searched * float(np.log(self.white_after.system.count)) + 2 * float(np.log(self.among))
        return self.white_before.bic - self.white_after.bic - searched

    @property
    def likelihood_gain(self) -> float:
        """Of the whitened log-likelihood on folds that were not fitted."""
        return self.white_after.log_likelihood - self.white_before.log_likelihood

    @property
    def cv_gain(self) -> float:
        """Part by which the squared error falls on folds that were not fitted."""
        return 1 - float(self.after.held_out[0].sum()) / float(self.before.held_out[0].sum())

    def failed_gates(self, floor: float, at_edge: bool, least_share: float = LEAST_SHARE) -> Iterator[FailedGate]:
        """Those that are not passed, first those that cost least to know."""
        delta, size = self.delta_bic, times_floor(self.eff, floor)
        if not delta > LEAST_DELTA_BIC:
            fall = whole_apart(delta, LEAST_DELTA_BIC)
            yield FailedGate("bic", f"whitened BIC falls by {fall}, not by {LEAST_DELTA_BIC:g}")
        if not size > LEAST_EFFECT:
            own = told_apart(size, LEAST_EFFECT)
            yield FailedGate("torque", f"its own torque is {own} of the noise floor, not more than {LEAST_EFFECT:g}")
        part, enough = 100 * self.share, 100 * least_share
        if not part > enough:
            text = f"it explains {whole_apart(part, enough)} % of what is left, not {enough:.0f} %"
            yield FailedGate("share", text)
        if at_edge:
            yield FailedGate("edge", "its shape lies at the edge of what was searched")
        gain, least = self.likelihood_gain, LEAST_LIKELIHOOD_GAIN
        if not gain > least:
            text = f"held-out log-likelihood changes by {whole_apart(gain, least)}; at least {least:g} is required"
            yield FailedGate("likelihood", text)
        if not 1 - np.sqrt(max(1 - self.cv_gain, 0.0)) > LEAST_ERROR_FALL:
            yield FailedGate("error", f"held-out error does not fall by {100 * LEAST_ERROR_FALL:g} %")


@dataclass
class WhitenedGround:
    """A ground of a field before and after whitening by the noise model of its best candidate.

    ground: the field's own, or that of its excerpt; floors (n,): every joint's noise floor
    """

    field: CandidateField
    ground: LinearSystem
    floors: Sequence[float]
    best: Block | None

    @cached_property
    def witness(self) -> FurtherSensors:
        return FurtherSensors(self.field)

    @cached_property
    def _residual(self) -> tuple[Array, ...]:
        """Per joint (M,) what the best candidate leaves."""
        best = self.ground if self.best is None else self.ground.with_block(self.best)
        return best.solution.residual

    @cached_property
    def whitening(self) -> list[Whitening]:
        """Of each joint, by what makes the best candidate's residual white."""
        return [row.whitening(r) for row, r in zip(self.ground.joints, self._residual, strict=True)]

    @cached_property
    def white(self) -> LinearSystem:
        return self.ground.whitened(self.whitening, self._residual)

    def weigh(self, candidate: Candidate, block: Block) -> Evidence:
        """All evidence for a candidate with its columns on the bench's ground."""
        weighing = Weighing(self, candidate.term, candidate.searched, block=block, among=candidate.among)
        figures = weighing.figures()
        several = self.field.model.library.effects[candidate.term.effect].several
        share = LEAST_SHARE_OF_ONE if several else LEAST_SHARE
        failed = tuple(figures.failed_gates(weighing.floor, candidate.at_edge, share))
        theta = np.append(1.0, figures.after.coefficients[len(self.ground.unknown) :])
        failed += (
            self._too_narrow(candidate)
            + weighing.doubts(theta)
            + self.witness.doubts(weighing.plain_base, candidate, block, theta)
        )
        return Evidence(
            candidate,
            figures.eff,
            figures.share,
            delta_bic=figures.delta_bic,
            likelihood_gain=figures.likelihood_gain,
            cv_gain=figures.cv_gain,
            failed=failed,
            parameters=figures.white_after.system.rank + candidate.searched,
            residual=weighing.residual(figures),
        )

    def _too_narrow(self, candidate: Candidate) -> tuple[FailedGate, ...]:
        """What speaks against a gap that the encoder does not resolve: where it is crossed is then the encoder's noise,
        to which the torque of the flanks does not answer in proportion, and which cannot be compensated for."""
        play = self.field.model.library.effects[candidate.term.effect].of_kind("play")
        if play is None or candidate.term.joint is None:
            return ()
        motion, own = self.field.motion, candidate.term.joint - 1
        noise = np.sqrt(motion.band.position_density[own] / (2 * motion.pieces[0].dt))
        least = GAP_OVER_NOISE * max(float(noise), float(motion.band.resolution[own]) / np.sqrt(12))
        size, unit = candidate.shape[play.name], self.field.model.joints[own].position_unit
        if size > least:
            return ()
        text = f"its {play.name} of {size:.2g} {unit} is no wider than the {least:.2g} that its encoder resolves"
        return (FailedGate("resolution", text),)


@dataclass
class Weighing:
    """A term's block on a bench, weighed as things are or with a torque of the term put into what was measured.

    searched: number of shape parameters that were searched; among: of places among which the shape was chosen
    """

    bench: WhitenedGround
    term: Term
    searched: int
    block: Block
    among: int = 1

    def __post_init__(self) -> None:
        field, ground = self.bench.field, self.bench.ground
        replaced = field.replaced(self.term)
        self.plain_base = field.without(ground, replaced)
        self.whitened = self.block.whitened(self.bench.whitening)
        self.joints = joints_of(field.model, self.term)
        self.floor = self.bench.floors[self.joints[0]]

    @cached_property
    def after(self) -> tuple[LinearSystem, LinearSystem]:
        """With the block in the place of what it generalises, plain and whitened."""
        field = self.bench.field
        white = field.without(self.bench.white, field.replaced(self.term))
        return self.plain_base.with_block(self.block), white.with_block(self.whitened)

    @cached_property
    def beside(self) -> tuple[LinearSystem, LinearSystem]:
        """With the block beside all that the model has, plain and whitened."""
        if not self.bench.field.replaced(self.term):
            return self.after
        return self.bench.ground.with_block(self.block), self.bench.white.with_block(self.whitened)

    def figures(self, added: Array | None = None) -> Figures:
        """added (1 + k,): parts of the block's torque and columns that are put into the measured torque."""
        bench, (plain, white) = self.bench, self.after
        count = max(1, bench.ground.joints[self.joints[0]].count)
        rms = [bench.field.rms(i) for i in self.joints]
        floors = [bench.floors[i] for i in self.joints]
        before, white_before = bench.ground.solution, bench.white.solution
        after, white_after = plain.solution, white.solution
        if added is not None:
            before, white_before = (system.solve_before(added) for system in self.beside)
            after, white_after = plain.solve(added), white.solve(added)
        return Figures(
            before,
            after,
            white_before,
            white_after=white_after,
            searched=self.searched,
            among=self.among,
            unit=rms[0] / float(np.sqrt(count)),
            excess=sum(max(1 - (f / r) ** 2, 0.0) for f, r in zip(floors, rms, strict=True) if r > 0),
            measured=bench.ground.solution.sse,
            count=count,
        )

    def own(self, theta: Array) -> float:
        """RMS at its own joint of what the model cannot take over of a torque, (1 + k,) `theta` of the columns."""
        kept, _ = self.bench.ground.own(self.block.torque(theta))
        row = self.bench.ground.joints[self.joints[0]]
        return float(np.sqrt(kept / max(1, row.count))) * self.bench.field.rms(self.joints[0])

    def luck(self, theta: Array) -> tuple[float, float]:
        """How much of a torque, (1 + k,) `theta` of the columns, the noise alone holds, and its standard deviation."""
        plain, white = self.beside
        return plain.held(theta)[0], white.held(theta)[1]

    def residual(self, figures: Figures) -> Array:
        """Whitened, all joints' rows that count, one after another."""
        found, joints = figures.white_after.residual, self.bench.white.joints
        return np.concatenate([row.weight * row.used(r) for row, r in zip(joints, found, strict=True)])

    def doubts(self, theta: Array) -> tuple[FailedGate, ...]:
        """What speaks against a candidate's torque itself, (1 + k,) `theta` of its columns."""
        own, whole = self.plain_base.own(self.block.torque(theta))
        noise, _ = self.plain_base.own(self.block.noise(theta))
        found = []
        if own < LEAST_OWN * whole:
            text = f"the model as it is can produce all but {100 * own / whole:.2g} % of its torque"
            found.append(FailedGate("model", text))
        if noise > MOST_NOISE * own:
            found.append(FailedGate("encoders", "another reading of the encoders would give another torque"))
        return tuple(found)


def rank(field: CandidateField, terms: Sequence[Term], floors: Sequence[float]) -> Verdict:
    """Rank these terms at their best shapes against the field; `floors` are all joints' noise floors."""
    return weigh(field, [field.refine(c) for c in _finalists(field, terms)], floors)


def weigh(field: CandidateField, candidates: Sequence[Candidate], floors: Sequence[float]) -> Verdict:
    """Rank candidates, each at its shape, against the field; `floors` are all joints' noise floors."""
    finalists, blocks, held = [], [], []
    for candidate in candidates:
        block = field.block(candidate.term, candidate.shape)
        if not block.finite:
            continue
        ground = field.without(field.ground, field.replaced(candidate.term))
        solution = ground.with_block(block).solution
        error, left = float(solution.held_out[0].sum()), solution.residual
        # Where the noise that is compensated for is most of what is left, nothing is known of the rest.
        if error > OF_WHAT_IS_LEFT * sum(r.weight**2 * float(e @ e) for r, e in zip(ground.joints, left, strict=True)):
            finalists.append(candidate)
            blocks.append(block)
            held.append(error)
    if not finalists:
        return Verdict((), ())
    bench = WhitenedGround(field, field.ground, floors, blocks[int(np.argmin(held))])
    evidence = [bench.weigh(c, b) for c, b in zip(finalists, blocks, strict=True)]
    evidence.sort(key=lambda e: (not e.passes, -e.delta_bic))
    return Verdict(tuple(evidence), _rivals(field.model, evidence))


def _finalists(field: CandidateField, terms: Sequence[Term]) -> list[Candidate]:
    """The candidates with the least cross-validated errors on the excerpt, among them some of every joint, that which
    leaves least there, and every transmission that an encoder watches."""
    ground = field.excerpt[1]

    def tried(term: Term) -> tuple[Candidate, Solution] | None:
        c = field.search(term)
        if c is None:
            return None
        return c, field.without(ground, field.replaced(term)).with_block(field.trial(c.term, c.shape)).solution

    both = [one for one in of_each("candidates", tried, terms) if one is not None]
    found = [c for c, _ in both]
    errors = {c.term: float(e.held_out[0].sum()) for c, e in both}
    left = {c.term: e.sse for c, e in both}
    scored = sorted(found, key=lambda c: errors[c.term])
    # What does not lower the error on the excerpt at all passes no gate on the whole; a few stay as witnesses.
    least = (1 - WORTH_A_LOOK / field.model.n) * float(ground.solution.held_out[0].sum())
    hopeful = [c for c in scored if errors[c.term] < least] or scored[:FINALISTS_OF_A_JOINT]
    chosen = hopeful[:FINALISTS]
    for joint in {c.term.joint for c in found}:
        of_joint = [c for c in hopeful if c.term.joint == joint][:FINALISTS_OF_A_JOINT]
        # What happens in one stretch only, as a contact may, is left to chance where that stretch is held out.
        of_joint.append(min((c for c in found if c.term.joint == joint), key=lambda c: left[c.term]))
        chosen += of_joint
    chosen += [c for c in scored if field.watched(c.term)]
    return list({c.term: c for c in chosen}.values())


def _rivals(model: Model, evidence: Sequence[Evidence]) -> tuple[Term, ...]:
    """Those that pass, too, and that neither Vuong's test nor BIC sets apart from the first; what acts on none of its
    joints explains something else."""
    first = evidence[0]
    if not first.passes:
        return ()
    found, own = [], set(joints_of(model, first.term))
    for other in (e for e in evidence[1:] if own & set(joints_of(model, e.term))):
        apart = vuong(first.residual, other.residual) >= VUONG_APART and (
            first.delta_bic - other.delta_bic >= BIC_APART
        )
        if other.passes and not apart:
            found.append(other.term)
    return tuple(found)
