"""Cases to judge by: a plant, what is hidden in it at a wanted size, a recording of it and the user's model file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from runtime.recording import Recording

from . import motion, outside  # noqa: F401 (outside adds its entries)
from .bodies import ARMS, BELIEVED, Body, model_text, torque
from .hidden import ENTRIES, PAIRS, Hidden, Rows, Setup
from .plant import COUNT, PERIOD, RanAwayError, Run, simulate
from .size import in_band, orthogonal

Array = NDArray[np.float64]

DISTURBANCE = 0.03  # N m
NOISE = {"white": 0.0, "coloured": 0.5, "strong": 0.95}
"""Noise of the recorded torque as a first-order autoregression of this coefficient."""
LEVEL = 0.2  # N m
NEAR = 0.1
"""A size within this of the wanted one is near enough."""


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


@dataclass(frozen=True)
class Case:
    """One line of the table. names: of hidden.ENTRIES; expected: verdicts that are right where nothing is named."""

    label: str
    kind: str
    names: tuple[str, ...]
    setting: Setting
    size: float
    seed: int
    expected: tuple[str, ...] = ("clean",)


@dataclass(frozen=True)
class Made:
    """A case made. joints: 1-based, of each hidden effect, None for one of the arm; sizes in units of the floor."""

    case: Case
    model: str
    recording: Recording
    held_out: Recording
    hidden: tuple[Hidden, ...]
    joints: tuple[int | None, ...]
    sizes: tuple[float, ...]
    amounts: tuple[float, ...]
    beyond_delay: float  # size of all that is hidden together, with the shift between torque and motion free as well


@dataclass(frozen=True)
class Bench:
    """An arm with its controller, driven along one motion with one set of noises."""

    bodies: tuple[Body, ...]
    setting: Setting
    motion: Array
    forward: Array
    warm: Array
    background: Array
    noise: Array
    warmth: Array
    period: Array
    rows: Rows

    @property
    def n(self) -> int:
        return len(self.bodies)

    @property
    def t(self) -> Array:
        return np.concatenate([[0.0], np.cumsum(self.period)[:-1]])

    def floor(self) -> Array:
        """(n,) N m: the noise in band: of the torque, the small disturbance and a fine encoder's through inertia."""
        heavy = np.array([row["KP"] for row in self.rows]) / _bandwidth(1.0) ** 2
        density = 2 * PERIOD * (2 * np.pi) ** 4 * 45.0**5 / 5
        encoder = heavy * COUNT / np.sqrt(12) * np.sqrt(density)
        floors: Array = np.sqrt(np.mean(in_band(self.noise + self.background) ** 2, axis=1) + encoder**2)
        return floors

    def run(self, hidden: Sequence[tuple[Hidden, int, float]]) -> Run:
        """The plant with effects (what, 0-based joint, amount) hidden in it. Raises RanAwayError."""
        rows, arm = [dict(row) for row in self.rows], {"COUNT": COUNT}
        pushes = self.background.copy()
        substeps = 8.0
        for what, joint, amount in hidden:
            if what.put is not None:
                what.put(rows, arm, amount)
            if what.push is not None:
                pushes[joint] += what.push(self.t, amount)
        if any(row.get("STIFFNESS", 0.0) > 3e4 for row in rows):
            substeps = 16.0
        if not self.setting.fine_control:
            arm["COUNT"] = COUNT * self.setting.coarse
        arm["SUBSTEPS"] = substeps
        return simulate(rows, self.motion, arm, self.forward, pushes, self.warm, self.period)

    def recording(self, run: Run) -> Recording:
        count = COUNT * self.setting.coarse
        temperature = [row if self.setting.temperature else None for row in self.warmth]
        return Recording(
            path=Path("judge.csv"),
            t=self.t,
            run=np.zeros(len(self.t), dtype=np.int64),
            q=np.ascontiguousarray(np.round(run.q / count) * count),
            tau=np.ascontiguousarray(run.tau + self.noise),
            types=("revolute",) * self.n,
            segments=(slice(0, len(self.t)),),
            temperature=tuple(temperature),
        )


def _bandwidth(coarse: float) -> float:
    """Of the position controller, rad/s: a coarse encoder allows less."""
    return 2 * np.pi * {1.0: 6.0, 10.0: 5.0, 50.0: 3.0}.get(coarse, 3.0)


