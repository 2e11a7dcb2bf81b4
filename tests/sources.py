"""The product's modules: their files, their syntax trees, and which of ours they import, directly or at the end."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


@cache
def modules() -> dict[str, Path]:
    """Dotted name -> file, of the three packages."""
    found = {}
    for package in ("symbolic", "codegen", "runtime"):
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


@cache
def tree(module: str) -> ast.Module:
    """The syntax tree of a module."""
    return ast.parse(modules()[module].read_text(encoding="utf-8"))


@cache
def imports(module: str) -> frozenset[str]:
    """The modules of ours that a module imports, anywhere in it: lazily and for types, too."""
    known, found = modules(), set()
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{module}: imports are absolute"
            found |= {
                f"{node.module}.{a.name}" if f"{node.module}.{a.name}" in known else str(node.module)
                for a in node.names
            }
    return frozenset(found & known.keys()) - {module}


@cache
def reached(start: str) -> frozenset[str]:
    """All modules that one imports, and those that they import, and so on."""
    seen: set[str] = set()
    todo = [start]
    while todo:
        for module in imports(todo.pop()) - seen:
            seen.add(module)
            todo.append(module)
    return frozenset(seen)
