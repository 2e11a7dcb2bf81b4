"""Motion and springs optimized: Tendon, CasADi's Opti by hand, SLSQP and trust-constr on one program, in one run."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca
import lagrange_reference
import numpy as np
import pytest
from by_hand import ByHand, Solved, scipy_solution
from harness import show, sized
from opti_reference import OptiByHand
from pinocchio_reference import Missing, Reference

from runtime.arrays import Array
from runtime.model.loader import Model
from runtime.planning import scenario_file
from runtime.planning.blocks import assemble
from runtime.planning.evaluate import effort, objective
from runtime.planning.optimize import WIDTH, Infeasible, Planner, StartError, optimize, random_start
from runtime.planning.program import MET, Program
from runtime.planning.scenario import Scenario
from runtime.planning.settings import PlanningSettings
from runtime.progress import on_cores
from symbolic.model_file.arm import Arm

CAP = float(os.environ.get("TENDON_BENCHMARK_CAP", sized("60", "1")))
"""Seconds of processor time after which a solver is stopped, a problem: other work on the machine costs none."""
STARTS = int(os.environ.get("TENDON_BENCHMARK_STARTS", sized("20", "1")))
"""Random starts a problem."""
ONLY = os.environ.get("TENDON_BENCHMARK_CASES", sized("", "2D 0.6"))
"""Beginning of the names of the cases to be run, "2D" for instance."""

LEAST = {"SLSQP": float(sized("20", "0")), "Opti": float(sized("4", "0"))}
"""Times Tendon's whole processor time that the others take over all cases to come near the best cost, at least; where
they never do, all their time counts. A single case says less."""
STUDY = Path(__file__).resolve().parents[2] / "runtime" / "study"
NEAR = 1.01
"""Of the best cost: what counts as the same."""


@pytest.fixture(scope="module")
def cases(model: Model) -> dict[str, Scenario]:
    """The paper's problems by name."""
    first, second = (
        scenario_file.fitted(scenario_file.read(STUDY / f"{name}.toml"), model, name)
        for name in ("scenario1", "scenario2")
    )
    found = {}
    for T in (1.2, 2.0):
        for letter, friction, springs in (
            ("A", False, False),
            ("B", False, True),
            ("C", True, False),
            ("D", True, True),
        ):
            own = first if springs else first.without_springs()
            found[f"1{letter} {T:.1f} s"] = replace(own.at(T), friction=friction)
    for stiffness in (600.0, 1300.0):
        contact = {**second.contact, "plate": {**second.contact["plate"], "stiffness": stiffness}}
        for letter, own in (("C", second.without_springs()), ("D", second)):
            found[f"2{letter} {stiffness / 1000:.1f} kN/m"] = replace(own.at(1.6), contact=contact)
    return {name: scenario for name, scenario in found.items() if name.startswith(ONLY)}


@pytest.fixture(scope="module")
def rnea(vishard4: Arm) -> ca.Function:
    """Somebody else's inverse dynamics in CasADi."""
    try:
        return Reference(vishard4).function()
    except Missing as error:
        print(f"\nwithout Pinocchio: {error}; SymPy's LagrangesMethod stands in")
        return lagrange_reference.casadi_function(vishard4)


def free(scenario: Scenario) -> Scenario:
    """Any stiffness, not those of a catalogue."""
    return replace(scenario, springs=tuple(replace(s, catalogue=()) for s in scenario.springs))


def load() -> str:
    one, five, _ = os.getloadavg()
    return f"{os.cpu_count()} cores with a load of {one:.1f} at the end, {five:.1f} over the last five minutes"


# --- side by side ---


def test_side_by_side(model: Model, vishard4: Arm, rnea: ca.Function, cases: dict[str, Scenario]) -> None:
    """One and the same start for all; that all solve one program is asserted, and that Tendon met its constraints."""
    rows: list[list[str]] = []
    spent, reached = Counter[str](), Counter[str]()
    for name, scenario in cases.items():
        table = _compared(model, vishard4, rnea, free(scenario))
        for solver, run in table.items():
            spent[solver] += run.counted
            reached[solver] += run.near is not None
        rows += [[name, solver, *run.figures(table["Tendon"])] for solver, run in table.items()]
        print("\n".join("  ".join(row) for row in rows[-len(table) :]), flush=True)
    notes = [
        "cost: exact torques of the motion found, by one evaluator; missed: the worst constraint, in its own unit",
        "s: processor time, setup included, in one thread; to 1 %: until constraints are met at a cost that near",
        "to the best of all, of Tendon the whole; ratio: of that, or else of all that was spent, to Tendon's",
        "Tendon: a search with few nodes, then the same nodes as the others, from the one start that all have",
        load(),
    ]
    head = ("case", "solver", "cost", "missed", "s", "to 1 %", "wall s", "steps", "ratio", "")
    for solver in spent:
        times = f"{spent[solver] / spent['Tendon']:.1f} times"
        notes.insert(0, f"all cases: {solver} {times}, near the best in {reached[solver]} of {len(cases)}")
    show("Motion and springs by four solvers", head, rows, notes)
    for name, least in LEAST.items():
        assert spent[name] >= least * spent["Tendon"], name


