"""Where the model fails: the residual torque of every joint, and the signals that it follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Final

import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.documents.fits import ComparedJoint, CompareDocument, DriveEntry, JointEntry, StructureShare, WrittenError
from runtime.documents.parts import EstimateEntry
from runtime.identification.drive_gains import with_gains_of
from runtime.identification.fit import Fit
from runtime.identification.identify import identify
from runtime.identification.problem import Problem, least_inertia
from runtime.identification.regressors import Regressors, Signals
from runtime.identification.settings import HARDLY_POSITIVE, STRUCTURE_LEAST_SHARE
from runtime.model.loader import Model
from runtime.model.terms import Prediction, joints_of, structure
from runtime.motion import repeats
from runtime.motion.band import apparent_inertia
from runtime.motion.motion import Motion
from runtime.motion.repeats import Floor, floor
from runtime.motion.settings import MORE_THAN_NOISE, RESOLVED
from runtime.recordings.recording import Recording

_BINS: Final = 24
"""bins of equal count; a curve over a signal may turn a dozen times."""


@dataclass(frozen=True)
class JointSeries:
    """A joint's (1-based) torque and prediction in its band, on the rows that count; each array (M,).

    fit      what predicts; None: nothing is told of a drive
    load     torque that the joint transmits to its link
    warmth   rise of the temperature, K; None where it was not recorded
    """

    joint: int
    force_unit: str
    position_unit: str
    t: Array
    piece: NDArray[np.intp]
    q: Array
    qd: Array
    qdd: Array
    load: Array
    warmth: Array | None
    tau: Array
    predicted: Array
    floor: Floor
    name: str | None = None
    fit: Fit | None = None

    @property
    def residual(self) -> Array:
        """(M,) measured less predicted torque."""
        return self.tau - self.predicted

    @property
    def rms(self) -> float:
        """Of the residual, in the unit of the joint's torque."""
        return errors(self.residual, self.tau)[0]

    @property
    def relative(self) -> float:
        """‖τ − τ̂‖ / ‖τ‖."""
        return errors(self.residual, self.tau)[1]

    @property
    def noise(self) -> float:
        """What a perfect model may leave, RMS: the noise floor, and at least what no sensor of torque resolves."""
        return max(self.floor.value, RESOLVED * float(np.sqrt(np.mean(self.tau**2)))) if len(self.tau) else 0.0

    @property
    def resolved(self) -> bool:
        """Whether the error is as large as a sensor of torque resolves."""
        return self.relative > RESOLVED

    @property
    def at_floor(self) -> bool:
        """Whether the error is no more than noise; of a joint that is called clean it always is. Twice as much where
        stamps are uneven: the floor lacks what uncertain instants of reading add."""
        uncertain = self.fit is not None and self.fit.motion.band.jittered
        return self.rms <= (2 if uncertain else 1) * MORE_THAN_NOISE * self.noise

    def signals(self) -> dict[str, Array]:
        """Signals that a residual may follow, by the names that `compare --json` uses."""
        found = {"position": self.q, "velocity": self.qd, "direction": np.sign(self.qd), "acceleration": self.qdd}
        found |= {"load": self.load, "time": self.t}
        return found if self.warmth is None else found | {"temperature": self.warmth}

    def document(self) -> JointEntry:
        """A joint's part of every document of a fit."""
        return JointEntry(
            joint=self.joint,
            name=UNSET if self.name is None else self.name,
            unit=self.force_unit,
            rms=self.rms,
            relative=self.relative,
            floor=self.floor.value,
            floor_source=self.floor.source,
            repeatable=self.floor.repeatable(self.rms),
            drive=self._drive(),
        )

    def _drive(self) -> DriveEntry | UnsetType:
        driven = None if self.fit is None else with_gains_of(self.fit, self.joint - 1)
        if driven is None:
            return UNSET
        gains = {
            gain.name: EstimateEntry(value=gain.value, unit=gain.unit, interval=gain.interval)
            for gain in driven.told.values()
            if not gain.imitated
        }
        unit = driven.law.unit[driven.prismatic]
        return DriveEntry(law=driven.law.name, rms=self.rms / driven.scale, unit=unit, gains=gains)


