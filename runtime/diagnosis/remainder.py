"""What a residual holds beyond noise: physics that comes back with the motion, or a disturbance from outside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis.gates import TORQUE
from runtime.diagnosis.settings import (
    ABOVE_NOISE,
    BURST_POWER,
    FORM_ABOVE_NOISE,
    FORM_PART,
    SLOW_AND_BURSTS,
    SLOW_DENSITY,
)
from runtime.diagnosis.steps import Step
from runtime.identification.compare import structure_shares
from runtime.model.catalogue import EffectInfo
from runtime.motion import spectra
from runtime.motion.band import LineAbove

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RepeatingResidual:
    """What comes back with the motion.

    part     of the residual's variance
    follows  the signal that it follows most, after an effect was added; None: not asked
    own      whether the added effect reads that signal: then its law has another form
    """

    part: float
    follows: str | None = None
    own: bool = False


@dataclass(frozen=True)
class Disturbance:
    """What does not come back with the motion: a line, a slow part or bursts.

    line     the strongest frequency, with its part of the power      slow    ratio of densities, low to upper band
    bursts   s at which seconds begin that are as bad as half of the second worst
    repeats  whether the recordings repeat any motion
    """

    line: spectra.SpectralLine | None
    slow: float | None
    bursts: tuple[float, ...]
    repeats: bool


Remainder = RepeatingResidual | Disturbance


def remainder(step: Step, joint: int) -> Remainder | None:
    """What a joint's residual (0-based) holds beyond noise; None if it is noise, white or evenly coloured."""
    return physics(step, joint) or outside(step, joint)


def physics(step: Step, joint: int) -> RepeatingResidual | None:
    """What comes back with the motion at a joint (0-based)."""
    s = step.joints[joint]
    # Errors of coarse encoder steps come back with the motion, too; they are in the instruments' noise.
    if s.floor.repeatable(s.rms) and s.rms > ABOVE_NOISE * s.floor.spectrum:
        return RepeatingResidual(min(1.0, ((s.floor.repeating or 0.0) / s.rms) ** 2))
    return None


def after_effect(step: Step, joint: int, effect: EffectInfo) -> Remainder | None:
    """What is left at a joint (0-based) once an effect was named and added; None if it is noise."""
    s = step.joints[joint]
    part = (s.floor.repeating or 0.0) ** 2 / s.rms**2 if s.rms else 0.0
    if part < FORM_PART or s.rms < FORM_ABOVE_NOISE * s.floor.spectrum:
        return outside(step, joint)
    shares = structure_shares(s)
    strongest = max(shares, key=lambda name: shares[name])
    signal = step.identification.model.library.signal
    own = {signal[name].seen_over for name in effect.signals}
    is_own = strongest in own or (strongest == "direction" and "velocity" in own)
    return RepeatingResidual(min(part, 1.0), strongest, is_own)


def lines_above(step: Step) -> list[LineAbove]:
    """Lines of the torque over the motor's angle above the band which would be named within it and are not known from
    below it."""
    model, known = step.identification.model, dict[int, list[float]]()
    for term, shape in step.shapes.items():
        line = model.library.effects[term.effect].line
        if line is not None and term.joint is not None:
            known.setdefault(term.joint - 1, []).append(shape[line.name])
    return [
        line
        for line in step.identification.motion.band.above
        if line.rms > TORQUE.limit * step.floors[line.joint]
        and not any(abs(line.order / order - 1) < 0.01 for order in known.get(line.joint, ()))
    ]


def outside(step: Step, joint: int) -> Disturbance | None:
    """A line, a slow part or bursts that stand out of the noise of a joint (0-based)."""
    found = step.identification
    motion, residual, use = found.motion, found.fit.residual[joint], found.motion.moving(joint)
    s = step.joints[joint]
    if not s.rms:
        return None
    noise, fixed_noise = found.problem.noise_rows(joint, found.fit.shapes)
    read = np.where(use, found.fit.coefficients @ noise + fixed_noise, 0.0)
    left, rate = motion.noise_left(joint), motion.row_rate(joint)
    # At least half is the torque's own noise, though the encoder's was estimated larger.
    white = max(s.rms**2 - float(np.mean(read[use] ** 2)), 0.5 * s.rms**2) if use.any() else 1.0
    expected = white * left / (np.mean(left[use]) if use.any() else 1.0) + _smooth(read**2, rate)
    worst, rows = spectra.bursts(residual, use, expected, rate)
    if motion.band.mistimed:
        # Noise is then loud where the motion is fast, and where the clocks that stamped it are apart.
        worst = 1.0
    slow = spectra.slow_over_white(residual, use, rate, motion.cutoff(joint))
    both = slow > SLOW_AND_BURSTS[0] and worst > SLOW_AND_BURSTS[1]
    line = spectra.strongest_line(residual, rate)
    is_slow = (slow > SLOW_DENSITY or both) and line is None
    in_bursts = worst > BURST_POWER or both
    if line is None and not is_slow and not in_bursts:
        return None
    times = tuple(float(t) for t in motion.row_time(joint)[rows]) if in_bursts else ()
    return Disturbance(line, slow if is_slow else None, times, s.floor.repeating is not None)


def _smooth(x: Array, rate: float) -> Array:
    # Of a motion of less than a second, over all of it.
    width = min(len(x), max(1, round(rate)))
    return np.convolve(x, np.full(width, 1 / width), "same")
