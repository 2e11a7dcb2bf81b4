"""Wherever a verb is killed, files and generated folders are the old ones or the new, and the next run tidies up."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from codegen.toolchain import build
from codegen.toolchain.build import shared_library
from runtime.cli import output
from runtime.cli.main import app
from runtime.workspace.names import ARMS
from tests.crashes import killed_at

ANSWER = {"answer.c": "int answer(void);\nint answer(void)\n{\n    return 42;\n}\n"}


def verb(*arguments: object) -> int:
    return output.run(app, [str(argument) for argument in arguments])


def seen(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def part(content: dict[str, bytes], name: str) -> dict[str, bytes]:
    """What stands in a folder, without what says where it comes from, whole or on its way."""
    return {path: data for path, data in content.items() if path.startswith(name) and "/." not in path}


def points(work: Callable[[], object], folder: Path, prepare: Callable[[], None], every: int) -> Iterator[int]:
    """Every so-many-th point at which the work is killed, from a folder that is prepared anew."""
    for point in itertools.count(0, every):
        prepare()
        if not killed_at(point, work, folder):
            return
        yield point


def fresh(folder: Path, content: dict[str, bytes]) -> None:
    for path in sorted(folder.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
    for path, data in content.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(data)


@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.slow), 5])
@pytest.mark.parametrize("what", ["add", "generate"])
def test_a_killed_add_or_generate(tmp_path: Path, capsys: pytest.CaptureFixture[str], what: str, every: int) -> None:
    model, out = tmp_path / "arm.toml", tmp_path / "made" / "drive"
    model.write_bytes((ARMS / "drive.toml").read_bytes())
    assert verb("generate", model, "--out", out) == 0
    before = seen(tmp_path)
    if what == "generate":
        model.write_bytes(model.read_bytes().replace(b"gear_ratio = 100", b"gear_ratio = 90"))
        before["arm.toml"] = model.read_bytes()
    work = {"add": ("add", model, "stribeck", "--joint", 1), "generate": ("generate", model)}[what]
    assert verb(*work, "--out", out) == 0
    after = seen(tmp_path)
    assert after != before
    count = 0
    for point in points(lambda: verb(*work, "--out", out), tmp_path, lambda: fresh(tmp_path, before), every):
        found, count = seen(tmp_path), count + 1
        for name in ("arm.toml", "made/drive/", "made/effects/"):
            assert part(found, name) in (part(before, name), part(after, name)), (point, name)
        assert verb("add", model, "offset", "--joint", 1, "--out", out) == 0
        assert verb("generate", model, "--out", out, "--check") == 0
        assert {p.name for p in tmp_path.rglob(".*")} <= {".model"}, point
    assert count > 2
    capsys.readouterr()


def test_a_killed_identify(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, run = tmp_path / "models" / "arm.toml", tmp_path / "run.csv"
    model.parent.mkdir()
    model.write_bytes((ARMS / "drive.toml").read_bytes())
    assert verb("simulate", "drive", "--out", run, "--seconds", 12) == 0
    work, before = ("identify", model, run, "--write"), seen(model.parent)
    assert verb(*work) == 0
    after, count = seen(model.parent), 0
    for point in points(lambda: verb(*work), model.parent, lambda: fresh(model.parent, before), 1):
        assert part(seen(model.parent), "arm.toml") in (before, after), point
        assert verb(*work) == 0
        assert set(seen(model.parent)) == {"arm.toml"}, point
        count += 1
    assert count > 2
    capsys.readouterr()


@pytest.mark.slow
def test_a_killed_improve(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, folder = tmp_path / "run.csv", tmp_path / "out"
    folder.mkdir()
    assert verb("simulate", "drive", "--out", run, "--seconds", 12, "--hide", "stribeck@1:torque=0.6,speed=0.15") == 0
    work = ("improve", "drive", run, "--out", folder / "better.toml")
    for point in points(lambda: verb(*work), folder, lambda: fresh(folder, {}), 1):
        assert set(seen(folder)) - {"better.toml"} == {n for n in seen(folder) if n.startswith(".better")}, point
        assert verb(*work) == 0
        assert set(seen(folder)) == {"better.toml"}
    capsys.readouterr()


def test_a_killed_making_of_an_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    monkeypatch.setenv("TENDON_CACHE", str(folder))
    count = 0
    for _ in points(lambda: shared_library(ANSWER, "answer"), folder, lambda: fresh(folder, {}), 1):
        assert build.is_whole(shared_library(ANSWER, "answer").parent)
        assert len(list(folder.iterdir())) == 1
        count += 1
    assert count > 2
