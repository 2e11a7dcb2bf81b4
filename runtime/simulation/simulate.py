"""Simulated recordings of a model, with hidden effects: to try a diagnosis with known truth.

The motion is prescribed, and the torque is computed by inverse dynamics plus all effects; encoder counts and torque
noise are added. No controller is simulated, and dry friction is zero at rest. See demo.py for a drive in closed loop.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from runtime.arrays import Array
from runtime.identification.grids import points
from runtime.identification.regressors import Regressors, Signals
from runtime.model.loader import Library, Model
from runtime.model.terms import OF_OTHERS, Prediction, Structure, Term, Values, check_complete, joints_of, structure
from runtime.motion.band import Band
from runtime.motion.filters import Smoother, differentiator, low_pass
from runtime.motion.motion import BandView, Motion
from runtime.motion.piece import Piece
from runtime.recordings.recording import Recording
from runtime.recordings.settings import LARGEST, MIN_SAMPLES
from runtime.simulation.equations import PlantError
from runtime.simulation.options import SimulationSettings
from runtime.simulation.settings import (
    AT_REST,
    COUNT,
    MARGIN,
    OWN_FRICTION,
    PATH_DEGREE,
    RANGE,
    RATE,
    RISE,
    SHARE,
    SIZING_CUTOFF,
    SLOW,
    SPEED,
    WARM,
    WARMING,
)
from symbolic.described import AnyEffect, numbered
from symbolic.model_file.arm import MOTOR_TORQUE, Torque
from symbolic.model_file.checks import Names, did_you_mean, effect_term, joint_number, known_joints, nearest, quote


class SimulationError(ValueError):
    """The requested simulation is impossible; the message says why and what to do."""


@dataclass(frozen=True)
class Hidden:
    """An effect in the recording that the model file lacks; `complete` chooses the values that are not stated."""

    term: Term
    values: Values


def parse_hidden(text: str, model: Model, option: str = "--hide") -> Hidden:
    """As `hidden_in`, for a loaded model."""
    hidden = hidden_in(
        text, model.library.effects, [joint.name for joint in model.joints], arm=model.name, option=option
    )
    name = hidden.term.effect
    if model.spatial and model.library[name].scope == "contact":
        raise SimulationError(
            f'{option} {text}: "{name}" is for planar arms, and {model.name} is spatial; choose another effect'
        )
    return hidden


def hidden_in(text: str, effects: Mapping[str, AnyEffect], joints: Names, arm: str, option: str = "--hide") -> Hidden:
    """Parses `EFFECT@JOINT[:KEY=VALUE,...]`; without @JOINT for effects of the arm or the contact.

    effects   the library by name     joints, arm   names of the joints and the arm     option   named in messages
    Raises SimulationError.
    """
    name, at, rest = effect_term(text, joints)
    usage = "write EFFECT@JOINT:KEY=VALUE,..., for instance stribeck@1:torque=0.6,speed=0.15"
    effect, which = numbered(name, effects)
    if effect not in effects:
        close = nearest(effect, effects)
        meant = f'did you mean "{close}"? ' if close else ""
        raise SimulationError(
            f"{option} {text}: there is no effect {quote(effect)}; {meant}(tendon effects lists them all)"
        )
    info = effects[effect]
    joint: int | None = None
    if info.scope in ("arm", "contact"):
        if at is not None:
            raise SimulationError(f'{option} {text}: "{name}" acts on the whole {info.scope}; leave out @{at}')
    else:
        able = joints[:-1] if info.scope == "joints" else joints
        if not able:
            raise SimulationError(f'{option} {text}: "{name}" acts on two joints and {arm} has one')
        joint = joint_number(at or "", able)
        if joint is None:
            where = f'found joint "{at or ""}", expected {known_joints(able)}'
            first = "" if able is joints else f' as the first of the two that "{name}" acts on'
            raise SimulationError(f"{option} {text}: {where}{first}; {usage}")
    values: Values = {}
    for assignment in filter(None, rest.split(",")):
        key, equals, value = assignment.partition("=")
        names = tuple(p.name for p in info.parameters)
        if key.strip() not in names:
            known = did_you_mean(key.strip(), names) if names else "it has none"
            raise SimulationError(f'{option} {text}: "{name}" has no parameter {quote(key.strip())}; {known}')
        try:
            values[key.strip()] = float(value)
        except ValueError as error:
            raise SimulationError(f'{option} {text}: found "{assignment}", expected a number; {usage}') from error
        if not equals or not isfinite(values[key.strip()]):
            raise SimulationError(f'{option} {text}: found "{assignment}", expected a finite number; {usage}')
    return Hidden(Term(effect, joint, which), values)


def simulate(
    model: Model,
    hidden: Sequence[Hidden] = (),
    settings: SimulationSettings = SimulationSettings(),
    motion: Array | Piece | None = None,
    torque: Torque | None = None,
) -> tuple[Recording, Structure]:
    """A recording at 1 kHz, and all effects in it with their values.

    motion   (n, N) positions at 1 kHz, or the result of `along`; None: the excitation of the settings
    torque   kind of the recorded torques, as the model file states it; None, and a drive with a law: the motor's torque
    Values that are not stated are chosen for `motion`, or for the excitation of the default seed, so that all seeds
    record the same arm. Raises SimulationError.
    """
    extra, noise = settings.extra, settings.noise
    rng = np.random.default_rng(settings.seed)
    if motion is None:
        piece = sizing = _excited(model, rng, settings)
        if settings.seed != SimulationSettings.seed:
            sizing = _excited(model, np.random.default_rng(SimulationSettings.seed), settings)
    else:
        piece = sizing = motion if isinstance(motion, Piece) else along(model, motion, "temperature" in extra)
    values = complete(model, sizing, _all_terms(model, hidden))
    if torque and any(joint.drive and joint.drive.law for joint in model.joints):
        torque = MOTOR_TORQUE
    signals = Signals(model, replace(piece, torque=torque or MOTOR_TORQUE), Prediction(model.lump_values, values))
    tau = _recorded(signals, values)
    level = np.sqrt(np.mean(tau**2, axis=1, keepdims=True))
    measured = tau + noise * level * rng.standard_normal(tau.shape)
    count = np.array([[COUNT[joint.type]] for joint in model.joints])
    made = replace(_recording(model, piece, measured, count), torque=torque)
    if "q_link" in extra:
        q = piece.q.copy()
        for term, known in values.items():
            deflection = signals.deflection(term, known)
            if deflection is not None:
                q[(term.joint or 1) - 1] -= deflection
        made = replace(made, q_link=np.round(q / count) * count)
    if "tau_link" in extra:
        effects = model.library.effects
        on_link = [t for t in values if effects[t.effect].side == "link" and not effects[t.effect].carried]
        output = _torque(signals, {term: values[term] for term in on_link}, signals.loads)
        level = np.sqrt(np.mean(output**2, axis=1, keepdims=True))
        made = replace(made, tau_link=output + noise * level * rng.standard_normal(output.shape))
    return made, values


def _excited(model: Model, rng: np.random.Generator, settings: SimulationSettings) -> Piece:
    path = excitation(model, rng, settings.seconds / settings.repeats, settings.repeats)
    return along(model, path, "temperature" in settings.extra)


def along(model: Model, path: Array, warm: bool = False) -> Piece:
    """A motion (n, N) at 1 kHz with its derivatives, for several simulations. warm: the joints warm up.

    Raises SimulationError.
    """
    if path.shape[0] != model.n or path.shape[1] < MIN_SAMPLES:
        raise SimulationError(
            f"the motion has {path.shape[0]} joints and {path.shape[1]} samples; "
            f"expected {model.n} joints of {model.name} and at least {MIN_SAMPLES} samples"
        )
    return _piece(model.library, path, warm)


def complete(model: Model, path: Array | Piece, terms: Structure) -> Structure:
    """The terms with all values; those not stated are 0 or moderate for the motion `path`, (n, N) at 1 kHz.

    0 are those of spatial arms only, so that a payload sits at the tip; and, if a linear parameter is stated, those of
    either sign, so that gravity with gx alone has that direction. Raises SimulationError if a value is out of bounds or
    cannot be chosen for this motion.
    """
    piece = path if isinstance(path, Piece) else _piece(model.library, path, warm=False)
    done: Structure = {}
    # Effects that read the torque of others come last.
    order = sorted(terms, key=lambda t: len(model.library.needs[t.effect] & OF_OTHERS))
    for term in order:
        info = model.library.effects[term.effect]
        sized = any(p.name in terms[term] for p in info.linear)
        either = [p for p in info.linear if sized and p.bounds[0] < 0 < p.bounds[1]]
        given = {**{p.name: 0.0 for p in info.parameters if p.space or p in either}, **terms[term]}
        if any(p.name not in given for p in info.parameters if p.role != "given"):
            given = {**_moderate(model, piece, term, stated=given, others=done), **given}
        for p in info.parameters:
            value = given.get(p.name, p.default)
            if value is None or not p.bounds[0] <= value <= p.bounds[1]:
                low, high = p.bounds
                raise SimulationError(f"{term}: {p.name} = {value}; expected a value from {low:g} to {high:g}")
        done[term] = given
    return {term: done[term] for term in terms}


def torque_along(model: Model, q: Array, qd: Array, qdd: Array, rate: float, values: Structure) -> Array:
    """Motor torques (n, N) along a motion, each (n, N) at `rate` Hz. values: of all parameters."""
    piece = _prescribed(model.library, q, qd, qdd=qdd, rate=rate, warm=False)
    signals = Signals(model, piece, Prediction(model.lump_values, values))
    return _torque(signals, values, signals.rigid)


def _torque(signals: Signals, values: Structure, without: Array) -> Array:
    """Torque (n, N) with the effects `values`, from that without effects."""
    tau = without.copy()
    for term in values:
        for joint in joints_of(signals.model, term):
            tau[joint] += signals.torque(term, joint)
    return tau


def _recorded(signals: Signals, values: Structure) -> Array:
    """Recorded torque (n, N), shifted at joints whose drive records it earlier or later than it acts.

    The law of such an effect is only its first-order approximation, which exaggerates fast changes. Raises
    SimulationError if the torque is not finite, or too large for a recording.
    """
    model = signals.model
    leads = {term: lead.name for term in values if (lead := model.library[term.effect].of_kind("lead")) is not None}
    tau = _torque(signals, {term: known for term, known in values.items() if term not in leads}, signals.rigid)
    for term, name in leads.items():
        for joint in joints_of(model, term):
            tau[joint] = led(tau[joint], signals.time(), values[term][name])
    if not np.isfinite(tau).all():
        infinite = []
        for term, known in values.items():
            if not all(np.isfinite(signals.torque(term, joint)).all() for joint in joints_of(model, term)):
                infinite.append(f"{term} with {', '.join(f'{name} = {value:g}' for name, value in known.items())}")
        of = "; ".join(infinite) or model.name
        raise SimulationError(f"the torque is not finite along this motion: {of}; choose other values")
    if (largest := float(np.abs(tau).max())) > LARGEST:
        raise SimulationError(
            f"along this motion the torque reaches {largest:.3g} N m (N at a prismatic joint), expected at most "
            f"{LARGEST:g}; choose a smaller effect or a slower motion"
        )
    return tau


def led(tau: Array, t: Array, time: float) -> Array:
    """A torque (N,) at times t (N,), shifted to `time` s earlier, with its ends held."""
    return np.interp(t + time, t, tau)


def _all_terms(model: Model, hidden: Sequence[Hidden]) -> Structure:
    terms = structure(model)
    for item in hidden:
        term = item.term
        while term in terms and model.library.effects[term.effect].several:
            term = replace(term, number=term.number + 1)
        if term in terms:
            raise SimulationError(
                f"--hide {item.term}: {model.name} already has this effect; hide another, or delete it from the file"
            )
        terms[term] = dict(item.values)
    return terms


def _piece(library: Library, path: Array, warm: bool) -> Piece:
    """A motion with derivatives, from a quintic spline through the positions. warm: with rising temperatures."""
    t = np.arange(path.shape[1]) / RATE
    spline = make_interp_spline(t, path, k=PATH_DEGREE, axis=1)
    q, qd, qdd = (np.ascontiguousarray(spline(t, nu)) for nu in range(3))
    return _prescribed(library, q, qd, qdd=qdd, rate=RATE, warm=warm)


def _prescribed(library: Library, q: Array, qd: Array, qdd: Array, rate: float, warm: bool) -> Piece:
    n, count = q.shape
    t = np.arange(count) / rate
    # Rounding errors must not cause friction at rest.
    qd = np.where(np.abs(qd) < AT_REST * np.abs(qd).max(), 0.0, qd)
    none = np.zeros((n, count))
    warmth = np.tile(RISE * -np.expm1(-t / (WARMING * t[-1])), (n, 1)) if warm else none
    return Piece(
        recording=0,
        run=1,
        dt=1 / rate,
        t=t,
        q=q,
        qd=qd,
        qdd=qdd,
        qdd_denoised=qdd,
        tau=none,
        warmth=warmth,
        measured=np.full(n, warm),
        low_pass=low_pass(SIZING_CUTOFF, rate, library),
        derive=differentiator(SIZING_CUTOFF, rate),
        wiener=(Smoother(np.ones(1)),) * n,
    )


def _moderate(model: Model, piece: Piece, term: Term, stated: Values, others: Structure) -> Values:
    """Values that give the term a moderate part of the torque: shape from the middle of its grid, size by SHARE."""
    info = model.library.effects[term.effect]
    silent = np.zeros(model.n)
    band = Band(silent + SIZING_CUTOFF, "simulated", silent, position_density=silent, resolution=silent)
    motion = Motion(band, (BandView(tuple(range(model.n)), (piece,)),), silent, silent)
    regressors = Regressors(model, motion, Prediction(model.lump_values, others))
    with np.errstate(divide="ignore", invalid="ignore"):
        grid = points(regressors, term)
    if not grid:
        needed = ", ".join(p.name for p in info.shape)
        raise SimulationError(f"{term}: no values can be chosen for this model and motion; state {needed}")
    # Of each axis of the grid the middle by rank; a third for begins, two thirds for ends.
    names = list(grid[0])
    part = {name: {"begin": 0.33, "end": 0.67}.get(info.parameter(name).kind, 0.55) for name in names}
    off = np.zeros(len(grid))
    for name in names:
        ranks = np.searchsorted(np.unique([g[name] for g in grid]), [g[name] for g in grid])
        off += np.abs(ranks - part[name] * ranks.max())
    linear = {p.name for p in info.linear}
    shape = {**grid[int(np.argmin(off))], **{k: v for k, v in stated.items() if k not in linear}}
    signals = regressors.signals(0)[0]
    rows, size = np.zeros(len(info.coefficients)), 0.0
    for joint in joints_of(model, term):
        columns = regressors.raw_columns(signals, term, joint, shape)[1:]
        rows = np.maximum(rows, np.sqrt(np.mean(columns**2, axis=1)))
        rigid = float(np.sqrt(np.mean(signals.rigid[joint] ** 2)))
        size = max(size, _known_size(model, term, joint) or rigid)
    if not all(row > 0 for row, c in zip(rows, info.coefficients, strict=True) if not c.space):
        raise SimulationError(f"{term}: this motion does not excite it; state its parameters or choose another motion")
    found = model.library.recover(term.effect, SHARE * size / np.where(rows > 0, rows, np.inf), shape)
    # The effect of a factor is its difference from its neutral value.
    sizes = {p.name: p.neutral + SHARE if p.neutral else found[p.name] for p in info.parameters}
    return {p.name: float(np.clip(sizes[p.name], *p.bounds)) for p in info.parameters}


def _known_size(model: Model, term: Term, joint: int) -> float:
    largest = model.joints[joint].torque_limit
    return 0.0 if largest is None or term not in structure(model) else OWN_FRICTION / SHARE * largest


def excitation(model: Model, rng: np.random.Generator, seconds: float, repeats: int) -> Array:
    """Positions (n, N) at 1 kHz: slow legs and cosines up to the limits of speed, `repeats` times.

    Every joint has its own frequencies and its own order of legs, so that all joints move differently.
    """
    half = round(seconds * RATE / 2)
    motions = []
    for joint in model.joints:
        low, high = joint.position_limits or (-RANGE[joint.type], RANGE[joint.type])
        middle, reach = (low + high) / 2, MARGIN * (high - low) / 2
        speed = MARGIN * (joint.speed_limit or SPEED[joint.type])
        moves = np.concatenate([_slow(rng, half, speed, reach), _fast(rng, half, speed, reach)])
        motions.append(middle + moves)
    return np.tile(np.stack(motions), (1, repeats))


def _slow(rng: np.random.Generator, count: int, speed: float, reach: float) -> Array:
    """Legs forth and back at constant low speeds, joined without jumps in acceleration."""
    leg = count // (2 * len(SLOW))
    rate = np.zeros(count)
    for k, part in enumerate(rng.permutation(SLOW) * rng.uniform(0.8, 1.2, len(SLOW))):
        rest = leg // 8
        fast = min(part * speed, reach / (leg / RATE))
        rate[2 * k * leg + rest : (2 * k + 1) * leg - rest] = fast
        rate[(2 * k + 1) * leg + rest : (2 * k + 2) * leg - rest] = -fast
    mean = np.full(max(1, leg // 16), 1 / max(1, leg // 16))
    return np.cumsum(np.convolve(np.convolve(rate, mean, "same"), mean, "same")) / RATE


def _fast(rng: np.random.Generator, count: int, speed: float, reach: float) -> Array:
    """Cosines from the slowest within the range up to about 10 Hz, faded in and out, scaled to the largest speed."""
    t = np.arange(count) / RATE
    lowest = speed / (2 * np.pi * reach)
    frequencies = np.geomspace(lowest, max(8.0, 2 * lowest), 7) * rng.uniform(0.85, 1.15, 7)
    amplitudes = frequencies**-1.5
    phases = rng.uniform(0, 2 * np.pi, 7)
    wave = np.sum(amplitudes[:, None] * np.cos(2 * np.pi * frequencies[:, None] * t + phases[:, None]), axis=0)
    fade = np.clip(np.minimum(t, t[::-1]) / 1.0, 0, 1)
    wave *= fade**3 * (10 - 15 * fade + 6 * fade**2)
    return wave * min(speed / np.abs(np.gradient(wave, t)).max(), reach / np.abs(wave).max())


def _recording(model: Model, piece: Piece, tau: Array, count: Array) -> Recording:
    samples = len(piece.t)
    return Recording(
        path=Path("simulation"),
        t=piece.t,
        run=np.ones(samples, dtype=np.int64),
        q=np.round(piece.q / count) * count,
        tau=tau,
        q_desired=piece.q,
        temperature=tuple(
            WARM + rise if there else None for rise, there in zip(piece.warmth, piece.measured, strict=True)
        ),
        segments=(slice(0, samples),),
        types=tuple(joint.type for joint in model.joints),
    )


def true_effects(model: Model, terms: Structure, changed: Sequence[Hidden], hidden: Sequence[Hidden]) -> Structure:
    """`terms` with changed values and hidden effects, whose values may still be missing.

    Raises PlantError if an effect to change is missing or one to hide exists; ModelError if the model lacks a value.
    """
    found = {term: dict(values) for term, values in terms.items()}
    for item in changed:
        if item.term not in found:
            raise PlantError(f"--set {item.term}: {model.name} does not have this effect; add it with --hide")
        if not item.values:
            raise PlantError(f"--set {item.term}: no value; write --set {item.term}:KEY=VALUE,...")
        found[item.term] |= item.values
    check_complete(model, found)
    for item in hidden:
        if item.term in found:
            raise PlantError(f"--hide {item.term}: {model.name} already has this effect; change its values with --set")
        found[item.term] = dict(item.values)
    return found
