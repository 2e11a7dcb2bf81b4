"""The bands in which model and measurement are compared, one for every joint's equation, chosen from the data.

A cut-off too high lets the encoders' noise, twice differentiated, into the regressors, and a memory
effect is then found that is not there; one too low throws away what would tell effects apart. A joint's
cut-off is where the noise of all q̈, times what inertia couples them to the joint, has a quarter of the
variance that the noise of its torque has inside the band: then whatever smooths accelerations cannot pass
for physics. A wrist's small inertia bears a band several times that of a base.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime.documents.parts import BandEntry
from runtime.motion.clock import grid
from runtime.motion.filters import differentiator, welch
from runtime.motion.noise import MeasuredRate, SampleNoise, judged
from runtime.motion.settings import (
    CLOSE_CUTOFFS,
    CUTOFF_OF_SAMPLING,
    ENCODER_SHARE,
    ENOUGH_FOR_NOISE,
    EXCITATION_CAUTION,
    EXCITATION_WINDOW_S,
    HIGHEST_CUTOFF,
    INERTIA_GUESSED,
    INERTIA_SEEN,
    LINE_INSIDE,
    LINE_TURNS,
    LINE_WORTH,
    LOWEST_CUTOFF,
    MOST_INERTIA_ROWS,
    NOISE_OF_LINES,
    SEGMENT_HALVES,
    SLOW_FOR_LINES,
    STEP_OF_ALL,
    STEP_ONE,
    STEP_QUANTILE,
    STEP_ROUNDED,
    STEP_SINGLE,
    WIDE_ENOUGH,
)
from runtime.motion.spectra import lines
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LineAbove:
    """A line of a joint's (0-based) torque over the motor's angle: order, periods a revolution; Hz at the middle
    speed of the motor; RMS, N m (N)."""

    joint: int
    order: float
    frequency: float
    rms: float


@dataclass(frozen=True)
class Band:
    """cutoffs (n,) Hz, of every joint's equation; reason, for people, of the narrowest; noise densities one-sided per
    joint (unit²/Hz) of torque and position; resolution (n,) the positions' step, rad (m), 0 where they have none;
    rates: what is made of measured rates, by joint; None where there are none; above: lines of the torque over the
    motor's angle that a joint's band does not hold; held: torques at uneven instants are commands, each held until the
    next; mistimed: the instants at which positions were read are uncertain, in every recording."""

    cutoffs: Array
    reason: str
    torque_density: Array
    position_density: Array
    resolution: Array
    rates: tuple[MeasuredRate | None, ...] = ()
    above: tuple[LineAbove, ...] = ()
    held: bool = False
    mistimed: bool = False

    @property
    def cutoff(self) -> float:
        """Hz, of the narrowest band, in which all joints can be read."""
        return float(self.cutoffs.min())

    def document(self) -> BandEntry:
        """As every verb has it: the narrowest cut-off and its reason, and each joint's own."""
        return BandEntry(cutoff_hz=self.cutoff, cutoffs_hz=self.cutoffs.tolist(), reason=self.explained)

    @property
    def explained(self) -> str:
        """The reason, and which joints are read in wider bands."""
        wider = sorted({float(f) for f in self.cutoffs if f > self.cutoff})
        joints = ((f, [str(i + 1) for i, own in enumerate(self.cutoffs) if own == f]) for f in wider)
        said = (f"{'joint' if len(names) == 1 else 'joints'} {', '.join(names)} up to {f:g} Hz" for f, names in joints)
        return "; ".join([self.reason, *said])

    def rate_noise(self, joint: int) -> float | None:
        """One-sided density of a joint's (0-based) measured rate, (unit/s)²/Hz; None where it is not used."""
        rate = self.rates[joint] if self.rates else None
        return rate.density if rate is not None and rate.used else None

    def torque_floor(self) -> Array:
        """Standard deviation of white torque noise inside the band, (n,)."""
        return np.sqrt(self.torque_density * self.cutoffs)


