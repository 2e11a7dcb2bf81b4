"""Candidates weighed against each other beside a fitted model.

The fall of the squared error on the excerpt proposes; then the autoregression of the best candidate's residual whitens
all rows, and every finalist has its score there. Those that pass the gates are ordered by their gain less its price.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from runtime.arrays import Array
from runtime.diagnosis import score
from runtime.diagnosis.candidates import Candidate, FittedBase
from runtime.diagnosis.further_sensors import FurtherSensors
from runtime.diagnosis.gates import (
    BOTH_JOINTS,
    EDGE,
    ENCODERS,
    MODEL,
    PART,
    RESOLUTION,
    SCORE,
    TORQUE,
    GateResult,
)
from runtime.diagnosis.score import Evidence
from runtime.diagnosis.settings import FINALISTS, FINALISTS_OF_A_JOINT, WORTH_A_LOOK
from runtime.model.terms import Term, joints_of
from runtime.motion.settings import SOME
from runtime.progress import of_each
from runtime.regression.noise import Whitening
from runtime.regression.rows import Block
from runtime.regression.system import LinearSystem, Solution
from runtime.wording import times_floor


@dataclass(frozen=True)
class Ranking:
    """All finalists, the best first."""

    candidates: tuple[Candidate, ...] = ()

    @property
    def best(self) -> Candidate | None:
        """The first candidate if it passes every gate."""
        return self.candidates[0] if self.candidates and self.candidates[0].passes else None

    def of(self, term: Term) -> Candidate | None:
        """The candidate of a term."""
        return next((c for c in self.candidates if c.term == term), None)

    def with_refitted(self, refitted: Sequence[Candidate]) -> Ranking:
        """The ranking with what refits said of some of its candidates."""
        found = {c.term: c for c in refitted}
        return replace(self, candidates=tuple(found.get(c.term, c) for c in self.candidates))


NOT_RANKED = Ranking()
"""Before any comparison."""


@dataclass(frozen=True)
class Solutions:
    """Without and with a candidate, plain and whitened.

    unit   N m (N): RMS at the candidate's own joint of a torque whose weighted square is 1
    """

    before: Solution
    after: Solution
    white_before: Solution
    white_after: Solution
    unit: float

    @property
    def eff(self) -> float:
        """RMS torque that only this effect explains, at its own joint, N m (N)."""
        return self.unit * float(np.sqrt(max(self.before.sse - self.after.sse, 0.0)))

    @property
    def gain(self) -> float:
        """Of the log-likelihood, by the sums of squares alone: the weights are of equal variances."""
        before, after = (max(s.sse, 1e-300) for s in (self.white_before, self.white_after))
        return 0.5 * self.white_after.system.count * float(np.log(before / after))

    def evidence(self, price: float) -> Evidence:
        """By the whitened residuals."""
        independent = [rows.independent for rows in self.white_after.system.joints]
        before, after = self.white_before.residual, self.white_after.residual
        gain = score.gain(independent, before, after)
        return Evidence(gain, *score.dispersion(independent, before, after), price)


def results(evidence: Evidence, eff: float, floor: float, edge: float) -> Iterator[GateResult]:
    """Of the gates that the motor torque answers for any candidate."""
    yield SCORE.asked(evidence.score, evidence.due)
    yield TORQUE.asked(times_floor(eff, floor))
    yield EDGE.asked(edge)


def _of_two_joints(white: LinearSystem, block: Block) -> GateResult:
    """What the gate says of a whitened block at two joints; white: the system with the best of either joint.

    Where two rates are alike, or one joint's friction has another law, a torque on their sum explains what one joint
    lacks, and its columns at the other say nothing. What is common to both must show at either.
    """
    tied = white.with_block(block).solution.sse
    least = min(white.with_block(_part_at(block, {joint})).solution.sse for joint in block.columns)
    return BOTH_JOINTS.asked(0.5 * white.count * float(np.log(max(least, 1e-300) / max(tied, 1e-300))))


def _part_at(block: Block, joints: Collection[int]) -> Block:
    """What a block has at some of its joints (0-based), with coefficients of its own."""
    columns = {joint: part for joint, part in block.columns.items() if joint in joints}
    return replace(block, key=(block.key, *joints), columns=columns)


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

    @cached_property
    def without(self) -> tuple[Solution, Solution]:
        """Of the system and of the whitened one, without a candidate."""
        return self.system.solution, self.white.solution

    def weighed(self, candidate: Candidate, block: Block) -> Candidate:
        """A candidate with its block on the system, and what every gate says of it."""
        weighing = Weighing(self, candidate.term, candidate.searched, block=block, among=candidate.among)
        found = weighing.solutions()
        theta = np.append(1.0, found.after.coefficients[len(self.system.unknown) :])
        predicted = self.base.predicted(candidate.term, theta[1:])
        evidence = found.evidence(weighing.price(predicted))
        torque = self.base.torque(weighing.joints[0])
        told = (
            *results(evidence, found.eff, weighing.floor, candidate.edge),
            PART.asked(found.eff / torque if torque else 0.0),
            *self._resolution(candidate),
            *weighing.of_torque(theta),
            *self._sensors.results(weighing.plain_base, candidate, block, theta),
        )
        return replace(candidate, eff=found.eff, evidence=evidence, predicted=predicted, results=told)

    def at_both(self, candidate: Candidate, block: Block, singles: Mapping[int, Block]) -> Candidate:
        """A candidate of two joints, and what the gate says of its torque at either; singles: by joint (0-based), what
        explains most there by itself."""
        white = self.base.without(self.white, self.base.replaced(candidate.term))
        for single in (singles[i] for i in block.columns if i in singles):
            white = white.with_block(single.whitened(self.whitening))
        found = _of_two_joints(white, block.whitened(self.whitening))
        return replace(candidate, results=(*candidate.results, found))

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

    def price(self, predicted: bool | None = None) -> float:
        """What its score must exceed."""
        rows = self.beside.system.joints[self.joints[0]].independent
        return self.beside.base.price(self.term, self.searched, self.among, rows, predicted)

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

    def solutions(self, added: Array | None = None) -> Solutions:
        """added (1 + k,): parts of the block's torque and columns that are put into the measured torque."""
        own, (plain, white) = self.beside, self._instead
        count = max(1, own.system.joints[self.joints[0]].count)
        before, white_before = own.without
        after, white_after = plain.solution, white.solution
        if added is not None:
            before, white_before = (system.solve_before(added) for system in self._added)
            after, white_after = plain.solve(added), white.solve(added)
        unit = own.base.rms(self.joints[0]) / float(np.sqrt(count))
        return Solutions(before, after, white_before, white_after, unit)

    def dispersion(self, theta: Array) -> tuple[float, float]:
        """Of the score of a torque, (1 + k,) `theta` of the columns, beside noise like what is left now, and over how
        many stretches it is spread."""
        own, white = self.beside.white, self._instead[1]
        taken = white.base if white.base is not None else own
        left = taken.beyond(self._white_block.torque(theta))
        rows, start, x, r = own.joints, 0, [], []
        for joint, e in zip(rows, own.solution.residual, strict=True):
            x.append(left[start : start + joint.count] / (joint.weight or 1.0))
            r.append(joint.used(e))
            start += joint.count
        return score.dispersion([joint.independent for joint in rows], [a + b for a, b in zip(x, r, strict=True)], r)

    def own(self, theta: Array) -> float:
        """RMS at its own joint of what the model cannot take over of a torque, (1 + k,) `theta` of the columns."""
        kept, _ = self.beside.system.own(self.block.torque(theta))
        count = max(1, self.beside.system.joints[self.joints[0]].count)
        return float(np.sqrt(kept / count)) * self.beside.base.rms(self.joints[0])

    def held(self, theta: Array) -> tuple[float, float]:
        """How much of a torque, (1 + k,) `theta` of the columns, the noise alone holds, and its standard deviation."""
        plain, white = self._added
        return plain.held(theta)[0], white.held(theta)[1]

    def of_torque(self, theta: Array) -> tuple[GateResult, GateResult]:
        """Of the gates that ask a candidate's torque itself, (1 + k,) `theta` of its columns."""
        own, whole = (float(x) for x in self.plain_base.own(self.block.torque(theta)))
        noise = float(self.plain_base.own(self.block.noise(theta))[0])
        changed = noise / own if own else np.inf * noise if noise else 0.0
        return MODEL.asked(own / whole if whole else 1.0), ENCODERS.asked(changed)


