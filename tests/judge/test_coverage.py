"""Which true values the judge holds against reported intervals, and how it counts them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from . import cases, coverage, rates, scoring
from .bench import Setting
from .bodies import ARMS, inertial_columns, inertial_values
from .cases import Made
from .coverage import Covered
from .line import Line, logged

SEED = 42


def made(name: str, joints: int = 1, **changes: Any) -> Made:
    setting = replace(Setting(excitation="brief"), **changes)
    return cases.make(next(iter(cases.cases([name], [joints], [1.0], [SEED], setting))))


def document(*effects: tuple[str, int | None, dict[str, float]], skew: float | None = None) -> dict[str, Any]:
    """An identification's JSON with these values, each with an interval of one thousandth to either side."""
    return {
        "inertial": [],
        "skew": {"value": 0.5 if skew is None else skew, "estimated": skew is None},
        "effects": [
            {
                "effect": effect,
                "joint": joint,
                "parameters": {k: {"value": v, "interval": [v - 1e-3, v + 1e-3]} for k, v in values.items()},
            }
            for effect, joint, values in effects
        ],
    }


def test_true_values_are_the_plants() -> None:
    case = made("stribeck")
    row = case.plant[0]
    found = coverage.covered(
        case,
        document(
            ("stribeck", 1, {"torque": row["CREEP"], "speed": row["CREEP_SPEED"] + 0.01}),
            ("coulomb_asymmetric", 1, {"positive": row["DRY_POSITIVE"], "negative": row["DRY_NEGATIVE"]}),
        ),
        None,
    )
    assert [(c.parameter, c.holds) for c in found] == [
        ("stribeck torque", True),
        ("stribeck speed", False),
        ("coulomb_asymmetric positive", True),
        ("coulomb_asymmetric negative", True),
    ]
    assert {c.family for c in found} == {"friction"}
    read = coverage.from_text(coverage.to_text(found))
    assert [(c.family, c.parameter) for c in read] == [(c.family, c.parameter) for c in found]
    assert [(c.true, c.low, c.high) for c in read] == [pytest.approx((c.true, c.low, c.high), rel=1e-5) for c in found]


def test_a_springs_rest_is_not_held_against_two_dry_frictions() -> None:
    row = {"stiffness": 1.0, "rest": 7.0}
    spring = made("linear_spring")
    found = coverage.covered(
        spring, document(("linear_spring", 1, row), ("coulomb_asymmetric", 1, {"positive": 0.0, "negative": 0.0})), None
    )
    assert [c.parameter for c in found] == ["linear_spring stiffness"]


def test_a_cables_constant_lies_in_the_dry_frictions() -> None:
    cable = made("cable")
    row = cable.plant[0]
    constant = -row["SPRING"] * row["SPRING_REST"]
    dry = {"positive": row["DRY_POSITIVE"] + constant, "negative": row["DRY_NEGATIVE"] - constant}
    found = coverage.covered(cable, document(("coulomb_asymmetric", 1, dry)), None)
    assert abs(constant) > 1e-3
    assert all(c.holds for c in found)


def test_a_phase_is_true_at_any_number_of_turns() -> None:
    ripple = made("torque_ripple")
    row = ripple.plant[0]
    values = {"order": row["RIPPLE_ORDER"] / 100, "amplitude": row["RIPPLE"], "phase": row["RIPPLE_PHASE"] - 2 * np.pi}
    found = coverage.covered(ripple, document(("torque_ripple", 1, values)), None)
    assert len(found) == 3
    assert all(c.holds for c in found)


def test_gravity_is_what_the_model_file_leaves_out() -> None:
    case = made("gravity_left_out")
    assert "gravity = [0.0, 0.0]" in case.model
    assert case.gravity == (0.0, 0.0)
    found = coverage.covered(case, document(("gravity", None, {"gx": 0.0, "gy": -9.81})), None)
    assert all(c.holds for c in found)
    known = made("load_friction_upright")
    assert "gravity = [0.0, -9.81]" in known.model


@pytest.mark.parametrize("n", [1, 2])
def test_true_lumps_give_the_true_torque(n: int) -> None:
    case = made("clean", n)

    def regressor(q: Any, qd: Any, qdd: Any) -> Any:
        return inertial_columns(ARMS[n], q, qd, qdd, case.gravity)

    lumps = coverage.true_lumps(case, regressor)
    states = np.random.default_rng(1).uniform(-1, 1, (3, n, 20))
    expected = np.einsum("ikt,k->it", regressor(*states), inertial_values(ARMS[n]))
    assert lumps is not None
    assert np.allclose(np.einsum("ikt,k->it", regressor(*states), lumps), expected)


def test_an_unknown_inertia_leaves_no_true_lump() -> None:
    assert coverage.true_lumps(made("coupled_gear", 2), lambda *_: pytest.fail("not asked for")) is None


def test_intervals_are_counted_by_family() -> None:
    held, missed = Covered("springs", "cable c1", 1.0, 0.9, 1.2), Covered("springs", "cable c2", 1.0, 1.1, 1.2)
    row = Line("cable", "single", 1, 1, "", 0.5, covered=coverage.to_text([held, missed]))
    printed = rates.coverage_table([row, replace(row, seed=2)])
    assert any(x.split()[:3] == ["springs", "2", "4"] for x in printed)
    assert any(x.split()[:4] == ["cable", "c2", "0", "2"] for x in printed)
    assert rates.coverage_table([replace(row, covered="")]) == []


def test_exactly_is_right_and_nothing_more() -> None:
    stribeck, form = made("stribeck"), made("stribeck_lorentz")
    right, more = scoring.Score("right", 0, True), scoring.Score("right", 1, True)
    assert scoring.exact(right, "effect", stribeck)
    assert not scoring.exact(more, "effect", stribeck)
    assert not scoring.exact(right, "effect", form)
    clean = made("clean")
    assert scoring.exact(scoring.Score("right", 0, False), "clean", clean)
    assert not scoring.exact(scoring.Score("right", 0, False), "refused", clean)


def test_the_lines_of_a_ripple_are_counted_wherever_an_order_is_said() -> None:
    lines = made("ripple_lines")

    def finding(*orders: float) -> dict[str, Any]:
        return {"parameters": {f"order{k or ''}": {"value": x} for k, x in enumerate(orders)}}

    assert scoring.lines(lines, []) == "0/3"
    assert scoring.lines(lines, [finding(18.05, 72.0)]) == "2/3"
    assert scoring.lines(lines, [finding(18.0), finding(72.0), finding(144.1)]) == "3/3"
    assert scoring.lines(made("stribeck"), [finding(18.0)]) == ""


def test_a_case_goes_through_files() -> None:
    case = made("stribeck", temperature=False)
    read = logged(case)
    assert np.allclose(read.recording.q, case.recording.q, rtol=0, atol=1e-11)
    assert read.recording.path == case.recording.path
