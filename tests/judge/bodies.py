"""Arms to be judged with: their bodies, what the user believes of them, and their regressors by Newton and Euler."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array

from . import space
from .space import SPATIAL, SpatialBody

BELIEVED = ("coulomb_asymmetric", "viscous", "viscous_cubic")


@dataclass(frozen=True)
class Body:
    """One link and the rotor that drives it, SI; friction levels at its joint as they are when nothing is hidden."""

    rotor: float
    length: float
    mass: float
    com: tuple[float, float]
    inertia: float
    dry: tuple[float, float]
    viscous: float
    cubic: float
    noise: float = 1.0

    def parameters(self) -> dict[str, float]:
        """By laws.h's names."""
        return {
            "ROTOR": self.rotor,
            "LENGTH": self.length,
            "MASS": self.mass,
            "COM_X": self.com[0],
            "COM_Y": self.com[1],
            "INERTIA": self.inertia,
            "DRY_POSITIVE": self.dry[0],
            "DRY_NEGATIVE": self.dry[1],
            "VISCOUS_POSITIVE": self.viscous,
            "VISCOUS_NEGATIVE": self.viscous,
            "CUBIC": self.cubic,
        }


Bodies = Sequence[Body] | Sequence[SpatialBody]

ARMS: dict[int, tuple[Body, ...] | tuple[SpatialBody, ...]] = {
    **SPATIAL,
    1: (Body(0.10, 0.30, 2.0, (0.20, 0.0), 0.0565, (1.72, 1.05), 1.14, -0.015),),
    2: (
        Body(0.10, 0.25, 2.0, (0.12, 0.0), 0.020, (1.60, 1.20), 1.10, -0.015),
        Body(0.06, 0.20, 1.2, (0.10, 0.0), 0.008, (1.10, 0.80), 0.70, -0.010),
    ),
    3: (
        Body(0.20, 0.25, 2.2, (0.12, 0.01), 0.022, (1.90, 1.50), 1.30, -0.015),
        Body(0.12, 0.20, 1.4, (0.10, 0.0), 0.010, (1.40, 1.10), 0.90, -0.012),
        Body(0.06, 0.15, 0.8, (0.07, 0.0), 0.004, (0.90, 0.70), 0.60, -0.008),
    ),
    4: (
        Body(0.30, 0.23, 2.5, (0.12, 0.0), 0.025, (2.10, 1.60), 1.50, -0.015),
        Body(0.20, 0.17, 1.9, (0.09, 0.0), 0.012, (1.70, 1.30), 1.20, -0.015),
        Body(0.10, 0.19, 1.6, (0.10, 0.0), 0.012, (1.30, 1.00), 0.90, -0.012),
        Body(0.06, 0.18, 0.9, (0.09, 0.0), 0.006, (1.00, 0.70), 0.60, -0.010),
    ),
}


def in_space(bodies: Bodies) -> bool:
    return isinstance(bodies[0], SpatialBody)


def model_text(
    bodies: Bodies, believed: Sequence[str], gravity: Sequence[float] = (0.0, 0.0), ratio: float = 100.0
) -> str:
    """The model file of a user who knows the bodies and believes in some effects of unknown values."""
    label = "_".join("".join(word[0] for word in name.split("_")) for name in believed)
    arm = f"judge{len(bodies)}_{label}" + (f"_n{ratio:g}" if ratio != 100.0 else "") + ("_g" if any(gravity) else "")
    lines = [f'name = "{arm}"', f"gravity = [{', '.join(map(str, gravity))}]"]
    if in_space(bodies):
        return "\n".join([*lines, *space.file_joints(bodies, believed, ratio)]) + "\n"
    for body in bodies:
        lines += [
            "",
            "[[joint]]",
            'type = "revolute"',
            f"rotor_inertia = {body.rotor}",
            f"gear_ratio = {ratio:g}",
            "[joint.link]",
            f"length = {body.length}",
            f"mass = {body.mass}",
            f"com = [{body.com[0]}, {body.com[1]}]",
            f"inertia = {body.inertia}",
            *(f"[joint.effects.{name}]" for name in believed),
        ]
    return "\n".join(lines) + "\n"


