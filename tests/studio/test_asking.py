"""What is asked of a fitted model by clicks: other values of an effect, and an effect hidden in the motion."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from runtime.cli import output
from runtime.cli.main import app
from tests import one_joint
from tests.studio import browser

MODEL = one_joint.model_text("[joint.effects.coulomb]\n[joint.effects.viscous]\n")
PATIENCE = 120_000
HIDE = "[data-do=hide]:not([disabled])"


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> Iterator[str]:
    """A studio with a model that lacks nothing."""
    folder = tmp_path_factory.mktemp("asked")
    known = MODEL.replace("coulomb]", "coulomb]\ntorque = 0.5").replace("viscous]", "viscous]\ncoefficient = 0.8")
    (folder / "drive.toml").write_text(known)
    arguments = [str(folder / "drive.toml"), "--out", str(folder / "run.csv"), "--seconds", "16"]
    assert output.run(app, ["simulate", *arguments]) == 0
    with browser.studio(folder, "drive.toml", "run.csv") as said:
        yield said


def test_a_slider_says_what_would_be_left_and_a_hidden_effect_whether_it_would_be_named(address):
    with browser.chromium() as chromium:
        watched = browser.Watched(chromium, address)
        page = watched.page
        ask = page.locator("#ask")
        ask.get_by_label("effect").first.wait_for(timeout=PATIENCE)
        ask.get_by_label("effect").first.select_option("coulomb@1")
        slider = page.locator("[data-do=try-torque]")
        slider.wait_for()
        slider.focus()
        page.keyboard.press("End")
        said = ask.get_by_text("with these values")
        said.wait_for(timeout=PATIENCE)
        fitted, tried = (float(text.split(" %")[0].split()[-1]) for text in said.inner_text().split("as fitted"))
        assert tried > 5 * fitted
        ask.locator("tendon-signals").wait_for()
        hide = page.locator(HIDE)
        hide.wait_for(timeout=PATIENCE)  # the work before has ended
        ask.get_by_label("effect").last.select_option("stribeck")
        ask.get_by_text("Hide stribeck@1").wait_for()
        hide.click()
        ask.get_by_text("Yes, it would be named").wait_for(timeout=PATIENCE)
        assert "stribeck@1" in ask.get_by_role("status").last.inner_text()
        assert watched.wrong == []
        assert watched.outside() == []


def redrawn(seen, other):
    """A page on which work begins and ends, begun in another tab, before it hears of that."""
    seen.keep()
    other.click(HIDE, timeout=PATIENCE)
    seen.wait("Ask the model")
    other.click("[data-do=cancel]", timeout=PATIENCE)
    seen.wait("Ask the model", times=2)


def test_what_is_chosen_while_the_page_is_drawn_anew_is_kept(address):
    """Of a list that the server has replaced already, and of a slider."""
    with browser.chromium() as chromium:
        watched, other = browser.Watched(chromium, address), browser.Watched(chromium, address).page
        page, seen = watched.page, watched.slow()
        ask = page.locator("#ask")
        ask.locator(HIDE).wait_for(timeout=PATIENCE)
        redrawn(seen, other)
        ask.get_by_label("effect").last.select_option("stribeck")
        seen.let_go()
        ask.get_by_text("Hide stribeck@1").wait_for()
        redrawn(seen, other)
        page.locator("[data-do=try-coefficient]").focus()
        page.keyboard.press("End")
        seen.let_go()
        ask.get_by_text("with these values").wait_for(timeout=PATIENCE)
        ask.get_by_text("Hide stribeck@1").wait_for()
        assert watched.wrong == []


def test_a_list_that_is_drawn_anew_has_the_focus_still(address):
    with browser.chromium() as chromium:
        page = browser.Watched(chromium, address).page
        effects = page.locator("#ask").get_by_label("effect").last
        effects.focus(timeout=PATIENCE)
        before = effects.input_value()
        page.keyboard.press("ArrowDown")
        page.wait_for_function("before => document.activeElement.value !== before", arg=before)
        page.locator(f"#ask {HIDE}", has_text=f"Hide {effects.input_value()}").wait_for()
        assert effects.evaluate("own => own === document.activeElement")
