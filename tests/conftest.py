"""Shared fixtures: compiled code goes into a cache of the tests' own, beside them."""

from __future__ import annotations

import fcntl
import json
import os
import sys
import threading

# As the command line does: small matrices, and several of us may run at once.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from bench_arm import BENCH
from hypothesis import settings

from codegen import prepare
from runtime import files
from runtime.model import loader
from runtime.workspace.source import Source
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm

# Bytecode is kept, whatever the environment says: else each process compiles all modules, and rewrites all tests.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# On a busy machine an example takes as long as it takes.
# A run says the same on every machine; `make test-all` draws new examples.
settings.register_profile("same", deadline=None, derandomize=True)
settings.register_profile("new", deadline=None)
settings.load_profile("same")

ROOT = Path(__file__).resolve().parent.parent
ARMS = ROOT / "symbolic" / "arms"
KEPT = ROOT / "tests" / ".cache"
DURATIONS = KEPT / "durations.json"
"""Seconds each test took in the last run, by node id: they order the next one."""
DEAR = 1.0
"""Tests and groups of at least this many seconds begin first, the longest ahead, so that none is alone at the end."""


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Dear units first. A unit is what one process runs: a group of tests that share a dear fixture, else one test."""
    try:
        known = json.loads(DURATIONS.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        known = {}
    seconds: Counter[str] = Counter()
    for item in items:
        seconds[_unit(item)] += known.get(item.nodeid, 0.0)
    items.sort(key=lambda item: -seconds[_unit(item)] if seconds[_unit(item)] >= DEAR else 0.0)
    for item in items:
        # pytest-xdist 3.8 appends the group to `_nodeid`, which pytest 9.2 no longer reads.
        grouped, own = getattr(item, "_nodeid", None), getattr(item, "_id", None)
        if isinstance(grouped, str) and own is not None:
            item._id = type(own).parse(grouped)  # type: ignore[attr-defined]


def _unit(item: pytest.Item) -> str:
    group = item.get_closest_marker("xdist_group")
    return str(group.args[0]) if group else item.nodeid


class Stopwatch:
    """Keeps how long each test took, set-up included, in the process that hands out the tests."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid.partition("@")[0]] += report.duration

    def pytest_sessionfinish(self) -> None:
        KEPT.mkdir(mode=0o700, exist_ok=True)
        try:
            before = json.loads(DURATIONS.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            before = {}
        new = {name: round(spent, 2) for name, spent in sorted((before | self.seconds).items())}
        files.replace(DURATIONS, json.dumps(new, indent=0).encode())


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Stopwatch())


@pytest.fixture(scope="session", autouse=True)
def cache() -> Iterator[Path]:
    """The folder of compiled arms and firmware, kept between runs and shared by all processes; never the user's own."""
    before = os.environ.get("TENDON_CACHE")
    KEPT.mkdir(mode=0o700, exist_ok=True)
    os.environ["TENDON_CACHE"] = str(KEPT)
    yield KEPT
    if before is None:
        del os.environ["TENDON_CACHE"]
    else:
        os.environ["TENDON_CACHE"] = before


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Of the test's own, in which nothing is compiled yet."""
    monkeypatch.setenv("TENDON_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@contextmanager
def alone(cache: Path) -> Iterator[None]:
    """One process at a time: the next one finds in the cache what the first one has made there."""
    with (cache / ".lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@pytest.fixture
def lock_refused(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Set once somebody in this process waits for the lock of a file that another holds."""
    waiting, lock = threading.Event(), files._lock

    def watched(path: Path) -> int | None:
        held = lock(path)
        if held is None:
            waiting.set()
        return held

    monkeypatch.setattr(files, "_lock", watched)
    return waiting


@pytest.fixture(scope="session")
def vishard4() -> Arm:
    """The arm of the paper."""
    return reader.load(ARMS / "vishard4.toml")


@pytest.fixture(scope="session")
def library(cache: Path) -> loader.Library:
    """The compiled library of effects."""
    with alone(cache):
        return loader.Library(prepare.prepare_effects())


@pytest.fixture(scope="session")
def model(vishard4: Arm, library: loader.Library, cache: Path) -> loader.Model:
    """The compiled arm of the paper."""
    with alone(cache):
        return loader.Model(prepare.prepare_arm(vishard4), library)


@pytest.fixture(scope="session")
def bench(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Source:  # noqa: ARG001 - where it is compiled
    """The arm of one joint of bench_arm.py."""
    path = tmp_path_factory.mktemp("bench") / "bench.toml"
    path.write_text(BENCH)
    return Source.read(path, None)


@pytest.fixture(scope="session")
def arm(bench: Source) -> loader.Model:
    return bench.compiled.model()
