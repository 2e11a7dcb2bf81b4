"""Recordings brought into the bands of the joints' equations: positions differentiated, rests taken out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from runtime.model.loader import Model
from runtime.motion import sensors, turns
from runtime.motion.band import Band, excitation
from runtime.motion.clock import EvenGrid, Stretch, grid
from runtime.motion.filters import Differentiator, LowPass, differentiator, low_pass, smoother
from runtime.motion.motion import BandView, Motion
from runtime.motion.piece import Piece
from runtime.motion.settings import (
    HELD_RANGE,
    LEAST_ROWS,
    STANDSTILL_NOISE,
    STANDSTILL_OF_TOP_SPEED,
    TEMPERATURE_START,
    TEMPERATURE_WINDOW_S,
)
from runtime.recordings.contents import unpowered
from runtime.recordings.recording import Recording, RecordingError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def prepare(recordings: Sequence[Recording], band: Band, model: Model) -> Motion:
    """Smooth and differentiate positions once for every band; keep torque raw for the band's filter.

    Stretches shorter than the filters are dropped. Raises RecordingError if none is left.
    """
    n = len(recordings[0].q)
    cutoffs = sorted({float(f) for f in band.cutoffs})
    views = tuple(_view(recordings, band, cutoff, narrowest=cutoffs[0], model=model) for cutoff in cutoffs)
    if not views[0].pieces:
        names = ", ".join(str(r.path) for r in recordings)
        raise RecordingError(f"{names}: no stretch without gaps is long enough to be filtered; record some seconds")
    motion = Motion(band, views, np.zeros(n), quiet=np.zeros(n), cells=recordings[0].cells, units=recordings[0].units)
    motion = motion.resting(_standstill(motion, recordings), np.zeros(n))
    if not any(motion.moving(i).any() for i in range(n)):
        names = ", ".join(str(r.path) for r in recordings)
        raise RecordingError(f"{names}: no joint moves faster than the noise of its encoder; record real motion")
    friction = np.maximum(_dry_friction(motion, model), 1e-300)
    with np.errstate(over="ignore"):  # of any noise there is more than of no friction
        quiet = band.torque_floor()[:n] / friction
    return motion.resting(motion.standstill, quiet)


def _view(recordings: Sequence[Recording], band: Band, cutoff: float, narrowest: float, model: Model) -> BandView:
    """All stretches that the filters of the narrowest band have room in, up to `cutoff` Hz."""
    pieces: list[Piece] = []
    common = sensors.measured_in_all(recordings)
    for number, recording in enumerate(recordings):
        clock = grid(recording)
        derive, band_filter = _filters(cutoff, clock, model)
        widest_derive, widest_filter = _filters(narrowest, clock, model)
        least = 2 * (widest_derive.half + widest_filter.half) + LEAST_ROWS * widest_filter.factor
        for stretch in clock.stretches:
            if stretch.size > least:
                read = sensors.read(recording, stretch, derive, common)
                pieces.append(
                    _piece(
                        recording,
                        number,
                        clock,
                        stretch=stretch,
                        derive=derive,
                        band_filter=band_filter,
                        band=band,
                        read=read,
                    )
                )
    return BandView(tuple(int(i) for i in np.flatnonzero(band.cutoffs == cutoff)), tuple(pieces))


def _filters(cutoff: float, clock: EvenGrid, model: Model) -> tuple[Differentiator, LowPass]:
    return differentiator(cutoff, 1 / clock.period), low_pass(cutoff, 1 / clock.period, model.library)


def _standstill(motion: Motion, recordings: Sequence[Recording]) -> Array:
    """(n,) rates below which a joint counts as at rest, infinite for one that is held."""
    band, n = motion.band, motion.n
    smoothing = 2 * band.cutoffs
    noise = np.sqrt(band.position_density * (2 * np.pi) ** 2 * smoothing**3 / 3)
    for i, density in enumerate(band.rate_noise(k) for k in range(n)):
        noise[i] = noise[i] if density is None else np.sqrt(density * smoothing[i])
    top = np.array([max(np.abs(p.qd[i]).max() for p in motion.pieces_of(i)) for i in range(n)])
    standstill = np.maximum(STANDSTILL_NOISE * noise, STANDSTILL_OF_TOP_SPEED * top)
    low, high = (extreme([extreme(p.q, axis=1) for p in motion.pieces], axis=0) for extreme in (np.min, np.max))
    held = high - low < [HELD_RANGE[kind] for kind in recordings[0].types]
    # A torque that never changes is no measurement of one: the joint is passive, or has no sensor.
    held |= unpowered(np.concatenate([r.tau for r in recordings], axis=1))
    return np.where(held, np.inf, standstill)


def _dry_friction(motion: Motion, model: Model) -> Array:
    """(n,) N m (N), about, of every joint."""
    found = []
    for i in range(motion.n):
        q, qd, qdd = (motion.rows(name, i) for name in ("q", "qd", "qdd"))
        rigid = _rigid_given(motion, i) if motion.rigid_given else model.regressor(q, qd, qdd)[i]
        use, tau = motion.moving(i), motion.recorded(i, 0.0)
        found.append(turns.dry_friction(q[i, use], qd[i, use], qdd[i, use], rigid=rigid[:, use], tau=tau[use]))
    return np.array(found)


def _rigid_given(motion: Motion, joint: int) -> Array:
    """(1, M) the rigid-body torque of the user's own model at a joint (0-based)."""
    given = [(p.sensors.tau_rigid, p.centres) for p in motion.pieces_of(joint)]
    return np.concatenate([x[None, joint, at] for x, at in given if x is not None], axis=1)


