"""Every effect of the library as a candidate for what a fitted model lacks.

A candidate is a block of columns with a grid over its shape parameters. The base model's coefficients,
the linearised shape parameters and the skew stay free beside it, so that a candidate gets credit only
for torque that the base cannot produce. Effects of the whole arm are judged on all joints' rows at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from runtime import grids
from runtime.covariance import shape_derivative, shape_steps
from runtime.evidence import Block, Rows, Solution, time_folds
from runtime.identify import SKEW_RANGE, Fit, Problem
from runtime.terms import Regressors, Term, Values, joints_of

Array = NDArray[np.float64]

_KEPT_SHAPES = 6
_REFINE_STEPS = 40


@dataclass(frozen=True)
class Candidate:
    """A term at its best shape. `choices`: the grid's best shapes and blocks, for an honest cross-validation."""

    term: Term
    rows: Rows
    shape: Values
    shapes_searched: int
    block: Block
    choices: tuple[tuple[Values, Block], ...]
    solution: Solution
    at_edge: bool

    @property
    def parameters(self) -> int:
        """Free parameters of base and candidate."""
        return self.rows.rank(self.block) + self.shapes_searched


@dataclass(frozen=True)
class _JointRows:
    """y (M,), base (b, M), noise (b + 1, M) and the bounds (b, 2) of the coefficients at one joint."""

    y: Array
    base: Array
    noise: Array
    bounds: Array


