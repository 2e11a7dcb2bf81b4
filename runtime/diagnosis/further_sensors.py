"""What further sensors say of a candidate: a link-side encoder and a torque sensor at a joint's output.

The torque by which a link lags behind its motor is -D (qdd - qdd_link), D the inertia on the link side: with an
encoder on both sides it is measured, whatever the law of the transmission. A torque sensor at the output feels
what acts on the link and nothing of what acts on the motor. Both are kept out of the fit, so that what they say is
independent evidence: a candidate's torque, as the motor torque asks for it, is sought in what they measure.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from runtime.arrays import Array
from runtime.diagnosis.candidates import Candidate, FittedBase
from runtime.diagnosis.gates import LAG, LESS_PLAY, MORE_PLAY, ON_LINK, ON_MOTOR, RIGID, Gate, GateResult
from runtime.diagnosis.settings import SENSOR_STRETCHES
from runtime.identification.regressors import Regressors, Signals
from runtime.identification.twist import late, without_peaks
from runtime.model.terms import Term, joints_of
from runtime.motion.piece import Piece, Sensors
from runtime.motion.settings import CERTAIN, SOME
from runtime.regression.noise import over_stretches
from runtime.regression.rows import Block
from runtime.regression.settings import LEAST_OWN
from runtime.regression.system import LinearSystem


@dataclass(frozen=True)
class Echo:
    """How much of a candidate's torque another sensor shows: 1 all of it, 0 nothing; with its standard error."""

    part: float
    spread: float

    def asked(self, gate: Gate) -> GateResult:
        """Of a gate, whose limit must surely be missed to keep it closed."""
        return gate.asked(self.part, spread=CERTAIN * self.spread)


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
    sums = np.array([[fold.sum()] for fold in np.array_split(score, SENSOR_STRETCHES)])
    return Echo(part, float(np.sqrt(over_stretches(sums, 1)[0, 0])) / square)


