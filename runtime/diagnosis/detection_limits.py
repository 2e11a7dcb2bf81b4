"""Detection limits: how large an effect would have had to be for these recordings to show it.

Each effect's own torque along the recorded motion is put into the measured torque, and the gates through which
every candidate must pass decide. The smallest amount that opens them all, and a margin for noise of another draw,
is the limit. It holds for the shape that is stated with it. What is approximated: an effect would also have changed
the motion a little, and that is left out; a long recording is represented by the excerpt on which shapes are
searched, which shows less than the whole does, so that its limits are cautious; rivals of the effect are not asked,
so that beyond its limit an effect is seen, by its name or by that of another that does the same along this motion.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from msgspec import UNSET

from runtime.arrays import Array
from runtime.diagnosis.candidates import FittedBase
from runtime.diagnosis.gates import TORQUE, failed
from runtime.diagnosis.ranking import Weighing, Whitened, results
from runtime.diagnosis.score import Evidence
from runtime.diagnosis.settings import LIMIT_OF_ITS_OWN, LIMIT_SIGMAS
from runtime.documents.diagnosis import LimitEntry
from runtime.identification import grids
from runtime.model.catalogue import EffectInfo
from runtime.model.terms import Term, Values, joints_of, unit_of
from runtime.progress import is_late, of_each
from runtime.regression.rows import Block, Columns

_OF_A_SPRING = ("stiffness", "damping")


@dataclass(frozen=True)
class Limit:
    """A parameter above (or below) which the effect would have been seen, its other parameters as assumed.

    joint   (0-based) at which it acts first      rms   of its torque there at the limit, N m (N)
    """

    term: Term
    parameter: str
    side: Literal["above", "below"]
    value: float
    unit: str
    joint: int
    rms: float
    assumed: Values = field(default_factory=dict)

    def document(self) -> LimitEntry:
        """An entry of would_have_seen in `tendon diagnose --json`."""
        return LimitEntry(
            effect=self.term.effect,
            joint=self.term.joint,
            parameter=self.parameter,
            above=self.value if self.side == "above" else UNSET,
            below=self.value if self.side == "below" else UNSET,
            unit=self.unit,
            assumed=dict(self.assumed),
        )


def of(base: FittedBase, floors: Sequence[float], joints: Sequence[int]) -> tuple[list[Limit], int]:
    """Limits of every candidate that acts first on one of these joints (0-based), where the recordings have any, and
    the number of candidates for which no time was left.

    floors   (n,) every joint's noise floor
    """
    beside = Whitened(base, base.excerpt[1], floors, None)
    own = [term for term in base.terms() if joints_of(base.model, term)[0] in joints]
    found = of_each("detection limits", lambda term: (is_late(), None if is_late() else _limit(beside, term)), own)
    limits = [limit for _, limit in found if limit is not None and np.isfinite(limit.value)]
    return limits, sum(late for late, _ in found)


def _limit(beside: Whitened, term: Term) -> Limit | None:
    shapes = beside.base.anywhere(term)
    if not shapes:
        return None
    shape = _typical(shapes)
    typical = beside.base.trial(term, shape)
    neutral = _neutral(typical) if typical.finite else None
    if neutral is not None:
        return _of_amount(beside, term, shape, choices=len(shapes), neutral=neutral)
    return _of_shape(beside, term, shapes) if shape else None


def _neutral(block: Block) -> Array | None:
    """(k,) coefficients with which a block has no torque: 0 for most, 1 for a scale; None if it always has one."""
    columns = np.concatenate([part.rows for part in block.columns.values()], axis=1)
    if not columns[0].any():
        return np.zeros(len(columns) - 1)
    found = np.linalg.lstsq(columns[1:].T, -columns[0], rcond=None)[0]
    return found if np.allclose(found @ columns[1:], -columns[0], atol=1e-9 * np.abs(columns[0]).max()) else None


def _typical(shapes: Sequence[Values]) -> Values:
    """The choice in the middle of all, by rank of each parameter."""
    ranks = np.array([np.unique([s[name] for s in shapes], return_inverse=True)[1] for name in shapes[0]], dtype=float)
    if not len(ranks):
        return shapes[0]
    spread = np.maximum(np.ptp(ranks, axis=1, keepdims=True), 1.0)
    away = np.sum(((ranks - ranks.mean(axis=1, keepdims=True)) / spread) ** 2, axis=0)
    return shapes[int(np.argmin(away))]


def _seen(weighing: Weighing, added: Array, dispersion: tuple[float, float], edge: float = np.inf) -> bool:
    found = weighing.solutions(added)
    evidence = Evidence(found.gain, *dispersion, weighing.price())
    return not failed(results(evidence, found.eff, weighing.floor, edge))


def _of_amount(beside: Whitened, term: Term, shape: Values, choices: int, neutral: Array) -> Limit | None:
    """By the first of the effect's coefficients, the others as without it."""
    base, library = beside.base, beside.base.model.library
    block = base.samples(term, [shape]).choice(0)
    if not block.finite:
        return None
    weighing = Weighing(beside, term, len(shape) if choices > 1 else 0, block, choices)
    one = np.zeros(1 + len(weighing.block.lower))
    one[1] = 1.0
    own = weighing.own(one)
    if own == 0.0 or failed(weighing.of_torque(one)):
        return None
    start = 0.5 * TORQUE.limit * weighing.floor / own  # half of the least torque that passes
    # What the noise holds of the torque by chance may only make it harder to see.
    held, spread = weighing.held(one)
    if not np.isfinite(held + spread):
        return None
    if weighing.block.lower[0] < 0 < held:
        one, held = -one, -held
    dispersion = weighing.dispersion(one)
    least = _least(lambda amount: _seen(weighing, (amount - max(held, 0.0)) * one, dispersion), start)
    if least is None:
        return None
    amount = least + LIMIT_SIGMAS * spread
    values = library.recover(term.effect, neutral + amount * np.abs(one[1:]), shape)
    name = library.effects[term.effect].linear[0].name
    rest = {k: v for k, v in values.items() if k != name and np.isfinite(v)}
    joint, unit = joints_of(base.model, term)[0], unit_of(base.model, term, name)
    rms = _rms(amount * (one @ block.columns[joint].rows))
    return Limit(term, name, "above", value=values[name], unit=unit, joint=joint, rms=rms, assumed=rest)


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _least(seen: Callable[[float], bool], start: float) -> float | None:
    """The smallest amount that is seen, as finely as users tell limits apart; None if none is seen up to a thousand
    times the start."""
    ladder = [float(start * 2.0**k) for k in range(11)]
    place = bisect_left(ladder, True, key=seen)
    if place == len(ladder):
        return None
    return _between(lambda found: seen(found[""]), {"": 0.5 * ladder[place]}, {"": ladder[place]}, "")[""]


