"""The generated code as NumPy functions: an arm's Model and the Library of effects.

All arrays are C-contiguous float64 with the samples last: q (n, N). A call without samples, q (n,), gives a
result without samples.
"""

from __future__ import annotations

import ctypes
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from math import nan, prod
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from runtime.arrays import Array
from runtime.model.catalogue import (
    EffectInfo,
    JointInfo,
    LoaderError,
    LumpInfo,
    SignalInfo,
    effects_of,
    evaluate,
    joint_info,
)
from symbolic.model_file.checks import check_stated

__all__ = [
    "EffectInfo",
    "JointInfo",
    "Library",
    "LoaderError",
    "LumpInfo",
    "Model",
]


@contextmanager
def _reading(directory: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise LoaderError(f"{directory}: no compiled code here ({error}); compile it with codegen.prepare") from error


_MOST_AT_ONCE = 20_000_000
"""Numbers, 160 MB, of scratch memory in columns_in_band; beyond it, joints are computed one after the other."""


def _pointer(array: Array) -> ctypes.c_void_p:
    # `array.ctypes` takes ten times as long.
    return ctypes.c_void_p(array.__array_interface__["data"][0])


class ContactInfo(TypedDict):
    """x: of the contact point along the base frame, m; effects: values of their parameters."""

    x: float
    effects: dict[str, dict[str, float]]


class Model:
    """The functions of an arm.

    spatial   whether it is spatial     places   of its joints at q = 0, m in base axes
    `lumps` (p,) replaces the base inertial parameters of the model file for one call. If the file leaves some open, the
    equations of motion need it, and raise ModelError without it.
    """

    def __init__(self, directory: Path, library: Library) -> None:
        self.directory, self.library = directory, library
        with _reading(directory):
            self.metadata = json.loads((directory / "metadata.json").read_text(encoding="utf-8"))
            self._lib = ctypes.CDLL(str(directory / "lib.so"))
        self.name: str = self.metadata["name"]
        self.n: int = self.metadata["n"]
        self.spatial: bool = self.metadata["space"]
        self.gravity: tuple[float, ...] = tuple(self.metadata["gravity"])
        self.effects: dict[str, dict[str, float]] = self.metadata["effects"]
        self.contact: ContactInfo | None = self.metadata["contact"]
        self.controller: dict[str, float] | None = self.metadata["controller"]
        self.joints = tuple(joint_info(data) for data in self.metadata["joints"])
        self.places: tuple[tuple[float, ...], ...] = tuple(map(tuple, self.metadata["places"]))
        self.lumps = tuple(LumpInfo(**data) for data in self.metadata["lumps"])
        self._defaults: Array = np.array([field["default"] for field in self.metadata["struct"]], dtype=np.float64)
        self.functions = tuple(self.metadata["functions"])

    @cached_property
    def lump_values(self) -> Array:
        """(p,) base inertial parameters of the model file. Raises ModelError if one is unknown."""
        open_lumps = [lump.name for lump in self.lumps if lump.value is None]
        check_stated(self.name, open_lumps, [joint.unknown for joint in self.joints])
        return self._defaults[: len(self.lumps)]

    def lumps_or(self, fitted: Array) -> Array:
        """(p,) base inertial parameters of the model file, and fitted ones where it leaves one open."""
        stated = self._defaults[: len(self.lumps)]
        return np.where(np.isnan(stated), fitted, stated)

    @cached_property
    def lumps_known(self) -> bool:
        """Whether the model file states all base inertial parameters."""
        return all(lump.value is not None for lump in self.lumps)

    @property
    def struct_values(self) -> list[float]:
        """Base inertial parameters, then geometry, as the generated functions take them. Raises ModelError."""
        return self.struct_of(self.lump_values.tolist())

    def struct_of(self, lumps: Iterable[Any]) -> list[Any]:
        """The same with other base inertial parameters (p,), numbers or expressions."""
        return [*lumps, *self._defaults[len(self.lumps) :].tolist()]

    def call(self, function: str, arguments: Mapping[str, ArrayLike], lumps: ArrayLike | None = None) -> Array:
        """Calls a generated function by name. Inputs and output (*shape, N); see metadata["functions"].

        Without lumps, results that depend on an unknown one are NaN.
        """
        if function not in self.metadata["functions"]:
            raise LoaderError(f'arm "{self.name}" has no function "{function}"; it has: {", ".join(self.functions)}')
        page = self.metadata["functions"][function]
        arrays, count = self._arrays(function, page["inputs"], arguments)
        shape = tuple(page["outputs"][0][1])
        samples = () if count is None else (count,)
        out = np.empty((*shape, *samples))
        parameters = self._defaults
        if lumps is not None:
            values = np.asarray(lumps, dtype=np.float64)
            if values.shape != (len(self.lumps),):
                raise LoaderError(f"lumps has shape {values.shape}, expected ({len(self.lumps)},) for {self.name}")
            parameters = np.concatenate([values, parameters[len(values) :]])
        kernel = getattr(self._lib, f"{self.name}_{function}_batch_f64")
        kernel(
            ctypes.c_size_t(1 if count is None else count),
            *(_pointer(a) for a in (parameters, *arrays, out)),
        )
        return out

    def _arrays(
        self, function: str, inputs: list[Any], arguments: Mapping[str, ArrayLike]
    ) -> tuple[list[Array], int | None]:
        """Inputs in order, and the number of samples; None: a call without samples."""
        arrays = [np.asarray(arguments[name], dtype=np.float64, order="C") for name, _ in inputs]
        # The dimensions of the first input show whether there are samples.
        count = arrays[0].shape[-1] if arrays[0].ndim == len(inputs[0][1]) + 1 else None
        for i, ((name, shape), array) in enumerate(zip(inputs, arrays, strict=True)):
            expected = (*shape,) if count is None else (*shape, count)
            if not shape and count is not None and array.ndim == 0:
                arrays[i] = np.full(count, float(array))
            elif array.shape != expected:
                rows = ", ".join(map(str, shape))
                hint = f"pass ({rows}{', ' if rows else ''}N), the samples last"
                raise LoaderError(
                    f"{self.name}: {function}: {name} has shape {array.shape}, expected {expected}; {hint}"
                )
        return arrays, count

    def _or_stated(self, lumps: ArrayLike | None) -> ArrayLike:
        return self.lump_values if lumps is None else lumps

    def inverse_dynamics(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, lumps: ArrayLike | None = None) -> Array:
        """Motor torques of the rigid arm, (n, N) N m or N."""
        return self.call("inverse_dynamics", {"q": q, "qd": qd, "qdd": qdd}, self._or_stated(lumps))

    def forward_dynamics(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike, lumps: ArrayLike | None = None) -> Array:
        """Accelerations under the torques tau, (n, N)."""
        return self.call("forward_dynamics", {"q": q, "qd": qd, "tau": tau}, self._or_stated(lumps))

    def regressor(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Derivative of the inverse dynamics by the lumps, (n, p, N)."""
        return self.call("regressor", {"q": q, "qd": qd, "qdd": qdd})

    def inertia(self, q: ArrayLike, lumps: ArrayLike | None = None) -> Array:
        """D(q), (n, n, N)."""
        return self.call("inertia", {"q": q}, self._or_stated(lumps))

    def coriolis(self, q: ArrayLike, qd: ArrayLike, lumps: ArrayLike | None = None) -> Array:
        """C(q, qd), (n, n, N)."""
        return self.call("coriolis", {"q": q, "qd": qd}, self._or_stated(lumps))

    def tip(self, q: ArrayLike) -> Array:
        """The tip in the base frame, (3, N): x, y and angle; of a spatial arm x, y and z."""
        return self.call("tip", {"q": q})

    def tip_jacobian(self, q: ArrayLike) -> Array:
        """Derivative of the tip by q, (3, n, N); of a spatial arm (6, n, N), along x, y, z and about them."""
        return self.call("tip_jacobian", {"q": q})

    def contact_coordinates(self, q: ArrayLike) -> Array:
        """w = phi(q), (4, N)."""
        return self.call("contact_coordinates", {"q": q})

    def contact_inverse(self, w: ArrayLike, elbow: ArrayLike) -> Array:
        """q of contact coordinates w; elbow: the sign of sin q2, a number or (N,). (4, N)."""
        return self.call("contact_inverse", {"w": w, "elbow": elbow})

    def contact_acceleration(self, q: ArrayLike, qd: ArrayLike, wdd: ArrayLike) -> Array:
        """qdd of contact accelerations wdd, (4, N)."""
        return self.call("contact_acceleration", {"q": q, "qd": qd, "wdd": wdd})


class Library:
    """The effects' torques and regressors along recorded signals."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        with _reading(directory):
            self.metadata = json.loads((directory / "effects.json").read_text(encoding="utf-8"))
            self._lib = ctypes.CDLL(str(directory / "lib.so"))
        self.signal: dict[str, SignalInfo] = {s["name"]: SignalInfo(**s) for s in self.metadata["signals"]}
        self.signals: tuple[str, ...] = tuple(self.signal)
        self._place = {name: place for place, name in enumerate(self.signals)}
        self._lanes: int = self.metadata["lanes"]
        self.effects: dict[str, EffectInfo] = effects_of(self.metadata["effects"])
        # What the signals of an effect depend on: `Needs` of symbolic/effects/signals.py.
        self.needs: dict[str, frozenset[str]] = {
            name: frozenset(self.signal[s].needs for s in info.signals) for name, info in self.effects.items()
        }

    def __getitem__(self, effect: str) -> EffectInfo:
        if effect not in self.effects:
            raise LoaderError(f'there is no effect "{effect}"; tendon effects lists them all')
        return self.effects[effect]

    def columns(
        self,
        effect: str,
        signals: Mapping[str, ArrayLike],
        parameters: Mapping[str, float],
        dt: float = 0.0,
    ) -> Array:
        """Regressor (1 + k, N): the part without linear parameters, then a row for each of the k coefficients.

        parameters   the shape parameters     dt   s, only for effects with states
        """
        info = self[effect]
        return self._call(info, "columns", 1 + len(info.coefficients), signals=signals, parameters=parameters, dt=dt)

    def torque(
        self,
        effect: str,
        signals: Mapping[str, ArrayLike],
        parameters: Mapping[str, float],
        dt: float = 0.0,
    ) -> Array:
        """The effect's torque, (N,), from all its parameters."""
        return self._call(self[effect], "torque", 1, signals=signals, parameters=parameters, dt=dt)[0]

    def states(
        self,
        effect: str,
        signals: Mapping[str, ArrayLike],
        parameters: Mapping[str, float],
        dt: float,
    ) -> dict[str, Array]:
        """The effect's states along the samples, (N,) each. Linear parameters may be left out and count as zero."""
        info = self[effect]
        if not info.states:
            return {}
        rows = self._call(info, "states", len(info.states), signals=signals, parameters=parameters, dt=dt)
        return dict(zip(info.states, rows, strict=True))

    def coefficients(self, effect: str, parameters: Mapping[str, float]) -> Array:
        """The unknowns of the linear fit (k,) from an effect's parameters; 0 for those that need one without value."""
        info = self[effect]
        if info.from_parameters is None:
            return np.array([parameters.get(c.name, 0.0) for c in info.coefficients])
        known = {p.name: parameters.get(p.name, nan if p.default is None else p.default) for p in info.parameters}
        return np.nan_to_num(np.array([evaluate(form, known) for form in info.from_parameters]), nan=0.0)

    def recover(self, effect: str, coefficients: ArrayLike, shape: Mapping[str, float]) -> dict[str, float]:
        """All parameters of an effect, from its coefficients (k,) and its other parameters."""
        info = self[effect]
        values = np.asarray(coefficients, dtype=np.float64)
        found = {p.name: float(shape.get(p.name, p.default or 0.0)) for p in info.parameters if p.role != "linear"}
        if info.recover is None:
            solved = dict(zip((p.name for p in info.linear), map(float, values), strict=True))
        else:
            known = {**found, **dict(zip((c.name for c in info.coefficients), map(float, values), strict=True))}
            solved = {p.name: evaluate(form, known) for p, form in zip(info.linear, info.recover, strict=True)}
        return {p.name: {**found, **solved}[p.name] for p in info.parameters}

    def decimate(self, kernel: Array, factor: int, x: Array) -> Array:
        """FIR filter with decimation: out[..., k] = sum_i kernel[i] x[..., k factor + i], every whole window.

        kernel (taps,), x (..., N) -> (..., (N − taps) // factor + 1), or (..., 0) where N < taps.
        """
        rows = np.ascontiguousarray(x, dtype=np.float64).reshape(prod(x.shape[:-1]), x.shape[-1])
        count = max(0, (rows.shape[1] - len(kernel)) // factor + 1)
        out = np.empty((len(rows), count))
        sizes = ctypes.c_size_t(count), ctypes.c_size_t(factor), ctypes.c_size_t(len(kernel))
        taps = np.ascontiguousarray(kernel)
        for row, result in zip(rows, out, strict=True):
            if not row.any():
                # Frequent: the part without coefficients.
                result[:] = 0.0
                continue
            self._lib.tendon_decimate_f64(*sizes, _pointer(taps), _pointer(row), _pointer(result))
        return out.reshape(*x.shape[:-1], count)

    def columns_in_band(
        self,
        effect: str,
        signals: Sequence[Mapping[str, ArrayLike]],
        choices: Sequence[Mapping[str, float]],
        dt: float,
        kernel: Array,
        factor: int,
    ) -> Array:
        """`columns` at J joints, for S choices of the shape parameters, filtered by `decimate`: (S, J, 1 + k, M).

        The signals that the effect's states read must be equal at all J joints.
        """
        info = self[effect]
        read = [self._signals(info, one) for one in signals]
        arrays, count = [arrays for arrays, _ in read], read[0][1]
        joints, rows = len(signals), 1 + len(info.coefficients)
        # Also of a single choice: the same choice among others is then the same to its last bit.
        lanes = self._lanes if info.states else 1
        if joints > 1 and joints * rows * count * lanes > _MOST_AT_ONCE:
            each = [
                self.columns_in_band(effect, [one], choices, dt=dt, kernel=kernel, factor=factor) for one in signals
            ]
            return np.concatenate(each, axis=1)
        values = np.array([self._values(info, choice, False) for choice in choices])
        padded = np.concatenate([values, np.repeat(values[-1:], -len(values) % lanes, axis=0)])
        out = np.empty((len(choices), joints, rows, max(0, (count - len(kernel)) // factor + 1)))
        taps, scratch = np.ascontiguousarray(kernel), np.empty((joints, rows, count, lanes))
        columns = getattr(self._lib, f"tendon_{effect}_columns_{'at_once' if lanes > 1 else 'batch'}_f64")
        self._lib.tendon_in_band_f64(
            columns,
            *map(ctypes.c_size_t, (lanes, joints * rows, values.shape[1], len(choices), count, joints)),
            self._pointers(arrays),
            ctypes.c_double(dt),
            _pointer(padded),
            *map(ctypes.c_size_t, (factor, len(kernel))),
            *map(_pointer, (taps, scratch, out)),
        )
        return out

    def _pointers(self, joints: Sequence[Mapping[str, Array]]) -> ctypes.Array[ctypes.c_void_p]:
        """One pointer per signal and joint; null for missing signals."""
        size = len(self.signals)
        found = (ctypes.c_void_p * (size * len(joints)))()
        for k, arrays in enumerate(joints):
            for name, array in arrays.items():
                found[k * size + self._place[name]] = array.ctypes.data
        return found

    def _call(
        self,
        info: EffectInfo,
        what: str,
        rows: int,
        signals: Mapping[str, ArrayLike],
        parameters: Mapping[str, float],
        dt: float,
    ) -> Array:
        values = self._values(info, parameters, what == "torque")
        if info.states and not dt > 0:
            raise LoaderError(f'effect "{info.name}" has states and needs a step dt > 0; found {dt}')
        arrays, count = self._signals(info, signals)
        out = np.empty((rows, count))
        kernel = getattr(self._lib, f"tendon_{info.name}_{what}_batch_f64")
        sizes = ctypes.c_size_t(count), ctypes.c_size_t(1)
        kernel(*sizes, self._pointers([arrays]), ctypes.c_double(dt), _pointer(values), _pointer(out))
        return out

    def _values(self, info: EffectInfo, parameters: Mapping[str, float], linear_too: bool) -> Array:
        found, missing, read = [], [], 0
        for p in info.parameters:
            if p.name in parameters:
                found.append(float(parameters[p.name]))
                read += 1
            else:
                found.append(p.default or 0.0)
                if p.role == "shape" or (linear_too and p.role == "linear"):
                    missing.append(p.name)
        if read < len(parameters):
            for name in parameters:
                info.parameter(name)
        if missing:
            raise LoaderError(f'effect "{info.name}" needs a value of: {", ".join(missing)}')
        return np.array(found, dtype=np.float64)

    def _signals(self, info: EffectInfo, signals: Mapping[str, ArrayLike]) -> tuple[dict[str, Array], int]:
        """The signals that the effect reads, each (N,); N is the length of the arrays in `signals`."""
        missing = [name for name in info.signals if name not in signals]
        if missing:
            raise LoaderError(f'effect "{info.name}" reads {", ".join(missing)}, which is not among the signals given')
        given = {name: np.asarray(value, dtype=np.float64) for name, value in signals.items()}
        lengths = {name: len(array) for name, array in given.items() if array.ndim == 1}
        if len(set(lengths.values())) > 1:
            text = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise LoaderError(f"signals differ in length: {text}")
        count = next(iter(lengths.values()), 1)
        arrays = {}
        for name in info.signals:
            array = given[name]
            if array.ndim > 1:
                raise LoaderError(f'signal "{name}" has shape {array.shape}, expected a number or (N,)')
            arrays[name] = np.full(count, float(array)) if array.ndim == 0 else np.ascontiguousarray(array)
        return arrays, count


def joint_places(model: Model, q: Array) -> list[tuple[Array, Array]]:
    """Of each joint at q (n, N): its position and the start of the moved part, (3, N) m; equal unless prismatic."""
    found = []
    for j, (joint, home) in enumerate(zip(model.joints, model.places, strict=True)):
        base = carried(model, q, j, home)
        found.append((base, carried(model, q, j + 1, home) if joint.type == "prismatic" else base))
    return found


def carried(model: Model, q: Array, link: int, place: ArrayLike) -> Array:
    """Position (3, N) m in base axes of a point fixed to a link (0: the base); z is 0 for planar arms.

    place   (2,) or (3,) m, the point's position at q = 0
    """
    still = np.ascontiguousarray(q, dtype=np.float64).copy()
    still[link:] = 0.0
    p, R = _pose(model, still)
    p0, R0 = (part[..., 0] for part in _pose(model, np.zeros((model.n, 1))))
    x = np.zeros(3)
    x[: np.size(place)] = place
    return p + np.einsum("ijn,kj,k->in", R, R0, x - p0)


def tip_place(model: Model, q: Array) -> Array:
    """Position (3, N) m of the tip in base axes; z is 0 for planar arms."""
    return _pose(model, np.ascontiguousarray(q, dtype=np.float64))[0]


def _pose(model: Model, q: Array) -> tuple[Array, Array]:
    """Position (3, N) and rotation (3, 3, N) of the tip in base axes."""
    tip = model.tip(q)
    if model.spatial:
        return tip, model.call("tip_rotation", {"q": q})
    c, s, zero = np.cos(tip[2]), np.sin(tip[2]), np.zeros(q.shape[1])
    R = np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]])
    return np.array([tip[0], tip[1], zero]), R
