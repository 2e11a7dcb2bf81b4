"""The firmware's C that is written by hand: plain files, for every arm the same, compiled as they stand."""

from __future__ import annotations

import re
import shutil
import subprocess
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from random_arms import MIXED

from codegen.firmware import source_tree
from codegen.firmware.source_tree import TREE, handwritten_files
from codegen.pages import BANNER, MARK
from codegen.toolchain import build, cross
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file.arm import Arm

STUB = "boards/own/board.c"
"""Filled in by its owner: a copy of it is replaced by nobody."""
LINES = 350
MANY = (*build.WARNINGS, "-Wcast-qual", "-Wwrite-strings", "-Wmissing-declarations", "-Wswitch-default")
GCC = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="needs gcc-arm-none-eabi")


@pytest.mark.parametrize("path", handwritten_files())
def test_a_plain_file_of_one_purpose(path: str) -> None:
    text = handwritten_files()[path]
    assert (MARK in text.splitlines()[0]) == (path != STUB)
    assert not any(hole in text for hole in ("{{", "{%", "vishard4", "VISHARD4"))
    assert len(text.splitlines()) <= LINES
    assert max(map(len, text.splitlines())) <= 120


def test_calls_between_files_go_one_way() -> None:
    """No file of the machine calls another one that calls it back, directly or through others."""
    files = {path: text for path, text in handwritten_files().items() if re.match(r"src/.*\.c$", path)}
    defined = {name: path for path in files for name in re.findall(r"^\w[\w ]* \**(tendon_\w+)\(", files[path], re.M)}
    calls = {path: {defined.get(name, path) for name in re.findall(r"\w+", files[path])} - {path} for path in files}
    order = list(TopologicalSorter(calls).static_order())
    assert order.index("src/tendon_guard.c") < order.index("src/tendon_hold.c") < order.index("src/tendon_step.c")


def test_it_is_copied_as_it_stands(vishard4: Arm) -> None:
    """Whatever the arm: what else a tree has says that it was generated, and is not among the handwritten files."""
    for arm in (vishard4, MIXED["r"]):
        files = source_tree.firmware_files(derive(arm), LIBRARY)
        assert {path: files[path] for path in handwritten_files()} == handwritten_files()
        other = {path: text for path, text in files.items() if path not in handwritten_files()}
        assert all(BANNER in text[:200] for path, text in other.items() if path != "protocol.json")
        assert sorted(Path(path).name for path in other if path.endswith(".h") and "/tendon_" in path) == [
            "tendon_arm.h",
            "tendon_controller.h",
            "tendon_math_f32.h",
            "tendon_messages.h",
        ]


@pytest.mark.parametrize("kind", [pytest.param("host"), pytest.param("gcc", marks=GCC)])
def test_it_compiles_where_it_stands(vishard4: Arm, tmp_path: Path, kind: str) -> None:
    """Over the generated headers of an arm and nothing else, with yet more warnings than a firmware is built with."""
    files = source_tree.firmware_files(derive(vishard4), LIBRARY)
    headers = [path for path in files if path.startswith("src/") and path.endswith(".h")]
    for path in set(headers) - set(handwritten_files()):
        (tmp_path / Path(path).name).write_text(files[path])
    tools = None if kind == "host" else cross.find(kind)
    compiler = build.compiler() if tools is None else tools.compile
    flags = (build.LOOPS, *build.FLAGS, "-pedantic") if tools is None else tools.flags(cross.TARGETS["cortex-m4f"])
    command = [*compiler, *flags, *MANY, f"-I{TREE / 'src'}"]
    units = [path for path in handwritten_files() if path.endswith(".c")]
    units = [path for path in units if tools is not None or not path.startswith("boards/mps2/")]

    def fill(into: Path) -> None:
        for path in units:
            own = [f"-I{tmp_path}", "-c", str(TREE / path), "-o", str(into / f"{Path(path).stem}.o")]
            made = subprocess.run([*command, *own], capture_output=True, text=True, check=False)
            assert made.returncode == 0, made.stderr[:2000]

    identity = "" if tools is None else tools.identity
    content = [part for item in files.items() for part in item]
    assert list(build.entry(f"objects-{build.key(identity, *command, *units, '', *content)}", fill).glob("*.o"))
