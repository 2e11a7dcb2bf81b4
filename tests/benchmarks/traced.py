"""Numbers that log how near every comparison with them came: what a threshold decides on a recording, in one pass.

A traced number carries its share of every result of arithmetic with it, to first order. Where such a result is
compared, the factor is logged by which the threshold would have to change for the comparison to flip.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np

_COMPARISONS = (np.less, np.less_equal, np.greater, np.greater_equal)

Logged = dict[str, list[float]]
"""By a threshold's name, the factors at which comparisons with it flip; 1 where that is not known."""


class TracedNumber(np.float64):
    """A float with the name of the threshold that it comes from, and by how much it changes as that grows e-fold."""

    name: str
    slope: float
    log: Logged

    @classmethod
    def of(cls, value: float, name: str, log: Logged, slope: float | None = None) -> TracedNumber:
        made = cls(value)
        made.name, made.log, made.slope = name, log, float(value) if slope is None else slope
        return made

    def __array_ufunc__(self, function: np.ufunc, method: str, *given: Any, **options: Any) -> Any:
        """A comparison with an array is logged; of any other function of arrays nothing is known, and its result leaves
        the trace."""
        plain = [float(x) if isinstance(x, TracedNumber) else x for x in given]
        if function in _COMPARISONS and len(given) == 2:
            self._flips(plain[0] if given[1] is self else plain[1])
        else:
            self.log[self.name].append(1.0)
        return getattr(function, method)(*plain, **options)

    def _result(self, operation: Callable[[Any, Any], Any], other: Any, slope: Callable[[float, float], float]) -> Any:
        """Of arithmetic with a number; of anything else nothing is known."""
        result = operation(float(self), other)
        if isinstance(other, int | float | np.number):
            return TracedNumber.of(result, self.name, self.log, slope(float(self), float(other)) * self.slope)
        self.log[self.name].append(1.0)
        return result

    def __add__(self, other: Any) -> Any:
        return self._result(lambda a, b: a + b, other, lambda *_: 1.0)

    def __sub__(self, other: Any) -> Any:
        return self._result(lambda a, b: a - b, other, lambda *_: 1.0)

    def __rsub__(self, other: Any) -> Any:
        return self._result(lambda a, b: b - a, other, lambda *_: -1.0)

    def __mul__(self, other: Any) -> Any:
        return self._result(lambda a, b: a * b, other, lambda _, b: b)

    def __truediv__(self, other: Any) -> Any:
        return self._result(lambda a, b: a / b, other, lambda _, b: 1 / b)

    def __rtruediv__(self, other: Any) -> Any:
        return self._result(lambda a, b: b / a, other, lambda a, b: -b / a**2)

    def __pow__(self, power: Any, _: None = None) -> Any:
        return self._result(lambda a, b: a**b, power, lambda a, b: b * a ** (b - 1))

    def __neg__(self) -> Any:
        return TracedNumber.of(-float(self), self.name, self.log, -self.slope)

    __radd__, __rmul__ = __add__, __mul__

    def _flips(self, other: Any) -> None:
        """Log the factors of the threshold at which this would equal the other, or each of many."""
        if self.slope:
            factors = 1 + (np.atleast_1d(np.asarray(other, dtype=float)) - float(self)) / self.slope
            factors = factors[np.isfinite(factors) & (factors > 0)]
            if len(factors):
                nearest = factors[np.argmin(np.abs(np.log(factors)))]
                self.log[self.name].append(float(nearest))
                return
        self.log[self.name].append(float("inf"))

    def __lt__(self, other: Any) -> Any:
        self._flips(other)
        return float(self) < other

    def __le__(self, other: Any) -> Any:
        self._flips(other)
        return float(self) <= other

    def __gt__(self, other: Any) -> Any:
        self._flips(other)
        return float(self) > other

    def __ge__(self, other: Any) -> Any:
        self._flips(other)
        return float(self) >= other

    __eq__, __ne__, __hash__ = np.float64.__eq__, np.float64.__ne__, np.float64.__hash__


def logged() -> Logged:
    return defaultdict(list)


def nearest(factors: list[float]) -> float:
    """The factor nearest to 1 at which any comparison flips; infinite where none does."""
    finite = [f for f in factors if np.isfinite(f)]
    return min(finite, key=lambda f: abs(np.log(f)), default=float("inf"))
