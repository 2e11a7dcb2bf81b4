"""A watched model on the board: floors from a recording, then a joint whose friction grows in the middle of a run."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from runtime import wording
from runtime.execution import execute as execution
from runtime.execution.options import ExecutionSettings
from runtime.hardware.boards import HostBoard, QemuBoard, UnicornBoard
from runtime.hardware.lockstep import Board
from runtime.hardware.settings import ControllerError
from runtime.identification.from_sums import fit_sums, sums_document
from runtime.identification.identify import identify
from runtime.recordings.board_sums import BoardSums
from runtime.workspace.source import Source
from runtime.workspace.watching import monitor_entry, propose_monitor
from tests.runtime.conftest import Run
from tests.watched_run import CHANGES, PLAIN, friction, said_of, there_and_back, with_floors

pytestmark = pytest.mark.xdist_group("watched")


@pytest.fixture(scope="module")
def watched() -> Source:
    return with_floors()


def test_the_model_file_gets_what_the_recording_shows(watched: Source) -> None:
    monitor, entry = watched.arm().monitor, monitor_entry(watched)
    assert monitor is not None
    assert entry is not None
    assert [joint.floor for joint in entry.joints] == [joint.floor for joint in monitor.joints]
    assert all(0.05 < joint.floor < 0.5 for joint in monitor.joints)
    assert all(joint.hours >= 1000 * 2 / entry.false_alarms for joint in entry.joints)
    assert "proposed: measured on" in watched.text


def test_a_recording_without_motion_gives_no_floor() -> None:
    source = Source(Path("arm.toml"), PLAIN)
    settings = ExecutionSettings(trials=1, cycles=1)
    done = execution.execute(source.compiled.model(), source.compiled.controller(), there_and_back(), settings)
    assert done.recording is not None
    with pytest.raises(ControllerError, match=r"joint 1 moves faster than .* for .* s; its floor needs 10 s of motion"):
        propose_monitor(source, source.compiled.model(), [done.recording])


def test_a_model_that_holds_is_believed(watched: Source) -> None:
    said = said_of(watched, friction(0.0), 12)
    assert [(entry.verdict, entry.signal, entry.since) for entry in said] == [("holds", "none", None)] * 2


@pytest.mark.parametrize(("more", "verdict", "soon"), [(0.2, "drifts", 6.0), (1.0, "broken", 3.0)])
def test_more_friction_is_found(watched: Source, more: float, verdict: str, soon: float) -> None:
    first, second = said_of(watched, friction(more), 12)
    assert first.verdict == "holds"
    assert (second.verdict, second.signal) == (verdict, "velocity")
    assert second.since is not None
    assert CHANGES - 2.0 < second.since < CHANGES + soon


@pytest.mark.parametrize("board", [UnicornBoard, pytest.param(partial(QemuBoard), marks=pytest.mark.slow)])
def test_the_emulated_board_says_the_same(watched: Source, board: Callable[..., Board]) -> None:
    assert said_of(watched, friction(1.0), 3, board=board, target="cortex-m4f") == said_of(watched, friction(1.0), 3)


@pytest.mark.parametrize("board", [HostBoard, pytest.param(UnicornBoard, marks=pytest.mark.slow)])
def test_what_the_board_adds_up_gives_the_parameters_of_the_recording(
    watched: Source, board: Callable[..., Board], tmp_path: Path
) -> None:
    """From its file, without a sample: of the arm that moved, within both intervals of those of the recording."""
    source = watched.with_text(watched.text.replace("[monitor]\n", "[monitor]\nstatistics = true\n"))
    model, target = source.compiled.model(), "host" if board is HostBoard else "cortex-m4f"
    settings = ExecutionSettings(trials=1, cycles=8, noise=0.01)
    done = execution.execute(model, source.compiled.controller(target), there_and_back(), settings, board=board)
    assert done.sums is not None
    assert done.recording is not None
    replace(done.sums, path=tmp_path / "sums.json").write()
    found = sums_document(model, fit_sums(model, BoardSums.read(tmp_path / "sums.json")))
    expected = identify(model, [done.recording]).inference.document(model)
    for one, other in zip(found.effects, expected.effects, strict=True):
        for name, parameter in one.parameters.items():
            assert parameter.value == pytest.approx(other.parameters[name].value, rel=0.05), (one.name, one.joint, name)
    assert min(found.rows) > 300


def test_what_the_board_added_up_is_named_with_the_command_that_reads_it(
    watched: Source, tmp_path: Path, tendon: Run
) -> None:
    (tmp_path / "arm.toml").write_text(watched.text.replace("[monitor]\n", "[monitor]\nstatistics = true\n"))
    there_and_back().write(tmp_path / "plan.json")
    run = ["execute", "arm.toml", "plan.json", "--on", "simulation", "--cycles", "8", "--trials", "1"]
    status, said, _ = tendon(*run, "--statistics", "sums.json", "--json", "run.json")
    assert status == 0
    assert "What the board added up: sums.json\n" in said
    assert json.loads((tmp_path / "run.json").read_text())["statistics"] == "sums.json"
    command = next(line for line in said.splitlines() if line.strip().startswith("tendon identify"))
    status, fitted, _ = tendon(*command.split()[1:], "--json", "fit.json")
    assert status == 0
    assert fitted.startswith("By what the board added up")
    document = json.loads((tmp_path / "fit.json").read_text())
    for joint, (rows, rms) in enumerate(zip(document["rows"], document["rms"], strict=True), 1):
        assert re.search(rf"^ {joint} +{wording.number(rms)} +{rows} *$", fitted, re.MULTILINE)


@pytest.mark.parametrize(("hide", "missed"), [([], []), (["--hide", "coulomb@2:torque=0.4"], [2])])
def test_a_recording_that_the_model_misses_is_said(
    hide: list[str], missed: list[int], tmp_path: Path, tendon: Run
) -> None:
    """With the file's values: fitted again, they would take up friction that has grown."""
    (tmp_path / "arm.toml").write_text(PLAIN)
    there_and_back().write(tmp_path / "plan.json")
    run = ["execute", "arm.toml", "plan.json", "--on", "simulation", "--cycles", "8", "--out", "run.csv"]
    assert tendon(*run, *hide)[0] == 0
    built = ["firmware", "arm.toml", "--monitor", "run.csv", "--target", "host", "--json", "built.json"]
    status, said, _ = tendon(*built)
    assert status == 0
    found = json.loads((tmp_path / "built.json").read_text())["missed"]
    assert [(entry["joint"], entry["rms"] > 0.3) for entry in found] == [(joint, True) for joint in missed]
    assert [int(joint) for joint in re.findall(r"joint (\d): the model file's values leave", said)] == missed
    assert "With statistics = true under [monitor] the board also" in said


def test_nothing_is_written_for_a_target_that_does_not_exist(watched: Source, tmp_path: Path, tendon: Run) -> None:
    (tmp_path / "arm.toml").write_text(watched.text)
    (tmp_path / "run.csv").write_text("t [s],q1,tau1\n")
    status, _, said = tendon("firmware", "arm.toml", "--monitor", "run.csv", "--target", "avr")
    assert status == 2
    assert "there are cortex-m4f" in said
    assert (tmp_path / "arm.toml").read_text() == watched.text
    status, _, said = tendon("identify", "arm.toml", "--statistics", "run.csv", "--output-error")
    assert status == 2
    assert "--statistics has no samples" in said
