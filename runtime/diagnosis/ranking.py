"""Candidates weighed against each other beside a fitted model.

First ranking by cross-validated error; then the autoregression of the best candidate's residual whitens all rows, the
gates are asked, and BIC ranks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis import coupling
from runtime.diagnosis.candidates import Candidate, FittedBase
from runtime.diagnosis.further_sensors import FurtherSensors
from runtime.diagnosis.gates import (
    BIC,
    EDGE,
    ENCODERS,
    ERROR,
    LIKELIHOOD,
    MODEL,
    RESOLUTION,
    SHARE,
    TORQUE,
    GateResult,
)
from runtime.diagnosis.settings import (
    BIC_APART,
    FINALISTS,
    FINALISTS_OF_A_JOINT,
    OF_WHAT_IS_LEFT,
    VUONG_APART,
    WORTH_A_LOOK,
)
from runtime.model.loader import Model
from runtime.model.terms import Term, joints_of
from runtime.progress import of_each
from runtime.regression.noise import Whitening, vuong
from runtime.regression.rows import Block
from runtime.regression.system import LinearSystem, Solution
from runtime.wording import times_floor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Ranking:
    """All finalists, the best first; rivals: terms from which these data cannot separate the best."""

    candidates: tuple[Candidate, ...] = ()
    rivals: tuple[Term, ...] = ()

    @property
    def best(self) -> Candidate | None:
        """The first candidate if it passes every gate."""
        return self.candidates[0] if self.candidates and self.candidates[0].passes else None

    def of(self, term: Term) -> Candidate | None:
        """The candidate of a term."""
        return next((c for c in self.candidates if c.term == term), None)


NOT_RANKED = Ranking()
"""Before any comparison."""


@dataclass(frozen=True)
class Evidence:
    """Solutions without and with a candidate, plain and whitened.

    searched   number of shape parameters that were searched      among   of places among which the shape was chosen
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
    def error_fall(self) -> float:
        """Part by which the error, RMS, falls on folds that were not fitted."""
        ratio = float(self.after.held_out[0].sum()) / float(self.before.held_out[0].sum())
        return 1 - float(np.sqrt(max(ratio, 0.0)))

    def results(self, floor: float, edge: float, several: bool = False) -> Iterator[GateResult]:
        """Of the gates that the motor torque answers, first those that cost least. several: a joint may have several of
        the effect, and two of them share what is left."""
        yield BIC.asked(self.delta_bic)
        yield TORQUE.asked(times_floor(self.eff, floor))
        yield SHARE.asked(self.share, SHARE.limit / 2 if several else None)
        yield EDGE.asked(edge)
        yield LIKELIHOOD.asked(self.white_after.log_likelihood - self.white_before.log_likelihood)
        yield ERROR.asked(self.error_fall)


@dataclass
class Whitened:
    """A system before and after whitening by the noise model of its best candidate.

    system: of the base, or of its excerpt; floors (n,): noise floor of every joint
    """

    base: FittedBase
    system: LinearSystem
    floors: Sequence[float]
    best: Block | None

    @cached_property
    def _sensors(self) -> FurtherSensors:
        return FurtherSensors(self.base)

    @cached_property
    def _residual(self) -> tuple[Array, ...]:
        """Per joint (M,) what the best candidate leaves."""
        best = self.system if self.best is None else self.system.with_block(self.best)
        return best.solution.residual

    @cached_property
    def whitening(self) -> list[Whitening]:
        """Of each joint, by what makes the best candidate's residual white."""
        return [rows.whitening(r) for rows, r in zip(self.system.joints, self._residual, strict=True)]

    @cached_property
    def white(self) -> LinearSystem:
        return self.system.whitened(self.whitening, self._residual)

    def weighed(self, candidate: Candidate, block: Block) -> tuple[Candidate, Array]:
        """A candidate with its block on the system, and what every gate says of it; (N,) its whitened residual, the
        rows of all joints that count."""
        weighing = Weighing(self, candidate.term, candidate.searched, block=block, among=candidate.among)
        evidence = weighing.evidence()
        several = self.base.model.library.effects[candidate.term.effect].several
        theta = np.append(1.0, evidence.after.coefficients[len(self.system.unknown) :])
        results = (
            *evidence.results(weighing.floor, candidate.edge, several),
            *self._resolution(candidate),
            *weighing.of_torque(theta),
            *self._sensors.results(weighing.plain_base, candidate, block, theta),
        )
        parameters = evidence.white_after.system.rank + candidate.searched
        weighed = replace(candidate, eff=evidence.eff, parameters=parameters, results=results)
        return weighed, weighing.residual(evidence)

    def at_both(self, candidate: Candidate, block: Block, singles: Mapping[int, Block]) -> Candidate:
        """A candidate of two joints, and what the gates say of its torque at either; singles: by joint (0-based), what
        explains most there by itself."""
        replaced = self.base.replaced(candidate.term)
        plain, white = self.base.without(self.system, replaced), self.base.without(self.white, replaced)
        for single in (singles[i] for i in block.columns if i in singles):
            white = white.with_block(single.whitened(self.whitening))
        found = coupling.results(plain, white, block, block.whitened(self.whitening), self.floors)
        return replace(candidate, results=(*candidate.results, *found))

    def _resolution(self, candidate: Candidate) -> Iterator[GateResult]:
        """Where an encoder does not resolve a gap, its noise says where it is crossed, to which the torque of the
        flanks does not answer in proportion: it cannot be compensated for."""
        play = self.base.model.library.effects[candidate.term.effect].of_kind("play")
        if play is None or candidate.term.joint is None:
            return
        motion, own = self.base.motion, candidate.term.joint - 1
        noise = np.sqrt(motion.band.position_density[own] / (2 * motion.pieces[0].dt))
        least = RESOLUTION.limit * max(float(noise), float(motion.band.resolution[own]) / np.sqrt(12))
        yield RESOLUTION.asked(candidate.shape[play.name], least)


