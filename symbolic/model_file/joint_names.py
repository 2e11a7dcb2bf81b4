"""Joints as people write them, by number or by the name that the model file gives, alone or behind an effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

Names = Sequence[str | None]
"""Of an arm's joints from the base outwards; None: the file gives none."""


@dataclass(frozen=True)
class SaidTerm:
    """`EFFECT@JOINT[:REST]` in its parts, as they were written; joint: None without an @."""

    effect: str
    joint: str | None
    rest: str


def said_term(text: str, names: Names) -> SaidTerm:
    """The parts of a term. A name may have colons of its own: the longest that is a joint's is taken."""
    head, colon, behind = text.partition(":")
    if "@" not in head:
        return SaidTerm(head, None, behind)
    effect, _, place = text.partition("@")
    number = head.partition("@")[2]
    if not _is_number(number):
        for name in sorted(filter(None, names), key=len, reverse=True):
            if place == name or place.startswith(f"{name}:"):
                return SaidTerm(effect, name, place[len(name) + 1 :])
    return SaidTerm(effect, number, behind if colon else "")


def joint_number(said: str, names: Names) -> int | None:
    """The joint that is meant, from 1; None where it is none of these. What looks like a number is one, whatever the
    joints are called."""
    if _is_number(said):
        return int(said) if len(said) < _DIGITS and 1 <= int(said) <= len(names) else None
    return names.index(said) + 1 if said in names else None


def expected(names: Names) -> str:
    """What `joint_number` takes, for a message."""
    called = ", ".join(name for name in names if name and not _is_number(name))
    return f"1 to {len(names)}" + (f" or a name: {called}" if called else "")


def _is_number(said: str) -> bool:
    return said.isascii() and said.isdigit()


_DIGITS = 10
"""Of a number that no joint has; Python refuses to read thousands of them."""
