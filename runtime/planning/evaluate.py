"""A planned motion by the exact laws, without smooth switches: motor torques, objective, limits at every instant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from runtime.arrays import Array
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term, structure
from runtime.planning.program import Bounds, Miss, Program, quadrature
from runtime.planning.scenario import Scenario, is_spring
from runtime.planning.settings import LEAST_POSITION_EXCESS, LEAST_SPEED_EXCESS, LEAST_TORQUE_EXCESS
from runtime.planning.task import limit_label
from runtime.planning.trajectory import JointMotion, Trajectory
from runtime.simulation.simulate import torque_along

Limited = Literal["position", "speed", "torque"]

NODES = 200
"""Gauss-Legendre nodes in each phase: the integrand has kinks where friction and springs switch."""
RATE = 4000.0
"""Hz, at which limits are checked."""
_MOST_INSTANTS = 1_000_000
"""Largest number of instants at which limits are checked: of longer motions, at a lower rate."""
_LEAST: dict[Limited, float] = {
    "position": LEAST_POSITION_EXCESS,
    "speed": LEAST_SPEED_EXCESS,
    "torque": LEAST_TORQUE_EXCESS,
}
_MOST_MOVED = 0.25
"""Largest fraction of the interval between a row's bounds by which they move at once, so that they never meet."""


def mounted(model: Model, trajectory: Trajectory) -> Structure:
    """The arm's terms with the trajectory's springs and contact in place of its own."""
    terms = {
        term: values
        for term, values in structure(model).items()
        if not is_spring(info := model.library[term.effect]) and info.scope != "contact"
    }
    terms |= {trajectory.spring(model.library, joint): dict(v) for joint, v in trajectory.springs.items()}
    return terms | {Term(name): dict(values) for name, values in trajectory.contact.items()}


@dataclass(frozen=True)
class Effort:
    """Torques along a motion at times with quadrature weights (N,): ∫ f dt = Σ weights f.

    terms   that make the torques
    rate    of the samples, Hz, for terms with a memory
    tau     (n, N) motor torques
    """

    model: Model
    motion: JointMotion
    terms: Structure
    rate: float
    weights: Array
    tau: Array

    @cached_property
    def spring(self) -> Array:
        """(n, N) torque with which the springs push the joints forward, τ_s of (2)."""
        m = self.motion
        bare = {term: values for term, values in self.terms.items() if not is_spring(self.model.library[term.effect])}
        return torque_along(self.model, m.q, m.qd, qdd=m.qdd, rate=self.rate, values=bare) - self.tau

    @cached_property
    def cost(self) -> Array:
        """(n,) ∫ τ² dt of each joint, (N m)² s."""
        return np.asarray(self.tau**2 @ self.weights)

    @cached_property
    def tip(self) -> Array:
        """(3, N) x, y, angle of the end-effector; of a spatial arm x, y, z."""
        return self.model.tip(self.motion.q)


def effort(model: Model, trajectory: Trajectory, friction: bool | None = None) -> Effort:
    """Torques at the nodes of a quadrature, phase by phase; friction: None for that of the plan."""
    s, w = quadrature(NODES)
    starts, durations = trajectory.starts[:-1], np.diff(trajectory.starts)
    t = np.concatenate([a + d * s for a, d in zip(starts, durations, strict=True)])
    weights = np.concatenate([d * w for d in durations])
    return at_times(model, trajectory, t, weights, friction=friction)


def at_times(
    model: Model, trajectory: Trajectory, t: Array, weights: Array | None = None, *, friction: bool | None = None
) -> Effort:
    """Torques at times (N,); without weights each sample counts as the mean step."""
    rubs = trajectory.friction if friction is None else friction
    m = trajectory.at(model, t)
    terms = {
        term: values
        for term, values in mounted(model, trajectory).items()
        if rubs or not model.library[term.effect].rubs
    }
    step = float(np.mean(np.diff(t))) if len(t) > 1 else trajectory.duration
    tau = torque_along(model, m.q, m.qd, qdd=m.qdd, rate=1 / step, values=terms)
    return Effort(
        model, m, terms, rate=1 / step, weights=np.full(len(t), step) if weights is None else weights, tau=tau
    )


