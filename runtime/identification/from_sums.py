"""Identification from what a board has added up: the same least squares, without a sample.

Products of columns and torque are all that least squares needs. Columns are not compensated for the encoders' noise,
and no skew is estimated, as both need the samples; rows are weighted by what each joint's own residual is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.documents.fits import FittedEffect, FittedParameter, InertialEntry, StatisticsFitDocument
from runtime.identification.problem import LinearUnknowns, inertia_cuts
from runtime.identification.settings import INTERVAL_SIGMAS, SUMS_PASSES, SUMS_POSTURES
from runtime.model.loader import Model
from runtime.model.terms import Term, joints_of, structure
from runtime.recordings.board_sums import BoardSums
from runtime.recordings.recording import RecordingError
from runtime.regression.bounded import inverse, minimise

_ALL_ROUND = (-np.pi, np.pi)
"""rad; of a joint without limits."""


@dataclass(frozen=True)
class SumsFit:
    """coefficients, deviations (K,); rms (n,) of the residuals in N m (N); rows (n,); layout of the unknowns."""

    layout: LinearUnknowns
    coefficients: Array
    deviations: Array
    rms: Array
    rows: Array


def fit_sums(model: Model, sums: BoardSums) -> SumsFit:
    """Base parameters and effects of a model file. Raises RecordingError where its structure is another one."""
    terms = structure(model)
    _check(model, sums, list(terms))
    layout = LinearUnknowns.of(model, list(terms), rigid_given=False)
    places = _places(model, sums, layout)
    grams = sums.triangles
    if not sums.rows.all():
        joint = int(np.argmin(sums.rows)) + 1
        raise RecordingError(f"{sums.path}: joint {joint} has no row; let the board run while every joint moves")
    # A torque in its own unit, until residuals say more.
    weights = np.sqrt(sums.rows / np.array([gram[-1, -1] for gram in grams]))
    postures = _postures(model)

    def broken(theta: Array) -> Array | None:
        met = inertia_cuts(model, postures, theta[layout.lumps])
        return None if met is None else np.pad(met, [(0, 0), (0, layout.size - met.shape[1])])

    for _ in range(SUMS_PASSES):
        normal, moment = np.zeros((layout.size, layout.size)), np.zeros(layout.size)
        for gram, at, weight in zip(grams, places, weights, strict=True):
            normal[np.ix_(at, at)] += weight**2 * gram[:-1, :-1]
            moment[at] += weight**2 * gram[:-1, -1]
        theta = minimise(normal, moment, layout.lower, layout.upper, violated=broken, near=layout.stated)
        ends = [np.append(-theta[at], 1.0) for at in places]
        squares = np.array([max(float(v @ gram @ v), 1e-300) for gram, v in zip(grams, ends, strict=True)])
        rms = np.sqrt(squares / sums.rows)
        weights = 1 / rms
    deviations = np.sqrt(np.maximum(np.diag(inverse(normal)), 0.0))
    return SumsFit(layout, theta, deviations, rms, sums.rows)


def _check(model: Model, sums: BoardSums, terms: Sequence[Term]) -> None:
    """Raises RecordingError where the sums are of another structure than the model file's."""
    if sums.arm != model.name or len(sums.rows) != model.n:
        raise RecordingError(f'{sums.path}: is of the arm "{sums.arm}"; expected "{model.name}" with {model.n} joints')
    if left := sums.layout["left_out"]:
        raise RecordingError(
            f"{sums.path}: the board has no columns of {', '.join(left)}, whose torque would pass for others'; "
            "identify from a recording"
        )
    held = {(name, j) for j, joint in enumerate(sums.layout["joints"], 1) for name, _ in joint["effects"]}
    mine = {(term.effect, term.joint) for term in terms}
    if held != mine:
        other = sorted(held ^ mine, key=str)[0]
        where = "the board has it and the model file has not" if other in held else "the board does not have it"
        raise RecordingError(
            f"{sums.path}: {other[0]}@{other[1]}: {where}; give the model file of the board's firmware"
        )


def _places(model: Model, sums: BoardSums, layout: LinearUnknowns) -> list[NDArray[np.intp]]:
    """Of each joint's columns, among the unknowns."""
    lumps = {lump.name: k for k, lump in enumerate(model.lumps)}
    terms = {(term.effect, term.joint): term for term in layout.terms}
    found = []
    for j, joint in enumerate(sums.layout["joints"], 1):
        at = [lumps[name] for name in joint["lumps"]]
        for effect, coefficient in joint["effects"]:
            term = terms[effect, j]
            assert j - 1 in joints_of(model, term)
            names = [c.name for c in model.library.effects[effect].coefficients]
            at.append(layout.slices[term].start + names.index(coefficient))
        found.append(np.array(at, dtype=np.intp))
    return found


def _postures(model: Model) -> Array:
    """(n, N) over the arm's range."""
    ends = np.array([joint.position_limits or _ALL_ROUND for joint in model.joints])
    return np.asarray(np.random.default_rng(0).uniform(ends[:, :1], ends[:, 1:], (model.n, SUMS_POSTURES)))


def sums_document(model: Model, fit: SumsFit) -> StatisticsFitDocument:
    """Every figure of the fit; intervals are 95 %."""
    theta, wide, stated = fit.coefficients, INTERVAL_SIGMAS * fit.deviations, structure(model)
    inertial = [
        InertialEntry(
            joint=lump.joint,
            name=lump.name,
            model=lump.value,
            fit=float(theta[k]),
            unit=lump.unit,
            interval=(float(theta[k] - wide[k]), float(theta[k] + wide[k])),
        )
        for k, lump in enumerate(model.lumps)
    ]
    effects = []
    for term, place in fit.layout.slices.items():
        info, values = model.library.effects[term.effect], stated.get(term, {})
        own = dict(zip((c.name for c in info.coefficients), range(place.start, place.stop), strict=True))
        solved = model.library.recover(term.effect, theta[place], values)
        parameters = {}
        for p in info.parameters:
            k = None if info.recover is not None else own.get(p.name)
            between = None if k is None else (float(theta[k] - wide[k]), float(theta[k] + wide[k]))
            value = solved.get(p.name, np.nan)
            kind = model.joints[(term.joint or 1) - 1].type
            parameters[p.name] = FittedParameter(
                value=float(value) if np.isfinite(value) else None,
                unit=p.unit.text(kind),
                interval=between,
                model=values.get(p.name),
            )
        effects.append(FittedEffect(effect=term.effect, joint=term.joint, name=term.name, parameters=parameters))
    return StatisticsFitDocument(
        rows=[int(x) for x in fit.rows], rms=fit.rms.tolist(), inertial=inertial, rotors=[], effects=effects
    )
