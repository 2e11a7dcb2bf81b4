"""Cross-compilers for the controller: how they are found, their flags, and the images that they build."""

from __future__ import annotations

import functools
import importlib.util
import os
import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from codegen.toolchain import build
from codegen.toolchain.build import WARNINGS, BuildError
from symbolic.model_file.checks import quote

if TYPE_CHECKING:
    from codegen.toolchain.stack import Sizes, Stack

LANGUAGE = ("-std=c99", "-pedantic", "-ffreestanding")
ARITHMETIC = ("-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
"""For the same bits from every compiler, and a square root in one instruction."""
SECTIONS = ("-ffunction-sections", "-fdata-sections")
FAST, SMALL = "-O2", "-Os"
"""For code that runs in every control step, and for all other code."""
_LINK = ("--gc-sections", "--build-id=none", "--fatal-warnings", "--emit-relocs")
"""Of both linkers. The relocations show which function calls which (stack.py)."""
FORBIDDEN = (
    *("__aeabi_d", "__aeabi_f2d", "__aeabi_i2d", "__aeabi_ui2d", "__aeabi_l2d"),
    *("malloc", "free", "printf", "_sbrk"),
)
"""Prefixes of functions that an image must not contain: double precision, a heap, text."""


@dataclass(frozen=True)
class Target:
    """A processor. gcc, zig: the compilers' flags for it; machine: QEMU's name of a board with it."""

    name: str
    meaning: str
    gcc: tuple[str, ...]
    zig: tuple[str, ...]
    machine: str


# An M4 fetches straight-line code from flash more slowly than it executes it. VMLA is a product and a sum in one
# instruction, both rounded, so it gives the same bits as two. By default the compilers use two instructions; these
# options make VMLA as cheap as on other processors.
_VMLA_ZIG, _VMLA_GCC = "-slowfpvmlx", "-mtune=cortex-a5"
_ZIG = ("-target", "thumb-freestanding-eabihf")
TARGETS = {
    "cortex-m4f": Target(
        name="cortex-m4f",
        meaning="Arm Cortex-M4 with its single-precision unit",
        gcc=("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", _VMLA_GCC),
        zig=(*_ZIG, f"-mcpu=cortex_m4+vfp4d16sp{_VMLA_ZIG}"),
        machine="mps2-an386",
    ),
    "cortex-m7": Target(
        name="cortex-m7",
        meaning="Arm Cortex-M7 with a single-precision unit",
        gcc=("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-sp-d16", "-mfloat-abi=hard"),
        zig=(*_ZIG, "-mcpu=cortex_m7+fp_armv8d16sp"),
        machine="mps2-an500",
    ),
}


HOST = "host"
"""The name of this computer as a target."""


def named_target(name: str) -> Target:
    """The processor with this name. Raises BuildError if there is none."""
    if name not in TARGETS:
        raise BuildError(f"--target {quote(name)}: no such target; there are {', '.join(TARGETS)} and {HOST}")
    return TARGETS[name]


@dataclass(frozen=True)
class Toolchain:
    """A cross-compiler. kind: gcc or zig, which decides the flags; why: the reason for its choice."""

    kind: str
    compile: tuple[str, ...]
    link: tuple[str, ...]
    why: str

    @property
    def version(self) -> str:
        """As the compiler reports it, for example "clang version 22.1.8 (ziglang 0.17.1)"."""
        wheel = f" (ziglang {version('ziglang')})" if "ziglang" in self.compile else ""
        return said_version(self.compile) + wheel

    @property
    def identity(self) -> str:
        """Cache key: everything but sources and flags on which the machine code depends."""
        wheel = version("ziglang") if "ziglang" in self.compile else ""
        return f"{self} {wheel} {build.identity(self.compile)}"

    def processor(self, target: Target) -> tuple[str, ...]:
        """Flags for the processor."""
        return target.gcc if self.kind == "gcc" else target.zig

    def common(self) -> tuple[str, ...]:
        """Flags for all processors, except the optimisation."""
        if self.kind == "gcc":
            # The first avoids calls of the C library for loops that clear or copy; renamed registers save ten
            # instructions of a control step.
            own = ["-fno-tree-loop-distribute-patterns", "-frename-registers", "-fstack-usage"]
        else:
            own = ["-fno-sanitize=all", "-fno-unroll-loops", "-mno-outline", "-fomit-frame-pointer"]
            own.append("-fstack-size-section")
        return (*LANGUAGE, *ARITHMETIC, *SECTIONS, *own)

    def flags(self, target: Target, optimisation: str = FAST) -> tuple[str, ...]:
        """All flags but warnings."""
        return (*self.processor(target), *self.common(), optimisation)

    def link_flags(self, target: Target) -> tuple[str, ...]:
        """For an image with its own start-up code and without libraries; a missing entry point is an error."""
        if self.kind == "gcc":
            return (*target.gcc, "-nostdlib", *(f"-Wl,{flag}" for flag in _LINK))
        return _LINK


@functools.cache
def said_version(command: tuple[str, ...]) -> str:
    """The first line that a compiler prints for --version."""
    line = _run([*command, "--version"], Path.cwd()).splitlines()
    return line[0] if line else "unknown"


def find(chosen: str | None = None) -> Toolchain:
    """The cross-compiler `chosen` ("gcc" or "zig"), else $TENDON_ARM_CC, else gcc-arm-none-eabi, else the ziglang
    wheel.

    Raises BuildError, which names what to install.
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
    processor = _run([*command, "-dumpmachine"], Path.cwd()).strip() or "a processor that it does not name"
    if not processor.startswith(("arm", "thumb")):
        raise BuildError(
            f'the compiler "{text}" of the environment variable TENDON_ARM_CC compiles for {processor}; '
            "expected one for Arm, such as arm-none-eabi-gcc"
        )
    return Toolchain("gcc", command, command, why)


@dataclass(frozen=True)
class Image:
    """A compiled image. start: address of the binary's first byte; symbols: addresses without the Thumb bit."""

    elf: Path
    binary: Path
    target: Target
    toolchain: Toolchain
    start: int
    sizes: Sizes
    stack: Stack
    symbols: Mapping[str, int]

    @property
    def forbidden(self) -> list[str]:
        """Symbols that the image must not contain."""
        return sorted(name for name in self.symbols if name.startswith(FORBIDDEN))

    def to_json(self) -> dict[str, object]:
        """image.json; paths are relative to its directory."""
        return {
            "target": self.target.name,
            "machine": self.target.machine,
            "toolchain": {"kind": self.toolchain.kind, "version": self.toolchain.version, "why": self.toolchain.why},
            "elf": self.elf.name,
            "binary": self.binary.name,
            "start": self.start,
            **asdict(self.sizes),
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
    macros: Sequence[str] = (),
    optimisation: str | None = None,
) -> Image:
    """Compiles and links `sources` of `directory` into output.elf and output.bin there.

    script         linker script
    output         path without suffix; object files go beside it
    include        directories with headers
    small          sources that are compiled for size
    macros         NAME=VALUE
    optimisation   for all sources, for example "-O0"
    Paths are relative to `directory`. Raises BuildError with the compiler's first error.
    """
    stem = directory / output
    objects = stem.parent / "objects"
    shutil.rmtree(objects, ignore_errors=True)
    objects.mkdir(parents=True)
    others = [*WARNINGS, "-g", *(f"-I{path}" for path in include), *(f"-D{macro}" for macro in macros)]
    outputs = [str((objects / source.replace("/", "_")).with_suffix(".o").relative_to(directory)) for source in sources]
    for source, compiled in zip(sources, outputs, strict=True):
        flags = toolchain.flags(target, optimisation or (SMALL if source in small else FAST))
        _run([*toolchain.compile, *flags, *others, "-c", source, "-o", compiled], directory)
    tail = ["-lgcc"] if toolchain.kind == "gcc" else []
    link = [*toolchain.link, *toolchain.link_flags(target), "-T", script]
    _run([*link, *outputs, *tail, "-o", f"{output}.elf"], directory)
    from codegen.toolchain import stack  # its reader of ELF files is slow to import, and images alone need it

    path = stem.with_suffix(".elf")
    elf = stack.Elf.read(path)
    start, content = elf.binary()
    stem.with_suffix(".bin").write_bytes(content)
    frames = stack.frames_of_usage(objects) if toolchain.kind == "gcc" else stack.frames_of_sections(elf)
    named = {
        s.name: s.address & ~1 if s.function else s.address for s in elf.symbols if s.section and s.name[:1] != "$"
    }
    return Image(
        elf=path,
        binary=stem.with_suffix(".bin"),
        target=target,
        toolchain=toolchain,
        start=start,
        sizes=elf.sizes,
        stack=stack.worst(elf, frames),
        symbols={name: address for name, address in named.items() if name and not name.endswith((".c", ".o"))},
    )


def _run(command: Sequence[str], directory: Path) -> str:
    """The output of a cross-compiler. Raises BuildError."""
    return build.run(command, directory, f"the cross-compiler {command[0]}")
