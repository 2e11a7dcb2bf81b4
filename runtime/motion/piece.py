"""One stretch of a recording in a band: smoothed motion and sensors at full rate, torque and regressors in the band."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, Mask
from runtime.motion.band import Band
from runtime.motion.clock import Stretch, interpolated
from runtime.motion.filters import Differentiator, LowPass, Smoother
from runtime.motion.rests import UnknownTorque, at_rest
from runtime.motion.settings import LITTLE, MOST_DELAY
from runtime.recordings.driven import DrivenJoint
from runtime.recordings.recording import Recording
from symbolic.model_file.arm import MOTOR_TORQUE, Torque

Gain = tuple[int, str]
"""A joint (0-based) and the name of a coefficient of its drive's law."""


@dataclass(frozen=True)
class Sensors:
    """Signals beside motor angles and torques over the samples of a piece; None where not measured.

    twist         (n, N) rad, motor less link, smoothed as the position is; NaN for a joint without link-side encoder
    twist_qdd     its second derivative
    tau_link      (n, N) N m at the joints' output; NaN for a joint without torque sensor
    tau_rigid     (n, N) N m, the rigid-body torque of the user's own model
    force         (2, N) N on the end-effector along base x and y, in space (6, N) N and N m along and about x, y and z;
                  a component that is not measured is zero
    q_desired     (n, N) rad (m), demanded; NaN for a joint without it
    """

    twist: Array | None = None
    twist_qdd: Array | None = None
    tau_link: Array | None = None
    tau_rigid: Array | None = None
    force: Array | None = None
    q_desired: Array | None = None

    def has(self, name: str, joint: int) -> bool:
        """Whether twist, tau_link or tau_rigid is measured at a joint (0-based)."""
        rows: Array | None = getattr(self, name)
        return rows is not None and not bool(np.isnan(rows[joint, 0]))

    def cut(self, window: slice) -> Sensors:
        """Within a window of the samples."""
        parts = {f.name: getattr(self, f.name) for f in fields(self)}
        return Sensors(**{k: None if x is None else np.ascontiguousarray(x[:, window]) for k, x in parts.items()})

    def with_errors(self, q: Array, qdd: Array) -> Sensors:
        """With errors q and qdd (n, N) added to the motors' angles and accelerations."""
        if self.twist is None or self.twist_qdd is None:
            return self
        return replace(self, twist=self.twist + q, twist_qdd=self.twist_qdd + qdd)

    def aligned(self, t: Array, q: Array, qdd: Array, late: Array) -> Sensors:
        """With the link-side encoders read `late` (n,) s sooner, 0 without one, at the instants t (N,) of the motors'
        angles q and accelerations qdd (n, N)."""
        if self.twist is None or self.twist_qdd is None or not late.any():
            return self
        from scipy.interpolate import make_interp_spline  # where it is used: it takes longer to load than a fit

        twist, curvature = self.twist.copy(), self.twist_qdd.copy()
        for i in np.flatnonzero(late):
            there = np.clip(t + late[i], t[0], t[-1])
            link = make_interp_spline(t, np.array([q[i] - twist[i], qdd[i] - curvature[i]]), k=3, axis=1)(there)
            twist[i], curvature[i] = q[i] - link[0], qdd[i] - link[1]
        return replace(self, twist=twist, twist_qdd=curvature)


def measured_in_all(recordings: Sequence[Recording]) -> dict[str, Mask]:
    """(n,) for each signal: whether all recordings have it, by joint (by component for the force)."""
    found = {}
    for name in ("q_link", "q_desired", "tau_link", "tau_rigid", "force"):
        rows = [getattr(r, name) for r in recordings]
        none = any(x is None for x in rows)
        found[name] = np.zeros(1, dtype=bool) if none else np.all([~np.isnan(x).all(axis=1) for x in rows], axis=0)
    return found


def read_sensors(recording: Recording, stretch: Stretch, derive: Differentiator, common: Mapping[str, Mask]) -> Sensors:
    """The signals that all recordings have (`measured_in_all`), over the samples of the smoothed position."""

    def raw(name: str, absent: float = np.nan) -> Array | None:
        if not common[name].any():
            return None
        rows = stretch.on_grid(getattr(recording, name))[:, derive.half : -derive.half]
        return np.where(common[name][:, None], rows, absent)

    found = Sensors(
        tau_link=raw("tau_link"),
        tau_rigid=raw("tau_rigid") if common["tau_rigid"].all() else None,
        force=raw("force", absent=0.0),
        q_desired=raw("q_desired"),
    )
    linked = common["q_link"]
    if recording.q_link is None or not linked.any():
        return found
    smooth, _, curved = derive.rows(stretch.on_grid((recording.q - recording.q_link)[linked]))
    twist = np.full((len(recording.q), smooth.shape[1]), np.nan)
    curvature = twist.copy()
    twist[linked], curvature[linked] = smooth, curved
    return replace(found, twist=twist, twist_qdd=curvature)


