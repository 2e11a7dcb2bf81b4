"""The bands in which model and measurement are compared, one for every joint's equation, chosen from the data.

A cut-off too high lets the encoders' noise, twice differentiated, into the regressors, where it looks like an effect
with a memory; one too low removes what distinguishes effects. At a joint's cut-off the noise of all q̈, times the
inertias that couple them to the joint, has a quarter of the variance of the joint's torque noise. A wrist's small
inertia permits a band several times that of a base.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from runtime.arrays import Array
from runtime.documents.parts import BandEntry
from runtime.motion.clock import grid
from runtime.motion.filters import differentiator, moving_mean, welch
from runtime.motion.noise import ENOUGH_FOR_NOISE, MeasuredRate, SampleNoise, measured_rate, resolution
from runtime.motion.settings import (
    CLOSE_CUTOFFS,
    CUTOFF_OF_SAMPLING,
    ENCODER_SHARE,
    HIGHEST_CUTOFF,
    LEAST_OWN_NOISE,
    LEAST_PERIODS,
    LITTLE,
    LOWEST_CUTOFF,
    SOME,
    WIDE_ENOUGH,
)
from runtime.motion.spectra import lines
from runtime.recordings.recording import Recording


@dataclass(frozen=True)
class LineAbove:
    """A line of a joint's (0-based) torque over the motor's angle, above the band.

    order      periods a revolution
    frequency  Hz, at the motor's middle speed
    rms        N m (N)
    """

    joint: int
    order: float
    frequency: float
    rms: float


@dataclass(frozen=True)
class Band:
    """The bands of all joints' equations, and the instruments' noise from which they follow.

    cutoffs           (n,) Hz
    reason            of the narrowest, for people
    torque_density    (n,) one-sided, unit²/Hz, of the torques' noise; position_density: of the positions'
    resolution        (n,) rad (m), the positions' step, 0 where they have none
    rates             how measured rates are used, by joint; None where there are none
    above             lines of the torque over the motor's angle above a joint's band
    held              torques at uneven instants are commands, each held until the next
    filtered          by joint, whether the torque was low-passed before it was recorded: its noise is then not known
    jittered          the instants at which positions were read are uncertain, in every recording
    """

    cutoffs: Array
    reason: str
    torque_density: Array
    position_density: Array
    resolution: Array
    rates: tuple[MeasuredRate | None, ...] = ()
    above: tuple[LineAbove, ...] = ()
    held: bool = False
    jittered: bool = False
    filtered: tuple[bool, ...] = ()

    @property
    def cutoff(self) -> float:
        """Hz, of the narrowest band."""
        return float(self.cutoffs.min())

    def document(self) -> BandEntry:
        """The narrowest cut-off with its reason, and each joint's own."""
        wider = sorted({float(f) for f in self.cutoffs if f > self.cutoff})
        joints = ((f, [str(i + 1) for i, own in enumerate(self.cutoffs) if own == f]) for f in wider)
        said = (f"{'joint' if len(names) == 1 else 'joints'} {', '.join(names)} up to {f:g} Hz" for f, names in joints)
        reason = "; ".join([self.reason, *said])
        return BandEntry(cutoff_hz=self.cutoff, cutoffs_hz=self.cutoffs.tolist(), reason=reason)

    def rate_noise(self, joint: int) -> float | None:
        """One-sided density of a joint's (0-based) measured rate, (unit/s)²/Hz; None where it is not used."""
        rate = self.rates[joint] if self.rates else None
        return rate.density if rate is not None and rate.used else None

    def torque_floor(self) -> Array:
        """(n,) standard deviation of the torques' white noise in their bands."""
        return np.sqrt(self.torque_density * self.cutoffs)


