"""What a verb leaves behind: its figures for a person or as JSON, an exit status, an error in one line."""

from __future__ import annotations

import errno
import gc
import io
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import NoReturn, TypeVar

import typer

from runtime.documents.parts import Document
from runtime.plain_json import plain

D = TypeVar("D")
NO, BAD_INPUT, INTERRUPTED = 1, 2, 130
_NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO)
_ALLOCATED, _YOUNGER = 100_000, 50
"""New objects, and collections of younger ones, between two searches for circles of objects: Python's 700 and 10 are
for programs that run for days. A verb derives equations out of a million small objects, nearly all of which stay."""


def open_streams() -> None:
    """A closed standard stream is one into which nothing comes: no file that is opened later takes its place. What a
    terminal cannot show is shown by its number."""
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            with suppress(OSError):
                os.fstat(number)
                continue
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            setattr(sys, name, os.fdopen(number, mode, closefd=False))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def run(app: typer.Typer, arguments: Sequence[str]) -> int:
    """The exit status of `tendon ARGUMENTS`; whatever a user did wrong is one line on standard error."""
    try:
        status = int(app(args=list(arguments) or ["--help"], prog_name="tendon", standalone_mode=False) or 0)
        # typer makes a status of Ctrl-C, and no word.
        return _complain("interrupted", INTERRUPTED) if status == INTERRUPTED else status
    except BrokenPipeError:
        # The reader of our output has gone; do not complain again when Python flushes.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (KeyboardInterrupt, typer.Abort):
        return _complain("interrupted", INTERRUPTED)
    except OSError as error:
        # All files that are written say their names; what has none is a stream.
        return _complain(_reason(error, "standard output" if error.errno in _NO_ROOM else ""), BAD_INPUT)
    except Exception as error:
        if _came_of_ctrl_c(error):
            return _complain("interrupted", INTERRUPTED)
        # typer's usage errors come from one click or another; both can format themselves.
        if show := getattr(error, "format_message", None):
            return _complain(f"{_command(error)}: {show()} (see {_command(error)} --help)", BAD_INPUT)
        if _is_for_people(error):
            return _complain(str(error), BAD_INPUT)
        raise


def _came_of_ctrl_c(error: BaseException | None) -> bool:
    """Whether it is what became of Ctrl-C, as in the middle of an import of compiled code."""
    return error is not None and (
        isinstance(error, KeyboardInterrupt) or _came_of_ctrl_c(error.__cause__ or error.__context__)
    )


def collect_seldom() -> None:
    """Search for garbage seldom: a fifth of the time of `generate` is spent on finding none."""
    gc.set_threshold(_ALLOCATED, _YOUNGER, _YOUNGER)


def leave(status: int) -> NoReturn:
    """End the process; after Ctrl-C at once: what it holds in memory takes a second to be given back in order. What is
    left then is not searched for circles any more."""
    if status == INTERRUPTED:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)
    gc.freeze()
    sys.exit(status)


def _is_for_people(error: Exception) -> bool:
    """Our own errors (ModelError, RecordingError, BuildError...) and only those; a bug keeps its traceback."""
    home = type(error).__module__.split(".")[0]
    return home in ("runtime", "symbolic", "codegen")


def _reason(error: OSError, nameless: str) -> str:
    name = error.filename or nameless
    return f"{name}{': ' * bool(name)}{error.strerror or error}"


def _command(error: Exception) -> str:
    context = getattr(error, "ctx", None)
    return context.command_path if context else "tendon"


def _complain(message: str, status: int) -> int:
    line = " ".join(message.split())
    print("".join(c if c.isprintable() else ascii(c)[1:-1] for c in line), file=sys.stderr)
    return status


def emit(target: str | None, document: D, show: Callable[[D], None]) -> None:
    """Print `document` for a person, or as JSON alone (`-`), or both a file and the print."""
    clean = plain(document)
    text = json.dumps(clean, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    if target == "-":
        sys.stdout.write(text if _shows(text) else json.dumps(clean, indent=1, allow_nan=False) + "\n")
        sys.stdout.flush()
        return
    show(document if isinstance(document, Document) else clean)
    if target is not None:
        from runtime.files import replace

        replace(target, text.encode())


def _shows(text: str) -> bool:
    """Whether standard output knows all letters of a text."""
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        return False
    return True


@contextmanager
def costs_itself(what: str) -> Iterator[None]:
    """A drawing of what has been said already: that it cannot be written is said, and changes nothing else."""
    try:
        yield
    except OSError as error:
        _complain(f"{what} could not be written: {_reason(error, '')}", 0)
