"""The folder of a session: what is in it can be opened again, whoever wrote it, and nothing gets out of it."""

from __future__ import annotations

import asyncio
import json
import shlex
from collections.abc import AsyncIterator
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from runtime.studio import studio as studios
from runtime.studio.history import History, HistoryError, JointError, PlacedEffect, SessionStep, changes
from runtime.studio.inputs import GivenFile, GivenReading, GivenRecording, Inputs
from runtime.studio.session import FILE, SessionError, StudioSession, beginning, safe_name
from runtime.studio.studio import Studio
from runtime.studio.terminal import commands
from tests import one_joint
from tests.runtime.studio.waiting import chunks

ERROR = JointError(joint=1, called="1 knee", unit="N m", rms=0.2, relative=0.06, floor=0.07, relative_floor=0.02)
MODEL = one_joint.model_text("[joint.effects.coulomb]\n[joint.effects.viscous]\n")


def step(history: History, *changed: PlacedEffect, kind: str = "added", inputs: Inputs | None = None) -> SessionStep:
    """A next step of a history."""
    made = "given" if history.current is None else kind
    return SessionStep(
        number=len(history.steps),
        parent=history.current,
        kind=made,
        inputs=inputs or Inputs(),
        changed=changed,
        joints=(ERROR,),  # type: ignore[arg-type]
    )


MOVES = st.lists(st.sampled_from(["fit", "fit", "undo", "redo", "judge"]), max_size=30)


@given(MOVES)
def test_a_history_goes_back_and_forth_and_loses_nothing(moves):
    """Held against a plain stack of undone steps, and against itself written and read."""
    history, stack, made = History(), [], 0
    for move in moves:
        if move == "fit":
            history, stack, made = history.with_steps(step(history, PlacedEffect("coulomb", 1))), [], made + 1
        elif move == "undo" and history.here is not None and history.here.parent is not None:
            stack.append(history.current)
            history = history.undo()
        elif move == "redo" and stack:
            history = history.redo()
            assert history.current == stack.pop()
        elif move == "judge" and history.current is not None:
            history = history.judged(history.current, "effect")
            assert history.here.verdict == "effect"
        assert len(history.steps) == made
        assert history.undone == tuple(s for s in stack if s is not None)
        assert msgspec.json.decode(msgspec.json.encode(history), type=History) == history
        if history.current is not None:
            way = history.path(history.current)
            assert way[0].parent is None
            assert [s.parent for s in way[1:]] == [s.number for s in way[:-1]]


def test_there_is_nothing_before_the_first_step_and_after_the_last():
    first = History().with_steps(step(History()))
    for wrong in (History().undo, first.undo, first.redo, lambda: first.at(7), lambda: first.step(-1)):
        with pytest.raises(HistoryError):
            wrong()


def test_what_was_added_and_left_out_again_is_in_no_command():
    stribeck, ripple, given = PlacedEffect("stribeck", 1), PlacedEffect("torque_ripple", 1), PlacedEffect("coulomb", 1)
    file = GivenFile("arm.toml", "arm.toml", "my arms/arm.toml")
    run = GivenRecording(GivenFile("run.csv", "run $(reboot).csv"), reading=GivenReading(("q1=-a b",)))
    inputs = Inputs(model=file, recordings=(run,))
    way = History().with_steps(step(History()))
    for effect, kind in [(stribeck, "added"), (ripple, "added"), (stribeck, "without"), (given, "without")]:
        way = way.with_steps(step(way, effect, kind=kind, inputs=inputs))
    assert changes(way.path(4)) == ([ripple], [given])
    lines = commands(way.path(4))
    assert lines[0] == "tendon improve 'my arms/arm.toml' 'run $(reboot).csv' --map 'q1=-a b' --report report"
    assert "tendon add 'my arms/arm.toml' torque_ripple --joint 1" in lines
    assert not any("stribeck" in line for line in lines)
    assert lines[-1].endswith("--write")


