"""A recording as a replay needs it: the motion, what drives it and the states of effects, at even samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.identification.regressors import Signals
from runtime.identification.settings import NOMINAL_SKEW
from runtime.model.loader import Model
from runtime.model.terms import OF_DRIVE, Prediction, Term, joints_of
from runtime.motion.band import Band
from runtime.motion.filters import LowPass
from runtime.motion.motion import Motion, prepare, with_torques_of
from runtime.motion.piece import Piece
from runtime.recordings.driven import DrivenJoint
from runtime.recordings.recording import Recording, drives_of
from runtime.replay.settings import RATE_NOISE, STATES_OF_SAMPLING


@dataclass(frozen=True)
class Track:
    """One stretch of a recording without gaps.

    recording    its number, from 0     dt  s     t  (N,) s since the start of the run
    q, qd        (n, N) of the motors, smoothed     q_read  (n, N) as the encoders gave it
    tau          (n, N) the torque as it acts: recorded or of the drive's law, less that which a measured force makes
    residual     (n, N) of it in the band, what the model does not explain; zero where a joint rests
    commands     (N,) what a drive's law reads, by joint (0-based) and signal, each held until the next
    late         samples from a row of commands to the instant at which it acts
    states       (S, N) of effects along this motion, in the order of their terms
    resting      (n,) part of the samples at which a joint rests
    start_noise  (2, n) standard deviations of q and qd, from what the smoothing takes away
    """

    recording: int
    dt: float
    t: Array
    q: Array
    qd: Array
    q_read: Array
    tau: Array
    residual: Array
    commands: Mapping[tuple[int, str], Array]
    late: float
    states: Array
    resting: Array
    start_noise: Array


def tracks(
    model: Model, known: Prediction, motion: Motion, recordings: Sequence[Recording], skew: float
) -> list[Track]:
    """All stretches of the recordings that `motion` was made of.

    known  parameters     skew  samples by which the torque is taken later

    Torques are compared in the band of the motion; positions and rates are smoothed as little as the encoders allow.
    """
    commands = _commands(model, motion, recordings)
    wide = prepare(recordings, _of_states(motion), model)
    readings = _on_grid(model, motion, recordings, [r.q for r in recordings])
    found = []
    for k, narrow in enumerate(motion.pieces):
        q, qd, tau, residual = (np.empty(narrow.q.shape) for _ in range(4))
        for view in wide.views:
            joints, piece = list(view.joints), next(p for p in view.pieces if _holds(p, narrow))
            acting, unexplained = _torques(model, known, piece, skew)
            bands = {i: motion.pieces_of(i)[k].low_pass for i in joints}
            residual[joints] = [
                _shared(_in_band(unexplained[i], piece, band), piece, narrow) for i, band in bands.items()
            ]
            for row, x in ((q, piece.q), (qd, piece.qd), (tau, acting)):
                row[joints] = _shared(x, piece, narrow)[joints]
        along = next(p for p in wide.pieces if _holds(p, narrow))
        rests = np.abs(qd) < np.where(_rubs(model, known), motion.standstill, 0.0)[:, None]
        q_read = np.array([rows[k] for rows in readings])
        off = np.sqrt(np.mean((q_read - q) ** 2, axis=1))
        found.append(
            Track(
                narrow.recording,
                narrow.dt,
                narrow.t,
                q,
                qd,
                q_read,
                tau,
                np.where(rests, 0.0, residual),
                {key: rows[k] for key, rows in commands.items()},
                skew - NOMINAL_SKEW,
                _shared(_states(model, known, along), along, narrow),
                rests.mean(axis=1),
                np.array([off, off * 2 * np.pi * wide.band.cutoffs]),
            )
        )
    return found


def _rubs(model: Model, known: Prediction) -> NDArray[np.bool_]:
    """(n,) whether dry friction holds a joint at rest, so that its torque is indeterminate there."""
    library, rubs = model.library, np.zeros(model.n, dtype=bool)
    for term in known.values:
        if library[term.effect].dry:
            rubs[list(joints_of(model, term))] = True
    return rubs


def _of_states(motion: Motion) -> Band:
    """The band with cut-offs at which the noise of every joint's rate is a small part of it; a factor of two apart, so
    that there are few of them."""
    rms = np.array([np.sqrt(np.mean(np.concatenate([p.qd[i] for p in motion.pieces]) ** 2)) for i in range(motion.n)])
    density = np.maximum(motion.band.position_density, 1e-300)
    # As in the standstill of a motion: the filter stops at twice the cut-off.
    most = np.cbrt(3 * (RATE_NOISE * rms) ** 2 / (density * (2 * np.pi) ** 2)) / 2
    highest = STATES_OF_SAMPLING / motion.pieces[0].dt
    steps = np.floor(np.log2(np.clip(most, motion.band.cutoffs, np.maximum(highest, motion.band.cutoffs)) / highest))
    return replace(motion.band, cutoffs=np.maximum(highest * 2.0**steps, motion.band.cutoffs))


def _holds(piece: Piece, narrow: Piece) -> bool:
    same = (piece.recording, piece.run) == (narrow.recording, narrow.run)
    return same and piece.t[0] <= narrow.t[0] + piece.dt / 2 and narrow.t[-1] <= piece.t[-1] + piece.dt / 2


def _shared(x: Array, piece: Piece, narrow: Piece) -> Array:
    """Of x (..., N') along a piece, the samples (..., N) of the narrowest band's piece."""
    first = round((narrow.t[0] - piece.t[0]) / piece.dt)
    return x[..., first : first + len(narrow.t)]


def _in_band(x: Array, piece: Piece, band: LowPass) -> Array:
    """x (N,) along a piece, low-passed, at all samples."""
    return np.interp(piece.t, piece.t[band.centres(len(x))], band(x))


def _torques(model: Model, known: Prediction, piece: Piece, skew: float) -> tuple[Array, Array]:
    """(n, N) the torque as it acts, and what the model does not explain of it."""
    late = piece.t - skew * piece.dt
    at_once = piece.at_once if piece.at_once.size else np.zeros_like(piece.tau)
    acting = at_once + np.array([np.interp(late, piece.t, row) for row in piece.tau - at_once])
    signals = Signals(model, piece, known)
    explained = signals.rigid.copy()
    for term in known.values:
        for joint in joints_of(model, term):
            explained[joint] += signals.torque(term, joint)
    return acting if signals.measured is None else acting - signals.measured, acting - explained


def _states(model: Model, known: Prediction, piece: Piece) -> Array:
    """(S, N) of all effects that have states, along the recorded motion."""
    signals, library = Signals(model, piece, known), model.library
    rows: list[Array] = []
    for term in remembering(model, known):
        read = signals.of(term, (term.joint or 1) - 1)
        rows += library.states(term.effect, read, known.values[term], piece.dt).values()
    return np.array(rows).reshape(len(rows), len(piece.t))


def remembering(model: Model, known: Prediction) -> list[Term]:
    """Terms with states, in the order in which the plant has them."""
    library = model.library
    return [t for t in known.values if library[t.effect].states and not library.needs[t.effect] & OF_DRIVE]


def _commands(model: Model, motion: Motion, recordings: Sequence[Recording]) -> dict[tuple[int, str], list[Array]]:
    """What the drives' laws read, (N,) for every piece, by joint (0-based) and signal."""
    found: dict[tuple[int, str], list[Array]] = {}
    for i, joint in enumerate(drives_of(recordings)):
        for name in () if joint is None else read_by(joint):
            rows = [np.tile(_of(r, i).signals[name], (model.n, 1)) for r in recordings]
            found[i, name] = _on_grid(model, motion, recordings, rows)[i]
    return found


def _on_grid(model: Model, motion: Motion, recordings: Sequence[Recording], rows: Sequence[Array]) -> list[list[Array]]:
    """Of each joint and piece (N,): signals (n, N'), those of each recording, at the even samples of the pieces."""
    others = [replace(r.with_torques(x), driven=()) for r, x in zip(recordings, rows, strict=True)]
    pieces = with_torques_of(motion, others, model).pieces
    return [[piece.tau[i] for piece in pieces] for i in range(model.n)]


def read_by(joint: DrivenJoint) -> list[str]:
    """Signals that a joint's law reads beside the motion."""
    return [name for name in joint.signals if name not in ("q", "qd")]


def _of(recording: Recording, i: int) -> DrivenJoint:
    joint = recording.driven[i]
    assert joint is not None, "the drive makes the torque in one recording and not in another"
    return joint
