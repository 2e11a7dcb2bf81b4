"""`import tendon`: the verbs in a notebook say what the command line says."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from runtime.cli import output
from runtime.cli.main import app

tendon = pytest.importorskip("tendon", reason="the package is not installed (pip install -e .)")
ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model file and two recordings of a drive with hidden Stribeck friction, one to judge by."""
    folder = tmp_path_factory.mktemp("notebook")
    drive = tendon.load("drive")
    drive.save(folder / "drive.toml")
    for seed in (1, 2):
        tendon.simulate(drive, "stribeck@1:torque=0.6,speed=0.12", seed=seed, seconds=20).save(
            folder / f"run{seed}.csv"
        )
    return folder


@pytest.fixture(scope="module")
def improved(folder: Path):
    arm = tendon.load(folder / "drive.toml")
    return tendon.improve(arm, folder / "run1.csv", held_out=folder / "run2.csv")


def test_it_is_typed_and_says_what_it_has() -> None:
    assert (ROOT / "runtime" / "import_name" / "tendon" / "py.typed").exists()
    assert {"load", "recording", "diagnose", "improve", "simulate", "optimize"} <= set(tendon.__all__)
    assert all(getattr(tendon, name).__doc__ for name in tendon.__all__)


def test_a_loaded_arm_evaluates_and_says_what_it_is(folder: Path) -> None:
    arm = tendon.load(folder / "drive.toml")
    assert repr(arm).splitlines()[0] == "drive: 1 joint (revolute)"
    assert arm.model.inverse_dynamics([0.0], [0.0], [1.0]).shape == (1,)


def test_a_recording_reads_without_an_arm_and_with_it(folder: Path) -> None:
    alone = tendon.recording(folder / "run1.csv")
    with_arm = tendon.recording(folder / "run1.csv", tendon.load("drive"))
    assert (alone.q == with_arm.q).all()
    assert repr(alone).endswith("run1.csv: 1 joint, 20000 samples, 20 s at 1000 Hz")


def test_the_loop_lowers_the_error_and_can_be_saved(improved, folder: Path) -> None:
    steps = improved.json["history"]
    assert [step["added"] for step in steps] == [None, "stribeck@1"]
    assert steps[1]["held_out_relative"][0] < 0.5 * steps[0]["held_out_relative"][0]
    improved.save(folder / "better.toml")
    document = tomllib.loads((folder / "better.toml").read_text())
    assert document["joint"][0]["effects"]["stribeck"]["torque"] == pytest.approx(0.6, abs=0.06)
    assert "stribeck@1" in repr(improved.arm)
    assert 2 <= len(repr(improved).splitlines()) <= 12


