"""Which part of a joint's torque an effect is: along recordings, or along a simulated motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from runtime.identification.identify import prepared
from runtime.identification.regressors import Signals
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Structure, Term, joints_of
from runtime.motion.piece import Piece
from runtime.recordings.recording import Recording
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import along, excitation


def shares(
    model: Model, terms: Structure, recordings: Sequence[Recording] = (), held: Mapping[Term, Structure] | None = None
) -> dict[tuple[Term, int], float]:
    """By term and joint (0-based), the rms of its torque over that of the model's torque with all terms.

    terms        with all values, which may be fewer than the model's
    recordings   along whose motion; without any, along the motion that `tendon simulate` makes up
    held         of a term, terms whose torque is no part of its share
    """
    found: dict[tuple[Term, int], list[np.ndarray]] = {}
    whole: list[np.ndarray] = []
    for piece in prepared(model, recordings).pieces if recordings else [_made_up(model)]:
        signals = Signals(model, piece, Prediction(model.lump_values, terms))
        total = signals.rigid.copy()
        for term in terms:
            for joint in joints_of(model, term):
                torque = signals.torque(term, joint)
                total[joint] += torque
                parts = (held or {}).get(term, {})
                without = Signals(model, piece, Prediction(model.lump_values, parts))
                found.setdefault((term, joint), []).append(torque - sum(without.torque(part, joint) for part in parts))
        whole.append(total)
    level = [_rms([total[joint] for total in whole]) for joint in range(model.n)]
    return {place: _rms(parts) / level[place[1]] for place, parts in found.items() if level[place[1]] > 0}


def _made_up(model: Model) -> Piece:
    settings = SimulationSettings()
    path = excitation(model, np.random.default_rng(settings.seed), settings.seconds, 1)
    return along(model, path)


def _rms(parts: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
