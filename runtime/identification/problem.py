"""The least-squares problem of one structure on one motion: everything that is linear, solved exactly."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.identification.grids import motor_angle
from runtime.identification.recorded_torque import without_weight
from runtime.identification.regressors import Ahead, Regressors
from runtime.model.loader import LumpInfo, Model
from runtime.model.terms import IDENTIFIED, Prediction, Term, Values, given, joints_of, known_vector, structure
from runtime.motion.motion import Motion
from runtime.regression.bounded import inverse, of_size, tangents
from runtime.regression.rows import Block, Columns, JointRows
from runtime.regression.system import LinearSystem
from symbolic.model_file.arm import ROTOR

LATE: Final = "late"
"""of blocks: samples by which the torque is taken later."""
DERIVATIVE_STEP: Final = 1e-3
"""part of a parameter (its unit where that is 0); over it the derivative of a torque is taken: between rounding and
curvature."""


@dataclass(frozen=True)
class LinearUnknowns:
    """Order of the linear unknowns: base inertial parameters, each term's coefficients, inertias at the motors, gains.

    gains         of drives, by what each is off; of a command's, as a part of it
    rotors        one a joint, where the user's own model gives the rigid-body torque: what that lacks of the rotors
    lower, upper  (K,) bounds     stated  (K,) what the model file says, a neutral value where nothing: what no row
    tells stays there
    """

    terms: tuple[Term, ...]
    slices: dict[Term, slice]
    lumps: slice
    rotors: slice
    gains: slice
    lower: Array
    upper: Array
    stated: Array

    @property
    def size(self) -> int:
        """Number of unknowns, K."""
        return len(self.lower)

    @classmethod
    def of(cls, model: Model, terms: Sequence[Term], rigid_given: bool, gains: int = 0) -> LinearUnknowns:
        """rigid_given: the inertial parameters act on no torque and stay at the file's values; gains: how many."""
        start, slices, known = len(model.lumps), {}, structure(model)
        stated = [_neutral(lump) if lump.value is None else lump.value for lump in model.lumps]
        lower = [*stated] if rigid_given else [-np.inf] * start
        upper = [*stated] if rigid_given else [np.inf] * start
        for term in terms:
            info = model.library.effects[term.effect]
            slices[term] = slice(start, start + len(info.coefficients))
            start += len(info.coefficients)
            # A size that is known is bound enough, and what is sought before it is known may be anywhere.
            lower += [-np.inf if info.sized else c.bounds[0] for c in info.coefficients]
            upper += [np.inf if info.sized else c.bounds[1] for c in info.coefficients]
            stated += model.library.coefficients(term.effect, known.get(term, {})).tolist()
        rotors = slice(start, start + (model.n if rigid_given else 0))
        count = rotors.stop - rotors.start
        # No rotor has less than none: at the least, all that the file states was in the user's model too often.
        lower += [-(joint.rotor_inertia or 0.0) for joint in model.joints[:count]]
        lower += [-np.inf] * gains
        count += gains
        bounds = map(np.array, (lower, upper + [np.inf] * count, stated + [0.0] * count))
        told = slice(rotors.stop, rotors.stop + gains)
        return cls(tuple(terms), slices, slice(0, len(model.lumps)), rotors, told, *bounds)


def _neutral(lump: LumpInfo) -> float:
    # Less than any joint moves, more than the rounding of D's eigenvalues.
    return 1e-6 if lump.name in (f"J{lump.joint}", f"M{lump.joint}") else 0.0


@dataclass(frozen=True)
class _Part(Mapping[int, Columns]):
    """What the arm, a term or the rotors have of the rows of their joints, computed when it is asked for.

    key: equal for equal columns; joints (0-based); unknowns: to which the columns belong; rows: (1 + k, M) at a joint,
    the part without free coefficient and the columns
    """

    key: Hashable
    joints: tuple[int, ...]
    unknowns: slice
    rows: Callable[[Regressors, int], Array]
    regressors: Regressors

    def __getitem__(self, joint: int) -> Columns:
        rows, again = (self.rows(r, joint) for r in (self.regressors, self.regressors.perturbed))
        return Columns(rows, again - rows)

    def __contains__(self, joint: object) -> bool:
        return joint in self.joints

    def __iter__(self) -> Iterator[int]:
        return iter(self.joints)

    def __len__(self) -> int:
        return len(self.joints)


class Nonlinear(NamedTuple):
    """A parameter in which the torque is not linear: of a term's shape, or of a joint (0-based) the rotor's inertia."""

    name: str
    term: Term | None = None
    joint: int = 0


Range = tuple[float, float]


