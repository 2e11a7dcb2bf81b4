"""The firmware's source tree: equations, controller, machine, boards and build files, complete without Python."""

from __future__ import annotations

import functools
import shutil
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from codegen import disk, metadata, render
from codegen.c import misra
from codegen.c.c_code import comment
from codegen.c.controller import STATUS, Controller
from codegen.firmware import protocol_text
from codegen.firmware.messages import LARGEST
from codegen.firmware.protocol import ACKS, NOT_READY, OUTRUN, REASONS, TELEMETRY_RECORDS, Protocol, records_of
from codegen.open_numbers import open_links
from codegen.pages import BANNER, MARK, page
from codegen.toolchain import build, cross
from codegen.toolchain.cross import HOST, TARGETS, Target, Toolchain
from codegen.toolchain.stack import EXCEPTION_FRAME
from symbolic.effects.declaration import Effect
from symbolic.model import ArmModel
from symbolic.model_file.arm import OpenNumber
from symbolic.model_file.checks import check_stated, open_lines

TREE = Path(__file__).resolve().parent / "tree"


@functools.cache
def handwritten_files() -> Mapping[str, str]:
    """The firmware's C that is the same for every arm: relative path in the tree -> text."""
    found = {path.relative_to(TREE).as_posix(): path for path in TREE.rglob("*.[ch]")}
    return MappingProxyType({path: found[path].read_text(encoding="utf-8") for path in sorted(found)})


_MAIN = "src/main.c"
"""The source that calls the board; the others only use its ceilings."""
_FIXED = {"state": "controller_state"}
"""The machine's names of controller structs, where they differ."""


def machine_files(model: ArmModel, library: Mapping[str, Effect], equations: Mapping[str, str]) -> dict[str, str]:
    """The firmware's machine: relative path in the tree -> text.

    library     all effects by name; those that the model file activates are compensated
    equations   the generated sources of the same model that the machine calls, by path
    """
    controller = Controller.of(model, library)
    protocol = Protocol.of(controller)
    name, ceilings = protocol.arm, protocol.ceilings
    types = [
        {"own": record.name, "fixed": f"tendon_{_FIXED.get(short, short)}"}
        for short, record in records_of(controller).items()
        if controller.monitor is None or record not in controller.monitor.records
    ]
    banner = f"/* {BANNER} Controller of the arm {name}. */"
    files = {
        **{path: text for path, text in handwritten_files().items() if path.startswith("src/") and path != _MAIN},
        "src/tendon_arm.h": page("firmware/tendon_arm.h.j2", **_numbers(protocol), ceilings=None),
        "src/tendon_controller.h": page(
            "firmware/tendon_controller.h.j2", banner=banner, types=types, **_summed(controller)
        ),
    }
    # Without the ceilings: a model file with tighter limits needs no new firmware.
    hashed = sorted({**equations, **files, **_messages(controller, protocol, 0)}.items())
    build = zlib.crc32("\0".join(part for item in hashed for part in item).encode())
    limits = {**vars(ceilings), "rows": " \\\n    " + ", \\\n    ".join(ceilings.rows())}
    numbers = _numbers(protocol) | {"banner": comment(f"{BANNER} Numbers of the arm {name}.", *open_lines(model.open))}
    holes = {"banner_text": f"{BANNER} Link to the arm {name}.", **protocol_text.page_holes(protocol)}
    files |= {
        "src/tendon_arm.h": page("firmware/tendon_arm.h.j2", **numbers, ceilings=limits),
        **_messages(controller, protocol, build),
        "PROTOCOL.md": page("firmware/PROTOCOL.md.j2", **holes),
        "protocol.json": metadata.text(protocol.document(build)),
    }
    return dict(sorted(files.items()))


def _summed(controller: Controller) -> dict[str, object]:
    name, control = controller.model.arm.name, controller.model.arm.controller
    minute = 0 if control is None else round(MINUTE * control.rate)
    return {"name": name, "NAME": name.upper(), "statistics": controller.statistics is not None, "minute": minute}


