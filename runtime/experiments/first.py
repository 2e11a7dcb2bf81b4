"""The first motion of an arm: from it the base parameters, rotors and friction of all joints are told best.

A Fourier motion of most information comes first and is repeated, so that repeats give the floor. A ladder of constant
speeds with reversals tells friction, holds tell gravity, slow passes tell ripple. Every part is made smaller and slower
until hardly any possible arm leaves its limits.
Source: Swevers et al. 1997 (repeats, a second motion for validation).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from runtime.arrays import Array
from runtime.documents.parts import IterationsEntry
from runtime.experiments.excitation import ExcitationSearch, Room
from runtime.experiments.fourier import FourierMotion, harmonics_of
from runtime.experiments.information import ArmInformation
from runtime.experiments.pieces import Envelope, legs
from runtime.experiments.settings import (
    CHECK_RATE,
    CORNER_S,
    FASTEST_HARMONIC,
    FOURIER_PART,
    HELD_FOR,
    LADDER,
    LEAST_LADDER,
    LEAST_TIMES,
    LEG,
    LONGEST_PASS,
    PASS_CORNER,
    PAUSE,
    PERIOD,
    SAMPLES_A_PERIOD,
    SLOWER,
    SLOWINGS,
    SMALLER,
    SMALLER_BY,
    SMALLEST,
    STARTS,
    STATIONS,
    TRANSFER_LEAST,
)
from runtime.simulation.settings import RATE
from runtime.simulation.simulate import SimulationError

Tell = Callable[[str], None]


@dataclass(frozen=True)
class SafeLimits:
    """What no possible arm may leave along a motion.

    torque      (n,) N m (N)        tip_speed   m/s
    envelopes   of the joints        room        keeps the arm clear of itself and its surroundings
    """

    information: ArmInformation
    envelopes: Sequence[Envelope]
    torque: Array
    tip_speed: float
    room: Room

    def worst(self, path: Array) -> tuple[float, str]:
        """Of a motion (n, N) at 1 kHz: the largest ratio to a limit, and of what in words."""
        q, qd, qdd = (part[:, :: round(RATE / CHECK_RATE)] for part in derivatives(path))
        found = [(float(ratio.max()), f"{what} of joint {i + 1}") for what, i, ratio in self._ratios(q, qd, qdd)]
        clear = float(self.room.least(q).min())
        if clear < 0:
            found.append((np.inf, "a distance"))
        return max(found)

    def is_free(self, path: Array) -> bool:
        """Whether a motion (n, N) at 1 kHz keeps clear of itself and its surroundings, and its tip is slow enough."""
        q, qd, qdd = (part[:, :: round(RATE / CHECK_RATE)] for part in derivatives(path))
        if float(self.room.least(q).min()) < 0:
            return False
        return float(self.largest(q, qd, qdd)[1].max()) <= self.tip_speed

    def _ratios(self, q: Array, qd: Array, qdd: Array) -> Iterator[tuple[str, int, Array]]:
        torque, tip_speed = self.largest(q, qd, qdd)
        for i, e in enumerate(self.envelopes):
            yield "the range", i, np.abs(q[i] - e.middle) / e.reach
            yield "the speed", i, np.abs(qd[i]) / e.speed
            yield "the acceleration", i, np.abs(qdd[i]) / e.acceleration
            yield "the torque", i, torque[i] / self.torque[i]
        yield "the tip's speed, at the end", len(self.envelopes) - 1, tip_speed / self.tip_speed

    def largest(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
        """(n, N) torque that hardly any possible arm exceeds, and (N,) m/s, the tip's speed."""
        size, N = self.information.count, q.shape[1]
        torque, speed = np.empty_like(q), np.empty(N)
        for first in range(0, N, size):
            # The last samples fill the batch.
            at = np.minimum(np.arange(first, first + size), N - 1)
            made = self.information.outputs(q[:, at], qd[:, at], qdd[:, at])
            torque[:, at] = self.information.largest_torque(made)[0].T
            speed[at] = np.sqrt(made.tip_speed2)
        return torque, speed


def derivatives(path: Array) -> tuple[Array, Array, Array]:
    """q, qd, qdd (n, N) of positions at 1 kHz, by central differences."""
    rate = np.gradient(path, 1 / RATE, axis=1)
    return path, rate, np.gradient(rate, 1 / RATE, axis=1)


