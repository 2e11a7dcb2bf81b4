"""Trajectories for the arm of the paper, and what a controller should do on them, composed in double."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, pi

import numpy as np
from scipy.signal import lfilter
from stepped import Controller

from codegen.c.controller import MIN_DEGREE
from runtime.arrays import Array
from runtime.model.loader import Model
from runtime.planning.trajectory import JointMotion, Phase, Trajectory

PLATE = {
    "plate": {"stiffness": 686.0, "pretension": 24.0, "friction": 2.0, "position": 0.3},
    "plate_damping": {"coefficient": 5.0},
}
EPSILON = 2.0**-24
POSTURE = np.array([0.4, 0.9, -0.6, 0.3])


def trajectory(phases: list[Phase], periodic: bool = True, **given: object) -> Trajectory:
    base = Trajectory("vishard4", "test", tuple(phases), periodic, 1.0, True, {}, {})
    return replace(base, **given)  # type: ignore[arg-type]


def still(q: Array = POSTURE, **given: object) -> Trajectory:
    """Stays where it is."""
    return trajectory([Phase("q", 1.0, np.tile(q[:, None], 4))], **given)


def there_and_back(duration: float = 1.2, degree: int = 10) -> Trajectory:
    """Scenario 1: joint 4 to a quarter turn and back, from rest to rest."""
    middle = np.linspace(0.0, -pi / 2, degree - 5)
    row = np.concatenate([[0.0] * 3, middle, [-pi / 2] * 3])
    there, back = np.zeros((4, degree + 1)), np.zeros((4, degree + 1))
    there[3], back[3] = row, row[::-1]
    return trajectory([Phase("q", duration / 2, there), Phase("q", duration / 2, back)])


@dataclass
class Composition:
    """What a controller should give, in double, from the model's functions and the library's torques."""

    model: Model
    plan: Trajectory
    friction: bool = True

    def torques(self, counts: Array) -> tuple[Array, Array]:
        """(n, N) for counts (n, N) that the encoders read step by step, and by how much floats may be off."""
        q, qd = self.measured(counts)
        m = self.plan.at(self.model, np.arange(counts.shape[1]) / self.settings["rate"])
        parts = [
            self.model.inverse_dynamics(m.q, m.qd, m.qdd),
            self.gain("kp") * (m.q - q),
            self.gain("kd") * (m.qd - qd),
            *self.compensation(q, qd),
        ]
        return np.sum(parts, axis=0), self.resolution(m) + 1e-6 * np.sum(np.abs(parts), axis=0)

    @property
    def settings(self) -> dict[str, float]:
        assert self.model.controller is not None
        return self.model.controller

    def gain(self, name: str) -> Array:
        return np.array([[getattr(joint.gains, name)] for joint in self.model.joints if joint.gains])

    def resolution(self, m: JointMotion) -> Array:
        """What a rounding of the control points to float does to the torque, a few times over (n, N)."""
        phases = [self.plan.phases[k] for k in m.phase]
        # Of the degree that the controller is given, which is that of its rounded points.
        slope = np.array([max(phase.points.shape[1] - 1, MIN_DEGREE) / phase.duration for phase in phases])
        size = [
            np.abs(phase.points).max() * (1.0 if phase.coordinates == "q" else self.lever(q))
            for phase, q in zip(phases, m.q.T, strict=True)
        ]
        inertia = np.abs(self.model.inertia(m.q)).sum(axis=1)
        return 8 * EPSILON * np.array(size) * (self.gain("kp") + self.gain("kd") * slope + inertia * slope**2)

    def lever(self, q: Array) -> float:
        """By how much a coordinate of the contact moves a joint at q (n,): without bound where the arm is stretched."""
        return float(np.abs(np.linalg.inv(self.model.call("contact_jacobian", {"q": q}))).sum(axis=1).max())

    def measured(self, counts: Array) -> tuple[Array, Array]:
        """Positions, and rates by a first-order low-pass on the backward difference (n, N)."""
        q = counts * np.array([[2 * pi / (2000 * joint.gear_ratio)] for joint in self.model.joints])
        raw = np.diff(q, axis=1, prepend=q[:, :1]) * self.settings["rate"]
        gain = 1 - exp(-2 * pi * self.settings["velocity_cutoff"] / self.settings["rate"])
        return q, lfilter([gain], [1.0, gain - 1.0], raw, axis=1)

    def compensation(self, q: Array, qd: Array) -> list[Array]:
        library, rows = self.model.library, []
        factor = self.settings["friction_scale"] * (1 - np.exp(-self.settings["friction_slope"] * np.abs(qd)))
        for name in ("coulomb_asymmetric", "viscous", "viscous_cubic"):
            joints = enumerate(self.model.joints)
            torque = [library.torque(name, {"qd": qd[i]}, joint.effects[name]) for i, joint in joints]
            rows.append(self.friction * factor * np.array(torque))
        springs = np.zeros_like(q)
        for joint, values in self.plan.springs.items():
            springs[joint - 1] = library.torque("parallel_spring", {"q": q[joint - 1]}, values)
        rows.append(springs)
        J = self.model.tip_jacobian(q)[1]
        for name, values in self.plan.contact.items():
            tip = {"tip_y": self.model.tip(q)[1], "tip_yd": np.sum(J * qd, axis=0)}
            tip["plate_y"] = np.full_like(tip["tip_y"], self.plan.contact["plate"]["position"])
            rows.append(np.array([library.torque(name, {**tip, "tip_row": row}, values) for row in J]))
        return rows


def run(c: Controller, counts: Array) -> Array:
    """Torques (n, N) for counts (n, N) step by step."""
    c.reset(counts[:, 0])
    return np.array([c.step(now).astype(float) for now in counts.T]).T


def agree(c: Controller, truth: Composition, positions: Array) -> None:
    """Step along measured positions (n, N) and compare every torque that is not at a change of phase."""
    counts = np.array([c.counts(q) for q in positions.T]).T
    found, (expected, tolerance) = run(c, counts), truth.torques(counts)
    expected = np.clip(expected, -c.torque_limit[:, None], c.torque_limit[:, None])
    t = np.arange(counts.shape[1]) * c.dt
    apart = np.abs(truth.plan.starts[:, None] - np.mod(t, truth.plan.duration)).min(axis=0) > 1e-6
    worst = np.unravel_index(np.argmax(np.abs(found - expected) * apart / tolerance), found.shape)
    assert abs(found - expected)[worst] <= tolerance[worst], (worst, found[worst], expected[worst])


def near(plan: Trajectory, model: Model, rng: np.random.Generator, steps: int, error: float = 0.02) -> Array:
    """Measured positions (n, steps) that follow a plan, a little off."""
    t = np.arange(steps) * 1e-3
    wave = np.sin(2 * pi * (rng.uniform(0.5, 5, (model.n, 1)) * t + rng.uniform(0, 1, (model.n, 1))))
    return plan.at(model, t).q + error * wave
