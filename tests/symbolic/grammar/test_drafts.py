"""Guesses at unknown physics: their units, their energy, and the files that declare them."""

from __future__ import annotations

import math
from itertools import product
from pathlib import Path

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from si_units import exponents

from symbolic import units as u
from symbolic.effects import LIBRARY, load_user_effects
from symbolic.effects.declaration import DT, SIGNALS, Effect, check, parameter
from symbolic.effects.source import BANNER, python_source
from symbolic.grammar import laws
from tests.effect_values import evaluate

ALL = laws.drafts()
CARRIERS = [carrier for carrier, _ in laws.GRAMMAR]
MODULATIONS = [laws.NONE, laws.LATE, *laws.POSITIONS, *laws.SPEEDS, *laws.TIMES]
PAIRS = [
    (c, m)
    for c, m in product(CARRIERS, MODULATIONS)
    if m.smooth or not (c.inertial and m.over == "position")  # no inertia that jumps: it would take an impulse
]
guesses = st.sampled_from(PAIRS).map(lambda pair: laws.draft(*pair))


def test_guesses_are_declarations_like_any_other() -> None:
    names = [effect.name for effect in ALL]
    assert len(set(names)) == len(names) > 150
    for effect in ALL:
        check(effect)
        assert effect.name not in LIBRARY
        assert effect.name.startswith(laws.PREFIX)
        assert effect.summary.startswith("A guess. ")
        for sentence in (effect.summary, effect.trace):
            assert sentence[0].isupper()
            assert sentence.endswith(".")
        for p in effect.parameters:
            assert p.name in effect.equation


@settings(max_examples=120, deadline=None)
@given(effect=guesses, joint_type=st.sampled_from(["revolute", "prismatic"]), data=st.data())
def test_units(effect: Effect, joint_type: str, data: st.DataObject) -> None:
    """The same situation in other units of mass, length, time and temperature gives the same torque and states."""
    number = st.floats(0.1, 3.0)
    units = {s.symbol: s.unit for s in (*SIGNALS, *effect.parameters, *effect.states)} | {DT: u.SECOND}
    values = {symbol: data.draw(number) for symbol in units}
    base = [data.draw(st.floats(0.5, 2.0)) for _ in range(4)]

    def scale(unit: u.Unit) -> float:
        return math.prod(b ** float(power) for b, power in zip(base, exponents(unit, joint_type), strict=True))

    other = {symbol: value * scale(units[symbol]) for symbol, value in values.items()}
    for expr, unit in [(effect.torque, u.FORCE), *((s.step, s.unit) for s in effect.states)]:
        assert math.isclose(evaluate(expr, other), evaluate(expr, values) * scale(unit), rel_tol=1e-6, abs_tol=1e-9)


@pytest.mark.parametrize("modulation", [m for m in laws.POSITIONS if m.smooth], ids=lambda m: m.name)
def test_an_inertia_over_the_position_makes_no_energy(modulation: laws.Modulation) -> None:
    """Its power is the change of m(q) qd^2/2, so that nothing is left after a round."""
    effect = laws.draft(laws.INERTIA, modulation)
    m = sum(parameter(p.name) * p.expr for p in modulation.parts)
    energy = m * laws.QD**2 / 2
    change = sp.diff(energy, laws.Q) * laws.QD + sp.diff(energy, laws.QD) * laws.QDD
    assert sp.simplify(effect.torque * laws.QD - change) == 0


@settings(max_examples=120, deadline=None)
@given(effect=guesses, notes=st.lists(st.text(), max_size=3))
def test_a_file_of_a_guess_declares_the_same_guess(
    effect: Effect, notes: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Whatever the notes say: they stay a comment."""
    path = tmp_path_factory.mktemp("guess") / "guess.py"
    text = python_source(effect, notes)
    path.write_text(text, encoding="utf-8")
    assert text.startswith(BANNER)
    assert load_user_effects(path) == (effect,)


@pytest.mark.parametrize("name", ["torque_ripple", "stribeck", "lugre", "end_stop", "coupled_friction", "plate"])
def test_effects_of_the_library_can_be_written_as_well(name: str, tmp_path: Path) -> None:
    """Forms, memories, both joints of a pair and the contact are written as they are declared."""
    from dataclasses import replace

    effect = replace(LIBRARY[name], name=f"my_{name}")
    path = tmp_path / "mine.py"
    path.write_text(python_source(effect), encoding="utf-8")
    assert load_user_effects(path) == (effect,)


def test_a_file_can_take_in_another_beside_it(tmp_path: Path) -> None:
    first, second = ALL[:2]
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "mine.py").write_text(python_source(first), encoding="utf-8")
    (tmp_path / "guess.py").write_text(python_source(second, (), "own/mine.py"), encoding="utf-8")
    assert load_user_effects(tmp_path / "guess.py") == (first, second)
