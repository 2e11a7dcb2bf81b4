"""What the tests of boards share: the bench of one joint, derived and compiled once, and the machine of a module's
own ARM."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from bench_arm import BENCH
from talk import Talk

from codegen import prepare
from runtime.model.loader import Model
from runtime.workspace import Source
from symbolic.effects import LIBRARY


@pytest.fixture(scope="session")
def bench(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Source:  # noqa: ARG001 - where it is compiled
    path = tmp_path_factory.mktemp("bench") / "bench.toml"
    path.write_text(BENCH)
    return Source.read(path, None)


@pytest.fixture(scope="session")
def arm(bench: Source) -> Model:
    return bench.model()


@pytest.fixture(scope="module")
def directory(request: pytest.FixtureRequest) -> Path:
    """Of a module's ARM, compiled for this computer."""
    return prepare.prepare_firmware(request.module.ARM, LIBRARY)


@pytest.fixture
def talk(request: pytest.FixtureRequest, directory: Path) -> Talk:
    return Talk(directory, request.module.ARM.name)


@pytest.fixture(scope="module")
def table(directory: Path) -> dict[str, Any]:
    """Its protocol.json."""
    found: dict[str, Any] = json.loads((directory / "protocol.json").read_text())
    return found