def _of_shape(beside: Whitened, term: Term, shapes: Sequence[Values]) -> Limit | None:
    """For an effect whose torque grows or vanishes with its first shape parameter: by that parameter."""
    base = beside.base
    name, freed = next(iter(shapes[0])), _freed(base, term)
    by_value = {v: _typical([s for s in shapes if s[name] == v]) for v in sorted({s[name] for s in shapes})}
    sizes = freed * _sizes(beside, term, list(by_value.values()))
    finite = np.flatnonzero(np.isfinite(sizes))
    if len(finite) < 2:
        return None
    rising = bool(sizes[finite[-1]] > sizes[finite[0]])
    weakest_first = list(zip(by_value.values(), sizes, strict=True))
    weakest_first = weakest_first if rising else weakest_first[::-1]
    least = TORQUE.limit * beside.floors[joints_of(base.model, term)[0]]

    def seen(shape: Values, block: Block) -> bool:
        if not block.finite:
            return False
        weighing = Weighing(beside, term, len(shape), block, len(shapes))
        whole = np.zeros(1 + len(weighing.block.lower))
        whole[0] = 1.0
        if failed(weighing.of_torque(whole)):
            return False
        held, spread = weighing.held(whole)
        whole[0] -= max(held, 0.0) + LIMIT_SIGMAS * spread
        if not np.isfinite(whole[0]):
            return False
        return _seen(weighing, whole, weighing.dispersion(whole), grids.edge_distance(base.excerpt[0], term, shape))

    strong = [k for k, (_, size) in enumerate(weakest_first) if size > least]
    if not strong:
        return None
    blocks = _along_its_own_motion(base, term, [weakest_first[k][0] for k in strong], freed)
    place = bisect_left(range(len(strong)), True, key=lambda k: seen(weakest_first[strong[k]][0], blocks.choice(k)))
    if place == len(strong):
        return None
    first = strong[place]
    shape = weakest_first[first][0]
    if first > 0:

        def seen_between(shape: Values) -> bool:
            return seen(shape, _along_its_own_motion(base, term, [shape], freed).choice(0))

        shape = _between(seen_between, weakest_first[first - 1][0], shape, name)
    if len(shape) > 1 and freed * _sizes(beside, term, [shape])[0] < LIMIT_OF_ITS_OWN * np.nanmin(sizes):
        return None
    shape = _softened(base.model.library.effects[term.effect], shape, freed)
    rest = {k: v for k, v in shape.items() if k != name}
    side: Literal["above", "below"] = "above" if rising else "below"
    joint, unit = joints_of(base.model, term)[0], unit_of(base.model, term, name)
    rms = _rms(base.unread(term, [shape]).choice(0).columns[joint].rows[0])
    return Limit(term, name, side, value=shape[name], unit=unit, joint=joint, rms=rms, assumed=rest)


