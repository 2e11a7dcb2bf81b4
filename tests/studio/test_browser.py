"""The studio in a real browser: the loop by clicks alone, and every other control of the page."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_arm import BENCH, SPRING, THERE_AND_BACK, trajectory
from guides import demo_errors, differs
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from runtime.studio.server import write_start_file
from tests.studio.browser import ROOT, Server, Watched, served
from tests.studio.conftest import EVIL
from tests.studio.test_work import broken

pytestmark = pytest.mark.xdist_group("studio")
PICTURE = ROOT / ".images" / "studio.png"
Tab = Callable[..., Watched]


def test_the_loop_of_the_demo_by_clicks_alone(tab: Tab, new_server: Server) -> None:
    """Compare, diagnose, add, see the error fall; back and forth; another tab shows the same."""
    seen = tab(new_server)
    page = seen.emptied()
    page.click("[data-do=demo]")
    page.click("[data-do=diagnose]:not([disabled])")
    page.wait_for_selector("[data-do=add]:not([disabled])")
    assert "lacks stribeck at joint 1" in page.inner_text("#verdict h1")
    before = seen.error()
    page.click("[data-do=add]:not([disabled])")
    page.wait_for_selector("[data-step='1'][aria-current=step]")
    page.wait_for_selector("#verdict h1:has-text('falls')")
    after = seen.error()
    assert after < 0.6 * before
    shown = re.findall(r"([\d.]+)\s%", page.inner_text("#verdict h1"))
    assert differs(" ".join(demo_errors()[::2]), " ".join(shown)) is None
    assert "at its noise floor" in page.inner_text("#errors")
    page.wait_for_selector("tendon-signals[data-ready]")
    page.click("[data-do=undo]")
    page.wait_for_selector("[data-step='0'][aria-current=step]")
    assert seen.error() == before
    assert "lacks stribeck" in page.inner_text("#verdict h1")
    page.click("[data-do=redo]")
    page.wait_for_selector("[data-step='1'][aria-current=step]")
    assert "[joint.effects.stribeck]" in page.inner_text("[data-difference]")
    assert "tendon add drive.toml stribeck --joint 1" in page.inner_text("[data-commands]")
    other = tab(new_server)
    other.page.wait_for_selector("[data-step='1'][aria-current=step]")
    assert other.error() == after
    assert seen.wrong == []
    assert seen.outside() == []


def test_a_session_is_opened_again_and_its_model_taken_away(fitted: Watched) -> None:
    """Another process shows what the first one found."""
    page = fitted.page
    assert "[joint.effects.linear_spring]" in page.inner_text("[data-difference]")
    with page.expect_download() as begun:
        page.click("a.download:has-text('model file')")
    assert "linear_spring" in Path(begun.value.path()).read_text()
    assert fitted.wrong == []


def test_the_file_that_a_browser_is_handed_leads_to_the_page(browser: Any, new_server: Server, tmp_path: Path) -> None:
    """A file is another site to the browser; the page that it opens has the cookie all the same."""
    write_start_file(tmp_path / "open.html", new_server.address)
    seen = Watched(browser, (tmp_path / "open.html").as_uri())
    seen.page.wait_for_selector("#plans h2")
    assert "token" not in seen.page.url
    seen.context.close()


def test_a_selection_is_lit_in_every_view(fitted: Watched) -> None:
    """Samples are selected over the velocity with the pointer, described, and cleared by Escape."""
    page = fitted.page
    page.wait_for_selector("#joint tendon-signals[data-ready]")
    canvas = page.locator("#joint figure:has-text('Residual over velocity') canvas").first
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 10)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.95 * box["width"], box["y"] + 0.8 * box["height"], steps=4)
    page.mouse.up()
    page.wait_for_selector("#joint .signals-said[data-lit]")
    lit = "document.querySelector('#joint tendon-signals').lit"
    velocity = page.evaluate(f"[Math.min(...{lit}.signals.velocity), {lit}.count, {lit}.total]")
    assert velocity[0] > 0
    assert 0 < velocity[1] == velocity[2]
    assert f"{velocity[2]:,}" in page.inner_text("#joint .signals-said")
    canvas.press("Escape")
    page.wait_for_selector("#joint .signals-said:not([data-lit])")


def files(folder: Path) -> dict[Path, int]:
    return {p: p.stat().st_mtime_ns for p in (folder / "session" / "steps").rglob("*") if p.is_file()}


def test_a_cancelled_diagnosis_leaves_the_session_as_it_was(fitted: Watched, fitted_server: Server) -> None:
    page, before = fitted.page, files(fitted_server.folder)
    page.click("[data-do=diagnose]:not([disabled])")
    page.wait_for_selector("progress")
    page.click("[data-do=cancel]")
    page.wait_for_selector("[role=alert]:has-text('Cancelled')")
    page.wait_for_selector("[data-do=diagnose]:not([disabled])")
    assert files(fitted_server.folder) == before


def test_a_broken_recording_is_an_answer_and_each_cure_a_button(
    tab: Tab, new_server: Server, recorded: Path, tmp_path: Path
) -> None:
    """A recording with a gap and with the torque's sign reversed: the page reports both, and a click cures each."""
    wrong = broken(recorded / EVIL, tmp_path / "wrong.csv")
    head, *lines = wrong.read_text().splitlines()
    place = head.split(",").index(next(name for name in head.split(",") if name.startswith("M")))
    turned = [
        [*cells[:place], str(-float(cells[place])), *cells[place + 1 :]] for cells in (x.split(",") for x in lines)
    ]
    wrong.write_text("\n".join([head.replace("M", "tau1"), *map(",".join, turned)]) + "\n")
    (tmp_path / "nonsense.csv").write_text("no recording\n")
    seen = tab(new_server)
    page = seen.emptied()
    page.set_input_files("#start file-drop[as=model] input", recorded / "drive.toml")
    page.wait_for_selector("#start .given:has-text('drive.toml')")
    page.set_input_files("#start file-drop[as=fitted] input", wrong)
    page.click("[data-do=begin]:not([disabled])")
    page.click("[data-do=cure]:has-text('Split at the gaps')")
    page.wait_for_selector("#verdict [data-do=cure]:not([disabled])")
    assert "wrong sign" in page.inner_text("#verdict")
    before = seen.error()
    page.click("#verdict [data-do=cure]")
    page.wait_for_selector("#verdict:not(:has([data-do=cure])) [data-do=diagnose]:not([disabled])")
    assert seen.error() < before
    assert "--map tau1=-tau1" in page.inner_text("[data-commands]")
    page.set_input_files("#recordings file-drop[as=fitted] input", tmp_path / "nonsense.csv")
    page.click("[data-do=begin]:not([disabled])")
    page.wait_for_selector("[role=alert]:has-text('nonsense.csv')")


