"""Keys of the cache: they follow every source and every digit on which generated code depends, and nothing else."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import sympy as sp

from codegen import prepare
from codegen.toolchain import build
from symbolic.effects import LIBRARY
from symbolic.effects.declaration import Effect, LinearForm, parameter
from symbolic.model_file.arm import Arm

ROOT = Path(__file__).resolve().parents[2]


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


RENDERED = """
import sys
opened = set()
sys.addaudithook(lambda event, values: opened.add(str(values[0])) if event == "open" else None)
from codegen import render
from symbolic.effects import shipped
from symbolic.model import derive
from symbolic.model_file import reader
for name in ("drive", "ur10"):
    path = f"symbolic/arms/{name}.toml"
    render.arm_files(derive(reader.load(path)))
for space in (False, True):
    render.effect_files(tuple(shipped(space).values()))
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
