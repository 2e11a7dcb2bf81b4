"""The gallery of findings: its commands say what stands there, and its pictures are those that they draw."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import test_guides
from test_guides import folder as folder

from tests import pictures

GALLERY = {picture.name: picture for picture in pictures.gallery()}
LARGEST = 70_000
"""Bytes of a picture."""
FAST = "stribeck"
"""The picture that is drawn in every run; all take minutes."""


def outlines(svg: str) -> list[np.ndarray]:
    """The coordinates of all lines and bars of a picture, (N, 2) points each; letters and clouds of points left out."""
    drawn = re.sub(r"<defs>.*?</defs>", "", svg, flags=re.DOTALL)
    paths = [re.findall(r"[ML] (-?[\d.]+) (-?[\d.]+)", path) for path in re.findall(r' d="([^"]*)"', drawn)]
    return [np.array(path, dtype=float) for path in paths if path]


def assert_drawn_anew(name: str, folder: Path) -> None:
    """Draws a picture and compares it with the one that is kept, to a point in size."""
    GALLERY[name].draw(folder)
    kept, drawn = (
        outlines((place / f"{name}.svg").read_text(encoding="utf-8"))
        for place in (pictures.PICTURES / "gallery", folder)
    )
    again = f"run python -m tests.pictures {name}"
    assert len(kept) > 5
    assert [len(path) for path in kept] == [len(path) for path in drawn], again
    for one, other in zip(kept, drawn, strict=True):
        np.testing.assert_allclose(one, other, atol=1.0, err_msg=again)


@pytest.mark.cheap
def test_every_picture_is_there_and_small() -> None:
    kept = {path.stem: path.stat().st_size for path in (pictures.PICTURES / "gallery").iterdir()}
    assert kept.keys() == GALLERY.keys()
    assert {name: size for name, size in kept.items() if size > LARGEST} == {}


@pytest.mark.cheap
def test_pictures_are_those_of_the_commands_below_them() -> None:
    for name, picture in GALLERY.items():
        assert len(picture.commands) == (0 if name in pictures.REAL else 2)
        assert all(f"{name}.csv.gz" in command for command in picture.commands)


def test_a_picture_is_what_its_commands_draw(tmp_path: Path) -> None:
    assert_drawn_anew(FAST, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in GALLERY if name != FAST])
def test_all_pictures_are_what_their_commands_draw(name: str, tmp_path: Path) -> None:
    if not GALLERY[name].is_there:
        pytest.skip(f"the recordings of {name} are not in {pictures.DATA}")
    assert_drawn_anew(name, tmp_path)


@pytest.mark.slow
def test_the_commands_print_what_stands_there(folder: Path) -> None:
    test_guides.walk("runtime/guides/gallery.md", folder, slow=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "heading", "shown"),
    [("emps", "A real axis: EMPS", ()), ("ur10", "A real arm: UR10", (1, 2, 3, 6))],
)
def test_the_tables_of_real_machines_are_what_improve_finds(name: str, heading: str, shown: tuple[int, ...]) -> None:
    if not GALLERY[name].is_there:
        pytest.skip(f"the recordings of {name} are not in {pictures.DATA}")
    steps = GALLERY[name].improved().history
    rows = test_guides.table("runtime/guides/gallery.md", heading)
    assert [row[0] for row in rows] == ["file, refitted", *(f"+ {step.added}" for step in steps[1:])]
    for row, step in zip(rows, steps, strict=True):
        held_out = step.held_out_relative
        assert held_out is not None
        errors = [held_out[joint - 1] for joint in shown] or [step.relative[0], held_out[0]]
        assert row[1:] == [f"{100 * (error or 0):.2f} %" for error in errors]
