"""Thresholds once: the numbers on which a diagnosis rests stand in the settings of their rooms, and nowhere else."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.cheap
ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("motion", "regression", "identification", "diagnosis", "inspection", "loop", "experiments", "simulation")
"""Rooms of `runtime` whose numbers decide what a recording is said to show."""

SMALL = 1e-8
"""A literal up to this keeps a division from zero, or is rounding: twice as much decides nothing."""
PLAIN = {0.0, 0.5, 1.0, 2.0, 10.0, 100.0}
"""Literals that are arithmetic: a half, a square, per cent."""
BOUNDS = {"min", "max", "np.clip", "np.minimum", "np.maximum"}
COUNTED = 3
"""A whole number above it, compared or bounded with, is a threshold; up to it, it counts what is there."""

ELSEWHERE = {
    "diagnosis/gates.py": "the gates, each a limit with its unit, reason and source",
    "simulation/options.py": "what the verb is told: defaults and ranges of its options",
    "experiments/options.py": "likewise",
    "motion/clock.py: EVEN_GRID": "what counts as one place on a grid",
    "motion/clock.py: _even": "what counts as one clock",
    "motion/clock.py: _counted": "chance, among a thousand samples",
    "motion/filters.py: kaiser_window": "Kaiser's formulas of 1974",
    "motion/filters.py: differentiator": "the limits of a filter's design, by construction",
    "motion/filters.py: low_pass": "likewise",
    "motion/noise.py: ENOUGH_FOR_NOISE": "time",
    "motion/noise.py: measured_rate": "when a measured rate is used",
    "motion/noise.py: resolution": "the step of an encoder, five parts of its own differences",
    "motion/repeats.py: _in_piece": "what is no motion",
    "motion/rests.py: UNKNOWN_OVER_NOISE": "how much of unknown combinations may stay",
    "motion/rests.py: SAME_DIRECTION": "rounding",
    "motion/rests.py: at_rest": "by how much the smoothing of a rate blurs a rest, 1 / (4 pi)",
    "motion/spectra.py: strongest_line": "Fisher's test of one signal in a thousand",
    "motion/spectra.py: peaks": "the freedom of overlapping spectra, Welch 1967",
    "motion/spectra.py: LombScargle": "aliases of a B-spline's grid, and rounding of what a model's columns leave",
    "diagnosis/candidates.py: _search_beside_grid": "numerics: where a simplex begins and ends",
    "diagnosis/detection_limits.py: _between": "how finely a limit is said",
    "diagnosis/steps.py: lines_above": "a hundredth of an order, less than a motor's lines are apart",
    "regression/bounded.py": "numerics of least squares: what is rounding, and where a solver ends",
    "regression/noise.py: Whitening": "what is rounding",
    "regression/rows.py: Block": "where squares overflow",
    "experiments/pieces.py": "motions, written down as numbers: what is chosen among them is in the settings",
    "experiments/first.py": "likewise",
    "experiments/motion_files.py": "formats of other programs: sizes, codes and numbers of fields",
    "experiments/scene.py: SCENE": "keys of a file, declared with where their values begin",
    "experiments/selection.py: WIDER": "factors that stand in words beside themselves",
    "identification/compare.py: _BINS": "bins of a curve that is shown over a signal",
    "identification/fit.py: _term_estimates": "a step for derivatives in closed form",
    "identification/jumps.py: _GAP_REACH": "where the width of a gap is sought",
    "identification/jumps.py: _GAP_STEPS": "likewise",
    "identification/fitting.py: _delay_of": "between which times delays of field buses and filters lie",
    "identification/fitting.py: _search": "parts of a joint's inertia, so that something is left on either side",
    "identification/fitting.py: _settles": "where passes end",
    "identification/grids.py: MotorAngle": "parts of the way that are slow, or all but its ends",
    "identification/fitting.py: _descended": "numerics: where steps end",
    "identification/problem.py: DERIVATIVE_STEP": "a step for derivatives",
    "identification/problem.py: _neutral": "next to nothing of an inertia",
    "identification/regressors.py: Signals": "a step for derivatives",
    "identification/twist.py: without_peaks": "a quantile in the place of the largest",
    "inspection/signals.py: joint_entries": "a quantile that is shown and decides nothing",
    "simulation/simulate.py": "the excitation, a motion written down as numbers",
    "simulation/demo.py": "the arm, the motion and the seeds of the demo, which stand for a user's",
}
"""Where numbers may stand beside the settings: a file, or a name in it, and what they are."""

UNITS = re.compile(
    r"(Hz|s|N m, N|dB|K|degC|rad, m|rad/s, m/s|samples|rows|bins|noise floors|grid steps|smallest pivot|length|power"
    r"|unit|natural logarithm|parts?|ratios?|standard deviations|numbers?)\b[^;]*;"
)
"""A setting's text begins with its unit or, without one, with what it is a part or a number of, and a semicolon."""


