"""What a command line names: arms and scenarios that come with Tendon, a model file, columns of recordings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from symbolic.model_file.checks import quote


class UsageError(ValueError):
    """A command line that contradicts itself."""


ARMS = Path(__file__).parent.parent.parent / "symbolic" / "arms"
SCENARIOS = Path(__file__).parent.parent / "study"
"""Folders of the model files and scenarios that come with Tendon."""


def is_name(path: Path) -> bool:
    """Whether an argument is the name of something that comes with Tendon: it has no folder and no ending, and no file
    here has this name."""
    return path.name == str(path) and not path.suffix and (path.is_dir() or not path.exists())


def arm_path(model: Path) -> Path:
    """The model file that an argument means: a file, or the name of an arm of Tendon. Raises UsageError."""
    return shipped_arm(model.name) if is_name(model) else model


def shipped_arm(name: str) -> Path:
    """The model file of an arm that comes with Tendon. Raises UsageError."""
    return _shipped(ARMS, "model file here and no arm", name)


def scenario_path(scenario: Path) -> Path:
    """The scenario file that an argument means: a file, or the name of one of Tendon's. Raises UsageError."""
    return _shipped(SCENARIOS, "scenario file here and no scenario", scenario.name) if is_name(scenario) else scenario


def shipped_or_given(path: Path) -> Path:
    """The file of Tendon that a name stands for, if there is one; else the path."""
    shipped = [folder / f"{path.name}.toml" for folder in (ARMS, SCENARIOS)] if is_name(path) else []
    return next((file for file in shipped if file.exists()), path)


def _shipped(folder: Path, kind: str, name: str) -> Path:
    names = sorted(path.stem for path in folder.glob("*.toml"))
    if name not in names:
        raise UsageError(f"{quote(name)} is no {kind} of Tendon; expected a file, or one of {', '.join(names)}")
    return folder / f"{name}.toml"


def check_unchanged(path: Path, text: str) -> None:
    """Raises UsageError if the model file has another text by now."""
    from symbolic.model_file import reader

    if reader.read_text(path) != text:
        raise UsageError(f"{path}: was changed by someone else meanwhile; nothing was written, try again")


def column_mapping(entries: Sequence[str] | None) -> dict[str, str]:
    """Signal -> column, from `--map name=column` and `--columns name,name`.

    `--map` overrides `--columns`, and a later sign or unit of the same column an earlier one. Raises UsageError.
    """
    from runtime.recordings.columns import in_order

    given = entries or ()
    lists = [entry for entry in given if "=" not in entry and "," in entry]
    ordered = _mapped(entry for columns in lists for entry in in_order(columns))
    return ordered | _mapped(entry for entry in given if entry not in lists)


def _mapped(entries: Iterable[str]) -> dict[str, str]:
    def bare(column: str) -> str:
        return column.strip().removeprefix("-").split(" [")[0]

    result: dict[str, str] = {}
    for entry in entries:
        name, equals, column = (part.strip() for part in entry.partition("="))
        if not equals or not name or not column:
            raise UsageError(f'--map {entry}: expected NAME=COLUMN, for example --map q1="Position1 [deg]"')
        if bare(result.get(name, column)) != bare(column):
            raise UsageError(f"--map {name}: given twice")
        result[name] = column
    return result
