"""Edits of a user's model file, text in and text out: comments, order and line ends stay.

An edit touches single lines where the file has ordinary [tables], and goes through tomlkit where it
has inline tables or dotted keys. Either way the result is read again and must say exactly what was
asked for, or nothing is changed.
"""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass
from itertools import count, pairwise
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from symbolic.described import AnyEffect, declared, number_name, numbered
from symbolic.model_file.arm import ROTOR, Arm
from symbolic.model_file.checks import SMALLEST, Place, at_joint, identifier, printable
from symbolic.model_file.reader import ModelError, check_effect, parse

DIGITS = 7
Owner = tuple[str, int | None]
"""Whose effects: ("joint", i counted from 1), ("arm", None) or ("contact", None)."""


def add_effect(
    text: str,
    where: str,
    library: Mapping[str, AnyEffect],
    effect: str,
    joint: int | None = None,
    values: Mapping[str, float] | None = None,
) -> str:
    """`text` with the effect active, its `values` written where known, in place of those it generalises.

    effect  one of which a joint may have several is added beside those that are there, under the next free name
    joint   counted from 1; None for effects of the arm and the contact
    Raises ModelError: not a model file, unknown effect, no such joint, wrong scope, already there, bad value.
    """
    arm = parse(text, where, library)
    place = Place(printable(where))
    owner = _owner(place, arm, library, effect, joint)
    active = _active(arm, owner)
    effect = _free_name(library, effect, active)
    if effect in active:
        place.fail(f'effect "{effect}" is already there{at_joint(joint)}; nothing to add')
    replaced = [name for name in declared(effect, library).generalises if name in active]
    new = {name: _rounded(value) for name, value in (values or {}).items()}

    def change(document: Any, table_of: Callable[[dict[str, float]], Any] = dict) -> None:
        table = _effects_of(document, owner)
        for name in replaced:
            del table[name]
        table[effect] = table_of(new)

    return _edited(text, where, library, change, lambda lines: _add_lines(lines, owner, effect, new, replaced))


def name_of_next(text: str, where: str, library: Mapping[str, AnyEffect], effect: str, joint: int | None = None) -> str:
    """The name under which `add_effect` would put the effect: with a number, where the joint has others of it.

    Raises ModelError: not a model file, unknown effect, no such joint, wrong scope.
    """
    arm = parse(text, where, library)
    owner = _owner(Place(printable(where)), arm, library, effect, joint)
    return _free_name(library, effect, _active(arm, owner))


def _free_name(library: Mapping[str, AnyEffect], effect: str, active: Container[str]) -> str:
    if effect not in library or not library[effect].several:
        return effect
    return next(name for k in count(1) if (name := number_name(effect, k)) not in active)


def remove_effect(
    text: str, where: str, library: Mapping[str, AnyEffect], effect: str, joint: int | None = None
) -> str:
    """`text` without the effect and what the file says of it.

    joint   counted from 1; None for effects of the arm and the contact
    Raises ModelError: not a model file, unknown effect, no such joint, wrong scope, not there.
    """
    arm = parse(text, where, library)
    place = Place(printable(where))
    owner = _owner(place, arm, library, effect, joint)
    if effect not in _active(arm, owner):
        place.fail(f'effect "{effect}" is not there{at_joint(joint)}; nothing to remove')

    def change(document: Any, _: Callable[[dict[str, float]], Any] = dict) -> None:
        table = _effects_of(document, owner)
        del table[effect]
        if not table:
            del _home_of(document, owner)["effects"]

    return _edited(text, where, library, change, lambda lines: _remove_lines(lines, owner, effect))


def place_effect(
    text: str,
    where: str,
    library: Mapping[str, AnyEffect],
    effect: str,
    joint: int | None,
    values: Mapping[str, float] | None,
) -> str:
    """`text` with the effect at these values, whether it was there or not; None: without it.

    Raises ModelError, as the edit does that this asks for.
    """
    arm = parse(text, where, library)
    there = effect in _active(arm, _owner(Place(printable(where)), arm, library, effect, joint))
    if values is None:
        return remove_effect(text, where, library, effect, joint) if there else text
    if there:
        return set_values(text, where, library, {(effect, joint): values})
    return add_effect(text, where, library, effect, joint, values)


