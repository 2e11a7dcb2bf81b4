"""Cases to judge by: a plant, what is hidden in it at a wanted size, a recording of it and the user's model file."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from runtime.arrays import Array
from runtime.recordings.recording import Recording

from . import drives, forms, inside, library, motion, outside  # noqa: F401 (they add their entries)
from .bench import NOISE, Bench, Setting, bench, specimen
from .bodies import BELIEVED, Bodies, in_space
from .first import first_motion
from .hidden import ENTRIES, PAIRS, Entry, Hidden, Rows, Setup
from .limits import AMOUNTS
from .plant import PERIOD, RanAwayError, Run
from .situations import SITUATIONS
from .size import orthogonal
from .space import DOWN, HOME
from .truth import Parameters, true_parameters
from .world import World, world_of

__all__ = [
    "CLEAN",
    "KINDS",
    "NOISE",
    "Bench",
    "Case",
    "Made",
    "Setting",
    "bench",
    "cases",
    "make",
    "motion",
    "specimen",
]


FIRST = "first"
"""An excitation: the motion that `tendon experiment` proposes."""
NEAR = 0.1
"""A size within this of the wanted one is near enough."""


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
    gravity: tuple[float, ...]  # m/s^2, as the model file has it
    model: str
    recording: Recording
    held_out: Recording
    hidden: tuple[Hidden, ...]
    joints: tuple[int | None, ...]
    sizes: tuple[float, ...]
    amounts: tuple[float, ...]
    beyond_delay: float  # size of all that is hidden together, with the shift between torque and motion free as well
    exact: Array  # (n, N) rad, the motors' angles of the held-out recording before the encoder
    disturbed: Array  # (n, N) N m, what the held-out torque holds beside physics: noise, less the push from outside
    rows: Rows  # of the plant before anything was hidden in it
    plant: Rows  # with what is hidden in it
    arm: dict[str, float]  # of the plant
    parameters: Parameters | None  # what a fit must find, where the model's own parameters can take all of it
    bodies: Bodies
    knows: bool  # whether true values are known of the parameters that a fit finds
    motors: tuple[drives.Motor, ...] = ()  # of the drives that make the torque, if none is recorded


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


def make(case: Case, amounts: Sequence[float] | None = None) -> Made:
    """The case's recordings; the same case is made the same. Raises RanAwayError.

    amounts   of the hidden effects; without them they are grown to the case's size, if it has one
    """
    form = case.setting.drive
    if amounts is None and case.size and case.setting.excitation == FIRST:
        # As much of the effect as is of this size on today's excitation.
        amounts = make(replace(case, setting=_ordinary(case.setting))).amounts
    made, runs = _simulated(replace(case, setting=replace(case.setting, drive="")), amounts and tuple(amounts))
    if not form:
        return made
    motors = drives.motors(runs[0][0])
    recording, held_out = (drives.recording(bench, run, motors, form) for bench, run in runs)
    text = drives.stated(made.model, form, motors)
    return replace(made, case=case, model=text, recording=recording, held_out=held_out, motors=motors)


@functools.lru_cache(maxsize=1)
def _simulated(case: Case, amounts: tuple[float, ...] | None) -> tuple[Made, tuple[tuple[Bench, Run], ...]]:
    """The case's recordings of torque, and the two runs; all forms of drives share them."""
    setting, world = case.setting, world_of(case.setting)
    bodies = world.arms(setting.joints)
    (plant_rng, motion_rng, other_rng), wanted, hidden, joints = _drawn(case)
    believed = next((h.believed for h in hidden if h.believed != BELIEVED), BELIEVED)
    warms = any(h.warms for h in hidden)
    rows = world.specimen(bodies, believed, plant_rng)
    text = world.model_text(setting, case.seed, believed, _known_gravity(setting, hidden))
    main = world.bench(setting, _moved(setting, text, wanted, 0), motion_rng, warms, rows)
    found = []
    for k, (what, joint) in enumerate(zip(hidden, joints, strict=True)):
        if amounts is not None:
            found.append((amounts[k], _size(main, what, joint, amounts[k], believed)))
        else:
            found.append(_sized(main, what, joint, case.size, believed) if case.size else (what.amount, 0.0))
    inside_it = [(what, joint, amount) for what, joint, (amount, _) in zip(hidden, joints, found, strict=True)]
    elsewhere = _moved(setting, text, _wanted(other_rng, setting), 1)
    elsewhere = elsewhere[..., : round(world.held_out * elsewhere.shape[-1])]
    other = world.bench(setting, elsewhere, other_rng, warms, rows)
    together, apart = main.run(inside_it), other.run(inside_it)
    known = _known_gravity(setting, hidden)
    left = orthogonal(together, bodies, believed, main.background, known, True, setting.band) / main.floor()
    plant, arm = main.plant(inside_it)
    held_out = other.recording(apart)
    made = Made(
        case,
        known,
        text,
        main.recording(together),
        held_out,
        tuple(hidden),
        places(case),
        tuple(size for _, size in found),
        tuple(amount for amount, _ in found),
        float(np.max(left)),
        other.exact(apart, held_out),
        other.disturbed(apart, held_out),
        rows,
        plant,
        arm,
        true_parameters(plant, arm, bodies, believed) if case.kind == "inside" and world.knows else None,
        bodies,
        world.knows,
    )
    return made, ((main, together), (other, apart))