@given(st.text(max_size=400))
def test_a_file_of_any_name_gets_a_plain_one(name):
    made = safe_name(name)
    assert made == Path(made).name
    assert made.isascii()
    assert not made.startswith((".", "-"))
    assert 0 < len(made) <= 100
    assert all(c.isalnum() or c in "._-" for c in made)


def test_endings_are_kept_since_they_tell_a_model_from_a_robot_description():
    assert safe_name("../../etc/arm of mine.urdf") == "arm_of_mine.urdf"
    assert safe_name("C:\\logs\\run.csv.gz") == "run.csv.gz"
    assert safe_name("x" * 300 + ".csv.gz").endswith("x.csv.gz")
    assert safe_name("<img src=x onerror=alert(1)>.toml") == "img_src_x_onerror_alert_1_.toml"


@pytest.fixture
def session(tmp_path) -> StudioSession:
    return StudioSession.create(tmp_path / "session")


def test_a_session_is_made_in_a_new_folder_only(tmp_path, session):
    with pytest.raises(SessionError, match="is not empty"):
        StudioSession.create(session.folder)
    (tmp_path / "file").write_text("")
    with pytest.raises(SessionError, match="is not empty"):
        StudioSession.create(tmp_path / "file")
    with pytest.raises(SessionError, match="is no session"):
        StudioSession.open(tmp_path)


def test_what_is_written_is_read_again(session):
    file = session.place_for('a "b"\n<i>.toml')
    session.given(file).write_text(MODEL)
    reading = GivenReading(("q1=x",), allow_gaps=True)
    inputs = Inputs(model=file, like="drive", recordings=(GivenRecording(file, True, reading),))
    history = History().with_steps(step(History())).judged(0, "clean")
    state = replace(beginning(Inputs()), history=history).given(inputs)
    session.change(state)
    assert StudioSession.open(session.folder).state == state


def test_a_new_start_puts_the_steps_aside(session):
    for k in (1, 2):
        session.step(0).mkdir()
        (session.step(0) / "model.toml").write_text(f"run {k}")
        session.change(replace(beginning(Inputs()), history=History().with_steps(step(History()))))
        session.restart(Inputs())
        assert session.history == History()
        assert not session.step(0).exists()
        assert (session.folder / "earlier" / f"steps-{k}" / "0" / "model.toml").read_text() == f"run {k}"


GOOD = {
    "schema": 2,
    "inputs": {"model": None, "like": None, "recordings": [], "effects": None},
    "history": {"steps": [], "current": None, "undone": []},
}


def _file(name: object) -> dict[str, object]:
    return {"file": name, "name": "x", "origin": None}


JOINT = {"joint": 1, "called": "1", "unit": "N m", "rms": 1.0, "relative": 0.1, "floor": 0.5, "relative_floor": 0.05}
STEP = {"number": 0, "parent": None, "kind": "given", "inputs": {}, "changed": [], "joints": [], "verdict": None}


@pytest.mark.parametrize(
    ("part", "key", "value"),
    [
        ("inputs", "model", _file("../../../etc/passwd")),
        ("inputs", "model", _file("/etc/passwd")),
        ("inputs", "model", _file(".")),
        ("inputs", "model", _file("..")),
        ("inputs", "model", _file(".bashrc")),
        ("inputs", "model", _file("absent.toml")),
        ("inputs", "model", 3),
        ("inputs", "recordings", [{"given": _file("a/b"), "held_out": False}]),
        ("inputs", "recordings", [{"given": _file("a.csv"), "held_out": False}] * 101),
        ("inputs", "recordings", "abc"),
        ("inputs", "recordings", [{"given": _file("a.csv"), "reading": {"maps": "q1=a"}}]),
        ("history", "steps", [{**STEP, "inputs": {"model": _file("absent.toml")}}]),
        ("history", "steps", [{**STEP, "parent": 0}]),
        ("history", "steps", [{**STEP, "kind": "<script>"}]),
        ("history", "steps", [{**STEP, "joints": [{"os": 1}]}]),
        ("history", "steps", [{**STEP, "verdict": 1}]),
        ("history", "steps", [{**STEP, "verdict": "fine onclick"}]),
        ("history", "steps", [{**STEP, "joints": [{**JOINT, "relative": "0.1"}]}]),
        ("history", "steps", [{**STEP, "joints": [{**JOINT, "floor": None}]}]),
        ("history", "steps", [{**STEP, "joints": [{**JOINT, "joint": 1.5}]}]),
        ("history", "steps", [{**STEP, "joints": [{**JOINT, "called": ["1"]}]}]),
        ("history", "steps", [{**STEP, "changed": [{"effect": "a\nrm -rf b", "joint": 1}]}]),
        ("history", "steps", [{**STEP, "changed": [{"effect": "coulomb", "joint": "1; b"}]}]),
        ("history", "steps", [{**STEP, "changed": [{"effect": ["coulomb"], "joint": 1}]}]),
        ("history", "current", 3),
        ("history", "current", "0"),
        ("history", "undone", [1]),
    ],
)
def test_a_session_of_somebody_else_may_hold_anything(session, part, key, value):
    document = {**GOOD, part: {**GOOD[part], key: value}}
    (session.folder / FILE).write_text(json.dumps(document))
    with pytest.raises(SessionError) as caught:
        StudioSession.open(session.folder)
    assert "\n" not in str(caught.value)


