"""The committed output is what the sources generate, to the byte."""

from __future__ import annotations

from pathlib import Path

from codegen import disk, render
from codegen.firmware import source_tree
from codegen.package.package import package_files
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file.arm import Arm

GENERATED = Path(__file__).resolve().parent.parent / "generated"


def test_the_arm_of_the_paper(vishard4: Arm) -> None:
    """If this fails: tendon generate symbolic/arms/vishard4.toml"""
    assert disk.stale(package_files(derive(vishard4), LIBRARY), GENERATED / "vishard4") == []


def test_the_firmware_of_the_arm_of_the_paper(vishard4: Arm) -> None:
    """If this fails: tendon firmware symbolic/arms/vishard4.toml"""
    files = source_tree.firmware_files(derive(vishard4), LIBRARY)
    assert disk.stale(files, GENERATED / "vishard4" / "firmware") == []


def test_the_library_of_effects() -> None:
    """If this fails: tendon generate symbolic/arms/vishard4.toml writes the library, too."""
    assert disk.stale(render.effect_files(tuple(LIBRARY.values())), GENERATED / "effects") == []