@dataclass
class Weighing:
    """A term's block beside a whitened system, as things are or with a torque of the term put into the measured one.

    searched: number of shape parameters that were searched; among: of places among which the shape was chosen
    """

    beside: Whitened
    term: Term
    searched: int
    block: Block
    among: int = 1

    def __post_init__(self) -> None:
        base, replaced = self.beside.base, self.beside.base.replaced(self.term)
        self.plain_base = base.without(self.beside.system, replaced)
        self._white_block = self.block.whitened(self.beside.whitening)
        self.joints = joints_of(base.model, self.term)
        self.floor = self.beside.floors[self.joints[0]]

    @cached_property
    def _instead(self) -> tuple[LinearSystem, LinearSystem]:
        base = self.beside.base
        white = base.without(self.beside.white, base.replaced(self.term))
        return self.plain_base.with_block(self.block), white.with_block(self._white_block)

    @cached_property
    def _added(self) -> tuple[LinearSystem, LinearSystem]:
        if not self.beside.base.replaced(self.term):
            return self._instead
        return self.beside.system.with_block(self.block), self.beside.white.with_block(self._white_block)

    def evidence(self, added: Array | None = None) -> Evidence:
        """added (1 + k,): parts of the block's torque and columns that are put into the measured torque."""
        own, (plain, white) = self.beside, self._instead
        count = max(1, own.system.joints[self.joints[0]].count)
        rms = [own.base.rms(i) for i in self.joints]
        floors = [own.floors[i] for i in self.joints]
        before, white_before = own.system.solution, own.white.solution
        after, white_after = plain.solution, white.solution
        if added is not None:
            before, white_before = (system.solve_before(added) for system in self._added)
            after, white_after = plain.solve(added), white.solve(added)
        return Evidence(
            before,
            after,
            white_before,
            white_after=white_after,
            searched=self.searched,
            among=self.among,
            unit=rms[0] / float(np.sqrt(count)),
            excess=sum(max(1 - (f / r) ** 2, 0.0) for f, r in zip(floors, rms, strict=True) if r > 0),
            measured=own.system.solution.sse,
            count=count,
        )

    def own(self, theta: Array) -> float:
        """RMS at its own joint of what the model cannot take over of a torque, (1 + k,) `theta` of the columns."""
        kept, _ = self.beside.system.own(self.block.torque(theta))
        count = max(1, self.beside.system.joints[self.joints[0]].count)
        return float(np.sqrt(kept / count)) * self.beside.base.rms(self.joints[0])

    def held(self, theta: Array) -> tuple[float, float]:
        """How much of a torque, (1 + k,) `theta` of the columns, the noise alone holds, and its standard deviation."""
        plain, white = self._added
        return plain.held(theta)[0], white.held(theta)[1]

    def residual(self, evidence: Evidence) -> Array:
        """Whitened, all joints' rows that count, one after another."""
        pairs = zip(self.beside.white.joints, evidence.white_after.residual, strict=True)
        return np.concatenate([rows.weight * rows.used(r) for rows, r in pairs])

    def of_torque(self, theta: Array) -> tuple[GateResult, GateResult]:
        """Of the gates that ask a candidate's torque itself, (1 + k,) `theta` of its columns."""
        own, whole = (float(x) for x in self.plain_base.own(self.block.torque(theta)))
        noise = float(self.plain_base.own(self.block.noise(theta))[0])
        changed = noise / own if own else np.inf * noise if noise else 0.0
        return MODEL.asked(own / whole if whole else 1.0), ENCODERS.asked(changed)