def rank(base: FittedBase, terms: Sequence[Term], floors: Sequence[float]) -> Ranking:
    """These terms at their best shapes; `floors` are the noise floors of all joints."""
    # What explains next to nothing on the excerpt stays a witness, and its shape as it is.
    least = WORTH_A_LOOK / base.model.n * base.excerpt[1].sse
    found = [base.refine(c) if c.fall > least or base.watched(c.term) else c for c in _finalists(base, terms)]
    return weigh(base, found, floors)


def weigh(base: FittedBase, candidates: Sequence[Candidate], floors: Sequence[float]) -> Ranking:
    """Candidates at their shapes; `floors` are the noise floors of all joints."""
    finalists, blocks, errors = [], [], []
    for candidate in candidates:
        block = base.block(candidate.term, candidate.shape)
        if not block.finite:
            continue
        system = base.without(base.system, base.replaced(candidate.term))
        solution = system.with_block(block).solution
        left = sum(r.weight**2 * float(e @ e) for r, e in zip(system.joints, solution.residual, strict=True))
        # Where the noise that is compensated for is most of what is left, nothing is known of the rest.
        if solution.sse > SOME * left:
            finalists.append(candidate)
            blocks.append(block)
            errors.append(solution.sse)
    if not finalists:
        return Ranking()
    beside = Whitened(base, base.system, floors, blocks[int(np.argmin(errors))])
    found = [beside.weighed(c, b) for c, b in zip(finalists, blocks, strict=True)]
    found = _at_both_joints(beside, found, blocks)
    return Ranking(tuple(sorted(found, key=lambda c: (not c.passes, -c.evidence.net))))