def test_the_held_out_recording_is_drawn_beside_in_the_same_way(fitted: Watched) -> None:
    """The same panels with the same legend, before and after on both sides, and other numbers."""
    page = fitted.page
    page.click("[data-do=held-out]")
    one, other = (page.locator("#joint tendon-signals").nth(k) for k in (0, 1))
    for k in (0, 1):
        page.locator("#joint tendon-signals[data-ready]").nth(k).wait_for()
    for part in ("figcaption b", ".signals-legend button"):
        assert one.locator(part).all_inner_texts() == other.locator(part).all_inner_texts()
    assert one.locator("figcaption b").count() == 7
    assert {"residual before", "residual after"} <= set(one.locator(".signals-legend button").all_inner_texts())
    assert one.locator(".signals-said").inner_text() != other.locator(".signals-said").inner_text()


def test_two_steps_are_compared(fitted: Watched) -> None:
    """Their errors side by side, and the difference of their model files."""
    page = fitted.page
    page.select_option("#change select", "0")
    page.wait_for_selector("#change table")
    before, after, held_before, held_after = page.locator("#change tbody td").all_inner_texts()
    assert float(after.split()[0]) < 0.6 * float(before.split()[0])
    assert float(held_after.split()[0]) < 0.6 * float(held_before.split()[0])
    assert "[joint.effects.linear_spring]" in "".join(page.locator("[data-difference] .came").all_inner_texts())