@dataclass
class FurtherSensors:
    """The further sensors of a base's motion, asked about its candidates."""

    base: FittedBase

    def __post_init__(self) -> None:
        self._lags: dict[tuple[int, bool], dict[int, Array]] = {}

    @cached_property
    def _late(self) -> Array:
        return late(self.base.fit)

    def _aligned(self, piece: Piece) -> Sensors:
        """The sensors of a piece as if all encoders were read at once."""
        return piece.sensors.aligned(piece.t, piece.q, piece.qdd, self._late)

    def results(self, system: LinearSystem, candidate: Candidate, block: Block, theta: Array) -> Iterator[GateResult]:
        """Of the gates that further sensors answer, for a candidate with coefficients (1 + k,) `theta`."""
        yield from self._transmission(system, candidate.term, block, theta)
        yield from self._play(candidate)
        yield from self._output(system, candidate.term, block, theta)

    # the link-side encoder -------------------------------------------------------------------------------------------

    def _transmission(self, system: LinearSystem, term: Term, block: Block, theta: Array) -> Iterator[GateResult]:
        model, motion = self.base.model, self.base.motion
        gives_way = model.library.effects[term.effect].gives_way
        places = joints_of(model, term)[:1] if gives_way else range(model.n)
        sensed = [i for i in places if motion.has("twist", i)]
        if not sensed:
            return
        torque, noise = system.beyond(block.torque(theta)), system.beyond(block.noise(theta))
        lag, lag_noise = (system.beyond(self._lag(sensed, noisy)) for noisy in (False, True))
        found = echo(torque, lag, (noise, lag_noise))
        if found is not None:
            yield found.asked(LAG if gives_way else RIGID)

    def _play(self, candidate: Candidate) -> Iterator[GateResult]:
        """Whether the measured twist and the candidate's are a gap apart: a step between the two directions of the
        transmitted torque, beside all that a spring, linear or hardening, makes of that torque."""
        model, motion, own = self.base.model, self.base.motion, (candidate.term.joint or 1) - 1
        info = model.library.effects[candidate.term.effect]
        if not info.gives_way or not motion.has("twist", own):
            return
        twists, loads = [], []
        # The direction of the load is asked for, which what rests would be taken out of.
        whole = replace(self.base.regressors, motion=motion.with_standstill)
        for signals, piece in zip(whole.signals(own), motion.pieces_of(own), strict=True):
            deflection = signals.deflection(candidate.term, candidate.shape)
            twist = self._aligned(piece).twist
            if deflection is None or twist is None:
                return
            twists.append(piece.in_band(np.array([twist[own], deflection])))
            loads.append(piece.in_band(signals.loads[own]))
        both = np.concatenate(twists, axis=1)
        carried = np.concatenate(loads) + self._measured_lag(whole, own)[own]
        largest = without_peaks(carried)
        use = motion.unaffected(own) & (np.abs(carried) > SOME * largest)
        torque = carried[use] / largest
        base = np.array([np.ones_like(torque), torque, torque**3])
        step = _beyond(base, np.sign(torque))
        there, has = (echo(step, _beyond(base, x[use])) for x in both)
        if there is None or has is None:
            return
        # No gap is negative; what comes out below zero is how far a spring's curve departs from a cubic.
        shown, modelled = max(there.part, 0.0), max(has.part, 0.0)
        apart, spread = shown - modelled, CERTAIN * float(np.hypot(there.spread, has.spread))
        alike = min(shown, modelled) > max(shown, modelled) / 2
        # It is more than a spring: a wider gap is a matter of its values.
        if alike or (apart > 0 and info.has_gap):
            return
        gate = MORE_PLAY if apart > 0 else LESS_PLAY
        yield gate.asked(abs(2 * apart), 2 * max(spread, gate.limit * float(np.std(both[0, use]))))

    def _lag(self, joints: list[int], noise: bool) -> dict[int, Array]:
        """(M,) by joint: torque that the links of some joints (0-based) do not take because they lag behind, beyond
        what the fitted model holds of it; or what encoder noise adds to it."""
        total = {i: np.zeros(len(self.base.motion.row_piece(i))) for i in range(self.base.model.n)}
        for own in joints:
            if (own, noise) not in self._lags:
                self._lags[own, noise] = self._lag_of(own, noise)
            for i, torque in self._lags[own, noise].items():
                total[i] += torque
        return total

    def _lag_of(self, own: int, noise: bool) -> dict[int, Array]:
        regressors = self.base.regressors
        plain = self._measured_lag(regressors, own)
        if noise:
            read_again = self._measured_lag(regressors.perturbed, own)
            return {i: read_again[i] - plain[i] for i in plain}
        known, effects = self.base.problem.layout.terms, self.base.model.library.effects
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
            i: np.concatenate([torque(s, s.piece, i) for s in regressors.signals(i)]) for i in range(self.base.model.n)
        }

    def _torque(self, regressors: Regressors, term: Term, joint: int) -> Array:
        """(M,) of a term of the fitted model, in the band."""
        columns = regressors.columns(term, joint, self.base.fit.shapes[term])
        return np.append(1.0, self.base.fit.coefficients[self.base.problem.layout.slices[term]]) @ columns

    # the torque sensor at the output ---------------------------------------------------------------------------------

    def _output(self, system: LinearSystem, term: Term, block: Block, theta: Array) -> Iterator[GateResult]:
        side = self.base.model.library.effects[term.effect].side
        sensed = [i for i in block.columns if self.base.motion.has("tau_link", i)]
        if side is None or not sensed:
            return
        torques, seen = [], []
        for i in sensed:
            base, measured = self._sensed(i)
            use = system.joints[i].use
            # What the model of the motor torque takes over of the candidate says nothing of it here either.
            base = np.vstack([system.columns(i), base[:, use]])
            torque = (theta @ block.columns[i].rows)[use]
            own = _beyond(base, torque)
            if float(own @ own) > LEAST_OWN * float(torque @ torque):
                torques.append(own)
                seen.append(_beyond(base, measured[use]))
        found = echo(np.concatenate(torques), np.concatenate(seen)) if torques else None
        if found is not None:
            yield found.asked(ON_LINK if side == "link" else ON_MOTOR)

    def _sensed(self, joint: int) -> tuple[Array, Array]:
        """What the arm's own parameters may explain of a torque at the link, (b, M), and the sensor's torque (M,) less
        what has no free coefficient.

        An unknown part of the rotor's inertia and an offset of the sensor are free; what the fitted model holds on
        the link side is, too, but for its shapes.
        """
        fitted, motion = self.base, self.base.motion
        pieces = motion.pieces_of(joint)
        parts = [np.array([_output_torque(p)[joint], np.ones(len(p.t))]) for p in pieces]
        pairs = zip(pieces, parts, strict=True)
        link, offset = np.concatenate([p.equation(p.in_band(x), joint) for p, x in pairs], axis=1)
        link = link - fitted.regressors.measured(joint)
        free = [*fitted.regressors.rigid(joint), fitted.regressors.acceleration(joint), offset]
        for term in fitted.problem.layout.terms:
            info = fitted.model.library.effects[term.effect]
            if joint in joints_of(fitted.model, term) and info.side == "link":
                columns = fitted.regressors.columns(term, joint, fitted.fit.shapes[term])
                link = link - columns[0]
                free += [*columns[1:]]
        return np.array(free), link


def _output_torque(piece: Piece) -> Array:
    assert piece.sensors.tau_link is not None
    return piece.sensors.tau_link


def _beyond(base: Array, x: Array) -> Array:
    """What of x (m,) the rows of a base (b, m) do not explain."""
    size = np.linalg.norm(base, axis=1, keepdims=True)
    scaled = base[size[:, 0] > 0] / size[size[:, 0] > 0]
    left: Array = x - np.linalg.lstsq(scaled.T, x, rcond=1e-9)[0] @ scaled
    return left
