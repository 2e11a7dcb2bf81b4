"""What the guides tell people to type and to open is there, and prints what they say it prints."""

from __future__ import annotations

import contextlib
import inspect
import io
import os
import re
import shlex
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterable
from dataclasses import fields
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from guides import ROOT, Block, blocks, demo_errors, differs
from PIL import Image
from test_rooms import ORDER

from codegen.toolchain import build
from runtime.cli import main, output
from runtime.cli.verbs import VERBS
from runtime.hardware import canopen_arm
from runtime.hardware.link import LinkError
from symbolic.effects import DECLARED
from symbolic.effects.declaration import Effect
from symbolic.model_file.drive_laws import GAIN_KEYS, LAWS

tendon = pytest.importorskip("tendon", reason="the package is not installed (pip install -e .)")

TASKS = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "runtime" / "guides").glob("*.md"))
GUIDES = ["README.md", "symbolic/README.md", "codegen/README.md", "runtime/README.md", "tests/README.md", *TASKS]
LATER = ["runtime/guides/gallery.md"]
"""Its commands take a minute; the slow tests of tests/test_gallery.py type them."""
LONGEST = 150
"""Lines of the first page."""

INSTEAD = {"make demo": "tendon demo"}
"""Typed in place of what needs the project's folder; make sets up an environment first, which the tests are in."""
NOT_TYPED = {
    " make ": "needs the project's folder, and is what runs these tests or what .ci/run runs beside them",
    ".ci/run": "likewise",
    "bin/python -m": "needs the project's folder; tests/judge and tests/benchmarks have tests of their own",
    "serial://": "needs a board on a serial port; tests/runtime/hardware/test_serial.py has one",
    "canopen://": "needs drives on a CAN bus; tests/runtime/hardware/test_canopen_execute.py has some",
    "ur10.urdf": "needs a URDF and recordings of the arm; tests/runtime/cli/test_import.py has some",
    "ur10.toml run1.csv": "likewise",
    "dask ": "runs until it is stopped; tests/runtime/sweep/test_sweep.py has a cluster",
    "tcp://": "needs that cluster",
    "pip install generated/": "changes this environment; tests/codegen/package/test_python_module.py does not",
    "import tendon_vishard4": "needs what that command installs; the same tests run it",
    "tendon studio": "serves until it is stopped; tests/runtime/studio opens it in a browser",
    '"NumPy"]': "a piece of a back end; tests/codegen/test_codegen_guide.py puts it together",
    "numpy_code": "likewise",
}
"""What stands in a command or script that is not run here -> why."""
SLOW = (
    "diagnose my_drive.toml",
    "improve my_drive.toml",
    "better.toml",  # which the line above writes
    "tendon.diagnose",
    "fitted.toml",  # which that one writes
    "diagnose drive soft.csv.gz",
    "diagnose my_ur.toml",
    "my_panda.toml run1.csv",
    "improve tilted.toml",
    "diagnose my_arm.toml",
    "tendon experiment",
    "run1.csv arm.toml",  # of which it makes the motion
    "improve arm.toml",
    "check.csv",
    "motion.csv",
    "--draft",
    "guess.py",
    "optimize scenario2",
    "case2D.json",
    "mounted.toml",
    "tendon sweep",
    "tendon paper",
    "tendon verify vishard4",
    "tendon verify begun.toml",
    "--on unicorn",
)
"""What stands in a command or script that takes some ten seconds or more, or needs what such a one leaves. `make test`
leaves them out; the faster ones and tests/runtime have the same verbs."""


def listed(command: str, entries: Iterable[str]) -> bool:
    """Whether one of the entries stands in a command, or begins it after a blank."""
    return any(entry in f" {command}" for entry in entries)


def is_slow(block: Block) -> bool:
    return any(listed(command.line, SLOW) for command in block.commands)


def walk(guide: str, folder: Path, slow: bool) -> None:
    """Type a guide from top to bottom in an empty folder and read along; without `slow`, all but what takes long."""
    printed: str | None = None
    for block in blocks(ROOT / guide):
        where = f"{guide}:{block.line}"
        if block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")
        elif block.commands:
            printed = type_in(block, where, slow)
        elif block.language == "python":
            left_out = listed(block.text, NOT_TYPED) or (not slow and listed(block.text, SLOW))
            printed = None if left_out else script(block, where)
        elif block.language == "text" and printed is not None:
            missing = differs(block.text, printed)
            assert missing is None, f"{where}: not printed as it stands: {missing}\n--- printed:\n{printed}"
        if block.language not in ("sh", "python") or block.file:
            printed = None


