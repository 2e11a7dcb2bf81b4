"""The jobs of a sweep, one optimization each: what a worker computes, and the worker processes of this machine."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from math import isfinite
from multiprocessing import resource_tracker
from pathlib import Path

import msgspec

from runtime.model.loader import Library, Model
from runtime.planning.optimize import Infeasible, StartError, optimize
from runtime.planning.scenario import Scenario
from runtime.planning.settings import PlanningSettings
from runtime.progress import on_cores

Value = float | str
ATTEMPTS = 2
"""How often a job is tried whose worker process dies."""
MAX_LOST = 3
"""After this many jobs in a row whose workers died, the sweep stops: the cause is not in the jobs."""
_SUBMITTED = 10_000
"""Jobs that are handed to the workers at a time."""

_ONE_AT_A_TIME = threading.Lock()
"""CasADi and IPOPT share state between the threads of a process, and a Dask worker may have several."""


class PoolError(RuntimeError):
    """No worker is left; the message says what to do."""


@dataclass(frozen=True)
class Code:
    """Directories of the compiled code of an arm and of the effects, as a worker sees them."""

    model: Path
    library: Path

    def load(self) -> Model:
        return Model(self.model, Library(self.library))

    def files(self) -> dict[str, Path]:
        """The files of both directories by their path below a common one."""
        parts = {"model": self.model, "library": self.library}
        found = [(f"{part}/{p.name}", p) for part, home in parts.items() for p in sorted(home.iterdir())]
        return {name: path for name, path in found if path.is_file()}

    def identity(self) -> str:
        """A hash of the generated sources: the same for one arm wherever it was compiled."""
        sources = {n: p for n, p in self.files().items() if p.suffix != ".so" and not p.name.startswith(".")}
        return digest({name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in sources.items()})


def digest(content: object) -> str:
    """A short hash of content that JSON can represent."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:24]


@dataclass(frozen=True)
class Job:
    """A variation of a scenario with one seed. key: a hash of everything that determines its result."""

    columns: Mapping[str, Value | None]
    scenario: Scenario
    seed: int
    starts: int | None
    key: str


class JobResult(msgspec.Struct, frozen=True):
    """The outcome of a job, a column of the table each.

    feasible    None: the job failed                    message       why there is no plan
    cost        of the objective, exact                 smooth_cost   as the solver computed it
    at_joints   cost_joint1 ..., stiffness_joint4 ...   seconds       of computation
    """

    feasible: bool | None
    cost: float | None = None
    smooth_cost: float | None = None
    at_joints: dict[str, float] = {}
    iterations: int | None = None
    message: str = ""
    seconds: float | None = None

    def columns(self) -> dict[str, float | str | None]:
        """One level of names, those without a value left out."""
        known = {name: x for name, x in msgspec.structs.asdict(self).items() if x is not None or name == "feasible"}
        return known | known.pop("at_joints")

    @classmethod
    def parse(cls, columns: object) -> JobResult:
        """The inverse of columns(). Raises ValueError for anything else."""
        if not isinstance(columns, dict):
            raise ValueError("expected an object")
        known = {name: columns[name] for name in cls.__struct_fields__ if name in columns}
        others = {name: x for name, x in columns.items() if name not in known}
        found = msgspec.convert({**known, "at_joints": others}, cls)
        if (found.cost is not None) is not (found.feasible is True):
            raise ValueError("expected a cost if there is a plan")
        if not all(isfinite(x) for x in (found.cost or 0.0, found.smooth_cost or 0.0, *found.at_joints.values())):
            raise ValueError("expected finite numbers")
        return found


def solve(code: Code, job: Job) -> JobResult:
    """The best plan of the job's starts, or why there is none."""
    with _ONE_AT_A_TIME, on_cores(1):
        started = time.perf_counter()
        try:
            plan = optimize(_loaded(code), job.scenario, PlanningSettings(job.starts, job.seed))
        except (Infeasible, StartError) as error:
            attempts = error.attempts if isinstance(error, Infeasible) else ()
            iterations = sum(a.iterations for a in attempts)
            seconds = time.perf_counter() - started
            return JobResult(feasible=False, iterations=iterations, message=str(error), seconds=seconds)
        springs = plan.trajectory.springs
        return JobResult(
            feasible=True,
            cost=plan.cost,
            smooth_cost=plan.smooth_cost,
            at_joints={f"cost_joint{i}": float(cost) for i, cost in enumerate(plan.effort.cost, 1)}
            | {
                f"{p.name}_joint{s.plan.joint}": float(springs[s.plan.joint][p.name])
                for s in plan.springs
                for p in s.sought
            },
            iterations=sum(a.iterations for a in (*plan.attempts, plan.refined)),
            seconds=time.perf_counter() - started,
        )


