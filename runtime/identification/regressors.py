"""What effects read along a motion, and the regressors that follow from it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, Key, Once
from runtime.identification.recorded_torque import (
    LINK_LOAD,
    LINK_SIDE,
    rigid_regressor,
    rigid_torque,
    weight_regressor,
    without_parameters,
)
from runtime.identification.settings import FINEST_STEP, NOMINAL_SKEW
from runtime.model.loader import Model
from runtime.model.terms import IDENTIFIED, OF_DRIVE, Prediction, SignalContext, Structure, Term, given, joints_of
from runtime.motion.clock import interpolated
from runtime.motion.motion import Motion
from runtime.motion.piece import Piece

OF_MASSES = "moment_jacobian"
"""The arm's function that needs the mass and the centre of mass of every link apart from one another."""
NOTHING_GIVEN: Final[Mapping[str, float]] = {}


@dataclass
class Signals(SignalContext):
    """The signals that effects read, along one piece, computed when first asked for.

    `prediction` is None as long as nothing is identified: then signals that need it are not there.
    """

    model: Model
    piece: Piece
    prediction: Prediction | None
    _cache: dict[tuple[str, int, int | None], Array | float] = field(default_factory=dict)
    _slopes: dict[tuple[str, str, int], Array] = field(default_factory=dict)
    _read: dict[tuple[str, int | None, int, int], dict[str, Array | float]] = field(default_factory=dict)

    def where(self, values: Structure) -> Signals:
        """The same where other effects act: what the arm's functions gave along this piece is read, not computed
        again."""
        made = Signals(self.model, self.piece, replace(self._known, values=values), _slopes=self._slopes)
        made._outputs = self._outputs
        return made

    def signal(self, name: str, joint: int, own: int | None) -> Array | float:
        key = (name, joint, own)
        if key not in self._cache:
            if self.prediction is None and self.model.library.signal[name].needs in IDENTIFIED:
                raise RuntimeError(f"{name} needs an identified model")
            self._cache[key] = super().signal(name, joint, own)
        return self._cache[key]

    def at(self, name: str, joint: int) -> Array | float:
        """A signal at a joint (0-based), for an effect that sits there."""
        return self.signal(name, joint, joint)

    def of(self, term: Term, joint: int, times: int = 1) -> Mapping[str, Array | float]:
        """What a term reads for its torque at a joint (0-based), so many times a sample, and the time, which tells how
        many there are."""
        key = (term.effect, term.joint, joint, times)
        if key not in self._read:
            read, names = self.reader(term, joint), self.model.library.effects[term.effect].signals
            found = {"t": self.piece.t, **{name: read(name) for name in names}}
            if times > 1:
                places = np.arange(len(self.piece.t), dtype=np.float64)
                fine = np.arange((len(places) - 1) * times + 1) / times
                along = [k for k, x in found.items() if np.ndim(x)]
                rows = interpolated(places, np.array([found[k] for k in along]), fine)
                found |= dict(zip(along, np.ascontiguousarray(rows), strict=True))
            self._read[key] = found
        return self._read[key]

    def lacks(self, term: Term) -> bool:
        """Whether the term reads of another effect that is not there: of a joint's dry friction, of a parameter."""
        read = [self.model.library.signal[name] for name in self.model.library.effects[term.effect].signals]
        if any(info.needs == "effect" and self.given(info.name) is None for info in read):
            return True
        rubbing = [info.name for info in read if info.needs == "friction" and term.joint is not None]
        return not all(np.any(self.at(name, (term.joint or 1) - 1)) for name in rubbing)

    def coordinate(self, name: str) -> Array:
        return getattr(self.piece, name)

    def evaluate(self, function: str) -> Array:
        if function == LINK_LOAD:
            return self._link_load
        inputs = self.model.metadata["functions"][function]["inputs"]
        lumps = None if self.prediction is None else self.prediction.lumps
        output = self.model.call(function, {name: self.coordinate(name) for name, _ in inputs}, lumps)
        if function == LINK_SIDE:
            for joint, change in self._moved_to_link.items():
                output[joint, joint] += change
        return output

    def growth(self, function: str, by: str, own: int) -> Array:
        """(n, N), by central differences: exact to rounding for rates, in which torques are quadratic."""
        if (function, by, own) not in self._slopes:
            step = 1e-4  # curvature adds a part of 1e-8, rounding one of 1e-11
            ends = [self._shifted(function, by, own, part) for part in (step, -step)]
            self._slopes[function, by, own] = (ends[0] - ends[1]) / (2 * step)
        return self._slopes[function, by, own]

    def _shifted(self, function: str, by: str, own: int, step: float) -> Array:
        moved = {"q": self.piece.q, "qd": self.piece.qd, "qdd": self.piece.qdd_denoised}
        moved[by] = moved[by] + step * (np.arange(self.model.n) == own)[:, None]
        inputs = self.model.metadata["functions"][function]["inputs"]
        return self.model.call(function, {name: moved[name] for name, _ in inputs}, self._known.lumps)

    def given(self, name: str) -> float | None:
        return given(self.model.library, self._known.values, name)

    def time(self) -> Array:
        return self.piece.t

    def elapsed(self) -> Array:
        return self.piece.began + self.piece.t

    def warmth(self, joint: int) -> Array | None:
        return self.piece.warmth[joint] if self.piece.measured[joint] else None

    def terms(self) -> Collection[Term]:
        return self._known.values.keys()

    @cached_property
    def measured(self) -> Array | None:
        """(n, N) the part of the rigid arm's torque that needs no inertial parameter: all of it where the user's own
        model gives it, else that which holds a measured force f (in space: and moment) at the end-effector, −Jᵀ f;
        None without either."""
        sensors = self.piece.sensors
        if sensors.tau_rigid is not None:
            return sensors.tau_rigid
        if sensors.force is not None:
            acting = sensors.force
            return -np.einsum("cjt,ct->jt", self.arm("tip_jacobian")[: len(acting)], acting)
        return None

    @cached_property
    def rigid(self) -> Array:
        """(n, N) what the recorded torque has of D qdd + C qd + g with the identified inertial parameters, less Jᵀ f of
        a measured force; or the user's own model's."""
        p = self.piece
        if p.sensors.tau_rigid is not None:
            return p.sensors.tau_rigid
        rigid = rigid_torque(self.model, p, self._known.lumps)
        return rigid if self.measured is None else rigid + self.measured

    @cached_property
    def _link_load(self) -> Array:
        """(n, N) the same without the rotors, of accelerations that are motion and not noise.

        What is simulated under a load amplifies noise at its resonance, and magnitudes do not average it.
        """
        p = self.piece
        if p.sensors.tau_rigid is not None:
            rotors = np.array([[joint.rotor_inertia or 0.0] for joint in self.model.joints])
            whole = np.array([smooth(row) for smooth, row in zip(p.wiener, p.sensors.tau_rigid, strict=True)])
            return whole - rotors * p.qdd_denoised
        loads = self.model.call(LINK_LOAD, {"q": p.q, "qd": p.qd, "qdd": p.qdd_denoised}, self._known.lumps)
        for joint, change in self._moved_to_link.items():
            loads[joint] += change * p.qdd_denoised[joint]
        return loads if self.measured is None else loads + self.measured

    def assumed_rotor(self, joint: int) -> float:
        """What the generated functions take for the rotor's inertia at a joint (0-based): all that it moves less what
        its link side does."""
        at, lumps = self.piece.q[:, :1], self._known.lumps
        link = self.model.call(LINK_SIDE, {"q": at}, lumps)
        return float(self.model.inertia(at, lumps)[joint, joint, 0] - link[joint, joint, 0])

    @cached_property
    def _moved_to_link(self) -> dict[int, float]:
        """By how much the inertia on the link side of a joint (0-based) is larger, where its rotor is known from a
        fit alone."""
        rotors = {} if self.prediction is None else self.prediction.rotors
        return {joint: self.assumed_rotor(joint) - rotor for joint, rotor in rotors.items()}

    @property
    def _known(self) -> Prediction:
        if self.prediction is None:
            raise RuntimeError("this signal needs an identified model")
        return self.prediction

    @property
    def loads(self) -> Array:
        """(n, N) torque that every joint transmits to its link."""
        return np.array([self.at("load", i) for i in range(self.model.n)])

    def link_inertia(self, joint: int) -> Array:
        """(N,) inertia of the link side as a joint (0-based) sees it."""
        return self.coupling(joint, joint)

    def coupling(self, joint: int, own: int) -> Array:
        """(N,) inertia between two joints (0-based), link side."""
        return self.arm("link_inertia")[joint, own]

    def predicted(self, joint: int) -> Array:
        total = self.rigid[joint].copy()
        for term in self._known.values:
            if joint in joints_of(self.model, term) and not self.model.library.needs[term.effect] & OF_DRIVE:
                total += self.torque(term, joint)
        return total

    def predicted_rate(self, joint: int) -> Array:
        return np.gradient(np.asarray(self.at("predicted", joint)), self.piece.dt)

    def torque(self, term: Term, joint: int) -> Array:
        """(N,) torque of a term of the prediction at a joint (0-based)."""
        values = self._known.values[term]
        return self.model.library.torque(term.effect, self.of(term, joint), values, self.piece.dt)

    def deflection(self, term: Term, shape: Mapping[str, float]) -> Array | None:
        """(N,) by which a term's link lags behind its motor; None for a term without such a state."""
        name = self.model.library.effects[term.effect].deflection
        if term.joint is None or name is None:
            return None
        read = self.of(term, term.joint - 1)
        return self.model.library.states(term.effect, read, shape, self.piece.dt)[name]


