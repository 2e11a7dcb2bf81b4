"""The study's files: figures, and what a diagnosis of its experiments needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from runtime import files
from runtime.recordings import recording
from runtime.report.plots import style
from runtime.study import figure4
from runtime.study import figures as draw
from runtime.study.tables import Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from runtime.planning.trajectory import Trajectory
    from runtime.study.study import Study


def figures(study: Study, wanted: Sequence[str]) -> dict[str, Figure]:
    """Those that are wanted and can be drawn, by name."""
    makers: dict[str, Callable[[], Figure]] = {
        "figure4": lambda: figure4.friction(study.table1.joint(figure4.JOINT)),
        "figure5": lambda: draw.figure5(study.curves),
        "figure6": lambda: draw.figure6(study.table2),
        "figure7": lambda: draw.figure7(study.table3),
        "figure8": lambda: draw.figure8(study.table3),
    }
    return {name: makers[name]() for name in wanted if name in makers}


def save(drawn: Mapping[str, Figure], directory: Path) -> None:
    """Each under its name. Raises OSError."""
    directory.mkdir(parents=True, exist_ok=True)
    for name, figure in drawn.items():
        style.save(figure, directory / f"{name}.png")


def recordings(study: Study, directory: Path, mounted: Callable[[Trajectory], str]) -> list[str]:
    """For every executed case its trajectory, its recording and the model with its spring; paths without ending."""
    directory.mkdir(parents=True, exist_ok=True)
    return [_kept(row, directory, mounted) for row in (*study.table2, *study.table3)]


def _kept(row: Row, directory: Path, mounted: Callable[[Trajectory], str]) -> str:
    case, trajectory = row.case, row.plan.trajectory
    number = "1" if case.plate is None else "2"
    plate = "" if case.plate is None else f"-{case.plate:g}"
    stem = directory / f"{number}{case.letter}-{case.cycle_time:g}s{plate}"
    trajectory.write(stem.with_name(f"{stem.name}.json"))
    files.replace(stem.with_name(f"{stem.name}.toml"), mounted(trajectory).encode())
    if row.run is not None and row.run.execution.recording is not None:
        recording.write(stem.with_name(f"{stem.name}.csv.gz"), row.run.execution.recording)
    return str(stem)
