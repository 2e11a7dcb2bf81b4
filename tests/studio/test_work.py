"""The work of a session in its process: progress, cancelling, undoing, and a session that outlives its server."""

from __future__ import annotations

import gzip
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from runtime.cli import output
from runtime.cli.main import app
from runtime.report.signals.signal_set import SignalSet
from runtime.studio.history import PlacedEffect
from runtime.studio.session import StudioSession
from runtime.studio.studio import Studio
from runtime.studio.work import WorkError
from tests import one_joint

MODEL = one_joint.model_text("[joint.effects.coulomb]\n[joint.effects.viscous]\n")
LINEAR_SPRING = PlacedEffect("linear_spring", 1)
PATIENCE = 120.0


def wait(studio: Studio) -> None:
    """Until the work under way has ended well."""
    end = time.monotonic() + PATIENCE
    while studio.work.state == "running":
        assert time.monotonic() < end
        time.sleep(0.02)
    assert studio.work.error is None
    assert studio.work.state == "done"


def failed(studio: Studio) -> str:
    """What is said once the work under way has failed: a line without the place of the session."""
    while studio.work.state == "running":
        time.sleep(0.02)
    assert studio.work.state == "failed"
    assert "\n" not in studio.work.error
    assert str(studio.session.folder) not in studio.work.error
    assert "mistake" not in studio.work.error
    return studio.work.error


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """Two recordings of a joint with a spring that the model lacks, and the model."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "drive.toml").write_text(MODEL)
    for seed, name in enumerate(("run.csv.gz", "held.csv.gz"), 1):
        hide = ["--hide", "linear_spring@1:stiffness=3,rest=0.1", "--seed", str(seed), "--seconds", "16"]
        assert output.run(app, ["simulate", str(folder / "drive.toml"), "--out", str(folder / name), *hide]) == 0
    return folder


@pytest.fixture(scope="module")
def begun(recorded, tmp_path_factory) -> Path:
    """A session whose model was fitted as given."""
    studio = Studio(StudioSession.create(tmp_path_factory.mktemp("begun") / "session"))
    studio.give_model(recorded / "drive.toml")
    studio.give_recording(recorded / "run.csv.gz")
    studio.give_recording(recorded / "held.csv.gz", held_out=True)
    studio.begin()
    wait(studio)
    studio.close()
    return studio.session.folder


@pytest.fixture
def studio(begun, tmp_path) -> Iterator[Studio]:
    """That session, opened from a copy of its folder."""
    folder = shutil.copytree(begun, tmp_path / "copied")
    made = Studio(StudioSession.open(folder))
    yield made
    made.close()


def alive(group: int) -> bool:
    """Whether any process of a group lives."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def gone(group: int, within: float) -> bool:
    """Whether the group ends in time; what has ended and is not waited for counts as there."""
    end = time.monotonic() + within
    while time.monotonic() < end:
        if not alive(group):
            return True
        time.sleep(0.02)
    return False


def test_the_model_as_given_is_fitted_and_shown(studio):
    assert [s.title for s in studio.history.steps] == ["as given, fitted"]
    joint = studio.history.here.joints[0]
    assert joint.relative > 3 * joint.relative_floor
    assert joint.held > 3 * joint.held_floor
    shown = studio.shown(0)["joints"][0]
    assert (shown["called"], shown["unit"], shown["at_floor"]) == ("1", "N m", False)
    for name, samples in ((shown["signals"], None), (shown["held"], None), ("recording1-joint1", 16_000)):
        kept = SignalSet.load(studio.signals(name))
        assert samples is None or len(kept.t) == samples
    residual = SignalSet.load(studio.signals("step0-joint1")).lines["residual"]
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(joint.rms, rel=1e-12)
    assert [r["name"] for r in studio.recordings()] == ["run.csv.gz", "held.csv.gz"]
    assert 1 in {p for e in studio.library(0) if e["effect"] == "linear_spring" for p in e["places"]}


