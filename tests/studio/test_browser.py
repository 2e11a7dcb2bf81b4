"""The studio in a real browser: the loop from opening to the fallen error by clicks alone, and what else may happen."""

from __future__ import annotations

import gzip
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.studio.server import write_door
from tests.studio.browser import ROOT, Watched, chromium, studio

PICTURE = ROOT / ".images" / "studio.png"

SOON = 20_000
"""ms for what the page does by itself, on a machine that is busy with other tests."""
WORK = 240_000
"""ms for work of a session's process."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def fitted(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a session of the demo in which step 0 is fitted and diagnosed, and step 1 added, by clicks."""
    folder = tmp_path_factory.mktemp("demo")
    with studio(folder) as address:
        seen = Watched(browser, address)
        page = seen.page
        page.click("[data-do=demo]", timeout=SOON)
        page.click("[data-do=diagnose]:not([disabled])", timeout=WORK)
        page.wait_for_selector("[data-do=add]:not([disabled])", timeout=WORK)
        assert "lacks stribeck at joint 1" in page.inner_text("#verdict h1")
        before = error(page)
        page.click("[data-do=add]:not([disabled])")
        page.wait_for_selector("[data-step='1'][aria-current=step]", timeout=WORK)
        page.wait_for_selector("#verdict h1:has-text('falls')", timeout=SOON)
        assert error(page) < 0.6 * before
        assert "at its noise floor" in page.inner_text("#errors")
        page.wait_for_selector("tendon-signals[data-ready]", timeout=SOON)
        assert seen.wrong == []
        assert seen.outside() == []
    return folder


def error(page: Any) -> float:
    """Of the current step, per cent: the last figure beside the first bar."""
    return float(re.findall(r"([\d.]+)\s%", page.inner_text(".bar-row.fitted .bar-value"))[-1])


def reopened(folder: Path, tmp_path: Path) -> Path:
    """A session of one's own, equal to another."""
    subprocess.run(["cp", "-r", str(folder / "studio-session"), str(tmp_path / "session")], check=True)
    return tmp_path / "session"


def test_the_loop_by_clicks_alone_and_opened_again(browser: Any, fitted: Path, tmp_path: Path) -> None:
    """A closed tab and an ended server lose nothing; undo goes back, redo forth."""
    with studio(tmp_path, reopened(fitted, tmp_path)) as address:
        seen = Watched(browser, address)
        page = seen.page
        page.wait_for_selector("[data-step='1'][aria-current=step]", timeout=SOON)
        after = error(page)
        page.click("[data-do=undo]")
        page.wait_for_selector("[data-step='0'][aria-current=step]", timeout=SOON)
        assert error(page) > 1.5 * after
        assert "lacks stribeck" in page.inner_text("#verdict h1")
        page.click("[data-do=redo]")
        page.wait_for_selector("[data-step='1'][aria-current=step]", timeout=SOON)
        assert error(page) == after
        assert "[joint.effects.stribeck]" in page.inner_text("[data-difference]")
        assert "tendon add drive.toml stribeck --joint 1" in page.inner_text("[data-commands]")
        with page.expect_download() as begun:
            page.click("a.download:has-text('model file')")
        assert "stribeck" in Path(begun.value.path()).read_text()
        assert seen.wrong == []


def test_the_file_that_a_browser_is_handed_leads_to_the_page(browser: Any, tmp_path: Path) -> None:
    """From a file, which is another site to the browser, to a page that has its cookie."""
    with studio(tmp_path) as address:
        write_door(tmp_path / "open.html", address)
        seen = Watched(browser, (tmp_path / "open.html").as_uri())
        seen.page.wait_for_selector("[data-do=demo]", timeout=SOON)
        assert "token" not in seen.page.url


def test_a_selection_is_lit_in_every_view(browser: Any, fitted: Path, tmp_path: Path) -> None:
    """Samples that are selected over the velocity, by the pointer: the same ones are told of, and cleared by Escape."""
    with studio(tmp_path, reopened(fitted, tmp_path)) as address:
        page = Watched(browser, address).page
        page.wait_for_selector("tendon-signals[data-ready]", timeout=SOON)
        canvas = page.locator("#joint figure:has-text('Residual over velocity') canvas").first
        canvas.scroll_into_view_if_needed()
        box = canvas.bounding_box()
        page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 10)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.95 * box["width"], box["y"] + 0.8 * box["height"], steps=4)
        page.mouse.up()
        page.wait_for_selector(".signals-said[data-lit]", timeout=SOON)
        lit = "document.querySelector('tendon-signals').lit"
        velocity = page.evaluate(f"[Math.min(...{lit}.signals.velocity), {lit}.count, {lit}.total]")
        assert velocity[0] > 0
        assert 0 < velocity[1] == velocity[2]
        assert f"{velocity[2]:,}" in page.inner_text(".signals-said")
        canvas.press("Escape")
        page.wait_for_selector(".signals-said:not([data-lit])", timeout=SOON)