@dataclass(frozen=True)
class Skew:
    """Samples `at` which the torque is taken; further shifts from there are unknown: "no", "shared" or "each"."""

    at: float
    unknown: Literal["no", "shared", "each"] = "no"


@dataclass(frozen=True)
class Solved:
    """coefficients (K,); shifts of the torque from where it was taken, samples; Gram matrix of both; residuals (M,)."""

    coefficients: Array
    shifts: Array
    gram: Array
    residual: list[Array]


def weighted(residual: Sequence[Array], weights: Array) -> float:
    """Weighted squared error of the joints' residuals."""
    return float(sum(w**2 * (r @ r) for r, w in zip(residual, weights, strict=True)))


def first_least(errors: Array) -> int:
    """Index of the first of the least of squared errors (S,); what rounding tells apart is equal."""
    return int(np.argmax(errors <= (1 + 1e-10) * errors.min()))


def least_inertia(model: Model, stretches: Sequence[Array], lumps: Array) -> float:
    """The smallest eigenvalue of D over configurations of stretches of motion (n, M), kg m² (kg); `lumps` are base
    inertial parameters."""
    return float(np.linalg.eigvalsh(_inertias(model, configurations(stretches), lumps)).min())


def inertia_cuts(model: Model, q: Array, lumps: Array) -> Array | None:
    """(C, p) cuts c with c·lumps > 0, of which a D that is not positive definite at configurations q (n, N) violates
    one; None if it is."""
    inertias = _inertias(model, q, lumps)
    with suppress(np.linalg.LinAlgError):
        np.linalg.cholesky(inertias)  # in a tenth of the time of eigenvalues
        return None
    value, vectors = np.linalg.eigh(inertias)
    worst = np.argsort(value[:, 0])[:4]
    worst = worst[value[worst, 0] <= 0]
    if not len(worst):
        return None
    # Of the torque only D(q) q̈ grows with acceleration: v of it, times v, is vᵀ D(q) v for every lump at once.
    v, at = vectors[worst, :, 0].T, q[:, worst]
    still = np.zeros_like(at)
    moved, held = (model.regressor(at, still, acceleration) for acceleration in (v, still))
    met: Array = np.einsum("jc,jkc->ck", v, moved - held)
    return met


