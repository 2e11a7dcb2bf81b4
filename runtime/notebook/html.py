"""A result as a notebook's cell shows it: a few lines, everything else folded; and its figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from runtime.report.page.html import fragment
from runtime.report.sections import Section

if TYPE_CHECKING:
    from runtime.report.page.page_figures import Drawn  # Matplotlib is imported where used

_STYLE = Markup("""<style>
.tendon-result { max-width: 62em; line-height: 1.4; }
.tendon-result p { margin: .2em 0; }
.tendon-result .scroll { overflow-x: auto; margin: .6em 0; }
.tendon-result table { border-collapse: collapse; font-size: .95em; font-variant-numeric: tabular-nums; }
.tendon-result :is(th, td) { text-align: left; vertical-align: top; padding: .25em 1em .25em 0; }
.tendon-result tr { border-bottom: 1px solid #8884; }
.tendon-result thead th { opacity: .7; }
.tendon-result tr.named > * { font-weight: 600; }
.tendon-result summary { cursor: pointer; opacity: .7; margin: .4em 0; }
.tendon-result dl { display: flex; flex-wrap: wrap; gap: .4em 1.6em; }
.tendon-result dt { opacity: .7; font-size: .9em; }
.tendon-result dd { margin: 0; }
.tendon-result pre { white-space: pre-wrap; }
.tendon-result :is(.flag, .warning) { font-weight: 600; }
.tendon-result .of { opacity: .7; }
</style>""")
"""Colours are the notebook's own, light or dark."""


def shown(lines: Sequence[str], sections: Sequence[Section]) -> str:
    """The lines, the first of them bold, and the sections folded below."""
    first, *others = lines
    paragraphs = [f"<p><b>{escape(first)}</b></p>", *(f"<p>{escape(line)}</p>" for line in others)]
    folded = f"<details><summary>everything</summary>{fragment(sections)}</details>"
    return f'{_STYLE}<div class="tendon-result">{"".join(paragraphs)}{folded}</div>'


class ResultFigures(tuple["Drawn", ...]):
    """Figures of a result; the last line of a cell draws them all, an item one of them."""

    __slots__ = ()

    def __repr__(self) -> str:
        return "\n".join(f"[{k}] {figure.caption}" for k, figure in enumerate(self))

    def _repr_html_(self) -> str:
        return "".join(figure._repr_html_() for figure in self)
