"""Long work of a session in a process of its own: how far it is, its end, and ending it early.

The process reads one task a line from its standard input and writes one message a line. It keeps between tasks what it
has read and fitted; when it is ended, by whatever, the session is as it was before the task: results are moved to
their places whole.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import runtime
from runtime.studio.settings import ENDS_WITHIN

State = Literal["running", "done", "cancelled", "failed"]


class WorkError(RuntimeError):
    """Work that cannot be begun while other work is under way."""


@dataclass(frozen=True)
class WorkState:
    """A piece of work.

    task     its kind, for programs; what: for people
    parts    of which it consists, in words        at     which of them is under way, from 0
    share    of the whole that is done, 0 to 1: each part counts the same, since nobody knows how long the next takes
    doing    what of the part is being done, in words, and left: s until that is done; None: not known
    said     lines of progress
    result   what it found, once it is done             error  one line, if it failed
    """

    task: str
    what: str
    state: State = "running"
    parts: tuple[str, ...] = ()
    at: int = 0
    share: float = 0.0
    doing: str = ""
    left: float | None = None
    said: tuple[str, ...] = ()
    result: Mapping[str, Any] | None = None
    error: str | None = None


class Work:
    """The process of a session, started when it is first needed.

    changed   is called from another thread whenever the state of the work is another; finished: before that, with a
              state that is an end
    """

    def __init__(
        self, folder: Path, effects: Path | None, changed: Callable[[], None], finished: Callable[[WorkState], None]
    ) -> None:
        self._command = [
            sys.executable,
            "-m",
            "runtime.studio.worker",
            str(folder),
            *([str(effects)] if effects else []),
        ]
        self._changed, self._finished = changed, finished
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.RLock()
        self._state: WorkState | None = None

    @property
    def state(self) -> WorkState | None:
        """Of the work that was begun last; None before any."""
        return self._state

    @property
    def busy(self) -> bool:
        """Whether work is under way."""
        return self._state is not None and self._state.state == "running"

    @contextlib.contextmanager
    def unchanged(self) -> Iterator[None]:
        """While it is held nothing comes of the process: the state of the work and what it has found are of one moment.

        Whoever shows them reads them more than once, and would else show what is no more.
        """
        with self._lock:
            yield

    def begin(self, task: str, what: str, arguments: Mapping[str, Any]) -> None:
        """Begin a task. Raises WorkError where another one is under way."""
        with self._lock:
            if self.busy:
                raise WorkError("something else is being worked on; wait for it, or cancel it")
            process = self._running()
            self._state = WorkState(task, what)
            assert process.stdin is not None
            process.stdin.write(json.dumps({"task": task, "arguments": dict(arguments)}).encode() + b"\n")
            process.stdin.flush()
        self._changed()

    def cancel(self) -> None:
        """End the work at once; nothing of it stays."""
        self._end("cancelled", None)

    def close(self) -> None:
        """End the process, too."""
        self._end("cancelled", None)
        with self._lock:
            if self._process is not None:
                _killed(self._process)
                self._process = None

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            home = str(Path(runtime.__file__).resolve().parent.parent)
            path = os.pathsep.join(filter(None, [home, os.environ.get("PYTHONPATH")]))
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, "PYTHONPATH": path, "PYTHONSAFEPATH": "1"},
                start_new_session=True,
            )
            threading.Thread(target=self._listen, args=(self._process,), daemon=True).start()
        return self._process

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        with process.stdout as lines:
            for line in lines:
                self._hear(process, json.loads(line))
        process.wait()
        with self._lock:
            lost = self._process is process and self.busy
        if lost:
            self._end("failed", "the process that did the work has ended; memory may have run out")

    def _hear(self, process: subprocess.Popen[bytes], message: Mapping[str, Any]) -> None:
        with self._lock:
            if self._process is not process or self._state is None or not self.busy:
                return
            state = self._state
            if "said" in message:
                self._state = replace(state, said=(*state.said, str(message["said"])))
            elif "parts" in message:
                self._state = replace(state, parts=tuple(message["parts"]))
            elif "at" in message:
                self._state = replace(state, **message)
            elif "error" in message:
                self._conclude(replace(state, state="failed", error=str(message["error"])))
            else:
                self._conclude(replace(state, state="done", share=1.0, left=0.0, result=message["result"]))
        self._changed()

    def _end(self, state: State, error: str | None) -> None:
        with self._lock:
            if self._state is None or not self.busy:
                return
            process, self._process = self._process, None
            if process is not None:
                _killed(process)
            self._conclude(replace(self._state, state=state, error=error))
        self._changed()

    def _conclude(self, ended: WorkState) -> None:
        """The end of the work is known once what it found is in its place."""
        try:
            self._finished(ended)
        except OSError as error:
            ended = replace(
                ended, state="failed", error=f"{error.filename or 'the session'}: {error.strerror or error}"
            )
        self._state = ended


def _killed(process: subprocess.Popen[bytes]) -> None:
    """End a process and those that it has forked, which are its group."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(ENDS_WITHIN)
    if process.stdin is not None:
        with contextlib.suppress(OSError):
            process.stdin.close()
