"""Cross-compilers are found, and what is said of their images is true."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from codegen.toolchain import cross
from codegen.toolchain.build import BuildError
from codegen.toolchain.cross import TARGETS, Image
from codegen.toolchain.stack import Elf

SCRIPT = """ENTRY(entry)
MEMORY { FLASH (rx) : ORIGIN = 0x100, LENGTH = 64K  RAM (rw) : ORIGIN = 0x20000000, LENGTH = 64K }
SECTIONS {
    .text : { *(.text*) *(.rodata*) } > FLASH
    .data : { *(.data*) } > RAM AT> FLASH
    .bss (NOLOAD) : { *(.bss*) } > RAM
    /DISCARD/ : { *(.ARM.exidx*) *(.ARM.extab*) }
}
"""
CODE = """
#include <stdint.h>
#define APART __attribute__((noinline, unused))
void entry(void);
void handler(void);
volatile uint32_t given = 7;
volatile uint32_t sink[25];
static APART void fill(volatile uint32_t *values, uint32_t count)
{
    for (uint32_t i = 0U; i < count; ++i) { values[i] = given; }
}
static APART void shallow(void) { volatile uint32_t few[10]; fill(few, 10U); }
static APART void deep(void) { volatile uint32_t many[50]; fill(many, 50U); }
__attribute__((used)) void handler(void) { volatile uint32_t some[20]; fill(some, 20U); }
"""
ENTRY = "void entry(void) { shallow(); deep(); fill(sink, 25U); for (;;) { } }\n"
KINDS = [
    pytest.param("zig"),
    pytest.param(
        "gcc", marks=pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="needs gcc-arm-none-eabi")
    ),
]


def image(directory: Path, kind: str, code: str, target: str = "cortex-m4f") -> Image:
    (directory / "image.ld").write_text(SCRIPT.replace("*(.text*)", "KEEP(*(.text.handler)) *(.text*)"))
    (directory / "image.c").write_text(code)
    return cross.compile_image(directory, ["image.c"], "image.ld", TARGETS[target], cross.find(kind), include=["."])


@pytest.mark.parametrize("kind", KINDS)
def test_the_worst_stack_is_that_of_the_deepest_calls(tmp_path: Path, kind: str) -> None:
    found = image(tmp_path, kind, CODE + ENTRY).stack
    assert [name for name, _ in found.chain] == ["entry", "deep", "fill"]
    assert found.unknown == ()
    assert 200 <= found.main <= 260
    assert 108 + 80 <= found.handlers <= 108 + 140
    assert found.worst == found.main + found.handlers


@pytest.mark.parametrize("kind", KINDS)
def test_a_stack_without_bound_is_said_to_be_one(tmp_path: Path, kind: str) -> None:
    recursion = "APART uint32_t down(uint32_t n);\nAPART uint32_t down(uint32_t n) {\n" + (
        "    volatile uint32_t kept = n;\n    return (n == 0U) ? 0U : (down(n - 1U) + kept);\n}\n"
    )
    entry = "void entry(void) { sink[0] = down(given); for (;;) { } }\n"
    assert image(tmp_path, kind, CODE + recursion + entry).stack.unknown == ("down calls itself",)
    pointer = "void (*volatile chosen)(void) = &deep;\nvoid entry(void) { chosen(); for (;;) { } }\n"
    assert image(tmp_path, kind, CODE + pointer).stack.unknown == ("entry calls through a pointer",)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("target", TARGETS)
def test_sizes_symbols_and_the_binary(tmp_path: Path, kind: str, target: str) -> None:
    made = image(tmp_path, kind, CODE + ENTRY, target)
    assert (made.sizes.data, made.sizes.bss) == (4, 100)
    assert made.symbols["given"] == 0x20000000
    assert made.symbols["entry"] % 2 == 0
    assert made.start == 0x100
    content = made.binary.read_bytes()
    assert made.sizes.text + made.sizes.data <= len(content) < made.sizes.text + made.sizes.data + 4
    assert content.endswith(b"\7\0\0\0")
    assert made.forbidden == []
    assert Elf.read(made.elf).entry == made.symbols["entry"] + 1


@pytest.mark.parametrize("kind", KINDS)
def test_double_precision_is_found(tmp_path: Path, kind: str) -> None:
    library = "double __aeabi_f2d(float x);\ndouble __aeabi_f2d(float x) { (void)x; return 0; }\n"
    code = library + "void entry(void);\nvoid entry(void) { volatile float x = (float)__aeabi_f2d(1); (void)x; }\n"
    (tmp_path / "image.ld").write_text(SCRIPT)
    (tmp_path / "image.c").write_text(code.replace("double", "float"))
    made = cross.compile_image(
        tmp_path, ["image.c"], "image.ld", TARGETS["cortex-m4f"], cross.find(kind), optimisation="-O0"
    )
    assert made.forbidden == ["__aeabi_f2d"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_mistake_in_the_source_is_named(tmp_path: Path, kind: str) -> None:
    with pytest.raises(BuildError, match=r"failed \(exit 1\): image\.c:2:.*error"):
        image(tmp_path, kind, "\nint x = ;\n")


def test_no_cross_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TENDON_ARM_CC", raising=False)
    monkeypatch.setattr(cross.shutil, "which", lambda _: None)
    assert cross.find().kind == "zig"
    assert "arm-none-eabi-gcc is not installed" in cross.find().why
    with pytest.raises(BuildError, match="install gcc-arm-none-eabi or choose --toolchain zig"):
        cross.find("gcc")
    monkeypatch.setattr(cross.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(BuildError, match=r"no cross-compiler found .* install gcc-arm-none-eabi, or run: .*ziglang"):
        cross.find()
    with pytest.raises(BuildError, match=r"pip install ziglang, or choose --toolchain gcc"):
        cross.find("zig")


def test_a_named_cross_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TENDON_ARM_CC", "no-such-compiler")
    with pytest.raises(BuildError, match='"no-such-compiler" of the environment variable TENDON_ARM_CC is not there'):
        cross.find()
    other = tmp_path / "cc"
    other.write_text("#!/bin/sh\necho x86_64-linux-gnu\n")
    other.chmod(0o755)
    monkeypatch.setenv("TENDON_ARM_CC", str(other))
    with pytest.raises(BuildError, match="TENDON_ARM_CC compiles for x86_64-linux-gnu; expected one for Arm, such as"):
        cross.find()
    monkeypatch.setenv("TENDON_ARM_CC", f"{sys.executable} -m ziglang cc")
    found = cross.find()
    assert found.kind == "zig"
    assert found.link == (sys.executable, "-m", "ziglang", "ld.lld")
