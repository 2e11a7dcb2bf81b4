"""Several joints in a real browser, and what stands beside each error: the joint of the finding, the list, colours."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.runtime.studio.browser import Server, Watched, served
from tests.runtime.studio.conftest import Prepared

pytestmark = pytest.mark.xdist_group("studio")
Tab = Callable[..., Watched]
COUNT, FOUND = 6, 3
"""Joints of the arm, and the one that lacks an effect."""


def rewritten(path: Path, change: Callable[[Any], None]) -> None:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def with_joints(joints: list[dict[str, Any]], found: float) -> None:
    """Six joints in the place of one: all clean but the one that lacks an effect."""
    (one,) = joints
    joints.clear()
    for k in range(1, COUNT + 1):
        own = found if k == FOUND else 1.0
        errors = {"rms": own * 0.1, "relative": own * 0.01, "floor": 0.1, "relative_floor": 0.01, "held": None}
        joints.append({**one, **errors, "joint": k, "called": f"{k} part_{k}_joint", "at_floor": own == 1.0})


@pytest.fixture(scope="module")
def six(prepared: Prepared, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """The prepared session as of an arm of six joints: joint 3 lacks a spring, is clean with it in step 1, and gains
    nothing by a further effect in step 2."""
    folder = tmp_path_factory.mktemp("six")
    shutil.copytree(prepared.folder, folder / "session")

    def whole(session: Any) -> None:
        steps = session["history"]["steps"]
        further = {"number": 2, "parent": 1, "changed": [{"effect": "stribeck", "joint": 1}]}
        steps.append(json.loads(json.dumps(steps[1])) | further)
        session["history"]["current"] = 0
        session["inputs"] = steps[0]["inputs"]
        for step, found in zip(steps, (9.0, 1.0, 1.0), strict=True):
            with_joints(step["joints"], found)
            for effect in step["changed"]:
                effect["joint"] = FOUND

    rewritten(folder / "session" / "session.json", whole)
    shutil.copytree(folder / "session/steps/1", folder / "session/steps/2")
    for number, found in ((0, 9.0), (1, 1.0), (2, 1.0)):
        step = folder / "session" / "steps" / str(number)
        rewritten(step / "overview.json", lambda overview, found=found: with_joints(overview["joints"], found))
    rewritten(folder / "session/steps/0/verdict.json", lambda said: said["findings"][0].update(shows_at=FOUND))
    yield from served(folder, "session")


def shown(page: Any) -> str:
    return str(page.inner_text("#joint h2"))


@pytest.mark.parametrize("width", [390, 1360])
def test_the_joint_with_the_finding_is_shown_and_the_list_stays_in_view(tab: Tab, six: Server, width: int) -> None:
    seen = tab(six, width=width)
    page = seen.at_step(0)
    page.wait_for_selector("#findings article")
    assert shown(page) == f"Joint {FOUND} part_{FOUND}_joint"
    assert page.get_attribute(f"[data-go='{FOUND}']", "aria-pressed") == "true"
    page.click("#parts a:has-text('Recordings')")
    page.wait_for_function("() => document.querySelector('#recordings').getBoundingClientRect().top < innerHeight")
    for k in range(1, COUNT + 1):
        box = page.locator(f"[data-go='{k}']").bounding_box()
        assert 0 <= box["y"] < 200
        assert 0 <= box["x"] < box["x"] + box["width"] <= width
    page.click("[data-go='5']")
    page.wait_for_selector("#joint h2:has-text('Joint 5 part_5_joint')")
    # Another step shows the joint of its own change.
    seen.at_step(1)
    page.wait_for_selector(f"#joint h2:has-text('Joint {FOUND} part_{FOUND}_joint')")
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def test_no_row_and_no_cell_is_cut_off(tab: Tab, six: Server) -> None:
    """Of any table, also on a phone."""
    page = tab(six, width=390).at_step(0)
    page.wait_for_selector("#findings article")
    wide = "e.clientWidth && e.scrollWidth > e.clientWidth + 1"
    high = "e.clientHeight && e.scrollHeight > e.clientHeight + 2"
    every = "[...document.querySelectorAll('.page table, .page td, .page .scroll')]"
    cut = f"{every}.filter((e) => {wide} || {high}).map((e) => e.outerHTML.slice(0, 200))"
    assert page.evaluate(cut) == []


def test_a_clean_residual_has_the_colour_of_a_fallen_error(tab: Tab, six: Server) -> None:
    page = tab(six).at_step(0)
    colour = "(k) => getComputedStyle(document.querySelector(`[data-joint='${k}'] .bar`)).backgroundColor"
    colours = [page.evaluate(colour, k) for k in range(1, COUNT + 1)]
    others = {c for k, c in enumerate(colours, 1) if k != FOUND}
    assert len(others) == 1
    assert colours[FOUND - 1] not in others


def test_an_error_that_stays_is_not_said_to_fall(tab: Tab, six: Server) -> None:
    """Nor drawn as a change."""
    seen = tab(six)
    page = seen.at_step(2)
    page.wait_for_selector("#verdict h1:has-text('does not fall: it stays at 1.00')")
    page = seen.at_step(1)
    page.wait_for_selector("#verdict h1:has-text('joint 3 part_3_joint falls from 9.00')")
    assert "→" in page.inner_text(f"#errors [data-joint='{FOUND}']")
    assert "→" not in page.inner_text("#errors [data-joint='1']")


def test_sliders_say_their_units(fitted: Watched) -> None:
    """Of the value and of its range."""
    page = fitted.at_step(1)
    page.select_option("[data-control=tried]", "linear_spring@1")
    page.wait_for_selector("#ask [data-do=try-stiffness]")
    said = page.inner_text("#ask label:has([data-do=try-stiffness])")
    assert re.fullmatch(r"stiffness: [23]\S* N m/rad \(fitted [23]\S*, range 0 to [56]\S* N m/rad\)", said.strip())


def test_measured_and_predicted_are_both_seen_where_they_agree(fitted: Watched) -> None:
    """A broad pale line below a thin one: at the noise floor neither hides the other."""
    page = fitted.at_step(1)
    page.wait_for_selector("#joint tendon-signals[data-ready]")
    count = """(rgb) => {
        const canvas = document.querySelector("#joint figure canvas");
        const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        let found = 0;
        for (let k = 0; k < data.length; k += 4) found += rgb.every((c, i) => Math.abs(c - data[k + i]) < 4);
        return found;
    }"""
    paper, ink, after = (255, 255, 255), (31, 39, 48), (10, 111, 176)
    pale = [round(p + 0.4 * (i - p)) for p, i in zip(paper, ink, strict=True)]
    assert page.evaluate(count, pale) > 500
    assert page.evaluate(count, list(after)) > 500
