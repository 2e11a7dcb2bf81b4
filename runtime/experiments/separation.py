"""How badly each of several rival effects explains another along a motion, before anything is recorded.

The torque of one rival is taken as the truth; what is left of it when the base model and the other rival, at
the best of its shapes, have taken their share is the separation, in units of the noise inside the band. All
that is needed are Gram matrices, one for each piece of a motion: they add, so any choice of pieces can be
judged without looking at the samples again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import permutations

import numpy as np

from runtime.arrays import Array
from runtime.experiments.options import ExperimentSettings
from runtime.experiments.pieces import Envelope
from runtime.experiments.settings import EXACT, ORDINARY_REPEATS, ORDINARY_SECONDS
from runtime.identification import grids
from runtime.identification.identify import prepared
from runtime.identification.problem import Problem
from runtime.identification.regressors import Signals
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Structure, Term, joints_of
from runtime.motion.band import Band
from runtime.motion.motion import Motion, prepare
from runtime.motion.piece import Piece
from runtime.progress import of_each
from runtime.recordings.recording import Recording
from runtime.regression.bounded import bounded, inverse
from runtime.regression.rows import Block, Columns, JointRows
from runtime.regression.system import LinearSystem
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import Hidden, excitation, led, simulate

Pair = tuple[int, int | None]
"""Numbers of the rival that is true and of the one that tries to explain it; None: nothing but the base model."""


def nothing_in_the_way(path: Array) -> bool:  # noqa: ARG001
    """True of every path (n, N)."""
    return True


@dataclass(frozen=True)
class TrialArm:
    """An arm on which experiments are tried: all its parameters known, its instruments as on an ordinary recording.

    model    as the file has it              known   the same with values for all its effects
    base     the values of its effects       rivals  with all their values
    noise    (n,) standard deviation of the recorded torque's noise, N m (N)
    band     as chosen on the ordinary recording       ordinary_path  (n, N) the ordinary excitation
    moving   joints (0-based) that move; the others stay in the middle of their ranges
    free     whether nothing is in the way of a path (n, N) at 1 kHz
    quiet    factor on the floor, to ask what less noise would do
    """

    model: Model
    known: Model
    base: Structure
    rivals: tuple[Hidden, ...]
    noise: Array
    band: Band
    ordinary_path: Array
    moving: tuple[int, ...]
    free: Callable[[Array], bool]
    quiet: float = 1.0

    @classmethod
    def of(
        cls,
        model: Model,
        rivals: Sequence[Hidden],
        settings: ExperimentSettings,
        moving: Sequence[int] | None = None,
        likely: Model | None = None,
        free: Callable[[Array], bool] = nothing_in_the_way,
    ) -> TrialArm:
        """moving, free: as the attributes; None: all. likely: the model with likely numbers for what its file leaves
        out; None: it leaves out nothing. Raises SimulationError."""
        likely = model if likely is None else likely
        part, moving = ORDINARY_SECONDS / ORDINARY_REPEATS, tuple(range(model.n) if moving is None else moving)
        path = ordinary(likely, np.random.default_rng(settings.seed), part, ORDINARY_REPEATS, moving)
        plain, base = simulate(likely, settings=SimulationSettings(noise=0.0), motion=path)
        known = stated(likely, base)
        complete = tuple(
            Hidden(r.term, simulate(known, [r], SimulationSettings(noise=0.0), path)[1][r.term]) for r in rivals
        )
        level = settings.noise * np.sqrt(np.mean(plain.tau**2, axis=1))
        recorded = noisy(plain, level, settings.seed)
        band = prepared(model, [recorded]).band
        return cls(model, known, base, complete, level, band, ordinary_path=path, moving=moving, free=free)

    @cached_property
    def floor(self) -> Array:
        """(n,) RMS inside the band of the torque's noise and of the encoder's as an inertial torque."""
        inertia = np.diagonal(self.known.inertia(np.zeros((self.model.n, 1)))[:, :, 0])
        encoder = inertia**2 * self.band.position_density * (2 * np.pi) ** 4 * self.band.cutoffs**5 / 5
        return self.quiet * np.sqrt(self.band.torque_floor() ** 2 + encoder)

    def record(self, path: Array | Piece, rival: Hidden | None, seed: int | None) -> Recording:
        """A recording of this motion, (n, N) or as `along` has it, with the rival hidden in it; no noise without a
        seed."""
        made, _ = simulate(self.known, [] if rival is None else [rival], SimulationSettings(noise=0.0), path)
        return made if seed is None else noisy(made, self.noise, seed)

    @property
    def pairs(self) -> list[Pair]:
        """Every rival as the truth against every other; a single one against nothing."""
        if len(self.rivals) == 1:
            return [(0, None)]
        return list(permutations(range(len(self.rivals)), 2))


def ordinary(model: Model, rng: np.random.Generator, seconds: float, repeats: int, moving: Sequence[int]) -> Array:
    """`excitation` (n, N) of some joints (0-based), while the others stay in the middle of their ranges."""
    path = excitation(model, rng, seconds, repeats)
    for i in set(range(model.n)).difference(moving):
        path[i] = Envelope.of(model.joints[i]).middle
    return path


def noisy(recording: Recording, level: Array, seed: int) -> Recording:
    """With white noise of standard deviation `level` (n,) on the torque."""
    rng = np.random.default_rng(seed)
    return replace(recording, tau=recording.tau + level[:, None] * rng.standard_normal(recording.tau.shape))


def narrowed(model: Model, ranges: Mapping[int, tuple[float, float]]) -> Model:
    """The same arm as if its file stated these ranges of positions, (low, high) by joint (0-based)."""
    narrowed = copy(model)
    narrowed.joints = tuple(
        replace(joint, limits=replace(joint.limits, position=ranges.get(i, joint.limits.position)))
        for i, joint in enumerate(model.joints)
    )
    return narrowed


def stated(model: Model, values: Structure) -> Model:
    """The same arm as if its file stated these values."""
    known = copy(model)
    known.joints = tuple(
        replace(joint, effects={t.effect: dict(v) for t, v in values.items() if t.joint == number})
        for number, joint in enumerate(model.joints, 1)
    )
    known.effects = {name: dict(values[Term(name)]) for name in model.effects}
    if model.contact is not None:
        effects = {name: dict(values[Term(name)]) for name in model.contact["effects"]}
        known.contact = {**model.contact, "effects": effects}
    return known


@dataclass(frozen=True)
class Separation:
    """rms: what the rival leaves, in noise floors; strength: its norm over all rows, in standard deviations."""

    rms: float
    strength: float


@dataclass(frozen=True)
class MotionPieces:
    """A motion's pieces, ready to be judged in any choice.

    systems  of every joint and piece, weighted by its noise floor: what the base model may take, then the rivals'
             torques, then their columns
    places   by rival and shape, the rows of the fixed part and of the columns behind the torques
    """

    bench: TrialArm
    systems: tuple[tuple[LinearSystem, ...], ...]
    places: tuple[tuple[slice, ...], ...]

    @classmethod
    def of(cls, bench: TrialArm, path: Array, spans: Sequence[tuple[float, float]] | None = None) -> MotionPieces:
        """Along a motion (n, N) at simulate's rate; spans: from and to which second each piece goes."""
        recording = bench.record(path, None, None)
        # The encoder's steps stay out, so that a special case of a rival is exactly that; the floor has them.
        motion = prepare([replace(recording, q=path)], bench.band, bench.model)
        spans = [(0.0, np.inf)] if spans is None else spans
        rows = _Rows.of(bench, motion)
        # One after another by view, so that what the joints of a view share is there for the next.
        order = [joint for view in motion.views for joint in view.joints]
        found = dict(zip(order, of_each("joints", partial(rows.joint, spans), order), strict=True))
        return cls(bench, tuple(found[i] for i in range(bench.model.n)), rows.places)

    def weigh(self, chosen: Sequence[int] | None = None, count: float = 1) -> dict[Pair, Separation]:
        """Separations on the chosen pieces, `count` times over; a pair without second rival is its visibility."""
        taken = self.systems if chosen is None else [[pieces[k] for k in chosen] for pieces in self.systems]
        everything = np.sum([_beyond_first(pieces) for pieces in taken], axis=0)
        rows = max(1, *(sum(system.joints[0].count for system in pieces) for pieces in taken))
        sums: dict[Pair, float] = {}
        for pair in [*self.bench.pairs, *((k, None) for k in range(len(self.bench.rivals)))]:
            sums[pair] = max(self._left(everything, *pair), 0.0)
        return {p: Separation(float(np.sqrt(s / rows)), float(np.sqrt(s * count))) for p, s in sums.items()}

    def _left(self, gram: Array, truth: int, other: int | None) -> float:
        """Squared error that the other rival leaves of the truth at its best shape."""
        whole = float(gram[truth, truth])
        if other is None:
            return whole
        effect = self.bench.model.library.effects[self.bench.rivals[other].term.effect]
        lower, upper = (np.array([c.bounds[k] for c in effect.coefficients]) for k in (0, 1))
        least, first = whole, len(self.bench.rivals)
        for place in self.places[other]:
            at = slice(first + place.start, first + place.stop)
            g, m = gram[at, at], gram[at, truth]
            fixed = whole - 2 * m[0] + g[0, 0]
            moment = m[1:] - g[1:, 0]
            theta = bounded(g[1:, 1:], moment, lower, upper)
            least = min(least, float(fixed - 2 * theta @ moment + theta @ g[1:, 1:] @ theta))
        return least - EXACT**2 * whole


