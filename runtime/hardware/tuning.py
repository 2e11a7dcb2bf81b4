"""What a model file lacks for its controller, proposed: gains, rate, filter, encoders, torque limits, unknown values.

The controller adds kp e + kd ė, at the joints' output, to the inverse dynamics. With kp = J ω² and kd = 2 J ω at every
joint, J its largest inertia, the linearised arm falls apart into modes of D v = μ diag(J) v, each a loop of one
inertia μ. One ω serves all joints; it is lowered until all modes of all sampled poses keep their margins.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import exp, log2, pi, sqrt
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.model.loader import Model
from runtime.model.terms import Term, joints_of, structure
from runtime.simulation.settings import RANGE
from runtime.simulation.simulate import complete, excitation, torque_along
from symbolic.model_file.arm import ProposedValue
from symbolic.model_file.checks import ModelError

BANDWIDTH = 5.0
"""Hz, of the position loop if nothing limits it: geared arms follow motions of seconds; a choice."""
DAMPING = 1.0
"""Damping ratio at the largest inertia; smaller inertias are damped more."""
MODULUS = 0.5
"""Smallest |1 + L|: a gain margin of 2 and a phase margin of 29° at least (Åström & Murray, Feedback Systems)."""
PHASE = 45.0
"""°, smallest phase margin."""
SPARE = (0.5, 1.5)
"""Inertias over and under those of the model at which the margins still hold."""
ELASTIC = 1.0 / 3.0
"""Largest bandwidth as a part of the lowest frequency at which a link swings on its elastic joint."""
RATE, CUTOFF = 1000.0, 200.0
"""Hz, of the control step and of the rates' low-pass; a choice."""
SCALE, SLOPE = 0.92, 150.0
"""c_u and c_e of (7) of friction that has been identified: those of the paper."""
RESOLUTION = {"revolute": 2.0 * pi / 2**18, "prismatic": 5e-6}
"""rad, m at the output that an encoder must tell apart."""
LEAST_COUNTS = 4096
"""Per turn of the motor: 1024 lines, four edges each."""
RESERVE = 1.5
"""Torque limit over the largest torque of fast motions."""
POSES, SECONDS, SEED = 2000, 20.0, 0
_STEP = 0.95
_SLOWEST = 0.05
"""Hz; no loop is proposed below."""
_DIGITS = 3


@dataclass(frozen=True)
class Loop:
    """The bandwidth of all joints, Hz; why it is not higher; inertia (n,) at the joints for which gains are meant."""

    bandwidth: float
    why: str
    inertia: Array


def effect_values(model: Model) -> Iterator[ProposedValue]:
    """Values of effects that the file leaves open, moderate along a test motion."""
    terms = {term: values for term, values in structure(model).items() if not model.library[term.effect].brought}
    unknown = [term for term, values in terms.items() if not _complete(model, term, values)]
    if not unknown:
        return
    motion = excitation(model, np.random.default_rng(SEED), SECONDS, 1)
    found = complete(model, motion, terms)
    for term in unknown:
        info = model.library[term.effect]
        table = ("contact", "effects", term.name) if info.scope == "contact" else ("effects", term.name)
        for p in info.parameters:
            if p.name not in terms[term] and p.default is None:
                yield _proposed(term.joint, table, p.name, found[term][p.name], "moderate, not measured")


def torque_limits(model: Model) -> Iterator[ProposedValue]:
    """Torque limits that the file does not state, by a test motion up to the limits of range and speed."""
    missing = [number for number, joint in enumerate(model.joints, 1) if joint.torque_limit is None]
    if not missing:
        return
    q = excitation(model, np.random.default_rng(SEED), SECONDS, 1)
    qd = np.gradient(q, 1.0 / RATE, axis=1)
    terms = {t: v for t, v in structure(model).items() if not model.library[t.effect].brought}
    largest = np.abs(torque_along(model, q, qd, np.gradient(qd, 1.0 / RATE, axis=1), RATE, terms)).max(axis=1)
    for number in missing:
        why = f"{RESERVE:g} times the largest of a test motion up to the limits of range and speed"
        yield _proposed(number, ("limits",), "torque", RESERVE * float(largest[number - 1]), why)


def shared(identified: bool) -> Iterator[ProposedValue]:
    """[controller]. identified: whether all values of effects stood in the file."""
    why = "the paper's" if identified else "off, as friction is not identified; about 0.9 once it is"
    yield _proposed(None, ("controller",), "rate", RATE, "what your drives allow")
    yield _proposed(None, ("controller",), "velocity_cutoff", CUTOFF, "low-pass on differentiated encoders")
    yield _proposed(None, ("controller",), "friction_scale", SCALE if identified else 0.0, f"c_u of (7); {why}")
    yield _proposed(None, ("controller",), "friction_slope", SLOPE, "c_e of (7); the paper's")


def encoders(model: Model) -> Iterator[ProposedValue]:
    """Encoder counts that the file does not state."""
    for number, joint in enumerate(model.joints, 1):
        if joint.encoder_counts is None:
            turn = 2.0 * pi / joint.gear_ratio
            counts = max(LEAST_COUNTS, 2 ** round(log2(max(1.0, turn / RESOLUTION[joint.type]))))
            fine = f"{turn / counts:.2g} {joint.position_unit} at the output"
            yield _proposed(number, ("encoder",), "counts", counts, f"{fine}; take it from the data sheet")


