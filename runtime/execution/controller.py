"""The generated C of the controller's step, called from Python: the same code that the firmware runs."""

from __future__ import annotations

import ctypes
import json
from collections.abc import Mapping
from math import exp, pi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.execution.records import structures
from runtime.loader import Model
from runtime.planning.trajectory import SPRING, Phase, Trajectory

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]

UNLIMITED = float(np.finfo(np.float32).max)
TOUCH = 1e-4  # m, below which the end-effector has not reached the plate
LOOKS = 200  # a phase, for the plate
BANDWIDTH = 2.0  # Hz, of the gains that are proposed where the model file has none


class ControllerError(ValueError):
    """The controller cannot run this trajectory on this arm; the message says what to do."""


class Controller:
    """One arm's controller on one trajectory.

    directory   of codegen.workspace.prepare_controller, for the same arm as the model
    friction    whether friction is compensated, (7); what else the model file has always is
    Raises ControllerError where the model file lacks what a controller needs, or the trajectory does not fit.

    The k-th step after `reset` follows the trajectory at k dt. The arrays are views of the controller's memory:
    the next step overwrites them.
    """

    def __init__(self, directory: Path, model: Model, trajectory: Trajectory, friction: bool = True) -> None:
        self.directory = Path(directory)
        self._data: dict[str, Any] = json.loads((self.directory / "controller.json").read_text(encoding="utf-8"))
        self.name: str = self._data["name"]
        self.n: int = self._data["n"]
        if (self.name, self.n) != (model.name, model.n) or trajectory.arm != model.name:
            raise ControllerError(
                f'controller of "{self.name}", model of "{model.name}" and trajectory of "{trajectory.arm}"; '
                "expected all three of one arm"
            )
        _check_complete(model, self._data["effects"])
        assert model.controller is not None
        self.uncompensated: tuple[str, ...] = tuple(item["effect"] for item in self._data["uncompensated"])
        self.dt = 1.0 / model.controller["rate"]
        turns = np.array([joint.encoder_counts * joint.gear_ratio for joint in model.joints if joint.encoder_counts])
        self.position_per_count: NDArray[np.float64] = 2.0 * pi / turns
        self._types = structures(self._data["records"])
        self._library = ctypes.CDLL(str(self.directory / "lib.so"))
        self._check_sizes()
        self._config = self._make_config(model, friction)
        self._phases = self._make_phases(model, trajectory)
        self._plan = self._make_trajectory(trajectory)
        self._state, self._output = self._new("state"), self._new("output")
        self._counts: Int32 = np.zeros(self.n, dtype=np.int32)
        self.torque: Float32 = np.ctypeslib.as_array(self._output.torque)
        self.q_desired: Float32 = np.ctypeslib.as_array(self._output.q_desired)
        self.q: Float32 = np.ctypeslib.as_array(self._output.q)
        self.qd: Float32 = np.ctypeslib.as_array(self._output.qd)
        read = ctypes.c_void_p(self._counts.ctypes.data)
        self._reset = getattr(self._library, f"{self.name}_controller_reset_f32")
        self._step = getattr(self._library, f"{self.name}_controller_step_f32")
        self._reset_arguments = (ctypes.byref(self._state), read)
        own = (self._config, self._plan, self._state)
        self._step_arguments = (*(ctypes.byref(item) for item in own), read, ctypes.byref(self._output))

    def counts(self, q: ArrayLike) -> Int32:
        """What the encoders read at positions q (n,)."""
        return np.floor(np.asarray(q, dtype=np.float64) / self.position_per_count).astype(np.int32)

    def reset(self, counts: ArrayLike) -> None:
        """Begin the trajectory: the arm stands still where its encoders read `counts` (n,)."""
        self._counts[:] = counts
        self._reset(*self._reset_arguments)

    def step(self, counts: ArrayLike) -> Float32:
        """The torques (n,) N m or N to hold over the coming period, for what the encoders read now (n,)."""
        self._counts[:] = counts
        self._step(*self._step_arguments)
        return self.torque

    @property
    def phase(self) -> int:
        """Of the trajectory, from 0, in the last step."""
        return int(self._output.phase)

    @property
    def saturated(self) -> bool:
        """Whether a torque was limited in the last step."""
        return self._flag("saturated")

    @property
    def finished(self) -> bool:
        """Whether the trajectory has ended; the arm is held where it ends."""
        return self._flag("finished")

    @property
    def invalid(self) -> bool:
        """Whether a torque was no finite number in the last step; then all of them are zero."""
        return self._flag("invalid")

    def _flag(self, name: str) -> bool:
        return bool(self._output.status & self._data["status"][name])

    def _new(self, record: str) -> Any:
        return self._types[f"{self.name}_{record}_f32"]()

    def _check_sizes(self) -> None:
        """The compiler must have laid out the structs as ctypes does."""
        sizes = (ctypes.c_uint32 * len(self._types))()
        getattr(self._library, f"{self.name}_controller_sizes_f32")(sizes)
        for size, (name, kind) in zip(sizes, self._types.items(), strict=True):
            if size != ctypes.sizeof(kind):
                raise ControllerError(f"{name} has {size} bytes in C and {ctypes.sizeof(kind)} in its description")

    def _make_config(self, model: Model, friction: bool) -> Any:
        settings, config = model.controller or {}, self._new("config")
        for field in model.metadata["struct"]:
            setattr(config.parameters, field["name"], field["default"])
        for name, value in self._data["effects"].items():
            setattr(config.effects, name, value)
        if not friction:
            config.effects.friction_scale = 0.0
        config.rate = settings["rate"]
        config.velocity_gain = 1.0 - exp(-2.0 * pi * settings["velocity_cutoff"] / settings["rate"])
        config.position_per_count[:] = self.position_per_count
        config.kp[:] = [joint.gains["kp"] for joint in model.joints if joint.gains]
        config.kd[:] = [joint.gains["kd"] for joint in model.joints if joint.gains]
        limits = [joint.torque_limit for joint in model.joints]
        config.torque_limit[:] = [UNLIMITED if limit is None else limit for limit in limits]
        return config

    def _make_phases(self, model: Model, trajectory: Trajectory) -> Any:
        phases = (self._types[f"{self.name}_phase_f32"] * len(trajectory.phases))()
        contact, touching = self._make_contact(trajectory), _touching(model, trajectory)
        for number, (made, phase) in enumerate(zip(phases, trajectory.phases, strict=True), 1):
            points = _points(phase)
            degree, most = len(points) - 1, self._data["max_degree"]
            if degree > most:
                raise ControllerError(f"phase {number} has polynomials of degree {degree}; the controller takes {most}")
            if phase.duration < self.dt:
                raise ControllerError(
                    f"phase {number} lasts {phase.duration:.3g} s, less than the control period of {self.dt:.3g} s"
                )
            made.coordinates = self._data["coordinates"][phase.coordinates]
            made.degree, made.duration = degree, phase.duration
            made.points = (ctypes.c_float * points.size)(*points.ravel().tolist())
            if number - 1 in touching:
                made.contact = ctypes.pointer(contact)
        return phases

    def _make_trajectory(self, trajectory: Trajectory) -> Any:
        plan = self._new("trajectory")
        plan.count, plan.periodic, plan.elbow = len(trajectory.phases), trajectory.periodic, trajectory.elbow
        plan.phases = self._phases
        for joint, values in trajectory.springs.items():
            _fill(plan.springs[joint - 1], values, f"{SPRING}@{joint}")
        return plan

    def _make_contact(self, trajectory: Trajectory) -> Any:
        contact = self._new("contact")
        for effect, values in trajectory.contact.items():
            _fill(contact, {f"{effect}_{key}": value for key, value in values.items()}, effect)
        return contact