@dataclass(frozen=True)
class Comparison:
    """A model's structure, fitted, against recordings; `written`: (rms, relative) with the file's own values."""

    fit: Fit
    joints: tuple[JointSeries, ...]
    written: tuple[tuple[float, float], ...] | None

    def document(self, warnings: list[str]) -> CompareDocument:
        """As `tendon compare --json`."""
        written = [None if e is None else WrittenError(rms=e[0], relative=e[1]) for e in self.written or ()]
        joints = [
            series.document().as_part_of(ComparedJoint, structure=structure_entries(series), as_written=error)
            for series, error in zip_longest(self.joints, written)
        ]
        return CompareDocument(
            band=self.fit.motion.band.document(), skew=self.fit.inference.skew_entry(), joints=joints, warnings=warnings
        )


def compare(model: Model, recordings: Sequence[Recording]) -> Comparison:
    """Fit the model file's structure to recordings."""
    fit = identify(model, recordings)
    return Comparison(fit, series(fit), as_written(fit))


def series(fit: Fit) -> tuple[JointSeries, ...]:
    """Every joint's torque and prediction on the rows that were fitted."""
    return series_on(fit, fit.problem, fit.residual)


def series_on(fit: Fit, problem: Problem, residuals: Sequence[Array]) -> tuple[JointSeries, ...]:
    """Every joint's torque and prediction along the motion of a problem, that of the fit or another one, on the rows
    that count.

    residuals   (M,) a joint, on all rows of that motion
    """
    model, motion = fit.model, problem.motion
    repeated, regressors, found = repeats.find(motion), Regressors(model, motion, fit.prediction), []
    for i, (joint, residual) in enumerate(zip(model.joints, residuals, strict=True)):
        use, tau = motion.moving(i), motion.recorded(i, fit.skew)
        load = np.concatenate([np.asarray(s.at("load", i))[s.piece.centres] for s in regressors.signals(i)])
        warm = all(bool(p.measured[i]) for p in motion.pieces)
        read = problem.reread(i, fit.shapes, fit.coefficients)
        found.append(
            JointSeries(
                i + 1,
                joint.force_unit,
                joint.position_unit,
                t=motion.row_time(i)[use],
                piece=motion.row_piece(i)[use],
                q=motion.rows("q", i)[i, use],
                qd=motion.rows("qd", i)[i, use],
                qdd=motion.rows("qdd", i)[i, use],
                load=load[use],
                warmth=motion.rows("warmth", i)[i, use] if warm else None,
                tau=tau[use],
                predicted=(tau - residual)[use],
                floor=floor(motion, repeated[i], i, residual, read=read),
                name=joint.name,
                fit=fit,
            )
        )
    return tuple(found)


def structure_entries(series: JointSeries) -> list[StructureShare]:
    """Signals that the residual follows, the largest share first."""
    shares = sorted(structure_shares(series).items(), key=lambda item: -item[1])
    found = [entry for entry in shares if entry[1] > STRUCTURE_LEAST_SHARE]
    return [StructureShare(signal=signal, share=share) for signal, share in found]


def structure_shares(series: JointSeries) -> dict[str, float]:
    """Share of the residual's variance that curves over each signal explain, one curve for each direction of motion.

    Friction leaves opposite residuals in the two directions, which a single curve would miss: the difference between
    the directions counts as "direction" and for every other signal.
    """
    r = series.residual
    total = float(np.sum((r - r.mean()) ** 2)) if len(r) else 0.0
    sides = [use for use in (series.qd > 0, series.qd <= 0) if np.count_nonzero(use) > 2 * _BINS]
    if total == 0 or not sides:
        return dict.fromkeys(series.signals(), 0.0)
    between = sum(float(use.sum() * (r[use].mean() - r.mean()) ** 2) for use in sides) / total
    found = dict.fromkeys(series.signals(), between)
    for use in sides:
        part = r[use] - r[use].mean()
        for name, values in series.signals().items():
            if name != "direction" and part.any():
                found[name] += float(part @ part) / total * _share(part, values[use])
    return {name: min(share, 1.0) for name, share in found.items()}


