"""The tasks of a session in its process: results, progress, cancelling, and a session that outlives its server."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from runtime.documents.provenance import digest
from runtime.report.signals.signal_set import SignalSet
from runtime.studio.documents import (
    EffectOffered,
    HiddenEffectAnswer,
    JointOverview,
    ReplayAnswer,
    StepOverview,
    ValuesAnswer,
    ValuesFound,
    VerdictOverview,
)
from runtime.studio.history import PlacedEffect
from runtime.studio.inputs import GivenReading
from runtime.studio.session import SessionError, StudioSession
from runtime.studio.studio import Studio
from runtime.studio.work import WorkError
from tests.runtime.studio.conftest import EVIL, SPRING, Prepared
from tests.runtime.studio.waiting import done, failed, until

pytestmark = pytest.mark.xdist_group("studio")


def shown(studio: Studio, number: int) -> JointOverview:
    """The joint of a step."""
    found = studio.answer(number, "overview", StepOverview)
    assert found is not None
    return found.joints[0]


def verdict(studio: Studio) -> VerdictOverview:
    """Of step 0."""
    found = studio.answer(0, "verdict", VerdictOverview)
    assert found is not None
    return found


def tried(studio: Studio, effect: PlacedEffect, values: dict[str, float]) -> ValuesAnswer:
    """The answer to other values."""
    studio.try_values(effect, values)
    done(studio)
    found = studio.answer(studio.history.current or 0, "tried", ValuesAnswer)
    assert found is not None
    return found


def signals(studio: Studio, name: str | None) -> SignalSet:
    path = studio.signals(name or "")
    assert path is not None
    return SignalSet.load(path)


def alive(group: int) -> bool:
    """Whether any process of a group lives."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def files(studio: Studio) -> dict[Path, int]:
    return {p: p.stat().st_mtime_ns for p in sorted(studio.session.folder.rglob("*")) if p.is_file()}


def test_the_model_as_given_is_fitted_and_shown(shared: Studio) -> None:
    assert shared.history.steps[0].title == "as given, fitted"
    joint = shown(shared, 0)
    assert (joint.called, joint.unit, joint.at_floor) == ("1", "N m", False)
    assert joint.relative > 3 * joint.relative_floor
    assert joint.held is not None
    assert joint.held_floor is not None
    assert joint.held > 3 * joint.held_floor
    first, held = (shared.recording(given) for given in shared.inputs.recordings)
    assert first is not None
    assert held is not None
    assert len(signals(shared, first.signals[0]).t) == 16_000
    assert signals(shared, joint.held_signals).title
    assert [r.given.name for r in shared.inputs.recordings] == [EVIL, "held.csv"]
    offered = shared.answer(0, "library", list[EffectOffered])
    assert offered is not None
    assert 1 in {p for e in offered if e.effect == "linear_spring" for p in e.places}


def test_the_error_in_the_history_is_that_of_the_signals_before_a_diagnosis(shared: Studio) -> None:
    shared.go_to(1)
    residual = signals(shared, "step1-joint1").lines["residual after"]
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(shown(shared, 1).rms, rel=1e-12)


def test_from_the_verdict_to_the_fallen_error_and_back(shared: Studio) -> None:
    found = verdict(shared)
    assert found.kind == shared.history.steps[0].verdict == "effect"
    assert (found.findings[0].placed, found.findings[0].shows_at) == (SPRING, 1)
    report = shared.file(0, "report.html")
    assert report is not None
    page = report.read_text()
    assert page.startswith("<!doctype html>")
    for given in (shared.inputs.model, *(r.given for r in shared.inputs.recordings)):
        assert given is not None
        assert digest(shared.session.given(given)) in page  # the hash of each file
    before, after = (s.joints[0] for s in shared.history.path(1))
    # Of 16 s the floor is known to a third.
    assert after.relative < 1.33 * after.relative_floor < before.relative / 3
    assert after.held < before.held / 3  # type: ignore[operator]
    assert "+[joint.effects.linear_spring]" in shared.difference(1, None)
    assert f"tendon add {shared.inputs.model.typed} linear_spring --joint 1" in shared.commands(1)  # type: ignore[union-attr]
    assert shared.answer(1, "verdict", VerdictOverview) is None
    shared.go_to(1)
    shared.without(SPRING)
    done(shared)
    assert shared.history.here is not None
    assert shared.history.here.title == "without linear_spring@1"
    assert shared.history.here.joints[0].relative == pytest.approx(before.relative, rel=1e-3)
    shared.undo()
    shared.undo()
    assert shared.history.current == 0
    shared.redo()
    assert StudioSession.open(shared.session.folder).history == shared.history


