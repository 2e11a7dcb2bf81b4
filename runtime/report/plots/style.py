"""Style of all figures: colours, type sizes, scales, and reproducible SVG."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from runtime import files

P = ParamSpec("P")

INK = "#1f2730"  # what was measured; text
FAINT = "#66727f"  # axes, the noise floor
BEFORE = "#bd4a07"  # the model as given
AFTER = "#0a6fb0"  # the improved model
COLOURS = {"ink": INK, "faint": FAINT, "before": BEFORE, "after": AFTER}
"""Colours by name; a page replaces them by its own."""

WIDTH = 4.1  # inches, of every figure: its labels stay readable on a phone

ABOVE_LEGEND = 17
"""points between a panel and its title, where a legend stands between the two"""

_STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.facecolor": "none",
    "axes.unicode_minus": True,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "savefig.dpi": 170,
    "text.color": INK,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "lines.solid_capstyle": "round",
    "path.simplify_threshold": 0.2,
    "svg.fonttype": "none",
    "text.parse_math": False,
}


def styled(make: Callable[P, Figure]) -> Callable[P, Figure]:
    """Decorator of functions that draw a figure: they use this style and leave the user's Matplotlib style as it is."""

    @wraps(make)
    def made(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with mpl.rc_context(_STYLE):
            return make(*args, **kwargs)

    return made


def residual_reach(residuals: Sequence[NDArray[np.float64]], floor: float) -> float:
    """Half the height of a scale of residuals (M,): without a few outliers, and with the noise floor in view."""
    reach = max((float(np.quantile(np.abs(r), 0.997)) for r in residuals if len(r)), default=0.0)
    return max(1.15 * reach, 2.5 * floor)


def residual_scale(ax: Axes, residuals: Sequence[NDArray[np.float64]], floor: float) -> None:
    """Set a vertical scale that is symmetric about 0."""
    reach = residual_reach(residuals, floor)
    ax.set_ylim(-reach, reach)


def legend(ax: Axes, handles: Sequence[Artist] | None = None) -> None:
    """A legend in one line above the curves; handles: what it names, in place of the curves with a label."""
    where: Any = {"loc": "lower left", "bbox_to_anchor": (0, 1.0), "borderaxespad": 0, "borderpad": 0.2}
    shape: Any = {"ncols": 3, "handlelength": 1.1, "columnspacing": 1.2}
    named: Any = {"labelcolor": "linecolor"} if handles is None else {"handles": handles}
    ax.legend(**named, **where, **shape, frameon=False, fontsize=8)


def envelope(t: NDArray[np.float64], y: NDArray[np.float64], points: int) -> tuple[NDArray[np.float64], ...]:
    """Times and values (N,) as about `points` points: the smallest and largest value of each bin, in order of time."""
    size = 2 * len(y) // points
    if size < 3:
        return t, y
    bins = y[: len(y) // size * size].reshape(-1, size)
    pick = np.sort(np.stack([bins.argmin(axis=1), bins.argmax(axis=1)], axis=1), axis=1)
    index = (pick + size * np.arange(len(bins))[:, None]).ravel()
    return t[index], y[index]


def save(figure: Figure, path: Path) -> None:
    """Write the figure to a file, on white and with text as outlines. Raises OSError."""
    buffer = io.BytesIO()
    with mpl.rc_context({**_STYLE, "svg.fonttype": "path", "svg.hashsalt": Path(path).name}):
        kind = Path(path).suffix.removeprefix(".") or "svg"
        figure.savefig(buffer, format=kind, facecolor="white", metadata={"Date": None} if kind == "svg" else None)
    files.replace(path, buffer.getvalue())


def svg(figure: Figure, name: str) -> str:
    """The figure as an SVG document, the same bytes at every call; `name` makes its ids unique on a page."""
    buffer = io.StringIO()
    with mpl.rc_context({**_STYLE, "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Type": None, "Format": None})
    return buffer.getvalue()
