"""A bench for tests of execution: one joint with a spring beside it, and motions for it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.planning.trajectory import Phase, Trajectory
from tests import one_joint

CONTROLLER = """\
[controller]
rate = 1000.0
velocity_cutoff = 100.0
friction_scale = 0.92
friction_slope = 150.0
"""
JOINT = """\
[joint.encoder]
counts = 2000.0
[joint.controller]
kp = 40.0
kd = 6.0
[joint.limits]
position = [-1.8, 1.8]
speed = 5.0
torque = 25.0
[joint.effects.coulomb_asymmetric]
positive = 1.72
negative = 1.05
[joint.effects.viscous]
coefficient = 1.14
"""
PLAIN = one_joint.model_text(JOINT, "bench", controller=CONTROLLER)
"""Without its spring."""
BENCH = f"""\
{PLAIN}# the spring that happens to be mounted
[joint.effects.parallel_spring]
stiffness = 5900.0   # N/m
radius = 0.06
offset = -1.2
pretension = 0.0
"""
SPRING = {"stiffness": 3000.0, "radius": 0.06, "offset": -0.5, "pretension": 10.0}


def motion(stations: Sequence[float], seconds: Sequence[float]) -> tuple[Phase, ...]:
    """From station to station and back to the first, at rest at each."""
    ends = [*stations[1:], stations[0]]
    return tuple(Phase("q", s, np.array([[a] * 3 + [b] * 3])) for a, b, s in zip(stations, ends, seconds, strict=True))


def trajectory(phases: tuple[Phase, ...], friction: bool = True, **others: object) -> Trajectory:
    given = {"periodic": True, "springs": {}, "contact": {}, **others}
    return Trajectory("bench", "there and back", phases, elbow=1.0, friction=friction, **given)  # type: ignore[arg-type]


THERE_AND_BACK = motion([0.0, -1.2], [0.7, 0.7])
