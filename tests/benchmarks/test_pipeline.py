"""Samples per second from the file to the diagnosis; one fit against lambdify and numpy.linalg.lstsq."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from harness import best, show, sized, timed
from numpy.typing import NDArray
from numpy_reference import NumPyFit

from runtime.diagnosis import diagnose
from runtime.diagnosis.gates import rank
from runtime.identification import compare, identify
from runtime.identification.identify import Identification
from runtime.identification.problem import Problem, Skew
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.recordings import recording
from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import Recording
from runtime.simulation import simulate
from runtime.simulation.options import SimulationSettings
from symbolic.model_file import reader

Array = NDArray[np.float64]

ARMS = Path(__file__).resolve().parents[2] / "symbolic" / "arms"
SECONDS = sized(80.0, 20.0)
LONG = sized(1000.0, 40.0)
ROUNDS = sized(5, 1)


def _processor_time() -> float:
    """s that this process and those that it has forked have used."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


@pytest.mark.parametrize("name", ["drive", "vishard4"])
def test_library(name: str) -> None:
    """CPU time of one search of the whole library: a million samples of one joint, 80 s of four joints."""
    from runtime.workspace.source import Source

    model = Source.read(ARMS / f"{name}.toml", None).compiled.model()
    simulated, _ = simulate.simulate(model, settings=SimulationSettings(seconds=LONG if model.n == 1 else SECONDS))
    start = _processor_time()
    search = diagnose.begin(model, [simulated])
    fitted = _processor_time()
    rank(search.ground(), search.ground().terms(), search.steps[0].floors)
    judged = _processor_time()
    diagnose.conclude(search)
    done = _processor_time()
    parts = [
        ("band, derivatives, fit, noise floor", fitted - start),
        ("the library: shapes, refinement, gates", judged - fitted),
        ("verdict, parameter tables, detection limits", done - judged),
        ("in all", done - start),
    ]
    show(
        f"{name}: {len(simulated.t)} samples, {model.n} joint{'s' if model.n > 1 else ''}, nothing hidden",
        ("part", "CPU s"),
        [(part, f"{seconds:.2f}") for part, seconds in parts],
    )


@pytest.mark.parametrize(("name", "hidden"), [("drive", "stribeck@1"), ("vishard4", "stribeck@2")])
def test_pipeline(name: str, hidden: str, tmp_path: Path) -> None:
    """An effect is hidden in a simulated recording; every stage is timed, and the effect has to be found."""
    from runtime.workspace.source import Source

    model = Source.read(ARMS / f"{name}.toml", None).compiled.model()
    simulated, _ = simulate.simulate(model, [simulate.parse_hidden(hidden, model)], SimulationSettings(seconds=SECONDS))
    path = tmp_path / f"{name}.csv"
    recording.write(path, simulated)
    arm = RecordedArm(model.joints, model.spatial)

    data = recording.read(path, arm)
    motion = identify.prepared(model, [data])
    known = structure(model)
    identification = identify.identify_motion(model, motion, known)
    stages = [
        ("read the CSV", best(lambda: recording.read(path, arm), ROUNDS)),
        ("choose the band, smooth, differentiate", best(lambda: identify.prepared(model, [data]), ROUNDS)),
        ("identify (fit, skew, shapes, intervals)", best(lambda: _identify(model, data), ROUNDS, least=5.0)),
        ("compare (noise floor, structure of the residual)", best(lambda: _compare(identification), ROUNDS)),
    ]
    stages[2] = (stages[2][0], stages[2][1] - stages[1][1])
    stages += _diagnosis(model, data, hidden)
    count = len(data.t)
    rows = [
        (stage, f"{1e3 * s:.0f}", f"{count / s / 1e3:.0f}", f"{count * model.n / s / 1e3:.0f}", f"{SECONDS / s:.0f}")
        for stage, s in stages
    ]
    show(
        f"{name}: {model.n} joint{'s' if model.n > 1 else ''}, {SECONDS:g} s at 1 kHz, {hidden} hidden",
        ("stage", "ms", "1000 samples/s", "x joints", "times real time"),
        rows,
        [f"the model is compiled beforehand; band {motion.band.cutoff:g} Hz"],
    )
    _against_numpy(name, model, identification)


def _diagnosis(model: Model, data: Recording, hidden: str) -> list[tuple[str, float]]:
    """diagnose.diagnose in its parts, each once."""
    first, search = timed(lambda: diagnose.begin(model, [data]))
    parts = [("diagnose: first fit", first)]
    finding = True
    while finding:
        seconds, found = timed(search.advance)
        finding = found is not None
        parts.append((f"diagnose: {found.term} found, refitted" if found else "diagnose: nothing more found", seconds))
    seconds, diagnosis = timed(lambda: diagnose.conclude(search))
    parts.append(("diagnose: verdict, what would have been seen", seconds))
    assert [str(f.term) for f in diagnosis.findings] == [hidden]
    return [*parts, ("diagnose in all", sum(s for _, s in parts))]


def _identify(model: Model, data: Recording) -> Identification:
    # Prepared anew every time: a motion keeps what was computed along it.
    return identify.identify_motion(model, identify.prepared(model, [data]), structure(model))


def _compare(identification: Identification) -> object:
    joints = compare.series(identification)
    return compare.Comparison(identification, joints, compare.as_written(identification)).document().to_json()


def _error(problem: Problem, theta: Array, identification: Identification) -> float:
    """Weighted sum of squares of the residual."""
    fit, total = identification.fit, 0.0
    for i in range(problem.model.n):
        x, fixed = problem.rows(i, fit.shapes)
        residual = (problem.motion.torque(i, fit.skew) - fixed - theta @ x)[problem.motion.moving(i)]
        total += float(problem.weights[i] ** 2 * (residual @ residual))
    return total


def _against_numpy(name: str, model: Model, identification: Identification) -> None:
    """One linear fit of all rows, shapes and skew given, by the tool and as one would write it in NumPy."""
    fit, motion = identification.fit, identification.motion.with_standstill
    terms = tuple(fit.shapes)
    reference = NumPyFit(reader.load(ARMS / f"{name}.toml"), terms)
    prediction = identification.problem.regressors.prediction
    fresh = Problem(model, motion, terms, prediction)
    theta, rows = reference.fit(fresh, fit.shapes, fit.skew)
    for joint, row in enumerate(rows):
        ours = fresh.rows(joint, fit.shapes)[0]
        assert np.abs(row - ours).max() < 1e-9 * np.abs(ours).max(), f"regressors of joint {joint + 1} differ"
    # Without bounds and without compensation for noise, lstsq has the least sum of squares there is.
    assert _error(fresh, theta, identification) <= _error(fresh, fit.coefficients, identification) * (1 + 1e-9)

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
