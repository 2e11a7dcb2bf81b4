"""How the generated C for controllers stands to MISRA C:2012: what is checked, and the deviations with their reasons.

The rules' texts are under copyright: numbers stand for them, and the reasons are in our own words. A test runs the
add-on, and fails for a rule that is broken and not listed here, and for one that is listed and not broken any more.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Literal

CHECKER = "2.22"
"""Version of cppcheck whose add-on checks the rules of CHECKED."""
CHECKED = (
    "1: 2 4; 2: 2 3 4 5 7; 3: 1; 4: 1 2; 5: 1 2 4 5 6 7 8 9; 6: 1 2; 7: 1 2 3 4; 8: 1 2 4 5 6 7 8 9 "
    "10 11 12 14; 9: 2 3 4 5; 10: 1 2 3 4 5 6 7 8; 11: 1 2 3 4 5 6 7 8 9; 12: 1 2 3 4; 13: 1 3 4 5 6; "
    "14: 1 2 4; 15: 1 2 3 4 5 6 7; 16: 1 2 3 4 5 6 7; 17: 1 2 3 6 7 8; 18: 4 5 7 8; 19: 2; 20: 1 2 3 "
    "4 5 7 8 9 10 11 12 13 14; 21: 1 2 3 4 5 6 7 8 9 10 11 12 14 15 16 19 20 21; 22: 5 7 8 9 10 "
)
"""Rules for which the add-on has a check: chapter, then numbers."""


@dataclass(frozen=True)
class Deviation:
    """A rule that files break. files: as in a firmware's tree, without src/; {name}: of the arm

    kind   "false report": the add-on is wrong, the rule is kept
    """

    rule: str
    kind: Literal["advisory", "required", "false report"]
    reason: str
    files: tuple[str, ...]


_BOARD = ("boards/mps2/board.c", "boards/mps2/startup.c")
_EQUATIONS = ("{name}_f32.c", "{name}_controller_f32.c", "{name}_effects_f32.c")
DEVIATIONS = (
    Deviation("11.4", "advisory", "Registers have fixed addresses, which only a cast turns into pointers.", _BOARD),
    Deviation("17.3", "false report", "The add-on takes the extension __asm for an undeclared function.", _BOARD),
    Deviation("21.2", "required", "Compilers call memcpy and its kin by these names.", ("boards/mps2/memory.c",)),
    Deviation("11.5", "advisory", "The same functions have these types.", ("boards/mps2/memory.c",)),
    Deviation(
        "19.2",
        "advisory",
        "Unions give access to the bits of a float, for messages and in mathematics, within C99's aliasing rules.",
        ("boards/mps2/board.c", "tendon_frame.h", "tendon_math_f32.h", "tendon_machine_private.h"),
    ),
    Deviation(
        "17.3",
        "false report",
        "__builtin_sqrtf is one instruction; the add-on does not know built-in functions.",
        ("tendon_math_f32.h",),
    ),
    Deviation(
        "12.1",
        "advisory",
        "Parentheses around every product in a sum would make equations harder to read.",
        ("tendon_math_f32.h", *_EQUATIONS),
    ),
    Deviation(
        "8.7",
        "advisory",
        "Functions for other programs, such as a simulation or your controller, are not all called here.",
        (*_EQUATIONS, "{name}_monitor_f32.c", "{name}_statistics_f32.c", "tendon_states.c", "boards/mps2/memory.c"),
    ),
    Deviation(
        "2.5",
        "advisory",
        "Macros for other programs are not all used here.",
        ("tendon_arm.h", "tendon_board.h", "{name}_controller_f32.h", "{name}_monitor_f32.h", "tendon_math_f32.h"),
    ),
)


def checked() -> list[str]:
    """The rules of CHECKED by their full numbers."""
    chapters = (part.split(":") for part in CHECKED.split(";"))
    return [f"{chapter.strip()}.{number}" for chapter, numbers in chapters for number in numbers.split()]


def rows(name: str, made: Collection[str]) -> list[tuple[str, str, str, str]]:
    """Rule, kind, files and reason of every deviation of an arm's code and firmware. made: the files of its folder."""

    def files(deviation: Deviation) -> str:
        here = [(f, f.format(name=name)) for f in deviation.files]
        return ", ".join(f"`{path}`" for f, path in here if f == path or path in made)

    return [(d.rule, d.kind, files(d), d.reason) for d in DEVIATIONS]


def suppressions(name: str, files: Iterable[str]) -> list[str]:
    """Lines of cppcheck's list for files of an arm's folder or of its firmware's tree, with the reasons."""
    by_end = {path.removeprefix("src/"): path for path in files}
    lines: list[str] = []
    for deviation in DEVIATIONS:
        here = [by_end[end] for f in deviation.files if (end := f.format(name=name)) in by_end]
        if here:
            lines += ["", f"# {deviation.kind.capitalize()}. {deviation.reason}"]
            lines += [f"misra-c2012-{deviation.rule}:{path}" for path in here]
    return lines[1:]
