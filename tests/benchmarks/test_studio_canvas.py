"""A million samples of three signals, moved by the reader's hand: how long a frame takes, beside Plotly and Bokeh."""

from __future__ import annotations

import importlib.util
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.report.signals.signal_set import DrawnLine, SignalPanel, SignalSet, around
from tests.benchmarks import harness
from tests.runtime.studio.browser import CHROMIUM
from tests.runtime.studio.signal_page import served

SAMPLES = harness.sized(1_000_000, 50_000)
FRAMES = harness.sized(200, 10)
OTHERS = harness.sized(12, 2)
"""frames of the others, which take up to seconds each."""
MOST_FRAME = 16.0
"""ms of a frame while a view is moved: sixty a second."""
MOST_FIRST = 2.0
"""s from samples in memory to their first picture in the browser."""
RATE = 1000.0
WORK = """([frames, seconds, width]) => {
  const all = document.querySelector("tendon-signals"), panel = all.panels[0], taken = [];
  for (let k = 0; k < frames; k++) {
    const begin = (seconds - width) * (0.2 + 0.5 * k / frames), began = performance.now();
    all.setView(panel, { ...panel.view, u0: begin, u1: begin + width });
    all.paint();
    for (const { pen } of all.panels) pen.getImageData(0, 0, 1, 1);
    taken.push(performance.now() - began);
  }
  return taken;
}"""
"""The same movement of ours without waiting for the screen: ms until every pixel of it is there to be read."""

PANNED = """async ([frames, seconds, width, move]) => {
  const step = new Function("begin", "end", move), taken = [];
  const drawn = () => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)));
  for (let k = 0; k < frames; k++) {
    const begin = (seconds - width) * (0.2 + 0.5 * k / frames), began = performance.now();
    await step(begin, begin + width);
    await drawn();
    taken.push(performance.now() - began);
  }
  return taken;
}"""
"""Moves a view through the middle of a recording; ms of every frame, from the movement to the end of its drawing."""

OURS = """const all = document.querySelector("tendon-signals"), panel = all.panels[0];
all.setView(panel, { ...panel.view, u0: begin, u1: end });"""
STILL = ""
PLOTLY = "return Plotly.relayout('plot', { 'xaxis.range': [begin, end] });"
BOKEH = "const range = Bokeh.documents[0].roots()[0].x_range; range.setv({ start: begin, end });"


def signals() -> SignalSet:
    """Torque, prediction and residual of a joint that turns to and fro."""
    rng = np.random.default_rng(1)
    t = np.arange(SAMPLES) / RATE
    predicted = 8 * np.sin(2 * np.pi * 0.31 * t) + 2 * np.sign(np.cos(2 * np.pi * 0.31 * t))
    residual = 0.3 * np.sin(2 * np.pi * 1.7 * t) + rng.normal(scale=0.2, size=SAMPLES)
    lines = {"measured": predicted + residual, "predicted": predicted, "residual": residual}
    torque = (DrawnLine("measured", "measured", "ink"), DrawnLine("predicted", "predicted", "before"))
    left = (DrawnLine("residual", "residual", "before"),)
    labels = ("time, s", "torque, N m")
    panels = (
        SignalPanel("time", "Torque over time", "time", labels, *around([lines["measured"]]), torque),
        SignalPanel("time", "Residual over time", "time", labels, *around([residual]), left, band=0.2),
    )
    return SignalSet("Joint 1", t, lines, {}, panels, 0.2, "N m")


def panned(page: Any, move: str, frames: int, width: float) -> list[float]:
    found: list[float] = page.evaluate(PANNED, [frames, SAMPLES / RATE, width, move])
    return found


def data(page: Any, shown: SignalSet) -> None:
    """The same samples in another page, as typed arrays."""
    rows = np.array([shown.t, *shown.lines.values()])
    page.route("**/raw", lambda route: route.fulfill(body=rows.astype("<f8").tobytes()))
    page.route("**/blank", lambda route: route.fulfill(body="<div id=plot style='width:1200px;height:500px'></div>"))
    page.goto("http://127.0.0.1/blank")
    page.evaluate(
        """async () => {
          const all = new Float64Array(await (await fetch('/raw')).arrayBuffer()), n = all.length / 4;
          window.rows = [0, 1, 2, 3].map((k) => all.subarray(k * n, (k + 1) * n));
        }"""
    )


