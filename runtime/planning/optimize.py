"""Motion and springs together: the best of several starts, then the springs that can be bought."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle, product
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from runtime.model.loader import Library, Model
from runtime.planning.evaluate import Effort, at_times, effort, objective
from runtime.planning.limits import Along, every_instant, limited
from runtime.planning.options import PlanningSettings
from runtime.planning.program import Program
from runtime.planning.scenario import Scenario
from runtime.planning.settings import MOST_TIGHTENINGS
from runtime.planning.solve import Attempt, Miss, Solver
from runtime.planning.springs import SoughtSpring, usual
from runtime.planning.starts import random_start
from runtime.planning.task import Task
from runtime.planning.tightening import tightened
from runtime.planning.trajectory import Phase, Trajectory
from runtime.progress import of_long, one_thread, steps

Array = NDArray[np.float64]
T = TypeVar("T")

WIDTH = 0.1
"""rad/s (m/s): within this of standstill dry friction is smooth. The exact torque is evaluated afterwards."""
_WAYS = ((5 * WIDTH, 2 * WIDTH, WIDTH), (2 * WIDTH, WIDTH / 2))
"""Widths on the way from the search to the result. Where joints stick, each may end in a slightly worse place."""
_SOFT = 1.0
"""The same while searching: so smooth that each start finds its basin in some thirty steps."""
_STEPS = 30
"""Of a solution, about."""
_WORTH_FORKING = 0.06
"""s of work, which processes begin and end in some hundredths of a second."""
_STARTS = 4
_SHARES = (0.01, 0.3)
"""Of the squared torque of joints whose spring is yet to be chosen, in the motions that it is chosen for."""
_PLACES = 41


def _few(degree: int) -> int:
    """Nodes a phase that tell basins apart."""
    return degree + 5


def _many(degree: int) -> int:
    """Nodes a phase between which no kink of a spring can hide."""
    return 3 * degree + 20


@dataclass(frozen=True)
class SpringChoice:
    """A spring, or one for each sprung joint, that can be bought: sizes (SI) by joint, and what it costs."""

    sizes: Mapping[int, float]
    cost: float | None


@dataclass(frozen=True)
class Plan:
    """What an optimization found.

    trajectory  with the springs chosen; effort: its exact torques; cost: the objective, exact
    smooth_cost what the program, smooth at standstill, made of it
    springs     as sought; free: sizes (SI) by joint before a spring was chosen from a catalogue
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
    springs: tuple[SoughtSpring, ...]
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


def optimize(model: Model, scenario: Scenario, settings: PlanningSettings = PlanningSettings()) -> Plan:
    """The best of several random starts, with the springs of the catalogues if there are some.

    Raises Infeasible if no start meets all constraints, StartError if no posture meets a point.
    """
    free = any(point.reached for point in scenario.points.values())
    count = (_STARTS if free else 1) if settings.starts is None else settings.starts
    return Planner(model, scenario).plan(count, np.random.default_rng(settings.seed))


