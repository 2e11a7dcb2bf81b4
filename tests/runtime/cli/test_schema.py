"""The JSON schemas that ship for editors: up to date, true of every file that ships, and as strict as the readers."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import tomlkit
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.cli import schema as schemas
from runtime.planning import scenario_file
from runtime.workspace.names import ARMS, SCENARIOS
from symbolic.model_file import reader
from symbolic.model_file.checks import ModelError, Place

jsonschema = pytest.importorskip("jsonschema")

FILES = dict.fromkeys(sorted(ARMS.glob("*.toml")), schemas.MODEL) | dict.fromkeys(
    sorted(SCENARIOS.glob("*.toml")), schemas.SCENARIO
)
STRUCTURE = re.compile(
    r"unknown (key|parameter)|missing key"
    r"| is (the text|the boolean|a list|a table|the date|-?[\d.]+; expected a (text|list))"
    r"|found (the text|the boolean|a list|-?[\d.]+;)|expected true or false"
)
"""What the readers say of a key that is none, or of a value of another kind; not of one that is out of range."""
WRONG = [True, "two", 3.5, ["a"], [[1.0]], {}, {"a": {"b": "c"}}]


@cache
def validator(name: str) -> Any:
    return jsonschema.Draft7Validator(json.loads(schemas.made()[name]))


def refusal(name: str, document: dict[str, Any]) -> str | None:
    """What the reader says of a document; None if it takes it."""
    try:
        if name == schemas.MODEL:
            reader.parse(tomlkit.dumps(document), "file")
        else:
            scenario_file.parse(tomllib.loads(tomlkit.dumps(document)), Place("file"))
    except ModelError as error:
        return str(error)
    return None


def test_they_are_up_to_date():
    assert {name: data.decode() for name, data in schemas.shipped().items()} == schemas.made(), (
        "run python -m runtime.cli.schema"
    )
    for name in schemas.made():
        jsonschema.Draft7Validator.check_schema(validator(name).schema)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_file_that_ships_is_valid(path: Path):
    validator(FILES[path]).validate(tomllib.loads(path.read_text()))


def places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Every key of every table in a document, and every entry of every list, with what it is in."""
    for key in node if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ():
        yield node, key
        yield from places(node[key])


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(list(FILES)), st.data())
def test_a_mistake_of_structure_is_refused_by_both(path: Path, data: st.DataObject):
    """A key mistyped, left out, put there, or with a value of another kind, anywhere in a file that ships."""
    document = copy.deepcopy(tomllib.loads(path.read_text()))
    node, key = data.draw(st.sampled_from(list(places(document))), label="place")
    kind = data.draw(st.sampled_from(["value", "mistyped", "missing", "more"]))
    if kind == "value" or not isinstance(node, dict):
        node[key] = copy.deepcopy(data.draw(st.sampled_from(WRONG)))
    elif kind == "mistyped":
        node[f"{key}x"] = node.pop(key)
    elif kind == "missing":
        del node[key]
    else:
        node["unheard_of"] = 1.0
    said = refusal(FILES[path], document)
    valid = validator(FILES[path]).is_valid(document)
    if not valid:
        assert said is not None
    elif said is not None:
        assert not STRUCTURE.search(said) or "unknown effect" in said, said


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("mass = 2.0", 'mass = "2.0"'),
        ("mass = 2.0", "mas = 2.0"),
        ("gear_ratio = 100", ""),
        ('"revolute"', '"turning"'),
        ("length = 0.30", "length = [0.3]"),
        ("[joint.effects.viscous]\n", "[joint.effects.viscous]\ncoeficient = 1.0\n"),
        ("[joint.effects.viscous]\n", "[joint.effects.gravity]\n"),
        ("[joint.effects.viscous]\n", "axis = [0.0, 0.0, 1.0]\n"),
    ],
)
def test_common_mistakes_are_seen_in_the_editor(old: str, new: str):
    text = (ARMS / "drive.toml").read_text()
    assert old in text
    assert not validator(schemas.MODEL).is_valid(tomllib.loads(text.replace(old, new)))


def test_effects_of_ones_own_are_no_mistake():
    document = tomllib.loads((ARMS / "drive.toml").read_text())
    document["joint"][0]["effects"] |= {"my_brake": {"torque": 1.0}, "torque_ripple_2": {"order": 2.0}}
    assert validator(schemas.MODEL).is_valid(document)
    document["joint"][0]["effects"]["torque_ripple_2"] = {"ordre": 2.0}
    assert not validator(schemas.MODEL).is_valid(document)
