"""Keys of a user's file: what is not declared is refused, and what is declared is listed."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from symbolic.model_file import fields, keys
from symbolic.model_file.checks import ModelError, Place
from symbolic.model_file.fields import Bounds, Choice, Flag, Inner, Number, PerJoint, Several, Whole, WholeNumber

ARMS = Path(keys.__file__).resolve().parents[1] / "arms"

BELT = (
    Number("speed", "of the belt", unit=("rad/s", "m/s"), positive=True),
    Flag("endless", "whether it is", default=True),
    Inner("roller", "under it", (WholeNumber("teeth", "of it", low=2, default=12),), default={}),
    Inner("brake", "if there is one", (Number("force", "of it", unit="N"),), default=None),
    Several("load", "on it", (PerJoint("q1", "where", Number, default=None), Whole("node", "its", 1, 9, "1 to 9"))),
)


def read(**table: Any) -> dict[str, Any]:
    return fields.read(Place("belt.toml"), {"speed": 2, "load": [], **table}, BELT, "prismatic")


def test_what_is_left_out_is_as_declared() -> None:
    assert read() == {"speed": 2.0, "endless": True, "roller": {"teeth": 12}, "brake": None, "load": ()}


def test_tables_within_tables() -> None:
    found = read(roller={"teeth": 7.0}, brake={"force": 3}, load=[{"q2": 0.5, "q11": 1, "node": 4}])
    assert (found["roller"], found["brake"]) == ({"teeth": 7}, {"force": 3.0})
    assert found["load"] == ({"q1": {2: 0.5, 11: 1.0}, "node": 4},)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"sped": 1}, 'unknown key "sped"; did you mean "speed"?'),
        ({"roller": {"teth": 1}}, 'roller: unknown key "teth"; did you mean "teeth"?'),
        ({"load": [{"node": 1}, {"node": 1, "q0": 1}]}, 'load 2: unknown key "q0"; '),
        ({"load": [{}]}, 'load 1: missing key "node"; needed are node'),
        ({"brake": {}}, 'brake: missing key "force"; needed are force'),
        ({"speed": "2"}, 'speed is the text "2"; expected a number in m/s'),
        ({"speed": 0}, "speed is 0; expected a number in m/s > 0"),
        ({"endless": 1}, "endless is 1; expected true or false"),
        ({"roller": {"teeth": 2.5}}, "roller: teeth is 2.5; expected a whole number"),
        ({"roller": {"teeth": 1}}, "roller: teeth is 1; expected a number >= 2"),
        ({"roller": 3}, "roller: found 3; expected a table"),
        ({"load": {"node": 1}}, "load is a table; expected a list"),
        ({"load": [3]}, "load 1: found 3; expected a table"),
        ({"load": [{"node": 1.0}]}, "load 1: node is 1; expected 1 to 9"),
        ({"load": [{"node": 1, "q2": "x"}]}, 'load 1: q2 is the text "x"; expected a number'),
    ],
)
def test_what_is_wrong_is_said_with_its_place(table: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError) as caught:
        read(**table)
    assert str(caught.value).startswith(f"belt.toml: {message}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("value", "expected"), [(3, (3.0, 3.0)), ([1, 2], (1.0, 2.0)), ([2, 2], (2.0, 2.0))])
def test_bounds_may_be_one_number(value: Any, expected: tuple[float, float]) -> None:
    assert Bounds("k", "", low=0.0).read(Place("f"), value, "revolute") == expected


@pytest.mark.parametrize("value", [True, 2, "1", None, [], {}, float("nan")])
def test_a_choice_is_one_of_its_values(value: Any) -> None:
    sign = Choice("elbow", "", (1.0, -1.0), "1 or -1")
    assert repr(sign.read(Place("f"), -1, "revolute")) == "-1.0"
    with pytest.raises(ModelError, match="expected 1 or -1"):
        sign.read(Place("f"), value, "revolute")


def test_rows_list_every_key_once() -> None:
    found = [(row.key, row.unit, row.default) for row in fields.rows(BELT)]
    assert found == [
        ("speed", "rad/s (m/s)", "required"),
        ("endless", "", "true"),
        ("roller.teeth", "", "12"),
        ("brake.force", "N", "required"),
        ("load.q1", "", ""),
        ("load.node", "", "required"),
    ]


def _keys(document: Any, prefix: str = "") -> list[str]:
    if isinstance(document, list) and document and isinstance(document[0], dict):
        return [key for item in document for key in _keys(item, prefix)]
    if not isinstance(document, dict):
        return [prefix]
    if prefix.endswith("effects"):
        return [f"{prefix}.EFFECT"]
    return [key for name, item in document.items() for key in _keys(item, f"{prefix}.{name}".lstrip("."))]


@pytest.mark.parametrize("arm", sorted(path.stem for path in ARMS.glob("*.toml")))
def test_every_key_of_a_model_file_is_listed_with_what_it_means(arm: str) -> None:
    rows = {row.key: row for row in keys.model_file_rows()}
    document = tomllib.loads((ARMS / f"{arm}.toml").read_text(encoding="utf-8"))
    known = rows.keys() | {row.key for row in keys.spatial_file_rows() if len(document["gravity"]) == 3}
    assert set(_keys(document)) <= known
    assert len(rows) == len(keys.model_file_rows())
    assert all(row.meaning for row in rows.values())
    assert rows["joint.torque_constant"].unit.startswith("N m/A at the joint's output")
    assert (rows["joint.link.length"].unit, rows["joint.link.length"].default) == ("m", "required")
    assert (rows["joint.link.mass"].unit, rows["joint.link.mass"].default) == ("kg", "")
    assert (rows["joint.encoder.zero"].default, rows["joint.drive.direction"].default) == ("0", "1")
