"""The compiler and the cache."""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from random_arms import MIXED

from codegen import descriptions, prepare
from codegen.toolchain import build
from runtime.model import loader
from runtime.workspace.names import ARMS
from runtime.workspace.source import Source
from symbolic.effects import shipped

ANSWER = {"answer.c": "int answer(void);\nint answer(void)\n{\n    return 42;\n}\n"}


def test_compiles_once(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = build.shared_library(ANSWER, "answer")
    assert path.is_relative_to(empty_cache)
    assert ctypes.CDLL(str(path)).answer() == 42
    monkeypatch.setattr(build, "compile_shared", lambda *_: pytest.fail("compiled twice"))
    assert build.shared_library(ANSWER, "answer") == path


def test_other_content_is_another_entry(empty_cache: Path) -> None:  # noqa: ARG001
    changed = {"answer.c": ANSWER["answer.c"].replace("42", "43")}
    assert build.shared_library(ANSWER, "answer") != build.shared_library(changed, "answer")


def test_a_failure_leaves_nothing_behind(empty_cache: Path) -> None:
    with pytest.raises(build.BuildError, match=r"failed \(exit 1\): wrong\.c:1.*error"):
        build.shared_library({"wrong.c": "int x = ;\n"}, "wrong")
    assert list(empty_cache.iterdir()) == []


def test_many_at_once(empty_cache: Path) -> None:
    paths: list[Path] = []
    threads = [threading.Thread(target=lambda: paths.append(build.shared_library(ANSWER, "answer"))) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(paths) == 6
    assert len(set(paths)) == 1
    assert len(list(empty_cache.iterdir())) == 1


def test_no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(build.shutil, "which", lambda _: None)
    monkeypatch.setattr(build.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(
        build.BuildError, match=r"no C compiler found .* install one, for example gcc, or run: .*ziglang"
    ):
        build.compiler()


def test_the_wheel_is_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(build.shutil, "which", lambda _: None)
    monkeypatch.setattr(build.importlib.util, "find_spec", lambda _: object())
    assert build.compiler() == (sys.executable, "-m", "ziglang", "cc")


def test_a_named_compiler_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler -m64")
    with pytest.raises(build.BuildError, match='"no-such-compiler -m64" of the environment variable CC is not there'):
        build.compiler()


def test_a_cache_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TENDON_CACHE", str(tmp_path / "file"))
    with pytest.raises(build.BuildError, match=r"cannot write the cache .*; set TENDON_CACHE"):
        build.shared_library(ANSWER, "answer")


def test_the_cache_has_a_place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("TENDON_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert build.cache_directory() == tmp_path / "tendon"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert build.cache_directory() == Path.home() / ".cache" / "tendon"


def test_without_a_home_that_can_be_written_the_cache_is_the_users_own_temporary_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Code is loaded from there: what others made, or could write to, is not taken."""
    (tmp_path / "home").write_text("no folder")
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    monkeypatch.delenv("TENDON_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    folder = temporary / f"tendon-{os.getuid()}"
    assert build.cache_directory() == folder
    assert folder.stat().st_mode & 0o777 == 0o700
    assert build.shared_library(ANSWER, "answer").is_relative_to(folder)
    folder.chmod(0o777)
    with pytest.raises(build.BuildError, match="it is not this user's alone; set TENDON_CACHE"):
        build.cache_directory()
    folder.rename(temporary / "elsewhere")
    folder.symlink_to(temporary / "elsewhere")
    with pytest.raises(build.BuildError, match="it is not this user's alone"):
        build.cache_directory()


def test_an_arm_is_prepared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    first = prepare.prepare_arm(MIXED["r"])
    assert (first / "lib.so").is_file()
    monkeypatch.setattr(build, "compile_shared", lambda *_: pytest.fail("compiled twice"))
    assert prepare.prepare_arm(MIXED["r"]) == first
    monkeypatch.undo()
    assert prepare.prepare_arm(MIXED["rp"]) != first


def test_another_effect_compiles_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = MIXED["r"]
    first = prepare.prepare_arm(arm)
    monkeypatch.setattr(build, "compile_shared", lambda *_: pytest.fail("compiled again"))
    joint = replace(arm.joints[0], effects={"viscous": {"coefficient": 2.0}})
    second = prepare.prepare_arm(replace(arm, joints=(joint,)))
    assert (first / "lib.so").read_bytes() == (second / "lib.so").read_bytes()
    assert (first / "metadata.json").read_text() != (second / "metadata.json").read_text()


def test_a_prepared_library_needs_no_sympy() -> None:
    prepare.prepare_effects()
    script = (
        "import sys; from codegen import prepare; from codegen.toolchain import build; build.compile_shared = None; "
        "prepare.prepare_effects(); print('sympy' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


@pytest.mark.parametrize("arm", ["drive", "ur10"])
def test_a_prepared_arm_is_opened_without_sympy(arm: str) -> None:
    Source.read(ARMS / f"{arm}.toml", None).compiled.model()
    script = (
        "import sys; from pathlib import Path; from runtime.workspace.source import Source; "
        f"Source.read(Path({str(ARMS / (arm + '.toml'))!r}), None).compiled.model(); print('sympy' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


def test_a_library_is_described_as_it_is_compiled() -> None:
    for space in (False, True):
        compiled = prepare.prepare_effects(tuple(shipped(space).values())) / "effects.json"
        assert descriptions.described(space) == json.loads(compiled.read_text())["effects"]
    assert descriptions.PAGE.read_text() == descriptions.text(), "python -m codegen.descriptions writes it anew"


def test_wider_vectors_change_no_bit(library: loader.Library, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same library compiled for any processor of the family, for this one, and without optimisation."""
    arm = MIXED["rprrp"]
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.normal(size=(3, 5, 257))
    results = []
    for flags in (build.vector_flags(), (), ("-O0",)):
        monkeypatch.setattr(build, "vector_flags", lambda _=None, flags=flags: flags)
        model = loader.Model(prepare.prepare_arm(arm), library)
        results.append([model.forward_dynamics(q, qd, qdd), model.inverse_dynamics(q, qd, qdd)])
    for other in results[1:]:
        assert np.array_equal(results[0], other)