def test_values_of_a_finding_are_tried_before_it_is_added(fitted: Watched) -> None:
    """A slider of the finding shows the residual with that value and makes no step."""
    page = fitted.at_step(0)
    count = page.locator("[data-step]").count()
    card = page.locator("#findings article").first
    slider = card.locator("input[type=range]").first
    slider.focus()
    page.keyboard.press("Home")
    said = card.get_by_text("with these values")
    said.wait_for()
    found, tried = (float(text.split(" %")[0].split()[-1]) for text in said.inner_text().split("as fitted"))
    assert tried > 1.2 * found
    card.locator("tendon-signals[data-ready]").wait_for()
    assert page.locator("[data-step]").count() == count
    assert slider.evaluate("own => own === document.activeElement")
    assert fitted.wrong == []


def test_designing_a_motion_shows_how_far_it_is_and_is_cancelled(fitted: Watched) -> None:
    page = fitted.at_step(0)
    page.click("[data-do=design]:not([disabled])")
    page.wait_for_selector("#progress li.current:has-text('designing a motion')")
    page.wait_for_selector("#progress p:has-text('judging the pieces of motion')")
    assert page.evaluate("document.querySelector('progress').value") >= 0.5
    page.click("[data-do=cancel]")
    page.wait_for_selector("[role=alert]:has-text('Cancelled')")
    page.wait_for_selector("[data-do=design]:not([disabled])")
    assert page.locator("a[href^='/download/motion']").count() == 0


@pytest.mark.slow
def test_the_motion_that_decides_is_designed_and_taken_away(fitted: Watched) -> None:
    """The motion is complete: a table of positions that never jumps."""
    page = fitted.at_step(0)
    page.context.set_default_timeout(3_600_000)
    page.click("[data-do=design]:not([disabled])")
    page.wait_for_selector("a[href^='/download/motion']")
    with page.expect_download() as begun:
        page.click("a[href^='/download/motion']")
    motion = np.loadtxt(begun.value.path(), delimiter=",", skiprows=1)
    assert len(motion) > 1000
    assert np.all(np.diff(motion[:, 0]) > 0)
    assert np.abs(np.diff(motion[:, 1])).max() < 0.1


URDF = """<robot name="bench"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_a_robot_description_is_dropped_and_a_broken_one_is_said(tab: Tab, new_server: Server) -> None:
    """By a real drop event; a model file is made from the URDF."""
    page = tab(new_server).emptied()

    def drop(name: str, text: str) -> None:
        made = "([name, text]) => { const d = new DataTransfer(); d.items.add(new File([text], name)); return d; }"
        data = page.evaluate_handle(made, [name, text])
        page.dispatch_event("#start file-drop[as=model]", "drop", {"dataTransfer": data})

    drop("broken.urdf", "<robot")
    page.wait_for_selector("#start file-drop[as=model] .warning:has-text('broken.urdf')")
    drop("bench.urdf", URDF)
    page.wait_for_selector("#start .given:has-text('bench')")
    assert page.is_disabled("[data-do=begin]")
    assert 'name = "hinge"' in (new_server.folder / "studio-session/given/bench.toml").read_text()


def test_a_plan_is_opened_and_its_page_shown_by_clicks(tab: Tab, new_server: Server, tmp_path: Path) -> None:
    """The plan's page runs its own scripts in another origin than the studio; no name becomes markup in either."""
    hostile = tmp_path / "<img src=x onerror=alert(1)>.json"
    trajectory(THERE_AND_BACK, springs={1: SPRING}).write(hostile)
    hostile.write_text(json.dumps(json.loads(hostile.read_text()) | {"scenario": "<b>there</b>"}))
    (tmp_path / "bench.toml").write_text(BENCH)
    seen = tab(new_server)
    page = seen.emptied()
    page.set_input_files("#start file-drop[as=model] input", tmp_path / "bench.toml")
    page.wait_for_selector("#start .given:has-text('bench.toml')")
    page.set_input_files("#plans file-drop input", hostile)
    link = page.locator("#plans a")
    link.wait_for()
    text = page.inner_text("#plans")
    assert "<img src=x onerror=alert(1)>.json" in text
    assert "<b>there</b> in 1.4 s, with friction" in text
    assert page.locator("#plans img, #plans b").count() == 0
    with page.context.expect_page() as opened:
        link.click()
    plan = opened.value
    plan.wait_for_selector("h1:has-text('<b>there</b> in 1.4 s')")
    assert plan.locator("figure svg").count() > 0
    before = plan.locator("#motion svg").first.inner_html()
    plan.click("#motion [data-play]")
    plan.wait_for_function("before => document.querySelector('#motion svg').innerHTML !== before", arg=before)
    assert plan.evaluate("window.origin") == "null"
    page.click("[data-do=close-plan-1]")
    link.wait_for(state="detached")
    assert seen.wrong == []
    assert seen.outside() == []