def test_a_diagnosis_is_that_of_the_command_line(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(folder)
    result = tendon.diagnose(tendon.load("drive.toml"), "run1.csv")
    assert output.run(app, ["diagnose", "drive.toml", "run1.csv", "--json", "d.json"]) == 0
    said = capsys.readouterr().out
    document, own = json.loads((folder / "d.json").read_text()), result.to_dict()
    typed, made = document.pop("provenance"), own.pop("provenance")
    assert document == own
    assert (typed["recordings"], typed["model"], made["command"]) == (made["recordings"], made["model"], None)
    result.show()
    assert capsys.readouterr().out == said
    assert result.verdict == "effect"
    assert repr(result).startswith("EFFECT: The model lacks stribeck at joint 1")


def test_figures_draw_themselves(improved, tmp_path: Path) -> None:
    assert len(improved.figures) > 3
    drawn = improved.figures._repr_html_()
    assert drawn.count("<svg") == len(improved.figures)
    assert "var(--" not in drawn
    improved.figures[0].save(tmp_path / "error.png")
    assert (tmp_path / "error.png").read_bytes().startswith(b"\x89PNG")
    assert improved.report(tmp_path / "page").exists()


def test_a_plan(tmp_path: Path) -> None:
    plan = tendon.optimize(ROOT / "runtime" / "study" / "scenario1.toml", friction=False, springs=False)
    assert plan.json["feasible"]
    plan.save(tmp_path / "plan.json")
    assert json.loads((tmp_path / "plan.json").read_text())["phases"]
    assert repr(plan).startswith("scenario1 in 1.2 s, without friction: ")
    assert len(plan.figures) == 1


def test_errors_are_the_lines_of_the_command_line(folder: Path) -> None:
    with pytest.raises(tendon.RecordingError, match="no such file; expected a recording"):
        tendon.recording(folder / "nothing.csv")
    with pytest.raises(ValueError, match='"drives" is no model file here and no arm of Tendon'):
        tendon.load("drives")
    with pytest.raises(tendon.ModelError, match='unknown effect "stribek"; did you mean "stribeck"'):
        tendon.add(tendon.load("drive"), "stribek", 1)


def test_what_is_not_needed_is_not_imported() -> None:
    """Models that are in the cache need no SymPy, and neither their functions nor a diagnosis CasADi or Matplotlib."""
    tendon.load("drive").mass_matrix([0.0])
    script = (
        "import tendon, sys\ntendon.load('drive').mass_matrix([0.0])\n"
        "print([m for m in ('sympy', 'casadi', 'matplotlib', 'pandas') if m in sys.modules])\n"
        "tendon.diagnose\nprint([m for m in ('sympy', 'casadi', 'matplotlib') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.split("\n") == ["[]", "[]", ""]


def test_every_public_name_is_there() -> None:
    assert {*tendon.__all__, "__version__"} == set(dir(tendon))
    assert all(
        getattr(tendon, name).__module__.split(".")[0] in ("runtime", "symbolic", "codegen", "tendon")
        for name in tendon.__all__
    )
    with pytest.raises(AttributeError, match="has no attribute 'diagnoze'"):
        _ = tendon.diagnoze
    errors = [getattr(tendon, name) for name in tendon.__all__ if name.endswith("Error")]
    assert [e.__name__ for e in errors if not issubclass(e, ValueError)] == ["BuildError", "LinkError"]


def test_a_result_has_its_figures_as_attributes_and_as_a_dict(improved) -> None:
    found, document = improved.added[0], improved.to_dict()
    assert (found.effect, found.joint) == ("stribeck", 1)
    assert found.parameters["torque"].value == pytest.approx(0.6, abs=0.06)
    low, high = found.parameters["torque"].interval
    assert low < found.parameters["torque"].value < high
    before, after = improved.history
    assert (found.error_before, found.error_after) == (before.relative[0], after.relative[0])
    assert found.held_out_error_before == before.held_out_relative[0]
    assert found.held_out_error_after == after.held_out_relative[0]
    assert document["history"][1]["finding"]["error_after"] == found.error_after
    assert json.loads(json.dumps(document)) == document == improved.json
    assert improved.verdict == document["verdict"]
    assert repr(found).startswith("<stribeck@1: error 0.0")


def test_a_notebook_shows_a_result_as_text_with_everything_folded(improved) -> None:
    shown = improved._repr_html_()
    assert "<p><b>EFFECT: Stribeck explains " in shown
    assert shown.index("<details>") < shown.index("<table") < shown.index("</details>")
    assert "<script" not in shown


def test_a_replay_says_how_far_the_motion_is_off(folder: Path, improved: tendon.ImprovementResult) -> None:
    run = folder / "run2.csv"
    before, after = (tendon.replay(arm, run, fit=folder / "run1.csv") for arm in (tendon.load("drive"), improved.arm))
    assert isinstance(after, tendon.ReplayResult)
    errors = [result.joints[0].closed_loop.rms for result in (before, after)]  # type: ignore[union-attr]
    assert errors[1] < 0.3 * errors[0]  # type: ignore[operator]
    assert "after 1 s in open loop, error of the joint" in repr(after)
    assert after.report(folder / "replayed").is_file()