def _messages(controller: Controller, protocol: Protocol, build: int) -> dict[str, str]:
    """tendon_messages.h and tendon_messages.c; build: CRC-32 of the sources, which the header states."""
    banner = f"/* {BANNER} Messages of the arm {protocol.arm}. */"
    holes = {"banner": banner, **protocol_text.code_holes(controller, protocol, build)}
    return {f"src/tendon_messages.{kind}": page(f"firmware/tendon_messages.{kind}.j2", **holes) for kind in ("h", "c")}


def _numbers(protocol: Protocol) -> dict[str, object]:
    """The holes of tendon_arm.h, the ceilings apart."""
    bits = sum(1 << reason.number for reason in REASONS if reason.torque == "zero")
    return {
        "banner": f"/* {BANNER} Numbers of the arm {protocol.arm}. */",
        "name": protocol.arm,
        "n": len(protocol.types),
        "looks": protocol.looks,
        "telemetry_records": TELEMETRY_RECORDS,
        "acks": ACKS,
        "not_ready": f"0x{NOT_READY:08x}U",
        "outrun": f"{OUTRUN}f",
        "no_limit": f"{LARGEST:.9g}f",
        "without_torque": f"0x{bits:x}U",
        "status": [
            {"name": flag.upper(), "bit": bit, "comment": comment(text)} for flag, (bit, text) in STATUS.items()
        ],
    }


BOARD = "boards/mps2"
"""The emulated board."""
MINUTE = 60.0
"""s between two blocks of statistics."""
STACK = 2048
"""Bytes that its linker script reserves; a test limits the worst case to half of that."""
_PAGES = (
    *("Makefile", "CMakeLists.txt", "README.md"),
    *("boards/mps2/mps2.ld", "cmake/gcc.cmake", "cmake/zig.cmake"),
)


def firmware_files(model: ArmModel, library: Mapping[str, Effect]) -> dict[str, str]:
    """The complete firmware tree: relative path -> text.

    library   all effects by name; those that the model file activates are compensated
    Raises ModelError if base inertial parameters are unknown.
    """
    name = model.arm.name
    check_stated(name, *open_links(model))
    # Without what is open in its banner: friction that is identified needs no other build.
    bare = replace(model, open=())
    code = render.arm_files(bare) | render.controller_files(bare, library)
    files = {f"src/{path}": text for path, text in code.items() if path.endswith(("_f32.c", "_f32.h"))}
    files |= {**handwritten_files(), **machine_files(model, library, files)}
    reasons = [(f"{r.text} (`{r.name}`)", r.criterion.replace("|", "\\|"), r.torque) for r in REASONS if r.torque]
    tools = {kind: Toolchain(kind, (), (), "") for kind in ("gcc", "zig")}
    targets = [
        {
            "name": target.name,
            **{kind: " ".join(found.processor(target)) for kind, found in tools.items()},
            **{f"link_{kind}": " ".join(found.link_flags(target)) for kind, found in tools.items()},
        }
        for target in TARGETS.values()
    ]
    holes = {
        "banner": f"/* {BANNER} Firmware of the arm {name}. */",
        "banner_text": f"{BANNER} Firmware of the arm {name}.",
        "name": name,
        "joints": f"{len(model.arm.joints)} joint" + ("s" if len(model.arm.joints) > 1 else ""),
        "stack_size": STACK,
        "library_sources": " ".join(_library(files)),
        "hot_sources": " ".join(path for path in _library(files) if _is_hot(path)),
        "fast": cross.FAST,
        "small": cross.SMALL,
        "common": {kind: " ".join(found.common()) for kind, found in tools.items()},
        "targets": targets,
        "target_names": ", ".join(TARGETS),
        "project_flags": " ".join(("-std=c99", *cross.ARITHMETIC)),
        "host_flags": " ".join(flag for flag in build.FLAGS if flag != "-shared"),
        "warnings": " ".join(build.WARNINGS),
        "board_warnings": "-Wall -Wextra",
        "banner_title": BANNER,
        "mark": MARK,
        "exception_frame": EXCEPTION_FRAME,
        **protocol_text.line_holes(Protocol.of(Controller.of(model, library))),
        "reasons": [" | ".join(cells) for cells in reasons],
    }
    files |= {path: page(f"firmware/{path}.j2", **holes) for path in _PAGES}
    files["misra.txt"] = page("c/misra.txt.j2", banner_text=holes["banner_text"], lines=misra.suppressions(name, files))
    return dict(sorted(files.items()))


