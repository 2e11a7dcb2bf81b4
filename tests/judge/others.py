"""The same recordings through pysindy and sysidentpy, as a user of them would look for a missing effect.

Both are given what the diagnosis has to find by itself: the band, the alignment of torque and motion, rows without
standstill, and one column for every static effect of the library at a few values of its shape parameters. What the
user's model explains (the arm's rigid-body regressors and its frictions) is projected out of the torque and of all
columns, so that neither has to find it again and neither puts another term in its place; what remains is
tau = Theta xi in standardised columns. pysindy: STLSQ, its threshold and ridge those of the sparsest model within one
per cent of the least error on blocks left out. sysidentpy: FROLS as a model without memory (NFIR), its number
of terms by BIC. Every term left is a name; the effect whose terms together are the largest torque is the answer.
Effects with a memory (elasticity, backlash, lugre, spring_hysteresis) and a delay have no static column: with those
the comparison says what such a library cannot say.
"""

from __future__ import annotations

import itertools
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal

from runtime.arrays import Array
from runtime.recordings.recording import Recording

from .bodies import ARMS, inertial_columns, inertial_values
from .cases import Made
from .plant import PERIOD
from .scoring import tag

Choose = Callable[[Array, Array], Array]
"""Standardised columns (M, K) and torque (M,) -> coefficients (K,), zero where a term is left out."""

MEMORY = frozenset(("elasticity", "backlash", "lugre", "spring_hysteresis", "torque_delay", "torque_scale"))
"""Effects without a column here; the others are the part of the comparison that is on equal terms."""
_LEAST_TERM = 1e-6
_INSIDE = 1e-4
"""A column of which less than this part is left beside the user's model is in its span."""


@dataclass(frozen=True)
class Answer:
    """Effects named beyond the model, "effect@joint", the largest first; seconds of CPU for the selection alone."""

    named: tuple[str, ...]
    seconds: float


@dataclass(frozen=True)
class Signals:
    """A recording in the band, (n, N) each but t (N,); warm rises with the drive's temperature."""

    t: Array
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    warm: Array
    taps: Array
    every: int

    def in_band(self, x: Array) -> Array:
        """x (..., N) -> (..., M)."""
        return np.asarray(signal.oaconvolve(x, self.taps.reshape((1,) * (x.ndim - 1) + (-1,)), "valid", -1))[
            ..., :: self.every
        ]


def signals(recording: Recording, cutoff: float) -> Signals:
    """Positions smoothed to twice the cut-off (Hz) and differentiated; the torque at the middle of its hold."""
    smooth = signal.firwin(2 * round(1.5 / (cutoff * PERIOD)) + 1, 2 * cutoff, fs=1 / PERIOD)
    half = len(smooth) // 2
    q = signal.oaconvolve(recording.q, smooth[None, :], "valid", axes=-1)
    qd = np.gradient(q, PERIOD, axis=1)
    middle = 0.5 * (recording.tau + np.roll(recording.tau, 1, axis=1))[:, half:-half]
    t = recording.t[half:-half]
    warm = np.tile(1 - np.exp(-3 * t / t[-1]), (len(q), 1))
    for i, temperature in enumerate(recording.temperature):
        if temperature is not None:
            smoothed = np.convolve(temperature, np.full(501, 1 / 501), "same")[half:-half]
            warm[i] = (smoothed - smoothed[1000]) / 10.0
    taps = signal.firwin(2 * round(2.5 / (cutoff * PERIOD)) + 1, cutoff, fs=1 / PERIOD)
    return Signals(
        t, q, qd, np.gradient(qd, PERIOD, axis=1), middle, warm, taps, max(1, round(0.4 / (cutoff * PERIOD)))
    )