def test_a_cancelled_diagnosis_leaves_nothing_and_runs_to_its_end_when_it_is_begun_again(copied: Studio) -> None:
    before, found = files(copied), verdict(copied)
    copied.diagnose()
    with pytest.raises(WorkError):
        copied.diagnose()
    until(lambda: copied.work is not None and copied.work.left is not None)
    assert copied.work is not None
    assert 0 <= copied.work.share <= 1
    process = copied._work._process
    assert process is not None
    copied.cancel()
    assert copied.work.state == "cancelled"
    until(lambda: not alive(process.pid))
    assert files(copied) == before
    assert shown(copied, 0).called == "1"
    (copied.session.step(0) / "verdict.json").unlink()
    copied.diagnose()
    done(copied)
    assert verdict(copied) == found


FORKING = """
import os, sys
from runtime import progress
from runtime.studio import worker
progress._WORTH_FORKING = 0.0
os.register_at_fork(after_in_child=lambda: open(sys.argv[2], "a").write("forked"))
with progress.on_cores(2):
    worker.main(sys.argv[1])
"""


def test_a_diagnosis_forks_processes_and_runs_to_its_end(copied: Studio, tmp_path: Path) -> None:
    """Every list of parts is divided among forked processes, however short it is."""
    before, forked = verdict(copied), tmp_path / "forked"
    (copied.session.step(0) / "verdict.json").unlink()
    copied._work._command = [sys.executable, "-c", FORKING, str(copied.session.folder), str(forked)]
    copied.diagnose()
    done(copied)
    assert forked.is_file()
    assert verdict(copied) == before


SERVER = """
import signal, sys, time
from pathlib import Path
from runtime.studio.session import StudioSession
from runtime.studio.studio import Studio
studio = Studio(StudioSession.open(Path(sys.argv[1])))
studio.diagnose()
while studio.work.left is None:
    time.sleep(0.01)
print(studio._work._process.pid, flush=True)
signal.pause()
"""


