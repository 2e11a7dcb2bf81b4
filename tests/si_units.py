"""Units as powers of kg, m, s and K, for checks by rescaling."""

from __future__ import annotations

from fractions import Fraction

from symbolic.units import Unit

_SI = {"N": (1, 1, -2, 0), "m": (0, 1, 0, 0), "kg": (1, 0, 0, 0), "s": (0, 0, 1, 0), "K": (0, 0, 0, 1)}
_JOINT: dict[str, dict[str, tuple[str, ...]]] = {
    "revolute": {"force": ("N", "m"), "position": ("rad",), "inertia": ("kg", "m", "m")},
    "prismatic": {"force": ("N",), "position": ("m",), "inertia": ("kg",)},
}


def exponents(unit: Unit, joint_type: str = "revolute") -> list[Fraction]:
    """Exponents of (kg, m, s, K); rad counts as 1."""
    total = [Fraction(0)] * 4
    for symbol, power in unit.powers:
        for name in _JOINT[joint_type].get(symbol, (symbol,)):
            for k, exponent in enumerate(_SI.get(name, (0, 0, 0, 0))):
                total[k] += power * exponent
    return total
