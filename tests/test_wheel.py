"""The wheel, built as for publication, in an empty environment: the first page's commands, typed in another folder."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
from importlib.util import find_spec
from pathlib import Path

import pytest
import test_guides
from guides import ROOT, Block
from test_guides import walk

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("wheel")]


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with wheel and archive, built from a copy of the sources alone."""
    if find_spec("build") is None:
        pytest.skip("the package build is not installed (the extra `dev`)")
    folder = tmp_path_factory.mktemp("dist")
    left_out = (".git", ".venv", ".*cache", "__pycache__", "*.egg-info", "build", "tests")
    shutil.copytree(ROOT, folder / "sources", ignore=shutil.ignore_patterns(*left_out))
    _run(sys.executable, "-m", "build", "--outdir", folder, folder / "sources")
    return folder


@pytest.fixture(scope="module")
def installed(dist: Path) -> Path:
    """`bin` of an environment that has nothing but the wheel and what it requires."""
    _run(sys.executable, "-m", "venv", dist / "empty")
    _run(dist / "empty" / "bin" / "pip", "install", "--quiet", next(dist.glob("*.whl")))
    return dist / "empty" / "bin"


def _run(*command: object) -> str:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    run = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, env=environment)
    assert run.returncode == 0, f"{run.stdout}\n{run.stderr}"
    return run.stdout


def test_it_has_one_name_in_site_packages(installed: Path) -> None:
    script = "from importlib.metadata import files; print(*{f.parts[0] for f in files('tendon-robotics')})"
    # -I: not what stands in this folder, an installation for editing among it.
    names = set(_run(installed / "python", "-I", "-c", script).split())
    assert {name for name in names if not name.endswith(".dist-info")} == {"tendon", ".."}


def test_the_archive_builds_the_wheel_by_itself(dist: Path) -> None:
    with tarfile.open(next(dist.glob("*.tar.gz"))) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"pyproject.toml", "LICENSE", ".ci/backend/one_name.py", "runtime/import_name/tendon/__init__.pyi"} <= names
    assert not any(name.startswith(("tests", "generated")) for name in names)


def test_the_commands_of_the_first_page_work_in_an_empty_environment(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def typed(line: str) -> tuple[int, str, str]:
        run = subprocess.run(line, shell=True, capture_output=True, text=True, check=False)
        return run.returncode, run.stdout, run.stderr

    def script(block: Block, where: str) -> str:
        run = subprocess.run([installed / "python", "-c", block.text], capture_output=True, text=True, check=False)
        assert run.returncode == 0, f"{where}: {run.stderr}"
        return run.stdout

    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    monkeypatch.setenv("PATH", f"{installed}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr(test_guides, "typed", typed)
    monkeypatch.setattr(test_guides, "script", script)
    # What is printed is compared in tests/test_guides.py.
    monkeypatch.setattr(test_guides, "differs", lambda *_: None)
    walk("README.md", tmp_path, slow=True)
