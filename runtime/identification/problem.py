"""The least-squares problem of one structure on one motion: everything that is linear, solved exactly."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from runtime.identification.estimate import Estimate
from runtime.identification.regressors import Ahead, Regressors
from runtime.model.loader import LumpInfo, Model
from runtime.model.terms import Prediction, Term, Values, given, joints_of, structure
from runtime.motion.motion import Motion
from runtime.regression.system import Block, Columns, JointRows, LinearSystem

Array = NDArray[np.float64]


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


def least_inertia(model: Model, motion: Motion, lumps: Array) -> tuple[float, Array, Array]:
    """The smallest eigenvalue of D over configurations of the motion, kg m² (kg), with its direction (n,) and its
    configuration (n, 1); `lumps` are base inertial parameters."""
    q = configurations([p.q for p in motion.pieces])
    value, vector = np.linalg.eigh(_inertias(model, q, lumps))
    worst = int(np.argmin(value[:, 0]))
    return float(value[worst, 0]), vector[worst, :, 0], q[:, worst : worst + 1]


def _positive(model: Model, motion: Motion, lumps: Array) -> bool:
    """Whether D is positive definite at all of these configurations, in a tenth of the time."""
    try:
        np.linalg.cholesky(_inertias(model, configurations([p.q for p in motion.pieces]), lumps))
    except np.linalg.LinAlgError:
        return False
    return True


def configurations(stretches: Sequence[Array]) -> Array:
    """(n, N) some configurations of every stretch of motion (n, M); D changes slowly with the posture."""
    enough = 60
    return np.concatenate([q[:, :: max(1, q.shape[1] // enough)] for q in stretches], axis=1)


def _inertias(model: Model, q: Array, lumps: Array) -> Array:
    """(N, n, n) D at configurations q (n, N)."""
    return np.moveaxis(model.inertia(q, lumps), 2, 0)


def _arm(regressors: Regressors, joint: int) -> Array:
    return np.vstack([regressors.measured(joint)[None], regressors.rigid(joint)])


def _term(regressors: Regressors, joint: int, term: Term, shape: Values, given: Values) -> Array:
    return regressors.columns(term, joint, shape, given)


def _rotors(regressors: Regressors, joint: int) -> Array:
    own = regressors.acceleration(joint)
    rows = np.zeros((1 + regressors.model.n, len(own)))
    rows[1 + joint] = own
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
    ) -> None:
        self.model, self.motion = model, motion
        self.layout = LinearUnknowns.of(model, terms, motion.rigid_given)
        self.regressors = Regressors(model, motion, prediction, ahead)
        self.rotors: Mapping[int, float] = {} if prediction is None else prediction.rotors
        self.weights = 1 / np.maximum(motion.band.torque_floor(), 1e-12)
        self._last: LinearSystem | None = None
        self._joints: dict[tuple[int, float, float], JointRows] = {}

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
        for part in self._parts(shapes):
            if joint in part.joints:
                rows = part.rows(regressors, joint)
                fixed += rows[0]
                x[part.unknowns] = rows[1:]
        return x, fixed

    def _parts(self, shapes: Mapping[Term, Values]) -> Iterator[_Part]:
        """The arm's, then each term's, then the rotors'."""
        layout, every = self.layout, tuple(range(self.model.n))
        yield _Part("arm", every, layout.lumps, _arm, self.regressors)
        for term in layout.terms:
            shape, given = shapes[term], self._given(term, shapes)
            rows = partial(_term, term=term, shape=shape, given=given)
            key = (term, *shape.values(), *given.items())
            yield _Part(key, joints_of(self.model, term), layout.slices[term], rows, self.regressors)
        if self.motion.rigid_given:
            yield _Part("rotors", every, layout.rotors, _rotors, self.regressors)

    def _given(self, term: Term, shapes: Mapping[Term, Values]) -> Values:
        """Signals of a term that are shape parameters of others: of these shapes, not of an earlier fit."""
        library = self.model.library
        names = (name for name in library.effects[term.effect].signals if library.signal[name].needs == "effect")
        values = {name: given(library, shapes, name) for name in names}
        return {name: value for name, value in values.items() if value is not None}

    def system(self, shapes: Mapping[Term, Values], skew: Skew) -> LinearSystem:
        """All that is linear for these shapes, compensated for the encoders' noise. What an earlier one had of the same
        columns is not multiplied again."""
        layout, blocks = self.layout, []
        for part in self._parts(shapes):
            lower, upper, near = (x[part.unknowns] for x in (layout.lower, layout.upper, layout.stated))
            key = part.key[0] if isinstance(part.key, tuple) else part.key
            blocks.append(Block(key, part, lower, upper, near=near, version=part.key))
        joints = [self._joint(i, skew.at) for i in range(self.model.n)]
        self._last = LinearSystem.of(joints, [*blocks, *self._late(skew)], self._last)
        return self._last

    def _joint(self, joint: int, at: float) -> JointRows:
        """A joint's rows (0-based), its torque taken `at` samples."""
        key = (joint, at, float(self.weights[joint]))
        if key not in self._joints:
            motion, use = self.motion, self.motion.moving(joint)
            self._joints = {k: rows for k, rows in self._joints.items() if k[0] != joint}
            self._joints[key] = JointRows(
                motion.torque(joint, at),
                use,
                motion.row_piece(joint),
                weight=key[2],
                eliminated=motion.eliminated(joint),
                unaffected=motion.unaffected(joint),
                dependent=motion.dependent(joint, use),
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
            late = -self.regressors.skew(i)
            rows = np.zeros((1 + count, len(late)))
            rows[1 + (i if skew.unknown == "each" else 0)] = late
            columns[i] = Columns(rows)
        free = np.full(count, np.inf)
        return [Block(("late", count), columns, -free, free)]

    def solve(self, shapes: Mapping[Term, Values], skew: Skew) -> Solved:
        """Everything that is linear, for these shapes; D stays positive definite."""
        system = self.system(shapes, skew)
        theta = system.least(self.inertia_cut)
        own, shifts = theta[: self.layout.size], theta[self.layout.size :]
        return Solved(own, shifts, system.normal, list(system.residual(theta)))

    def errors(self, ways: Sequence[Mapping[Term, Values]], skew: Skew) -> Array:
        """(S,) weighted squared errors of the solutions for these shapes."""
        return np.array([weighted(self.solve(shapes, skew).residual, self.weights) for shapes in ways])

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
