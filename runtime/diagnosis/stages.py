"""Which physical effect is missing? The method, stage by stage.

Prepare: recordings become a motion in the band in which model and measurement are compared. Identify: the model file's
structure is fitted, and data that look wrong are refused. While a move improves the set of terms (search.py): every
effect of the library is scored beside the fitted model (candidates.py, ranking.py, score.py) and must open all gates
(gates.py); the best are added and everything is refitted and asked again (acceptance.py); earlier findings are dropped
or swapped where that is better. Decide: findings, silence, or a refusal (verdict.py), and how large each effect would
have had to be to be seen (detection_limits.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

from runtime.diagnosis import detection_limits
from runtime.diagnosis.acceptance import bristles
from runtime.diagnosis.search import (
    add_further,
    add_witnessed,
    compared,
    is_open,
    lengthened,
    mended,
    no_worse,
    paired,
    with_rivals,
    with_rivals_decided,
)
from runtime.diagnosis.settings import BUDGET, LEAST_MOVING_S
from runtime.diagnosis.steps import CutShort, SearchWork, Step, Trail, seconds_moving
from runtime.diagnosis.verdict import Diagnosis, decide
from runtime.fit_warnings import suspicions
from runtime.identification.identify import prepared, refuse_copies, refuse_two_sides, without_tip_rests
from runtime.model.loader import Model
from runtime.motion.motion import Motion, prepare
from runtime.progress import one_thread
from runtime.recordings.recording import Recording, RecordingError

OnStep = Callable[[Step], None]


def diagnose(
    model: Model,
    recordings: Sequence[Recording],
    held_out: Sequence[Recording] = (),
    budget: int = BUDGET,
) -> Diagnosis:
    """Fit the model file's structure, then name what is missing, or say why nothing can be named.

    model        the arm, its library of effects     recordings   that are fitted, at least one
    held_out     that are judged in the same band and never fitted
    budget       number of structures that the search may fit to all rows

    Returns the verdict with every step that led to it. Raises RecordingError where the recordings do not fit the arm,
    or each other.
    """
    return conclude(complete(begin(model, recordings, held_out), budget=budget))


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
    """The trail at its end: no move makes its set better. on_step is called with each step that lengthens it; budget:
    number of structures that may be fitted to all rows on the way."""
    shown: list[Step] = []

    def show(step: Step) -> None:
        shown.append(step)
        on_step(step)

    work = SearchWork(budget)
    trail = follow(replace(trail, work=work), show)
    with suppress(CutShort):
        while work.goes_on():
            decided = with_rivals_decided(trail)
            swapped = {f.term for f in decided.findings} != {f.term for f in trail.findings}
            trail = decided
            if not swapped:
                break
            trail = follow(trail, show)
    work.open = False
    trail = no_worse(trail, shown).with_told_gains()
    return with_rivals(trail, {f.term: tuple(dict.fromkeys((*f.rivals, *bristles(f)))) for f in trail.findings})


def follow(trail: Trail, on_step: OnStep = lambda _: None) -> Trail:
    """The trail lengthened as long as a move improves it and its work goes on."""
    while is_open(trail) and trail.work.goes_on():
        longer = advanced(trail)
        if longer.last is trail.last:
            return longer
        trail = longer
        on_step(trail.last)
    return trail


def advanced(trail: Trail) -> Trail:
    """One round: what only a link-side encoder shows, or else a pair in a finding's place, or the best candidate of
    every joint; then what was found before is asked again. The same last step where nothing holds; where the work is
    cut, what was found before."""
    trail = compared(trail)
    longer = trail
    try:
        for move in (add_witnessed, paired, lengthened):
            longer = move(trail)
            if longer.last is not trail.last:
                break
            trail = longer
        known = {f.term for f in trail.findings}
        fresh = [f.term for f in longer.findings if f.term not in known]
        for term in fresh:
            longer = add_further(longer, term)
        return mended(longer, fresh) if fresh else longer
    except CutShort:
        return longer


@one_thread()
def conclude(trail: Trail) -> Diagnosis:
    """Decide, and say how large each effect would have had to be, if all was sought."""
    found = decide(trail)
    if trail.suspicions or trail.stopped:
        return found
    able = [i for i in range(trail.model.n) if seconds_moving(trail.motion, i) >= LEAST_MOVING_S]
    return found.within(*detection_limits.of(found.last.base, found.last.floors, able))


def _held_out(fitted: Motion, recordings: Sequence[Recording], model: Model) -> Motion:
    motion = without_tip_rests(model, prepare(recordings, fitted.band, model))
    if motion.rigid_given != fitted.rigid_given:
        has, lacks = ("has", "do not") if motion.rigid_given else ("has no", "do")
        raise RecordingError(
            f"{recordings[0].path}: {has} tau1_rigid and the recordings that are fitted {lacks}; "
            "give the rigid-body torque in all of them or in none"
        )
    return motion
