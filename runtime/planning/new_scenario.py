"""The scenario of a task: from point to point and back, with parallel springs to be optimized; its text.

Bounds of the springs follow from the task: a simple motion through its points shows which torques they could save.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi, sin

import numpy as np
from scipy.optimize import least_squares

from runtime.arrays import Array
from runtime.model.catalogue import JointInfo
from runtime.model.loader import Model
from runtime.model.terms import SURFACE, Term, giver
from runtime.planning.scenario import usual
from symbolic.model_file.checks import ModelError

DEGREE = 8
"""Of the polynomials: 5 for positions, rates and accelerations at both ends, the others to be optimized; a choice."""
RADIUS = 0.05
"""m of a spring's pulley; a choice."""
STRONGEST = 12.0
"""Largest torque of a spring over the whole motion, as a multiple of the motion's own. A spring that swings with the
joint needs twice that, one that pulls in a third of the motion only nine times; a choice."""
TOUCHING = 0.2
"""Part of the cycle in contact; a choice."""
ONE_WAY = {"revolute": 1.0, "prismatic": 0.2}
"""rad, m; from one point to the other where only the tip's places are stated; a choice."""
LONG = 1.0
"""m to either side of 0, of a prismatic joint without limits; a choice."""
_NEAR = 1e-3
"""m; a point that the tip comes so near is reached."""
_TRIALS, _SAMPLES, _SEED = 12, 200, 0


@dataclass(frozen=True)
class TaskPoint:
    """Positions of all joints (n,), rad or m, or a place of the tip, m, base axes."""

    name: str
    q: tuple[float, ...] = ()
    tip: tuple[float, ...] = ()


@dataclass(frozen=True)
class PointToPoint:
    """What a scenario is begun from.

    name      of the scenario, a C identifier     model   as the scenario names it
    points    two or more: the arm rests at the first and the last one
    back      whether it goes back on the same way, over and over
    springs   joints (from 1) that may have one
    plate     whether the last point is pressed into the plate of the model file
    friction  whether the model's friction is known, so that the motion can be planned with it
    """

    name: str
    model: str
    points: tuple[TaskPoint, ...]
    seconds: float
    back: bool
    springs: tuple[int, ...]
    plate: bool
    friction: bool


def point(model: Model, name: str, text: str) -> TaskPoint:
    """`0.3,-0.5,…` (a position for each joint) or `tip=0.4,0.1` (base x and y, in space x, y and z).

    Raises ModelError: no such point, beyond a limit, out of reach.
    """
    tip, numbers = text.strip().lower().startswith("tip="), text.strip()
    count, what = model.n, "a position for each joint, rad or m"
    if tip:
        numbers = numbers[4:]
        count, what = (3, "x, y and z of the tip, m") if model.spatial else (2, "x and y of the tip, m")
    try:
        values = tuple(float(part) for part in numbers.strip("[] ").split(","))
    except ValueError:
        values = ()
    if len(values) != count or not np.isfinite(values).all():
        raise ModelError(
            f"{name} {text}: expected {count} number{'s' * (count > 1)}, {what}"
            f"{'' if tip else '; or tip=' + ('X,Y,Z' if model.spatial else 'X,Y')}"
        )
    found = TaskPoint(name, tip=values) if tip else TaskPoint(name, q=values)
    _posture(model, found)
    return found


def scenario_text(model: Model, task: PointToPoint) -> str:
    """The scenario file. Raises ModelError: springs at joints that there are not, no plate."""
    postures = np.array([_posture(model, p) for p in task.points])
    stated = all(p.q for p in task.points)
    moving = [j for j in range(1, model.n + 1) if not stated or np.ptp(postures[:, j - 1]) > 0]
    if not moving:
        raise ModelError("the points are the same; expected at least one joint that moves between them")
    for joint in task.springs:
        if joint not in moving:
            raise ModelError(f"--springs: joint {joint} does not move; expected some of {', '.join(map(str, moving))}")
    elbow = "1" if sin(postures[0, min(1, model.n - 1)]) >= 0 else "-1"
    lines = [*_head(task, elbow), *_moving(moving, postures, stated), *_points(task, moving), *_phases(model, task)]
    torques = _torques(model, postures, task)
    for joint in task.springs:
        lines += _spring(model, joint, postures[:, joint - 1], float(torques[joint - 1]), stated)
    return "\n".join(lines) + "\n"


