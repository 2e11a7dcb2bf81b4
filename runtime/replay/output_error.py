"""Output error: the parameters with which the model, driven as the arm was, moves as the arm did.

The equation error of a fit has the noise of positions on both sides where the torque is made of them: a servo's is
k_p (q_desired − q). The simulated motion has no such noise. Windows of the recording are simulated from their recorded
starts, which are unknowns, too (multiple shooting), and the squared error of the motion is made small by Gauss-Newton
steps from the fit, with the derivatives of the integrator's steps.

Source: Ljung, System Identification, 1999, sections 3.3 and 7.2, for the method; Bock, Modelling of Chemical Reaction
Systems, 1981, for starts as unknowns; Liang & Zeger, Biometrika 73(1), 1986, for the intervals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from runtime.arrays import Array
from runtime.documents.parts import IterationsEntry, SearchEnd
from runtime.documents.replays import MotionErrorEntry, OutputErrorEntry, RefinedMotion, RefinedParameter
from runtime.identification import grids
from runtime.identification.estimate import Estimate
from runtime.identification.fit import SKEW, Fit, Inference, interval
from runtime.identification.settings import NOMINAL_SKEW, SEPARABLE
from runtime.model.terms import Prediction, Term
from runtime.motion.settings import SOME
from runtime.progress import is_late, within
from runtime.recordings.driven import ToldGain
from runtime.recordings.recording import Recording, drives_of
from runtime.replay.driven_arm import DrivenArm, Windows
from runtime.replay.replay import Replay
from runtime.replay.settings import (
    DAMPINGS,
    ENOUGH_FALL,
    GAUSS_NEWTON_STEPS,
    LEAST_WINDOWS,
    MOST_RUNS,
    MOST_WINDOWS,
    SHOOTING,
    SHOOTING_STEP,
    SKEW_STEP,
    SKEW_TOLD,
    SURE,
    TANGLED,
)
from runtime.setting import SearchSettings
from runtime.simulation.equations import PlantEquations


@dataclass(frozen=True)
class Sought:
    """A parameter: a base inertial one (`lump`, 0-based), one of a term, a coefficient of a joint's (0-based) drive, or
    the skew, samples by which the torque is taken later.

    size   by which a step in it is scaled     low, high   its bounds
    """

    name: str
    value: float
    size: float
    low: float
    high: float
    lump: int | None = None
    term: Term | None = None
    joint: int | None = None


@dataclass(frozen=True)
class OutputError:
    """Parameters (k,) after the search, their covariance (k, k), and the motion's error before and after.

    joints   (0-based) whose motion was fitted, with both errors
    better   whether the error fell, so that the parameters count
    skew     samples by which the torque is taken later
    search   how many steps it took
    """

    sought: tuple[Sought, ...]
    found: Array
    covariance: Array
    windows: int
    joints: Mapping[int, tuple[MotionErrorEntry, MotionErrorEntry]]
    better: bool
    skew: float
    search: IterationsEntry

    def estimate(self, k: int, before: Estimate) -> Estimate:
        """The k-th parameter with its 95 % interval; without one if it is told only together with others."""
        value = float(self.found[k])
        ends = None if before.with_others else interval(value, float(self.covariance[k, k]), self.windows - 1)
        return replace(before, value=value, interval=ends)

    def inference(self, fit: Fit) -> Inference:
        """That of the fit, with what was found."""
        lumps, values = list(fit.inference.lumps), {t: dict(v) for t, v in fit.inference.values.items()}
        for k, of in enumerate(self.sought):
            if of.lump is not None:
                lumps[of.lump] = self.estimate(k, lumps[of.lump])
            elif of.term is not None:
                values[of.term][of.name] = self.estimate(k, values[of.term][of.name])
        return replace(fit.inference, lumps=tuple(lumps), values=values)

    def told(self, recordings: Sequence[Recording]) -> dict[int, dict[str, ToldGain]]:
        """The drives' coefficients, by joint (0-based) and name."""
        drives = drives_of(recordings)
        found = {i: dict(drive.told) for i, drive in enumerate(drives) if drive is not None}
        for k, of in enumerate(self.sought):
            if of.joint is not None:
                before = found[of.joint][of.name]
                after = self.estimate(k, Estimate(before.value, before.interval, before.unit))
                found[of.joint][of.name] = replace(before, value=after.value, interval=after.interval)
        return found


