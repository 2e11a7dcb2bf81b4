"""Stamps that are rounded, late, lost or truly uneven: one even grid, and the truth on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.diagnosis.stages import diagnose
from runtime.identification.identify import identify, prepared
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.motion.clock import Stretch, grid
from runtime.motion.noise import ENOUGH_FOR_NOISE, SampleNoise
from runtime.recordings.recording import Recording
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import simulate
from runtime.workspace.source import Source
from tests.judge.cases import Setting, cases, make
from tests.judge.recorder import Logger
from tests.kept import kept

TRUE_INERTIA = 0.2365  # kg m^2, of the drive's rotor and link


@pytest.fixture(scope="module")
def run(drive: Model) -> Recording:
    """At 1 kHz, evenly."""
    return simulate(drive, settings=SimulationSettings(seconds=30.0, seed=3))[0]


def sampled(recording: Recording, rows: NDArray[np.intp], stamps: Array | None = None) -> Recording:
    """Some of the samples, with other stamps if wanted."""
    t = recording.t[rows] if stamps is None else stamps
    return replace(
        recording,
        t=t,
        run=recording.run[rows],
        q=recording.q[:, rows],
        tau=recording.tau[:, rows],
        q_desired=None,
        segments=(slice(0, len(t)),),
    )


def steps(recording: Recording, choices: list[int], seed: int = 0) -> NDArray[np.intp]:
    rows = np.cumsum(np.random.default_rng(seed).choice(choices, len(recording.t) // min(choices)))
    return rows[rows < len(recording.t)]


def uneven(run: Recording) -> Recording:
    """A controller whose period is 10 or 12 ms, in no order."""
    return sampled(run, steps(run, [10, 12]))


def off_by_a_little(run: Recording) -> Recording:
    """500 Hz of a clock that is 0.37 % slow, whose stamps are whole milliseconds."""
    rows = np.arange(0, len(run.t), 2)
    return sampled(run, rows, np.round(1.0037 * run.t[rows] + 3e-4, 3))


def late(run: Recording) -> Recording:
    """500 Hz, stamped by a host that is late by up to 1.3 ms, in whole milliseconds."""
    rows = np.arange(0, len(run.t), 2)
    return sampled(run, rows, np.round(run.t[rows] + np.random.default_rng(1).uniform(0, 1.3e-3, len(rows)), 3))


def lossy(run: Recording) -> Recording:
    """500 Hz, of which one sample in a hundred was lost."""
    rows = np.arange(0, len(run.t), 2)
    return sampled(run, rows[np.random.default_rng(2).random(len(rows)) > 0.01])


@pytest.mark.parametrize(
    ("logged", "inertia", "least"),
    [
        (uneven, TRUE_INERTIA, 17.0),
        (off_by_a_little, TRUE_INERTIA * 1.0037**2, 25.0),
        (late, TRUE_INERTIA, 25.0),
        (lossy, TRUE_INERTIA, 25.0),
    ],
)
def test_inertia_and_band_do_not_depend_on_the_stamps(
    drive: Model, run: Recording, logged: Callable[[Recording], Recording], inertia: float, least: float
) -> None:
    """A clock that is slow makes seconds longer, and an inertia with their square."""
    found = kept(identify, drive, [logged(run)])
    estimate = found.inference.lumps[0]
    assert estimate.interval is not None
    # A tenth of a per cent for one draw in twenty that lies beside its interval.
    assert estimate.interval[0] - 1e-3 * inertia < inertia < estimate.interval[1] + 1e-3 * inertia
    assert found.motion.band.cutoff > least


@pytest.mark.parametrize("logged", [uneven, off_by_a_little, lossy])
def test_a_clean_recording_stays_clean(drive: Model, run: Recording, logged: Callable[[Recording], Recording]) -> None:
    assert kept(diagnose, drive, [logged(run)]).verdict == "clean"


def test_an_even_recording_is_not_touched(run: Recording) -> None:
    found = grid(run)
    assert found.stretches[0].places is None
    assert found.period == pytest.approx(1e-3, rel=1e-9)


def test_a_lost_sample_is_a_place_left_out(run: Recording) -> None:
    """Also two near each other, and beside stamps that are late."""
    rows = np.delete(np.arange(2000), [300, 304, 305, 1000])
    stamps = run.t[rows].copy()
    stamps[[200, 201, 600]] += [1.7e-3, 0.9e-3, 2.1e-3]
    logged = sampled(run, rows, stamps)
    places = grid(logged).stretches[0].places
    assert places is not None
    assert places == pytest.approx(rows)


@pytest.mark.parametrize("pace", [0.9962, 0.9989, 1.0011, 1.0037])
def test_rounding_does_not_draw_the_period_to_its_own_places(pace: float, run: Recording) -> None:
    """500 Hz of a clock that is off by up to 0.4 %, jittering, in whole milliseconds: no sample is taken for lost."""
    rows = np.arange(0, len(run.t), 2)
    jitter = np.random.default_rng(4).normal(0, 1.5e-4, len(rows))
    found = grid(sampled(run, rows, np.round(pace * run.t[rows] + jitter - jitter.min(), 3)))
    assert found.period == pytest.approx(2e-3 * pace, rel=1e-4)
    assert found.longest.size == len(rows)


def test_segments_have_one_period(run: Recording) -> None:
    logged = uneven(run)
    middle = len(logged.t) // 2
    parts = replace(logged, segments=(slice(0, middle), slice(middle + 100, len(logged.t))))
    found = grid(parts)
    assert found.period == pytest.approx(11e-3, rel=0.02)
    assert [s.size for s in found.stretches] == pytest.approx([middle, len(logged.t) - middle - 100], rel=0.02)


def test_interpolation_does_not_change_the_noise(run: Recording) -> None:
    """White noise of known density on uneven samples is measured as it is, though a spline smooths it."""
    logged = uneven(run)
    noise = 1e-3 * np.random.default_rng(5).standard_normal(len(logged.t))
    found = grid(logged)
    measured = SampleNoise.on(found.longest, 1 / found.period).density(noise)
    assert measured == pytest.approx(2 * 1e-6 * found.period, rel=0.25)


def test_another_reading_passes_the_same_interpolation(drive: Model, run: Recording) -> None:
    """What it changes has the noise's density where the spline passes it, and less where it does not."""
    motion = prepared(drive, [uneven(run)])
    piece, again = motion.pieces[0], motion.perturbed.pieces[0]
    error = (again.q - piece.q)[0]
    expected = motion.band.position_density[0] * 2 * motion.band.cutoff
    assert np.var(error) == pytest.approx(expected, rel=0.5)
    window = slice(200, 1200)
    part = piece.cut(window).perturbed(motion.band, 7, motion.driven)
    assert np.std(part.q - piece.q[:, window]) == pytest.approx(np.std(error), rel=0.3)


