"""C structs from outside: ctypes structures made from the description that was generated with them."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any

_SCALARS: dict[str, Any] = {"float": ctypes.c_float, "int32_t": ctypes.c_int32, "uint32_t": ctypes.c_uint32}


def structures(records: Sequence[Mapping[str, Any]]) -> dict[str, type[ctypes.Structure]]:
    """By name, in the order of the description: each may hold earlier ones."""
    found: dict[str, type[ctypes.Structure]] = {}
    for record in records:
        fields = [(field["name"], _type(field, found)) for field in record["fields"]]
        found[record["name"]] = type(record["name"], (ctypes.Structure,), {"_fields_": fields})
    return found


def _type(field: Mapping[str, Any], known: Mapping[str, Any]) -> Any:
    kind = _SCALARS.get(field["type"]) or known[field["type"]]
    if field["pointer"]:
        return ctypes.POINTER(kind)
    return kind if field["count"] is None else kind * field["count"]
