"""Motion and springs together: random starts, the best of their solutions, then the springs that can be bought."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle, product
from typing import TypeVar

import numpy as np
from msgspec import UNSET, UnsetType

from runtime.arrays import Array
from runtime.documents.parts import IterationsEntry
from runtime.model.loader import Library, Model
from runtime.planning.evaluate import (
    Along,
    Effort,
    at_times,
    effort,
    every_instant,
    limited,
    objective,
    tightened,
)
from runtime.planning.physics import turn_needed
from runtime.planning.program import Attempt, Miss, Program, Solver
from runtime.planning.scenario import Point, Scenario, SoughtSpring, usual
from runtime.planning.settings import MOST_TIGHTENINGS, PlanningSettings
from runtime.planning.task import Task
from runtime.planning.trajectory import Phase, Trajectory
from runtime.progress import of_long, one_thread, steps
from runtime.setting import LEAST_TIME_LIMIT, SearchSettings

T = TypeVar("T")

WIDTH = 0.1
"""rad/s (m/s); dry friction is smooth within this speed. The exact torque is evaluated afterwards."""
_WAYS = ((5 * WIDTH, 2 * WIDTH, WIDTH), (2 * WIDTH, WIDTH / 2))
"""Sequences of widths from the search to the result. Where joints stick, either may end in a slightly worse minimum."""
_SOFT = 1.0
"""Width of the search: so smooth that each start finds its basin in some thirty steps."""
_STARTS = 4
_SHARES = (0.01, 0.3)
"""Shares of the squared torque that count at joints with unknown springs, in motions for which springs are chosen."""
_PLACES = 41

_TRIES = 200
_REACH_STEPS = 40
_REACHED = 1e-6  # m, rad
_DAMPING = 1e-3  # m/rad, of the least squares near singular postures
_SPAN = {"revolute": 2.0, "prismatic": 0.3}
"""Range to either side of zero where the model file states no limit."""
_BENT = 0.1
"""Least |sin q_2| in contact."""
_SCATTER = 0.15
"""Standard deviation of control points about the straight line, as a fraction of a joint's span."""


def _few(degree: int) -> int:
    return degree + 5


def _many(degree: int) -> int:
    return 3 * degree + 20


@dataclass(frozen=True)
class SpringChoice:
    """A combination of springs that can be bought: sizes (SI) by joint; cost: of the objective, None if infeasible."""

    sizes: Mapping[int, float]
    cost: float | None


