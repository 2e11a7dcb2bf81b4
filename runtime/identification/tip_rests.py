"""Where the end-effector rests or turns under dry friction of its own: what that is there, no joint knows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from runtime.identification.regressors import Regressors, Signals
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term, joints_of
from runtime.motion import turns
from runtime.motion.motion import Motion
from runtime.motion.settings import STANDSTILL_NOISE, STANDSTILL_OF_TOP_SPEED

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RATE = "tip_rate"
"""The arm's function whose values are rates of the end-effector."""


def rubbing(model: Model, terms: Iterable[Term]) -> list[tuple[Term, str]]:
    """Terms without a memory that read a rate of the end-effector, and the name of that."""
    signal, effects = model.library.signal, model.library.effects
    plain = [term for term in terms if not effects[term.effect].states]
    return [(t, name) for t in plain for name in effects[t.effect].signals if _of_tip(signal[name].source)]


def _of_tip(source: object) -> bool:
    return isinstance(source, dict) and source.get("function") == RATE


def eliminated(model: Model, motion: Motion, prediction: Prediction) -> Motion:
    """The motion with what rubs at the end-effector unknown to every joint where that rests or turns.

    It reaches every joint, whose own motion shows nothing of it: where a plate sticks at the end of a stroke, all
    joints that press it may be moving.
    """
    most, unknown = np.zeros(model.n), []
    here, again = (Regressors(model, m, prediction) for m in (motion, motion.perturbed))
    for view in motion.views:
        first = view.joints[0]
        samples, dry = _unknown(
            motion, view.joints, here.signals(first), again=again.signals(first), prediction=prediction
        )
        unknown.append(samples)
        most = np.maximum(most, dry)
    floor = motion.band.torque_floor()[: model.n]
    quiet = np.minimum(motion.quiet, np.divide(floor, most, out=np.full(model.n, np.inf), where=most > 0))
    views = tuple(
        replace(view, pieces=tuple(p.unknown_at(x, quiet) for p, x in zip(view.pieces, samples, strict=True)))
        for view, samples in zip(motion.views, unknown, strict=True)
    )
    return replace(motion, views=views, quiet=quiet)


def _unknown(
    motion: Motion,
    joints: Sequence[int],
    here: Sequence[Signals],
    again: Sequence[Signals],
    prediction: Prediction,
) -> tuple[list[Mask], Array]:
    """Samples (n, N) of every piece at which what rubs is unknown to some joints (0-based), and (n,) as much as it may
    be of each joint's torque there; again: the signals as another reading of the encoders gives them."""
    model, floor = here[0].model, motion.band.torque_floor()
    unknown, most = [np.zeros(s.piece.q.shape, dtype=bool) for s in here], np.zeros(motion.n)
    for term, name in rubbing(model, prediction.values):
        rest = _standstill(here, again, term, name)
        for signals, samples in zip(here, unknown, strict=True):
            for i in (i for i in joints_of(model, term) if i in joints):
                dry = _dry_friction(signals, term, name, joint=i, rest=rest)
                samples[i] |= _rests(signals, term, name, joint=i, rest=rest) & (dry > floor[i])
                most[i] = max(most[i], dry.max(where=samples[i], initial=0.0))
    return unknown, most


def _standstill(here: Iterable[Signals], again: Iterable[Signals], term: Term, name: str) -> float:
    """The rate below which it rests: as of a joint, from its noise and from its top speed."""
    (own, other) = (
        np.concatenate([np.asarray(s.of(term, joints_of(s.model, term)[0])[name]) for s in side])
        for side in (here, again)
    )
    noise = float(np.sqrt(np.mean((other - own) ** 2)))
    return max(STANDSTILL_NOISE * noise, STANDSTILL_OF_TOP_SPEED * float(np.abs(own).max()))


def _rests(signals: Signals, term: Term, name: str, joint: int, rest: float) -> Mask:
    """(N,) samples of one piece."""
    piece = signals.piece
    return turns.at_rest(np.asarray(signals.of(term, joint)[name]), piece.dt, piece.low_pass.cutoff, rest)


def _dry_friction(signals: Signals, term: Term, name: str, joint: int, rest: float) -> Array:
    """(N,) half of what a term's torque at a joint (0-based) jumps by as a rate turns."""
    assert signals.prediction is not None
    values, read = signals.prediction.values[term], signals.of(term, joint)
    rate, library = np.full(len(signals.piece.t), rest), signals.model.library
    sides = [library.torque(term.effect, {**read, name: x}, values, signals.piece.dt) for x in (rate, -rate)]
    return np.asarray(np.abs(sides[0] - sides[1]) / 2)
