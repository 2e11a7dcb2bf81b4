"""Draws the README's figures from a run of the demo: `python -m tests.pictures`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import tendon

from runtime.cli.main import app
from runtime.cli.output import run

PICTURES = Path(__file__).resolve().parent.parent / ".images"
DRAWN = {"error.svg": "Error of joint 1", "residual.svg": "Residual over velocity"}
"""File of each figure -> the beginning of its caption in the report."""


def draw(folder: Path) -> None:
    """Write the figures into a folder."""
    with tempfile.TemporaryDirectory() as report:
        run(app, ["demo", "--out", report])
        arm = tendon.load("drive")
        fitted, held_out = (tendon.recording(f"{report}/{name}.csv.gz", arm) for name in ("fitted", "held_out"))
        figures = tendon.improve(arm, fitted, held_out=held_out).figures
    for file, caption in DRAWN.items():
        next(figure for figure in figures if figure.caption.startswith(caption)).save(folder / file)


if __name__ == "__main__":
    draw(PICTURES)