def _at_both_joints(beside: Whitened, weighed: Sequence[Candidate], blocks: Sequence[Block]) -> list[Candidate]:
    """Weighed candidates; those of two joints that pass are asked for their torque at either, beside the best
    candidate there that is of one joint."""
    effects = beside.base.model.library.effects
    singles: dict[int, tuple[float, Block]] = {}
    for c, block in zip(weighed, blocks, strict=True):
        joint = (c.term.joint or 0) - 1
        if effects[c.term.effect].scope == "joint" and c.evidence.net > singles.get(joint, (0.0, block))[0]:
            singles[joint] = c.evidence.net, block
    alone = {joint: block for joint, (_, block) in singles.items()}
    return [
        beside.at_both(c, block, alone) if c.passes and effects[c.term.effect].scope == "joints" else c
        for c, block in zip(weighed, blocks, strict=True)
    ]


def _finalists(base: FittedBase, terms: Sequence[Term]) -> list[Candidate]:
    """The candidates by which the squared error on the excerpt falls most, among them some of every joint, and every
    transmission with an encoder on either side."""
    found = [c for c in of_each("candidates", base.search, terms) if c is not None]
    scored = sorted(found, key=lambda c: -c.fall)
    # What does not lower the error on the excerpt at all passes no gate on the whole; a few stay as witnesses.
    least = WORTH_A_LOOK / base.model.n * base.excerpt[1].sse
    hopeful = [c for c in scored if c.fall > least] or scored[:FINALISTS_OF_A_JOINT]
    chosen = hopeful[:FINALISTS]
    for joint in dict.fromkeys(c.term.joint for c in found):
        chosen += [c for c in hopeful if c.term.joint == joint][:FINALISTS_OF_A_JOINT]
    chosen += [c for c in scored if base.watched(c.term)]
    return list({c.term: c for c in chosen}.values())
