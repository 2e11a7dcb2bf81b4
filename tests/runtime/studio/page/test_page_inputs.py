"""Inputs in a real browser: columns by clicks, recordings that are added, refused, removed and brought back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import one_joint
from tests.runtime.studio.browser import Server, Watched
from tests.runtime.studio.conftest import EVIL
from tests.runtime.studio.test_changed_inputs import lab_log

pytestmark = pytest.mark.xdist_group("studio")
Tab = Callable[..., Watched]


def row(signal: str) -> str:
    return f"#recordings article:has-text('lab.csv') tr[data-signal='{signal}']"


def choose(page: Any, signal: str, what: str, value: str) -> None:
    """A choice in the row of a signal, once the server has drawn it: a click before that is one on what is replaced."""
    place = f"{row(signal)} td[data-is={what}] select"
    page.eval_on_selector(place, "list => { list.dataset.before = '' }")
    page.select_option(place, value)
    page.wait_for_selector(f"{place}:not([data-before]):not([disabled])")
    assert page.input_value(place) == value


def test_columns_are_chosen_by_clicks_and_belong_to_their_recording(
    tab: Tab, new_server: Server, recorded: Path, tmp_path: Path
) -> None:
    """Guessed, previewed, chosen, used, edited and removed; a recording beside it and the demo know nothing of it."""
    seen = tab(new_server)
    page = seen.emptied()
    page.set_input_files("#start file-drop[as=model] input", recorded / "drive.toml")
    page.wait_for_selector("#start .given:has-text('drive.toml')")
    page.set_input_files("#start file-drop[as=fitted] input", lab_log(recorded, tmp_path / "lab.csv"))
    page.wait_for_selector(row("t"))
    assert page.input_value(f"{row('t')} td[data-is=unit] select") == "ms"
    assert "guessed" in page.inner_text(row("q1"))
    assert page.inner_text(f"{row('t')} td[data-is=range]") == "0 … 16 s"
    assert page.locator(f"{row('q1')} svg path").count() == 1
    assert page.is_disabled("[data-do=columns]")
    choose(page, "tau1", "column", "M")
    choose(page, "tau1", "sign", "-")
    page.click("[data-do=columns]:not([disabled])")
    page.wait_for_selector("#recordings:has-text('16000 samples') [data-do=columns-remove]:not([disabled])")
    page.set_input_files("#start file-drop[as=held_out] input", recorded / "held.csv")
    page.wait_for_selector("#recordings article:has-text('held.csv'):has-text('16000 samples')")
    page.click("[data-do=begin]:not([disabled])")
    page.wait_for_selector("[data-do=diagnose]:not([disabled])")
    text = page.inner_text("body")
    assert "--map" not in text
    assert str(new_server.folder) not in text
    # It survives a reload, can be edited, and undo takes the edit back.
    page.reload()
    page.wait_for_selector(row("tau1"))
    assert page.input_value(f"{row('tau1')} td[data-is=sign] select") == "-"
    choose(page, "q1", "unit", "deg")
    page.click("[data-do=columns]:not([disabled])")
    page.wait_for_selector("#changed [data-do=undo]:not([disabled])")
    assert page.is_disabled("[data-do=diagnose]")
    page.click("#changed [data-do=undo]")
    page.wait_for_selector("[data-do=diagnose]:not([disabled])")
    page.click("[data-do=columns-remove]")
    page.wait_for_selector("#recordings .warning:has-text('no column t')")
    page.wait_for_selector("#changed:has-text('lab.csv cannot be used yet')")
    seen.emptied()
    page.click("[data-do=demo]")
    page.wait_for_selector("[data-do=diagnose]:not([disabled])")
    assert page.locator("#recordings article:has-text('lab.csv')").count() == 0
    assert seen.wrong == []
    assert seen.outside() == []


def test_a_log_in_milliampere_asks_for_the_motor(tab: Tab, new_server: Server, recorded: Path, tmp_path: Path) -> None:
    """An ordinary log: ms, degrees and mA without a word of it in the header but in the names."""
    rows = [[float(cell) for cell in line.split(",")] for line in (recorded / EVIL).read_text().splitlines()[1:]]
    texts = [f"{1000 * r[0]:.6g},{r[1] * 57.29577951308232!r},{r[2] * 1000 / 8!r}" for r in rows]
    (tmp_path / "lab.csv").write_text("\n".join(["time,pos_act_deg,Iq_mA", *texts]) + "\n")
    seen = tab(new_server)
    page = seen.emptied()
    page.set_input_files("#start file-drop[as=model] input", recorded / "drive.toml")
    page.wait_for_selector("#start .given:has-text('drive.toml')")
    page.set_input_files("#start file-drop[as=fitted] input", tmp_path / "lab.csv")
    page.wait_for_selector(row("tau1"))
    units = [page.input_value(f"{row(signal)} td[data-is=unit] select") for signal in ("t", "q1", "tau1")]
    assert units == ["ms", "deg", "mA"]
    assert "Still to be chosen: torque constant 1" in page.inner_text("#recordings")
    page.fill("[data-control='constant 1']", "0.08")
    page.press("[data-control='constant 1']", "Tab")
    page.click("[data-do=columns]:not([disabled])")
    page.click("[data-do=begin]:not([disabled])")
    page.wait_for_selector("[data-do=diagnose]:not([disabled])")
    assert '# set torque_constant = 8 in joint 1 of "drive.toml"' in page.text_content("[data-commands]")
    assert seen.wrong == []


def test_a_servo_without_a_torque_is_asked_for_none(tab: Tab, new_server: Server, tmp_path: Path) -> None:
    """Steps of its registers are read as they are; where the model file names no law, the page says which to add."""
    t = np.arange(4000)
    steps = [2048 + np.round(600 * np.sin(t / 80 + lead)) for lead in (0.0, 0.05)]
    header = "Time (ms),Present Position,Goal Position"
    np.savetxt(tmp_path / "lab.csv", np.column_stack([5 * t, *steps]), "%d", delimiter=",", header=header, comments="")
    servo = one_joint.model_text("[joint.effects.viscous]\n")
    seen = tab(new_server)
    page = seen.emptied()
    (tmp_path / "servo.toml").write_text(servo, encoding="utf-8")
    page.set_input_files("#start file-drop[as=model] input", tmp_path / "servo.toml")
    page.wait_for_selector("#start .given:has-text('servo.toml')")
    page.set_input_files("#start file-drop[as=fitted] input", tmp_path / "lab.csv")
    page.wait_for_selector("#recordings .warning:has-text('its columns are those of a drive')")
    assert page.locator("[data-do=cure]:has-text('gaps')").count() == 0
    seen.emptied()
    (tmp_path / "lawful.toml").write_text(f'{servo}\n[joint.drive]\nlaw = "position_servo"\n', encoding="utf-8")
    page.set_input_files("#start file-drop[as=model] input", tmp_path / "lawful.toml")
    page.wait_for_selector("#start .given:has-text('lawful.toml')")
    page.set_input_files("#start file-drop[as=fitted] input", tmp_path / "lab.csv")
    page.wait_for_selector("#recordings:has-text('4000 samples')")
    assert page.locator(row("q1_desired")).count() == 1
    assert page.locator(row("tau1")).count() == 0
    assert seen.wrong == []


def test_of_several_files_the_one_that_is_refused_is_named(
    tab: Tab, new_server: Server, recorded: Path, tmp_path: Path
) -> None:
    """Also once the page has been drawn again because of the one that was taken."""
    (tmp_path / "nonsense.csv").write_text("no recording\n")
    page = tab(new_server).emptied()
    page.set_input_files("#start file-drop[as=fitted] input", [recorded / "held.csv", tmp_path / "nonsense.csv"])
    page.wait_for_selector("#recordings article:has-text('16000 samples') [data-do=remove]:not([disabled])")
    page.wait_for_selector("#start file-drop .warning:has-text('nonsense.csv')")
    page.select_option("[data-control=arm]", "drive")
    page.wait_for_selector("#start .given:has-text('drive.toml')")
    assert page.locator("#recordings article").count() == 1
    assert "nonsense.csv" in page.inner_text("#start file-drop[as=fitted] .warning")


def test_a_recording_that_is_refused_or_added_leaves_the_steps(fitted: Watched, recorded: Path, tmp_path: Path) -> None:
    page = fitted.page
    steps = page.locator("#history li").count()
    (tmp_path / "nonsense.csv").write_text("no recording\n")
    page.set_input_files("#recordings file-drop[as=fitted] input", tmp_path / "nonsense.csv")
    page.wait_for_selector("#recordings file-drop .warning:has-text('nonsense.csv')")
    assert page.locator("#history li").count() == steps
    assert page.locator("#changed:visible").count() == 0
    page.set_input_files("#recordings file-drop[as=fitted] input", recorded / EVIL)
    page.wait_for_selector("#changed:has-text('The inputs have changed') [data-do=begin]:not([disabled])")
    assert page.inner_text("#changed [data-do=begin]") == "Fit the steps again"
    assert page.locator("#history li").count() == steps
    page.click("#changed [data-do=undo]")
    page.wait_for_selector("#changed", state="hidden")
    assert page.locator("#history li").count() == steps
    # Without any recording left there is a place to give one, and undo.
    count = page.locator("#recordings article").count()
    for left in range(count - 1, -1, -1):
        page.click("#recordings [data-do=remove]:not([disabled])")
        page.locator("#recordings article").nth(left).wait_for(state="detached")
    page.wait_for_selector("#changed:has-text('A recording to fit is missing')")
    assert page.locator("#recordings file-drop[as=fitted]").count() == 1
    for back in range(count):
        page.click("#changed [data-do=undo]:not([disabled])")
        page.locator("#recordings article").nth(back).wait_for()
    page.wait_for_selector("#changed", state="hidden")
    page.set_input_files("#recordings file-drop[as=fitted] input", recorded / EVIL)
    page.wait_for_selector("#changed [data-do=undo]:not([disabled])")
    page.click("#changed [data-do=undo]")
    page.wait_for_selector("#changed", state="hidden")
    page.click("[data-do=redo]:not([disabled])")
    page.wait_for_selector("#changed [data-do=undo]:not([disabled])")
    page.click("#changed [data-do=undo]")
    page.wait_for_selector("#changed", state="hidden")
