"""The judging set: its seeds, sizes and situations, in one place. Nobody tunes on these.

Development runs cases at sizes of its choice with seeds below FIRST_JUDGING_SEED; the judging set has seeds from there
on, and sizes and situations drawn for each case. `judging` is the whole of it, in rounds that have every case of every
class once; `short` is a choice of some 400 that fits into an hour of one processor, half of them clean recordings of a
brief motion, which tell a false name in a hundred. Both mix their classes evenly: what ends early has judged a share
of each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .bodies import ARMS, in_space
from .cases import CLEAN, KINDS, PAIR_NAMES, Case, Setting, cases
from .hidden import ENTRIES
from .recorder import Logger
from .situations import SITUATIONS

FIRST_JUDGING_SEED = 5000
FIRST_SHORT_SEED = 20_000
"""Of the short set. One from 10,000 on was looked at case by case while gates were chosen: it is development's."""
JOINTS = (1, 2, 4)
Sizes = Mapping[str, Callable[[np.random.Generator], float]]
Situations = Callable[[Case, np.random.Generator], Setting]
SIZES: Sizes = {
    "below": lambda rng: rng.uniform(0.03, 0.13),
    "small": lambda rng: rng.uniform(0.3, 0.45),
    "large": lambda rng: 0.5 * 4.0 ** rng.uniform(),
}
"""In units of the noise floor: too small to be named, hard to name, and to be named nearly always."""
PLAIN = 0.5
"""The part of the cases that are recorded plainly; the others are in a situation that is drawn."""
FASTER = 2
"""Periods of the drives a step, at most, where lines are hidden that slower ones would fold back."""
GEARED = ("ripple_direct", "ripple_lines", "ripple_geared")


def judging(
    kinds: Sequence[str] = KINDS, joints: Sequence[int] = JOINTS, rounds: int = 5, excitation: str = "full"
) -> Iterator[Case]:
    """The judging set, round by round: single effects at the three sizes, everything else at a large one."""
    for seed in range(FIRST_JUDGING_SEED, FIRST_JUDGING_SEED + rounds):
        rng = np.random.default_rng([seed, *map(ord, "judging")])
        groups: dict[tuple[str, int, str], list[Case]] = {}
        for case in cases(kinds, joints, [1.0], [seed], Setting(excitation=excitation)):
            for size, sized in _sized(replace(case, setting=_situation(case, rng)), rng):
                groups.setdefault((case.kind, case.setting.joints, size), []).append(sized)
        yield from _mixed(groups.values(), rng)


@dataclass(frozen=True)
class Share:
    """number cases of one class, by drawing from its names. excitation: of the motion, where it is not the full one."""

    names: tuple[str, ...]
    joints: int
    number: int
    size: str = "large"
    excitation: str = "full"


def _of_kind(kind: str, joints: int) -> tuple[str, ...]:
    return tuple(name for name, e in ENTRIES.items() if e.kind == kind and e.least_joints <= joints)


SHORT = (
    Share(tuple(CLEAN), 1, 145, excitation="brief"),
    Share(tuple(CLEAN), 2, 40, excitation="brief"),
    Share(tuple(CLEAN), 4, 15, excitation="brief"),
    Share(_of_kind("single", 1), 1, 45),
    Share(_of_kind("single", 1), 1, 8, "small"),
    Share(_of_kind("single", 1), 1, 4, "below"),
    Share(_of_kind("single", 2), 2, 25),
    Share(_of_kind("single", 4), 4, 12, excitation="brief"),
    Share(GEARED, 1, 8),
    Share(("coupled_gear",), 2, 4),
    Share(("gravity_left_out+load_friction",), 1, 6),
    Share(("gravity_left_out+load_friction",), 2, 2),
    Share(_of_kind("forms", 1), 1, 20),
    Share(("lugre_maxwell",), 1, 4),
    Share(("cable_pack", "cable_hose", "cable_sine"), 1, 6),
    Share(("elasticity", "backlash"), 1, 6),
    Share(PAIR_NAMES, 1, 14),
    Share(PAIR_NAMES, 2, 4),
    Share(_of_kind("unknown", 1), 1, 6),
    Share(_of_kind("inside", 1), 1, 4),
    Share(("limits",), 1, 4),
)


def short() -> Iterator[Case]:
    """The short judging set; its seeds are above those of the whole one."""
    rng = np.random.default_rng([FIRST_SHORT_SEED, *map(ord, "short")])
    yield from drawn(SHORT, FIRST_SHORT_SEED, rng, Setting(), _situation, SIZES)


