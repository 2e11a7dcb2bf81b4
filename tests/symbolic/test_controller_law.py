"""Equation (7): how much of the friction the controller compensates."""

from __future__ import annotations

import math

import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from symbolic.controller_law import C_E, C_U, underestimated

F, QD = sp.symbols("F qd", real=True)


def compensated(friction: float, rate: float, share: float, slope: float) -> float:
    values = {F: friction, QD: rate, C_U: share, C_E: slope}
    return float(underestimated(F, QD).subs(values))


@given(
    friction=st.floats(-50.0, 50.0),
    rate=st.floats(-10.0, 10.0),
    share=st.floats(0.0, 1.0),
    slope=st.floats(0.1, 200.0),
)
def test_never_more_than_the_friction_and_nothing_at_rest(
    friction: float, rate: float, share: float, slope: float
) -> None:
    """The controller never drives the joint by what it compensates."""
    torque = compensated(friction, rate, share, slope)
    assert abs(torque) <= abs(share * friction) * (1 + 1e-12)
    assert torque * friction >= 0.0
    assert torque == compensated(friction, -rate, share, slope)
    assert compensated(friction, 0.0, share, slope) == 0.0


def test_the_share_at_a_rate() -> None:
    """At 1/c_e the share is c_u (1 - 1/e); far above, c_u."""
    assert compensated(10.0, 0.02, 0.9, 50.0) == pytest.approx(9.0 * (1 - 1 / math.e))
    assert compensated(10.0, 2.0, 0.9, 50.0) == pytest.approx(9.0)