@dataclass(frozen=True)
class Plan:
    """The result of an optimization.

    trajectory   with the springs chosen; effort: its exact torques; cost: the exact objective
    smooth_cost  the objective of the program, which is smooth at standstill
    springs      as sought; free: optimal sizes (SI) by joint, before springs were chosen from a catalogue
    choices      the springs of the catalogue that were compared, the chosen one first
    attempts     of the search, the best first; refined: the best of them on the fine program
    search       how many iterations all solutions took
    setup_seconds, seconds   to build the programs, and in total
    left_out     effects of the model that a plan cannot hold, and why
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
    search: IterationsEntry
    setup_seconds: float
    seconds: float
    left_out: Mapping[str, str]


class StartError(ValueError):
    """No posture meets a point; the message says which."""


class Infeasible(Exception):
    """No start met all constraints; missed: the largest violation of the best attempt; search: as of a plan."""

    def __init__(self, scenario: Scenario, missed: Miss, attempts: Sequence[Attempt], search: IterationsEntry) -> None:
        self.missed, self.attempts, self.search = missed, tuple(attempts), search
        super().__init__(f"{scenario.name}: no motion meets all constraints; in the best of {len(attempts)}, {missed}")


def optimize(model: Model, scenario: Scenario, settings: PlanningSettings = PlanningSettings()) -> Plan:
    """The best of several random starts, with springs from the catalogues if there are any.

    Raises Infeasible if no start meets all constraints, StartError if no posture meets a point.
    """
    free = any(point.reached for point in scenario.points.values())
    count = (_STARTS if free else 1) if settings.starts is None else settings.starts
    return Planner(model, scenario, settings).plan(count, np.random.default_rng(settings.seed))


def without_springs(
    model: Model, plan: Plan, settings: PlanningSettings = PlanningSettings()
) -> Plan | Infeasible | UnsetType:
    """The best motion of a plan's scenario without its springs, with what is left of what the search may do; Infeasible
    where no motion meets all constraints without them, UNSET where it has none."""
    if not plan.scenario.springs:
        return UNSET
    budget = settings.budget and max(settings.budget - plan.search.iterations, 1)
    limit = settings.time_limit and max(settings.time_limit - plan.seconds, LEAST_TIME_LIMIT)
    try:
        return optimize(model, plan.scenario.without_springs(), replace(settings, budget=budget, time_limit=limit))
    except Infeasible as error:
        return error


class Planner:
    """The programs of one scenario: a coarse one for the search, a fine one for the result."""

    def __init__(self, model: Model, scenario: Scenario, allowed: SearchSettings = SearchSettings()) -> None:
        self.model, self.scenario, self._started = model, scenario, time.perf_counter()
        task = Task(model, scenario)
        self.coarse, self.fine = Solver(Program(task, _few), 1e-3, 150), Solver(Program(task, _many), 1e-8, 400)
        self.coarse.until = self.fine.until = time.monotonic() + allowed.seconds
        self._budget, self._solved = allowed.budget, list[Attempt]()
        self._step: Callable[[], None] = lambda: None

    def plan(self, starts: int, rng: np.random.Generator) -> Plan:
        """The best of so many random starts."""
        searched = max(starts, len(_SHARES)) + 2 * len(_SHARES) if self.scenario.springs else starts
        bought = sum(bool(spring.catalogue) for spring in self.scenario.springs)
        # The number of solutions, approximately.
        count = searched + len(_WAYS) + (2**bought if bought else 0)
        with one_thread(), steps("solutions", count) as self._step:
            return self.finish(self.search([random_start(self.coarse.program, rng) for _ in range(starts)]))

    def _each(
        self, solver: Solver, solve: Callable[[T], Attempt], parts: Sequence[T], solutions: int = 1
    ) -> list[Attempt]:
        """solve(part) with the solver for each part, on all cores. They share half of the iterations that are left, so
        that later stages have some, too; solutions: of a part at most."""
        if self._budget is not None:
            left = max(self._budget - self.came.iterations, 0)
            solver.most = min(solver.iterations, left // (2 * len(parts) * solutions))
        found = []
        for attempt in of_long(solve, parts):
            found.append(attempt)
            self._step()
        self._solved += found
        return found

    @property
    def came(self) -> IterationsEntry:
        """How many iterations all solutions took so far."""
        made, allowed = (sum(getattr(a, name) for a in self._solved) for name in ("iterations", "allowed"))
        return IterationsEntry.of(made, self._budget or allowed, [attempt.ended for attempt in self._solved])

    def search(self, guesses: Sequence[Array]) -> list[Attempt]:
        """Coarse solutions, the best first.

        The best motion with a spring can be far from the one without. So springs begin with the parameters that suit
        motions for which torque at their joints is nearly free, or costs less.
        """
        coarse = self.coarse
        if not self.scenario.springs:
            # A large barrier takes all guesses into one wide basin, a small one leaves each in its own. Either may
            # be better.
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
        if attempt.missed is not None:
            return True, attempt.missed.amount
        return False, objective(self.scenario, effort(self.model, self.trajectory(attempt.x)))

    def finish(self, attempts: Sequence[Attempt]) -> Plan:
        """The first attempt refined, with its springs chosen from the catalogues."""
        ways = self._each(self.fine, lambda widths: self._refined(attempts[0].x, widths), _WAYS, len(_WAYS[0]))
        free, (*_, width) = min(zip(ways, _WAYS, strict=True), key=lambda way: self._rank(way[0]))
        if free.missed is not None:
            raise Infeasible(self.scenario, free.missed, attempts, self.came)
        fixed, chosen, choices = self._chosen(free, width)
        chosen = self._kept_everywhere(chosen, width, fixed)
        if chosen.missed is not None:
            raise Infeasible(self.scenario, chosen.missed, attempts, self.came)
        trajectory = self.trajectory(chosen.x)
        found = effort(self.model, trajectory)
        springs = self.fine.program.task.springs
        return Plan(
            scenario=self.scenario,
            trajectory=trajectory,
            effort=found,
            cost=objective(self.scenario, found),
            smooth_cost=chosen.cost,
            springs=springs,
            free={s.plan.joint: size for s, size in zip(springs, self._sizes(free), strict=True)},
            choices=choices,
            attempts=tuple(attempts),
            refined=free,
            search=self.came,
            setup_seconds=self.coarse.setup_seconds + self.fine.setup_seconds,
            seconds=time.perf_counter() - self._started,
            left_out={str(term): why for term, why in self.fine.program.task.physics.left_out.items()},
        )

    def _refined(self, x: Array, widths: Sequence[float]) -> Attempt:
        """Through the widths; with the iterations of all of them."""
        *before, last = widths
        way = []
        for width in before:
            way.append(self.fine.near(x, width))
            x = way[-1].x
        way.append(self.fine.onwards(x, last))
        made, allowed = (sum(getattr(a, name) for a in way) for name in ("iterations", "allowed"))
        ended = IterationsEntry.of(made, allowed, [attempt.ended for attempt in way]).ended
        return replace(way[-1], iterations=made, allowed=allowed, ended=ended)

    def _kept_everywhere(self, found: Attempt, width: float, fixed: Mapping[int, float]) -> Attempt:
        """The motion, computed again with tighter limits where it exceeds one between its nodes."""
        rows = self.fine.rows
        for _ in range(MOST_TIGHTENINGS):
            t, beyond = self._beyond(found.x)
            if found.missed is not None or not beyond:
                return found
            rows = tightened(self.fine.program, rows, t, beyond)
            (found,) = self._each(self.fine, partial(self.fine.onwards, width=width, sizes=fixed, rows=rows), [found.x])
        t, beyond = self._beyond(found.x)
        return replace(found, missed=found.missed or next((along.missed(t) for along in beyond), None))

    def _beyond(self, x: Array) -> tuple[Array, list[Along]]:
        """Times of a motion (N,) s, and the limits that it exceeds at some of them."""
        seen = every_instant(self.model, self.trajectory(x))
        return seen.motion.t, [along for along in limited(seen) if not along.kept]

    # --- springs ---

    def _values(self, x: Array) -> list[dict[str, float]]:
        springs, place = enumerate(self.fine.program.task.springs), self.fine.program.task.unknowns.spring
        return [{name: float(v) for name, v in s.values(x[place(k)]).items()} for k, s in springs]

    def _sizes(self, found: Attempt) -> list[float]:
        springs = self.fine.program.task.springs
        return [values[s.size.name] for s, values in zip(springs, self._values(found.x), strict=True)]

    def _sprung(self, x: Array) -> list[Array]:
        """x with springs that take most of the squared torque off its motion, and with springs that are always taut.

        The former are often slack for most of the motion, and from there a search does not reach the latter.
        """
        t = np.linspace(0.0, self.scenario.cycle_time, 400, endpoint=False)
        bare = at_times(self.model, self.trajectory(x, springs=False), t)
        fitting, taut, place = x.copy(), x.copy(), self.fine.program.task.unknowns.spring
        for k, spring in enumerate(self.fine.program.task.springs):
            i = spring.plan.joint - 1
            fitting[place(k)] = _relief(self.model.library, bare, i, spring)
            values = {spring.size.name: sum(spring.plan.sought[spring.size.name]) / 2}
            if spring.place is not None:
                q, bounds = bare.motion.q[i], spring.plan.sought[spring.place.name]
                values[spring.place.name] = min(q.max() + np.ptp(q) / 2, bounds[1])
            taut[place(k)] = spring.unknowns(values)
        return [fitting, taut]

    def _chosen(self, free: Attempt, width: float) -> tuple[Mapping[int, float], Attempt, tuple[SpringChoice, ...]]:
        """The last step of section IV.A, for both neighbours in each catalogue: the motion with the size fixed.

        Returns the chosen sizes by number of the spring (0-based), the motion with them, and all choices.
        """
        springs = self.scenario.springs
        options = [_neighbours(s.catalogue, k) for s, k in zip(springs, self._sizes(free), strict=True)]
        if not any(options):
            return {}, free, ()
        combinations = [
            {k: value for k, value in enumerate(combination) if value is not None}
            for combination in product(*(o or (None,) for o in options))
        ]
        found = self._each(self.fine, lambda fixed: self.fine.onwards(free.x, width, fixed), combinations)
        tried = sorted(zip(combinations, found, strict=True), key=lambda item: self._rank(item[1]))
        if tried[0][1].missed is not None:
            raise Infeasible(self.scenario, tried[0][1].missed, [attempt for _, attempt in tried], self.came)
        named = [
            SpringChoice({springs[k].joint: v for k, v in fixed.items()}, attempt.cost if attempt.met else None)
            for fixed, attempt in tried
        ]
        return *tried[0], tuple(named)

    # --- results ---

    def trajectory(self, x: Array, springs: bool = True) -> Trajectory:
        """The motion of the unknowns x, with its springs or without."""
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
        return Trajectory(
            arm=self.model.name,
            scenario=s.name,
            phases=tuple(phases),
            periodic=s.periodic,
            elbow=s.elbow,
            friction=s.friction,
            springs=mounted,
            contact=contact,
            effects=foreign,
        )


def _relief(library: Library, bare: Effort, i: int, spring: SoughtSpring) -> list[float]:
    """Unknowns of the spring that minimizes the squared torque of joint i (0-based) of a motion without springs."""
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


def _neighbours(catalogue: Sequence[float], stiffness: float) -> tuple[float, ...]:
    below = [k for k in catalogue if k <= stiffness]
    above = [k for k in catalogue if k > stiffness]
    return (*([max(below)] if below else []), *([min(above)] if above else []))


# --- first guesses ---


def random_start(program: Program, rng: np.random.Generator) -> Array:
    """Unknowns (nx,) of a random first guess: postures that meet the points, straight lines between them, disturbed.

    Raises StartError.
    """
    scenario, u = program.task.scenario, program.task.unknowns
    postures = _postures(program, rng)
    x = np.zeros(u.size)
    span = _limits(program) @ np.array([-1.0, 1.0])
    for k, plan in enumerate(scenario.phases):
        line = np.linspace(postures[plan.start], postures[plan.end], plan.degree + 1, axis=1)
        if plan.kind == "contact":
            line = program.task.model.contact_coordinates(line)
        else:
            inner = line[:, 1:-1]
            inner += _SCATTER * span[:, None] / 2 * rng.standard_normal(inner.shape)
        for row, c in enumerate(u.free[k]):
            x[u.points(k, row)] = line[c]
    for k, spring in enumerate(program.task.springs):
        x[u.spring(k)] = [rng.uniform(*spring.plan.sought[p.name]) / p.scale for p in spring.sought]
    if scenario.objective.goal == "peak_torque":
        x[u.peak] = 1.0
    return x


def _limits(program: Program) -> Array:
    """(n, 2) range of each joint's position."""
    joints = enumerate(program.task.model.joints)
    return np.array([program.task.span(i) or (-_SPAN[j.type], _SPAN[j.type]) for i, j in joints])