def _began(recording: Recording, run: int) -> float:
    """s that all runs before this one lasted."""
    numbers, first = np.unique(recording.run, return_index=True)
    earlier = numbers[first < first[numbers == run]]
    spans = [np.ptp(recording.t[recording.run == number]) + recording.dt for number in earlier]
    return float(sum(spans))


def _piece(
    recording: Recording,
    number: int,
    clock: EvenGrid,
    stretch: Stretch,
    derive: Differentiator,
    band_filter: LowPass,
    band: Band,
    read: sensors.Sensors,
) -> Piece:
    n, segment, dt, half = len(recording.q), stretch.samples, clock.period, derive.half
    parts = [derive(row) for row in stretch.of(recording.q[:, segment])]
    q, qd, qdd = (np.array([part[k] for part in parts]) for k in range(3))
    measured_rate = np.full_like(recording.q, np.nan) if recording.qd is None else recording.qd
    rates = [band.rate_noise(i) if np.isfinite(measured_rate[i]).all() else None for i in range(n)]
    rate_measured = tuple(i for i, noise in enumerate(rates) if noise is not None)
    for k in rate_measured:
        qd[k], qdd[k], _ = derive(stretch.of(measured_rate[k, segment]))
    first = int(np.argmax(recording.run == recording.run[segment.start]))
    warmth, measured = np.zeros_like(q), np.zeros(n, dtype=bool)
    for i in range(n):
        temperature = recording.temperature[i] if i < len(recording.temperature) else None
        if temperature is not None:
            measured[i] = True
            start = np.median(temperature[:TEMPERATURE_START])
            warmth[i] = stretch.of(_smooth_temperature(temperature, dt)[segment])[half:-half] - start
    t = recording.t[segment.start] - recording.t[first] + dt * (half + np.arange(q.shape[1]))
    measured_torque = (stretch.held if band.held else stretch.of)(recording.tau[:, segment])
    tau = np.ascontiguousarray(measured_torque[:, half:-half])
    run = int(recording.run[segment.start])
    rate = 1 / dt
    excited = tuple(
        smoother(excitation(row, rate, density, 2) if noise is None else excitation(row, rate, noise, 1))
        for row, density, noise in zip(qdd, band.position_density, rates, strict=True)
    )
    slow = np.array([smooth(row) for smooth, row in zip(excited, qdd, strict=True)])
    places = None if stretch.places is None else stretch.places - half
    return Piece(
        number,
        run,
        dt,
        t=t,
        q=q,
        qd=qd,
        qdd=qdd,
        slow=slow,
        tau=tau,
        warmth=warmth,
        measured=measured,
        low_pass=band_filter,
        derive=derive,
        excited=excited,
        rate_measured=rate_measured,
        sensors=read,
        places=places,
        began=_began(recording, run),
    )


def _smooth_temperature(x: Array, dt: float) -> Array:
    """Moving mean over a second: gears warm slowly, sensors are coarse."""
    width = min(len(x), max(1, round(TEMPERATURE_WINDOW_S / dt)) | 1)
    padded = np.pad(x, width // 2, mode="edge")
    total = np.concatenate([[0.0], np.cumsum(padded)])
    return (total[width:] - total[:-width]) / width