def objective(scenario: Scenario, found: Effort) -> float:
    """The scenario's objective by exact torques: (N m)² s, a fraction of the torque limit, or J."""
    goal, joints = scenario.objective, [j - 1 for j in scenario.counted]
    if goal.goal == "peak_torque":
        limits = [found.model.joints[i].torque_limit or 1.0 for i in joints]
        return float(max(np.abs(found.tau[i]).max() / limit for i, limit in zip(joints, limits, strict=True)))
    if goal.goal == "positive_work":
        return float(sum(np.maximum(found.tau[i] * found.motion.qd[i], 0.0) @ found.weights for i in joints))
    if goal.goal == "electrical_energy":
        scale = [goal.resistance[i + 1] / (found.model.joints[i].torque_constant or 1.0) ** 2 for i in joints]
        return float(sum(k * found.cost[i] for i, k in zip(joints, scale, strict=True)))
    return float(sum(found.cost[i] for i in joints))


# --- limits, also between the nodes of the program ---


@dataclass(frozen=True)
class Along:
    """A limited quantity of a joint (0-based) along a motion: x (N,) between low and high, in `unit`."""

    what: Limited
    joint: int
    x: Array
    low: float
    high: float
    unit: str

    @property
    def excess(self) -> Array:
        """(N,) distance beyond the nearer limit; negative within."""
        return np.maximum(self.x - self.high, self.low - self.x)

    @property
    def kept(self) -> bool:
        """Whether the excess is at most the allowed one."""
        return not self.excess.max() > _LEAST[self.what] * max(abs(self.low), abs(self.high))

    def missed(self, t: Array) -> Miss:
        """The largest violation of the limit, at one of the times t (N,)."""
        k = int(np.argmax(self.excess))
        return Miss(f"t = {t[k]:.4g} s", limit_label(self.what, self.joint), float(self.excess[k]), self.unit)


def every_instant(model: Model, trajectory: Trajectory, friction: bool | None = None) -> Effort:
    """Torques of one cycle at RATE, ends included; friction: None for that of the plan."""
    t = np.linspace(0.0, trajectory.duration, min(round(trajectory.duration * RATE) + 1, _MOST_INSTANTS))
    # Just before the end, because the end of a periodic motion is its beginning.
    t[-1] = np.nextafter(t[-1], 0.0)
    return at_times(model, trajectory, t, friction=friction)


def limited(seen: Effort) -> Iterator[Along]:
    """All quantities that the model file limits, joint by joint."""
    m = seen.motion
    for i, joint in enumerate(seen.model.joints):
        if joint.position_limits is not None:
            yield Along("position", i, m.q[i], *joint.position_limits, joint.position_unit)
        if joint.speed_limit is not None:
            yield Along(
                "speed", i, m.qd[i], low=-joint.speed_limit, high=joint.speed_limit, unit=f"{joint.position_unit}/s"
            )
        if joint.torque_limit is not None:
            yield Along(
                "torque", i, seen.tau[i], low=-joint.torque_limit, high=joint.torque_limit, unit=joint.force_unit
            )


def tightened(program: Program, bounds: Bounds, t: Array, beyond: Sequence[Along]) -> Bounds:
    """Bounds of the program's rows with tighter limits at the nodes on either side of every violation, by its amount.

    t   (N,) s, of the quantities in `beyond`
    """
    lower, upper = (part.copy() for part in bounds)
    begin, first = 0.0, 0
    for k, plan in enumerate(program.task.scenario.phases):
        block = program.blocks[k]
        rows = slice(first, first + block.lower.size)
        low, high = (part[rows].reshape(block.lower.shape) for part in (lower, upper))
        labels = [what for what, _ in block.expression.labels]
        end = begin + program.task.scenario.cycle_time * plan.part
        edges = np.array([begin, *(begin + (end - begin) * quadrature(program.nodes(plan.degree))[0]), end])
        for along in beyond:
            if (label := limit_label(along.what, along.joint)) in labels:
                row = labels.index(label)
                room = _MOST_MOVED * (high[:, row] - low[:, row])
                low[:, row] += np.minimum(_largest_near(edges, t, along.low - along.x), room)
                high[:, row] -= np.minimum(_largest_near(edges, t, along.x - along.high), room)
        begin, first = end, rows.stop
    return lower, upper


def _largest_near(edges: Array, t: Array, excess: Array) -> Array:
    """(nodes,) largest excess (N,) at times t between the neighbours of each node, at least 0.

    edges   s, increasing: the beginning of a phase, its nodes, its end
    """
    here = (t >= edges[0]) & (t <= edges[-1])
    gap = np.clip(np.searchsorted(edges, t[here], side="right") - 1, 0, len(edges) - 2)
    largest = np.zeros(len(edges) - 1)
    np.maximum.at(largest, gap, excess[here])
    # A node has a gap on either side.
    found: Array = np.maximum(largest[:-1], largest[1:])
    return found