class Planner:
    """The programs of one scenario: a coarse one to search with, a fine one for the result."""

    def __init__(self, model: Model, scenario: Scenario) -> None:
        self.model, self.scenario, self._started = model, scenario, time.perf_counter()
        task = Task(model, scenario)
        self.coarse, self.fine = Solver(Program(task, _few), 1e-3, 150), Solver(Program(task, _many), 1e-8, 400)
        self._step: Callable[[], None] = lambda: None

    def plan(self, starts: int, rng: np.random.Generator) -> Plan:
        with one_thread(), steps("solutions", self._solutions(starts)) as self._step:
            return self.finish(self.search([random_start(self.coarse.program, rng) for _ in range(starts)]))

    def _solutions(self, starts: int) -> int:
        """How many solutions a plan takes, about."""
        searched = max(starts, len(_SHARES)) + 2 * len(_SHARES) if self.scenario.springs else starts
        bought = sum(bool(spring.catalogue) for spring in self.scenario.springs)
        return searched + len(_WAYS) + (2**bought if bought else 0)

    def _each(self, solver: Solver, solve: Callable[[T], Attempt], parts: Sequence[T]) -> list[Attempt]:
        """What `solve` finds with the solver for each part, on all cores where that is worth their processes."""
        worth = _STEPS * solver.pace * len(parts) > _WORTH_FORKING
        found = []
        for attempt in of_long(solve, parts) if worth else map(solve, parts):
            found.append(attempt)
            self._step()
        return found

    def search(self, guesses: Sequence[Array]) -> list[Attempt]:
        """Coarse solutions, the best first.

        The motion that suits a spring can be far from the one without: so springs begin as they suit motions for
        which torque at their joints is nearly free, or costs less.
        """
        coarse = self.coarse
        if not self.scenario.springs:
            # A large barrier carries all guesses into one wide basin, a small one leaves each in its own: which of them
            # is the better is seen at the end.
            begun = list(zip(cycle((coarse.run, coarse.refine)), guesses, strict=False))
            return sorted(self._each(coarse, lambda begin: begin[0](begin[1], _SOFT), begun), key=self._rank)
        # Each guess serves one share, and a single one both.
        shared = [(k, x) for k in range(len(_SHARES)) for x in guesses[k :: len(_SHARES)] or guesses]
        found = self._each(coarse, lambda part: coarse.relieved(part[1], _SOFT, _SHARES[part[0]]), shared)
        sprung = []
        for k in range(len(_SHARES)):
            own = [attempt for (share, _), attempt in zip(shared, found, strict=True) if share == k]
            sprung += self._sprung(min(own, key=lambda a: (not a.met, a.cost)).x)
        return sorted(self._each(coarse, lambda x: coarse.refine(x, _SOFT), sprung), key=self._rank)

    def _rank(self, attempt: Attempt) -> tuple[bool, float]:
        """The cheapest that meets all constraints, else the one that misses them least.

        By the exact cost: between few nodes a kink of a spring can hide.
        """
        if attempt.missed is not None:
            return True, attempt.missed.amount
        return False, objective(self.scenario, effort(self.model, self.trajectory(attempt.x)))

    def finish(self, attempts: Sequence[Attempt]) -> Plan:
        """The first attempt refined, and its springs chosen."""
        ways = self._each(self.fine, lambda widths: self._refined(attempts[0].x, widths), _WAYS)
        free, (*_, width) = min(zip(ways, _WAYS, strict=True), key=lambda way: self._rank(way[0]))
        if free.missed is not None:
            raise Infeasible(self.scenario, free.missed, attempts)
        fixed, chosen, choices = self._chosen(free, width)
        chosen = self._kept_everywhere(chosen, width, fixed)
        if chosen.missed is not None:
            raise Infeasible(self.scenario, chosen.missed, attempts)
        trajectory = self.trajectory(chosen.x)
        found = effort(self.model, trajectory)
        setup = self.coarse.setup_seconds + self.fine.setup_seconds
        return Plan(
            scenario=self.scenario,
            trajectory=trajectory,
            effort=found,
            cost=objective(self.scenario, found),
            smooth_cost=chosen.cost,
            springs=self.fine.program.task.springs,
            free={
                s.plan.joint: size for s, size in zip(self.fine.program.task.springs, self._sizes(free), strict=True)
            },
            choices=choices,
            attempts=tuple(attempts),
            refined=free,
            setup_seconds=setup,
            seconds=time.perf_counter() - self._started,
            left_out={str(term): why for term, why in self.fine.program.task.physics.left_out.items()},
        )

    def _refined(self, x: Array, widths: Sequence[float]) -> Attempt:
        *before, last = widths
        for width in before:
            x = self.fine.near(x, width)
        return self.fine.onwards(x, last)

    def _kept_everywhere(self, found: Attempt, width: float, fixed: Mapping[int, float]) -> Attempt:
        """The motion, sought again where it goes beyond a limit between its nodes, at which alone a program asks."""
        rows = self.fine.rows
        for _ in range(MOST_TIGHTENINGS):
            t, beyond = self._beyond(found.x)
            if found.missed is not None or not beyond:
                return found
            rows = tightened(self.fine.program, rows, t, beyond)
            found = self.fine.onwards(found.x, width, fixed, rows)
        t, beyond = self._beyond(found.x)
        return replace(found, missed=found.missed or next((along.missed(t) for along in beyond), None))

    def _beyond(self, x: Array) -> tuple[Array, list[Along]]:
        """Instants of a motion, and the limits that it does not keep at all of them."""
        seen = every_instant(self.model, self.trajectory(x))
        return seen.motion.t, [along for along in limited(seen) if not along.kept]

    def _spring(self, k: int) -> slice:
        return self.fine.program.task.unknowns.spring(k)

    # --- springs ---

    def _values(self, x: Array) -> list[dict[str, float]]:
        """All parameters of each spring, SI."""
        springs = enumerate(self.fine.program.task.springs)
        return [{name: float(v) for name, v in s.values(x[self._spring(k)]).items()} for k, s in springs]

    def _sizes(self, found: Attempt) -> list[float]:
        springs = self.fine.program.task.springs
        return [values[s.size.name] for s, values in zip(springs, self._values(found.x), strict=True)]

    def _sprung(self, x: Array) -> list[Array]:
        """x with springs that take most of the squared torque off its motion, and with others that are always taut.

        The first are often slack for most of the motion, and from there a search does not reach the second.
        """
        t = np.linspace(0.0, self.scenario.cycle_time, 400, endpoint=False)
        bare = at_times(self.model, self.trajectory(x, springs=False), t)
        fitting, taut = x.copy(), x.copy()
        for k, spring in enumerate(self.fine.program.task.springs):
            i = spring.plan.joint - 1
            fitting[self._spring(k)] = _relief(self.model.library, bare, i, spring)
            values = {spring.size.name: sum(spring.plan.sought[spring.size.name]) / 2}
            if spring.place is not None:
                q, bounds = bare.motion.q[i], spring.plan.sought[spring.place.name]
                values[spring.place.name] = min(q.max() + np.ptp(q) / 2, bounds[1])
            taut[self._spring(k)] = spring.unknowns(values)
        return [fitting, taut]

    def _chosen(self, free: Attempt, width: float) -> tuple[Mapping[int, float], Attempt, tuple[SpringChoice, ...]]:
        """The last step of section IV.A, for both neighbours in each catalogue: fixed, and the motion sought again.

        Gives the sizes chosen, by number of the spring (0-based), and the motion with them, too.
        """
        springs = self.scenario.springs
        options = [neighbours(s.catalogue, k) for s, k in zip(springs, self._sizes(free), strict=True)]
        if not any(options):
            return {}, free, ()
        combinations = [
            {k: value for k, value in enumerate(combination) if value is not None}
            for combination in product(*(o or (None,) for o in options))
        ]
        found = self._each(self.fine, lambda fixed: self.fine.onwards(free.x, width, fixed), combinations)
        tried = sorted(zip(combinations, found, strict=True), key=lambda item: self._rank(item[1]))
        if tried[0][1].missed is not None:
            raise Infeasible(self.scenario, tried[0][1].missed, [attempt for _, attempt in tried])
        named = [
            SpringChoice({springs[k].joint: v for k, v in fixed.items()}, attempt.cost if attempt.met else None)
            for fixed, attempt in tried
        ]
        return *tried[0], tuple(named)

    # --- results ---

    def trajectory(self, x: Array, springs: bool = True) -> Trajectory:
        """The motion that the unknowns x describe, with its springs or with none."""
        s, u = self.scenario, self.fine.program.task.unknowns
        phases = []
        for k, plan in enumerate(s.phases):
            points = np.tile(np.array(s.posture)[:, None], plan.degree + 1)
            if plan.kind == "contact":
                points[0] = self.model.contact["x"] if self.model.contact else 0.0
            for row, c in enumerate(u.free[k]):
                points[c] = x[u.points(k, row)]
            phases.append(Phase("q" if plan.kind == "free" else "w", s.cycle_time * plan.part, points))
        library = self.model.library
        own = list(zip(self.fine.program.task.springs, self._values(x), strict=True)) if springs else []
        mounted = {spring.plan.joint: values for spring, values in own}
        foreign = {s.plan.joint: s.info.name for s, _ in own if s.info.name != usual(library.effects)}
        contact = {
            term.effect: dict(values)
            for term, values in self.fine.program.task.physics.terms.items()
            if library[term.effect].scope == "contact"
        }
        told = self.model.name, s.name, tuple(phases), s.periodic, s.elbow, s.friction
        return Trajectory(*told, mounted, contact, foreign)


