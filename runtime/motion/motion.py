"""Recordings become a motion: of every joint, the pieces as the band of its own equation shows them."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from runtime.model.loader import Model
from runtime.motion.band import Band, excitation
from runtime.motion.clock import EvenGrid, Stretch, grid
from runtime.motion.filters import Differentiator, LowPass, differentiator, low_pass, smoother
from runtime.motion.noise import MeasuredRate
from runtime.motion.piece import Piece, Sensors, measured_in_all, read_sensors
from runtime.motion.rests import dry_friction
from runtime.motion.settings import (
    EXCERPT_WINDOW_KERNELS,
    EXCERPT_WINDOWS,
    HELD_RANGE,
    KEPT_SKEWS,
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
Rows = NDArray[np.intp]


@dataclass(frozen=True)
class BandView:
    """All pieces as one band shows them, whose rows are those of some joints' equations (0-based)."""

    joints: tuple[int, ...]
    pieces: tuple[Piece, ...]

    @cached_property
    def row_piece(self) -> Rows:
        """(M,) the piece of each row."""
        return np.concatenate([np.full(len(p.centres), k) for k, p in enumerate(self.pieces)])

    @cached_property
    def row_time(self) -> Array:
        """(M,) s, of the rows of all pieces, each since its own beginning."""
        return np.concatenate([p.t[p.centres] for p in self.pieces])

    def cut(self, samples: int) -> tuple[BandView, Rows]:
        """As `Motion.excerpt`."""
        total = sum(len(p.t) for p in self.pieces)
        pieces: list[Piece] = []
        rows: list[Rows] = []
        start = 0
        for piece in self.pieces:
            for window in _windows(piece, round(samples * len(piece.t) / total)):
                pieces.append(piece.cut(window))
                rows.append(start + window.start // piece.low_pass.factor + np.arange(len(pieces[-1].centres)))
            start += len(piece.centres)
        return replace(self, pieces=tuple(pieces)), np.concatenate(rows)


@dataclass(frozen=True)
class Motion:
    """All pieces as the band of each joint's equation shows them, and which of its rows may be used.

    Signals of all joints are read in the band of the joint whose equation it is: what its torque is compared with is
    smoothed as that torque is.

    views: from the narrowest band on, every joint in one of them.
    standstill (n,): rates below which a joint counts as at rest, infinite for one that is held.
    quiet (n,): torque noise in the band over what dry friction may come to at rest.
    cells, units: of each signal, what `--map` takes for the field of the first recording from which it was read, and
    in which unit, where one was stated.
    """

    band: Band
    views: tuple[BandView, ...]
    standstill: Array
    quiet: Array
    cells: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.standstill)

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """All pieces in the narrowest band, in which every joint's noise is small."""
        return self.views[0].pieces

    def view(self, joint: int) -> BandView:
        """That of a joint's equation (0-based)."""
        return self._view[joint]

    def pieces_of(self, joint: int) -> tuple[Piece, ...]:
        """All pieces in the band of a joint's equation (0-based)."""
        return self._view[joint].pieces

    @cached_property
    def _view(self) -> dict[int, BandView]:
        return {joint: view for view in self.views for joint in view.joints}

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

    def changed(self, change: Callable[[Piece], Piece]) -> Motion:
        """The same motion with every piece changed."""
        return self._viewed(lambda view: tuple(change(p) for p in view.pieces))

    def of_recording(self, number: int) -> Motion:
        """What one recording (0-based) has of it."""
        return self._viewed(lambda view: tuple(p for p in view.pieces if p.recording == number))

    def _viewed(self, pieces: Callable[[BandView], tuple[Piece, ...]]) -> Motion:
        return replace(self, views=tuple(replace(view, pieces=pieces(view)) for view in self.views))

    @cached_property
    def perturbed(self) -> Motion:
        """The same motion as another reading of the encoders might have given it; always the same one."""
        return self._viewed(lambda view: tuple(p.perturbed(self.band, seed) for seed, p in enumerate(view.pieces)))

    @cached_property
    def unsmoothed(self) -> Motion:
        """The same motion with all of the encoder's noise in the accelerations that a load is made of."""
        return self.changed(lambda p: replace(p, slow=p.qdd))

    def excerpt(self, samples: int) -> tuple[Motion, tuple[Rows, ...]]:
        """Windows spread evenly over the motion, about `samples` long together, and of each joint the in-band rows
        that they hold.

        A motion that is no longer than that is its own excerpt; asked for again, it is the same one.
        """
        if samples not in self._excerpts:
            self._excerpts[samples] = self._cut_to(samples)
        return self._excerpts[samples]

    @cached_property
    def _excerpts(self) -> dict[int, tuple[Motion, tuple[Rows, ...]]]:
        return {}

    def _cut_to(self, samples: int) -> tuple[Motion, tuple[Rows, ...]]:
        if sum(len(p.t) for p in self.pieces) <= samples:
            return self, tuple(np.arange(len(self.row_piece(i))) for i in range(self.n))
        found = [view.cut(samples) for view in self.views]
        rows = {joint: rows for view, rows in found for joint in view.joints}
        return replace(self, views=tuple(view for view, _ in found)), tuple(rows[i] for i in range(self.n))

    def resting(self, standstill: Array, quiet: Array) -> Motion:
        """The same motion, as `Piece.resting`."""
        found = self._viewed(lambda view: tuple(p.resting(standstill, quiet, view.joints) for p in view.pieces))
        return replace(found, standstill=standstill, quiet=quiet)

    @cached_property
    def with_standstill(self) -> Motion:
        """The same motion with all torques known, whether joints rest or not."""
        return self.changed(lambda p: replace(p, without=()))

    # --- the rows of a joint's equation (0-based) ---

    def moving(self, joint: int) -> Mask:
        """(M,) rows of which enough is known."""
        return self._moving[joint]

    @cached_property
    def _moving(self) -> list[Mask]:
        return [np.concatenate([p.moving(i) for p in self.pieces_of(i)]) for i in range(self.n)]

    def untouched(self, joint: int) -> Mask:
        """(M,) rows that no unknown torque reaches."""
        return np.concatenate([p.untouched(joint) for p in self.pieces_of(joint)])

    def noise_left(self, joint: int) -> Array:
        """(M,) of the variance that white noise of the joint's torque has in a row, the part that is left."""
        return np.concatenate([p.noise_left(joint) for p in self.pieces_of(joint)])

    def dependent(self, joint: int, use: Mask) -> int:
        """How many of some rows, use (M,), follow from the others by what was eliminated."""
        left = [p.without[joint].left if p.without else np.ones(len(p.centres)) for p in self.pieces_of(joint)]
        return round(float(np.sum(1 - np.concatenate(left)[use])))

    def eliminated(self, joint: int) -> sparse.csr_array:
        """(M, K) combinations of rows that were eliminated."""
        parts = [p.eliminated(joint) for p in self.pieces_of(joint)]
        return sparse.csr_array(sparse.block_diag(parts, format="csr"))

    def cutoff(self, joint: int) -> float:
        """Hz, of the joint's band."""
        return float(self.band.cutoffs[joint])

    def row_piece(self, joint: int) -> Rows:
        """(M,) the piece of each row."""
        return self.view(joint).row_piece

    def row_time(self, joint: int) -> Array:
        """(M,) s, of the rows of all pieces, each since its own beginning."""
        return self.view(joint).row_time

    def row_rate(self, joint: int) -> float:
        """Rows a second."""
        first = self.pieces_of(joint)[0]
        return 1 / (first.dt * first.low_pass.factor)

    def rows(self, name: str, joint: int) -> Array:
        """(n, M): `q`, `qd`, `qdd` or `warmth` of all joints at the rows (not filtered again)."""
        return np.concatenate([getattr(p, name)[:, p.centres] for p in self.pieces_of(joint)], axis=1)

    def beside(self, joint: int, other: int) -> Rows:
        """(M',) of every row of another joint's equation the row of this one's that is nearest in time."""
        if self.view(joint) is self.view(other):
            return np.arange(len(self.row_piece(joint)))
        found, start = [], 0
        for own, there in zip(self.pieces_of(joint), self.pieces_of(other), strict=True):
            t = own.t[own.centres]
            after = np.clip(np.searchsorted(t, there.t[there.centres]), 1, max(len(t) - 1, 1))
            nearer = there.t[there.centres] - t[after - 1] < t[np.minimum(after, len(t) - 1)] - there.t[there.centres]
            found.append(start + np.minimum(after - nearer, len(t) - 1))
            start += len(t)
        return np.concatenate(found)

    def torque(self, joint: int, skew: float) -> Array:
        """(M,) measured torque in the band, `skew` samples later than recorded, less what is unknown of it; not to be
        written to."""
        kept = self._torques.setdefault(joint, {})
        if skew not in kept:
            if len(kept) >= KEPT_SKEWS:
                kept.clear()
            kept[skew] = self.torque_ahead(joint, skew, 0.0)
            kept[skew].flags.writeable = False
        return kept[skew]

    @cached_property
    def _torques(self) -> dict[int, dict[float, Array]]:
        """Of each joint (0-based) the torques at the last skews: a search over shapes asks for the same again."""
        return {}

    def recorded(self, joint: int, skew: float) -> Array:
        """(M,) measured torque in the band, `skew` samples later than recorded, whole."""
        return np.concatenate([p.late(p.tau[joint], skew) for p in self.pieces_of(joint)])

    def torque_ahead(self, joint: int, skew: float, time: float) -> Array:
        """(M,) measured torque in the band, `skew` samples and `time` s later than recorded, less what is unknown."""
        pieces = self.pieces_of(joint)
        return np.concatenate([p.equation(p.late(p.tau[joint], skew + time / p.dt), joint) for p in pieces])


def _windows(piece: Piece, samples: int) -> list[slice]:
    """At most EXCERPT_WINDOWS windows, each long against the filter, that begin on rows of the band."""
    factor, taps = piece.low_pass.factor, 2 * piece.low_pass.half + 1
    length = max(samples // EXCERPT_WINDOWS, EXCERPT_WINDOW_KERNELS * taps)
    count = max(1, min(EXCERPT_WINDOWS, samples // length))
    starts = np.linspace(0, max(0, len(piece.t) - length), count) // factor * factor
    return [slice(int(s), int(s) + length) for s in starts]


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
    common = measured_in_all(recordings)
    for number, recording in enumerate(recordings):
        clock = grid(recording)
        derive, band_filter = _filters(cutoff, clock, model)
        widest_derive, widest_filter = _filters(narrowest, clock, model)
        least = 2 * (widest_derive.half + widest_filter.half) + LEAST_ROWS * widest_filter.factor
        for stretch in clock.stretches:
            if stretch.size > least:
                read = read_sensors(recording, stretch, derive, common)
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
        found.append(dry_friction(q[i, use], qd[i, use], qdd[i, use], rigid=rigid[:, use], tau=tau[use]))
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
    read: Sensors,
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
