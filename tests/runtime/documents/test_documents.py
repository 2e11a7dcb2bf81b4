"""What --json prints is what its schema says, and the guide's table of keys is up to date."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from runtime.cli import output
from runtime.cli.main import app
from runtime.documents import verbs
from runtime.plain_json import plain
from runtime.workspace.names import ARMS

jsonschema = pytest.importorskip("jsonschema")

MODEL = ["--seconds", "8", "--repeats", "2"]
LINES = {
    "simulate": ["drive", "--out", "other.csv", *MODEL],
    "inspect": ["run.csv", "drive"],
    "compare": ["drive", "run.csv"],
    "identify": ["drive", "run.csv"],
    "diagnose": ["drive", "run.csv"],
    "experiment": ["drive", "--between", "linear_spring@1,gravity"],
    "improve": ["bare.toml", "run.csv"],
    "demo": ["--out", "demo"],
    "optimize": ["scenario1"],
    "execute": ["vishard4", "plan.json", "--on", "simulation", "--trials", "1", "--out", "executed.csv"],
    "sweep": ["scenario1", "--over", "seed=0", "--over", "case=A,B", "--table", "table.csv", "--workers", "1"],
    "paper": ["table2", "--trials", "0"],
    "generate": ["drive", "--out", "drive"],
    "add": ["own.toml", "stribeck", "--joint", "1", "--out", "own"],
    "verify": ["drive", "--samples", "1"],
    "effects": [],
    "firmware": ["drive", "--target", "host", "--out", "firmware"],
    "init": ["--like", "drive", "--out", "like.toml"],
    "export": ["drive", "--to", "urdf", "--out", "other.urdf"],
    "import": ["arm.urdf", "--out", "arm.toml"],
    "report": ["compared.json", "--out", "again"],
}

SLOW = {"demo", "experiment"}
"""The first has the class of improve, the second is asserted in test_experiment."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a recording of the drive, its URDF and a planned motion."""
    place = tmp_path_factory.mktemp("documents")
    assert output.run(app, ["simulate", "drive", "--out", str(place / "run.csv"), *MODEL]) == 0
    assert output.run(app, ["export", "drive", "--to", "urdf", "--out", str(place / "arm.urdf")]) == 0
    assert output.run(app, ["optimize", "scenario1", "--out", str(place / "plan.json")]) == 0
    assert output.run(app, ["compare", "drive", str(place / "run.csv"), "--json", str(place / "compared.json")]) == 0
    text = (ARMS / "drive.toml").read_text()
    (place / "own.toml").write_text(text)
    (place / "bare.toml").write_text(text)
    return place


@pytest.mark.parametrize(
    "verb", [pytest.param(verb, marks=[pytest.mark.slow] if verb in SLOW else []) for verb in LINES]
)
def test_a_document_is_as_its_schema_says(verb: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It validates, and the struct holds every key of it."""
    monkeypatch.chdir(folder)
    assert output.run(app, [verb, *LINES[verb], "--json", "found.json"]) == 0
    document = json.loads((folder / "found.json").read_text())
    jsonschema.Draft202012Validator(verbs.schema(verb)).validate(document)
    assert plain(msgspec.convert(document, verbs.BY_VERB[verb])) == document


@pytest.mark.parametrize(
    ("verb", "line", "status", "kind"),
    [
        ("effects", ["lugre"], 0, 0),
        ("optimize", ["scenario1", "--cycle-time", "0.3"], 1, 0),
        ("init", ["--controller", "ur10"], 0, 0),
        ("experiment", ["drive", "--seconds", "20", "--budget", "50"], 1, 0),
    ],
    ids=["one effect", "no plan", "a controller", "a motion"],
)
def test_a_verbs_other_document(
    verb: str, line: list[str], status: int, kind: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert output.run(app, [verb, *line, "--json", "-"]) == status
    document = json.loads(capsys.readouterr().out)
    jsonschema.Draft202012Validator(verbs.schema(verb)).validate(document)
    assert plain(msgspec.convert(document, verbs.OR_ELSE[verb][kind])) == document


def test_an_effects_units_are_those_of_either_kind_of_joint(capsys: pytest.CaptureFixture[str]) -> None:
    assert output.run(app, ["effects", "stribeck"]) == 0
    assert "rad/s or m/s" in capsys.readouterr().out


def test_a_document_of_another_kind_does_not_validate() -> None:
    validator = jsonschema.Draft202012Validator(verbs.schema("simulate"))
    right: dict[str, Any] = {"out": "run.csv", "samples": 1, "seconds": 0.1, "seed": 0}
    right |= {"effects": [], "drives": [], "assumed": []}
    assert validator.is_valid(right)
    assert not validator.is_valid(right | {"samples": "many"})
    assert not validator.is_valid({k: v for k, v in right.items() if k != "seed"})


@pytest.mark.parametrize("verb", verbs.BY_VERB)
def test_every_number_and_key_has_a_meaning(verb: str) -> None:
    schema = verbs.schema(verb)
    jsonschema.Draft202012Validator.check_schema(schema)
    for component in schema["$defs"].values():
        assert all("description" in entry for entry in component["properties"].values())


def test_the_verb_prints_one_schema_or_all(capsys: pytest.CaptureFixture[str]) -> None:
    assert output.run(app, ["schema", "diagnose"]) == 0
    one = json.loads(capsys.readouterr().out)
    assert output.run(app, ["schema", "--json", "-"]) == 0
    everything = json.loads(capsys.readouterr().out)
    assert (everything["diagnose"], list(everything)) == (one, list(verbs.BY_VERB))
    assert output.run(app, ["schema", "nothing"]) == 2
    assert "there is one for: init" in capsys.readouterr().err


def test_the_table_of_keys_is_up_to_date() -> None:
    assert verbs.KEYS.read_text() == verbs.table_of_keys(), "run python -m runtime.documents.verbs"
