"""Guides as they are typed: what stands in their blocks, and whether what is printed is what they say.

Blocks follow each other in one folder, which is empty at first:

    ```sh       commands, typed in their order; a comment behind one says so if it ends with "exit status 1" or 2
    ```text     right after commands: what the last of them prints; a line with … alone stands for any that are left out
    ```python   a script, run where it stands; the text after it is what it prints
    ```toml, ```c, ```cpp, ```python   whose first line is a comment with the name of a file: that file

A number may differ by 5 %, or by half a unit of its last digit: a slightly better figure does not change a guide. One
that begins with ~ depends on the machine and is not compared. Tables are compared by the words in their cells.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NAMED = re.compile(r"(?:#|//|/\*) ([\w.-]+\.(?:toml|py|c|cpp|csv))(?: \*/)?(?:$|[:,;] )")
_NUMBER = re.compile(r"~?[-−+]?\d[\d,]*(?:\.\d+)?(?:[eE][-+]?\d+)?")

_TOLERANCE = 0.05


@dataclass(frozen=True)
class Command:
    """What is typed, and the status with which it ends."""

    line: str
    status: int


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, the line of the guide on which the text begins."""

    language: str
    text: str
    line: int

    @property
    def file(self) -> str | None:
        """The file that it is, where its first line names one."""
        named = _NAMED.match(self.text.partition("\n")[0]) if self.language in ("toml", "c", "cpp", "python") else None
        return named[1] if named else None

    @property
    def commands(self) -> list[Command]:
        """Its commands, where it is one of commands; a line that ends in a backslash goes on."""
        if self.language != "sh":
            return []
        lines = re.sub(r"\\\n\s*", "", self.text).splitlines()
        typed = [re.split(r"(?:^|\s+)#", line, maxsplit=1) for line in lines]
        said = [(line.strip(), re.findall(r"exit status (\d)", "".join(about))) for line, *about in typed]
        return [Command(line, int("".join(status) or 0)) for line, status in said if line]


def blocks(guide: Path) -> Iterator[Block]:
    """All fenced blocks of a guide, in their order."""
    text = guide.read_text(encoding="utf-8")
    for match in _FENCE.finditer(text):
        yield Block(match[1], match[2], text.count("\n", 0, match.start(2)) + 1)


def differs(said: str, printed: str) -> str | None:
    """The first line of `said` that was not printed in its place, or None."""
    lines = [_words(line) for line in printed.splitlines()]
    lines = [words for words in lines if words]
    at, anywhere = 0, False
    for raw in said.splitlines():
        if not (words := _words(raw)):
            continue
        if raw.strip() == "…":
            anywhere = True
            continue
        places = range(at, len(lines)) if anywhere else range(at, min(at + 1, len(lines)))
        found = next((k for k in places if _same(words, lines[k])), None)
        if found is None:
            return raw
        at, anywhere = found + 1, False
    return None if anywhere or at == len(lines) else f"nothing follows, but it printed: {' '.join(lines[at])}"


def _words(line: str) -> list[str]:
    """The words of a line, rules of tables left out."""
    return [word for word in line.split() if set(word) != {"─"}]


def _same(said: list[str], printed: list[str]) -> bool:
    return len(said) == len(printed) and all(_same_word(a, b) for a, b in zip(said, printed, strict=True))


def _same_word(said: str, printed: str) -> bool:
    """Equal text around numbers that agree."""
    if said == printed:
        return True
    if _NUMBER.sub("0", said) != _NUMBER.sub("0", printed):
        return False
    return all(_same_number(a, b) for a, b in zip(_NUMBER.findall(said), _NUMBER.findall(printed), strict=True))


def _same_number(said: str, printed: str) -> bool:
    if said.startswith("~"):
        return True
    digits = said.replace(",", "").replace("−", "-")
    mantissa, _, exponent = digits.lower().partition("e")
    last = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    value, other = float(digits), float(printed.replace(",", "").replace("−", "-"))
    return abs(value - other) <= max(0.501 * last, _TOLERANCE * abs(value))


def demo_errors() -> list[str]:
    """What README.md says of the demo's errors, %: fitted and held out before the effect is added, and after."""
    text = next(block.text for block in blocks(ROOT / "README.md") if block.language == "text")
    return re.findall(r"([\d.]+) %", text)[:4]
