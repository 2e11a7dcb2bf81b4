"""What a residual holds beyond noise: physics that comes back with the motion, or a disturbance from outside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis.settings import (
    ABOVE_NOISE,
    BURST_POWER,
    FORM_ABOVE_NOISE,
    FORM_PART,
    LEAST_EFFECT,
    LEAST_WHITE,
    SAME_ORDER,
    SLOW_AND_BURSTS,
    SLOW_DENSITY,
    TIMES_SAID,
)
from runtime.diagnosis.steps import Step
from runtime.identification.compare import structure_shares
from runtime.model.loader import EffectInfo
from runtime.motion import spectra
from runtime.wording import per_turn

Array = NDArray[np.float64]


def remainder(step: Step, joint: int) -> str | None:
    """What a joint's residual (0-based) holds beyond noise, in words; None if it is noise, white or evenly coloured."""
    return physics(step, joint) or outside(step, joint)


def physics(step: Step, joint: int) -> str | None:
    """That something comes back with the motion, in words."""
    s = step.joints[joint]
    # Errors of coarse encoder steps come back with the motion, too; they are in the instruments' noise.
    if s.floor.repeatable(s.rms) and s.rms > ABOVE_NOISE * s.floor.spectrum:
        part = min(1.0, ((s.floor.repeating or 0.0) / s.rms) ** 2)
        return (
            f"{100 * part:.0f} % of its variance comes back with the motion, so physics is left: "
            "an effect that is not in the library, or one in another form"
        )
    return None


def after_effect(step: Step, joint: int, effect: EffectInfo) -> str | None:
    """What is left at a joint (0-based) once an effect was named and added, in words; None if it is noise."""
    s = step.joints[joint]
    part = (s.floor.repeating or 0.0) ** 2 / s.rms**2 if s.rms else 0.0
    if part < FORM_PART or s.rms < FORM_ABOVE_NOISE * s.floor.spectrum:
        return outside(step, joint)
    shares = structure_shares(s)
    strongest = max(shares, key=lambda name: shares[name])
    signal = step.identification.model.library.signal
    own = {signal[name].seen_over for name in effect.signals}
    share = f"{100 * min(part, 1.0):.0f} % of what is left comes back with the motion, most of it over {strongest}"
    if strongest in own or (strongest == "direction" and "velocity" in own):
        return f"{share}: {effect.name} is the right effect in another form than the library's law"
    return f"{share}: something else is missing beside {effect.name}, or it has another form than the library's law"


def above_band(step: Step) -> str:
    """That lines of the torque over the motor's angle lie above the band which would be named within it and are not
    known from below it, as the end of a sentence."""
    model, band = step.identification.model, step.identification.motion.band
    known: dict[int, list[float]] = {}
    for term, shape in step.shapes.items():
        line = model.library.effects[term.effect].line
        if line is not None and term.joint is not None:
            known.setdefault(term.joint - 1, []).append(shape[line.name])
    found = [
        f"joint {line.joint + 1}: a line at {per_turn(line.order, model.joints[line.joint].gear_ratio)} lies above its "
        f"band, which ends at {band.cutoffs[line.joint]:g} Hz, at {line.frequency:.3g} Hz"
        for line in band.above
        if line.rms > LEAST_EFFECT * step.floors[line.joint]
        and not any(abs(line.order / order - 1) < SAME_ORDER for order in known.get(line.joint, ()))
    ]
    return "".join(f"; {text}" for text in found)


def outside(step: Step, joint: int) -> str | None:
    """That a line, a slow part or bursts stand out of the noise, in words."""
    found = step.identification
    motion, residual, use = found.motion, found.fit.residual[joint], found.motion.moving(joint)
    s = step.joints[joint]
    if not s.rms:
        return None
    signs = []
    noise, fixed_noise = found.problem.noise_rows(joint, found.fit.shapes)
    read = np.where(use, found.fit.coefficients @ noise + fixed_noise, 0.0)
    left, rate = motion.noise_left(joint), motion.row_rate(joint)
    white = max(s.rms**2 - float(np.mean(read[use] ** 2)), LEAST_WHITE * s.rms**2) if use.any() else 1.0
    expected = white * left / (np.mean(left[use]) if use.any() else 1.0) + _smooth(read**2, rate)
    worst, rows = spectra.bursts(residual, use, expected, rate)
    if motion.band.mistimed:
        # Noise is then loud where the motion is fast, and where the clocks that stamped it are apart.
        worst = 1.0
    slow = spectra.slow_over_white(residual, use, rate, motion.cutoff(joint))
    both = slow > SLOW_AND_BURSTS[0] and worst > SLOW_AND_BURSTS[1]
    line = spectra.strongest_line(residual, rate)
    if line is not None:
        signs.append(f"{100 * line.share:.0f} % of it is at {line.frequency:.2f} Hz")
    if (slow > SLOW_DENSITY or both) and line is None:
        signs.append(f"it is {slow:.1f} times as dense at low frequencies as in the rest of the band")
    if worst > BURST_POWER or both:
        times = ", ".join(f"{t:.0f}" for t in motion.row_time(joint)[rows][:TIMES_SAID])
        signs.append(f"it comes in bursts, at {times} s")
    if not signs:
        return None
    back = "does not come back with the motion" + (
        "" if s.floor.repeating is not None else " as far as these data tell, which repeat none"
    )
    return f"{'; '.join(signs)}, and it {back}: a disturbance from outside, or noise that is not white"


def _smooth(x: Array, rate: float) -> Array:
    # Of a motion of less than a second, over all of it.
    width = min(len(x), max(1, round(rate)))
    return np.convolve(x, np.full(width, 1 / width), "same")