def _known_gravity(setting: Setting, hidden: Sequence[Hidden]) -> tuple[float, ...]:
    """m/s^2, as the model file has it."""
    return (0.0, 0.0) if any(what.left_out for what in hidden) else setting.gravity


def places(case: Case) -> tuple[int | None, ...]:
    """Joints (1-based) of a case's effects, None for one of the arm."""
    _, _, hidden, joints = _drawn(case)
    return tuple(None if what.of_arm else joint + 1 for what, joint in zip(hidden, joints, strict=True))


def _drawn(case: Case) -> tuple[list[np.random.Generator], Array, list[Hidden], list[int]]:
    """What chance decides first: generators for the rest, the wanted motion, the effects and their joints (0-based)."""
    rng = np.random.default_rng([case.seed, case.setting.joints, *map(ord, case.label)])
    world = world_of(case.setting)
    bodies = world.arms(case.setting.joints)
    *others, shape_rng = rng.spawn(4)
    joints = [_place(world.entries[name], len(bodies), shape_rng) for name in case.names]
    wanted = _wanted(others[1], case.setting)
    step = PERIOD * case.setting.logger.every
    setups = [Setup(bodies, joint, wanted, shape_rng, case.setting.gear_ratio, step) for joint in joints]
    return others, wanted, [world.entries[name].draw(s) for name, s in zip(case.names, setups, strict=True)], joints


def _ordinary(setting: Setting) -> Setting:
    """As today's excitation would record it, where it is a first motion that does."""
    kind = setting.excitation
    return replace(setting, excitation=motion.ORDINARY[setting.simulator] if kind == FIRST else kind)


def _moved(setting: Setting, text: str, wanted: Array, number: int) -> Array:
    """The motion itself: the one that is wanted, or in its place a first motion for the model file, the same whatever
    is hidden."""
    if setting.excitation != FIRST:
        return wanted
    typical = _wanted(np.random.default_rng(setting.joints), setting)
    return motion.along(first_motion(text, typical, number))


def _wanted(rng: np.random.Generator, setting: Setting) -> Array:
    """The motion (3, n, N), of an arm in space about its home and gentler, as long links need."""
    found = motion.desired(rng, setting.joints, _ordinary(setting).excitation)
    return motion.gentle(found[0], np.array(HOME[setting.joints])) if setting.joints in HOME else found


def _sized(main: Bench, what: Hidden, joint: int, size: float, believed: Sequence[str]) -> tuple[float, float]:
    """Amount of one effect at a joint (0-based), and its size, as near to the wanted one as can be."""
    return _grown(lambda amount: _size(main, what, joint, amount, believed), what, size)


