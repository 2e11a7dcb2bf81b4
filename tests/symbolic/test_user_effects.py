"""A user's own declarations: what is accepted, and one clear line for everything else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import sympy as sp

from symbolic import units as u
from symbolic.effects import LIBRARY, EffectsError, load_user_effects
from symbolic.effects.declaration import Effect, Grid, LinearForm, Parameter, check, parameter

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
        (replace(OFFSET, has_gap=True), "has a gap, and reads no signal by which a transmission gives way"),
        (replace(OFFSET, brought=True), "exactly one parameter must be its planned="),
        (replace(OFFSET, parameters=(*OFFSET.parameters, shape("critical"))), 'needs a parameter of kind "stiffness"'),
        (replace(OFFSET, parameters=(*OFFSET.parameters, shape("end"))), 'needs a parameter of kind "side"'),
    ],
)
def test_check_names_the_contradiction(effect: Effect, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        check(effect)
