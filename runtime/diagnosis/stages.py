"""Which physical effect is missing? The method, stage by stage.

Prepare: recordings become a motion in the band in which model and measurement are compared. Identify: the model file's
structure is fitted, and data that look wrong are refused. While a step improves: every effect of the library is ranked
beside the fitted model (candidates.py, ranking.py) and must open all gates (gates.py); the best one, or a pair that it
stood for, is added and everything refitted (search.py, acceptance.py); earlier findings that later ones made
superfluous are pruned (pruning.py), and rivals are followed to their ends (rivals.py). Decide: findings, silence, or a
refusal (verdict.py), and how large each effect would have had to be to be seen (detection_limits.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

from runtime.diagnosis import detection_limits
from runtime.diagnosis.acceptance import bristles, explains_better
from runtime.diagnosis.grammar_search import Wider
from runtime.diagnosis.pruning import reconsidered, without_insignificant, without_replaced
from runtime.diagnosis.rivals import best_branch, branches, is_open, with_rivals
from runtime.diagnosis.search import add_further, add_witnessed, best_pair, best_single, compared
from runtime.diagnosis.settings import BUDGET, LEAST_MOVING_S, MOST_FINDINGS
from runtime.diagnosis.steps import CutShort, SearchWork, Step, Trail, seconds_moving
from runtime.diagnosis.verdict import Diagnosis, decide
from runtime.fit_warnings import suspicions
from runtime.identification.identify import prepared, refuse_copies, refuse_two_sides, without_tip_rests
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.motion.motion import Motion, prepare
from runtime.progress import one_thread
from runtime.recordings.recording import Recording, RecordingError

OnStep = Callable[[Step], None]


def diagnose(
    model: Model,
    recordings: Sequence[Recording],
    held_out: Sequence[Recording] = (),
    wider: Wider | None = None,
    budget: int = BUDGET,
) -> Diagnosis:
    """Fit the model file's structure, then name what is missing, or say why nothing can be named.

    model        the arm, its library of effects     recordings   that are fitted, at least one
    held_out     that are judged in the same band and never fitted
    wider        opens the same arm with guesses in its library; asked where findings leave something: a guess that
                 explains far more says that physics is missing which the library lacks
    budget       number of structures that the search may fit to all rows

    Returns the verdict with every step that led to it. Raises RecordingError where the recordings do not fit the arm,
    or each other.
    """
    return conclude(complete(begin(model, recordings, held_out), budget=budget), wider)


@one_thread()
def begin(model: Model, recordings: Sequence[Recording], held_out: Sequence[Recording] = ()) -> Trail:
    """Prepare and identify: a trail with the model file's structure fitted."""
    motion = prepared(model, recordings)
    held = _held_out(motion, held_out, model) if held_out else None
    refuse_copies([*recordings, *held_out])
    refuse_two_sides([*recordings, *held_out])
    trail = Trail.begun(model, motion, held, [r.path.name for r in recordings])
    found = suspicions(trail.last.fit, trail.names, held, [r.path.name for r in held_out])
    return replace(trail, suspicions=found)


@one_thread()
def complete(trail: Trail, on_step: OnStep = lambda _: None, budget: int = BUDGET) -> Trail:
    """The trail at its end: the best of those that follow the first finding with rivals, or one of these; without what
    is not significant beside the rest. on_step is called with each step of the first way; budget: number of structures
    that may be fitted to all rows on the way to the end."""
    shown: list[Step] = []

    def show(step: Step) -> None:
        shown.append(step)
        on_step(step)

    work = SearchWork(budget)
    trail = follow(replace(trail, work=work), show)
    with suppress(CutShort):
        number, others = branches(trail) if work.goes_on() else (0, [])
        if others:
            trail = best_branch([trail, *map(follow, others)], number)
    work.open = False
    trail = _no_worse(without_insignificant(trail), shown).with_told_gains()
    return with_rivals(trail, {f: _unrefuted(f) for f in trail.findings})


def follow(trail: Trail, on_step: OnStep = lambda _: None) -> Trail:
    """The trail lengthened as long as a step improves it and its work goes on."""
    while is_open(trail) and trail.work.goes_on():
        longer = advanced(trail)
        if longer.last is trail.last:
            return longer
        trail = longer
        on_step(trail.last)
    return trail


def advanced(trail: Trail) -> Trail:
    """Add, then prune: what only a link-side encoder shows, or else the best candidate that passes every gate, or a
    pair that it stood for. The same last step where nothing passes; where the work is cut, what was accepted before."""
    trail = compared(trail)
    single = None
    try:
        witnessed = add_witnessed(trail)
        if witnessed.last is not trail.last:
            return witnessed
        single = best_single(trail)
        pair = best_pair(trail, single)
        if pair is not None:
            return without_replaced(trail.to(pair))
        if single is None:
            return trail
        return _pruned(add_further(without_replaced(trail.to(single)), single.term))
    except CutShort:
        return trail if single is None else without_replaced(trail.to(single))


def _pruned(trail: Trail) -> Trail:
    for _ in range(MOST_FINDINGS):
        pruned = reconsidered(trail)
        if pruned is trail:
            break
        trail = pruned
    return trail


@one_thread()
def conclude(trail: Trail, wider: Wider | None = None) -> Diagnosis:
    """Decide, and say how large each effect would have had to be, if all was sought; wider as for `diagnose`."""
    found = decide(trail, wider)
    if trail.suspicions or trail.stopped:
        return found
    able = [i for i in range(trail.model.n) if seconds_moving(trail.motion, i) >= LEAST_MOVING_S]
    return found.within(*detection_limits.of(found.last.base, found.last.floors, able))


def _no_worse(trail: Trail, shown: Sequence[Step]) -> Trail:
    """The trail, or one that ends at the last of its steps, or of those that were shown, which explains recordings that
    were not fitted clearly better than its end."""
    each = [(i,) for i in range(trail.model.n)]
    better = [s for s in (*trail.steps, *shown) if explains_better(s, trail.last, each)]
    return trail.to(better[-1]) if better else trail


def _held_out(fitted: Motion, recordings: Sequence[Recording], model: Model) -> Motion:
    motion = without_tip_rests(model, prepare(recordings, fitted.band, model))
    if motion.rigid_given != fitted.rigid_given:
        has, lacks = ("has", "do not") if motion.rigid_given else ("has no", "do")
        raise RecordingError(
            f"{recordings[0].path}: {has} tau1_rigid and the recordings that are fitted {lacks}; "
            "give the rigid-body torque in all of them or in none"
        )
    return motion


def _unrefuted(finding: Step) -> tuple[Term, ...]:
    return tuple(dict.fromkeys(t for t in (*finding.rivals, *bristles(finding)) if t not in finding.refuted))
