"""Compiles generated C into shared libraries, kept in the user's cache.

A cache entry is named by a hash of its inputs and holds a digest of its files. Code is loaded from there, so the folder
belongs to the user alone, and a damaged entry is made again.
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
from collections.abc import Callable, Mapping
from pathlib import Path

from codegen import disk

DIGEST = ".sha256"
"""In every entry, its files with their digests, as sha256sum writes them."""
_MAKING = ".making-"


class BuildError(RuntimeError):
    """No compiler, or it refused, or nothing can be kept; the message says what to do."""


def cache_directory() -> Path:
    """$TENDON_CACHE, else $XDG_CACHE_HOME/tendon, else ~/.cache/tendon; where nothing can be written there, a folder of
    the user's own among the temporary ones. It is there, and no other user can write to it. Raises BuildError."""
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
    """The folder, made if it is not there. Raises BuildError where others own it or may write to it."""
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
    """The cache's directory `name`, filled by `fill` where it is not there or not whole; other processes see it whole
    or not at all. Raises BuildError."""
    final = cache_directory() / name
    if is_whole(final):
        return final
    try:
        with disk.scratch(final.parent, _MAKING) as scratch:
            fill(scratch)
            _seal(scratch)
            with disk.alone_in(final.parent):
                # Where another process was first, what it made is the same.
                if not is_whole(final):
                    _remove(final)
                    scratch.rename(final)
                    _to_disk(final.parent)
    except OSError as error:
        raise _refused(final.parent, error.strerror or str(error)) from error
    return final


def is_whole(folder: Path) -> bool:
    """Whether an entry has every file that was put into it, as it was put there."""
    try:
        if folder.is_symlink() or folder.stat().st_uid != os.getuid():
            return False
        lines = (folder / DIGEST).read_text(encoding="utf-8").splitlines()
        stated = [line.partition("  ") for line in lines]
        return bool(stated) and all(_digest(folder / path) == digest for digest, _, path in stated)
    except (OSError, ValueError):
        return False


def _seal(folder: Path) -> None:
    """Writes down what an entry holds, with the bytecode of its modules; all of it is on the disk when this returns."""
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
    """What stands in an entry's place goes at once: it may be any kind of file."""
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
"""-ffp-contract=off: the same bits from every compiler; no -march=native and no -ffast-math for the same reason."""
LOOPS, STRAIGHT = "-O3", "-O1"
"""How much of its time a compiler spends on a source of loops, as those of the effects along samples are, and on one of
hundreds of operations in a row, as an arm's functions are: for what it looks for beyond, it takes half as long again,
and the code is 0 to 4 % faster."""
_GCC = ("-fschedule-insns", "-fsched-pressure", "-ftree-loop-vectorize", "--param", "vect-epilogues-nomask=0")
"""Hundreds of operations in a row: gcc orders them before it hands out registers, as clang does by itself, which makes
vectors up to a third faster. An arm's few loops become vectors at any level. And gcc would vectorise what is left of a
loop once more, half as wide: a third of its time, for no measurable speed."""
_OF_FOUR, _OF_EIGHT = ("avx2",), ("avx512f", "avx512dq", "avx512vl")
"""What a processor has for vectors of four and of eight doubles. AVX-512 brings a fused multiply-add. Where gcc 12
makes the vectors itself, it takes that for neighbouring sums and differences in spite of -ffp-contract=off; where they
stand in the source, as in an arm's functions, it does not. AVX2 brings none."""
_GCC_OF_EIGHT = ("-fno-tree-ter", "--param", "sched-pressure-algorithm=2")
"""AVX-512 has 32 registers, enough for an order that looks at time more than at room, and at every statement alone:
3 % faster. With 16 registers that would be a fifth slower."""
WARNINGS = (
    *("-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-Wdouble-promotion", "-Wfloat-conversion"),
    *("-Wshadow", "-Wundef", "-Wstrict-prototypes", "-Wmissing-prototypes", "-Wvla", "-Werror"),
)
"""What embedded developers compile with; the generated code passes, a test holds it to that."""


def compiler() -> tuple[str, ...]:
    """The command of a C compiler: $CC, cc, gcc, clang, or the ziglang wheel. BuildError says what to install."""
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
    """The widest vectors of this processor that keep the bits of a level's sources: a sample of a batch takes half the
    time with each doubling."""
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
def _identity(command: tuple[str, ...]) -> str:
    """What would change the machine code besides the sources: the compiler and the processor's family."""
    path = Path(shutil.which(command[0]) or command[0]).resolve()
    status = path.stat()
    return f"{command} {path} {status.st_size} {status.st_mtime_ns} {platform.machine()} {platform.system()}"


def key(*parts: str) -> str:
    """Name of a cache entry: a hash of everything that decides its content, the compiler included."""
    digest = hashlib.sha256()
    for part in (*parts, _identity(compiler()), *FLAGS, *vector_flags()):
        digest.update(f"{len(part)}:{part}".encode())
    return digest.hexdigest()[:32]


def compile_shared(directory: Path, sources: list[str], output: str, level: str) -> None:
    """Compile `sources` of `directory` into the shared library `output` there. `level`: LOOPS or STRAIGHT."""
    command = [*compiler(), level, *FLAGS, *vector_flags(level), *sources, "-o", output, "-lm"]
    environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": str(cache_directory() / "zig")}
    try:
        result = subprocess.run(command, cwd=directory, capture_output=True, text=True, env=environment, check=False)
    except OSError as error:
        raise BuildError(f"cannot run the C compiler {command[0]}: {error.strerror}") from error
    if result.returncode:
        lines = [line.strip() for line in result.stderr.splitlines() if line.strip()]
        first = next((line for line in lines if "error" in line), lines[0] if lines else "no message")
        raise BuildError(f"the C compiler {' '.join(compiler())} failed (exit {result.returncode}): {first[:300]}")


def shared_library(files: Mapping[str, str], name: str, level: str = LOOPS) -> Path:
    """The shared library of all `.c` files among `files`, from the cache or freshly compiled."""
    parts = [part for item in sorted(files.items()) for part in item]
    sources = sorted(path for path in files if path.endswith(".c"))

    def fill(directory: Path) -> None:
        for path, text in files.items():
            (directory / path).write_text(text, encoding="utf-8")
        compile_shared(directory, sources, f"{name}.so", level)

    return entry(f"{name}-{key(*parts, level)}", fill) / f"{name}.so"
