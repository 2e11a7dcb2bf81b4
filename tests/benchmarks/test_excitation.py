"""The first motion's Fourier part against random Fourier series of the same length and limits, against the setting of
five harmonics of 0.1 Hz, as many publications take it, and against figaroh's of its UR10 and TX40 examples:
information, condition number, and the widest interval that is left of what any of them tells.

All have the same arm, noise, start, floor and limits; every random series is as large as these allow.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest
from harness import show, sized
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

from runtime.arrays import Array
from runtime.experiments.clearance import Clearance
from runtime.experiments.excitation import ExcitationSearch
from runtime.experiments.first_proposal import ArmToMove, ReadyArm
from runtime.experiments.fourier import FourierMotion, harmonics_of
from runtime.experiments.options import ExperimentSettings, FirstMotionSettings
from runtime.experiments.pieces import Envelope
from runtime.experiments.scene import Scene
from runtime.experiments.settings import FASTEST_HARMONIC, PERIOD, SAMPLES_A_PERIOD, STARTS
from runtime.progress import each
from runtime.workspace.source import Source

DRAWS, SECONDS = sized((1000, 60.0), (10, 60.0))
TELLABLE = 0.5
"""Part of its interval that some motion leaves of a parameter, if the widest intervals are compared on it."""
STARTS_AT = {"ur10": (0.0, -1.57, 1.57, -1.57, -1.57, 0.0), "panda": (0.0, -0.785, 0.0, -2.356, 0.0, 1.57, 0.785)}


def _ready(name: str) -> ReadyArm:
    source = Source.shipped(name)
    likely, assumed = source.compiled.with_likely_numbers()
    room = Clearance.of(likely.arm, Scene.of(floor=0.0) if name in STARTS_AT else Scene.of())
    start = np.array(STARTS_AT[name]) if name in STARTS_AT else None
    model = source.compiled.model()
    to_move = ArmToMove(model, likely.model(), likely.arm, assumed, room, room.unchecked, start=start)
    return ReadyArm.of(to_move, ExperimentSettings(), FirstMotionSettings())


@dataclass(frozen=True)
class Splines:
    """Cubic splines through waypoints at even times, at rest in the middle pose at both ends; unknowns (n, k) are the
    waypoints between, of size 1 at the ends of the range."""

    envelopes: Sequence[Envelope]
    moving: Sequence[int]
    period: float
    waypoints: int

    def random(self, rng: np.random.Generator) -> Array:
        return rng.uniform(-0.5, 0.5, (len(self.envelopes), self.waypoints - 2))

    def shape(self, x: Array, t: Array) -> tuple[Array, Array, Array]:
        middle = np.array([[e.middle] for e in self.envelopes])
        made = [np.einsum("nk,nkN->nN", x, basis) for basis in self.bases(t)]
        return middle + made[0], made[1], made[2]

    def bases(self, t: Array) -> tuple[Array, Array, Array]:
        """Derivatives of q, qd and qdd by each joint's unknowns, (n, k, N)."""
        at = np.linspace(0.0, self.period, self.waypoints)
        each_way = CubicSpline(at, np.eye(self.waypoints)[:, 1:-1], bc_type="clamped")
        reach = np.array([e.reach if i in self.moving else 0.0 for i, e in enumerate(self.envelopes)])
        found = [reach[:, None, None] * each_way(t, order).T for order in range(3)]
        return found[0], found[1], found[2]


FIGAROH = {"UR10": (7, 2.0), "TX40": (5, 1.5)}
"""Waypoints and s between them: figaroh-examples, unified configurations of examples/ur10 and examples/staubli_TX40.
Both make the condition number of the base regressor small."""
ITERATIONS = sized(100, 5)
"""Of a descent, as in figaroh's configuration of the UR10."""


def _search(ready: ReadyArm, series: FourierMotion | Splines) -> ExcitationSearch:
    limits = ready.limits
    t = np.arange(SAMPLES_A_PERIOD) * series.period / SAMPLES_A_PERIOD
    information = replace(limits.information, count=SAMPLES_A_PERIOD)
    # A motion by any other basis than Fourier's has the same methods.
    return ExcitationSearch(information, series, limits.room, t, SECONDS, limits.torque, limits.tip_speed)  # type: ignore[arg-type]


def _fourier(ready: ReadyArm, period: float, harmonics: tuple[int, ...]) -> ExcitationSearch:
    return _search(ready, FourierMotion(ready.limits.envelopes, ready.moving, period, harmonics))