def files(room: str) -> list[Path]:
    return sorted(p for p in (ROOT / "runtime" / room).glob("*.py") if p.name != "settings.py")


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def settings(room: str) -> dict[str, str]:
    """Name -> text of every setting of a room."""
    path = ROOT / "runtime" / room / "settings.py"
    if not path.exists():
        return {}
    body, found = parsed(path).body, {}
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.Assign | ast.AnnAssign):
            assert isinstance(node, ast.AnnAssign), f"{room}: {ast.unparse(node)} is not Final"
            assert isinstance(node.target, ast.Name)
            assert ast.unparse(node.annotation) == "Final", f"{room}: {node.target.id} is not Final"
            text = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else ""
            found[node.target.id] = str(text)
    return found


def number(node: ast.AST) -> float | None:
    value = node.value if isinstance(node, ast.Constant) else None
    return None if isinstance(value, bool) or not isinstance(value, int | float) else value


def literals(tree: ast.AST) -> Iterator[tuple[int, float]]:
    """Line and value of every literal that decides: broken ones, and whole ones that are compared or bounded with."""
    for node in ast.walk(tree):
        value = number(node)
        if isinstance(value, float) and abs(value) > SMALL and value not in PLAIN:
            yield node.lineno, value  # type: ignore[attr-defined]
        if isinstance(node, ast.Compare):
            parts: list[ast.expr] = [node.left, *node.comparators]
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in BOUNDS:
            parts = node.args
        else:
            continue
        for part in (p for whole in parts for p in factors(whole)):
            whole_number = number(part)
            if isinstance(whole_number, int) and COUNTED < whole_number != 100:
                yield part.lineno, whole_number


def factors(node: ast.expr) -> Iterator[ast.expr]:
    """Of what is compared, the factors and summands at its surface."""
    if isinstance(node, ast.BinOp):
        yield from factors(node.left)
        yield from factors(node.right)
    elif isinstance(node, ast.UnaryOp):
        yield from factors(node.operand)
    else:
        yield node


def data(node: ast.AST) -> Iterator[ast.AST]:
    """What an expression consists of, without functions in it and without places in a row."""
    yield node
    if not isinstance(node, ast.Lambda | ast.Subscript):
        for part in ast.iter_child_nodes(node):
            yield from data(part)


def own_name(node: ast.stmt) -> str:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return node.name
    target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
    return target.id if isinstance(target, ast.Name) else ""


def inspected() -> Iterator[tuple[str, ast.stmt]]:
    """Every statement of every file of the rooms that is no exception, with its place."""
    for room in ROOMS:
        for path in files(room):
            place = f"{room}/{path.name}"
            if place not in ELSEWHERE:
                for node in parsed(path).body:
                    if f"{place}: {own_name(node)}" not in ELSEWHERE:
                        yield place, node


def test_no_number_decides_outside_the_settings() -> None:
    assert [f"{place}:{line}: {value!r}" for place, node in inspected() for line, value in literals(node)] == []


def test_no_constant_of_a_module_is_a_number() -> None:
    """Not even a whole one, or several: what has a name has a reason, and stands with the others."""
    wrong = [
        f"{place}: {ast.unparse(node)}"
        for place, node in inspected()
        if isinstance(node, ast.Assign | ast.AnnAssign)
        and node.value is not None
        and any(number(part) is not None for part in data(node.value))
    ]
    assert wrong == []


def test_every_exception_is_there() -> None:
    for place in ELSEWHERE:
        name, _, inside = place.partition(": ")
        path = ROOT / "runtime" / name
        assert path.exists(), place
        if inside:
            assert inside in {own_name(node) for node in parsed(path).body}, place


@pytest.mark.parametrize("room", ROOMS)
def test_every_setting_has_unit_reason_and_source(room: str) -> None:
    for name, text in settings(room).items():
        assert UNITS.match(text), f"{room}: {name} begins without a unit: {text[:40]}"
        assert text.count(";") >= 2 or "decides no" in text, f"{room}: {name} has no reason or no source: {text}"
        assert text.endswith("."), f"{room}: {name}"


def test_every_setting_is_used_and_has_a_name_of_its_own() -> None:
    everything = [name for room in ROOMS for name in settings(room)]
    assert len(everything) > 100
    assert sorted(set(everything)) == sorted(everything)
    read = {
        node.id
        for path in (ROOT / "runtime").rglob("*.py")
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
    }
    assert [name for name in everything if name not in read] == []


@pytest.mark.parametrize(
    ("source", "seen"),
    [
        ("def f(x):\n    return x > 0.3", [0.3]),
        ("def f(x):\n    return 100 * x if len(x) > 12 else max(x, 5)", [12, 5]),
        ("def f(x, least=0.7):\n    return max(x, 1e-300) / 2.0 + x**4 / 12", [0.7]),
    ],
)
def test_what_counts_as_a_number_that_decides(source: str, seen: list[float]) -> None:
    assert sorted(value for _, value in literals(ast.parse(source))) == sorted(seen)
