"""Where a result came from, and the commands that follow from it, to be copied as they stand."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from runtime.model.terms import Term

GUESS = Path("guess.py")
"""Where a draft of an unknown effect is proposed to go."""


@dataclass(frozen=True)
class Invocation:
    """The files and options of a command line, as they were typed.

    maps       `--map` entries
    improved   where the improved model was written, if it was
    about      what the model file says of itself
    like       the arm of Tendon that was named in place of a model file; `model` is then where a copy of it goes
    """

    model: Path
    recordings: tuple[Path, ...]
    held_out: tuple[Path, ...] = ()
    effects: Path | None = None
    maps: tuple[str, ...] = ()
    allow_gaps: bool = False
    improved: Path | None = None
    about: str = ""
    like: str | None = None

    def copy(self) -> str:
        """Makes the arm that was named a model file of the user's."""
        return shlex.join(["tendon", "init", "--like", str(self.like), "--out", _path(self.model)])

    def add(self, term: Term) -> str:
        """Puts an effect into the model file."""
        at = [] if term.joint is None else ["--joint", str(term.joint)]
        return self._line("add", [_path(self.model), term.effect, *at])

    def identify(self) -> str:
        """Fits the model file again and writes the values into it."""
        return self._line("identify", [_path(self.model), *self._data(), "--write"])

    def experiment(self, terms: Sequence[Term]) -> str:
        """Designs the motion that tells effects apart."""
        between = ",".join(map(str, terms))
        return self._line("experiment", [self._latest, "--between", between])

    def draft(self) -> str:
        """Drafts an effect for what nothing in the library explains."""
        return self._line("diagnose", [self._latest, *self._data(), "--draft", str(GUESS)])

    def try_draft(self) -> str:
        """Adds the draft, if it helps."""
        return shlex.join(["tendon", "improve", self._latest, *self._data(), "--effects", str(GUESS)])

    @property
    def _latest(self) -> str:
        return _path(self.improved) if self.improved else self.like or _path(self.model)

    def _data(self) -> list[str]:
        return [*map(_path, self.recordings), *reading(self.maps, self.allow_gaps)]

    def _line(self, verb: str, arguments: Sequence[str]) -> str:
        own = [] if self.effects is None else ["--effects", _path(self.effects)]
        return shlex.join(["tendon", verb, *arguments, *own])


def reading(maps: Sequence[str], allow_gaps: bool) -> list[str]:
    """The options by which recordings were read, as one would type them."""
    entries = [part for entry in maps for part in ("--map" if "=" in entry else "--columns", entry)]
    return [*entries, *(["--allow-gaps"] if allow_gaps else [])]


def about(text: str) -> str:
    """The first paragraph of the comment at the head of a model file, where its sources stand."""
    words: list[str] = []
    for line in text.splitlines():
        found = line.lstrip("#").split() if line.startswith("#") else []
        if not found:
            break
        words += found
    return " ".join(words)


def unknown(model: str) -> Invocation:
    """For a result whose files nobody named: the model's name and a word to replace."""
    return Invocation(Path(f"{model}.toml"), (Path("RECORDING"),))


def _path(path: Path) -> str:
    # What begins with a dash would be read as an option.
    text = str(path)
    return f"./{text}" if text.startswith("-") else text