@dataclass(frozen=True)
class _Run:
    """A solver's run: cost and miss where it ended; near: s of processor time after which it was within NEAR of the
    best cost of all, None: never."""

    solved: Solved
    cost: float
    missed: float
    near: float | None

    @property
    def counted(self) -> float:
        return self.solved.cpu if self.near is None else self.near

    def figures(self, tendon: _Run) -> list[str]:
        there = "never" if self.near is None else f"{self.near:.2f}"
        times = f"{self.counted / tendon.counted:.1f}"
        measured = (
            f"{self.cost:.2f}",
            f"{self.missed:.0e}",
            f"{self.solved.cpu:.2f}",
            there,
            f"{self.solved.seconds:.2f}",
        )
        return [*measured, str(self.solved.iterations), times, "stopped" * self.solved.stopped]


def _compared(model: Model, arm: Arm, rnea: ca.Function, scenario: Scenario) -> dict[str, _Run]:
    judge = Planner(model, scenario)
    program = judge.fine.program
    start = random_start(program, np.random.default_rng(0))
    by_hand = ByHand(program, WIDTH)
    bounds = judge.fine.bounds({})
    _assert_same(program, by_hand, OptiByHand(program, arm, rnea, WIDTH), bounds, start)
    solvers: dict[str, Callable[[], Solved]] = {
        "Tendon": lambda: _tendon(model, scenario, start),
        "Opti": lambda: _opti(program, arm, rnea, start),
        "SLSQP": lambda: scipy_solution(program, WIDTH, "SLSQP", start, bounds, CAP),
        "trust-constr": lambda: scipy_solution(program, WIDTH, "trust-constr", start, bounds, CAP),
    }
    found = {solver: solve() for solver, solve in solvers.items()}
    assert by_hand.violation(found["Tendon"].x) < MET

    def cost(x: Array) -> float:
        return objective(scenario, effort(model, judge.trajectory(x)))

    ends = {solver: (cost(solved.x), by_hand.violation(solved.x)) for solver, solved in found.items()}
    enough = NEAR * min(c for c, missed in ends.values() if missed < MET)

    def near(solved: Solved) -> float | None:
        there = (s for s, x in solved.way if by_hand.violation(x) < MET and cost(x) <= enough)
        return next(there, None)

    return {solver: _Run(solved, *ends[solver], near(solved)) for solver, solved in found.items()}


def _tendon(model: Model, scenario: Scenario, start: Array) -> Solved:
    wall, cpu = time.perf_counter(), time.process_time()
    # As the others, in one process.
    with on_cores(1):
        planner = Planner(model, scenario)
        plan = planner.finish(planner.search([start]))
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    steps = plan.refined.iterations + sum(attempt.iterations for attempt in plan.attempts)
    return Solved(plan.refined.x, wall, cpu, steps, False, plan.refined.status, ((cpu, plan.refined.x),))


def _opti(program: Program, arm: Arm, rnea: ca.Function, start: Array) -> Solved:
    wall, cpu = time.perf_counter(), time.process_time()
    opti = OptiByHand(program, arm, rnea, WIDTH)
    built = time.process_time() - cpu
    solved = opti.solve(start, CAP)
    way = tuple((built + s, x) for s, x in solved.way)
    return replace(solved, seconds=time.perf_counter() - wall, cpu=time.process_time() - cpu, way=way)


