"""The judging set: its seeds and sizes, in one place. Nobody tunes on these.

Development runs cases at sizes of its choice with seeds below FIRST_JUDGING_SEED; the judging set has seeds from there
on, and sizes drawn for each case. A round has every case of every class once; what ends early ends between rounds of
cases that are in random order, so that a table of a part is a fair sample.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from .cases import KINDS, Case, Setting, cases

FIRST_JUDGING_SEED = 5000
JOINTS = (1, 2, 4)
SIZES = {
    "below": lambda rng: rng.uniform(0.03, 0.13),
    "small": lambda rng: rng.uniform(0.3, 0.45),
    "large": lambda rng: 0.5 * 4.0 ** rng.uniform(),
}
"""In units of the noise floor: too small to be named, hard to name, and to be named nearly always."""


def judging(kinds: Sequence[str] = KINDS, joints: Sequence[int] = JOINTS, rounds: int = 5) -> Iterator[Case]:
    """The judging set, round by round: single effects at the three sizes, everything else at a large one."""
    for seed in range(FIRST_JUDGING_SEED, FIRST_JUDGING_SEED + rounds):
        rng = np.random.default_rng([seed, *map(ord, "judging")])
        drawn = []
        for case in cases(kinds, joints, [1.0], [seed], Setting()):
            if case.size == 0.0:
                drawn.append(case)
                continue
            sizes = SIZES if case.kind == "single" else {"large": SIZES["large"]}
            drawn += [replace(case, size=round(float(draw(rng)), 3)) for draw in sizes.values()]
        yield from (drawn[k] for k in rng.permutation(len(drawn)))
