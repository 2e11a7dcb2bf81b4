"""A bench for one recording: an arm with its controller, its motion and its noises."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from runtime.arrays import Array
from runtime.recordings.recording import Recording

from . import recorder
from .bodies import ARMS, Bodies, in_space, torque
from .hidden import Hidden, Rows
from .plant import COUNT, PERIOD, Run, simulate
from .recorder import Logger
from .size import BAND, in_band

DISTURBANCE = 0.03  # N m, beside a noise of LEVEL
NOISE = {"white": 0.0, "coloured": 0.5, "strong": 0.95}
"""Noise of the recorded torque as a first-order autoregression of this coefficient."""
LEVEL = 0.2  # N m
BAND_OF_SAMPLING = 0.18

Hiding = tuple[Hidden, int, float]
"""What is hidden, at which joint (0-based), and how much of it."""


@dataclass(frozen=True)
class Setting:
    """How a recording is made."""

    joints: int = 1
    excitation: str = "full"
    coarse: float = 1.0
    noise: str = "white"
    jitter: float = 0.0  # standard deviation of the instants about an even grid, in periods
    temperature: bool = True
    fine_control: bool = False  # the controller sees a fine encoder where the recording has a coarse one
    level: float = LEVEL  # N m, of the torque's noise
    gear_ratio: float = 100.0
    gravity: tuple[float, ...] = (0.0, 0.0)  # m/s^2, in the plant; the model file has it, too, unless it is hidden
    logger: Logger = field(default_factory=Logger)
    simulator: str = ""  # "mujoco", or the judge's own plant
    drive: str = ""  # of drives.FORMS: what is recorded in place of a torque

    def __str__(self) -> str:
        parts = [self.excitation, self.noise, f"x{self.coarse:g}"]
        parts += ["jitter"] if self.jitter else []
        parts += ["fine control"] if self.fine_control else []
        parts += [] if self.temperature else ["no T"]
        parts += [f"noise {self.level:g}"] if self.level != LEVEL else []
        parts += [f"N {self.gear_ratio:g}"] if self.gear_ratio != 100.0 else []
        parts += [f"g {','.join(f'{x:g}' for x in self.gravity)}"] if any(self.gravity) else []
        parts += [self.simulator] if self.simulator else []
        parts += [f"by {self.drive}"] if self.drive else []
        return " ".join([*parts, str(self.logger)]).strip()

    @property
    def band(self) -> float:
        """Hz, in which sizes are measured: what a diagnosis can use of a recording at this rate."""
        return min(BAND, BAND_OF_SAMPLING / (PERIOD * self.logger.every))


@dataclass(frozen=True)
class Bench:
    """An arm with its controller, driven along one motion with one set of noises."""

    bodies: Bodies
    setting: Setting
    motion: Array
    forward: Array
    warm: Array
    background: Array
    noise: Array
    warmth: Array
    period: Array
    rows: Rows
    logged: NDArray[np.intp]  # the controller's periods at whose beginnings samples are taken

    @property
    def n(self) -> int:
        return len(self.bodies)

    @property
    def t(self) -> Array:
        return np.concatenate([[0.0], np.cumsum(self.period)[:-1]])

    def floor(self) -> Array:
        """(n,) N m: the noise in band: of the torque, the small disturbance and a fine encoder's through inertia."""
        band, step = self.setting.band, PERIOD * self.setting.logger.every
        heavy = np.array([row["KP"] for row in self.rows]) / bandwidth_of(1.0) ** 2
        density = 2 * step * (2 * np.pi) ** 4 * band**5 / 5
        steps = self.setting.logger.resolution**2 / 12 * 2 * step * band
        encoder = heavy * COUNT / np.sqrt(12) * np.sqrt(density)
        noise = np.mean(in_band(self.noise + self.background, band) ** 2, axis=1)
        floors: Array = np.sqrt(noise + encoder**2 + steps)
        return floors

    def plant(self, hidden: Sequence[Hiding]) -> tuple[Rows, dict[str, float]]:
        """Parameters of the joints and of the arm with effects hidden in them."""
        rows, arm = [dict(row) for row in self.rows], {"COUNT": COUNT}
        arm.update({f"GRAVITY_{axis}": x for axis, x in zip("XYZ", self.setting.gravity, strict=False)})
        arm.update(SPATIAL=float(in_space(self.bodies)))
        for what, _, amount in hidden:
            if what.put is not None:
                what.put(rows, arm, amount)
        return rows, arm

    def run(self, hidden: Sequence[Hiding]) -> Run:
        """The plant with effects hidden in it. Raises RanAwayError."""
        rows, arm = self.plant(hidden)
        pushes = self.background.copy()
        substeps = 8.0
        for what, joint, amount in hidden:
            if what.push is not None:
                pushes[joint] += what.push(self.t, amount)
        if any(row.get("STIFFNESS", 0.0) > 3e4 for row in rows):
            substeps = 16.0
        if not self.setting.fine_control:
            arm["COUNT"] = COUNT * self.setting.coarse
        arm["SUBSTEPS"] = substeps
        return simulate(rows, self.motion, arm, self.forward, pushes, self.warm, self.period)

    def part(self, _what: Hidden) -> Bench:
        """The bench with as much of the motion as tells an effect's size: all of it."""
        return self

    def recording(self, run: Run) -> Recording:
        temperature = [row if self.setting.temperature else None for row in self.warmth]
        logger, coarse = self.setting.logger, self.setting.coarse
        return recorder.record(logger, run, self.t, self.logged, self.noise, coarse, temperature)

    def disturbed(self, run: Run, recording: Recording) -> Array:
        """(n, M) N m, what the recorded torque holds beside physics: noise and steps, less the push from outside."""
        physics = recorder.means(run.tau + self.background, self.logged, recorder.held(self.setting.logger))
        found: Array = recording.tau - physics
        return found

    def exact(self, run: Run, recording: Recording) -> Array:
        """(n, M) rad, the motors' angles at the instants that the recording's stamps say, before the encoder."""
        return np.array([np.interp(recording.t, self.t, row) for row in run.q])


