"""Draws the figures of README.md and of the gallery: `python -m tests.pictures`.

A picture of the gallery is a figure of the report on the commands below it: its description begins with the figure's
caption. Those of real machines are drawn where their recordings are.
"""

from __future__ import annotations

import base64
import io
import re
import shlex
import sys
import tempfile
from collections.abc import Sequence
from contextlib import chdir, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import tendon
from PIL import Image
from PIL.Image import Quantize

from runtime.cli.main import app
from runtime.cli.output import run
from runtime.notebook.html import ResultFigures
from runtime.report.page.page_figures import Drawn

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / ".images"
GALLERY = ROOT / "runtime" / "guides" / "gallery.md"
DATA = ROOT.parent / "shared" / "data"
DRAWN = {"error.svg": "Error of joint 1", "residual.svg": "Residual over velocity"}
"""File of each figure of README.md -> the beginning of its caption in the report."""
REAL = {
    "emps": ("emps/identification.csv.gz", "emps/validation.csv.gz"),
    "ur10": ("real/ur10/fit.csv.gz", "real/ur10/held.csv.gz"),
}
"""Arm, which is the name of its picture -> the recording that is fitted, and the one that is held out."""

_SECTION = re.compile(r"!\[([^\]:]+)[^\]]*\]\(\S*/gallery/(\w+)\.svg\)(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
_FILE = re.compile(r"^```python\n(# ([\w.]+)\n.*?)^```$", re.MULTILINE | re.DOTALL)
_EMBEDDED = re.compile(r"(data:image/png;base64,)([^\"]+)")
_COLOURS = 24


@dataclass(frozen=True)
class GalleryPicture:
    """A picture of the gallery: its name, the beginning of the figure's caption, the commands below it, and texts and
    names of files that they read."""

    name: str
    caption: str
    commands: tuple[str, ...]
    files: tuple[tuple[str, str], ...]

    def draw(self, folder: Path) -> None:
        """Write the picture into a folder."""
        result = self.improved() if self.name in REAL else self._diagnosed()
        save(figure(result.figures, self.caption), folder / f"{self.name}.svg")

    @property
    def is_there(self) -> bool:
        """Whether the recordings are there from which it is drawn."""
        return all((DATA / path).is_file() for path in REAL.get(self.name, ()))

    def improved(self) -> tendon.ImprovementResult:
        """What is added to the model of a real machine."""
        fitted, held_out = (DATA / path for path in REAL[self.name])
        return tendon.improve(tendon.load(self.name), fitted, held_out=held_out)

    def _diagnosed(self) -> tendon.DiagnosisResult:
        """The diagnosis of what the commands simulate: `tendon simulate ARM ...`, `tendon diagnose ARM FILE ...`."""
        simulated, diagnosed = (shlex.split(command)[1:] for command in self.commands)
        _, model, file, *options = diagnosed
        with tempfile.TemporaryDirectory() as folder, chdir(folder), redirect_stdout(io.StringIO()):
            for text, name in self.files:
                Path(name).write_text(text, encoding="utf-8")
            run(app, simulated)
            arm = tendon.load(model)
            columns = dict(option.split("=", 1) for option in options if option != "--map")
            return tendon.diagnose(arm, tendon.recording(file, arm, columns))


def gallery() -> list[GalleryPicture]:
    """The pictures of the gallery, in their order."""
    found = []
    for caption, name, below in _SECTION.findall(GALLERY.read_text(encoding="utf-8")):
        commands = re.findall(r"^(tendon [^#\n]*[^#\s])", below, re.MULTILINE)
        found.append(GalleryPicture(name, caption, tuple(commands), tuple(_FILE.findall(below))))
    return found


def figure(figures: ResultFigures, caption: str) -> Drawn:
    """The first figure whose caption begins so."""
    return next(one for one in figures if one.caption.startswith(caption))


def save(drawn: Drawn, path: Path) -> None:
    """Write a figure, its clouds of points with few colours: they are most of its bytes."""
    drawn.save(path)
    path.write_text(_EMBEDDED.sub(_smaller, path.read_text(encoding="utf-8")), encoding="utf-8")


def _smaller(embedded: re.Match[str]) -> str:
    """The picture inside an SVG with a palette."""
    buffer = io.BytesIO()
    with Image.open(io.BytesIO(base64.b64decode(embedded[2]))) as cloud:
        cloud.quantize(_COLOURS, Quantize.FASTOCTREE).save(buffer, "PNG", optimize=True)
    return embedded[1] + base64.b64encode(buffer.getvalue()).decode()


def draw_demo(folder: Path) -> None:
    """Write the figures of README.md into a folder."""
    with tempfile.TemporaryDirectory() as report:
        run(app, ["demo", "--out", report])
        arm = tendon.load("drive")
        fitted, held_out = (tendon.recording(f"{report}/{name}.csv.gz", arm) for name in ("fitted", "held_out"))
        figures = tendon.improve(arm, fitted, held_out=held_out).figures
    for file, caption in DRAWN.items():
        save(figure(figures, caption), folder / file)


def draw_gallery(folder: Path, named: Sequence[str] = ()) -> None:
    """Write the pictures of the gallery into a folder: those named, or all."""
    folder.mkdir(exist_ok=True)
    for picture in gallery():
        if not picture.is_there:
            print(f"{picture.name}: its recordings are not in {DATA}; the picture stays as it is")
        elif not named or picture.name in named:
            picture.draw(folder)
            print(f"{picture.name}: {(folder / picture.name).with_suffix('.svg').stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    if not sys.argv[1:]:
        draw_demo(PICTURES)
    draw_gallery(PICTURES / "gallery", sys.argv[1:])
