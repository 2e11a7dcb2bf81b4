"""Intervals of a soft transmission hold its values, also where something pushes the link that no model knows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.fit_warnings import warnings
from runtime.identification.estimate import Estimate
from runtime.identification.fit import Fit
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import prepared
from runtime.identification.problem import Problem
from runtime.model.terms import Term, structure
from runtime.regression.noise import over_stretches
from runtime.workspace.source import Source
from tests import bank, spatial_wrist
from tests.judge.bodies import ARMS
from tests.judge.cases import Setting
from tests.judge.recorder import Logger
from tests.judge.sensed import sensed
from tests.kept import kept

ELASTICITY = Term("elasticity", 1)


def soft(stiffness: float, seed: int, rotor: float = ARMS[1][0].rotor, **setting: Any) -> tuple[Fit, float]:
    """A fit with an elasticity of the independent plant, and its damping there, N m s/rad; rotor: as it is stated."""
    made = kept(sensed, Setting(**setting), ("elasticity", 0, stiffness), seed=seed)
    text = bank.TEXTS["judge1"].replace(f"rotor_inertia = {ARMS[1][0].rotor}", f"rotor_inertia = {rotor}")
    model = Source(Path("judge1.toml"), text).compiled.model()
    known = {**structure(model), ELASTICITY: {}}
    return fit_motion(model, prepared(model, [made.plain]), known), made.plant[0]["STIFFNESS_DAMPING"]


def holds(e: Estimate, truth: float) -> bool:
    return e.interval is not None and e.interval[0] < truth < e.interval[1]


def test_a_soft_joint_pushed_from_outside_is_within_its_interval() -> None:
    found, damping = soft(1500.0, 51)
    values = found.inference.values[ELASTICITY]
    assert holds(values["stiffness"], 1500.0)
    assert holds(values["damping"], damping)


@pytest.mark.parametrize("every", [4, 15])
def test_a_stiffness_is_right_at_any_rate_of_the_rows(every: int) -> None:
    """At 66 Hz the load between two rows, continued in a straight line, would make 3000 N m/rad 2000."""
    found, damping = soft(3000.0, 7, level=0.0, logger=Logger(every=every))
    values = found.inference.values[ELASTICITY]
    assert values["stiffness"].value == pytest.approx(3000.0, rel=0.08)
    assert holds(values["stiffness"], 3000.0)
    assert holds(values["damping"], damping)


@pytest.mark.parametrize(("stiffness", "seed"), [(3000.0, 8), (1000.0, 9)])
@pytest.mark.parametrize("rotor", [0.07, 0.14])
def test_a_stiffness_is_no_surer_than_the_stated_rotor(stiffness: float, seed: int, rotor: float) -> None:
    """The link's inertia is the joint's less the rotor's 0.1 kg m^2; the interval says why it is wide."""
    found, _ = soft(stiffness, seed, rotor)
    assert holds(found.inference.values[ELASTICITY]["stiffness"], stiffness)
    assert [w for w in warnings(found, ()) if "elasticity@1 stiffness" in w and "rotor_inertia" in w]


def test_a_stiffness_is_no_surer_than_the_inertia_behind_it() -> None:
    """A resonance tells k/J: what the fit does not know of J it does not know of k."""
    found, _ = soft(600.0, 50)
    sure = found.uncertainty
    behind = found.coefficients[0] - ARMS[1][0].rotor
    k = sure.names.index("elasticity@1 stiffness")
    spread = np.sqrt(np.diagonal(sure.covariance))
    assert spread[k] / 600.0 > 0.6 * spread[0] / behind


@pytest.mark.slow
def test_intervals_of_soft_joints_hold() -> None:
    held: dict[str, list[bool]] = {"stiffness": [], "damping": []}
    for stiffness in (1500.0, 4000.0):
        for seed in range(50, 56):
            found, damping = soft(stiffness, seed)
            for name, truth in (("stiffness", stiffness), ("damping", damping)):
                held[name].append(holds(found.inference.values[ELASTICITY][name], truth))
    assert all(sum(of_one) >= 11 for of_one in held.values())


def test_an_effect_that_reads_the_arm_is_as_sure_whatever_was_predicted_before(cache: Path, tmp_path: Path) -> None:  # noqa: ARG001
    """The fit before differs by less than the data tell; divided by a small step, it is no derivative."""
    path = tmp_path / "wrist.toml"
    text = spatial_wrist.MODEL.split("[[joint]]")
    text[3] += "[joint.effects.load_friction]\n"
    path.write_text("[[joint]]".join(text), encoding="utf-8")
    model, motor = (
        Source.read(path, None).compiled.model(),
        spatial_wrist.CoupledMotor(dry=0.0, viscous=0.0, inertia=0.0),
    )
    recording = spatial_wrist.record(motor, 3, 20.0, spatial_wrist.Beside(load=0.1))
    found = fit_motion(model, prepared(model, [recording]), structure(model))
    before = replace(found.prediction, lumps=1.001 * found.prediction.lumps)
    other = Problem(model, found.motion, found.problem.layout.terms, before)
    other.weights = found.problem.weights
    place = found.problem.layout.slices[Term("load_friction", 3)].start
    spreads = [np.sqrt(replace(found, problem=p).uncertainty.covariance[place, place]) for p in (found.problem, other)]
    assert spreads[1] == pytest.approx(spreads[0], rel=0.02)
    # The plant's friction reads the rotor's share of the load, too, which the effect's law leaves out.
    assert found.coefficients[place] == pytest.approx(0.1, rel=0.05)
    assert 0 < spreads[0] < 0.03 * 0.1


def mean_ratio(equations: int) -> float:
    """Of variances over stretches to those of white noise, which they are; eight unknowns an equation."""
    rng, stretches, rows, unknowns = np.random.default_rng(4), 24, 20, 8
    ratios = []
    for _ in range(60):
        scores, true = np.zeros((stretches, equations * unknowns)), np.zeros(equations * unknowns)
        bread = np.zeros((equations * unknowns, equations * unknowns))
        for k in range(equations):
            own = slice(k * unknowns, (k + 1) * unknowns)
            x, y = rng.standard_normal((unknowns, stretches * rows)), rng.standard_normal(stretches * rows)
            residual = y - np.linalg.lstsq(x.T, y, rcond=None)[0] @ x
            scores[:, own] = (x * residual).reshape(unknowns, stretches, rows).sum(axis=2).T
            bread[own, own] = np.linalg.inv(x @ x.T)
            true[own] = np.diag(bread)[own]
        ratios.append(np.diag(bread @ over_stretches(scores, equations) @ bread) / true)
    return float(np.mean(ratios))


def test_a_variance_over_stretches_is_as_large_however_many_joints_share_them() -> None:
    """More than there is, as regressors that hang together ask, and no more where there are 48 unknowns than with 8."""
    alone = mean_ratio(1)
    assert 1.0 < alone < 1.5
    assert mean_ratio(6) == pytest.approx(alone, rel=0.05)
