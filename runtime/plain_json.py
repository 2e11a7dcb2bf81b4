"""Results as plain JSON values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec


def plain(value: Any) -> Any:
    """A value as JSON: structs become objects without their unset keys, NaN and infinity null."""
    if isinstance(value, msgspec.Struct):
        keys = zip(value.__struct_encode_fields__, value.__struct_fields__, strict=True)
        pairs = ((encoded, getattr(value, name)) for encoded, name in keys)
        config = value.__struct_config__
        kind = {} if config.tag is None else {config.tag_field: config.tag}
        return {**kind, **{encoded: plain(v) for encoded, v in pairs if v is not msgspec.UNSET}}
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
