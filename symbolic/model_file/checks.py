"""What users write: files read, values and names checked; each failure is one line that says where and what.

Names end up in C and in file names: they are checked against the languages' rules here, and never evaluated.
"""

from __future__ import annotations

import difflib
import json
import keyword
import math
import os
import re
import select
import stat
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final, NoReturn

MAX_NAME, MAX_LABEL = 40, 60
# The controller's floats range from 1e-38 to 1e38, and products of a few parameters must not leave that range.
LARGEST, SMALLEST = 1e12, 1e-15

_RESERVED = """
auto break case char const continue default do double else enum extern float for goto if inline int long
register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
alignas alignof and and_eq asm bitand bitor bool catch char8_t char16_t char32_t class co_await co_return
co_yield compl concept consteval constexpr constinit const_cast decltype delete dynamic_cast explicit export
false friend mutable namespace new noexcept not not_eq nullptr operator or or_eq private protected public
reinterpret_cast requires static_assert static_cast template this thread_local throw true try typeid typename
typeof typeof_unqual using virtual wchar_t xor xor_eq main NULL errno
"""
_WORDS = frozenset(_RESERVED.split())
_SIGNS = "°µ·²³"
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*", re.ASCII)
LABEL = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_ .:/()-]*", re.ASCII)


class ModelError(ValueError):
    """An unusable model file; the message is one line for the file's author."""


@dataclass(frozen=True)
class Place:
    """A location in a file, for messages."""

    file: str
    path: str = ""

    def inside(self, name: str) -> Place:
        """The location of a table or key within this one."""
        return Place(self.file, f"{self.path}: {name}" if self.path else name)

    def fail(self, message: str) -> NoReturn:
        """Raise ModelError with file, location and message in one line."""
        raise ModelError(f"{self.file}: {self.path}: {message}" if self.path else f"{self.file}: {message}")


def printable(text: str) -> str:
    """`text` with unprintable characters escaped, so that it stays on one line and cannot control the terminal."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def quote(value: str) -> str:
    """A user's text in quotes and ASCII, so that look-alike letters are visible; signs of units are kept."""
    shown = value if len(value) <= 60 else value[:57] + "..."
    return "".join(c if c in _SIGNS else json.dumps(c)[1:-1] for c in shown).join('""')


def at_joint(joint: int | None) -> str:
    """ " at joint N", to follow an effect's name; empty for effects of the arm or the contact."""
    return "" if joint is None else f" at joint {joint}"


def found(value: Any) -> str:
    """A value from a file, described in a few words."""
    if isinstance(value, bool):
        return f"the boolean {str(value).lower()}"
    if isinstance(value, (int, float)):
        return f"{value:.6g}" if abs(value) < 1e300 or isinstance(value, float) else "a huge integer"
    if isinstance(value, str):
        return f"the text {quote(value)}"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return f"the date {printable(str(value))}"


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name closest to a mistyped one, or None."""
    close = difflib.get_close_matches(name[:100], list(known), n=1, cutoff=0.6)
    return close[0] if close else None


def check_stated(
    name: str,
    open_lumps: Sequence[str],
    unknown_keys: Sequence[Sequence[str]],
    otherwise: str = "let tendon init --controller MODEL propose rotors",
) -> None:
    """Raise ModelError where base inertial parameters are unknown because the model file omits numbers.

    open_lumps   names of the unknown base parameters     unknown_keys   omitted keys, by joint
    otherwise    what else the user may do
    """
    if not open_lumps:
        return
    left_out = _by_joints(dict(enumerate(unknown_keys, 1)))
    raise ModelError(
        f"{name}: this needs numbers that the model file leaves out ({left_out}); base parameters that depend on them: "
        f"{', '.join(open_lumps)}; state them, identify them (tendon identify MODEL RECORDING --write), or {otherwise}"
    )


def open_lines(numbers: Iterable[tuple[int | None, str, float | None]]) -> list[str]:
    """What a model file leaves open (OpenNumber), a line each for what is taken as 0 and for what has no value."""
    groups: dict[str, dict[int, list[str]]] = {"taken as 0": {}, "without a value": {}}
    for joint, parameter, value in numbers:
        groups["without a value" if value is None else "taken as 0"].setdefault(joint or 0, []).append(parameter)
    return [f"left open, {text}: {_by_joints(keys)}" for text, keys in groups.items() if keys]


def _by_joints(keys: Mapping[int, Sequence[str]]) -> str:
    """Keys by joint, those of several joints together; 0: of none."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for joint, own in keys.items():
        alike.setdefault(tuple(own), []).append(str(joint))
    at = {own: f"joint{'s' if len(of) > 1 else ''} {', '.join(of)}" for own, of in alike.items() if own}
    return "; ".join(f"{place.replace('joint 0', 'arm')}: {', '.join(own)}" for own, place in at.items())


