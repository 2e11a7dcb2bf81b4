"""Every joint's equation is compared in its own band: as wide as the encoders' noise, through the arm, lets it be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from codegen.prepare import prepare_arm
from runtime.arrays import Array
from runtime.diagnosis.stages import diagnose
from runtime.identification.fit import Fit
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import prepared
from runtime.identification.regressors import Regressors
from runtime.model.loader import Library, Model
from runtime.model.terms import Prediction, Term, structure
from runtime.motion.band import choose_band, coupling_bound
from runtime.motion.motion import prepare
from runtime.motion.settings import HIGHEST_CUTOFF, WIDE_ENOUGH
from runtime.recordings.recording import Recording
from runtime.report.diagnosed import document as diagnosed
from runtime.workspace.source import Source
from tests import wrist
from tests.kept import kept
from tests.six_joints import six_joints

RATE, SECONDS = 1000.0, 120.0
TORQUE = (0.2, 2.8e-3)
"""N m of white noise of either joint's torque."""
POSITION = (4e-5, 1e-6)
"""rad of white noise of either joint's encoder."""
COARSE = 2 * np.pi / 40_000
"""rad, the steps of a base's encoder beside those of `wrist`."""
ORDER, LINE = 1.0, 0.05
"""A line of the outer motor: periods a turn of it, N m."""


def still(seed: int) -> Recording:
    """Two joints that move slowly, with white noise on everything."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(SECONDS * RATE)) / RATE
    q = np.array([np.sin(0.9 * t), np.cos(1.3 * t)]) + np.array(POSITION)[:, None] * rng.standard_normal((2, len(t)))
    tau = np.array([np.cos(0.9 * t), np.sin(1.3 * t)]) + np.array(TORQUE)[:, None] * rng.standard_normal((2, len(t)))
    run, kinds = np.zeros(len(t), dtype=np.int64), ("revolute", "revolute")
    whole = (slice(0, len(t)),)
    return Recording(Path("still.csv"), t, run, q, tau, types=kinds, segments=whole, temperature=(None, None))


def noise_in_band(density_of: tuple[float, float], row: Array, cutoff: float) -> float:
    """Variance up to `cutoff` of the accelerations' noise times a row of inertias: summed over a spectrum's lines."""
    frequency = np.arange(1, 200_001) * cutoff / 200_000
    white = 2 * np.array(density_of) ** 2 / RATE
    return float(np.sum((row**2 @ white) * (2 * np.pi * frequency) ** 4) * frequency[0])


@pytest.mark.parametrize("coupling", [0.0, 0.003, 0.3])
def test_a_band_ends_where_the_noise_of_all_accelerations_is_a_quarter_of_the_torque_s(coupling: float) -> None:
    D = np.array([[1.0, coupling], [coupling, 0.1]])
    band = choose_band([still(0)], D)
    narrow = choose_band([still(0)], np.diag([1.0, 0.1]))
    assert band.cutoff == narrow.cutoff
    shares = [noise_in_band(POSITION, row, f) for row, f in zip(D, band.cutoffs, strict=True)]
    allowed = [0.25 * 2 * sigma**2 / RATE * f for sigma, f in zip(TORQUE, band.cutoffs, strict=True)]
    if coupling == 0.3:
        # Joint 1's noise reaches joint 2 as what three times its own inertia makes of it: the narrowest serves both.
        assert np.ptp(band.cutoffs) == 0
    else:
        assert band.cutoffs.argmin() == 0
        assert shares == pytest.approx(allowed, rel=0.1)


def test_beside_a_narrow_band_a_joint_s_own_ends_where_resonances_begin() -> None:
    for base, widest in ((1.0, WIDE_ENOUGH), (1e-4, HIGHEST_CUTOFF)):
        band = choose_band([still(1)], np.diag([base, 1e-5]))
        assert band.cutoffs[1] == pytest.approx(widest)


def test_what_is_not_known_of_a_coupling_is_as_much_as_two_inertias_permit() -> None:
    open_file = coupling_bound(np.full((2, 2), np.nan), np.array([4.0, 1.0]))
    assert open_file == pytest.approx(np.array([[4.0, 2.0], [2.0, 1.0]]))
    stated = coupling_bound(np.array([[1.0, -0.25], [-0.25, 1.0]]), np.array([4.0, 1.0]))
    assert stated == pytest.approx(np.array([[4.0, 0.5], [0.5, 1.0]]))


def recorded(line: float, seed: int) -> Recording:
    """The wrist with a base whose encoder is coarse, and a line of the outer motor's torque."""
    made = wrist.record(wrist.CoupledMotor(), seed)
    q, tau = made.q.copy(), made.tau.copy()
    tau[1] += line * np.sin(ORDER * 100 * q[1])
    q[0] = np.round(q[0] / COARSE) * COARSE
    return replace(made, q=q, tau=tau)


