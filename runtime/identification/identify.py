"""Identification: base inertial parameters and effects of all joints at once, from recordings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, product
from typing import Literal

import numpy as np
from msgspec import UNSET
from scipy.ndimage import uniform_filter1d

from runtime.arrays import Array, Mask
from runtime.documents.fits import FitDocument
from runtime.documents.parts import DelayEntry
from runtime.identification.estimate import Estimate
from runtime.identification.fit import Fit, Inference
from runtime.identification.fitting import drivable, fit_motion
from runtime.identification.problem import Problem, Skew, configurations, weighted
from runtime.identification.regressors import Regressors, Signals
from runtime.identification.settings import BEAT_S, BEAT_WAVES, LASTING_BEAT
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term, joints_of, structure
from runtime.motion.band import choose_band, coupling_bound, credible_inertia, lowered, raised_to_lines, rigid_inertia
from runtime.motion.clock import grid
from runtime.motion.filters import Smoother
from runtime.motion.motion import Motion, prepare
from runtime.motion.rests import at_rest
from runtime.motion.settings import (
    CERTAIN,
    LITTLE,
    MOST,
    SMOOTHING_OVER_CUTOFF,
    SOME,
    STANDSTILL_OF_TOP_SPEED,
    WHITE_BAND,
)
from runtime.recordings.recording import Recording, RecordingError
from runtime.recordings.settings import FASTEST_STEP
from symbolic.model_file.arm import COMMAND, LINK_TORQUE


@dataclass(frozen=True)
class Unsound:
    """The check that a fit fails at a joint (0-based), with its value.

    worse than none    residual over torque, rms
    mostly noise       part of the torque's power that would be the encoders' noise
    worse than plain   residual over that of least squares without noise compensation, rms
    """

    check: Literal["worse than none", "mostly noise", "worse than plain"]
    joint: int
    value: float


def identify(model: Model, recordings: Sequence[Recording], skew: float | None = None) -> Fit:
    """Fit the model file's structure to recordings; `skew` in samples, None to estimate it."""
    return fit_motion(model, prepared(model, recordings), structure(model), skew)


def prepared(model: Model, recordings: Sequence[Recording]) -> Motion:
    """Recordings in the band that suits their noise and the model's inertia, without samples at which dry friction at
    the end-effector is indeterminate. Raises RecordingError.
    """
    return without_tip_rests(model, _as_it_acts(model, recordings, _in_its_band(model, recordings)))


def _as_it_acts(model: Model, recordings: Sequence[Recording], motion: Motion) -> Motion:
    """The motion with torques at uneven instants interpolated, or as commands that are held until the next, whichever
    the model explains better.

    A controller whose periods waver holds each command for its own period; interpolated, it counts for half of the
    periods to either side. That error is correlated with the rate measured a period before, and biases friction and
    inertia.
    """
    if motion.rigid_given or not any(grid(r).is_uneven for r in recordings):
        return motion
    held = prepare(recordings, replace(motion.band, held=True), model)
    if all(r.torque == COMMAND for r in recordings):
        return held
    signal, command = (fit_motion(model, m, structure(model)) for m in (motion, held))
    return (
        held
        if weighted(command.residual, signal.problem.weights) < weighted(signal.residual, signal.problem.weights)
        else motion
    )


def without_untold(fit: Fit) -> Motion:
    """The motion without rows of which its samples tell too little; the motion itself where there are none.

    They are those of `without_folded`, and those at which an encoder's steps beat with the samples, where that is heard
    beside the noise. Where a speed brings nearly a whole number of steps a sample, the steps' error is a slow wave: it
    has all its power in the band, comes back with the motion, and is a wave over the motor's angle.
    """
    motion = fit.motion
    return _without(motion, [_beats(fit, i) | _folded(fit, motion, i) for i in range(motion.n)])


def without_folded(fit: Fit, motion: Motion) -> Motion:
    """A motion without rows near which it is faster than its samples tell, by a fit's inertia; itself where it nowhere
    is.

    A torque is measured at instants: what of it is faster than half the rate of samples folds into the band. Of
    accelerations, which follow from positions, next to nothing does, as of a torque that a law makes of them. Where the
    band reaches nearly as far as the samples, what of the inertial torque lies above it stands for what is beyond them.
    """
    return _without(motion, [_folded(fit, motion, i) for i in range(motion.n)])