def type_in(block: Block, where: str, slow: bool) -> str | None:
    """Standard output of a block's last command; None if that is not typed here."""
    printed: str | None = None
    for command in block.commands:
        printed = None
        line = INSTEAD.get(command.line, command.line)
        if listed(line, NOT_TYPED) or (not slow and listed(line, SLOW)):
            continue
        began = time.monotonic()
        status, printed, errors = typed(line)
        print(f"{time.monotonic() - began:6.1f} s  {where}: {line}")
        assert status == command.status, f"{where}: {line}: status {status}\n{printed}{errors}"
    return printed


def typed(line: str) -> tuple[int, str, str]:
    """Status, standard output and standard error of a command."""
    if not line.startswith("tendon "):
        line = re.sub(r"^cc ", f"{shlex.join(build.compiler())} ", line)
        run = subprocess.run(line, shell=True, capture_output=True, text=True, check=False)
        return run.returncode, run.stdout, run.stderr
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = output.run(main.app, shlex.split(line)[1:])
    return status, out.getvalue(), err.getvalue()


def script(block: Block, where: str) -> str:
    """Standard output of a Python script."""
    run = subprocess.run([sys.executable, "-c", block.text], capture_output=True, text=True, check=False)
    assert run.returncode == 0, f"{where}: {run.stderr}"
    return run.stdout


PRINTED = """
 joint   cost      range
 ───────────────────────
 1       105.8     -0.487 to 0.061

It took 12.4 s.
"""


@pytest.mark.parametrize(
    ("said", "missing"),
    [
        ("joint cost range\n1 105.8 -0.487 to 0.061\nIt took ~3 s.", None),
        ("joint   cost range\n1 106 -0.49 to 0.061\nIt took 12.4 s.", None),
        ("…\n1 105.8 -0.487 to 0.061\n…", None),
        ("…\n1 109.8 -0.487 to 0.061\n…", None),
        ("…\n1 112.8 -0.487 to 0.061\n…", "1 112.8 -0.487 to 0.061"),
        ("…\n1 105.8 -0.487 to 0.0610\n…", None),
        ("…\n1 105.8 -0.487 to 0.066\n…", "1 105.8 -0.487 to 0.066"),
        ("…\n2 105.8 -0.487 to 0.061\n…", "2 105.8 -0.487 to 0.061"),
        ("…\n1 105.8 0.487 to 0.061\n…", "1 105.8 0.487 to 0.061"),
        ("1 105.8 -0.487 to 0.061\n…", "1 105.8 -0.487 to 0.061"),
        ("joint cost range\nIt took 12.4 s.", "It took 12.4 s."),
        ("…\nIt took 12.4 s.\n1 105.8 -0.487 to 0.061\n…", "1 105.8 -0.487 to 0.061"),
        ("joint cost range", "nothing follows, but it printed: 1 105.8 -0.487 to 0.061"),
        ("…\nIt cost 12.4 s.", "It cost 12.4 s."),
    ],
)
def test_reading_along_finds_what_differs(said: str, missing: str | None) -> None:
    assert differs(said, PRINTED) == missing


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Empty, and where commands are typed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{ROOT / 'runtime' / 'import_name'}")
    return tmp_path


@pytest.mark.parametrize("guide", [guide for guide in GUIDES if guide not in LATER])
def test_what_a_guide_says_is_what_happens(guide: str, folder: Path) -> None:
    walk(guide, folder, slow=False)


@pytest.mark.slow
@pytest.mark.parametrize("guide", [g for g in GUIDES if any(map(is_slow, blocks(ROOT / g))) and g not in LATER])
def test_what_a_guide_says_of_slow_commands_is_what_happens(guide: str, folder: Path) -> None:
    walk(guide, folder, slow=True)


@pytest.mark.cheap
@pytest.mark.parametrize("guide", GUIDES)
def test_what_is_said_to_be_printed_follows_something_that_is_typed(guide: str) -> None:
    for before, block in pairwise(blocks(ROOT / guide)):
        if block.language == "text":
            said_by = before.commands[-1].line if before.commands else before.text
            typed_here = before.language in ("sh", "python") and not before.file
            assert typed_here, f"{guide}:{block.line}"
            assert said_by in INSTEAD or not listed(said_by, NOT_TYPED), f"{guide}:{block.line}"