@dataclass(frozen=True, eq=False)
class Shooting:
    """A fit and the windows in which its model is simulated."""

    fit: Fit
    recordings: Sequence[Recording]

    @cached_property
    def replay(self) -> Replay:
        """The fit's model along the recordings that were fitted."""
        fit = self.fit
        return Replay(fit.model, fit.prediction, fit.motion, self.recordings, fit.skew, longest_step=SHOOTING_STEP)

    @cached_property
    def windows(self) -> Windows:
        """In all tracks, evenly spread."""
        found = Windows.of(self.replay.tracks, round(SHOOTING / self.replay.tracks[0].dt))
        directions = len(self.sought) + 2 * self.fit.model.n
        most = min(MOST_WINDOWS, max(LEAST_WINDOWS, MOST_RUNS // directions))
        return Windows(found.length, found.starts[:: -(-len(found.starts) // most)])

    @cached_property
    def sought(self) -> tuple[Sought, ...]:
        """The parameters that the fit told, and the unknown coefficients of the drives that it scaled. Where the torque
        of a command is unknown, stated inertias give its scale, and stay. A command's delay looks like friction in the
        torque: where the fit tells it badly, and a plain hold does not explain it, the motion tells them apart."""
        inference, library = self.fit.inference, self.fit.model.library
        found = []
        for k, (lump, told) in enumerate(zip(self.fit.model.lumps, inference.lumps, strict=True)):
            if (size := _size(told)) and not (self.scaled and lump.value is not None):
                found.append(Sought(lump.name, told.value, size, -np.inf, np.inf, lump=k))
        for term, values in inference.values.items():
            for name, told in values.items():
                if size := _size(told):
                    # At an end of its bounds a shape may be none, without derivatives: it is sought where the fit does.
                    shape = self.fit.shapes.get(term, {})
                    ends = grids.slope_range(self.fit.problem.regressors, term, name, shape) if name in shape else None
                    low, high = ends or library[term.effect].parameter(name).bounds
                    found.append(Sought(name, told.value, size, low, high, term=term))
        for i, drive in enumerate(drives_of(self.recordings)):
            for name, gain in ({} if drive is None else drive.told).items():
                if gain.interval is not None:
                    size = max((gain.interval[1] - gain.interval[0]) / 2, 1e-3 * gain.value)
                    found.append(Sought(name, gain.value, size, 0.0, np.inf, joint=i))
        low, high = inference.skew_interval or (-np.inf, np.inf)
        plain = self.fit.motion.commanded and self.fit.skew == NOMINAL_SKEW
        if high - low > SKEW_TOLD and any(drives_of(self.recordings)) and not plain:
            found.append(Sought(SKEW, max(self.fit.skew, 0.0), SKEW_STEP, 0.0, np.inf))
        return tuple(found)

    @cached_property
    def scaled(self) -> bool:
        """Whether stated inertias give the scale of a torque."""
        drives = (drive for drive in drives_of(self.recordings) if drive is not None)
        return any(drive.law.terms[0].name in drive.told for drive in drives)

    @cached_property
    def arm(self) -> DrivenArm:
        """The model under recorded torques, and under commands where drives have laws; the parameters are symbols."""
        symbols = ca.SX.sym("sought", len(self.sought))
        known = self.fit.prediction
        lumps: list[Any] = (self.fit.model.lumps_or(known.lumps) if self.scaled else known.lumps).tolist()
        values: dict[Term, dict[str, Any]] = {term: dict(own) for term, own in known.values.items()}
        closed = self.replay.commanded
        coefficients = {i: dict(own) for i, own in closed.coefficients.items()}
        for k, of in enumerate(self.sought):
            if of.lump is not None:
                lumps[of.lump] = symbols[k]
            elif of.term is not None:
                values[of.term][of.name] = symbols[k]
            elif of.joint is not None:
                coefficients[of.joint][of.name] = symbols[k]
        own: Any = Prediction(lumps, values, known.rotors)  # type: ignore[arg-type]
        equations = PlantEquations(self.fit.model, own, self.replay.made.widths, self.replay.made.torque)
        return replace(closed, coefficients=coefficients, equations=equations, free=symbols)

    @cached_property
    def start(self) -> Array:
        """(W, S) recorded states."""
        return self.arm.starts(self.replay.tracks, self.windows)

    def skew(self, theta: Array) -> float:
        """Samples by which the torque is taken later."""
        return next((float(x) for x, of in zip(theta, self.sought, strict=True) if of.name == SKEW), self.fit.skew)

    def read(self, theta: Array) -> Array:
        """What drives the windows."""
        return self.arm.read(replace(self.replay, skew=self.skew(theta)).tracks, self.windows)

    @cached_property
    def recorded(self) -> Array:
        """(W, K, n) positions."""
        return self.windows.cut(self.replay.tracks, "q_read")

    @cached_property
    def moving(self) -> list[int]:
        """Joints (0-based) that move."""
        return [i for i in range(self.fit.model.n) if np.isfinite(self.fit.motion.standstill[i])]

    def started(self, off: Array) -> Array:
        """Starts (W, S) with positions and rates off (W, 2 n) those recorded."""
        moved = self.start.copy()
        moved[:, : off.shape[1]] += off
        return moved

    def error(self, theta: Array, off: Array) -> Array:
        """(W, K, n') of the joints that move."""
        played = self.arm.play(self.started(off), self.read(theta), theta)
        return np.asarray((played - self.recorded)[:, :, self.moving])

    def scale(self, at: tuple[Array, Array]) -> Array:
        """(n',) the error of each joint's motion with some parameters and starts."""
        return np.asarray(np.maximum(np.sqrt(np.nanmean(self.error(*at) ** 2, axis=(0, 1))), 1e-12))


def _size(told: Estimate) -> float | None:
    """Half of an interval; a part of the value that is told only together with others, or is surer than that; None for
    what the fit does not tell."""
    if told.known_value is None or (told.known_interval is None and not told.with_others):
        return None
    low, high = told.known_interval or (told.value, told.value)
    least = SURE if told.known_interval else TANGLED
    return max((high - low) / 2, least * abs(told.value)) or None


def output_error(fit: Fit, recordings: Sequence[Recording], allowed: SearchSettings = SearchSettings()) -> OutputError:
    """The parameters of a fit, refined on the recordings that were fitted. Raises PlantError, RecordingError."""
    shooting = Shooting(fit, recordings)
    most = allowed.budget or GAUSS_NEWTON_STEPS
    with within(allowed.seconds):
        found = _searched(shooting, shooting.scale(_begin(shooting)), most)
    return _result(found, IterationsEntry.of(found.steps, most, [found.ended]))


@dataclass(frozen=True, eq=False)
class _Searched:
    """Where a search ended: parameters, starts, and the cost; after how many steps, and why."""

    search: _Search
    theta: Array
    off: Array
    cost: float
    steps: int
    ended: SearchEnd


def _begin(shooting: Shooting) -> tuple[Array, Array]:
    theta = np.array([of.value for of in shooting.sought])
    return theta, np.zeros((len(shooting.start), 2 * shooting.fit.model.n))


def _searched(shooting: Shooting, scale: Array, most: int) -> _Searched:
    """By at most so many steps."""
    search = _Search(shooting, scale)
    theta, off = _begin(shooting)
    best, steps = search.cost(theta, off), 0
    while steps < min(most, GAUSS_NEWTON_STEPS) and not is_late():
        stepped, steps = search.step(theta, off, best), steps + 1
        before = best
        if stepped is not None:
            theta, off, best = stepped
        if stepped is None or before - best < ENOUGH_FALL * best:
            return _Searched(search, theta, off, best, steps, "complete")
    ended: SearchEnd = "complete" if steps == GAUSS_NEWTON_STEPS else "budget" if steps == most else "time"
    return _Searched(search, theta, off, best, steps, ended)


def _result(found: _Searched, search: IterationsEntry) -> OutputError:
    """The parameters with their covariance, and the error of each joint's motion beside that of the fit."""
    after = found.search.shooting
    errors = after.error(*_begin(after)), after.error(found.theta, found.off)
    recorded = after.recorded[:, :, after.moving]
    moved = np.sqrt(np.mean((recorded - recorded[:, :1]) ** 2, axis=(0, 1)))
    seconds = after.windows.length * after.replay.tracks[0].dt
    entries = {
        joint: (_entry(errors[0][:, :, k], moved[k], seconds), _entry(errors[1][:, :, k], moved[k], seconds))
        for k, joint in enumerate(after.moving)
    }
    better = found.cost < found.search.cost(*_begin(after))
    covariance = found.search.covariance(found.theta, found.off)
    skew = after.skew(found.theta)
    return OutputError(after.sought, found.theta, covariance, len(after.start), entries, better, skew, search)


def _entry(error: Array, moved: float, seconds: float) -> MotionErrorEntry:
    rms = float(np.sqrt(np.mean(error**2)))
    share = rms / moved if moved > 0 else None
    return MotionErrorEntry(seconds=seconds, windows=len(error), rms=rms, share=share, promised=None, rest=None)


@dataclass(frozen=True, eq=False)
class _Search:
    """Gauss-Newton steps in the parameters, with the windows' starts eliminated.

    scale   (n',) by which the error of each joint's motion is weighed
    """

    shooting: Shooting
    scale: Array

    @cached_property
    def sizes(self) -> Array:
        """(k,) of steps."""
        return np.array([of.size for of in self.shooting.sought])

    @cached_property
    def doubt(self) -> Array:
        """(2 n,) standard deviations of the recorded starts."""
        track = self.shooting.replay.tracks[0]
        return np.maximum(np.concatenate([track.start_noise[0], track.start_noise[1]]), 1e-9)

    def cost(self, theta: Array, off: Array) -> float:
        """Mean squared weighted error and what the starts are off, infinite where the motion runs away."""
        error = self.shooting.error(theta, off) / self.scale
        total = np.sum(error**2) + np.sum((off / self.doubt) ** 2)
        return float(total) if np.isfinite(total) else np.inf

    def step(self, theta: Array, off: Array, cost: float) -> tuple[Array, Array, float] | None:
        """The parameters and starts after a step that lowers the cost, and that; None where none does."""
        found = self._reduced(theta, off)
        normal, gradient = found.normal, found.scores.sum(axis=0)
        if not np.isfinite(normal).all():
            return None
        low, high = (np.array([getattr(of, end) for of in self.shooting.sought]) for end in ("low", "high"))
        for damping in DAMPINGS:
            damped = normal + damping * np.diag(np.diag(normal))
            change = -np.linalg.lstsq(damped, gradient, rcond=1e-12)[0]
            moved = np.clip(theta + change * self.sizes, low, high)
            further = off + np.array([alone + slope @ change for alone, slope in found.starts])
            if (now := self.cost(moved, further)) < cost:
                return moved, further, now
        return None

    def _reduced(self, theta: Array, off: Array) -> _Reduced:
        """The normal equations about some parameters and starts."""
        total, scores, starts = np.zeros((len(theta), len(theta))), [], []
        for own, further, error, doubt in self._linear(theta, off):
            inner = np.linalg.inv(further @ further.T + np.diag(self.doubt**-2))
            pulled = further @ error + doubt
            total += own @ own.T - own @ further.T @ inner @ further @ own.T
            scores.append(own @ error - own @ further.T @ inner @ pulled)
            starts.append((-inner @ pulled, -inner @ further @ own.T))
        return _Reduced(total, np.array(scores), starts)

    def _linear(self, theta: Array, off: Array) -> list[tuple[Array, Array, Array, Array]]:
        """Of every window, weighted: derivatives of its error by the parameters (k, m) and by its start (2 n, m), the
        error (m,), and the gradient (2 n,) of what the start is off."""
        n, size = self.shooting.fit.model.n, self.shooting.start.shape[1]
        states = np.vstack([np.zeros((len(theta), size)), np.eye(2 * n, size)])
        parameters = np.vstack([np.diag(self.sizes), np.zeros((2 * n, len(theta)))])
        played, slopes = self.shooting.arm.slopes(
            self.shooting.started(off), self.shooting.read(theta), theta, states, parameters
        )
        moving = self.shooting.moving
        off_by = (played - self.shooting.recorded)[:, :, moving]
        for i, of in enumerate(self.shooting.sought):
            if of.name == SKEW:  # of what is read, which no symbol stands for
                later = self.shooting.error(theta + of.size * (np.arange(len(theta)) == i), off)
                slopes[:, i, :, moving] = np.moveaxis(later - off_by, 2, 0)
        error = (off_by / self.scale).reshape(len(off), -1)
        weighted = (slopes[:, :, :, moving] / self.scale).reshape(len(off), len(states), -1)
        k = len(theta)
        return [(w[:k], w[k:], e, o / self.doubt**2) for w, e, o in zip(weighted, error, off, strict=True)]

    def covariance(self, theta: Array, off: Array) -> Array:
        """(k, k) of the parameters, with errors that hang together within a window; infinite on the diagonal for one
        that the motion does not tell apart from others, or that has no derivative."""
        found = self._reduced(theta, off)
        if not np.isfinite(found.normal).all():
            return np.diag(np.full(len(theta), np.inf))
        scale = np.sqrt(np.maximum(np.diag(found.normal), 1e-300))
        value, vector = np.linalg.eigh(found.normal / np.outer(scale, scale))
        seen = value > SEPARABLE**2 * value.max(initial=0.0)
        bread = (vector[:, seen] / value[seen]) @ vector[:, seen].T / np.outer(scale, scale)
        windows = len(found.scores)
        meat = found.scores.T @ found.scores * windows / max(1, windows - len(theta))
        covariance = np.asarray(bread @ meat @ bread * np.outer(self.sizes, self.sizes))
        untold = np.any(np.abs(vector[:, ~seen]) > SOME, axis=1)
        covariance[untold, untold] = np.inf
        return covariance


@dataclass(frozen=True)
class _Reduced:
    """Normal equations in scaled parameters, with the windows' starts eliminated.

    normal   (k, k)     scores  (W, k) each window's part of the gradient
    starts   of every window the change of its start: what it is alone (2 n,), and its slope (2 n, k)
    """

    normal: Array
    scores: Array
    starts: list[tuple[Array, Array]]


def refined(
    fit: Fit, recordings: Sequence[Recording], allowed: SearchSettings = SearchSettings()
) -> tuple[Inference, list[Recording], OutputErrorEntry]:
    """A fit's inference and its recordings with the parameters and gains that output error found; as they are where it
    did not lower the motion's error. Raises PlantError, RecordingError."""
    found = output_error(fit, recordings, allowed)
    inference, told = fit.inference, list(recordings)
    if found.better:
        inference, told = found.inference(fit), [r.with_gains(found.told(recordings)) for r in recordings]
    entries = []
    for k, of in enumerate(found.sought):
        if of.name == SKEW:
            continue
        after = found.estimate(k, _told(fit, recordings, of))
        name = of.name if of.term is None else f"{of.term.name}: {of.name}"
        entries.append(
            RefinedParameter(
                joint=_joint_of(fit, of),
                name=name,
                unit=after.unit,
                before=of.value,
                after=after.value,
                interval=after.known_interval,
            )
        )
    motions = [
        RefinedMotion(joint=i + 1, unit=fit.model.joints[i].position_unit, before=before, after=after)
        for i, (before, after) in found.joints.items()
    ]
    entry = OutputErrorEntry(
        better=found.better, skew=found.skew, parameters=entries, motions=motions, search=found.search
    )
    return inference, told, entry


def _told(fit: Fit, recordings: Sequence[Recording], of: Sought) -> Estimate:
    """A parameter as the torque tells it."""
    if of.lump is not None:
        return fit.inference.lumps[of.lump]
    if of.term is not None:
        return fit.inference.values[of.term][of.name]
    drive = drives_of(recordings)[of.joint or 0]
    assert drive is not None, "a gain of no drive"
    gain = drive.told[of.name]
    return Estimate(gain.value, gain.interval, gain.unit)


def _joint_of(fit: Fit, of: Sought) -> int | None:
    if of.lump is not None:
        return fit.model.lumps[of.lump].joint
    return of.joint + 1 if of.joint is not None else of.term.joint if of.term is not None else None