def test_a_cancelled_diagnosis_leaves_the_session_as_it_was(browser: Any, fitted: Path, tmp_path: Path) -> None:
    session = reopened(fitted, tmp_path)
    before = sorted(p.relative_to(session) for p in (session / "steps").rglob("*"))
    with studio(tmp_path, session) as address:
        page = Watched(browser, address).page
        page.click("[data-do=diagnose]:not([disabled])", timeout=SOON)
        page.wait_for_selector("progress", timeout=SOON)
        page.click("[data-do=cancel]")
        page.wait_for_selector("[role=alert]:has-text('Cancelled')", timeout=SOON)
        page.wait_for_selector("[data-do=diagnose]:not([disabled])", timeout=SOON)
    assert sorted(p.relative_to(session) for p in (session / "steps").rglob("*")) == before


def test_a_broken_recording_is_an_answer_and_a_cure_is_a_button(browser: Any, fitted: Path, tmp_path: Path) -> None:
    """Dropped with a gap in it: the page says so and offers to split it; then it is compared."""
    text = gzip.decompress((fitted / "studio-session/given/fitted.csv.gz").read_bytes()).decode().splitlines()
    broken = tmp_path / "broken.csv"
    broken.write_text("\n".join([*text[:20_000], *text[20_400:40_000]]) + "\n")
    nonsense = tmp_path / "nonsense.csv"
    nonsense.write_text("no recording\n")
    with studio(tmp_path) as address:
        page = Watched(browser, address).page
        page.select_option("#start select", "drive", timeout=SOON)
        page.wait_for_selector("#start .given:has-text('drive.toml')", timeout=SOON)
        page.set_input_files("#start file-drop[as=fitted] input", broken)
        page.click("[data-do=begin]:not([disabled])", timeout=SOON)
        page.click("[data-do=cure]:has-text('Split at the gaps')", timeout=WORK)
        page.wait_for_selector("[data-do=diagnose]:not([disabled])", timeout=WORK)
        page.set_input_files("#recordings file-drop[as=fitted] input", nonsense)
        page.wait_for_selector("[data-do=begin]:not([disabled])", timeout=SOON)
        page.click("[data-do=begin]:not([disabled])")
        page.wait_for_selector("[role=alert]:has-text('nonsense.csv')", timeout=WORK)


def test_the_held_out_recording_is_drawn_beside_in_the_same_way(browser: Any, fitted: Path, tmp_path: Path) -> None:
    """The same panels with the same legend: before and after on both sides, and other numbers."""
    with studio(tmp_path, reopened(fitted, tmp_path)) as address:
        page = Watched(browser, address).page
        page.click("[data-do=held-out]", timeout=SOON)
        for k in (0, 1):
            page.locator("#joint tendon-signals[data-ready]").nth(k).wait_for(timeout=SOON)
        one, other = (page.locator("#joint tendon-signals").nth(k) for k in (0, 1))
        for part in ("figcaption b", ".signals-legend button"):
            assert one.locator(part).all_inner_texts() == other.locator(part).all_inner_texts()
        assert one.locator("figcaption b").count() == 7
        assert {"residual before", "residual after"} <= set(one.locator(".signals-legend button").all_inner_texts())
        assert one.locator(".signals-said").inner_text() != other.locator(".signals-said").inner_text()


def test_two_steps_are_compared(browser: Any, fitted: Path, tmp_path: Path) -> None:
    """Their errors beside each other, and what of the model file is another."""
    with studio(tmp_path, reopened(fitted, tmp_path)) as address:
        page = Watched(browser, address).page
        page.wait_for_selector("#change select", timeout=SOON)
        page.select_option("#change select", "0")
        page.wait_for_selector("#change table", timeout=SOON)
        before, after, held_before, held_after = page.locator("#change tbody td").all_inner_texts()
        assert float(after.split()[0]) < 0.6 * float(before.split()[0])
        assert float(held_after.split()[0]) < 0.6 * float(held_before.split()[0])
        assert "[joint.effects.stribeck]" in "".join(page.locator("[data-difference] .came").all_inner_texts())


