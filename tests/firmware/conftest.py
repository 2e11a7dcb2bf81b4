"""What the tests of boards share: the bench of one joint, derived and compiled once."""

from __future__ import annotations

from pathlib import Path

import pytest
from bench_arm import BENCH

from runtime.model.loader import Model
from runtime.workspace import Source


@pytest.fixture(scope="session")
def bench(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Source:  # noqa: ARG001 - where it is compiled
    path = tmp_path_factory.mktemp("bench") / "bench.toml"
    path.write_text(BENCH)
    return Source.read(path, None)


@pytest.fixture(scope="session")
def arm(bench: Source) -> Model:
    return bench.model()
