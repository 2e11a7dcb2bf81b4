"""The settings that are uploaded to a controller: values of its messages, from the model file and a trajectory."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import ceil, exp, floor, inf, pi, prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.hardware.link import Values
from runtime.model.loader import Model
from runtime.model.terms import SURFACE, Term, given
from runtime.planning.trajectory import Phase, Trajectory

UNLIMITED = float(np.finfo(np.float32).max)
OVERSPEED = 1.5
"""Safe stop at this multiple of the joint's speed limit, which the plan keeps; tracking needs less."""
BEYOND = {"revolute": 0.05, "prismatic": 0.01}
"""Safe stop at so much (rad, m) beyond a joint's range, which the plan may touch; keep it free before the end stops."""
TRACKING = {"revolute": 0.5, "prismatic": 0.1}
"""Largest tracking error in rad, m; beyond it is a safe stop."""
START = {"revolute": 0.05, "prismatic": 0.01}
"""Largest distance in rad, m between the arm and the trajectory's start."""
SILENCE, DAMPING, SATURATED = 0.2, 0.5, 2.0
"""Times in s: without a message from the host; of damping after a stop; with a torque at its limit."""
_JUMP, _LEAST_JUMP, _ANY_JUMP = 4.0, 16, 2**31 - 1
"""An encoder jumps if its speed is this multiple of that of a safe stop; least and largest jump in counts."""
_FROZEN = 0.5
"""Part of the largest tracking error; over a longer desired travel a working encoder has counted."""
_EARLY, _LATE = 0.5, 1.5
"""Least and largest number of control periods between two steps."""
_ERRORS = 3
_LOWERED = {"torque_limit", "kp", "kd", "tracking", "speed", "low", "high", "silence", "late"}
"""Fields of drive and safety for which a board has ceilings."""
_MICROSECONDS = 1e6

TOUCH = 1e-4  # m into the plate; less is no contact
LOOKS = 200  # samples per phase in the search for contact


class ControllerError(ValueError):
    """The controller cannot run a trajectory on an arm; the message says what to do."""


@dataclass(frozen=True)
class Settings:
    """All that is uploaded to the controller for one arm and one trajectory.

    dt                   control period, s
    position_per_count   (n,) float, rad or m       zero   (n,) counts at position 0
    uncompensated        effects of the model that the controller does not compensate
    drive, safety, parameters, effects, trajectory   values of the messages with these names
    phases               values of the messages phase
    points               (rows, n) control points of all phases
    """

    model: Model
    dt: float
    position_per_count: NDArray[np.float32]
    zero: NDArray[np.int32]
    uncompensated: tuple[str, ...]
    drive: Values
    safety: Values
    parameters: Values
    effects: Values
    trajectory: Values
    phases: tuple[Values, ...]
    points: Array

    def tolerating(self, late: float) -> Settings:
        """The same with at least `late` s allowed between two control steps.

        Without a shortest time, because a late step is followed by an early one.
        """
        longest = max(self.safety["late"], ceil(late * _MICROSECONDS))
        return replace(self, safety={**self.safety, "early": 0, "late": longest})

    @classmethod
    def of(
        cls, directory: Path, model: Model, trajectory: Trajectory, friction: bool = True, tracking: float | None = None
    ) -> Settings:
        """The settings of a firmware directory, which has controller.json and protocol.json.

        friction   whether friction is compensated, equation (7); other effects always are
        tracking   largest tracking error of every joint, rad or m; None: by the joint's type
        Raises ControllerError if the model file is incomplete or the trajectory does not fit.
        """
        page = json.loads((Path(directory) / "controller.json").read_text(encoding="utf-8"))
        ceilings = json.loads((Path(directory) / "protocol.json").read_text(encoding="utf-8"))["ceilings"]
        if (page["name"], page["n"]) != (model.name, model.n) or trajectory.arm != model.name:
            raise ControllerError(
                f'the controller is of arm "{page["name"]}", the model of "{model.name}", the trajectory of '
                f'"{trajectory.arm}"; expected the same arm'
            )
        check_controllable(model, page["effects"])
        assert model.controller is not None
        turns = np.array([joint.encoder_counts * joint.gear_ratio for joint in model.joints if joint.encoder_counts])
        per_count = 2.0 * pi / turns
        dt = 1.0 / model.controller["rate"]
        effects = dict(page["effects"]) if friction else {**page["effects"], "friction_scale": 0.0}
        phases = _phases(page, model, trajectory, dt)
        return cls(
            model=model,
            dt=dt,
            position_per_count=per_count.astype(np.float32),
            zero=np.array([joint.encoder_zero for joint in model.joints], dtype=np.int32),
            uncompensated=tuple(item["effect"] for item in page["uncompensated"]),
            drive=_within(_drive(model, per_count), ceilings),
            safety=_within(_safety(model, per_count, dt, tracking), ceilings),
            parameters=dict(zip((f["name"] for f in model.metadata["struct"]), model.struct_values, strict=True)),
            effects=effects,
            trajectory=_trajectory(page, model, trajectory),
            phases=phases,
            points=np.concatenate([_points(page, phase) for phase in trajectory.phases]),
        )

    def positions(self, counts: NDArray[np.int32]) -> Array:
        """Positions (n, N) in rad or m of counts (N, n), in the controller's float arithmetic."""
        # The counter may overflow between the zero and these counts.
        return ((counts - self.zero).astype(np.float32) * self.position_per_count).T.astype(np.float64)

    def messages(self, rows: int) -> Iterator[tuple[str, Values]]:
        """Names and values of the uploaded messages in order, without `commit`. rows: control points per message."""
        for name in ("parameters", "effects", "drive", "safety", "trajectory"):
            yield name, getattr(self, name)
        for phase in self.phases:
            yield "phase", phase
        for first in range(0, len(self.points), rows):
            block = np.zeros((rows, self.model.n))
            part = self.points[first : first + rows]
            block[: len(part)] = part
            yield "points", {"first_row": first, "values": block.ravel().tolist()}


