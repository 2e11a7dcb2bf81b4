"""The floors of the monitor on the board: what a recording leaves of each joint's torque while the model holds.

The residual is that of the board's own code, compiled for this computer: torque less the model's torque for the desired
motion, where it was recorded, else for the measured one. Floor, its growth with the load, and how much the energies of
windows scatter are what the monitor needs so that false alarms are as rare as stated.
"""

from __future__ import annotations

import ctypes
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from runtime.arrays import Array
from runtime.hardware.settings import ControllerError, check_controllable
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.motion.clock import grid
from runtime.motion.filters import differentiator
from runtime.recordings.recording import Recording

Float32 = NDArray[np.float32]

HIGHEST_CUTOFF = 20.0
"""Hz; above it a position loop answers less than the model lacks, and the feedback no longer shows that."""
LEAST_WINDOWS = 20
"""Number of windows of a joint from which its floor and the scatter of energies are taken: ten seconds of motion."""
_SETTLED = 2.0
"""Times 1/cutoff; after it a low-pass of second order has forgotten where it began."""


@dataclass(frozen=True)
class MeasuredFloor:
    """Of a joint: RMS of its residual in N m (N) without load, its growth with the load, and the degrees of freedom of
    the energy in a window. slowest: rad/s (m/s), at a lower speed it is not judged"""

    floor: float
    load_floor: float
    slowest: float
    freedom: float


def measured_floors(
    model: Model, directory: Path, recordings: Sequence[Recording], slowest: Array
) -> list[MeasuredFloor]:
    """The floor of every joint, from recordings of a model that holds.

    directory   of codegen.prepare.prepare_residuals     slowest   (n,) rad/s (m/s)
    Raises ControllerError where a joint moves too little.
    """
    document = json.loads((directory / "controller.json").read_text(encoding="utf-8"))
    check_controllable(model, document["effects"])
    page = document["monitor"]
    rate = (model.controller or {})["rate"]
    window, settled = round(page["window"] * rate), round(_SETTLED * rate / page["cutoff"])
    parts = [part for r in recordings for part in _residuals(model, directory, r, page["cutoff"])]
    found = []
    for j, slow in enumerate(slowest):
        moving = [np.flatnonzero(np.abs(qd[settled:, j]) > slow) + settled for _, _, qd in parts]
        residual, load = (np.concatenate([x[k][at, j] for x, at in zip(parts, moving, strict=True)]) for k in (0, 1))
        count = len(residual) // window
        if count < LEAST_WINDOWS:
            moved = f"joint {j + 1} moves faster than {slow:.3g} {model.joints[j].position_unit}/s"
            raise ControllerError(
                f"{recordings[0].path}: {moved} for {len(residual) / rate:.3g} s; its floor needs "
                f"{LEAST_WINDOWS * page['window']:g} s of motion"
            )
        windows = [x[: count * window].reshape(count, window) for x in (residual, load)]
        found.append(_floor(windows[0], windows[1], float(slow), page["freedom"]))
    return found


def _floor(residual: Array, load: Array, slowest: float, most: float) -> MeasuredFloor:
    """From windows (W, N) of residual and load; most: degrees of freedom of noise.

    The shape floor + load_floor |load| is that of the residual's magnitude, its size that of the energies.
    """
    columns = np.stack([np.ones(residual.size), np.abs(load).ravel()], axis=1)
    (alone, slope), _ = nnls(columns, np.abs(residual).ravel())
    expected = np.mean((alone + slope * np.abs(load)) ** 2, axis=1)
    energy = np.mean(residual**2, axis=1)
    size = np.sqrt(energy.sum() / expected.sum())
    # Of chi-squared over its degrees of freedom the variance is two over them.
    scatter = float(np.var(energy / (size**2 * expected)))
    freedom = min(most, 2.0 / max(scatter, 1e-9))
    return MeasuredFloor(float(size * alone), float(size * slope), float(slowest), freedom)


def _residuals(
    model: Model, directory: Path, recording: Recording, cutoff: float
) -> Iterator[tuple[Array, Array, Array]]:
    """(N, n) residual in the monitor's band, load and measured rate of every stretch, at the control rate."""
    clock, rate = grid(recording), (model.controller or {})["rate"]
    derive = differentiator(cutoff, 1 / clock.period)
    wanted = recording.q_desired
    for s in (s for s in clock.stretches if derive.fits(s.size)):
        q, qd, qdd = derive.rows(s.on_grid(recording.q))
        motion = (q, qd, qdd) if wanted is None or np.isnan(wanted).any() else derive.rows(s.on_grid(wanted))
        tau = s.on_grid(recording.tau)[:, derive.half : -derive.half] - _springs(model, q)
        t = clock.period * np.arange(q.shape[1])
        at = np.arange(0.0, t[-1], 1 / rate)
        rows = [np.array([np.interp(at, t, row) for row in x]).T for x in (tau, q, qd, *motion)]
        residual, load = _along(model, directory, rows)
        yield residual, load, rows[2]


def _springs(model: Model, q: Array) -> Array:
    """(n, N) torque of the springs in the model file; on the board they belong to the trajectory."""
    found = np.zeros(q.shape)
    for term, values in structure(model).items():
        info = model.library.effects[term.effect]
        if info.brought and info.scope == "joint" and term.joint is not None:
            joint = term.joint - 1
            found[joint] += model.library.torque(term.effect, {"q": q[joint], "t": q[joint]}, values, 1.0)
    return found


def _along(model: Model, directory: Path, rows: Sequence[Array]) -> tuple[Array, Array]:
    """(N, n) residual and load of rows (N, n): torque, q, qd, and the motion for which the model is asked."""
    page = json.loads((directory / "controller.json").read_text(encoding="utf-8"))
    library = ctypes.CDLL(str(directory / "lib.so"))
    effects = np.array(list(page["effects"].values()), dtype=np.float32)
    inputs = [np.ascontiguousarray(x, dtype=np.float32) for x in rows]
    outputs = [np.zeros(rows[0].shape, dtype=np.float32) for _ in range(2)]
    arrays = (ctypes.c_void_p(x.ctypes.data) for x in (effects, *inputs, *outputs))
    getattr(library, f"{model.name}_residuals_f32")(ctypes.c_uint32(len(rows[0])), *arrays)
    residual, load = outputs
    return residual.astype(np.float64), load.astype(np.float64)