def _share(r: Array, values: Array) -> float:
    """Share of the variance of r (N,) that its means over quantile bins explain, less what chance would.

    The remainder around the means gives how much of their squares is chance; where it is correlated from row to row,
    so many rows count as one. The correlation of r itself does not give this: a function of a slow signal is as slow.
    """
    edges = np.unique(np.quantile(values, np.linspace(0, 1, _BINS + 1)[1:-1]))
    index = np.searchsorted(edges, values)
    count = np.bincount(index)
    means = np.bincount(index, weights=r) / np.maximum(count, 1)
    left = r - means[index]
    bins, power = int(np.count_nonzero(count)), float(left @ left)
    lag = float(np.clip((left[1:] @ left[:-1]) / power, 0.0, 1.0)) if power else 0.0
    # Correlated rows that count as one; degrees of freedom are left once every bin has its mean.
    alike = (1 + lag) / max(1 - lag, 1e-12)
    freedom = len(r) - bins * alike
    if freedom <= 0:
        return 0.0
    chance = (bins - 1) * alike * power / freedom
    return float(np.clip(1 - (power + chance) / float(r @ r), 0.0, 1.0))


def as_written(fit: Fit) -> tuple[tuple[float, float], ...] | None:
    """(rms, relative) a joint with the file's own values; None where the file leaves values open."""
    model, motion = fit.model, fit.motion
    if not model.lumps_known and not motion.rigid_given:
        return None
    known = structure(model)
    for term, values in known.items():
        info = model.library.effects[term.effect]
        if any(p.name not in values and p.role != "given" for p in info.parameters):
            return None
    prediction = Prediction(fit.problem.layout.stated[: len(model.lumps)], known)
    skew, found = fit.skew, []
    for i in range(model.n):
        predicted = np.concatenate([_torque(Signals(model, p, prediction), i) for p in motion.pieces_of(i)])
        use = motion.moving(i)
        found.append(errors((motion.torque(i, skew) - predicted)[use], motion.recorded(i, skew)[use]))
    return tuple(found)


def errors(residual: Array, tau: Array) -> tuple[float, float]:
    """RMS and ‖τ − τ̂‖/‖τ‖ of a joint's rows; zeros where there are none."""
    total = float(np.linalg.norm(tau))
    if not total:
        return 0.0, 0.0
    with np.errstate(over="ignore"):  # what is simulated along another motion may have no end
        size = float(np.linalg.norm(residual))
    return size / float(np.sqrt(len(residual))), size / total


def _torque(signals: Signals, joint: int) -> Array:
    total = signals.rigid[joint].copy()
    if signals.prediction is not None:
        for term in signals.prediction.values:
            if joint in joints_of(signals.model, term):
                total += signals.torque(term, joint)
    return signals.piece.equation(signals.piece.in_band(total), joint)


def has_proper_inertia(fit: Fit) -> bool:
    """Whether the fitted D is positive definite by more than a hundredth of what the model file or the torques ask."""
    model, motion = fit.model, fit.motion
    if motion.rigid_given:
        return True
    lumps, stretches = fit.coefficients[fit.problem.layout.lumps], [p.q for p in motion.pieces]
    fitted = least_inertia(model, stretches, lumps)
    given = least_inertia(model, stretches, model.lump_values) if model.lumps_known else _least_apparent(motion)
    return bool(fitted > HARDLY_POSITIVE * given)


def _least_apparent(motion: Motion) -> float:
    """The smallest inertia that fits a moving joint's torque by itself, kg m² (kg); 0 where none does."""
    found = []
    for i in range(motion.n):
        use = motion.moving(i)
        if use.any():
            q, qd, qdd = (motion.rows(name, i)[:, use] for name in ("q", "qd", "qdd"))
            found.append(apparent_inertia(i, q, qd, qdd=qdd, tau=motion.torque(i, 0.0)[use]))
    return min((x for x in found if np.isfinite(x)), default=0.0)


def driving_speed(fit: Fit, joint: int, up_to: float) -> float | None:
    """Smallest speed up to some speed at which the joint's summed static friction drives it; None if it never does."""
    model, prediction, count = fit.model, fit.prediction, 400
    speeds = np.linspace(up_to / count, up_to, count)
    drives = np.zeros(count, dtype=bool)
    for direction in (1.0, -1.0):
        total = np.zeros(count)
        for term, values in prediction.values.items():
            info = model.library.effects[term.effect]
            if term.joint == joint + 1 and info.rubs and set(info.signals) <= {"q", "qd"}:
                signals = {"qd": direction * speeds, "q": np.zeros(count)}
                total += model.library.torque(term.effect, signals, values, 1.0)
        drives |= direction * total < 0
    return float(speeds[np.argmax(drives)]) if drives.any() else None