def set_values(
    text: str,
    where: str,
    library: Mapping[str, AnyEffect],
    effects: Mapping[tuple[str, int | None], Mapping[str, float]],
    inertial: Mapping[str, float] | None = None,
    rotors: Mapping[int, float] | None = None,
) -> str:
    """`text` with new parameter values of active effects and of [inertial], and new inertias of rotors.

    effects    (effect, joint or None) -> parameter -> value in SI
    inertial   base inertial parameter -> value in SI
    rotors     joint, counted from 1 -> kg m² (kg) at its output
    Raises ModelError: an effect that is not active, no such parameter, a value out of its bounds.
    """
    arm = parse(text, where, library)
    place = Place(printable(where))
    changes: list[tuple[tuple[str, ...], int | None, dict[str, float]]] = []
    for (effect, joint), values in effects.items():
        owner = _owner(place, arm, library, effect, joint)
        if effect not in _active(arm, owner):
            place.fail(f'effect "{effect}" is not in the file; add it first')
        changes.append(((*_prefix(owner), effect), owner[1], {k: _rounded(v) for k, v in values.items()}))
    changes += [(("joint",), joint, {ROTOR: _rounded(value)}) for joint, value in (rotors or {}).items()]
    if inertial:
        rounded = {identifier(place.inside("inertial"), "key", k): _rounded(v) for k, v in inertial.items()}
        changes.append((("inertial",), None, rounded))

    def change(document: Any, table_of: Callable[[dict[str, float]], Any] = dict) -> None:
        for path, joint, values in changes:
            table = document
            for key in path:
                table = table.setdefault(key, table_of({}))
                if key == "joint" and joint:
                    table = table[joint - 1]
            table.update(values)

    def by_lines(lines: list[str]) -> list[str]:
        for path, joint, values in changes:
            lines = _set_lines(lines, path, joint, values)
        return lines

    return _edited(text, where, library, change, by_lines)


# --- what is asked for ---


def _owner(place: Place, arm: Arm, library: Mapping[str, AnyEffect], effect: str, joint: int | None) -> Owner:
    known = numbered(effect, library)[0] in library
    scope = declared(effect, library).scope if known else "joint"
    if scope in ("joint", "joints"):
        n = len(arm.joints)
        if joint is None:
            if not known:
                check_effect(place, effect, "joint", library)
            place.fail(f'effect "{effect}" acts on a joint; say which with --joint 1{f" to {n}" if n > 1 else ""}')
        if not 1 <= joint <= n:
            place.fail(f"there is no joint {joint}; the arm has {n}, counted from 1")
        check_effect(place.inside(f"joint {joint}"), effect, "joint", library, last=joint == n)
        return "joint", joint
    if joint is not None:
        place.fail(f'effect "{effect}" acts on {"the whole arm" if scope == "arm" else "the contact"}; drop --joint')
    if scope == "contact" and arm.contact is None:
        space = arm.space
        how = "which belongs to planar arms; this one is in space" if space else "and the file has none; add [contact]"
        place.fail(f'effect "{effect}" acts at a contact, {how}{"" if space else " with x first"}')
    return scope, None


def _active(arm: Arm, owner: Owner) -> Mapping[str, Any]:
    scope, joint = owner
    if joint is not None:
        return arm.joints[joint - 1].effects
    if scope == "arm":
        return arm.effects
    return arm.contact.effects if arm.contact else {}


def _prefix(owner: Owner) -> tuple[str, ...]:
    return ("effects",) if owner[0] == "arm" else (owner[0], "effects")


def _home_of(document: Any, owner: Owner) -> Any:
    """The table that has the owner's effects in it."""
    scope, joint = owner
    table = document if scope == "arm" else document[scope]
    return table if joint is None else table[joint - 1]


def _effects_of(document: Any, owner: Owner) -> Any:
    return _home_of(document, owner).setdefault("effects", {})


def _rounded(value: float) -> float:
    """As it will stand in the file: more digits than any fit determines, few enough to read; 0 for next to nothing."""
    return 0.0 if abs(value) < SMALLEST else float(f"{float(value):.{DIGITS}g}")


# --- how it gets into the file ---


def _edited(
    text: str,
    where: str,
    library: Mapping[str, AnyEffect],
    change: Callable[..., None],
    by_lines: Callable[[list[str]], list[str]],
) -> str:
    """The first way of editing whose result says what is asked for."""
    bare = text.removeprefix("\ufeff")
    bom = text[: len(text) - len(bare)]
    expected = copy.deepcopy(tomllib.loads(bare))
    change(expected)
    edits: tuple[Callable[[], str], ...] = (
        lambda: "".join(by_lines(_lines(bare))),
        lambda: _by_tomlkit(bare, change),
        lambda: _by_tomlkit(bare, lambda document: change(document, _inline)),  # among dotted keys
    )
    for edit in edits:
        try:
            result = edit()
            same = tomllib.loads(result) == expected
        except (TOMLKitError, tomllib.TOMLDecodeError, LookupError, TypeError, AttributeError):
            continue
        if same:
            parse(result, where, library)
            return bom + result
    # Neither way: the values themselves may be at fault, which parse says better.
    parse(tomlkit.dumps(expected), where, library)
    raise ModelError(f"{printable(where)}: this layout cannot be edited; write it with [tables] instead of inline ones")


def _by_tomlkit(text: str, change: Callable[[Any], None]) -> str:
    document = tomlkit.parse(text)
    change(document)
    result = tomlkit.dumps(document)
    if "\r\n" in text and not re.search(r"(?<!\r)\n", text):
        result = re.sub(r"(?<!\r)\n", "\r\n", result)
    return result


def _inline(values: Mapping[str, float]) -> Any:
    table = tomlkit.inline_table()
    table.update(values)
    return table


