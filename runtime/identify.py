"""Identification: base inertial parameters and effects of all joints at once, from recordings.

Linear coefficients are solved exactly for every trial of the shape parameters and of the skew between
torque and encoder (variable projection, Golub & Pereyra 1973). The inertia matrix stays positive
definite over the recorded motion, and effects stay within their physical bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from runtime import grids
from runtime.band import choose_band, rigid_inertia
from runtime.constrained import inverse, minimise
from runtime.covariance import Inference, infer
from runtime.loader import Model
from runtime.motion import Motion, prepare
from runtime.recording import Recording
from runtime.terms import PREDICTED, Prediction, Regressors, Structure, Term, Values, joints_of, structure

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

HOLD = (-0.25, 1.0)
"""Samples between a torque and the encoder reading beside it that a hold can explain."""
NOMINAL_SKEW = 0.5
_SKEW_RANGE = (-3.5, 3.5)
_SKEWS_APART = 0.25
_SKEW_SIGMAS = 4.0
_PASSES = 3
_CONFIGURATIONS = 60
_KEPT_SYSTEMS = 8


@dataclass(frozen=True)
class Fit:
    """The solution of one least-squares problem.

    prediction    inertial parameters and effects' values
    coefficients  (K,) linear unknowns in the order of `Layout.names`
    shapes        shape parameters by term
    skew          samples by which the torque is taken later
    skew_free     whether it was estimated, and is what a hold explains
    residual      per joint (M,), unweighted, zero in rows that do not count
    weights       (n,) 1/σ by which joints were weighted
    """

    prediction: Prediction
    coefficients: Array
    shapes: dict[Term, Values]
    skew: float
    skew_free: bool
    residual: list[Array]
    weights: Array


@dataclass(frozen=True)
class Layout:
    """Order of the linear unknowns: base inertial parameters, then each term's coefficients."""

    terms: tuple[Term, ...]
    slices: dict[Term, slice]
    lumps: slice
    lower: Array
    upper: Array

    @property
    def size(self) -> int:
        return len(self.lower)

    @classmethod
    def of(cls, model: Model, terms: Sequence[Term], rigid_given: bool) -> Layout:
        """rigid_given: the inertial parameters act on no torque and stay at the file's values."""
        start, slices = len(model.lumps), {}
        lower = [*model.lump_values] if rigid_given else [-np.inf] * start
        upper = [*model.lump_values] if rigid_given else [np.inf] * start
        for term in terms:
            info = model.library.effects[term.effect]
            slices[term] = slice(start, start + len(info.coefficients))
            start += len(info.coefficients)
            lower += [c.bounds[0] for c in info.coefficients]
            upper += [c.bounds[1] for c in info.coefficients]
        return cls(tuple(terms), slices, slice(0, len(model.lumps)), np.array(lower), np.array(upper))


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


