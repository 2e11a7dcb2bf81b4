"""Shared fixtures: compiled code goes into a cache of the tests' own, beside them."""

from __future__ import annotations

import fcntl
import os

# As the command line does: small matrices, and several of us may run at once.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import settings

from codegen import prepare
from runtime.model import loader
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm

# On a busy machine an example takes as long as it takes.
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")

ROOT = Path(__file__).resolve().parent.parent
ARMS = ROOT / "symbolic" / "arms"
KEPT = ROOT / "tests" / ".cache"
LONGEST = ("test_guides.py", "test_study.py")
"""Files that begin first, so that no process is alone with one of them at the end."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.name not in LONGEST)


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


@contextmanager
def alone(cache: Path) -> Iterator[None]:
    """One process at a time: the next one finds in the cache what the first one has made there."""
    with (cache / ".lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@pytest.fixture(scope="session")
def vishard4() -> Arm:
    """The arm of the paper."""
    return reader.load(ARMS / "vishard4.toml")


@pytest.fixture(scope="session")
def library(cache: Path) -> loader.Library:
    """The compiled library of effects."""
    with alone(cache):
        return loader.load_library(prepare.prepare_effects())


@pytest.fixture(scope="session")
def model(vishard4: Arm, library: loader.Library, cache: Path) -> loader.Model:
    """The compiled arm of the paper."""
    with alone(cache):
        return loader.load_model(prepare.prepare_arm(vishard4), library)