def inertial_columns(bodies: Sequence[Body], q: Array, qd: Array, qdd: Array, gravity: Sequence[float]) -> Array:
    """Torque per unit of every inertial parameter, (n, 5 n, N): of each link the mass, the first moments along and
    across, the inertia about its joint, and the rotor's inertia. Forces and moments of each body, summed at the joints.
    """
    n, count = q.shape
    out = np.zeros((n, 5 * n, count))
    angle, rate, turn = np.cumsum(q, 0), np.cumsum(qd, 0), np.cumsum(qdd, 0)
    place = np.zeros((n, 2, count))
    fall = np.zeros((n, 2, count))  # acceleration of the joint, less gravity's
    fall[0] -= np.array(gravity)[:2, None]
    for k in range(n):
        along = np.array([np.cos(angle[k]), np.sin(angle[k])])
        across = np.array([-along[1], along[0]])
        unit = [along, across]
        moved = [turn[k] * across - rate[k] ** 2 * along, -turn[k] * along - rate[k] ** 2 * across]
        for i in range(k + 1):
            arm = place[k] - place[i]
            out[i, 5 * k] = _cross(arm, fall[k])
            for c in range(2):
                out[i, 5 * k + 1 + c] = _cross(unit[c], fall[k]) + _cross(arm, moved[c])
            out[i, 5 * k + 3] = turn[k]
        out[k, 5 * k + 4] = qdd[k]
        if k + 1 < n:
            place[k + 1] = place[k] + bodies[k].length * along
            fall[k + 1] = fall[k] + bodies[k].length * moved[0]
    return out


def inertial_values(bodies: Sequence[Body]) -> Array:
    """(5 n,) values of the parameters of inertial_columns."""
    rows = []
    for b in bodies:
        about_joint = b.inertia + b.mass * (b.com[0] ** 2 + b.com[1] ** 2)
        rows.append([b.mass, b.mass * b.com[0], b.mass * b.com[1], about_joint, b.rotor])
    return np.array(rows).ravel()


def _cross(a: Array, b: Array) -> Array:
    crossed: Array = a[0] * b[1] - a[1] * b[0]
    return crossed


def joint_rows(bodies: Bodies, q: Array, qd: Array, qdd: Array, gravity: Sequence[float]) -> Iterator[Array]:
    """Joint by joint the torque per unit of every inertial parameter, (p, N) each."""
    if in_space(bodies):
        at = space.moving(bodies, q, qd, qdd, gravity)
        return (space.joint_columns(bodies, at, qdd, joint) for joint in range(len(bodies)))
    return iter(inertial_columns(bodies, q, qd, qdd, gravity))


def link_inertia(bodies: Bodies, joint: int, q: Array) -> float:
    """kg m² behind a joint's transmission: of a planar arm stretched out, of one in space at the angles q (n,)."""
    if in_space(bodies):
        still, push = np.zeros((len(bodies), 1)), np.zeros((len(bodies), 1))
        push[joint] = 1.0
        whole = torque(bodies, np.array([q[:, None], still, push]), (0.0, 0.0, 0.0))
        return float(whole[joint, 0] - bodies[joint].rotor)
    place, total = 0.0, 0.0
    for body in bodies[joint:]:
        total += body.inertia + body.mass * (place + body.com[0]) ** 2
        place += body.length
    return total


def torque(bodies: Bodies, motion: Array, gravity: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    """Rigid-body torque (n, N) along motion (3, n, N)."""
    if in_space(bodies):
        values = space.values(bodies)
        return np.array([values @ rows for rows in joint_rows(bodies, motion[0], motion[1], motion[2], gravity)])
    columns = inertial_columns(bodies, motion[0], motion[1], motion[2], gravity)
    forces: Array = np.einsum("ikt,k->it", columns, inertial_values(bodies))
    return forces


def friction_columns(effect: str, rate: Array, above: Array, below: Array) -> list[Array]:
    """Regressors (N,) of an effect that a user believes in, at one joint, from what the plant says of its friction."""
    if effect == "coulomb":
        return [above - below]
    if effect == "coulomb_asymmetric":
        return [above, -below]
    if effect == "viscous":
        return [rate]
    if effect == "viscous_asymmetric":
        return [np.maximum(rate, 0.0), np.minimum(rate, 0.0)]
    if effect == "viscous_cubic":
        return [rate**3]
    if effect == "offset":
        return [np.ones_like(rate)]
    raise ValueError(f"no regressor for {effect}")