def test_values_of_a_finding_are_tried_before_it_is_added(browser: Any, fitted: Path, tmp_path: Path) -> None:
    """A slider on its card: the residual with that value, and no step more."""
    with studio(tmp_path, reopened(fitted, tmp_path)) as address:
        seen = Watched(browser, address)
        page = seen.page
        page.click("[data-do=undo]", timeout=SOON)
        card = page.locator("#findings article").first
        slider = card.locator("input[type=range]").first
        slider.focus(timeout=SOON)
        page.keyboard.press("Home")
        said = card.get_by_text("with these values")
        said.wait_for(timeout=WORK)
        found, tried = (float(text.split(" %")[0].split()[-1]) for text in said.inner_text().split("as fitted"))
        assert tried > 1.2 * found
        card.locator("tendon-signals[data-ready]").wait_for(timeout=SOON)
        assert page.locator("[data-step]").count() == 2
        assert slider.evaluate("own => own === document.activeElement")
        assert seen.wrong == []


def test_designing_a_motion_shows_how_far_it_is_and_is_cancelled(browser: Any, fitted: Path, tmp_path: Path) -> None:
    with studio(tmp_path, reopened(fitted, tmp_path)) as address:
        page = Watched(browser, address).page
        page.click("[data-do=undo]", timeout=SOON)
        page.click("[data-do=design]:not([disabled])", timeout=SOON)
        page.wait_for_selector("#progress li.current:has-text('looking for a motion')", timeout=WORK)
        page.wait_for_selector("#progress p:has-text('judging the pieces of motion')", timeout=WORK)
        assert page.evaluate("document.querySelector('progress').value") >= 0.5
        page.click("[data-do=cancel]")
        page.wait_for_selector("[role=alert]:has-text('Cancelled')", timeout=SOON)
        page.wait_for_selector("[data-do=design]:not([disabled])", timeout=SOON)
        assert page.locator("a[href^='/download/motion']").count() == 0


@pytest.mark.slow
def test_the_motion_that_decides_is_designed_and_taken_away(browser: Any, fitted: Path, tmp_path: Path) -> None:
    """To its end: what the simulation says of it, and a table of positions that never jumps."""
    with studio(tmp_path, reopened(fitted, tmp_path)) as address:
        page = Watched(browser, address).page
        page.click("[data-do=undo]", timeout=SOON)
        page.click("[data-do=design]:not([disabled])", timeout=SOON)
        page.wait_for_selector("a[href^='/download/motion']", timeout=4 * WORK)
        with page.expect_download() as begun:
            page.click("a[href^='/download/motion']")
        motion = np.loadtxt(begun.value.path(), delimiter=",", skiprows=1)
    assert len(motion) > 1000
    assert np.all(np.diff(motion[:, 0]) > 0)
    assert np.abs(np.diff(motion[:, 1])).max() < 0.1


def turned(source: Path, target: Path) -> Path:
    """A recording whose torque has the other sign."""
    head, *lines = gzip.decompress(source.read_bytes()).decode().splitlines()
    place = next(k for k, name in enumerate(head.split(",")) if name.startswith("tau1"))
    for k, line in enumerate(lines):
        cells = line.split(",")
        cells[place] = cells[place][1:] if cells[place].startswith("-") else f"-{cells[place]}"
        lines[k] = ",".join(cells)
    target.write_text("\n".join([head, *lines]) + "\n")
    return target


def test_a_torque_of_the_wrong_sign_is_cured_by_a_button(browser: Any, fitted: Path, tmp_path: Path) -> None:
    """The page says so at its head, and with the cure the error falls to that of the recording as it was."""
    wrong = turned(fitted / "studio-session/given/fitted.csv.gz", tmp_path / "turned.csv")
    with studio(tmp_path, "drive", wrong) as address:
        seen = Watched(browser, address)
        page = seen.page
        page.wait_for_selector("#verdict [data-do=cure]:not([disabled])", timeout=WORK)
        assert "wrong sign" in page.inner_text("#verdict")
        before = error(page)
        page.click("#verdict [data-do=cure]")
        page.wait_for_selector("#verdict:not(:has([data-do=cure])) [data-do=diagnose]:not([disabled])", timeout=WORK)
        assert error(page) < before / 3
        assert "--map tau1=-tau1" in page.inner_text("[data-commands]")
        assert seen.wrong == []