class Problem:
    """Least squares of one structure on one motion, for any shapes and skew."""

    def __init__(self, model: Model, motion: Motion, terms: Sequence[Term], prediction: Prediction | None) -> None:
        self.model, self.motion = model, motion
        self.layout = Layout.of(model, terms, motion.rigid_given)
        self.regressors = Regressors(model, motion, prediction)
        self.weights = 1 / np.maximum(motion.band.torque_floor(), 1e-12)
        self._systems: dict[tuple[Any, ...], _System] = {}

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
                columns = regressors.columns(term, joint, shapes[term])
                fixed += columns[0]
                x[self.layout.slices[term]] = columns[1:]
        return x, fixed

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
                late = -self.regressors.skew(i)[use]
                cross = system.x @ late
                x = np.vstack([x, late])
                g = np.block([[g, cross[:, None]], [cross[None], np.array([[late @ late]])]])
                m, index = np.append(m, 0.0), np.append(index, size + columns.of(i))
            gram[np.ix_(index, index)] += self.weights[i] ** 2 * g
            moment[index] += self.weights[i] ** 2 * (x @ y + m)
            parts.append((x, y, use, index))
        free = np.full(columns.size, np.inf)
        lower, upper = np.append(self.layout.lower, -free), np.append(self.layout.upper, free)
        theta = minimise(gram, moment, lower, upper, self._inertia_cuts)
        residual = [_spread(y - theta[index] @ x, use) for x, y, use, index in parts]
        return Solved(theta[:size], theta[size:], gram, residual)

    def _system(self, joint: int, shapes: Mapping[Term, Values]) -> _System:
        """A joint's equations for these shapes; a search that moves one term leaves the other joints' as they are."""
        here = [t for t in self.layout.terms if joint in joints_of(self.model, t)]
        key = (joint, tuple((t, *shapes[t].values()) for t in here))
        if key not in self._systems:
            if len(self._systems) > _KEPT_SYSTEMS * self.model.n:
                self._systems.clear()
            use = self.motion.moving(joint)
            x, fixed = self.rows(joint, shapes)
            noise, fixed_noise = self.noise_rows(joint, shapes)
            x, noise = x[:, use], noise[:, use]
            self._systems[key] = _System(x, fixed[use], x @ x.T - noise @ noise.T, noise @ fixed_noise[use])
        return self._systems[key]

    def _inertia_cuts(self, theta: Array) -> Array | None:
        """(len(theta),) c with c·theta > 0 that a D(q) which is not positive definite violates; None if it is."""
        if self.motion.rigid_given:
            return None
        q = np.concatenate([p.q[:, :: max(1, p.q.shape[1] // _CONFIGURATIONS)] for p in self.motion.pieces], axis=1)
        value, vector = np.linalg.eigh(np.moveaxis(self.model.inertia(q, theta[self.layout.lumps]), 2, 0))
        worst = int(np.argmin(value[:, 0]))
        if value[worst, 0] > 0:
            return None
        v, at = vector[worst, :, 0], q[:, worst : worst + 1]
        cut = np.zeros(len(theta))
        for k in range(len(self.model.lumps)):
            unit = np.zeros(len(self.model.lumps))
            unit[k] = 1.0
            cut[k] = v @ self.model.inertia(at, unit)[:, :, 0] @ v
        return cut

    def prediction(self, theta: Array, shapes: Mapping[Term, Values]) -> Prediction:
        values = {t: self._values(t, theta, shapes[t]) for t in self.layout.terms}
        return Prediction(theta[self.layout.lumps], values)

    def _values(self, term: Term, theta: Array, shape: Values) -> Values:
        return self.model.library.recover(term.effect, theta[self.layout.slices[term]], shape)


def _start(problem: Problem, known: Structure, skew: Skew) -> dict[Term, Values]:
    """Shape values from the file where it states them, else the best of the grid, one term after another."""
    shapes: dict[Term, Values] = {}
    open_terms: list[tuple[Term, list[Values]]] = []
    for term in problem.layout.terms:
        names = [p.name for p in problem.model.library.effects[term.effect].shape]
        given = {k: v for k, v in known.get(term, {}).items() if k in names}
        choices = grids.points(problem.regressors, term)
        choices = list({tuple({**c, **given}.items()): {**c, **given} for c in choices}.values())
        shapes[term] = choices[len(choices) // 2]
        if len(choices) > 1:
            open_terms.append((term, choices))
    for term, choices in open_terms:
        errors = [_error(problem.solve({**shapes, term: c}, skew).residual, problem.weights) for c in choices]
        shapes[term] = choices[int(np.argmin(errors))]
    return shapes


def _error(residual: Sequence[Array], weights: Array) -> float:
    return float(sum(w**2 * (r @ r) for r, w in zip(residual, weights, strict=True)))


def solve(
    model: Model, motion: Motion, known: Structure, skew: float | None, start: Fit | None = None
) -> tuple[Problem, Fit]:
    """Fit all of a structure's parameters.

    known   active terms with the values from which the search starts (shapes; linear ones need none)
    skew    samples, or None to estimate it
    start   an earlier fit with at least some of the terms, for its shapes and prediction
    """
    terms = tuple(known)
    needs = [t for t in terms if _needs_prediction(model, t)]
    prediction = start.prediction if start else None
    shapes: dict[Term, Values] = dict(start.shapes) if start else {}
    if prediction is None and needs:
        _, plain = solve(model, motion, {t: v for t, v in known.items() if t not in needs}, skew)
        prediction, shapes = plain.prediction, dict(plain.shapes)
        start = plain
    at = skew if skew is not None else (start.skew if start else NOMINAL_SKEW)
    free = skew is None
    if free and any("predicted_rate" in model.library.effects[t.effect].signals for t in terms):
        # A delay is counted from the shift that a hold explains; both at once cannot be told apart.
        free = False
        at = NOMINAL_SKEW if model.n == 1 or start is None else start.skew
    problem, fit = _refine(model, motion, known, shapes, at, free, prediction)
    for _ in range(_PASSES - 1 if needs else 0):
        before = fit.prediction.lumps
        if not _drivable(model, motion, needs, fit.prediction):
            break
        problem, fit = _refine(model, motion, known, fit.shapes, fit.skew, free, fit.prediction)
        if np.allclose(before, fit.prediction.lumps, rtol=1e-3):
            break
    return problem, fit


def _drivable(model: Model, motion: Motion, terms: Sequence[Term], prediction: Prediction) -> bool:
    """Whether what hangs on every transmission has an inertia, without which its motion has no meaning."""
    regressors = Regressors(model, motion, prediction)
    own = [t.joint - 1 for t in terms if t.joint and "coupling" in model.library.effects[t.effect].signals]
    return all(float(np.min(s.get("link_inertia", i))) > 0 for s in regressors.signals for i in own)


def _needs_prediction(model: Model, term: Term) -> bool:
    return bool(PREDICTED & set(model.library.effects[term.effect].signals))


def _refine(
    model: Model,
    motion: Motion,
    known: Structure,
    shapes: dict[Term, Values],
    skew: float,
    free_skew: bool,
    prediction: Prediction | None,
) -> tuple[Problem, Fit]:
    problem = Problem(model, motion, tuple(known), prediction)
    missing = {t: v for t, v in known.items() if t not in shapes}
    at = Skew(skew, "shared" if free_skew else "no")
    found = _start(problem, {**known, **{t: s for t, s in shapes.items() if t in known}}, at) if missing else shapes
    shapes = {t: found[t] for t in known}
    hold = free_skew
    for _ in range(2):
        shapes = _search(problem, shapes, at)
        if free_skew:
            at, hold = _settled(problem, shapes, at)
        solved = problem.solve(shapes, at)
        count = np.array([max(1, motion.moving(i).sum()) for i in range(model.n)])
        rms = np.sqrt([r @ r for r in solved.residual] / count)
        problem.weights = 1 / np.maximum(rms, 1e-12)
        if model.n == 1:
            break
    solved = problem.solve(shapes, Skew(at.at))
    theta = solved.coefficients
    return problem, Fit(problem.prediction(theta, shapes), theta, shapes, at.at, hold, solved.residual, problem.weights)


def _settled(problem: Problem, shapes: dict[Term, Values], skew: Skew) -> tuple[Skew, bool]:
    """The shift that all joints share, and whether a hold explains it.

    Torque and encoders of all joints are sampled together. Where their shifts differ, or no hold explains them,
    something delays a torque: then the shift stays as near to that of a hold as a joint's is, and the delays
    are left to be found.
    """
    common = skew
    for _ in range(2):
        shift = float(problem.solve(shapes, replace(common, unknown="shared")).shifts[0])
        common = Skew(float(np.clip(common.at + shift, *_SKEW_RANGE)), "shared")
    solved = problem.solve(shapes, Skew(common.at, "each"))
    spread = np.sqrt(np.maximum(np.diagonal(inverse(solved.gram))[problem.layout.size :], 0.0))
    seen = spread > 0
    own, margin = (common.at + solved.shifts)[seen], _SKEW_SIGMAS * spread[seen]
    low, high = (own - margin).max(initial=-np.inf), (own + margin).min(initial=np.inf)
    if low - high < _SKEWS_APART and low <= HOLD[1] and high >= HOLD[0]:
        return replace(common, at=float(np.clip(common.at, *HOLD))), True
    nearest = float(own[np.argmin(np.abs(own - NOMINAL_SKEW))])
    held = problem.model.n > 1 and HOLD[0] <= nearest <= HOLD[1]
    return Skew(nearest if held else NOMINAL_SKEW), False


def _search(problem: Problem, shapes: dict[Term, Values], skew: Skew) -> dict[Term, Values]:
    """Shape parameters that minimise the weighted residual, from a start that a grid gave."""
    names, x0, lower, upper = [], [], [], []
    for term, shape in shapes.items():
        for parameter in problem.model.library.effects[term.effect].shape:
            if parameter.grid is not None and parameter.grid.continuous:
                values = grids.axis(problem.regressors, term, parameter, shape)
                low, high = float(values[0]), float(values[-1])
                names.append((term, parameter.name))
                lower.append(low)
                upper.append(high)
                x0.append(float(np.clip(shape[parameter.name], low, high)))
    if not x0:
        return shapes
    lo, scale = np.array(lower), np.array(upper) - np.array(lower)

    def unpack(z: Array) -> dict[Term, Values]:
        changed = {t: dict(s) for t, s in shapes.items()}
        for (term, name), value in zip(names, lo + z * scale, strict=True):
            changed[term][name] = float(value)
        return changed

    def residual(z: Array) -> Array:
        parts = problem.solve(unpack(z), skew).residual
        return np.concatenate([w * r for w, r in zip(problem.weights, parts, strict=True)])

    z0 = np.clip((np.array(x0) - lo) / scale, 1e-6, 1 - 1e-6)
    found = least_squares(residual, z0, bounds=(0.0, 1.0), diff_step=1e-4, xtol=1e-4, ftol=1e-6, max_nfev=12)
    return unpack(found.x)


@dataclass(frozen=True)
class Identification:
    """A fit with its uncertainty."""

    model: Model
    motion: Motion
    problem: Problem
    fit: Fit

    @cached_property
    def inference(self) -> Inference:
        return infer(self.problem, self.fit)

    @cached_property
    def uncorrected(self) -> Inference | None:
        """The same fit with no skew correction and no row left out; None where no skew was estimated."""
        if not self.fit.skew_free:
            return None
        every = replace(self.motion, standstill=np.zeros(self.model.n))
        return infer(*solve(self.model, every, {t: dict(v) for t, v in self.fit.shapes.items()}, 0.0, self.fit))

    def to_json(self) -> dict[str, Any]:
        """As `tendon identify --json`; intervals are 95 %."""
        document: dict[str, Any] = {
            "band": {"cutoff_hz": self.motion.band.cutoff, "reason": self.motion.band.reason},
            "skew": self.inference.skew_json(),
            **self.inference.to_json(self.model),
        }
        document["uncorrected"] = None if self.uncorrected is None else self.uncorrected.to_json(self.model)
        return document


def identify(model: Model, recordings: Sequence[Recording], skew: float | None = None) -> Identification:
    """Fit the model file's structure to recordings; `skew` in samples, None to estimate it."""
    return identify_motion(model, prepared(model, recordings), structure(model), skew)


def prepared(model: Model, recordings: Sequence[Recording]) -> Motion:
    """Recordings in the band that suits their noise and the model's inertia."""
    given = rigid_inertia(recordings)
    return prepare(recordings, choose_band(recordings, _diagonal(model) if given is None else given), model.library)


def identify_motion(
    model: Model, motion: Motion, known: Structure, skew: float | None = None, start: Fit | None = None
) -> Identification:
    """As `identify`, on a motion that is already prepared and for any structure."""
    return Identification(model, motion, *solve(model, motion, known, skew, start))


def _diagonal(model: Model) -> Array:
    """(n,) D_ii of the model file at q = 0."""
    return np.diagonal(model.inertia(np.zeros((model.n, 1)))[:, :, 0]).copy()