def test_what_is_not_typed_stands_in_a_guide() -> None:
    typed_lines = [c.line for guide in GUIDES for block in blocks(ROOT / guide) for c in block.commands]
    scripts = [block.text for guide in GUIDES for block in blocks(ROOT / guide) if block.language == "python"]
    for entries in (INSTEAD, NOT_TYPED, SLOW):
        assert [e for e in entries if not any(listed(line, [e]) for line in [*typed_lines, *scripts])] == []


@pytest.mark.cheap
@pytest.mark.parametrize("guide", GUIDES)
def test_everything_that_could_be_typed_is_marked_as_such(guide: str) -> None:
    """No command hides in an indented block or in one of another kind, where nobody types it."""
    text = (ROOT / guide).read_text(encoding="utf-8")
    outside = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    assert re.findall(r"^    (?:tendon|make|cmake|cc|c[+][+]|pip|dask|\.venv).*", outside, re.MULTILINE) == []
    languages = {block.language for block in blocks(ROOT / guide)}
    assert languages <= {"sh", "text", "python", "toml", "c", "cpp", "jinja"}


@pytest.mark.parametrize("guide", GUIDES)
def test_verbs_that_are_mentioned_exist(guide: str) -> None:
    text = (ROOT / guide).read_text(encoding="utf-8")
    mentioned = set(re.findall(r"`tendon ([a-z]+)", text)) | set(re.findall(r"^tendon ([a-z]+)", text, re.MULTILINE))
    assert mentioned <= VERBS.keys()


@pytest.mark.cheap
@pytest.mark.parametrize("guide", GUIDES)
def test_links_and_pictures_are_there(guide: str) -> None:
    path = ROOT / guide
    text = path.read_text(encoding="utf-8")
    targets = re.findall(r"\]\(([^)]+)\)", text) + re.findall(r'src="([^"]+)"', text)
    for target in targets:
        file, _, anchor = target.partition("#")
        aim = path.parent / file if file else path
        assert aim.exists(), target
        assert not anchor or anchor in anchors(aim), target


def anchors(guide: Path) -> set[str]:
    """The headings of a guide, as links name them."""
    headings = re.findall(r"^#+ (.*)$", guide.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def table(guide: str, heading: str, column: str = "") -> list[list[str]]:
    """The cells of the first table under a heading whose first column is called so."""
    text = (ROOT / guide).read_text(encoding="utf-8").partition(f"## {heading}\n")[2]
    rows = re.search(rf"^\| *{column}.*\n\|-.*\n((?:\|.*\n)+)", text, re.MULTILINE)
    assert rows, f"{guide}: no table under {heading}"
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]] for row in rows[1].splitlines()]


def test_the_effects_are_those_of_the_library() -> None:
    def row(effect: Effect) -> list[str]:
        units = [(p.name, p.unit.text("revolute")) for p in effect.parameters]
        beyond = {p.name for p in effect.parameters if p.space}
        shown = [(f"in space {name}" if name in beyond else name, unit) for name, unit in units]
        parameters = ", ".join(name if unit == "1" else f"{name} [{unit}]" for name, unit in shown)
        law = effect.equation.replace("|", r"\|")
        return [f"`{effect.name}`", effect.scope, f"`{law}`", parameters, effect.summary]

    assert table("symbolic/README.md", "The effects") == [row(effect) for effect in DECLARED.values()]


def test_every_field_of_a_declaration_has_its_line() -> None:
    listed_fields = [
        name for row in table("symbolic/README.md", "The fields of a declaration") for name in row[0].split(", ")
    ]
    assert {name.strip("`") for name in listed_fields} == {field.name for field in fields(Effect)}


@pytest.mark.parametrize(
    ("guide", "heading", "declared"),
    [
        ("symbolic/README.md", "The model file", "symbolic.model_file.keys:model_file_rows"),
        ("symbolic/README.md", "An arm in space", "symbolic.model_file.keys:spatial_file_rows"),
        ("runtime/README.md", "Motion and springs together", "runtime.planning.scenario_file:scenario_file_rows"),
    ],
)
def test_the_keys_of_a_file_are_those_that_are_declared(guide: str, heading: str, declared: str) -> None:
    module, _, function = declared.partition(":")
    rows = getattr(import_module(module), function)()
    assert table(guide, heading) == [[f"`{row.key}`", row.unit, row.default, row.meaning] for row in rows]


