"""Before a real arm moves: which limits its model file must have, and what the simulated arm did with the same plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.execution.demand import PlannedCycle
from runtime.execution.execute import Execution
from runtime.execution.trial import Trial
from runtime.hardware.settings import ControllerError
from runtime.model.loader import Model
from runtime.model.terms import SURFACE, Term, given

Array = NDArray[np.float64]

_SPAN = 0.01
"""s over which counted positions are differentiated for the speed: encoder steps do not show."""


def check_limits(model: Model) -> None:
    """Raise ControllerError that names every limit that is missing: no real arm moves without."""
    missing = []
    for number, joint in enumerate(model.joints, 1):
        keys = {"position": joint.position_limits, "speed": joint.speed_limit, "torque": joint.torque_limit}
        if absent := [name for name, value in keys.items() if value is None]:
            missing.append(f"{', '.join(absent)} at joint {number}")
    if missing:
        raise ControllerError(
            f'the model file of "{model.name}" has too few limits for a real arm; add to [joint.limits]: '
            f"{'; '.join(missing)} (position = [low, high] in rad or m, speed in rad/s or m/s, torque in N m or N)"
        )


@dataclass(frozen=True)
class ExpectedRun:
    """Of a motion on the simulated arm. (n,) each; room: to the nearer end of a joint's range, rad or m.

    plate   m from the end-effector's lowest place to the plate's surface, less than 0 where it is pressed down;
            None without a plate
    """

    torque: Array
    speed: Array
    room: Array
    plate: float | None

    @classmethod
    def of(cls, execution: Execution) -> ExpectedRun:
        """Over all trials, of which there is at least one. All limits are there."""
        trials, plan, dt = execution.trials, execution.plan, execution.dt
        return cls(
            torque=np.max([np.abs(trial.tau).max(axis=1) for trial in trials], axis=0),
            speed=np.max([_speed(trial, dt) for trial in trials], axis=0),
            room=np.min([_room(plan.model, trial) for trial in trials], axis=0),
            plate=_plate(plan, trials),
        )

    def to_json(self, model: Model) -> dict[str, Any]:
        """Beside the limits."""
        joints = [
            {
                "joint": k + 1,
                "name": joint.name,
                "torque": self.torque[k],
                "torque_limit": joint.torque_limit,
                "force_unit": joint.force_unit,
                "speed": self.speed[k],
                "speed_limit": joint.speed_limit,
                "room": self.room[k],
                "position_unit": joint.position_unit,
            }
            for k, joint in enumerate(model.joints)
        ]
        return {"joints": joints, "plate": self.plate}


def _speed(trial: Trial, dt: float) -> Array:
    span = min(max(1, round(_SPAN / dt)), trial.q.shape[1] - 1)
    return np.abs(trial.q[:, span:] - trial.q[:, :-span]).max(axis=1) / (span * dt)


def _room(model: Model, trial: Trial) -> Array:
    low, high = np.array([joint.position_limits for joint in model.joints], dtype=np.float64).T
    return np.minimum(trial.q.min(axis=1) - low, high - trial.q.max(axis=1))


def _plate(plan: PlannedCycle, trials: tuple[Trial, ...]) -> float | None:
    contact = plan.trajectory.contact or (plan.model.contact or {}).get("effects", {})
    surface = given(plan.model.library, {Term(name): values for name, values in contact.items()}, SURFACE)
    if surface is None:
        return None
    return float(min(plan.model.tip(trial.q)[1].min() for trial in trials) - surface)
