"""Where the end-effector rests or turns under an effect with dry friction there: its force is known to no joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from runtime.estimation.regressors import Regressors, Signals
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term, joints_of
from runtime.motion import turns
from runtime.motion.motion import Motion
from runtime.motion.settings import STANDSTILL_NOISE, STANDSTILL_OF_TOP_SPEED

Array = NDArray[np.float64]

RATE = "tip_rate"
"""The arm's function whose values are rates of the end-effector."""


def rubbing(model: Model, terms: tuple[Term, ...]) -> dict[Term, list[str]]:
    """By term, the end-effector's rates that it reads."""
    signal = model.library.signal
    read = {t: [s for s in model.library.effects[t.effect].signals if _is_rate(signal[s].source)] for t in terms}
    return {term: names for term, names in read.items() if names and not model.library.effects[term.effect].states}


def _is_rate(source: object) -> bool:
    return isinstance(source, dict) and source.get("function") == RATE


def eliminated(model: Model, motion: Motion, prediction: Prediction) -> Motion:
    """The motion with what these effects' dry friction may hold where the end-effector rests as unknown as that of a
    joint at rest."""
    terms = rubbing(model, tuple(prediction.values))
    if not terms:
        return motion
    pairs = [Regressors(model, m, prediction).signals for m in (motion, motion.perturbed)]
    floor, pieces = motion.band.torque_floor(), list(motion.pieces)
    jump = np.zeros(model.n)
    found = [np.zeros(p.q.shape, dtype=bool) for p in pieces]
    for term, names in terms.items():
        for name in names:
            joints = joints_of(model, term)
            rates = [[np.asarray(s.of(term, joints[0])[name]) for s in side] for side in pairs]
            noise = np.sqrt(np.mean(np.concatenate([(b - a) ** 2 for a, b in zip(*rates, strict=True)])))
            top = max(float(np.abs(rate).max()) for rate in rates[0])
            rest = max(STANDSTILL_NOISE * float(noise), STANDSTILL_OF_TOP_SPEED * top)
            for k, (piece, signals, rate) in enumerate(zip(pieces, pairs[0], rates[0], strict=True)):
                still = turns.at_rest(rate, piece.dt, piece.low_pass.cutoff, rest)
                for i in joints:
                    there = _jump(signals, term, i, name, rest)
                    found[k][i] |= still & (there > floor[i])
                    jump[i] = max(jump[i], float(np.max(there, where=still, initial=0.0)))
    quiet = np.minimum(motion.quiet, floor[: model.n] / np.maximum(jump / 2, 1e-300))
    return replace(
        motion,
        pieces=tuple(p.unknown_at(mask, quiet) for p, mask in zip(pieces, found, strict=True)),
        quiet=quiet,
    )


def _jump(signals: Signals, term: Term, joint: int, rate: str, rest: float) -> Array:
    """(N,) by how much a term's torque at a joint (0-based) differs between the two directions of a rate."""
    assert signals.prediction is not None
    values, read = signals.prediction.values[term], signals.of(term, joint)
    library, dt = signals.model.library, signals.piece.dt
    size = np.full(len(signals.piece.t), rest)
    sides = [library.torque(term.effect, {**read, rate: sign * size}, values, dt) for sign in (1.0, -1.0)]
    difference: Array = np.abs(sides[0] - sides[1])
    return difference
