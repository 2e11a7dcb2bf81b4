"""What the tests of the runtime share: models by file, recordings of others, and recordings of the test plants."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from bench_arm import THERE_AND_BACK, trajectory
from driven import rig

from runtime.cli import output
from runtime.cli.main import app
from runtime.execution.trial import Trial
from runtime.model.loader import Model
from runtime.planning import scenario_file
from runtime.planning.scenario import Scenario
from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import Recording, read
from runtime.workspace.source import Source
from tests import plants
from tests.kept import kept

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "data"


@pytest.fixture(scope="session")
def drive(cache: Path) -> Model:  # noqa: ARG001 - the cache is where it is compiled
    return Source.read(ROOT / "symbolic" / "arms" / "drive.toml", None).compiled.model()


@pytest.fixture(scope="session")
def emps(cache: Path) -> Model:  # noqa: ARG001
    return Source.read(ROOT / "symbolic" / "arms" / "emps.toml", None).compiled.model()


@pytest.fixture(scope="session")
def pressing(model: Model) -> Scenario:
    """The paper's scenario 2 with any spring, not those of a catalogue."""
    path = ROOT / "runtime" / "study" / "scenario2.toml"
    found = scenario_file.fitted(scenario_file.read(path), model, path.name)
    return replace(found, springs=tuple(replace(spring, catalogue=()) for spring in found.springs))


@pytest.fixture(scope="session")
def shared(cache: Path) -> Callable[[str, Model], Recording]:  # noqa: ARG001
    """A recording below shared/data, or a skip that says what is missing."""

    def open_recording(name: str, model: Model) -> Recording:
        path = SHARED / name
        if not path.exists():
            pytest.skip(f"{name} is not here: the folder shared/data is not part of the project")
        return read(path, RecordedArm(model.joints, model.spatial))

    return open_recording


@pytest.fixture(scope="session")
def clean(bench: Source, arm: Model) -> Trial:
    """The bench's motion there and back on a board that nothing disturbs."""
    return rig(arm, bench.compiled.controller(), trajectory(THERE_AND_BACK)).driven()


@pytest.fixture
def interrupts() -> Iterator[None]:
    """Ctrl-C interrupts, as in a terminal: a process that a shell started in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, in which the test works."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def tendon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """`tendon ARGUMENTS` in the test's own folder: status, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def called(*arguments: object) -> tuple[int, str, str]:
        status = output.run(app, [str(a) for a in arguments])
        return status, *capsys.readouterr()

    return called


Refused = Callable[..., str]


@pytest.fixture
def refused(tendon: Run) -> Refused:
    """The one line that `tendon ARGUMENTS` says when it refuses them as bad input."""

    def said(*arguments: object) -> str:
        status, out, err = tendon(*arguments)
        assert (status, out, err.count("\n")) == (2, "", 1)
        return err

    return said


def recorded(hidden: str | None, seed: int, size: float | None = None) -> Recording:
    """A recording of the independent plant with an effect hidden in it."""
    return kept(plants.recording, hidden, seed, size)