def resolution(q: Array) -> float:
    """The step of which nearly all differences of q (N,) are multiples; 0 if there is none."""
    steps = np.abs(np.diff(q[:ENOUGH_FOR_NOISE]))
    steps = steps[steps > 1e-12 * (np.ptp(q) + 1e-300)]
    if not len(steps):
        return 0.0
    # Printed digits round each position, hence each step by a little.
    least = float(np.quantile(steps, STEP_QUANTILE))
    size = float(np.median(steps[steps < STEP_ONE * least]))
    multiples = steps / size
    fits = np.abs(multiples - np.round(multiples)) < STEP_ROUNDED
    return size if fits.mean() > STEP_OF_ALL and (multiples < STEP_ONE).mean() > STEP_SINGLE else 0.0


def excitation(qdd: Array, rate: float, density: float, derivative: int) -> Array:
    """Part (F,) of accelerations qdd (N,) that is motion, evenly from 0 to half the sampling rate (Wiener's filter);
    the rest is white noise of this density of what they are the first or second derivative of."""
    f, power = welch(qdd[:ENOUGH_FOR_NOISE], rate, min(len(qdd), round(EXCITATION_WINDOW_S * rate)) // 2 * 2)
    noise = density * (2 * np.pi * f) ** (2 * derivative)
    part = np.clip(1 - EXCITATION_CAUTION * noise / np.maximum(power, 1e-300), 0.0, 1.0)
    return np.where(f < LOWEST_CUTOFF, 1.0, part)


def rigid_inertia(recordings: Sequence[Recording]) -> Array | None:
    """(n,) kg m² (kg), what the rigid-body torque of the user's own model asks for an acceleration, beside what it asks
    for a posture; None where not all recordings have that torque."""
    n = len(recordings[0].q)
    moment, square = np.zeros(n), np.zeros(n)
    for r in recordings:
        if r.tau_rigid is None:
            return None
        clock = grid(r)
        derive = differentiator(LOWEST_CUTOFF, 1 / clock.period)
        for s in (s for s in clock.stretches if s.size > SEGMENT_HALVES * derive.half):
            parts = [derive(row) for row in s.of(r.q[:, s.samples])]
            q, qdd = (np.array([part[k] for part in parts]) for k in (0, 2))
            moving = beyond_posture(q, qdd)
            moment += np.sum(moving * s.of(r.tau_rigid[:, s.samples])[:, derive.half : -derive.half], axis=1)
            square += np.sum(moving**2, axis=1)
    inertia: Array = np.abs(moment) / np.maximum(square, 1e-300)
    return np.maximum(inertia, 1e-12)


def beyond_posture(q: Array, x: Array) -> Array:
    """What of signals x (k, N) no torque of the posture q (n, N) can be: no constant, and no wave of a joint's angle or
    of a link's, as gravity makes them."""
    angles = np.vstack([q, np.cumsum(q, axis=0)[1:]])
    base = np.vstack([np.ones((1, q.shape[1])), np.cos(angles), np.sin(angles)])
    left: Array = x - np.linalg.lstsq(base.T, x.T, rcond=None)[0].T @ base
    return left


def coupled(D: Array, inertia: Array) -> Array:
    """(n, n) kg m² (kg), what each joint's torque asks for each joint's acceleration, at most.

    D (n, n): of the model file, NaN where that leaves it open: then as much as two bodies with these inertias may be
    coupled. inertia (n,): as far as the file's own diagonal is believed.
    """
    believed, own = np.sqrt(inertia), np.sqrt(np.abs(np.diagonal(D)))
    # A joint that is held may be as heavy as can be.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        most, part = np.outer(believed, believed), np.minimum(np.abs(D) / np.outer(own, own), 1.0)
    found: Array = np.where(np.isfinite(part), part, 1.0) * most
    return found


def choose_band(recordings: Sequence[Recording], inertia: Array) -> Band:
    """Cut-offs for all recordings together.

    inertia (n, n): what a joint's torque asks for each joint's acceleration, kg m² (kg).
    """
    grids = [grid(r) for r in recordings]
    rate = min(1 / g.spacing for g in grids)
    n = len(inertia)
    torque, position, step = np.zeros(n), np.zeros(n), np.zeros(n)
    noise = [SampleNoise.on(g.longest, 1 / g.period) for g in grids]
    for i in range(n):
        step[i] = max(resolution(r.q[i, g.longest.samples]) for r, g in zip(recordings, grids, strict=True))
        torque[i] = np.median([d.density(r.tau[i]) for r, d in zip(recordings, noise, strict=True)])
        position[i] = np.median([d.density(r.q[i]) for r, d in zip(recordings, noise, strict=True)])
    ceiling = min(HIGHEST_CUTOFF, CUTOFF_OF_SAMPLING * rate)
    band = Band(*_cut(inertia, torque, position, rate=np.zeros(n), ceiling=ceiling), torque, position, step)
    band = replace(band, mistimed=all(d.mistimed(r.q) for r, d in zip(recordings, noise, strict=True)))
    band = replace(band, rates=judged(recordings, grids, band.cutoffs, position))
    quiet = np.array([band.rate_noise(i) for i in range(n)], dtype=float)
    if np.isnan(quiet).all():
        return band
    of_rate = np.isfinite(quiet)
    densities = np.where(of_rate, 0.0, position), np.where(of_rate, quiet, 0.0)
    cutoffs, reason = _cut(inertia, torque, *densities, ceiling)
    wider = np.maximum(cutoffs, band.cutoffs)
    return replace(band, cutoffs=wider, reason=reason if wider.min() > band.cutoff else band.reason)


def _cut(inertia: Array, torque: Array, position: Array, rate: Array, ceiling: float) -> tuple[Array, str]:
    """The cut-offs (n,) and the reason of the narrowest.

    torque, position, rate (n,): densities of noise; a joint's position or rate is what is differentiated, the other's
    is 0. The band in which each joint's own acceleration would not rival its torque's noise is the least for all: a
    coupling may be no more than what two inertias permit.
    """
    alone = _balance(np.diag(np.diagonal(inertia)), torque, position, rate)
    joint = int(np.argmin(alone))
    least = float(f"{np.clip(alone[joint], LOWEST_CUTOFF, ceiling):.3g}")
    widest = min(max(least, WIDE_ENOUGH), ceiling)
    every = np.clip(np.minimum(_balance(inertia, torque, position, rate), alone), least, widest)
    # A joint that is passive is in no fit, and needs no band of its own.
    cutoffs = np.array([least if silent else float(f"{f:.3g}") for f, silent in zip(every, torque == 0, strict=True)])
    if alone[joint] >= ceiling:
        return _shared(cutoffs), f"the position is clean enough for the whole band up to {least:g} Hz"
    if alone[joint] <= LOWEST_CUTOFF:
        return _shared(cutoffs), f"above {least:g} Hz the encoder of joint {joint + 1} tells nothing about the torque"
    who = f"the encoder noise of joint {joint + 1}"
    return _shared(cutoffs), f"above {least:g} Hz {who}, as an inertial torque, would rival the torque noise"


def _balance(inertia: Array, torque: Array, position: Array, rate: Array) -> Array:
    """(n,) Hz, above which accelerations, as an inertial torque, rival the noise of a joint's own; as `_cut`.

    One-sided white noise twice and once differentiated, up to f: (2π)⁴ f⁵/5 and (2π)² f³/3 of its density.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        square = inertia**2
        fourth, second = square @ position * (2 * np.pi) ** 4 / 5, square @ rate * (2 * np.pi) ** 2 / 3
        share = ENCODER_SHARE * torque
        # Stable whichever of the two is 0: f² of fourth f⁴ + second f² = share.
        found = np.sqrt(2 * share / (second + np.sqrt(second**2 + 4 * fourth * share)))
    # A torque that never changes has no noise to be rivalled: the joint is passive, and left out of the fit.
    found[(torque == 0) | np.isnan(found)] = np.inf
    return np.asarray(found)


def _shared(cutoffs: Array) -> Array:
    """Cut-offs (n,) of which those that are close are one, the lower: each more is a further view of all recordings."""
    found, order = cutoffs.copy(), np.argsort(cutoffs)
    lowest = cutoffs[order[0]]
    for i in order:
        lowest = cutoffs[i] if cutoffs[i] > CLOSE_CUTOFFS * lowest else lowest
        found[i] = lowest
    return found


def lowered(band: Band, factor: float) -> Band | None:
    """Narrower bands of the same recordings; None where nothing of the motion would be left in them."""
    if band.cutoff <= LOWEST_CUTOFF:
        return None
    cutoffs = np.array([float(f"{max(factor * f, LOWEST_CUTOFF):.3g}") for f in band.cutoffs])
    what = "most of the measured accelerations is the encoders' noise"
    return replace(band, cutoffs=cutoffs, reason=f"above {cutoffs.min():g} Hz {what}")


def believable(stated: Array, recordings: Sequence[Recording]) -> Array:
    """(n,) kg m² (kg): the stated inertias, those excepted that are far below what the recordings show, or unknown
    (NaN): there what they show, or if they show none the most that their torque can be for.

    One that is too large costs bandwidth and no more. What a recording shows may be too small itself, where something
    delays or withholds a torque.
    """
    motion = _slow_motion(recordings)
    if motion is None:
        return np.where(np.isfinite(stated), stated, 1.0)
    seen = _asked_at_all(motion)
    _, _, qdd, tau = motion
    with np.errstate(over="ignore"):  # a joint that is not accelerated may be as heavy as can be
        most = np.linalg.norm(tau, axis=1) / np.maximum(np.linalg.norm(qdd, axis=1), 1e-300)
    known = np.where(np.isfinite(stated), stated, most)
    return np.where(np.isfinite(seen) & ~(INERTIA_GUESSED * stated > seen), seen, known)


def shown(recordings: Sequence[Recording]) -> Array:
    """(n,) as `asked`, of every joint, below the lowest cut-off; NaN where no stretch is long enough."""
    motion = _slow_motion(recordings)
    return np.full(len(recordings[0].q), np.nan) if motion is None else _asked_at_all(motion)


def _asked_at_all(motion: tuple[Array, Array, Array, Array]) -> Array:
    q, qd, qdd, tau = motion
    return np.array([asked(i, q, qd, qdd=qdd, tau=row) for i, row in enumerate(tau)])


def _slow_motion(recordings: Sequence[Recording]) -> tuple[Array, Array, Array, Array] | None:
    parts = [p for r in recordings if (p := _smooth(r)) is not None]
    if not parts:
        return None
    q, qd, qdd, tau = (np.concatenate(signals, axis=1) for signals in zip(*parts, strict=True))
    return q, qd, qdd, tau


def _smooth(recording: Recording) -> tuple[Array, Array, Array, Array] | None:
    """q, qd, qdd, tau (n, M) below the lowest cut-off, thinned out; None if no stretch is long enough."""
    clock = grid(recording)
    derive, stretch = differentiator(LOWEST_CUTOFF, 1 / clock.period), clock.longest
    if stretch.size <= SEGMENT_HALVES * derive.half:
        return None
    window = slice(0, ENOUGH_FOR_NOISE)
    thin = max(1, min(stretch.size, ENOUGH_FOR_NOISE) // MOST_INERTIA_ROWS)
    position = stretch.of(recording.q[:, stretch.samples])[:, window]
    torque = stretch.of(recording.tau[:, stretch.samples])[:, window]
    parts = [derive(row) for row in position]
    q, qd, qdd = (np.array([p[k][::thin] for p in parts]) for k in range(3))
    return q, qd, qdd, np.array([derive(row)[0][::thin] for row in torque])


def asked(joint: int, q: Array, qd: Array, qdd: Array, tau: Array) -> float:
    """kg m² (kg), what a joint's torque tau (M,) asks for its acceleration, of all signals (n, M), beside friction,
    gravity and what the other joints' accelerations ask; NaN where that explains too little of it to be told."""
    turns = [f(row) for row in q for f in (np.sin, np.cos)]
    others = [row for k, row in enumerate(qdd) if k != joint]
    rest = np.array([qd[joint], np.sign(qd[joint]), np.ones(q.shape[1]), *turns, *others])
    y = np.array([qdd[joint], tau])
    beside = y - np.linalg.lstsq(rest.T, y.T, rcond=None)[0].T @ rest
    own, cross, whole = (float(a @ b) for a, b in (beside[[0, 0]], beside, beside[[1, 1]]))
    if own <= 0 or cross <= 0 or cross**2 < INERTIA_SEEN * own * whole:
        return float("nan")
    return cross / own


def lines_above(recordings: Sequence[Recording], band: Band, ratios: Sequence[float]) -> list[LineAbove]:
    """Lines of the measured torques that are above the band most of the way, the strongest first.

    ratios (n,): gear ratios. The torque is taken as it is: what model and motion say of it lies below.
    """
    found = [line for i, ratio in enumerate(ratios) for line in _lines_of_joint(recordings, band, i, ratio)]
    found.sort(key=lambda line: -line.rms)
    return [line for line in found if line.rms**2 >= LINE_WORTH * found[0].rms ** 2]


def raised(recordings: Sequence[Recording], band: Band, inertia: Array, ratios: Sequence[float]) -> Band:
    """Every joint's band up to above the highest of the lines beyond it that the encoders' noise permits.

    inertia (n, n) as for `choose_band`. As an inertial torque in the raised band, that noise must be small against what
    the joint's lines are; a line that would need more of it stays above.
    """
    above = lines_above(recordings, band, ratios)
    highest = CUTOFF_OF_SAMPLING * min(1 / r.dt for r in recordings)
    cutoffs, reasons = band.cutoffs.copy(), []
    for joint in sorted({line.joint for line in above}):
        own = [line for line in above if line.joint == joint]
        together = float(np.sqrt(sum(line.rms**2 for line in own)))
        for line in sorted(own, key=lambda line: -line.frequency):
            cutoff = float(f"{LINE_INSIDE * line.frequency:.3g}")
            # One-sided white noise of the positions, twice differentiated, up to the cut-off.
            noise = float(np.sqrt(inertia[joint] ** 2 @ band.position_density * (2 * np.pi) ** 4 * cutoff**5 / 5))
            if cutoff <= highest and noise < NOISE_OF_LINES * together:
                reasons.append(
                    f"the band of joint {joint + 1} is raised from {cutoffs[joint]:g} to {cutoff:g} Hz to hold a line "
                    f"of its torque that repeats {line.order:.4g} times per turn of the motor, "
                    f"at {line.frequency:.3g} Hz"
                )
                cutoffs[joint] = cutoff
                break
    rest = tuple(line for line in above if LINE_INSIDE * line.frequency > cutoffs[line.joint])
    return replace(band, cutoffs=cutoffs, reason="; ".join([band.reason, *reasons]), above=rest)


def _lines_of_joint(recordings: Sequence[Recording], band: Band, joint: int, ratio: float) -> list[LineAbove]:
    cutoff = float(band.cutoffs[joint])
    # A stretch of each is enough to see a line, as it is for noise.
    stretches = [(r, slice(s.start, min(s.stop, s.start + ENOUGH_FOR_NOISE))) for r in recordings for s in r.segments]
    parts = [_along(r.q[joint, s], r.tau[joint, s], r.dt, ratio=ratio, cutoff=cutoff) for r, s in stretches]
    angle, speed, torque = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    use = speed > SLOW_FOR_LINES * speed.max(initial=0.0)
    angle, speed, torque = angle[use], speed[use], torque[use]
    if not len(angle) or np.ptp(angle) < 2 * np.pi * LINE_TURNS:
        return []
    ordered = np.sort(speed)
    middle = float(ordered[np.searchsorted(np.cumsum(ordered), ordered.sum() / 2)])
    # Above the band at the middle speed, and below what a raised band could hold.
    span = 2 * np.pi * cutoff / middle, 2 * np.pi * CUTOFF_OF_SAMPLING / recordings[0].dt / middle
    among = max(2, round((span[1] - span[0]) * float(np.ptp(angle)) / (2 * np.pi)))
    rows = angle, torque - torque.mean(), np.ones((1, len(angle))), np.array([[1 / len(angle)]])
    return [
        LineAbove(joint, order, order * middle / (2 * np.pi), float(np.sqrt(gain / len(angle))))
        for order, gain in lines(*rows, span, among).items()
    ]


def _along(q: Array, tau: Array, dt: float, ratio: float, cutoff: float) -> tuple[Array, Array, Array]:
    """The motor's angle and speed, and the torque less its slow part, each (N,)."""
    width = max(1, round(1 / (cutoff * dt)))
    if len(q) <= 2 * width:
        return np.empty(0), np.empty(0), np.empty(0)
    speed = np.abs(q[2 * width :] - q[: -2 * width]) / (2 * width * dt)
    total = np.concatenate([[0.0], np.cumsum(tau)])
    size = 2 * width + 1
    slow = (total[size:] - total[:-size]) / size
    inner = slice(width, -width)
    return ratio * q[inner], ratio * speed, tau[inner] - slow
