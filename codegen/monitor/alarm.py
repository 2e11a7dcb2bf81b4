"""How high a cumulative sum may rise before it is an alarm, so that false alarms are as rare as stated.

A window's energy over its floor is scored in half octaves, which are whole numbers; the sum of scores less a reference,
never below zero, is then a Markov chain with few states, and its average run length is the solution of linear
equations, without simulation. Source: the sum, Page, Biometrika 41, 1954; the chain, Brook & Evans, Biometrika 59,
1972; sums of scores, Munford, Applied Statistics 29, 1980.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from codegen.monitor.settings import BREAK, DRIFT, LEVELS, STEPS_A_LEVEL, WINDOW

Array = NDArray[np.float64]

_THOUSAND_HOURS = 3.6e6
"""s."""
_HIGHEST = 4096
"""Steps; no sum needs more."""


def degrees_of_freedom(cutoff: float) -> float:
    """Of the energy in a window of white noise behind two equal first-order low-passes of this corner, Hz.

    2 T (∫S)²/∫S² of the density S = 1/(1 + (f/f_c)²)². Source: Blackman & Tukey 1958.
    """
    return 4 / 5 * pi * WINDOW * cutoff


def score_probabilities(freedom: float) -> Array:
    """(S,) of the scores 0, 1, … of a window while the model holds: chi-squared over its degrees of freedom."""
    from scipy.special import gammainc  # slow to import, as is all of SciPy; monitors alone need it

    first, last = LEVELS
    edges = 2.0 ** (np.arange(first, last) / 2)
    below = gammainc(freedom / 2, freedom / 2 * edges)
    return np.diff(np.concatenate([[0.0], below, [1.0]]))


def run_length(probabilities: Array, reference: int, alarm: int) -> float:
    """Average number of windows until a sum that begins at zero reaches `alarm`; scores count STEPS_A_LEVEL each."""
    from scipy.linalg import solve

    moves = STEPS_A_LEVEL * np.arange(len(probabilities)) - reference
    to = np.maximum(np.arange(alarm)[:, None] + moves, 0)
    chain = np.zeros((alarm, alarm))
    for state, ends in enumerate(to):
        inside = ends < alarm
        np.add.at(chain[state], ends[inside], probabilities[inside])
    return float(solve(np.eye(alarm) - chain, np.ones(alarm))[0])


@dataclass(frozen=True)
class Alarm:
    """Of a joint, in steps of the sums.

    reference, broken_reference   taken from a window's score      level   at which a sum is an alarm
    hours                         of judged motion between two false alarms of the joint
    """

    reference: int
    broken_reference: int
    level: int
    hours: float


def alarm(freedom: float, false_alarms: float, joints: int) -> Alarm:
    """The lowest alarm with at most so many false ones in a thousand hours of motion of an arm with so many joints."""
    probabilities = score_probabilities(freedom)
    mean = float(probabilities @ np.arange(len(probabilities)))
    reference, broken = (ceil(STEPS_A_LEVEL * (mean + above)) for above in (DRIFT, BREAK))
    least = _THOUSAND_HOURS * joints / false_alarms / WINDOW
    low, high = 1, 2
    while run_length(probabilities, reference, high) < least and high < _HIGHEST:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if run_length(probabilities, reference, middle) < least else (low, middle)
    hours = run_length(probabilities, reference, high) * WINDOW / 3600
    return Alarm(reference, broken, high, hours)
