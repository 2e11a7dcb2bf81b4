"""The Fourier motion that tells most of all unknown parameters within the limits of an uncertain arm.

What is maximised is smooth: the information less a penalty for what lies beyond a limit, by quasi-Newton steps from
several random motions. What is left beyond a limit at the end is removed by making the motion smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
from scipy.optimize import minimize

from runtime.arrays import Array
from runtime.documents.parts import IterationsEntry, SearchEnd
from runtime.experiments.fourier import FourierMotion
from runtime.experiments.information import ArmInformation, InstantOutputs
from runtime.experiments.margins import Nearest
from runtime.experiments.settings import PENALTIES, SMALLER_BY, SMALLEST, SOFT, STEPS_A_PENALTY
from runtime.progress import is_late, of_each, one_thread


class Room(Protocol):
    """What keeps an arm clear of itself and of what stands around it."""

    def least(self, q: Array) -> Array:
        """(N,) m; smallest distance less its margin along q (n, N)."""

    def worst(self, q: Array) -> Nearest:
        """Where q comes closest."""

    def penalty(self, q: Array, soft: float) -> tuple[float, Array]:
        """A penalty for distances below the margins and `soft` m above, and its gradient (n, N)."""


class NoRoom:
    """Nothing is in the way."""

    def least(self, q: Array) -> Array:
        """(N,) m; infinite."""
        return np.full(q.shape[1], np.inf)

    def worst(self, q: Array) -> Nearest:
        """Infinitely far."""
        return Nearest(float(self.least(q).min()), "nothing", 0)

    def penalty(self, q: Array, soft: float) -> tuple[float, Array]:  # noqa: ARG002
        """None."""
        return 0.0, np.zeros_like(q)


@dataclass(frozen=True)
class Climb:
    """A search from one start: the unknowns (n, k) where it ended, its iterations, and why it ended."""

    x: Array
    iterations: int
    ended: SearchEnd


def _until_late(_: Array) -> None:
    if is_late():
        raise StopIteration


@dataclass(frozen=True)
class ExcitationSearch:
    """Of Fourier motions of one arm.

    t           (N,) s; samples of one period
    seconds     length of the whole recording, for the information
    torque      (n,) largest torques, N m (N)     tip_speed   m/s
    """

    information: ArmInformation
    motion: FourierMotion
    room: Room
    t: Array
    seconds: float
    torque: Array
    tip_speed: float

    def value(self, x: Array) -> float:
        """Information of the motion in nats."""
        made = self.information.outputs(*self.motion.shape(x, self.t))
        return self.information.nats(made, self.seconds)[0]

    def beyond(self, x: Array) -> float:
        """The largest ratio to a limit along the motion; at most 1 if it keeps to all of them."""
        q, qd, qdd = self.motion.shape(x, self.t)
        made = self.information.outputs(q, qd, qdd)
        torque = self.information.largest_torque(made)[0].T / self._limits[3]
        ratios = [np.abs(part).max() for part in (*self._relative(q, qd, qdd), torque)]
        clear = float(self.room.least(q).min())
        return max(*ratios, float(np.sqrt(made.tip_speed2.max())) / self.tip_speed, np.inf if clear < 0 else 0.0)

    def best(self, starts: Sequence[Array], budget: int | None = None) -> tuple[Array, IterationsEntry]:
        """The unknowns (n, k) of the best motion from any of these starts that keeps to all limits; budget: iterations,
        of which each start gets the same share; None: as many as the search is made for."""
        budget = len(starts) * len(PENALTIES) * STEPS_A_PENALTY if budget is None else budget
        found = of_each("motions", partial(self._ended, budget // len(starts)), starts)
        made = sum(climb.iterations for _, climb in found)
        best = max(found, key=lambda pair: pair[0])[1].x
        return best, IterationsEntry.of(made, budget, [climb.ended for _, climb in found])

    def _ended(self, most: int, start: Array) -> tuple[float, Climb]:
        with one_thread():
            climb = self._climbed(start, most)
            x = self._within_limits(climb.x)
            return self.value(x), replace(climb, x=x)

    def _climbed(self, x: Array, most: int) -> Climb:
        """With each penalty in turn, which has an even share of the iterations that are left."""
        made, ends = 0, set[SearchEnd]()
        for k, weight in enumerate(PENALTIES):
            steps = min(STEPS_A_PENALTY, (most - made) // (len(PENALTIES) - k))
            if not steps or is_late():
                ends.add("budget" if not steps else "time")
                continue
            found = minimize(
                self._loss,
                x.ravel(),
                args=(weight,),
                jac=True,
                method="L-BFGS-B",
                callback=_until_late,
                options={"maxiter": steps},
            )
            x, made = found.x.reshape(x.shape), made + found.nit
            if found.nit >= steps < STEPS_A_PENALTY:
                ends.add("budget")
            elif is_late():
                ends.add("time")
        return Climb(x, made, IterationsEntry.of(made, most, ends).ended)

    def _within_limits(self, x: Array) -> Array:
        size = 1.0
        while self.beyond(x * size) > 1.0 and size > SMALLEST:
            size *= SMALLER_BY
        return x * size

    @property
    def _limits(self) -> tuple[Array, Array, Array, Array]:
        """(n, 1) each: of position about the middle, rate, acceleration, torque."""
        e = self.motion.envelopes
        columns = np.array([[j.reach, j.speed, j.acceleration] for j in e]).T[:, :, None]
        return columns[0], columns[1], columns[2], self.torque[:, None]

    def _relative(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
        middle = np.array([[e.middle] for e in self.motion.envelopes])
        reach, speed, acceleration, _ = self._limits
        return (q - middle) / reach, qd / speed, qdd / acceleration

    def _loss(self, flat: Array, weight: float) -> tuple[float, Array]:
        """Less information, more penalty; with the gradient by the unknowns."""
        x = flat.reshape(len(self.motion.envelopes), -1)
        q, qd, qdd = self.motion.shape(x, self.t)
        info, N = self.information, len(self.t)
        made = info.outputs(q, qd, qdd)
        nats, by_Y, by_E = info.nats(made, self.seconds)
        weight_each = weight / N
        # Torque: of the likeliest arm, and of possible ones.
        torque, shares_Y, shares_E = info.largest_torque(made)
        limit = self._limits[3].T
        over = np.maximum(torque / limit - 1.0, 0.0)
        push = 2 * weight_each * over / limit
        speed2 = np.maximum(made.tip_speed2 / self.tip_speed**2 - 1.0, 0.0)
        loss = -nats + weight_each * float((over**2).sum() + (speed2**2).sum())
        by = InstantOutputs(
            Y=(push[:, :, None] * shares_Y) @ info.arms.spread.T - by_Y,
            E=push[:, :, None] * shares_E * info.spreads - by_E,
            tau=push * np.sign(made.tau),
            tip_speed2=2 * weight_each * speed2 / self.tip_speed**2,
        )
        slopes = list(info.slopes(q, qd, qdd, by))
        for k, (part, own) in enumerate(zip(self._relative(q, qd, qdd), self._limits, strict=False)):
            far = np.maximum(np.abs(part) - 1.0, 0.0)
            loss += weight_each * float((far**2).sum())
            slopes[k] = slopes[k] + 2 * weight_each * far * np.sign(part) / own
        near, by_q = self.room.penalty(q, SOFT)
        loss += weight_each * near
        slopes[0] = slopes[0] + weight_each * by_q
        bases = self.motion.bases(self.t)
        gradient = sum(np.einsum("nN,nkN->nk", s, b) for s, b in zip(slopes, bases, strict=True))
        return loss, np.asarray(gradient).ravel()
