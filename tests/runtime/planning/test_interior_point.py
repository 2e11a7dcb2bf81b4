"""The dense interior-point method: against IPOPT on the same programs, and where it must give up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from runtime.model.loader import Model
from runtime.planning.blocks import Kernels, Machine
from runtime.planning.interior_point import SOLVED, STUCK, Bounded, Manner, minimize
from runtime.planning.optimize import random_start
from runtime.planning.program import Program, Solver
from runtime.planning.scenario import Scenario


def few(degree: int) -> int:
    return degree + 5


@pytest.fixture(scope="module")
def pressed(model: Model, pressing: Scenario) -> Program:
    return Program.of(model, pressing, few)


def bounded(program: Program, solver: Solver) -> Bounded:
    p = program.task.p.vector(program.task.values(1.0))
    lower, upper = (np.concatenate([getattr(b, end).ravel() for b in program.blocks]) for end in ("lower", "upper"))
    return Bounded(
        Kernels.of(program.blocks, Machine(program.task.model.library.machine)), p, lower, upper, *solver.bounds({})
    )


def test_it_ends_where_ipopt_does(pressed: Program) -> None:
    """From one point near it: the same cost, the same motion."""
    solver = Solver(pressed, 1e-6, 200)
    near = solver.run(random_start(pressed, np.random.default_rng(3)), 1.0).x
    manner = Manner(1e-7, 200, 1e-4, 1e-5)
    whole = bounded(pressed, solver)
    ours = minimize(whole, near, manner)
    theirs = solver._by_ipopt(manner, near, whole)
    assert ours.status == SOLVED
    assert ours.cost == pytest.approx(theirs.cost, rel=1e-5)


def test_a_solution_meets_all_constraints(pressed: Program) -> None:
    whole = bounded(pressed, Solver(pressed, 1e-6, 200))
    found = minimize(whole, random_start(pressed, np.random.default_rng(1)), Manner(1e-6, 200))
    assert found.status == SOLVED
    assert np.maximum(whole.lower - found.rows, found.rows - whole.upper).max() < 1e-6
    assert (found.x >= whole.low).all()
    assert (found.x <= whole.high).all()


def test_out_of_reach_it_gives_up(pressed: Program) -> None:
    """In contact beyond the arm's length there is no posture, and no number to go by."""
    start = random_start(pressed, np.random.default_rng(0))
    u = pressed.task.unknowns
    far = start.copy()
    far[u.points(1, 0)] = 100.0
    found = minimize(bounded(pressed, Solver(pressed, 1e-6, 200)), far, Manner(1e-6, 200))
    assert found.status == STUCK
    assert found.iterations == 0


def test_a_fixed_unknown_stays(pressed: Program) -> None:
    solver = Solver(pressed, 1e-6, 200)
    whole = bounded(pressed, solver)
    low, high = solver.bounds({0: 5100.0})
    found = minimize(
        replace(whole, low=low, high=high), random_start(pressed, np.random.default_rng(2)), Manner(1e-6, 200)
    )
    assert found.x[pressed.task.unknowns.spring(0)][0] == low[pressed.task.unknowns.spring(0)][0]