@dataclass(frozen=True)
class FirstMotion:
    """A motion (n, N) at 1 kHz from rest at `start` and back, and what it consists of.

    without_repeats   (n, N) the same with its Fourier part once
    parts   names and lengths in s      nats   information of its Fourier part
    search   how far the search for that part came
    """

    path: Array
    without_repeats: Array
    parts: tuple[tuple[str, float], ...]
    nats: float
    start: Array
    search: IterationsEntry

    @property
    def seconds(self) -> float:
        """Its length."""
        return self.path.shape[1] / RATE


@dataclass(frozen=True)
class MotionPlanner:
    """Composes motions for one arm.

    moving    joints (0-based) that move; the others stay in the middle of their ranges
    start     (n,) rad (m), where the arm is before and after
    seconds   about the length of the whole
    """

    limits: SafeLimits
    moving: Sequence[int]
    start: Array
    seconds: float

    @property
    def envelopes(self) -> Sequence[Envelope]:
        """Of all joints."""
        return self.limits.envelopes

    @cached_property
    def middle(self) -> Array:
        """(n,) the pose about which the arm moves."""
        return np.array([e.middle for e in self.envelopes])

    def motion(
        self, seed: int, tell: Tell, more: Sequence[tuple[str, Array]] = (), budget: int | None = None
    ) -> FirstMotion:
        """The first motion; another seed gives another one. more: names and positions (n, N) of parts besides; budget:
        iterations of the search; None: all that it is made for. Raises SimulationError where nothing is safe."""
        rng = np.random.default_rng(seed)
        tell("searching the Fourier motion of most information")
        series, x, nats, search = self._fourier(rng, budget)
        tell("fitting a ladder of speeds, holds and slow passes into the limits")
        others = [*more, *self._others(rng)]
        once = series.shape(x, np.arange(round(series.period * RATE)) / RATE)[0]
        without_repeats = self._joined([once, *(part for _, part in others)])
        left = self.seconds - without_repeats.shape[1] / RATE
        times = max(LEAST_TIMES, 1 + round(left / series.period))
        parts = [(f"a Fourier motion of {series.period:g} s, {times} times", np.tile(once, times)), *others]
        path = self._joined([part for _, part in parts])
        lengths = tuple((name, part.shape[1] / RATE) for name, part in parts)
        return FirstMotion(path, without_repeats, lengths, nats, self.start, search)

    def _fourier(
        self, rng: np.random.Generator, budget: int | None
    ) -> tuple[FourierMotion, Array, float, IterationsEntry]:
        period = min(PERIOD, FOURIER_PART * self.seconds / LEAST_TIMES)
        series = FourierMotion(self.envelopes, self.moving, period, harmonics_of(period, FASTEST_HARMONIC))
        limits, count = self.limits, SAMPLES_A_PERIOD
        search = ExcitationSearch(
            replace(limits.information, count=count),
            series,
            limits.room,
            np.arange(count) * period / count,
            FOURIER_PART * self.seconds,
            torque=limits.torque,
            tip_speed=limits.tip_speed,
        )
        x, came = search.best([series.random(rng) for _ in range(STARTS)], budget)
        # Between the samples of the search, too.
        t = np.arange(round(period * RATE)) / RATE
        size = 1.0
        while (worst := limits.worst(np.tile(series.shape(size * x, t)[0], 2)))[0] > 1.0:
            size *= SMALLER_BY
            if size < SMALLEST:
                raise SimulationError(
                    f"no safe motion about the middle of the ranges was found: even a small one has {worst[1]} at "
                    f"{worst[0]:.3g} of what is allowed; start from another pose, or narrow the ranges"
                )
        return series, size * x, search.value(size * x), came

    def _others(self, rng: np.random.Generator) -> list[tuple[str, Array]]:
        """Names and positions (n, N) at 1 kHz of what stands beside the Fourier motion, as far as there is time."""
        slowest, fastest, most = LADDER
        orders = [rng.permutation(np.geomspace(slowest, fastest, k)) for k in range(most, LEAST_LADDER - 1, -1)]
        poses = rng.uniform(-1, 1, (STATIONS, len(self.envelopes)))
        left, found = (1.0 - FOURIER_PART) * self.seconds, []
        coming: list[tuple[str, list[Callable[[float, float], Array]]]] = [
            ("a ladder of constant speeds with reversals", [partial(self._ladder, order) for order in orders]),
            ("holds", [partial(self._holds, poses)]),
            ("slow passes", [lambda size, pace: self._passes(min(left, LONGEST_PASS), size, pace)]),
        ]
        for name, ways in coming:
            for made in map(self._fitted, ways):
                if made is not None and made.shape[1] / RATE <= left + HELD_FOR:
                    found.append((name, made))
                    left -= made.shape[1] / RATE
                    break
        return found

    def _ladder(self, order: Array, size: float, pace: float) -> Array:
        """Every joint at its own constant speeds in both directions, in its own order."""
        rows = {}
        for i in self.moving:
            e = self.envelopes[i]
            own = []
            for speed in pace * e.speed * np.roll(order, 3 * i):
                soft = max(2 * speed / (pace * e.acceleration), CORNER_S)
                far = min(size * e.reach, (LEG + soft) * speed)
                own.append(legs([far, -far] if i % 2 else [-far, far], speed, soft))
            rows[i] = np.concatenate(own)
        return self._together(rows)

    def _holds(self, poses: Array, size: float, pace: float) -> Array:
        """Poses, (K, n) parts of the ranges, at which all joints rest for a moment."""
        reach = size * np.array([e.reach if i in self.moving else 0.0 for i, e in enumerate(self.envelopes)])
        at, rows = self.middle, []
        for pose in (*(self.middle + reach * poses), self.middle):
            rows += [self._transfer(at, pose, pace), np.repeat(pose[:, None], round(HELD_FOR * RATE), axis=1)]
            at = pose
        return np.concatenate(rows, axis=1)

    def _passes(self, seconds: float, size: float, pace: float) -> Array:
        """Over a part of the range and back, so slowly that it lasts so many seconds."""
        rows = {}
        for i in self.moving:
            e = self.envelopes[i]
            far = size * 0.7 * e.reach
            rows[i] = legs([far, -far], min(4 * far / max(seconds, 1.0), pace * e.speed), PASS_CORNER)
        return self._together(rows)

    def _together(self, rows: dict[int, Array]) -> Array:
        """The joints' displacements from the middle at the same time; who is done rests."""
        path = np.repeat(self.middle[:, None], max(len(row) for row in rows.values()), axis=1)
        for i, row in rows.items():
            path[i, : len(row)] += row
            path[i, len(row) :] += row[-1]
        return path

    def _fitted(self, make: Callable[[float, float], Array]) -> Array | None:
        """A part as large and then as fast as the limits allow; None if nothing of it is."""
        for size in SMALLER:
            for k in range(0, SLOWINGS, 2):
                path = make(size, SLOWER**k)
                if self.limits.worst(path)[0] <= 1.0:
                    return path
        return None

    def _transfer(self, start: Array, end: Array, pace: float = 1.0) -> Array:
        """(n, N) from rest to rest, straight in the joints, by the polynomial of least jerk."""
        far = np.abs(end - start)
        speed, acceleration = (np.array([getattr(e, k) for e in self.envelopes]) for k in ("speed", "acceleration"))
        fastest = max(float(np.max(1.9 * far / speed)), float(np.sqrt(np.max(5.8 * far / acceleration))))
        seconds = max(fastest, TRANSFER_LEAST)
        u = np.linspace(0, 1, round(seconds / pace * RATE))
        return start[:, None] + (end - start)[:, None] * u**3 * (10 - 15 * u + 6 * u**2)

    def _joined(self, parts: Sequence[Array]) -> Array:
        """The parts one after another from the start pose and back to it, with pauses and slow ways between them."""
        at, rows = self.start, [_rest(self.start)]
        for part in parts:
            rows += [self._way(at, part[:, 0]), _rest(part[:, 0]), part, _rest(part[:, -1])]
            at = part[:, -1]
        return np.concatenate([*rows, self._way(at, self.start), _rest(self.start)], axis=1)

    def _way(self, start: Array, end: Array) -> Array:
        """From rest to rest, as fast as the limits allow and at most at half their pace. Raises SimulationError."""
        for k in range(SLOWINGS):
            path = self._transfer(start, end, 0.5 * SLOWER**k)
            if (worst := self.limits.worst(path))[0] <= 1.0:
                return path
        raise SimulationError(
            f"no safe way was found from one part of the motion to the next: {worst[1]} would be {worst[0]:.3g} of "
            "what is allowed; start from another pose, or narrow the ranges"
        )


def _rest(pose: Array) -> Array:
    return np.repeat(pose[:, None], round(PAUSE * RATE), axis=1)
