"""Recordings become a motion: pieces of signals, filtered to the band of each joint's equation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from runtime.arrays import Array, Mask, Once
from runtime.model.loader import Model
from runtime.motion.band import Band, wiener_filter
from runtime.motion.clock import EvenGrid, Stretch, grid
from runtime.motion.filters import Differentiator, LowPass, differentiator, low_pass, moving_mean, smoother
from runtime.motion.piece import Gain, Piece, measured_in_all, read_sensors
from runtime.motion.rests import dry_friction
from runtime.motion.settings import CERTAIN, HELD_RANGE, STANDSTILL_OF_TOP_SPEED, UNAFFECTED
from runtime.recordings.contents import unpowered
from runtime.recordings.driven import DrivenJoint, ToldGain
from runtime.recordings.recording import Recording, RecordingError, drives_of
from symbolic.model_file.arm import MOTOR_TORQUE

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class BandView:
    """All pieces in the band of some joints' equations (0-based)."""

    joints: tuple[int, ...]
    pieces: tuple[Piece, ...]

    @cached_property
    def row_piece(self) -> Rows:
        """(M,) number of each row's piece."""
        return np.concatenate([np.full(len(p.centres), k) for k, p in enumerate(self.pieces)])

    @cached_property
    def row_time(self) -> Array:
        """(M,) s of each row, since the beginning of its run."""
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
    """All pieces in the band of each joint's equation, and which of its rows count.

    All signals of a joint's equation, also those of other joints, are smoothed to its band, as its torque is.

    views       from the narrowest band on, every joint in one of them
    standstill  (n,) rates below which a joint is at rest, infinite for one that is held
    quiet       (n,) torque noise in the band over dry friction
    left_out    a joint, (M,) further rows that do not count; empty where all do
    driven      as `drives_of` its recordings
    gains       those of drives that were identified and that a fit may change
    cells       field of each signal in the first recording, as `--map` takes it; units: those that were stated
    """

    band: Band
    views: tuple[BandView, ...]
    standstill: Array
    quiet: Array
    cells: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    left_out: tuple[Mask, ...] = ()
    driven: tuple[DrivenJoint | None, ...] = ()
    gains: tuple[Gain, ...] = ()

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.standstill)

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """All pieces in the narrowest band."""
        return self.views[0].pieces

    def view(self, joint: int) -> BandView:
        """The view in the band of a joint's equation (0-based)."""
        return next(view for view in self.views if joint in view.joints)

    def pieces_of(self, joint: int) -> tuple[Piece, ...]:
        """All pieces in the band of a joint's equation (0-based)."""
        return self.view(joint).pieces

    def has(self, name: str, joint: int) -> bool:
        """Whether a signal of `Sensors` is measured at a joint (0-based), in all recordings."""
        return all(p.sensors.has(name, joint) for p in self.pieces)

    @property
    def rigid_given(self) -> bool:
        """Whether the rigid-body torque comes from the user's own model, at all joints."""
        return all(p.sensors.tau_rigid is not None for p in self.pieces)

    @cached_property
    def once(self) -> Once:
        """What depends on the motion and the model alone: in-band regressors, later torques."""
        return Once()

    # --- other motions made of it ---

    def changed(self, change: Callable[[Piece], Piece]) -> Motion:
        """The motion with every piece changed."""
        return self._viewed(lambda view: tuple(change(p) for p in view.pieces))

    def of_recording(self, number: int) -> Motion:
        """The pieces of one recording (0-based)."""
        found = self._viewed(lambda view: tuple(p for p in view.pieces if p.recording == number))
        own = [k for k, p in enumerate(self.pieces) if p.recording == number]
        kept = tuple(mask[np.isin(self.row_piece(i), own)] for i, mask in enumerate(self.left_out))
        return replace(found, left_out=kept)

    def with_gains(self, told: Mapping[int, Mapping[str, ToldGain]]) -> Motion:
        """The motion with torques by other gains of drives, by joint (0-based), as far as a limit does not cut them."""
        driven = tuple(joint and joint.with_told(told.get(i, joint.told)) for i, joint in enumerate(self.driven))
        change = {
            (i, name): value - before.acting[name]
            for i, (before, after) in enumerate(zip(self.driven, driven, strict=True))
            if before is not None and after is not None
            for name, value in after.acting.items()
            if value != before.acting[name]
        }

        if not change:
            return self

        def changed(p: Piece) -> Piece:
            tau, at_once = p.tau.copy(), p.at_once.copy()
            for gain, (column, own) in p.gains.items():
                tau[gain[0]] += change.get(gain, 0.0) * column
                at_once[gain[0]] += change.get(gain, 0.0) * own
            return replace(p, tau=tau, at_once=at_once)

        return replace(self.changed(changed), driven=driven, gains=tuple(_gains(driven)))

    def without_rows(self, left_out: Sequence[Mask]) -> Motion:
        """The motion without some rows (M,) of each joint."""
        return replace(self, left_out=tuple(left_out))

    def _viewed(self, pieces: Callable[[BandView], tuple[Piece, ...]]) -> Motion:
        return replace(self, views=tuple(replace(view, pieces=pieces(view)) for view in self.views))

    @cached_property
    def perturbed(self) -> Motion:
        """The motion with another realisation of the encoders' errors, always the same one."""
        return self._viewed(lambda v: tuple(p.perturbed(self.band, k, self.driven) for k, p in enumerate(v.pieces)))

    @cached_property
    def unsmoothed(self) -> Motion:
        """The motion with accelerations that are not denoised (`Piece.qdd_denoised`)."""
        return self.changed(lambda p: replace(p, qdd_denoised=p.qdd))

    @property
    def all_late(self) -> Motion:
        """The motion with torques of laws as late as their commands, the part that is at once, too."""
        nothing = np.zeros((0, 0))
        return self.changed(
            lambda p: replace(p, at_once=nothing, gains={g: np.stack([x[0], 0 * x[1]]) for g, x in p.gains.items()})
        )

    @cached_property
    def with_standstill(self) -> Motion:
        """The motion with no torque eliminated at rest."""
        return self.changed(lambda p: replace(p, without=()))

    def resting(self, standstill: Array, quiet: Array) -> Motion:
        """The motion with torques unknown at rest, as `Piece.resting`."""
        found = self._viewed(lambda view: tuple(p.resting(standstill, quiet, view.joints) for p in view.pieces))
        return replace(found, standstill=standstill, quiet=quiet)

    @cached_property
    def _excerpts(self) -> dict[int, tuple[Motion, tuple[Rows, ...]]]:
        return {}

    def excerpt(self, samples: int) -> tuple[Motion, tuple[Rows, ...]]:
        """Windows spread evenly over the motion, about `samples` long together, and each joint's rows (M',) in them;
        the motion itself if it is no longer. It is kept."""
        if samples not in self._excerpts:
            if sum(len(p.t) for p in self.pieces) <= samples:
                return self, tuple(np.arange(len(self.row_piece(i))) for i in range(self.n))
            found = [view.cut(samples) for view in self.views]
            rows = {joint: rows for view, rows in found for joint in view.joints}
            left_out = tuple(mask[rows[i]] for i, mask in enumerate(self.left_out))
            cut = replace(self, views=tuple(view for view, _ in found), left_out=left_out)
            self._excerpts[samples] = cut, tuple(rows[i] for i in range(self.n))
        return self._excerpts[samples]

    # --- the rows of a joint's equation (0-based) ---

    @cached_property
    def _moving(self) -> list[Mask]:
        found = [np.concatenate([p.unknown(i).counts for p in self.pieces_of(i)]) for i in range(self.n)]
        return [counts & ~mask for counts, mask in zip(found, self.left_out, strict=True)] if self.left_out else found

    def moving(self, joint: int) -> Mask:
        """(M,) rows that count: not left out, and the elimination of unknown torques leaves enough of them."""
        return self._moving[joint]

    def _left(self, joint: int) -> Array:
        """(M,) part of each row that the elimination leaves."""
        return np.concatenate([p.unknown(joint).left for p in self.pieces_of(joint)])

    def unaffected(self, joint: int) -> Mask:
        """(M,) rows that no unknown torque reaches."""
        found: Mask = self.moving(joint) & (self._left(joint) > UNAFFECTED)
        return found

    def noise_left(self, joint: int) -> Array:
        """(M,) part of the variance of white torque noise that the elimination leaves in each row."""
        return np.concatenate([p.noise_left(joint) for p in self.pieces_of(joint)])

    def dependent(self, joint: int, use: Mask) -> int:
        """Number of ranks that the elimination takes from some rows, use (M,)."""
        return round(float(np.sum(1 - self._left(joint)[use])))

    @cached_property
    def _eliminated(self) -> list[sparse.csr_array]:
        every = ([p.unknown(i).directions for p in self.pieces_of(i)] for i in range(self.n))
        return [sparse.csr_array(sparse.block_diag(parts, format="csr")) for parts in every]

    def eliminated(self, joint: int) -> sparse.csr_array:
        """(M, K) combinations of rows that were eliminated."""
        return self._eliminated[joint]

    def cutoff(self, joint: int) -> float:
        """Hz, of the joint's band."""
        return float(self.band.cutoffs[joint])

    def row_piece(self, joint: int) -> Rows:
        """(M,) number of each row's piece."""
        return self.view(joint).row_piece

    def row_time(self, joint: int) -> Array:
        """(M,) s of each row, since the beginning of its run."""
        return self.view(joint).row_time

    def row_rate(self, joint: int) -> float:
        """Rows a second."""
        first = self.pieces_of(joint)[0]
        return 1 / (first.dt * first.low_pass.factor)

    def rows(self, name: str, joint: int) -> Array:
        """(n, M) `q`, `qd`, `qdd` or `warmth` of all joints at the rows (not filtered again)."""
        return np.concatenate([getattr(p, name)[:, p.centres] for p in self.pieces_of(joint)], axis=1)

    def nearest_rows(self, joint: int, other: int) -> Rows:
        """(M',) for every row of another joint's equation, the row of this one's that is nearest in time."""
        if self.view(joint) is self.view(other):
            return np.arange(len(self.row_piece(joint)))
        found, start = [], 0
        for own, there in zip(self.pieces_of(joint), self.pieces_of(other), strict=True):
            t, at = own.t[own.centres], there.t[there.centres]
            after = np.clip(np.searchsorted(t, at), 1, max(len(t) - 1, 1))
            nearer = at - t[after - 1] < t[np.minimum(after, len(t) - 1)] - at
            found.append(start + np.minimum(after - nearer, len(t) - 1))
            start += len(t)
        return np.concatenate(found)

    @cached_property
    def _torques(self) -> dict[int, dict[float, Array]]:
        """Torques of each joint (0-based) at the last skews: a search over shapes asks for the same again."""
        return {}

    def torque(self, joint: int, skew: float) -> Array:
        """(M,) measured torque in the band, `skew` samples later than recorded, without unknown torques; read only."""
        kept = self._torques.setdefault(joint, {})
        if skew not in kept:
            if len(kept) > 3:
                kept.clear()
            kept[skew] = self.torque_delayed(joint, skew, 0.0)
            kept[skew].flags.writeable = False
        return kept[skew]

    def recorded(self, joint: int, skew: float) -> Array:
        """(M,) measured torque in the band, `skew` samples later than recorded."""
        return np.concatenate([p.torque_late(joint, skew) for p in self.pieces_of(joint)])

    def slope(self, joint: int) -> Array:
        """(M,) change of a joint's (0-based) torque in the band, all of it taken one sample later than recorded."""
        late = partial(self.torque_delayed, joint, time=0.0, whole=True)
        return self.once.one(("slope", joint), lambda: late(0.5) - late(-0.5))

    def feeds_back(self, joint: int) -> bool:
        """Whether a law makes a part of a joint's torque (0-based) of its motion."""
        return any(p.at_once.size and p.at_once[joint].any() for p in self.pieces_of(joint))

    @property
    def commanded(self) -> bool:
        """Whether every joint's torque follows from a command, to which it answers at once."""
        return all(self.feeds_back(i) for i in range(self.n))

    def torque_delayed(self, joint: int, skew: float, time: float, whole: bool = False) -> Array:
        """(M,) measured torque in the band, `skew` samples and `time` s late, without unknown torques; whole: also what
        of it follows the motion at once."""
        pieces = self.pieces_of(joint)
        return np.concatenate([p.equation(p.torque_late(joint, skew + time / p.dt, whole), joint) for p in pieces])

    def torque_per_gain(self, gain: Gain, skew: float, whole: bool = False) -> Array:
        """(M,) torque in the band of a drive per unit of an unknown gain, taken as `torque_delayed`; zero where the
        torque was recorded."""
        found = []
        for p in self.pieces_of(gain[0]):
            own = p.gains.get(gain)
            found.append(
                np.zeros(len(p.centres))
                if own is None
                else p.equation(p.made_late(own[0], own[1] * (not whole), skew), gain[0])
            )
        return np.concatenate(found)


