"""Which pieces of motion, one after another, separate rival effects best in the shortest time within the limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from math import ceil

import numpy as np

from runtime.arrays import Array
from runtime.experiments.pieces import BROAD, Envelope, MotionPiece, in_sequence, pieces
from runtime.experiments.separation import MotionPieces, Pair, Separation, TrialArm, ordinary
from runtime.experiments.settings import (
    LEAST_SECONDS,
    LEAST_TIMES,
    MEMORY_TORQUE,
    MOST_PIECES,
    NEAR_BEST,
    ORDINARY_PIECE_SECONDS,
    PAUSE,
    SLOWER,
    SLOWINGS,
    SMALLER,
    SURE,
    VISIBLE,
)
from runtime.model.terms import joints_of
from runtime.progress import each, of_each
from runtime.simulation.settings import MARGIN, RATE
from runtime.simulation.simulate import SimulationError, along


@dataclass(frozen=True)
class Freedom:
    """By which factors limits are widened, to learn which of them stands in the way."""

    name: str = "the limits"
    range: float = 1.0
    speed: float = 1.0
    torque: float = 1.0
    noise: float = 1.0


WIDER = (
    Freedom("twice the range", range=2.0),
    Freedom("twice the speed and torque", speed=2.0, torque=2.0),
    Freedom("twice the torque", torque=2.0),
    Freedom("a quarter of the noise", noise=0.25),
)


@dataclass(frozen=True)
class PieceChoice:
    """Pieces by number, how often they are gone through, and what that separates."""

    numbers: tuple[int, ...]
    times: int
    seconds: float
    separations: dict[Pair, Separation]

    @property
    def rms(self) -> float:
        """The smallest separation in noise floors, nothing if a rival is not visible at all."""
        return self._least("rms") if self.visible else 0.0

    @property
    def strength(self) -> float:
        """Of the pair that is least apart, in standard deviations."""
        return self._least("strength")

    @property
    def visible(self) -> bool:
        """Whether the model as it is leaves enough of every rival's torque to be seen."""
        return min(s.rms for (_, other), s in self.separations.items() if other is None) > VISIBLE

    @property
    def enough(self) -> bool:
        """Whether all pairs are surely apart."""
        return self.visible and self.strength > SURE

    def _least(self, figure: str) -> float:
        against = [s for (_, other), s in self.separations.items() if other is not None]
        return float(min(getattr(s, figure) for s in against or self.separations.values()))


@dataclass(frozen=True)
class Repertoire:
    """Pieces that keep to the limits, and the ground on which they were judged together, `passes` times over."""

    envelopes: tuple[Envelope, ...]
    names: tuple[str, ...]
    parts: tuple[Array, ...]
    ground: MotionPieces
    passes: int

    @classmethod
    def of(cls, bench: TrialArm, limit: TorqueLimit, freedom: Freedom) -> Repertoire:
        """Raises SimulationError if nothing keeps to the limits."""
        joints = tuple(Envelope.of(joint, freedom.range, freedom.speed) for joint in bench.model.joints)
        found = _within(bench, joints, limit, freedom.torque)
        if not found:
            raise SimulationError(
                f"{bench.model.name}: no motion keeps to the torque limits; its friction and weight alone exceed them"
            )
        names, parts = tuple(found), tuple(found.values())
        passes = 2 if _changes_with_time(bench) else 1
        path, spans = in_sequence([*parts] * passes, joints)
        return cls(joints, names, parts, MotionPieces.of(bench, path, spans), passes)

    def choice(self, numbers: tuple[int, ...]) -> PieceChoice:
        """These pieces, so many times through that repeats and length suffice for a diagnosis."""
        once = sum(self.parts[k].shape[1] / RATE + PAUSE for k in numbers)
        times = max(LEAST_TIMES, ceil(LEAST_SECONDS / once))
        chosen = [k + before * len(self.parts) for before in range(self.passes) for k in numbers]
        return PieceChoice(numbers, times, times * once, self.ground.weigh(chosen, times / self.passes))

    def choices(self) -> list[PieceChoice]:
        """All single pieces and pairs, and larger choices that grow from the best; the base model is fitted on the
        same motion, so each holds a piece that allows it."""
        count = range(len(self.parts))
        broad = {k for k in count if self.names[k] in BROAD} or set(count)
        chosen = [c for size in (1, 2) for c in combinations(count, size) if not broad.isdisjoint(c)]
        found = [self.choice(numbers) for numbers in each("choices of pieces", chosen)]
        for key in ("rms", "strength"):
            best = max(found, key=lambda c: (getattr(c, key), -c.seconds))
            while len(best.numbers) < min(MOST_PIECES, len(self.parts)):
                grown = [self.choice(tuple(sorted((*best.numbers, k)))) for k in count if k not in best.numbers]
                best = max(grown, key=lambda c: getattr(c, key))
                found.append(best)
        return found

    def motion(self, choice: PieceChoice) -> Array:
        """(n, N) rad or m, at 1 kHz."""
        return in_sequence([self.parts[k] for k in choice.numbers] * choice.times, self.envelopes)[0]


