"""The firmware's tree: equations, controller, machine, boards and build files, complete without Python."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from codegen import build, render, toolchain
from codegen.machine import machine_files
from codegen.toolchain import TARGETS, Image, Target, Toolchain
from symbolic.effects.declaration import Effect
from symbolic.kinematics import Coordinates
from symbolic.model import ArmModel

BOARD = "boards/mps2"
"""The board that is emulated."""
STACK = 2048
"""Bytes that its linker script sets aside; a test holds the worst case to half of that."""
_PAGES = (
    *("src/main.c", "src/tendon_board.h", "Makefile", "CMakeLists.txt", "misra.txt"),
    *("boards/mps2/startup.c", "boards/mps2/board.c", "boards/mps2/mps2.ld", "boards/own/board.c"),
    *("cmake/gcc.cmake", "cmake/zig.cmake"),
)


def firmware_files(model: ArmModel, library: Mapping[str, Effect]) -> dict[str, str]:
    """Relative path -> text.

    library   all effects by name; those that the model file activates are compensated
    """
    name = model.arm.name
    code = render.arm_files(model) | render.controller_files(model, library)
    files = {f"src/{path}": text for path, text in code.items() if path.endswith(("_f32.c", "_f32.h"))}
    files |= machine_files(model, library)
    holes = {
        "banner": f"/* {render.BANNER} Firmware of the arm {name}. */",
        "banner_text": f"{render.BANNER} Firmware of the arm {name}.",
        "name": name,
        "n": len(model.arm.joints),
        "units": Coordinates(tuple(joint.type for joint in model.arm.joints)).force,
        "stack_size": STACK,
        "library_sources": " ".join(_library(files)),
        **_flags(),
        "target_names": ", ".join(TARGETS),
        "host_flags": " ".join(flag for flag in build.FLAGS if flag != "-shared"),
        "warnings": " ".join(build.WARNINGS),
    }
    files |= {path: render.page(f"firmware/{path.removeprefix('src/')}.j2", **holes) for path in _PAGES}
    return dict(sorted(files.items()))


def _flags() -> dict[str, Any]:
    """Flags as finished strings, the same that Tendon itself compiles with: by compiler, and by processor."""
    tools = {kind: Toolchain(kind, (), (), "") for kind in ("gcc", "zig")}

    def strings(target: Target) -> dict[str, str]:
        flags = {kind: " ".join(found.processor(target)) for kind, found in tools.items()}
        return flags | {f"link_{kind}": " ".join(found.link_flags(target)) for kind, found in tools.items()}

    return {
        "common": {kind: " ".join(found.common()) for kind, found in tools.items()},
        "targets": [{"name": target.name, **strings(target)} for target in TARGETS.values()],
    }


def _library(files: Iterable[str]) -> list[str]:
    """Sources that do not depend on a board."""
    return sorted(path for path in files if path.startswith("src/") and path.endswith(".c") and path != "src/main.c")


def library_files(files: Iterable[str]) -> list[str]:
    """Sources and headers that do not depend on a board."""
    found = list(files)
    return _library(found) + sorted(path for path in found if path.startswith("src/") and path.endswith(".h"))


def compile_tree(directory: Path, name: str, target: Target, tools: Toolchain) -> Image:
    """NAME.elf and NAME.bin in `directory`, of the tree that is there, for the emulated board."""
    sources = sorted(path.relative_to(directory).as_posix() for path in directory.glob("src/*.c"))
    sources += sorted(path.relative_to(directory).as_posix() for path in directory.glob(f"{BOARD}/*.c"))
    image = toolchain.compile_image(directory, sources, f"{BOARD}/mps2.ld", target, tools, output=name)
    shutil.rmtree(directory / "objects")
    return image


def kept(files: Iterable[str], directory: Path) -> list[str]:
    """Those of the files that are there without the banner, and so are their owner's: never replaced, never stale."""
    return [
        path
        for path in files
        if (directory / path).is_file() and not path.endswith(".json") and not render.has_banner(directory / path)
    ]


def stale(files: Mapping[str, str], directory: Path) -> list[str]:
    """As render.stale, without what is the owner's."""
    return render.stale(_generated(files, directory), directory)


def write(files: Mapping[str, str], directory: Path) -> None:
    """As render.write, without what is the owner's."""
    render.write(_generated(files, directory), directory)


def _generated(files: Mapping[str, str], directory: Path) -> dict[str, str]:
    own = set(kept(files, directory))
    return {path: text for path, text in files.items() if path not in own}