def test_from_the_verdict_to_the_fallen_error_and_back(studio):
    studio.diagnose()
    with pytest.raises(WorkError):
        studio.diagnose()
    wait(studio)
    verdict = studio.verdict(0)
    assert verdict["kind"] == studio.history.here.verdict == "effect"
    card = verdict["findings"][0]
    assert (card["effect"], card["joint"], card["shows_at"]) == ("linear_spring", 1, 1)
    assert studio.report(0).read_text().startswith("<!doctype html>")
    studio.add(PlacedEffect(card["effect"], card["joint"]))
    wait(studio)
    before, after = (s.joints[0] for s in studio.history.path(1))
    # Of 16 s that come back once, the floor is known to a third.
    assert after.relative < 1.33 * after.relative_floor < before.relative / 3
    assert after.held < before.held / 3
    assert "+[joint.effects.linear_spring]" in studio.difference(1)
    assert f"tendon add {studio.inputs.model.typed} linear_spring --joint 1" in studio.commands(1)
    assert studio.verdict(1) is None
    studio.without(LINEAR_SPRING)
    wait(studio)
    assert studio.history.here.title == "without linear_spring@1"
    assert studio.history.here.joints[0].relative == pytest.approx(before.relative, rel=1e-3)
    studio.undo()
    studio.undo()
    assert studio.history.current == 0
    studio.redo()
    again = StudioSession.open(studio.session.folder)
    assert again.history == studio.history
    assert len(again.history.steps) == 3


def test_a_cancelled_diagnosis_leaves_nothing_and_can_be_begun_again(studio):
    before = {p: p.stat().st_mtime_ns for p in sorted(studio.session.folder.rglob("*")) if p.is_file()}
    studio.diagnose()
    end = time.monotonic() + PATIENCE
    while studio.work.left is None and time.monotonic() < end:
        time.sleep(0.01)
    assert 0 <= studio.work.share <= 1
    assert studio.work.left >= 0
    group = studio._work._process.pid
    began = time.monotonic()
    studio.cancel()
    assert time.monotonic() - began < 1
    assert studio.work.state == "cancelled"
    assert gone(group, 1)
    assert {p: p.stat().st_mtime_ns for p in sorted(studio.session.folder.rglob("*")) if p.is_file()} == before
    studio.diagnose()
    wait(studio)
    assert studio.verdict(0)["kind"] == "effect"


SERVER = """
import sys, time
from pathlib import Path
from runtime.studio.session import StudioSession
from runtime.studio.studio import Studio
studio = Studio(StudioSession.open(Path(sys.argv[1])))
studio.diagnose()
while studio.work.left is None:
    time.sleep(0.01)
print(studio._work._process.pid, flush=True)
time.sleep(600)
"""


