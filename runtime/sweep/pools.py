"""Jobs through an executor of concurrent.futures: each comes to one end, whatever becomes of the workers."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Protocol

from runtime.sweep.job import Code, Job, Result, failed, solve

_TRIES = 2
"""Of a job that was alone when its worker died."""
_GIVE_UP = 3
"""Jobs in a row that took their worker with them: then it is not the jobs."""


class PoolError(RuntimeError):
    """The workers are gone for good; the message says what to do."""


class Pool(Protocol):
    """Where jobs run. width: how many are submitted at a time; lost: what to say when the executor gives up jobs."""

    @property
    def width(self) -> int:
        """How many jobs run at a time."""

    @property
    def lost(self) -> str:
        """What to say where the pool itself is gone."""

    @property
    def task(self) -> Callable[[Job], Result]:
        """What a worker does with a job; can be pickled."""

    def executor(self) -> AbstractContextManager[Executor]:
        """A fresh one. Leaving it ends what still runs there."""


def outcomes(pool: Pool, jobs: Iterable[Job]) -> Iterator[tuple[Job, Result]]:
    """Each job once with its result, as they finish. Raises PoolError if there is no one left to work.

    A process that dies breaks its executor, and nobody knows which job was to blame. So those that ran then are
    tried again one at a time, and only a job that dies alone, again and again, is given up as failed.
    """
    waiting, suspects = deque(jobs), deque[Job]()
    deaths: Counter[str] = Counter()
    in_a_row = 0
    while waiting or suspects:
        try:
            with pool.executor() as executor:
                for queue, width in ((suspects, 1), (waiting, pool.width)):
                    for job, result in _finished(executor, pool, queue, width):
                        in_a_row = 0
                        yield job, result
        except _WorkerDied as died:
            if len(died.running) > 1:
                suspects.extend(died.running)
                continue
            for job in died.running:
                deaths[job.key] += 1
                if deaths[job.key] < _TRIES:
                    suspects.appendleft(job)
                    continue
                in_a_row += 1
                yield job, failed(f"its worker process died {_TRIES} times, with no other job there")
        if in_a_row >= _GIVE_UP:
            raise PoolError(f"{in_a_row} jobs in a row took their worker process with them; is there enough memory?")


class _WorkerDied(Exception):
    """running: the jobs that were with the executor then."""

    def __init__(self, running: Iterable[Job]) -> None:
        super().__init__()
        self.running = tuple(running)


def _finished(executor: Executor, pool: Pool, jobs: deque[Job], width: int) -> Iterator[tuple[Job, Result]]:
    """Takes jobs off the queue until it is empty and all are done."""
    running: dict[Future[Result], Job] = {}
    done: SimpleQueue[Future[Result]] = SimpleQueue()
    try:
        while jobs or running:
            while jobs and len(running) < width:
                with _deaf():
                    future = executor.submit(pool.task, jobs[0])
                running[future] = jobs.popleft()
                future.add_done_callback(done.put)
            future = done.get()
            result = _result(future, pool)
            yield running.pop(future), result
    except BrokenExecutor as error:
        raise _WorkerDied(running.values()) from error


def _result(future: Future[Result], pool: Pool) -> Result:
    try:
        return future.result()
    except BrokenExecutor:
        raise
    except CancelledError as error:
        raise PoolError(pool.lost) from error
    except Exception as error:
        return failed(f"{type(error).__name__}: {error}")


@contextmanager
def _deaf() -> Iterator[None]:
    """What is started within never hears Ctrl-C, not even before it runs; here it is heard afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# --- processes of this machine ---


@dataclass(frozen=True)
class Local:
    """Processes of this machine, each with the arm's compiled code."""

    code: Code
    workers: int

    @property
    def width(self) -> int:
        """One more waits for each that runs."""
        return 2 * self.workers

    @property
    def lost(self) -> str:
        return "the worker processes were told to stop"

    @property
    def task(self) -> Callable[[Job], Result]:
        return partial(solve, self.code)

    @contextmanager
    def executor(self) -> Iterator[Executor]:
        # The matrices here are small, threads of the linear algebra library would only wait for each other; and
        # a fresh interpreter, as a fork would copy locks that CasADi and NumPy hold.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        context = multiprocessing.get_context("spawn")
        theirs, ours = context.Pipe(duplex=False)
        others = set(multiprocessing.active_children())
        executor = ProcessPoolExecutor(self.workers, context, _begin, (theirs,))
        try:
            yield executor
        finally:
            ours.close()
            # One that is yet to begin does not see that.
            for worker in set(multiprocessing.active_children()) - others:
                worker.kill()
            executor.shutdown(cancel_futures=True)
            theirs.close()


def _begin(lifeline: Connection) -> None:
    """In a new worker: none outlives its parent."""
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()


def _end_with(lifeline: Connection) -> None:
    # Nothing is ever sent: it ends when the parent closes it, or when the parent dies.
    with suppress(EOFError, OSError):
        lifeline.recv()
    os._exit(0)