@cache
def _loaded(code: Code) -> Model:
    return code.load()


# --- workers ---


@dataclass(frozen=True)
class Pool:
    """Where jobs run. executor: of concurrent.futures; task: what it calls with each job; lost: the message of the
    PoolError if it cancels jobs."""

    executor: Executor
    task: Callable[[Job], JobResult]
    lost: str


def outcomes(pool: Pool, jobs: Sequence[Job]) -> Iterator[tuple[Job, JobResult]]:
    """Each job with its result, in the order in which they finish. Raises PoolError if there is no worker left."""
    lost_in_a_row = 0
    for first in range(0, len(jobs), _SUBMITTED):
        running = {pool.executor.submit(pool.task, job): job for job in jobs[first : first + _SUBMITTED]}
        for future in as_completed(running):
            job = running.pop(future)
            try:
                result, lost_in_a_row = future.result(), 0
            except CancelledError as error:
                raise PoolError(pool.lost) from error
            except BrokenProcessPool:
                result = JobResult(feasible=None, message=f"its worker process died {ATTEMPTS} times")
                lost_in_a_row += 1
            except Exception as error:
                result = JobResult(feasible=None, message=" ".join(f"{type(error).__name__}: {error}".split()))
            yield job, result
            if lost_in_a_row >= MAX_LOST:
                raise PoolError(f"the workers of {MAX_LOST} jobs in a row died; is there enough memory?")


@contextmanager
def processes(code: Code, count: int) -> Iterator[Pool]:
    """Worker processes of this machine; leaving the context ends those that still run."""
    # The matrices are small: threads of the linear algebra library would only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Starting the tracker unblocks interrupts in its thread, so the threads of the workers must find it running.
    resource_tracker.ensure_running()
    workers = _Workers(code)
    # Ctrl-C is handled by the main thread; the processes that a thread starts inherit its mask.
    executor = ThreadPoolExecutor(
        count, initializer=signal.pthread_sigmask, initargs=(signal.SIG_BLOCK, {signal.SIGINT})
    )
    try:
        yield Pool(executor, workers.solve, "the worker processes were told to stop")
    finally:
        workers.kill()
        executor.shutdown(cancel_futures=True)


class _Workers:
    """A process for each thread that calls solve(), so that a process that dies takes one job with it only."""

    def __init__(self, code: Code) -> None:
        self._code = code
        self._local = threading.local()
        self._lock = threading.Lock()
        self._ended = False
        self._pools: list[ProcessPoolExecutor] = []
        self._others = set(multiprocessing.active_children())

    def solve(self, job: Job) -> JobResult:
        """Raises BrokenProcessPool if the process died in every attempt."""
        for attempt in range(ATTEMPTS):
            future = self._submit(job)
            try:
                return future.result()
            except BrokenProcessPool:
                del self._local.process
                if attempt == ATTEMPTS - 1:
                    raise
        raise AssertionError

    def _submit(self, job: Job) -> Future[JobResult]:
        with self._lock:
            if self._ended:
                raise CancelledError
            if not hasattr(self._local, "process"):
                # A fresh interpreter: a fork would copy locks that CasADi and NumPy hold.
                context = multiprocessing.get_context("spawn")
                self._local.process = ProcessPoolExecutor(1, context, _end_with_parent)
                self._pools.append(self._local.process)
            return self._local.process.submit(solve, self._code, job)

    def kill(self) -> None:
        with self._lock:
            self._ended = True
            for process in set(multiprocessing.active_children()) - self._others:
                process.kill()
        # Their semaphores are removed here: after Ctrl-C the process ends without the finalizers of its objects.
        while self._pools:
            self._pools.pop().shutdown()


def _end_with_parent() -> None:
    """In a new worker process: end when the parent dies, even if it is killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
