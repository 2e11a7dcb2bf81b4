"""Questions about the model in a real browser, and controls that are drawn again meanwhile."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.runtime.studio.browser import Server, Watched

pytestmark = pytest.mark.xdist_group("studio")
Tab = Callable[..., Watched]


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


def test_a_replay_shows_the_arm_as_recorded_and_as_the_model_moves(fitted: Watched) -> None:
    page = fitted.at_step(1)
    page.click("[data-do=replay]:not([disabled])")
    page.wait_for_selector("a[href^='/download/replay']")
    assert "fter 1 s in open loop, error of the joint" in page.inner_text("[role=status]:has-text('open loop')")
    assert "Error of the motion, rms" in page.inner_text("#questions, main")
    assert page.locator(".arm-picture").count() == 2
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
