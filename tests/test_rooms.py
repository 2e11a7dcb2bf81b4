"""The plan of the house: which room stands on which, over all packages; lazy imports and those for types count, too."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import Counter

import pytest
from sources import ROOT, imports, modules, reached, tree

pytestmark = pytest.mark.cheap

ROOMS = """
symbolic.primitives symbolic.units symbolic.elements symbolic.described symbolic.functions
symbolic.effects
symbolic.grammar
symbolic.model_file
symbolic.rigid_body
symbolic.drive_function
symbolic.model
symbolic.controller_law

codegen.pages codegen.disk
codegen.tape codegen.effect_functions
codegen.open_numbers
codegen.monitor
codegen.c
codegen.casadi codegen.rust
codegen.metadata
codegen.render
codegen.toolchain
codegen.package
codegen.firmware
codegen.verify
codegen.descriptions codegen.prepare

runtime.arrays runtime.version runtime.files runtime.plain_json runtime.documents
runtime.wording runtime.setting runtime.interruption runtime.progress
runtime.model
runtime.exchange
runtime.recordings
runtime.motion
runtime.regression
runtime.identification
runtime.fit_warnings
runtime.diagnosis
runtime.inspection
runtime.simulation
runtime.planning
runtime.replay
runtime.loop
runtime.experiments
runtime.hardware
runtime.execution
runtime.sweep
runtime.report
runtime.study
runtime.workspace
runtime.notebook
runtime.studio
runtime.cli
runtime.import_name
"""
"""From the ground up: a room imports those above it in this list and nothing else. Rooms of one line stand side by
side and may lean on those left of them."""

ORDER = [room for line in ROOMS.splitlines() for room in line.split()]
BOTH_ENDS = {"runtime.workspace", "runtime.notebook", "runtime.studio", "runtime.import_name", "runtime.cli"}
"""They alone may see the equations and the generators from the side of the recordings."""
PLAIN = {
    f"symbolic.{name}"
    for name in (
        "described",
        "elements",
        "model_file.arm",
        "model_file.checks",
        "model_file.drive_laws",
        "model_file.fields",
        "model_file.frames",
        "model_file.likely",
    )
}
"""How a user's file is read and checked and what an error says, what a declaration says without equations, and the
arithmetic of a drive's law: for every package, and without SymPy."""


def room(module: str) -> str | None:
    """The room of a module; None for the page of a package."""
    return next((r for r in ORDER if module == r or module.startswith(r + ".")), None)


def test_every_module_stands_in_a_room() -> None:
    packages = {"symbolic", "codegen", "runtime"}
    assert [m for m in modules() if room(m) is None and m not in packages] == []
    assert [r for r in ORDER if not any(room(m) == r for m in modules())] == []


def test_no_room_climbs() -> None:
    """Of every module, and of all that it reaches, none lies in a later room."""
    wrong = []
    for module in sorted(modules()):
        here = room(module)
        for other in sorted(imports(module) if here else ()):
            there = room(other)
            if there is not None and ORDER.index(there) > ORDER.index(here or ""):
                wrong.append(f"{module} imports {other}")
    assert wrong == []


def test_no_module_reaches_itself() -> None:
    assert [m for m in sorted(modules()) if m in reached(m)] == []


@pytest.mark.parametrize("package", ["symbolic", "codegen", "runtime"])
def test_data_flows_one_way(package: str) -> None:
    """symbolic <- codegen, and generated <- runtime: transitively, but for the rooms that see both ends."""
    foreign = {"symbolic": ("codegen", "runtime"), "codegen": ("runtime",), "runtime": ("symbolic", "codegen")}[package]
    wrong = [
        f"{module} reaches {other}"
        for module in sorted(modules())
        if module.split(".")[0] == package and room(module) not in BOTH_ENDS
        for other in sorted(reached(module))
        if other.split(".")[0] in foreign and other not in PLAIN | {"symbolic.model_file", "symbolic"}
    ]
    assert wrong == []


def test_a_recording_never_climbs_on_its_way_to_a_verdict() -> None:
    way = [
        "runtime.recordings",
        "runtime.motion",
        "runtime.regression",
        "runtime.identification",
        "runtime.diagnosis",
        "runtime.report",
    ]
    assert [ORDER.index(r) for r in way] == sorted(ORDER.index(r) for r in way)


def test_a_public_class_has_a_name_of_its_own() -> None:
    where: dict[str, list[str]] = {}
    for module in modules():
        for node in tree(module).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                where.setdefault(node.name, []).append(module)
    assert {name: places for name, places in where.items() if len(places) > 1} == {}


FORBIDDEN = {
    "symbolic": {"numpy", "scipy", "casadi", "jinja2", "tests"},
    "codegen": {"tests"},
    "runtime": {"sympy", "jinja2", "tests"},
}
"""What a package leaves to others, beside its own kind; the report's page alone fills a template in `runtime`."""


@pytest.mark.parametrize("package", FORBIDDEN)
def test_packages_of_others_stay_where_they_belong(package: str) -> None:
    wrong = []
    for module in (m for m in modules() if m.split(".")[0] == package):
        allowed = {"jinja2"} if room(module) == "runtime.report" else set()
        for node in ast.walk(tree(module)):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            wrong += [f"{module}: {n}" for n in names if n.split(".")[0] in FORBIDDEN[package] - allowed]
    assert wrong == []


def test_loading_compiled_code_imports_no_sympy() -> None:
    imported = f"import runtime.model.loader, runtime.planning.scenario_file, {', '.join(sorted(PLAIN))}, sys"
    script = f"{imported}; print(sorted({{m.split('.')[0] for m in sys.modules}} & {{'sympy', 'codegen'}}))"
    run = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_a_file_of_tests_has_a_name_of_its_own() -> None:
    """pytest imports those that are in no package by their name alone."""
    files = [path for path in (ROOT / "tests").rglob("test_*.py") if not (path.parent / "__init__.py").exists()]
    names = Counter(path.name for path in files if "benchmarks" not in path.parts)
    assert [name for name, count in names.items() if count > 1] == []


def test_the_top_level_has_no_other_folders_of_code() -> None:
    with_code = {p.parent.name for p in ROOT.glob("*/*.py")}
    assert with_code <= {"symbolic", "codegen", "generated", "runtime", "tests"}
