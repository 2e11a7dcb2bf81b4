"""Units of signals and parameters, declared once for both joint types.

A unit is a product of powers of `force` (a joint's generalised force), `position` (a joint's coordinate), `inertia`
(force by acceleration), N, m, kg, s and K. At a revolute joint, force is N m, position rad and inertia kg m^2; at a
prismatic joint, N, m and kg.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

_JOINT: dict[str, dict[str, tuple[str, ...]]] = {
    "revolute": {"force": ("N", "m"), "position": ("rad",), "inertia": ("kg", "m", "m")},
    "prismatic": {"force": ("N",), "position": ("m",), "inertia": ("kg",)},
}


@dataclass(frozen=True)
class Unit:
    """A product of powers: ((symbol, exponent), ...), symbols out of force, position, inertia, N, m, kg, s, K."""

    powers: tuple[tuple[str, Fraction], ...] = ()

    def __mul__(self, other: Unit) -> Unit:
        total: dict[str, Fraction] = dict(self.powers)
        for symbol, power in other.powers:
            total[symbol] = total.get(symbol, Fraction(0)) + power
        return Unit(tuple((s, p) for s, p in total.items() if p))

    def __truediv__(self, other: Unit) -> Unit:
        return self * other**-1

    def __pow__(self, exponent: int) -> Unit:
        return Unit(tuple((s, p * exponent) for s, p in self.powers))

    def text(self, joint_type: str = "revolute") -> str:
        """The unit's text, e.g. `N m s/rad`; `1` if dimensionless."""
        names = _JOINT[joint_type]
        total: dict[str, Fraction] = {}
        for symbol, power in self.powers:
            for name in names.get(symbol, (symbol,)):
                total[name] = total.get(name, Fraction(0)) + power
        texts = [(p, s if abs(p) == 1 else f"{s}^{abs(p)}") for s, p in total.items()]
        above = " ".join(text for p, text in texts if p > 0)
        below = " ".join(text for p, text in texts if p < 0)
        if not below:
            return above or "1"
        return f"{above or '1'}/{below if ' ' not in below else f'({below})'}"


ONE = Unit()
FORCE = Unit((("force", Fraction(1)),))
POSITION = Unit((("position", Fraction(1)),))
NEWTON = Unit((("N", Fraction(1)),))
METRE = Unit((("m", Fraction(1)),))
KILOGRAM = Unit((("kg", Fraction(1)),))
SECOND = Unit((("s", Fraction(1)),))
KELVIN = Unit((("K", Fraction(1)),))
RATE = POSITION / SECOND
ACCELERATION = POSITION / SECOND**2
STIFFNESS = FORCE / POSITION
VISCOUS = FORCE * SECOND / POSITION
INERTIA = Unit((("inertia", Fraction(1)),))