def unknown(place: Place, what: str, key: str, known: tuple[str, ...]) -> NoReturn:
    """Raise ModelError for a key (or whatever `what` says) that is not one of the known ones."""
    place.fail(f"unknown {what} {quote(key)}; {did_you_mean(key, known) if known else 'no keys are allowed here'}")


def did_you_mean(key: str, known: tuple[str, ...]) -> str:
    """A clause that suggests the known name closest to a mistyped one."""
    if not known:
        return "there are none"
    close = nearest(key, known)
    if close:
        return f'did you mean "{close}"?'
    closest = max(known, key=lambda k: difflib.SequenceMatcher(None, key[:100], k).ratio())
    return f'the closest known one is "{closest}" (known: {", ".join(known)})'


def table_at(place: Place, value: Any, example: str) -> dict[str, Any]:
    """The value, if it is a table. Raises ModelError otherwise. example: the expected table, for the message."""
    if not isinstance(value, dict):
        place.fail(f"found {found(value)}; expected a table {example}")
    return value


def real(
    place: Place,
    key: str,
    value: Any,
    unit: str,
    low: float = -math.inf,
    high: float = math.inf,
    positive: bool = False,
) -> float:
    """A finite number within [low, high] (above 0 if `positive`)."""
    expected = f"a number{f' in {unit}' if unit not in ('', '1') else ''}"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        place.fail(f"{key} is {found(value)}; expected {expected}")
    try:
        x = float(value)
    except OverflowError:
        x = math.inf
    if not math.isfinite(x):
        place.fail(f"{key} is {found(value)}; expected {expected} that is finite")
    if positive and x <= 0:
        place.fail(f"{key} is {x:.6g}; expected {expected} > 0")
    if x < low:
        place.fail(f"{key} is {x:.6g}; expected {expected} >= {low:g}")
    if x > high:
        place.fail(f"{key} is {x:.6g}; expected {expected} <= {high:g}")
    return x


def number(
    place: Place,
    key: str,
    value: Any,
    unit: str,
    low: float = -math.inf,
    high: float = math.inf,
    positive: bool = False,
) -> float:
    """As `real`, within the magnitudes that the controller's floats can represent."""
    x = real(place, key, value, unit=unit, low=low, high=high, positive=positive)
    if abs(x) > LARGEST or 0 < abs(x) < SMALLEST:
        place.fail(f"{key} is {x:.6g}; expected 0 or a magnitude between {SMALLEST:g} and {LARGEST:g}")
    return x


def identifier(place: Place, what: str, value: Any) -> str:
    """A name that is valid in C, C++, Python and file names."""
    if not isinstance(value, str):
        place.fail(f"{what} is {found(value)}; expected a C identifier")
    if not _NAME.fullmatch(value):
        place.fail(f"{what} {quote(value)} is no C identifier; use letters a-z, digits and _, not a digit first")
    if len(value) > MAX_NAME:
        place.fail(f"{what} {quote(value)} has {len(value)} letters; expected at most {MAX_NAME}")
    if value in _WORDS or keyword.iskeyword(value):
        place.fail(f"{what} {quote(value)} is a word of C, C++ or Python; choose another name")
    if value.startswith("__") or re.match(r"_[A-Z]", value):
        place.fail(f"{what} {quote(value)} is reserved for C compilers; do not begin with __ or _ and a capital")
    return value


_OF_HEADERS = ("std", "Span", "Input", "Output", "RowByRow", "as_matrix")
"""Names in the namespace `tendon` of generated C++ headers, which has a namespace for each arm."""


def is_taken(name: str) -> bool:
    """Whether an arm's name collides with the toolkit's own generated files."""
    return name.lower() in ("effects", "tendon") or name.lower().startswith("tendon_") or name in _OF_HEADERS


