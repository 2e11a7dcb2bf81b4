"""The motion that makes rival effects distinguishable, found within a joint's limits and confirmed by simulation.

Rivals are effects that a recording could not tell apart. Pieces of motion (pieces.py) are judged by
how badly each rival explains the torque of the other along them (separation.py); the shortest choice that
comes near the best is recorded in simulation, once with each rival hidden in it, and diagnosed like any other
recording. Only that diagnosis decides whether the motion separates them.
"""

from __future__ import annotations

import gzip
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from runtime import files
from runtime.arrays import Array
from runtime.diagnosis.stages import begin, complete
from runtime.diagnosis.verdict import decide
from runtime.documents.parts import EffectAt, IterationsEntry, SearchEnd
from runtime.documents.recordings import (
    AssumedNoise,
    MovedJoint,
    ProposalDocument,
    ProposedMotion,
    ReliefEntry,
    SeparationEntry,
    TrialDiagnosis,
    ValuedEffect,
)
from runtime.experiments.asking import ExperimentError
from runtime.experiments.options import ExperimentSettings
from runtime.experiments.pieces import Envelope
from runtime.experiments.selection import WIDER, Freedom, PieceChoice, Repertoire, TorqueLimit, peaks, plans
from runtime.experiments.separation import MotionPieces, Pair, Separation, TrialArm, narrowed, nothing_in_the_way
from runtime.experiments.settings import MOST_PLANS, SAME_ANSWER, TRIAL_SEEDS
from runtime.model.loader import Model
from runtime.model.terms import Term, joints_of
from runtime.progress import is_late, of_long, one_thread, steps, within
from runtime.simulation.motion_file import without_dust
from runtime.simulation.settings import MARGIN, RATE
from runtime.simulation.simulate import Hidden

Tell = Callable[[str], None]


@dataclass(frozen=True)
class SimulatedDiagnosis:
    """One diagnosis of a simulated recording.

    hidden    what was in it, None for nothing         others  its rivals, which the diagnosis must rule out
    named     findings, the first first                rivals  what the diagnosis could not tell from the first
    """

    hidden: Term | None
    others: tuple[Term, ...]
    seed: int
    verdict: str
    named: tuple[Term, ...]
    rivals: tuple[Term, ...]

    @property
    def right(self) -> bool:
        """Whether what was hidden was named, and told from its rivals."""
        return self.problem is None

    @property
    def problem(self) -> str | None:
        """What is wrong with the answer, in words; None if nothing is."""
        if self.hidden is None:
            return f"with nothing hidden, {self.named[0]} is named" if self.named else None
        if not self.named:
            return f"with {self.hidden} hidden, nothing is named ({self.verdict})"
        if self.named[0] != self.hidden:
            return f"with {self.hidden} hidden, {self.named[0]} is named"
        open_rivals = [str(t) for t in (*self.rivals, *self.named[1:]) if t in self.others]
        return f"{self.hidden} is named, but not told from {', '.join(open_rivals)}" if open_rivals else None

    def document(self) -> TrialDiagnosis:
        return TrialDiagnosis(
            hidden=None if self.hidden is None else place(self.hidden),
            seed=self.seed,
            verdict=self.verdict,
            named=[place(t) for t in self.named],
            rivals=[place(t) for t in self.rivals],
            right=self.right,
            problem=self.problem,
        )


@dataclass(frozen=True)
class Confirmation:
    """Diagnoses of recordings of one motion, one for each rival and seed. True if all that were asked for are right.

    asked   number of diagnoses that it takes; fewer were made where an answer was wrong, or the search was cut
    """

    trials: tuple[SimulatedDiagnosis, ...]
    asked: int

    def __bool__(self) -> bool:
        return self.problem is None

    @property
    def finished(self) -> bool:
        """Whether it is decided: by a wrong answer, or as all are right."""
        return len(self.trials) == self.asked or not all(trial.right for trial in self.trials)

    @property
    def problem(self) -> str | None:
        """What is wrong with the first wrong answer, or with their number, in words; None if all are right."""
        wrong = next((trial.problem for trial in self.trials if trial.problem), None)
        if self.finished:
            return wrong
        return f"the search was cut after {len(self.trials)} of {self.asked} diagnoses; a longer one decides"