def _changes_with_time(bench: TrialArm) -> bool:
    acting = {term.effect for term in bench.base} | {rival.term.effect for rival in bench.rivals}
    return any("time" in bench.model.library.needs[effect] for effect in acting)


def _subject(bench: TrialArm) -> list[int]:
    """Joints (0-based) in question: those of the rivals, all for an effect of the arm."""
    found: set[int] = set()
    for rival in bench.rivals:
        own = rival.term.joint
        found |= set(joints_of(bench.model, rival.term)) if own is None else {own - 1}
    return sorted(found)


def _ordinary(bench: TrialArm) -> Array:
    """The ordinary excitation as a piece: displacements from the middle (n, N)."""
    path = ordinary(bench.model, np.random.default_rng(0), ORDINARY_PIECE_SECONDS, 1, bench.moving)
    return path - np.array([[Envelope.of(joint).middle] for joint in bench.model.joints])


def peaks(bench: TrialArm, path: Array) -> Array:
    """(1 + rivals, n) largest torques along a motion: of the base model, then with each rival in it."""
    return np.array(list(_peaks(bench, path)))


def _peaks(bench: TrialArm, path: Array) -> Iterator[Array]:
    motion = along(bench.known, path)
    for rival in (None, *bench.rivals):
        yield np.abs(bench.record(motion, rival, None).tau).max(axis=1)


@dataclass(frozen=True)
class TorqueLimit:
    """(1 + rivals, n) largest torques of the base model and with each rival in it.

    Where the file states no limit, the base model may ask for what it does in the ordinary excitation. A rival with
    a memory may ask for twice what it does there, so that it is not driven into resonance; what others ask for
    then follows from the speeds and the range.
    """

    largest: Array

    @classmethod
    def of(cls, bench: TrialArm) -> TorqueLimit:
        """The file's limits less a margin, else the largest torque of the ordinary excitation."""
        largest = peaks(bench, bench.ordinary_path)
        for row, rival in zip(largest[1:], bench.rivals, strict=True):
            row *= MEMORY_TORQUE if bench.model.library.effects[rival.term.effect].states else np.inf
        for i, joint in enumerate(bench.model.joints):
            if joint.torque_limit is not None:
                largest[:, i] = MARGIN * joint.torque_limit
        return cls(largest)

    def allows(self, bench: TrialArm, path: Array, factor: float) -> bool:
        """Whether nothing is in the way of a path (n, N), and it asks for no more than `factor` times these torques."""
        rows = zip(_peaks(bench, path), factor * self.largest, strict=True)
        return bench.free(path) and all(bool(np.all(peak <= most)) for peak, most in rows)


def _within(bench: TrialArm, joints: Sequence[Envelope], limit: TorqueLimit, factor: float) -> dict[str, Array]:
    """Every piece as large and then as fast as the torques allow, without those that they do not allow at all."""
    subject = _subject(bench)
    found: dict[str, Array] = {}
    for part in SMALLER:
        envelopes = [replace(joint, reach=part * joint.reach) for joint in joints]
        every = pieces(envelopes, subject, bench.moving, lambda: _ordinary(bench))
        left = [piece for piece in every if piece.name not in found]
        made = of_each("pieces of motion", partial(_slowed, bench, joints, limit, factor), left)
        found.update((piece.name, path) for piece, path in zip(left, made, strict=True) if path is not None)
    return found


def _slowed(
    bench: TrialArm, joints: Sequence[Envelope], limit: TorqueLimit, factor: float, piece: MotionPiece
) -> Array | None:
    """The piece as fast as the torques allow; None if they do not allow even the slowest."""
    # The slowest comes second: if it asks for too much, those between need not be tried.
    for k in (0, SLOWINGS, *range(1, SLOWINGS)):
        made = piece.make(SLOWER**k)
        allowed = limit.allows(bench, in_sequence([made], joints)[0], factor)
        if k == SLOWINGS:
            slowest = made
            if not allowed:
                return None
        elif allowed:
            return made
    return slowest


def plans(choices: Sequence[PieceChoice]) -> Iterator[PieceChoice]:
    """What to try, in this order: the shortest that comes near the best, the plainest, the best, the surest.

    If none promises to be enough, only the shortest that comes near the surest.
    """
    able = [c for c in choices if c.enough]
    if not able:
        surest = max((c.visible, c.strength) for c in choices)
        near = [c for c in choices if (c.visible, c.strength) >= (surest[0], NEAR_BEST * surest[1])]
        yield min(near, key=lambda c: c.seconds)
        return
    best = max(able, key=lambda c: (c.rms, -c.seconds))
    near = [c for c in able if c.rms >= NEAR_BEST * best.rms]
    plainest = max(able, key=lambda c: (-len(c.numbers), c.rms))
    tried: list[tuple[int, ...]] = []
    for choice in (min(near, key=lambda c: c.seconds), plainest, best, max(able, key=lambda c: c.strength)):
        if choice.numbers not in tried:
            tried.append(choice.numbers)
            yield choice
