"""The figures of a result, as a notebook draws them."""

from __future__ import annotations

from runtime.report.page.page_figures import Drawn


class ResultFigures(tuple[Drawn, ...]):
    """Figures of a result; the last line of a cell draws them all, an item one of them."""

    __slots__ = ()

    def __repr__(self) -> str:
        return "\n".join(f"[{k}] {figure.caption}" for k, figure in enumerate(self))

    def _repr_html_(self) -> str:
        return "".join(figure._repr_html_() for figure in self)
