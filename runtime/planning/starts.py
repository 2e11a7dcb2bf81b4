"""Where a search begins: random postures that meet the points, and straight lines between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from runtime.model.loader import JointInfo, Model
from runtime.planning.direction import turn_needed
from runtime.planning.program import Program
from runtime.planning.scenario import Point

Array = NDArray[np.float64]

_TRIES = 200
_STEPS = 40
_REACHED = 1e-6  # m, rad
_DAMPING = 1e-3  # m/rad, of the least squares near singular postures
_SPAN = {"revolute": 2.0, "prismatic": 0.3}
"""To either side of zero, where the model file states no limit."""
_BENT = 0.1
"""Least |sin q_2| in contact."""
_SCATTER = 0.15
"""Of a joint's span: standard deviation of control points about the straight line."""


class StartError(ValueError):
    """No posture meets a point; the message says which."""


def random_start(program: Program, rng: np.random.Generator) -> Array:
    """Unknowns (nx,) of a random first guess. Raises StartError."""
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
        x[u.spring(k)] = [rng.uniform(*b) / p.scale for p, b in zip(spring.sought, spring.bounds, strict=True)]
    if scenario.objective.goal == "peak_torque":
        x[u.peak] = 1.0
    return x


def _limits(program: Program) -> Array:
    """(n, 2) range of each joint's position."""
    joints = enumerate(program.task.model.joints)
    return np.array([program.task.span(i) or (-_SPAN[j.type], _SPAN[j.type]) for i, j in joints])


def _postures(program: Program, rng: np.random.Generator) -> Mapping[str, Array]:
    """A posture (n,) for each point; each is sought from the one before, so that they lie near each other."""
    found: dict[str, Array] = {}
    touching = {name for p in program.task.scenario.phases if p.kind == "contact" for name in (p.start, p.end)}
    # Those in contact first: they leave the least choice.
    order = sorted(program.task.scenario.points, key=lambda name: name not in touching)
    near: Array | None = None
    for name in order:
        near = _posture(program, program.task.scenario.points[name], name in touching, rng, near)
        if near is None:
            tip = program.task.scenario.points[name].tip
            raise StartError(
                f'{program.task.scenario.name}: point "{name}": no posture within the limits found'
                + (f" that reaches ({', '.join(f'{x:g}' for x in tip)}) m" if tip else "")
                + (" in that direction" if program.task.scenario.points[name].directed else "")
                + "; check the target, the lengths of the links and the position limits"
            )
        found[name] = near
    return found


def _posture(
    program: Program, point: Point, touching: bool, rng: np.random.Generator, before: Array | None
) -> Array | None:
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
    """The posture nearby that meets the point, by damped least squares; joints that rest or are given stay."""
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
    for _ in range(_STEPS):
        miss, J = _missing(model, point, q)
        if np.linalg.norm(miss) < _REACHED:
            return _turned(model.joints, q, able)
        if not able:  # every joint rests or is given
            return None
        J = J[:, able]
        step = J.T @ np.linalg.solve(J @ J.T + _DAMPING**2 * np.eye(len(miss)), miss)
        q[able] += step * min(1.0, 0.5 / max(np.abs(step).max(), 1e-12))
    return None


def _missing(model: Model, point: Point, q: Array) -> tuple[Array, Array]:
    """What the end-effector at q lacks of what the point asks for, m and rad (k,), and its Jacobian (k, n)."""
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


def _turned(joints: Sequence[JointInfo], q: Array, able: list[int]) -> Array:
    """Whole turns of revolute joints taken out."""
    for i in able:
        if joints[i].type == "revolute":
            q[i] = (q[i] + np.pi) % (2 * np.pi) - np.pi
    return q
