"""Generated folders are replaced whole: whoever looks, and wherever a process is killed, sees the old or the new."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from codegen import disk
from codegen.pages import BANNER

OLD = {f"{name}.c": f"/* {BANNER} */\nint old_{name};\n" for name in "abcdef"} | {"same.h": f"/* {BANNER} */\n"}
NEW = {f"src/{name}.c": f"/* {BANNER} */\nint new_{name};\n" for name in "abc"} | {
    "same.h": OLD["same.h"],
    "a.c": f"/* {BANNER} */\nint new_a;\n",
}
KILLED = """
import os, signal, sys
from pathlib import Path
from codegen import disk
from tests.codegen.test_disk import NEW
def exchange(*_):
    os.kill(os.getpid(), signal.SIGKILL)
disk._exchange = exchange
disk.write(NEW, Path(sys.argv[1]))
"""


@contextmanager
def umask(mask: int) -> Iterator[None]:
    before = os.umask(mask)
    try:
        yield
    finally:
        os.umask(before)


def seen(folder: Path) -> dict[str, str]:
    return {p.relative_to(folder).as_posix(): p.read_text() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder that was generated, and in which its user has a file, a link and a folder of their own."""
    disk.write(OLD, tmp_path / "arm")
    (tmp_path / "arm" / "own.c").write_text("by hand")
    (tmp_path / "arm" / "build").mkdir(mode=0o750)
    (tmp_path / "arm" / "build" / "main.o").write_text("compiled")
    (tmp_path / "arm" / "link").symlink_to("build")
    return tmp_path / "arm"


def check_new(folder: Path) -> None:
    """What was asked for is there, what is the user's too, and nothing else."""
    assert seen(folder) == NEW | {"own.c": "by hand", "build/main.o": "compiled"}
    assert os.readlink(folder / "link") == "build"
    assert stat.S_IMODE((folder / "build").stat().st_mode) == 0o750
    assert sorted(folder.parent.iterdir()) == [folder]
    assert disk.stale(NEW, folder) == []


def without_exchange(monkeypatch: pytest.MonkeyPatch, _: Path) -> None:
    monkeypatch.setattr(disk, "_exchange", lambda *_: False)


def from_within(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    monkeypatch.chdir(folder / "build")


def as_it_is(*_: object) -> None:
    pass


@pytest.mark.parametrize("way", [as_it_is, without_exchange, from_within])
def test_what_is_the_users_stays(
    folder: Path, monkeypatch: pytest.MonkeyPatch, way: Callable[[pytest.MonkeyPatch, Path], None]
) -> None:
    kept = (folder / "same.h").stat().st_mtime_ns
    way(monkeypatch, folder)
    disk.write(NEW, folder)
    check_new(folder)
    assert (folder / "same.h").stat().st_mtime_ns == kept
    assert Path.cwd().exists()


def test_no_reader_sees_a_mixture(folder: Path) -> None:
    """A folder that is held open is wholly the old one or wholly the new one, while it is written to and fro."""
    done = threading.Event()

    def to_and_fro() -> None:
        for _ in range(40):
            disk.write(NEW, folder)
            disk.write(OLD, folder)
        done.set()

    writer = threading.Thread(target=to_and_fro)
    writer.start()
    whole = {frozenset(OLD), frozenset(("same.h", "a.c"))}
    mixtures = set()
    while not done.is_set():
        inside = os.open(folder, os.O_RDONLY)
        names = frozenset(os.listdir(inside)) - {"own.c", "build", "link", "src"}
        # One that was taken away meanwhile is being deleted.
        if os.path.samestat(os.fstat(inside), folder.stat()) and names not in whole:
            mixtures.add(names)
        os.close(inside)
    writer.join()
    assert mixtures == set()


def test_what_a_killed_process_left_goes(folder: Path) -> None:
    before = seen(folder)
    run = subprocess.run([sys.executable, "-c", KILLED, str(folder)], check=False)
    assert run.returncode == -9
    assert seen(folder) == before
    assert len(list(folder.parent.iterdir())) == 2
    disk.write(NEW, folder)
    check_new(folder)


def test_two_at_once_leave_one_of_both(folder: Path) -> None:
    writers = [threading.Thread(target=disk.write, args=(files, folder)) for files in (NEW, OLD) * 4]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    disk.write(NEW, folder)
    check_new(folder)


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002, 0o027])
def test_umask_is_obeyed(tmp_path: Path, mask: int) -> None:
    with umask(mask):
        disk.write(NEW, tmp_path / "arm")
    made = [*(tmp_path / "arm").rglob("*"), tmp_path / "arm"]
    modes = {(p.is_dir(), stat.S_IMODE(p.stat().st_mode)) for p in made}
    assert modes == {(True, 0o777 & ~mask), (False, 0o666 & ~mask)}


def test_a_link_to_a_folder_stays_one(folder: Path) -> None:
    link = folder.parent / "link"
    link.symlink_to("arm")
    disk.write(NEW, link)
    assert os.readlink(link) == "arm"
    link.unlink()
    check_new(folder)


def test_a_full_disk_names_the_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = seen(folder)
    opened = os.open

    def full(path: str, flags: int, *mode: int, **where: int) -> int:
        return opened("/dev/full", os.O_WRONLY) if str(path).endswith("b.c") else opened(path, flags, *mode, **where)

    monkeypatch.setattr(os, "open", full)
    with pytest.raises(OSError, match="No space left on device") as caught:
        disk.write(NEW, folder)
    assert caught.value.filename == str(folder / "src" / "b.c")
    assert seen(folder) == before
    assert sorted(folder.parent.iterdir()) == [folder]