@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1360, "light")])
def test_nothing_is_cut_off(tab: Tab, fitted_server: Server, width: int, scheme: str) -> None:
    """On a phone and on a desk, dark and light; and every control has a name."""
    seen = tab(fitted_server, width=width, scheme=scheme)
    page = seen.at_step(1)
    page.wait_for_selector("#joint tendon-signals[data-ready]")
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    named = "e => !(e.ariaLabel || e.textContent.trim() || e.labels?.length || e.title)"
    assert page.evaluate(f"[...document.querySelectorAll('button,select,input,canvas')].filter({named}).length") == 0
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, re.findall(r"\d+", paper)[:3])) < 200) == (scheme == "dark")
    assert seen.wrong == []


def test_by_the_keyboard_alone(fitted: Watched) -> None:
    """Undo is reached by Tab and pressed by Enter; a view is zoomed and selected by keys."""
    page = fitted.page
    page.reload()
    page.wait_for_selector("#joint tendon-signals[data-ready]")
    for _ in range(40):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.dataset.do") == "undo":
            break
    page.keyboard.press("Enter")
    page.wait_for_selector("[data-step='0'][aria-current=step]")
    page.wait_for_selector("#joint tendon-signals[data-ready]")
    canvas = page.locator("#joint tendon-signals canvas").first
    canvas.focus()
    for key in ("+", "+", "+", "ArrowRight", "s"):
        page.keyboard.press(key)
    page.wait_for_selector("#joint .signals-said[data-lit]")
    assert 0 < page.evaluate("(s => s.lit.total / s.rows.total)(document.querySelector('#joint tendon-signals'))") < 0.7


def test_no_name_becomes_a_part_of_the_page(fitted: Watched, fitted_server: Server) -> None:
    """Neither the name of a recording nor a comment of the model file, which both contain markup."""
    page = fitted.at_step(0)
    page.get_by_text(EVIL).first.wait_for()
    page.wait_for_selector("#findings article")
    assert (
        "<script>document.title='evil'</script>"
        in fitted_server.folder.joinpath("session/given/drive.toml").read_text()
    )
    assert page.title() == "Tendon studio"
    assert page.locator("img").count() == 0
    assert fitted.outside() == []
    assert not any(url.endswith("/x") for url in fitted.asked)


HIDE = "[data-do=hide]:not([disabled])"


def test_a_slider_says_the_error_and_a_hidden_effect_whether_it_would_be_named(fitted: Watched) -> None:
    page = fitted.page
    ask = page.locator("#ask")
    ask.get_by_label("effect").first.select_option("coulomb@1")
    slider = page.locator("#ask [data-do=try-torque]")
    slider.focus()
    page.keyboard.press("End")
    said = ask.get_by_text("with these values")
    said.wait_for()
    error, tried = (float(text.split(" %")[0].split()[-1]) for text in said.inner_text().split("as fitted"))
    assert tried > 5 * error
    ask.locator("tendon-signals").wait_for()
    page.locator(HIDE).wait_for()  # the task before has ended
    ask.get_by_label("effect").last.select_option("stribeck")
    page.locator(HIDE, has_text="Hide stribeck@1").click()
    ask.get_by_text("Yes, it would be named").wait_for()
    assert "stribeck@1" in ask.get_by_role("status").last.inner_text()
    assert fitted.wrong == []
    assert fitted.outside() == []


