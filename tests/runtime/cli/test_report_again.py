"""Results say what they were made from, and a report is made again from the JSON of its result."""

from __future__ import annotations

import hashlib
import html
import json
import os
import re
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from runtime.cli import output
from runtime.cli.main import app
from runtime.documents.provenance import now
from runtime.version import VERSION
from runtime.workspace.names import ARMS
from tests.runtime.conftest import Refused, Run
from tests.runtime.studio.browser import launched
from tests.variants import slow

SIMULATED = ("--hide", "stribeck@1:torque=0.6,speed=0.15", "--seconds", "12")
IMPROVE = ("improve", "arm.toml", "run.csv.gz", "--held-out", "other.csv.gz")
WRITTEN = ("--json", "result.json", "--report", "report")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a model, two recordings, an improvement and its report, made in 1970."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as here:
        here.chdir(folder)
        here.setenv("SOURCE_DATE_EPOCH", "86400")
        Path("arm.toml").write_bytes((ARMS / "drive.toml").read_bytes())
        for name, seed in (("run.csv.gz", "0"), ("other.csv.gz", "1")):
            assert output.run(app, ["simulate", "arm.toml", "--out", name, "--seed", seed, *SIMULATED]) == 0
        assert output.run(app, [*IMPROVE, *WRITTEN]) == 0
    return folder


def result(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "result.json").read_text()))


