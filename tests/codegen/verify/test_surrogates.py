"""The optimizer's smooth surrogates against the exact laws of C."""

from __future__ import annotations

import random

import numpy as np
import pytest
import sympy as sp

from codegen.effect_functions import torque
from codegen.verify import reference
from codegen.verify.reference import Reference
from symbolic.effects import LIBRARY
from symbolic.primitives import WIDTHS, ramp, sgn, smooth, step

STATIC = [name for name, effect in LIBRARY.items() if effect.torque.has(sgn, step, ramp)]


@pytest.mark.parametrize("name", STATIC)
def test_tends_to_the_exact_law(name: str) -> None:
    """At any point off the switching points, from some width on the surrogate is the exact law itself."""
    effect = LIBRARY[name]
    exact, surrogate = (Reference(torque(effect), rule) for rule in ("exact", "smooth"))
    for seed in range(10):
        values = reference.effect_values(random.Random(seed), effect)
        errors = []
        for width in (1.0, 1e-2, 1e-4, 1e-9):
            values |= dict.fromkeys(WIDTHS, width)
            errors.append(abs(surrogate(values)[0] - exact(values)[0]))
        assert errors[-1] <= 1e-30 * (1 + abs(exact(values)[0]))
        assert errors[-1] <= errors[0]


@pytest.mark.parametrize("primitive", [sgn, step, ramp])
def test_equals_the_exact_law_outside_the_width(primitive: type) -> None:
    x = sp.Symbol("x", real=True)
    law = smooth(primitive(x, sp.Rational(1, 4)))
    exact = {sgn: lambda v: np.sign(v), step: lambda v: float(v > 0), ramp: lambda v: max(v, 0)}[primitive]
    for value in (-3.0, -0.5, -0.25, 0.25, 0.5, 3.0):
        assert float(law.subs(x, sp.Rational(value))) == exact(value)


@pytest.mark.parametrize("primitive", [sgn, step, ramp])
def test_joins_with_slope_and_curvature(primitive: type) -> None:
    """Twice differentiable: from inside, value, slope and curvature reach those of the exact law."""
    x = sp.Symbol("x", real=True)
    inside = sp.simplify(
        smooth(primitive(x, 1)).subs({sp.Max(-1, sp.Min(1, x)): x, sp.Max(0, x - 1): 0, sp.Max(0, -x - 1): 0})
    )
    slope = {sgn: (0, 0), step: (0, 0), ramp: (0, 1)}[primitive]
    for end, expected in zip((-1, 1), slope, strict=True):
        assert sp.diff(inside, x).subs(x, end) == expected
        assert sp.diff(inside, x, 2).subs(x, end) == 0