def confirm(bench: TrialArm, motion: Array, seeds: Sequence[int], most: int | None = None) -> Confirmation:
    """Diagnose the motion with each rival hidden in it (and nothing, if there is only one); ends at a wrong answer,
    after `most` diagnoses, and when the time has passed that work was given."""
    asked: list[_Asked] = [(motion, truth, seed) for seed in seeds for truth in _truths(bench)]
    trials: list[SimulatedDiagnosis] = []
    with steps("diagnoses", len(asked)) as step:
        for trial in of_long(partial(_trial, bench), asked[:most]):
            if trial is None:  # its search was cut
                break
            trials.append(trial)
            step()
            if not trial.right:
                break
    return Confirmation(tuple(trials), len(asked))


_Asked = tuple[Array, int | None, int]
"""A motion, which rival is hidden in it, and the seed of its noise."""


def _truths(bench: TrialArm) -> list[int | None]:
    """Numbers of the rivals, and None, nothing, where there is only one."""
    return [*range(len(bench.rivals)), *([None] if len(bench.rivals) == 1 else [])]


def _trial(bench: TrialArm, asked: _Asked) -> SimulatedDiagnosis | None:
    """None if the diagnosis was cut."""
    motion, truth, seed = asked
    hidden = None if truth is None else bench.rivals[truth]
    # Recordings of different rivals get different noise.
    own = len(bench.rivals) * seed + (0 if truth is None else truth)
    begun = begin(bench.model, [bench.record(motion, hidden, own)])
    # What is named at other joints decides nothing between the rivals.
    at = frozenset(i for r in bench.rivals for i in joints_of(bench.model, r.term))
    trail = complete(replace(begun, sought=at))
    if trail.stopped:
        return None
    result = decide(trail)
    term = None if hidden is None else hidden.term
    others = tuple(r.term for r in bench.rivals if r.term != term)
    named = tuple(f.term for f in result.findings)
    rivals = result.findings[0].rivals if result.findings else ()
    return SimulatedDiagnosis(term, others, seed, verdict=result.verdict, named=named, rivals=tuple(rivals))