def _condition(search: ExcitationSearch, x: Array) -> float:
    """Ratio of the largest to the smallest singular value of the base parameters' regressor that the motion tells."""
    Y = search.information.outputs(*search.motion.shape(x, search.t)).Y
    values = np.linalg.svd(Y.reshape(-1, Y.shape[-1]), compute_uv=False)
    told = values[values > 1e-10 * values[0]]
    return float(told[0] / told[-1])


def _well_conditioned(search: ExcitationSearch, starts: int) -> Array:
    """The motion of the least condition number within the limits, from several random ones."""

    def loss(flat: Array) -> float:
        x = flat.reshape(len(search.motion.envelopes), -1)
        over = max(search.beyond(x) - 1.0, 0.0)
        return float(np.log(_condition(search, x)) + 10.0 * min(over, 10.0))

    made = []
    for k in range(starts):
        start = _largest(search, search.motion.random(np.random.default_rng(k)))
        found = minimize(loss, start.ravel(), method="L-BFGS-B", options={"maxiter": ITERATIONS})
        x = found.x.reshape(start.shape)
        made.append(x if search.beyond(x) <= 1.0 else _largest(search, x))
    return min(made, key=lambda x: _condition(search, x))


def _left(search: ExcitationSearch, x: Array) -> Array:
    """Standard deviations that are left of base parameters and parameters of effects, as parts of what they were."""
    q, qd, qdd = search.motion.shape(x, search.t)
    F = search.information.told(q, qd, qdd, len(search.t) / SECONDS)
    left = np.linalg.inv(np.eye(len(F)) + F)
    spread = search.information.arms.spread
    lumps = np.diag(spread @ left[: spread.shape[1], : spread.shape[1]] @ spread.T) / (spread**2).sum(axis=1)
    effects = np.diag(left)[spread.shape[1] :][search.information.spreads > 0]
    return np.sqrt(np.concatenate([lumps, effects]))


def _largest(search: ExcitationSearch, x: Array) -> Array:
    """The motion as large as all limits allow."""
    low, high = 0.0, 4.0
    for _ in range(10):
        middle = (low + high) / 2
        low, high = (middle, high) if search.beyond(middle * x) <= 1.0 else (low, middle)
    return low * x


@dataclass(frozen=True)
class Told:
    """What a motion tells: nats, standard deviations left, condition number; s of its search."""

    nats: float
    left: Array
    condition: float
    seconds: float

    @classmethod
    def by(cls, search: ExcitationSearch, x: Array, seconds: float = np.nan) -> Told:
        return cls(search.value(x), _left(search, x), _condition(search, x), seconds)


@pytest.mark.parametrize("name", ["drive", "vishard4", "ur10", "panda"])
def test_information_against_other_motions(name: str) -> None:
    ready = _ready(name)
    usual = _fourier(ready, PERIOD, harmonics_of(PERIOD, FASTEST_HARMONIC))
    rng = np.random.default_rng(1)
    random = [Told.by(usual, _largest(usual, usual.motion.random(rng))) for _ in each("random series", range(DRAWS))]
    by_nats = sorted(random, key=lambda told: told.nats)
    swevers = _fourier(ready, 10.0, (1, 2, 3, 4, 5))
    ways = {
        f"{points} waypoints every {apart:g} s (figaroh, {of})": (
            _search(ready, Splines(ready.limits.envelopes, ready.moving, (points - 1) * apart, points)),
            partial(_well_conditioned, starts=STARTS),
        )
        for of, (points, apart) in FIGAROH.items()
    }
    ways |= {"five harmonics of 0.1 Hz, optimized": (swevers, _most_told), "Tendon": (usual, _most_told)}
    found = {f"best of {DRAWS} random series": by_nats[-1], f"median of {DRAWS}": by_nats[len(by_nats) // 2]}
    for label, (search, sought) in ways.items():
        began = time.perf_counter()
        x = sought(search)
        found[label] = Told.by(search, x, time.perf_counter() - began)
    # What no motion tells has the same interval after all of them.
    tellable = np.min([told.left for told in found.values()], axis=0) < TELLABLE
    rows = [
        (label, f"{x.nats:.1f}", f"{x.left[tellable].max():.3f}", f"{x.condition:.0f}", f"{x.seconds:.1f}")
        for label, x in found.items()
    ]
    columns = ("motion", "nats", f"widest of {tellable.sum()} left", "condition", "s")
    show(f"Excitation of {name}, {SECONDS:g} s", columns, rows)
    assert found["Tendon"].nats > by_nats[-1].nats


def _most_told(search: ExcitationSearch) -> Array:
    return search.best([search.motion.random(np.random.default_rng(k)) for k in range(STARTS)])[0]