def with_other(folder: Path, to: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """A copy of the result in which something is said otherwise."""
    document = result(folder)
    change(document["provenance"])
    to.write_text(json.dumps(document))


def test_a_result_says_what_it_was_made_from(made: Path) -> None:
    said = result(made)["provenance"]
    assert (said["verb"], said["date"], said["version"]) == ("improve", "1970-01-02T00:00:00Z", VERSION)
    assert said["command"] == f"tendon {' '.join((*IMPROVE, *WRITTEN))}"
    assert said["folder"] == str(made)
    for file, name in ((said["model"], "arm.toml"), *zip(said["recordings"], ["run.csv.gz"], strict=True)):
        found = hashlib.sha256((made / name).read_bytes()).hexdigest()
        assert file == {"typed": name, "path": str(made / name), "sha256": found}
    assert [file["typed"] for file in said["held_out"]] == ["other.csv.gz"]
    assert said["model_text"] == (made / "arm.toml").read_text()


@pytest.mark.parametrize("verb", ["compare", "identify", "diagnose"])
def test_every_verb_of_a_fit_says_it(made: Path, tendon: Run, verb: str) -> None:
    out = tendon(verb, made / "arm.toml", made / "run.csv.gz", "--json", "-")[1]
    said = json.loads(out)["provenance"]
    assert (said["verb"], said["recordings"][0]["path"]) == (verb, str(made / "run.csv.gz"))
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", said["date"])


def test_every_verb_of_a_motion_says_it_and_how_it_is_made_again(
    made: Path, here: Path, tendon: Run, refused: Refused
) -> None:
    """With names and hashes of all that was read; report refuses in one line, with the command to run again."""
    (here / "arm.toml").write_text((made / "arm.toml").read_text())
    run, command = str(made / "run.csv.gz"), {}
    lines = {
        "inspect": ("inspect", run, "arm.toml"),
        "simulate": ("simulate", "arm.toml", "--out", "new.csv", "--seconds", "6"),
        "optimize": ("optimize", "scenario1", "--out", "plan.json"),
        "execute": ("execute", "vishard4", "plan.json", "--on", "simulation", "--trials", "1"),
    }
    read = {"inspect": [], "simulate": [], "optimize": ["scenario1.toml"], "execute": ["plan.json"]}
    for verb, line in lines.items():
        assert tendon(*line, "--json", f"{verb}.json")[0] == 0
        found = json.loads((here / f"{verb}.json").read_text())
        said = found["provenance"]
        command[verb] = f"tendon {' '.join(line)} --json {verb}.json"
        assert (said["verb"], said["version"], said["command"]) == (verb, VERSION, command[verb])
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", said["date"])
        files = [said["model"], *said["recordings"], *said["further"]]
        assert [Path(file["path"]).name for file in said["further"]] == read[verb]
        for file in files:
            assert file["sha256"] == hashlib.sha256(Path(file["path"]).read_bytes()).hexdigest()
        assert Path(said["model"]["path"]).read_text() == said["model_text"]
        answer = refused("report", f"{verb}.json", "--out", "again")
        assert f"a result of {verb} is not made again from its JSON" in answer
        assert command[verb] in answer
        assert ("--report DIR" in answer) == (verb in ("optimize", "execute"))
        assert not (here / "again").exists()
    assert tendon("inspect", run, "--json", "alone.json")[0] == 0
    alone = json.loads((here / "alone.json").read_text())["provenance"]
    assert (alone["model"], alone["model_text"]) == (None, None)


@pytest.mark.parametrize("wrong", ["", "soon", "²", "9" * 40])
def test_another_epoch_is_no_date(monkeypatch: pytest.MonkeyPatch, wrong: str) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", wrong)
    assert re.fullmatch(r"2\d{3}-\d\d-\d\dT\d\d:\d\d:\d\dZ", now())


def test_a_report_shows_it(made: Path) -> None:
    page = html.unescape((made / "report" / "report.html").read_text())
    shown = page[page.index("<body>") : page.index('id="result"')]
    said = result(made)["provenance"]
    for file in (said["model"], *said["recordings"], *said["held_out"]):
        assert file["path"] in shown
        assert file["sha256"] in shown
    assert said["command"] in shown
    assert shown.count(f"1970-01-02 00:00:00 UTC, Tendon {VERSION}") == 2  # at the head, and beside the files


def test_the_same_report_is_made_again(made: Path, here: Path, tendon: Run) -> None:
    """Although the model has changed since: its text is in the result."""
    before = (made / "arm.toml").read_bytes()
    (made / "arm.toml").write_text("mass = ")
    try:
        status, out, err = tendon("report", made / "result.json", "--out", "again", "--json", "said.json")
    finally:
        (made / "arm.toml").write_bytes(before)
    assert (status, out, err.count("no plots")) == (
        0,
        "Report: again/report.html (computed again from the same files)\n",
        0,
    )
    assert json.loads((here / "said.json").read_text()) == {"page": "again/report.html", "plots": True, "why_not": []}
    assert (here / "again" / "report.html").read_bytes() == (made / "report" / "report.html").read_bytes()


def test_without_its_recordings_a_report_has_the_words(made: Path, here: Path, tendon: Run) -> None:
    """And says which file is another one, or gone."""

    def changed(provenance: dict[str, Any]) -> None:
        provenance["recordings"][0]["sha256"] = "0" * 64
        provenance["held_out"][0]["path"] = str(here / "gone.csv")

    with_other(made, here / "other.json", changed)
    status, out, err = tendon("report", "other.json", "--out", "again")
    assert (status, out) == (0, "Report: again/report.html (words and tables of the JSON, no plots)\n")
    assert err.splitlines() == [
        f"other.json: no plots: {made / 'run.csv.gz'} is not the file that was read: its SHA-256 differs",
        f"other.json: no plots: {here / 'gone.csv'} is not there",
    ]
    page = html.unescape((here / "again" / "report.html").read_text())
    assert "<svg" not in page
    assert "<h1>Stribeck explains 99\u00a0% of what was missing at joint 1; " in page
    for text in (
        "stribeck at joint 1: residual",
        "file, refitted",
        "What it was made from",
        "gain of the log-likelihood",
    ):
        assert text in page


@pytest.mark.parametrize(
    ("verb", "tag", "headline"),
    [
        ("compare", "comparison", "Joint 1: misses "),
        ("identify", "fitted", "The fit misses "),
        ("diagnose", "effect found", "The model lacks stribeck at joint 1 "),
    ],
)
def test_the_words_of_every_kind_of_result(
    made: Path, here: Path, tendon: Run, verb: str, tag: str, headline: str
) -> None:
    """Also of a result that does not say what it was made from."""
    document = json.loads(tendon(verb, made / "arm.toml", made / "run.csv.gz", "--json", "-")[1])
    del document["provenance"]
    (here / "bare.json").write_text(json.dumps(document))
    status, _, err = tendon("report", "bare.json", "--out", "again")
    assert (status, err) == (0, "bare.json: no plots: the JSON does not say what it was made from\n")
    page = html.unescape((here / "again" / "report.html").read_text())
    assert re.search(rf"<h1>{headline}", page)
    assert f">{tag}</span>" in page


CUT = "() => [...document.querySelectorAll('#errors .scroll')].filter(e => e.scrollWidth > e.clientWidth).length"
"""Number of tables of errors that are wider than the page."""


@pytest.mark.parametrize("player", ["tendon", slow("mujoco")])
def test_a_replay_is_made_again(made: Path, here: Path, tendon: Run, player: str) -> None:
    """Of two models, with other parameters or those of the files; without its recording, its words and tables."""
    if player == "mujoco":
        pytest.importorskip("mujoco", reason="no MuJoCo: pip install mujoco")
    (here / "run.csv.gz").write_bytes((made / "run.csv.gz").read_bytes())
    (here / "arm.toml").write_bytes((made / "arm.toml").read_bytes())
    assert tendon("identify", "arm.toml", "run.csv.gz", "--write")[0] == 0
    assert tendon("improve", "arm.toml", "run.csv.gz", "--out", "more.toml")[0] == 0
    how = ["--in", "mujoco"] if player == "mujoco" else ["--fit", made / "other.csv.gz"]
    line = ["replay", "more.toml", "run.csv.gz", "--before", "arm.toml", *how]
    assert tendon(*line, "--json", "said.json", "--report", "page")[0] == 0
    status, out, err = tendon("report", "said.json", "--out", "again")
    assert (status, "computed again" in out, "no plots" in err) == (0, True, False)
    assert (here / "again" / "report.html").read_bytes() == (here / "page" / "report.html").read_bytes()
    (here / "run.csv.gz").unlink()
    status, _, err = tendon("report", "said.json", "--out", "words")
    assert (status, "run.csv.gz is not there" in err) == (0, True)
    page = html.unescape((here / "words" / "report.html").read_text())
    assert "<h1>After 1 s in open loop, error of the joint" in page
    assert ("in MuJoCo" in page) is (player == "mujoco")
    drawn = html.unescape((here / "page" / "report.html").read_text())
    for text in ("dashed, where it is off: the same in MuJoCo", ">off after, in MuJoCo<"):
        assert (text in drawn) is (player == "mujoco")
    assert drawn.count("stroke-dasharray: 2.9") == 2 * (player == "mujoco")  # the models' curves
    with contextmanager(launched)() as browser:
        opened = browser.new_page(viewport={"width": 1000, "height": 900})
        opened.goto((here / "page" / "report.html").as_uri())
        assert opened.evaluate(CUT) == 0


def test_a_name_that_is_no_utf8(made: Path, here: Path, tendon: Run) -> None:
    """It is escaped in JSON and page, and the report is made again from it."""
    run = here / os.fsdecode(b"run\xff.csv.gz")
    run.write_bytes((made / "run.csv.gz").read_bytes())
    assert tendon("compare", made / "arm.toml", run, "--json", "said.json", "--report", "page")[0] == 0
    assert json.loads((here / "said.json").read_text("utf-8"))["provenance"]["recordings"][0]["path"] == str(run)
    assert "run\\udcff.csv.gz" in (here / "page" / "report.html").read_text("utf-8")
    assert tendon("report", "said.json", "--out", "again")[0] == 0
    assert (here / "again" / "report.html").read_bytes() == (here / "page" / "report.html").read_bytes()


def test_a_file_of_effects_is_run_only_if_it_is_named(made: Path, here: Path, tendon: Run) -> None:
    own = here / "own.py"
    own.write_text(f"open({str(here / 'run')!r}, 'w')\n")
    of_own = {"typed": "own.py", "path": str(own), "sha256": hashlib.sha256(own.read_bytes()).hexdigest()}
    with_other(made, here / "other.json", lambda provenance: provenance.update(effects=of_own))
    status, _, err = tendon("report", "other.json", "--out", "again")
    assert (status, err) == (
        0,
        "other.json: no plots: name the file of effects again, which is run: --effects own.py\n",
    )
    assert not (here / "run").exists()
    own.write_text("changed\n")
    assert "is not the file that was read" in tendon("report", "other.json", "--out", "again", "--effects", own)[2]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("{", "not what --json of compare, diagnose, improve, identify, replay or demo writes"),
        ("[1]", "not the result of compare"),
        ('{"out": "drive.toml"}', "not the result of compare"),
        ('{"joints": 3}', "Expected `array`, got `int`"),
        ("[" * 5000, "not what --json of compare"),
        ("\xff", "not what --json of compare"),
    ],
)
def test_what_is_no_result_is_refused_in_one_line(here: Path, refused: Refused, content: str, expected: str) -> None:
    (here / "no.json").write_bytes(content.encode("latin-1"))
    assert expected in refused("report", "no.json", "--out", "again")
    assert not (here / "again").exists()