def _touching(model: Model, trajectory: Trajectory) -> set[int]:
    """The phases (from 0) in which the plan touches the plate; in the others it costs no time to look for it."""
    if "plate" not in trajectory.contact:
        return set()
    t = np.linspace(0.0, trajectory.duration, LOOKS * len(trajectory.phases), endpoint=False)
    motion = trajectory.at(model, t)
    below = model.tip(motion.q)[1] < trajectory.contact["plate"]["position"] - TOUCH
    return set(motion.phase[below].tolist()) | {k for k, p in enumerate(trajectory.phases) if p.coordinates == "w"}


def _points(phase: Phase) -> NDArray[np.float64]:
    """(degree + 1, n) control points of a degree of 2 at least; a straight line has its middle as a third one."""
    points = phase.points.T
    return points if len(points) > 2 else np.array([points[0], (points[0] + points[1]) / 2, points[1]])


def _fill(target: ctypes.Structure, values: Mapping[str, float], effect: str) -> None:
    known = {name for name, _ in target._fields_}  # type: ignore[misc]
    if unknown := values.keys() - known:
        raise ControllerError(
            f"{effect}: the controller has no {sorted(unknown)[0]}; it has: {', '.join(sorted(known))}"
        )
    for name, value in values.items():
        setattr(target, name, value)


# --- what the model file has to say ---


def _check_complete(model: Model, effects: Mapping[str, float | None]) -> None:
    """Raise ControllerError that names everything that is missing, with a proposal where one can be computed."""
    missing: list[str] = []
    if model.controller is None:
        missing.append(
            "[controller] with rate and velocity_cutoff in Hz, friction_scale and friction_slope in s/rad "
            "(for example 1000, 100, 0.92 and 150)"
        )
    for number, joint in enumerate(model.joints, 1):
        if joint.gains is None:
            missing.append(f"[joint.controller] at joint {number}, for example {proposed_gains(model, number)}")
        if joint.encoder_counts is None:
            missing.append(
                f"[joint.encoder] at joint {number} with counts per turn of the motor (four times its lines)"
            )
    if missing:
        raise ControllerError(
            f'the model file of "{model.name}" says too little of its controller; add {"; ".join(missing)}'
        )
    unknown = [name for name, value in effects.items() if value is None]
    if unknown:
        raise ControllerError(
            f'the model file of "{model.name}" has no value of {", ".join(unknown)}; '
            "tendon identify MODEL RECORDING --write finds them"
        )


def proposed_gains(model: Model, joint: int) -> str:
    """Gains of a critically damped joint (1-based) of 2 Hz, as a person writes them, and the inertia behind them."""
    seen = float(model.inertia(np.zeros(model.n))[joint - 1, joint - 1])
    omega = 2.0 * pi * BANDWIDTH
    unit = "kg m^2" if model.joints[joint - 1].type == "revolute" else "kg"
    return f"kp = {omega**2 * seen:.3g}, kd = {2.0 * omega * seen:.3g} ({BANDWIDTH:g} Hz at {seen:.3g} {unit})"