def _drive(model: Model, per_count: Array) -> Values:
    settings = model.controller or {}
    limits = [joint.torque_limit for joint in model.joints]
    return {
        "rate": settings["rate"],
        "velocity_gain": 1.0 - exp(-2.0 * pi * settings["velocity_cutoff"] / settings["rate"]),
        "position_per_count": per_count.tolist(),
        "zero": [joint.encoder_zero for joint in model.joints],
        "kp": [joint.gains.kp for joint in model.joints if joint.gains],
        "kd": [joint.gains.kd for joint in model.joints if joint.gains],
        "torque_limit": [UNLIMITED if limit is None else limit for limit in limits],
    }


def _safety(model: Model, per_count: Array, dt: float, tracking: float | None) -> Values:
    joints = model.joints
    largest = np.array([TRACKING[j.type] if tracking is None else tracking for j in joints])
    speed = np.array([OVERSPEED * j.speed_limit if j.speed_limit else inf for j in joints])
    ranges = np.array([j.position_limits or (-inf, inf) for j in joints])
    beyond = np.array([BEYOND[j.type] for j in joints])
    jump = np.minimum(np.maximum(np.ceil(_JUMP * speed * dt / per_count), _LEAST_JUMP), _ANY_JUMP)
    return {
        "tracking": _finite(largest),
        "speed": _finite(speed),
        "low": _finite(ranges[:, 0] - beyond),
        "high": _finite(ranges[:, 1] + beyond),
        "start": _finite(np.array([START[j.type] for j in joints])),
        "jump": [int(counts) for counts in jump],
        "frozen": _finite(_FROZEN * largest),
        "saturated": ceil(SATURATED / dt),
        "silence": ceil(SILENCE / dt),
        "errors": _ERRORS,
        "early": floor(_EARLY * dt * _MICROSECONDS),
        "late": ceil(_LATE * dt * _MICROSECONDS),
        "damping": ceil(DAMPING / dt),
    }


def _within(values: Values, ceilings: Values) -> Values:
    """The values within the board's ceilings, so that reported limits are those in force."""
    lowered = {
        name: np.clip(values[name], ceilings["low"], ceilings["high"]).tolist()
        if name in ("low", "high")
        else np.minimum(values[name], ceilings[name]).tolist()
        for name in _LOWERED & values.keys()
    }
    return {**values, **lowered}


def _finite(values: Array) -> list[float]:
    """As floats; the largest one means no limit."""
    return np.clip(values, -UNLIMITED, UNLIMITED).tolist()


def _trajectory(page: Mapping[str, Any], model: Model, trajectory: Trajectory) -> Values:
    records = {record["name"].removeprefix(f"{page['name']}_"): record for record in page["records"]}
    springs = _springs(page, model, trajectory)
    contact = {field["name"]: 0.0 for field in records["contact_f32"]["fields"]}
    for effect, values in trajectory.contact.items():
        named = {f"{effect}_{key}": value for key, value in values.items()}
        _check_known(named, contact, effect)
        contact |= named
    return {
        "count": len(trajectory.phases),
        "periodic": int(trajectory.periodic),
        "elbow": int(trajectory.elbow),
        "rows": sum(len(_points(page, phase)) for phase in trajectory.phases),
        **{f"spring_{name}": values for name, values in springs.items()},
        **contact,
    }