def plotly(page: Any, shown: SignalSet) -> float:
    """Seconds of the first picture."""
    import plotly

    data(page, shown)
    page.add_script_tag(path=Path(plotly.__file__).parent / "package_data" / "plotly.min.js")
    began = time.perf_counter()
    page.evaluate(
        """() => Plotly.newPlot('plot', [1, 2, 3].map((k) => ({ x: rows[0], y: rows[k], mode: 'lines', type: 'scatter',
        line: { width: 1 } })), { width: 1200, height: 500 }, { staticPlot: false })"""
    )
    return time.perf_counter() - began


def bokeh(page: Any, shown: SignalSet) -> float:
    """Seconds of the first picture."""
    import bokeh

    data(page, shown)
    scripts = Path(bokeh.__file__).parent / "server" / "static" / "js"
    for name in ("bokeh.min.js", "bokeh-api.min.js"):
        page.add_script_tag(path=scripts / name)
    began = time.perf_counter()
    page.evaluate(
        """async () => {
          const plot = Bokeh.Plotting.figure({ width: 1200, height: 500, x_range: [0, rows[0].at(-1)] });
          const source = new Bokeh.ColumnDataSource({ data: { t: rows[0], a: rows[1], b: rows[2], c: rows[3] } });
          for (const name of ['a', 'b', 'c']) plot.line({ field: 't' }, { field: name }, { source });
          await Bokeh.Plotting.show(plot, '#plot');
          await new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)));
        }"""
    )
    return time.perf_counter() - began


def test_a_million_samples_under_the_hand() -> None:
    playwright = pytest.importorskip("playwright.sync_api", reason="no browser: pip install playwright")
    if CHROMIUM is None:
        pytest.skip("no browser: apt-get install chromium")
    shown, rows, work = signals(), [], []
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        with served({"joint": shown}) as address:
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            began = time.perf_counter()
            page.goto(address)
            page.wait_for_selector("tendon-signals[data-ready]")
            first = time.perf_counter() - began
            for part in (0.5, 0.01):
                work.append(page.evaluate(WORK, [FRAMES, SAMPLES / RATE, part * SAMPLES / RATE]))
                rows.append(row("Tendon, its work alone", part, work[-1], first))
            rows += [row("Tendon", p, panned(page, OURS, FRAMES, p * SAMPLES / RATE), first) for p in (0.5, 0.01)]
            rows.append(row("a page at rest", 1.0, panned(page, STILL, FRAMES, SAMPLES / RATE), None))
        for name, draw, move in (("plotly", plotly, PLOTLY), ("bokeh", bokeh, BOKEH)):
            if importlib.util.find_spec(name) is None:
                rows.append((name, "is not installed", "", "", ""))
                continue
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            page.set_default_timeout(180_000)
            took = draw(page, shown)
            rows += [row(name, p, panned(page, move, OTHERS, p * SAMPLES / RATE), took) for p in (0.5, 0.01)]
            page.close()
        browser.close()
    harness.show(
        f"Moving a view of {SAMPLES} samples of three signals",
        ("", "seen of it", "ms, median", "1 of 20 over", "s at first"),
        rows,
        (
            "Chromium without a graphics card; a frame is from the movement to the end of its drawing; the wait for",
            "the screen, 1/60 s, is in it: that of a page at rest is nothing else",
        ),
    )
    if not harness.SHORT:
        assert max(float(np.median(taken)) for taken in work) < MOST_FRAME
        assert first < MOST_FIRST


def row(name: str, part: float, taken: list[float], first: float | None) -> tuple[str, ...]:
    slow = f"{np.quantile(taken, 0.95):.3g}" if len(taken) > OTHERS else "–"
    return name, f"{100 * part:g} %", f"{np.median(taken):.3g}", slow, "" if first is None else f"{first:.3g}"