Names = Sequence[str | None]
"""Joint names from the base outwards; None where the file gives none."""


def effect_term(text: str, names: Names) -> tuple[str, str | None, str]:
    """The parts of `EFFECT@JOINT[:REST]` as written; joint: None without an @. Joint names may contain colons: the
    longest matching name is taken."""
    head, colon, behind = text.partition(":")
    if "@" not in head:
        return head, None, behind
    effect, _, place = text.partition("@")
    number = head.partition("@")[2]
    if not _is_number(number):
        for name in sorted(filter(None, names), key=len, reverse=True):
            if place == name or place.startswith(f"{name}:"):
                return effect, name, place[len(name) + 1 :]
    return effect, number, behind if colon else ""


def joint_number(said: str, names: Names) -> int | None:
    """The joint's number, from 1, or None where there is no such joint. Digits mean a number, never a name."""
    if _is_number(said):
        return int(said) if len(said) < _MOST_DIGITS and 1 <= int(said) <= len(names) else None
    return names.index(said) + 1 if said in names else None


def known_joints(names: Names) -> str:
    """The joints that `joint_number` accepts, for a message."""
    called = ", ".join(name for name in names if name and not _is_number(name))
    return f"1 to {len(names)}" + (f" or a name: {called}" if called else "")


def _is_number(said: str) -> bool:
    return said.isascii() and said.isdigit()


_MOST_DIGITS = 10
"""Digits of a number that no joint has; Python refuses to convert thousands of digits."""


LONGEST_WAIT: Final = 10.0
"""s until a pipe or device must have delivered its first byte; a choice."""

MAX_BYTES: Final = 1_000_000
"""bytes of a model file or scenario; the largest that ship have 5000; a choice."""


def opened(path: Path | str) -> BinaryIO:
    """Open a file for reading; wait until a pipe or device has data, at most LONGEST_WAIT. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        kind = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(kind):
            raise IsADirectoryError(21, "is a directory", str(path))
        if not stat.S_ISREG(kind):
            waiting = select.poll()
            waiting.register(descriptor, select.POLLIN)
            if not waiting.poll(1e3 * LONGEST_WAIT):
                raise TimeoutError(110, f"delivered nothing within {LONGEST_WAIT:g} s; expected a file", str(path))
            os.set_blocking(descriptor, True)
        return open(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_bytes(path: Path | str, most: int, expected: str) -> bytes:
    """The whole file, at most `most` bytes. expected: what the file should be, for messages. Raises ModelError."""
    place = Place(printable(str(path)))
    try:
        with opened(path) as file:
            data = file.read(most + 1)
    except FileNotFoundError:
        place.fail(f"no such file; expected {expected}")
    except IsADirectoryError:
        place.fail(f"is a directory; expected {expected}")
    except (OSError, ValueError) as error:
        place.fail(f"cannot be read: {printable(getattr(error, 'strerror', None) or str(error))}")
    if len(data) > most:
        place.fail(f"is larger than {most // 1_000_000} MB; expected {expected}")
    return data


def read_text(path: Path | str, most: int, expected: str) -> str:
    """The file as UTF-8 text with its line ends unchanged. Raises ModelError."""
    data = read_bytes(path, most, expected)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        place = Place(f"{printable(str(path))} line {line}")
        place.fail(f"byte 0x{data[error.start]:02x} is not UTF-8; save the file as UTF-8")


def parse_toml(text: str, top: Place) -> dict[str, Any]:
    """The document of a TOML text; top: its file, for messages. Raises ModelError with the line."""
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError as error:
        match = re.match(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)$", str(error), re.DOTALL)
        what, line, column = match.groups() if match else (str(error), None, None)
        if "Cannot overwrite" in what or "declare" in what or "mutate" in what:
            what += " (the same key or table twice?)"
        where = f"line {line}" if line else f"line {text.count(chr(10)) + 1}"
        at = f" at column {column}" if column else ""
        raise ModelError(f"{top.file} {where}: not valid TOML{at}: {printable(what)}") from None
    except RecursionError:
        top.fail("not valid TOML: nested too deeply")
    except ValueError as error:  # an invalid date, a number of thousands of digits
        top.fail(f"not valid TOML: {printable(str(error)).split(';')[0][:120]}")
