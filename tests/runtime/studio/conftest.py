"""What the tests of the studio share: a browser, a session that was fitted and diagnosed once, and two servers.

Tests that use the session or a server bear the mark xdist_group("studio"): one process runs them all.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from runtime.cli import output
from runtime.cli.main import app
from runtime.studio.history import PlacedEffect
from runtime.studio.session import StudioSession
from runtime.studio.studio import Studio
from runtime.studio.work import WorkState
from tests import one_joint
from tests.runtime.studio.browser import Server, Watched, launched, served
from tests.runtime.studio.waiting import done

SPRING = PlacedEffect("linear_spring", 1)
EVIL = "<img src=x onerror=document.title='evil'>.csv"
"""A name that must not become a part of the page."""
MODEL = f"# <script>document.title='evil'</script> {EVIL}\n" + one_joint.model_text(
    "[joint.effects.coulomb]\n[joint.effects.viscous]\n"
)


@dataclass
class Prepared:
    """A session of a model that lacks a spring: step 0 is fitted and diagnosed, step 1 has the spring.

    studio   open, with its process
    folder   a copy of the session, which nothing changes
    states   of the task, as they came during the diagnosis
    """

    studio: Studio
    folder: Path
    states: list[WorkState]


@pytest.fixture(scope="session")
def recorded(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: ARG001 - where it is compiled
    """A model, and two recordings of a joint with a spring that the model lacks."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "drive.toml").write_text(MODEL)
    for seed, name in enumerate((EVIL, "held.csv"), 1):
        hide = ["--hide", "linear_spring@1:stiffness=3,rest=0.1", "--seed", str(seed), "--seconds", "16"]
        assert output.run(app, ["simulate", str(folder / "drive.toml"), "--out", str(folder / name), *hide]) == 0
    return folder


@pytest.fixture(scope="session")
def prepared(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Prepared]:
    """The loop, once."""
    home = tmp_path_factory.mktemp("prepared")
    studio = Studio(StudioSession.create(home / "session"))
    states: list[WorkState] = []
    try:
        studio.give_model(recorded / "drive.toml")
        studio.give_recording(recorded / EVIL)
        studio.give_recording(recorded / "held.csv", held_out=True)
        studio.begin()
        done(studio)
        count = studio._changed
        studio._work._changed = lambda: (states.append(studio.work), count())  # type: ignore[arg-type, return-value]
        studio.diagnose()
        done(studio)
        studio._work._changed = count
        studio.add(SPRING)
        done(studio)
        yield Prepared(studio, shutil.copytree(studio.session.folder, home / "copy"), states)
    finally:
        studio.close()


@pytest.fixture
def shared(prepared: Prepared) -> Studio:
    """That session at step 0, with its process; tests may add steps and answers to it."""
    prepared.studio.go_to(0)
    return prepared.studio


@pytest.fixture
def copied(prepared: Prepared, tmp_path: Path) -> Iterator[Studio]:
    """A copy of that session at step 0."""
    made = Studio(StudioSession.open(shutil.copytree(prepared.folder, tmp_path / "copied")))
    made.go_to(0)
    yield made
    made.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser without a window. Its event loop forbids others in the process while it is open: one a module."""
    yield from launched()


@pytest.fixture(scope="session")
def fitted_server(prepared: Prepared, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """`tendon studio` with a copy of the prepared session."""
    folder = tmp_path_factory.mktemp("fitted")
    shutil.copytree(prepared.folder, folder / "session")
    yield from served(folder, "session")


@pytest.fixture(scope="session")
def new_server(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:  # noqa: ARG001
    """`tendon studio` with a new session. A test empties it by removing the recordings: see `Watched.emptied`."""
    yield from served(tmp_path_factory.mktemp("new"))


@pytest.fixture
def tab(browser: Any) -> Iterator[Callable[..., Watched]]:
    """Opens tabs, which are closed at the end of the test."""
    opened: list[Watched] = []

    def open_tab(server: Server, **looks: Any) -> Watched:
        opened.append(Watched(browser, server.address, **looks))
        return opened[-1]

    yield open_tab
    for watched in opened:
        watched.context.close()


@pytest.fixture
def fitted(tab: Callable[..., Watched], fitted_server: Server) -> Watched:
    """A tab with the prepared session at step 1."""
    watched = tab(fitted_server)
    watched.at_step(1)
    return watched
