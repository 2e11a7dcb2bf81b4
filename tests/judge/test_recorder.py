"""What the judge's loggers write: their stamps, their means, their steps, their rates and their late encoders."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.arrays import Array

from .bench import DISTURBANCE, LEVEL, Setting, bench, specimen
from .bodies import ARMS, BELIEVED
from .motion import desired
from .plant import COUNT, PERIOD, Run
from .recorder import LONG, LOST, RATE_CORNER, STAMPS, Logger, clock, instants, means, record, stamped
from .situations import SITUATIONS

PERIODS = 40_000
INSTANTS = np.linspace(0.0, (PERIODS - 1) * PERIOD, PERIODS)


def ramp(rate: float, acceleration: float = 0.0) -> Run:
    """One joint in even acceleration, and its link with it."""
    t = INSTANTS
    q = (rate * t + 0.5 * acceleration * t**2)[None]
    v = np.diff(q, append=q[:, -1:] + PERIOD * rate) / PERIOD
    zero = np.zeros_like(q)
    return Run(q, zero, v, zero, zero, zero, q)


def written(logger: Logger, seed: int = 1) -> tuple[Array, Array]:
    """Stamps, and the instants that they are stamps of."""
    rng = np.random.default_rng(seed)
    t = INSTANTS * clock(logger, rng)
    at = instants(logger, PERIODS, rng)
    return stamped(logger, t[at]), t[at]


@pytest.mark.parametrize("stamps", STAMPS)
@pytest.mark.parametrize("every", [2, 10])
def test_stamps_increase_strictly_and_cover_the_motion(stamps: str, every: int) -> None:
    stamp, true = written(Logger(every=every, stamps=stamps))
    assert np.all(np.diff(stamp) > 0)
    assert stamp[-1] == pytest.approx(PERIODS * PERIOD, rel=5e-3)
    assert np.abs(stamp - true).max() <= 0.5e-3 + 1e-12


def test_a_logger_of_two_steps_takes_either_half_of_the_time() -> None:
    stamp, _ = written(Logger(every=10, stamps="two_steps"))
    steps = np.round(np.diff(stamp), 6)
    assert set(steps) == {0.010, round(0.010 * LONG, 6)}
    # Four standard deviations of a coin that is thrown so often.
    assert np.mean(steps == 0.010) == pytest.approx(0.5, abs=2.0 / np.sqrt(len(steps)))


def test_rounded_stamps_are_whole_milliseconds_of_another_clock() -> None:
    stamp, true = written(Logger(every=2, stamps="rounded"))
    assert np.allclose(stamp, np.round(stamp, 3), rtol=0, atol=1e-12)
    # What is rounded off is spread evenly, which has this standard deviation.
    assert (stamp - true).std() == pytest.approx(1e-3 / np.sqrt(12), rel=0.05)
    assert len(np.unique(np.round(np.diff(stamp), 6))) > 1


def test_lost_samples_are_single_ones() -> None:
    stamp, _ = written(Logger(every=2, stamps="lost"))
    steps = np.round(np.diff(stamp) / 2e-3).astype(int)
    assert set(steps) == {1, 2}
    assert np.mean(steps == 2) == pytest.approx(LOST, rel=0.3)


def test_means_keep_the_impulse() -> None:
    x = np.random.default_rng(2).standard_normal((2, PERIODS))
    logger = Logger(every=4)
    at = instants(logger, PERIODS, np.random.default_rng(0))
    assert np.allclose(4 * means(x, at, 4).sum(axis=1), x[:, : 4 * len(at)].sum(axis=1), rtol=0, atol=1e-8)


def logged(logger: Logger, run: Run) -> tuple[Array, Array, Array | None, Array | None]:
    at = instants(logger, PERIODS, np.random.default_rng(0))
    made = record(logger, run, INSTANTS, at, np.zeros_like(run.tau), 1.0, [None])
    return made.t, made.q, made.qd, made.q_link


def test_a_late_encoder_at_the_link_reads_what_comes() -> None:
    _, q, _, link = logged(Logger(link_late=2.5e-3), ramp(0.5))
    assert link is not None
    assert np.median(link - q) == pytest.approx(0.5 * 2.5e-3, abs=COUNT)


@pytest.mark.parametrize(
    ("rates", "late"), [("clean", 0.0), ("filtered", np.sqrt(2) / (2 * np.pi * RATE_CORNER)), ("difference", 1e-3)]
)
def test_a_rate_is_as_late_as_its_filter(rates: str, late: float) -> None:
    """In even acceleration, a Butterworth filter of second order lags sqrt(2)/(2 pi f), a difference half a step."""
    t, _, qd, _ = logged(Logger(every=2, rates=rates), ramp(0.1, 0.2))
    assert qd is not None
    behind = 0.1 + 0.2 * t - qd[0]
    assert np.mean(behind[2000:-10]) / 0.2 == pytest.approx(late, abs=0.6e-3)


def test_a_torque_in_steps_is_off_by_half_a_step_at_most() -> None:
    setting = SITUATIONS["quantised"]
    step = setting.logger.resolution
    rng = np.random.default_rng(3)
    plant = bench(setting, desired(rng, 1, "brief"), rng, False, specimen(ARMS[1], BELIEVED, rng))
    run = plant.run([])
    tau = plant.recording(run).tau
    assert np.allclose(tau / step, np.round(tau / step), rtol=0, atol=1e-9)
    assert np.abs(tau - run.tau - plant.noise).max() <= 0.5 * step + 1e-9


@pytest.mark.parametrize("name", list(SITUATIONS))
def test_every_situation_gives_a_recording_and_says_how_it_is(name: str) -> None:
    setting = SITUATIONS[name]
    rng = np.random.default_rng(3)
    plant = bench(setting, desired(rng, 1, "brief")[..., :6000], rng, False, specimen(ARMS[1], BELIEVED, rng))
    run = plant.run([])
    made = plant.recording(run)
    assert made.q.shape == made.tau.shape == (1, len(made.t))
    assert made.dt == pytest.approx(PERIOD * setting.logger.every, rel=0.21)
    assert (made.qd is not None) == bool(setting.logger.rates)
    assert (made.q_link is not None) == (setting.logger.link_late is not None)
    assert (str(setting) == str(Setting())) == (name == "plain")
    # Noise and steps alone: the plant's torque is no part of it.
    disturbed = plant.disturbed(run, made)
    expected = np.hypot(setting.level / np.sqrt(setting.logger.every), setting.logger.resolution / np.sqrt(12))
    assert disturbed.std() == pytest.approx(np.hypot(expected, DISTURBANCE * setting.level / LEVEL), rel=0.1)
