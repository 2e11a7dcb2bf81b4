"""Data flows one way: symbolic <- codegen <- generated <- runtime; the command line alone sees both ends."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
OWN = {"symbolic", "codegen", "generated", "runtime"}
FORBIDDEN = {
    "symbolic": {"codegen", "generated", "runtime", "numpy", "scipy", "casadi", "jinja2"},
    "codegen": {"generated", "runtime"},
    "runtime": {"symbolic", "codegen", "generated", "sympy"},
}


COMMON = {"symbolic.checks"}
"""How a user's file is checked and what an error says: for every layer, and without SymPy."""


def imported(path: Path) -> set[str]:
    """Top-level packages that a module imports anywhere in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add(node.module or "")
    return {name.split(".")[0] for name in found - COMMON}


@pytest.mark.parametrize("layer", FORBIDDEN)
def test_imports_go_one_way(layer: str) -> None:
    modules = sorted((ROOT / layer).rglob("*.py"))
    assert modules
    for path in modules:
        if path == ROOT / "runtime" / "cli.py":
            continue
        assert not imported(path) & FORBIDDEN[layer], path


@pytest.mark.parametrize("layer", ["symbolic", "codegen", "runtime"])
def test_layers_name_no_unknown_package_of_ours(layer: str) -> None:
    for path in (ROOT / layer).rglob("*.py"):
        assert not imported(path) & {"tests", "tendon"}, path


def test_loading_compiled_code_imports_no_sympy() -> None:
    imports = "import runtime.loader, runtime.planning.scenario_file, sys"
    script = f"{imports}; print(sorted({{m.split('.')[0] for m in sys.modules}} & {{'sympy', 'codegen'}}))"
    run = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_the_house_has_no_other_rooms() -> None:
    """Folders of the top level with code in them are those of the design."""
    with_code = {p.parent.name for p in ROOT.glob("*/*.py")}
    assert with_code <= OWN | {"tests"}