def _windows(piece: Piece, samples: int) -> list[slice]:
    factor, count, kernels = piece.low_pass.factor, 8, 10
    length = max(samples // count, kernels * (2 * piece.low_pass.half + 1))
    starts = np.linspace(0, max(0, len(piece.t) - length), max(1, min(count, samples // length))) // factor * factor
    return [slice(int(s), int(s) + length) for s in starts]


# --- from recordings ---


def prepare(recordings: Sequence[Recording], band: Band, model: Model) -> Motion:
    """Positions smoothed and differentiated for every band, torques at rest marked unknown.

    Stretches shorter than the filters are dropped. Raises RecordingError if none is left.
    """
    n, names = len(recordings[0].q), ", ".join(str(r.path) for r in recordings)
    cutoffs = sorted({float(f) for f in band.cutoffs})
    views = tuple(_view(recordings, band, cutoff, narrowest=cutoffs[0], model=model) for cutoff in cutoffs)
    if not views[0].pieces:
        raise RecordingError(f"{names}: no stretch without gaps is long enough to be filtered; record some seconds")
    first = recordings[0]
    motion = Motion(band, views, np.zeros(n), quiet=np.zeros(n), cells=first.cells, units=first.units)
    driven = drives_of(recordings)
    motion = replace(motion, driven=driven, gains=tuple(_gains(driven)))
    motion = motion.resting(_standstill(motion, recordings), np.zeros(n))
    if not any(motion.moving(i).any() for i in range(n)):
        raise RecordingError(f"{names}: no joint moves faster than the noise of its encoder; record real motion")
    friction = np.maximum(_dry_friction(motion, model), 1e-300)
    with np.errstate(over="ignore"):  # noise over no friction
        quiet = band.torque_floor()[:n] / friction
    return motion.resting(motion.standstill, quiet)


def _gains(driven: Sequence[DrivenJoint | None]) -> Iterator[Gain]:
    """Gains that were identified. A torque's scale is told by other joints alone: of one joint none, and where nobody
    states any, of all joints but the first."""
    scales = [i for i, joint in enumerate(driven) if joint is not None and joint.command_gain in joint.identified]
    told = scales[1:] if len(scales) == len(driven) else scales
    for i, joint in ((i, joint) for i, joint in enumerate(driven) if joint is not None):
        for name in joint.identified:
            if name != joint.command_gain or i in told:
                yield i, name


def with_torques_of(motion: Motion, recordings: Sequence[Recording], model: Model) -> Motion:
    """The motion with other torques: those of recordings of the same motion."""
    cutoffs = sorted({float(f) for f in motion.band.cutoffs})
    others = [_view(recordings, motion.band, cutoff, narrowest=cutoffs[0], model=model) for cutoff in cutoffs]
    pairs = zip(motion.views, others, strict=True)
    views = [
        replace(
            v, pieces=tuple(replace(p, tau=q.tau, at_once=q.at_once) for p, q in zip(v.pieces, o.pieces, strict=True))
        )
        for v, o in pairs
    ]
    return replace(motion, views=tuple(views))


def _view(recordings: Sequence[Recording], band: Band, cutoff: float, narrowest: float, model: Model) -> BandView:
    """All stretches up to `cutoff` Hz that leave ten rows after the filters of the narrowest band."""
    pieces: list[Piece] = []
    common = measured_in_all(recordings)
    for number, recording in enumerate(recordings):
        clock = grid(recording)
        own, widest = (
            (differentiator(f, 1 / clock.period), low_pass(f, 1 / clock.period, model.library))
            for f in (cutoff, narrowest)
        )
        least = 2 * (widest[0].half + widest[1].half) + 10 * widest[1].factor
        for stretch in (s for s in clock.stretches if s.size > least):
            pieces.append(_piece(recording, number, clock, stretch=stretch, filters=own, band=band, common=common))
    return BandView(tuple(int(i) for i in np.flatnonzero(band.cutoffs == cutoff)), tuple(pieces))


def _piece(
    recording: Recording,
    number: int,
    clock: EvenGrid,
    stretch: Stretch,
    filters: tuple[Differentiator, LowPass],
    band: Band,
    common: Mapping[str, Mask],
) -> Piece:
    derive, low = filters
    dt, half = clock.period, derive.half
    q, qd, qdd = derive.rows(stretch.on_grid(recording.q))
    noise = [(float(density), 2) for density in band.position_density]
    rate_measured = []
    for i, measured_rate in enumerate([] if recording.qd is None else recording.qd):
        if np.isfinite(measured_rate).all() and (density := band.rate_noise(i)) is not None:
            noise[i] = density, 1
            rate_measured.append(i)
            qd[i], qdd[i], _ = derive(stretch.on_grid(measured_rate))
    warmth, measured = np.zeros_like(q), np.array([x is not None for x in recording.temperature])
    for i, temperature in enumerate(recording.temperature):
        if temperature is not None:
            beginning = np.median(temperature[:200])
            warmth[i] = stretch.on_grid(_smooth_temperature(temperature, dt))[half:-half] - beginning
    on_grid = stretch.held if band.held else stretch.on_grid
    gains, at_once = dict[Gain, Array](), np.zeros(recording.tau.shape)
    cut = np.zeros(recording.tau.shape)

    def parted(whole: Array, own: Array) -> Array:
        """(2, n, M) a torque and its part that is at once, (n, N) each: a command alone is held."""
        own_on_grid = stretch.on_grid(own)
        return np.ascontiguousarray(np.stack([on_grid(whole - own) + own_on_grid, own_on_grid])[..., half:-half])

    for i, joint in ((i, joint) for i, joint in enumerate(recording.driven) if joint is not None):
        cut[i], at_once[i] = joint.cut, joint.torque_at_once
        for name in joint.unknown:
            gains[i, name] = parted(joint.columns[name][None], joint.at_once[name][None])[:, 0]
    torque, at_once = parted(recording.tau, at_once)
    wiener = tuple(smoother(wiener_filter(row, 1 / dt, *of)) for row, of in zip(qdd, noise, strict=True))
    start = stretch.samples.start
    run = recording.run[start]
    first = int(np.argmax(recording.run == run))
    return Piece(
        number,
        int(run),
        dt,
        t=recording.t[start] - recording.t[first] + dt * (half + np.arange(q.shape[1])),
        q=q,
        qd=qd,
        qdd=qdd,
        qdd_denoised=np.array([smooth(row) for smooth, row in zip(wiener, qdd, strict=True)]),
        tau=torque,
        warmth=warmth,
        measured=measured,
        low_pass=low,
        derive=derive,
        wiener=wiener,
        rate_measured=tuple(rate_measured),
        sensors=read_sensors(recording, stretch, derive, common),
        places=None if stretch.places is None else stretch.places - half,
        began=_began(recording, first),
        torque=recording.torque or MOTOR_TORQUE,
        at_once=at_once if any(recording.driven) else at_once[:0],
        gains=gains,
        limited=on_grid(cut)[:, half:-half] > 0 if cut.any() else cut[:0, :0] > 0,
    )


def _began(recording: Recording, first: int) -> float:
    """s that all runs before the one with this first sample lasted."""
    runs, start = np.unique(recording.run, return_index=True)
    spans = [np.ptp(recording.t[recording.run == run]) + recording.dt for run in runs[start < first]]
    return float(sum(spans))


def _smooth_temperature(x: Array, dt: float) -> Array:
    width = min(len(x), max(1, round(1 / dt)) | 1)
    return moving_mean(np.pad(x, width // 2, mode="edge"), width)


def _standstill(motion: Motion, recordings: Sequence[Recording]) -> Array:
    """(n,) rates below which a joint is at rest, infinite for one that is held."""
    band, n = motion.band, motion.n
    smoothing = 2 * band.cutoffs
    noise = np.sqrt(band.position_density * (2 * np.pi) ** 2 * smoothing**3 / 3)
    for i, density in enumerate(band.rate_noise(k) for k in range(n)):
        noise[i] = noise[i] if density is None else np.sqrt(density * smoothing[i])
    top = np.array([max(np.abs(p.qd[i]).max() for p in motion.pieces_of(i)) for i in range(n)])
    standstill = np.maximum(CERTAIN * noise, STANDSTILL_OF_TOP_SPEED * top)
    held = np.ptp(np.concatenate([p.q for p in motion.pieces], axis=1), axis=1) < [
        HELD_RANGE[kind] for kind in recordings[0].types
    ]
    # A torque that never changes is no measurement of one: the joint is passive, or has no sensor.
    held |= unpowered(np.concatenate([r.tau for r in recordings], axis=1))
    return np.where(held, np.inf, standstill)


def _dry_friction(motion: Motion, model: Model) -> Array:
    """(n,) upper bound of every joint's dry friction, N m (N)."""
    found = []
    for i in range(motion.n):
        q, qd, qdd = (motion.rows(name, i) for name in ("q", "qd", "qdd"))
        # The rigid-body torque of the user's own model, where every recording has it.
        given = [(p.sensors.tau_rigid, p.centres) for p in motion.pieces_of(i)]
        own = [x[None, i, at] for x, at in given if x is not None]
        rigid = np.concatenate(own, axis=1) if motion.rigid_given else model.regressor(q, qd, qdd)[i]
        use, tau = motion.moving(i), motion.recorded(i, 0.0)
        found.append(dry_friction(q[i, use], qd[i, use], qdd[i, use], rigid=rigid[:, use], tau=tau[use]))
    return np.array(found)
