"""The process of a session: `python -m runtime.studio.worker FOLDER [EFFECTS]`.

It reads a task a line from standard input, {"task", "arguments"}, and writes messages a line to standard output:
{"parts"} of the task, {"at", "share", "doing", "left"} for its progress, {"said"} for people, and at the end {"result"}
or {"error"}. It ends when its input does.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import traceback
from pathlib import Path
from queue import SimpleQueue
from typing import TextIO, get_type_hints

import msgspec

from runtime.progress import heard_by
from runtime.studio.loaded import LoadedSession, Reporter
from runtime.studio.session import StudioSession
from runtime.studio.tasks import TASKS
from runtime.version import is_ours


def main(folder: str, effects: str | None = None) -> None:
    """Work until nothing more is asked for."""
    # What libraries print must not mix with the messages.
    report = Reporter(os.fdopen(os.dup(1), "w"))
    os.dup2(2, 1)
    # A forked process closes sys.stdin, and would wait forever for the lock that the reading thread holds.
    asked_from, sys.stdin = os.fdopen(os.dup(0)), open(os.devnull)  # noqa: SIM115
    lines: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_read, args=(asked_from, lines), daemon=True).start()
    loaded: LoadedSession | None = None
    while True:
        asked = json.loads(lines.get())
        try:
            session = StudioSession.open(Path(folder))
            if loaded is None or loaded.inputs != session.inputs:
                loaded = LoadedSession(session, None if effects is None else Path(effects), loaded)
            loaded.session = session
            task = TASKS[asked["task"]]
            kinds = get_type_hints(task)
            arguments = {name: msgspec.convert(value, kinds[name]) for name, value in asked["arguments"].items()}
            with heard_by(report.progress):
                report.message(result=task(loaded, report, **arguments))
        except Exception as error:
            # For people: one line, without the path of the session.
            line = " ".join(str(error).split()).replace(f"{Path(folder).resolve() / 'given'}{os.sep}", "")
            if not is_ours(error) and not isinstance(error, OSError | msgspec.MsgspecError):
                traceback.print_exc()
                line = f"this is a mistake in Tendon: {type(error).__name__}: {error}"
            report.message(error=line)


def _read(tasks: TextIO, lines: SimpleQueue[str]) -> None:
    for line in tasks:
        lines.put(line)
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    main(*sys.argv[1:])