KEYS = st.sampled_from([*GOOD, "model", "steps", "current"])
ANY = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner) | st.dictionaries(KEYS, inner),
    max_leaves=8,
)


@given(ANY)
def test_any_other_json_is_refused(tmp_path_factory, document):
    folder = tmp_path_factory.mktemp("any")
    (folder / FILE).write_text(json.dumps(document))
    with pytest.raises(SessionError):
        StudioSession.open(folder)


def test_no_json_and_too_much_of_it_are_refused(session, monkeypatch):
    for text in ("", "{", "[" * 100_000, '{"schema": 1}'):
        (session.folder / FILE).write_text(text)
        with pytest.raises(SessionError):
            StudioSession.open(session.folder)
    monkeypatch.setattr("runtime.studio.session.MOST_SESSION", 10)
    (session.folder / FILE).write_text(json.dumps(GOOD))
    with pytest.raises(SessionError, match="larger"):
        StudioSession.open(session.folder)


def test_effects_of_ones_own_are_code_and_never_run_unasked(session):
    (session.folder / FILE).write_text(json.dumps({**GOOD, "inputs": {**GOOD["inputs"], "effects": "/tmp/evil.py"}}))
    with pytest.raises(SessionError, match="open it with --effects"):
        Studio(StudioSession.open(session.folder))


@pytest.mark.parametrize("name", ["given", "steps", "work", "session.json", "given/model.toml", "steps/0"])
def test_no_link_leads_out_of_a_session_of_somebody_else(session, tmp_path, name):
    target = tmp_path / "elsewhere"
    target.mkdir()
    place = session.folder / name
    if place.is_dir():
        place.rmdir()
    elif place.exists():
        place = place.rename(target / "session.json") and place
    place.symlink_to(target / "session.json" if name == "session.json" else target)
    with pytest.raises(SessionError, match="is a link"):
        StudioSession.open(session.folder)


def test_a_session_is_open_in_one_studio_at_a_time(session):
    first = Studio(session)
    with pytest.raises(SessionError, match="open in another studio"):
        Studio(StudioSession.open(session.folder))
    first.close()
    Studio(StudioSession.open(session.folder)).close()


def test_a_session_is_the_users_alone(session):
    assert session.folder.stat().st_mode & 0o077 == 0


def test_no_name_of_a_file_begins_a_line_of_a_script():
    way = History().with_steps(step(History()))
    file = GivenFile("arm.toml", "arm\nrm -rf x.toml")
    inputs = Inputs(
        model=file, recordings=(GivenRecording(file), GivenRecording(file, True, GivenReading(("q1=a\nrm -rf y",))))
    )
    way = way.with_steps(step(way, PlacedEffect("coulomb", 1), kind="without", inputs=inputs))
    script = "\n".join(commands(way.path(1)))
    # What a shell makes of it: whole words, and comments.
    words = shlex.split(script, comments=True)
    assert "rm" not in words
    assert "arm\nrm -rf x.toml" in words


