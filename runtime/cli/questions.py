"""Questions asked on a terminal, or answered line by line by whatever else standard input is.

An empty line takes what stands in brackets, and so does the end of the input. On a terminal an answer that is none is
asked for again; elsewhere it is an error.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TextIO, TypeVar

from runtime.workspace import UsageError

T = TypeVar("T")
UNKNOWN = "?"


@dataclass(frozen=True)
class Questions:
    """answers: where they come from; None: nothing is asked, and everything is as by an empty line."""

    answers: TextIO | None

    def ask(
        self, question: str, read: Callable[[str], T], shown: str, default: Any = None, needed: str | None = None
    ) -> T | None:
        """The answer to one question.

        read     of an answer that is not empty; raises ValueError that says what was expected
        shown    what stands in brackets; default: what it means
        needed   there is no default, and this option says it in place of an answer
        Raises UsageError.
        """
        typed = self.answers is not None and self.answers.isatty()
        while True:
            if typed:
                print(f"{question} [{shown}]: " if shown else f"{question}: ", end="", file=sys.stderr, flush=True)
            line = "" if self.answers is None else self.answers.readline()
            answer = line.strip()
            if not answer and needed is None:
                return default
            try:
                if not answer:
                    raise ValueError("an answer is needed" + ("" if typed else f", or {needed}"))
                return read(answer)
            except ValueError as error:
                problem = f"{question}: {answer or 'nothing'}: {error}"
                if not typed or not line:
                    raise UsageError(problem) from error
                print(problem, file=sys.stderr)


def number(text: str) -> float | None:
    """A finite number; None for ?."""
    if text == UNKNOWN:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError("expected a number, or ? where it is not known")
    return value


def numbers(*counts: int) -> Callable[[str], tuple[float, ...]]:
    """Reads so many numbers, with commas or blanks between them; none for ?."""

    def read(text: str) -> tuple[float, ...]:
        if text == UNKNOWN:
            return ()
        values = [number(part) for part in re.split(r"[,\s]+", text.strip("[]() ")) if part]
        known = tuple(value for value in values if value is not None)
        if len(known) != len(values) or len(values) not in counts:
            raise ValueError(f"expected {' or '.join(map(str, counts))} numbers with commas between, or ?")
        return known

    return read


def choice(**words: T) -> Callable[[str], T]:
    """Reads one of some words, or their first letters."""

    def read(text: str) -> T:
        met = [value for word, value in words.items() if word.startswith(text.lower())]
        if len(met) != 1:
            raise ValueError(f"expected {' or '.join(words)}")
        return met[0]

    return read


def of_option(option: str, given: str, read: Callable[[str], T]) -> T:
    """What an option says, read as an answer. Raises UsageError."""
    try:
        return read(given)
    except ValueError as error:
        raise UsageError(f"{option} {given}: {error}") from error


def for_each(option: str, given: str | None, count: int) -> Sequence[float | None] | None:
    """What an option says of every joint: one number for all, or one each; ? where it is not known. None: not given."""
    if given is None:
        return None
    values = of_option(option, given, lambda text: [number(part.strip()) for part in text.split(",")])
    if len(values) not in (1, count):
        raise UsageError(f"{option} {given}: {len(values)} numbers; expected one for all joints, or {count}, one each")
    return values * count if len(values) == 1 else values