@dataclass(frozen=True)
class Ahead:
    """By how much the recorded torques lead the motion: of all joints `skew` samples, and of each (n,) `times` s more.

    At that time the column of a delay is exact: to first order, a delay of a sample would be one of a small angle at
    every frequency, and of three samples at none.

    whole   (n,) whether all of a torque that a law makes is late, as that of a slow drive is, and not its command alone
    first   of every joint (n,) the first of a structure's delays, which has the part without free coefficient: further
            ones add their times alone; empty: no structure is known
    """

    skew: float
    times: Array
    whole: NDArray[np.bool_]
    first: tuple[Term | None, ...] = ()

    def of(self, model: Model, terms: Iterable[Term]) -> Ahead:
        """The same for a structure."""
        found: list[Term | None] = [None] * model.n
        for term in terms:
            for joint in joints_of(model, term) if is_delay(model, term) else ():
                found[joint] = found[joint] or term
        return replace(self, first=tuple(found))

    def begins(self, term: Term, joint: int) -> bool:
        """Whether no other delay has the part without free coefficient at a joint (0-based)."""
        return not self.first or self.first[joint] in (None, term)


def is_delay(model: Model, term: Term) -> bool:
    """Whether a term's only coefficient is the time by which the recorded torque is ahead."""
    return [p.kind for p in model.library.effects[term.effect].parameters] == ["lead"]


