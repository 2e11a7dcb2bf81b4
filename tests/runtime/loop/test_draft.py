"""Physics that no library has: a guess is written, loaded, named, and the error falls; or it is said why not."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from guides import blocks

from runtime.diagnosis import grammar_search
from runtime.diagnosis.stages import begin
from runtime.diagnosis.steps import errors_elsewhere
from runtime.model.terms import Term
from runtime.motion.motion import prepare
from runtime.recordings import recording
from runtime.workspace.source import Source
from symbolic.effects import load_user_effects
from symbolic.effects.source import BANNER
from tests import bank
from tests.judge import cases as judging
from tests.runtime.conftest import ROOT

Run = Callable[..., tuple[int, dict, str]]


OWN = f"{BANNER}\n" + next(
    block.text for block in blocks(ROOT / "runtime" / "guides" / "own_effect.md") if block.file == "drag.py"
)
"""The guide's example of a user's own effects, which all calls here load: guesses come beside them."""


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with the drive's model and a user's own effects to work in; diagnoses come from the bank."""
    bank.KeptVerbs(monkeypatch)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drive.toml").write_text((ROOT / "symbolic" / "arms" / "drive.toml").read_text())
    (tmp_path / "mine.py").write_text(OWN)
    return tmp_path


@pytest.fixture
def run(here, tendon) -> Run:  # noqa: ARG001
    """Status, the JSON of standard output (empty if there is none), standard error."""

    def called(*arguments: object) -> tuple[int, dict, str]:
        status, out, err = tendon(*arguments)
        return status, json.loads(out) if out.startswith("{") else {}, err

    return called


def test_from_an_unknown_to_its_guess_to_a_better_model(here, run):
    recording.write(Path("run.csv.gz"), bank.recording("friction wave"))
    Path("guess.py").write_text(f"{BANNER}\nEFFECTS = ()\n")  # an earlier guess, and no loss
    call = ["diagnose", "drive.toml", "run.csv.gz", "--json", "-", "--effects"]
    status, said, _ = run(*call, "mine.py", "--draft", "guess.py")
    assert (status, said["verdict"]) == (1, "unexplained")
    guess = said["draft"]
    assert (guess["effect"], guess["joint"], guess["file"]) == ("draft_dry_wave", 1, "guess.py")
    assert guess["share"] > 0.9
    # The plant's wave has 20 rad^-1.
    assert guess["parameters"]["wavelength"]["value"] == pytest.approx(2 * 3.14159 / 20, rel=0.01)
    assert said["joints"][0]["structure"][0]["signal"] == "position"
    text = Path("guess.py").read_text()
    assert text.startswith(BANNER)
    assert "drive.toml, on run.csv.gz" in text
    assert str(here) not in text
    assert [e.name for e in load_user_effects(Path("guess.py"))] == ["drag", "draft_dry_wave"]

    status, named, _ = run(*call, "guess.py", "--draft", "needless.py")
    assert "an effect of the library explains the residual" in named["draft_reason"]
    (finding,) = named["findings"]
    assert (status, finding["effect"], finding["rivals"]) == (0, "draft_dry_wave", [])
    assert finding["rms_after"] == pytest.approx(guess["rms_after"], rel=0.01)
    assert finding["rms_after"] < 1.1 * named["joints"][0]["floor"] < 0.6 * finding["rms_before"]

    add = guess["next"][1].split()
    assert add[:4] == ["tendon", "add", "drive.toml", "draft_dry_wave"]
    assert run(*add[1:])[0] == 0
    recording.write(Path("run.csv.gz"), bank.recording("friction wave again"))
    status, left, _ = run(*call, "guess.py", "--draft", "needless.py")
    assert (status, left["verdict"], left["draft"]) == (0, "clean", None)
    assert "the residual is noise" in left["draft_reason"]
    assert not Path("needless.py").exists()


def test_a_disturbance_from_outside_gets_no_guess(run):
    recording.write(Path("run.csv.gz"), bank.recording("disturbance"))
    call = ["diagnose", "drive.toml", "run.csv.gz", "--effects", "mine.py", "--draft", "guess.py", "--json", "-"]
    status, said, _ = run(*call)
    assert (status, said["verdict"], said["draft"]) == (1, "unexplained", None)
    assert "no term of the model's signals explains the residual" in said["draft_reason"]
    assert not Path("guess.py").exists()


def test_files_of_others_are_not_overwritten(here, run):
    call = ["diagnose", "drive.toml", "absent.csv", "--effects", "mine.py", "--draft"]
    Path("notes.txt").write_text("mine")
    assert run(*call, "notes.txt") == (2, {}, "notes.txt: already exists and is not a draft; choose another name\n")
    assert run(*call, "mine.py")[2] == "mine.py: is read here; choose another name to write to\n"
    assert run(*call, here)[2] == f"{here}: is a directory; expected a file to write\n"


@pytest.mark.slow
def test_a_neighbours_motion_is_guessed_at_the_joint_that_feels_it(tmp_path):
    """Drag between two joints, by the plant that judges the diagnosis; and on a recording that was not fitted."""
    (case,) = judging.cases(["drag_across"], [2], [1.5], [4], judging.Setting())
    made = judging.make(case)
    path = tmp_path / "arm.toml"
    path.write_text(made.model)
    (tmp_path / "mine.py").write_text(OWN)
    source = Source.read(path, tmp_path / "mine.py")
    wider = source.compiled.with_guesses()
    step = begin(source.compiled.model(), [made.recording], [made.held_out]).steps[-1]
    joint = made.joints[0] or 1
    found = grammar_search.best(step, wider.model(), wider.library.keys() - source.compiled.library.keys(), range(2))
    assert found is not None
    assert found.term == Term("draft_next_viscous" if joint == 1 else "draft_previous_viscous", joint)
    assert found.step.share() > 0.85
    after = found.step.fit
    held_out = prepare([made.held_out], after.motion.band, after.model)
    assert errors_elsewhere(after, held_out).rms[joint - 1] < 1.15 * step.joints[joint - 1].floor.value