# --- parts of the file ---


def _head(task: PointToPoint, elbow: str) -> Iterator[str]:
    yield "# A task begun with tendon init --scenario; every number may be changed. tendon optimize plans its motion."
    yield f'name = "{task.name}"'
    yield f"model = {json.dumps(task.model)}   # an arm of Tendon, or a model file beside this one"
    yield f"cycle_time = {task.seconds!r}   # s"
    if not task.back:
        yield "periodic = false   # once, from rest to rest"
    if task.plate:
        yield f"elbow = {elbow}   # sign of sin q_2 in contact; as at the first point"
    known = "" if task.friction else "   # its values in the model file are unknown or only proposed"
    yield f"friction = {'true' if task.friction else 'false'}{known}"


def _moving(moving: Sequence[int], postures: Array, stated: bool) -> Iterator[str]:
    if stated and len(moving) < postures.shape[1]:
        yield f"moving = {list(moving)}   # the others are held where `posture` says"
        yield f"posture = {[float(x) for x in postures[0]]}   # rad, m"
    yield from ("", "[objective]", 'goal = "torque_squared"   # or peak_torque, electrical_energy, positive_work')


def _points(task: PointToPoint, moving: Sequence[int]) -> Iterator[str]:
    for p in task.points:
        yield from ("", f"[points.{p.name}]")
        yield from (f"q{j} = {p.q[j - 1]!r}   # rad, m" for j in moving if p.q)
        if p.tip:
            yield f"tip = {list(p.tip)}   # m"
        ends = p in (task.points[0], task.points[-1])
        if ends:
            yield "tip_rest = true   # joints may move" if task.plate and p.tip else "rest = true"


def _phases(model: Model, task: PointToPoint) -> Iterator[str]:
    there = [p.name for p in task.points]
    if task.plate:
        touch = _touch(model, task)
        yield from (
            "",
            f"[points.{touch.name}]   # above the last point, where the plate begins",
            f"tip = {list(touch.tip)}",
        )
        there.insert(-1, touch.name)
    legs = list(pairwise(there))
    legs += [(end, start) for start, end in reversed(legs)] if task.back else []
    touching = {frozenset(there[-2:])} if task.plate else set()
    pressed = sum(frozenset(leg) in touching for leg in legs)
    for start, end in legs:
        contact = frozenset((start, end)) in touching
        free = (1.0 - TOUCHING * bool(pressed)) / (len(legs) - pressed)
        yield from ("", "[[phase]]", f'from = "{start}"', f'to = "{end}"')
        if contact:
            yield 'kind = "contact"   # the end-effector stays on the axis of the plate'
        yield f"part = {(TOUCHING / pressed if contact else free)!r}   # of the cycle time"
        yield f"degree = {DEGREE}"
        if contact:
            yield "monotone = true"


def _touch(model: Model, task: PointToPoint) -> TaskPoint:
    """Where the tip meets the plate above the last point. Raises ModelError."""
    contact = model.contact
    found = contact and giver(model.library, map(Term, contact["effects"]), SURFACE)
    if not contact or not found or "contact_inverse" not in model.functions:
        raise ModelError(
            f"--plate: {model.name} has none; expected a planar arm of four revolute joints with [contact] and a plate"
        )
    term, name = found
    height, last = contact["effects"][term.effect].get(name), task.points[-1]
    if height is None:
        raise ModelError(f"--plate: the model file has no {name} of its {term.effect}; state it")
    if not last.tip or abs(last.tip[0] - contact["x"]) > _NEAR or not last.tip[1] < height:
        raise ModelError(
            f"--plate: --to is pressed into it; expected tip={contact['x']:g},Y with Y below {height:g}, the plate's"
        )
    return TaskPoint("touch", tip=(float(contact["x"]), float(height)))


