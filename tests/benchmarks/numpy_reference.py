"""The same least-squares fit as one would write it without generated code: SymPy's lambdify to NumPy, and lstsq."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import sympy as sp

from codegen import effect_functions
from runtime.arrays import Array
from runtime.identification.problem import Problem
from runtime.model.terms import Term, Values, joints_of
from runtime.motion.piece import Piece
from symbolic import primitives
from symbolic.effects import LIBRARY
from symbolic.functions import SymbolicFunction
from symbolic.model import derive
from symbolic.model_file.arm import Arm


class NumPyFit:
    """Regressors of an arm and of effects without memory, one NumPy expression after another."""

    def __init__(self, arm: Arm, terms: Sequence[Term]) -> None:
        model = derive(arm)
        function = next(f for f in model.functions if f.name == "regressor")
        self.n, self.lumps = len(arm.joints), len(model.lumps)
        self._regressor = _lambdified(function)
        self._parameters = model.struct.defaults
        self._columns = {t: _lambdified(effect_functions.columns(LIBRARY[t.effect])) for t in terms}

    def rigid(self, piece: Piece) -> Array:
        """(n, p, N), as Model.regressor."""
        out = np.empty((self.n * self.lumps, len(piece.t)))
        for row, value in zip(out, self._regressor(*self._parameters, *piece.q, *piece.qd, *piece.qdd), strict=True):
            row[:] = value
        return out.reshape(self.n, self.lumps, -1)

    def columns(self, term: Term, shape: Mapping[str, float], signals: Mapping[str, Any], count: int) -> Array:
        """(1 + k, N), as Library.columns."""
        effect = LIBRARY[term.effect]
        values = [shape.get(p.name, p.default or 0.0) for p in effect.parameters]
        found = self._columns[term](*(signals[s.name] for s in effect.signals), *values)
        return np.array([np.broadcast_to(value, count) for value in found])

    def fit(self, problem: Problem, shapes: Mapping[Term, Values], skew: float) -> tuple[Array, list[Array]]:
        """Coefficients (K,) and each joint's rows (K, M): filtered like ours, then numpy.linalg.lstsq."""
        motion = problem.motion
        found = []
        for view in motion.views:
            # As one would write it: the regressor of all joints at once, in the band in which some of them are fitted.
            rigid = [self.rigid(piece) for piece in view.pieces]
            for i in view.joints:
                parts = [self._rows(problem, k, i, shapes, own[i]) for k, own in enumerate(rigid)]
                found.append((i, np.concatenate(parts, axis=1)))
        rows = [x for _, x in sorted(found, key=lambda item: item[0])]
        theta = np.linalg.lstsq(*_stacked(problem, [(x[1:], x[0]) for x in rows], skew))[0]
        return theta, [x[1:] for x in rows]

    def _rows(self, problem: Problem, number: int, joint: int, shapes: Mapping[Term, Values], rigid: Array) -> Array:
        """(1 + K, M) of a joint along a piece: the part without free coefficient, then a row a coefficient; rigid
        (lumps, N)."""
        layout, signals = problem.layout, problem.regressors.signals(joint)[number]
        x = np.zeros((1 + layout.size, rigid.shape[1]))
        x[1 : 1 + self.lumps] = rigid
        for term in layout.terms:
            if joint in joints_of(problem.model, term):
                part = layout.slices[term]
                columns = self.columns(term, shapes[term], signals.of(term, joint), rigid.shape[1])
                x[0] += columns[0]
                x[1 + part.start : 1 + part.stop] = columns[1:]
        return signals.piece.in_band(x)


def stacked(problem: Problem, shapes: Mapping[Term, Values], skew: float) -> tuple[Array, Array]:
    """Our own rows of a linear fit, of all joints and weighted: columns (M, K) and torque (M,)."""
    return _stacked(problem, [problem.rows(i, shapes) for i in range(problem.model.n)], skew)


def _stacked(problem: Problem, rows: Sequence[tuple[Array, Array]], skew: float) -> tuple[Array, Array]:
    """rows: of each joint the columns (K, M) and the part without free coefficient (M,)."""
    motion, left, right = problem.motion, [], []
    for i, (x, fixed) in enumerate(rows):
        use = motion.moving(i)
        left.append(problem.weights[i] * x[:, use])
        right.append(problem.weights[i] * (motion.torque(i, skew) - fixed)[use])
    return np.concatenate(left, axis=1).T, np.concatenate(right)


def _lambdified(function: SymbolicFunction) -> Callable[..., Sequence[Any]]:
    """Outputs from the struct's and the inputs' numbers or arrays, common subexpressions computed once."""
    arguments = list(function.struct.symbols) if function.struct is not None else []
    arguments += [s for a in function.inputs for s in a.symbols]
    definitions = list(function.definitions)
    outputs = [primitives.exact(sp.sympify(e)) for o in function.outputs for e in o.expressions]
    shared = (lambda expressions: (definitions, expressions)) if definitions else True
    return sp.lambdify(arguments, outputs, modules="numpy", cse=shared)