def _without(motion: Motion, rows: Sequence[Mask]) -> Motion:
    return motion.without_rows(rows) if any(mask.any() for mask in rows) else motion


def _folded(fit: Fit, motion: Motion, joint: int) -> Mask:
    use, pieces, above = motion.moving(joint), motion.pieces_of(joint), []
    reach = SMOOTHING_OVER_CUTOFF * motion.cutoff(joint) * pieces[0].dt
    if reach < WHITE_BAND[1] or motion.rigid_given or motion.feeds_back(joint) or not use.any():
        return np.zeros_like(use)
    for p in pieces:
        torque = np.einsum("jn,jn->n", fit.model.inertia(p.q, fit.prediction.lumps)[joint], p.qdd)
        fast = torque - Smoother(p.low_pass.kernel)(torque)
        above.append(uniform_filter1d(fast**2, p.low_pass.half | 1)[p.centres])
    square = np.concatenate(above)
    usual = np.median(square[use])  # noise of the encoders
    # Pulses of acceleration fall with the square of the frequency: of those above the band so much folds into it.
    folded: Mask = use & (LITTLE**2 * (square - usual) > motion.band.torque_floor()[joint] ** 2)
    return folded


def _beats(fit: Fit, joint: int) -> Mask:
    """(M,) rows of a joint (0-based) at which its encoder's steps beat with the samples, loud enough to be heard."""
    motion, use, step = fit.motion, fit.motion.moving(joint), fit.motion.band.resolution[joint]
    rate, none = 1 / motion.pieces_of(joint)[0].dt, np.zeros(len(use), dtype=bool)
    if not step or not use.any():
        return none
    cutoff, steps = motion.cutoff(joint), np.abs(motion.rows("qd", joint)[joint]) / (step * rate)
    beat = rate * np.abs(steps - np.round(steps)) / cutoff
    noise = np.mean(fit.problem.reread(joint, fit.shapes, fit.coefficients)[use] ** 2)
    loud = noise * _beat_power(beat, rate / cutoff) > SOME * np.mean(fit.residual[joint][use] ** 2)
    # The beat is in the speed of each row, too, which scatters about that of the stretch.
    width = max(1, round(BEAT_S * motion.row_rate(joint)))
    lasting: Mask = use & (uniform_filter1d((use & loud).astype(float), width) > LASTING_BEAT)
    return lasting


def _beat_power(beat: Array, rate: float) -> Array:
    """In-band power (M,) of the acceleration of steps that beat, over that of steps whose error is white.

    beat (M,) and rate: frequencies of the beat and of the samples, over the cut-off

    A beat is a sawtooth of one step's height, whose m-th wave has an amplitude of step / (pi m); white errors have
    a variance of step^2 / 12 up to half the rate.
    """
    waves = np.floor(1 / np.maximum(beat, 1 / BEAT_WAVES))
    inside = np.where(beat < 1, beat**4 * waves * (waves + 1) * (2 * waves + 1) / 6, 0.0)
    power: Array = 15 * rate / np.pi**2 * inside
    return power


def without_tip_rests(model: Model, motion: Motion) -> Motion:
    """As `without_torques_at_tip_rests`, with the values of a fit; the motion as it is where nothing rubs there."""
    known = structure(model)
    if not rubbing_at_tip(model, known):
        return motion
    return without_torques_at_tip_rests(model, motion, fit_motion(model, motion, known).prediction)