def bandwidth_of(coarse: float) -> float:
    """Of the position controller, rad/s: a coarse encoder allows less."""
    return 2 * np.pi * {1.0: 6.0, 10.0: 5.0, 50.0: 3.0}.get(coarse, 3.0)


def bench(setting: Setting, wanted: Array, rng: np.random.Generator, warms: bool, rows: Rows) -> Bench:
    """A bench with the judge's own arm; as `built`."""
    return built(ARMS[setting.joints], setting, wanted, rng, warms, rows)


def built(bodies: Bodies, setting: Setting, wanted: Array, rng: np.random.Generator, warms: bool, rows: Rows) -> Bench:
    """A bench for one recording of the motion wanted (3, n, N); rows: the plant's parameters without its controller.

    Gains are for the inertia at rest in the middle; in space, where a joint feels a tenth of it in another posture, for
    the least along the motion: with larger ones the controller oscillates there, as none is let.
    """
    n, count = wanted.shape[1:]
    coarse = 1.0 if setting.fine_control else setting.coarse
    bandwidth = bandwidth_of(coarse)
    controlled = []
    places = wanted[0, :, ::100] if in_space(bodies) else np.zeros((n, 1))
    for i, row in enumerate(rows):
        push = np.zeros((3, *places.shape))
        push[0], push[2, i] = places, 1.0
        inertia = float(torque(bodies, push)[i].min())
        gains = {"KP": inertia * bandwidth**2, "KD": 1.6 * inertia * bandwidth}
        controlled.append({**row, **gains, "OBSERVER": bandwidth * (6.0 if coarse == 1.0 else 3.5)})
    forward = torque(bodies, wanted, setting.gravity)
    if rng.random() < 0.5:  # half of the controllers compensate friction, roughly
        for i, body in enumerate(bodies):
            forward[i] += 0.6 * np.mean(body.dry) * np.tanh(wanted[1, i] / 0.05) + body.viscous * wanted[1, i]
    late = np.clip(setting.jitter * rng.standard_normal(count + 1), -0.45, 0.45)
    period = PERIOD * (1 + np.diff(late))
    if setting.logger.stamps == "rounded":
        period = period * recorder.clock(setting.logger, rng)
    slow = signal.butter(1, 5.0, fs=1 / PERIOD, output="sos")
    background = signal.sosfilt(slow, rng.standard_normal((n, count)), axis=1)
    level = setting.level * np.array([[body.noise] for body in bodies])
    background *= DISTURBANCE * level / LEVEL / background.std(axis=1, keepdims=True)
    part = NOISE[setting.noise]
    noise = signal.lfilter([np.sqrt(1 - part**2)], [1, -part], level * rng.standard_normal((n, count)), axis=1)
    time = np.cumsum(period)
    warm = np.tile(1 - np.exp(-time / (0.35 * time[-1])), (n, 1))
    rise = rng.uniform(8.0, 18.0) if warms or rng.random() < 0.5 else 0.0
    degrees = 24.0 + rise * warm + 0.2 * rng.standard_normal((n, count))
    logged = recorder.instants(setting.logger, count, rng)
    return Bench(bodies, setting, wanted, forward, warm, background, noise, degrees, period, controlled, logged)


def specimen(bodies: Bodies, believed: Sequence[str], rng: np.random.Generator) -> Rows:
    """The bodies as the user knows them, with frictions of their own, but no other kinds than are believed in."""
    rows = []
    for body in bodies:
        row = body.parameters()
        for name in ("DRY_POSITIVE", "DRY_NEGATIVE", "CUBIC"):
            row[name] *= rng.uniform(0.75, 1.25)
        factor = rng.uniform(0.8, 1.25)
        row["VISCOUS_POSITIVE"] *= factor
        row["VISCOUS_NEGATIVE"] *= factor
        if "coulomb" in believed:
            row["DRY_POSITIVE"] = row["DRY_NEGATIVE"] = 0.5 * (row["DRY_POSITIVE"] + row["DRY_NEGATIVE"])
        if not {"coulomb", "coulomb_asymmetric"} & set(believed):
            row["DRY_POSITIVE"] = row["DRY_NEGATIVE"] = 0.0
        if "viscous" not in believed:
            row["VISCOUS_POSITIVE"] = row["VISCOUS_NEGATIVE"] = 0.0
        if "viscous_cubic" not in believed:
            row["CUBIC"] = 0.0
        rows.append(row)
    return rows
