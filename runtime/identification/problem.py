"""The least-squares problem of one structure on one motion: everything that is linear, solved exactly."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime.identification.estimate import Estimate
from runtime.identification.regressors import Ahead, Regressors
from runtime.identification.settings import INERTIA_CONFIGURATIONS, KEPT_EQUATIONS, NEUTRAL_INERTIA, SAME_ERROR
from runtime.model.loader import LumpInfo, Model
from runtime.model.terms import Prediction, Term, Values, given, joints_of, structure
from runtime.motion.motion import Motion
from runtime.regression.joint_equations import Alternatives, Block, JointEquations
from runtime.regression.least_squares import minimise

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Fit:
    """The solution of one least-squares problem.

    prediction    inertial parameters and effects' values
    coefficients  (K,) linear unknowns in the order of `LinearUnknowns.names`
    shapes        shape parameters by term
    skew          samples by which the torque is taken later
    skew_free     whether it was estimated, and is what a hold explains
    residual      per joint (M,), unweighted, zero in rows that do not count
    weights       (n,) 1/σ by which joints were weighted
    ahead         by how much torques lead the motion beyond what a hold explains; None where nothing is beyond it
    witnessed     terms that a further sensor shows and the torque does not, with their parameters; no part of the fit
    """

    prediction: Prediction
    coefficients: Array
    shapes: dict[Term, Values]
    skew: float
    skew_free: bool
    residual: list[Array]
    weights: Array
    ahead: Ahead | None = None
    witnessed: Mapping[Term, Mapping[str, Estimate]] = field(default_factory=dict)


@dataclass(frozen=True)
class LinearUnknowns:
    """Order of the linear unknowns: base inertial parameters, each term's coefficients, then inertias at the motors.

    rotors        one a joint, where the user's own model gives the rigid-body torque: what that lacks of the rotors
    lower, upper  (K,) bounds     stated  (K,) what the model file says, a neutral value where nothing: what no row
    tells stays there
    """

    terms: tuple[Term, ...]
    slices: dict[Term, slice]
    lumps: slice
    rotors: slice
    lower: Array
    upper: Array
    stated: Array

    @property
    def size(self) -> int:
        """Number of unknowns, K."""
        return len(self.lower)

    @classmethod
    def of(cls, model: Model, terms: Sequence[Term], rigid_given: bool) -> LinearUnknowns:
        """rigid_given: the inertial parameters act on no torque and stay at the file's values."""
        start, slices, known = len(model.lumps), {}, structure(model)
        stated = [_neutral(lump) if lump.value is None else lump.value for lump in model.lumps]
        lower = [*stated] if rigid_given else [-np.inf] * start
        upper = [*stated] if rigid_given else [np.inf] * start
        for term in terms:
            info = model.library.effects[term.effect]
            slices[term] = slice(start, start + len(info.coefficients))
            start += len(info.coefficients)
            lower += [c.bounds[0] for c in info.coefficients]
            upper += [c.bounds[1] for c in info.coefficients]
            # The coefficients of a form are others than the file's parameters.
            values = known.get(term, {}) if info.recover is None else {}
            stated += [values.get(c.name, 0.0) for c in info.coefficients]
        rotors = slice(start, start + (model.n if rigid_given else 0))
        count = rotors.stop - rotors.start
        # No rotor has less than none: at the least, all that the file states was in the user's model too often.
        lower += [-(joint.rotor_inertia or 0.0) for joint in model.joints[:count]]
        bounds = map(np.array, (lower, upper + [np.inf] * count, stated + [0.0] * count))
        return cls(tuple(terms), slices, slice(0, len(model.lumps)), rotors, *bounds)


def _neutral(lump: LumpInfo) -> float:
    """Of a base inertial parameter that the file leaves open: next to nothing for an inertia or a mass that moves with
    its own joint, so that D is positive definite whatever the data tell; 0 for the others."""
    return NEUTRAL_INERTIA if lump.name in (f"J{lump.joint}", f"M{lump.joint}") else 0.0


class _Part(NamedTuple):
    """What the arm or a term has of a joint's rows: equal ones have one key; unknowns to which its columns belong; and
    (1 + k, M) the part without free coefficient and the columns."""

    key: Hashable
    unknowns: slice
    rows: Callable[[Regressors], Array]


@dataclass(frozen=True)
class _SkewColumns:
    """Unknown shifts of the torque: none, one for all joints, or one a joint."""

    size: int
    shared: bool

    def of(self, joint: int) -> int:
        return 0 if self.shared else joint