def rank(base: FittedBase, terms: Sequence[Term], floors: Sequence[float]) -> Ranking:
    """These terms at their best shapes; `floors` are the noise floors of all joints."""
    # What explains next to nothing on the excerpt stays a witness, and its shape as it is.
    least = WORTH_A_LOOK / base.model.n * base.excerpt[1].solution.sse
    found = [base.refine(c) if c.gain > least or base.watched(c.term) else c for c in _finalists(base, terms)]
    return weigh(base, found, floors)


def weigh(base: FittedBase, candidates: Sequence[Candidate], floors: Sequence[float]) -> Ranking:
    """Candidates at their shapes; `floors` are the noise floors of all joints."""
    finalists, blocks, held = [], [], []
    for candidate in candidates:
        block = base.block(candidate.term, candidate.shape)
        if not block.finite:
            continue
        system = base.without(base.system, base.replaced(candidate.term))
        solution = system.with_block(block).solution
        error = float(solution.held_out[0].sum())
        left = sum(r.weight**2 * float(e @ e) for r, e in zip(system.joints, solution.residual, strict=True))
        # Where the noise that is compensated for is most of what is left, nothing is known of the rest.
        if error > OF_WHAT_IS_LEFT * left:
            finalists.append(candidate)
            blocks.append(block)
            held.append(error)
    if not finalists:
        return Ranking()
    beside = Whitened(base, base.system, floors, blocks[int(np.argmin(held))])
    found = [beside.weighed(c, b) for c, b in zip(finalists, blocks, strict=True)]
    found = _at_both_joints(beside, found, blocks)
    found.sort(key=lambda one: (not one[0].passes, -one[0].delta_bic))
    return Ranking(tuple(c for c, _ in found), _rivals(base.model, found))


def _at_both_joints(
    beside: Whitened, weighed: Sequence[tuple[Candidate, Array]], blocks: Sequence[Block]
) -> list[tuple[Candidate, Array]]:
    """Weighed candidates; those of two joints that pass are asked for their torque at either, beside the best
    candidate there that is of one joint."""
    effects = beside.base.model.library.effects
    singles: dict[int, tuple[float, Block]] = {}
    for (c, _), block in zip(weighed, blocks, strict=True):
        joint = (c.term.joint or 0) - 1
        if effects[c.term.effect].scope == "joint" and c.delta_bic > singles.get(joint, (0.0, block))[0]:
            singles[joint] = c.delta_bic, block
    alone = {joint: block for joint, (_, block) in singles.items()}
    return [
        (beside.at_both(c, block, alone) if c.passes and effects[c.term.effect].scope == "joints" else c, left)
        for (c, left), block in zip(weighed, blocks, strict=True)
    ]


def _finalists(base: FittedBase, terms: Sequence[Term]) -> list[Candidate]:
    """The candidates with the least cross-validated errors on the excerpt, among them some of every joint, that which
    leaves least there, and every transmission with an encoder on either side."""
    system = base.excerpt[1]

    def tried(term: Term) -> tuple[Candidate, float, float] | None:
        c = base.search(term)
        if c is None:
            return None
        solution = base.without(system, base.replaced(term)).with_block(base.trial(c.term, c.shape)).solution
        return c, float(solution.held_out[0].sum()), solution.sse

    tried_ones = [one for one in of_each("candidates", tried, terms) if one is not None]
    found = [c for c, _, __ in tried_ones]
    errors = {c.term: held for c, held, _ in tried_ones}
    left = {c.term: sse for c, _, sse in tried_ones}
    scored = sorted(found, key=lambda c: errors[c.term])
    # What does not lower the error on the excerpt at all passes no gate on the whole; a few stay as witnesses.
    least = (1 - WORTH_A_LOOK / base.model.n) * float(system.solution.held_out[0].sum())
    hopeful = [c for c in scored if errors[c.term] < least] or scored[:FINALISTS_OF_A_JOINT]
    chosen = hopeful[:FINALISTS]
    for joint in dict.fromkeys(c.term.joint for c in found):
        of_joint = [c for c in hopeful if c.term.joint == joint][:FINALISTS_OF_A_JOINT]
        # What happens in one stretch only, as a contact may, is left to chance where that stretch is held out.
        of_joint.append(min((c for c in found if c.term.joint == joint), key=lambda c: left[c.term]))
        chosen += of_joint
    chosen += [c for c in scored if base.watched(c.term)]
    return list({c.term: c for c in chosen}.values())


def _rivals(model: Model, ranked: Sequence[tuple[Candidate, Array]]) -> tuple[Term, ...]:
    """Those that pass, too, and that neither Vuong's test nor BIC sets apart from the first; what acts on none of its
    joints explains something else."""
    first, left = ranked[0]
    if not first.passes:
        return ()
    found, own = [], set(joints_of(model, first.term))
    for other, residual in ranked[1:]:
        alike = vuong(left, residual) < VUONG_APART or first.delta_bic - other.delta_bic < BIC_APART
        if other.passes and own & set(joints_of(model, other.term)) and alike:
            found.append(other.term)
    return tuple(found)