def configurations(stretches: Sequence[Array]) -> Array:
    """(n, N) some configurations of every stretch of motion (n, M); D changes slowly with the posture."""
    enough = 60
    return np.concatenate([q[:, :: max(1, q.shape[1] // enough)] for q in stretches], axis=1)


def _inertias(model: Model, q: Array, lumps: Array) -> Array:
    """(N, n, n) D at configurations q (n, N)."""
    return np.moveaxis(model.inertia(q, lumps), 2, 0)


def change(key: Hashable, columns: Mapping[int, Array], lower: float = -np.inf, upper: float = np.inf) -> Block:
    """A block of one column, (M,) by joint, without noise: what a change of a parameter adds to the torque."""
    rows = {joint: Columns(np.stack([np.zeros_like(x), x])) for joint, x in columns.items()}
    return Block(key, rows, np.array([lower]), np.array([upper]), version=(key, object()))


def _arm(regressors: Regressors, joint: int) -> Array:
    return np.vstack([regressors.measured(joint)[None], regressors.rigid(joint)])


def _term(regressors: Regressors, joint: int, term: Term, shape: Values, given: Values) -> Array:
    return regressors.columns(term, joint, shape, given)


def _rotors(regressors: Regressors, joint: int) -> Array:
    own = regressors.acceleration(joint)
    rows = np.zeros((1 + regressors.model.n, len(own)))
    rows[1 + joint] = own
    return rows


def _gains(regressors: Regressors, joint: int) -> Array:
    gains = regressors.motion.gains
    rows = np.zeros((1 + len(gains), len(regressors.motion.row_piece(joint))))
    for k, (own, name) in enumerate(gains, start=1):
        if own == joint:
            rows[k] = regressors.gain(joint, name)
    return rows


class Problem:
    """Least squares of one structure on one motion, for any shapes and skew."""

    def __init__(
        self,
        model: Model,
        motion: Motion,
        terms: Sequence[Term],
        prediction: Prediction | None,
        ahead: Ahead | None = None,
        like: Problem | None = None,
        weights: Array | None = None,
    ) -> None:
        """like: another, of which the products of equal columns are taken where its motion is the same; weights (n,) of
        the joints' residuals, by the floors of their torques if None."""
        self.model, self.motion = model, motion
        self.layout = LinearUnknowns.of(model, terms, motion.rigid_given, len(motion.gains))
        self.regressors = Regressors(model, motion, prediction, ahead and ahead.of(model, terms))
        self._told = object()
        self.rotors: Mapping[int, float] = {} if prediction is None else prediction.rotors
        self.weights = 1 / np.maximum(motion.band.torque_floor(), 1e-12) if weights is None else weights
        same = like if like is not None and like.motion is motion else None
        self._last: LinearSystem | None = None if same is None else same._last
        self.cuts: Array = np.zeros((0, len(model.lumps))) if same is None else same.cuts
        self._met = self.cuts
        self._joints: dict[tuple[int, float, float], JointRows] = {}

    def with_rotors(self, rotors: Mapping[int, float]) -> Problem:
        """The same with other inertias of rotors that the model file leaves out, by joint (0-based)."""
        prediction = self.regressors.prediction
        assert prediction is not None
        made, told = copy(self), replace(prediction, rotors=dict(rotors))
        made.rotors, made._told = told.rotors, object()
        made.regressors = Regressors(self.model, self.motion, told, self.regressors.ahead)
        return made

    def weighed(self, weights: Array) -> Problem:
        """The same with other weights (n,); what follows from it begins with the cuts that were met up to here."""
        made = copy(self)
        made.weights, made.cuts = weights, self._met
        return made

    def rows(self, joint: int, shapes: Mapping[Term, Values]) -> tuple[Array, Array]:
        """Regressor (K, M) and the part without free coefficient (M,) of a joint's torque (0-based)."""
        return self._rows(self.regressors, joint, shapes)

    def reread(self, joint: int, shapes: Mapping[Term, Values], coefficients: Array) -> Array:
        """(M,) by how much another reading of the encoders would change the predicted torque of a joint (0-based)."""
        (x, fixed), (again, fixed_again) = (
            self._rows(r, joint, shapes) for r in (self.regressors, self.regressors.perturbed)
        )
        change: Array = coefficients @ (again - x) + (fixed_again - fixed)
        return change

    def _rows(self, regressors: Regressors, joint: int, shapes: Mapping[Term, Values]) -> tuple[Array, Array]:
        x = np.zeros((self.layout.size, len(self.motion.row_piece(joint))))
        fixed = np.zeros(x.shape[1])
        for part in self._parts(shapes):
            if joint in part.joints:
                rows = part.rows(regressors, joint)
                fixed += rows[0]
                x[part.unknowns] = rows[1:]
        return x, fixed

    def _parts(self, shapes: Mapping[Term, Values]) -> Iterator[_Part]:
        """The arm's, then each term's, the rotors' and the drives'."""
        layout, every = self.layout, tuple(range(self.model.n))
        yield _Part("arm", every, layout.lumps, _arm, self.regressors)
        for term in layout.terms:
            shape, given = shapes[term], self._given(term, shapes)
            rows = partial(_term, term=term, shape=shape, given=given)
            key = (term, *shape.values(), *given.items())
            if self.model.library.needs[term.effect] & IDENTIFIED:
                key = (*key, self._told)  # they read what was predicted
            yield _Part(key, joints_of(self.model, term), layout.slices[term], rows, self.regressors)
        if self.motion.rigid_given:
            yield _Part("rotors", every, layout.rotors, _rotors, self.regressors)
        if self.motion.gains:
            yield _Part(("gains", self._told), every, layout.gains, _gains, self.regressors)

    def _given(self, term: Term, shapes: Mapping[Term, Values]) -> Values:
        library = self.model.library
        names = (name for name in library.effects[term.effect].signals if library.signal[name].needs == "effect")
        values = {name: given(library, shapes, name) for name in names}
        return {name: value for name, value in values.items() if value is not None}

    def system(self, shapes: Mapping[Term, Values], skew: Skew, beside: Sequence[Block] = ()) -> LinearSystem:
        """All that is linear for these shapes, compensated for the encoders' noise; beside: further blocks. What an
        earlier one had of the same columns is not multiplied again."""
        layout, blocks = self.layout, []
        for part in self._parts(shapes):
            lower, upper, near = (x[part.unknowns] for x in (layout.lower, layout.upper, layout.stated))
            key = part.key[0] if isinstance(part.key, tuple) else part.key
            blocks.append(Block(key, part, lower, upper, near=near, version=part.key))
        joints = [self.joint_rows(i, skew.at) for i in range(self.model.n)]
        self._last = LinearSystem.of(joints, [*blocks, *self._late(skew), *beside], self._last)
        return self._last

    def searched(self, shapes: Mapping[Term, Values]) -> list[Nonlinear]:
        """Parameters that take any value of a range and in which the torque is not linear."""
        library, found = self.model.library, []
        for term in self.layout.terms:
            for name in shapes[term]:
                grid = library.effects[term.effect].parameter(name).grid
                if grid is not None and grid.continuous:
                    found.append(Nonlinear(name, term))
        return [*found, *(Nonlinear(ROTOR, joint=joint) for joint in self.rotors)]

    def value(self, shapes: Mapping[Term, Values], of: Nonlinear) -> float:
        """What a parameter is."""
        return self.rotors[of.joint] if of.term is None else shapes[of.term][of.name]

    def changed(
        self, shapes: Mapping[Term, Values], changes: Mapping[Nonlinear, float]
    ) -> tuple[Problem, dict[Term, Values]]:
        """The problem and the shapes with parameters changed by so much."""
        rotors, moved = dict(self.rotors), {t: dict(s) for t, s in shapes.items()}
        for of, by in changes.items():
            if of.term is None:
                rotors[of.joint] += by
            else:
                moved[of.term][of.name] += by
        return (self if rotors == self.rotors else self.with_rotors(rotors)), moved

    def derivative(self, shapes: Mapping[Term, Values], theta: Array, of: Nonlinear) -> Block:
        """Of the predicted torque by a parameter, with coefficients theta (K,): a block of one column, whose
        coefficient is a change of that parameter."""
        step = self._step(of, self.value(shapes, of))
        sides = [self.changed(shapes, {of: by}) for by in (step, -step)]
        if of.term is not None:
            ends, given = [moved[of.term] for _, moved in sides], self._given(of.term, shapes)
            for joint in joints_of(self.model, of.term):
                self.regressors.foresee(of.term, joint, ends, given)
        found: dict[int, Array] = {}
        for more, less in zip(*(there._parts(moved) for there, moved in sides), strict=True):
            if more.key != less.key or more.regressors is not less.regressors:
                along = np.append(1.0, theta[more.unknowns]) / (2 * step)
                for joint in more.joints:
                    own = along @ (more.rows(more.regressors, joint) - less.rows(less.regressors, joint))
                    found[joint] = found[joint] + own if joint in found else own
        return change(of, found)

    def _step(self, of: Nonlinear, value: float) -> float:
        line = None if of.term is None else self.model.library.effects[of.term.effect].line
        if of.term is None or line is None or line.name != of.name:
            return DERIVATIVE_STEP * abs(value) or DERIVATIVE_STEP
        return DERIVATIVE_STEP * motor_angle(self.model, self.motion, joints_of(self.model, of.term)[0]).period

    def step(
        self, shapes: Mapping[Term, Values], solved: Solved, skew: Skew, ranges: Mapping[Nonlinear, Range], reach: float
    ) -> tuple[dict[Nonlinear, float], float]:
        """Changes of parameters that the equations ask for, linearised about a solution, within their ranges and no
        larger than a part `reach` of these; and the weighted square of the torque that they move."""
        blocks = []
        for of, (low, high) in ranges.items():
            value, most = self.value(shapes, of), reach * (high - low)
            lower, upper = np.array([max(low - value, -most)]), np.array([min(high - value, most)])
            blocks.append(replace(self.derivative(shapes, solved.coefficients, of), lower=lower, upper=upper))
        begin = np.concatenate([solved.coefficients, solved.shifts, np.zeros(len(blocks))])
        system, own = self.system(shapes, skew, blocks), slice(-len(blocks), None)
        found = system.towards(begin, self.inertia_cuts)[own]
        return dict(zip(ranges, map(float, found), strict=True)), float(found @ system.normal[own, own] @ found)

    def joint_rows(self, joint: int, at: float) -> JointRows:
        """A joint's rows (0-based), its torque taken `at` samples."""
        key = (joint, at, float(self.weights[joint]))
        if key not in self._joints:
            motion, use = self.motion, self.motion.moving(joint)
            self._joints = {k: rows for k, rows in self._joints.items() if k[0] != joint}
            tau = motion.torque(joint, at)
            self._joints[key] = JointRows(
                tau,
                use,
                motion.row_piece(joint),
                weight=key[2],
                eliminated=motion.eliminated(joint),
                unaffected=motion.unaffected(joint),
                dependent=motion.dependent(joint, use),
                noise=motion.perturbed.torque(joint, at) - tau if motion.feeds_back(joint) else None,
                version=("torque", at),
            )
        return self._joints[key]

    def _late(self, skew: Skew) -> list[Block]:
        """What the rows lose as the torque is taken a sample later, where that shift is unknown."""
        n = self.model.n
        count = {"no": 0, "shared": 1, "each": n}[skew.unknown]
        if not count:
            return []
        columns = {}
        for i in range(n):
            late = -self.regressors.skew(i, skew.at)
            rows = np.zeros((1 + count, len(late)))
            rows[1 + (i if skew.unknown == "each" else 0)] = late
            columns[i] = Columns(rows)
        free = np.full(count, np.inf)
        return [Block((LATE, count), columns, -free, free, version=(LATE, count, skew.at))]

    def solve(self, shapes: Mapping[Term, Values], skew: Skew) -> Solved:
        """Everything that is linear, for these shapes; D stays positive definite."""
        system = self.system(shapes, skew)
        theta, held = system.least(self.inertia_cuts), dict[int, float]()
        for place, stated, size in self.known_sizes:
            free = np.flatnonzero((theta > system.bounds[0]) & (theta < system.bounds[1]))
            others, whole = np.setdiff1d(free, place), system.normal
            across = whole[np.ix_(others, place)]
            square = whole[np.ix_(place, place)] - across.T @ inverse(whole[np.ix_(others, others)]) @ across
            price = np.log(system.count) * weighted(system.residual(theta), self.weights) / system.count
            change = of_size(square, stated + theta[place], size, near=stated, slack=price) - stated
            held |= dict(zip(place.tolist(), change.tolist(), strict=True))
        if held:
            theta = system.least(self.inertia_cuts, held)
        own, shifts = theta[: self.layout.size], theta[self.layout.size :]
        return Solved(own, shifts, system.normal, list(system.residual(theta)))

    @cached_property
    def known_sizes(self) -> list[tuple[NDArray[np.intp], Array, float]]:
        """Of terms that change a vector of a known size: places of the changes among the unknowns, the model file's
        vector, and the size."""
        found = []
        for term in self.layout.terms:
            vector = known_vector(self.model, term)
            if vector and self.model.library.effects[term.effect].sized and not without_weight(self.motion):
                place = np.arange(self.layout.slices[term].start, self.layout.slices[term].stop)
                found.append((place, *vector))
        return found

    def directions(self, theta: Array) -> Array:
        """(K', F) orthonormal directions in which unknowns may move from theta (K',), the layout's first, so that known
        sizes are kept."""
        found, apart = np.eye(len(theta)), []
        for place, stated, _ in self.known_sizes:
            flat = tangents(stated + theta[place])
            found[np.ix_(place, place[: flat.shape[1]])] = flat
            apart += place[flat.shape[1] :].tolist()
        return np.delete(found, apart, axis=1)

    def errors(self, ways: Sequence[Mapping[Term, Values]], skew: Skew) -> Array:
        """(S,) weighted squared errors of the solutions for these shapes."""
        return np.array([weighted(self.solve(shapes, skew).residual, self.weights) for shapes in ways])

    def foresee(self, term: Term, choices: Sequence[Values], shapes: Mapping[Term, Values]) -> None:
        """Make columns ready, at once, for solutions with these shapes of one term and all else as in `shapes`."""
        given = self._given(term, shapes)
        for joint in joints_of(self.model, term):
            for regressors in (self.regressors, self.regressors.perturbed):
                regressors.foresee(term, joint, choices, given)

    def inertia_cuts(self, theta: Array) -> Array | None:
        """(C, len(theta)) cuts c with c·theta > 0, of which a D(q) that is not positive definite violates one; None if
        it is."""
        lumps, motion = theta[self.layout.lumps], self.motion
        if motion.rigid_given:
            return None
        # A cut holds for every fit along this motion: what a fit met before is most of what it will meet.
        if (self._met @ lumps > 0).all():
            met = inertia_cuts(self.model, configurations([p.q for p in motion.pieces]), lumps)
            if met is None:
                return None
            most = 40
            self._met = np.vstack([self._met, met])[-most:]
        cuts = np.zeros((len(self._met), len(theta)))
        cuts[:, self.layout.lumps] = self._met
        return cuts

    def prediction(self, theta: Array, shapes: Mapping[Term, Values]) -> Prediction:
        """What theta (K,) and shapes say of the model: base parameters, and a value of every effect's parameter."""
        values = {t: self._values(t, theta, shapes[t]) for t in self.layout.terms}
        return Prediction(theta[self.layout.lumps], values, self.rotors)

    def _values(self, term: Term, theta: Array, shape: Values) -> Values:
        values = self.model.library.recover(term.effect, theta[self.layout.slices[term]], shape)
        # What came out without any size has no place either (a spring's rest): any will do, as it makes no torque.
        return {name: value if np.isfinite(value) else 0.0 for name, value in values.items()}
