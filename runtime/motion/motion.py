"""Recordings as the model sees them: smoothed motion at full rate, torque and regressors inside the band."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from runtime.model.loader import Model
from runtime.motion import sensors, turns
from runtime.motion.band import Band, excitation
from runtime.motion.clock import EvenGrid, Stretch, grid, interpolated
from runtime.motion.filters import Differentiator, LowPass, Smoother, differentiator, low_pass, smoother
from runtime.motion.rates import MeasuredRate
from runtime.motion.sensors import NOTHING, Sensors
from runtime.motion.settings import (
    CLEAR_RATE,
    EXCERPT_WINDOW_KERNELS,
    EXCERPT_WINDOWS,
    HELD_RANGE,
    KEPT_SKEWS,
    LEAST_ROWS,
    MOST_DELAY,
    SPLINE_DEGREE,
    STANDSTILL_NOISE,
    STANDSTILL_OF_TOP_SPEED,
    TEMPERATURE_START,
    TEMPERATURE_WINDOW_S,
    UNTOUCHED,
)
from runtime.motion.unknown_torque import UnknownTorque
from runtime.recordings.plausible import unpowered
from runtime.recordings.recording import Recording, RecordingError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Piece:
    """One gap-free stretch of one recording, on the recording's even grid.

    t (N,) s; q, qd, qdd, tau (n, N); slow (n, N) qdd where the motion stands out of the encoder's noise;
    warmth (n, N) K; measured (n,) whether a temperature was; places: in periods from the first, where the samples
    were taken from which it was interpolated; None where they are those of the grid; rate_measured: joints
    (0-based) whose qd and qdd are those of a measured rate; began: s from the recording's start to that of the run,
    the runs one after another; without: of every joint, what takes a torque out of its rows that nobody knows; empty:
    every torque is known.
    """

    recording: int
    run: int
    dt: float
    t: Array
    q: Array
    qd: Array
    qdd: Array
    slow: Array
    tau: Array
    warmth: Array
    measured: Mask
    low_pass: LowPass
    derive: Differentiator
    excited: tuple[Smoother, ...]
    rate_measured: tuple[int, ...] = ()
    sensors: Sensors = NOTHING
    places: Array | None = None
    began: float = 0.0
    without: tuple[UnknownTorque, ...] = ()

    def perturbed(self, band: Band, seed: int) -> Piece:
        """The piece as its encoders might have read it another time: other places of the steps, other noise.

        Errors of coarse steps are no white noise where the motion is slow, so the steps themselves are taken again.
        """
        rng = np.random.default_rng(seed)
        noise = []
        for q, step, density in zip(self.q, band.resolution, band.position_density, strict=True):
            noise.append(self.derive(self._misread(q, step, density, rng)))
        parts = np.array(noise)
        rates, accelerations = parts[:, 1].copy(), parts[:, 2].copy()
        for i in self.rate_measured:
            error = self._misread(self.qd[i], 0.0, band.rate_noise(i) or 0.0, rng)
            rates[i], accelerations[i], _ = self.derive(error)
        q, qd, qdd = self.q + parts[:, 0], self.qd + rates, self.qdd + accelerations
        slow = np.array([smooth(row) for smooth, row in zip(self.excited, qdd, strict=True)])
        return replace(self, q=q, qd=qd, qdd=qdd, slow=slow, sensors=self.sensors.moved(parts[:, 0], parts[:, 2]))

    def _misread(self, q: Array, step: float, density: float, rng: np.random.Generator) -> Array:
        """(N + 2 half,) errors of another reading of q (N,) on the grid: made where the samples were taken, and
        interpolated as those were."""
        path = np.pad(q, self.derive.half, mode="reflect", reflect_type="odd")
        on_grid = np.arange(len(path)) - self.derive.half
        if self.places is not None:
            path = np.interp(self.places, on_grid, path)
        shifted = path + step * rng.uniform()
        error = step * np.round(shifted / step) - shifted if step else np.zeros_like(path)
        rounding = step**2 / 12
        rest = max(density / (2 * self.dt) - rounding, 0.0)
        error += np.sqrt(rest) * rng.standard_normal(len(path))
        return error if self.places is None else interpolated(self.places, error, on_grid)

    def cut(self, window: slice) -> Piece:
        """The piece within a window of its samples."""

        def part(x: Array) -> Array:
            return np.ascontiguousarray(x[:, window])

        return replace(
            self,
            t=self.t[window],
            q=part(self.q),
            qd=part(self.qd),
            qdd=part(self.qdd),
            slow=part(self.slow),
            tau=part(self.tau),
            warmth=part(self.warmth),
            sensors=self.sensors.cut(window),
            places=self._places_in(window),
            without=tuple(each.cut(window, self.low_pass) for each in self.without),
        )

    def _places_in(self, window: slice) -> Array | None:
        """The samples that the kernels see from a window, and some beyond, from which its ends were interpolated."""
        if self.places is None:
            return None
        reach = self.derive.half + 2 * SPLINE_DEGREE
        first, last = np.searchsorted(self.places, (window.start - reach, window.stop + reach))
        return self.places[first:last] - window.start

    @cached_property
    def centres(self) -> NDArray[np.intp]:
        """(M,) samples on which the rows stand."""
        return self.low_pass.centres(len(self.t))

    def in_band(self, x: Array) -> Array:
        """x (..., N) -> (..., M)."""
        return self.low_pass(x)

    def equation(self, x: Array, joint: int) -> Array:
        """In-band rows x (..., M) of a joint (0-based) less what its unknown torque could have put into them."""
        return self.without[joint](x) if self.without else x

    def equations(self, x: Array) -> Array:
        """x (n, ..., N) -> (n, ..., M): in-band rows of all joints, as `equation`."""
        return np.array([self.equation(row, i) for i, row in enumerate(self.low_pass(x))])

    def moving(self, joint: int) -> Mask:
        """(M,) rows of a joint (0-based) of which enough is known."""
        return self.without[joint].counts if self.without else np.ones(len(self.centres), dtype=bool)

    def untouched(self, joint: int) -> Mask:
        """(M,) rows of a joint (0-based) that no unknown torque reaches."""
        found: Mask = self.moving(joint) & (self.without[joint].left > UNTOUCHED if self.without else True)
        return found

    def eliminated(self, joint: int) -> sparse.csr_array:
        """(M, K) combinations of the joint's rows (0-based) that were eliminated."""
        return self.without[joint].directions if self.without else sparse.csr_array((len(self.centres), 0))

    def noise_left(self, joint: int) -> Array:
        """(M,) of the variance that white noise of a joint's torque (0-based) has in a row, the part that is left.

        In the band's rows, which are closer than their noise needs, an eliminated combination held more of it than one
        of a row.
        """
        if not self.without:
            return np.ones(len(self.centres))
        denser = 1 / (2 * self.low_pass.cutoff * self.dt * self.low_pass.factor)
        return np.maximum(1 - denser * (1 - self.without[joint].left), 0.0)

    def resting(self, standstill: Array, quiet: Array) -> Piece:
        """The piece with joints at rest below these rates (n,); quiet (n,): torque noise in the band over what dry
        friction may come to there, 0 where that is not known."""
        rests = [turns.at_rest(qd, self.dt, self.low_pass.cutoff, x) for qd, x in zip(self.qd, standstill, strict=True)]
        whole = replace(self, without=()).unknown_at(np.array(rests), quiet)
        # A joint that is stopped again and again would have no rows left.
        clear = (quiet > 0) & (standstill < CLEAR_RATE * np.max(np.abs(self.qd), axis=1, initial=0.0))
        found = zip(whole.without, clear, strict=True)
        return replace(self, without=tuple(x.resolved(self.low_pass) if c and x.too_much else x for x, c in found))

    def unknown_at(self, samples: Mask, quiet: Array) -> Piece:
        """The piece with the joints' torques unknown at more samples (n, N)."""
        there = samples | np.array([each.samples for each in self.without]) if self.without else samples
        found = (UnknownTorque.of(self.low_pass, x, level) for x, level in zip(there, quiet, strict=True))
        return replace(self, without=tuple(found))