@dataclass(frozen=True)
class Proposal:
    """A motion (n, N) at 1 kHz, what it consists of, what it separates, and what the diagnosis made of it.

    before, after   separations on the ordinary excitation and on this motion
    ordinary        the confirmation on the ordinary excitation, for comparison
    relief          what would separate the rivals where this motion does not: (what, smallest strength, enough)
    search          how far the search came: diagnoses made, and wider limits judged
    """

    bench: TrialArm
    motion: Array
    names: tuple[str, ...]
    times: int
    limit: TorqueLimit
    before: dict[Pair, Separation]
    after: dict[Pair, Separation]
    ordinary: Confirmation
    confirmation: Confirmation
    relief: tuple[tuple[str, float, bool], ...]
    search: IterationsEntry

    @property
    def separated(self) -> bool:
        """Whether every diagnosis along the motion is right."""
        return bool(self.confirmation)

    @property
    def seconds(self) -> float:
        """Length of the motion, s."""
        return self.motion.shape[1] / RATE

    @property
    def reason(self) -> str:
        """The answer in a sentence: which rivals are told apart, or what stands in the way."""
        rivals = [str(r.term) for r in self.bench.rivals]
        if self.separated and len(rivals) == 1:
            return f"hidden in this motion, {rivals[0]} is named; without it, nothing is"
        if self.separated:
            return f"hidden in this motion, each of {', '.join(rivals)} is named without the others as rivals"
        helpful = [name for name, _, enough in self.relief if enough]
        if helpful:
            rest = f"with {', or with '.join(helpful)}, there could be one"
        elif self.relief:
            tried = ", ".join(name for name, _, _ in self.relief)
            rest = f"none of {tried} changes that: {self._least}"
        else:
            rest = f"the torques differ by enough ({self._least}), but the diagnosis does not see it"
        return f"no motion within the limits was found: {self.confirmation.problem}; {rest}"

    @property
    def _least(self) -> str:
        """The pair that is least apart, in words."""
        terms = [str(r.term) for r in self.bench.rivals]
        (truth, other), s = min(
            ((pair, self.after[pair]) for pair in self.bench.pairs), key=lambda item: item[1].strength
        )
        what = "the base model" if other is None else terms[other]
        return f"{what} explains {terms[truth]} to within {s.rms:.2g} noise floors"

    def document(self) -> ProposalDocument:
        """As `tendon experiment --json`, but for the file."""
        rivals = self.bench.rivals
        motion = ProposedMotion(
            pieces=list(self.names),
            times=self.times,
            seconds=self.seconds,
            joints=[self._joint(i, t) for i, t in enumerate(peaks(self.bench, self.motion).T)],
        )
        noise = enumerate(zip(self.bench.noise, self.bench.floor, strict=True), 1)
        return ProposalDocument(
            separated=self.separated,
            reason=self.reason,
            rivals=[ValuedEffect(effect=r.term.effect, joint=r.term.joint, values=dict(r.values)) for r in rivals],
            motion=motion,
            noise=[AssumedNoise(joint=i, torque=torque, floor=floor) for i, (torque, floor) in noise],
            band=self.bench.band.document(),
            separations=[self._pair(*pair) for pair in self.after],
            trials=[t.document() for t in self.confirmation.trials],
            ordinary_trials=[t.document() for t in self.ordinary.trials],
            relief=[ReliefEntry(change=name, sigmas=s, enough=enough) for name, s, enough in self.relief],
            search=self.search,
        )

    def _joint(self, i: int, torque: Array) -> MovedJoint:
        joint, q = self.bench.model.joints[i], self.motion[i]
        allowed = Envelope.of(joint)
        return MovedJoint(
            joint=i + 1,
            name=joint.name,
            position=(float(q.min()), float(q.max())),
            position_limits=(allowed.middle - allowed.reach / MARGIN, allowed.middle + allowed.reach / MARGIN),
            position_stated=joint.position_limits is not None,
            position_unit=joint.position_unit,
            speed=float(np.abs(np.diff(q)).max() * RATE),
            speed_limit=allowed.speed / MARGIN,
            speed_stated=joint.speed_limit is not None,
            torque=float(torque[0]),
            torque_with_rivals=float(torque.max()),
            torque_limit=float(self.limit.largest[0, i] if joint.torque_limit is None else joint.torque_limit),
            torque_stated=joint.torque_limit is not None,
            force_unit=joint.force_unit,
        )

    def _pair(self, truth: int, other: int | None) -> SeparationEntry:
        rivals, pair = self.bench.rivals, (truth, other)
        return SeparationEntry(
            hidden=place(rivals[truth].term),
            explained_by=None if other is None else place(rivals[other].term),
            before=self.before[pair].rms,
            after=self.after[pair].rms,
            sigmas_before=self.before[pair].strength,
            sigmas_after=self.after[pair].strength,
        )


def place(term: Term) -> EffectAt:
    """Where an effect acts, for a document."""
    return EffectAt(effect=term.effect, joint=term.joint)


def propose(
    model: Model,
    rivals: Sequence[Hidden],
    settings: ExperimentSettings = ExperimentSettings(),
    tell: Tell | None = None,
    moving: Sequence[int] | None = None,
    ranges: Mapping[int, tuple[float, float]] = MappingProxyType({}),
    likely: Model | None = None,
    free: Callable[[Array], bool] = nothing_in_the_way,
) -> Proposal:
    """The motion within the model file's limits that separates the rivals, or comes nearest to it.

    rivals   one (against the base model) or more; parameters without a value get a moderate one
    tell     hears what is going on
    moving   joints (0-based) that move, the others stay in the middle of their ranges; None: all
    ranges   joint (0-based) -> (low, high), rad or m, in place of the file's limits
    likely, free   as for TrialArm.of
    Raises SimulationError, ExperimentError.
    """
    say = tell or (lambda _: None)
    if settings.noise <= 0:
        raise ExperimentError("without noise every difference would count; give a noise above 0")
    with one_thread(), within(settings.seconds):
        own = None if likely is None else narrowed(likely, ranges)
        bench = TrialArm.of(narrowed(model, ranges), rivals, settings, moving, own, free)
        limit = TorqueLimit.of(bench)
        say("judging the pieces of motion")
        repertoire = Repertoire.of(bench, limit, Freedom())
        seeds = [settings.seed + s for s in TRIAL_SEEDS]
        once = len(_truths(bench))
        work = _Work(settings.budget or (MOST_PLANS * len(seeds) + 1) * once + len(WIDER))
        choice, motion, confirmation = _tried(bench, repertoire, seeds, work, say)
        say("diagnosing the ordinary excitation")
        ordinary = work.confirmed(bench, bench.ordinary_path, seeds[:1])
        relief = _reliefs(bench, limit, work, say) if not confirmation and not choice.enough else ()
        return Proposal(
            bench,
            motion,
            tuple(repertoire.names[k] for k in choice.numbers),
            times=choice.times,
            limit=limit,
            before=MotionPieces.of(bench, bench.ordinary_path).weigh(),
            after=MotionPieces.of(bench, motion).weigh(),
            ordinary=ordinary,
            confirmation=confirmation,
            relief=relief,
            search=IterationsEntry.of(work.made, work.most, work.ends),
        )


