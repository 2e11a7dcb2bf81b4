"""Images and programs that tests compile, and what the programs print: kept in tests/.cache by a hash of all inputs."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from codegen.toolchain import build, cross

SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def texts(directory: Path) -> list[str]:
    """Names and contents of what may be compiled or linked in a directory, without those of its folders."""
    files = sorted(p for p in directory.iterdir() if p.suffix in (".c", ".h", ".inc", ".ld"))
    return [part for path in files for part in (path.name, path.read_text())]


def image(
    directory: Path, units: Sequence[str], kind: str, target: str = "cortex-m4f", optimisation: str | None = None
) -> Path:
    """The ELF file of the sources `units` in a directory, linked by its motion.ld."""
    tools, processor = cross.find(kind), cross.TARGETS[target]
    flags = (*tools.flags(processor, optimisation or cross.FAST), *tools.link_flags(processor))

    def fill(into: Path) -> None:
        for name, text in zip(*[iter(texts(directory))] * 2, strict=True):
            (into / name).write_text(text)
        cross.compile_image(
            into, units, "motion.ld", processor, tools, output="motion", include=(".",), optimisation=optimisation
        )

    key = build.key(tools.identity, *flags, *units, "", *texts(directory))
    return build.entry(f"image-{key}", fill) / "motion.elf"


def program(directory: Path, units: Sequence[str], *flags: str) -> Path:
    """An executable for this computer of the sources `units` in a directory. Skips the test without sanitizers."""
    command = [*build.compiler(), "-std=c99", "-ffp-contract=off", *flags, *units]

    def fill(into: Path) -> None:
        output = ["-o", str(into / "program"), "-lm"]
        made = subprocess.run([*command, *output], cwd=directory, capture_output=True, text=True, check=False)
        if made.returncode and "san" in made.stderr and "-fsanitize" in " ".join(flags):
            pytest.skip("this compiler has no sanitizers")
        assert made.returncode == 0, made.stderr[:3000]

    key = build.key(*command, "", *texts(directory))
    return build.entry(f"program-{key}", fill) / "program"


def figures(made: Path, *arguments: str, files: Sequence[Path] = ()) -> dict[str, int]:
    """The figures that a program prints, which ends well; run once for its arguments and the contents of `files`."""

    def fill(into: Path) -> None:
        done = subprocess.run(
            [made, *arguments, *map(str, files)],
            cwd=into, env=os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr[:3000]
        (into / "figures").write_text(done.stdout)

    contents = [path.read_bytes().hex() for path in files]
    found = build.entry(f"figures-{build.key(made.parent.name, *arguments, '', *contents)}", fill) / "figures"
    print(f"\n{found.read_text().strip()}")
    return {name: int(value, 0) for name, value in (word.split("=") for word in found.read_text().split())}