def bench(setting: Setting, wanted: Array, rng: np.random.Generator, warms: bool, rows: Rows) -> Bench:
    """A bench for one recording of the motion wanted (3, n, N); rows: the plant's parameters without its controller."""
    bodies = ARMS[setting.joints]
    n, count = wanted.shape[1:]
    coarse = 1.0 if setting.fine_control else setting.coarse
    bandwidth = _bandwidth(coarse)
    controlled = []
    for i, row in enumerate(rows):
        push = np.zeros((3, n, 1))
        push[2, i] = 1.0
        inertia = float(torque(bodies, push)[i, 0])
        gains = {"KP": inertia * bandwidth**2, "KD": 1.6 * inertia * bandwidth}
        controlled.append({**row, **gains, "OBSERVER": bandwidth * (6.0 if coarse == 1.0 else 3.5)})
    forward = torque(bodies, wanted)
    if rng.random() < 0.5:  # half of the controllers compensate friction, roughly
        for i, body in enumerate(bodies):
            forward[i] += 0.6 * np.mean(body.dry) * np.tanh(wanted[1, i] / 0.05) + body.viscous * wanted[1, i]
    late = np.clip(setting.jitter * rng.standard_normal(count + 1), -0.45, 0.45)
    period = PERIOD * (1 + np.diff(late))
    slow = signal.butter(1, 5.0, fs=1 / PERIOD, output="sos")
    background = signal.sosfilt(slow, rng.standard_normal((n, count)), axis=1)
    background *= DISTURBANCE / background.std(axis=1, keepdims=True)
    part = NOISE[setting.noise]
    noise = signal.lfilter([np.sqrt(1 - part**2)], [1, -part], LEVEL * rng.standard_normal((n, count)), axis=1)
    time = np.cumsum(period)
    warm = np.tile(1 - np.exp(-time / (0.35 * time[-1])), (n, 1))
    rise = rng.uniform(8.0, 18.0) if warms or rng.random() < 0.5 else 0.0
    degrees = 24.0 + rise * warm + 0.2 * rng.standard_normal((n, count))
    return Bench(bodies, setting, wanted, forward, warm, background, noise, degrees, period, controlled)


def specimen(bodies: Sequence[Body], believed: Sequence[str], rng: np.random.Generator) -> Rows:
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
        if "viscous_cubic" not in believed:
            row["CUBIC"] = 0.0
        rows.append(row)
    return rows


def _grown(measure: Callable[[float], float], hidden: Hidden, target: float) -> tuple[float, float]:
    """Amount and size as near to the wanted size as the limits allow: secants in the logarithms, within a bracket."""
    least, most = (float(np.log(x)) for x in hidden.limits)
    small = large = None  # logarithms of amounts known to give too little and too much
    x, slope = float(np.log(hidden.amount)), hidden.power
    best, last = (hidden.amount, 0.0), None
    for _ in range(12):
        try:
            miss = float(np.log(max(measure(float(np.exp(x))), 1e-6) / target))
        except RanAwayError:
            miss = 20.0
        if miss < 10.0 and (best[1] == 0.0 or abs(miss) < abs(np.log(best[1] / target))):
            best = (float(np.exp(x)), target * float(np.exp(miss)))
        if abs(miss) < NEAR:
            break
        small, large = (small, x) if miss > 0 else (x, large)
        if last is not None and abs(x - last[0]) > 1e-3:
            secant = (miss - last[1]) / (x - last[0])
            slope = secant if 0.2 < secant / hidden.power < 5.0 else slope
        last = (x, miss)
        following = float(np.clip(x - np.clip(miss / slope, -2.5, 2.5), least, most))
        if small is not None and large is not None and not min(small, large) < following < max(small, large):
            following = 0.5 * (small + large)
        if abs(following - x) < 1e-3:
            break
        x = following
    return best


