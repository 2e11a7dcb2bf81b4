"""No name of an effect, of its parameter or of its state stands outside the library and the paper's study."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest
import sources

from symbolic.effects import LIBRARY

pytestmark = pytest.mark.cheap
EXEMPT = ("symbolic/effects/", "runtime/study/")

EFFECTS = frozenset(LIBRARY)
PARAMETERS = frozenset(
    name
    for effect in LIBRARY.values()
    for name in (*(p.name for p in (*effect.parameters, *effect.coefficients)), *(s.name for s in effect.states))
)

WORDS = {
    "gravity": "the acceleration in the model file and the function g(q)",
    "payload": "of a frame of the firmware's protocol",
    "offset": "a place in a file or in an array, and the zero of a unit",
    "plate": "a key of what `execute` says of a run, and the thing that the end-effector touches",
    "viscous": "a unit, and a carrier of the grammar of guesses",
    "coulomb": "the demonstration's own plant, which is written without the library",
}
"""Names of effects that are words of the field as well, and what they mean outside."""

KEYS = {
    "position": "limits and units of a joint, what a motion is seen over",
    "speed": "limits of a joint",
    "torque": "limits of a joint, a function of an effect, a telemetry field",
    "rate": "of a controller, a kind of width",
    "time": "a signal that residuals are seen over, a kind of width",
    "load": "a signal, a column of a page",
    "acceleration": "a signal that residuals are seen over",
    "friction": "a flag of scenarios and trajectories",
    "phase": "of a trajectory",
    "order": "an answer of the protocol",
    "start": "the beginning of a run or of a motion, a function of an effect",
    "end": "of a motion or of a grid's range",
    "rest": "of a point of a scenario",
    "side": "an operation of the tape, a kind of parameter",
    "stiffness": "a kind of parameter",
    "damping": "a kind of parameter, what a board does after a stop",
    "deflection": "a kind of state",
    "width": "of the smooth switches",
    "mass": "of a link in the model file",
    "inertia": "of a link in the model file, a function of an arm",
    "radius": "of a capsule in a scene file",
    "ratio": "of an error to what is allowed, in what verify prints",
}
"""Names of parameters and states that are keys of something else, and of what."""


def modules() -> Iterator[tuple[str, ast.Module]]:
    for module, path in sources.modules().items():
        place = str(path.relative_to(sources.ROOT))
        if not place.startswith(EXEMPT):
            yield place, sources.tree(module)


def texts(node: ast.AST | None) -> list[str]:
    """Strings that a node is or lists."""
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return [text for item in node.elts for text in texts(item)]
    return [node.value] if isinstance(node, ast.Constant) and isinstance(node.value, str) else []


def keys(node: ast.AST) -> list[str]:
    """Strings by which something is looked up, compared or named in a mapping."""
    if isinstance(node, ast.Subscript):
        return texts(node.slice)
    if isinstance(node, ast.Compare):
        return [text for side in (node.left, *node.comparators) for text in texts(side)]
    if isinstance(node, ast.Dict):
        return [text for key in node.keys for text in texts(key)]
    asks = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in ("get", "pop")
    return texts(node.args[0]) if asks and isinstance(node, ast.Call) and node.args else []


def identifiers(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Name):
        return [node.id.lower().strip("_")]
    if isinstance(node, ast.ImportFrom):
        return [alias.name.lower() for alias in node.names]
    return [node.attr.lower().strip("_")] if isinstance(node, ast.Attribute) else []


def test_no_effect_is_named_outside_the_library() -> None:
    found = [
        f"{place}:{getattr(node, 'lineno', 0)} {name}"
        for place, tree in modules()
        for node in ast.walk(tree)
        for name in {*texts(node), *identifiers(node)} & EFFECTS - WORDS.keys()
    ]
    assert found == []


def test_no_family_of_the_library_is_imported_outside_it() -> None:
    """Who needs the declarations takes them by what they declare."""
    families = {f"symbolic.effects.{path.stem}" for path in (sources.ROOT / "symbolic" / "effects").glob("*.py")}
    families -= {f"symbolic.effects.{name}" for name in ("__init__", "declaration", "signals", "source")}
    found = [
        f"{place}:{node.lineno}"
        for place, tree in modules()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module in families
    ]
    assert found == []


def test_no_parameter_or_state_is_looked_up_by_name_outside_the_library() -> None:
    found = [
        f"{place}:{getattr(node, 'lineno', 0)} {name}"
        for place, tree in modules()
        for node in ast.walk(tree)
        for name in set(keys(node)) & PARAMETERS - KEYS.keys() - WORDS.keys()
    ]
    assert found == []


def test_no_family_decides_anything() -> None:
    """A family is a heading: it is read where lists are sorted and shown, and nowhere else."""
    shown = ("runtime/report/", "runtime/studio/describe.py", "symbolic/described.py", "codegen/metadata.py")
    found = [
        f"{place}:{node.lineno}"
        for place, tree in modules()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and node.attr == "family" and not place.startswith(shown)
    ]
    assert found == []