def _postures(program: Program, rng: np.random.Generator) -> Mapping[str, Array]:
    """A posture (n,) for each point; the search for each begins at the previous one, so that they are close."""
    found: dict[str, Array] = {}
    scenario = program.task.scenario
    touching = {name for p in scenario.phases if p.kind == "contact" for name in (p.start, p.end)}
    near: Array | None = None
    # Those in contact first, because they have the least freedom.
    for name in sorted(scenario.points, key=lambda name: name not in touching):
        point = scenario.points[name]
        near = _posture(program, point, name in touching, rng=rng, before=near)
        if near is None:
            raise StartError(
                f'{scenario.name}: point "{name}": no posture within the limits found'
                + (f" that reaches ({', '.join(f'{x:g}' for x in point.tip)}) m" if point.tip else "")
                + (" in that direction" if point.directed else "")
                + "; check the target, the lengths of the links and the position limits"
            )
        found[name] = near
    return found


def _posture(
    program: Program, point: Point, touching: bool, *, rng: np.random.Generator, before: Array | None
) -> Array | None:
    """A posture within the limits that meets a point; None if none is found."""
    limits = _limits(program)
    for attempt in range(_TRIES):
        guess = rng.uniform(limits[:, 0], limits[:, 1]) if before is None or attempt else before
        q = _reach(program, point, guess)
        if q is None or np.any((q < limits[:, 0]) | (q > limits[:, 1])):
            continue
        if not touching or program.task.scenario.elbow * np.sin(q[1]) > _BENT:
            return q
    return None


