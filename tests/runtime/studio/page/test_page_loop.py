"""The loop in a real browser, by clicks alone."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from guides import demo_errors, differs

from tests.runtime.studio.browser import ROOT, Server, Watched, served

pytestmark = pytest.mark.xdist_group("studio")
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
    assert "tendon add drive.toml stribeck --joint 1" in page.text_content("[data-commands]")
    other = tab(new_server)
    other.page.wait_for_selector("[data-step='1'][aria-current=step]")
    assert other.error() == after
    assert seen.wrong == []
    assert seen.outside() == []


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
