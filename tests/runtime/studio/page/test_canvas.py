"""Signals for the canvas: what is reduced is true of the samples, what is selected is what lies in the ranges."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.identification.compare import JointSeries
from runtime.motion.repeats import Floor
from runtime.report.page import html
from runtime.report.signals import EMBEDDED_SCRIPTS, STATIC
from runtime.report.signals.joint_signals import of_series
from runtime.report.signals.signal_set import (
    MOST_ROWS,
    AskedWrongly,
    DrawnLine,
    Pyramid,
    SignalPanel,
    SignalSet,
    around,
    curve,
)
from tests.runtime.studio.signal_page import served
from tests.runtime.studio.waiting import PATIENCE


def walk(samples: int, seed: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """A random walk and its noise over an uneven time."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 1.5, samples)) * 1e-3
    return t, {"walk": np.cumsum(rng.normal(size=samples)), "noise": rng.normal(size=samples)}


@settings(deadline=None, max_examples=60)
@given(
    samples=st.integers(1, 40_000),
    seed=st.integers(0, 99),
    part=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    columns=st.integers(1, 3000),
)
def test_blocks_bound_every_sample(samples: int, seed: int, part: tuple[float, float], columns: int) -> None:
    """The least and the largest of a view's blocks are those of its samples, and of no sample far from it."""
    t, lines = walk(samples, seed)
    begin, end = (float(t[0] + p * (t[-1] - t[0])) for p in sorted(part))
    found = Pyramid.of(t, lines).columns(begin, end, columns)
    assert found.shape[0] == 5
    assert found.shape[1] <= 2 * columns + 2
    assert np.all(np.diff(found[0]) > 0)
    assert np.all(np.isin(found[0], t))
    seen = (t >= begin) & (t < end)
    for k, values in enumerate(lines.values()):
        assert np.all(found[1 + 2 * k] <= found[2 + 2 * k])
        if seen.any():
            assert found[1 + 2 * k].min() <= values[seen].min()
            assert found[2 + 2 * k].max() >= values[seen].max()
        own = np.searchsorted(found[0], t[seen], side="right") - 1
        assert np.all(values[seen] >= found[1 + 2 * k][own])
        assert np.all(values[seen] <= found[2 + 2 * k][own])


def test_a_few_samples_are_shown_as_they_are() -> None:
    t, lines = walk(5000, 1)
    found = Pyramid.of(t, lines).columns(float(t[100]), float(t[200]), 400)
    assert np.array_equal(found[0], t[99:201])
    assert np.array_equal(found[1], lines["walk"][99:201])
    assert np.array_equal(found[1], found[2])


def signals(samples: int = 3000) -> SignalSet:
    t, lines = walk(samples, 3)
    over = SignalPanel(
        "over", "Noise over walk", "walk", ("walk, rad", "noise, N m"), *around([lines["noise"]]),
        (DrawnLine("noise", "noise", "before"),), (curve("mean", "ink", np.arange(3.0), np.array([0.0, np.nan, 1.0])),),
    )  # fmt: skip
    time = SignalPanel(
        "time", "Noise over time", "time", ("time, s", "noise, N m"), *around([lines["noise"]]),
        (DrawnLine("noise", "noise", "before"),), band=0.5,
    )  # fmt: skip
    return SignalSet("Joint <b>1</b>", t, {"noise": lines["noise"]}, {"walk": lines["walk"]}, (time, over), 0.5, "N m")


def test_a_selection_is_what_lies_in_its_ranges() -> None:
    shown = signals(50_000)
    walked, noise = shown.axes["walk"], shown.lines["noise"]
    count, rows = shown.rows({"walk": (0.0, 10.0), "noise": (-0.1, 0.1)})
    inside = (walked >= 0) & (walked <= 10) & (np.abs(noise) <= 0.1)
    assert count == inside.sum() == rows.shape[1]
    assert np.array_equal(rows, [shown.t[inside], walked[inside], noise[inside]])
    count, rows = shown.rows({})
    assert (count, rows.shape) == (50_000, (3, MOST_ROWS))
    assert np.all(np.diff(rows[0]) > 0)


def test_a_set_comes_back_from_its_file(tmp_path: Path) -> None:
    shown = signals()
    shown.save(tmp_path / "set.npz")
    again = SignalSet.load(tmp_path / "set.npz")
    assert again.spec() == shown.spec()
    assert again.answer("rows", {}) == shown.answer("rows", {})
    assert json.loads(shown.answer("spec", {})[0])["panels"][1]["curves"][0]["y"] == [0.0, None, 1.0]


@pytest.mark.parametrize(
    ("what", "query"),
    [
        ("secrets", {}),
        ("columns", {"begin": "0", "end": "nan", "columns": "100"}),
        ("columns", {"begin": "0"}),
        ("rows", {"walk": "1"}),
        ("rows", {"__class__": "0,1"}),
    ],
)
def test_a_wrong_question_is_refused(what: str, query: dict[str, str]) -> None:
    with pytest.raises(AskedWrongly):
        signals().answer(what, query)


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """A page of 900 by 900 pixels."""
    made = browser.new_page(viewport={"width": 900, "height": 900})
    made.set_default_timeout(1000 * PATIENCE)
    yield made
    made.close()


