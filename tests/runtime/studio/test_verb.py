"""The verb: what it opens, and what it refuses in one line before anything is made."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from runtime.studio import server
from runtime.studio.session import StudioSession
from runtime.studio.studio import Studio
from tests import one_joint

MODEL = one_joint.model_text("[joint.effects.coulomb]\n[joint.effects.viscous]\n")


@pytest.fixture
def here(here, monkeypatch):
    """An empty folder with a model, where nothing is served: what would be is kept in `served`."""
    (here / "arm.toml").write_text(MODEL)
    monkeypatch.setattr(server, "needed", lambda: None)
    return here


@pytest.fixture
def served(monkeypatch):
    """The studios that were opened."""
    found = []

    def serve(studio, listening, _say, browser) -> None:
        found.append((studio, listening.getsockname()[1], browser))
        studio.close()

    monkeypatch.setattr(server, "serve", serve)
    return found


def test_a_new_session_is_made_each_time_and_opened_again(here, served, tendon):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        wanted = free.getsockname()[1]
    for name in ("studio-session", "studio-session-2"):
        status, out, _ = tendon("studio", "arm.toml", "--port", wanted, "--no-browser")
        assert (status, out) == (0, f"Session: {here / name}\n")
        studio, port, browser = served[-1]
        assert (studio.session.folder, port, browser) == (here / name, wanted, False)
        assert studio.inputs.model.typed == "arm.toml"
    assert tendon("studio", "studio-session")[0] == 0
    assert served[-1][0].session.folder == here / "studio-session"
    assert served[-1][0].inputs.model.typed == "arm.toml"
    assert sorted(p.name for p in here.iterdir()) == ["arm.toml", "studio-session", "studio-session-2"]


def test_an_arm_of_tendon_and_a_robot_description(here, served, tendon):
    urdf = """<robot name="bench"><link name="base"/><link name="arm"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    (here / "bench.urdf").write_text(urdf)
    assert tendon("studio", "drive")[0] == 0
    assert (served[-1][0].inputs.like, served[-1][0].inputs.model.file) == ("drive", "drive.toml")
    assert tendon("studio", "bench.urdf")[0] == 0
    made = served[-1][0]
    assert made.inputs.model.file == "bench.toml"
    assert 'name = "hinge"' in made.model_text(None)
    assert made.inputs.described.made.joints[0].unknown == ["rotor_inertia"]
    assert any("gear_ratio" in note for note in made.inputs.described.made.notes)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["absent.toml"], "absent.toml"),
        (["broken.toml"], "broken.toml"),
        (["broken.urdf"], "broken.urdf"),
        (["--demo", "arm.toml"], "--demo brings a model"),
        (["--held-out", "run.csv"], "--held-out needs a model"),
        (["arm.toml", "absent.csv"], "absent.csv"),
        (["arm.toml", "--session", "arm.toml"], "is a file"),
        (["arm.toml", "--session", "."], "is not empty"),
        (["arm.toml", "--map", "q1"], "expected NAME=COLUMN"),
        (["arm.toml", "--port", "70000"], "--port"),
        (["old", "--demo"], "drop the other arguments"),
        (["nothing"], "nothing"),
    ],
)
def test_what_is_wrong_is_one_line(here, served, refused, arguments, expected):
    (here / "broken.toml").write_text("name = 3")
    (here / "broken.urdf").write_text("<robot")
    StudioSession.create(Path("old"))
    before = sorted(p.name for p in here.iterdir())
    said = refused("studio", *arguments)
    assert expected in said
    assert "given/" not in said
    assert sorted(p.name for p in here.iterdir()) == before
    assert served == []


def test_a_port_that_is_taken_is_said_before_a_folder_is_made(here, served, refused):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"port {port} of 127.0.0.1 cannot be used" in refused("studio", "arm.toml", "--port", port)
    assert [p.name for p in here.iterdir()] == ["arm.toml"]
    assert served == []


def test_the_browser_is_handed_a_file_that_others_cannot_read_and_not_the_key(here, monkeypatch):
    """What stands on a command line everybody on the machine can read. The key is long, and another each time."""
    pytest.importorskip("nicegui", reason="no studio: pip install -e '.[studio]'")
    import uvicorn

    opened, said, keys = [], [], []
    monkeypatch.setattr(server.webbrowser, "open", opened.append)

    def run(_self, _sockets) -> None:
        path = Path(opened[0].removeprefix("file://"))
        assert path.stat().st_mode & 0o777 == 0o600
        assert said[0] in path.read_text()

    monkeypatch.setattr(uvicorn.Server, "run", run)
    for name in ("session", "another"):
        said.clear()
        opened.clear()
        with server.bound(0) as listening:
            server.serve(Studio(StudioSession.create(here / name)), listening, said.append, browser=True)
        keys.append(said[0].partition("token=")[2])
        assert keys[-1] not in opened[0]
        assert not (here / name / "open.html").exists()
    assert len(keys[0]) >= 43
    assert keys[0] != keys[1]


def test_without_nicegui_it_says_what_to_install(tmp_path, monkeypatch, refused):
    monkeypatch.setattr(server.importlib.util, "find_spec", lambda _: None)
    assert "pip install -e '.[studio]'" in refused("studio", "--demo")
    assert list(tmp_path.iterdir()) == []