def make(case: Case) -> Made:
    """The case's recordings; the same case is made the same. Raises RanAwayError."""
    rng = np.random.default_rng([case.seed, case.setting.joints, *map(ord, case.label)])
    setting, bodies = case.setting, ARMS[case.setting.joints]
    plant_rng, motion_rng, other_rng, shape_rng = rng.spawn(4)
    joints = [_place(name, len(bodies), shape_rng) for name in case.names]
    wanted = motion.desired(motion_rng, len(bodies), setting.excitation)
    hidden = [
        ENTRIES[name].draw(Setup(bodies, j, wanted, shape_rng)) for name, j in zip(case.names, joints, strict=True)
    ]
    believed = next((h.believed for h in hidden if h.believed != BELIEVED), BELIEVED)
    warms = any(h.warms for h in hidden)
    rows = specimen(bodies, believed, plant_rng)
    main = bench(setting, wanted, motion_rng, warms, rows)
    floor = main.floor()
    found = []
    for what, joint in zip(hidden, joints, strict=True):

        def measure(amount: float, what: Hidden = what, joint: int = joint) -> float:
            left = orthogonal(main.run([(what, joint, amount)]), bodies, believed, main.background)
            return float(np.max(left / floor) if what.of_arm else left[joint] / floor[joint])

        found.append(_grown(measure, what, case.size))
    inside = [(what, joint, amount) for what, joint, (amount, _) in zip(hidden, joints, found, strict=True)]
    elsewhere = motion.desired(other_rng, len(bodies), setting.excitation)
    other = bench(setting, elsewhere, other_rng, warms, rows)
    together = main.run(inside)
    left = orthogonal(together, bodies, believed, main.background, free_delay=True) / floor
    return Made(
        case,
        model_text(bodies, believed),
        main.recording(together),
        other.recording(other.run(inside)),
        tuple(hidden),
        tuple(None if what.of_arm else joint + 1 for what, joint in zip(hidden, joints, strict=True)),
        tuple(size for _, size in found),
        tuple(amount for amount, _ in found),
        float(np.max(left)),
    )


def _place(name: str, n: int, rng: np.random.Generator) -> int:
    """The joint (0-based) of a hidden effect."""
    last = n - 1 if ENTRIES[name].not_last else n
    return int(rng.integers(0, last))


CLEAN: dict[str, tuple[Setting, tuple[str, ...]]] = {
    "clean": (Setting(), ("clean",)),
    "clean_coloured": (Setting(noise="coloured"), ("clean", "unexplained")),
    "clean_strong": (Setting(noise="strong"), ("clean", "unexplained")),
    "clean_x10": (Setting(coarse=10.0), ("clean",)),
    "clean_x50": (Setting(coarse=50.0), ("clean",)),
    "clean_x50_fine_control": (Setting(coarse=50.0, fine_control=True), ("clean",)),
    "clean_jitter": (Setting(jitter=0.1), ("clean",)),
    "clean_no_repeat": (Setting(excitation="no_repeat"), ("clean",)),
    "clean_no_temperature": (Setting(temperature=False), ("clean",)),
    "clean_one_cosine": (Setting(excitation="one_cosine"), ("clean", "refused")),
    "clean_small": (Setting(excitation="small"), ("clean", "refused")),
    "clean_no_slow": (Setting(excitation="no_slow"), ("clean", "refused")),
    "clean_slow": (Setting(excitation="slow"), ("clean", "refused")),
}

KINDS = ("clean", "single", "forms", "unknown", "pairs")


def cases(
    wanted: Sequence[str], joints: Sequence[int], sizes: Sequence[float], seeds: Sequence[int], setting: Setting
) -> Iterator[Case]:
    """Cases by class (KINDS) or by name, for arms of these numbers of joints. ValueError for an unknown name."""
    for n in joints:
        base = replace(setting, joints=n)
        for word in wanted:
            names = _named(word, n)
            for seed in seeds:
                for name in names:
                    yield from _of(name, base, sizes, seed)


def _named(word: str, n: int) -> list[str]:
    if word == "clean":
        return list(CLEAN)
    if word == "pairs":
        return [f"{a}+{b}" for a, b in PAIRS]
    if word in KINDS:
        return [k for k, e in ENTRIES.items() if e.kind == word and e.least_joints <= n]
    if word in CLEAN or all(part in ENTRIES for part in word.split("+")):
        return [word]
    raise ValueError(f"unknown case {word}; expected one of {', '.join((*KINDS, *CLEAN, *ENTRIES))}")


def _of(name: str, base: Setting, sizes: Sequence[float], seed: int) -> Iterator[Case]:
    if name in CLEAN:
        setting, expected = CLEAN[name]
        yield Case(name, "clean", (), replace(setting, joints=base.joints), 0.0, seed, expected)
        return
    parts = tuple(name.split("+"))
    kind = "pairs" if len(parts) > 1 else ENTRIES[name].kind
    for size in sizes:
        setting = base
        if "thermal" in name and seed % 2:  # every other one without a thermometer
            setting = replace(base, temperature=False)
        yield Case(name, kind, parts, setting, size, seed, ("unexplained",))
