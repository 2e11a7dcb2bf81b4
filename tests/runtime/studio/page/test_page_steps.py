"""Joints and steps of a session in a real browser: signals, held-out recordings, comparisons, cancelling."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.runtime.studio.browser import Server, Watched

pytestmark = pytest.mark.xdist_group("studio")


def test_a_session_is_opened_again_and_its_model_taken_away(fitted: Watched) -> None:
    """Another process shows what the first one found."""
    page = fitted.page
    assert "[joint.effects.linear_spring]" in page.inner_text("[data-difference]")
    with page.expect_download() as begun:
        page.click("a.download:has-text('model file')")
    assert "linear_spring" in Path(begun.value.path()).read_text()
    assert fitted.wrong == []


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
    fitted_server.hold_task()
    page.wait_for_selector("progress")
    page.click("[data-do=cancel]")
    page.wait_for_selector("[role=alert]:has-text('Cancelled')")
    page.wait_for_selector("[data-do=diagnose]:not([disabled])")
    assert files(fitted_server.folder) == before


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
