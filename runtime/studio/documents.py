"""Documents of a session, read when they are another than before, and what they must be: the folder may be anyone's."""

from __future__ import annotations

import types
from collections.abc import Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints, is_typeddict

from runtime.studio.session import SessionError, StudioSession
from runtime.studio.settings import MOST_DOCUMENTS
from symbolic.model_file.checks import quote

T = TypeVar("T")


class Documents:
    """JSON files of a session, each kept for as long as it is the same."""

    def __init__(self, session: StudioSession) -> None:
        self._session = session
        self._kept: dict[Path, tuple[int, Any]] = {}

    def read(self, path: Path, kind: type[T]) -> T | None:
        """A document of a kind: a class of shown.py, or a list of such; None where there is none.

        Raises SessionError where it is none of that kind.
        """
        if not path.is_file():
            return None
        changed = path.stat().st_mtime_ns
        if path not in self._kept or self._kept[path][0] != changed:
            found = self._session.document(path)
            try:
                check(found, kind)
            except TypeError as error:
                raise SessionError(f"{path}: {error}") from error
            if len(self._kept) >= MOST_DOCUMENTS:
                self._kept.clear()
            self._kept[path] = changed, found
        return cast(T, self._kept[path][1])


def check(value: object, kind: Any, where: str = "document") -> None:
    """Whether JSON is of a kind: a TypedDict or a dataclass, whose keys beyond its fields do not matter, or what their
    fields may be. Raises TypeError, which says where it is not."""
    origin, inside = get_origin(kind), get_args(kind)
    if kind is Any:
        return
    if origin in (Union, types.UnionType):
        _one_of(value, inside, where)
    elif origin is Literal:
        _must(value in inside, value, where, f"one of {', '.join(map(repr, inside))}")
    elif is_typeddict(kind) or is_dataclass(kind):
        _must(isinstance(value, dict), value, where, "an object")
        _fields(cast(dict[str, object], value), get_type_hints(kind), where)
    elif origin is list:
        _must(isinstance(value, list), value, where, "a list")
        for k, entry in enumerate(cast(Sequence[object], value)):
            check(entry, inside[0], f"{where}[{k}]")
    elif origin is tuple:
        _must(isinstance(value, list) and len(value) == len(inside), value, where, f"a list of {len(inside)}")
        for entry, own in zip(cast(Sequence[object], value), inside, strict=True):
            check(entry, own, where)
    elif origin is dict:
        _must(isinstance(value, dict), value, where, "an object")
        for name, entry in cast(dict[str, object], value).items():
            check(entry, inside[1], f"{where}.{name}")
    else:
        plain = (int, float) if kind is float else kind
        _must(isinstance(value, plain) and (kind is bool or not isinstance(value, bool)), value, where, kind.__name__)


def _fields(value: dict[str, object], fields: dict[str, Any], where: str) -> None:
    for name, own in fields.items():
        _must(name in value, value, where, f"{name} in it")
        check(value[name], own, f"{where}.{name}")


def _one_of(value: object, kinds: Sequence[Any], where: str) -> None:
    wrong = ""
    for kind in kinds:
        try:
            check(value, kind, where)
        except TypeError as error:
            wrong = str(error)
        else:
            return
    raise TypeError(wrong)


def _must(holds: bool, value: object, where: str, expected: str) -> None:
    if not holds:
        raise TypeError(f"{where} is {quote(str(value)[:40])}; expected {expected}")