def _beyond_first(systems: Sequence[LinearSystem]) -> Array:
    """(R', R') products, over some pieces, of all rows behind the first block once its columns took over what they
    can."""
    gram, first = np.sum([system.gram for system in systems], axis=0), systems[0].blocks[0].rows
    cross, behind = gram[first], slice(first[-1] + 1, None)
    left: Array = gram[behind, behind] - cross[:, behind].T @ inverse(cross[:, first]) @ cross[:, behind]
    return left


@dataclass(frozen=True)
class _Rows:
    """Of which the rows of the joints' equations are made along one motion: what the arm does is computed once for all
    joints of a view and all rivals.

    problem  of the base model        shapes  the grid of every rival
    """

    bench: TrialArm
    motion: Motion
    problem: Problem
    shapes: tuple[tuple[dict[str, float], ...], ...]

    @classmethod
    def of(cls, bench: TrialArm, motion: Motion) -> _Rows:
        model = bench.known
        problem = Problem(model, motion, tuple(bench.base), Prediction(model.lump_values, bench.base))
        with np.errstate(divide="ignore", invalid="ignore"):
            shapes = tuple(tuple(grids.points(problem.regressors, rival.term)) for rival in bench.rivals)
        return cls(bench, motion, problem, shapes)

    @property
    def places(self) -> tuple[tuple[slice, ...], ...]:
        """As `MotionPieces`."""
        found, at = [], 0
        for rival, choices in zip(self.bench.rivals, self.shapes, strict=True):
            size = self._size(rival)
            found.append(tuple(slice(at + k * size, at + (k + 1) * size) for k in range(len(choices))))
            at += size * len(choices)
        return tuple(found)

    def joint(self, spans: Sequence[tuple[float, float]], joint: int) -> tuple[LinearSystem, ...]:
        """The systems of a joint (0-based), one a span of time."""
        base, rivals = self._base(joint), self.bench.rivals
        torques = [self._torque(rival, joint) for rival in rivals]
        columns = [self._columns(rival, choices, joint) for rival, choices in zip(rivals, self.shapes, strict=True)]
        others, free = np.concatenate([torques, *columns]), np.full(len(base), np.inf)
        use, time = self.motion.moving(joint), self.motion.row_time(joint)
        taken = Block("base", {0: Columns(np.vstack([np.zeros(len(time)), base]))}, -free, free)
        unbounded = np.full(len(others) - 1, np.inf)
        blocks = [taken, Block("rivals", {0: Columns(others)}, -unbounded, unbounded)]
        nothing, piece, weight = np.zeros(len(time)), self.motion.row_piece(joint), 1 / self.bench.floor[joint]
        inside = (use & (time >= low) & (time < high) for low, high in spans)
        return tuple(LinearSystem.of([JointRows(nothing, rows, piece, weight)], blocks) for rows in inside)

    def _base(self, joint: int) -> Array:
        """(K, M) what the base model may take."""
        model = self.bench.known
        x, _ = self.problem.rows(joint, {term: _shape(self.bench, term) for term in self.bench.base})
        base = x[np.any(x != 0, axis=1)]
        if any("torque_rate" in model.library.needs[r.term.effect] for r in self.bench.rivals):
            return base
        # The skew between torque and motion is estimated, unless a delay of the drive is in question itself.
        return np.vstack([base, self.problem.regressors.skew(joint)])

    def _torque(self, rival: Hidden, joint: int) -> Array:
        """(M,) the rival's torque at a joint, in the band."""
        if joint not in joints_of(self.bench.known, rival.term):
            return np.zeros(len(self.motion.row_time(joint)))
        values = {**self.bench.base, rival.term: rival.values}
        signals = [s.where(values) for s in self.problem.regressors.signals(joint)]
        torques = [_own_torque(s, rival, joint) for s in signals]
        return np.concatenate(
            [s.piece.equation(s.piece.in_band(tau), joint) for s, tau in zip(signals, torques, strict=True)]
        )

    def _columns(self, rival: Hidden, choices: Sequence[dict[str, float]], joint: int) -> Array:
        """(K, M) of all shapes of a rival."""
        rows = len(self.motion.row_time(joint))
        if not choices or joint not in joints_of(self.bench.known, rival.term):
            return np.zeros((len(choices) * self._size(rival), rows))
        return self.problem.regressors.columns_each(rival.term, joint, choices).reshape(-1, rows)

    def _size(self, rival: Hidden) -> int:
        """Number of rows of a shape: the fixed part and the columns."""
        return 1 + len(self.bench.model.library.effects[rival.term.effect].coefficients)


def _own_torque(signals: Signals, rival: Hidden, joint: int) -> Array:
    """(N,) what a rival adds to the recorded torque at a joint (0-based), a delay as it is simulated."""
    lead = signals.model.library.effects[rival.term.effect].of_kind("lead")
    if lead is None:
        return signals.torque(rival.term, joint)
    predicted = signals.predicted(joint)
    return led(predicted, signals.time(), rival.values[lead.name]) - predicted


def _shape(bench: TrialArm, term: Term) -> dict[str, float]:
    shape = {p.name for p in bench.model.library.effects[term.effect].shape}
    return {k: v for k, v in bench.base[term].items() if k in shape}
