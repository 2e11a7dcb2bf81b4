"""A sweep: its points as a figure and a table, and the plan of the point that is pressed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import isfinite
from typing import Any

from runtime.report.page.drawing_board import WIDTH
from runtime.studio.page.parts import button, put
from runtime.studio.page.view import PageView
from runtime.studio.plan_shown import PointShown, SweepShown
from runtime.wording import number, sentence

HEIGHT, EDGE, FOOT = 420, 80, 60
"""Of the figure, in the units of its drawing as WIDTH: its height, the room at its left and above it, and below."""
STYLES = 8
"""Lines that are told apart by their colours and dashes."""


class SweepPart:
    """The sweeps of a session as one tab sees them.

    look_at_plan   shows a plan
    """

    def __init__(self, view: PageView, look_at_plan: Callable[[int], None]) -> None:
        self._view, self._shelf, self._look_at_plan = view, view.studio.plans, look_at_plan
        self._chosen: int | None = None
        self._point: int | None = None
        self._scenario = ""
        self._seen = self._shelf.newest

    @property
    def chosen(self) -> int | None:
        """The sweep that is looked at: what was opened last, until another one is chosen."""
        if self._shelf.newest != self._seen:
            self._seen = self._shelf.newest
            if self._seen is not None and self._seen[0] == "sweeps":
                self._chosen, self._point = self._seen[1], None
        known = self._shelf.numbers("sweeps")
        if self._chosen not in known:
            self._chosen, self._point = (known[0] if known else None), None
        return self._chosen

    def look_at(self, sweep: int) -> None:
        """Choose another one."""
        self._chosen, self._point = sweep, None
        self._view.changed()

    def key(self) -> object:
        """What the figure and the table show; None: there is no sweep."""
        if self.chosen is None:
            return None
        return self.chosen, self._point, repr(self._shelf.plans_of(self.chosen))

    def draw(self) -> None:
        """The points, as a figure and as a table."""
        sweep = self.chosen
        assert sweep is not None
        shown, plans = self._shelf.sweep(sweep), self._shelf.plans_of(sweep)
        put("h2", f"Sweep: {shown['name']}")
        said = f"{shown['jobs']} jobs, {len(shown['points']) + shown['more']} variations of {', '.join(shown['axes'])}"
        put("p", f"{said}. Press a point, in the figure or the table, to see its plan.", "of")
        with put("div", classes="beside"):
            _figure(shown, self._press, self._point)
            _table(shown, self._press, self._point, plans)
        if shown["more"]:
            put("p", f"{shown['more']} more variations are in the table's file and are not shown.", "of")

    def key_of_point(self) -> object:
        """What is shown of the point that was pressed; None: there is no sweep."""
        return self.key() and (self.key(), self._scenario, self._view.busy)

    def point(self) -> None:
        """What came of the point that was pressed, and its plan: a table has none, so it is planned again."""
        sweep = self.chosen
        assert sweep is not None
        if self._point is not None:
            shown, plans = self._shelf.sweep(sweep), self._shelf.plans_of(sweep)
            with put("article", classes="card", data_point=self._point):
                self._one(shown["points"][self._point], plans.get(self._point))
        away = partial(self._view.act, partial(self._shelf.take_away, "sweeps", sweep))
        with put("div", classes="acts"):
            button("Take the sweep away", away, disabled=self._view.busy, data_do="sweep-away")

    def _press(self, point: int) -> None:
        """Look at a point, and at its plan if there is one."""
        self._point = point
        assert self._chosen is not None
        plan = self._shelf.plans_of(self._chosen).get(point)
        if plan is not None:
            self._look_at_plan(plan)
        self._view.changed()

    def _one(self, found: PointShown, plan: int | None) -> None:
        put("h3", _words(found["at"]))
        if found["cost"] is None:
            put("p", f"There is no plan: {sentence(found['reason'] or 'the job did not come to an end')}", "warning")
            return
        put("p", f"The best of {found['jobs']}: cost {number(found['cost'])}, seed {found['seed']}.")
        if plan is not None:
            with put("div", classes="acts"):
                button("Show its plan", partial(self._look_at_plan, plan), data_do="point-plan")
            return
        put("p", "The table holds no motion; it is planned again from the scenario of the sweep.", "of")
        scenarios = self._shelf.scenarios()
        name = self._scenario if self._scenario in scenarios else next(iter(scenarios))
        begin = partial(self._shelf.plan_point, self._chosen or 0, self._point or 0, name)
        with put("div", classes="acts"):
            self._view.controls.choice("scenario", "scenario", list(scenarios.items()), name, self._of)
            button(
                "Plan this point", partial(self._view.act, begin), "first", disabled=self._view.busy, data_do="point"
            )

    def _of(self, scenario: str) -> None:
        self._scenario = scenario
        self._view.changed()


# --- the figure ---


@dataclass(frozen=True)
class _Drawing:
    """Where the points are drawn: x in the values of an axis, y in costs."""

    across: str
    left: float
    right: float
    top: float

    def place(self, point: PointShown) -> tuple[float, float]:
        """Of a point with a plan."""
        wide, high = WIDTH - EDGE - FOOT, HEIGHT - FOOT - EDGE / 2
        x = (float(point["at"][self.across]) - self.left) / (self.right - self.left)
        return EDGE + x * wide, HEIGHT - FOOT - (point["cost"] or 0.0) / self.top * high


def _across(shown: SweepShown) -> str | None:
    """What the horizontal axis is: the axis with the most numbers; None where no axis has two."""
    values = {
        axis: {p["at"][axis] for p in shown["points"] if isinstance(p["at"][axis], float)} for axis in shown["axes"]
    }
    most = max(values, key=lambda axis: len(values[axis]), default=None)
    return most if most is not None and len(values[most]) > 1 else None


def _figure(shown: SweepShown, press: Callable[[int], None], chosen: int | None) -> None:
    """The cost over what varies; points that differ in nothing else are joined."""
    across = _across(shown)
    if across is None:
        return
    drawn = [(k, p) for k, p in enumerate(shown["points"]) if _is_drawn(p, across)]
    values = [p["at"][across] for _, p in drawn]
    if len(set(values)) < 2:
        return
    most = max(p["cost"] or 0.0 for _, p in drawn)
    drawing = _Drawing(across, min(values), max(values), most or 1.0)
    if not all(map(isfinite, (drawing.left, drawing.right, drawing.top))):
        return
    series: dict[str, list[tuple[int, PointShown]]] = {}
    for k, point in drawn:
        series.setdefault(_words({n: v for n, v in point["at"].items() if n != across}), []).append((k, point))
    with put("figure", classes="sweep-figure"):
        label = f"Cost of {len(drawn)} variations over {across}"
        with put("svg", viewBox=f"0 0 {WIDTH} {HEIGHT}", role="group", aria_label=label):
            _axes(drawing)
            for k, points in enumerate(series.values()):
                _line(drawing, k % STYLES, sorted(points, key=lambda p: p[1]["at"][across]), press, chosen)
        if len(series) > 1:
            with put("figcaption"), put("ul", classes="key"):
                for k, name in enumerate(series):
                    with put("li"):
                        with put("svg", classes="sample", viewBox="0 0 40 12", aria_hidden="true"):
                            put("path", classes="sweep-line", d="M0 6H40", data_style=k % STYLES)
                        put("span", name)


def _is_drawn(point: PointShown, across: str) -> bool:
    """Whether it has a place in the figure."""
    return point["cost"] is not None and point["cost"] >= 0.0 and isinstance(point["at"][across], float)


def _axes(drawing: _Drawing) -> None:
    floor, high = HEIGHT - FOOT, EDGE / 2
    for part in (0.0, 0.5, 1.0):
        y = floor - part * (floor - high)
        put("path", classes="sweep-rule", d=f"M{EDGE} {y}H{WIDTH - FOOT}")
        put("text", number(part * drawing.top, 3), x=EDGE - 10, y=y + 6, text_anchor="end")
        x = EDGE + part * (WIDTH - EDGE - FOOT)
        value = drawing.left + part * (drawing.right - drawing.left)
        put("text", number(value, 3), x=x, y=floor + 26, text_anchor="middle")
    put("text", drawing.across, x=WIDTH - FOOT, y=HEIGHT - 8, text_anchor="end")
    put("text", "cost", x=EDGE - 10, y=high - 16, text_anchor="end")


def _line(
    drawing: _Drawing,
    style: int,
    points: list[tuple[int, PointShown]],
    press: Callable[[int], None],
    chosen: int | None,
) -> None:
    places = [drawing.place(point) for _, point in points]
    put("path", classes="sweep-line", d="M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in places), data_style=style)
    for (k, point), (x, y) in zip(points, places, strict=True):
        what = f"{_words(point['at'])}: cost {number(point['cost'] or 0.0)}"
        mark: dict[str, Any] = {"data_style": style, "aria_current": "true" if k == chosen else None}
        with put(
            "g", classes="sweep-point", role="button", tabindex=0, aria_label=what, data_do=f"dot-{k}", **mark
        ) as dot:
            put("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r=9 if k == chosen else 6)
            put("title", what)
        dot.on("click", partial(press, k), [])
        dot.on("keydown.enter", partial(press, k), [])


# --- the table ---


def _table(shown: SweepShown, press: Callable[[int], None], chosen: int | None, plans: dict[int, int]) -> None:
    several = any(point["jobs"] > 1 for point in shown["points"])
    heads = [*shown["axes"], "cost", *(["with a plan"] if several else []), "plan"]
    with put("div", classes="scroll sweep-table"), put("table", classes="stack"):
        with put("thead"), put("tr"):
            for head in heads:
                put("th", head, scope="col")
        with put("tbody"):
            for k, point in enumerate(shown["points"]):
                cells = [_cell(point["at"][axis]) for axis in shown["axes"]]
                cells.append("none" if point["cost"] is None else number(point["cost"]))
                cells += [f"{point['plans']} of {point['jobs']}"] if several else []
                with put("tr", aria_current="true" if k == chosen else None):
                    for head, cell in zip(heads, cells, strict=False):
                        put("td", cell, "n", data_is=head)
                    with put("td", data_is="plan"):
                        text = "Open" if k in plans else "Why not" if point["cost"] is None else "Look"
                        what = f"{text}: {_words(point['at'])}"
                        button(text, partial(press, k), aria_label=what, data_do=f"point-{k}")


def _words(at: dict[str, Any]) -> str:
    return ", ".join(f"{name} {_cell(value)}" for name, value in at.items() if value is not None) or "the scenario"


def _cell(value: object) -> str:
    return "" if value is None else number(value) if isinstance(value, float) else str(value)
