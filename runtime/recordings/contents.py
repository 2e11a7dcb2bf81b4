"""An opened recording: its fields and their clocks, samples with their place in the file, and how a file is refused."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import NoReturn, Protocol

import numpy as np
from numpy.typing import NDArray

from symbolic.model_file.checks import quote


class RecordingError(ValueError):
    """A recording that cannot be used; the message is one line with the file and, where it applies, the place."""


def printable(text: object) -> str:
    """Text for a message: one line, nothing that a terminal would act on."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in os.fsdecode(str(text)))


@dataclass(frozen=True)
class Refusal:
    """Refuses a file. shown: its name as people read it."""

    shown: str

    def __call__(self, message: str, place: str = "") -> NoReturn:
        """Raises RecordingError. place: where in the file, such as "line 812"."""
        at = f" {printable(place)}" if place else ""
        raise RecordingError(f"{self.shown}{at}: {printable(message)}")

    @contextmanager
    def on(self, errors: tuple[type[Exception], ...], what: str, cure: str) -> Iterator[None]:
        """Refuses the file where reading it fails in one of these ways. what: what is wrong then; cure: what to do."""
        try:
            yield
        except RecordingError:
            raise
        except errors as error:
            reason = str(error).partition("\n")[0][:200] or type(error).__name__
            self(f"{what} ({reason}); {cure}")


def require(package: str, extra: str, what: str, refuse: Refusal) -> None:
    """Refuses a file for which a package lacks, and says how to get it. what: the format or the part of it."""
    if find_spec(package) is None:
        refuse(
            f"{what} needs {package}, the extra `{extra}` (pip install -e '.[{extra}]'); "
            f"run: {sys.executable} -m pip install {package}"
        )


Array = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class RecordedField:
    """A column of a file, before it is read.

    name     as the file has it, with `[unit]` where the file states one
    clock    what is sampled together has one: a topic, a group, a struct; "" where the file has but one
    place    what stands before the number of a sample in a message: "line", "/joint_states message", "rec.q column"
    signal   what the format itself says that it is, without a joint: "t", "q", "qd", "tau"; None: it does not say
    joint    the joint's name, where the format has names for joints
    """

    name: str
    clock: str = ""
    place: str = "line"
    signal: str | None = None
    joint: str | None = None


@dataclass(frozen=True)
class Samples:
    """Signals of one clock.

    signals   name -> (N,)
    numbers   (N,) of the samples in the file, as its tools count them
    places    of each signal, what stands before that number
    """

    signals: dict[str, Array]
    numbers: Numbers
    places: Mapping[str, str]

    def at(self, name: str, sample: int) -> str:
        """Where in the file a signal's sample stands."""
        return f"{self.places[name]} {self.numbers[sample]}"

    def kept(self, samples: NDArray[np.bool_]) -> Samples:
        """Those samples (N,) alone."""
        signals = {name: values[samples] for name, values in self.signals.items()}
        return replace(self, signals=signals, numbers=self.numbers[samples])


class Contents(Protocol):
    """A file that was opened and is understood, as the module of its format has it.

    format   its name, for people
    header   where the names of the fields stand, for messages; "" where that is no place
    fields   in the file's order
    times    of a clock, the index of the field with its time; a clock without one is not among them
    """

    @property
    def format(self) -> str:
        """Of the file, as people call it."""

    @property
    def header(self) -> str:
        """The first line of a text, "" of other formats."""

    @property
    def fields(self) -> Sequence[RecordedField]:
        """All that can be read."""

    @property
    def times(self) -> Mapping[str, int]:
        """Of every clock, the number of the field that is its time."""

    def load(self, wanted: Mapping[str, int]) -> Samples:
        """The fields of one clock by signal, as the file has them. wanted: signal -> index. Raises RecordingError."""
        ...


def some(names: Sequence[str], most: int = 8) -> str:
    """Some of these names, for a message."""
    quoted = [quote(name.strip()) for name in names[:most]]
    return ", ".join(quoted) + (f" and {len(names) - most} more" if len(names) > most else "")


def map_option(signal: str, cell: str) -> str:
    """A signal from that field."""
    return f'--map {signal}="{cell}"'


def negated(cell: str) -> str:
    """With the other sign."""
    return cell.removeprefix("-") if cell.startswith("-") else f"-{cell}"


def in_unit(cell: str, unit: str) -> str:
    """In another unit than it was read in."""
    return f"{without_unit(cell)} [{unit}]"


def without_unit(cell: str) -> str:
    """A field without its unit."""
    return cell.split(" [")[0]