def _assert_same(
    program: Program, by_hand: ByHand, opti: OptiByHand, bounds: tuple[Array, Array], start: Array
) -> None:
    """One program three times: at several points the same cost, and every constraint of one in the others."""
    p = ca.DM(program.task.p.vector(program.task.values(WIDTH)))
    assembled = assemble(program.blocks).problem
    whole = ca.Function("whole", [assembled[name] for name in "xp"], [assembled[name] for name in "fg"])
    ends = [np.concatenate([getattr(b, end).ravel() for b in program.blocks]) for end in ("lower", "upper")]
    rng = np.random.default_rng(1)
    for scale in (0.0, 0.01, 0.1):
        x = start + scale * rng.standard_normal(len(start))
        cost, rows = (part.full().ravel() for part in whole(x, p))
        own = _distances(rows, *ends)
        np.testing.assert_allclose(by_hand.cost(x), cost[0], rtol=1e-9)
        hand = np.sort(np.abs(by_hand.equalities(x))), _finite(by_hand.inequalities(x))
        opti_cost, *said = opti.rows(x)
        np.testing.assert_allclose(opti_cost, cost[0], rtol=1e-9)
        # SciPy and IPOPT are told the bounds of the unknowns apart; Opti has them among its constraints.
        peers = hand, _distances(*said)
        bounded = own[0], np.sort(np.concatenate([own[1], _distances(x, *bounds)[1]]))
        for found, expected in zip(peers, (own, bounded), strict=True):
            for part, ours in zip(found, expected, strict=True):
                np.testing.assert_allclose(part, ours, rtol=1e-9, atol=1e-9)


def _distances(rows: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """|miss| of each equality, and how far every inequality is from its bounds; sorted: solvers order freely."""
    equal = lower == upper
    above = np.concatenate([(rows - lower)[~equal], (upper - rows)[~equal]])
    return np.sort(np.abs((rows - lower)[equal])), _finite(above)


def _finite(rows: Array) -> Array:
    """Without those that are no constraint, sorted."""
    return np.sort(rows[np.isfinite(rows)])


# --- as a user has it ---


def test_from_the_scenario_to_the_plan(model: Model, cases: dict[str, Scenario]) -> None:
    """`tendon optimize` without reading and writing: all starts, and the springs of the catalogue."""
    rows, wall, cpu = [], {}, {}
    for name, scenario in cases.items():
        started, busy = time.perf_counter(), _processor_time()
        plan = optimize(model, scenario)
        wall[name], cpu[name] = time.perf_counter() - started, _processor_time() - busy
        springs = ", ".join(f"{s['stiffness'] / 1000:.1f}" for s in plan.trajectory.springs.values())
        figures = f"{plan.cost:.2f}", f"{plan.smooth_cost:.2f}", springs, f"{cpu[name]:.2f}", f"{wall[name]:.2f}"
        rows.append([name, *figures])
    eight = [name for name in cases if name.startswith("1")]
    rows.append(["scenario 1, all", "", "", "", *(f"{sum(t[n] for n in eight):.2f}" for t in (cpu, wall))])
    notes = ["aimed at: each of scenario 1 under 0.4 s, each of scenario 2 under 2 s", load()]
    show("From a scenario to its plan", ("case", "cost", "smooth", "kN/m", "s", "wall s"), rows, notes)


def _processor_time() -> float:
    """s, of this process and of those that it forked and that have ended."""
    return sum(os.times()[:4])


# --- random starts ---


def test_random_starts(model: Model, cases: dict[str, Scenario]) -> None:
    """How many of the single starts, and of whole optimizations with another seed, come near the best."""
    rows, said = [], Counter[str]()
    for name, scenario in cases.items():
        single, whole = _random(model, free(scenario), said)
        best = min(single + whole)
        shares = [f"{_share(costs, best):.0%}" for costs in (single, whole)]
        failed = f"{sum(np.isinf(single)) + sum(np.isinf(whole))}"
        rows.append([name, f"{best:.2f}", *shares, failed, f"{max(whole):.2f}"])
        print("  ".join(rows[-1]), flush=True)
    notes = [
        f"{STARTS} of each (TENDON_BENCHMARK_STARTS); near: within 1 % of the best of the row; aimed at: 95 %",
        *(f"{count} times: {what}" for what, count in said.most_common(8)),
        load(),
    ]
    show("Random starts", ("case", "best", "one start", "optimize", "failed", "worst"), rows, notes)


def _random(model: Model, scenario: Scenario, said: Counter[str]) -> tuple[list[float], list[float]]:
    """Costs of searches from one random start each, and of whole optimizations."""
    planner = Planner(model, scenario)
    single = [
        _cost(lambda seed=seed: planner.plan(1, np.random.default_rng(seed)).cost, said) for seed in range(STARTS)
    ]
    return single, [
        _cost(lambda seed=seed: optimize(model, scenario, PlanningSettings(seed=seed)).cost, said)
        for seed in range(STARTS)
    ]


def _cost(work: Callable[[], float], said: Counter[str]) -> float:
    try:
        return work()
    except (Infeasible, StartError) as error:
        said[str(error)] += 1
        return np.inf


def _share(costs: Sequence[float], best: float) -> float:
    return float(np.mean([cost <= NEAR * best for cost in costs]))
