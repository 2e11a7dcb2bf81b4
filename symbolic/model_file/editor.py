"""Edits of a user's model file, text in and text out: comments, order and line ends stay.

The result is parsed again and must state exactly what was asked for; otherwise the edit is refused.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Any, Self

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Comment, InlineTable, Null, Table, Whitespace

from symbolic.described import AnyEffect, declared, number_name, numbered
from symbolic.model_file.arm import ROTOR, Arm, ProposedValue
from symbolic.model_file.checks import SMALLEST, Place, at_joint, identifier, printable
from symbolic.model_file.keys import CONTROLLER, ENCODER, GAINS, JOINT, JOINT_MONITOR, LIMITS, MONITOR
from symbolic.model_file.reader import ModelError, check_effect, parse

DIGITS = 7
ABOUT_INERTIAL = "base inertial parameters as identified; they override what follows from the links"
Owner = tuple[str, int | None]
"""Whose effects: ("joint", i counted from 1), ("arm", None) or ("contact", None)."""
TableOf = Callable[..., Any]
"""Makes a table of values, with a comment below its header: a dict or one of tomlkit."""


PROPOSED = "proposed"
"""The word in the comment beside a value that nobody has measured; it goes when the value is set."""


def _plain(values: Mapping[str, Any], _: str = "") -> dict[str, Any]:
    return dict(values)


@dataclass(frozen=True)
class ModelText:
    """The text of a model file, to be edited. Each edit returns a new object.

    path      the file, for messages
    effects   library in which the file's effects are declared
    Joints are counted from 1; joint None: an effect of the arm or the contact. The edits raise ModelError: not a model
    file, unknown effect or parameter, no such joint, wrong scope, value out of bounds.
    """

    path: Path
    text: str
    effects: Mapping[str, AnyEffect]

    @cached_property
    def arm(self) -> Arm:
        """What the text says."""
        return parse(self.text, str(self.path), self.effects)

    def add(self, effect: str, joint: int | None = None, values: Mapping[str, float] | None = None) -> Self:
        """Add an effect with its known values, under `name_of_next`; it replaces the effects that it generalises."""
        owner, active = self._home(effect, joint)
        effect = self.name_of_next(effect, joint)
        if effect in active:
            self._place.fail(f'effect "{effect}" is already there{at_joint(joint)}; nothing to add')
        replaced = [name for name in declared(effect, self.effects).generalises if name in active]
        new = {name: _rounded(value) for name, value in (values or {}).items()}

        def change(document: Any, table_of: TableOf = _plain) -> None:
            table = _home_of(document, owner).setdefault("effects", {})
            names = list(table)
            behind = {name: table.pop(name) for name in (names[names.index(replaced[0]) :] if replaced else [])}
            table[effect] = table_of(new)
            table.update({name: value for name, value in behind.items() if name not in replaced})

        return self._edited(change, apart=owner[0] != "joint" and not active)

    def name_of_next(self, effect: str, joint: int | None = None) -> str:
        """The name under which `add` adds an effect: numbered where the joint has others of a kind it may have several
        of."""
        _, active = self._home(effect, joint)
        if effect not in self.effects or not self.effects[effect].several:
            return effect
        return next(name for k in count(1) if (name := number_name(effect, k)) not in active)

    def remove(self, effect: str, joint: int | None = None) -> Self:
        """Remove an active effect and its values."""
        owner, active = self._home(effect, joint)
        if effect not in active:
            self._place.fail(f'effect "{effect}" is not there{at_joint(joint)}; nothing to remove')

        def change(document: Any, _: TableOf = _plain) -> None:
            home = _home_of(document, owner)
            del home["effects"][effect]
            if not home["effects"]:
                del home["effects"]

        return self._edited(change)

    def place(self, effect: str, joint: int | None, values: Mapping[str, float] | None) -> Self:
        """Add the effect, or set its values if it is active; values None: remove it."""
        _, active = self._home(effect, joint)
        if values is None:
            return self.remove(effect, joint) if effect in active else self
        return self.set_values({(effect, joint): values}) if effect in active else self.add(effect, joint, values)

    def set_values(
        self,
        effects: Mapping[tuple[str, int | None], Mapping[str, float]],
        inertial: Mapping[str, float] | None = None,
        rotors: Mapping[int, float] | None = None,
    ) -> Self:
        """Set parameter values of active effects and of [inertial], and rotor inertias.

        effects    (effect, joint) -> parameter -> value in SI
        inertial   base inertial parameter -> value in SI
        rotors     joint -> kg m² (kg) at its output
        """
        changes: list[tuple[tuple[str, ...], int | None, dict[str, float]]] = []
        for (effect, joint), values in effects.items():
            owner, active = self._home(effect, joint)
            if effect not in active:
                self._place.fail(f'effect "{effect}" is not in the file; add it first')
            path = ("effects", effect) if owner[0] == "arm" else (owner[0], "effects", effect)
            changes.append((path, owner[1], {k: _rounded(v) for k, v in values.items()}))
        changes += [(("joint",), joint, {ROTOR: _rounded(value)}) for joint, value in (rotors or {}).items()]
        if inertial:
            place = self._place.inside("inertial")
            changes.append(
                (("inertial",), None, {identifier(place, "key", k): _rounded(v) for k, v in inertial.items()})
            )

        def change(document: Any, table_of: TableOf = _plain) -> None:
            for path, joint, values in changes:
                table = document
                for key in path:
                    table = table.setdefault(key, table_of({}, ABOUT_INERTIAL if key == "inertial" else ""))
                    if key == "joint" and joint:
                        table = table[joint - 1]
                table.update({key: value for key, value in values.items() if table.get(key) != value})
                for key in values if table_of is not _plain else ():
                    _no_longer_proposed(table[key])

        return self._edited(change, apart=True)

    def propose(self, values: Sequence[ProposedValue]) -> Self:
        """Set values with a comment beside each that says that it was proposed, and why."""

        def change(document: Any, table_of: TableOf = _plain) -> None:
            for one in values:
                table = document if one.joint is None else document["joint"][one.joint - 1]
                for key in one.table:
                    table = table.setdefault(key, table_of({}))
                table[one.key] = one.value
                if table_of is _table and not isinstance(table, InlineTable):
                    unit = self.unit(one)
                    table[one.key].comment(f"{unit}{'; ' if unit else ''}{PROPOSED}: {one.why}")

        return self._edited(change, apart=True)

    def unit(self, proposed: ProposedValue) -> str:
        """The unit of a proposed value, as its key or its effect declares it."""
        kind = "revolute" if proposed.joint is None else self.arm.joints[proposed.joint - 1].type
        *_, around, table = ("", "", *proposed.table)
        if around == "effects":
            named = {p.name: p for p in declared(table, self.effects).parameters}
            return named[proposed.key].unit.text(kind)
        monitor = MONITOR if proposed.joint is None else JOINT_MONITOR
        tables = {"controller": (*GAINS, *CONTROLLER), "encoder": ENCODER, "limits": LIMITS, "monitor": monitor}
        fields = {**tables, "": JOINT}[table]
        return next(field for field in fields if field.key == proposed.key).unit_of(kind)

    def set_torque_constants(self, values: Mapping[int, float]) -> Self:
        """Set torque constants: joint -> N m/A (N/A) at its output."""

        def change(document: Any, _: TableOf = _plain) -> None:
            for joint, value in values.items():
                document["joint"][joint - 1]["torque_constant"] = _rounded(value)

        return self._edited(change)

    def set_drive_gains(self, values: Mapping[int, Mapping[str, float]]) -> Self:
        """Set gains of the laws of drives: joint -> key -> value in SI."""

        def change(document: Any, _: TableOf = _plain) -> None:
            for joint, gains in values.items():
                document["joint"][joint - 1]["drive"].update({key: _rounded(value) for key, value in gains.items()})

        return self._edited(change)

    @property
    def _place(self) -> Place:
        return Place(printable(str(self.path)))

    def _home(self, effect: str, joint: int | None) -> tuple[Owner, Mapping[str, Any]]:
        """Where an effect belongs, and the effects that are active there."""
        place, arm = self._place, self.arm
        known = numbered(effect, self.effects)[0] in self.effects
        scope = declared(effect, self.effects).scope if known else "joint"
        if scope in ("joint", "joints"):
            n = len(arm.joints)
            if joint is None:
                if not known:
                    check_effect(place, effect, "joint", self.effects)
                place.fail(f'effect "{effect}" acts on a joint; say which with --joint 1{f" to {n}" if n > 1 else ""}')
            if not 1 <= joint <= n:
                place.fail(f"there is no joint {joint}; the arm has {n}, counted from 1")
            check_effect(place.inside(f"joint {joint}"), effect, "joint", self.effects, last=joint == n)
            return ("joint", joint), arm.joints[joint - 1].effects
        if joint is not None:
            place.fail(
                f'effect "{effect}" acts on {"the whole arm" if scope == "arm" else "the contact"}; drop --joint'
            )
        if scope == "arm":
            return (scope, None), arm.effects
        if arm.contact is None:
            how = "which belongs to planar arms; this one is in space"
            how = how if arm.space else "and the file has none; add [contact] with x first"
            place.fail(f'effect "{effect}" acts at a contact, {how}')
        return (scope, None), arm.contact.effects

    def _edited(self, change: Callable[..., None], apart: bool = False) -> Self:
        """The text after `change`, which must state exactly what the same change makes of plain tables.

        apart   a blank line goes above a new table
        """
        bare = self.text.removeprefix("\ufeff")
        expected = tomllib.loads(bare)
        change(expected)
        if expected == tomllib.loads(bare):
            return self
        for table_of in (_table, _inline):  # tables with headers, else inline ones among dotted keys
            try:
                document = tomlkit.parse(bare if bare.endswith("\n") else f"{bare}\n")
                above, inline = _detached(document), [(table, set(table)) for table in _inline_tables(document)]
                change(document, table_of)
                for table, known in inline:
                    _space(table, known)
                _reattach(document, above, apart)
                result = tomlkit.dumps(document)
                same = tomllib.loads(result) == expected
            except (TOMLKitError, ValueError, LookupError, TypeError, AttributeError):
                continue
            if same:
                if "\r\n" in bare and not re.search(r"(?<!\r)\n", bare):
                    result = re.sub(r"(?<!\r)\n", "\r\n", result)
                parse(result, str(self.path), self.effects)
                return replace(self, text=self.text[: len(self.text) - len(bare)] + result)
        # Where the values themselves are at fault, parse says so.
        parse(tomlkit.dumps(expected), str(self.path), self.effects)
        raise ModelError(
            f"{self._place.file}: this layout cannot be edited; write it with [tables] instead of inline ones"
        )


def _home_of(document: Any, owner: Owner) -> Any:
    """The table that contains the owner's `effects`."""
    scope, joint = owner
    table = document if scope == "arm" else document[scope]
    return table if joint is None else table[joint - 1]