@dataclass(frozen=True)
class Piece:
    """One gap-free stretch of one recording, on the recording's even grid.

    recording       its number, from 0; run: the run's number in it
    dt              s, from sample to sample
    t               (N,) s
    q, qd, qdd, tau (n, N)
    qdd_denoised    (n, N) qdd through the Wiener filter of each joint, `wiener`: only where motion exceeds noise
    warmth          (n, N) K, since the beginning; measured: (n,) whether a temperature was
    rate_measured   joints (0-based) whose qd and qdd are those of a measured rate
    places          places of interpolated samples, in periods from the first; None where none were interpolated
    began           s from the recording's start to that of the run, the runs one after another
    torque          what tau is
    at_once         (n, N) the part of tau that a drive's law makes of the motion; empty where no law makes any
    gains           torque per unit of a drive's unknown gain, (2, N): all of it, and the part that is at once
    limited         (n, N) where a drive's limit makes its torque unknown; empty where none does
    without         elimination of each joint's unknown torque; empty where every torque is known
    """

    recording: int
    run: int
    dt: float
    t: Array
    q: Array
    qd: Array
    qdd: Array
    qdd_denoised: Array
    tau: Array
    warmth: Array
    measured: Mask
    low_pass: LowPass
    derive: Differentiator
    wiener: tuple[Smoother, ...]
    rate_measured: tuple[int, ...] = ()
    sensors: Sensors = field(default_factory=Sensors)
    places: Array | None = None
    began: float = 0.0
    torque: Torque = MOTOR_TORQUE
    at_once: Array = field(default_factory=lambda: np.zeros((0, 0)))
    gains: Mapping[Gain, Array] = field(default_factory=dict)
    limited: Mask = field(default_factory=lambda: np.zeros((0, 0), dtype=bool))
    without: tuple[UnknownTorque, ...] = ()

    def perturbed(self, band: Band, seed: int, driven: Sequence[DrivenJoint | None]) -> Piece:
        """The piece with another realisation of the encoders' errors: other offsets of the steps, other noise, which
        are in the torques, too, that drives make of their own angles.

        Errors of coarse steps are not white where the motion is slow, hence positions are rounded again.
        """
        rng = np.random.default_rng(seed)
        steps = zip(self.q, band.resolution, band.position_density, strict=True)
        error, rates, accelerations = self.derive.rows(
            np.array([self._reading_error(q, step, density, rng) for q, step, density in steps])
        )
        of_encoder = accelerations.copy()
        for i in self.rate_measured:
            of_rate = self._reading_error(self.qd[i], 0.0, band.rate_noise(i) or 0.0, rng)
            rates[i], accelerations[i], _ = self.derive(of_rate)
        q, qd, qdd = self.q + error, self.qd + rates, self.qdd + accelerations
        own = np.array([smooth(row) for smooth, row in zip(self.wiener, qdd, strict=True)])
        found = self._answering(driven, error, rates)
        sensors = self.sensors.with_errors(error, of_encoder)
        return replace(found, q=q, qd=qd, qdd=qdd, qdd_denoised=own, sensors=sensors)

    def _answering(self, driven: Sequence[DrivenJoint | None], error: Array, rates: Array) -> Piece:
        """With what drives make of errors (n, N) of angles and rates."""
        tau, at_once, gains = self.tau.copy(), self.at_once.copy(), dict(self.gains)
        for i, joint in enumerate(driven):
            if joint is None:
                continue
            own_rate = rates[i] if i in self.rate_measured or not joint.rate_recorded else 0 * rates[i]
            parts = joint.answer(error[i], own_rate, self.dt)
            gains |= {gain: x + parts[gain[1]] for gain, x in self.gains.items() if gain[0] == i}
            answer = joint.summed(parts)
            tau[i] += answer
            if at_once.size:
                at_once[i] += answer
        return replace(self, tau=tau, at_once=at_once, gains=gains)

    def _reading_error(self, q: Array, step: float, density: float, rng: np.random.Generator) -> Array:
        """(N + 2 half,) errors of another reading of q (N,), made at the places of the samples and interpolated as
        these were; step: the encoder's, density: one-sided, of all its noise."""
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
        """Within a window of its samples."""

        def part(x: Array) -> Array:
            return np.ascontiguousarray(x[:, window])

        places = self.places
        if places is not None:
            # Those under the kernels, and ten more, from which the ends were interpolated.
            reach = self.derive.half + 10
            first, last = np.searchsorted(places, (window.start - reach, window.stop + reach))
            places = places[first:last] - window.start
        return replace(
            self,
            t=self.t[window],
            q=part(self.q),
            qd=part(self.qd),
            qdd=part(self.qdd),
            qdd_denoised=part(self.qdd_denoised),
            tau=part(self.tau),
            at_once=part(self.at_once),
            limited=self.limited[:, window],
            gains={gain: part(x) for gain, x in self.gains.items()},
            warmth=part(self.warmth),
            sensors=self.sensors.cut(window),
            places=places,
            without=tuple(each.cut(window, self.low_pass) for each in self.without),
        )

    @cached_property
    def centres(self) -> NDArray[np.intp]:
        """(M,) samples at the centres of the rows."""
        return self.low_pass.centres(len(self.t))

    def in_band(self, x: Array) -> Array:
        """x (..., N) -> (..., M)."""
        return self.low_pass(x)

    def unknown(self, joint: int) -> UnknownTorque:
        """The elimination of a joint's (0-based) unknown torque."""
        return self.without[joint] if self.without else UnknownTorque.nowhere(self.low_pass, len(self.t))

    def equation(self, x: Array, joint: int) -> Array:
        """In-band rows x (..., M) of a joint (0-based) with its unknown torque eliminated."""
        return self.without[joint](x) if self.without else x

    def equations(self, x: Array, joints: Collection[int]) -> dict[int, Array]:
        """x (n, ..., N) -> (..., M): in-band rows of some joints (0-based), as `equation`."""
        return {i: self.equation(self.low_pass(x[i]), i) for i in joints}

    def equations_in_blocks(self, make: Callable[[slice], Array], joints: Collection[int]) -> dict[int, Array]:
        """As `equations`, of signals (n, ..., N') that `make` computes for some samples at a time.

        500 rows at a time: their samples fit into the processor's caches, and wide signals never fill the memory.
        """
        band, count, block = self.low_pass, len(self.centres), 500
        parts: dict[int, list[Array]] = {i: [] for i in joints}
        for first in range(0, count, block):
            last = min(first + block, count) - 1
            x = make(slice(first * band.factor, last * band.factor + 2 * band.half + 1))
            for i, rows in parts.items():
                rows.append(band(x[i]))
        return {i: self.equation(np.concatenate(rows, axis=-1), i) for i, rows in parts.items()}

    def delayed(self, x: Array, delay: float) -> Array:
        """In-band x (N,), `delay` samples late; whole samples for which the filter has no room by holding the ends."""
        whole = round(delay) if abs(delay) > MOST_DELAY - 0.5 else 0
        if whole:
            reach = min(abs(whole), len(x))
            first = reach - max(-reach, min(whole, reach))
            x = np.ascontiguousarray(np.pad(x, reach, mode="edge")[first : first + len(x)])
        return self.low_pass(x, delay - whole)

    def torque_late(self, joint: int, late: float, whole: bool = False) -> Array:
        """(M,) the torque of a joint (0-based) in the band, `late` samples late; whole: also what is at once."""
        at_once = self.at_once[joint] if self.at_once.size and not whole else np.zeros(0)
        return self.made_late(self.tau[joint], at_once, late)

    def made_late(self, x: Array, at_once: Array, late: float) -> Array:
        """In-band torque x (N,), `late` samples late but for the part at_once (N,), zero or empty where there is none.

        What is late beside such a part is a command, and held for a sample, here by two points of Gauss.
        """
        if not at_once.any():
            return self.delayed(x, late)
        command, apart = x - at_once, 1 / np.sqrt(12)
        held = (self.delayed(command, late - apart) + self.delayed(command, late + apart)) / 2
        return held + self.low_pass(at_once)

    def noise_left(self, joint: int) -> Array:
        """(M,) part of the variance of white torque noise that the elimination leaves in a joint's (0-based) rows.

        Rows are closer than their band needs, hence an eliminated combination held more noise than one row.
        """
        denser = 1 / (2 * self.low_pass.cutoff * self.dt * self.low_pass.factor)
        return np.maximum(1 - denser * (1 - self.unknown(joint).left), 0.0)

    def resting(self, standstill: Array, quiet: Array, joints: Collection[int]) -> Piece:
        """With the torques of some joints (0-based) unknown at rates below `standstill` (n,); quiet (n,): torque noise
        in the band over dry friction, 0 where that is not known."""
        rests = np.zeros(self.q.shape, dtype=bool)
        for i in joints:
            rests[i] = at_rest(self.qd[i], self.dt, self.low_pass.cutoff, standstill[i])
        if self.limited.size:
            rests |= self.limited
        whole = replace(self, without=()).unknown_at(rests, quiet)
        # A joint that is stopped again and again would have no rows left.
        clear = (quiet > 0) & (standstill < LITTLE * np.max(np.abs(self.qd), axis=1, initial=0.0))
        clear &= ~self.limited.any(axis=1) if self.limited.size else True
        found = zip(whole.without, clear, strict=True)
        return replace(self, without=tuple(x.relaxed(self.low_pass) if c and x.too_much else x for x, c in found))

    def unknown_at(self, samples: Mask, quiet: Array) -> Piece:
        """With the joints' torques unknown at more samples (n, N)."""
        there = samples | np.array([self.unknown(i).samples for i in range(len(samples))])
        found = (UnknownTorque.of(self.low_pass, x, level) for x, level in zip(there, quiet, strict=True))
        return replace(self, without=tuple(found))
