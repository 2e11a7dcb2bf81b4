"""The start of a session in a real browser: files that are given, what is wrong with them, and plans."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bench_arm import BENCH, SPRING, THERE_AND_BACK, trajectory

from runtime.studio.server import write_start_file
from tests.runtime.studio.browser import Server, Watched
from tests.runtime.studio.conftest import EVIL
from tests.runtime.studio.test_work import broken

pytestmark = pytest.mark.xdist_group("studio")
Tab = Callable[..., Watched]


def test_the_file_that_a_browser_is_handed_leads_to_the_page(browser: Any, new_server: Server, tmp_path: Path) -> None:
    """A file is another site to the browser; the page that it opens has the cookie all the same."""
    write_start_file(tmp_path / "open.html", new_server.address)
    seen = Watched(browser, (tmp_path / "open.html").as_uri())
    seen.page.wait_for_selector("#plans h2")
    assert "token" not in seen.page.url
    seen.context.close()


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
    seen = tab(new_server)
    page = seen.emptied()
    page.set_input_files("#start file-drop[as=model] input", recorded / "drive.toml")
    page.wait_for_selector("#start .given:has-text('drive.toml')")
    page.set_input_files("#start file-drop[as=fitted] input", wrong)
    page.wait_for_selector("#recordings .warning:has-text('a gap of')")
    assert page.is_disabled("[data-do=begin]")
    page.click("[data-do=cure]:has-text('Split it at its gaps'):not([disabled])")
    page.wait_for_selector("#verdict [data-do=cure]:not([disabled])")
    assert "wrong sign" in page.inner_text("#verdict")
    assert "--map" not in page.inner_text("body")
    before = seen.error()
    page.click("#verdict [data-do=cure]")
    page.wait_for_selector("#verdict:not(:has([data-do=cure])) [data-do=diagnose]:not([disabled])")
    assert seen.error() < before
    assert "--map tau1=-tau1" in page.text_content("[data-commands]")


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


GRIPPER = URDF.replace(
    "</robot>",
    """<link name="left"/><link name="right"/>
<joint name="open_left" type="prismatic"><parent link="arm"/><child link="left"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.1" effort="1" velocity="1"/></joint>
<joint name="open_right" type="prismatic"><parent link="arm"/><child link="right"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.1" effort="1" velocity="1"/></joint></robot>""",
)


def test_a_robot_description_says_what_was_assumed(tab: Tab, new_server: Server, tmp_path: Path) -> None:
    """Friction, gravity and what is unknown; where the arm ends is chosen where the file does not say it."""
    (tmp_path / "gripper.urdf").write_text(GRIPPER)
    seen = tab(new_server)
    page = seen.emptied()
    page.set_input_files("#start file-drop[as=model] input", tmp_path / "gripper.urdf")
    page.wait_for_selector("#start .warning:has-text('2 links end the chains')")
    assert page.is_disabled("[data-do=begin]")
    page.select_option("[data-control=tip]", "arm")
    page.wait_for_selector("[data-assumed]")
    said = page.inner_text("[data-assumed]")
    for part in (
        "coulomb_asymmetric and viscous",
        "gravity is (0, 0, \N{MINUS SIGN}9.81)",
        "open_left, open_right are not between base and tip: locked at 0",
        "the rotor's inertia of joint 1: not stated, hence unknown",
        "gear_ratio of joint 1: not stated, set to 1",
    ):
        assert part in said
    assert "--" not in page.inner_text("#start")
    assert "hinge" in page.inner_text("#start table")
    page.select_option("[data-control=tip]", "left")
    page.wait_for_selector("#start tbody tr:nth-child(2):has-text('open_left')")
    page.click("[data-do=undo]:not([disabled])")
    page.wait_for_selector("#start tbody:not(:has(tr:nth-child(2)))")
    assert seen.wrong == []


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


def test_a_plan_that_is_dropped_during_a_task_is_opened_after_it(tab: Tab, new_server: Server, tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(BENCH)
    for name in ("first", "held", "last"):
        trajectory(THERE_AND_BACK).write(tmp_path / f"{name}.json")
    seen = tab(new_server)
    page = seen.emptied()
    page.set_input_files("#start file-drop[as=model] input", tmp_path / "bench.toml")
    page.set_input_files("#plans file-drop input", tmp_path / "first.json")
    page.wait_for_selector("#plans a:has-text('first.json')")
    new_server.hold_task()  # it waits for a task, and will not begin the next one
    page.set_input_files("#plans file-drop input", tmp_path / "held.json")
    page.wait_for_selector("progress")
    page.set_input_files("#plans file-drop input", tmp_path / "last.json")
    page.wait_for_selector("#plans [role=status]:has-text('last.json is read once the running task has ended')")
    page.click("[data-do=cancel]")
    page.wait_for_selector("#plans a:has-text('last.json')")
    assert page.locator("#plans a:has-text('held.json')").count() == 0
    page.wait_for_selector("#plans [role=status]:text-is('')", state="attached")
    assert seen.wrong == []