def _size(main: Bench, what: Hidden, joint: int, amount: float, believed: Sequence[str]) -> float:
    part = main.part(what)
    known, run = _known_gravity(main.setting, [what]), part.run([(what, joint, amount)])
    left = orthogonal(run, main.bodies, believed, part.background, known, band=main.setting.band)
    relative = left / main.floor()
    return float(np.max(relative) if what.of_arm else relative[joint])


def _place(entry: Entry, n: int, rng: np.random.Generator) -> int:
    """The joint (0-based) of a hidden effect."""
    last = n - 1 if entry.not_last else n
    return int(rng.integers(0, last))


CLEAN: dict[str, tuple[Setting, tuple[str, ...]]] = {
    "clean": (Setting(), ("clean",)),
    "clean_coloured": (Setting(noise="coloured"), ("clean",)),
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
    **{f"clean_{name}": (setting, ("clean",)) for name, setting in SITUATIONS.items() if name != "plain"},
}

KINDS = ("clean", "limits", "inside", "single", "forms", "unknown", "pairs")
PAIR_NAMES = tuple(f"{a}+{b}" for a, b in PAIRS)
_LIMIT = "limit_"


def cases(
    wanted: Sequence[str], joints: Sequence[int], sizes: Sequence[float], seeds: Sequence[int], setting: Setting
) -> Iterator[Case]:
    """Cases by class (KINDS) or by name, for arms of these numbers of joints. ValueError for an unknown name."""
    world = world_of(setting)
    for n in joints:
        arm = world.arms(n)
        base = replace(setting, joints=n, gravity=DOWN if in_space(arm) else setting.gravity)
        for word in wanted:
            names = _named(word, arm, world)
            for seed in seeds:
                for name in names:
                    yield from _of(name, base, sizes, seed, world)


def _named(word: str, arm: Bodies, world: World) -> list[str]:
    entries = world.entries
    if word == "clean":
        return list(CLEAN)
    if word == "limits":
        return [_LIMIT + name for name in AMOUNTS if ENTRIES[name].least_joints <= len(arm)]
    if word == "pairs":
        pairs = ["+".join(pair) for pair in world.pairs]
        return [x for x in pairs if all(entries[part].fits(arm) for part in x.split("+"))]
    if word in KINDS:
        return [k for k, e in entries.items() if e.kind == word and e.fits(arm)]
    if word in CLEAN or word.removeprefix(_LIMIT) in AMOUNTS or all(part in entries for part in word.split("+")):
        return [word]
    raise ValueError(f"unknown case {word}; expected one of {', '.join((*KINDS, *CLEAN, *entries))}")


def _of(name: str, base: Setting, sizes: Sequence[float], seed: int, world: World) -> Iterator[Case]:
    if name in CLEAN:
        setting, expected = CLEAN[name]
        excitation = base.excitation if setting.excitation == "full" else setting.excitation
        gravity = base.gravity if in_space(world.arms(base.joints)) else setting.gravity
        kept = {"joints": base.joints, "excitation": excitation, "gravity": gravity, "simulator": base.simulator}
        setting = replace(setting, **kept)
        yield Case(name, "clean", (), setting, 0.0, seed, expected)
        return
    if name.startswith(_LIMIT):
        yield Case(name, "limits", (name.removeprefix(_LIMIT),), base, 0.0, seed)
        return
    parts = tuple(name.split("+"))
    kind = "pairs" if len(parts) > 1 else world.entries[name].kind
    for part in parts:
        base = replace(base, **world.entries[part].needs)
    if kind == "inside":
        yield Case(name, kind, parts, base, 0.0, seed)
        return
    for size in sizes:
        setting = base
        if "thermal" in name and seed % 2:  # every other one without a thermometer
            setting = replace(base, temperature=False)
        yield Case(name, kind, parts, setting, size, seed, ("unexplained",))