def _relief(library: Library, bare: Effort, i: int, spring: SoughtSpring) -> list[float]:
    """Unknowns of the spring that leaves the least squared torque of joint i (0-based) of a motion without springs."""
    torque, read = bare.tau[i], {"q": bare.motion.q[i], "qd": bare.motion.qd[i]}
    bounds = spring.plan.sought
    best: tuple[float, float, float] | None = None
    for place in [0.0] if spring.place is None else np.linspace(*bounds[spring.place.name], _PLACES):
        pull = -library.torque(spring.info.name, read, spring.relieving(float(place)))
        square = float(pull @ pull)
        size = float(np.clip(torque @ pull / square if square else 0.0, *bounds[spring.size.name]))
        found = float(np.sum((torque - size * pull) ** 2)), size / spring.size.scale, float(place)
        best = found if best is None else min(best, found)
    assert best is not None
    return [best[1] if p is spring.size else best[2] / p.scale for p in spring.sought]


def neighbours(catalogue: Sequence[float], stiffness: float) -> tuple[float, ...]:
    """The nearest in a catalogue on either side of a stiffness."""
    below = [k for k in catalogue if k <= stiffness]
    above = [k for k in catalogue if k > stiffness]
    return (*([max(below)] if below else []), *([min(above)] if above else []))
