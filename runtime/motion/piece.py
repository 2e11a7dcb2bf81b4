"""One stretch of a recording as a band shows it: smoothed motion at full rate, torque and regressors in the band."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from runtime.motion import turns
from runtime.motion.band import Band
from runtime.motion.clock import interpolated
from runtime.motion.filters import Differentiator, LowPass, Smoother
from runtime.motion.sensors import NOTHING, Sensors
from runtime.motion.settings import BLOCK_ROWS, CLEAR_RATE, MOST_DELAY, SPLINE_DEGREE, UNTOUCHED
from runtime.motion.unknown_torque import UnknownTorque

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

    def equations(self, x: Array, joints: Collection[int]) -> dict[int, Array]:
        """x (n, ..., N) -> (..., M): in-band rows of some joints (0-based), as `equation`."""
        return {i: self.equation(self.low_pass(x[i]), i) for i in joints}

    def equations_in_blocks(self, make: Callable[[slice], Array], joints: Collection[int]) -> dict[int, Array]:
        """As `equations`, of what `make` gives for so many samples at a time, (n, ..., N'): what is wide at full rate
        need not stand there whole."""
        band, count = self.low_pass, len(self.centres)
        parts: dict[int, list[Array]] = {i: [] for i in joints}
        for first in range(0, count, BLOCK_ROWS):
            last = min(first + BLOCK_ROWS, count) - 1
            x = make(slice(first * band.factor, last * band.factor + 2 * band.half + 1))
            for i, rows in parts.items():
                rows.append(band(x[i]))
        return {i: self.equation(np.concatenate(rows, axis=-1), i) for i, rows in parts.items()}

    def late(self, x: Array, delay: float) -> Array:
        """In-band x (N,), `delay` samples late; by whole samples what the filter has no room for, the ends held."""
        whole = round(delay) if abs(delay) > MOST_DELAY - 0.5 else 0
        if whole:
            reach = min(abs(whole), len(x))
            first = reach - max(-reach, min(whole, reach))
            x = np.ascontiguousarray(np.pad(x, reach, mode="edge")[first : first + len(x)])
        return self.low_pass(x, delay - whole)

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

    def resting(self, standstill: Array, quiet: Array, joints: Collection[int]) -> Piece:
        """The piece with some joints (0-based) at rest below these rates (n,); quiet (n,): torque noise in the band
        over what dry friction may come to there, 0 where that is not known."""
        rests = np.zeros(self.q.shape, dtype=bool)
        for i in joints:
            rests[i] = turns.at_rest(self.qd[i], self.dt, self.low_pass.cutoff, standstill[i])
        whole = replace(self, without=()).unknown_at(rests, quiet)
        # A joint that is stopped again and again would have no rows left.
        clear = (quiet > 0) & (standstill < CLEAR_RATE * np.max(np.abs(self.qd), axis=1, initial=0.0))
        found = zip(whole.without, clear, strict=True)
        return replace(self, without=tuple(x.resolved(self.low_pass) if c and x.too_much else x for x, c in found))

    def unknown_at(self, samples: Mask, quiet: Array) -> Piece:
        """The piece with the joints' torques unknown at more samples (n, N)."""
        there = samples | np.array([each.samples for each in self.without]) if self.without else samples
        found = (UnknownTorque.of(self.low_pass, x, level) for x, level in zip(there, quiet, strict=True))
        return replace(self, without=tuple(found))
