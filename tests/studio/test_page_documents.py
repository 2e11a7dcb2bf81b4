"""Documents of a session that may come from anyone: what is not of its kind is said, and never shown."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal, TypedDict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.studio.documents import Documents, check
from runtime.studio.session import SessionError, StudioSession
from runtime.studio.shown import StepShown


class Kind(TypedDict):
    """One of everything."""

    text: str
    number: float
    count: int
    flag: bool
    maybe: str | None
    pairs: list[tuple[str, float]]
    any: dict[str, Any]
    names: dict[str, int]
    one: Literal["a", "b"]


GOOD: dict[str, Any] = {
    "text": "x", "number": 1, "count": 2, "flag": True, "maybe": None, "pairs": [["a", 0.5]], "any": {"x": [1]},
    "names": {"x": 1}, "one": "a",
}  # fmt: skip
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


def test_what_is_of_its_kind_passes() -> None:
    check(GOOD | {"more": "does not matter"}, Kind)
    check([GOOD], list[Kind])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("text", 3), ("number", "1"), ("number", True), ("number", None), ("count", 1.5), ("count", True), ("flag", 1),
        ("maybe", 2), ("pairs", {}), ("pairs", [["a"]]), ("pairs", [["a", "b"]]), ("any", []), ("names", {"x": "1"}),
        ("one", "c"), ("one", ["a"]),
    ],
)  # fmt: skip
def test_what_is_not_is_said_with_its_place(key: str, value: object) -> None:
    with pytest.raises(TypeError, match=f"document.{key}"):
        check(GOOD | {key: value}, Kind)
    with pytest.raises(TypeError, match=f"{key} in it"):
        check({k: v for k, v in GOOD.items() if k != key}, Kind)


@given(JSON)
def test_whatever_stands_in_a_file_is_no_step_and_refused_in_one_line(value: object) -> None:
    with pytest.raises(TypeError) as caught:
        check(value, StepShown)
    assert "\n" not in str(caught.value)


def test_a_document_is_read_again_when_it_has_changed(tmp_path: Path) -> None:
    session = StudioSession.create(tmp_path / "session")
    documents, path = Documents(session), session.folder / "kind.json"
    assert documents.read(path, Kind) is None
    path.write_text(json.dumps(GOOD))
    first = documents.read(path, Kind)
    assert first == GOOD
    assert documents.read(path, Kind) is first
    replaced = tmp_path / "new.json"
    replaced.write_text(json.dumps(GOOD | {"text": "y"}))
    replaced.replace(path)
    assert documents.read(path, Kind) == GOOD | {"text": "y"}
    path.write_text('{"text": "<script>"}')
    with pytest.raises(SessionError, match=r"kind\.json"):
        documents.read(path, Kind)