def _in_its_band(model: Model, recordings: Sequence[Recording]) -> Motion:
    """Recordings in the band that suits their noise and the model's inertia.

    A far too small inertia in the model file makes that band too wide: then the first lower band in which the share of
    the encoders' noise in the inertial columns can be compensated. Raises RecordingError.
    """
    refuse_copies(recordings)
    refuse_two_sides(recordings)
    refuse_fast_clocks(recordings)
    given = rigid_inertia(recordings)
    inertia = _inertia(model, recordings) if given is None else np.diag(given)
    ratios = [joint.gear_ratio for joint in model.joints]
    band = raised_to_lines(recordings, choose_band(recordings, inertia), inertia, ratios)
    first = motion = prepare(recordings, band, model)
    for _ in range(6):  # to an eighth
        if motion.rigid_given or _compensated(model, motion) <= MOST:
            return motion
        # The noise of an acceleration falls to a sixth each time.
        lower = lowered(motion.band, float(np.sqrt(0.5)))
        if lower is None:
            break
        motion = prepare(recordings, lower, model)
    # A joint that hardly moves has only noise in any band; the others keep theirs.
    return first


def refuse_copies(recordings: Sequence[Recording]) -> None:
    """Raises RecordingError where two recordings hold the same samples: they would count twice, or judge themselves."""
    for one, other in combinations(recordings, 2):
        if np.array_equal(one.q, other.q) and np.array_equal(one.tau, other.tau):
            same = str(one.path) == str(other.path)
            what = "is given twice" if same else f"holds the same samples as {one.path}"
            expected = "expected every recording once, fitted or held out; leave one out"
            raise RecordingError(f"{other.path}: {what}; {expected}")


def refuse_two_sides(recordings: Sequence[Recording]) -> None:
    """Raises RecordingError where torques of some recordings were measured at the link and those of others were not:
    they have no friction in common."""
    links = [r for r in recordings if r.torque == LINK_TORQUE]
    others = [r for r in recordings if r.torque != LINK_TORQUE]
    if links and others:
        raise RecordingError(
            f"{others[0].path}: its torque is the motor's and that of {links[0].path} is measured at the link, without "
            "the motor's friction and rotor; give them one after the other"
        )


def refuse_fast_clocks(recordings: Sequence[Recording]) -> None:
    """Raises RecordingError where samples are so dense that the filters would be longer than the recording."""
    for recording in (r for r in recordings if r.dt < FASTEST_STEP):
        cell = recording.cells.get("t", "t").split(" [")[0]
        raise RecordingError(
            f"{recording.path}: the median step of t is {recording.dt:.4g} s; expected at least {FASTEST_STEP:g} s "
            f'between samples; if t is in s, pass --map t="{cell} [s]", else write t in seconds'
        )


@lru_cache(maxsize=2)
def uncorrected(fit: Fit) -> Inference | None:
    """The same fit with no skew correction and no row left out; None where no skew was estimated, or where the fit
    leaves a transmission nothing to drive."""
    if not fit.skew_free or not drivable(fit.model, fit.motion, tuple(fit.shapes), fit.prediction):
        return None
    known = {t: dict(v) for t, v in fit.shapes.items()}
    return fit_motion(fit.model, fit.motion.with_standstill, known, skew=0.0, start=fit).inference


def fit_document(fit: Fit) -> FitDocument:
    """Every figure of a fit; intervals are 95 %."""
    plain = uncorrected(fit)
    return fit.inference.document(fit.model).as_part_of(
        FitDocument,
        band=fit.motion.band.document(),
        skew=fit.inference.skew_entry(),
        delay=delay_entries(fit),
        uncorrected=None if plain is None else plain.document(fit.model),
    )


def _inertia(model: Model, recordings: Sequence[Recording]) -> Array:
    """(n, n) kg m² (kg), RMS of the model file's D over the recordings' configurations, as far as it is credible."""
    n = model.n
    if not model.lumps_known:
        return coupling_bound(np.full((n, n), np.nan), credible_inertia(np.full(n, np.nan), recordings))
    own = np.diagonal(model.inertia(np.zeros((n, 1)))[:, :, 0]).copy()
    q = configurations([r.q for r in recordings])
    return coupling_bound(np.sqrt(np.mean(model.inertia(q) ** 2, axis=2)), credible_inertia(own, recordings))


# --- rests of the end-effector ---

TIP_RATE = "tip_rate"
"""The arm's function whose values are rates of the end-effector."""


