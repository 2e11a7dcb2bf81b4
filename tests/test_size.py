"""The house does not grow: lines and modules of product and tests are at most what .ci/size.toml states."""

from __future__ import annotations

import tomllib
from collections import Counter
from pathlib import Path

import pytest

pytestmark = pytest.mark.cheap
ROOT = Path(__file__).resolve().parent.parent
ROOTS = {"product": ("symbolic", "codegen", "runtime", ".site", ".ci"), "tests": ("tests",)}
MADE = {"__pycache__", "built", ".cache"}
PYTHON, OTHER = {".py", ".pyi"}, {".c", ".cpp", ".css", ".h", ".hpp", ".j2", ".js"}


@pytest.mark.parametrize("part", ROOTS)
def test_size(part: str) -> None:
    """Neither larger than stated, nor so much smaller that the statement could be lowered by a hundred lines."""
    stated = tomllib.loads((ROOT / ".ci" / "size.toml").read_text())[part]
    found: Counter[str] = Counter()
    for path in (p for root in ROOTS[part] for p in (ROOT / root).rglob("*")):
        if path.suffix in PYTHON | OTHER and not MADE & set(path.relative_to(ROOT).parts):
            found["python" if path.suffix in PYTHON else "other"] += len(path.read_bytes().splitlines())
            found["modules"] += path.suffix == ".py"
    assert set(stated) == set(found)
    for what, most in stated.items():
        assert found[what] <= most, f"{part}: {found[what]} {what}, {found[what] - most} more than .ci/size.toml allows"
        assert found[what] > most - 100, f"{part}: {found[what]} {what}; lower {most} in .ci/size.toml"
