"""The process of a session: `python -m runtime.studio.worker FOLDER [EFFECTS]`.

Reads a task a line on standard input, writes messages a line on standard output: {"parts"} of which the work consists,
{"at", "share", "doing", "left"} of how far it is, {"said"} a line for people, and in the end {"result"} or {"error"}.
It ends when its input does.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TextIO

from runtime.plain_json import plain
from runtime.progress import Progress, heard_by
from runtime.studio import questions, tasks
from runtime.studio.bench import Bench, Tell
from runtime.studio.settings import TOLD_EVERY

TASKS = tasks.TASKS | questions.TASKS


class _Teller:
    """Messages to the server."""

    def __init__(self, out: TextIO) -> None:
        self._out, self._last, self._doing = out, 0.0, ""
        self._parts: tuple[str, ...] = ()
        self._at, self._share = 0, 0.0

    def message(self, **fields: Any) -> None:
        self._out.write(json.dumps(plain(fields), allow_nan=False) + "\n")
        self._out.flush()

    def progress(self, progress: Progress) -> None:
        """Not more often than a page can show. A part may consist of several works, each from its beginning: the share
        of the whole never falls."""
        now, last = time.monotonic(), progress.done >= progress.parts
        if now - self._last >= TOLD_EVERY or progress.what != self._doing or last:
            self._last, self._doing = now, progress.what
            inside = min(progress.done / progress.parts, 1.0)
            self._share = max(self._share, (self._at + inside) / max(len(self._parts), 1))
            self.message(at=self._at, share=self._share, doing=progress.what, left=progress.left)

    def parts(self, parts: Sequence[str]) -> None:
        """Of which the work consists."""
        self._parts, self._at, self._share = tuple(parts), 0, 0.0
        self.message(parts=self._parts)

    def part(self, what: str) -> None:
        """The next of them, of which nobody knows yet how long it takes."""
        self._at = self._parts.index(what)
        self._share = max(self._share, self._at / len(self._parts))
        self.message(at=self._at, share=self._share, doing="", left=None)


def main(arguments: list[str]) -> None:
    """Work until nothing more is asked for."""
    # What libraries print is none of the messages.
    told = _Teller(os.fdopen(os.dup(1), "w"))
    os.dup2(2, 1)
    asked: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_read, args=(asked,), daemon=True).start()
    bench = Bench(Path(arguments[0]), Path(arguments[1]) if len(arguments) > 1 else None)
    while True:
        task = json.loads(asked.get())
        _do(bench, task["task"], task["arguments"], told)


def _read(asked: SimpleQueue[str]) -> None:
    """Tasks as they come. Where the server has gone nobody wants what is being worked on."""
    for line in sys.stdin:
        asked.put(line)
    os.killpg(0, signal.SIGKILL)


def _do(bench: Bench, task: str, arguments: Mapping[str, Any], told: _Teller) -> None:
    tell = Tell(told.parts, told.part, lambda line: told.message(said=line))
    try:
        with heard_by(told.progress):
            result = TASKS[task](bench, tell, **arguments)
    except Exception as error:
        told.message(error=_line(error, bench))
    else:
        told.message(result=result)


def _line(error: Exception, bench: Bench) -> str:
    """An error as people read it: one line, without the place of the session."""
    ours = type(error).__module__.split(".")[0] in ("runtime", "symbolic", "codegen")
    if not ours and not isinstance(error, OSError):
        traceback.print_exc()
        return f"this is a mistake in Tendon: {type(error).__name__}: {error}"
    return " ".join(str(error).split()).replace(f"{bench.folder / 'given'}{os.sep}", "")


if __name__ == "__main__":
    main(sys.argv[1:])
