"""What a planned motion asks of the motors, by the exact laws: the compiled equations, no smooth switch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime.model.loader import Model
from runtime.model.terms import Structure, Term, structure
from runtime.planning.program import quadrature
from runtime.planning.scenario import Scenario
from runtime.planning.springs import is_spring
from runtime.planning.trajectory import JointMotion, Trajectory
from runtime.simulation.simulate import torque_along

Array = NDArray[np.float64]

NODES = 200
"""Of Gauss and Legendre in each phase: the integrand has kinks where friction and springs switch."""


def mounted(model: Model, trajectory: Trajectory) -> Structure:
    """The arm's terms with the springs and the contact that the trajectory was planned for, and no others."""
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

    terms   of which the torques are made; rate: of the samples, Hz, for what has a memory
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
        """(n, N) What the springs push the joints forward with, τ_s of (2)."""
        m = self.motion
        bare = {term: values for term, values in self.terms.items() if not is_spring(self.model.library[term.effect])}
        return torque_along(self.model, m.q, m.qd, m.qdd, self.rate, bare) - self.tau

    @cached_property
    def cost(self) -> Array:
        """(n,) ∫ τ² dt of each joint, (N m)² s."""
        return np.asarray(self.tau**2 @ self.weights)

    @cached_property
    def tip(self) -> Array:
        """(3, N) x, y, angle of the end-effector; of a spatial arm x, y, z."""
        return self.model.tip(self.motion.q)


def effort(model: Model, trajectory: Trajectory, friction: bool | None = None) -> Effort:
    """Torques at the nodes of a quadrature, phase by phase; friction: None for as it was planned."""
    s, w = quadrature(NODES)
    starts, durations = trajectory.starts[:-1], np.diff(trajectory.starts)
    t = np.concatenate([a + d * s for a, d in zip(starts, durations, strict=True)])
    weights = np.concatenate([d * w for d in durations])
    return at_times(model, trajectory, t, weights, friction)


def at_times(
    model: Model, trajectory: Trajectory, t: Array, weights: Array | None = None, friction: bool | None = None
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
    tau = torque_along(model, m.q, m.qd, m.qdd, 1 / step, terms)
    return Effort(model, m, terms, 1 / step, np.full(len(t), step) if weights is None else weights, tau)


def objective(scenario: Scenario, found: Effort) -> float:
    """What the scenario minimizes, of exact torques: (N m)² s, a part of the torque limit, or J."""
    goal = scenario.objective
    joints = [j - 1 for j in goal.joints or scenario.moving]
    if goal.goal == "peak_torque":
        limits = [found.model.joints[i].torque_limit or 1.0 for i in joints]
        return float(max(np.abs(found.tau[i]).max() / limit for i, limit in zip(joints, limits, strict=True)))
    if goal.goal == "positive_work":
        return float(sum(np.maximum(found.tau[i] * found.motion.qd[i], 0.0) @ found.weights for i in joints))
    if goal.goal == "electrical_energy":
        scale = [goal.resistance[i + 1] / (found.model.joints[i].torque_constant or 1.0) ** 2 for i in joints]
        return float(sum(k * found.cost[i] for i, k in zip(joints, scale, strict=True)))
    return float(sum(found.cost[i] for i in joints))