@pytest.fixture
def model(cache: Path, tmp_path: Path) -> Model:  # noqa: ARG001 - the cache is where it is compiled
    path = tmp_path / "wrist.toml"
    path.write_text(wrist.MODEL, encoding="utf-8")
    return Source.read(path, None).compiled.model()


def test_a_line_of_a_wrist_is_found_above_what_the_base_s_encoder_permits(model: Model) -> None:
    found = kept(diagnose, model, [recorded(LINE, seed=3)])
    band = found.steps[0].fit.motion.band
    speed = np.abs(np.diff(recorded(LINE, seed=3).q[1])).mean() * wrist.RATE
    assert band.cutoffs[0] < ORDER * 100 * speed / (2 * np.pi) < band.cutoffs[1]
    assert [str(f.term) for f in found.findings] == ["torque_ripple@2"]
    assert found.findings[0].candidate.shape["order"] == pytest.approx(ORDER, rel=1e-3)
    document = diagnosed(found).to_json()["band"]
    assert document["cutoff_hz"] == min(document["cutoffs_hz"]) == band.cutoffs[0]
    assert f"joint 2 up to {band.cutoffs[1]:g} Hz" in document["reason"]


def test_without_the_line_nothing_is_named(model: Model) -> None:
    assert not kept(diagnose, model, [recorded(0.0, seed=4)]).findings


def test_a_wider_band_tells_more_of_the_joint_that_has_it(model: Model) -> None:
    recording = recorded(0.0, seed=5)
    own = prepared(model, [recording])
    narrow = prepare([recording], replace(own.band, cutoffs=np.full(2, own.band.cutoff)), model)
    wide, common = (fit_motion(model, motion, structure(model)) for motion in (own, narrow))

    def width(found: Fit, name: str, joint: int) -> float:
        (value,) = found.inference.values[Term(name, joint)].values()
        assert value.interval is not None
        low, high = value.interval
        truth = (wrist.DRY if name == "coulomb" else wrist.VISCOUS)[joint - 1]
        assert low - (high - low) < truth < high + (high - low)
        return high - low

    # Friction turns with the rate, which is known more sharply where it is smoothed less.
    assert width(wide, "coulomb", 2) < 0.8 * width(common, "coulomb", 2)
    assert width(wide, "coulomb", 1) == pytest.approx(width(common, "coulomb", 1), rel=0.2)