@dataclass
class Regressors:
    """In-band regressors of one model along one motion; asked for again, they are not computed again.

    ahead: where delays are exact; None: they are small
    extents: offset and scale of quantities over the motion, as `grids` has found them.
    """

    model: Model
    motion: Motion
    prediction: Prediction | None = None
    ahead: Ahead | None = None
    extents: dict[tuple[str, tuple[int, ...]], tuple[float, float]] = field(default_factory=dict)
    _once: Once = field(default_factory=Once, init=False)
    _signals: dict[tuple[int, ...], tuple[Signals, ...]] = field(default_factory=dict, init=False)

    def signals(self, joint: int) -> tuple[Signals, ...]:
        """Along every piece, in the band of a joint's equation (0-based)."""
        view = self.motion.view(joint)
        if view.joints not in self._signals:
            self._signals[view.joints] = tuple(Signals(self.model, piece, self.prediction) for piece in view.pieces)
        return self._signals[view.joints]

    @cached_property
    def perturbed(self) -> Regressors:
        """The same along the motion with a further realisation of the encoders' noise on it."""
        return Regressors(self.model, self.motion.perturbed, self.prediction, self.ahead)

    def rigid(self, joint: int) -> Array:
        """(p, M) derivative of the joint's torque (0-based) by the base inertial parameters; zero where the user's own
        model gives it whole."""

        if self.motion.rigid_given:
            return np.zeros((len(self.model.lumps), len(self.motion.row_piece(joint))))

        def rows(p: Piece, joints: tuple[int, ...]) -> dict[int, Array]:
            return p.equations_in_blocks(lambda at: rigid_regressor(self.model, p, at), joints)

        return self._of_all("rigid", joint, lambda s, joints: rows(s.piece, joints))

    def weights(self, joint: int) -> Array:
        """(p, M) the part of `rigid` that gravity makes: what holds the arm at rest."""

        def rows(p: Piece, joints: tuple[int, ...]) -> dict[int, Array]:
            return p.equations_in_blocks(lambda at: weight_regressor(self.model, p.q[:, at]), joints)

        return self._of_all("weights", joint, lambda s, joints: rows(s.piece, joints))

    def measured(self, joint: int) -> Array:
        """(M,) the part of the joint's torque (0-based) that is known whatever the parameters: measured signals give
        it, or stated rotors."""

        def torque(s: Signals) -> Array:
            parts = (s.measured, None if self.motion.rigid_given else without_parameters(self.model, s.piece))
            return sum((part for part in parts if part is not None), start=np.zeros(s.piece.q.shape))

        return self._of_all("measured", joint, lambda s, joints: s.piece.equations(torque(s), joints))

    def _of_all(self, what: str, joint: int, make: Callable[[Signals, tuple[int, ...]], Mapping[int, Array]]) -> Array:
        """(..., M) in-band rows of a joint (0-based) of what is computed at once for some joints along a piece; kept
        for this motion."""
        key = (what, self.model.directory)

        def made(_: Sequence[Key]) -> dict[Key, Array]:
            joints = self.motion.view(joint).joints
            parts = [make(s, joints) for s in self.signals(joint)]
            return {(*key, i): np.concatenate([part[i] for part in parts], axis=-1) for i in joints}

        return self.motion.once.of([(*key, joint)], made)[0]

    def acceleration(self, joint: int) -> Array:
        """(M,) of the joint (0-based): what a further inertia at its motor asks for."""

        return self._of_all("acceleration", joint, lambda s, joints: s.piece.equations(s.piece.qdd, joints))

    def late(self, joint: int) -> float:
        """Samples by which a delay of the structure has the torque of a joint (0-based) taken later; 0 of a small one,
        and of one that is no part of it."""
        if self.ahead is None or not self.ahead.first or self.ahead.first[joint] is None:
            return 0.0
        return float(self.ahead.times[joint]) / self.motion.pieces[0].dt

    def gain(self, joint: int, name: str) -> Array:
        """(M,) what is wrong with the torque of a joint (0-based) whose drive has one unit less of a gain than the
        motion's torque was made with; of the gain of its command, all of it less."""
        pieces, driven = self.motion.pieces_of(joint), self.motion.driven[joint]
        if driven is not None and name == driven.command_gain:
            none = np.zeros(len(self.model.lumps))
            lumps = self.model.lumps_or(none) if self.prediction is None else self.prediction.lumps
            made = np.concatenate([np.full(len(p.centres), (joint, name) in p.gains) for p in pieces])
            return np.where(made, lumps @ self.rigid(joint), 0.0)
        held = NOMINAL_SKEW if self.motion.feeds_back(joint) else 0.0
        return -self.motion.torque_per_gain((joint, name), held + self.late(joint), self.whole(joint))

    def whole(self, joint: int) -> bool:
        """Whether a delay of the structure has all of a joint's torque (0-based) late, not the command alone."""
        return bool(self.late(joint)) and self.ahead is not None and bool(self.ahead.whole[joint])

    def columns(
        self, term: Term, joint: int, shape: Mapping[str, float], given: Mapping[str, float] = NOTHING_GIVEN
    ) -> Array:
        """(1 + k, M): the part without free coefficient, then one row a linear coefficient.

        given   signals that are parameters of other effects, where these have other values than predicted
        """
        return self._stored(term, joint, [shape], given)[0]

    def columns_each(self, term: Term, joint: int, shapes: Sequence[Mapping[str, float]]) -> Array:
        """(S, 1 + k, M) `columns` for many shapes of a term."""
        return np.array(self._stored(term, joint, shapes, NOTHING_GIVEN))

    def foresee(
        self, term: Term, joint: int, shapes: Sequence[Mapping[str, float]], given: Mapping[str, float]
    ) -> None:
        """Compute at once, which takes a part of the time, what `columns` will be asked for one after another."""
        self._stored(term, joint, shapes, given)

    def _stored(
        self, term: Term, joint: int, shapes: Sequence[Mapping[str, float]], given: Mapping[str, float]
    ) -> list[Array]:
        library = self.model.library
        once = self._once if library.needs[term.effect] & IDENTIFIED else self.motion.once
        where = (library.directory, self.model.directory, term, *given.items())
        by_key = {(joint, *where, *shape.values()): shape for shape in shapes}

        def made(absent: Sequence[Key]) -> dict[Key, Array]:
            found = self._in_band(term, joint, [by_key[key] for key in absent], given)
            return {(i, *key[1:]): own for i, each in found.items() for key, own in zip(absent, each, strict=True)}

        return once.of([(joint, *where, *shape.values()) for shape in shapes], made)

    def _in_band(
        self, term: Term, joint: int, shapes: Sequence[Mapping[str, float]], given: Mapping[str, float]
    ) -> dict[int, Array]:
        """(S, 1 + k, M) at the joint, and at all that feel the same and share its band: it is simulated once."""
        if is_delay(self.model, term) and (self._exact(joint) or self.motion.feeds_back(joint)):
            none = np.zeros(self.model.n)
            ahead = self.ahead or Ahead(NOMINAL_SKEW, none, none > 0)
            late = self._late(joint, ahead)
            if not ahead.begins(term, joint):
                late[0] = 0.0
            return {joint: np.array([late] * len(shapes))}
        library, felt = self.model.library, joints_of(self.model, term)
        joints = [i for i in self.motion.view(joint).joints if i in felt] if joint in felt else [joint]
        parts, told = [], self._told(term)
        for s in self.signals(joint):
            band, dt = s.piece.low_pass, s.piece.dt
            times = max(1, round(dt / FINEST_STEP)) if library.effects[term.effect].gives_way else 1
            read = [{**s.of(term, i, times), **given} for i in joints]
            # Of the steps between two samples the filter reads none.
            kernel = np.kron(band.kernel, np.arange(times) == 0)[: len(band.kernel) * times - times + 1]
            columns = library.columns_in_band(term.effect, read, shapes, dt / times, kernel, band.factor * times)
            if told < band.cutoff:
                columns = band.narrowed(columns, told)
            parts.append([s.piece.equation(columns[:, k], i) for k, i in enumerate(joints)])
        return {i: np.concatenate([part[k] for part in parts], axis=2) for k, i in enumerate(joints)}

    def _exact(self, joint: int) -> bool:
        """Whether a delay at a joint (0-based) is too large to be taken to first order about none."""
        return self.ahead is not None and bool(self.ahead.times[joint])

    def _told(self, term: Term) -> float:
        """Hz, up to which the motion tells what a term does.

        A link behind a spring is simulated from the motion of its own motor. Above that joint's band this is the
        encoder's noise, and a resonance there multiplies it: in the wider bands of lighter joints it would be all
        there is.
        """
        if term.joint is None or not self.model.library.effects[term.effect].gives_way:
            return np.inf
        return float(self.motion.band.cutoffs[term.joint - 1])

    def raw_columns(self, signals: Signals, term: Term, joint: int, shape: Mapping[str, float]) -> Array:
        """(1 + k, N) at full rate along one piece."""
        library = self.model.library
        return library.columns(term.effect, signals.of(term, joint), shape, signals.piece.dt)

    def _late(self, joint: int, ahead: Ahead) -> Array:
        """(2, M) as `columns`: what the recorded torque has beside what it is a time later, to first order about the
        time at which it was found.

        The slope is a central difference there: with what lies between the two torques in its place, a time between
        them would average their noise, and seem to fit better.
        """
        time, motion, whole = float(ahead.times[joint]), self.motion, bool(ahead.whole[joint])
        half = motion.pieces[0].dt / 2
        sooner, later, latest = (
            motion.torque_delayed(joint, ahead.skew, time + by, whole) for by in (-half, 0.0, half)
        )
        slope = (latest - sooner) / (2 * half)
        return np.stack([motion.torque(joint, ahead.skew) - later + time * slope, -slope])

    def skew(self, joint: int, at: float = NOMINAL_SKEW) -> Array:
        """(M,) change of the in-band torque when it is taken one sample later than `at`; a recorded torque, whose noise
        is in it, than recorded."""
        if not self.motion.feeds_back(joint):
            return self.motion.slope(joint)
        return self.motion.torque(joint, at + 0.5) - self.motion.torque(joint, at - 0.5)


def arm_functions_read(model: Model, term: Term) -> set[str]:
    """The arm's functions whose outputs a term reads; its other signals of the arm follow from the load."""
    read = [model.library.signal[name] for name in model.library.effects[term.effect].signals]
    outputs = {str(s.source["function"]) for s in read if s.source is not None and s.source["kind"] == "ArmOutput"}
    return outputs | {LINK_LOAD for s in read if s.source is None and s.needs == "arm"}


def unseen_rotors(model: Model, terms: Iterable[Term]) -> tuple[int, ...]:
    """Joints (0-based) whose rotor's part in their inertia no rigid motion determines, and a term needs."""
    needed = {
        t.joint - 1 for t in terms if t.joint is not None and arm_functions_read(model, t) & {LINK_LOAD, LINK_SIDE}
    }
    identified = {lump.name for lump in model.lumps}
    return tuple(sorted(i for i in needed if f"I{i + 1}" not in identified))
