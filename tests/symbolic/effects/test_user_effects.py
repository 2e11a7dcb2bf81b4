"""A user's own declarations: what is accepted, and one clear line for everything else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import sympy as sp

from runtime.workspace.source import effects_library
from symbolic import units as u
from symbolic.effects import DECLARED, LIBRARY, EffectsError, load_user_effects
from symbolic.effects.declaration import Effect, Grid, LinearForm, Parameter, check, mistake, parameter
from symbolic.grammar.laws import drafts

HEAD = """
import sympy as sp
from dataclasses import replace
from symbolic.effects import LIBRARY
from symbolic.effects.declaration import *
"""


def load(tmp_path: Path, text: str) -> tuple[Effect, ...]:
    path = tmp_path / "mine.py"
    path.write_text(HEAD + text)
    return load_user_effects(path)


def test_a_file_adds_its_effects(tmp_path: Path) -> None:
    (effect,) = load(tmp_path, 'EFFECTS = (replace(LIBRARY["offset"], name="magnet"),)')
    assert effect.name == "magnet"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no EFFECTS in it; define EFFECTS"),
        ("EFFECTS = 3", "EFFECTS is a int; make it a tuple"),
        ("EFFECTS = (1,)", "item 1 is a int, not an Effect"),
        ('EFFECTS = (LIBRARY["offset"],)', '"offset" is already in use'),
        ('EFFECTS = (replace(LIBRARY["offset"], name="a"),) * 2', '"a" is already in use'),
        ('EFFECTS = (replace(LIBRARY["offset"], name="a", torque=sp.Symbol("zz")),)', "uses zz, which is neither"),
        ('EFFECTS = (replace(LIBRARY["offset"], name="a; b"),)', "must be lower-case letters"),
        ("1/0", "failed: ZeroDivisionError: division by zero"),
        ("EFFECTS = (", "failed: SyntaxError"),
        ("raise SystemExit('stop')", "failed: SystemExit: stop"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(EffectsError) as caught:
        load(tmp_path, text)
    assert message in str(caught.value)
    assert "mine.py: " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(EffectsError, match=r"absent\.py: cannot read the file of effects: No such file"):
        load_user_effects(tmp_path / "absent.py")


OFFSET = LIBRARY["offset"]
RIPPLE = LIBRARY["torque_ripple"]


def shape(of: str) -> Parameter:
    return Parameter("place", u.ONE, "m", "shape", grid=Grid(0.1, 1.0, 3, of))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        (replace(OFFSET, torque=parameter("torque") ** 2), "is not linear in all"),
        (replace(OFFSET, parameters=(Parameter("torque", u.FORCE, "m", "shape"),)), "needs a grid"),
        (replace(OFFSET, parameters=(Parameter("torque", u.FORCE, "m", "given"),)), "needs a default"),
        (replace(OFFSET, parameters=OFFSET.parameters * 2), "names a parameter twice"),
        (replace(RIPPLE, form=None), "is not linear in all"),
        (replace(RIPPLE, torque=2 * RIPPLE.torque), "its form is not the same torque"),
        (replace(OFFSET, form=LinearForm((), sp.Integer(0), (), ())), "an expression for each coefficient"),
        (replace(OFFSET, has_gap=True), "has a gap but reads no signal of a compliant transmission"),
        (replace(OFFSET, brought=True), "exactly one parameter must be its planned="),
        (replace(OFFSET, parameters=(*OFFSET.parameters, shape("critical"))), 'needs a parameter of kind "stiffness"'),
        (replace(OFFSET, parameters=(*OFFSET.parameters, shape("end"))), 'needs a parameter of kind "side"'),
    ],
)
def test_check_names_the_contradiction(effect: Effect, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        check(effect)


OWN = 'O = LIBRARY["offset"]\nP = O.parameters[0]\nx = parameter("torque")\nqd = SIGNAL["qd"].symbol\n'


def with_parameter(change: str) -> str:
    return f'EFFECTS = (replace(O, name="mine", parameters=(replace(P, {change}),)),)'


def with_grid(grid: str) -> str:
    shape = f'Parameter("w", P.unit, "m", "shape", grid={grid})'
    return f'EFFECTS = (replace(O, name="mine", parameters=(P, {shape}), torque=x * sp.cos(parameter("w") * qd)),)'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("raise BaseException('x')", "failed: BaseException: x"),
        ("raise GeneratorExit", "failed: GeneratorExit: no message"),
        ("class E(Exception):\n    def __str__(self): raise ValueError\nraise E", "failed: E: no message"),
        ("def f(): f()\nf()", "failed: RecursionError"),
        ("x = '\0'", "failed: SyntaxError"),
        ("class T(tuple):\n    def __iter__(self): raise ValueError\nEFFECTS = T()", "EFFECTS is a T; make it a tuple"),
        ("class E(Effect): pass\nEFFECTS = (object.__new__(E),)", "item 1 is a E, not an Effect"),
        ("EFFECTS = (replace(O, name=3),)", "name is 3; expected a text"),
        (f"EFFECTS = (replace(O, name={'x' * 64!r}),)", "has 64 letters; expected at most 63"),
        ("EFFECTS = (replace(O, name='mine', scope='arms'),)", "scope is 'arms'; expected 'joint' or"),
        ("EFFECTS = (replace(O, name='mine', summary=object()),)", "summary is a object; expected a text"),
        ("EFFECTS = (replace(O, name='mine', parameters=None),)", "parameters is None; expected a tuple"),
        ("EFFECTS = (replace(O, name='mine', parameters=(1,)),)", "parameters item 1 is 1; expected Parameter"),
        ("EFFECTS = (replace(O, name='mine', form=3),)", "form is 3; expected LinearForm"),
        ("EFFECTS = (replace(O, name='mine', dissipates='yes'),)", "dissipates is 'yes'; expected True or False"),
        *(
            (f"EFFECTS = (replace(O, name='mine', torque={law}),)", f"torque is {found}; expected an expression")
            for law, found in [
                ("qd > 0", "a StrictGreaterThan"),
                ("sp.Eq(x, qd)", "a Equality"),
                ("sp.true", "a BooleanTrue"),
                ("True", "True"),
                ("'x'", "'x'"),
                ("(x,)", "a tuple"),
                ("sp.Matrix([x])", "a MutableDenseMatrix"),
                ("sp.Poly(x, x)", "a Poly"),
            ]
        ),
        (with_parameter("bounds=(1, 0)"), "bounds are (1, 0); expected the smaller one first"),
        (with_parameter("bounds=(float('nan'), 1)"), "bounds item 1 is nan; expected a number"),
        (with_parameter("bounds=(0, 1, 2)"), "bounds has 3 items; expected 2"),
        (with_parameter("role='lin'"), "role is 'lin'; expected 'linear' or"),
        (with_parameter("unit='N m'"), "unit is 'N m'; expected a unit"),
        (with_parameter("meaning=None"), "meaning is None; expected a text"),
        (with_grid("Grid(0.1, 1.0, 3, 'nosuch')"), "of is 'nosuch'; expected 'one' or"),
        (with_grid("Grid(0.1, 1.0, 10**9)"), "grid has 1000000000 values; expected 1 to 200"),
        (with_grid("Grid(0.0, 1.0, 3)"), "grid begins at 0.0, spaced as its logarithm"),
        (with_grid("Grid(1.0, 0.1, 3)"), "grid goes from 1.0 to 0.1; expected finite numbers"),
    ],
)
def test_a_declaration_of_wrong_types_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    test_what_is_wrong_with_a_file_is_one_line(tmp_path, OWN + text, message)


def test_every_declaration_that_ships_is_well_typed() -> None:
    assert [wrong for e in (*LIBRARY.values(), *DECLARED.values(), *drafts()) if (wrong := mistake(e))] == []


@pytest.mark.parametrize(
    "law",
    [
        "x * sp.Piecewise((1, qd > 0), (2, True))",
        "x * sp.gamma(qd)",
        "x * sp.Integral(sp.exp(qd), qd)",
        "sp.Derivative(x * qd**2, qd)",
        "sp.zoo",
        "x + sp.oo",
        "sp.nan",
        "x * sp.I",
        "x * sp.Function('f')(qd)",
        "x * 10**400",
        "x * sp.besselj(0, qd)",
    ],
)
def test_a_law_that_no_target_can_evaluate_is_one_line(tmp_path: Path, law: str) -> None:
    (tmp_path / "mine.py").write_text(f"{HEAD}{OWN}EFFECTS = (replace(O, name='mine', torque={law}),)")
    with pytest.raises(EffectsError, match=r"mine\.py: .*(no target can evaluate|cannot be generated)") as caught:
        effects_library(tmp_path / "mine.py", space=False)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["int", "lambda", "double", "class", "while", "register"])
def test_a_word_of_c_or_python_is_no_name(tmp_path: Path, name: str) -> None:
    own = f"parameters=(replace(P, name='{name}'),), torque=parameter('{name}'), elements=()"
    for text in (f"name='{name}'", f"name='mine', {own}"):
        (tmp_path / "mine.py").write_text(f"{HEAD}{OWN}EFFECTS = (replace(O, {text}),)")
        with pytest.raises(EffectsError, match=f'name "{name}" cannot be used in C'):
            effects_library(tmp_path / "mine.py", space=False)
