"""A Dask cluster as a pool: the arm's compiled code goes to its workers, also to those that join later."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from distributed import Client, Worker, WorkerPlugin
from distributed.comm import get_address_host

from runtime.sweep.job import Code, Job, Result, solve
from runtime.sweep.pools import PoolError

_PATIENCE = 10.0  # s
_PLACES = ("model", "library")
_unpacked: dict[str, Code] = {}
"""On a worker: code that has arrived, by name."""


class CompiledCode(WorkerPlugin):
    """Directories of compiled code, written anew on every worker: it needs no folder in common with us."""

    def __init__(self, code: Code) -> None:
        self.files = {
            f"{place}/{path.name}": path.read_bytes()
            for place, directory in zip(_PLACES, (code.model, code.library), strict=True)
            for path in sorted(directory.iterdir())
            if path.is_file()
        }
        content = "".join(f"{path} {hashlib.sha256(data).hexdigest()}\n" for path, data in self.files.items())
        self.name = f"tendon-{hashlib.sha256(content.encode()).hexdigest()[:24]}"

    def setup(self, worker: Worker) -> None:
        """Called by Dask as soon as a worker is there. Code that its machine cannot load is an error here."""
        if self.name in _unpacked:
            return
        home = Path(worker.local_directory) / self.name
        for path, data in self.files.items():
            target = home / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
        code = Code(*(home / place for place in _PLACES))
        code.load()
        _unpacked[self.name] = code


def solve_with(name: str, job: Job) -> Result:
    """On a worker: with the code that arrived under a name."""
    return solve(_unpacked[name], job)


@dataclass(frozen=True)
class Cluster:
    """A Dask scheduler's workers; see connected()."""

    client: Client
    address: str
    name: str

    @property
    def width(self) -> int:
        """The scheduler does the queueing, and workers may join."""
        return 10_000

    @property
    def lost(self) -> str:
        return f"{self.address}: the Dask scheduler is gone; run the same command again to go on"

    @property
    def task(self) -> Callable[[Job], Result]:
        return partial(solve_with, self.name)

    @property
    def workers(self) -> int:
        return len(self.client.scheduler_info(n_workers=-1)["workers"])

    @contextmanager
    def executor(self) -> Iterator[Executor]:
        executor = self.client.get_executor(pure=False)
        try:
            yield executor
        finally:
            executor.shutdown(wait=False)


@contextmanager
def connected(address: str, code: Code) -> Iterator[Cluster]:
    """The cluster of a scheduler, its workers prepared. Raises PoolError."""
    try:
        get_address_host(address)
        client = Client(address, timeout=_PATIENCE, set_as_default=False)
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
                f"--scheduler {address}: a worker cannot take the arm's code ({type(error).__name__}: {error}); "
                "every worker needs tendon installed and a machine of the same kind as this one"
            ) from error
        yield Cluster(client, address, plugin.name)
