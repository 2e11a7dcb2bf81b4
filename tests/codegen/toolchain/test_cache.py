"""The cache heals: an entry that is not as it was written is made anew; nothing is loaded that others could write."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import sympy as sp

from codegen import prepare
from codegen.toolchain import build
from codegen.toolchain.build import BuildError, shared_library
from symbolic.effects import LIBRARY
from symbolic.effects.declaration import Effect, LinearForm, parameter
from symbolic.model_file.arm import Arm

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


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TENDON_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


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


def own(symbol: sp.Symbol) -> Effect:
    """An effect whose form goes back by way of a symbol of these assumptions."""
    offset = LIBRARY["offset"]
    back = (sp.sqrt(symbol**2),)
    form = LinearForm(offset.parameters, offset.torque, (parameter("torque"),), back)
    return replace(offset, name="magnet", form=form)


def test_assumptions_are_part_of_the_key() -> None:
    """sqrt(x**2) is x of a positive x, and abs(x) of a real one."""
    x = [sp.Symbol("p_torque", real=True), sp.Symbol("p_torque", positive=True), sp.Symbol("p_torque")]
    laws = [sp.Function("f")(symbol) for symbol in x]
    said = [prepare.said_of(replace(own(x[0]), torque=law)) for law in laws]
    assert len({repr(law) for law in laws}) == 1
    assert len(set(said)) == 3
    digits = [sp.Float("0.1", 30), sp.Float("0.1000000000000000000001", 30)]
    assert len({prepare.said_of(replace(own(x[0]), torque=d * x[0])) for d in digits}) == 2


def test_loaded_code_is_checked_before_it_is_loaded(empty_cache: Path) -> None:  # noqa: ARG001
    path = shared_library(ANSWER, "answer")
    assert ctypes.CDLL(str(path)).answer() == 42
    turned(path)
    assert not build.is_whole(path.parent)


RENDERED = """
import sys
opened = set()
sys.addaudithook(lambda event, values: opened.add(str(values[0])) if event == "open" else None)
from codegen import render
from codegen.casadi.machine import machine_page
from symbolic.effects import shipped
from symbolic.model import derive
from symbolic.model_file import reader
for name in ("drive", "ur10"):
    path = f"symbolic/arms/{name}.toml"
    render.arm_files(derive(reader.load(path)))
for space in (False, True):
    render.effect_files(tuple(shipped(space).values()))
machine_page()
print(*sys.modules, *opened, sep="\\n")
"""


def test_the_key_of_an_arm_covers_what_renders_it() -> None:
    """Every module and template that is loaded while arms and effects are rendered is hashed; the firmware is not."""
    run = subprocess.run([sys.executable, "-c", RENDERED], cwd=ROOT, capture_output=True, text=True, check=True)
    covered = {path.relative_to(ROOT).as_posix() for path in prepare.sources(prepare.UNUSED_BY_ARMS)}
    needed = {path for name in run.stdout.splitlines() if (path := source_of(name)) is not None}
    assert {"codegen/c/templates/source.c.j2", "symbolic/effects/friction.py", "codegen/tape/tape.py"} <= needed
    assert needed - covered == set()
    assert [path for path in covered if path.startswith(("codegen/firmware", "codegen/verify"))] == []


def test_the_key_of_the_firmware_covers_the_arm_and_its_tree() -> None:
    arm, firmware = (set(prepare.sources(u)) for u in (prepare.UNUSED_BY_ARMS, prepare.UNUSED_BY_FIRMWARE))
    assert arm < firmware
    assert ROOT / "codegen/firmware/templates/tendon_arm.h.j2" in firmware - arm
    assert ROOT / "codegen/verify/verify.py" not in firmware


@pytest.mark.parametrize(
    ("changed", "another"),
    [("symbolic/effects/friction.py", True), ("codegen/c/c_code.py", True), ("codegen/verify/verify.py", False)],
)
def test_a_changed_source_is_another_entry(
    changed: str, another: bool, vishard4: Arm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The entry of an arm follows every source that it depends on, by its content."""
    for package in ("symbolic", "codegen"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(prepare, "_ROOT", tmp_path)
    monkeypatch.setattr(build, "entry", lambda name, _: Path(name))

    def entry() -> Path:
        prepare.sources.cache_clear()
        prepare._digest.cache_clear()
        return prepare.prepare_arm(vishard4)

    before = entry()
    with (tmp_path / changed).open("a", encoding="utf-8") as source:
        source.write("# another\n")
    after = entry()
    prepare.sources.cache_clear()
    prepare._digest.cache_clear()
    assert (after != before) == another


@pytest.mark.parametrize("name", prepare.UNUSED_BY_ARMS)
def test_what_a_key_leaves_out_exists(name: str) -> None:
    assert (ROOT / name).exists()


def source_of(name: str) -> str | None:
    """The path in the repository of a module or a file that was opened; None where it is not a source of ours."""
    if name.startswith("/"):
        path = Path(name)
    else:
        path = ROOT / name.replace(".", "/")
        path = path / "__init__.py" if path.is_dir() else path.with_name(f"{path.name}.py")
    known = path.is_relative_to(ROOT) and path.suffix in (".py", ".j2", ".c", ".h") and path.is_file()
    relative = path.relative_to(ROOT).as_posix() if known else ""
    return relative if relative.startswith(("symbolic/", "codegen/")) else None