def gains(model: Model, loop: Loop, replaced: bool = False) -> Iterator[ProposedValue]:
    """Gains that the file does not state. replaced: those that it states, too."""
    omega = 2.0 * pi * loop.bandwidth
    for number, (joint, seen) in enumerate(zip(model.joints, loop.inertia, strict=True), 1):
        if joint.gains is None or replaced:
            of = f"{loop.bandwidth:.2g} Hz at the joint's largest inertia"
            yield _proposed(number, ("controller",), "kp", float(seen) * omega**2, of)
            kd = 2.0 * DAMPING * float(seen) * omega
            yield _proposed(number, ("controller",), "kd", kd, f"damping ratio {DAMPING:g} there")


def loop(model: Model, rate: float, cutoff: float) -> Loop:
    """The largest bandwidth up to BANDWIDTH at which all modes keep their margins.

    rate, cutoff   of the control step and of the low-pass on the rates, Hz
    Raises ModelError if there is none.
    """
    inertia = _inertias(model, _poses(model))
    largest = inertia.diagonal(axis1=1, axis2=2).max(axis=0)
    scale = 1.0 / np.sqrt(largest)
    modes = np.linalg.eigvalsh(inertia * scale[:, None] * scale)
    spread = np.geomspace(SPARE[0] * modes.min(), SPARE[1] * modes.max(), 9)
    delay, lag = _drive(model)
    limits = [(BANDWIDTH, "the largest that is proposed"), *_elastic(model, largest)]
    bandwidth, why = min(limits)
    while not _keeps_margins(rate, cutoff, bandwidth, spread, delay=delay, lag=lag):
        bandwidth *= _STEP
        why = f"by the margins at this rate and low-pass{' and this delay of the drive' if delay or lag else ''}"
        if bandwidth < _SLOWEST:
            raise ModelError(
                f"{model.name}: no gains keep a phase margin of {PHASE:g}° with a rate of {rate:g} Hz, a low-pass "
                f"of {cutoff:g} Hz and {1e3 * (delay + lag):.3g} ms of "
                "delay; raise rate and velocity_cutoff in [controller]"
            )
    return Loop(bandwidth, why, largest)


def _keeps_margins(rate: float, cutoff: float, bandwidth: float, modes: Array, *, delay: float, lag: float) -> bool:
    """Whether the sampled loop of every inertia μ has the margins: held torques, filtered differences of positions."""
    omega, T = 2.0 * pi * bandwidth, 1.0 / rate
    w = np.geomspace(0.05 * omega, 0.999 * pi * rate, 4000)
    z, s = np.exp(1j * w * T), 1j * w
    kept = exp(-2.0 * pi * cutoff / rate)
    differenced = (1.0 - kept) * rate * (1.0 - 1.0 / z) / (1.0 - kept / z)
    held = 0.5 * T**2 * (z + 1.0) / (z - 1.0) ** 2  # the double integrator behind a hold
    one = (omega**2 + 2.0 * DAMPING * omega * differenced) * held * np.exp(-s * delay) / (1.0 + s * lag)
    for mu in modes:
        L = one / mu
        above = np.flatnonzero(np.abs(L) >= 1.0)
        if not len(above) or above[-1] == len(w) - 1:
            return False
        phase = np.degrees(np.angle(-L[above[-1]]))
        if phase < PHASE or np.abs(1.0 + L).min() < MODULUS:
            return False
    return True


def _drive(model: Model) -> tuple[float, float]:
    """Delay and lag of the slowest joint's drive as far as the file states them, s."""
    terms = structure(model)

    def sums(kind: Any) -> float:
        each = np.zeros(model.n)
        for term, values in terms.items():
            p = model.library[term.effect].of_kind(kind)
            for joint in joints_of(model, term) if p is not None else ():
                each[joint] += max(0.0, values.get(p.name, 0.0)) if p is not None else 0.0
        return float(each.max())

    return sums("lead"), sums("lag")


def _elastic(model: Model, largest: Array) -> Iterator[tuple[float, str]]:
    """Bandwidths that elastic joints allow, Hz: a part of the frequency of the link on the held motor."""
    for term, values in structure(model).items():
        info = model.library[term.effect]
        p = info.of_kind("stiffness") if info.gives_way and term.joint else None
        if p is not None and term.joint is not None and (stiffness := values.get(p.name)):
            link = max(largest[term.joint - 1] - (model.joints[term.joint - 1].rotor_inertia or 0.0), 1e-9)
            swings = sqrt(stiffness / link) / (2.0 * pi)
            yield ELASTIC * swings, f"by {term}, on which the link swings at {swings:.3g} Hz"


def _poses(model: Model) -> Array:
    """(n, POSES) positions within the joints' ranges."""
    limits = [j.position_limits or (-RANGE[j.type], RANGE[j.type]) for j in model.joints]
    low, high = np.array(limits).T[:, :, None]
    return low + (high - low) * np.random.default_rng(SEED).random((model.n, POSES))


def _inertias(model: Model, q: Array) -> Array:
    """(N, n, n) inertia matrices with rotors, kg m² or kg."""
    return np.moveaxis(model.inertia(q), 2, 0)


def _complete(model: Model, term: Term, values: Mapping[str, float]) -> bool:
    return all(p.name in values or p.default is not None for p in model.library[term.effect].parameters)


def _rounded(value: float) -> float:
    return value if isinstance(value, int) else float(f"{value:.{_DIGITS}g}")


def _proposed(joint: int | None, table: tuple[str, ...], key: str, value: float, why: str) -> ProposedValue:
    return ProposedValue(joint, table, key, _rounded(value), why)
