"""Compiles generated C into shared libraries in the user's cache.

A cache entry is named by a hash of its inputs and holds a digest of its files. Code is loaded from the cache, so only
its user may write to it, and a damaged entry is replaced.
"""

from __future__ import annotations

import compileall
import contextlib
import functools
import hashlib
import importlib.util
import os
import platform
import py_compile
import secrets
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from codegen import disk

DIGEST = ".sha256"
"""The file in every entry that lists its files with their digests, in the format of sha256sum."""
_MAKING = ".making-"


class BuildError(RuntimeError):
    """No compiler, a failed compilation or a cache that cannot be written; the message says what to do."""


def cache_directory() -> Path:
    """$TENDON_CACHE, else $XDG_CACHE_HOME/tendon, else ~/.cache/tendon, else a temporary folder of the user.

    The folder exists, and no other user can write to it. Raises BuildError.
    """
    if own := os.environ.get("TENDON_CACHE"):
        return _of_this_user(Path(own))
    try:
        usual = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "tendon"
        usual.parent.mkdir(parents=True, exist_ok=True)
        usual.mkdir(mode=0o700, exist_ok=True)
        foreign = usual.stat().st_uid != os.getuid()
    except (OSError, RuntimeError):  # RuntimeError: a user without a home
        return _temporary()
    return _temporary() if foreign or not os.access(usual, os.W_OK | os.X_OK) else _of_this_user(usual)


def _temporary() -> Path:
    folder = Path(tempfile.gettempdir()) / f"tendon-{os.getuid()}"
    if folder.is_symlink():
        raise _refused(folder, "it is not this user's alone")
    return _of_this_user(folder)


def _of_this_user(folder: Path) -> Path:
    """The folder, created if it is missing. Raises BuildError if another user owns it or may write to it."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        facts = folder.stat()
    except OSError as error:
        raise _refused(folder, error.strerror or str(error)) from error
    if not stat.S_ISDIR(facts.st_mode):
        raise _refused(folder, "it is no folder")
    if facts.st_uid != os.getuid():
        raise _refused(folder, "it is not this user's alone, but another's")
    if facts.st_mode & 0o022:
        raise BuildError(
            f"the cache {folder}: others may write to it, and code is loaded from there: it is not this user's alone; "
            "set TENDON_CACHE to a folder of your own, or delete it"
        )
    return folder


def _refused(folder: Path, reason: str) -> BuildError:
    return BuildError(f"cannot write the cache {folder}: {reason}; set TENDON_CACHE to a folder that can be written")


def entry(name: str, fill: Callable[[Path], None]) -> Path:
    """The cache's directory `name`, which `fill` fills if it is missing or damaged. Raises BuildError.

    Other processes see the complete entry or none.
    """
    final = cache_directory() / name
    if is_whole(final):
        return final
    try:
        with disk.scratch(final.parent, _MAKING) as scratch:
            fill(scratch)
            _seal(scratch)
            with disk.alone_in(final.parent):
                # An entry that another process has made in the meantime is the same.
                if not is_whole(final):
                    _remove(final)
                    scratch.rename(final)
                    _to_disk(final.parent)
    except OSError as error:
        raise _refused(final.parent, error.strerror or str(error)) from error
    return final


def is_whole(folder: Path) -> bool:
    """Whether all files of an entry exist and match their digests."""
    try:
        if folder.is_symlink() or folder.stat().st_uid != os.getuid():
            return False
        lines = (folder / DIGEST).read_text(encoding="utf-8").splitlines()
        stated = [line.partition("  ") for line in lines]
        return bool(stated) and all(_digest(folder / path) == digest for digest, _, path in stated)
    except (OSError, ValueError):
        return False


def _seal(folder: Path) -> None:
    """Compiles an entry's modules to bytecode, writes the digests, and flushes all files to the disk."""
    unchecked = py_compile.PycInvalidationMode.UNCHECKED_HASH
    compileall.compile_dir(folder, quiet=2, invalidation_mode=unchecked)
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    lines = [f"{_digest(path)}  {path.relative_to(folder).as_posix()}\n" for path in paths]
    (folder / DIGEST).write_text("".join(lines), encoding="utf-8")
    for path in (*paths, folder / DIGEST, folder):
        _to_disk(path)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _remove(damaged: Path) -> None:
    """Removes whatever stands in an entry's place, first by renaming it; it may be any kind of file."""
    aside = damaged.with_name(f"{_MAKING}{secrets.token_hex(4)}")
    with contextlib.suppress(FileNotFoundError):
        damaged.rename(aside)
        if aside.is_dir() and not aside.is_symlink():
            shutil.rmtree(aside, ignore_errors=True)
        else:
            aside.unlink()


