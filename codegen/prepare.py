"""Generated and compiled code of an arm or a library, in the user's cache.

An entry's name is a hash of the model and of the sources that derive and print it, so a second call does not import
SymPy.
"""

from __future__ import annotations

import functools
import hashlib
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from codegen.toolchain import build, cross
from codegen.toolchain.cross import HOST
from symbolic.described import declared

if TYPE_CHECKING:
    from symbolic.effects.declaration import Effect
    from symbolic.model_file.arm import Arm

_F64 = ("_f64.c", "_f64.h")
_ROOT = Path(__file__).resolve().parent.parent


_NEVER = (
    *("symbolic/grammar", "symbolic/model_file/exchange", "symbolic/model_file/editor.py"),
    *("codegen/descriptions.py", "codegen/verify", "codegen/package", "codegen/rust"),
)
UNUSED_BY_ARMS = (*_NEVER, "codegen/firmware", "codegen/disk.py", "codegen/toolchain/")
"""Sources on which the code of an arm or of the effects does not depend. All others are hashed, new ones included."""
UNUSED_BY_FIRMWARE = _NEVER
"""The same for the firmware."""
_FLAGS = "codegen/toolchain/build.py"


@functools.cache
def sources(unused: tuple[str, ...]) -> tuple[Path, ...]:
    """The sources that derive, print and compile, without those whose path begins with one of `unused`."""
    found = [path for folder in ("symbolic", "codegen") for path in (_ROOT / folder).rglob("*")]
    named = {path.relative_to(_ROOT).as_posix(): path for path in found if path.suffix in (".py", ".j2", ".c", ".h")}
    return tuple(path for name, path in sorted(named.items()) if name == _FLAGS or not name.startswith(unused))


@functools.cache
def _digest(unused: tuple[str, ...]) -> str:
    digest = hashlib.sha256(f"sympy {version('sympy')}".encode())
    for path in sources(unused):
        digest.update(str(path.relative_to(_ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _fill(directory: Path, files: Mapping[str, str], level: str) -> None:
    _put(directory, files)
    compiled = {path: text for path, text in files.items() if path.endswith(_F64)}
    shutil.copyfile(build.shared_library(compiled, "code", level), directory / "lib.so")


def _put(directory: Path, files: Mapping[str, str]) -> None:
    for path, text in files.items():
        (directory / path).parent.mkdir(parents=True, exist_ok=True)
        (directory / path).write_text(text, encoding="utf-8")


def prepare_arm(arm: Arm) -> Path:
    """The directory with render.arm_files(derive(arm)) and `lib.so` of the double-precision code."""

    def fill(directory: Path) -> None:
        from codegen import render
        from symbolic.model import derive

        _fill(directory, render.arm_files(derive(arm)), build.STRAIGHT)

    return build.entry(f"arm-{arm.name}-{build.key(_digest(UNUSED_BY_ARMS), repr(arm))}", fill)


def _active(arm: Arm, library: Mapping[str, Effect]) -> list[str]:
    """The declarations of the effects that an arm activates, as text."""
    active = {name for joint in arm.joints for name in joint.effects} | set(arm.effects)
    active |= set(arm.contact.effects) if arm.contact is not None else set()
    return [said_of(declared(name, library)) for name in sorted(active)]


def said_of(effect: Effect) -> str:
    """An effect's declaration as text for a cache key, with the assumptions and all digits of its equations.

    A shipped effect is its name: the key has its source already, and writing the library out takes a third of a second.
    """
    import sympy as sp

    from symbolic.effects import shipped

    for space in (False, True):
        if shipped(space).get(effect.name) is effect:
            return f"{effect.name}, shipped, {space=}"

    def said(value: Any) -> Any:
        if isinstance(value, sp.Basic):
            return sp.srepr(value)
        if is_dataclass(value):
            return [(part.name, said(getattr(value, part.name))) for part in fields(value)]
        return [said(each) for each in value] if isinstance(value, tuple) else repr(value)

    return repr(said(effect))


def prepare_firmware(
    arm: Arm,
    library: Mapping[str, Effect],
    target: str = HOST,
    chosen: str | None = None,
    macros: Sequence[str] = (),
) -> Path:
    """The directory with the firmware's tree, controller.json, image.json (a report on the image), and

    lib.so                 the machine, for the target "host"
    NAME.elf, NAME.bin     the image for the emulated board, for a target of cross.TARGETS
    chosen                 the cross-compiler, "gcc" or "zig"; None: as cross.find chooses
    macros                 NAME=VALUE of C
    Raises BuildError, also for an unknown target.
    """
    processor = None if target == HOST else cross.named_target(target)
    if processor is None and chosen is not None:
        raise build.BuildError(
            f"--toolchain {chosen}: a cross-compiler; --target {HOST} takes the C compiler of this computer, "
            "or that of the environment variable CC: leave --toolchain out"
        )
    tools = None if processor is None else cross.find(chosen)
    content = [repr(arm), *_active(arm, library), "" if tools is None else tools.identity, *macros]

    def fill(directory: Path) -> None:
        from codegen import metadata
        from codegen.c.controller import Controller
        from codegen.firmware import source_tree
        from codegen.open_numbers import for_others

        model = for_others(arm, library)
        files = source_tree.firmware_files(model, library)
        _put(directory, files)
        (directory / "controller.json").write_text(metadata.text(Controller.of(model, library).document()), "utf-8")
        if processor is None or tools is None:
            report = source_tree.compile_host(directory, files, macros)
        else:
            report = source_tree.compile_board(directory, arm.name, processor, tools, macros)
        (directory / "image.json").write_text(metadata.text(report), "utf-8")

    return build.entry(f"firmware-{target}-{arm.name}-{build.key(_digest(UNUSED_BY_FIRMWARE), *content)}", fill)


def prepare_residuals(arm: Arm, library: Mapping[str, Effect]) -> Path:
    """The directory with controller.json and `lib.so`: the residual of the arm's monitor along recordings."""

    def fill(directory: Path) -> None:
        from codegen import render
        from symbolic.model import derive

        files = render.residual_files(derive(arm), library)
        _put(directory, files)
        compiled = {path: text for path, text in files.items() if not path.endswith(".json")}
        shutil.copyfile(build.shared_library(compiled, "code"), directory / "lib.so")

    content = [repr(arm), *_active(arm, library)]
    return build.entry(f"residuals-{arm.name}-{build.key(_digest(UNUSED_BY_ARMS), *content)}", fill)


def prepare_effects(effects: Iterable[Effect] | None = None, space: bool = False) -> Path:
    """The directory with render.effect_files(effects) and `lib.so`.

    effects   None: the shipped library, for planar arms or for spatial ones
    """
    chosen = None if effects is None else tuple(effects)
    shipped_name = "library in space" if space else "library"
    content = shipped_name if chosen is None else "\n".join(map(said_of, chosen))

    def fill(directory: Path) -> None:
        from codegen import render
        from symbolic.effects import shipped

        _fill(directory, render.effect_files(tuple(shipped(space).values()) if chosen is None else chosen), build.LOOPS)

    return build.entry(f"effects-{build.key(_digest(UNUSED_BY_ARMS), content)}", fill)