@dataclass(frozen=True)
class Skew:
    """Samples `at` which the torque is taken; further shifts from there are unknown: "no", "shared" or "each"."""

    at: float
    unknown: Literal["no", "shared", "each"] = "no"

    def columns(self, n: int) -> _SkewColumns:
        return _SkewColumns({"no": 0, "shared": 1, "each": n}[self.unknown], self.unknown == "shared")


@dataclass(frozen=True)
class Solved:
    """coefficients (K,); shifts of the torque from where it was taken, samples; Gram matrix of both; residuals (M,)."""

    coefficients: Array
    shifts: Array
    gram: Array
    residual: list[Array]


def _spread(values: Array, use: Mask) -> Array:
    out = np.zeros(len(use))
    out[use] = values
    return out


def weighted(residual: Sequence[Array], weights: Array) -> float:
    """Weighted squared error of the joints' residuals."""
    return float(sum(w**2 * (r @ r) for r, w in zip(residual, weights, strict=True)))


def first_least(errors: Array) -> int:
    """Index of the first of the least of squared errors (S,); what rounding tells apart is equal."""
    return int(np.argmax(errors <= (1 + SAME_ERROR) * errors.min()))


def least_inertia(model: Model, motion: Motion, lumps: Array) -> tuple[float, Array, Array]:
    """The smallest eigenvalue of D over configurations of the motion, kg m² (kg), with its direction (n,) and its
    configuration (n, 1); `lumps` are base inertial parameters."""
    q = _configurations(motion)
    value, vector = np.linalg.eigh(_inertias(model, q, lumps))
    worst = int(np.argmin(value[:, 0]))
    return float(value[worst, 0]), vector[worst, :, 0], q[:, worst : worst + 1]


def _positive(model: Model, motion: Motion, lumps: Array) -> bool:
    """Whether D is positive definite at all of these configurations, in a tenth of the time."""
    try:
        np.linalg.cholesky(_inertias(model, _configurations(motion), lumps))
    except np.linalg.LinAlgError:
        return False
    return True