def test_a_session_outlives_a_server_that_is_killed_and_the_process_does_not(copied: Studio) -> None:
    """A step folder that the server moved before it wrote the history is replaced by the next step."""
    copied.close()
    command = [sys.executable, "-c", SERVER, str(copied.session.folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        group = int(server.stdout.readline())
        assert alive(group)
        server.send_signal(signal.SIGKILL)
    until(lambda: not alive(group))
    (copied.session.step(2) / "joint1.npz").mkdir(parents=True)
    again = Studio(StudioSession.open(copied.session.folder))
    assert not again.session.scratch.exists()
    assert again.history == copied.history
    again.add(SPRING)
    done(again)
    assert shown(again, 2).relative < shown(again, 0).relative / 3
    assert signals(again, "step2-joint1").title
    again.close()


def broken(source: Path, target: Path) -> Path:
    """A recording with a gap, and with a torque of the other sign in another column."""
    head, *lines = source.read_text().splitlines()
    target.write_text("\n".join([head.replace("tau1", "M"), *lines[:9000], *lines[9400:]]) + "\n")
    return target


def test_a_broken_recording_is_said_and_its_cures_work(recorded: Path, tmp_path: Path) -> None:
    """Nothing is written outside of the session, and what was given is as it was."""
    given = {p: p.read_bytes() for p in recorded.iterdir()}
    made = Studio(StudioSession.create(tmp_path / "session"))
    made.give_model(recorded / "drive.toml")
    made.give_recording(broken(recorded / EVIL, tmp_path / "<b>broken.csv"))
    (taken,) = made.inputs.recordings
    made.read_as(taken.given.file, GivenReading(("tau1=-M",)))
    made.begin()
    done(made)
    assert made.history.steps == ()
    recording = made.recording(made.inputs.recordings[0])
    assert recording is not None
    assert "gap" in str(recording.problem)
    made.cure(next(c for c in recording.cures if c.gaps))
    made.begin()
    done(made)
    assert len(made.history.steps) == 1
    assert "--allow-gaps" in made.commands(0)[0]
    found = made.answer(0, "overview", StepOverview)
    assert found is not None
    assert found.cures[0].readings == {taken.given.file: ("tau1=M",)}
    made.cure(found.cures[0])
    made.begin()
    done(made)
    assert made.inputs.recordings[0].reading == GivenReading(("tau1=M",), allow_gaps=True)
    again = made.answer(1, "overview", StepOverview)
    assert again is not None
    assert again.cures == []
    assert [step.title for step in made.history.steps] == ["as given, fitted", "as given, fitted again"]
    made.close()
    assert {p: p.read_bytes() for p in recorded.iterdir()} == given
    assert sorted(p.name for p in tmp_path.iterdir()) == ["<b>broken.csv", "session"]


def test_nothing_is_written_outside_of_the_session(
    copied: Studio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a working folder, a home and a folder for temporary files of their own; only the cache is elsewhere."""
    for name in ("here", "home", "tmp"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setenv("MPLCONFIGDIR", os.environ.get("MPLCONFIGDIR", str(tmp_path / "copied" / "mpl")))
    copied.read_as(copied.inputs.recordings[0].given.file, GivenReading(allow_gaps=True))
    copied.begin()
    done(copied)
    copied.close()
    written = [p for name in ("here", "home", "tmp") for p in (tmp_path / name).rglob("*")]
    assert [p for p in written if p.is_file()] == []
    assert json.loads((copied.session.folder / "session.json").read_text())["schema"] == 2


def test_other_values_are_tried_and_leave_the_step_as_it_is(shared: Studio) -> None:
    friction = PlacedEffect("coulomb", 1)
    step = shared.answer(0, "overview", StepOverview)
    assert step is not None
    assert step.active[0].placed == friction
    entry = step.active[0].ranges[0]
    assert entry.value is not None
    assert 0 <= entry.low < entry.value < entry.high  # type: ignore[operator]
    count = len(shared.history.steps)
    answers = {f: tried(shared, friction, {"torque": f * entry.value}).joints[0] for f in (1.0, 1.5, 2.0)}
    # Where it is fitted the error is least, and away from there it grows as a square does.
    assert answers[1.0].rms == pytest.approx(shown(shared, 0).rms, rel=1e-9)
    grown = [answers[f].rms ** 2 - answers[1.0].rms ** 2 for f in (1.5, 2.0)]
    assert 0 < grown[0] < grown[1]
    assert grown[1] == pytest.approx(4 * grown[0], rel=0.2)
    lines = signals(shared, answers[2.0].signals).lines
    assert np.sqrt(np.mean(lines["residual after"] ** 2)) == pytest.approx(answers[2.0].rms, rel=1e-9)
    assert len(shared.history.steps) == count
    shared.try_values(friction, {"torque": -1.0})
    assert "expected 0 to inf" in failed(shared)


def test_an_answer_and_the_end_of_its_task_are_seen_together(shared: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reader during the end of a task sees the old state as a whole, and afterwards the new one as a whole."""
    arrived, taken, wanted = threading.Event(), threading.Event(), threading.Event()
    hear, lock = shared._work._hear, shared._work._lock

    def heard(process, message) -> None:
        if "result" in message:
            arrived.set()
            taken.wait()
        hear(process, message)

    class Lock:
        """That of the task; says when another thread wants it."""

        def __enter__(self) -> None:
            if taken.is_set() and threading.current_thread() is not threading.main_thread():
                wanted.set()
            lock.acquire()

        def __exit__(self, *_: object) -> None:
            lock.release()

    before = tried(shared, PlacedEffect("coulomb", 1), {"torque": 0.3})
    monkeypatch.setattr(shared._work, "_hear", heard)
    monkeypatch.setattr(shared._work, "_lock", Lock())
    shared.try_values(PlacedEffect("coulomb", 1), {"torque": 0.4})
    until(arrived.is_set)
    with shared.paused():
        taken.set()
        until(wanted.is_set)
        assert shared.work is not None
        assert shared.work.state == "running"
        assert shared.answer(0, "tried", ValuesAnswer) == before
    done(shared)
    after = shared.answer(0, "tried", ValuesAnswer)
    assert after is not None
    assert after.values["torque"] == 0.4


def test_values_of_what_was_found_are_tried_before_it_is_added(shared: Studio) -> None:
    """At the values found the error is that with the effect; with a spring of no stiffness, nearly that without it."""
    finding = verdict(shared).findings[0]
    found = {entry.name: entry.value for entry in finding.ranges}
    stiffness = found["stiffness"]
    assert stiffness == pytest.approx(3, rel=0.05)
    # The fit of the next model starts from them.
    kept = json.loads((shared.session.step(0) / "found.json").read_text())
    assert kept[0]["placed"] == {"effect": "linear_spring", "joint": 1}
    assert ValuesFound.__struct_fields__ == tuple(kept[0])
    given, count, error = shown(shared, 0).relative, len(shared.history.steps), {}
    for value in (stiffness, stiffness / 2, 1e-9):
        joint = tried(shared, finding.placed, {"stiffness": value}).joints[0]
        assert joint.fitted < given / 3
        error[value] = joint.relative
    assert error[stiffness] == pytest.approx(joint.fitted, rel=1e-9)
    assert joint.fitted < error[stiffness / 2] < error[1e-9]
    assert error[1e-9] > 0.8 * given
    lines = signals(shared, joint.signals).lines
    without = np.sqrt(np.mean(lines["residual before"] ** 2) / np.mean(lines["measured"] ** 2))
    assert without == pytest.approx(given, rel=1e-9)
    assert len(shared.history.steps) == count
    shared.try_values(PlacedEffect("lugre", 1), {})
    assert "nor does its diagnosis name it" in failed(shared)


def test_what_was_held_out_is_drawn_like_what_was_fitted(shared: Studio) -> None:
    """Before and after in the same panels."""
    for number in (0, 1):
        joint, panels = shown(shared, number), []
        for name in (joint.signals, joint.held_signals):
            kept = signals(shared, name)
            panels.append([(p.title, p.lines, [c.name for c in p.curves]) for p in kept.panels])
        assert panels[0] == panels[1]
    assert np.std(kept.lines["residual after"]) < np.std(kept.lines["residual before"]) / 3
    power = [np.trapezoid(np.square(c.y), c.x) for c in kept.panels[-1].curves]
    assert [c.name for c in kept.panels[-1].curves] == ["residual before", "residual after"]
    assert power[0] > 9 * power[1]


def test_the_share_of_the_task_that_is_done_never_falls(prepared: Prepared) -> None:
    """Nor the part that is running; all parts are known from the beginning."""
    states = [state for state in prepared.states if state.parts and state.state == "running"]
    assert {len(state.parts) for state in states} == {4}
    assert {state.at for state in states} == {0, 1, 2, 3}
    for one, next_ in itertools.pairwise(states):
        assert 0 <= one.share <= next_.share <= 1
        assert one.at <= next_.at
    assert any(0.25 < state.share < 0.5 for state in states)


def test_an_effect_is_hidden_in_the_recorded_motion(shared: Studio) -> None:
    shared.go_to(1)
    for torque, seen in ((0.5, True), (1e-4, False)):
        shared.hide(PlacedEffect("stribeck", 1), {"torque": torque, "speed": 0.1})
        done(shared)
        answer = shared.answer(1, "hidden", HiddenEffectAnswer)
        assert answer is not None
        assert answer.values == {"torque": torque, "speed": 0.1}
        assert answer.seen == seen
        assert (answer.problem is None) == seen
    shared.hide(SPRING, {})
    assert "already has this effect" in failed(shared)


def test_the_model_is_driven_by_the_recorded_torque(shared: Studio) -> None:
    shared.go_to(1)
    shared.replay()
    done(shared)
    answer = shared.answer(1, "replay", ReplayAnswer)
    assert answer is not None
    assert answer.arm is not None
    before, after = (step.joints[0].open_loop[-1].rms for step in answer.steps)
    assert before is not None
    assert after is not None
    assert after < before
    assert "as recorded, dashed" in (shared.file(1, "replay.html") or Path()).read_text(encoding="utf-8")


def test_what_fails_is_one_line(shared: Studio) -> None:
    shared.add(PlacedEffect("no_such_effect", 1))
    assert "unknown effect" in failed(shared)
    shared.add(PlacedEffect("no\nsuch <effect>", 1))
    assert "matching regex" in failed(shared)


@pytest.mark.parametrize("name", ["overview", "verdict", "tried"])
def test_a_document_of_somebody_else_is_refused_in_one_line(copied: Studio, name: str) -> None:
    kinds = {"overview": StepOverview, "verdict": VerdictOverview, "tried": ValuesAnswer}
    (copied.session.step(0) / f"{name}.json").write_text('{"sentence": "<script>"}')
    with pytest.raises(SessionError, match=rf"{name}\.json") as caught:
        copied.answer(0, name, kinds[name])
    assert "\n" not in str(caught.value)