def _springs(page: Mapping[str, Any], model: Model, trajectory: Trajectory) -> dict[str, list[float]]:
    """The fields of the springs, (n,) each."""
    others = page.get("other_springs", {})
    springs = {name: [0.0] * page["n"] for name in (*page["springs"], *(f for own in others.values() for f in own))}
    for joint, values in trajectory.springs.items():
        term = trajectory.spring(model.library, joint)
        products = (
            {name: {p: 1} for name, p in others[term.effect].items()} if term.effect in others else page["springs"]
        )
        _check_known(values, {parameter: 1.0 for powers in products.values() for parameter in powers}, str(term))
        for name, powers in products.items():
            springs[name][joint - 1] = prod(values[p] ** power for p, power in powers.items())
    return springs


def _check_known(values: Mapping[str, float], known: Mapping[str, Any], effect: str) -> None:
    if unknown := values.keys() - known.keys():
        raise ControllerError(
            f"{effect}: the controller has no {sorted(unknown)[0]}; it has: {', '.join(sorted(known))}"
        )


def _phases(page: Mapping[str, Any], model: Model, trajectory: Trajectory, dt: float) -> tuple[Values, ...]:
    touching, found, row = _touching(model, trajectory), [], 0
    for index, phase in enumerate(trajectory.phases):
        degree, most = len(_points(page, phase)) - 1, page["max_degree"]
        if degree > most:
            raise ControllerError(
                f"phase {index + 1} has polynomials of degree {degree}; the controller has at most {most}"
            )
        if phase.duration < dt:
            raise ControllerError(
                f"phase {index + 1} lasts {phase.duration:.3g} s, less than the control period of {dt:.3g} s"
            )
        made = {"coordinates": page["coordinates"][phase.coordinates], "degree": degree, "duration": phase.duration}
        found.append({"index": index, **made, "touches": int(index in touching), "first_row": row})
        row += degree + 1
    return tuple(found)


def _touching(model: Model, trajectory: Trajectory) -> set[int]:
    """Phases (from 0) with contact in the plan; in the others the controller need not compute it."""
    touched = {Term(name): dict(values) for name, values in trajectory.contact.items()}
    surface = given(model.library, touched, SURFACE)
    if surface is None:
        return set()
    t = np.linspace(0.0, trajectory.duration, LOOKS * len(trajectory.phases), endpoint=False)
    motion = trajectory.at(model, t)
    below = model.tip(motion.q)[1] < surface - TOUCH
    return set(motion.phase[below].tolist()) | {k for k, p in enumerate(trajectory.phases) if p.coordinates == "w"}


def _points(page: Mapping[str, Any], phase: Phase) -> Array:
    """(degree + 1, n) control points, with the degree raised to the controller's minimum."""
    points = phase.points.T
    while (degree := len(points) - 1) < page["min_degree"]:
        share = (np.arange(1, degree + 1) / (degree + 1))[:, None]
        points = np.concatenate([points[:1], share * points[:-1] + (1 - share) * points[1:], points[-1:]])
    return points


# --- completeness of the model file ---


def check_controllable(model: Model, effects: Mapping[str, float | None]) -> None:
    """Raises ControllerError with everything that is missing. effects: values of those that are compensated"""
    missing: list[str] = []
    if model.controller is None:
        missing.append("[controller]")
    for table, there in (("controller", lambda j: j.gains), ("encoder", lambda j: j.encoder_counts)):
        if lacking := [str(number) for number, joint in enumerate(model.joints, 1) if there(joint) is None]:
            missing.append(f"[joint.{table}] at joint{'s' * (len(lacking) > 1)} {', '.join(lacking)}")
    if missing:
        raise ControllerError(
            f'the model file of "{model.name}" is incomplete for its controller; it lacks {"; ".join(missing)}; '
            "tendon init --controller MODEL --write proposes them"
        )
    unknown = [name for name, value in effects.items() if value is None]
    if unknown:
        raise ControllerError(
            f'the model file of "{model.name}" has no value of {", ".join(unknown)}; '
            "find them with tendon identify MODEL RECORDING --write"
        )
