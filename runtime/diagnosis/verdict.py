"""The decision at the end of a trail, joint by joint: what is missing, or why nothing can be named.

The arm's verdict is made of its joints': an effect where any is named, else unexplained, refused or clean. Only data
that look wrong and recordings of different arms refuse the arm as a whole.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from runtime.diagnosis import credibility, detection_limits
from runtime.diagnosis.acceptance import error_falls, explains_better, only_nearest
from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.gates import RECORDINGS
from runtime.diagnosis.ranking import Ranking
from runtime.diagnosis.search import not_borne_out, undecided, with_rivals
from runtime.diagnosis.settings import LEAST_MOVING_S
from runtime.diagnosis.steps import (
    Step,
    Trail,
    explained,
    physics,
    remainder,
    seconds_moving,
    series_elsewhere,
)
from runtime.documents.diagnosis import SearchEntry
from runtime.identification.compare import JointSeries
from runtime.identification.identify import unsound
from runtime.model.loader import Model
from runtime.model.terms import joints_of
from runtime.motion.settings import MOST

Verdict = Literal["effect", "clean", "unexplained", "refused"]
Why = Literal[
    "wrong data",
    "contradiction",
    "cut",
    "standstill",
    "unsound fit",
    "excitation",
    "comes nearest",
    "found",
    "nothing explains",
    "not borne out",
    "above the floor",
    "held out",
    "blind",
    "noise",
]

VERDICTS: Final[Mapping[Why, Verdict]] = {
    "wrong data": "refused",
    "contradiction": "refused",
    "cut": "refused",
    "standstill": "refused",
    "unsound fit": "refused",
    "excitation": "refused",
    "comes nearest": "unexplained",
    "found": "effect",
    "nothing explains": "unexplained",
    "not borne out": "unexplained",
    "above the floor": "unexplained",
    "held out": "unexplained",
    "blind": "refused",
    "noise": "clean",
}
"""The verdict that each reason makes."""


@dataclass(frozen=True, eq=False)
class JointVerdict:
    """What is said of a joint (0-based), and what decided.

    named      findings by which its error falls
    withdrawn  findings that showed there and are not named
    undecided  what another recording would decide
    """

    joint: int
    why: Why
    named: tuple[Step, ...] = ()
    withdrawn: tuple[Step, ...] = ()
    undecided: Candidate | None = None

    @property
    def verdict(self) -> Verdict:
        return VERDICTS[self.why]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The verdict on a model and recordings.

    joints      what is said of each joint               found  the model as given, then every step that is named
    searched    the trail with what was withdrawn        elsewhere  joints' series on held-out recordings, if any
    ranking     the last comparison of candidates, with what was withheld
    recordings  the parameters of each recording alone   seen   how large each effect would have had to be
    unseen      number of effects of which a time limit left that open
    """

    joints: tuple[JointVerdict, ...]
    found: Trail
    searched: Trail
    ranking: Ranking
    recordings: credibility.Tables
    elsewhere: tuple[JointSeries, ...] = ()
    seen: tuple[detection_limits.Limit, ...] = ()
    unseen: int = 0

    @property
    def decisive(self) -> JointVerdict:
        """The joint that decides for the arm: the first with an effect, else unexplained, refused or clean; of joints
        that move, where there are any."""
        order: tuple[Verdict, ...] = ("effect", "unexplained", "refused", "clean")
        moving = [v for v in self.joints if v.why != "standstill"] or self.joints
        return min(moving, key=lambda v: order.index(v.verdict))

    @property
    def verdict(self) -> Verdict:
        return self.decisive.verdict

    @property
    def unexplained(self) -> tuple[int, ...]:
        """Joints (0-based) at which something is left that nothing explains."""
        return tuple(v.joint for v in self.joints if v.verdict == "unexplained")

    @property
    def search(self) -> SearchEntry:
        """How far the search came, and what cut it or the detection limits after it."""
        done = self.searched.work
        return SearchEntry(refits=done.refits, budget=done.budget, ended="time" if self.unseen else done.ended)

    @property
    def findings(self) -> tuple[Step, ...]:
        return self.found.findings

    @property
    def steps(self) -> tuple[Step, ...]:
        """The model as given, then with each finding added."""
        return self.found.steps

    @property
    def last(self) -> Step:
        return self.found.last

    @property
    def model(self) -> Model:
        return self.found.model

    def within(self, seen: Sequence[detection_limits.Limit], unseen: int = 0) -> Diagnosis:
        """The same with detection limits; no joint is clean where most effects could be as large as its torque, or
        where a time limit left that open."""
        clean = [v.joint for v in self.joints if v.why == "noise"]
        blind = [i for i in clean if unseen or _is_blind(self.last, i, seen)]
        joints = tuple(replace(v, why="cut" if unseen else "blind") if v.joint in blind else v for v in self.joints)
        return replace(self, joints=joints, seen=tuple(seen), unseen=unseen)


def decide(trail: Trail) -> Diagnosis:
    """The verdict, once nothing more passes the gates. Detection limits are left out."""
    compared = credibility.compare(trail.last.fit, trail.names, [s.floor.spectrum for s in trail.last.joints])
    whole = _refused(trail, compared)
    if whole is not None:
        joints = tuple(JointVerdict(i, whole) for i in range(trail.model.n))
        return Diagnosis(joints, trail.to(trail.first), trail, _withheld(trail, compared), compared)
    kept, withdrawn = _named(trail)
    last = kept.last
    elsewhere = () if trail.held_out is None else series_elsewhere(last.fit, trail.held_out)
    joints = tuple(withdrawn.get(i) or _judged(kept, i, elsewhere) for i in range(trail.model.n))
    return Diagnosis(joints, kept, trail, trail.ranking, compared, elsewhere)


