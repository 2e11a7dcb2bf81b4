"""Edits of a user's model file, text in and text out: comments, order and line ends stay.

The result is parsed again and must state exactly what was asked for; otherwise the edit is refused.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from itertools import count
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Comment, Null, Table, Whitespace

from symbolic.described import AnyEffect, declared, number_name, numbered
from symbolic.model_file.arm import ROTOR, Arm
from symbolic.model_file.checks import SMALLEST, Place, at_joint, identifier, printable
from symbolic.model_file.reader import ModelError, check_effect, parse

DIGITS = 7
ABOUT_INERTIAL = "base inertial parameters as identified; they override what follows from the links"
Owner = tuple[str, int | None]
"""Whose effects: ("joint", i counted from 1), ("arm", None) or ("contact", None)."""
TableOf = Callable[..., Any]
"""Makes a table of values, with a comment below its header: a dict or one of tomlkit."""


def _plain(values: Mapping[str, Any], _: str = "") -> dict[str, Any]:
    return dict(values)


def add_effect(
    text: str,
    where: str,
    library: Mapping[str, AnyEffect],
    effect: str,
    joint: int | None = None,
    values: Mapping[str, float] | None = None,
) -> str:
    """Add an effect with its known `values`; it replaces the effects that it generalises.

    effect   one that a joint may have several of is added under the next free name
    joint    counted from 1; None for effects of the arm and the contact
    Returns the new text. Raises ModelError: not a model file, unknown effect, no such joint, wrong scope, already
    active, value out of bounds.
    """
    arm = parse(text, where, library)
    place = Place(printable(where))
    owner = _owner(place, arm, library, effect=effect, joint=joint)
    active = _active(arm, owner)
    effect = _free_name(library, effect, active)
    if effect in active:
        place.fail(f'effect "{effect}" is already there{at_joint(joint)}; nothing to add')
    replaced = [name for name in declared(effect, library).generalises if name in active]
    new = {name: _rounded(value) for name, value in (values or {}).items()}

    def change(document: Any, table_of: TableOf = _plain) -> None:
        table = _home_of(document, owner).setdefault("effects", {})
        names = list(table)
        behind = {name: table.pop(name) for name in (names[names.index(replaced[0]) :] if replaced else [])}
        table[effect] = table_of(new)
        table.update({name: value for name, value in behind.items() if name not in replaced})

    return _edited(text, where, library, change, apart=owner[0] != "joint" and not active)


def name_of_next(text: str, where: str, library: Mapping[str, AnyEffect], effect: str, joint: int | None = None) -> str:
    """The name that `add_effect` would use: with a number, where the joint has others of this effect.

    Raises ModelError: not a model file, unknown effect, no such joint, wrong scope.
    """
    arm = parse(text, where, library)
    owner = _owner(Place(printable(where)), arm, library, effect=effect, joint=joint)
    return _free_name(library, effect, _active(arm, owner))


def _free_name(library: Mapping[str, AnyEffect], effect: str, active: Container[str]) -> str:
    if effect not in library or not library[effect].several:
        return effect
    return next(name for k in count(1) if (name := number_name(effect, k)) not in active)


def remove_effect(
    text: str, where: str, library: Mapping[str, AnyEffect], effect: str, joint: int | None = None
) -> str:
    """Remove an effect and its values.

    joint   counted from 1; None for effects of the arm and the contact
    Returns the new text. Raises ModelError: not a model file, unknown effect, no such joint, wrong scope, not active.
    """
    arm = parse(text, where, library)
    place = Place(printable(where))
    owner = _owner(place, arm, library, effect=effect, joint=joint)
    if effect not in _active(arm, owner):
        place.fail(f'effect "{effect}" is not there{at_joint(joint)}; nothing to remove')

    def change(document: Any, _: TableOf = _plain) -> None:
        home = _home_of(document, owner)
        del home["effects"][effect]
        if not home["effects"]:
            del home["effects"]

    return _edited(text, where, library, change)


def place_effect(
    text: str,
    where: str,
    library: Mapping[str, AnyEffect],
    effect: str,
    joint: int | None,
    values: Mapping[str, float] | None,
) -> str:
    """Add the effect, or set its values if it is active; values None: remove it. Raises ModelError."""
    arm = parse(text, where, library)
    there = effect in _active(arm, _owner(Place(printable(where)), arm, library, effect=effect, joint=joint))
    if values is None:
        return remove_effect(text, where, library, effect=effect, joint=joint) if there else text
    if there:
        return set_values(text, where, library, {(effect, joint): values})
    return add_effect(text, where, library, effect=effect, joint=joint, values=values)


def set_values(
    text: str,
    where: str,
    library: Mapping[str, AnyEffect],
    effects: Mapping[tuple[str, int | None], Mapping[str, float]],
    inertial: Mapping[str, float] | None = None,
    rotors: Mapping[int, float] | None = None,
) -> str:
    """Set parameter values of active effects and of [inertial], and rotor inertias.

    effects    (effect, joint or None) -> parameter -> value in SI
    inertial   base inertial parameter -> value in SI
    rotors     joint, counted from 1 -> kg m² (kg) at its output
    Returns the new text. Raises ModelError: effect not active, no such parameter, value out of bounds.
    """
    arm = parse(text, where, library)
    place = Place(printable(where))
    changes: list[tuple[tuple[str, ...], int | None, dict[str, float]]] = []
    for (effect, joint), values in effects.items():
        owner = _owner(place, arm, library, effect=effect, joint=joint)
        if effect not in _active(arm, owner):
            place.fail(f'effect "{effect}" is not in the file; add it first')
        path = ("effects", effect) if owner[0] == "arm" else (owner[0], "effects", effect)
        changes.append((path, owner[1], {k: _rounded(v) for k, v in values.items()}))
    changes += [(("joint",), joint, {ROTOR: _rounded(value)}) for joint, value in (rotors or {}).items()]
    if inertial:
        rounded = {identifier(place.inside("inertial"), "key", k): _rounded(v) for k, v in inertial.items()}
        changes.append((("inertial",), None, rounded))

    def change(document: Any, table_of: TableOf = _plain) -> None:
        for path, joint, values in changes:
            table = document
            for key in path:
                table = table.setdefault(key, table_of({}, ABOUT_INERTIAL if key == "inertial" else ""))
                if key == "joint" and joint:
                    table = table[joint - 1]
            table.update({key: value for key, value in values.items() if table.get(key) != value})

    return _edited(text, where, library, change, apart=True)


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


def _home_of(document: Any, owner: Owner) -> Any:
    """The table that contains the owner's `effects`."""
    scope, joint = owner
    table = document if scope == "arm" else document[scope]
    return table if joint is None else table[joint - 1]