def test_what_is_chosen_while_the_page_is_drawn_anew_is_kept(fitted: Watched, tab: Tab, fitted_server: Server) -> None:
    """A task that another tab begins makes the server replace list and slider before the page hears of it. A choice in
    the old elements still counts."""
    page, other, seen = fitted.page, tab(fitted_server).page, fitted.slow()
    ask = page.locator("#ask")
    ask.locator(HIDE).wait_for()

    def redrawn() -> None:
        seen.keep()
        other.click(HIDE)
        seen.wait("Ask the model")
        seen.wait("Ask the model", times=2)

    redrawn()
    ask.get_by_label("effect").last.select_option("lugre")
    seen.let_go()
    ask.get_by_text("Hide lugre@1").wait_for()
    redrawn()
    page.locator("#ask [data-do=try-stiffness]").focus()
    page.keyboard.press("End")
    seen.let_go()
    ask.get_by_text("with these values").wait_for()
    ask.get_by_text("Hide lugre@1").wait_for()
    assert fitted.wrong == []


def test_a_list_that_is_drawn_anew_has_the_focus_still(fitted: Watched) -> None:
    page = fitted.page
    effects = page.locator("#ask").get_by_label("effect").last
    effects.focus()
    before = effects.input_value()
    page.keyboard.press("ArrowDown")
    page.wait_for_function("before => document.activeElement.value !== before", arg=before)
    page.locator(f"#ask {HIDE}", has_text=f"Hide {effects.input_value()}").wait_for()
    assert effects.evaluate("own => own === document.activeElement")


@pytest.fixture
def demo(tab: Tab, tmp_path: Path) -> Iterator[Watched]:
    """The demo, compared, in a session of its own."""
    for server in served(tmp_path, "--demo"):
        seen = tab(server)
        seen.page.wait_for_selector("[data-do=diagnose]:not([disabled])")
        yield seen


def test_the_picture_of_the_guide(fitted: Watched, request: pytest.FixtureRequest) -> None:
    """What the README shows is as large as the page here. TENDON_PICTURE=write, and nothing else, makes it anew, of
    the demo, with the words of its verdict as the file's description."""
    write = os.environ.get("TENDON_PICTURE") == "write"
    page = request.getfixturevalue("demo").page if write else fitted.page
    if write:
        page.click("[data-do=diagnose]:not([disabled])")
        page.click("[data-do=add]:not([disabled])")
        page.wait_for_selector("[data-step='1'][aria-current=step]")
    page.wait_for_selector("#joint tendon-signals[data-ready]")
    picture = page.screenshot()
    if write:
        words = PngInfo()
        words.add_text("Description", page.inner_text("#verdict"))
        with Image.open(io.BytesIO(picture)) as image:
            image.save(PICTURE, pnginfo=words, optimize=True)
    assert PICTURE.read_bytes()[:24] == picture[:24]  # signature, width and height


@pytest.mark.slow
def test_the_loop_on_four_joints(tab: Tab, tmp_path: Path) -> None:
    """A hidden effect at one of four joints is found, added, and its error falls, by clicks alone."""
    command = [sys.executable, "-c", "from runtime.cli.main import main; main()", "simulate", "vishard4"]
    hidden = ["--out", "run.csv.gz", "--hide", "stribeck@2", "--seconds", "20"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run([*command, *hidden], cwd=tmp_path, env=environment, check=True, capture_output=True)
    for server in served(tmp_path, "vishard4", "run.csv.gz"):
        seen = tab(server)
        page = seen.page
        page.context.set_default_timeout(3_600_000)
        page.click("[data-do=diagnose]:not([disabled])")
        page.wait_for_selector("[data-do=add]:not([disabled])")
        assert page.get_attribute("[data-joint='2']", "aria-pressed") == "true"
        page.click("[data-joint='1']")
        page.wait_for_selector("#joint h2:has-text('Joint 1')")
        page.click("[data-joint='2']")
        page.wait_for_selector("#joint h2:has-text('Joint 2')")
        page.click("[data-do=add]:not([disabled])")
        page.wait_for_selector("[data-step='1'][aria-current=step]")
        page.wait_for_selector("#verdict h1:has-text('falls')")
        assert seen.wrong == []
        assert seen.outside() == []
