"""The least-squares problem of one structure on one motion: everything that is linear, solved exactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from runtime.estimation.estimate import Estimate
from runtime.estimation.least_squares import minimise
from runtime.estimation.regressors import Ahead, Regressors
from runtime.estimation.settings import INERTIA_CONFIGURATIONS, KEPT_SYSTEMS, NEUTRAL_INERTIA
from runtime.model.loader import LumpInfo, Model
from runtime.model.terms import Prediction, Term, Values, given, joints_of, structure
from runtime.motion.motion import Motion

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


@dataclass(frozen=True)
class _System:
    """A joint's rows that count: regressor (K, m), fixed part (m,), compensated Gram matrix, noise's moment."""

    x: Array
    fixed: Array
    gram: Array
    noise_moment: Array


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
        self._systems: dict[tuple[Any, ...], _System] = {}

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
        rigid = regressors.rigid(joint)
        x = np.zeros((self.layout.size, rigid.shape[1]))
        x[self.layout.lumps] = rigid
        fixed = regressors.measured(joint).copy()
        for term in self.layout.terms:
            if joint in joints_of(self.model, term):
                columns = regressors.columns(term, joint, shapes[term], self._given(term, shapes))
                fixed += columns[0]
                x[self.layout.slices[term]] = columns[1:]
        if self.motion.rigid_given:
            x[self.layout.rotors.start + joint] = regressors.acceleration(joint)
        return x, fixed

    def _given(self, term: Term, shapes: Mapping[Term, Values]) -> Values:
        """Signals of a term that are shape parameters of others: of these shapes, not of an earlier fit."""
        library = self.model.library
        values = {name: given(library, shapes, name) for name in library.effects[term.effect].signals}
        return {name: value for name, value in values.items() if value is not None}

    def solve(self, shapes: Mapping[Term, Values], skew: Skew) -> Solved:
        """Everything that is linear, compensated for the encoders' noise, for these shapes."""
        size, columns = self.layout.size, skew.columns(self.model.n)
        gram = np.zeros((size + columns.size, size + columns.size))
        moment = np.zeros(len(gram))
        parts = []
        for i in range(self.model.n):
            use = self.motion.moving(i)
            system = self._system(i, shapes)
            y = self.motion.torque(i, skew.at)[use] - system.fixed
            x, g, m = system.x, system.gram, system.noise_moment
            index = np.arange(size)
            if columns.size:
                late = -self.regressors.skew(i, skew.at)[use]
                cross = system.x @ late
                x = np.vstack([x, late])
                g = np.block([[g, cross[:, None]], [cross[None], np.array([[self.regressors.skew_square(i, late)]])]])
                m, index = np.append(m, 0.0), np.append(index, size + columns.of(i))
            gram[np.ix_(index, index)] += self.weights[i] ** 2 * g
            moment[index] += self.weights[i] ** 2 * (x @ y + m)
            parts.append((x, y, use, index))
        free = np.full(columns.size, np.inf)
        lower, upper = np.append(self.layout.lower, -free), np.append(self.layout.upper, free)
        stated = np.append(self.layout.stated, np.zeros(columns.size))
        theta = minimise(gram, moment, lower, upper, self.inertia_cut, stated)
        residual = [_spread(y - theta[index] @ x, use) for x, y, use, index in parts]
        return Solved(theta[:size], theta[size:], gram, residual)

    def _system(self, joint: int, shapes: Mapping[Term, Values]) -> _System:
        """A joint's equations for these shapes; a search that moves one term leaves the other joints' as they are."""
        here = [t for t in self.layout.terms if joint in joints_of(self.model, t)]
        key = (joint, tuple((t, *shapes[t].values()) for t in here))
        if key not in self._systems:
            if len(self._systems) > KEPT_SYSTEMS * self.model.n:
                self._systems.clear()
            use = self.motion.moving(joint)
            x, fixed = self.rows(joint, shapes)
            noise, fixed_noise = self.noise_rows(joint, shapes)
            x, noise = x[:, use], noise[:, use]
            self._systems[key] = _System(x, fixed[use], x @ x.T - noise @ noise.T, noise @ fixed_noise[use])
        return self._systems[key]

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
