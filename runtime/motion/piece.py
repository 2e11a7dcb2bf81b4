"""A stretch of a recording without gaps: its motion at full rate, and its equations inside the band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.model.loader import Library
from runtime.motion import turns
from runtime.motion.band import Band
from runtime.motion.clock import interpolated
from runtime.motion.filters import Differentiator, LowPass, Smoother
from runtime.motion.sensors import NOTHING, Sensors
from runtime.motion.settings import CLEAR, MOST_AMPLIFIED, MOST_DELAY, SPLINE_DEGREE

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Piece:
    """One gap-free stretch of one recording, on the recording's even grid.

    t (N,) s; q, qd, qdd, tau (n, N); slow (n, N) qdd where the motion stands out of the encoder's noise;
    warmth (n, N) K; measured (n,) whether a temperature was; places: in periods from the first, where the samples
    were taken from which it was interpolated; None where they are those of the grid; rate_measured: joints
    (0-based) whose qd and qdd are those of a measured rate; known (n, N) how much a sample counts in a joint's
    equations (`turns.known`); began: s from the recording's start to that of the run, the runs one after another.
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
    known: Array
    low_pass: LowPass
    derive: Differentiator
    excited: tuple[Smoother, ...]
    rate_measured: tuple[int, ...] = ()
    sensors: Sensors = NOTHING
    places: Array | None = None
    began: float = 0.0

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
            known=part(self.known),
            sensors=self.sensors.cut(window),
            places=self._places_in(window),
        )

    def _places_in(self, window: slice) -> Array | None:
        """The samples that the kernels see from a window, and some beyond, from which its ends were interpolated."""
        if self.places is None:
            return None
        reach = self.derive.half + 2 * SPLINE_DEGREE
        first, last = np.searchsorted(self.places, (window.start - reach, window.stop + reach))
        return self.places[first:last] - window.start

    def resting_below(self, standstill: Array) -> Piece:
        """The piece with its joints at rest below these rates (n,)."""
        rows = zip(self.qd, standstill, strict=True)
        known = np.array([turns.known(qd, self.dt, self.low_pass.cutoff, rest) for qd, rest in rows])
        return replace(self, known=known)

    @cached_property
    def centres(self) -> NDArray[np.intp]:
        return self.low_pass.centres(len(self.t))

    def in_band(self, x: Array, joint: int) -> Array:
        """x (..., N) -> (..., M): means in the band, of samples at which friction of the joint (0-based) is known."""
        return self.low_pass(x * self.known[joint]) / self._weights[0][joint]

    def columns(
        self,
        library: Library,
        effect: str,
        signals: Mapping[str, ArrayLike],
        choices: Sequence[Mapping[str, float]],
        joint: int,
    ) -> Array:
        """(S, 1 + k, M) of an effect at a joint (0-based) for many choices of its shape, as `in_band`.

        library   the effect's own: guesses are tried on a motion that was prepared without them
        """
        rows = self.low_pass.columns(library, effect, signals, choices, self.dt, self.known[joint])
        return rows / self._weights[0][joint]

    def in_band_each(self, x: Array) -> Array:
        """x (n, ..., N) -> (n, ..., M): as `in_band`, of each joint its own."""
        return np.array([self.in_band(row, i) for i, row in enumerate(x)])

    def torque(self, joint: int, delay: float) -> Array:
        """(M,) measured torque of a joint (0-based) in the band, `delay` samples late; by whole samples what the filter
        has no room for, the ends held."""
        x, known = self.tau[joint], self.known[joint]
        whole = round(delay) if abs(delay) > MOST_DELAY - 0.5 else 0
        if whole:
            reach = min(abs(whole), len(x))
            padded = np.pad(x, reach, mode="edge")
            x = np.ascontiguousarray(padded[reach - whole : reach - whole + len(x)])
        rest = delay - whole
        if rest:
            # The filter delays the product; what counts is when the torque acts, and not when it was recorded.
            at = np.arange(len(x))
            known = np.interp(at + rest, at, known)
        return self.low_pass(x * known, rest) / self._weights[0][joint]

    def moving(self, joint: int) -> Mask:
        """(M,) rows of a joint (0-based) that hold enough samples at which its friction is known."""
        return self._weights[1][joint]

    def clear(self, joint: int) -> Mask:
        """(M,) rows that hold next to all samples around them. The others hold noise from above the band, too, that a
        standstill lets in."""
        clear: Mask = np.abs(self._weights[0][joint] - 1) < CLEAR
        return clear & self._weights[1][joint]

    @cached_property
    def _weights(self) -> tuple[Array, Mask]:
        """(n, M) sum of the filter's kernel over samples that count, and whether it is enough for the noise of what is
        left not to be far above that of other rows; where it is not, the sum is 1."""
        total, noise = self.low_pass(self.known), self.low_pass.noise(self.known)
        counts = (total > 0) & (noise < MOST_AMPLIFIED * total)
        return np.where(counts, total, 1.0), counts