def _spring(model: Model, joint: int, q: Array, torque: float, stated: bool) -> Iterator[str]:
    info = model.library[usual(model.library.effects)]
    joint_info = model.joints[joint - 1]
    low, high = _range(joint_info)
    reach = float(np.ptp(q)) if stated else min(high - low, ONE_WAY[joint_info.type])
    begin, end = (float(q.min()) - reach, float(q.max()) + reach) if stated else (low, high)
    radius = RADIUS if joint_info.type == "revolute" else 1.0
    yield from ("", "[[spring]]   # at most one for each joint", f"joint = {joint}")
    for p in info.parameters:
        about = f"{p.unit.text(joint_info.type)}, {p.meaning}"
        if p.planned == "size":
            most = _round(STRONGEST * torque / (radius**2 * reach))
            yield f"{p.name} = [0.0, {most!r}]   # {about}: bounds; a single number fixes it"
        elif p.planned == "place":
            yield f"{p.name} = [{begin:.4g}, {end:.4g}]   # {about}: bounds"
        elif p.role == "given":
            yield f"{p.name} = {radius!r}   # {about.partition(';')[0]}; assumed, take yours"
    yield "# catalogue = [1300.0, 2000.0]   # stiffnesses that you can buy, if that is to be respected"


def _round(x: float) -> float:
    return float(f"{x:.2g}") if x > 0 else 1.0


# --- postures and torques ---


def _posture(model: Model, p: TaskPoint) -> Array:
    """(n,) positions: those of the point, or some in which the tip is there. Raises ModelError."""
    if p.q:
        for k, (x, joint) in enumerate(zip(p.q, model.joints, strict=True), 1):
            ends = joint.position_limits
            if ends and not ends[0] <= x <= ends[1]:
                unit = joint.position_unit
                raise ModelError(
                    f"{p.name}: q{k} is {x:g} {unit}; joint {k} can go from {ends[0]:g} to {ends[1]:g} {unit}"
                )
        return np.array(p.q)
    low, high = np.array([_range(joint) for joint in model.joints]).T
    rng, target, best = np.random.default_rng(_SEED), np.array(p.tip), None
    rows = len(target)
    for _ in range(_TRIALS):
        found = least_squares(
            lambda q: model.tip(q)[:rows] - target,
            rng.uniform(low, high),
            jac=lambda q: model.tip_jacobian(q)[:rows],
            bounds=(low, high),
        )
        if best is None or found.cost < best.cost:
            best = found
        if best.cost < 0.5 * _NEAR**2:
            return best.x
    assert best is not None
    away = float(np.linalg.norm(model.tip(best.x)[:rows] - target))
    raise ModelError(f"{p.name}: the tip comes no nearer than {away:.3g} m to {', '.join(f'{x:g}' for x in target)}")


def _range(joint: JointInfo) -> tuple[float, float]:
    """Range of a joint, rad or m; a whole turn or 2 LONG if the file states none."""
    return joint.position_limits or ((-pi, pi) if joint.type == "revolute" else (-LONG, LONG))


def _torques(model: Model, postures: Array, task: PointToPoint) -> Array:
    """(n,) largest torques along a cosine from point to point, without friction and springs."""
    seconds = task.seconds / (len(postures) - 1) / (1 + task.back)
    s = np.linspace(0.0, np.pi, _SAMPLES)
    largest = np.zeros(model.n)
    for start, end in pairwise(postures):
        move, rate = (end - start)[:, None], np.pi / seconds
        q = start[:, None] + move * (1.0 - np.cos(s)) / 2.0
        tau = model.inverse_dynamics(q, move * np.sin(s) / 2.0 * rate, move * np.cos(s) / 2.0 * rate**2)
        largest = np.maximum(largest, np.abs(tau).max(axis=1))
    return largest
