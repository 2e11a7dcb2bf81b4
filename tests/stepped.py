"""The generated C of the controller's step by itself, called from Python, without the machine around it."""

from __future__ import annotations

import ctypes
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.hardware.settings import ControllerError, Settings, Values
from runtime.model.loader import Model
from runtime.planning.trajectory import Trajectory

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]


class Controller:
    """One arm's controller on one trajectory.

    directory   of codegen.prepare.prepare_firmware for the host, of the same arm as the model
    friction    whether friction is compensated, (7); what else the model file has always is
    Raises ControllerError where the model file lacks what a controller needs, or the trajectory does not fit.

    The k-th step after `reset` follows the trajectory at k dt. The arrays are views of the controller's memory:
    the next step overwrites them.
    """

    def __init__(self, directory: Path, model: Model, trajectory: Trajectory, friction: bool = True) -> None:
        self.directory = Path(directory)
        self._data: dict[str, Any] = json.loads((self.directory / "controller.json").read_text(encoding="utf-8"))
        settings = Settings.of(self.directory, model, trajectory, friction)
        self.name, self.n = model.name, model.n
        self.uncompensated, self.dt = settings.uncompensated, settings.dt
        self.position_per_count: NDArray[np.float64] = np.array(settings.drive["position_per_count"])
        self.torque_limit: NDArray[np.float64] = np.array(settings.drive["torque_limit"])
        self._types = structures(self._data["records"])
        self._library = ctypes.CDLL(str(self.directory / "lib.so"))
        self._check_sizes()
        self._config = self._make_config(settings)
        self._phases = self._make_phases(settings)
        self._plan = self._make_trajectory(settings)
        self._state, self._output = self._new("state"), self._new("output")
        self._counts: Int32 = np.zeros(self.n, dtype=np.int32)
        self.torque: Float32 = np.ctypeslib.as_array(self._output.torque)
        self.q_desired: Float32 = np.ctypeslib.as_array(self._output.q_desired)
        self.q: Float32 = np.ctypeslib.as_array(self._state.q)
        self.qd: Float32 = np.ctypeslib.as_array(self._state.qd)
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

    def _call(self, function: str, record: Any) -> None:
        getattr(self._library, f"{self.name}_controller_{function}_f32")(ctypes.byref(record))

    def _check_sizes(self) -> None:
        """The compiler must have laid out the structs as ctypes does."""
        sizes = (ctypes.c_uint32 * len(self._types))()
        getattr(self._library, f"{self.name}_controller_sizes_f32")(sizes)
        for size, (name, kind) in zip(sizes, self._types.items(), strict=True):
            if size != ctypes.sizeof(kind):
                raise ControllerError(f"{name} has {size} bytes in C and {ctypes.sizeof(kind)} in its description")

    def _make_config(self, settings: Settings) -> Any:
        config = self._new("config")
        _fill(config.parameters, settings.parameters)
        _fill(config.effects, settings.effects)
        _fill(config, settings.drive)
        self._call("prepare", config)
        return config

    def _make_phases(self, settings: Settings) -> Any:
        phases = (self._types[f"{self.name}_phase_f32"] * len(settings.phases))()
        contact = self._new("contact")
        _fill(contact, {name: settings.trajectory[name] for name, _ in contact._fields_})
        for made, phase in zip(phases, settings.phases, strict=True):
            rows = settings.points[phase["first_row"] : phase["first_row"] + phase["degree"] + 1]
            _fill(made, {name: phase[name] for name in ("coordinates", "degree", "duration")})
            made.points = (ctypes.c_float * rows.size)(*rows.ravel().tolist())
            if phase["touches"]:
                made.contact = ctypes.pointer(contact)
            self._call("prepare_phase", made)
        return phases

    def _make_trajectory(self, settings: Settings) -> Any:
        plan = self._new("trajectory")
        _fill(plan, {name: settings.trajectory[name] for name in ("count", "periodic", "elbow")})
        plan.phases = self._phases
        for joint, spring in enumerate(plan.springs):
            _fill(spring, {name: settings.trajectory[f"spring_{name}"][joint] for name, _ in spring._fields_})
        return plan


def _fill(target: ctypes.Structure, values: Values) -> None:
    for name, value in values.items():
        if isinstance(value, list):
            getattr(target, name)[:] = value
        else:
            setattr(target, name, value)


_SCALARS: dict[str, Any] = {"float": ctypes.c_float, "int32_t": ctypes.c_int32, "uint32_t": ctypes.c_uint32}


def structures(records: Sequence[Mapping[str, Any]]) -> dict[str, type[ctypes.Structure]]:
    """By name, in the order of the description: each may hold earlier ones."""
    found: dict[str, type[ctypes.Structure]] = {}
    for record in records:
        fields = [(field["name"], _type(field, found)) for field in record["fields"]]
        found[record["name"]] = type(record["name"], (ctypes.Structure,), {"_fields_": fields})
    return found


def _type(field: Mapping[str, Any], known: Mapping[str, Any]) -> Any:
    kind = _SCALARS.get(field["type"]) or known[field["type"]]
    if field["pointer"]:
        return ctypes.POINTER(kind)
    return kind if field["count"] is None else kind * field["count"]
