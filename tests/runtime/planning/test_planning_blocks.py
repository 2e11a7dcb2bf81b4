"""Derivatives of the optimizer's programs: against CasADi's of the whole expression, and against differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from runtime.model.loader import Library, Model
from runtime.planning.blocks import Sum, assemble
from runtime.planning.optimize import random_start
from runtime.planning.program import Program
from runtime.planning.scenario import Objective, Scenario
from symbolic.model_file.arm import Limits
from tests.runtime.planning.planning_cases import and_back, arm


def few(degree: int) -> int:
    return degree


GOALS = ("torque_squared", "peak_torque", "electrical_energy", "positive_work")


@pytest.fixture(scope="module")
def sliding(library: Library) -> Model:
    """Two revolute joints and a slide between them, with limits of every kind."""
    limits = Limits(position=(-2.0, 2.0), speed=4.0, torque=30.0)
    return arm(
        library, "rpr", limits, {"coulomb": {"torque": 0.7}, "viscous": {"coefficient": 0.3}}, torque_constant=2.0
    )


@pytest.fixture(scope="module")
def reaching(sliding: Model) -> Scenario:
    spring = {"stiffness": [100.0, 4000.0], "offset": [-1.0, 1.0], "radius": 0.05, "pretension": 3.0}
    return and_back(
        sliding,
        1.1,
        {"tip": [0.5, 0.3]},
        {"q1": 0.4, "q2": 0.1},
        spring=[{"joint": 1, **spring}, {"joint": 3, **spring}],
    )


def at_random(program: Program, seed: int) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """x, p, and multipliers of the cost and of the rows."""
    rng = np.random.default_rng(seed)
    x = random_start(program, rng)
    rows = sum(block.expression.rows.numel() * block.count for block in program.blocks)
    return x, program.task.p.vector(program.task.values(0.3)), rng.uniform(0.5, 2.0), rng.standard_normal(rows)


def assert_derivatives(program: Program, seed: int = 0) -> None:
    """Gradient, Jacobian and Hessian of the Lagrangian are those that CasADi derives from the whole expression."""
    x, p, scale, y = at_random(program, seed)
    whole: Sum = assemble(program.blocks)
    problem = whole.problem
    lagrangian = scale * problem["f"] + ca.dot(ca.DM(y), problem["g"])
    hessian, _ = ca.hessian(lagrangian, problem["x"])
    symbols = [problem["x"], problem["p"]]
    gradient = ca.gradient(problem["f"], problem["x"])
    jacobian = ca.jacobian(problem["g"], problem["x"])
    expected = ca.Function("expected", symbols, [problem["f"], gradient, problem["g"], jacobian, ca.triu(hessian)])(
        x, p
    )
    found = whole.derivatives
    both = zip(
        [*found["grad_f"](x, p), *found["jac_g"](x, p), found["hess_lag"](x, p, scale, y)], expected, strict=True
    )
    for ours, casadi in both:
        dense = np.array(ca.DM(casadi))
        np.testing.assert_allclose(np.array(ca.DM(ours)), dense, atol=1e-9 * max(1.0, np.abs(dense).max()))


@pytest.mark.parametrize("goal", GOALS)
def test_derivatives_of_every_objective(sliding: Model, reaching: Scenario, goal: str) -> None:
    objective = Objective(goal, resistance={1: 0.5, 2: 0.6, 3: 0.7} if goal == "electrical_energy" else {})
    assert_derivatives(Program.of(sliding, replace(reaching, objective=objective), few))


def test_derivatives_in_contact(model: Model, pressing: Scenario) -> None:
    assert_derivatives(Program.of(model, pressing, few), seed=3)


def test_derivatives_are_slopes(model: Model, pressing: Scenario) -> None:
    """Central differences along a random direction: a route without automatic derivatives."""
    program = Program.of(model, pressing, few)
    x, p, scale, y = at_random(program, seed=4)
    whole = assemble(program.blocks)
    values = ca.Function("values", [whole.problem["x"], whole.problem["p"]], [whole.problem["f"], whole.problem["g"]])
    first, rows, second = (whole.derivatives[name] for name in ("grad_f", "jac_g", "hess_lag"))
    h = 1e-6
    way = np.random.default_rng(5).standard_normal(len(x))
    above, below = x + h * way, x - h * way

    def slope(f: Callable[[np.ndarray], Any]) -> np.ndarray:
        return (np.array(f(above)) - np.array(f(below))) / (2 * h)

    gradient, jacobian = np.array(first(x, p)[1]), np.array(ca.DM(rows(x, p)[1]))
    upper = np.array(ca.DM(second(x, p, scale, y)))
    hessian = upper + np.triu(upper, 1).T

    def lagrangian_slope(at: np.ndarray) -> np.ndarray:
        return scale * np.array(first(at, p)[1]) + np.array(ca.DM(rows(at, p)[1])).T @ y[:, None]

    pairs = [
        (gradient.ravel() @ way, slope(lambda at: values(at, p)[0])),
        (jacobian @ way, slope(lambda at: values(at, p)[1])),
        (hessian @ way, slope(lagrangian_slope)),
    ]
    for exact, differences in pairs:
        # Rounding and the third derivative: about the cube root of 1e-16 squared, of the largest entry.
        scale_of = np.abs(exact).max()
        np.testing.assert_allclose(np.ravel(differences), np.ravel(exact), atol=1e-6 * scale_of)
