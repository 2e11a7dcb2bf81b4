"""Jobs on a Dask cluster, which queues them and repeats those whose worker dies; its workers receive the arm's code."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from distributed import Client, Worker, WorkerPlugin
from distributed.comm import get_address_host

from runtime.sweep.job import Code, Job, JobResult, Pool, PoolError, digest, solve

_TIMEOUT = 10.0
"""s; to reach the scheduler."""
_unpacked: dict[str, Code] = {}
"""In a worker: the code that it has received, by name."""


class CompiledCode(WorkerPlugin):
    """The directories of compiled code, written to every worker's own disk, also of workers that join later."""

    def __init__(self, code: Code) -> None:
        self.files = {name: path.read_bytes() for name, path in code.files().items()}
        self.name = f"tendon-{digest({name: hashlib.sha256(data).hexdigest() for name, data in self.files.items()})}"

    def setup(self, worker: Worker) -> None:
        """Called by Dask on each worker. Raises an error if its machine cannot load the code."""
        if self.name in _unpacked:
            return
        home = Path(worker.local_directory) / self.name
        for path, data in self.files.items():
            target = home / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
        code = Code(home / "model", home / "library")
        code.load()
        _unpacked[self.name] = code


def solve_with(name: str, job: Job) -> JobResult:
    """In a worker: with the code that it received under this name."""
    return solve(_unpacked[name], job)


@contextmanager
def cluster(address: str, code: Code) -> Iterator[Pool]:
    """The workers of the Dask scheduler at this address. Raises PoolError."""
    try:
        get_address_host(address)
        client = Client(address, timeout=_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise PoolError(
            f"--scheduler {address}: no Dask scheduler answers there ({error}); start one with: dask scheduler"
        ) from error
    with client:
        plugin = CompiledCode(code)
        try:
            client.register_plugin(plugin)
        except Exception as error:
            raise PoolError(
                f"--scheduler {address}: a worker cannot load the arm's code ({type(error).__name__}: {error}); "
                "every worker needs tendon installed and a machine of the same kind as this one"
            ) from error
        if not client.scheduler_info(n_workers=-1)["workers"]:
            print(f"{address} has no workers yet; start some: dask worker {address} --nthreads 1", file=sys.stderr)
        executor = client.get_executor(pure=False)
        lost = f"{address}: the Dask scheduler is gone; run the same command again to continue"
        try:
            yield Pool(executor, partial(solve_with, plugin.name), lost)
        finally:
            executor.shutdown(wait=False)