def _reach(program: Program, point: Point, q: Array) -> Array | None:
    """The posture near q that meets the point, by damped least squares; joints that rest or are given stay."""
    model, scenario = program.task.model, program.task.scenario
    q = q.copy()
    for i, posture in enumerate(scenario.posture):
        if i not in program.task.moving:
            q[i] = posture
    for joint, value in point.q.items():
        q[joint - 1] = value
    if not point.reached:
        return q
    able = [i for i in program.task.moving if i + 1 not in point.q]
    for _ in range(_REACH_STEPS):
        miss, J = _missing(model, point, q)
        if np.linalg.norm(miss) < _REACHED:
            # Without whole turns of revolute joints.
            turning = [i for i in able if model.joints[i].type == "revolute"]
            q[turning] = (q[turning] + np.pi) % (2 * np.pi) - np.pi
            return q
        if not able:
            return None
        J = J[:, able]
        step = J.T @ np.linalg.solve(J @ J.T + _DAMPING**2 * np.eye(len(miss)), miss)
        q[able] += step * min(1.0, 0.5 / max(np.abs(step).max(), 1e-12))
    return None


def _missing(model: Model, point: Point, q: Array) -> tuple[Array, Array]:
    """Distance from the end-effector at q to what the point requires, m and rad (k,), and its Jacobian (k, n)."""
    J, misses, rows = model.tip_jacobian(q), [np.zeros(0)], [np.zeros((0, model.n))]
    if point.tip is not None:
        count = len(point.tip)
        misses.append(np.array(point.tip) - model.tip(q)[:count])
        rows.append(J[:count])
    if point.directed:
        axes, angles = turn_needed(point, model.call("tip_rotation", {"q": q}))
        misses.append(angles)
        rows.append(axes @ J[3:])
    return np.concatenate(misses), np.vstack(rows)