def _configurations(motion: Motion) -> Array:
    """(n, N) all over the motion."""
    return np.concatenate([p.q[:, :: max(1, p.q.shape[1] // INERTIA_CONFIGURATIONS)] for p in motion.pieces], axis=1)


def _inertias(model: Model, q: Array, lumps: Array) -> Array:
    """(N, n, n) D at configurations q (n, N)."""
    return np.moveaxis(model.inertia(q, lumps), 2, 0)


class Problem:
    """Least squares of one structure on one motion, for any shapes and skew."""

    def __init__(
        self,
        model: Model,
        motion: Motion,
        terms: Sequence[Term],
        prediction: Prediction | None,
        ahead: Ahead | None = None,
    ) -> None:
        self.model, self.motion = model, motion
        self.layout = LinearUnknowns.of(model, terms, motion.rigid_given)
        self.regressors = Regressors(model, motion, prediction, ahead)
        self.rotors: Mapping[int, float] = {} if prediction is None else prediction.rotors
        self.weights = 1 / np.maximum(motion.band.torque_floor(), 1e-12)
        self._equations: dict[tuple[Hashable, ...], JointEquations] = {}
        self._last: dict[int, JointEquations] = {}
        self._right_sides: dict[int, tuple[JointEquations, float, Array, Array]] = {}
        self._lateness: dict[Hashable, Block] = {}

    def with_rotors(self, rotors: Mapping[int, float]) -> Problem:
        """The same with other inertias of rotors that the model file leaves out, by joint (0-based)."""
        prediction = self.regressors.prediction
        assert prediction is not None
        made = Problem(self.model, self.motion, self.layout.terms, replace(prediction, rotors=dict(rotors)))
        made.weights = self.weights
        return made

    def rows(self, joint: int, shapes: Mapping[Term, Values]) -> tuple[Array, Array]:
        """Regressor (K, M) and the part without free coefficient (M,) of a joint's torque (0-based)."""
        return self._rows(self.regressors, joint, shapes)

    def noise_rows(self, joint: int, shapes: Mapping[Term, Values]) -> tuple[Array, Array]:
        """What a realisation of the encoders' noise adds to `rows`."""
        (x, fixed), (noisy, noisy_fixed) = (
            self._rows(r, joint, shapes) for r in (self.regressors, self.regressors.perturbed)
        )
        return noisy - x, noisy_fixed - fixed

    def _rows(self, regressors: Regressors, joint: int, shapes: Mapping[Term, Values]) -> tuple[Array, Array]:
        x = np.zeros((self.layout.size, len(self.motion.row_piece(joint))))
        fixed = np.zeros(x.shape[1])
        for part in self._parts(joint, shapes):
            rows = part.rows(regressors)
            fixed += rows[0]
            x[part.unknowns] = rows[1:]
        return x, fixed

    def _parts(self, joint: int, shapes: Mapping[Term, Values]) -> Iterator[_Part]:
        """Of a joint's rows (0-based): the arm's, then each term's, then the rotor's."""
        layout = self.layout
        yield _Part("arm", layout.lumps, lambda r: np.vstack([r.measured(joint)[None], r.rigid(joint)]))
        for term in layout.terms:
            if joint in joints_of(self.model, term):
                shape, given = shapes[term], self._given(term, shapes)
                columns = partial(Regressors.columns, term=term, joint=joint, shape=shape, given=given)
                yield _Part((term, *shape.values(), *given.items()), layout.slices[term], columns)
        if self.motion.rigid_given:
            own = slice(layout.rotors.start + joint, layout.rotors.start + joint + 1)
            yield _Part("rotor", own, lambda r: np.stack([np.zeros_like(r.acceleration(joint)), r.acceleration(joint)]))

    def _given(self, term: Term, shapes: Mapping[Term, Values]) -> Values:
        """Signals of a term that are shape parameters of others: of these shapes, not of an earlier fit."""
        library = self.model.library
        names = (name for name in library.effects[term.effect].signals if library.signal[name].needs == "effect")
        values = {name: given(library, shapes, name) for name in names}
        return {name: value for name, value in values.items() if value is not None}

    def solve(self, shapes: Mapping[Term, Values], skew: Skew) -> Solved:
        """Everything that is linear, compensated for the encoders' noise, for these shapes."""
        size = self.layout.size + skew.columns(self.model.n).size
        gram, moment = np.zeros((size, size)), np.zeros(size)
        parts = []
        for i in range(self.model.n):
            weight, equations = self.weights[i] ** 2, self._of_joint(i, shapes, skew)
            y, own = self._right_side(i, equations, skew.at)
            here = equations.unknowns
            gram[here[:, None], here] += weight * equations.gram
            moment[here] += weight * own
            parts.append((equations, y))
        theta = self._least(gram, moment)
        residual = [
            _spread(y - equations.torque(theta[equations.unknowns]), self.motion.moving(i))
            for i, (equations, y) in enumerate(parts)
        ]
        return Solved(theta[: self.layout.size], theta[self.layout.size :], gram, residual)

    def errors(self, ways: Sequence[Mapping[Term, Values]], skew: Skew) -> Array:
        """(S,) weighted squared errors of the solutions for these shapes; what they share is multiplied once."""
        size = self.layout.size + skew.columns(self.model.n).size
        grams, moments = np.zeros((len(ways), size, size)), np.zeros((len(ways), size))
        parts = []
        for i in range(self.model.n):
            weight, one = self.weights[i] ** 2, self._alternatives(i, ways, skew)
            y, here = self.motion.torque(i, skew.at)[self.motion.moving(i)], one.unknowns
            grams[:, here[:, None], here] += weight * one.grams
            moments[:, here] += weight * one.moments(y)
            parts.append((weight, one, y))
        theta = np.array([self._least(gram, moment) for gram, moment in zip(grams, moments, strict=True)])
        return np.sum([weight * one.errors(y, theta[:, one.unknowns]) for weight, one, y in parts], axis=0)

    def _least(self, gram: Array, moment: Array) -> Array:
        """(K + shifts,) within the bounds; shifts of the torque have none."""
        free = np.full(len(moment) - self.layout.size, np.inf)
        lower, upper = np.append(self.layout.lower, -free), np.append(self.layout.upper, free)
        stated = np.append(self.layout.stated, np.zeros(len(free)))
        return minimise(gram, moment, lower, upper=upper, violated=self.inertia_cut, near=stated)

    def _right_side(self, joint: int, equations: JointEquations, at: float) -> tuple[Array, Array]:
        """(m,) a joint's torque, taken `at` samples, less what has no free coefficient, and (K,) its moment with the
        columns, compensated; a search that moves another joint's term leaves them as they are."""
        kept = self._right_sides.get(joint)
        if kept is None or kept[0] is not equations or kept[1] != at:
            y = self.motion.torque(joint, at)[self.motion.moving(joint)] - equations.fixed
            kept = self._right_sides[joint] = (equations, at, y, equations.moment(y) + equations.noise_moment)
        return kept[2], kept[3]

    def _of_joint(self, joint: int, shapes: Mapping[Term, Values], skew: Skew) -> JointEquations:
        """A joint's equations for these shapes; a search that moves one term leaves the other joints' as they are, and
        of its own joint's the others' columns."""
        parts, late = list(self._parts(joint, shapes)), self._late(joint, skew)
        key = (joint, *(part.key for part in parts), *(block.key for block in late))
        if key not in self._equations:
            if len(self._equations) > KEPT_EQUATIONS * self.model.n:
                self._equations.clear()
            last = self._last.get(joint)
            there = {} if last is None else {block.key: block for block in last.blocks}
            blocks = [there.get(part.key) or self._block(part, joint) for part in parts]
            self._equations[key] = self._last[joint] = JointEquations.of([*blocks, *late], last)
        return self._equations[key]

    def _alternatives(self, joint: int, ways: Sequence[Mapping[Term, Values]], skew: Skew) -> Alternatives:
        """A joint's equations (0-based) for each of these shapes."""
        whole = self._of_joint(joint, ways[0], skew)
        slots = list(zip(*(self._parts(joint, shapes) for shapes in ways), strict=True))
        other = [k for k, slot in enumerate(slots) if len({part.key for part in slot}) > 1]
        same = [block for k, block in enumerate(whole.blocks) if k not in other]
        own = [[self._block(slots[k][way], joint) for k in other] for way in range(len(ways))]
        return Alternatives.of(JointEquations.of(same, whole), own)

    def _block(self, part: _Part, joint: int) -> Block:
        use = self.motion.moving(joint)
        rows, again = (part.rows(r)[:, use] for r in (self.regressors, self.regressors.perturbed))
        return Block(part.key, np.arange(part.unknowns.start, part.unknowns.stop), rows, again - rows)

    def _late(self, joint: int, skew: Skew) -> list[Block]:
        """What a joint's rows lose as its torque is taken a sample later, where that shift is unknown."""
        columns = skew.columns(self.model.n)
        if not columns.size:
            return []
        key = ("late", self.layout.size + columns.of(joint))
        if (joint, key) not in self._lateness:
            late = -self.regressors.skew(joint)[self.motion.moving(joint)]
            rows = np.stack([np.zeros_like(late), late])
            self._lateness[joint, key] = Block(key, np.array(key[1:]), rows, np.zeros_like(rows))
        return [self._lateness[joint, key]]

    def foresee(self, term: Term, choices: Sequence[Values], shapes: Mapping[Term, Values]) -> None:
        """Make columns ready, at once, for solutions with these shapes of one term and all else as in `shapes`."""
        given = self._given(term, shapes)
        for joint in joints_of(self.model, term):
            for regressors in (self.regressors, self.regressors.perturbed):
                regressors.foresee(term, joint, choices, given)

    def inertia_cut(self, theta: Array) -> Array | None:
        """(len(theta),) c with c·theta > 0 that a D(q) which is not positive definite violates; None if it is."""
        if self.motion.rigid_given or _positive(self.model, self.motion, theta[self.layout.lumps]):
            return None
        least, v, at = least_inertia(self.model, self.motion, theta[self.layout.lumps])
        if least > 0:
            return None
        # Of the torque only D(q) q̈ grows with acceleration: v of it, times v, is vᵀ D(q) v for every lump at once.
        still, twice = np.zeros((len(v), 2)), np.repeat(at, 2, axis=1)
        regressor = self.model.regressor(twice, still, np.stack([v, still[:, 0]], axis=1))
        cut = np.zeros(len(theta))
        cut[self.layout.lumps] = v @ (regressor[:, :, 0] - regressor[:, :, 1])
        return cut

    def prediction(self, theta: Array, shapes: Mapping[Term, Values]) -> Prediction:
        """What theta (K,) and shapes say of the model: base parameters, and a value of every effect's parameter."""
        values = {t: self._values(t, theta, shapes[t]) for t in self.layout.terms}
        return Prediction(theta[self.layout.lumps], values, self.rotors)

    def _values(self, term: Term, theta: Array, shape: Values) -> Values:
        values = self.model.library.recover(term.effect, theta[self.layout.slices[term]], shape)
        # What came out without any size has no place either (a spring's rest): any will do, as it makes no torque.
        return {name: value if np.isfinite(value) else 0.0 for name, value in values.items()}
