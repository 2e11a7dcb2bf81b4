"""The cache heals: an entry that is not as it was written is made anew; nothing is loaded that others could write."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from codegen.toolchain import build
from codegen.toolchain.build import BuildError, shared_library

ROOT = Path(__file__).resolve().parents[3]
ANSWER = {"answer.c": "int answer(void);\nint answer(void)\n{\n    return 42;\n}\n"}
KILLED = """
import os, signal, sys
from pathlib import Path
from codegen.toolchain import build
def fill(directory):
    (directory / "half.c").write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
build.entry("killed", fill)
"""


def answer() -> int:
    """Loaded in a process of its own: a library that is cut kills the one that loads it."""
    path = shared_library(ANSWER, "answer")
    script = "import ctypes, sys; print(ctypes.CDLL(sys.argv[1]).answer())"
    run = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True)
    return int(run.stdout)


def cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def turned(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def foreign(path: Path) -> None:
    path.write_bytes(b"of another program")


def missing(path: Path) -> None:
    path.unlink()


def a_link_to_nowhere(path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


def a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize("damage", [cut, emptied, turned, foreign, missing, a_link_to_nowhere, a_folder])
def test_an_entry_that_is_not_whole_is_made_anew(empty_cache: Path, damage: Callable[[Path], None]) -> None:
    path = shared_library(ANSWER, "answer")
    kept = path.read_bytes()
    damage(path)
    assert answer() == 42
    assert path.read_bytes() == kept
    damage(path.parent / build.DIGEST)
    assert answer() == 42
    assert len(list(empty_cache.iterdir())) == 1


@pytest.mark.parametrize("what", ["nothing in it", "a file", "a link"])
def test_what_stands_in_the_place_of_an_entry_goes(empty_cache: Path, tmp_path: Path, what: str) -> None:
    folder = shared_library(ANSWER, "answer").parent
    folder.rename(tmp_path / "aside")
    if what == "a file":
        folder.write_text("of another program")
    elif what == "a link":
        folder.symlink_to(tmp_path / "aside")
    else:
        folder.mkdir()
    assert answer() == 42
    assert folder.is_dir()
    assert not folder.is_symlink()
    assert len(list(empty_cache.iterdir())) == 1


def test_an_entry_is_the_users_alone(empty_cache: Path) -> None:
    path = shared_library(ANSWER, "answer")
    assert [folder.stat().st_mode & 0o777 for folder in (empty_cache, path.parent)] == [0o700, 0o700]


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o720, 0o702])
def test_a_cache_that_others_may_write_to_is_refused(empty_cache: Path, mode: int) -> None:
    path = shared_library(ANSWER, "answer")
    empty_cache.chmod(mode)
    with pytest.raises(BuildError, match=r"others may write to it, and code is loaded from there: .*set TENDON_CACHE"):
        shared_library(ANSWER, "answer")
    empty_cache.chmod(0o755)
    assert shared_library(ANSWER, "answer") == path


def test_what_a_killed_process_left_goes(empty_cache: Path) -> None:
    assert subprocess.run([sys.executable, "-c", KILLED], check=False).returncode == -9
    assert [path.name.startswith(".making-") for path in empty_cache.iterdir()] == [True]
    path = shared_library(ANSWER, "answer")
    assert list(empty_cache.iterdir()) == [path.parent]


def test_what_a_process_is_at_is_left_to_it(empty_cache: Path) -> None:
    """Another one sweeps while it works."""

    def fill(directory: Path) -> None:
        (directory / "one.c").write_text("one")
        shared_library(ANSWER, "answer")
        assert (directory / "one.c").read_text() == "one"

    assert (build.entry("slow", fill) / "one.c").read_text() == "one"
    assert len(list(empty_cache.iterdir())) == 2


def test_a_full_disk_is_one_line(empty_cache: Path) -> None:  # noqa: ARG001
    def fill(_: Path) -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(BuildError, match=r"cannot write the cache .*: No space left on device; set TENDON_CACHE"):
        build.entry("full", fill)