def _no_longer_proposed(item: Any) -> None:
    """Takes the part of the comment beside a value away that says why it was proposed; its unit stays."""
    trivia = item.trivia
    kept, proposed, _ = trivia.comment.partition(f"{PROPOSED}:")
    if proposed:
        trivia.comment = kept.rstrip("; ")
        if trivia.comment == "#":
            trivia.comment = trivia.comment_ws = ""


def _rounded(value: float) -> float:
    return 0.0 if abs(value) < SMALLEST else float(f"{float(value):.{DIGITS}g}")


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


def _inline_tables(value: Any) -> Iterator[InlineTable]:
    """All inline tables within a value of tomlkit."""
    if isinstance(value, InlineTable):
        yield value
    below = value.values() if isinstance(value, Mapping) else value if isinstance(value, list) else ()
    for each in below:
        yield from _inline_tables(each)


def _space(table: InlineTable, known: Set[str]) -> None:
    """A blank before each key of an inline table that was not known before, and at the end if there is one at the
    start; tomlkit leaves them out."""
    body = table.value.body
    for place, (key, item) in enumerate(body):
        if key is not None and key.key not in known:
            follows = place > 0 and not isinstance(body[place - 1][1], Whitespace)
            item.trivia.indent = " " if follows else ""
            if place == len(body) - 1 and isinstance(body[0][1], Whitespace):
                item.trivia.trail = " "


Trivia = list[tuple[Any, Any]]
"""Blank lines and comments, as they stand in the body of a container of tomlkit."""


def _tables(container: Any) -> Iterator[Any]:
    yield container
    for _, item in _body(container):
        for table in item.body if isinstance(item, AoT) else [item] if isinstance(item, Table) else []:
            yield from _tables(table)


def _with_header(tables: Iterable[Any]) -> list[Any]:
    return [table for table in tables if not (isinstance(table, Table) and table.is_super_table())]


def _body(container: Any) -> Any:
    return container.value.body if isinstance(container, Table) else container.body


def _content_end(body: Any) -> int:
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
