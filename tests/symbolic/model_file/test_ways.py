"""How each effect stands in the files of other programs: the guide's table is the one that the exporters write by."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from symbolic import elements
from symbolic.effects import DECLARED
from symbolic.model_file.exchange.ways import LANGUAGES, WAYS, of_effect, table

GUIDE = Path(__file__).resolve().parents[3] / "runtime" / "guides" / "mujoco.md"


@pytest.mark.cheap
def test_the_guide_has_the_table() -> None:
    written = GUIDE.read_text(encoding="utf-8").partition("| effect | MuJoCo |")[2]
    rows = [line for line in written.splitlines() if line.startswith("| ")]
    assert rows == [f"| {' | '.join(row)} |" for row in table(DECLARED.values())]


@pytest.mark.cheap
def test_every_element_is_of_an_effect_and_somewhere_played() -> None:
    declared = {type(element) for effect in DECLARED.values() for element in effect.elements}
    known = {kind for kind in vars(elements).values() if isinstance(kind, type) and issubclass(kind, elements.Element)}
    assert declared == known - {elements.Element}
    assert declared == {kind for language in LANGUAGES for kind in WAYS[language]}


@pytest.mark.cheap
def test_values_of_elements_are_those_of_the_effect() -> None:
    """A spring on a pulley: r² k and r F at the joint."""
    values = {"stiffness": 1000.0, "radius": 0.05, "offset": 0.3, "pretension": 20.0}
    spring, step = DECLARED["parallel_spring"].elements_at(values)
    assert (spring.side, spring.place, spring.stiffness) == pytest.approx((-1.0, 0.3, 2.5))
    assert [getattr(step, f.name) for f in fields(step)] == pytest.approx([-1.0, 0.3, 1.0])


@pytest.mark.cheap
def test_what_is_left_out_is_named() -> None:
    there = of_effect(DECLARED["viscous_asymmetric"], "urdf")
    assert (there.played, there.but) == ("approximated", "its absolute damper is left out")
    assert of_effect(DECLARED["load_friction"], "mjcf").played == "not"
    assert of_effect(DECLARED["end_stop"], "mjcf").tolerance == 0.02