def six_joints_moved(model: Model, seed: int) -> Recording:
    """Six joints in space that swing slowly; white noise on everything, of encoders of 200,000 counts."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(20 * RATE)) / RATE
    omega, phase = 2 * np.pi * rng.uniform(0.2, 0.7, (6, 1)), rng.uniform(0, 2 * np.pi, (6, 1))
    wave, slope = np.sin(omega * t + phase), np.cos(omega * t + phase)
    tau = model.inverse_dynamics(wave, omega * slope, -(omega**2) * wave, model.lump_values)
    q, tau = (x + size * rng.standard_normal(x.shape) for x, size in ((wave, 1e-5), (tau, 0.2)))
    run, kinds, whole = np.zeros(len(t), dtype=np.int64), ("revolute",) * 6, (slice(0, len(t)),)
    return Recording(Path("six.csv"), t, run, q, tau, types=kinds, segments=whole, temperature=(None,) * 6)


def test_a_soft_shoulder_reaches_a_wrist_s_rows_as_far_as_the_shoulder_s_own_band(library: Library) -> None:
    """A resonance between the two bands multiplies the noise of the shoulder's encoder, and nothing else is there."""
    six = Model(prepare_arm(six_joints()), library)
    recording, shoulder, wrist_joint = six_joints_moved(six, seed=8), 2, 3
    own = prepared(six, [recording])
    low, high = own.band.cutoffs[[shoulder, wrist_joint]]
    assert high > 1.5 * low
    common = prepare([recording], replace(own.band, cutoffs=np.full(6, low)), six)
    wide, narrow = (Regressors(six, motion, Prediction(six.lump_values, {})) for motion in (own, common))
    inertia, omega = float(np.median(wide.signals(shoulder)[0].link_inertia(shoulder))), 2 * np.pi * np.sqrt(low * high)
    soft = {"stiffness": inertia * omega**2, "damping": 2 * 0.003 * inertia * omega}
    term = Term("elasticity", shoulder + 1)
    felt, again, there = (r.columns(term, wrist_joint, soft)[0] for r in (wide, wide.perturbed, narrow))
    assert np.std(again - felt) < 0.1 * np.std(felt)
    within = slice(len(there) // 20, -len(there) // 20)
    at = np.interp(common.row_time(wrist_joint), own.row_time(wrist_joint), felt)
    assert np.std((at - there)[within]) < 0.1 * np.std(there)


def test_rows_of_two_bands_stand_beside_each_other_in_time(model: Model) -> None:
    motion = prepared(model, [recorded(0.0, seed=6)])
    for own, other in ((0, 1), (1, 0), (0, 0)):
        beside = motion.nearest_rows(own, other)
        apart = np.abs(motion.row_time(own)[beside] - motion.row_time(other))
        inside = (motion.row_time(other) > motion.row_time(own)[0]) & (
            motion.row_time(other) < motion.row_time(own)[-1]
        )
        assert apart[inside].max() <= 0.5001 / motion.row_rate(own)
    assert motion.row_rate(1) > 1.5 * motion.row_rate(0)
    assert np.array_equal(motion.nearest_rows(1, 1), np.arange(len(motion.row_time(1))))


def test_rows_are_the_same_in_blocks(model: Model) -> None:
    (piece,) = prepared(model, [recorded(0.0, seed=7)]).pieces_of(1)
    wide = np.random.default_rng(0).standard_normal((2, 3, len(piece.t)))
    whole = piece.equations(wide, (0, 1))
    parts: list[slice] = []

    def make(at: slice) -> NDArray[np.float64]:
        parts.append(at)
        return wide[:, :, at]

    blocks = piece.equations_in_blocks(make, (0, 1))
    assert len(parts) > 2
    assert all(np.array_equal(blocks[i], whole[i]) for i in (0, 1))


def test_what_is_later_than_a_recording_is_long_is_its_end_held(model: Model) -> None:
    (piece,) = prepared(model, [recorded(0.0, seed=7)]).pieces_of(1)
    ramp = np.arange(1.0, len(piece.t) + 1)
    for times, end in ((3.0, ramp[0]), (-3.0, ramp[-1])):
        assert piece.delayed(ramp, times * len(ramp)) == pytest.approx(np.full(len(piece.centres), end))
    within = piece.delayed(ramp, 10.0)[1:-1]
    assert within == pytest.approx(ramp[piece.centres][1:-1] - 10.0)