def rubbing_at_tip(model: Model, terms: Iterable[Term]) -> list[tuple[Term, str]]:
    """Terms without internal states that read a rate of the end-effector, and the name of that signal."""
    library = model.library
    of_tip = {
        name
        for name, signal in library.signal.items()
        if isinstance(signal.source, dict) and signal.source.get("function") == TIP_RATE
    }
    plain = ((term, library.effects[term.effect]) for term in terms)
    return [(term, name) for term, info in plain if not info.states for name in info.signals if name in of_tip]


def without_torques_at_tip_rests(model: Model, motion: Motion, prediction: Prediction) -> Motion:
    """The motion without the samples at which the end-effector rests or turns under dry friction of its own.

    That friction is indeterminate there, and acts on every joint, moving or not: where a plate sticks at the end of a
    stroke, all joints that press it may be moving.
    """
    largest, floor, unknown = np.zeros(model.n), motion.band.torque_floor(), []
    here, again = (Regressors(model, m, prediction) for m in (motion, motion.perturbed))
    for view in motion.views:
        signals, perturbed = (regressors.signals(view.joints[0]) for regressors in (here, again))
        samples: list[Mask] = [np.zeros(piece.q.shape, dtype=bool) for piece in view.pieces]
        for term, name in rubbing_at_tip(model, prediction.values):
            slow = _standstill_of_tip(signals, perturbed, term, name)
            joints = [i for i in joints_of(model, term) if i in view.joints]
            for (along, excluded), i in product(zip(signals, samples, strict=True), joints):
                dry, piece = _dry_friction(along, term, name, joint=i, rate=slow), along.piece
                rests = at_rest(np.asarray(along.of(term, i)[name]), piece.dt, piece.low_pass.cutoff, slow)
                excluded[i] |= rests & (dry > floor[i])
                largest[i] = max(largest[i], dry.max(where=excluded[i], initial=0.0))
        unknown.append(samples)
    quiet = np.divide(floor[: model.n], largest, out=np.full(model.n, np.inf), where=largest > 0)
    quiet = np.minimum(motion.quiet, quiet)
    views = tuple(
        replace(view, pieces=tuple(p.unknown_at(x, quiet) for p, x in zip(view.pieces, samples, strict=True)))
        for view, samples in zip(motion.views, unknown, strict=True)
    )
    return replace(motion, views=views, quiet=quiet)


def _standstill_of_tip(signals: Sequence[Signals], perturbed: Sequence[Signals], term: Term, name: str) -> float:
    """Rate below which the end-effector rests: as of a joint, from its noise and its top speed."""
    own, other = (
        np.concatenate([np.asarray(s.of(term, joints_of(s.model, term)[0])[name]) for s in side])
        for side in (signals, perturbed)
    )
    noise = float(np.sqrt(np.mean((other - own) ** 2)))
    return max(CERTAIN * noise, STANDSTILL_OF_TOP_SPEED * float(np.abs(own).max()))


def _dry_friction(signals: Signals, term: Term, name: str, joint: int, rate: float) -> Array:
    """(N,) half of the step in a term's torque at a joint (0-based) as a rate changes its sign."""
    assert signals.prediction is not None
    values, read = signals.prediction.values[term], signals.of(term, joint)
    ahead, library = np.full(len(signals.piece.t), rate), signals.model.library
    sides = [library.torque(term.effect, {**read, name: x}, values, signals.piece.dt) for x in (ahead, -ahead)]
    return np.asarray(np.abs(sides[0] - sides[1]) / 2)


def delay_entries(fit: Fit) -> list[DelayEntry]:
    """The whole delay from torque to motion of every joint, or from the command to the torque that a law makes of it,
    s, as verbs print it: what is assumed of it (half a sample of a hold) and what is estimated, the shift between the
    samples or an effect that leads."""
    model, inference, dt = fit.model, fit.inference, fit.motion.pieces[0].dt
    document = []
    for joint in range(1, model.n + 1):
        shift = dt * inference.skew
        assumed, estimated, interval = shift, 0.0, None
        if inference.skew_interval is not None:
            assumed, estimated = 0.0, shift
            interval = (dt * inference.skew_interval[0], dt * inference.skew_interval[1])
        for found in _leads(model, inference, joint):
            estimated += found.value
            interval = None if found.interval is None else (found.interval[0] + shift, found.interval[1] + shift)
        document.append(
            DelayEntry(
                joint=joint,
                value=assumed + estimated,
                unit="s",
                interval=interval,
                assumed=assumed,
                estimated=estimated,
                hold=dt if any(fit.motion.driven[joint - 1 : joint]) else UNSET,
            )
        )
    return document


