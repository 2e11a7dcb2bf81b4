"""One linear fit, shapes and skew given: by the tool, and as one would write it with lambdify and lstsq in NumPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from harness import best, show, sized
from numpy_reference import NumPyFit, stacked

from runtime.identification import identify
from runtime.identification.fitting import fit_motion
from runtime.identification.problem import Problem, Skew
from runtime.model.terms import structure
from runtime.simulation import simulate
from runtime.simulation.options import SimulationSettings
from runtime.workspace.source import Source
from symbolic.model_file import reader

ARMS = Path(__file__).resolve().parents[2] / "symbolic" / "arms"
SECONDS = sized(80.0, 20.0)
ROUNDS = sized(5, 1)


@pytest.mark.parametrize(("name", "hidden"), [("drive", "stribeck@1"), ("vishard4", "stribeck@2")])
def test_linear_fit(name: str, hidden: str) -> None:
    """Equal regressors, and no larger an error than NumPy's solution has; an effect that the model lacks is hidden."""
    model = Source.shipped(name).compiled.model()
    data, _ = simulate.simulate(model, [simulate.parse_hidden(hidden, model)], SimulationSettings(seconds=SECONDS))
    fit = fit_motion(model, identify.prepared(model, [data]), structure(model))
    motion = fit.motion.with_standstill
    terms = tuple(fit.shapes)
    reference = NumPyFit(reader.load(ARMS / f"{name}.toml"), terms)
    prediction = fit.problem.regressors.prediction
    fresh = Problem(model, motion, terms, prediction)
    theta, rows = reference.fit(fresh, fit.shapes, fit.skew)
    for joint, row in enumerate(rows):
        ours = fresh.rows(joint, fit.shapes)[0]
        assert np.abs(row - ours).max() < 1e-9 * np.abs(ours).max(), f"regressors of joint {joint + 1} differ"
    # Without bounds and without compensation for noise, lstsq has the least sum of squares there is.
    columns, torque = stacked(fresh, fit.shapes, fit.skew)
    theirs, ours = (float(np.sum((torque - columns @ x) ** 2)) for x in (theta, fit.coefficients))
    assert theirs <= ours * (1 + 1e-9)

    piece = motion.pieces[0]
    count = len(piece.t)
    signals = {t: fresh.regressors.signals(0)[0].of(t, (t.joint or 1) - 1) for t in terms}

    def our_columns() -> None:
        for t in terms:
            model.library.columns(t.effect, signals[t], fit.shapes[t], piece.dt)

    def their_columns() -> None:
        for t in terms:
            reference.columns(t, fit.shapes[t], signals[t], count)

    def our_fit() -> None:
        # A new problem computes every regressor anew; the second realisation of the noise included.
        Problem(model, motion, terms, prediction).solve(fit.shapes, Skew(fit.skew))

    pairs = [
        (
            f"rigid regressor ({model.n} x {len(model.lumps)})",
            best(lambda: model.regressor(piece.q, piece.qd, piece.qdd), ROUNDS),
            best(lambda: reference.rigid(piece), ROUNDS),
        ),
        (f"columns of {len(terms)} effects", best(our_columns, ROUNDS), best(their_columns, ROUNDS)),
        (
            "the whole fit, compensated for noise",
            best(our_fit, ROUNDS),
            best(lambda: reference.fit(fresh, fit.shapes, fit.skew), ROUNDS),
        ),
    ]
    show(
        f"{name}: one linear fit of {fresh.layout.size} unknowns against lambdify + numpy.linalg.lstsq",
        ("part", "ours, ms", "NumPy, ms", "ratio"),
        [(part, f"{1e3 * a:.1f}", f"{1e3 * b:.1f}", f"{b / a:.1f}") for part, a, b in pairs],
        [
            "regressors equal to 1e-9; ours evaluates them twice, to take the encoder's noise out;",
            "NumPy's has our filter, and our signals for nothing",
        ],
    )
