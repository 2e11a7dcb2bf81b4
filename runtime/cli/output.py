"""Output of a verb: its document on the terminal or as JSON, its exit status, and errors in one line."""

from __future__ import annotations

import errno
import gc
import io
import json
import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypeVar

import typer

from runtime.documents.parts import Document
from runtime.interruption import came_of_ctrl_c, heard_at_last
from runtime.plain_json import plain
from runtime.version import is_our_module, is_ours

if TYPE_CHECKING:
    from runtime.fit_warnings import Suspicion
    from runtime.identification.compare import JointSeries
    from runtime.report.summary import ResultSummary

D = TypeVar("D")
NO, BAD_INPUT, INTERRUPTED = 1, 2, 130
_NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO)
_DISTRIBUTIONS = {"elftools": "pyelftools", "PIL": "pillow"}
"""Packages that are installed under another name."""
_ALLOCATED, _YOUNGER = 100_000, 50
"""Thresholds of the garbage collector. A verb allocates a million small objects, nearly all of which stay
alive; Python's defaults of 700 and 10 would scan them over and over."""


_ARGUMENTS: ContextVar[tuple[str, ...]] = ContextVar("arguments of the call that runs", default=())


def command_line() -> str:
    """The command that runs, as it was typed."""
    return shlex.join(["tendon", *_ARGUMENTS.get()])


def open_streams() -> None:
    """Open closed standard streams on the null device, so that no file that is opened later gets their descriptor.
    Characters that the terminal cannot encode are escaped."""
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
    """Run `tendon ARGUMENTS` and return its exit status; errors of the user are one line on standard error."""
    _ARGUMENTS.set(tuple(arguments))
    try:
        with heard_at_last():
            status = int(app(args=list(arguments) or ["--help"], prog_name="tendon", standalone_mode=False) or 0)
        # typer turns Ctrl-C into a status without a message.
        return _complain("interrupted", INTERRUPTED) if status == INTERRUPTED else status
    except BrokenPipeError:
        # The reader of our output has gone; do not complain again when Python flushes.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (KeyboardInterrupt, typer.Abort):
        return _complain("interrupted", INTERRUPTED)
    except OSError as error:
        # Errors of files carry their name; without one it is a stream.
        return _complain(_reason(error, "standard output" if error.errno in _NO_ROOM else ""), BAD_INPUT)
    except Exception as error:
        if came_of_ctrl_c(error):
            return _complain("interrupted", INTERRUPTED)
        # typer's usage errors come from one click or another; both can format themselves.
        if show := getattr(error, "format_message", None):
            return _complain(f"{_command(error)}: {show()} (see {_command(error)} --help)", BAD_INPUT)
        # Our own errors, such as ModelError, are for people; any other is a bug and keeps its traceback.
        if is_ours(error):
            return _complain(str(error), BAD_INPUT)
        if isinstance(error, ModuleNotFoundError) and error.name and not is_our_module(error.name):
            package = error.name.partition(".")[0]
            how = f"{sys.executable} -m pip install {_DISTRIBUTIONS.get(package, package)}"
            return _complain(f"this needs {package}, which is not installed; run: {how}", BAD_INPUT)
        raise


def collect_seldom() -> None:
    """Run the garbage collector rarely: by default it takes a fifth of the time of `generate` and frees nothing."""
    gc.set_threshold(_ALLOCATED, _YOUNGER, _YOUNGER)


def leave(status: int) -> NoReturn:
    """End the process; after Ctrl-C at once, because an orderly release of its memory takes a second. The final garbage
    collection is skipped."""
    if status == INTERRUPTED:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)
    gc.freeze()
    sys.exit(status)


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
    """Show a document on the terminal and write it as JSON to the file `target`, if any; `-`: only JSON on standard
    output."""
    clean = plain(document)
    text = json.dumps(clean, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    if target == "-":
        try:
            text.encode(sys.stdout.encoding or "utf-8")
        except UnicodeEncodeError:
            text = json.dumps(clean, indent=1, allow_nan=False) + "\n"
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    show(document if isinstance(document, Document) else clean)
    if target is not None:
        from runtime.files import replace

        # A name of a file that is no UTF-8 is escaped, as JSON has it.
        replace(target, text.encode(errors="backslashreplace"))


def end(wrong: Sequence[Suspicion], joints: Sequence[JointSeries], *, no: bool) -> None:
    """End a verb whose result is shown: BAD_INPUT where the data look wrong, NO where that is the answer or most of a
    joint's torque is missed. Raises RecordingError, typer.Exit."""
    from runtime.diagnosis.credibility import mostly_missed
    from runtime.recordings.recording import RecordingError

    if wrong:
        raise RecordingError(f"the data look wrong: {'; '.join(map(str, wrong))}")
    if no or mostly_missed(joints):
        raise typer.Exit(NO)


def write_page(directory: Path | None, summary: ResultSummary, target: str | None) -> None:
    """Write the page of a result that has been shown already, if --report asked for it; target: that of --json."""
    if directory is not None:
        from runtime.report.page.reports import write_report

        draw(lambda: write_report(directory, summary), target)


def draw(write: Callable[[], Path], target: str | None) -> None:
    """Write a page and print its path; the result has been shown already, so that a failure is only reported."""
    from runtime.report.terminal import say, working

    with costs_itself("the report"):
        with working("drawing the report"):
            page = write()
        if target != "-":
            say(f"Report: {page}")


@contextmanager
def costs_itself(what: str) -> Iterator[None]:
    """Report a failure to write a figure or a page, without changing the exit status: the result is printed already."""
    try:
        yield
    except OSError as error:
        _complain(f"{what} could not be written: {_reason(error, '')}", 0)