def _leads(model: Model, inference: Inference, joint: int) -> list[Estimate]:
    """Times by which effects say that a joint's recorded torque is ahead; a lag delays slow motion by its time
    constant."""
    found = []
    for term, values in inference.values.items():
        info = model.library.effects[term.effect]
        time = info.of_kind("lead") or info.of_kind("lag")
        if time is not None and joint - 1 in joints_of(model, term):
            found.append(values[time.name])
    return found


# whether a fit may be believed ---------------------------------------------------------------------------------------
#
# The encoders' noise is subtracted from the Gram matrix. Where it is most of a column, the rest is a difference of two
# large estimates: it may be negative, or so small that a coefficient becomes arbitrary. Such a fit leaves more than
# plain least squares would, and at last more than no model at all. Source: errors in variables and their compensation,
# Söderström, Automatica 43, 2007; that the compensated estimate exists only where the compensated matrix is positive,
# Fuller, Measurement Error Models, 1987, section 2.5.


def _compensated(model: Model, motion: Motion) -> float:
    """The largest part of an inertial column's power that is the encoders' noise; 0 without such columns."""
    regressors = Regressors(model, motion)
    power, noise = np.zeros(len(model.lumps)), np.zeros(len(model.lumps))
    for i in range(model.n):
        use = motion.moving(i)
        x = regressors.rigid(i)[:, use]
        power += np.sum(x**2, axis=1)
        noise += np.sum((regressors.perturbed.rigid(i)[:, use] - x) ** 2, axis=1)
    return float(np.max(np.divide(noise, power, out=np.zeros_like(power), where=power > 0), initial=0.0))


def unsound(fit: Fit) -> dict[int, Unsound]:
    """Joints (0-based) whose fit contradicts itself, and by what."""
    found: dict[int, Unsound] = {}
    for check in (_worse_than_none, _mostly_noise, _worse_than_plain):
        for unsound_one in check(fit):
            found.setdefault(unsound_one.joint, unsound_one)
    return found


def _worse_than_none(fit: Fit) -> Iterator[Unsound]:
    for i, left in enumerate(fit.residual):
        use = fit.motion.moving(i)
        torque = float(np.sum(fit.motion.torque(i, fit.skew)[use] ** 2))
        if (rest := float(left[use] @ left[use])) > torque:
            yield Unsound("worse than none", i, float(np.sqrt(rest / max(torque, 1e-300))))


def _mostly_noise(fit: Fit) -> Iterator[Unsound]:
    """What another reading of the encoders would change in a joint's predicted torque, against that torque."""
    for i in range(fit.model.n):
        use = fit.motion.moving(i)
        read = fit.problem.reread(i, fit.shapes, fit.coefficients)[use]
        torque = fit.motion.torque(i, fit.skew)[use]
        part = float(read @ read) / max(float(torque @ torque), 1e-300)
        if part > MOST:
            yield Unsound("mostly noise", i, part)


def _worse_than_plain(fit: Fit) -> Iterator[Unsound]:
    for i, (mine, theirs) in enumerate(zip(_squares(fit.problem, fit.residual), _plain(fit), strict=True)):
        # Noise that is that part of a column makes plain least squares leave so much of what the truth does.
        if MOST * mine > theirs:
            yield Unsound("worse than plain", i, float(np.sqrt(mine / max(theirs, 1e-300))))


def _squares(problem: Problem, residual: Sequence[Array]) -> list[float]:
    return [float(w**2 * (r @ r)) for w, r in zip(problem.weights, residual, strict=True)]


def _plain(fit: Fit) -> list[float]:
    system = fit.problem.system(fit.shapes, Skew(fit.skew)).without_noise()
    return _squares(fit.problem, system.residual(system.least(fit.problem.inertia_cuts)))
