"""The site of the guides builds without a warning, its links lead somewhere, and it fetches nothing from elsewhere."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlsplit

import pytest
from sources import ROOT

from runtime.version import VERSION
from tests.runtime.studio.browser import launched

MAKER = ROOT / ".site" / "maker"
sys.path.insert(0, str(MAKER))

pytest.importorskip("zensical", reason="the package zensical is not installed (pip install -e .[site])")

import docstrings  # noqa: E402
import gather  # noqa: E402
import listings  # noqa: E402
import references  # noqa: E402
import yaml  # noqa: E402

FETCHING = {"img": "src", "script": "src", "link": "href", "iframe": "src", "source": "src", "object": "data"}
"""Elements that make a browser fetch something -> the attribute that names it."""


class Page(HTMLParser):
    """What a page leads to, what it fetches, and the places to which links may lead."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.fetched: set[str] = set()
        self.anchors: set[str] = {""}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.add(given["href"])
        # A link element that only states where the page belongs is not followed.
        if tag in FETCHING and given.get("rel") not in ("canonical", "next", "prev"):
            self.fetched |= {given[FETCHING[tag]]} if FETCHING[tag] in given else set()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built, strictly: a link or an anchor that leads nowhere ends it."""
    folder = tmp_path_factory.mktemp("site")
    run = subprocess.run([sys.executable, MAKER / "build.py", folder], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return folder / "site"


@pytest.fixture(scope="module")
def built(site: Path) -> dict[Path, Page]:
    """Every page by its file. The page of a server that finds nothing names others from the server's root."""
    found = [path for path in sorted(site.rglob("*.html")) if path.name != "404.html"]
    return {path: Page(path.read_text(encoding="utf-8")) for path in found}


def test_every_page_of_the_navigation_is_there(site: Path) -> None:
    listed = [path for section, path in gather.pages(gather.navigation(references.PAGES))]
    assert len(listed) == len(set(listed))
    assert {path.relative_to(ROOT).as_posix() for path in (ROOT / "runtime" / "guides").glob("*.md")} <= set(listed)
    pages = [site / re.sub(r"(README)?\.md$", ".html", gather.on_site(path)) for path in listed]
    assert [p for p in pages if not p.with_name(p.name if p.stem != ".html" else "index.html").is_file()] == []


def test_every_link_leads_to_a_place(built: dict[Path, Page]) -> None:
    wrong = []
    for path, page in built.items():
        for link in page.links | page.fetched:
            file, anchor = urldefrag(link)
            if urlsplit(link).scheme:
                continue
            aim = (path.parent / unquote(file)).resolve() if file else path
            missing = not aim.is_file() or (aim in built and unquote(anchor) not in built[aim].anchors)
            wrong += [f"{path.name}: {link}"] if missing else []
    assert wrong == []


def test_nothing_is_fetched_from_elsewhere(site: Path, built: dict[Path, Page]) -> None:
    assert {
        link for page in built.values() for link in page.fetched if urlsplit(link).scheme not in ("", "data")
    } == set()
    styles = [path.read_text(encoding="utf-8") for path in site.rglob("*.css")]
    assert styles
    assert [
        found for text in styles for found in re.findall(r"(?:url\(['\"]?|@import ['\"])(https?:[^)'\"]*)", text)
    ] == []


def test_llms_txt_names_pages_that_exist(site: Path) -> None:
    text = (site / "llms.txt").read_text(encoding="utf-8")
    links = re.findall(r"^- \[.+\]\(([^)]+)\): \S.*$", text, re.MULTILINE)
    assert len(links) == text.count("\n- ") > 10
    assert [link for link in links if not (site / link).is_file()] == []
    assert text.startswith("# Tendon\n\n> Which physics")


def test_the_reference_of_python_has_every_public_name(built: dict[Path, Page]) -> None:
    page = next(page for path, page in built.items() if path.name == "python.html")
    homes = [home for names in references.public().values() for _, home in names]
    assert len(homes) > 30
    assert [home for home in homes if home not in page.anchors] == []


def test_the_source_of_the_reference_of_python_can_be_read(site: Path) -> None:
    text = (site / "reference" / "python.md").read_text(encoding="utf-8")
    assert "\n### tendon.diagnose\n\n`diagnose(arm: 'LoadedArm'" in text
    assert "- **skew** — samples by which the torque leads the motion" in text
    assert ":::" not in text


def test_every_verb_has_a_section_with_its_options() -> None:
    text = references.verbs()
    assert re.search(r"^### tendon diagnose$", text, re.MULTILINE)
    assert "| `--budget N` | Refits that the search may try. | 1000; x>=0 |" in text


def test_the_agents_table_is_that_of_the_verbs() -> None:
    text = references.AGENTS.read_text(encoding="utf-8")
    assert "| `diagnose` | `tendon diagnose drive.toml run1.csv --report report` | `--report DIR`" in text
    assert references.with_table(text) == text, "run python .site/maker/references.py"


def test_a_link_to_a_file_that_is_no_page_becomes_its_name() -> None:
    text = gather.linked(
        "[test](../tests/test_guides.py) [t](../tests/README.md#x)", "codegen/README.md", {"tests/README.md"}
    )
    assert text == "test (`tests/test_guides.py`) [t](../tests/README.md#x)"
    with pytest.raises(SystemExit, match=r"codegen/README.md: links to nothing.md; there is no such file"):
        gather.linked("[x](nothing.md)", "codegen/README.md", set())
    with pytest.raises(SystemExit, match=r"no such file"):
        gather.linked("![x](../.images/nothing.svg)", "codegen/README.md", set())
    assert gather.linked("```sh\n[x](nothing.md)\n```", "codegen/README.md", set()) == "```sh\n[x](nothing.md)\n```"


def test_bars_in_the_code_of_a_table_need_no_backslash() -> None:
    assert gather.linked(r"| `F \|qd\|` | a \| b |", "README.md", set()) == r"| `F |qd|` | a \| b |"


def test_pictures_keep_their_way() -> None:
    text = '![a](../.images/error.svg) <img src="../.images/error.svg">'
    assert gather.linked(text, "codegen/README.md", set()) == text.replace("../.images", "../images")


def test_rows_of_a_docstring_become_a_list() -> None:
    rows = "What.\n\nq, qd   (n,) rad     t   s\ntau     (n,) N m,\n        at the joint\nRaises ValueError."
    made = (
        "What.\n\n\n- **q, qd** — (n,) rad\n- **t** — s\n- **tau** — (n,) N m,\n    at the joint\n\nRaises ValueError."
    )
    assert docstrings.as_markdown(rows) == made
    assert docstrings.as_markdown("What.\n\none, two\n          three") == "What.\n\n\n- **one, two** — three"


def test_a_summary_is_the_first_sentence_without_its_marks() -> None:
    assert (
        listings.summary("# A\n\n![p](x.svg)\n\n**Bold** [link](a.md#b) and e.g. this. Another.")
        == "Bold link and e.g. this."
    )


def test_the_citation_is_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / ".github" / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == VERSION
    assert cited["title"] in (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"## {VERSION}\n" in (ROOT / ".github" / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_search_works_without_a_server_and_nothing_is_asked_from_elsewhere(site: Path) -> None:
    asked: list[str] = []
    errors: list[str] = []
    for browser in launched():
        page = browser.new_page()
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto((site / "index.html").as_uri())
        page.keyboard.press("Control+k")
        page.keyboard.type("presliding")
        page.get_by_text("Presliding: friction that winds up").first.click()
        page.wait_for_url("**/runtime/guides/gallery.html*")
    assert errors == []
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
