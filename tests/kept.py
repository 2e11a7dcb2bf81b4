"""What a function returned, computed once and kept beside the tests by all that it depends on.

The name of a kept result is a hash of the code of the function's module and of every module of ours that this one
imports, of the arguments, of the compiled arms among them, and of the libraries' versions. So what rests on a changed
source, argument or arm is computed anew. Processes share what is kept: one computes, under a lock, and the others wait.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import io
import os
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import cache, cached_property
from importlib.metadata import version
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar

import numpy as np

from runtime import files
from runtime.model.loader import Library, Model
from runtime.workspace.source import CompiledArm, Source
from tests import sources

Result = TypeVar("Result")

CACHE = sources.ROOT / "tests" / ".cache"
FOLDER = CACHE / "bank"
MOST = 3_000_000_000
"""Bytes; beyond that, what was not used for longest goes."""


def kept(function: Callable[..., Result], *arguments: Any, **options: Any) -> Result:
    """What `function` returns for these arguments; each call has a copy of its own.

    function    of a module of ours, by its name there; what it raises is not kept
    arguments   numbers, text, arrays, dataclasses, models, and collections of them
    """
    path = FOLDER / f"{function.__name__}-{key(function, *arguments, **options)}"
    if not path.exists():
        with _alone(path):
            if not path.exists():
                files.replace(path, _pickled(function(*arguments, **options)))
                _forget_oldest(but=path)
    os.utime(path)
    found: Result = _Reader(path.read_bytes()).load()
    return found


def key(function: Callable[..., Any], *arguments: Any, **options: Any) -> str:
    """The hash of all that a call depends on."""
    found = hashlib.sha256(_code(function.__module__).encode())
    for part in _parts((function.__qualname__, arguments, options)):
        found.update(part + b"\0")
    return found.hexdigest()[:32]


@cache
def _code(module: str) -> str:
    """Hash of a module of ours with all it imports, of files that are no Python beside them, and of the libraries."""
    names = sorted({module, *sources.reached(module)})
    found = hashlib.sha256(sys.version.encode())
    for library in ("numpy", "scipy", "casadi", "sympy"):
        found.update(version(library).encode())
    for name in names:
        found.update(sources.code(name).encode())
    for path in _beside(names):
        found.update(path.read_bytes())
    return found.hexdigest()


def _beside(names: Iterable[str]) -> list[Path]:
    """C of the plants beside modules of the tests, and templates where code is generated on the way."""
    folders = {sources.everything()[name].parent for name in names if name.startswith("tests.")}
    found = [path for folder in folders for path in folder.iterdir() if path.suffix in (".c", ".h")]
    if any(name.startswith("codegen.") for name in names):
        found += [path for path in (sources.ROOT / "codegen").rglob("templates/**/*") if path.is_file()]
    return sorted(found)


def _parts(value: Any) -> Iterator[bytes]:
    """All that tells one argument from another; of a path its name alone, so that any folder will do."""
    yield type(value).__qualname__.encode()
    if isinstance(value, np.ndarray):
        yield from (value.dtype.str.encode(), repr(value.shape).encode(), np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Model):
        yield from _parts((value.directory, value.library, repr([getattr(value, name) for name in STATED])))
    elif isinstance(value, Library):
        yield value.directory.name.encode()
    elif isinstance(value, Source):
        yield from _parts((value.path, value.text, value.compiled.model()))
    elif isinstance(value, CompiledArm):
        yield from _parts(value.model())
    elif isinstance(value, Path):
        yield value.name.encode()
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            yield field.name.encode()
            yield from _parts(getattr(value, field.name))
    elif isinstance(value, Mapping):
        yield from _parts(list(value.items()))
    elif isinstance(value, FunctionType):
        yield f"{value.__module__}.{value.__qualname__}".encode()
    elif isinstance(value, set | frozenset):
        yield from _parts(sorted(value))
    elif isinstance(value, list | tuple):
        yield str(len(value)).encode()
        for one in value:
            yield from _parts(one)
    else:
        assert isinstance(value, str | bytes | int | float | slice | None), f"{value!r} has no name to keep results by"
        yield repr(value).encode()


STATED = ("joints", "effects", "contact")
"""What a copy of a model may state otherwise than its folder."""


class _Writer(pickle.Pickler):
    """Leaves out cached properties, which are computed again; compiled arms and effects by their folders, with what a
    copy of an arm states otherwise."""

    def persistent_id(self, value: Any) -> Any:
        if isinstance(value, Model):
            return value.directory.name, value.library.directory.name, {name: getattr(value, name) for name in STATED}
        return value.directory.name if isinstance(value, Library) else None

    def reducer_override(self, value: Any) -> Any:
        if isinstance(value, type) or not type(value).__module__.startswith(("runtime.", "tests.")):
            return NotImplemented
        again = vars(value).keys() & _cached(type(value)) if hasattr(value, "__dict__") else ()
        if not again:
            return NotImplemented
        make, arguments, state, *others = value.__reduce_ex__(pickle.HIGHEST_PROTOCOL)
        return make, arguments, {name: x for name, x in state.items() if name not in again}, *others


class _Reader(pickle.Unpickler):
    def __init__(self, written: bytes) -> None:
        super().__init__(io.BytesIO(written))
        self._models: dict[str, Model] = {}

    def persistent_load(self, name: Any) -> Any:
        if isinstance(name, str):
            return _library(CACHE / name)
        key = repr(name)
        if key not in self._models:
            self._models[key] = Model(CACHE / name[0], _library(CACHE / name[1]))
            vars(self._models[key]).update(name[2])
        return self._models[key]


_library = cache(Library)


@cache
def _cached(kind: type) -> frozenset[str]:
    """Names of a class's cached properties."""
    return frozenset(n for c in kind.__mro__ for n, value in vars(c).items() if isinstance(value, cached_property))


def _pickled(value: Any) -> bytes:
    written = io.BytesIO()
    _Writer(written, pickle.HIGHEST_PROTOCOL).dump(value)
    return written.getvalue()


_being_made: set[Path] = set()


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    FOLDER.mkdir(mode=0o700, parents=True, exist_ok=True)
    assert path not in _being_made, f"{path.name} asks for itself"
    _being_made.add(path)
    with path.with_name(f".{path.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            yield
        finally:
            _being_made.remove(path)
            Path(lock.name).unlink(missing_ok=True)


def _forget_oldest(but: Path) -> None:
    """Keep what was used last, up to MOST bytes, and `but` whatever its size."""
    left = MOST
    for _, size, path in sorted(((s.st_mtime, s.st_size, p) for p, s in _stats()), reverse=True):
        left -= size
        if left < 0 and path != but:
            path.unlink(missing_ok=True)


def _stats() -> list[tuple[Path, os.stat_result]]:
    found = []
    with os.scandir(FOLDER) as entries:
        for entry in (e for e in entries if not e.name.startswith(".")):
            # Another process may have removed it since.
            with contextlib.suppress(FileNotFoundError):
                found.append((Path(entry.path), entry.stat()))
    return found
