"""How the page looks in a real browser: nothing is cut off, no name becomes markup, the picture of the guide."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from tests.runtime.studio.browser import ROOT, Server, Watched, served
from tests.runtime.studio.conftest import EVIL

pytestmark = pytest.mark.xdist_group("studio")
PICTURE = ROOT / ".images" / "studio.png"
Tab = Callable[..., Watched]


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