def wiener_filter(qdd: Array, rate: float, density: float, derivative: int) -> Array:
    """Wiener filter (F,), at even frequencies from 0 to half the sampling rate, of accelerations qdd (N,): the part of
    the power that is motion.

    density: of white noise, whose first or second derivative the accelerations hold. It counts twice, as its estimate
    varies and noise that passes for load is amplified at a resonance; spectra of a second resolve the lowest cut-off.
    """
    f, power = welch(qdd[:ENOUGH_FOR_NOISE], rate, min(len(qdd), round(rate)) // 2 * 2)
    noise = density * (2 * np.pi * f) ** (2 * derivative)
    return np.where(f < LOWEST_CUTOFF, 1.0, np.clip(1 - 2 * noise / np.maximum(power, 1e-300), 0.0, 1.0))


# --- the choice of cut-offs ---


def choose_band(recordings: Sequence[Recording], inertia: Array) -> Band:
    """Cut-offs for all recordings together; inertia (n, n) kg m² (kg): of each joint's torque for each joint's
    acceleration."""
    grids = [grid(r) for r in recordings]
    noise = [SampleNoise.on(g.longest, 1 / g.period) for g in grids]
    n = len(inertia)
    torque, position, step = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        step[i] = max(resolution(r.q[i, g.longest.samples]) for r, g in zip(recordings, grids, strict=True))
        position[i] = np.median([d.density(r.q[i]) for r, d in zip(recordings, noise, strict=True)])
        torque[i] = np.median([_own_density(r, d, i, position[i]) for r, d in zip(recordings, noise, strict=True)])
    ceiling = min(HIGHEST_CUTOFF, CUTOFF_OF_SAMPLING * min(1 / g.spacing for g in grids))
    cutoffs, reason = _cutoffs(inertia, torque, position, rate=np.zeros(n), ceiling=ceiling)
    jittered = all(d.jittered(r.q) for r, d in zip(recordings, noise, strict=True))
    rates = tuple(measured_rate(i, recordings, grids, float(cutoffs[i]), float(position[i])) for i in range(n))
    filtered = tuple(all(d.filtered(r.tau[i]) for r, d in zip(recordings, noise, strict=True)) for i in range(n))
    band = Band(cutoffs, reason, torque, position, resolution=step, rates=rates, jittered=jittered, filtered=filtered)
    quiet = np.array([band.rate_noise(i) for i in range(n)], dtype=float)
    if np.isnan(quiet).all():
        return band
    of_rate = np.isfinite(quiet)
    densities = np.where(of_rate, 0.0, position), np.where(of_rate, quiet, 0.0)
    cutoffs, reason = _cutoffs(inertia, torque, *densities, ceiling)
    wider = np.maximum(cutoffs, band.cutoffs)
    return replace(band, cutoffs=wider, reason=reason if wider.min() > band.cutoff else band.reason)


def _own_density(recording: Recording, noise: SampleNoise, joint: int, position: float) -> float:
    """One-sided density of the white noise of a joint's torque (0-based); where a drive's law makes it of a rate that
    follows from positions, without the noise of these, of density `position`, which grows with the frequency."""
    whole, driven = noise.density(recording.tau[joint]), recording.driven[joint] if recording.driven else None
    if driven is None or driven.rate_recorded:
        return whole
    read = np.random.default_rng(joint).standard_normal(len(recording.t)) * np.sqrt(0.5 * position * noise.rate)
    return max(whole - noise.density(driven.reread(read, recording.t, recording.run)), LEAST_OWN_NOISE * whole)


def _cutoffs(inertia: Array, torque: Array, position: Array, rate: Array, ceiling: float) -> tuple[Array, str]:
    """The cut-offs (n,) and the reason of the narrowest.

    torque, position, rate (n,): densities of noise; that of a joint's position or rate is 0, as only the other is
    differentiated. No cut-off lies below the lowest that a joint's own acceleration asks for, as couplings are known
    only up to what two inertias permit.
    """
    alone = _balance(np.diag(np.diagonal(inertia)), torque, position, rate)
    joint = int(np.argmin(alone))
    least = float(f"{np.clip(alone[joint], LOWEST_CUTOFF, ceiling):.3g}")
    widest = min(max(least, WIDE_ENOUGH), ceiling)
    every = np.clip(np.minimum(_balance(inertia, torque, position, rate), alone), least, widest)
    # A passive joint has no equation in the fit.
    cutoffs = np.array([least if silent else float(f"{f:.3g}") for f, silent in zip(every, torque == 0, strict=True)])
    # Close cut-offs become the lower one: each further one is a further view of all recordings.
    order = np.argsort(cutoffs)
    lowest = cutoffs[order[0]]
    for i in order:
        lowest = cutoffs[i] if cutoffs[i] > CLOSE_CUTOFFS * lowest else lowest
        cutoffs[i] = lowest
    if alone[joint] >= ceiling:
        return cutoffs, f"the position is clean enough for the whole band up to {least:g} Hz"
    if alone[joint] <= LOWEST_CUTOFF:
        return cutoffs, f"above {least:g} Hz the encoder of joint {joint + 1} tells nothing about the torque"
    who = f"the encoder noise of joint {joint + 1}"
    return cutoffs, f"above {least:g} Hz {who}, as an inertial torque, would rival the torque noise"


def _balance(inertia: Array, torque: Array, position: Array, rate: Array) -> Array:
    """(n,) Hz, up to which the encoders' noise as an inertial torque has ENCODER_SHARE of the torque noise's variance;
    arguments as `_cutoffs`.

    White noise of a one-sided density, twice and once differentiated, has (2π)⁴ f⁵/5 and (2π)² f³/3 of it up to f.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        square = inertia**2
        fourth, second = square @ position * (2 * np.pi) ** 4 / 5, square @ rate * (2 * np.pi) ** 2 / 3
        share = ENCODER_SHARE * torque
        # f² of fourth f⁴ + second f² = share, stable where either is 0.
        found = np.sqrt(2 * share / (second + np.sqrt(second**2 + 4 * fourth * share)))
    # A torque that never changes has no noise: the joint is passive, and not fitted.
    found[(torque == 0) | np.isnan(found)] = np.inf
    return np.asarray(found)


def lowered(band: Band, factor: float) -> Band | None:
    """Narrower bands of the same recordings; None where the lowest cut-off is reached."""
    if band.cutoff <= LOWEST_CUTOFF:
        return None
    cutoffs = np.array([float(f"{max(factor * f, LOWEST_CUTOFF):.3g}") for f in band.cutoffs])
    what = "most of the measured accelerations is the encoders' noise"
    return replace(band, cutoffs=cutoffs, reason=f"above {cutoffs.min():g} Hz {what}")


# --- inertias, of the model file and of the recordings ---


def coupling_bound(D: Array, inertia: Array) -> Array:
    """(n, n) kg m² (kg), at most, of each joint's torque for each joint's acceleration.

    D (n, n): of the model file; NaN where it is not stated, which stands for the strongest coupling of two bodies.
    inertia (n,): the joints' own, as `credible_inertia` gives them.
    """
    believed, own = np.sqrt(inertia), np.sqrt(np.abs(np.diagonal(D)))
    # A joint that is held may have any inertia.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        most, part = np.outer(believed, believed), np.minimum(np.abs(D) / np.outer(own, own), 1.0)
    found: Array = np.where(np.isfinite(part), part, 1.0) * most
    return found


def rigid_inertia(recordings: Sequence[Recording]) -> Array | None:
    """(n,) kg m² (kg), of the rigid-body torque of the user's own model, without the torque of the posture; None where
    a recording has no such torque."""
    n = len(recordings[0].q)
    moment, square = np.zeros(n), np.zeros(n)
    for r in recordings:
        if r.tau_rigid is None:
            return None
        clock = grid(r)
        derive = differentiator(LOWEST_CUTOFF, 1 / clock.period)
        for s in (s for s in clock.stretches if derive.fits(s.size)):
            q, _, qdd = derive.rows(s.on_grid(r.q))
            # Gravity is no constant, but waves of joints' and links' angles.
            angles = np.vstack([q, np.cumsum(q, axis=0)[1:]])
            posture = np.vstack([np.ones((1, q.shape[1])), np.cos(angles), np.sin(angles)])
            moving = qdd - np.linalg.lstsq(posture.T, qdd.T, rcond=None)[0].T @ posture
            moment += np.sum(moving * s.on_grid(r.tau_rigid)[:, derive.half : -derive.half], axis=1)
            square += np.sum(moving**2, axis=1)
    inertia: Array = np.abs(moment) / np.maximum(square, 1e-300)
    return np.maximum(inertia, 1e-12)


def credible_inertia(stated: Array, recordings: Sequence[Recording]) -> Array:
    """(n,) kg m² (kg): the stated inertias, except those that are unknown (NaN) or less than half of the recordings'
    own, as a guess is. These are the recordings', or where none is measurable the most that the torque permits.

    An inertia that is too large only costs bandwidth; that of a recording may be too small where a torque is delayed.
    """
    parts = [p for r in recordings if (p := _slow_signals(r)) is not None]
    if not parts:
        return np.where(np.isfinite(stated), stated, 1.0)
    q, qd, qdd, tau = (np.concatenate(signals, axis=1) for signals in zip(*parts, strict=True))
    seen = np.array([apparent_inertia(i, q, qd, qdd=qdd, tau=row) for i, row in enumerate(tau)])
    with np.errstate(over="ignore"):  # a joint that is not accelerated may have any inertia
        most = np.linalg.norm(tau, axis=1) / np.maximum(np.linalg.norm(qdd, axis=1), 1e-300)
    known = np.where(np.isfinite(stated), stated, most)
    return np.where(np.isfinite(seen) & ~(2 * stated > seen), seen, known)


def _slow_signals(recording: Recording) -> tuple[Array, Array, Array, Array] | None:
    """q, qd, qdd, tau (n, M) below the lowest cut-off, about 20,000 samples: an inertia is then known far better than
    to a factor of two. None if no stretch is long enough."""
    clock = grid(recording)
    derive, stretch = differentiator(LOWEST_CUTOFF, 1 / clock.period), clock.longest
    if not derive.fits(stretch.size):
        return None
    rows = 20_000
    thin = max(1, min(stretch.size, ENOUGH_FOR_NOISE) // rows)
    q, tau = (stretch.on_grid(x)[:, :ENOUGH_FOR_NOISE] for x in (recording.q, recording.tau))
    position, rate, acceleration = (x[:, ::thin] for x in derive.rows(q))
    return position, rate, acceleration, derive.rows(tau)[0][:, ::thin]


def apparent_inertia(joint: int, q: Array, qd: Array, qdd: Array, tau: Array) -> float:
    """kg m² (kg), the inertia that a joint's torque tau (M,) shows beside friction, gravity and the other joints'
    accelerations, of all signals (n, M); NaN where it explains too little of the torque."""
    waves = [f(row) for row in q for f in (np.sin, np.cos)]
    others = [row for k, row in enumerate(qdd) if k != joint]
    rest = np.array([qd[joint], np.sign(qd[joint]), np.ones(q.shape[1]), *waves, *others])
    y = np.array([qdd[joint], tau])
    beside = y - np.linalg.lstsq(rest.T, y.T, rcond=None)[0].T @ rest
    own, cross, whole = (float(a @ b) for a, b in (beside[[0, 0]], beside, beside[[1, 1]]))
    if own <= 0 or cross <= 0 or cross**2 < SOME * own * whole:
        return float("nan")
    return cross / own


# --- lines of the torque above the band ---


def raised_to_lines(recordings: Sequence[Recording], band: Band, inertia: Array, ratios: Sequence[float]) -> Band:
    """Every joint's band up to the highest line above it that the encoders' noise permits; others stay in `above`.

    inertia (n, n) as for `choose_band`; ratios (n,): gear ratios. As an inertial torque in the raised band, the
    encoders' noise must be small against the joint's lines.
    """
    above = [line for i, ratio in enumerate(ratios) for line in _lines_of_joint(recordings, band, i, ratio)]
    above.sort(key=lambda line: -line.rms)
    above = [line for line in above if line.rms**2 >= LITTLE**2 * above[0].rms ** 2]
    highest = CUTOFF_OF_SAMPLING * min(1 / r.dt for r in recordings)
    cutoffs, reasons = band.cutoffs.copy(), []
    for joint in sorted({line.joint for line in above}):
        own = [line for line in above if line.joint == joint]
        together = float(np.sqrt(sum(line.rms**2 for line in own)))
        for line in sorted(own, key=lambda line: -line.frequency):
            # A band up to there holds the line on about half of the way.
            cutoff = float(f"{(1 + LITTLE) * line.frequency:.3g}")
            # One-sided white noise of the positions, twice differentiated, up to the cut-off.
            noise = float(np.sqrt(inertia[joint] ** 2 @ band.position_density * (2 * np.pi) ** 4 * cutoff**5 / 5))
            if cutoff <= highest and noise < LITTLE * together:
                reasons.append(
                    f"the band of joint {joint + 1} is raised from {cutoffs[joint]:g} to {cutoff:g} Hz to hold a line "
                    f"of its torque that repeats {line.order:.4g} times per turn of the motor, "
                    f"at {line.frequency:.3g} Hz"
                )
                cutoffs[joint] = cutoff
                break
    rest = tuple(line for line in above if (1 + LITTLE) * line.frequency > cutoffs[line.joint])
    return replace(band, cutoffs=cutoffs, reason="; ".join([band.reason, *reasons]), above=rest)


def _lines_of_joint(recordings: Sequence[Recording], band: Band, joint: int, ratio: float) -> list[LineAbove]:
    """Lines of the measured torque above the band; below it lies what the model explains."""
    cutoff = float(band.cutoffs[joint])
    stretches = [(r, slice(s.start, min(s.stop, s.start + ENOUGH_FOR_NOISE))) for r in recordings for s in r.segments]
    parts = [_above_cutoff(r.q[joint, s], r.tau[joint, s], r.dt, ratio=ratio, cutoff=cutoff) for r, s in stretches]
    angle, speed, torque = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    use = speed > LITTLE * speed.max(initial=0.0)
    angle, speed, torque = angle[use], speed[use], torque[use]
    # In few turns a wave over time passes for one over the angle.
    if not len(angle) or np.ptp(angle) < 2 * np.pi * LEAST_PERIODS:
        return []
    ordered = np.sort(speed)
    middle = float(ordered[np.searchsorted(np.cumsum(ordered), ordered.sum() / 2)])
    # Above the band at the middle speed, and below the highest cut-off.
    span = 2 * np.pi * cutoff / middle, 2 * np.pi * CUTOFF_OF_SAMPLING / recordings[0].dt / middle
    among = max(2, round((span[1] - span[0]) * float(np.ptp(angle)) / (2 * np.pi)))
    rows = angle, torque - torque.mean(), np.ones((1, len(angle))), np.array([[1 / len(angle)]])
    return [
        LineAbove(joint, order, order * middle / (2 * np.pi), float(np.sqrt(gain / len(angle))))
        for order, gain in lines(*rows, span, among).items()
    ]


def _above_cutoff(q: Array, tau: Array, dt: float, ratio: float, cutoff: float) -> tuple[Array, Array, Array]:
    """The motor's angle and speed, and the torque without its part below the cut-off, each (N,)."""
    width = max(1, round(1 / (cutoff * dt)))
    if len(q) <= 2 * width:
        return np.empty(0), np.empty(0), np.empty(0)
    speed = np.abs(q[2 * width :] - q[: -2 * width]) / (2 * width * dt)
    inner = slice(width, -width)
    return ratio * q[inner], ratio * speed, tau[inner] - moving_mean(tau, 2 * width + 1)
