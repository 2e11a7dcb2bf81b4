"""Modules of the product and of the tests: files, syntax trees, and which of ours they import, also indirectly."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


@cache
def modules() -> dict[str, Path]:
    """Dotted name -> file, of the three packages."""
    return _named(sorted(path for name in ("symbolic", "codegen", "runtime") for path in (ROOT / name).rglob("*.py")))


@cache
def everything() -> dict[str, Path]:
    """Dotted name -> file, of the three packages and of the tests."""
    tests = ROOT / "tests"
    folders = sorted(path for path in tests.iterdir() if path.is_dir() and not path.name.startswith("."))
    inside = [path for folder in folders for path in sorted(folder.rglob("*.py"))]
    return {**modules(), **_named([*sorted(tests.glob("*.py")), *inside])}


def _named(paths: list[Path]) -> dict[str, Path]:
    dotted = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in paths}
    return {name.removesuffix(".__init__"): path for name, path in dotted.items()}


@cache
def tree(module: str) -> ast.Module:
    """The syntax tree of a module."""
    return ast.parse(everything()[module].read_text(encoding="utf-8"))


@cache
def imports(module: str) -> frozenset[str]:
    """The modules of ours that a module imports, anywhere in it: lazily and for types, too."""
    known, found = everything(), set()
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = _start(module, node)
            found |= {f"{start}.{a.name}" if f"{start}.{a.name}" in known else start for a in node.names}
    if module.startswith("tests."):
        # Folders of tests without __init__.py are on the path themselves.
        found |= {f"tests.{name}" for name in found}
    return frozenset(found & known.keys()) - {module}


def _start(module: str, node: ast.ImportFrom) -> str:
    """The dotted name after `from`, made absolute."""
    if not node.level:
        return str(node.module)
    assert module.startswith("tests."), f"{module}: imports are absolute"
    return ".".join([*module.split(".")[: -node.level], *([node.module] if node.module else [])])


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


@cache
def code(module: str) -> str:
    """A module's syntax tree as text, without its docstrings: the same until what it computes may change."""
    blocks = [node for node in ast.walk(tree(module)) if isinstance(getattr(node, "body", None), list)]
    whole = [node.body for node in blocks]
    try:
        for node in blocks:
            node.body = [line for line in node.body if not _is_text(line)]
        return ast.dump(tree(module))
    finally:
        for node, body in zip(blocks, whole, strict=True):
            node.body = body


def _is_text(line: ast.stmt) -> bool:
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and isinstance(line.value.value, str)
