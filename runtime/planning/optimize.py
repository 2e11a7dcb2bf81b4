"""Motion and springs together: the best of several starts, then the springs that can be bought."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from runtime.model.loader import Library, Model
from runtime.planning.evaluate import Effort, at_times, effort, objective
from runtime.planning.program import STIFFNESS_UNIT, Program
from runtime.planning.scenario import Scenario, SpringPlan
from runtime.planning.solve import Attempt, Miss, Solver
from runtime.planning.starts import random_start
from runtime.planning.trajectory import SPRING, Phase, Trajectory

Array = NDArray[np.float64]

WIDTH = 0.1
"""rad/s (m/s): within this of standstill dry friction is smooth. The exact torque is evaluated afterwards."""
_WAYS = ((WIDTH,), (2 * WIDTH, WIDTH / 2))
"""Widths on the way from the search to the result. Where joints stick, each may end in a slightly worse place."""
_SOFT = 1.0
"""The same while searching: so smooth that each start finds its basin in some thirty steps."""
_STARTS = 4
_SHARES = (0.01, 0.3)
"""Of the squared torque of joints whose spring is yet to be chosen, in the motions that it is chosen for."""
_OFFSETS = 41


def _few(degree: int) -> int:
    """Nodes a phase that tell basins apart."""
    return degree + 5


def _many(degree: int) -> int:
    """Nodes a phase between which no kink of a spring can hide."""
    return 3 * degree + 20


@dataclass(frozen=True)
class SpringChoice:
    """A spring, or one for each sprung joint, that can be bought: stiffness (N/m) by joint, and what it costs."""

    stiffness: Mapping[int, float]
    cost: float | None


@dataclass(frozen=True)
class Plan:
    """What an optimization found.

    trajectory  with the springs chosen; effort: its exact torques; cost: the objective, exact
    smooth_cost what the program, smooth at standstill, made of it
    free        stiffness (N/m) by joint before a spring was chosen from a catalogue
    choices     the springs of the catalogue that were compared, the chosen one first
    attempts    of the search, in order; refined: the best of them on the fine program
    setup_seconds, seconds   to build the programs, and altogether
    left_out    effects of the model that a plan cannot hold, and why
    """

    scenario: Scenario
    trajectory: Trajectory
    effort: Effort
    cost: float
    smooth_cost: float
    free: Mapping[int, float]
    choices: tuple[SpringChoice, ...]
    attempts: tuple[Attempt, ...]
    refined: Attempt
    setup_seconds: float
    seconds: float
    left_out: Mapping[str, str]


class Infeasible(Exception):
    """No start met all constraints; missed: the least that stands in the way."""

    def __init__(self, scenario: Scenario, missed: Miss, attempts: Sequence[Attempt]) -> None:
        self.missed, self.attempts = missed, tuple(attempts)
        super().__init__(f"{scenario.name}: no motion meets all constraints; in the best of {len(attempts)}, {missed}")


def optimize(model: Model, scenario: Scenario, starts: int | None = None, seed: int = 0) -> Plan:
    """The best of several random starts, with the springs of the catalogues if there are some.

    starts   None: one, or several where postures are free because points ask for the end-effector only
    Raises Infeasible if no start meets all constraints, StartError if no posture meets a point.
    """
    free = any(point.tip is not None for point in scenario.points.values())
    count = (_STARTS if free else 1) if starts is None else starts
    return Planner(model, scenario).plan(count, np.random.default_rng(seed))


class Planner:
    """The programs of one scenario: a coarse one to search with, a fine one for the result."""

    def __init__(self, model: Model, scenario: Scenario) -> None:
        self.model, self.scenario, self._started = model, scenario, time.perf_counter()
        self.coarse = Solver(Program(model, scenario, _few), 1e-3, 150)
        self.fine = Solver(Program(model, scenario, _many), 1e-6, 400)

    def plan(self, starts: int, rng: np.random.Generator) -> Plan:
        return self.finish(self.search([random_start(self.coarse.program, rng) for _ in range(starts)]))

    def search(self, guesses: Sequence[Array]) -> list[Attempt]:
        """Coarse solutions, the best first.

        The motion that suits a spring can be far from the one without: so springs begin as they suit motions for
        which torque at their joints is nearly free, or costs less.
        """
        if not self.scenario.springs:
            return sorted((self.coarse.run(x, _SOFT) for x in guesses), key=self._rank)
        sprung = []
        for k, share in enumerate(_SHARES):
            # Each guess serves one share, and a single one both.
            own = guesses[k :: len(_SHARES)] or guesses
            relieved = min((self.coarse.relieved(x, _SOFT, share) for x in own), key=lambda a: (not a.met, a.cost))
            sprung += [self.coarse.refine(guess, _SOFT) for guess in self._sprung(relieved.x)]
        return sorted(sprung, key=self._rank)

    def _rank(self, attempt: Attempt) -> tuple[bool, float]:
        """The cheapest that meets all constraints, else the one that misses them least.

        By the exact cost: between few nodes a kink of a spring can hide.
        """
        if attempt.missed is not None:
            return True, attempt.missed.amount
        return False, objective(self.scenario, effort(self.model, self.trajectory(attempt.x)))

    def finish(self, attempts: Sequence[Attempt]) -> Plan:
        """The first attempt refined, and its springs chosen."""
        free = min((self._refined(attempts[0].x, widths) for widths in _WAYS), key=self._rank)
        if free.missed is not None:
            raise Infeasible(self.scenario, free.missed, attempts)
        chosen, choices = self._chosen(free)
        trajectory = self.trajectory(chosen.x)
        found = effort(self.model, trajectory)
        setup = self.coarse.setup_seconds + self.fine.setup_seconds
        return Plan(
            scenario=self.scenario,
            trajectory=trajectory,
            effort=found,
            cost=objective(self.scenario, found),
            smooth_cost=chosen.cost,
            free={s.joint: free.x[self._spring(k)][0] * STIFFNESS_UNIT for k, s in enumerate(self.scenario.springs)},
            choices=choices,
            attempts=tuple(attempts),
            refined=free,
            setup_seconds=setup,
            seconds=time.perf_counter() - self._started,
            left_out={str(term): why for term, why in self.fine.program.physics.left_out.items()},
        )

    def _refined(self, x: Array, widths: Sequence[float]) -> Attempt:
        for width in widths:
            found = self.fine.refine(x, width)
            x = found.x
        return found

    def _spring(self, k: int) -> slice:
        return self.fine.program.unknowns.spring(k)

    # --- springs ---

    def _sprung(self, x: Array) -> list[Array]:
        """x with springs that take most of the squared torque off its motion, and with others that are always taut.

        The first are often slack for most of the motion, and from there a search does not reach the second.
        """
        t = np.linspace(0.0, self.scenario.cycle_time, 400, endpoint=False)
        bare = at_times(self.model, self.trajectory(x, springs=False), t)
        fitting, taut = x.copy(), x.copy()
        for k, spring in enumerate(self.scenario.springs):
            torque, q = bare.tau[spring.joint - 1], bare.motion.q[spring.joint - 1]
            fitting[self._spring(k)] = _relief(self.model.library, torque, q, spring)
            offset = min(q.max() + np.ptp(q) / 2, spring.offset[1])
            taut[self._spring(k)] = sum(spring.stiffness) / 2 / STIFFNESS_UNIT, offset
        return [fitting, taut]

    def _chosen(self, free: Attempt) -> tuple[Attempt, tuple[SpringChoice, ...]]:
        """The last step of section IV.A, for both neighbours in each catalogue: fixed, and the motion sought again."""
        springs = self.scenario.springs
        sought = [free.x[self._spring(k)][0] * STIFFNESS_UNIT for k in range(len(springs))]
        options = [neighbours(s.catalogue, k) for s, k in zip(springs, sought, strict=True)]
        if not any(options):
            return free, ()
        tried = []
        for combination in product(*(o or (None,) for o in options)):
            fixed = {k: value for k, value in enumerate(combination) if value is not None}
            tried.append((fixed, self.fine.refine(free.x, WIDTH, fixed)))
        tried.sort(key=lambda item: (not item[1].met, item[1].cost))
        if tried[0][1].missed is not None:
            raise Infeasible(self.scenario, tried[0][1].missed, [attempt for _, attempt in tried])
        named = [
            SpringChoice({springs[k].joint: v for k, v in fixed.items()}, attempt.cost if attempt.met else None)
            for fixed, attempt in tried
        ]
        return tried[0][1], tuple(named)

    # --- results ---

    def trajectory(self, x: Array, springs: bool = True) -> Trajectory:
        """The motion that the unknowns x describe, with its springs or with none."""
        s, u = self.scenario, self.fine.program.unknowns
        phases = []
        for k, plan in enumerate(s.phases):
            points = np.tile(np.array(s.posture)[:, None], plan.degree + 1)
            if plan.kind == "contact":
                points[0] = self.model.contact["x"] if self.model.contact else 0.0
            for row, c in enumerate(u.free[k]):
                points[c] = x[u.points(k, row)]
            phases.append(Phase("q" if plan.kind == "free" else "w", s.cycle_time * plan.part, points))
        mounted = {
            spring.joint: {
                "stiffness": float(x[u.spring(k)][0]) * STIFFNESS_UNIT,
                "radius": spring.radius,
                "offset": float(x[u.spring(k)][1]),
                "pretension": spring.pretension,
            }
            for k, spring in enumerate(s.springs if springs else ())
        }
        library = self.model.library
        contact = {
            term.effect: dict(values)
            for term, values in self.fine.program.physics.terms.items()
            if library[term.effect].scope == "contact"
        }
        return Trajectory(self.model.name, s.name, tuple(phases), s.periodic, s.elbow, s.friction, mounted, contact)


def _relief(library: Library, torque: Array, q: Array, spring: SpringPlan) -> tuple[float, float]:
    """Stiffness (kN/m) and offset that leave the least squared torque (N,) at positions q (N,)."""
    best = (np.inf, 0.0, 0.0)
    for offset in np.linspace(*spring.offset, _OFFSETS):
        unit = {"stiffness": 1.0, "radius": spring.radius, "offset": float(offset), "pretension": 0.0}
        pull = -library.torque(SPRING, {"q": q}, unit)
        size = float(pull @ pull)
        k = float(np.clip(torque @ pull / size if size else 0.0, *spring.stiffness))
        best = min(best, (float(np.sum((torque - k * pull) ** 2)), k / STIFFNESS_UNIT, float(offset)))
    return best[1:]


def neighbours(catalogue: Sequence[float], stiffness: float) -> tuple[float, ...]:
    """The nearest in a catalogue on either side of a stiffness."""
    below = [k for k in catalogue if k <= stiffness]
    above = [k for k in catalogue if k > stiffness]
    return (*([max(below)] if below else []), *([min(above)] if above else []))
