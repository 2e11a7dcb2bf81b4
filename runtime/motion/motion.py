"""Recordings as the model sees them: of every joint, the pieces as the band of its own equation shows them."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from runtime.motion.band import Band
from runtime.motion.piece import Piece
from runtime.motion.rates import MeasuredRate
from runtime.motion.settings import EXCERPT_WINDOW_KERNELS, EXCERPT_WINDOWS, KEPT_SKEWS

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