# --- what a browser sends ---


@pytest.fixture
def studio(session):
    made = Studio(session)
    yield made
    made.close()


def test_a_model_that_is_sent_is_read_before_it_is_taken(studio):
    asyncio.run(studio.receive("model", "<b>../arm.toml", chunks(MODEL[:40].encode(), MODEL[40:].encode())))
    given = studio.inputs.model
    assert studio.session.given(given).read_text() == MODEL
    assert (given.file, given.name) == ("arm.toml", "arm.toml")
    before = studio.inputs
    for wrong, why in [(b"\xff\xfe\x00", "arm-2.toml"), (b"name = 3", "arm-2.toml"), (b"", "arm-2.toml")]:
        with pytest.raises(SessionError, match=why):
            asyncio.run(studio.receive("model", "arm.toml", chunks(wrong)))
    assert studio.inputs == before
    assert {p.name for p in (studio.session.folder / "given").iterdir()} == {"arm.toml"}


def test_what_is_sent_is_bounded_and_leaves_nothing(studio, monkeypatch):
    monkeypatch.setattr(studios, "MOST_UPLOADED", 1000)
    with pytest.raises(SessionError, match=r'"run\.csv": is larger than'):
        asyncio.run(studio.receive("fitted", "run.csv", chunks(*[b"x" * 400] * 3)))

    async def broken() -> AsyncIterator[bytes]:
        yield b"t,q1"
        raise ConnectionResetError

    with pytest.raises(ConnectionResetError):
        asyncio.run(studio.receive("fitted", "run.csv", broken()))
    assert list((studio.session.folder / "given").iterdir()) == []
    monkeypatch.setattr(studios, "MOST_RECORDINGS", 1)
    asyncio.run(studio.receive("fitted", "run.csv", chunks(LOG)))
    with pytest.raises(SessionError, match="at most 1"):
        asyncio.run(studio.receive("fitted", "run2.csv", chunks(LOG)))
    assert [p.name for p in (studio.session.folder / "given").iterdir()] == ["run.csv"]


LOG = b"t,q1,tau1\n0,0,0\n"


def test_files_of_one_name_stand_beside_each_other(studio):
    for held_out in (False, True):
        asyncio.run(studio.receive("held_out" if held_out else "fitted", "run.csv", chunks(LOG)))
    assert [(r.given.file, r.given.name, r.held_out) for r in studio.inputs.recordings] == [
        ("run.csv", "run.csv", False),
        ("run-2.csv", "run.csv", True),
    ]
    studio.hold_out("run.csv", True)
    studio.hold_out("run-2.csv", False)
    assert [r.held_out for r in studio.inputs.recordings] == [True, False]
    studio.remove_recording("run.csv")
    assert [r.given.file for r in StudioSession.open(studio.session.folder).inputs.recordings] == ["run-2.csv"]


@pytest.mark.parametrize(
    "name",
    [
        "step0-joint1/../../x",
        "step0-joint1.npz",
        "../session",
        "step-1-joint1",
        "step0",
        "",
        "step0-held1\n",
        "given0-joint1",
    ],
)
def test_no_name_of_a_signal_set_leads_elsewhere(studio, name):
    (studio.session.folder / "x.npz").write_bytes(b"")
    assert studio.signals(name) is None


def test_a_signal_set_is_found_by_its_name(studio):
    place = studio.session.recording(GivenRecording(GivenFile("run.csv", "run.csv")))
    for folder in (studio.session.step(0), place):
        folder.mkdir(parents=True)
        (folder / "joint3.npz").write_bytes(b"")
    assert studio.signals("step0-joint3") == studio.session.step(0) / "joint3.npz"
    assert studio.signals(f"{place.name}-joint3") == place / "joint3.npz"
    assert studio.signals("step0-held3") is None


def test_a_number_of_a_step_is_one(session):
    session.change(replace(beginning(Inputs()), history=History().with_steps(step(History()))))
    made = Studio(session)
    with pytest.raises(HistoryError):
        made.model_text(1)
    made.close()
