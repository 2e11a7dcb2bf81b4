"""Files are replaced whole, by one process at a time; nothing is lost, and nothing is left by one that was killed."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from runtime import files
from runtime.workspace.names import ARMS, UsageError
from runtime.workspace.source import Source

KILLED = """
import os, signal, sys
from runtime import files
at = os.fsync if sys.argv[2] == "written" else os.replace
def killed(*_):
    os.kill(os.getpid(), signal.SIGKILL)
setattr(os, at.__name__, killed)
with files.locked(sys.argv[1]):
    files.replace(sys.argv[1], b"new")
"""


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_bytes((ARMS / "drive.toml").read_bytes())
    return path


def test_no_update_is_lost(model: Path, monkeypatch: pytest.MonkeyPatch, lock_refused: threading.Event) -> None:
    """Several put their effect into one file at once: who says that it is in there is right."""
    replaced = files.replace

    def slow(path: Path, data: bytes) -> None:
        assert lock_refused.wait(files.LONGEST_WAIT)
        replaced(path, data)

    monkeypatch.setattr(files, "replace", slow)
    effects = ["stribeck", "offset", "linear_spring", "lugre", "friction_patch"]
    sources = {effect: Source.read(model, None) for effect in effects}
    said: list[str] = []
    refused: list[str] = []

    def add(effect: str) -> None:
        try:
            sources[effect].edits.add(effect, 1).write()
            said.append(effect)
        except UsageError as error:
            refused.append(str(error))

    threads = [threading.Thread(target=add, args=(effect,)) for effect in effects]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    there = Source.read(model, None).arm().joints[0].effects
    assert len(said) == 1
    assert set(refused) == {f"{model}: was changed by someone else meanwhile; nothing was written, try again"}
    assert [effect for effect in effects if effect in there] == said
    assert list(model.parent.iterdir()) == [model]


def test_what_belongs_to_a_file_is_written_before_another_is_let_in(model: Path, lock_refused: threading.Event) -> None:
    first, order = Source.read(model, None), []

    def second() -> None:
        source = Source.read(model, None)
        with replace(source.edits, text=source.text + "# second\n").written():
            order.append("second")

    with replace(first.edits, text=first.text + "# first\n").written():
        thread = threading.Thread(target=second)
        thread.start()
        assert lock_refused.wait(files.LONGEST_WAIT)
        order.append("first")
    thread.join()
    assert order == ["first", "second"]
    assert model.read_text().endswith("# first\n# second\n")


@pytest.mark.parametrize("killed", ["written", "renamed"])
def test_what_a_killed_process_left_goes(model: Path, killed: str) -> None:
    before = model.read_bytes()
    assert subprocess.run([sys.executable, "-c", KILLED, str(model), killed], check=False).returncode == -9
    assert model.read_bytes() == before
    assert len(list(model.parent.iterdir())) == 3
    with files.locked(model):
        files.replace(model, b"new")
    assert model.read_bytes() == b"new"
    assert list(model.parent.iterdir()) == [model]


def test_what_another_process_is_writing_is_left_to_it(tmp_path: Path) -> None:
    target = tmp_path / "file"
    beside, descriptor = files._beside(target)
    (tmp_path / ".file.0123456789ab").write_text("left by one that was killed")
    (tmp_path / ".file.mine").write_text("of another name")
    (tmp_path / ".file.fedcba987654").mkdir()
    files.replace(target, b"data")
    left = sorted([".file.mine", ".file.fedcba987654", beside.name, "file"])
    assert sorted(path.name for path in tmp_path.iterdir()) == left
    os.close(descriptor)


def test_who_does_not_come_to_an_end_is_named(model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "LONGEST_WAIT", 0.05)
    with files.locked(model), pytest.raises(TimeoutError, match="another process is writing to it; try") as caught:
        files.locked(model).__enter__()
    assert caught.value.filename == str(model)


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_umask_is_obeyed(tmp_path: Path, mask: int) -> None:
    before = os.umask(mask)
    try:
        files.replace(tmp_path / "new", b"data")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "new").stat().st_mode) == 0o666 & ~mask


def test_a_full_disk_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "run.csv").write_bytes(b"old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left on device") as caught:
        files.replace(tmp_path / "run.csv", b"data")
    assert caught.value.filename == str(tmp_path / "run.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]
    assert (tmp_path / "run.csv").read_bytes() == b"old"


def test_the_longest_name_that_there_can_be(tmp_path: Path) -> None:
    for name in ("x" * 255, "ü" * 127):
        with files.locked(tmp_path / name):
            files.replace(tmp_path / name, b"data")
        assert (tmp_path / name).read_bytes() == b"data"
