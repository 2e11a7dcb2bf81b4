"""Other inputs in a session that has steps: nothing is lost, and undo takes a change back; readings of recordings."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from runtime.studio.history import History, HistoryError
from runtime.studio.inputs import GivenReading
from runtime.studio.session import SessionError, StudioSession
from runtime.studio.studio import Studio
from tests.runtime.studio.conftest import EVIL, SPRING
from tests.runtime.studio.waiting import chunks, done

pytestmark = pytest.mark.xdist_group("studio")

LAB = ("t=Time_ms [ms]", "q1=Pos", "tau1=-M")
"""How the log of `lab_log` is read."""


def lab_log(recorded: Path, place: Path) -> Path:
    """A recording with names of its own, time in ms, and the torque of the other sign."""
    head, *lines = (recorded / EVIL).read_text().splitlines()
    assert [cell.split(" [")[0] for cell in head.split(",")][:3] == ["t", "q1", "tau1"]
    rows = [[float(cell) for cell in line.split(",")] for line in lines]
    texts = [f"{1000 * row[0]:.6g};{row[1]!r};{-row[2]!r}" for row in rows]
    place.write_text("\n".join(["Time_ms;Pos;M", *texts]) + "\n")
    return place


def sent(studio: Studio, path: Path, role: str = "fitted") -> None:
    """A file as a browser sends it."""
    asyncio.run(studio.receive(role, path.name, chunks(path.read_bytes())))


@pytest.fixture
def new(tmp_path: Path, recorded: Path) -> Iterator[Studio]:
    """A session with the model alone."""
    made = Studio(StudioSession.create(tmp_path / "new"))
    made.give_model(recorded / "drive.toml")
    yield made
    made.close()


def test_a_mapping_belongs_to_its_recording(new: Studio, recorded: Path, tmp_path: Path) -> None:
    """A log that needs one and a log that needs none are fitted together, also when the session is opened again."""
    sent(new, lab_log(recorded, tmp_path / "lab.csv"))
    (lab,) = new.inputs.recordings
    first = new.recording(lab)
    assert first is not None
    assert "no column t" in str(first.problem)
    assert first.guesses == {"t": "Time_ms [ms]", "q1": "Pos"}
    new.read_as(lab.given.file, GivenReading(LAB))
    sent(new, recorded / "held.csv")
    new.begin()
    done(new)
    assert [r.reading.maps for r in new.inputs.recordings] == [LAB, ()]
    assert [getattr(new.recording(r), "problem", "") for r in new.inputs.recordings] == [None, None]
    assert new.history.here is not None
    assert new.history.here.title == "as given, fitted"
    script = "\n".join(new.commands(0))
    assert "read in different ways" in script
    assert all(line.startswith("#") for line in script.splitlines() if "--map" in line)
    new.close()
    again = Studio(StudioSession.open(new.session.folder))
    assert [r.reading.maps for r in again.inputs.recordings] == [LAB, ()]
    again.read_as(lab.given.file, GivenReading())
    removed = again.recording(again.inputs.recordings[0])
    assert removed is not None
    assert "no column t" in str(removed.problem)
    again.undo()
    assert again.state.fitted
    again.close()


def test_the_sign_of_a_torque_is_guessed_from_its_work(new: Studio, recorded: Path, tmp_path: Path) -> None:
    """A torque that brakes the motion on average has the other sign; and a column of rates may have another unit."""
    rows = [[float(cell) for cell in line.split(",")] for line in (recorded / EVIL).read_text().splitlines()[1:]]
    rates = np.gradient([row[1] for row in rows], 1e-3)
    log = tmp_path / "turned.csv"
    texts = [f"{r[0]},{r[1]},{np.degrees(rate)},{-r[2]}" for r, rate in zip(rows, rates, strict=True)]
    log.write_text("\n".join(["time,position,velocity,torque", *texts]) + "\n")
    sent(new, log)
    found = new.recording(new.inputs.recordings[0])
    assert found is not None
    assert found.guesses == {"t": "time", "q1": "position", "qd1": "velocity [deg/s]", "tau1": "-torque"}


def test_a_cure_is_of_its_recording_and_takes_the_place_of_an_earlier_one(
    new: Studio, recorded: Path, tmp_path: Path
) -> None:
    """Pressed twice it is there once, and the recording beside it is read as before."""
    sent(new, lab_log(recorded, tmp_path / "lab.csv"))
    new.read_as("lab.csv", GivenReading(("t=Time_ms [ms]", "q1=Pos", "tau1=M")))
    sent(new, recorded / "held.csv", "held_out")
    new.begin()
    done(new)
    lab, held = new.inputs.recordings
    found = new.recording(lab)
    assert found is not None
    cure = next(c for c in found.cures if c.does == "Read tau1 with the opposite sign")
    for _ in range(2):
        new.cure(cure)
    lab, held = new.inputs.recordings
    assert lab.reading == GivenReading(LAB)
    assert held.reading == GivenReading()


def test_entries_that_contradict_each_other_can_be_removed(new: Studio, recorded: Path) -> None:
    """A session that somebody has written by hand."""
    sent(new, recorded / "held.csv")
    new.read_as("held.csv", GivenReading(("q1=q1", "q1=tau1")))
    new.begin()
    done(new)
    shown = new.recording(new.inputs.recordings[0])
    assert shown is not None
    assert shown.problem == "q1: given twice"
    assert shown.guesses["q1"] == "q1"
    assert new.history.steps == ()
    new.read_as("held.csv", GivenReading())
    new.begin()
    done(new)
    assert len(new.history.steps) == 1


def test_a_current_is_a_torque_once_the_motor_is_known(new: Studio, recorded: Path, tmp_path: Path) -> None:
    """The constant goes into the copy of the model file; the given one stays as it is."""
    given = (recorded / "drive.toml").read_text()
    rows = [line.split(",") for line in (recorded / EVIL).read_text().splitlines()[1:]]
    log = tmp_path / "currents.csv"
    log.write_text("\n".join(["t,q1,Iq [mA]", *(f"{r[0]},{r[1]},{float(r[2]) * 1000 / 8}" for r in rows)]) + "\n")
    sent(new, log)
    (taken,) = new.inputs.recordings
    found = new.recording(taken)
    assert found is not None
    assert (found.guesses["tau1"], found.ratios) == ("Iq", {1: 100})
    new.read_as(taken.given.file, GivenReading(("tau1=Iq",)))
    with pytest.raises(SessionError, match=r"^drive\.toml"):
        new.state_torque_constants({1: -8.0})
    new.state_torque_constants({1: 8.0})
    new.begin()
    done(new)
    assert new.history.here is not None
    assert new.history.here.joints[0].rms == pytest.approx(0.4, rel=0.5)
    assert "torque_constant = 8" in new.model_text(0)
    assert (recorded / "drive.toml").read_text() == given
    assert '# set torque_constant = 8 in joint 1 of "' in "\n".join(new.commands(0))
    new.close()
    assert StudioSession.open(new.session.folder).inputs.constants == {1: 8.0}


def test_another_recording_keeps_the_steps_and_they_are_fitted_again(copied: Studio, recorded: Path) -> None:
    copied.go_to(1)
    before, inputs = copied.history, copied.inputs
    sent(copied, recorded / "held.csv")
    copied.remove_recording("held.csv")
    assert copied.history == before
    changed = [(r.given.file, r.held_out) for r in copied.inputs.recordings[1:]]
    assert changed == [("held-2.csv", False)]
    with pytest.raises(HistoryError, match="fit the steps again, or undo"):
        copied.diagnose()
    copied.undo()
    assert len(copied.inputs.recordings) == 3
    copied.undo()
    assert copied.inputs == inputs
    assert copied.state.fitted
    for _ in range(2):
        copied.redo()
    assert [(r.given.file, r.held_out) for r in copied.inputs.recordings[1:]] == changed
    assert StudioSession.open(copied.session.folder).state == copied.state
    copied.begin()
    done(copied)
    titles = ["as given, fitted", "+ linear_spring@1", "as given, fitted again", "+ linear_spring@1"]
    assert [step.title for step in copied.history.steps] == titles
    assert copied.history.steps[:2] == before.steps
    given, here = copied.history.path(3)
    assert (given.number, given.parent) == (2, 1)
    assert here.joints[0].relative < given.joints[0].relative / 3
    assert here.changed == (SPRING,)
    for number in (2, 1):
        copied.undo()
        assert copied.history.current == number
    assert copied.inputs == inputs
    copied.redo()
    assert [(r.given.file, r.held_out) for r in copied.inputs.recordings[1:]] == changed


def test_another_model_keeps_the_steps_and_takes_their_changes(copied: Studio, recorded: Path, tmp_path: Path) -> None:
    """As far as it can: what the model has already is not added again."""
    copied.go_to(1)
    text = (recorded / "drive.toml").read_text()
    for k, other in enumerate((text.replace("mass = 2.0", "mass = 2.1"), f"{text}[joint.effects.linear_spring]\n")):
        (tmp_path / "other.toml").write_text(other)
        sent(copied, tmp_path / "other.toml", "model")
        assert not copied.state.fitted
        copied.begin()
        done(copied)
        assert [s.title for s in copied.history.steps[2:]] == [
            ["as given, fitted again", "+ linear_spring@1"],
            ["as given, fitted again"],
        ][k]
        copied.go_to(1)
        copied.session.change(replace(copied.state, history=History(copied.history.steps[:2], 1)))


def test_the_demo_starts_fresh(new: Studio, recorded: Path, tmp_path: Path) -> None:
    """Whatever was given before; and a file of the same name stays what it was."""
    log = lab_log(recorded, tmp_path / "fitted.csv.gz")
    sent(new, log)
    new.read_as("fitted.csv.gz", GivenReading(LAB))
    new.start_demo()
    assert [r.reading for r in new.inputs.recordings] == [GivenReading(), GivenReading()]
    assert [r.held_out for r in new.inputs.recordings] == [False, True]
    assert new.inputs.like == "drive"
    assert (new.session.folder / "given" / "fitted.csv.gz").read_bytes() == log.read_bytes()
    new.read()
    done(new)
    assert [getattr(new.recording(r), "problem", "") for r in new.inputs.recordings] == [None, None]