def _rounded(value: float) -> float:
    """Rounded for the file: more digits than a fit determines, few enough to read; tiny values are 0."""
    return 0.0 if abs(value) < SMALLEST else float(f"{float(value):.{DIGITS}g}")


# --- how it gets into the file ---


def _edited(
    text: str, where: str, library: Mapping[str, AnyEffect], change: Callable[..., None], apart: bool = False
) -> str:
    """The text after `change`, which must state exactly what the same change makes of plain tables.

    apart   a blank line goes above a new table
    """
    bare = text.removeprefix("\ufeff")
    expected = tomllib.loads(bare)
    change(expected)
    if expected == tomllib.loads(bare):
        return text
    for table_of in (_table, _inline):  # tables with headers, else inline ones among dotted keys
        try:
            document = tomlkit.parse(bare if bare.endswith("\n") else f"{bare}\n")
            above = _detached(document)
            change(document, table_of)
            _reattach(document, above, apart)
            result = tomlkit.dumps(document)
            same = tomllib.loads(result) == expected
        except (TOMLKitError, ValueError, LookupError, TypeError, AttributeError):
            continue
        if same:
            if "\r\n" in bare and not re.search(r"(?<!\r)\n", bare):
                result = re.sub(r"(?<!\r)\n", "\r\n", result)
            parse(result, where, library)
            return text[: len(text) - len(bare)] + result
    # Where the values themselves are at fault, parse says so.
    parse(tomlkit.dumps(expected), where, library)
    raise ModelError(f"{printable(where)}: this layout cannot be edited; write it with [tables] instead of inline ones")


def _table(values: Mapping[str, Any], about: str = "") -> Any:
    table = tomlkit.table()
    if about:
        table.add(tomlkit.comment(about))
    table.update(values)
    return table


def _inline(values: Mapping[str, Any], _: str = "") -> Any:
    table = tomlkit.inline_table()
    table.update(values)
    return table


Trivia = list[tuple[Any, Any]]
"""Blank lines and comments, as they stand in the body of a container of tomlkit."""


def _tables(container: Any) -> Iterator[Any]:
    """The document and all tables within it, in the order of the text."""
    yield container
    for _, item in _body(container):
        for table in item.body if isinstance(item, AoT) else [item] if isinstance(item, Table) else []:
            yield from _tables(table)


def _with_header(tables: Iterable[Any]) -> list[Any]:
    return [table for table in tables if not (isinstance(table, Table) and table.is_super_table())]


def _body(container: Any) -> Any:
    return container.value.body if isinstance(container, Table) else container.body


def _content_end(body: Any) -> int:
    """Where the keys of a table end and the tables within it begin."""
    return next((k for k, (_, item) in enumerate(body) if isinstance(item, Table | AoT)), len(body))


def _detached(document: Any) -> list[tuple[Any, Trivia]]:
    """Every table with the blank lines and comments above its header, which tomlkit keeps in the table before it.

    The last entry, None, is the end of the file. Comments right below a key stay with it where a blank line follows.
    """
    tables = _with_header(_tables(document))
    found: list[tuple[Any, Trivia]] = []
    for table, following in zip(tables, [*tables[1:], None], strict=True):
        body = _body(table)
        end = start = _content_end(body)
        while start and isinstance(body[start - 1][1], Whitespace | Comment):
            start -= 1
        below = start
        while below < end and isinstance(body[below][1], Comment):
            below += 1
        if below < end or following is None:
            start = below
        found.append((following, body[start:end]))
        body[start:end] = [(None, Null())] * (end - start)  # tomlkit counts on the places of the others
    return found


def _reattach(document: Any, above: list[tuple[Any, Trivia]], apart: bool) -> None:
    """Puts blank lines and comments above the tables where they were; those of a removed table, above the next one."""
    known = {id(table) for table, _ in above}
    for table in list(_tables(document))[1:]:
        table.trivia.indent = table.trivia.indent.lstrip("\n")
    tables, left = _with_header(_tables(document)), Trivia()
    for table in tables[1:]:
        if apart and id(table) not in known:
            table.trivia.indent = f"\n{table.trivia.indent}"
    before = {id(table): tables[k - 1] for k, table in enumerate(tables)}
    for table, trivia in above:
        if table is not None and id(table) not in before:
            left = [*left, *trivia]
            continue
        if left and isinstance(left[-1][1], Whitespace) and (not trivia or isinstance(trivia[0][1], Whitespace)):
            left.pop()
        body = _body(tables[-1] if table is None else before[id(table)])
        end = _content_end(body)
        body[end:end] = [*left, *trivia]
        left = []