def test_the_example_of_a_model_file_has_every_key() -> None:
    def keys(value: Any, path: str = "") -> set[str]:
        if isinstance(value, list) and value and isinstance(value[0], dict):
            return set().union(*(keys(item, path) for item in value))
        if not isinstance(value, dict):
            return {path}
        if path.endswith("effects"):
            return {f"{path}.EFFECT"}
        return set().union(*(keys(item, f"{path}.{name}".lstrip(".")) for name, item in value.items()))

    (bench,) = (block for block in blocks(ROOT / "symbolic" / "README.md") if block.file == "bench.toml")
    listed_keys = {row[0].strip("`") for row in table("symbolic/README.md", "The model file")}
    of_a_law = {f"joint.drive.{gain.key}" for gain in GAIN_KEYS}
    assert keys(tomllib.loads(bench.text)) == listed_keys - {"inertial.NAME"} - of_a_law


def test_every_law_of_a_drive_has_its_line() -> None:
    shared = {gain.key for gain in GAIN_KEYS if all(gain in law.gains for law in LAWS.values())}
    assert table("symbolic/README.md", "The model file", "`law`") == [
        [
            f"`{law.name}`",
            law.equation,
            ", ".join([*(f"`{c}`" for c in law.reads), *(f"`{c}` (optional)" for c in law.also)]),
            ", ".join(f"`{gain.key}`" for gain in law.gains if gain.key not in shared),
        ]
        for law in LAWS.values()
    ]


def test_every_verb_has_its_line() -> None:
    lines = [row[0] for row in table("runtime/README.md", "Every verb")]
    assert {re.match(r"`tendon ([a-z]+)", line)[1] for line in lines} == VERBS.keys()  # type: ignore[index]


def test_every_function_for_notebooks_has_its_line() -> None:
    functions = {name for name in tendon.__all__ if not inspect.isclass(getattr(tendon, name))}
    lines = [row[0] for row in table("runtime/README.md", "The package tendon", "verb")]
    assert {line.strip("`").partition("(")[0] for line in lines} == functions


def test_the_functions_of_an_arm_that_have_a_line_exist() -> None:
    cells = [row[0] for row in table("runtime/README.md", "The package tendon", "function of an arm")]
    names = {said.partition("(")[0] for cell in cells for said in re.findall(r"`([^`]+)`", cell)}
    assert "inverse_dynamics" in names
    assert {name for name in names if not callable(getattr(tendon.LoadedArm, name, None))} == set()


@pytest.mark.cheap
def test_the_pictures_have_the_figures_of_the_demo() -> None:
    """The words of a drawing stand in its comments, those of the screenshot in its description."""
    before, held_out_before, after, held_out_after = demo_errors()
    words = re.findall(r"<!--.*?([\d.]+) % -->", (ROOT / ".images" / "error.svg").read_text(encoding="utf-8"))
    assert differs(" ".join((before, after, held_out_before, held_out_after)), " ".join(words)) is None
    with Image.open(ROOT / ".images" / "studio.png") as picture:
        said = picture.text["Description"].splitlines()
    for label, figures in (("error", (before, after)), ("error, held out", (held_out_before, held_out_after))):
        shown = re.findall(r"[\d.]+", said[said.index(label) + 1])
        assert differs(" ".join(figures), " ".join(shown)) is None


@pytest.mark.cheap
def test_the_first_page_stays_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= LONGEST


@pytest.mark.cheap
@pytest.mark.parametrize("guide", GUIDES)
def test_lines_fit_a_screen(guide: str) -> None:
    lines = re.sub(r"^```.*?^```$", "", (ROOT / guide).read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    assert [x for x in lines.splitlines() if len(x) > 127 and not x.startswith(("|", "<img", "["))] == []


@pytest.mark.cheap
@pytest.mark.parametrize("package", ["symbolic", "codegen", "runtime"])
def test_the_map_of_the_rooms_is_the_one_that_is_kept(package: str) -> None:
    """A row a room, in the order in which they stand on each other."""
    text = (ROOT / package / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)(?:\.py|/)` \|", text.partition("## The rooms")[2], re.MULTILINE)
    assert [f"{package}.{name}" for name in rows] == [room for room in ORDER if room.startswith(package + ".")]


def test_rates_on_a_can_bus_are_those_that_fit() -> None:
    text = (ROOT / "codegen" / "README.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| highest `rate`, Hz.*?\| (.*) \|$", text, re.MULTILINE)
    for drives, rate in enumerate(map(float, row.split("|")), 1):
        address = canopen_arm.CanAddress("can0")
        canopen_arm.check_bus_load(drives, rate, address)
        with pytest.raises(LinkError):
            canopen_arm.check_bus_load(drives, rate + 10, address)
