"""What signals say of each other without a model: units and signs of rates, joints exchanged, torques that brake.

A rate is the derivative of its position, so that its integral tells its scale with no noise of differentiation. A joint
that comes back has taken up what its friction dissipates: the work of its torque is positive.
"""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

from runtime.estimation.suspicions import Suspicion
from runtime.inspection.settings import AGAINST_MOTION, FOLLOWS, MANY_TURNS, RETURNED, SCALE_OFF
from runtime.inspection.shifts import integral, scale
from runtime.recordings.cures import in_unit, read_from, turned_round
from runtime.recordings.recording import Recording
from runtime.recordings.units import UNITS

Array = NDArray[np.float64]


def without_model(recording: Recording) -> list[Suspicion]:
    """What looks wrong with positions and torques where no model tells it better."""
    return [*_turns(recording), *_braking(recording)]


def of_rates(recording: Recording) -> list[Suspicion]:
    """Measured rates that are no derivatives of their positions."""
    found: list[Suspicion] = []
    if recording.qd is None:
        return found
    samples = max(recording.segments, key=lambda s: s.stop - s.start)
    t, q = recording.t[samples], recording.q[:, samples]
    rates = {i: integral(t, qd[samples]) for i, qd in enumerate(recording.qd) if np.isfinite(qd).all() and np.ptp(q[i])}
    moved = [i for i in rates if np.ptp(rates[i]) > 0]
    for i in moved:
        factor, explained = scale(q[i], rates[i], t)
        if explained > FOLLOWS:
            found += _scaled(recording, i, factor)
            continue
        others = {j: scale(q[i], rates[j], t)[1] for j in moved if j != i}
        best = max(others, key=lambda j: others[j], default=None)
        if best is not None and others[best] > FOLLOWS:
            cure = read_from(recording.cells, f"qd{i + 1}", f"qd{best + 1}")
            said = f"qd{best + 1} is the derivative of q{i + 1}, and qd{i + 1} is not"
            found.append(Suspicion(i + 1, "exchanged", said, f"expected both under one number: pass {cure}"))
    return found


def _scaled(recording: Recording, joint: int, factor: float) -> list[Suspicion]:
    """A rate that is a multiple of its position's derivative."""
    if abs(abs(factor) - 1) < SCALE_OFF and factor > 0:
        return []
    q, qd, cells = f"q{joint + 1}", f"qd{joint + 1}", recording.cells
    said = f"{qd} is {factor:.3g} times the derivative of {q}"
    if abs(abs(factor) - 1) < SCALE_OFF:
        cure = f"expected the same sign: pass {turned_round(cells, qd)}, or {turned_round(cells, q)}"
        return [Suspicion(joint + 1, "sign", said, cure)]
    units = {
        1 / UNITS["deg/s"][1]: in_unit(cells, qd, "deg/s"),
        UNITS["deg"][1]: in_unit(cells, q, "deg"),
        1 / UNITS["rpm"][1]: in_unit(cells, qd, "rpm"),
        1 / UNITS["mrad/s"][1]: in_unit(cells, qd, "mrad/s"),
    }
    fitting = [c for size, c in units.items() if abs(abs(factor) / size - 1) < SCALE_OFF]
    if not fitting:
        return [Suspicion(joint + 1, "unit", said, f"is the unit of {qd}, of {q} or of t right? State it with --map")]
    return [Suspicion(joint + 1, "unit", said, f"expected rad and rad/s: pass {fitting[0]}")]


def _turns(recording: Recording) -> list[Suspicion]:
    """Positions over many turns that no unit was stated of."""
    found = []
    for i, q in enumerate(recording.q):
        turns = float(np.ptp(q)) / (2 * pi)
        cell = recording.cells.get(f"q{i + 1}", "")
        if recording.types[i] == "revolute" and turns > MANY_TURNS and "[" not in cell:
            cure = f"if it is in degrees, pass {in_unit(recording.cells, f'q{i + 1}', 'deg')}"
            found.append(Suspicion(i + 1, "degrees", f"its position covers {turns:.3g} turns", cure))
    return found


def _braking(recording: Recording) -> list[Suspicion]:
    """Joints whose torque takes power out of a motion that comes back to where it began."""
    work, effort = np.zeros(len(recording.q)), np.zeros(len(recording.q))
    for samples in recording.segments:
        q, tau = recording.q[:, samples], recording.tau[:, samples]
        travel = np.diff(q, axis=1)
        middle = (tau[:, 1:] + tau[:, :-1]) / 2
        work += np.sum(middle * travel, axis=1)
        effort += np.linalg.norm(middle, axis=1) * np.linalg.norm(travel, axis=1)
    returned = np.abs(recording.q[:, -1] - recording.q[:, 0]) <= RETURNED * np.ptp(recording.q, axis=1)
    found = []
    for i in np.flatnonzero(returned & (effort > 0)):
        part = float(work[i] / effort[i])
        if part < -AGAINST_MOTION:
            cure = turned_round(recording.cells, f"tau{i + 1}")
            said = f"its torque brakes the motion on the whole, as friction does and no motor (work of {work[i]:.3g} J)"
            cure = f"expected positive where it drives towards positive positions: pass {cure}"
            found.append(Suspicion(int(i) + 1, "sign", said, cure))
    return found