def base_columns(s: Signals, joint: int, believed: Sequence[str]) -> list[Array]:
    """(N,) regressors of the user's model at a joint (0-based): an independent set of inertial ones, and friction."""
    bodies = ARMS[len(s.q)]
    inertial = inertial_columns(bodies, s.q, s.qd, s.qdd, (0.0, 0.0))[joint]
    inertial = inertial[np.any(inertial != 0.0, axis=1)]
    thinned = inertial[:, ::10].T
    _, r, pivots = linalg.qr(thinned / np.linalg.norm(thinned, axis=0), mode="economic", pivoting=True)
    kept = pivots[: int(np.sum(np.abs(np.diag(r)) > 1e-3 * abs(r[0, 0])))]
    v, sign = s.qd[joint], np.sign(s.qd[joint])
    friction = {
        "coulomb": [sign],
        "coulomb_asymmetric": [np.maximum(sign, 0.0), np.minimum(sign, 0.0)],
        "viscous": [v],
        "viscous_cubic": [v**3],
    }
    return [*inertial[kept], *(x for effect in believed for x in friction[effect])]


def candidate_columns(s: Signals, joint: int, believed: Sequence[str]) -> list[tuple[str, Array]]:
    """("effect@joint", (N,)) for every static effect that the model lacks, at a few values of its shape parameters."""
    n, bodies = len(s.q), ARMS[len(s.q)]
    q, v, sign, t = s.q[joint], s.qd[joint], np.sign(s.qd[joint]), s.t / s.t[-1]
    rigid = np.einsum("kt,k->t", inertial_columns(bodies, s.q, s.qd, s.qdd, (0.0, 0.0))[joint], inertial_values(bodies))
    load = rigid - bodies[joint].rotor * s.qdd[joint]
    angle = np.cumsum(s.q, axis=0)
    low, high = np.quantile(q, [0.001, 0.999])
    places = low + (high - low) * np.linspace(0.0, 1.0, 9)
    ratio = 100.0
    found = [
        ("viscous_asymmetric", np.abs(v)),
        ("viscous_power", np.sqrt(np.abs(v)) * sign),
        ("viscous_power", v * np.abs(v)),
        *(("stribeck", np.exp(-((v / w) ** 2)) * sign) for w in (0.05, 0.1, 0.2, 0.4)),
        ("load_friction", np.abs(load) * sign),
        *(("friction_patch", sign * ((q > a) & (q < b))) for a, b in itertools.pairwise(places)),
        ("thermal_friction", s.warm[joint] * sign),
        ("thermal_friction", s.warm[joint] * v),
        ("linear_spring", q),
        ("cable", q**2),
        ("cable", q**3),
        *(("parallel_spring", np.maximum(x - q, 0.0)) for x in places[3:7]),
        ("end_stop", np.maximum(places[1] - q, 0.0)),
        ("end_stop", np.maximum(q - places[7], 0.0)),
        *(("torque_ripple", f(k * ratio * q)) for k in (1, 2) for f in (np.cos, np.sin)),
        ("torque_saturation", rigid**3),
        *(("gravity", f(angle[k])) for k in range(joint, n) for f in (np.cos, np.sin)),
        *(("payload", (t > x) * s.qdd[joint]) for x in (0.4, 0.5, 0.6)),
    ]
    coupled = [
        (tag("coupled_friction", min(joint, k) + 1), np.sign(v + s.qd[k])) for k in (joint - 1, joint + 1) if 0 <= k < n
    ]
    lacking: dict[str, list[Array]] = {"viscous_cubic": [v**3], "viscous": [v]}
    if not {"coulomb", "coulomb_asymmetric"} & set(believed):
        lacking["coulomb"] = [sign]
    if "coulomb_asymmetric" not in believed:
        lacking["offset"] = [np.ones_like(v)]
    missing = [(effect, x) for effect, columns in lacking.items() if effect not in believed for x in columns]
    where: dict[str, int | None] = {"gravity": None, "payload": None}
    return [*((tag(effect, where.get(effect, joint + 1)), x) for effect, x in (*found, *missing)), *coupled]


