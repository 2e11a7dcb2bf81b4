"""Base inertial parameters as people see them: names, units, meanings, values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from symbolic.model_file.arm import Arm
from symbolic.model_file.checks import ModelError, nearest
from symbolic.rigid_body.exact_rank import BaseParameters, exact
from symbolic.rigid_body.layout import RecursionLayout


@dataclass(frozen=True)
class Lump:
    """A base inertial parameter. unit: e.g. "kg m^2"; joint: 1-based; value: what the model file says, None where it
    leaves out a number behind it; parts: of an arm in space, what is in it: joint (1-based), a parameter of its body
    (moments.INERTIA) or "I", the rotor, and by how much."""

    name: str
    unit: str
    meaning: str
    joint: int
    value: float | None
    parts: tuple[tuple[int, str, Fraction], ...] = ()


def named_lumps(arm: Arm, base: BaseParameters, layout: RecursionLayout) -> tuple[Lump, ...]:
    """The base parameters as people see them; values that an identification left in the file replace the links'.

    Raises ModelError for a value in the file whose name this arm does not have.
    """
    scale = exact(arm.lengths[layout.reference - 1]) if layout.reference else Fraction(1)
    lumps = []
    for (kind, i), value in base.values.items():
        sliding = arm.joints[i].type == "prismatic"
        power = layout.metres(kind)
        name = f"{'M' if sliding and kind == 'mu' else kind}{i + 1}"
        own = {"J": "kg m^2", "I": "kg" if sliding else "kg m^2", "mu": "kg", "h": "kg m", "hy": "kg m"}[kind]
        unit = "kg m^2" if power else own
        note = f", times l{layout.reference}{'^2' if power == 2 else ''}" if power else ""
        also = ", rotor included" if kind != "I" and any(c == ("I", i) for c, _ in base.merged[kind, i]) else ""
        stated = None if value is None else float(value * scale**power)
        text = _meaning(kind, i + 1, sliding, len(arm.joints)) + also + note
        lumps.append(Lump(name, unit, text, i + 1, stated))
    return overridden(arm, lumps)


def overridden(arm: Arm, lumps: Sequence[Lump]) -> tuple[Lump, ...]:
    """With the values that an identification left in the model file.

    Raises ModelError for a value in the file whose name this arm does not have.
    """
    names = [lump.name for lump in lumps]
    for name in arm.inertial:
        if name not in names:
            near = nearest(name, names)
            hint = f'; did you mean "{near}"?' if near else ""
            raise ModelError(
                f'{arm.name}: inertial: unknown base parameter "{name}"{hint} (this arm has {", ".join(names)})'
            )
    return tuple(replace(lump, value=arm.inertial.get(lump.name, lump.value)) for lump in lumps)


def _meaning(kind: str, joint: int, sliding: bool, n: int) -> str:
    end = "the end-effector" if joint == n else f"joint {joint + 1}"
    if kind == "mu":
        return f"mass that joint {joint} slides" if sliding else f"point mass that link {joint} carries at {end}"
    return {
        "J": f"inertia that turns with link {joint} about joint {joint}, beyond the point masses",
        "I": f"rotor inertia of joint {joint} at its output",
        "h": f"first mass moment of link {joint} along it, beyond the point masses",
        "hy": f"first mass moment of link {joint} across it, from a centre of mass off its line",
    }[kind]
