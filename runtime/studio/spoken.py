"""Messages of a command line as the page says them."""

from __future__ import annotations

import re
import sys


def spoken(message: str) -> str:
    """A message without what one would type: the page has controls for that."""
    named = re.sub(r"--map (\w+):", r"\1:", message)
    plain = re.sub(r" \([^()]*--[^()]*\)", "", named)
    return "; ".join(part for part in plain.split("; ") if "--" not in part and sys.executable not in part)