def answer(made: Made, believed: Sequence[str], cutoff: float, choose: Choose) -> Answer:
    """What one method names on a case's recording."""
    s = signals(made.recording, cutoff)
    torques: dict[str, float] = {}
    seconds = 0.0
    for joint in range(len(s.q)):
        base, candidates = base_columns(s, joint, believed), candidate_columns(s, joint, believed)
        rows = s.in_band(np.array([*base, s.tau[joint], *(x for _, x in candidates)]))[:, _moving(s, joint)].T
        known, _ = np.linalg.qr(rows[:, : len(base)])
        left = rows[:, len(base) :] - known @ (known.T @ rows[:, len(base) :])
        size = np.linalg.norm(left, axis=0) / np.sqrt(len(left))
        size[size < _INSIDE * np.linalg.norm(rows[:, len(base) :], axis=0) / np.sqrt(len(left))] = np.inf
        tau, theta = left[:, 0], left[:, 1:] / size[1:]
        start = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # both libraries warn of columns that depend on each other
            xi = choose(theta, tau)
        seconds += time.process_time() - start
        parts: dict[str, Array] = {}
        for (name, _), x, coefficient in zip(candidates, theta.T, xi, strict=True):
            if abs(coefficient) > _LEAST_TERM:
                parts[name] = parts.get(name, np.zeros_like(x)) + coefficient * x
        for name, part in parts.items():
            torques[name] = max(torques.get(name, 0.0), float(part.std()))
    return Answer(tuple(sorted(torques, key=lambda name: -torques[name])), seconds)


def _moving(s: Signals, joint: int) -> NDArray[np.bool_]:
    """Rows of in_band at which the joint's rate keeps its sign."""
    half = len(s.taps) // 2
    slow = np.abs(s.qd[joint]) < 0.005 * np.abs(s.qd[joint]).max()
    near = np.convolve(slow, np.ones(9), "same") > 0
    return ~near[half : len(near) - half : s.every]


def pysindy_choice(theta: Array, tau: Array) -> Array:
    """Sequentially thresholded least squares; threshold (N m) and ridge by the error on every fourth of 80 blocks."""
    fitted = np.arange(len(tau)) * 80 // len(tau) % 4 != 3
    tried = []
    for threshold in np.geomspace(0.005, 0.3, 10):
        for ridge in (0.05, 0.01 * len(tau), 0.1 * len(tau)):
            xi = _sindy(theta[fitted], tau[fitted], threshold, ridge)
            error = float(np.linalg.norm((tau - theta @ xi)[~fitted]))
            tried.append((error, int(np.count_nonzero(xi)), threshold, ridge))
    least = min(error for error, *_ in tried)
    _, _, threshold, ridge = min(
        (terms, error, threshold, ridge) for error, terms, threshold, ridge in tried if error <= 1.01 * least
    )
    return _sindy(theta, tau, threshold, ridge)


def _sindy(theta: Array, tau: Array, threshold: float, ridge: float) -> Array:
    import pysindy

    optimizer = pysindy.STLSQ(threshold=threshold, alpha=ridge)
    model = pysindy.SINDy(optimizer=optimizer, feature_library=pysindy.IdentityLibrary())
    model.fit(theta, t=1.0, x_dot=tau[:, None])
    found: Array = np.asarray(model.coefficients())[0]
    return found


def sysidentpy_choice(theta: Array, tau: Array) -> Array:
    """Forward regression with orthogonal least squares, the number of terms by BIC."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    count = theta.shape[1]
    model = FROLS(
        order_selection=True,
        n_info_values=min(count, 30),
        info_criteria="bic",
        xlag=[[1]] * count,
        ylag=1,
        model_type="NFIR",
        estimator=LeastSquares(),
        basis_function=Polynomial(degree=1),
    )
    # Its inputs act a sample later at the earliest.
    model.fit(X=theta[1:], y=tau[:-1, None])
    xi = np.zeros(count)
    for code, value in zip(model.final_model[:, 0], np.ravel(model.theta), strict=True):
        if code:  # 0 is the constant; 2001 is the first input, one sample late
            xi[(int(code) // 1000) - 2] = value
    return xi


METHODS: dict[str, Choose] = {"pysindy": pysindy_choice, "sysidentpy": sysidentpy_choice}
