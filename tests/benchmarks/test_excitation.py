"""The first motion's Fourier part against random Fourier series of the same length and limits, and against the setting
of five harmonics of 0.1 Hz, as many publications take it: information, and the widest interval that is left.

All have the same arm, noise, start, floor and limits; every random series is as large as these allow.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from harness import show, sized
from numpy.typing import NDArray

from runtime.experiments.clearance import Clearance
from runtime.experiments.excitation import ExcitationSearch
from runtime.experiments.first_proposal import ArmToMove, ReadyArm
from runtime.experiments.fourier import FourierMotion, harmonics_of
from runtime.experiments.options import ExperimentSettings, FirstMotionSettings
from runtime.experiments.scene import Scene
from runtime.experiments.settings import FASTEST_HARMONIC, PERIOD, SAMPLES_A_PERIOD, STARTS
from runtime.progress import each
from runtime.workspace.source import Source

Array = NDArray[np.float64]

DRAWS, SECONDS = sized((1000, 60.0), (10, 60.0))
STARTS_AT = {"ur10": (0.0, -1.57, 1.57, -1.57, -1.57, 0.0), "panda": (0.0, -0.785, 0.0, -2.356, 0.0, 1.57, 0.785)}


def _ready(name: str) -> ReadyArm:
    source = Source.shipped(name)
    likely, assumed = source.compiled.with_likely_numbers()
    room = Clearance.of(likely.arm, Scene.of(floor=0.0) if name in STARTS_AT else Scene.of())
    start = np.array(STARTS_AT[name]) if name in STARTS_AT else None
    model = source.compiled.model()
    to_move = ArmToMove(model, likely.model(), likely.arm, assumed, room, room.unchecked, start=start)
    return ReadyArm.of(to_move, ExperimentSettings(), FirstMotionSettings())


def _search(ready: ReadyArm, period: float, harmonics: tuple[int, ...]) -> ExcitationSearch:
    limits = ready.limits
    series = FourierMotion(limits.envelopes, ready.moving, period, harmonics)
    t = np.arange(SAMPLES_A_PERIOD) * period / SAMPLES_A_PERIOD
    information = replace(limits.information, count=SAMPLES_A_PERIOD)
    return ExcitationSearch(information, series, limits.room, t, SECONDS, limits.torque, limits.tip_speed)


def _widest(search: ExcitationSearch, x: Array) -> float:
    """The largest standard deviation that is left of a base parameter or a parameter of an effect, as a part of what it
    was."""
    q, qd, qdd = search.motion.shape(x, search.t)
    F = search.information.told(q, qd, qdd, len(search.t) / SECONDS)
    left = np.linalg.inv(np.eye(len(F)) + F)
    spread = search.information.arms.spread
    lumps = np.diag(spread @ left[: spread.shape[1], : spread.shape[1]] @ spread.T) / (spread**2).sum(axis=1)
    effects = np.diag(left)[spread.shape[1] :][search.information.spreads > 0]
    return float(np.sqrt(max(lumps.max(), effects.max())))


def _largest(search: ExcitationSearch, x: Array) -> Array:
    """The motion as large as all limits allow."""
    low, high = 0.0, 4.0
    for _ in range(10):
        middle = (low + high) / 2
        low, high = (middle, high) if search.beyond(middle * x) <= 1.0 else (low, middle)
    return low * x


@pytest.mark.parametrize("name", ["drive", "vishard4", "ur10", "panda"])
def test_information_against_random_series(name: str) -> None:
    ready = _ready(name)
    usual = _search(ready, PERIOD, harmonics_of(PERIOD, FASTEST_HARMONIC))
    rng = np.random.default_rng(1)
    random = []
    for _ in each("random series", range(DRAWS)):
        x = _largest(usual, usual.motion.random(rng))
        random.append((usual.value(x), _widest(usual, x)))
    rows = []
    drawn = np.array(random)
    best = drawn[drawn[:, 0].argmax()]
    rows.append((f"best of {DRAWS} random series", f"{best[0]:.1f}", f"{best[1]:.3f}", ""))
    rows.append((f"median of {DRAWS}", f"{np.median(drawn[:, 0]):.1f}", f"{np.median(drawn[:, 1]):.3f}", ""))
    swevers = _search(ready, 10.0, (1, 2, 3, 4, 5))
    for label, search in (("five harmonics of 0.1 Hz, optimized", swevers), ("Tendon", usual)):
        began = time.perf_counter()
        x = search.best([search.motion.random(np.random.default_rng(k)) for k in range(STARTS)])
        seconds = time.perf_counter() - began
        rows.append((label, f"{search.value(x):.1f}", f"{_widest(search, x):.3f}", f"{seconds:.1f}"))
    show(f"Fourier motions of {name}, {SECONDS:g} s", ("motion", "nats", "widest interval left", "s"), rows)
    assert float(rows[-1][1]) > best[0]