def _refused(trail: Trail, compared: credibility.Tables) -> Why | None:
    """Why nothing can be said of any joint."""
    if trail.suspicions:
        return "wrong data"
    physical = any(physics(trail.last, i) for i in range(trail.model.n))
    if compared.contradictory and (compared.each_is_noise or not physical):
        return "contradiction"
    if credibility.poor_excitation(trail.first.fit) == "short motion":
        return "excitation"
    return None


def _withheld(trail: Trail, compared: credibility.Tables) -> Ranking:
    """The last comparison; findings that recordings of different arms made are in it as ruled out."""
    if not trail.findings:
        return trail.ranking
    named = {f.term for f in trail.findings}
    closed = RECORDINGS.asked(max(1.0, float(len(compared.inertial) + len(compared.effects))))
    mine = tuple(replace(f.candidate, results=(*f.candidate.results, closed)) for f in trail.findings)
    return Ranking((*mine, *(c for c in trail.ranking.candidates if c.term not in named)))


# what is named -------------------------------------------------------------------------------------------------------


def _named(trail: Trail) -> tuple[Trail, dict[int, JointVerdict]]:
    """The trail without the findings of joints (0-based) at which they do not hold, and what is said of these."""
    withdrawn: dict[int, JointVerdict] = {}
    for i in sorted({f.joint_index for f in trail.findings}):
        said = _withdrawn(trail, i)
        if said is not None:
            withdrawn[i] = said
            trail = trail.rebuilt([f for f in trail.findings if f.joint_index != i], {}, ())
    named = {f.term for f in trail.findings}
    return with_rivals(trail, {f.term: tuple(t for t in f.rivals if t not in named) for f in trail.findings}), withdrawn


def _withdrawn(trail: Trail, joint: int) -> JointVerdict | None:
    """Why the findings of a joint (0-based) are not named; None where they are. What lowers the joint's error on
    recordings that were not fitted is more than what comes nearest."""
    first, last = trail.first, trail.last
    here = tuple(f for f in trail.findings if f.joint_index == joint)
    if joint in unsound(last.fit):
        return JointVerdict(joint, "unsound fit", withdrawn=here)
    if not any(f.candidate.twist is None for f in here):
        return None  # an encoder on either side shows it, whatever the torque says
    if credibility.tangled(first.fit, joint):
        return JointVerdict(joint, "excitation", withdrawn=here)
    if trail.stopped or explains_better(last, first, [(joint,)]):
        return None  # what would explain the rest may not have been tried, or held-out recordings bear these out
    weak = physics(last, joint) and explained(first, last, joint) < MOST
    if weak or only_nearest(first, last, joint):
        return JointVerdict(joint, "comes nearest", withdrawn=here)
    return None


# what is said of a joint at which nothing was withdrawn --------------------------------------------------------------


def _judged(trail: Trail, joint: int, elsewhere: Sequence[JointSeries]) -> JointVerdict:
    """What is said of a joint (0-based) beside all that is named; elsewhere: its series on held-out recordings."""
    named = tuple(f for f in trail.findings if _shows_at(f, joint))
    if named and seconds_moving(trail.motion, joint) >= LEAST_MOVING_S:
        return JointVerdict(joint, "found", named)
    why = _why_not_named(trail, joint, elsewhere)
    if why == "not borne out":
        return JointVerdict(joint, why, undecided=not_borne_out(trail, joint))
    return JointVerdict(joint, why, undecided=undecided(trail, joint) if why == "nothing explains" else None)


def _shows_at(finding: Step, joint: int) -> bool:
    """Whether a joint's error (0-based) falls by a finding: its own, or one that acts on further joints."""
    acts = joint in joints_of(finding.fit.model, finding.term)
    return finding.joint_index == joint or (acts and error_falls(finding.previous, finding, joint))


def _why_not_named(trail: Trail, joint: int, elsewhere: Sequence[JointSeries]) -> Why:
    last = trail.last
    if seconds_moving(trail.motion, joint) < LEAST_MOVING_S:
        return "standstill"
    if joint in unsound(last.fit):
        return "unsound fit"
    if credibility.tangled(trail.first.fit, joint) or credibility.inseparable_inertia(trail.first.fit):
        return "excitation"
    if trail.stopped:
        return "cut"
    if remainder(last, joint):
        return "nothing explains"
    if not last.joints[joint].at_floor:
        return "above the floor"
    if not_borne_out(trail, joint):
        return "not borne out"
    return "held out" if elsewhere and not elsewhere[joint].at_floor else "noise"


def _is_blind(step: Step, joint: int, seen: Sequence[detection_limits.Limit]) -> bool:
    """Whether half of the effects of a joint (0-based) that have a limit could be as large as its torque, unseen."""
    series = step.joints[joint]
    parts = sorted(limit.rms for limit in seen if limit.joint == joint)
    return bool(parts) and parts[len(parts) // 2] * series.relative > MOST * series.rms