@dataclass
class Field:
    """A fitted model as the ground on which candidates compete."""

    problem: Problem
    fit: Fit

    def __post_init__(self) -> None:
        self.model, self.motion = self.problem.model, self.problem.motion
        self.regressors = Regressors(self.model, self.motion, self.fit.prediction)
        self._rows: dict[tuple[tuple[int, ...], tuple[Term, ...], bool], Rows] = {}

    def terms(self, joint: int) -> list[Term]:
        """What could be missing at a joint (0-based); effects of the whole arm stand at the first joint."""
        active = set(self.problem.layout.terms)
        covered = {g for t in active for g in self._generalised_at(t, joint)}
        found = []
        for name, info in self.model.library.effects.items():
            if info.scope == "contact" and self.model.contact is None:
                continue
            if info.scope in ("arm", "contact") and joint > 0:
                continue
            if info.scope == "joints" and joint + 1 >= self.model.n:
                continue
            term = Term(name, joint + 1 if info.scope in ("joint", "joints") else None)
            if term not in active and term not in covered and self._possible(term, joint):
                found.append(term)
        return found

    def _generalised_at(self, term: Term, joint: int) -> list[Term]:
        generalises = self.model.library.effects[term.effect].generalises
        return [Term(g, joint + 1) for g in generalises] if term.joint == joint + 1 else []

    def _possible(self, term: Term, joint: int) -> bool:
        signals = self.model.library.effects[term.effect].signals
        if "plate_y" in signals and Term("plate") not in self.problem.layout.terms:
            return False
        if "predicted_rate" in signals and self.skew_inside:
            # A delay that a hold explains has been taken out as skew; there is nothing left to find.
            return False
        if "level" in signals:
            return bool(np.any(np.asarray(self.regressors.signals[0].get("level", joint)) > 0))
        return True

    @property
    def skew_inside(self) -> bool:
        """Whether the estimated skew is one that a hold explains, so that it may adapt beside candidates."""
        low, high = SKEW_RANGE
        return low + 0.01 < self.fit.skew < high - 0.01

    def rows(self, joints: tuple[int, ...], without: tuple[Term, ...] = ()) -> Rows:
        """Torque and base regressors of one joint, or of several stacked and weighted by their noise."""
        key = (joints, without, self.skew_inside)
        if key not in self._rows:
            self._rows[key] = self._stack(joints, without)
        return self._rows[key]

    def _stack(self, joints: tuple[int, ...], without: tuple[Term, ...]) -> Rows:
        parts = [self._joint_rows(i, without) for i in joints]
        weights = self.weights(joints)
        size = sum(len(part.base) for part in parts)
        base = np.zeros((size, sum(len(part.y) for part in parts)))
        noise = np.zeros((size + 1, base.shape[1]))
        row = column = 0
        for part, weight in zip(parts, weights, strict=True):
            at = np.s_[row : row + len(part.base), column : column + len(part.y)]
            base[at], noise[at] = weight * part.base, weight * part.noise[:-1]
            noise[-1, at[1]] = weight * part.noise[-1]
            row, column = at[0].stop, at[1].stop
        use = np.concatenate([self.motion.moving(i) for i in joints])
        fold = np.concatenate([time_folds(self.motion.moving(i)) for i in joints])
        pieces = self.motion.row_piece.max() + 1
        piece = np.concatenate([self.motion.row_piece + k * pieces for k in range(len(joints))])
        y = np.concatenate([w * part.y for part, w in zip(parts, weights, strict=True)])
        bounds = np.vstack([part.bounds for part in parts])
        rows = Rows.levelled(y, base, noise, (bounds[:, 0], bounds[:, 1]), use, piece, fold)
        return replace(rows, level=self.rows(joints).level) if without else rows

    def weights(self, joints: tuple[int, ...]) -> Array:
        """1 for the first joint; for others the inverse of their residuals relative to the first's."""
        rms = np.array([self.rms(i) for i in joints])
        return np.where(rms > 0, rms[0] / np.where(rms > 0, rms, 1.0), 0.0)

    def rms(self, joint: int) -> float:
        """Of the fitted model's residual at a joint (0-based)."""
        use = self.motion.moving(joint)
        return float(np.sqrt(np.mean(self.fit.residual[joint][use] ** 2))) if use.any() else 0.0

    def _joint_rows(self, joint: int, without: tuple[Term, ...]) -> _JointRows:
        x, fixed = self.problem.rows(joint, self.fit.shapes)
        x_noise, fixed_noise = self.problem.noise_rows(joint, self.fit.shapes)
        y = self.motion.torque(joint, self.fit.skew) - fixed
        slices = [self.problem.layout.slices[t] for t in without]
        keep = np.ones(len(x), dtype=bool)
        for part in slices:
            keep[part] = False
        keep &= np.any(x != 0, axis=1)
        rows = [x[keep]]
        for term, name, step in shape_steps(self.problem, self.fit):
            if term not in without and joint in joints_of(self.model, term):
                rows.append(shape_derivative(self.problem, self.fit, term, name, step, joint)[None])
        if self.skew_inside:
            rows.append(-self.problem.regressors.skew(joint)[None])
        base = np.vstack(rows)
        bounds = np.tile([-np.inf, np.inf], (len(base), 1))
        layout = self.problem.layout
        bounds[: int(keep.sum())] = np.stack([layout.lower[keep], layout.upper[keep]], axis=1)
        noise = np.zeros((len(base) + 1, base.shape[1]))
        noise[: int(keep.sum())], noise[-1] = x_noise[keep], -fixed_noise
        return _JointRows(y, base, noise, bounds)

    def block(self, term: Term, joints: tuple[int, ...], shape: Values) -> Block:
        """The candidate's columns on the (stacked) rows of its joints, their noise not yet known."""
        columns = self._columns(self.regressors, term, joints, shape)
        coefficients = self.model.library.effects[term.effect].coefficients
        bounds = np.array([c.bounds for c in coefficients], dtype=float).reshape(-1, 2)
        return Block(columns[1:], columns[0], bounds[:, 0], bounds[:, 1], np.zeros_like(columns))

    def _with_noise(self, block: Block, term: Term, joints: tuple[int, ...], shape: Values) -> Block:
        noisy = self._columns(self.regressors.perturbed, term, joints, shape)
        return replace(block, noise=noisy - np.vstack([block.fixed, block.columns]))

    def _columns(self, regressors: Regressors, term: Term, joints: tuple[int, ...], shape: Values) -> Array:
        weights = self.weights(joints)
        return np.concatenate(
            [w * regressors.columns(term, i, shape) for i, w in zip(joints, weights, strict=True)], axis=1
        )

    def replaced(self, term: Term) -> tuple[Term, ...]:
        """Active terms that the candidate contains as special cases."""
        generalises = self.model.library.effects[term.effect].generalises
        return tuple(t for t in self.problem.layout.terms if t.effect in generalises and t.joint == term.joint)

    def search(self, term: Term) -> Candidate | None:
        """The candidate at the best point of its grid; None if the data give it no scale or no say."""
        joints = joints_of(self.model, term)
        rows = self.rows(joints, self.replaced(term))
        choices = self._choices(term)
        scored: list[tuple[float, Values, Block]] = []
        for shape in choices:
            block = self.block(term, joints, shape)
            if np.all(np.isfinite(block.columns)) and np.all(np.isfinite(block.fixed)):
                scored.append((rows.sse(block), shape, block))
        if not scored:
            return None
        scored.sort(key=lambda s: s[0])
        _, shape, block = scored[0]
        searched = len(self.model.library.effects[term.effect].shape) if len(choices) > 1 else 0
        kept = tuple((s, b) for _, s, b in scored[:_KEPT_SHAPES])
        edge = len(choices) > 1 and grids.at_edge(self.regressors, term, shape)
        return Candidate(term, rows, shape, searched, block, kept, rows.solve(block), edge)

    def _choices(self, term: Term) -> list[Values]:
        choices = grids.points(self.regressors, term)
        signals = self.model.library.effects[term.effect].signals
        if "warmth" in signals and all(bool(p.measured.all()) for p in self.motion.pieces):
            # The measured temperature takes the place of the assumed warming: its time constant is idle.
            return choices[:1]
        return choices

    def refine(self, candidate: Candidate) -> Candidate:
        """The same candidate with its shape moved off the grid to the least error, and the noise of its columns."""
        shape = self._refined_shape(candidate) if candidate.shapes_searched else candidate.shape
        term, joints = candidate.term, joints_of(self.model, candidate.term)

        def block_at(values: Values) -> Block:
            return self._with_noise(self.block(term, joints, values), term, joints, values)

        shapes = [shape] + [s for s, _ in candidate.choices if s != shape]
        choices = tuple((s, block_at(s)) for s in shapes)
        block = choices[0][1]
        edge = candidate.shapes_searched > 0 and grids.at_edge(self.regressors, term, shape)
        solution = candidate.rows.solve(block)
        return replace(candidate, shape=shape, block=block, choices=choices, solution=solution, at_edge=edge)

    def _refined_shape(self, candidate: Candidate) -> Values:
        joints = joints_of(self.model, candidate.term)
        moving = [p for p in self.model.library.effects[candidate.term.effect].shape if p.grid and p.grid.count > 2]
        start = np.array([candidate.shape[p.name] for p in moving])
        scale = np.array([self._step(candidate, p.name) for p in moving])

        def shape_at(z: Array) -> Values:
            moved = start * np.exp(z * scale) if self._logarithmic(candidate) else start + z * scale
            return {**candidate.shape, **dict(zip((p.name for p in moving), map(float, moved), strict=True))}

        def error(z: Array) -> float:
            shape = shape_at(z)
            if np.any(np.abs(z) > 1.5) or not grids.within(self.regressors, candidate.term, shape):
                return float("inf")
            return candidate.rows.sse(self.block(candidate.term, joints, shape))

        simplex = np.vstack([np.zeros(len(moving)), 0.5 * np.eye(len(moving))])
        options = {"maxfev": _REFINE_STEPS, "initial_simplex": simplex, "xatol": 0.01, "fatol": 0.0}
        return shape_at(minimize(error, np.zeros(len(moving)), method="Nelder-Mead", options=options).x)

    def _logarithmic(self, candidate: Candidate) -> bool:
        shape = self.model.library.effects[candidate.term.effect].shape
        return all(p.grid is None or p.grid.spacing == "log" for p in shape)

    def _step(self, candidate: Candidate, name: str) -> float:
        """One grid step of a shape parameter: as a ratio's logarithm on logarithmic grids."""
        parameter = self.model.library.effects[candidate.term.effect].parameter(name)
        values = grids.axis(self.regressors, candidate.term, parameter, candidate.shape)
        if self._logarithmic(candidate):
            return float(np.log(values[1] / values[0]))
        return float(values[1] - values[0])
