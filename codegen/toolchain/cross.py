"""Cross-compilers for the controller: which there are, their flags, and what they make of the sources."""

from __future__ import annotations

import functools
import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from codegen.toolchain import stack
from codegen.toolchain.build import WARNINGS, BuildError, cache_directory
from codegen.toolchain.stack import Elf
from symbolic.model_file.checks import quote

LANGUAGE = ("-std=c99", "-pedantic", "-ffreestanding")
ARITHMETIC = ("-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
"""The same bits from every compiler, and a square root that is one instruction."""
SECTIONS = ("-ffunction-sections", "-fdata-sections")
FAST, SMALL = "-O2", "-Os"
"""For what runs in every control step, and for the rest."""
_LINK = ("--gc-sections", "--build-id=none", "--fatal-warnings", "--emit-relocs")
"""Of both linkers. The relocations show which function calls which (stack.py)."""
FORBIDDEN = (
    "__aeabi_d",
    "__aeabi_f2d",
    "__aeabi_i2d",
    "__aeabi_ui2d",
    "__aeabi_l2d",
    "malloc",
    "free",
    "printf",
    "_sbrk",
)
"""How the names of functions begin that have no place in the image: double precision, a heap, text."""


@dataclass(frozen=True)
class Target:
    """A processor. gcc, zig: the compilers' flags for it; machine: QEMU's name of a board that has it."""

    name: str
    meaning: str
    gcc: tuple[str, ...]
    zig: tuple[str, ...]
    machine: str


def _cortex(name: str, meaning: str, cpu: str, fpu: str, zig: str, machine: str, *tuning: str) -> Target:
    return Target(
        name,
        meaning,
        (f"-mcpu={cpu}", "-mthumb", f"-mfpu={fpu}", "-mfloat-abi=hard", *tuning),
        ("-target", "thumb-freestanding-eabihf", f"-mcpu={zig}"),
        machine,
    )


# Out of flash an M4 fetches straight-line code more slowly than it runs it. VMLA is a product and a sum in one
# instruction, both rounded, so it gives the same bits; it takes a cycle more than the two do at their best. Left to
# themselves the compilers take the two: zig is told that VMLA is not slow, gcc that it costs what it does elsewhere.
_CHAINED_ZIG, _CHAINED_GCC = "-slowfpvmlx", "-mtune=cortex-a5"

TARGETS = {
    target.name: target
    for target in (
        _cortex(
            "cortex-m4f",
            "Arm Cortex-M4 with its single-precision unit",
            *("cortex-m4", "fpv4-sp-d16", f"cortex_m4+vfp4d16sp{_CHAINED_ZIG}", "mps2-an386", _CHAINED_GCC),
        ),
        _cortex(
            "cortex-m7",
            "Arm Cortex-M7 with a single-precision unit",
            *("cortex-m7", "fpv5-sp-d16", "cortex_m7+fp_armv8d16sp", "mps2-an500"),
        ),
    )
}


HOST = "host"
"""The target that is this computer."""


def named_target(name: str) -> Target:
    """A processor by its name. Raises BuildError."""
    if name not in TARGETS:
        raise BuildError(f"--target {quote(name)}: no such target; there are {', '.join(TARGETS)} and {HOST}")
    return TARGETS[name]


@dataclass(frozen=True)
class Toolchain:
    """kind: gcc or zig, by whose rules the flags are; why: how it came to be chosen."""

    kind: str
    compile: tuple[str, ...]
    link: tuple[str, ...]
    why: str

    @property
    def version(self) -> str:
        """As the compiler says it, for example "clang version 22.1.8 (ziglang 0.17.1)"."""
        wheel = f" (ziglang {version('ziglang')})" if "ziglang" in self.compile else ""
        return said_version(self.compile) + wheel

    @property
    def identity(self) -> str:
        """What would change the machine code besides sources and flags."""
        wheel = version("ziglang") if "ziglang" in self.compile else ""
        path = Path(shutil.which(self.compile[0]) or self.compile[0]).resolve()
        return f"{self} {wheel} {path} {path.stat().st_size} {path.stat().st_mtime_ns}"

    def processor(self, target: Target) -> tuple[str, ...]:
        """Flags that name the processor."""
        return target.gcc if self.kind == "gcc" else target.zig

    def common(self) -> tuple[str, ...]:
        """The other flags that decide the machine code, but for the optimisation."""
        own = {
            # Else a loop that clears or copies becomes a call of the C library. Registers renamed: ten instructions
            # of a control step less.
            "gcc": ("-fno-tree-loop-distribute-patterns", "-frename-registers", "-fstack-usage"),
            "zig": (
                "-fno-sanitize=all",
                "-fno-unroll-loops",
                "-mno-outline",
                "-fomit-frame-pointer",
                "-fstack-size-section",
            ),
        }[self.kind]
        return (*LANGUAGE, *ARITHMETIC, *SECTIONS, *own)

    def flags(self, target: Target, optimisation: str = FAST) -> tuple[str, ...]:
        """All that decides the machine code; warnings apart."""
        return (*self.processor(target), *self.common(), optimisation)

    def link_flags(self, target: Target) -> tuple[str, ...]:
        """Of an image that brings its own start-up and needs no library. One without an entry is no image."""
        if self.kind == "gcc":
            return (*target.gcc, "-nostdlib", *(f"-Wl,{flag}" for flag in _LINK))
        return _LINK


@functools.cache
def said_version(command: tuple[str, ...]) -> str:
    """First line of what a compiler says of itself."""
    line = _run([*command, "--version"], Path.cwd()).splitlines()
    return line[0] if line else "unknown"


def said_processor(command: tuple[str, ...]) -> str:
    """What a compiler says it compiles for, for example "arm-none-eabi"."""
    return _run([*command, "-dumpmachine"], Path.cwd()).strip() or "a processor that it does not name"


def find(chosen: str | None = None) -> Toolchain:
    """A cross-compiler: `chosen` ("gcc", "zig"), else $TENDON_ARM_CC, else gcc-arm-none-eabi, else the ziglang wheel.

    Raises BuildError, which says what to install.
    """
    if chosen not in (None, "gcc", "zig"):
        raise BuildError(f"--toolchain {quote(chosen)}: no such cross-compiler; there are gcc and zig")
    if chosen is not None:
        return _gcc("as chosen") if chosen == "gcc" else _zig("as chosen")
    if named := os.environ.get("TENDON_ARM_CC"):
        return _named(named)
    if shutil.which("arm-none-eabi-gcc"):
        return _gcc("found first; --toolchain zig takes the ziglang wheel instead")
    if importlib.util.find_spec("ziglang") is not None:
        return _zig("arm-none-eabi-gcc is not installed")
    raise BuildError(
        "no cross-compiler found (looked for TENDON_ARM_CC, arm-none-eabi-gcc and the ziglang wheel); "
        f"install gcc-arm-none-eabi, or run: {sys.executable} -m pip install ziglang"
    )


def _gcc(why: str) -> Toolchain:
    command = shutil.which("arm-none-eabi-gcc")
    if command is None:
        raise BuildError("arm-none-eabi-gcc is not there; install gcc-arm-none-eabi or choose --toolchain zig")
    return Toolchain("gcc", (command,), (command,), why)


def _zig(why: str) -> Toolchain:
    if importlib.util.find_spec("ziglang") is None:
        raise BuildError(
            f"the ziglang wheel is not there; run: {sys.executable} -m pip install ziglang, or choose --toolchain gcc"
        )
    zig = (sys.executable, "-m", "ziglang")
    return Toolchain("zig", (*zig, "cc"), (*zig, "ld.lld"), why)


def _named(text: str) -> Toolchain:
    command = tuple(shlex.split(text))
    if not command or shutil.which(command[0]) is None:
        raise BuildError(f'the cross-compiler "{text}" of the environment variable TENDON_ARM_CC is not there')
    why = "named by TENDON_ARM_CC"
    if "zig" in text:
        bare = command[:-1] if command[-1] == "cc" else command
        return Toolchain("zig", (*bare, "cc"), (*bare, "ld.lld"), why)
    processor = said_processor(command)
    if not processor.startswith(("arm", "thumb")):
        raise BuildError(
            f'the compiler "{text}" of the environment variable TENDON_ARM_CC compiles for {processor}; '
            "expected one for Arm, such as arm-none-eabi-gcc"
        )
    return Toolchain("gcc", command, command, why)


@dataclass(frozen=True)
class Image:
    """What was compiled. start: address of the binary's first byte; symbols: addresses, without the Thumb bit."""

    elf: Path
    binary: Path
    target: Target
    toolchain: Toolchain
    start: int
    text: int
    data: int
    bss: int
    stack: stack.Stack
    symbols: Mapping[str, int]

    @property
    def forbidden(self) -> list[str]:
        """Symbols that have no place on a microcontroller."""
        return sorted(name for name in self.symbols if name.startswith(FORBIDDEN))

    def to_json(self) -> dict[str, Any]:
        """The report beside the image; paths are names within its directory."""
        return {
            "target": self.target.name,
            "machine": self.target.machine,
            "toolchain": {"kind": self.toolchain.kind, "version": self.toolchain.version, "why": self.toolchain.why},
            "elf": self.elf.name,
            "binary": self.binary.name,
            "start": self.start,
            "text": self.text,
            "data": self.data,
            "bss": self.bss,
            "stack": {**asdict(self.stack), "worst": self.stack.worst},
            "forbidden": self.forbidden,
            "symbols": dict(sorted(self.symbols.items())),
        }


def compile_image(
    directory: Path,
    sources: Sequence[str],
    script: str,
    target: Target,
    toolchain: Toolchain,
    *,
    output: str = "build/firmware",
    include: Sequence[str] = ("src",),
    small: Sequence[str] = (),
    optimisation: str | None = None,
) -> Image:
    """Compile and link `sources` of `directory` into output.elf and output.bin there.

    script        linker script
    output        without suffix; object files go beside it
    include       directories with headers
    small         those of the sources that are compiled for size
    optimisation  of all, for example "-O0"
    Paths are relative to `directory`. Raises BuildError with the compiler's first complaint.
    """
    stem = directory / output
    objects = stem.parent / "objects"
    shutil.rmtree(objects, ignore_errors=True)
    objects.mkdir(parents=True)
    others = [*WARNINGS, "-g", *(f"-I{path}" for path in include)]
    outputs = [str((objects / source.replace("/", "_")).with_suffix(".o").relative_to(directory)) for source in sources]
    for source, compiled in zip(sources, outputs, strict=True):
        flags = toolchain.flags(target, optimisation or (SMALL if source in small else FAST))
        _run([*toolchain.compile, *flags, *others, "-c", source, "-o", compiled], directory)
    tail = ["-lgcc"] if toolchain.kind == "gcc" else []
    link = [*toolchain.link, *toolchain.link_flags(target), "-T", script]
    _run([*link, *outputs, *tail, "-o", f"{output}.elf"], directory)
    path = stem.with_suffix(".elf")
    elf = Elf.read(path)
    start, content = elf.binary()
    stem.with_suffix(".bin").write_bytes(content)
    frames = stack.frames_of_usage(objects) if toolchain.kind == "gcc" else stack.frames_of_sections(elf)
    sizes = elf.sizes
    named = {
        s.name: s.address & ~1 if s.function else s.address for s in elf.symbols if s.section and s.name[:1] != "$"
    }
    return Image(
        path,
        stem.with_suffix(".bin"),
        target,
        toolchain,
        start,
        sizes.text,
        sizes.data,
        sizes.bss,
        stack.worst(elf, frames),
        {name: address for name, address in named.items() if name and not name.endswith((".c", ".o"))},
    )


def _run(command: Sequence[str], directory: Path) -> str:
    """Standard output of a compiler's call. Raises BuildError."""
    zig = str(cache_directory() / "zig")
    environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": zig, "ZIG_LOCAL_CACHE_DIR": zig}
    try:
        result = subprocess.run(command, cwd=directory, capture_output=True, text=True, env=environment, check=False)
    except OSError as error:
        raise BuildError(f"cannot run the cross-compiler {command[0]}: {error.strerror}") from error
    if result.returncode:
        lines = [line.strip() for line in result.stderr.splitlines() if line.strip()]
        first = next((line for line in lines if "error" in line), lines[0] if lines else "no message")
        raise BuildError(f"the cross-compiler {command[0]} failed (exit {result.returncode}): {first[:300]}")
    return result.stdout