FLAGS = (
    *("-std=c99", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"),
    *("-fPIC", "-shared"),
)
"""Without contraction, -march=native and -ffast-math, so that every compiler gives the same bits."""
LOOPS, STRAIGHT = "-O3", "-O1"
"""Optimisation of loops, such as the effects along samples, and of straight-line code, such as an arm's functions. For
the latter a higher level takes half as long again for code that is 0 to 4 % faster."""
_GCC = ("-fschedule-insns", "-fsched-pressure", "-ftree-loop-vectorize", "--param", "vect-epilogues-nomask=0")
"""gcc orders straight-line code before register allocation, as clang does by default; vectors are up to a third faster.
Loops are vectorised at every level, but not their remainders, which would take a third of the time without a gain."""
_OF_FOUR, _OF_EIGHT = ("avx2",), ("avx512f", "avx512dq", "avx512vl")
"""Processor features for vectors of four and of eight doubles. AVX-512 has a fused multiply-add, which gcc 12 uses in
spite of -ffp-contract=off when it vectorises loops, but not for explicit vectors as in an arm's functions. AVX2 has
none."""
_GCC_OF_EIGHT = ("-fno-tree-ter", "--param", "sched-pressure-algorithm=2")
"""With AVX-512's 32 registers, scheduling for latency is 3 % faster; with 16 registers it would be a fifth slower."""
WARNINGS = (
    *("-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-Wdouble-promotion", "-Wfloat-conversion"),
    *("-Wshadow", "-Wundef", "-Wstrict-prototypes", "-Wmissing-prototypes", "-Wvla", "-Werror"),
)
"""Warnings common in embedded development; the generated code compiles without any."""


def compiler() -> tuple[str, ...]:
    """The command of the C compiler: $CC, cc, gcc, clang, or the ziglang wheel. Raises BuildError without one."""
    if named := os.environ.get("CC"):
        command = shlex.split(named)
        if not command or shutil.which(command[0]) is None:
            raise BuildError(
                f'the C compiler "{named}" of the environment variable CC is not there; unset or correct CC'
            )
        return tuple(command)
    for name in ("cc", "gcc", "clang"):
        if found := shutil.which(name):
            return (found,)
    if importlib.util.find_spec("ziglang") is not None:
        return (sys.executable, "-m", "ziglang", "cc")
    raise BuildError(
        "no C compiler found (looked for CC, cc, gcc, clang and the ziglang wheel); "
        f"install one, for example gcc, or run: {sys.executable} -m pip install ziglang"
    )


@functools.cache
def vector_flags(level: str = STRAIGHT) -> tuple[str, ...]:
    """Flags for the widest vectors of this processor that keep the bits of code compiled at `level`.

    Each doubling halves the time of a sample in a batch.
    """
    gcc = "gcc" in Path(shutil.which(compiler()[0]) or "").resolve().name
    scheduled = _GCC if gcc else ()
    if platform.machine() not in ("x86_64", "AMD64") or "ziglang" in compiler():
        return scheduled
    try:
        flags = next(line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("flags"))
    except (OSError, StopIteration):
        return scheduled
    has = set(flags.split())
    wider = (_OF_EIGHT, _OF_FOUR) if level == STRAIGHT else (_OF_FOUR,)
    widest = next((names for names in wider if has.issuperset(names)), ())
    roomy = _GCC_OF_EIGHT if gcc and widest == _OF_EIGHT else ()
    return (*(f"-m{name}" for name in widest), *scheduled, *roomy)


@functools.cache
def identity(command: tuple[str, ...]) -> str:
    """Cache key: the compiler's file and the processor's family."""
    path = Path(shutil.which(command[0]) or command[0]).resolve()
    status = path.stat()
    return f"{command} {path} {status.st_size} {status.st_mtime_ns} {platform.machine()} {platform.system()}"


def key(*parts: str) -> str:
    """Name of a cache entry: a hash of `parts`, of the host's compiler and of its flags."""
    digest = hashlib.sha256()
    for part in (*parts, identity(compiler()), *FLAGS, *vector_flags()):
        digest.update(f"{len(part)}:{part}".encode())
    return digest.hexdigest()[:32]


def run(command: Sequence[str], directory: Path, name: str) -> str:
    """The output of a compiler, called `name` in messages. Raises BuildError with its first error."""
    zig = str(cache_directory() / "zig")
    environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": zig, "ZIG_LOCAL_CACHE_DIR": zig}
    try:
        result = subprocess.run(command, cwd=directory, capture_output=True, text=True, env=environment, check=False)
    except OSError as error:
        raise BuildError(f"cannot run {name}: {error.strerror}") from error
    if result.returncode:
        lines = [line.strip() for line in result.stderr.splitlines() if line.strip()]
        first = next((line for line in lines if "error" in line), lines[0] if lines else "no message")
        raise BuildError(f"{name} failed (exit {result.returncode}): {first[:300]}")
    return result.stdout


def compile_shared(directory: Path, sources: list[str], output: str, level: str, macros: Sequence[str] = ()) -> None:
    """Compiles `sources` of `directory` into the shared library `output` there. level: LOOPS or STRAIGHT; macros:
    NAME=VALUE."""
    command = [
        *compiler(),
        level,
        *(f"-D{macro}" for macro in macros),
        *FLAGS,
        *vector_flags(level),
        *sources,
        "-o",
        output,
        "-lm",
    ]
    run(command, directory, f"the C compiler {' '.join(compiler())}")


def shared_library(files: Mapping[str, str], name: str, level: str = LOOPS, macros: Sequence[str] = ()) -> Path:
    """The shared library of all `.c` files among `files`, from the cache or newly compiled."""
    parts = [part for item in sorted(files.items()) for part in item]
    sources = sorted(path for path in files if path.endswith(".c"))

    def fill(directory: Path) -> None:
        for path, text in files.items():
            (directory / path).write_text(text, encoding="utf-8")
        compile_shared(directory, sources, f"{name}.so", level, macros)

    return entry(f"{name}-{key(*parts, level, *macros)}", fill) / f"{name}.so"
