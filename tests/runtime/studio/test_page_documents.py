"""Documents of a session may come from anyone: an invalid one is refused with one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.studio.documents import StepOverview, ValuesAnswer, VerdictOverview, document
from runtime.studio.session import SessionError

TRIED = {
    "placed": {"effect": "coulomb", "joint": 1},
    "values": {"torque": 1},
    "joints": [{"joint": 1, "rms": 0.5, "relative": 0.1, "fitted": 0.1, "signals": "step0-tried1"}],
}
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        (json.dumps(TRIED | {"values": {"torque": "1"}}), "values"),
        (json.dumps(TRIED | {"values": {"torque": True}}), "values"),
        (json.dumps(TRIED | {"placed": {"effect": "a;rm -rf", "joint": 1}}), "placed.effect"),
        (json.dumps(TRIED | {"placed": {"effect": "coulomb", "joint": 0}}), "placed.joint"),
        (json.dumps(TRIED | {"joints": [{}]}), "joints"),
        (json.dumps({k: v for k, v in TRIED.items() if k != "values"}), "values"),
        ('{"values": {"torque": NaN}}', "malformed"),
        ("", "truncated"),
        ("[" * 100_000, "object"),
        ('{"more": ' + "[" * 100_000, "recursion"),
    ],
)
def test_what_is_not_of_its_kind_is_said_with_its_place(tmp_path: Path, text: str, place: str) -> None:
    path = tmp_path / "tried.json"
    path.write_text(text)
    with pytest.raises(SessionError, match=rf"tried\.json: .*{place}") as caught:
        document(path, ValuesAnswer)
    assert "\n" not in str(caught.value)


@given(JSON)
def test_whatever_stands_in_a_file_is_no_step(tmp_path_factory: pytest.TempPathFactory, value: object) -> None:
    path = tmp_path_factory.mktemp("any") / "overview.json"
    path.write_text(json.dumps(value))
    for kind in (StepOverview, VerdictOverview):
        with pytest.raises(SessionError):
            document(path, kind)


def test_a_document_is_read_again_when_it_has_changed(tmp_path: Path) -> None:
    path = tmp_path / "tried.json"
    assert document(path, ValuesAnswer) is None
    path.write_text(json.dumps(TRIED | {"further": "keys do not matter"}))
    first = document(path, ValuesAnswer)
    assert first is not None
    assert first.joints[0].signals == "step0-tried1"
    assert document(path, ValuesAnswer) is first
    replaced = tmp_path / "new.json"
    replaced.write_text(json.dumps(TRIED | {"values": {"torque": 2}}))
    replaced.replace(path)
    again = document(path, ValuesAnswer)
    assert again is not None
    assert again.values == {"torque": 2}