def test_signals_that_are_not_measured_stay_absent(run: Recording) -> None:
    logged = uneven(run)
    stretch = grid(logged).stretches[0]
    rows = np.vstack([logged.q, np.full_like(logged.q, np.nan)])
    spread = stretch.on_grid(rows)
    assert np.isfinite(spread[0]).all()
    assert np.isnan(spread[1]).all()


@pytest.mark.parametrize(("setting", "held"), [({"jitter": 0.3}, True), ({"stamps": "two_steps", "every": 10}, False)])
def test_a_command_is_held_where_the_period_of_its_controller_wavers(
    setting: dict[str, Any], held: bool, tmp_path: Path
) -> None:
    """Interpolated, it would take some hundredths of viscous friction; a torque that is read at uneven instants goes on
    between them."""
    at = Setting(logger=Logger(**setting)) if "stamps" in setting else Setting(**setting)
    (case,) = cases(["inside_coulomb"], [1], [1.0], [40], at)
    made = make(case)
    path = tmp_path / "arm1.toml"
    path.write_text(made.model)
    found = kept(identify, Source.read(path, None).compiled.model(), [made.recording])
    assert found.motion.band.held is held
    truth = made.plant[0]["VISCOUS_POSITIVE"]
    interval = found.inference.values[Term("viscous", 1)]["coefficient"].interval
    assert interval is not None
    assert interval[0] < truth < interval[1]
    inertia = found.inference.lumps[0].interval
    assert inertia is not None
    assert inertia[0] < TRUE_INERTIA < inertia[1]


@pytest.mark.parametrize("uncertain", [False, True])
def test_noise_that_follows_the_rate_is_an_error_of_time(run: Recording, uncertain: bool) -> None:
    """Every other sample, read within 0.3 ms of its stamp, or at it with as much noise of an encoder."""
    rng, rows = np.random.default_rng(1), np.arange(0, len(run.t) - 1, 2)
    late, rate = rng.normal(0.0, 3e-4, len(rows)), np.gradient(run.q[0], run.t)[rows]
    error = rate * late if uncertain else np.std(rate) * 3e-4 * rng.standard_normal(len(rows))
    read = sampled(run, rows)
    found = grid(read)
    noise = SampleNoise.on(found.longest, 1 / found.period)
    assert noise.jittered(read.q + error) == uncertain


def test_a_long_recording_of_uneven_stamps_has_a_noise() -> None:
    """More samples than are looked at."""
    size, rng = ENOUGH_FOR_NOISE + 1000, np.random.default_rng(2)
    places = np.arange(size) + np.append(0.0, rng.uniform(0.0, 0.3, size - 1))
    noise = SampleNoise.on(Stretch(slice(0, size), places, size), 1000.0)
    assert not noise.jittered(np.sin(places / 500)[None] + 1e-4 * rng.standard_normal((1, size)))