@dataclass(frozen=True)
class Motion:
    """All pieces, and which of their in-band rows may be used for each joint.

    standstill (n,): rates below which a joint counts as at rest, infinite for one that is held.
    quiet (n,): torque noise in the band over what dry friction may come to at rest.
    cells, units: of each signal, what `--map` takes for the field of the first recording from which it was read, and
    in which unit, where one was stated.
    """

    band: Band
    pieces: tuple[Piece, ...]
    standstill: Array
    quiet: Array
    cells: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.standstill)

    def has(self, name: str, joint: int) -> bool:
        """Whether a signal of `Sensors` is measured at a joint (0-based), in all recordings."""
        return all(p.sensors.has(name, joint) for p in self.pieces)

    @property
    def rates(self) -> tuple[MeasuredRate | None, ...]:
        """What is made of measured rates, by joint, and why; None where there are none."""
        return self.band.rates

    @property
    def rigid_given(self) -> bool:
        """Whether the rigid-body torque comes from the user's own model, at all joints."""
        return all(p.sensors.tau_rigid is not None for p in self.pieces)

    @cached_property
    def columns(self) -> dict[tuple[Hashable, ...], Array]:
        """In-band regressors that depend on the motion alone, kept for whoever asks again."""
        return {}

    @cached_property
    def perturbed(self) -> Motion:
        """The same motion as another reading of the encoders might have given it; always the same one."""
        return replace(self, pieces=tuple(p.perturbed(self.band, seed) for seed, p in enumerate(self.pieces)))

    @cached_property
    def unsmoothed(self) -> Motion:
        """The same motion with all of the encoder's noise in the accelerations that a load is made of."""
        return replace(self, pieces=tuple(replace(p, slow=p.qdd) for p in self.pieces))

    def excerpt(self, samples: int) -> tuple[Motion, NDArray[np.intp]]:
        """Windows spread evenly over the motion, about `samples` long together, and the in-band rows they hold.

        A motion that is no longer than that is its own excerpt; asked for again, it is the same one.
        """
        if samples not in self._excerpts:
            self._excerpts[samples] = self._cut_to(samples)
        return self._excerpts[samples]

    @cached_property
    def _excerpts(self) -> dict[int, tuple[Motion, NDArray[np.intp]]]:
        return {}

    def _cut_to(self, samples: int) -> tuple[Motion, NDArray[np.intp]]:
        total = sum(len(p.t) for p in self.pieces)
        if total <= samples:
            return self, np.arange(len(self.row_piece))
        pieces: list[Piece] = []
        rows: list[NDArray[np.intp]] = []
        start = 0
        for piece in self.pieces:
            for window in _windows(piece, round(samples * len(piece.t) / total)):
                pieces.append(piece.cut(window))
                rows.append(start + window.start // piece.low_pass.factor + np.arange(len(pieces[-1].centres)))
            start += len(piece.centres)
        return replace(self, pieces=tuple(pieces)), np.concatenate(rows)

    def moving(self, joint: int) -> Mask:
        """(M,) rows of the joint (0-based) of which enough is known."""
        return self._moving[joint]

    def untouched(self, joint: int) -> Mask:
        """(M,) rows of the joint (0-based) that no unknown torque reaches."""
        return np.concatenate([p.untouched(joint) for p in self.pieces])

    def noise_left(self, joint: int) -> Array:
        """(M,) of the variance that white noise of a joint's torque (0-based) has in a row, the part that is left."""
        return np.concatenate([p.noise_left(joint) for p in self.pieces])

    def dependent(self, joint: int, use: Mask) -> int:
        """How many of some of the joint's rows (0-based), use (M,), follow from the others by what was eliminated."""
        left = [p.without[joint].left if p.without else np.ones(len(p.centres)) for p in self.pieces]
        return round(float(np.sum(1 - np.concatenate(left)[use])))

    def eliminated(self, joint: int) -> sparse.csr_array:
        """(M, K) combinations of the joint's rows (0-based) that were eliminated."""
        return sparse.csr_array(sparse.block_diag([p.eliminated(joint) for p in self.pieces], format="csr"))

    @cached_property
    def _moving(self) -> list[Mask]:
        return [np.concatenate([p.moving(i) for p in self.pieces]) for i in range(self.n)]

    def resting(self, standstill: Array, quiet: Array) -> Motion:
        """The same motion, as `Piece.resting`."""
        pieces = tuple(p.resting(standstill, quiet) for p in self.pieces)
        return replace(self, pieces=pieces, standstill=standstill, quiet=quiet)

    @cached_property
    def with_standstill(self) -> Motion:
        """The same motion with all torques known, whether joints rest or not."""
        return replace(self, pieces=tuple(replace(p, without=()) for p in self.pieces))

    @cached_property
    def row_piece(self) -> NDArray[np.intp]:
        """(M,) the piece of each in-band row."""
        return np.concatenate([np.full(len(p.centres), k) for k, p in enumerate(self.pieces)])

    @cached_property
    def row_time(self) -> Array:
        """(M,) s, of the rows of all pieces, each since its own beginning."""
        return np.concatenate([p.t[p.centres] for p in self.pieces])

    @cached_property
    def row_rate(self) -> float:
        """In-band rows a second."""
        first = self.pieces[0]
        return 1 / (first.dt * first.low_pass.factor)

    def rows(self, name: str) -> Array:
        """(n, M): `q`, `qd`, `qdd` or `warmth` at the in-band rows (not filtered again)."""
        return np.concatenate([getattr(p, name)[:, p.centres] for p in self.pieces], axis=1)

    def torque(self, joint: int, skew: float) -> Array:
        """(M,) measured torque in the band, `skew` samples later than recorded, less what is unknown of it; not to be
        written to."""
        kept = self._torques.setdefault(joint, {})
        if skew not in kept:
            if len(kept) >= KEPT_SKEWS:
                kept.clear()
            kept[skew] = np.concatenate([p.equation(_late(p, p.tau[joint], skew), joint) for p in self.pieces])
            kept[skew].flags.writeable = False
        return kept[skew]

    def recorded(self, joint: int, skew: float) -> Array:
        """(M,) measured torque in the band, `skew` samples later than recorded, whole."""
        return np.concatenate([_late(p, p.tau[joint], skew) for p in self.pieces])

    @cached_property
    def _torques(self) -> dict[int, dict[float, Array]]:
        """Of each joint (0-based) the torques at the last skews: a search over shapes asks for the same again."""
        return {}

    def torque_ahead(self, joint: int, skew: float, time: float) -> Array:
        """(M,) measured torque in the band, `skew` samples and `time` s later than recorded."""
        parts = [p.equation(_late(p, p.tau[joint], skew + time / p.dt), joint) for p in self.pieces]
        return np.concatenate(parts)


def _late(piece: Piece, x: Array, delay: float) -> Array:
    """In-band x, `delay` samples late; by whole samples what the filter has no room for, the ends held."""
    whole = round(delay) if abs(delay) > MOST_DELAY - 0.5 else 0
    if whole:
        reach = min(abs(whole), len(x))
        padded = np.pad(x, reach, mode="edge")
        x = np.ascontiguousarray(padded[reach - whole : reach - whole + len(x)])
    return piece.low_pass(x, delay - whole)


def _windows(piece: Piece, samples: int) -> list[slice]:
    """At most EXCERPT_WINDOWS windows, each long against the filter, that begin on rows of the band."""
    factor, taps = piece.low_pass.factor, 2 * piece.low_pass.half + 1
    length = max(samples // EXCERPT_WINDOWS, EXCERPT_WINDOW_KERNELS * taps)
    count = max(1, min(EXCERPT_WINDOWS, samples // length))
    starts = np.linspace(0, max(0, len(piece.t) - length), count) // factor * factor
    return [slice(int(s), int(s) + length) for s in starts]


def _dry_friction(motion: Motion, model: Model) -> Array:
    """(n,) N m (N), about, of every joint."""
    q, qd, qdd = (motion.rows(name) for name in ("q", "qd", "qdd"))
    rigid = _rigid_given(motion) if motion.rigid_given else model.regressor(q, qd, qdd)
    found = []
    for i in range(motion.n):
        use = motion.moving(i)
        tau = motion.recorded(i, 0.0)[use]
        found.append(turns.dry_friction(q[i, use], qd[i, use], qdd[i, use], rigid[i][:, use], tau))
    return np.array(found)


def _rigid_given(motion: Motion) -> Array:
    """(n, 1, M) the rigid-body torque of the user's own model."""
    given = [(p.sensors.tau_rigid, p.centres) for p in motion.pieces]
    return np.concatenate([x[:, None, at] for x, at in given if x is not None], axis=2)


def prepare(recordings: Sequence[Recording], band: Band, model: Model) -> Motion:
    """Smooth and differentiate positions once; keep torque raw for the band's filter.

    Stretches shorter than the filters are dropped. Raises RecordingError if none is left.
    """
    pieces: list[Piece] = []
    common = sensors.measured_in_all(recordings)
    for number, recording in enumerate(recordings):
        clock = grid(recording)
        derive = differentiator(band.cutoff, 1 / clock.period)
        band_filter = low_pass(band.cutoff, 1 / clock.period, model.library)
        for stretch in clock.stretches:
            if stretch.size > 2 * (derive.half + band_filter.half) + LEAST_ROWS * band_filter.factor:
                piece = _piece(recording, number, clock, stretch, derive, band_filter, band)
                read = sensors.read(recording, stretch, derive, common)
                pieces.append(replace(piece, sensors=read, began=_began(recording, piece.run)))
    if not pieces:
        names = ", ".join(str(r.path) for r in recordings)
        raise RecordingError(f"{names}: no stretch without gaps is long enough to be filtered; record some seconds")
    n = len(recordings[0].q)
    top = np.max([np.abs(p.qd).max(axis=1) for p in pieces], axis=0)
    smoothing = 2 * band.cutoff
    noise = np.sqrt(band.position_density * (2 * np.pi) ** 2 * smoothing**3 / 3)
    for i, density in enumerate(band.rate_noise(k) for k in range(n)):
        noise[i] = noise[i] if density is None else np.sqrt(density * smoothing)
    standstill = np.maximum(STANDSTILL_NOISE * noise, STANDSTILL_OF_TOP_SPEED * top)[:n]
    low, high = (extreme([extreme(p.q, axis=1) for p in pieces], axis=0) for extreme in (np.min, np.max))
    held = high - low < [HELD_RANGE[kind] for kind in recordings[0].types]
    # A torque that never changes is no measurement of one: the joint is passive, or has no sensor.
    held |= unpowered(np.concatenate([r.tau for r in recordings], axis=1))
    standstill = np.where(held, np.inf, standstill)
    motion = Motion(band, tuple(pieces), standstill, np.zeros(n), recordings[0].cells, recordings[0].units)
    motion = motion.resting(standstill, np.zeros(n))
    if not any(motion.moving(i).any() for i in range(n)):
        names = ", ".join(str(r.path) for r in recordings)
        raise RecordingError(f"{names}: no joint moves faster than the noise of its encoder; record real motion")
    friction = np.maximum(_dry_friction(motion, model), 1e-300)
    with np.errstate(over="ignore"):  # of any noise there is more than of no friction
        quiet = band.torque_floor()[:n] / friction
    return motion.resting(standstill, quiet)


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
        t,
        q,
        qd,
        qdd,
        slow,
        tau,
        warmth,
        measured,
        band_filter,
        derive,
        excited,
        rate_measured,
        places=places,
    )


def _smooth_temperature(x: Array, dt: float) -> Array:
    """Moving mean over a second: gears warm slowly, sensors are coarse."""
    width = min(len(x), max(1, round(TEMPERATURE_WINDOW_S / dt)) | 1)
    padded = np.pad(x, width // 2, mode="edge")
    total = np.concatenate([[0.0], np.cumsum(padded)])
    return (total[width:] - total[:-width]) / width