def _library(files: Iterable[str]) -> list[str]:
    """Sources that do not depend on the board."""
    return sorted(path for path in files if path.startswith("src/") and path.endswith(".c") and path != _MAIN)


def _is_hot(source: str) -> bool:
    """Whether most of a source runs in every control step."""
    return source.endswith(("_f32.c", "/tendon_step.c"))


def compile_board(
    directory: Path, name: str, target: Target, tools: Toolchain, macros: Sequence[str] = ()
) -> dict[str, object]:
    """Builds NAME.elf and NAME.bin from the tree in `directory` for the emulated board. Returns a report.

    macros   NAME=VALUE of C

    fits: the stack is bounded and within the reserved memory, and no forbidden function is linked
    Raises BuildError.
    """
    there = sorted(path.relative_to(directory).as_posix() for path in directory.rglob("*.c"))
    # In the Makefile's order, so that it links the same image.
    sources = [*_library(there), _MAIN, *(path for path in there if path.startswith(BOARD))]
    small = [path for path in sources if not _is_hot(path)]
    image = cross.compile_image(
        directory, sources, f"{BOARD}/mps2.ld", target=target, toolchain=tools, output=name, small=small, macros=macros
    )
    shutil.rmtree(directory / "objects")
    fits = not image.stack.unknown and image.stack.worst <= STACK and not image.forbidden
    return {**image.to_json(), "outputs": [image.elf.name, image.binary.name], "stack_size": STACK, "fits": fits}


def compile_host(directory: Path, files: Mapping[str, str], macros: Sequence[str] = ()) -> dict[str, object]:
    """Builds lib.so in `directory`, the machine without a board for this computer. macros: NAME=VALUE of C.

    Raises BuildError.
    """
    flat = {Path(path).name: files[path] for path in _library(files)}
    flat |= {Path(path).name: text for path, text in files.items() if path.startswith("src/") and path.endswith(".h")}
    shutil.copyfile(build.shared_library(flat, "code", macros=macros), directory / "lib.so")
    said = cross.said_version(build.compiler())
    tools = {"kind": "host", "version": said, "why": "the C compiler of this computer"}
    return {"target": HOST, "toolchain": tools, "outputs": ["lib.so"], "stack": None, "fits": True}


@dataclass(frozen=True)
class FirmwareTree:
    """The files of a firmware and their directory. An existing file without the banner belongs to the user and is
    kept. open: what the model file leaves open"""

    files: Mapping[str, str]
    directory: Path
    open: tuple[OpenNumber, ...] = ()

    @classmethod
    def of(cls, model: ArmModel, library: Mapping[str, Effect], directory: Path) -> FirmwareTree:
        """An arm's firmware, for a directory."""
        return cls(firmware_files(model, library), directory, model.open)

    @property
    def kept(self) -> tuple[str, ...]:
        """Files of the user that differ from what would be written."""
        own = [path for path in self.files if self._is_owners(path)]
        return tuple(path for path in own if (self.directory / path).read_bytes() != self.files[path].encode())

    def stale(self) -> list[str]:
        """As disk.stale."""
        return disk.stale(self._generated, self.directory)

    def write(self) -> None:
        """As disk.write."""
        disk.write(self._generated, self.directory)

    @property
    def _generated(self) -> dict[str, str]:
        return {path: text for path, text in self.files.items() if not self._is_owners(path)}

    def _is_owners(self, path: str) -> bool:
        there = self.directory / path
        if there.suffix == ".json":  # which has no comments, so no banner
            return there.is_file() and b'"fingerprint"' not in there.read_bytes()
        return there.is_file() and not disk.has_banner(there)