FIRST_DRIVEN_SEED = 700
RATES = (2, 4, 5)
"""Periods of the drives a step, of recordings without torque: 500 to 200 Hz."""
LATE = ("delay_of_samples", "torque_delay")
"""What the controller of an arm of four joints does not bear at these rates."""
UNTOLD = ("torque_scale", *GEARED)
"""What no drive of unknown gains shows, and lines that slow loggers fold back."""
DRIVEN = {
    "": (
        Share(tuple(x for x in _of_kind("single", 1) if x not in UNTOLD), 1, 20),
        Share(tuple(x for x in _of_kind("single", 4) if x not in (*UNTOLD, *LATE)), 4, 10, excitation="brief"),
        Share(("clean",), 1, 6),
        Share(("clean",), 4, 4, excitation="brief"),
    ),
    "mujoco": (
        Share(
            ("stribeck", "linear_spring", "friction_patch", "load_friction_upright", "stop_tendon"),
            1,
            5,
            "large",
            "fourier",
        ),
        Share(("stribeck", "linear_spring", "coupled_friction", "torque_ripple"), 4, 4, "large", "fourier"),
        Share(("clean",), 1, 1, "large", "fourier"),
        Share(("clean",), 4, 1, "large", "fourier"),
    ),
}
"""By simulator, cases to be recorded with and without torque."""


def driven(simulator: str) -> list[Case]:
    """A development set for recordings without torque, all with one."""
    rng = np.random.default_rng([FIRST_DRIVEN_SEED, *map(ord, "driven" + simulator)])
    return drawn(DRIVEN[simulator], FIRST_DRIVEN_SEED, rng, Setting(simulator=simulator), _slow, SIZES)


def _slow(case: Case, rng: np.random.Generator) -> Setting:
    """The case's setting, plain, at a rate that is drawn."""
    return replace(case.setting, coarse=1.0, noise="white", logger=Logger(every=int(rng.choice(RATES))))


def drawn(
    shares: Sequence[Share], first: int, rng: np.random.Generator, base: Setting, situation: Situations, sizes: Sizes
) -> list[Case]:
    """A set of cases, mixed; their seeds count up from the first."""
    groups, seed = [], first
    for share in shares:
        group: list[Case] = []
        names = _cycled(share.names, share.number, rng)
        for name in names:
            of_share = replace(base, excitation=share.excitation)
            found = [c for c in cases([name], [share.joints], [1.0], [seed], of_share) if name in (c.label, c.kind)]
            case = found[int(rng.integers(len(found)))]
            sized = dict(_sized(replace(case, setting=situation(case, rng)), rng, sizes))
            group.append(sized.get(share.size, sized["large"]))
            seed += 1
        groups.append(group)
    return _mixed(groups, rng)


def _situation(case: Case, rng: np.random.Generator) -> Setting:
    """The case's setting in a situation that is drawn, with what its entries need; a clean case has its own."""
    if case.kind == "clean":
        return case.setting
    needs = {k: v for part in case.names for k, v in ENTRIES[part].needs.items()}
    slowest = FASTER if "gear_ratio" in needs else np.inf
    names = [name for name, s in SITUATIONS.items() if name != "plain" and s.logger.every <= slowest]
    name = "plain" if rng.random() < PLAIN else str(rng.choice(names))
    # An arm in space has its gravity always.
    of_case = ("joints", "temperature", "excitation", *(["gravity"] if in_space(ARMS[case.setting.joints]) else []))
    kept = {k: getattr(case.setting, k) for k in of_case}
    return replace(SITUATIONS[name], **{**needs, **kept})


def _sized(case: Case, rng: np.random.Generator, of_single: Sizes = SIZES) -> Iterator[tuple[str, Case]]:
    """The case at the sizes at which its class is judged, by their names."""
    if case.size == 0.0:
        yield "large", case
        return
    sizes = of_single if case.kind == "single" else {"large": SIZES["large"]}
    for name, draw in sizes.items():
        yield name, replace(case, size=round(float(draw(rng)), 3))


def _cycled(names: Sequence[str], number: int, rng: np.random.Generator) -> list[str]:
    """So many names at random, none a second time before all were drawn once."""
    out: list[str] = []
    while len(out) < number:
        out += [names[k] for k in rng.permutation(len(names))]
    return out[:number]


def _mixed(groups: Iterable[Sequence[Case]], rng: np.random.Generator) -> list[Case]:
    """All cases, each group in random order and spread evenly over the whole."""
    placed: list[tuple[float, Case]] = []
    for group in groups:
        start = 0.5 * rng.random()  # the first of a small group comes early
        placed += [((k + start) / len(group), group[int(at)]) for k, at in enumerate(rng.permutation(len(group)))]
    return [case for _, case in sorted(placed, key=lambda x: x[0])]