def test_a_session_outlives_a_server_that_is_killed_and_the_process_does_not(studio):
    studio.close()
    command = [sys.executable, "-c", SERVER, str(studio.session.folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        group = int(server.stdout.readline())
        assert alive(group)
        server.send_signal(signal.SIGKILL)
    assert gone(group, 5)
    assert studio.session.scratch.parent.is_dir()
    again = Studio(StudioSession.open(studio.session.folder))
    assert not again.session.scratch.exists()
    assert again.history == studio.history
    again.add(LINEAR_SPRING)
    wait(again)
    assert again.history.here.joints[0].relative < again.history.path(1)[0].joints[0].relative / 3
    again.close()


def test_a_step_that_was_fitted_and_not_noted_is_fitted_again(studio):
    (studio.session.step(1) / "joint1.npz").mkdir(parents=True)
    studio.add(LINEAR_SPRING)
    wait(studio)
    assert studio.signals("step1-joint1").is_file()


def rewritten(source: Path, target: Path, change) -> Path:
    """A recording with other lines."""
    lines = gzip.decompress(source.read_bytes()).decode().splitlines()
    target.write_text("\n".join(change(lines)) + "\n")
    return target


def test_a_broken_recording_is_said_and_its_cure_works(recorded, tmp_path):
    holed = rewritten(recorded / "run.csv.gz", tmp_path / "<b>holed.csv", lambda x: x[:9000] + x[9400:])
    made = Studio(StudioSession.create(tmp_path / "session"))
    made.give_model(recorded / "drive.toml")
    made.give_recording(holed)
    made.begin()
    wait(made)
    assert made.history.steps == ()
    shown = made.recordings()[0]
    assert "gap" in shown["problem"]
    cure = next(c for c in shown["cures"] if c["gaps"])
    made.read_as([*made.inputs.maps, *cure["maps"]], cure["gaps"])
    made.begin()
    wait(made)
    assert len(made.history.steps) == 1
    assert "--allow-gaps" in made.commands(0)[0]
    made.close()


def test_a_torque_of_the_wrong_sign_is_said_and_its_cure_works(recorded, tmp_path):
    turned = rewritten(recorded / "run.csv.gz", tmp_path / "run.csv", lambda x: [x[0].replace("tau1", "M"), *x[1:]])
    made = Studio(StudioSession.create(tmp_path / "session"))
    made.give_model(recorded / "drive.toml")
    made.give_recording(turned)
    made.read_as(["tau1=-M"], False)
    made.begin()
    wait(made)
    cure = made.shown(0)["cures"][0]
    assert cure["maps"] == ["tau1=M"]
    made.read_as([*made.inputs.maps, *cure["maps"]], False)
    made.begin()
    wait(made)
    assert made.shown(0)["cures"] == []
    assert len(made.history.steps) == 1
    made.close()


def test_other_values_are_tried_and_leave_the_step_as_it_is(studio):
    friction = PlacedEffect("coulomb", 1)
    fitted = studio.shown(0)["active"][0]
    assert (fitted["effect"], fitted["joint"]) == ("coulomb", 1)
    torque = fitted["ranges"][0]["value"]
    assert 0 <= fitted["ranges"][0]["low"] < torque < fitted["ranges"][0]["high"]
    errors = {}
    for factor in (1.0, 1.5, 2.0):
        studio.try_values(friction, {"torque": factor * torque})
        wait(studio)
        errors[factor] = studio.tried(0)["joints"][0]["rms"]
    # Where it is fitted the error is least, and away from there it grows as a square does.
    assert errors[1.0] == pytest.approx(studio.history.here.joints[0].rms, rel=1e-9)
    grown = [errors[f] ** 2 - errors[1.0] ** 2 for f in (1.5, 2.0)]
    assert 0 < grown[0] < grown[1]
    assert grown[1] == pytest.approx(4 * grown[0], rel=0.2)
    kept = SignalSet.load(studio.signals(studio.tried(0)["joints"][0]["signals"]))
    assert np.sqrt(np.mean(kept.lines["residual after"] ** 2)) == pytest.approx(errors[2.0], rel=1e-9)
    assert len(studio.history.steps) == 1
    studio.try_values(friction, {"torque": -1.0})
    assert "expected 0 to inf" in failed(studio)


def test_an_answer_and_the_end_of_its_work_are_seen_together(studio):
    """Whoever looks while a process ends sees all of what was, for as long as it takes, and then all that is."""
    studio.try_values(PlacedEffect("coulomb", 1), {"torque": 0.4})
    with studio.unchanged():
        before = studio.tried(0)
        end = time.monotonic() + PATIENCE
        while not (studio.session.scratch / "answer" / "tried.json").is_file():
            assert time.monotonic() < end
            time.sleep(0.02)
        time.sleep(0.5)  # the process has said that it is done
        assert studio.work.state == "running"
        assert studio.tried(0) == before
    wait(studio)
    assert studio.tried(0)["values"]["torque"] == 0.4


def test_values_of_what_was_found_are_tried_before_it_is_added(studio):
    """At the values found the error is that with the effect; with a spring of no stiffness, nearly that without it."""
    studio.diagnose()
    wait(studio)
    card = studio.verdict(0)["findings"][0]
    found = {entry["name"]: entry["value"] for entry in card["ranges"]}
    assert found["stiffness"] == pytest.approx(3, rel=0.05)
    effect = PlacedEffect(card["effect"], card["joint"])
    given = studio.history.here.joints[0].relative
    left = {}
    for stiffness in (found["stiffness"], found["stiffness"] / 2, 1e-9):
        studio.try_values(effect, {"stiffness": stiffness})
        wait(studio)
        joint = studio.tried(0)["joints"][0]
        assert joint["fitted"] < given / 3
        left[stiffness] = joint["relative"]
    assert left[found["stiffness"]] == pytest.approx(joint["fitted"], rel=1e-9)
    assert joint["fitted"] < left[found["stiffness"] / 2] < left[1e-9]
    assert left[1e-9] > 0.8 * given
    lines = SignalSet.load(studio.signals(joint["signals"])).lines
    without = np.sqrt(np.mean(lines["residual before"] ** 2) / np.mean(lines["measured"] ** 2))
    assert without == pytest.approx(given, rel=1e-9)
    assert len(studio.history.steps) == 1
    studio.try_values(PlacedEffect("lugre", 1), {})
    assert "nor was it named" in failed(studio)


def test_what_was_held_out_is_drawn_like_what_was_fitted(studio):
    """Before and after in the same panels, also in a session that was opened again."""
    shown = studio.shown(0)["joints"][0]
    panels = {}
    for number in (0, 1):
        for kind in ("signals", "held"):
            kept = SignalSet.load(studio.signals(studio.shown(number)["joints"][0][kind]))
            panels[number, kind] = [(p.title, p.lines, [c.name for c in p.curves]) for p in kept.panels]
        assert panels[number, "held"] == panels[number, "signals"]
        if number == 0:
            studio.add(LINEAR_SPRING)
            wait(studio)
    kept = SignalSet.load(studio.signals(studio.shown(1)["joints"][0]["held"]))
    assert np.std(kept.lines["residual after"]) < np.std(kept.lines["residual before"]) / 3
    assert shown["held"] is not None
    power = [np.trapezoid(np.square(c.y), c.x) for c in kept.panels[-1].curves]
    assert [c.name for c in kept.panels[-1].curves] == ["residual before", "residual after"]
    assert power[0] > 9 * power[1]


def test_the_share_of_the_work_that_is_done_never_falls(studio):
    """Nor the part that is under way; all parts are known from the beginning."""
    seen = []
    studio._work._changed = lambda: seen.append(studio.work)
    studio.diagnose()
    wait(studio)
    told = [state for state in seen if state.parts and state.state == "running"]
    assert {len(state.parts) for state in told} == {4}
    assert {state.at for state in told} == {0, 1, 2, 3}
    for one, next_ in itertools.pairwise(told):
        assert 0 <= one.share <= next_.share <= 1
        assert one.at <= next_.at
    assert any(0.25 < state.share < 0.5 for state in told)


def test_an_effect_is_hidden_in_the_recorded_motion(studio):
    studio.add(LINEAR_SPRING)
    wait(studio)
    for torque, seen in ((0.5, True), (1e-4, False)):
        studio.hide(PlacedEffect("stribeck", 1), {"torque": torque, "speed": 0.1})
        wait(studio)
        answer = studio.hidden(1)
        assert answer["values"] == {"torque": torque, "speed": 0.1}
        assert answer["seen"] == seen
        assert (answer["problem"] is None) == seen
    studio.hide(PlacedEffect("linear_spring", 1), {})
    assert "has this effect already" in failed(studio)


def test_what_fails_is_one_line(studio):
    studio.add(PlacedEffect("no\nsuch <effect>", 1))
    assert "unknown effect" in failed(studio)
    studio.add(LINEAR_SPRING)
    wait(studio)


def test_nothing_is_written_outside_of_the_session(recorded, tmp_path, monkeypatch):
    """In a working folder, a home and a folder for temporary files of their own; only the cache is elsewhere."""
    for name in ("here", "home", "tmp"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setenv("MPLCONFIGDIR", os.environ.get("MPLCONFIGDIR", str(tmp_path / "session" / "mpl")))
    given = {p: p.read_bytes() for p in recorded.iterdir()}
    made = Studio(StudioSession.create(tmp_path / "session"))
    made.give_model(recorded / "drive.toml")
    made.give_recording(recorded / "run.csv.gz")
    made.begin()
    wait(made)
    made.close()
    written = [p for name in ("here", "home", "tmp") for p in (tmp_path / name).rglob("*")]
    assert [p for p in written if p.is_file()] == []
    assert {p: p.read_bytes() for p in recorded.iterdir()} == given
    assert json.loads((made.session.folder / "session.json").read_text())["schema"] == 1
