"""What further sensors say of a candidate: a link-side encoder and a torque sensor at a joint's output.

The torque by which a link lags behind its motor is -D (qdd - qdd_link), D the inertia on the link side: with an
encoder on both sides it is measured, whatever the law of the transmission. A torque sensor at the output feels
what acts on the link and nothing of what acts on the motor. Both are kept out of the fit, so that what they say is
independent evidence: a candidate's torque, as the motor torque asks for it, is sought in what they measure.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis.candidates import Candidate, CandidateField
from runtime.diagnosis.settings import HALF_OF_TORQUE, LEAST_LAG, OF_TWIST, SENSOR_SIGMAS
from runtime.identification.regressors import Regressors, Signals
from runtime.identification.settings import LARGEST_QUANTILE, LOADED
from runtime.identification.twist import late
from runtime.model.terms import Term, joints_of
from runtime.motion.piece import Piece, Sensors
from runtime.regression.noise import over_stretches
from runtime.regression.settings import FOLDS, LEAST_OWN
from runtime.regression.system import Block, LinearSystem

Array = NDArray[np.float64]

Gate = Literal[
    "bic",
    "torque",
    "share",
    "edge",
    "likelihood",
    "error",
    "resolution",
    "model",
    "encoders",
    "link encoder",
    "output sensor",
    "bound",
    "recordings",
]


class FailedGate(NamedTuple):
    """A gate that a candidate does not pass, and the figures in words."""

    gate: Gate
    text: str


@dataclass(frozen=True)
class Echo:
    """How much of a candidate's torque another sensor shows: 1 all of it, 0 nothing; with its standard error."""

    part: float
    spread: float

    def above(self, part: float) -> bool:
        """Whether more than this part is surely seen."""
        return self.part - SENSOR_SIGMAS * self.spread > part

    def below(self, part: float) -> bool:
        """Whether less than this part is surely seen."""
        return self.part + SENSOR_SIGMAS * self.spread < part

    def __str__(self) -> str:
        return f"{100 * self.part:.0f} ± {100 * SENSOR_SIGMAS * self.spread:.0f} % of its torque".replace("-", "−")


def echo(torque: Array, seen: Array, noise: tuple[Array, Array] | None = None) -> Echo | None:
    """Of a torque (N,) in what was measured (N,), both beyond what a base explains; None without any torque.

    noise   what encoder noise adds to each of them: it is compensated for as in `evidence`
    The standard error holds for autocorrelated residuals.
    """
    square, cross = float(torque @ torque), float(torque @ seen)
    if noise is not None:
        square, cross = square - float(noise[0] @ noise[0]), cross - float(noise[0] @ noise[1])
    if square <= 0:
        return None
    part = cross / square
    score = torque * (seen - part * torque)
    sums = np.array([[fold.sum()] for fold in np.array_split(score, FOLDS)])
    return Echo(part, float(np.sqrt(over_stretches(sums, 1)[0, 0])) / square)


