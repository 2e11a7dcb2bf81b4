"""What the tests of the firmware share: the machine of a module's own ARM."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from talk import Talk

from codegen import prepare
from symbolic.effects import LIBRARY


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
