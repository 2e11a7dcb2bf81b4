"""The generated monitor of one joint, compiled for this computer, along residuals of many hours."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from codegen import render
from codegen.monitor.alarm import degrees_of_freedom
from codegen.toolchain import build
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file import reader
from tests.watched_arm import watched_text

DRIVER = Path(__file__).resolve().parent / "codegen" / "c" / "watched_noise.c"
CUTOFF, RATE = 8.0, 100.0
"""Hz; a slow control rate, for which the numbers of the monitor follow as for a fast one."""
Float32 = NDArray[np.float32]


def noise_gain() -> float:
    """RMS of white noise of unit variance behind the monitor's two low-passes."""
    kept = np.exp(-2 * np.pi * CUTOFF / RATE)
    response = (1 - kept) ** 2 * np.arange(1, 400) * kept ** np.arange(399)
    return float(np.sqrt(np.sum(response**2)))


@dataclass
class WatchedNoise:
    """A monitor with a floor of 1 N m; false_alarms: in a thousand hours, as the model file states it."""

    false_alarms: float
    load_floor: float = 0.0

    def __post_init__(self) -> None:
        monitor = f"[monitor]\ncutoff = {CUTOFF}\nfalse_alarms = {self.false_alarms}\n"
        text = watched_text(floor=1.0, monitor=monitor, load_floor=self.load_floor)
        text = text.replace("rate = 1000.0", f"rate = {RATE}").replace(
            "velocity_cutoff = 100.0", "velocity_cutoff = 40.0"
        )
        model = derive(reader.parse(text, "arm.toml"))
        files = render.arm_files(model) | render.controller_files(model, LIBRARY)
        used = ("arm_monitor_f32.c", "arm_monitor_f32.h", "tendon_math_f32.h")
        code = {path: files[path] for path in used} | {"watched_noise.c": DRIVER.read_text()}
        self._library = ctypes.CDLL(str(build.shared_library(code, "code")))
        pointer = ctypes.c_void_p
        self._library.watch.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_size_t, *[pointer] * 4]
        self._config, self._state = ctypes.create_string_buffer(4096), ctypes.create_string_buffer(4096)
        self.restart()

    def restart(self) -> None:
        """A monitor that has seen nothing."""
        self._library.begin(self._config, self._state)

    def watch(self, residual: Float32, load: Float32 | None = None) -> int:
        """Samples until the model does not hold; all of them if it does to the end. It goes on where it was."""
        loads = np.zeros_like(residual) if load is None else load
        own = (ctypes.c_void_p(x.ctypes.data) for x in (residual, loads))
        return int(self._library.watch(self._config, self._state, len(residual), *own, None, None))

    def said(self, residual: Float32, load: Float32, motion: Float32) -> NDArray[np.uint8]:
        """(2, N) verdict and signal after every sample; motion (N, 3): position, rate, acceleration."""
        found = np.zeros(len(residual), dtype=np.uint8)
        rows = [np.ascontiguousarray(x, dtype=np.float32) for x in (residual, load, motion)]
        own = (ctypes.c_void_p(x.ctypes.data) for x in (*rows, found))
        self._library.watch(self._config, self._state, len(found), *own)
        return np.stack([found % 4, found // 4])

    def alarms(self, hours: float, rng: np.random.Generator, rms: float = 1.0) -> int:
        """How many alarms there are in so many hours of noise with this RMS over the floor; after each the monitor
        begins anew."""
        found, scale, block = 0, np.float32(rms / noise_gain()), 2_000_000
        for _ in range(round(hours * 3600 * RATE / block)):
            residual = scale * rng.standard_normal(block, dtype=np.float32)
            at = 0
            while (at := at + self.watch(residual[at:])) < block:
                found += 1
                self.restart()
        return found

    def delays(self, ratio: float, runs: int, rng: np.random.Generator, seconds: float = 120.0) -> NDArray[np.float64]:
        """(runs,) s from a change of the RMS, from the floor to `ratio` floors, to the alarm; NaN where there is none
        in so many seconds, 0 for an alarm before the change."""
        before, count, found = round(20 * RATE), round((20 + seconds) * RATE), np.empty(runs)
        for k in range(runs):
            self.restart()
            residual = rng.standard_normal(count, dtype=np.float32) / np.float32(noise_gain())
            residual[before:] *= np.float32(ratio)
            taken = self.watch(residual)
            found[k] = np.nan if taken == count else max(taken - before, 0) / RATE
        return found


FREEDOM = degrees_of_freedom(CUTOFF)