def _lines(text: str) -> list[str]:
    """With their ends; only \\n and \\r\\n end a line in TOML."""
    return re.findall(r"[^\n]*\n|[^\n]+$", text)


@dataclass(frozen=True)
class _Section:
    """A table of the file: lines[start] is its header, lines[start:end] all of it up to the next header."""

    path: tuple[str, ...]
    joint: int | None
    start: int
    end: int
    content_end: int
    """After its last line that is neither blank nor a comment leading over to the next table."""


def _sections(lines: list[str]) -> Iterator[_Section]:
    # In a valid model file, only a header begins with a bracket: no value there is a list of lists.
    starts = [k for k, line in enumerate(lines) if line.lstrip().startswith("[")]
    joints = 0
    for start, end in pairwise([*starts, len(lines)]):
        value: Any = tomllib.loads(lines[start])
        path: list[str] = []
        while value:
            if isinstance(value, list):
                value = value[0]
                continue
            key = next(iter(value))
            path.append(key)
            value = value[key]
        if path == ["joint"]:
            joints += 1
        yield _Section(tuple(path), joints if path[0] == "joint" else None, start, end, _content_end(lines, start, end))


def _content_end(lines: list[str], start: int, end: int) -> int:
    k = end
    while k > start + 1 and (not lines[k - 1].strip() or lines[k - 1].lstrip().startswith("#")):
        k -= 1
    # Comments right below the content with a blank line after them belong to it.
    below = k
    while below < end and lines[below].lstrip().startswith("#"):
        below += 1
    return below if below == end == len(lines) or (below < end and not lines[below].strip()) else k


def _add_lines(
    lines: list[str], owner: Owner, effect: str, values: Mapping[str, float], replaced: list[str]
) -> list[str]:
    prefix = _prefix(owner)
    own = [s for s in _sections(lines) if s.joint == owner[1] and (owner[0] == "arm" or s.path[0] == prefix[0])]
    siblings = [s for s in own if s.path[: len(prefix)] == prefix]
    old = [s for s in siblings if s.path[len(prefix) :] in [(name,) for name in replaced]]
    home = old[0] if old else (siblings or own or list(_sections(lines)))[-1]
    indent = re.match(r"\s*", lines[home.start])[0] if siblings else ""  # type: ignore[index]
    end = _line_end(lines)
    new = [f"{indent}[{'.'.join((*prefix, effect))}]{end}", *(f"{indent}{k} = {v!r}{end}" for k, v in values.items())]
    if owner[0] != "joint" and not siblings:
        new.insert(0, end)
    lines = list(lines)
    for section in reversed(old[1:]):
        del lines[section.start : section.content_end]
    at = home.start if old else home.content_end
    return _spliced(lines, at, home.content_end, new, end)


def _remove_lines(lines: list[str], owner: Owner, effect: str) -> list[str]:
    path = (*_prefix(owner), effect)
    found = [s for s in _sections(lines) if s.path == path and s.joint == owner[1]]
    start, after = found[0].start, lines[found[0].content_end :]
    # One of two blank lines that would meet, and one that would end the file.
    if not lines[start - 1].strip() and not (after and after[0].strip()):
        start -= 1
    return [*lines[:start], *after]


def _set_lines(lines: list[str], path: tuple[str, ...], joint: int | None, values: Mapping[str, float]) -> list[str]:
    end = _line_end(lines)
    section = next((s for s in _sections(lines) if s.path == path and s.joint == joint), None)
    if section is None:
        about = "# base inertial parameters as identified; they override what follows from the links"
        new = [end, f"[{'.'.join(path)}]{end}", about + end, *(f"{k} = {v!r}{end}" for k, v in values.items())]
        return _spliced(lines, len(lines), len(lines), new, end)
    lines = list(lines)
    missing = dict(values)
    indent = re.match(r"\s*", lines[section.start])[0]  # type: ignore[index]
    for k in range(section.start + 1, section.content_end):
        match = re.match(r"(\s*)([A-Za-z0-9_-]+)(\s*=\s*)([^\s#]+)(.*)", lines[k], re.DOTALL)
        if match and match[2] in values:
            value = missing.pop(match[2])
            if not _is_same(match[4], value):
                lines[k] = f"{match[1]}{match[2]}{match[3]}{value!r}{match[5]}"
            indent = match[1]
    new = [f"{indent}{k} = {v!r}{end}" for k, v in missing.items()]
    return _spliced(lines, section.content_end, section.content_end, new, end) if new else lines


def _is_same(written: str, value: float) -> bool:
    try:
        return float(written.replace("_", "")) == value
    except ValueError:
        return False


def _spliced(lines: list[str], start: int, stop: int, new: list[str], end: str) -> list[str]:
    """lines[start:stop] replaced by `new`, with a line end before it where the file's last line has none."""
    before = list(lines[:start])
    if before and not before[-1].endswith("\n"):
        before[-1] += end
    return [*before, *new, *lines[stop:]]


def _line_end(lines: list[str]) -> str:
    ended = [line for line in lines if line.endswith("\n")]
    return "\r\n" if ended and all(line.endswith("\r\n") for line in ended) else "\n"
