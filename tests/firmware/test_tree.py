"""The firmware's tree: what is written, what stays, what its page says, and the verb that makes it."""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from codegen import prepare
from codegen.firmware import source_tree
from codegen.firmware.protocol import REASONS
from codegen.firmware.source_tree import FirmwareTree
from codegen.pages import BANNER, MARK
from codegen.toolchain import cross
from runtime.cli import main, output
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file.arm import Arm

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "symbolic" / "arms" / "drive.toml"
Verb = Callable[..., int]


@pytest.fixture(scope="module")
def files(vishard4: Arm) -> dict[str, str]:
    return source_tree.firmware_files(derive(vishard4), LIBRARY)


@pytest.fixture
def tendon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Verb:
    """`tendon firmware drive.toml ...` in a directory of its own."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(MODEL, tmp_path / "drive.toml")
    monkeypatch.delenv("TENDON_ARM_CC", raising=False)
    return lambda *arguments: output.run(main.app, ["firmware", "drive.toml", *arguments])


# --- files ---


def test_writing_twice_changes_nothing(files: dict[str, str], tmp_path: Path) -> None:
    tree = FirmwareTree(files, tmp_path)
    assert len(tree.stale()) == len(files)
    tree.write()
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    tree.write()
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == before
    assert tree.stale() == []
    assert tree.kept == ()


def test_what_is_not_generated_stays(files: dict[str, str], tmp_path: Path) -> None:
    """A board of one's own, a stub that was filled in, a page that was taken over, notes beside generated files."""
    tree = FirmwareTree(files, tmp_path)
    tree.write()
    own = {
        "boards/mine/board.c": "mine",
        "boards/own/board.c": "filled in",
        "Makefile": "all:\n",
        "src/notes.txt": "mine",
        "src/more.c": "mine",
        "protocol.json": '{"mine": 1}',
    }
    for path, text in own.items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(text)
    assert tree.stale() == []
    tree.write()
    assert {path: (tmp_path / path).read_text() for path in own} == own
    assert set(tree.kept) == {"boards/own/board.c", "Makefile", "protocol.json"}


def test_what_was_generated_is_kept_up_to_date(files: dict[str, str], tmp_path: Path) -> None:
    tree = FirmwareTree(files, tmp_path)
    tree.write()
    (tmp_path / "src" / "main.c").write_text(files["src/main.c"] + "/* changed */\n")
    (tmp_path / "src" / "former.c").write_text(f"/* {BANNER} */\n")
    (tmp_path / "src" / "copied.c").write_text(f"/* {MARK} */\n")
    (tmp_path / "protocol.json").write_text(files["protocol.json"].replace("idle", "Idle"))
    (tmp_path / "boards" / "mps2" / "board.c").unlink()
    found = {line.removeprefix(f"{tmp_path}/") for line in tree.stale()}
    assert found == {
        "src/main.c: out of date",
        "src/former.c: no longer generated",
        "src/copied.c: no longer generated",
        "protocol.json: out of date",
        "boards/mps2/board.c: missing",
    }
    tree.write()
    assert tree.stale() == []
    assert not any((tmp_path / "src" / name).exists() for name in ("former.c", "copied.c"))


def test_the_page_tells_everything(files: dict[str, str]) -> None:
    page = files["README.md"]
    interface = set(re.findall(r"(tendon_board_\w+)\(", files["src/tendon_board.h"]))
    assert len(interface) == 9
    table = set(re.findall(r"^\| `(tendon_board_\w+)`", page, re.MULTILINE))
    assert table == interface
    for reason in REASONS:
        assert (f"(`{reason.name}`)" in page) == bool(reason.torque), reason.name
    machine = set(re.findall(r"(tendon_machine_\w+)\(", files["src/tendon_machine.h"])) - {"tendon_machine_size"}
    assert machine <= set(re.findall(r"tendon_machine_\w+", page))


def test_the_stub_has_every_function_of_a_board(files: dict[str, str]) -> None:
    def declared(path: str) -> set[str]:
        return set(re.findall(r"^\w+ (tendon_board_\w+)\(", files[path], re.MULTILINE))

    assert declared("boards/own/board.c") == declared("src/tendon_board.h") == declared("boards/mps2/board.c")


def test_deviations_name_files_that_are_there(files: dict[str, str]) -> None:
    lines = [line for line in files["misra.txt"].splitlines() if line and not line.startswith("#")]
    assert lines
    for line in lines:
        rule, _, path = line.partition(":")
        assert re.fullmatch(r"misra-c2012-\d+\.\d+", rule), line
        assert path in files, line


# --- the verb ---


def test_it_writes_compiles_and_reports(tendon: Verb, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert tendon("--toolchain", "zig", "--json", "report.json") == 0
    said = capsys.readouterr().out
    report = json.loads((tmp_path / "report.json").read_text())
    place = tmp_path / "generated" / "drive" / "firmware"
    assert sorted(path for path in report["files"] if (place / path).is_file()) == report["files"]
    build = report["build"]
    assert {Path(path).name for path in build["outputs"]} == {"drive.elf", "drive.bin"}
    assert all((tmp_path / path).stat().st_size > 1000 for path in build["outputs"])
    assert build["toolchain"]["kind"] == "zig"
    for words in (f"text {build['text']:,} B", f"worst stack {build['stack']['worst']:,} B", "as chosen", ": none"):
        assert words in said
    assert tendon("--check") == 0
    assert "up to date" in capsys.readouterr().out
    (place / "src" / "main.c").unlink()
    assert tendon("--check", "--json", "-") == 1
    assert json.loads(capsys.readouterr().out)["stale"] == ["generated/drive/firmware/src/main.c: missing"]


def test_for_this_computer(tendon: Verb, tmp_path: Path) -> None:
    assert tendon("--target", "host", "--out", "here") == 0
    assert (tmp_path / "here" / "build" / "host" / "lib.so").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--target", "cortex-m0"], '--target "cortex-m0": no such target; there are cortex-m4f, cortex-m7 and host'),
        (["--toolchain", "iar"], '--toolchain "iar": no such cross-compiler; there are gcc and zig'),
        (["--target", "host", "--toolchain", "zig"], "--toolchain zig: a cross-compiler; --target host takes the C"),
        (["--out", "drive.toml"], "drive.toml: is a file; expected a directory to write into"),
        (["--json", "absent/report.json"], "there is no directory absent; make it first"),
    ],
)
def test_what_it_cannot_do(
    tendon: Verb, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert tendon(*arguments) == 2
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["drive.toml"]


def test_without_a_cross_compiler(
    tendon: Verb, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cross.shutil, "which", lambda _: None)
    monkeypatch.setattr(cross.importlib.util, "find_spec", lambda _: None)
    assert tendon() == 2
    said = capsys.readouterr().err
    assert "install gcc-arm-none-eabi, or run: " in said
    assert sys.executable in said
    assert [path.name for path in tmp_path.iterdir()] == ["drive.toml"]


def test_it_is_prepared_once(vishard4: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    first = prepare.prepare_firmware(vishard4, LIBRARY, "cortex-m4f", "zig")
    monkeypatch.setattr(cross, "compile_image", lambda *_, **__: pytest.fail("compiled twice"))
    assert prepare.prepare_firmware(vishard4, LIBRARY, "cortex-m4f", "zig") == first
    assert prepare.prepare_firmware(vishard4, LIBRARY) != first
