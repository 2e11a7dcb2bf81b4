"""Where the command line meets the person: options that several verbs share, JSON out, errors in one line."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

NO, BAD_INPUT = 1, 2

ModelFile = Annotated[Path, typer.Argument(metavar="MODEL", help="Model file (TOML).")]
Recordings = Annotated[
    list[Path],
    typer.Argument(
        metavar="RECORDING...",
        help="CSV, plain or gzip: t,q1,tau1,... and, if measured, temperature1,q1_link,tau1_link,tau1_rigid,fx,fy.",
    ),
]
Json = Annotated[str | None, typer.Option("--json", metavar="FILE", help="Write every figure as JSON; - for stdout.")]
EffectsFile = Annotated[
    Path | None, typer.Option("--effects", metavar="FILE.py", help="Your own effects: Python that is run, so trust it.")
]
Map = Annotated[
    list[str] | None,
    typer.Option("--map", metavar='q1="Position1 [deg]"', help="Read a signal from a column of another name."),
]
AllowGaps = Annotated[bool, typer.Option("--allow-gaps", help="Split at gaps and drop NaN rows instead of refusing.")]
Report = Annotated[Path | None, typer.Option("--report", metavar="DIR", help="Write an HTML page with plots there.")]


class UsageError(ValueError):
    """A command line that contradicts itself."""


def run(app: typer.Typer, arguments: Sequence[str]) -> int:
    """The exit status of `tendon ARGUMENTS`; whatever a user did wrong is one line on standard error."""
    try:
        return int(app(args=list(arguments) or ["--help"], prog_name="tendon", standalone_mode=False) or 0)
    except BrokenPipeError:
        # The reader of our output has gone; do not complain again when Python flushes.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (KeyboardInterrupt, typer.Abort):
        return _complain("interrupted", 130)
    except OSError as error:
        named = f"{error.filename}: " if error.filename else ""
        return _complain(f"{named}{error.strerror or error}", BAD_INPUT)
    except Exception as error:
        # typer's usage errors come from one click or another; both can format themselves.
        if show := getattr(error, "format_message", None):
            return _complain(f"{_command(error)}: {show()} (see {_command(error)} --help)", BAD_INPUT)
        if _is_for_people(error):
            return _complain(str(error), BAD_INPUT)
        raise


def _is_for_people(error: Exception) -> bool:
    """Our own errors (ModelError, RecordingError, BuildError...) and only those; a bug keeps its traceback."""
    home = type(error).__module__.split(".")[0]
    return home in ("runtime", "symbolic", "codegen")


def _command(error: Exception) -> str:
    context = getattr(error, "ctx", None)
    return context.command_path if context else "tendon"


def _complain(message: str, status: int) -> int:
    line = " ".join(message.split())
    print("".join(c if c.isprintable() else ascii(c)[1:-1] for c in line), file=sys.stderr)
    return status


def emit(target: str | None, document: Mapping[str, Any], show: Callable[[Mapping[str, Any]], None]) -> None:
    """Print `document` for a person, or as JSON alone (`-`), or both a file and the print."""
    clean = plain(document)
    if target is not None:
        text = json.dumps(clean, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        if target == "-":
            sys.stdout.write(text)
            sys.stdout.flush()
            return
        from runtime.files import replace

        replace(target, text.encode())
    show(clean)


def plain(value: Any) -> Any:
    """As JSON knows it: NumPy's numbers become Python's, NaN and infinity null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def check_writable(*targets: Path | str | None) -> None:
    """Refuse before any work is done where a result could not be written after it."""
    for target in targets:
        if target in (None, "-"):
            continue
        path = Path(str(target))
        if path.is_dir():
            raise UsageError(f"{path}: is a directory; expected a file to write")
        if not path.parent.is_dir():
            raise UsageError(f"{path}: there is no directory {path.parent}; make it first")
        if not os.access(path if path.exists() else path.parent, os.W_OK):
            raise UsageError(f"{path}: cannot be written; check its permissions")


def check_directory(target: Path | None) -> None:
    """Refuse a directory to write into that is something else."""
    if target is not None and target.exists() and not target.is_dir():
        raise UsageError(f"{target}: is a file; expected a directory to write into")


def nearby(path: Path) -> Path:
    """The path as one would type it from here, where it lies below."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path


def mapping(entries: Sequence[str] | None) -> dict[str, str]:
    """`--map name=column`, several times, as a dictionary."""
    result: dict[str, str] = {}
    for entry in entries or ():
        name, equals, column = entry.partition("=")
        if not equals or not name.strip() or not column.strip():
            raise UsageError(f'--map {entry}: expected NAME=COLUMN, for example --map q1="Position1 [deg]"')
        if name.strip() in result:
            raise UsageError(f"--map {name.strip()}: given twice")
        result[name.strip()] = column.strip()
    return result
