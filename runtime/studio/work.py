"""Long tasks of a session in a process of their own: begin, progress, end, cancel.

The process (worker.py) keeps between tasks what it has read and fitted. Whenever it ends, the session is as it was
before the task: complete results are moved to their places by the server.
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

import msgspec

from runtime.plain_json import plain
from runtime.studio.documents import TaskResult
from runtime.studio.settings import ENDS_WITHIN

State = Literal["running", "done", "cancelled", "failed"]


class WorkError(RuntimeError):
    """A task that cannot begin while another one is running."""


@dataclass(frozen=True)
class WorkState:
    """A task.

    what     in words
    parts    in words; at: the one that is running, from 0
    share    of the whole that is done, 0 to 1: each part counts the same, since their durations are not known
    doing    a job of the part, in words; left: s until it is done, None: not known
    said     intermediate results, for people
    result   once it is done
    error    one line, if it failed
    """

    what: str
    state: State = "running"
    parts: tuple[str, ...] = ()
    at: int = 0
    share: float = 0.0
    doing: str = ""
    left: float | None = None
    said: tuple[str, ...] = ()
    result: TaskResult | None = None
    error: str | None = None


class Work:
    """The process of a session, started when it is first needed.

    changed    called after every change of the state, from another thread
    finished   called before that with a state that is an end
    """

    def __init__(
        self, folder: Path, effects: Path | None, changed: Callable[[], None], finished: Callable[[WorkState], None]
    ) -> None:
        arguments = [str(folder), *([str(effects)] if effects else [])]
        self._command = [sys.executable, "-m", f"{__package__}.worker", *arguments]
        self._changed, self._finished = changed, finished
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.RLock()
        self._state: WorkState | None = None

    @property
    def state(self) -> WorkState | None:
        """Of the last task; None before any."""
        return self._state

    @property
    def busy(self) -> bool:
        """Whether a task is running."""
        return self._state is not None and self._state.state == "running"

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Within, no message of the process is taken: all that is read of task and session belongs together."""
        with self._lock:
            yield

    def begin(self, task: str, what: str, arguments: Mapping[str, Any]) -> None:
        """Begin a task. Raises WorkError while another one is running."""
        with self._lock:
            if self.busy:
                raise WorkError("another task is running; wait for it, or cancel it")
            process = self._running()
            self._state = WorkState(what)
            assert process.stdin is not None
            process.stdin.write(json.dumps(plain({"task": task, "arguments": arguments})).encode() + b"\n")
            process.stdin.flush()
        self._changed()

    def cancel(self) -> None:
        """End the task at once, without a result."""
        self._end("cancelled", None)

    def close(self) -> None:
        """End the task and the process."""
        self._end("cancelled", None)
        with self._lock:
            if self._process is not None:
                _kill(self._process)
                self._process = None

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            home = str(Path(__file__).resolve().parents[__name__.count(".")])
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
                try:
                    self._hear(process, json.loads(line))
                except (ValueError, TypeError) as error:  # else nobody would learn that the task has ended
                    self._end("failed", f"the result of the task cannot be read: {error}")
        process.wait()
        with self._lock:
            lost = self._process is process and self.busy
        if lost:
            self._end("failed", "the process of the task has ended; memory may have run out")

    def _hear(self, process: subprocess.Popen[bytes], message: Mapping[str, Any]) -> None:
        with self._lock:
            if self._process is not process or self._state is None or not self.busy:
                return
            state = self._state
            if "said" in message:
                self._state = replace(state, said=(*state.said, str(message["said"])))
            elif "result" in message:
                result = msgspec.convert(message["result"], TaskResult, str_keys=True)
                self._conclude(replace(state, state="done", share=1.0, left=0.0, result=result))
            elif "error" in message:
                self._conclude(replace(state, state="failed", error=str(message["error"])))
            else:
                self._state = replace(state, **{**message, "parts": tuple(message.get("parts", state.parts))})
        self._changed()

    def _end(self, state: State, error: str | None) -> None:
        with self._lock:
            if self._state is None or not self.busy:
                return
            process, self._process = self._process, None
            if process is not None:
                _kill(process)
            self._conclude(replace(self._state, state=state, error=error))
        self._changed()

    def _conclude(self, ended: WorkState) -> None:
        """The end is seen once the results are in their places."""
        try:
            self._finished(ended)
        except OSError as error:
            why = f"{error.filename or 'the session'}: {error.strerror or error}"
            ended = replace(ended, state="failed", error=why)
        self._state = ended


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a process and its group: those that it has forked."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(ENDS_WITHIN)
    if process.stdin is not None:
        with contextlib.suppress(OSError):
            process.stdin.close()