URDF = """<robot name="bench"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_a_robot_description_is_dropped_and_a_broken_one_is_said(browser: Any, tmp_path: Path) -> None:
    """By the event of a real drop; a model file is made of it."""
    with studio(tmp_path) as address:
        page = Watched(browser, address).page
        page.wait_for_selector("#start file-drop[as=model]", timeout=SOON)

        def drop(name: str, text: str) -> None:
            made = "([name, text]) => { const d = new DataTransfer(); d.items.add(new File([text], name)); return d; }"
            data = page.evaluate_handle(made, [name, text])
            page.dispatch_event("#start file-drop[as=model]", "drop", {"dataTransfer": data})

        drop("broken.urdf", "<robot")
        page.wait_for_selector("#start file-drop[as=model] .warning:has-text('broken.urdf')", timeout=SOON)
        drop("bench.urdf", URDF)
        page.wait_for_selector("#start .given:has-text('bench')", timeout=SOON)
        assert page.is_disabled("[data-do=begin]")
    assert 'name = "hinge"' in (tmp_path / "studio-session/given/bench.toml").read_text()


@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (390, "light"), (1360, "dark")])
def test_nothing_is_cut_off(browser: Any, fitted: Path, tmp_path: Path, width: int, scheme: str) -> None:
    """On a phone and on a desk; texts stand out in both schemes, and every control has a name."""
    with studio(tmp_path, reopened(fitted, tmp_path)) as address:
        seen = Watched(browser, address, width, scheme)
        page = seen.page
        page.wait_for_selector("tendon-signals[data-ready]", timeout=SOON)
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        named = "e => !(e.ariaLabel || e.textContent.trim() || e.labels?.length || e.title)"
        assert (
            page.evaluate(f"[...document.querySelectorAll('button,select,input,canvas')].filter({named}).length") == 0
        )
        paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (sum(map(int, re.findall(r"\d+", paper)[:3])) < 200) == (scheme == "dark")
        assert seen.wrong == []


def test_by_the_keyboard_alone(browser: Any, fitted: Path, tmp_path: Path) -> None:
    """Undo is reached by Tab and pressed by Enter, and has the focus still; a view is zoomed and selected by keys."""
    with studio(tmp_path, reopened(fitted, tmp_path)) as address:
        page = Watched(browser, address).page
        page.wait_for_selector("tendon-signals[data-ready]", timeout=SOON)
        for _ in range(40):
            page.keyboard.press("Tab")
            if page.evaluate("document.activeElement.dataset.do") == "undo":
                break
        page.keyboard.press("Enter")
        page.wait_for_selector("[data-step='0'][aria-current=step]", timeout=SOON)
        page.wait_for_selector("tendon-signals[data-ready]", timeout=SOON)
        canvas = page.locator("tendon-signals canvas").first
        canvas.focus()
        for key in ("+", "+", "+", "ArrowRight", "s"):
            page.keyboard.press(key)
        page.wait_for_selector(".signals-said[data-lit]", timeout=SOON)
        assert 0 < page.evaluate("(s => s.lit.total / s.rows.total)(document.querySelector('tendon-signals'))") < 0.7


def test_the_picture_of_the_guide(browser: Any, fitted: Path, tmp_path: Path) -> None:
    """What the README shows is the page, as large as that is here; TENDON_PICTURE=write makes it anew."""
    with studio(tmp_path, reopened(fitted, tmp_path)) as address:
        page = Watched(browser, address).page
        page.wait_for_selector("tendon-signals[data-ready]", timeout=SOON)
        picture = page.screenshot()
    if os.environ.get("TENDON_PICTURE") == "write":
        PICTURE.write_bytes(picture)
    kept = PICTURE.read_bytes()
    assert kept[:24] == picture[:24]  # signature, width and height


@pytest.mark.slow
def test_the_loop_on_four_joints(browser: Any, tmp_path: Path) -> None:
    """A hidden effect at one of four joints is found, added, and its error falls, by clicks alone."""
    command = [sys.executable, "-c", "from runtime.cli.main import main; main()", "simulate", "vishard4"]
    hidden = ["--out", "run.csv.gz", "--hide", "stribeck@2", "--seconds", "20"]
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin:/usr/local/bin", "HOME": str(Path.home())}
    subprocess.run([*command, *hidden], cwd=tmp_path, env=environment, check=True, capture_output=True)
    with studio(tmp_path, "vishard4", "run.csv.gz") as address:
        seen = Watched(browser, address)
        page = seen.page
        page.click("[data-do=diagnose]:not([disabled])", timeout=4 * WORK)
        page.wait_for_selector("[data-do=add]:not([disabled])", timeout=6 * WORK)
        assert page.get_attribute("[data-joint='2']", "aria-pressed") == "true"
        page.click("[data-joint='1']")
        page.wait_for_selector("#joint h2:has-text('Joint 1')", timeout=SOON)
        page.click("[data-joint='2']")
        page.wait_for_selector("#joint h2:has-text('Joint 2')", timeout=SOON)
        page.click("[data-do=add]:not([disabled])")
        page.wait_for_selector("[data-step='1'][aria-current=step]", timeout=2 * WORK)
        page.wait_for_selector("#verdict h1:has-text('falls')", timeout=SOON)
        assert seen.wrong == []
        assert seen.outside() == []
