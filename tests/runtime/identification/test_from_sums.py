"""Identification from what a board has added up: the parameters of the recording, without its samples."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.c.c_code import F32, F64
from codegen.prepare import prepare_arm
from runtime.identification.from_sums import SumsFit, fit_sums, sums_document
from runtime.identification.identify import identify
from runtime.model.loader import Library, Model
from runtime.recordings.board_sums import BoardSums, added
from runtime.recordings.recording import Recording, RecordingError
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import simulate
from symbolic.model_file.arm import Arm
from tests.summed import board_sums, with_statistics

pytestmark = pytest.mark.xdist_group("sums")
CUTOFF = 20.0
SAME = 1e-4
"""Asked: of a parameter, between the board's floats and the recording in double precision."""


@pytest.fixture(scope="module")
def free(vishard4: Arm) -> Arm:
    """The paper's arm without plate and spring."""
    joints = tuple(
        replace(joint, effects={name: v for name, v in joint.effects.items() if name != "parallel_spring"})
        for joint in vishard4.joints
    )
    return replace(vishard4, name="free4", contact=None, joints=joints)


@pytest.fixture(scope="module")
def known(free: Arm, library: Library) -> Model:
    return Model(prepare_arm(free), library)


@pytest.fixture(scope="module")
def recording(known: Model) -> Recording:
    return simulate(known, settings=SimulationSettings(seconds=40.0))[0]


@pytest.fixture(scope="module")
def sums(free: Arm, recording: Recording) -> BoardSums:
    """The board's."""
    return board_sums(with_statistics(free, 1000.0, CUTOFF), recording, F32)


@pytest.fixture(scope="module")
def fit(known: Model, sums: BoardSums) -> SumsFit:
    return fit_sums(known, sums)


def test_floats_on_the_board_give_the_parameters_of_double_precision(
    free: Arm, known: Model, recording: Recording, fit: SumsFit
) -> None:
    exact = fit_sums(known, board_sums(with_statistics(free, 1000.0, CUTOFF), recording, F64))
    apart = np.abs(fit.coefficients - exact.coefficients) / np.abs(exact.coefficients)
    print(f"\nat most {apart.max():.1e} of a parameter")
    assert apart.max() < SAME
    assert (fit.rows == exact.rows).all()
    assert (fit.rows > 1000).all()


def test_they_are_those_that_identification_finds(known: Model, recording: Recording, fit: SumsFit) -> None:
    """With all samples, another filter and compensation for the encoders' noise: within both intervals."""
    found, document = identify(known, [recording]).inference.document(known), sums_document(known, fit)
    pairs = [(a.fit, a.interval, b.fit) for a, b in zip(document.inertial, found.inertial, strict=True)]
    for one, other in zip(document.effects, found.effects, strict=True):
        pairs += [(p.value, p.interval, other.parameters[name].value) for name, p in one.parameters.items()]
    distance = [abs(x - y) / ((between[1] - between[0]) / 2) for x, between, y in pairs]
    part = [abs(x - y) / abs(y) for x, _, y in pairs]
    print(
        f"\n{len(pairs)} parameters: median {np.median(part):.1e}, at most {np.max(distance):.2f} half intervals apart"
    )
    assert np.max(distance) < 1.5
    assert np.median(part) < 2e-3


def test_they_are_the_truth(known: Model, fit: SumsFit) -> None:
    document = sums_document(known, fit)
    outside = [p.name for p in document.inertial if not p.interval[0] <= p.model <= p.interval[1]]
    assert len(outside) <= 2


def test_halves_of_a_recording_add_up(
    free: Arm, known: Model, recording: Recording, fit: SumsFit, tmp_path: Path
) -> None:
    model, half = with_statistics(free, 1000.0, CUTOFF), len(recording.t) // 2
    files = []
    for k, part in enumerate((slice(0, half), slice(half, None))):
        cut = replace(recording, q=recording.q[:, part], tau=recording.tau[:, part], t=recording.t[part])
        files.append(replace(board_sums(model, cut, F32), path=tmp_path / f"{k}.json"))
        files[-1].write()
    both = fit_sums(known, added([BoardSums.read(file.path) for file in files]))
    assert np.abs((both.coefficients - fit.coefficients) / fit.deviations).max() < 1.0


def test_what_is_no_file_of_a_board_is_refused(known: Model, sums: BoardSums, tmp_path: Path) -> None:
    path = tmp_path / "board.json"
    replace(sums, path=path).write()
    page = json.loads(path.read_text())
    for wrong in (
        "",
        "{}",
        "[1]",
        json.dumps({**page, "sums": page["sums"][:-1]}),
        json.dumps({**page, "rows": ["a"]}),
    ):
        path.write_text(wrong)
        with pytest.raises(RecordingError, match="expected the statistics of a board"):
            BoardSums.read(path)
    with pytest.raises(RecordingError, match=r"No such file"):
        BoardSums.read(tmp_path / "missing.json")
    left = replace(sums, layout={**sums.layout, "left_out": ["lugre@1"]})
    with pytest.raises(RecordingError, match="no columns of lugre@1"):
        fit_sums(known, left)
    with pytest.raises(RecordingError, match='is of the arm "other"'):
        fit_sums(known, replace(sums, arm="other"))
    with pytest.raises(RecordingError, match="joint 2 has no row"):
        fit_sums(known, replace(sums, rows=np.array([9.0, 0.0, 9.0, 9.0])))
    with pytest.raises(RecordingError, match="of another arm or firmware"):
        added([sums, left])