@dataclass
class _Work:
    """What a search may do and has done: diagnoses and wider limits, both counted alike; and what cut it."""

    most: int
    made: int = 0
    ends: set[SearchEnd] = field(default_factory=set)

    def confirmed(self, bench: TrialArm, motion: Array, seeds: Sequence[int]) -> Confirmation:
        """As `confirm`, as far as the search may."""
        found = confirm(bench, motion, seeds, self.most - self.made)
        self.made += len(found.trials)
        if not found.finished:
            self.cut()
        return found

    @property
    def spent(self) -> bool:
        """Whether nothing further may be done."""
        return self.made >= self.most or is_late()

    def cut(self) -> None:
        """Note that something is left out."""
        self.ends.add("time" if is_late() else "budget")


def _tried(
    bench: TrialArm, repertoire: Repertoire, seeds: Sequence[int], work: _Work, say: Tell
) -> tuple[PieceChoice, Array, Confirmation]:
    """The first plan that is confirmed, or the last that was decided; the same wrong answer again ends it."""
    tried: list[tuple[PieceChoice, Array, Confirmation]] = []
    for choice in plans(repertoire.choices()):
        wrong = [confirmation.problem for *_, confirmation in tried]
        if wrong and wrong.count(wrong[-1]) >= SAME_ANSWER:
            break
        say(f"diagnosing {_told(repertoire, choice)}")
        motion = repertoire.motion(choice)
        confirmation = work.confirmed(bench, motion, seeds)
        if confirmation.finished or not tried:
            tried.append((choice, motion, confirmation))
        if confirmation:
            break
    return tried[-1]


def _told(repertoire: Repertoire, choice: PieceChoice) -> str:
    return f"{choice.seconds:.0f} s of {', '.join(repertoire.names[k] for k in choice.numbers)}"


def _reliefs(bench: TrialArm, limit: TorqueLimit, work: _Work, say: Tell) -> tuple[tuple[str, float, bool], ...]:
    """What each wider limit would do, as many of them as the search may judge."""
    found: list[tuple[str, float, bool]] = []
    for freedom in WIDER:
        if work.spent:
            work.cut()
            break
        found.append(_relief(bench, limit, freedom, say))
        work.made += 1
    return tuple(found)


def _relief(bench: TrialArm, limit: TorqueLimit, freedom: Freedom, say: Tell) -> tuple[str, float, bool]:
    say(f"judging the motion with {freedom.name}")
    quieter = replace(bench, quiet=freedom.noise)
    best = max(Repertoire.of(quieter, limit, freedom).choices(), key=lambda c: (c.visible, c.strength))
    return freedom.name, best.strength, best.enough


def write_motion(path: Path, model: Model, motion: Array, notes: Sequence[str] = ()) -> None:
    """Write positions (n, N) as `tendon simulate --motion` reads them; gzip if the name ends in .gz. notes: lines of
    comment at its top."""
    units = [joint.position_unit for joint in model.joints]
    lines = [f"# {note}" for note in notes]
    lines += [",".join(["t [s]", *(f"q{i} [{unit}]" for i, unit in enumerate(units, 1))])]
    row = ",".join(["%.3f", *["%.10f"] * model.n])
    lines += [row % (k / RATE, *q) for k, q in enumerate(without_dust(motion).T.tolist())]
    data = ("\n".join(lines) + "\n").encode()
    files.replace(path, gzip.compress(data, mtime=0) if str(path).endswith(".gz") else data)
