"""Variants of a test that `make test` leaves out, beside those that it runs."""

from __future__ import annotations

from typing import Any

import pytest


def slow(value: Any) -> Any:
    """A parameter of a test whose variant is a slow test."""
    return pytest.param(value, marks=pytest.mark.slow)