@pytest.mark.xdist_group("studio")
def test_the_canvas_draws_zooms_and_tells(page: Any) -> None:
    """Pixels of the line's colour are there; closer up there are other ones; a name is text, not HTML."""
    colour = """(number) => {
      const panel = document.querySelector('tendon-signals').panels[number], { pen, canvas } = panel;
      const seen = pen.getImageData(0, 0, canvas.width, canvas.height).data;
      let count = 0;
      for (let k = 0; k < seen.length; k += 4) if (seen[k] > seen[k + 2] + 30) count += 1;
      return count;
    }"""
    with served({"one": signals()}) as address:
        page.goto(address)
        page.wait_for_selector("tendon-signals[data-ready]")
        whole = page.evaluate(colour, 0)
        assert whole > 500
        assert page.evaluate(colour, 1) > 100
        canvas = page.locator("canvas").first
        canvas.focus()
        for _ in range(12):
            page.keyboard.press("+")
        page.wait_for_function("document.querySelector('tendon-signals').detail !== null")
        view = page.evaluate("(({ u0, u1 }) => u1 - u0)(document.querySelector('tendon-signals').panels[0].view)")
        assert view < 0.1 * 3.0
        assert 0 < page.evaluate(colour, 0) < whole
        page.keyboard.press("0")
        page.keyboard.press("s")
        page.wait_for_selector(".signals-said[data-lit]")
        assert "3,000" in page.inner_text(".signals-said")
        assert page.locator("tendon-signals b b").count() == 0
        assert "<b>1</b>" in page.get_attribute("canvas", "aria-label")


def figures(page: Any) -> list[float]:
    """What is said of a selection: the first number of each figure."""
    said = page.locator(".signals-said dd").all_inner_texts()
    return [float(re.findall(r"[\d.]+", text.replace(",", ""))[0]) for text in said]


@pytest.mark.xdist_group("studio")
def test_a_page_that_stands_alone_draws_and_selects_the_same(tmp_path: Path, page: Any) -> None:
    """Its numbers are those of the set but for the steps in which they are written; nothing is asked of anybody."""
    shown = signals(2500)
    scripts = "".join(f"<script>{(STATIC / name).read_text()}</script>" for name in EMBEDDED_SCRIPTS)
    data = f'<script type="application/json">{html.embedded(shown.embedded())}</script>'
    path = tmp_path / "page.html"
    path.write_text(f'<meta charset="utf-8"><tendon-signals>{data}</tendon-signals>{scripts}')
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    page.wait_for_selector("tendon-signals[data-ready]")
    for name, values in shown.signals.items():
        there = np.array(page.evaluate(f"[...document.querySelector('tendon-signals').rows.signals['{name}']]"))
        assert np.allclose(there, values, rtol=0, atol=np.ptp(values) / 65535)
    page.evaluate("document.querySelector('tendon-signals').select({ noise: [0, 10] })")
    page.wait_for_selector(".signals-said[data-lit]")
    lit = page.evaluate("document.querySelector('tendon-signals').lit.count")
    assert abs(lit - np.count_nonzero(shown.lines["noise"] >= 0)) <= 2
    inside = shown.lines["noise"][shown.lines["noise"] >= 0]
    said = dict(zip(page.locator(".signals-said dt").all_inner_texts(), figures(page), strict=True))
    assert said["noise, mean"] == pytest.approx(inside.mean(), rel=5e-3)
    assert said["noise, rms"] == pytest.approx(np.sqrt(np.mean(inside**2)), rel=5e-3)
    share = np.sum(inside**2) / np.sum(shown.lines["noise"] ** 2)
    assert said["of all squares of noise"] == pytest.approx(100 * share, rel=1e-2)
    assert asked == [path.as_uri()]


@pytest.mark.parametrize("recorded", [True, False])
def test_a_residual_is_drawn_over_the_temperature_where_that_is_recorded(recorded: bool) -> None:
    """A torque that falls as the joint warms up: the temperature explains the residual, and its panel says so."""
    t = np.linspace(0.0, 60.0, 6000)
    q, warmth = np.sin(1.3 * t), 20 * (1 - np.exp(-t / 20))
    tau = 0.05 * warmth + 0.01 * np.random.default_rng(0).standard_normal(len(t))
    still, known = np.zeros(len(t)), warmth if recorded else None
    series = JointSeries(
        1, "N m", "rad", t, still.astype(int), q, 1.3 * np.cos(1.3 * t), -1.69 * q, 2.0 * q, known, tau, still,
        Floor(0.01, "spectrum", 0.01, None),
    )  # fmt: skip
    over = {panel.x: panel for panel in of_series(series, None).panels if panel.kind == "over"}
    assert ("temperature" in over) == recorded
    if recorded:
        assert over["temperature"].labels[0] == "temperature above the start, K"
        assert int(over["temperature"].note.split("explains ")[1].split()[0]) > 80
        means = over["temperature"].curves[0]
        seen = [(x, y) for x, y in zip(means.x, means.y, strict=True) if x is not None and y is not None]
        assert np.allclose([y for _, y in seen], [0.05 * x for x, _ in seen], atol=0.05)