@dataclass
class FurtherSensors:
    """The further sensors of a field's motion, asked about its candidates."""

    field: CandidateField

    def __post_init__(self) -> None:
        self._lags: dict[tuple[int, bool], dict[int, Array]] = {}

    @cached_property
    def _late(self) -> Array:
        return late(self.field.problem, self.field.fit)

    def _aligned(self, piece: Piece) -> Sensors:
        """The sensors of a piece as if all encoders were read at once."""
        return piece.sensors.aligned(piece.t, piece.q, piece.qdd, self._late)

    def doubts(self, ground: LinearSystem, candidate: Candidate, block: Block, theta: Array) -> tuple[FailedGate, ...]:
        """What the sensors hold against a candidate with coefficients (1 + k,) `theta`, in words and figures."""
        term = candidate.term
        lag = self._transmission(ground, term, block, theta)
        return (*lag, *self._play(candidate), *self._output(ground, term, block, theta))

    # the link-side encoder -------------------------------------------------------------------------------------------

    def _transmission(self, ground: LinearSystem, term: Term, block: Block, theta: Array) -> tuple[FailedGate, ...]:
        model, motion = self.field.model, self.field.motion
        gives_way = model.library.effects[term.effect].gives_way
        places = joints_of(model, term)[:1] if gives_way else range(model.n)
        sensed = [i for i in places if motion.has("twist", i)]
        if not sensed:
            return ()
        torque = ground.beyond(block.torque(theta))
        noise = ground.beyond(block.noise(theta))
        lag, lag_noise = (ground.beyond(self._lag(sensed, noisy)) for noisy in (False, True))
        found = echo(torque, lag, (noise, lag_noise))
        if found is None:
            return ()
        if gives_way and found.below(LEAST_LAG):
            return _by_link(f"does not show it: the link lags by {found}")
        if not gives_way and found.above(HALF_OF_TORQUE):
            return (
                FailedGate(
                    "link encoder",
                    f"the link-side encoder shows that the transmission gives way instead: the lag makes up {found}",
                ),
            )
        return ()

    def _play(self, candidate: Candidate) -> tuple[FailedGate, ...]:
        """Whether the measured twist and the candidate's are a gap apart: a step between the two directions of the
        transmitted torque, beside all that a spring, linear or hardening, makes of that torque."""
        model, motion, own = self.field.model, self.field.motion, (candidate.term.joint or 1) - 1
        info = model.library.effects[candidate.term.effect]
        if not info.gives_way or not motion.has("twist", own):
            return ()
        twists, loads = [], []
        # The direction of the load is asked for, which what rests would be taken out of.
        whole = replace(self.field.regressors, motion=motion.with_standstill)
        for signals, piece in zip(whole.signals(own), motion.pieces_of(own), strict=True):
            deflection = signals.deflection(candidate.term, candidate.shape)
            twist = self._aligned(piece).twist
            if deflection is None or twist is None:
                return ()
            twists.append(piece.in_band(np.array([twist[own], deflection])))
            loads.append(piece.in_band(signals.loads[own]))
        both = np.concatenate(twists, axis=1)
        carried = np.concatenate(loads) + self._measured_lag(whole, own)[own]
        largest = float(np.quantile(np.abs(carried), LARGEST_QUANTILE))
        use = motion.unaffected(own) & (np.abs(carried) > LOADED * largest)
        torque = carried[use] / largest
        base = np.array([np.ones_like(torque), torque, torque**3])
        step = _beyond(base, np.sign(torque))
        there, has = (echo(step, _beyond(base, x[use])) for x in both)
        if there is None or has is None:
            return ()
        # No gap is negative; what comes out below zero is how far a spring's curve departs from a cubic.
        shown, modelled = max(there.part, 0.0), max(has.part, 0.0)
        apart, spread = shown - modelled, SENSOR_SIGMAS * float(np.hypot(there.spread, has.spread))
        alike = min(shown, modelled) > HALF_OF_TORQUE * max(shown, modelled)
        if apart > 0 and info.has_gap:
            # It is more than a spring: a wider gap is a matter of its values.
            return ()
        if alike or abs(apart) < max(spread, OF_TWIST * float(np.std(both[0, use]))):
            return ()
        unit = model.joints[own].position_unit
        play = f"{abs(2 * apart):.2g} ± {2 * spread:.1g} {unit}"
        return (
            FailedGate(
                "link encoder", f"the link-side encoder shows {play} {'more' if apart > 0 else 'less'} play than it has"
            ),
        )

    def _lag(self, joints: list[int], noise: bool) -> dict[int, Array]:
        """(M,) by joint: torque that the links of some joints (0-based) do not take because they lag behind, beyond
        what the fitted model holds of it; or what encoder noise adds to it."""
        total = {i: np.zeros(len(self.field.motion.row_piece(i))) for i in range(self.field.model.n)}
        for own in joints:
            if (own, noise) not in self._lags:
                self._lags[own, noise] = self._lag_of(own, noise)
            for i, torque in self._lags[own, noise].items():
                total[i] += torque
        return total

    def _lag_of(self, own: int, noise: bool) -> dict[int, Array]:
        regressors = self.field.regressors
        plain = self._measured_lag(regressors, own)
        if noise:
            read_again = self._measured_lag(regressors.perturbed, own)
            return {i: read_again[i] - plain[i] for i in plain}
        known, effects = self.field.problem.layout.terms, self.field.model.library.effects
        for term in (t for t in known if t.joint == own + 1 and effects[t.effect].gives_way):
            for i in plain:
                plain[i] = plain[i] - self._torque(regressors, term, i)
        return plain

    def _measured_lag(self, regressors: Regressors, own: int) -> dict[int, Array]:
        def torque(signals: Signals, piece: Piece, joint: int) -> Array:
            twist_qdd = self._aligned(piece).twist_qdd
            assert twist_qdd is not None
            return piece.equation(piece.in_band(-signals.coupling(joint, own) * twist_qdd[own]), joint)

        return {
            i: np.concatenate([torque(s, s.piece, i) for s in regressors.signals(i)]) for i in range(self.field.model.n)
        }

    def _torque(self, regressors: Regressors, term: Term, joint: int) -> Array:
        """(M,) of a term of the fitted model, in the band."""
        columns = regressors.columns(term, joint, self.field.fit.shapes[term])
        return np.append(1.0, self.field.fit.coefficients[self.field.problem.layout.slices[term]]) @ columns

    # the torque sensor at the output ---------------------------------------------------------------------------------

    def _output(self, ground: LinearSystem, term: Term, block: Block, theta: Array) -> tuple[FailedGate, ...]:
        side = self.field.model.library.effects[term.effect].side
        sensed = [i for i in block.columns if self.field.motion.has("tau_link", i)]
        if side is None or not sensed:
            return ()
        torques, seen = [], []
        for i in sensed:
            base, measured = self._sensed(i)
            use = ground.joints[i].use
            # What the model of the motor torque takes over of the candidate says nothing of it here either.
            base = np.vstack([ground.columns(i), base[:, use]])
            torque = (theta @ block.columns[i].rows)[use]
            own = _beyond(base, torque)
            if float(own @ own) > LEAST_OWN * float(torque @ torque):
                torques.append(own)
                seen.append(_beyond(base, measured[use]))
        found = echo(np.concatenate(torques), np.concatenate(seen)) if torques else None
        if found is None:
            return ()
        if side == "link" and found.below(HALF_OF_TORQUE):
            return (
                FailedGate(
                    "output sensor",
                    f"the torque sensor at the output does not feel it, as it would on the link: {found}",
                ),
            )
        if side == "motor" and found.above(HALF_OF_TORQUE):
            return (
                FailedGate(
                    "output sensor", f"the torque sensor at the output feels it, as it would not on the motor: {found}"
                ),
            )
        return ()

    def _sensed(self, joint: int) -> tuple[Array, Array]:
        """What the arm's own parameters may explain of a torque at the link, (b, M), and the sensor's torque (M,) less
        what has no free coefficient.

        An unknown part of the rotor's inertia and an offset of the sensor are free; what the fitted model holds on
        the link side is, too, but for its shapes.
        """
        field, motion = self.field, self.field.motion
        pieces = motion.pieces_of(joint)
        parts = [np.array([_output_torque(p)[joint], np.ones(len(p.t))]) for p in pieces]
        pairs = zip(pieces, parts, strict=True)
        link, offset = np.concatenate([p.equation(p.in_band(x), joint) for p, x in pairs], axis=1)
        link = link - field.regressors.measured(joint)
        free = [*field.regressors.rigid(joint), field.regressors.acceleration(joint), offset]
        for term in field.problem.layout.terms:
            info = field.model.library.effects[term.effect]
            if joint in joints_of(field.model, term) and info.side == "link":
                columns = field.regressors.columns(term, joint, field.fit.shapes[term])
                link = link - columns[0]
                free += [*columns[1:]]
        return np.array(free), link


def _by_link(text: str) -> tuple[FailedGate, ...]:
    return (FailedGate("link encoder", f"the link-side encoder {text}"),)


def _by_output(text: str) -> tuple[FailedGate, ...]:
    return (FailedGate("output sensor", f"the torque sensor at the output {text}"),)


def _output_torque(piece: Piece) -> Array:
    assert piece.sensors.tau_link is not None
    return piece.sensors.tau_link


def _beyond(base: Array, x: Array) -> Array:
    """What of x (m,) the rows of a base (b, m) do not explain."""
    size = np.linalg.norm(base, axis=1, keepdims=True)
    scaled = base[size[:, 0] > 0] / size[size[:, 0] > 0]
    left: Array = x - np.linalg.lstsq(scaled.T, x, rcond=1e-9)[0] @ scaled
    return left