def _freed(base: FittedBase, term: Term) -> float:
    """By how much stiffer a transmission has to be for the torque along the recorded motion to be, times the same
    factor, that along the motion which the motor would have made with it.

    A link on a spring shakes its motor, too: seen from the torque, motor and link resonate against each other, at
    (J/J_m)^½ times the frequency of the link alone behind a motor that is held. With r the square of a frequency
    over that of the link alone, the torque J_l r/(1 − r J_m/J) along the motion of the rigid joint.
    """
    if not base.model.library.effects[term.effect].gives_way:
        return 1.0
    own = joints_of(base.model, term)[0]
    signals = base.excerpt[0].signals(own)
    link = float(np.median(np.concatenate([np.atleast_1d(s.link_inertia(own)) for s in signals])))
    rotor = base.model.joints[own].rotor_inertia
    if rotor is None:
        rotor = float(np.median(np.concatenate([s.arm("inertia")[own, own] - s.link_inertia(own) for s in signals])))
    return (rotor + link) / rotor if rotor > 0 < link else 1.0


def _softened(info: EffectInfo, shape: Values, freed: float) -> Values:
    return {k: v / freed if info.parameter(k).kind in _OF_A_SPRING else v for k, v in shape.items()}


def _along_its_own_motion(base: FittedBase, term: Term, shapes: Sequence[Values], freed: float) -> Block:
    """What the softened effect does along the motion with it; the encoders' noise is that of its own columns."""
    if freed == 1.0:
        return base.samples(term, shapes)
    info, blocks = base.model.library.effects[term.effect], base.unread(term, shapes)
    noisy = base.samples(term, [_softened(info, shape, freed) for shape in shapes]).columns
    parts = {i: Columns(freed * part.rows, noisy[i].noise) for i, part in blocks.columns.items()}
    return replace(blocks, columns=parts)


def _between(seen: Callable[[Values], bool], unseen: Values, shape: Values, name: str) -> Values:
    while max(shape[name], unseen[name]) > 1.2 * min(shape[name], unseen[name]):
        middle = {k: float(np.sqrt(shape[k] * unseen[k])) for k in shape}
        shape, unseen = (middle, unseen) if seen(middle) else (shape, middle)
    return shape


def _sizes(beside: Whitened, term: Term, shapes: Sequence[Values]) -> Array:
    """(S,) RMS at its own joint of what the base cannot take over of an effect's torque without free coefficients, at
    each of some shapes; NaN where that is no number."""
    base, system = beside.base, beside.system
    own = joints_of(base.model, term)[0]
    blocks = base.unread(term, shapes)
    found, finite = np.full(len(shapes), np.nan), blocks.finite
    parts = {i: part.rows[finite, 0] for i, part in blocks.columns.items()}
    kept, _ = base.without(system, base.replaced(term)).own(parts)
    found[finite] = base.rms(own) * np.sqrt(kept / max(1, system.joints[own].count))
    return found
